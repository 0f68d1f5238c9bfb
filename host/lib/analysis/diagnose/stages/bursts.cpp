// SPDX-License-Identifier: MIT
#include "analysis/diagnose/stages/bursts.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "analysis/diagnose/evidence/kalman.h"
#include "base/rng.h"

namespace imucal {

using Eigen::VectorXd;

namespace {

constexpr double kPerhapsHit = 0.02;                   // probability of a sample that may be one
constexpr int kMostScatters = 6000, kEnoughAsMany = 3; // draws of the hits at other samples
constexpr double kMostHits = 1000;                     // more are thinned: time

// Samples of a run that may be hits.
struct Hits {
  double samples = 0; // of the run
  std::vector<double> at, probability;
};
Hits hits_of(const VectorXd& hit) {
  Hits out;
  out.samples = static_cast<double>(hit.size());
  for (long k = 0; k < hit.size(); ++k)
    if (hit[k] > kPerhapsHit) out.at.push_back(static_cast<double>(k)), out.probability.push_back(hit[k]);
  return out;
}
// About `most` of the hits of all runs, whichever.
void thin(double most, std::vector<Hits>* runs, Rng* rng) {
  double all = 0;
  for (const Hits& hits : *runs) all += static_cast<double>(hits.at.size());
  if (all <= most) return;
  for (Hits& hits : *runs) {
    Hits kept;
    kept.samples = hits.samples;
    for (size_t k = 0; k < hits.at.size(); ++k)
      if (rng->uniform() * all < most) kept.at.push_back(hits.at[k]), kept.probability.push_back(hits.probability[k]);
    hits = kept;
  }
}
// How many pairs of hits are expected within `reach` samples.
double near_pairs(const Hits& hits, double reach) {
  double sum = 0, near = 0;
  for (size_t k = 0, first = 0; k < hits.at.size(); ++k) {
    while (hits.at[k] - hits.at[first] > reach) near -= hits.probability[first++];
    sum += near * hits.probability[k];
    near += hits.probability[k];
  }
  return sum;
}
double near_pairs(const std::vector<Hits>& runs, double reach) {
  double sum = 0;
  for (const Hits& hits : runs) sum += near_pairs(hits, reach);
  return sum;
}
// The same hits at any samples of their runs.
void scatter(std::vector<Hits>* runs, Rng* rng) {
  for (Hits& hits : *runs) {
    for (double& at : hits.at) at = std::floor(rng->uniform() * hits.samples);
    std::sort(hits.at.begin(), hits.at.end());
    for (size_t k = hits.at.size(); k > 1; --k)
      std::swap(hits.probability[k - 1],
                hits.probability[std::min(k - 1, static_cast<size_t>(rng->uniform() * static_cast<double>(k)))]);
  }
}

} // namespace

// Draws of the hits at other samples, until three have as many pairs (Besag and Clifford, Biometrika 78, 1991).
RestFinding hits_in_bursts(const Campaign& campaign, const std::vector<VectorXd>& residual, const NoiseModel& noise,
                           const SelectorConstants& constants) {
  RestFinding strongest = {Rest::kBursts, std::log(constants.rest_rate), -std::log(constants.rest_rate)};
  if (!(noise.hit_probability > 0)) return strongest;
  std::vector<Hits> hits;
  for (size_t r = 0; r < residual.size(); ++r) {
    VectorXd hit;
    mixture_log_likelihood(campaign.runs[r], noise, residual[r], nullptr, &hit);
    hits.push_back(hits_of(hit));
  }
  Rng rng(1, 0, 0, Stream::kTool);
  thin(kMostHits, &hits, &rng);
  for (const long neighbours : kOfOneBurst) {
    const auto reach = static_cast<double>(neighbours);
    const double found = near_pairs(hits, reach);
    std::vector<Hits> drawn = hits;
    int draws = 0, as_many = 0;
    for (; draws < kMostScatters && as_many < kEnoughAsMany; ++draws) {
      scatter(&drawn, &rng);
      as_many += near_pairs(drawn, reach) >= found ? 1 : 0;
    }
    const double p = static_cast<double>(as_many + 1) / static_cast<double>(draws + 1);
    strongest.evidence_nats =
        std::max(strongest.evidence_nats, std::log(constants.rest_rate / std::size(kOfOneBurst)) - std::log(p));
  }
  return strongest;
}

} // namespace imucal
