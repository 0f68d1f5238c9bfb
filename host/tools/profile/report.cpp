// SPDX-License-Identifier: MIT
#include "profile/report.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>

#include "base/digits.h"
#include "base/error.h"
#include "physics/effects/parameters.h"

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
      input.max_rate_degc_per_min = std::max(input.max_rate_degc_per_min, std::abs(leg.rate_degc_per_min()));
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

// No amplitude makes it visible otherwise.
static bool is_seen(const SignatureTable& table, size_t effect) {
  return table.needed[effect] > 0;
}

Json to_json(const SignatureTable& table) {
  const size_t n = table.effects.size();
  Json json = {{"effects", Json::array()}, {"correlation", Json::array()}, {"worst_correlation", table.worst}};
  for (size_t i = 0; i < n; ++i) {
    json["effects"].push_back({{"name", table.effects[i].name},
                               {"parameters", table.effects[i].parameters},
                               {"strength", table.strength[i]},
                               {"visible_frac", table.visible_frac[i]},
                               {"separable_strength", table.separable[i]},
                               {"needed_to_name", is_seen(table, i) ? Json(table.needed[i]) : Json()}});
    json["correlation"].push_back(
        std::vector<double>(table.correlation.begin() + static_cast<std::ptrdiff_t>(i * n),
                            table.correlation.begin() + static_cast<std::ptrdiff_t>((i + 1) * n)));
  }
  if (n > 1) json["worst_pair"] = {table.effects[table.worst_a].name, table.effects[table.worst_b].name};
  json["mean_separable_strength"] = table.mean_separable;
  json["not_visible"] = table.invisible;
  return json;
}

std::string signature_text(const SignatureTable& table, const std::string& unit) {
  std::string text = "  correlation of whitened signatures (polynomial and turn-on constant projected off)\n";
  char cell[128];
  const size_t n = table.effects.size();
  for (size_t i = 0; i < n; ++i) {
    std::snprintf(cell, sizeof cell, "  %-24s", table.effects[i].name.c_str());
    text += cell;
    for (size_t j = 0; j <= i; ++j) {
      std::snprintf(cell, sizeof cell, " %6.2f", table.correlation[i * n + j]);
      text += cell;
    }
    text += "\n";
  }
  std::string named;
  for (size_t i = 0; i < n; ++i)
    named +=
        (named.empty() ? "" : ", ") + table.effects[i].name +
        (is_seen(table, i) ? " from " + in_digits(table.needed[i], 2) + " " + unit_of(table.amplitude[i], unit) + " on"
                           : " at no size");
  if (!named.empty()) text += "  can be named: " + named + "\n";
  if (n > 1 && table.worst > 0) {
    std::snprintf(cell, sizeof cell, "  worst %.3f: ", table.worst);
    text += cell + table.effects[table.worst_a].name + " and " + table.effects[table.worst_b].name + "\n";
  }
  for (const std::string& name : table.invisible) text += "  " + name + ": not visible on this profile\n";
  return text;
}

} // namespace imucal
