// SPDX-License-Identifier: MIT
// Temperature profile of a chamber (host/formats.md, Profile): soaks and ramps from a start temperature, repeated.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "base/units.h"
#include "io/json.h"

namespace imucal {

struct ProfileSegment {
  double rate_degc_per_min = 0; // 0: soak of duration_s; otherwise a ramp to to_degc (sign follows to_degc)
  double duration_s = 0;        // given for a soak, derived for a ramp
  double to_degc = 0;           // given for a ramp, derived for a soak
};

struct Profile {
  double start_degc = 0;
  std::vector<ProfileSegment> segments;
  int repeat = 1; // the segments are run this many times; from the second on they start where the last ended

  double duration_s() const;
  double min_degc() const;
  double max_degc() const;
  // Chamber temperature at t_s from the start; the end temperature beyond the end.
  double at(double t_s) const;
  // One temperature per second k = 1 … n: at the middle of the second that ends at t = k dt.
  std::vector<double> temperatures(double dt_s = 1.0) const;
};

// Segments flattened over repeats with absolute start times: what `at` walks.
struct ProfileLeg {
  double start_s, end_s, start_degc, end_degc;
  double rate_degc_per_min() const { return kSecondsPerMinute * (end_degc - start_degc) / (end_s - start_s); }
};
std::vector<ProfileLeg> legs(const Profile& profile);

Profile read_profile(const std::string& path); // data_error: missing fields, a ramp that goes nowhere, no time
Profile profile_from_json(const JsonField& field);
Json to_json(const Profile& profile);

} // namespace imucal
