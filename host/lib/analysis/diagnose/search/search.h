// SPDX-License-Identifier: MIT
// The slow search, which the slow stage (stages/slow_stage.h) asks: which causes in the mean and which kind of slow noise explain the block means of a campaign, the
// noise parameters estimated again under every hypothesis.
//
// Score of a hypothesis M (names a_1 .. a_k in the mean, one kind of noise):
//   S(M) = max over nu, theta of [ log p(y | M, nu, theta) + log p(nu) ] - charges
// Charges: the shape of every name (logarithm of maximum over mean of the likelihood over its grid), a threshold per
// name, and what a noise other than the believed one costs.  The best score wins; names are kept only while each of
// them earns its own threshold.
#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "analysis/diagnose/evidence/constants.h"
#include "analysis/diagnose/search/null_tail.h"
#include "analysis/diagnose/search/slow_model.h"
#include "analysis/diagnose/search/time_jumps.h"

namespace imucal {

// What must be gained: by a name in the mean; by jumps in time together, beyond what each must.
struct Thresholds {
  NullTail mean;
  double first_step_nats;
};

class SlowSearch {
public:
  // `data` and `held_out`, of which only the temperatures are read (nullptr: none), must outlive it.
  SlowSearch(const SlowData& data, const NoiseBelief& belief, const std::vector<const Effect*>& library,
             const std::vector<bool>& active, const SelectorConstants& constants, const Campaign* held_out = nullptr);
  ~SlowSearch();

  SlowResult run();

  // Calibration: draws of the fitted noise (with the fitted polynomial), each searched over all candidates and nodes of
  // noise as the data are; the largest gain of each draw over its own best noise.
  std::vector<double> null_gains(size_t draws, uint64_t seed);
  // The same of draws of another noise without a name, one with a kind of slow noise; its own node is searched too.
  std::vector<double> gains_under(const SlowModel& noise, size_t draws, uint64_t seed) const;
  // Names everything that null_gains depends on, to the last bit: what is kept under it is what would be drawn.
  std::string null_key(size_t draws, uint64_t seed) const;
  void set_thresholds(const Thresholds& thresholds);
  // How finely the starts of the loop that the logs may hold must be followed (start_halvings.h); the data may be coarser.
  int start_halvings();
  void forget_scans(); // frees what is quick to make anew: of a long log, hundreds of megabytes

  const std::vector<Candidate>& candidates() const;
  NoiseModel noise_of(const SlowModel& model) const;         // of block means, with what its noise effect makes
  NoiseModel seconds_noise_of(const SlowModel& model) const; // of 1-s means, the same
  NoiseModel base_noise_of(const SlowModel& model) const;    // of 1-s means, without the noise effect
  // The columns of a model on this or on other data: steps belong to the runs of the data searched, which come first.
  std::vector<MeanPart> parts_on(const SlowData& data, const SlowModel& model) const;
  RunGrams grams_of(const SlowModel& model) const;
  double score(const SlowModel& model) const; // less all thresholds: what the search maximises
  // What comes near a name in its place, best first, by the data searched.
  std::vector<SlowResult::Rival> rivals(const SlowModel& model, size_t name) const;
  // Free shapes beside a model, the one that gains most first: what its names leave unexplained.
  std::vector<SlowCandidateScore> free_beside(const SlowModel& model, size_t most) const;
  // The free function of everything that repeats beside a model, with its noise or that of `also`, whichever is likelier
  // (no name at all: the campaign has no temperature).  Not estimated again.
  SlowModel with_free_function(const SlowModel& model, const SlowModel& also) const;
  // The same kind of noise beside the noise as believed, its parameters estimated again.
  SlowModel beside_believed(const SlowModel& model) const;
  // The same kind of noise where it takes most of what the rest of the noise held.
  SlowModel in_place_of_base(const SlowModel& model) const;
  // Every kind of slow noise in the place of that of a model, beside the same names, each from its best start.
  std::vector<SlowCandidateScore> kinds_beside(const SlowModel& model) const;
  // A free spectrum in the place of the kind of slow noise of a model.
  SlowModel with_free_spectrum(const SlowModel& model) const;
  // Noise and shape parameters estimated again.
  SlowModel polished(const SlowModel& model) const;
  // The value of a model on more logs than those searched, which come first in `all`: noise parameters estimated there.
  double value_on(const SlowData& all, const SlowModel& model) const;
  // With every effect of any shape in that of its parameters which comes nearest, the rest estimated again.
  SlowModel with_parameters(const SlowModel& model) const;
  // Whether its jumps in time all go one way, one after another in a log: no noise of two levels.
  bool has_teeth(const SlowModel& model) const;
  // Whether its jumps in time come again at the same temperatures (time_jumps.h).
  RepeatedJumps repeated_jumps(const SlowModel& model) const;
  // After a name of `best` was taken away: estimated again, members in the place of free shapes where they gain nearly as
  // much, evidence and rivals of every name anew.
  void judge_again(SlowResult* result) const;
  // The best hypothesis with exactly these causes (in the mean, and at most one kind of slow noise): what the search
  // would have to reach if it were told them.  Causes that block means cannot show are left out.
  SlowModel best_with(const std::vector<const Effect*>& effects) const;

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

} // namespace imucal
