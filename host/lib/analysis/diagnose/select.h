// SPDX-License-Identifier: MIT
// Which effects: forward selection of up to three with swaps and drops, every candidate judged with the
// nominal and with re-estimated noise, and what no candidate explains.
#pragma once
#include <string>
#include <vector>

#include "analysis/diagnose/nulls.h"

namespace imucal {

struct CandidateEvidence {
  std::string name;
  double gain_nats = 0; // over the hypothesis it is added to
  double threshold_nats = 0;
  double evidence_nats = 0;         // gain - threshold
  double gain_reestimated_nats = 0; // with the noise parameters estimated on both sides; NaN: not needed
};

struct SelectedEffect {
  Term term;
  double gain_nats = 0, evidence_nats = 0, p_value = 1;
  std::vector<CandidateEvidence> set; // candidates that cannot be excluded, this one first
  bool is_structural = false;
  std::string statement; // of a structural effect
};

struct GenericFinding {
  size_t test = 0;
  double gain_nats = 0, threshold_nats = 0;
  double evidence_nats() const { return gain_nats - threshold_nats; }
};

enum class Verdict { kNoGap, kExplained, kPartlyExplained, kUnexplained };
std::string to_text(Verdict verdict);

struct Selection {
  Verdict verdict = Verdict::kNoGap;
  std::vector<SelectedEffect> effects;
  Hypothesis nominal, final;
  std::vector<CandidateEvidence> first_scan; // all candidates over the nominal model
  std::vector<GenericFinding> before, after; // library-free tests on the nominal and the final model
  std::vector<std::string> notes;            // sentences for the reader
  double total_gain_nats = 0;
};

struct SelectOptions {
  int max_effects = 3;
  double set_width_nats = 3;
  double noise_discount =
      1; // of what re-tuned noise parameters gain, when the nominal ones were estimated themselves
};

// `library`: all effects (order of the calibration); `active`: those that may be named.
Selection select_effects(Campaign* campaign, const Hypothesis& nominal,
                         const std::vector<const Effect*>& library, const std::vector<bool>& active,
                         const Calibration& calibration, const Thresholds& thresholds,
                         const SelectOptions& options);

} // namespace imucal
