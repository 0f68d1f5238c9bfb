// SPDX-License-Identifier: MIT
#include "analysis/diagnose/stages/minutes_left.h"

#include <algorithm>
#include <cmath>

#include "base/quantile.h"

namespace imucal {

double MinutesLeft::rms_of_noise_dph(const NoiseModel& noise) const {
  return std::sqrt(noise_of_all(gaussian_equivalent(noise), minute_s, after));
}
double MinutesLeft::ms_after_dph2(bool with_run_to_run) const {
  return rms_after_dph * rms_after_dph - (with_run_to_run ? 0 : run_to_run_rms_dph * run_to_run_rms_dph);
}
double MinutesLeft::part_left(bool with_run_to_run) const {
  const auto excess = [&](double ms_dph2) { return std::max(0.0, ms_dph2 - noise_rms_dph * noise_rms_dph); };
  const double of_gap = excess(rms_before_dph * rms_before_dph);
  return of_gap > 0 ? excess(ms_after_dph2(with_run_to_run)) / of_gap : 0;
}
double MinutesLeft::times_expected() const {
  return std::sqrt(ms_after_dph2(false) / expected_ms_dph2());
}
double MinutesLeft::errors_above_noise() const {
  if (!has_residual()) return 0;
  const double excess = ms_after_dph2(true) - noise_rms_dph * noise_rms_dph;
  return excess > 0 ? excess / (2 * noise_rms_dph * noise_error_dph) : 0;
}
double MinutesLeft::times_square_by_chance(double p) const {
  const double noise_ms_error_dph2 = 2 * noise_rms_dph * noise_error_dph;
  const auto dof = [&](double error_dph2) { return 2 * std::pow(expected_ms_dph2() / error_dph2, 2); };
  const double above = dof(std::hypot(noise_ms_error_dph2, fit_ms_error_dph2));
  if (std::isnan(above)) return above;
  return f_quantile(p, above, dof(noise_ms_error_dph2 * std::sqrt(per_hour_fitted)));
}
bool MinutesLeft::exceed_noise(const SelectorConstants& constants) const {
  if (!has_residual()) return false;
  return std::pow(times_expected(), 2) > times_square_by_chance(normal_cdf(constants.noise_errors));
}
bool MinutesLeft::leave_mean(const SelectorConstants& constants) const {
  return exceed_noise(constants) && times_expected() > constants.noise_times;
}

} // namespace imucal
