// SPDX-License-Identifier: MIT
#include "errormodel/trend.h"

#include <algorithm>
#include <cstdio>

#include "analysis/errormodel/trend.h"
#include "base/axis_unit.h"
#include "base/error.h"
#include "cli/text.h"

namespace imucal {

std::vector<Series> load_one_kind(const std::string& log, const std::vector<std::string>& axes, bool with_temp) {
  std::vector<Series> all = load_series(log, axes, with_temp);
  const auto is_accel = [](const Series& s) { return is_accelerometer(s.axis); };
  if (axes.empty() && !std::all_of(all.begin(), all.end(), is_accel))
    all.erase(std::remove_if(all.begin(), all.end(), is_accel), all.end());
  return all;
}

void choose_detrend(const std::vector<std::string>& logs, const std::vector<std::string>& axes, std::string* detrend) {
  const bool is_chosen = !detrend->empty();
  if (is_chosen && *detrend != "mean" && *detrend != "none") return;
  for (const std::string& log : logs) {
    if (log == "-") continue; // standard input cannot be read twice
    for (const Series& s : load_one_kind(log, axes, true)) {
      const double f = temperature_f(s);
      if (f <= kTemperatureF) continue;
      warn("errormodel: note: %s %s: the rate follows the temperature (F = %.3g, limit %.3g): %s\n",
           printable(log).c_str(), s.axis.c_str(), f, kTemperatureF,
           is_chosen ? ("with --detrend " + *detrend + " that counts as noise").c_str()
                     : "a cubic is taken out (--detrend poly:3); to choose: --detrend");
      if (!is_chosen) *detrend = "poly:3";
      return;
    }
  }
  if (!is_chosen) *detrend = "mean";
}

} // namespace imucal
