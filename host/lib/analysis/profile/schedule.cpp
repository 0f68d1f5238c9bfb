// SPDX-License-Identifier: MIT
#include "analysis/profile/schedule.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace imucal {

size_t ScheduleShape::n_levels() const {
  int n = 0;
  for (const Stop& s : stops) n = std::max(n, s.level_var + 1);
  return static_cast<size_t>(n);
}

size_t ScheduleShape::n_weights() const {
  int n = 0;
  for (const Stop& s : stops) n = std::max(n, s.weight_var + 1);
  return static_cast<size_t>(n);
}

size_t ScheduleShape::n_variables() const {
  return n_levels() + n_weights() + (free_rates ? stops.size() - 1 : 0);
}

std::vector<double> ScheduleShape::start() const {
  std::vector<double> x(n_levels() + n_weights(), 0.5);
  for (size_t i = stops.size(); i-- > 0;)
    if (stops[i].level_var >= 0)
      x[static_cast<size_t>(stops[i].level_var)] = stops[i].mirrored ? 1 - stops[i].level : stops[i].level;
  if (free_rates) x.resize(x.size() + stops.size() - 1, 0.9);
  return x;
}

double ScheduleShape::level_of(const Stop& stop, const std::vector<double>& variables) const {
  if (stop.level_var < 0) return stop.level;
  const double level = std::clamp(variables[static_cast<size_t>(stop.level_var)], 0.0, 1.0);
  return stop.mirrored ? 1 - level : level;
}

ScheduleShape chain_shape(const std::string& name, const std::vector<double>& levels, bool free_rates) {
  ScheduleShape shape;
  shape.name = name;
  shape.free_rates = free_rates;
  int n_levels = 0, n_weights = 0;
  for (double level : levels)
    shape.stops.push_back({level, level > 0 && level < 1 ? n_levels++ : -1, false, n_weights++});
  return shape;
}

// Interior support of the G-optimal design for orders 2 … 5 (zeros of the Legendre derivative, Guest 1958),
// evenly spread beyond.
static std::vector<double> interior_levels(int count) {
  switch (count) {
  case 0:
    return {};
  case 1:
    return {0.5};
  case 2:
    return {0.2763932, 0.7236068};
  case 3:
    return {0.1726732, 0.5, 0.8273268};
  case 4:
    return {0.1174723, 0.3573842, 0.6426158, 0.8825277};
  default:
    break;
  }
  std::vector<double> out;
  for (int i = 1; i <= count; ++i) out.push_back(static_cast<double>(i) / (count + 1));
  return out;
}

ScheduleShape passes_shape(int passes, int interior, int passes_with_interior, bool starts_hot, bool free_rates,
                           bool tied) {
  ScheduleShape shape;
  shape.free_rates = free_rates;
  const int soaked = std::min(passes, passes_with_interior);
  shape.name = std::to_string(passes) + (passes == 1 ? " pass" : " passes");
  if (interior > 0 && soaked > 0)
    shape.name += ", " + std::to_string(interior) + " interior soak" + (interior == 1 ? "" : "s") +
                  (passes > 1 ? " on " + std::to_string(soaked) : "");
  shape.name += starts_hot ? ", from hot" : ", from cold";
  bool at_hot = starts_hot;
  int n_levels = tied ? interior : 0, n_weights = tied ? 2 + interior : 0;
  shape.stops.push_back({at_hot ? 1.0 : 0.0, -1, false, tied ? 0 : n_weights++});
  for (int pass = 0; pass < passes; ++pass) {
    const std::vector<double> levels = interior_levels(pass < soaked ? interior : 0);
    for (int i = 0; i < static_cast<int>(levels.size()); ++i) {
      const double level = at_hot ? 1 - levels[static_cast<size_t>(i)] : levels[static_cast<size_t>(i)];
      const int place = at_hot ? interior - 1 - i : i; // from the cold end: the same soak on the way up and down
      if (tied)
        shape.stops.push_back({level, place, false, 2 + place});
      else
        shape.stops.push_back({level, n_levels++, false, n_weights++});
    }
    at_hot = !at_hot;
    shape.stops.push_back({at_hot ? 1.0 : 0.0, -1, false, tied ? (pass + 1 == passes ? 0 : 1) : n_weights++});
  }
  return shape;
}

