// SPDX-License-Identifier: MIT
// Profiles described by a few numbers, for an optimiser: stops (temperature, soak) joined by ramps.
#pragma once
#include <string>
#include <vector>

#include "base/units.h"
#include "io/profile.h"

namespace imucal {

// What the chamber and the user allow.  Rates in degC/min, both positive.
struct ChamberLimits {
  double lo_degc = 0, hi_degc = 0;
  double heating_degc_per_min = 0, cooling_degc_per_min = 0;
  double min_soak_s = 0;
  double max_soak_s = 0; // 0: unlimited
  double span_degc() const { return hi_degc - lo_degc; }
  double traverse_s(bool heating) const {
    return kSecondsPerMinute * span_degc() / (heating ? heating_degc_per_min : cooling_degc_per_min);
  }
};

// A chain of stops.  Stops may share variables (an up and a down pass with the same interior levels), so that
// many passes still have few variables.
struct ScheduleShape {
  std::string name;
  struct Stop {
    double level;          // 0 = lo, 1 = hi; where the search starts from when it is variable
    int level_var = -1;    // which level variable; -1: fixed
    bool mirrored = false; // level = 1 - variable
    int weight_var = 0;    // which soak weight
  };
  std::vector<Stop> stops;
  bool free_rates = false; // ramps may be slower than the limit, each by its own factor

  size_t n_levels() const;
  size_t n_weights() const;
  size_t n_variables() const; // levels, then soak weights, then rate fractions: all in [0, 1]
  std::vector<double> start() const;
  double level_of(const Stop& stop, const std::vector<double>& variables) const;
};

// A chain in which every stop has its own soak weight and every level inside (0, 1) its own variable.
ScheduleShape chain_shape(const std::string& name, const std::vector<double>& levels, bool free_rates);

// Passes between the ends of the range with `interior` soaks on the first `passes_with_interior` of them.
// tied: all passes share the interior levels and weights (mirrored about the middle), inner ends share one
// weight.
ScheduleShape passes_shape(int passes, int interior, int passes_with_interior, bool starts_hot, bool free_rates,
                           bool tied);

// Turns variables into a profile that lasts duration_s.  The soaks share the time that the ramps leave over, in
// proportion to their weights and within the limits on soaks.  Where all soaks are at their maximum the ramps
// are slowed.  Returns false where fastest ramps and shortest soaks last longer than duration_s, or where stops
// at one temperature together soak longer than allowed; *excess_s then says by how much.
bool make_profile(const ScheduleShape& shape, const std::vector<double>& variables, const ChamberLimits& limits,
                  double duration_s, Profile* profile, double* excess_s);

// Rounded for people and chamber controllers: temperatures to 0.01 degC, soaks to seconds, soaks below a second
// dropped, rates to 1e-6 degC/min.  So that duration_s is kept, the longest soak takes the remainder, and what the limits on
// soaks leave changes the rate of a ramp within the chamber's limits: to half a second, or, where no soak and no ramp has
// room, to the time that 0.01 degC takes.
Profile rounded(const Profile& profile, double duration_s, const ChamberLimits& limits);

// The paper's profile for a duration: ramps at the limit between the ends (passes of them, up first), equal
// soaks at both ends.  Soak 0 where the ramps alone take longer.
Profile paper_profile(const ChamberLimits& limits, double duration_s, int passes = 1);

} // namespace imucal
