// SPDX-License-Identifier: MIT
// Hypotheses of the slow search: causes in the mean, jumps in time and a kind of slow noise, with the noise parameters under
// which they are judged, and what a search over them says.
#pragma once
#include <memory>
#include <optional>
#include <vector>

#include "analysis/diagnose/evidence/references.h"
#include "analysis/diagnose/evidence/scan.h"
#include "physics/effects/effect.h"

namespace imucal {

// A size that is seen is more than so many standard errors from none.
constexpr double kSeenErrors = 3;

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

// A candidate of the search: an effect of the library, the same effect of any shape, or a free shape.
struct Candidate {
  const Effect* effect = nullptr; // nullptr: a free shape
  const Reference* reference = nullptr;
  size_t place = 0; // in the library or the list of free shapes
  ScanCandidate scan;
  bool is_any_shape = false;     // the effect, of a shape that its parameters do not tell
  bool is_once = false;          // it happens once in the one fitted log, and again in those held out, which tell
                                 // it from a jump in time: no name beside one
  bool is_free_function = false; // of everything that repeats: no scan asks it, it stands against answers
  Family family() const { return effect ? effect->family() : reference->family; }
  bool is_member() const { return effect && !is_any_shape; } // of a shape that a few parameters tell
};

// One hypothesis.
struct SlowModel {
  struct Name {
    size_t candidate;
    Theta shape;
    double charge = 0; // of the shape
    bool is_at_bound = false;
    double beyond_nats = 0;     // that the same effect of any shape gains more, where this one stands in its place
    bool is_start_only = false; // nothing but the state in which every run began: what is left without the cause itself
  };
  std::vector<Name> names;
  std::vector<Theta> steps; // run, t_s of jumps that are in the mean beside the names
  const Effect* noise_effect = nullptr;
  Theta noise_theta;
  double noise_charge = 0;
  double log_noise[3] = {0, 0, 0}; // white noise, slow density, tau: logarithms of factors on the base
  bool is_believed = false;        // with the noise as believed
  bool is_noise_white = false;     // and nothing else: least squares
  bool is_without_lines = false;   // lines of the spectrum that were taken into the mean are left in the rates
  double value = -1e300;           // log marginal likelihood with the prior of the noise and its cost
  SlowModel without(size_t name) const;
  void take_noise_of(const SlowModel& other); // its parameters, not its kind
  void drop_swallowed();                      // its noise as left_by_swallowed has it
  double charges() const;
  bool can_be() const { return value > -1e299; }          // not: a jump is not seen, or the logs do not hold a shape
  double free_score() const { return value - charges(); } // without thresholds
};

struct SlowCandidateScore {
  // Of `model`, over no other hypothesis: its free_score(), or score() where thresholds count; from a scan the mean likelihood
  // over the shapes of its last name.
  double score_nats = 0;
  SlowModel model;
};

struct SlowResult {
  SlowModel null, best;
  // Per name of `best`: what it gains over the best hypothesis without it, beyond its threshold.
  std::vector<double> evidence;
  std::optional<double> noise_evidence; // the same of its kind of slow noise; none: it has none, or was not judged
  bool has_noise() const { return best.noise_effect && noise_evidence.value_or(0) > 0; } // worth its name
  // Per name of `best`: what comes near in its place (within near_nats), best first.  Those within rivals_nats cannot be
  // told from it.
  struct Rival {
    size_t candidate;
    const Effect* noise_effect; // or this
    double gap_nats;            // by which it makes the logs less likely
    SlowModel model;            // with it in the place of the name
  };
  std::vector<std::vector<Rival>> rivals;
  std::vector<SlowCandidateScore> singles; // per candidate
  std::vector<SlowCandidateScore> noises;  // per slow noise effect of the library that was tried
  double step_gain_nats = 0;               // the same of all jumps of `best` together
  // Where jumps in time were found: the answer without them.  Other data choose between the two.
  std::shared_ptr<const SlowResult> without_steps;
  std::vector<size_t> replaced; // free shapes that gain somewhat more than the member named in their place
};

// Whether both name the same candidates, in any order.
bool have_same_names(const SlowModel& a, const SlowModel& b);
// The highest first.
void sort_by_score(std::vector<SlowCandidateScore>* scores);

} // namespace imucal
