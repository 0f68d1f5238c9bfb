// SPDX-License-Identifier: MIT
#include "analysis/diagnose/structure.h"

#include <algorithm>
#include <cmath>

#include "analysis/diagnose/blocks.h"

namespace imucal {
namespace {

constexpr double kFarZero = 8;    // noise standard deviations of the values around a zero that is no rate
constexpr double kGuard_s = 10;   // next to censored samples: those that just escaped are biased too
constexpr double kMostLost = 0.5; // part of the samples that the guard may cost; else only the samples themselves go

// Smallest difference between neighbours that differ: the step of rates that were rounded.
double smallest_change(const Campaign& campaign) {
  double smallest = 1e300;
  for (const double change : changes_between_samples(campaign))
    if (change > 0) smallest = std::min(smallest, change);
  return smallest;
}

// Zeros between values that are far from zero: the recorder's, not the gyro's.  Of coarse rates most are equal to the one
// before, and zero may be the next step.
size_t mask_dropouts(Campaign* campaign) {
  const double noise =
      std::max(white_between_samples(*campaign) / std::sqrt(campaign->dt_s), smallest_change(*campaign));
  size_t count = 0;
  std::vector<std::vector<char>> unusable;
  for (const CampaignRun& run : campaign->runs) {
    std::vector<char> bad(run.input.size(), 0);
    double last = std::nan(""); // the last rate that is not zero
    std::vector<double> next(run.n() + 1, std::nan(""));
    for (size_t k = run.n(); k-- > 0;) {
      const double y = run.input.rate_dph[static_cast<size_t>(run.used[k])];
      next[k] = y != 0 ? y : next[k + 1];
    }
    for (size_t k = 0; k < run.n(); ++k) {
      const size_t row = static_cast<size_t>(run.used[k]);
      const double y = run.input.rate_dph[row];
      if (y != 0) {
        last = y;
        continue;
      }
      const double before = std::isfinite(last) ? last : next[k], after = std::isfinite(next[k]) ? next[k] : last;
      if (std::isfinite(before) && before * after > 0 &&
          std::min(std::fabs(before), std::fabs(after)) > kFarZero * noise)
        bad[row] = 1, ++count;
    }
    unusable.push_back(std::move(bad));
  }
  if (count > 0) mask(campaign, unusable);
  return count;
}

// Seconds within the guard of a censored one.
std::vector<std::vector<char>> with_guard(const Campaign& campaign, std::vector<std::vector<char>> bad) {
  const long guard = std::lround(kGuard_s / campaign.dt_s);
  size_t lost = 0;
  std::vector<std::vector<char>> wide = bad;
  for (size_t r = 0; r < bad.size(); ++r) {
    const std::vector<long>& tick = campaign.runs[r].input.tick;
    long last = -10 * guard;
    for (size_t i = 0; i < bad[r].size(); ++i) {
      if (bad[r][i]) last = tick[i];
      if (tick[i] - last <= guard) wide[r][i] = 1;
    }
    last = tick.empty() ? 0 : tick.back() + 10 * guard;
    for (size_t i = bad[r].size(); i-- > 0;) {
      if (bad[r][i]) last = tick[i];
      if (last - tick[i] <= guard) wide[r][i] = 1;
    }
    for (char w : wide[r]) lost += w != 0;
  }
  return static_cast<double>(lost) < kMostLost * static_cast<double>(campaign.n()) ? wide : bad;
}

} // namespace

StructureResult find_structure(Campaign* campaign, const std::vector<const Effect*>& library,
                               const std::vector<bool>& active) {
  StructureResult out;
  const size_t before = campaign->n();
  out.n_dropouts = mask_dropouts(campaign);
  std::vector<const Effect*> detectors;
  for (size_t j = 0; j < library.size(); ++j)
    if (active[j] && library[j]->estimator() && library[j]->estimator()->form() == Form::kStructural)
      detectors.push_back(library[j]);
  std::stable_sort(detectors.begin(), detectors.end(), [](const Effect* a, const Effect* b) {
    return a->estimator()->detection_order() < b->estimator()->detection_order();
  });
  for (const Effect* effect : detectors) {
    std::vector<RunInput> inputs;
    for (const CampaignRun& run : campaign->runs) inputs.push_back(run.input);
    const auto signature = effect->estimator()->detect(inputs);
    if (!signature) continue;
    out.findings.push_back({effect, *signature});
    out.extra_white_dph2 += signature->extra_white_dph2;
    const bool is_censoring = effect->estimator()->is_censoring();
    out.is_censored = out.is_censored || is_censoring;
    if (!signature->unusable.empty())
      mask(campaign, is_censoring ? with_guard(*campaign, signature->unusable) : signature->unusable);
  }
  out.n_left_out = before - campaign->n();
  return out;
}

} // namespace imucal
