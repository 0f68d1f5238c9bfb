// SPDX-License-Identifier: MIT
#include "analysis/fit/residual_shape.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

#include "base/median.h"

namespace imucal {

namespace {

constexpr double kMean_s = 128;
constexpr size_t kLeastRows = 8;    // of a mean
constexpr size_t kLeastMeans = 20;  // of the longest log
constexpr double kLeastPart = 0.75; // of the rows of a mean have a value
constexpr double kSingle = 8;       // standard deviations: single wrong rows are no jump

double usual_size(std::vector<double> values) {
  for (double& value : values) value = std::fabs(value);
  return kSigmaOfMedianSize * median(std::move(values));
}

std::vector<double> finite(const std::vector<std::vector<double>>& runs) {
  std::vector<double> out;
  for (const std::vector<double>& run : runs)
    std::copy_if(run.begin(), run.end(), std::back_inserter(out), [](double x) { return std::isfinite(x); });
  return out;
}

// Means over `rows` rows, from every row on; NaN where too few have a value.
std::vector<double> running_means(const std::vector<double>& run, size_t rows) {
  std::vector<double> out;
  double sum = 0;
  size_t n = 0;
  for (size_t k = 0; k < run.size(); ++k) {
    if (std::isfinite(run[k])) sum += run[k], ++n;
    if (k >= rows && std::isfinite(run[k - rows])) sum -= run[k - rows], --n;
    if (k + 1 < rows) continue;
    out.push_back(static_cast<double>(n) >= kLeastPart * static_cast<double>(rows)
                      ? sum / static_cast<double>(n)
                      : std::numeric_limits<double>::quiet_NaN());
  }
  return out;
}

void find_jump(const std::vector<std::vector<double>>& means, size_t rows, ResidualShape* out) {
  std::vector<std::vector<double>> steps(means.size());
  for (size_t l = 0; l < means.size(); ++l)
    for (size_t k = rows; k < means[l].size(); ++k) steps[l].push_back(means[l][k] - means[l][k - rows]);
  const std::vector<double> all = finite(steps);
  const double usual = all.empty() ? 0 : usual_size(all);
  if (!(usual > 0)) return;
  for (size_t l = 0; l < steps.size(); ++l)
    for (size_t k = 0; k < steps[l].size(); ++k)
      if (std::fabs(steps[l][k]) > out->jump_times * usual) // NaN: no
        out->jump_dph = steps[l][k], out->jump_times = std::fabs(steps[l][k]) / usual, out->jump_run = l,
        out->jump_row = k + rows;
}

void find_warm_up(const std::vector<std::vector<double>>& means, ResidualShape* out) {
  std::vector<double> all = finite(means);
  if (all.empty()) return;
  const double middle = median(all);
  for (double& mean : all) mean -= middle;
  const double usual = usual_size(all);
  if (!(usual > 0)) return;
  for (size_t l = 0; l < means.size(); ++l) {
    if (means[l].empty() || !(std::fabs(means[l][0] - middle) > out->warm_up_times * usual)) continue;
    out->warm_up_dph = means[l][0] - middle, out->warm_up_times = std::fabs(out->warm_up_dph) / usual;
    out->warm_up_run = l;
  }
}

} // namespace

ResidualShape shape_of(std::vector<std::vector<double>> residual_dph, double dt_s) {
  ResidualShape out;
  const size_t rows = std::max(kLeastRows, static_cast<size_t>(std::lround(kMean_s / dt_s)));
  size_t longest = 0;
  for (const std::vector<double>& run : residual_dph) longest = std::max(longest, run.size());
  const std::vector<double> all = finite(residual_dph);
  if (longest < kLeastMeans * rows || all.empty()) return out;
  out.mean_s = static_cast<double>(rows) * dt_s;
  const double most = kSingle * usual_size(all);
  for (std::vector<double>& run : residual_dph)
    for (size_t k = 0; k < run.size(); ++k) {
      const bool is_alone =
          (k == 0 || !(std::fabs(run[k - 1]) > most)) && (k + 1 == run.size() || !(std::fabs(run[k + 1]) > most));
      if (std::fabs(run[k]) > most && is_alone) run[k] = std::numeric_limits<double>::quiet_NaN();
    }
  std::vector<std::vector<double>> means;
  for (const std::vector<double>& run : residual_dph) means.push_back(running_means(run, rows));
  find_jump(means, rows, &out);
  find_warm_up(means, &out);
  return out;
}

} // namespace imucal
