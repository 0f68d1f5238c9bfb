// SPDX-License-Identifier: MIT
// From evidence to an answer: which names and families the slow and the fast stage support, what they leave, and the
// verdict.  Nothing here is decided by words; they are made in host/tools/diagnose.
#pragma once
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "analysis/diagnose/judge/verdict.h"
#include "analysis/diagnose/logs/structure.h"
#include "analysis/diagnose/search/search.h"
#include "analysis/diagnose/stages/gap.h"
#include "analysis/diagnose/stages/rest.h"
#include "analysis/diagnose/stages/selected.h"

namespace imucal {

struct Selection {
  Verdict verdict = Verdict::kNoGap;
  std::vector<SelectedEffect> effects;
  std::vector<SelectedEffect> dropped; // names that held-out data do not support
  Hypothesis nominal, final;           // of the seconds
  Fit nominal_fit, final_fit;
  std::vector<CandidateEvidence> first_scan;
  std::vector<RestFinding> before, after; // tests of innovations of the nominal and of the final model
  std::vector<StepValue> own_jumps;       // of held-out logs, beside everything that is told
  struct Strength {
    int log;
    double times;
  };
  std::vector<Strength> stronger_noise;      // of held-out logs, over that of the fitted ones
  std::vector<RestFinding> unseen;           // tests of innovations of the held-out logs
  std::vector<CandidateEvidence> remainders; // what gains beside the names, or in their place, and is no name
  double total_gain_nats = 0;
  size_t n_dropouts = 0; // exact zeros that are no rates, left out: too few for a finding
  size_t n_left_out = 0; // seconds that structure has spoilt
  bool is_noise_retuned = false;
  bool is_told_by_held_out = false; // slow noise explains the fitted logs as well, not all logs together
  // Of the held-out minutes so much more than noise and errors of the fit that nothing is explained.
  bool leaves_mean = false;
  bool exceeds_noise = false; // more, as far as its scatter tells
  bool cannot_judge = false;  // structure left too little: `effects` holds what the recorder did, nothing else is known
  NullTail chance;            // what noise alone gains in the search for names
  NoiseModel fitted_noise;    // of the seconds, under the final hypothesis
  double white_dph = 0;       // white noise from second to second, over the samples of the logs
};

struct SelectOptions {
  SelectorConstants constants;
  StructureResult structure = {}; // what is masked in the campaigns already
  // The thresholds for this campaign, found before the search; empty: as given.
  std::function<Thresholds(SlowSearch*)> calibrate = {};
  // See AxisQuestion.
  std::function<double(const SlowSearch&, const SlowModel&)> threshold_under = {};
};

// All stages of one axis.  Leaves out of `campaign` and `held_out` what is too short; no runs of `held_out` left: as if none had
// been given.
struct AxisStudy {
  Selection selection;
  std::unique_ptr<SlowData> data;
  std::unique_ptr<SlowSearch> search;
  SlowResult slow;
  GapResult gap;
};
AxisStudy study_axis(Campaign* campaign, Campaign* held_out, const NoiseBelief& belief,
                     const std::vector<const Effect*>& library, const std::vector<bool>& active,
                     const SelectOptions& options);

} // namespace imucal