// Shares `total` in proportion to the weights, none above `cap` (0: no cap); returns what is left over.
static double share_out(double total, double cap, const std::vector<double>& weights, std::vector<double>* out) {
  const size_t n = weights.size();
  std::vector<bool> full(n, false);
  out->assign(n, 0.0);
  double left = total;
  for (size_t round = 0; round <= n; ++round) {
    double sum = 0;
    for (size_t i = 0; i < n; ++i)
      if (!full[i]) sum += weights[i] + 1e-6;
    if (sum == 0) return left;
    bool overflow = false;
    for (size_t i = 0; i < n; ++i)
      if (!full[i] && cap > 0 && left * (weights[i] + 1e-6) / sum > cap) {
        (*out)[i] = cap;
        full[i] = overflow = true;
      }
    if (!overflow) {
      for (size_t i = 0; i < n; ++i)
        if (!full[i]) (*out)[i] = left * (weights[i] + 1e-6) / sum;
      return 0;
    }
    left = total;
    for (size_t i = 0; i < n; ++i)
      if (full[i]) left -= cap;
    if (left < 0) left = 0;
  }
  return left;
}

namespace {

// A chain of stops with its times.  Index i of the ramps: from stop i - 1 to stop i; [0] is 0.
struct ChainTimes {
  std::vector<double> level;             // 0 = lo, 1 = hi
  std::vector<double> weight;            // of the soaks
  std::vector<double> ramp_s, fastest_s; // as wanted, and at the chamber's limit
  std::vector<double> soak_s;
};

double sum_s(const std::vector<double>& times_s) {
  return std::accumulate(times_s.begin(), times_s.end(), 0.0);
}

// Levels, weights and ramps as the variables ask for them; no soaks yet.
ChainTimes wanted_times(const ScheduleShape& shape, const std::vector<double>& variables, const ChamberLimits& limits) {
  const size_t n = shape.stops.size(), n_levels = shape.n_levels();
  ChainTimes t;
  for (const ScheduleShape::Stop& stop : shape.stops) {
    t.level.push_back(shape.level_of(stop, variables));
    t.weight.push_back(std::max(0.0, variables[n_levels + static_cast<size_t>(stop.weight_var)]));
  }
  t.ramp_s.assign(n, 0.0), t.fastest_s.assign(n, 0.0), t.soak_s.assign(n, 0.0);
  size_t next = n_levels + shape.n_weights(); // rate fractions
  for (size_t i = 1; i < n; ++i) {
    const double rise = t.level[i] - t.level[i - 1];
    t.fastest_s[i] = std::abs(rise) * limits.traverse_s(rise > 0);
    t.ramp_s[i] = t.fastest_s[i] / (shape.free_rates ? std::clamp(variables[next++], 0.02, 1.0) : 1.0);
  }
  return t;
}

// Saves `saved_s` on the ramps: all come nearer to the chamber's limit by the same part.
void quicken_ramps(double saved_s, ChainTimes* t) {
  const double slack_s = sum_s(t->ramp_s) - sum_s(t->fastest_s);
  const double keep = slack_s > 0 ? std::max(0.0, 1 - saved_s / slack_s) : 0;
  for (size_t i = 1; i < t->ramp_s.size(); ++i)
    t->ramp_s[i] = t->fastest_s[i] + keep * (t->ramp_s[i] - t->fastest_s[i]);
}

// Gives the soaks their least time and their part of `left_s`.  What the longest soak allowed leaves over slows the ramps.
void share_soaks(double left_s, const ChamberLimits& limits, ChainTimes* t) {
  const double cap = limits.max_soak_s > 0 ? limits.max_soak_s - limits.min_soak_s : 0;
  const bool no_room = limits.max_soak_s > 0 && cap <= 0;
  const double over_s = no_room ? left_s : share_out(left_s, cap, t->weight, &t->soak_s);
  for (double& s : t->soak_s) s += limits.min_soak_s;
  if (over_s <= 0) return;
  const double ramps_s = sum_s(t->ramp_s);
  for (double& r : t->ramp_s) r *= (ramps_s + over_s) / ramps_s;
}

Profile profile_of(const ChainTimes& t, const ChamberLimits& limits) {
  Profile profile;
  profile.start_degc = limits.lo_degc + t.level[0] * limits.span_degc();
  double temp_degc = profile.start_degc;
  for (size_t i = 0; i < t.level.size(); ++i) {
    const double to_degc = limits.lo_degc + t.level[i] * limits.span_degc();
    if (i > 0 && t.ramp_s[i] > 0 && to_degc != temp_degc)
      profile.segments.push_back({kSecondsPerMinute * (to_degc - temp_degc) / t.ramp_s[i], t.ramp_s[i], to_degc});
    temp_degc = to_degc;
    if (t.soak_s[i] > 0) profile.segments.push_back({0, t.soak_s[i], temp_degc});
  }
  return profile;
}

// Stops at one temperature make one soak.
double longest_soak_s(const Profile& profile) {
  double longest_s = 0, together_s = 0, at_degc = profile.start_degc;
  for (const ProfileSegment& s : profile.segments) {
    if (s.rate_degc_per_min == 0)
      together_s += s.duration_s;
    else if (std::abs(s.to_degc - at_degc) >= 0.05)
      together_s = 0;
    at_degc = s.to_degc;
    longest_s = std::max(longest_s, together_s);
  }
  return longest_s;
}

} // namespace

