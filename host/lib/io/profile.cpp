// SPDX-License-Identifier: MIT
#include "io/profile.h"

#include <algorithm>
#include <cmath>

#include "base/format.h"
#include "base/units.h"
#include "io/json_file.h"
#include "io/notice.h"

namespace imucal {

static constexpr double kSameMember = 0.01;            // of a number that says what is known already: it was rounded
static constexpr double kMaxDurationS = 366 * 86400.0; // what it is for takes hours; a year still fits into memory

std::vector<ProfileLeg> legs(const Profile& profile) {
  std::vector<ProfileLeg> out;
  double t_s = 0, temp_degc = profile.start_degc;
  for (int cycle = 0; cycle < profile.repeat; ++cycle) {
    for (const ProfileSegment& s : profile.segments) {
      const bool soak = s.rate_degc_per_min == 0;
      const double end_degc = soak ? temp_degc : s.to_degc;
      const double lasts_s =
          soak ? s.duration_s : std::abs((end_degc - temp_degc) / s.rate_degc_per_min) * kSecondsPerMinute;
      if (lasts_s <= 0) continue;
      out.push_back({t_s, t_s + lasts_s, temp_degc, end_degc});
      t_s += lasts_s;
      temp_degc = end_degc;
    }
  }
  return out;
}

double Profile::duration_s() const {
  const auto all = legs(*this);
  return all.empty() ? 0.0 : all.back().end_s;
}

double Profile::min_degc() const {
  double lowest = start_degc;
  for (const ProfileLeg& leg : legs(*this)) lowest = std::min(lowest, leg.end_degc);
  return lowest;
}

double Profile::max_degc() const {
  double highest = start_degc;
  for (const ProfileLeg& leg : legs(*this)) highest = std::max(highest, leg.end_degc);
  return highest;
}

static double leg_temperature(const ProfileLeg& leg, double t_s) {
  return leg.start_degc + (leg.end_degc - leg.start_degc) * (t_s - leg.start_s) / (leg.end_s - leg.start_s);
}

double Profile::at(double t_s) const {
  const auto all = legs(*this);
  if (all.empty() || t_s <= 0) return start_degc;
  if (t_s >= all.back().end_s) return all.back().end_degc;
  const auto leg = std::upper_bound(all.begin(), all.end(), t_s,
                                    [](double t, const ProfileLeg& candidate) { return t < candidate.end_s; });
  return leg_temperature(*leg, t_s);
}

std::vector<double> Profile::temperatures(double dt_s) const {
  const auto all = legs(*this);
  std::vector<double> out;
  if (all.empty()) return out;
  const auto n = static_cast<size_t>(std::floor(all.back().end_s / dt_s + 1e-9));
  out.reserve(n);
  size_t leg = 0;
  for (size_t k = 0; k < n; ++k) {
    const double t_s = (static_cast<double>(k) + 0.5) * dt_s;
    while (leg + 1 < all.size() && t_s >= all[leg].end_s) ++leg;
    out.push_back(leg_temperature(all[leg], t_s));
  }
  return out;
}

// A member that is given and not followed; pattern: of what is followed and what is given.
static void note_ignored(const JsonField& member, double followed, const char* pattern) {
  const double given = member.number();
  if (std::abs(given - followed) <= kSameMember * std::max(1.0, std::abs(followed))) return;
  notice(member.place() + ": " + format(pattern, followed, given));
}

// `is_only_first`: no other segment or cycle has moved the temperature before it.
static ProfileSegment segment_from_json(const JsonField& f, bool is_only_first, double* temp_degc) {
  f.only({"rate_degc_per_min", "duration_s", "to_degc"});
  ProfileSegment s;
  s.rate_degc_per_min = f.at("rate_degc_per_min").number(-1e4, 1e4);
  if (s.rate_degc_per_min == 0) {
    s.duration_s = f.at("duration_s").number(0.0, 1e9);
    s.to_degc = *temp_degc;
    if (const auto to = f.find("to_degc"))
      note_ignored(*to, s.to_degc,
                   "a soak (rate 0) stays at %.6g degC; %.6g is not followed: for a ramp give its rate");
    return s;
  }
  s.to_degc = f.at("to_degc").number(-273.15, 2000.0);
  if (s.to_degc == *temp_degc && is_only_first)
    f.refuse("a ramp to the temperature it starts from; give a soak (rate 0, duration_s) instead");
  s.duration_s = std::abs((s.to_degc - *temp_degc) / s.rate_degc_per_min) * kSecondsPerMinute;
  if (const auto duration = f.find("duration_s"))
    note_ignored(
        *duration, s.duration_s,
        "a ramp lasts as long as its rate takes, %.6g s; %.6g s are not followed: change the rate, or leave it out");
  // The sign of a rate says nothing that to_degc does not; both spellings are taken.
  s.rate_degc_per_min = std::copysign(s.rate_degc_per_min, s.to_degc - *temp_degc);
  *temp_degc = s.to_degc;
  return s;
}

// From the second cycle on the segments start where the last one ended: a ramp to that temperature takes no time there.
static void note_lost_ramps(const JsonField& field, const Profile& profile) {
  if (profile.repeat < 2 || profile.segments.empty()) return;
  double temp_degc = profile.segments.back().to_degc;
  if (temp_degc == profile.start_degc) return;
  for (size_t i = 0; i < profile.segments.size(); ++i) {
    const ProfileSegment& s = profile.segments[i];
    if (s.rate_degc_per_min != 0 && s.to_degc == temp_degc && s.duration_s > 0) {
      return notice(
          field.place() +
          format(
              ": repeat: each further cycle starts where the last one ended, at %.6g degC: the ramp of segments[%zu] "
              "to %.6g degC is there only the first time; add a ramp back to %.6g degC at the end",
              profile.segments.back().to_degc, i, s.to_degc, profile.start_degc));
    }
    if (s.rate_degc_per_min != 0) temp_degc = s.to_degc;
  }
}

Profile profile_from_json(const JsonField& field) {
  if (field.version_of("imucal_profile", "a profile").integer(0, 1000000) != 1)
    field.at("imucal_profile").refuse("version not known to this program (it knows 1)");
  field.only({"imucal_profile", "start_degc", "segments", "repeat"});
  Profile profile;
  profile.start_degc = field.at("start_degc").number(-273.15, 2000.0);
  double temp_degc = profile.start_degc;
  for (const JsonField& f : field.at("segments").elements())
    profile.segments.push_back(
        segment_from_json(f, profile.segments.empty() && field.number_or("repeat", 1) == 1, &temp_degc));
  profile.repeat = field.find("repeat") ? static_cast<int>(field.at("repeat").integer(1, 10000)) : 1;
  if (profile.duration_s() > kMaxDurationS)
    field.at("segments")
        .refuse("the profile lasts " + std::to_string(profile.duration_s() / 86400) +
                " days; at most 366 are possible");
  if (profile.duration_s() < 1.0)
    field.at("segments").refuse("the profile lasts less than one second; add a soak or a ramp");
  note_lost_ramps(field, profile);
  return profile;
}

Profile read_profile(const std::string& path) {
  return profile_from_json(read_json(path));
}

Json to_json(const Profile& profile) {
  Json json = {{"imucal_profile", 1}, {"start_degc", profile.start_degc}, {"segments", Json::array()}};
  for (const ProfileSegment& s : profile.segments) {
    if (s.rate_degc_per_min == 0)
      json["segments"].push_back({{"rate_degc_per_min", 0}, {"duration_s", s.duration_s}});
    else
      json["segments"].push_back({{"rate_degc_per_min", s.rate_degc_per_min}, {"to_degc", s.to_degc}});
  }
  json["repeat"] = profile.repeat;
  return json;
}

} // namespace imucal
