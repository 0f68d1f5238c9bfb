// SPDX-License-Identifier: MIT
// What the slow stage says (slow_stage.h makes it): the hypothesis found in block means, what data that were not fitted
// say of it, and what is left beside it.
#pragma once
#include <memory>
#include <vector>

#include "analysis/diagnose/stages/gap.h"
#include "analysis/diagnose/stages/question.h"
#include "analysis/diagnose/stages/selected.h"

namespace imucal {

// A free shape beside an answer.
struct Beside {
  size_t candidate;
  double nats; // that it gains
};

// A kind of noise that follows the temperature, and how much less likely the seconds are by it than by the likeliest of these.
struct SlopedKind {
  const Effect* effect;
  double gap_nats;
};

struct SlowAnswer {
  std::unique_ptr<SlowData> data;        // block means of the fitted logs
  std::unique_ptr<SlowSearch> search;    // over them
  std::unique_ptr<Campaign> held_blocks; // block means of the held-out logs, or nullptr
  SlowResult found;
  GapResult gap;                       // what found.best predicts, over nothing
  double over_null_nats = 0;           // by how much it makes what was not fitted more likely than found.null does
  std::vector<Beside> beside;          // what found.best leaves of a cause
  std::vector<SelectedEffect> dropped; // names that held-out data do not support
  std::vector<SlopedKind> sloped;      // where found.best has one: what the seconds say of them (sloped_noise.h)
  bool is_told_by_held_out = false;    // slow noise explains the fitted logs as well, not all logs together
  bool has_lines = false;              // lines of the spectrum are in every mean: the gap counts what they take
  bool is_noise_of_all = false;        // all logs together tell the kind of slow noise, its parameters estimated on all

  const Candidate& candidate(size_t j) const { return search->candidates()[j]; }
  CandidateEvidence evidence_of(size_t candidate, double gain_nats, double threshold_nats) const;
  // Of everything found over nothing but noise.
  double gain_nats() const { return found.best.free_score() - found.null.free_score(); }
  // Whether a shape that gains so much beside the answer is held against it.
  bool leaves_much(double nats, const SelectorConstants& constants) const;
  // Whether a name of found.best, or any, is the free function of everything that repeats.
  bool is_free_function(size_t name) const { return candidate(found.best.names[name].candidate).is_free_function; }
  bool has_free_function() const;
  // Whether held-out logs can show enough of a name of found.best, beyond its start states or with them, to be asked for it.
  // Quarters of one log always are.
  bool can_test(size_t name, const SelectorConstants& constants) const;
  // Rows of a log before which a name of found.best jumps.
  std::vector<size_t> rows_of_jumps(const RunInput& in) const;
  // Whether held-out logs become less likely by the answer, and all logs together do not speak for its noise.
  bool is_against(const SelectorConstants& constants) const;
  // No cause is left in the answer.
  void forget_causes();
  // What found.best predicts, after it was changed.
  void measure();
};

// Whether held-out logs can show so much of a name.
bool can_show(const Support& support, const SelectorConstants& constants);

// A name of found.best as an effect of the answer, with the rivals that cannot be excluded.
SelectedEffect effect_of_name(const SlowAnswer& slow, const SelectorConstants& constants, size_t name);

} // namespace imucal