bool make_profile(const ScheduleShape& shape, const std::vector<double>& variables, const ChamberLimits& limits,
                  double duration_s, Profile* profile, double* excess_s) {
  ChainTimes times = wanted_times(shape, variables, limits);
  const double soaks_min_s = limits.min_soak_s * static_cast<double>(times.level.size());
  *excess_s = sum_s(times.fastest_s) + soaks_min_s - duration_s;
  if (*excess_s > 1e-6) return false;
  const double left_s = duration_s - sum_s(times.ramp_s) - soaks_min_s;
  if (left_s < 0) quicken_ramps(-left_s, &times); // slower ramps than the duration allows
  share_soaks(std::max(0.0, left_s), limits, &times);
  *profile = profile_of(times, limits);
  if (limits.max_soak_s > 0) *excess_s = std::max(*excess_s, longest_soak_s(*profile) - limits.max_soak_s);
  return *excess_s <= 1e-6;
}

// Soaks that follow each other become one, a stop without a soak vanishes from a ramp of one rate.
static void append_merged(const ProfileSegment& s, std::vector<ProfileSegment>* out) {
  if (!out->empty()) {
    ProfileSegment& last = out->back();
    if (s.rate_degc_per_min == last.rate_degc_per_min) {
      last.duration_s += s.duration_s;
      last.to_degc = s.to_degc;
      return;
    }
  }
  out->push_back(s);
}

// Rates are written to 1e-6 degC/min.
static double floor_rate(double rate) {
  return std::floor(rate * 1e6 + 1e-3) / 1e6;
}

static bool is_soak(const ProfileSegment& s) {
  return s.rate_degc_per_min == 0;
}

// Temperatures to 0.01 degC, and rates never above the chamber's; soaks still as they were, those below a second dropped.
static Profile with_round_temperatures(const Profile& profile) {
  Profile out;
  out.start_degc = std::round(profile.start_degc * 100) / 100;
  double temp_degc = out.start_degc;
  for (ProfileSegment s : profile.segments) {
    if (is_soak(s)) {
      if (s.duration_s < 1) continue;
      s.to_degc = temp_degc;
    } else {
      s.to_degc = std::round(s.to_degc * 100) / 100;
      if (s.to_degc == temp_degc) continue;
      const double rate = floor_rate(std::abs(s.rate_degc_per_min));
      s.rate_degc_per_min = std::copysign(rate, s.to_degc - temp_degc);
      s.duration_s = std::abs(s.to_degc - temp_degc) / rate * kSecondsPerMinute;
    }
    temp_degc = s.to_degc;
    append_merged(s, &out.segments);
  }
  return out;
}

// The segments of a rounded profile, whose times give and take until they fill the duration.
class Filler {
public:
  Filler(const ChamberLimits& limits, std::vector<ProfileSegment>* segments) : limits_(limits), segments_(*segments) {
    for (ProfileSegment& s : segments_)
      if (is_soak(s)) s.duration_s = allowed_soak_s(std::floor(s.duration_s + 1e-6));
  }

