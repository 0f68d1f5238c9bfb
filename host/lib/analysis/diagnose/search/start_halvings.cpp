// SPDX-License-Identifier: MIT
#include "analysis/diagnose/search/start_halvings.h"

#include <algorithm>
#include <cmath>

#include "analysis/diagnose/search/slow_polish.h"

namespace imucal {

namespace {

constexpr double kFewNats = 100; // of a loop, of which start columns without a halving leave less than one
constexpr double kLeftByOne = 8; // every halving leaves this part of the energy that was left before
constexpr int kMostHalvings = 4;

// The likeliest loop beside nothing; no names: none can be asked.
SlowModel likeliest_loop(const SlowLikelihood& of, const SlowScan& scans, const SlowModel& null) {
  SlowCandidateScore best;
  best.score_nats = -1e300;
  const std::vector<SlowCandidateScore> singles = scans.scan(null, scans.all_nodes());
  for (size_t j = 0; j < singles.size(); ++j)
    if (of.space().candidates[j].scan.estimator->is_start_bounded() && singles[j].score_nats > best.score_nats)
      best = singles[j];
  return best.model.names.empty() ? best.model : polished(of, best.model);
}

} // namespace

int start_halvings(const SlowLikelihood& of, const SlowScan& scans, const SlowModel& null) {
  SlowModel loop = likeliest_loop(of, scans, null);
  if (loop.names.empty()) return 0;
  // Under its own noise: that of nothing is as large as the loop.
  const double nats = loop.value - of.evaluate(loop.without(0));
  if (!(nats > kFewNats)) return 0;
  return std::min(kMostHalvings, static_cast<int>(std::ceil(std::log(nats / kFewNats) / std::log(kLeftByOne))));
}

} // namespace imucal
