// SPDX-License-Identifier: MIT
#include "diagnose/noise_words.h"

#include <cmath>
#include <cstdio>

#include "base/digits.h"
#include "base/units.h"
#include "diagnose/words.h"

namespace imucal {

namespace {

// What follows the temperature, and how its slope makes it larger: exp(part of the slope times the change of Tn).
struct Sloped {
  double NoiseModel::*slope;
  double part;
  const char *what, *large, *slope_of;
};
constexpr Sloped kSloped[] = {
    {&NoiseModel::white_slope, 0.5, "the white noise", "large", "its log-variance"},
    {&NoiseModel::markov_slope, 0.5, "the slow noise", "large", "its log-variance"},
    {&NoiseModel::tau_slope, 1, "the time constant of the slow noise", "long", "its logarithm"},
};

double to_tenths(double degc) {
  return std::round(10 * degc) / 10 + 0.0; // no -0
}

constexpr double kHardlyMore = 1.25; // times: no dependence on temperature that anybody would look for

// By how much a noise is larger at one end of the temperatures of the logs than at the other.
struct OverTemperature {
  const Sloped* sloped = nullptr; // nullptr: it does not follow the temperature
  Measured times = {1, kUnknown};
  double more_at_degc = 0, less_at_degc = 0;
};
OverTemperature over_temperature(const Term& term, const Campaign& campaign) {
  OverTemperature out;
  if (!term.estimator || term.form() != Form::kNoise || term.shape.empty() || !campaign.has_temperature) return out;
  Theta further = term.shape;
  for (size_t i = 0; i < further.size(); ++i)
    further[i] += i < term.shape_errors.size() ? term.shape_errors[i] : kUnknown;
  const NoiseModel noise = term.estimator->noise(NoiseModel(), term.shape),
                   next = term.estimator->noise(NoiseModel(), further);
  const double lo_degc = to_tenths(campaign.lo_degc), hi_degc = to_tenths(campaign.hi_degc);
  for (const Sloped& sloped : kSloped) {
    const double slope = noise.*sloped.slope;
    if (slope == 0) continue;
    const double exponent = sloped.part * (hi_degc - lo_degc) / campaign.range_degc;
    const bool grows = exponent * slope > 0;
    const double times = std::exp(std::fabs(exponent * slope));
    out.sloped = &sloped;
    out.times = {times, times * std::fabs(exponent) * std::fabs(next.*sloped.slope - slope)};
    out.more_at_degc = grows ? hi_degc : lo_degc, out.less_at_degc = grows ? lo_degc : hi_degc;
    return out;
  }
  return out;
}

} // namespace

std::string noise_over_temperature(const Term& term, const Campaign& campaign) {
  const OverTemperature found = over_temperature(term, campaign);
  if (!found.sloped) return "";
  char text[300];
  std::snprintf(text, sizeof text,
                "%s is %s times as %s at %g degC as at %g degC (slope: of %s, per unit of (T - %g degC) / %g degC)",
                found.sloped->what, with_error(found.times.value, found.times.std_error).c_str(), found.sloped->large,
                found.more_at_degc, found.less_at_degc, found.sloped->slope_of, campaign.t0_degc, campaign.range_degc);
  return text;
}

bool hardly_follows_temperature(const Term& term, const Campaign& campaign) {
  const OverTemperature found = over_temperature(term, campaign);
  return found.sloped && (found.times.value < kHardlyMore || found.times.value - 1 < found.times.std_error);
}

namespace {

// So many processes of one size, each as many times slower than the one before, are 1/f noise.
constexpr size_t kFewestOfLadder = 4;
constexpr int kNoiseDigits = 3;

// How many processes from this one on are of one size and of time constants as far apart; the last ones may be closer, cut where
// they are longer than the logs can tell.
size_t ladder_from(const std::vector<Markov>& processes, size_t first) {
  constexpr double kSame = 1e-6;
  size_t n = 1;
  double ratio = 0;
  for (; first + n < processes.size(); ++n) {
    const Markov &before = processes[first + n - 1], &next = processes[first + n];
    const double apart = next.tau_s / before.tau_s;
    if (n == 1) ratio = apart;
    const bool is_of_size = std::fabs(next.sigma_dph / before.sigma_dph - 1) < kSame;
    if (!is_of_size || !(ratio > 1) || apart < 1 || apart > ratio * (1 + kSame)) break;
  }
  return n;
}
// The strength B of 1/f noise of spectrum B^2/(pi f): sigma^2 = B^2 ln(ratio)/pi of each of its processes.
double strength_of_ladder(const Markov& first, const Markov& second) {
  return first.sigma_dph / std::sqrt(std::log(second.tau_s / first.tau_s) / kPi);
}

} // namespace

std::string processes_in_words(const std::vector<Markov>& processes, const std::string& axis_unit) {
  if (processes.size() < 2) return "";
  std::vector<std::string> parts;
  const auto size = [&](double value) { return in_digits(value, kNoiseDigits) + " " + axis_unit; };
  const auto time = [](double tau_s) { return in_digits(tau_s, kNoiseDigits) + " s"; };
  for (size_t i = 0; i < processes.size();) {
    const size_t n = ladder_from(processes, i);
    const Markov& m = processes[i];
    if (n >= kFewestOfLadder) {
      parts.push_back("1/f noise of instability B " + size(strength_of_ladder(m, processes[i + 1])) +
                      " with time constants from " + time(m.tau_s) + " to " + time(processes[i + n - 1].tau_s));
      i += n;
      continue;
    }
    parts.push_back(size(m.sigma_dph) + " with a time constant of " + time(m.tau_s));
    ++i;
  }
  return "all slow noise that these logs show: " + joined(parts, ", and ");
}

} // namespace imucal