  double rest_s(double duration_s) const {
    for (const ProfileSegment& s : segments_) duration_s -= s.duration_s;
    return duration_s;
  }

  // The longest soak takes as much as it may; with less than nothing to take, soaks give, the longest first.
  void fill_soaks(double rest_s) {
    std::vector<ProfileSegment*> soaks;
    for (ProfileSegment& s : segments_)
      if (is_soak(s)) soaks.push_back(&s);
    std::stable_sort(soaks.begin(), soaks.end(),
                     [](const auto* a, const auto* b) { return a->duration_s > b->duration_s; });
    for (ProfileSegment* s : soaks) {
      const double before_s = s->duration_s;
      s->duration_s = allowed_soak_s(std::floor((before_s + rest_s) * 10 + 1e-6) / 10);
      rest_s -= s->duration_s - before_s;
      if (rest_s > -0.05) return; // what is left over is for the ramps
    }
  }

  // The longest ramp goes slower, which every chamber can; or the one furthest below the chamber's limit faster.
  void fill_ramps(double rest_s) {
    ProfileSegment* best = nullptr;
    const auto reserve_s = [&](const ProfileSegment& s) {
      return rest_s > 0 ? s.duration_s : s.duration_s - fastest_s(s);
    };
    for (ProfileSegment& s : segments_)
      if (!is_soak(s) && (!best || reserve_s(s) > reserve_s(*best))) best = &s;
    if (!best) return;
    const double step = step_degc(*best), wanted_s = std::max(best->duration_s + rest_s, 1e-3);
    const double rate = std::min(std::ceil(step / wanted_s * kSecondsPerMinute * 1e6) / 1e6, fastest(*best));
    best->rate_degc_per_min = std::copysign(rate, best->rate_degc_per_min);
    best->duration_s = step / rate * kSecondsPerMinute;
  }

private:
  double allowed_soak_s(double soak_s) const {
    soak_s = std::max({soak_s, limits_.min_soak_s, 1.0});
    return limits_.max_soak_s > 0 ? std::min(soak_s, limits_.max_soak_s) : soak_s;
  }
  double fastest(const ProfileSegment& s) const {
    return floor_rate(s.rate_degc_per_min > 0 ? limits_.heating_degc_per_min : limits_.cooling_degc_per_min);
  }
  static double step_degc(const ProfileSegment& s) {
    return std::abs(s.rate_degc_per_min) * s.duration_s / kSecondsPerMinute;
  }
  double fastest_s(const ProfileSegment& s) const { return step_degc(s) / fastest(s) * kSecondsPerMinute; }

  const ChamberLimits& limits_;
  std::vector<ProfileSegment>& segments_;
};

Profile rounded(const Profile& profile, double duration_s, const ChamberLimits& limits) {
  Profile out = with_round_temperatures(profile);
  Filler filler(limits, &out.segments);
  filler.fill_soaks(filler.rest_s(duration_s));
  // Rates are round too: a slow ramp misses its time by seconds, and another then takes them.
  for (size_t i = 0; i <= out.segments.size(); ++i) {
    const double rest_s = filler.rest_s(duration_s);
    if (rest_s > -0.1 && rest_s < 0.5) break;
    filler.fill_ramps(rest_s);
    filler.fill_soaks(filler.rest_s(duration_s));
  }
  return out;
}

Profile paper_profile(const ChamberLimits& limits, double duration_s, int passes) {
  Profile p;
  p.start_degc = limits.lo_degc;
  double ramps_s = 0;
  for (int i = 0; i < passes; ++i) ramps_s += limits.traverse_s(i % 2 == 0);
  const double soak_s = std::max(0.0, (duration_s - ramps_s) / (passes + 1));
  if (soak_s > 0) p.segments.push_back({0, soak_s, limits.lo_degc});
  for (int i = 0; i < passes; ++i) {
    const bool up = i % 2 == 0;
    const double to_degc = up ? limits.hi_degc : limits.lo_degc;
    p.segments.push_back(
        {up ? limits.heating_degc_per_min : -limits.cooling_degc_per_min, limits.traverse_s(up), to_degc});
    if (soak_s > 0) p.segments.push_back({0, soak_s, to_degc});
  }
  return p;
}

} // namespace imucal
