// SPDX-License-Identifier: MIT
#include "profile/report.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>

#include "base/error.h"

namespace imucal {

static bool looks_like_json(const std::string& path) {
  std::ifstream file(path);
  if (!file) throw data_error(path + ": cannot be read; give a profile (JSON) or a log (CSV)");
  char c = 0;
  while (file.get(c) && std::isspace(static_cast<unsigned char>(c))) {
  }
  return c == '{';
}

ProfileInput read_profile_input(const std::string& path, bool restart_each_cycle) {
  ProfileInput input;
  input.path = path;
  if (looks_like_json(path)) {
    const Profile profile = read_profile(path);
    input.runs = runs_of_profile(profile, 1.0, restart_each_cycle);
    for (CalibrationRun& run : input.runs) run.name = path + " " + run.name;
    input.lo_degc = profile.min_degc();
    input.hi_degc = profile.max_degc();
    for (const ProfileLeg& leg : legs(profile))
      input.max_rate_degc_per_min = std::max(input.max_rate_degc_per_min,
                                             60 * std::abs(leg.end_degc - leg.start_degc) / (leg.end_s - leg.start_s));
  } else {
    input.runs.push_back(run_of_log(read_log(path)));
    const auto [lo, hi] = std::minmax_element(input.runs[0].temp_degc.begin(), input.runs[0].temp_degc.end());
    input.lo_degc = *lo;
    input.hi_degc = *hi;
  }
  return input;
}

Json to_json(const CalibrationError& error) {
  return {{"temp_degc", error.temp_degc},
          {"sigma_dph", error.sigma_dph},
          {"believed_sigma_dph", error.believed_sigma_dph},
          {"worst_dph", error.worst_dph},
          {"rms_dph", error.rms_dph},
          {"believed_worst_dph", error.believed_worst_dph},
          {"duration_s", error.duration_s},
          {"covariance_dph2", error.covariance}};
}

Json to_json(const Bound& bound) {
  return {{"bound_dph", bound.slow_ramp_dph},
          {"assumptions", bound.assumptions},
          {"proven_bound_dph", bound.proven_dph},
          {"proven_assumptions", bound.proven_assumptions},
          {"proof",
           {{"relaxed_design_dph", bound.relaxation_dph},
            {"inset_low_frac", bound.inset_low_frac},
            {"inset_high_frac", bound.inset_high_frac},
            {"boxes", bound.boxes}}}};
}

std::string error_text(const CalibrationError& error, bool with_believed, const std::string& unit, int lines) {
  const std::string pad = unit == "mg" ? " " : ""; // under the numbers
  std::string text = "  temp degC   " + pad + "error " + unit;
  if (with_believed) text += "  " + pad + "believed " + unit;
  text += "\n";
  const int n = static_cast<int>(error.temp_degc.size());
  const int shown_lines = std::min(lines, n);
  char line[96];
  for (int i = 0; i < shown_lines; ++i) {
    const auto k = static_cast<size_t>(shown_lines > 1 ? std::lround(double(i) * (n - 1) / (shown_lines - 1)) : 0);
    if (with_believed)
      std::snprintf(line, sizeof line, "  %9.2f  %10.3f  %12.3f\n", error.temp_degc[k], error.sigma_dph[k],
                    error.believed_sigma_dph[k]);
    else
      std::snprintf(line, sizeof line, "  %9.2f  %10.3f\n", error.temp_degc[k], error.sigma_dph[k]);
    text += line;
  }
  return text;
}

} // namespace imucal
