// SPDX-License-Identifier: MIT
// The slow stage: which causes in the mean and which kind of slow noise explain the block means of a campaign, the
// noise parameters estimated again under every hypothesis.
//
// Score of a hypothesis M (names a_1 .. a_k in the mean, one kind of noise):
//   S(M) = max over nu, theta of [ log p(y | M, nu, theta) + log p(nu) ] - charges
// Charges: the shape of every name (logarithm of maximum over mean of the likelihood over its grid), a threshold per
// name, and what a noise other than the believed one costs.  The best score wins; names are kept only while each of
// them earns its own threshold.
#pragma once
#include <memory>
#include <string>
#include <vector>

#include "analysis/diagnose/constants.h"
#include "analysis/diagnose/references.h"
#include "analysis/diagnose/scan.h"
#include "physics/effects/effect.h"

namespace imucal {

// Another kind of noise may have been swallowed by a process of the fitted one.  What that process then leaves, where a
// search for the other kind starts: logarithms of factors on white noise, slow density and tau.
Theta left_by_swallowed();
// The slowest process of a noise that has one.
const Markov& slowest(const NoiseModel& noise);

// What is known of the noise before the logs.
struct NoiseBelief {
  NoiseModel model;            // the believed one, of 1-s means; or a start, where nothing is believed
  bool has_believed = false;   // it competes for every hypothesis
  bool has_data_sheet = false; // known to about a factor of two: prior, not competitor
  // Effects of the model that were taken out of the rates: the state each run began in is still free.
  struct Known {
    const EffectEstimator* estimator;
    Theta shape;
  };
  std::vector<Known> known = {};
};

// A candidate of the search: an effect of the library or a free shape.
struct Candidate {
  const Effect* effect = nullptr; // nullptr: a free shape
  const Reference* reference = nullptr;
  size_t place = 0; // in the library or the list of free shapes
  ScanCandidate scan;
  bool is_free_function = false; // of everything that repeats: no scan asks it, it stands against answers
  Family family() const { return effect ? effect->family() : reference->family; }
};

// One hypothesis.
struct SlowModel {
  struct Name {
    size_t candidate;
    Theta shape;
    double charge = 0; // of the shape
    bool is_at_bound = false;
    bool is_start_only = false; // nothing but the state in which every run began: what is left without the cause itself
  };
  std::vector<Name> names;
  std::vector<Theta> steps; // run, t_s of jumps that are in the mean beside the names
  const Effect* noise_effect = nullptr;
  Theta noise_theta;
  double noise_charge = 0;
  double log_noise[3] = {0, 0, 0}; // white noise, slow density, tau: logarithms of factors on the base
  bool is_believed = false;        // with the noise as believed
  bool is_without_lines = false;   // lines of the spectrum that were taken into the mean are left in the rates
  double value = -1e300;           // log marginal likelihood with the prior of the noise and its cost
  SlowModel without(size_t name) const;
  void take_noise_of(const SlowModel& other); // its parameters, not its kind
  double charges() const;
  double free_score() const { return value - charges(); } // without thresholds
};

struct SlowCandidateScore {
  double gain_nats = 0; // over the best hypothesis without a name, shape charged
  SlowModel model;
};

struct SlowResult {
  SlowModel null, best;
  // Per name of `best` (and, last, its noise effect): what it gains over the best hypothesis without it.
  std::vector<double> evidence;
  // Per name of `best`: candidates that would do as well in its place (within rivals_nats), best first.
  struct Rival {
    size_t candidate;
    const Effect* noise_effect; // or this
    double gap_nats;            // by which it scores less
  };
  std::vector<std::vector<Rival>> rivals;
  std::vector<SlowCandidateScore> singles; // per candidate
  std::vector<SlowCandidateScore> noises;  // per slow noise effect of the library that was tried
  std::vector<const Effect*> noise_effects;
  double step_gain_nats = 0; // of all jumps of `best` over the null without them
  // Where jumps in time were found: the answer without them.  Other data choose between the two.
  std::shared_ptr<const SlowResult> without_steps;
  std::vector<size_t> replaced; // free shapes that gain somewhat more than the member named in their place
};

class SlowSearch {
public:
  SlowSearch(const SlowData& data, const NoiseBelief& belief, const std::vector<const Effect*>& library,
             const std::vector<bool>& active, const SelectorConstants& constants);
  ~SlowSearch();

  SlowResult run();

  // Calibration: draws of the fitted noise (with the fitted polynomial), each searched over all candidates and nodes of
  // noise as the data are; the largest gain of each draw over its own best noise.
  std::vector<double> null_gains(size_t draws, uint64_t seed);
  // Names everything that null_gains depends on, to the last bit: what is kept under it is what would be drawn.
  std::string null_key(size_t draws, uint64_t seed) const;
  void set_mean_threshold(double nats); // of a name in the mean

  const std::vector<Candidate>& candidates() const;
  NoiseModel noise_of(const SlowModel& model) const;         // of block means, with what its noise effect makes
  NoiseModel seconds_noise_of(const SlowModel& model) const; // of 1-s means, the same
  NoiseModel base_noise_of(const SlowModel& model) const;    // of 1-s means, without the noise effect
  // The columns of a model on this or on other data: steps belong to the runs of the data searched, which come first.
  std::vector<MeanPart> parts_on(const SlowData& data, const SlowModel& model) const;
  RunGrams grams_of(const SlowModel& model) const;
  static bool have_same_names(const SlowModel& a, const SlowModel& b);
  double score(const SlowModel& model) const; // less all thresholds: what the search maximises
  // What a name gains over the best hypothesis without it, less its threshold.
  double evidence_of(const SlowModel& model, size_t name) const;
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
  // Noise and shape parameters estimated again.
  SlowModel polished(const SlowModel& model) const;
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

// The threshold that the largest gain of a draw exceeds with probability `rate`: exponential tail above the upper fifth.
double null_threshold(std::vector<double> gains, double rate, const SelectorConstants& constants = {});

} // namespace imucal
