// SPDX-License-Identifier: MIT
// One effect of the answer: its name or family, what speaks for it, and what cannot be excluded beside it.
#pragma once
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "analysis/diagnose/evidence/fit.h"
#include "analysis/diagnose/evidence/references.h"

namespace imucal {

struct CandidateEvidence {
  const Effect* effect = nullptr;       // or
  const Reference* reference = nullptr; // a free shape, or
  bool is_family = false;               // a family as a whole
  Family family = Family::kSlowNoise;
  double gain_nats = 0, threshold_nats = 0;
  double evidence_nats() const { return gain_nats - threshold_nats; }
};
CandidateEvidence evidence_for(const Effect& effect, double gain_nats, double threshold_nats);

// Why a name is not more than that.
enum class Doubt {
  kNone,
  kMemberOpen, // the family is told, its member is not
  kShapeOpen,  // a free shape of the family explains it, no member does
  kLoopOpen,   // the states in which runs began are seen, and not the loop that they belong to
  kSlowNoise,  // slow noise would explain it as well: these logs cannot tell
  kAgainst     // held-out data speak against it (it is then not named, only noted)
};

// held_out_nats of what predicts nothing: jumps in time, noise, structure.
constexpr double kPredictsNothing = std::numeric_limits<double>::quiet_NaN();

// Of an effect whose runs begin between two extremes of its own size: that size over its shape (the travel from one extreme to
// the other), where logs do not show the two apart, and the least shape that they allow (0: any).
struct OnlyRatio {
  Measured ratio;
  double least_shape = 0;
};

// The sizes of an effect in the runs, where each began from another start, and the largest of them: the mean of all that may be as
// large, each with its weight.
struct StartSizes {
  struct OfRun {
    int log;
    Measured size;
    double weight; // 0: it began smaller
  };
  std::vector<OfRun> runs; // empty: not such an effect
  Measured largest;
};

struct SelectedEffect {
  Family family = Family::kSlowNoise;
  bool is_family = false;    // the family is the name
  Term term;                 // the best member; term.effect is nullptr where only a free shape explains it
  bool is_any_shape = false; // found in a shape that its parameters do not tell: `term` is the nearest that they do
  double gain_nats = 0, evidence_nats = 0;
  double held_out_nats = 0;  // or kPredictsNothing
  bool is_untested = false;  // it predicts, but the logs held out can show neither it nor its start states
  bool is_of_starts = false; // held-out logs show no more of it than the states in which they began
  Doubt doubt = Doubt::kNone;
  // Held-out data speak against it, and it gained little: it came by chance and leaves nothing behind.
  bool came_by_chance = false;
  std::vector<CandidateEvidence> set; // what cannot be excluded, the name first
  // What it adds to the rates of a second, rms about the mean of the run [dph]; NaN: not known.  For the order of words.
  double rms_dph = std::numeric_limits<double>::quiet_NaN();
  std::optional<OnlyRatio> only_ratio;
  StartSizes start_sizes;
  bool is_structural = false;
  bool is_of_some_logs = false; // what single logs were rounded to: nothing of the device, nothing for its model
  std::string statement;        // of a structural detector
};

Term term_of(const Effect* effect, const EffectEstimator* estimator, const Theta& shape);

// Explained by a free shape alone.
bool is_free(const SelectedEffect& effect);
// The family is told, and no member has its shape.
inline bool is_shape_open(const SelectedEffect& effect) {
  return effect.doubt == Doubt::kShapeOpen;
}
// The family is told, for one of three reasons.
void open_member(SelectedEffect* effect);
void open_shape(SelectedEffect* effect);
void open_loop(SelectedEffect* effect);
// Evidence of less is weak: odds of less than 20 to 1 beyond what a name must gain.
constexpr double kWeak_nats = 3;
// The log shows that the thermometer has coarse steps; that the rates feel them it shows weakly at most.
bool are_steps_unfelt(const SelectedEffect& effect);
// What the recorder did, or axes share, where it is a small part of the noise from second to second, and steps of the thermometer
// that are not felt: worth a note, and no answer to what else is there.
bool is_note(const SelectedEffect& effect, double white_dph);
// It explains nothing: its shape is open, or was not seen.
bool is_shape_unknown(const SelectedEffect& effect);

bool is_in_set(const SelectedEffect& effect, const Effect* member);
// Behind what is in the set already, what gains most first; no name twice.
void add_to_set(std::vector<CandidateEvidence> list, SelectedEffect* effect);
// A family is worth what the best of its members in the set is.
void raise_family(SelectedEffect* effect);
// What no likelihood tells from the effect; nullptr: nothing.
void add_equal(const Effect* kind, SelectedEffect* effect);

} // namespace imucal
