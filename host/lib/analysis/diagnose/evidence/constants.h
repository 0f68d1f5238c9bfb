// SPDX-License-Identifier: MIT
// The margins of the selector: what a name, a kind of noise, a free shape or held-out data must gain or may lose.  The
// defaults are the ones in use; they are passed down, so that `make selector-table` can run the same cases at half and at
// double of each.  What a constant means and where its value comes from stands beside its name in constants.cpp.  Other
// numbers that bear on an answer (how many names or jumps are few, how many candidates are tried, cells and scales of the
// tests of what is left) stand beside their one use.
#pragma once
#include <vector>

namespace imucal {

// Unit "nats": natural logarithm of a likelihood ratio.  Others are parts (no unit).
struct SelectorConstants {
  // Search: slow causes on block means (search.h and what it uses).
  double mean_nats = 6;
  double noise_nats = 6;
  double step_nats = 8;
  double first_step_nats = 1.5;
  double step_try_part = 0.3;
  double reestimated_nats = 6;
  double noise_kind_nats = 3;
  double near_nats = 10;
  double near_part = 0.3;
  double below_null_nats = 1;
  double more_names_nats = 3;
  double rivals_nats = 3;
  double member_share = 0.85;
  // Threshold from draws of the fitted noise (null_draws.h).
  double polish_gain_nats = 1;
  double least_threshold_nats = 4;
  double most_threshold_nats = 14;
  // Selection: held-out data, names, families, verdict (slow_stage.h, slow_names.h, rest_names.h, select.h).
  double family_margin_nats = 2;
  double least_held_out_nats = 1;
  double predicted_part = 0.2;
  double short_by_chance = 2.33;
  double undecided_nats = 4;
  double carried_part = 0.75;
  double slow_tau_part = 0.05;
  double agreed_tau_part = 0.3;
  double growth_part = 0.02;
  double noise_errors = 3;
  double noise_times = 1.4;
  double lack_nats = 3;
  double lack_part = 0.1;
  double foretold_nats = 5;
  double foretold_part = 0.5;
  double least_share = 0.1;
  double beside_free_part = 0.33;
  double noise_margin_nats = 6;
  double against_nats = 3;
  // Fast causes in the seconds (seconds_noise.h, mean_lines.h, jumping.h, shared.h).
  double fast_nats = 8;
  double line_nats = 22;
  double drift_nats = 28;
  double retuned_nats = 7;
  double rest_rate = 1e-3;
  double rest_line_nats = 20;
  double shared_nats = 8;

  // Of so many jumps in time.
  double cost_of_jumps(size_t n) const { return n ? first_step_nats + step_nats * static_cast<double>(n) : 0; }
};

// One of them, for tables and tests.
struct SelectorConstant {
  const char* name;
  double SelectorConstants::*value;
  const char* meaning; // what it decides
  const char* source;  // where its value comes from
  bool is_part;        // a share of something: 1 is its largest sensible value
};
const std::vector<SelectorConstant>& selector_constants();

} // namespace imucal
