// SPDX-License-Identifier: MIT
#include "diagnose/noise_words.h"

#include <cmath>
#include <cstdio>

#include "base/digits.h"

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

std::string times_as_large(const Sloped& sloped, double slope, double slope_error, const Campaign& campaign) {
  const double lo_degc = to_tenths(campaign.lo_degc), hi_degc = to_tenths(campaign.hi_degc);
  const double exponent = sloped.part * (hi_degc - lo_degc) / campaign.range_degc;
  const bool grows = exponent * slope > 0;
  const double times = std::exp(std::fabs(exponent * slope)), error = times * std::fabs(exponent) * slope_error;
  char text[300];
  std::snprintf(text, sizeof text,
                "%s is %s times as %s at %g degC as at %g degC (slope: of %s, per unit of (T - %g degC) / %g degC)",
                sloped.what, with_error(times, error).c_str(), sloped.large, grows ? hi_degc : lo_degc,
                grows ? lo_degc : hi_degc, sloped.slope_of, campaign.t0_degc, campaign.range_degc);
  return text;
}

} // namespace

std::string noise_over_temperature(const Term& term, const Campaign& campaign) {
  if (!term.estimator || term.form() != Form::kNoise || term.shape.empty() || !campaign.has_temperature) return "";
  Theta further = term.shape;
  for (size_t i = 0; i < further.size(); ++i)
    further[i] += i < term.shape_errors.size() ? term.shape_errors[i] : kUnknown;
  const NoiseModel noise = term.estimator->noise(NoiseModel(), term.shape),
                   next = term.estimator->noise(NoiseModel(), further);
  for (const Sloped& sloped : kSloped)
    if (const double slope = noise.*sloped.slope; slope != 0)
      return times_as_large(sloped, slope, std::fabs(next.*sloped.slope - slope), campaign);
  return "";
}

} // namespace imucal
