// SPDX-License-Identifier: MIT
#include "analysis/diagnose/search/null_draws.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "base/rng.h"

namespace imucal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

const char kCalibrationVersion[] = "13"; // changes whenever a draw would gain something else
// At which first_step_nats is stated, and by how many nats more chance jumps e times less often: the tail of what jumps gained in
// devices without a gap (HISTORY.md, Chance that jumps).
constexpr double kStatedRate = 0.01, kJumpTail_nats = 1.4;

// FNV-1a over the bits of what is added.
class Hash {
public:
  void add(const std::string& text) { add(text.data(), text.size()), add(static_cast<double>(text.size())); }
  void add(double x) { add(&x, sizeof x); }
  template <class T> void add(const std::vector<T>& list) {
    add(list.data(), list.size() * sizeof(T)), add(static_cast<double>(list.size()));
  }
  std::string text() const {
    char out[20];
    std::snprintf(out, sizeof out, "%016llx", static_cast<unsigned long long>(state_));
    return out;
  }

private:
  void add(const void* bytes, size_t n) {
    const auto* at = static_cast<const unsigned char*>(bytes);
    for (size_t i = 0; i < n; ++i) state_ = (state_ ^ at[i]) * 0x100000001b3ull;
  }
  uint64_t state_ = 0xcbf29ce484222325ull;
};

void add_run(const CampaignRun& run, Hash* hash) {
  const RunInput& in = run.input;
  for (const std::vector<double>* column :
       {&in.t_s, &in.temp_degc, &in.smooth_degc, &in.path_degc, &in.rate_degc_min, &in.tn, &in.rate_dph})
    hash->add(*column);
  for (const auto& [name, values] : in.auxiliary) hash->add(name), hash->add(values);
  hash->add(run.used), hash->add(run.steps), hash->add(run.start_s);
  hash->add(run.own_white_dph2);
}

void add_noise(const NoiseModel& noise, Hash* hash) {
  for (double x :
       {noise.white_sigma_dph, noise.walk_dph_per_rt_s, noise.white_slope, noise.markov_slope, noise.tau_slope,
        noise.extra_white_dph2, noise.hit_probability, noise.hit_sigma_dph, noise.telegraph_dph, noise.telegraph_tau_s})
    hash->add(x);
  for (const Markov& process : noise.markov) hash->add(process.sigma_dph), hash->add(process.tau_s);
}

// Draws of the noise of `null` with its polynomial: per run, used samples x draws.
std::vector<MatrixXd> drawn(const SlowLikelihood& likelihood, const SlowModel& null, size_t draws, uint64_t seed) {
  const SlowSpace& space = likelihood.space();
  const NoiseModel noise = likelihood.noise(null);
  const RunGrams::Posterior at = likelihood.grams(null).posterior();
  std::vector<MatrixXd> y;
  for (size_t r = 0; r < space.data.y.size(); ++r) {
    MatrixXd x(space.data.y[r].size(), static_cast<long>(draws));
    const RunGains gains = compute_gains(space.data.campaign.runs[r], noise);
    const VectorXd mean = space.data.powers[r] * at.common.head(space.data.powers[r].cols());
    for (size_t d = 0; d < draws; ++d) {
      Rng rng(seed, (static_cast<uint64_t>(d) << 16) + r, 0, static_cast<uint32_t>(Stream::kTool) + 7);
      for (long k = 0; k < x.rows(); ++k) x(k, static_cast<long>(d)) = rng.normal();
      colour(gains, x.col(static_cast<long>(d)).data(), static_cast<size_t>(x.rows()));
      x.col(static_cast<long>(d)) += mean;
    }
    y.push_back(std::move(x));
  }
  return y;
}

} // namespace

std::string null_key(const SlowSpace& space, size_t draws, uint64_t seed) {
  const Campaign& campaign = space.data.campaign;
  const NoiseBelief& belief = space.belief;
  Hash hash;
  hash.add(std::string(IMUCAL_VERSION) + kCalibrationVersion);
  hash.add(static_cast<double>(draws)), hash.add(static_cast<double>(seed));
  for (const Candidate& c : space.candidates) {
    hash.add(c.effect ? c.effect->name() : c.reference->what);
    for (const Theta& shape : c.scan.shapes) hash.add(shape);
  }
  for (const SelectorConstant& c : selector_constants()) hash.add(space.constants.*c.value);
  hash.add(campaign.dt_s), hash.add(campaign.order), hash.add(campaign.temp_lsb_degc);
  for (const CampaignRun& run : campaign.runs) add_run(run, &hash);
  hash.add(belief.has_believed), hash.add(belief.has_data_sheet), add_noise(belief.model, &hash);
  for (const NoiseBelief::Known& known : belief.known)
    for (const Effect* effect : effect_library())
      if (effect->estimator() == known.estimator) hash.add(effect->name()), hash.add(known.shape);
  return hash.text();
}

std::vector<double> null_gains(const SlowLikelihood& likelihood, const std::vector<const SlowNode*>& nodes,
                               const SlowModel& null, size_t draws, uint64_t seed) {
  const SlowSpace& space = likelihood.space();
  const std::vector<MatrixXd> y = drawn(likelihood, null, draws, seed);
  const size_t n = space.candidates.size();
  std::vector<double> base(draws, -1e300), best(draws, -1e300);
  for (const SlowNode* node : nodes) {
    const ScanNode::Scores scores = node->scan->score({}, y, std::vector<char>(n, 0));
    const double extra = likelihood.noise_value(node->at) - node->at.noise_charge;
    for (size_t d = 0; d < draws; ++d) {
      const long column = static_cast<long>(d);
      base[d] = std::max(base[d], scores.base[column] + extra);
      std::vector<std::vector<double>> values(n);
      for (size_t g = 0; g < space.bank->groups().size(); ++g)
        if (scores.group(static_cast<long>(g), column) > -1e299)
          values[space.bank->groups()[g].candidate].push_back(scores.group(static_cast<long>(g), column));
      for (const std::vector<double>& of : values)
        if (!of.empty()) best[d] = std::max(best[d], log_mean_exp(of) + extra);
    }
  }
  for (size_t d = 0; d < draws; ++d) best[d] -= base[d];
  return best;
}

NullTail null_tail(std::vector<double> gains, double rate, const SelectorConstants& constants) {
  if (gains.size() < 20) return {constants.mean_nats};
  std::sort(gains.begin(), gains.end());
  const double q80 = gains[gains.size() * 4 / 5];
  double excess = 0, n = 0;
  for (double g : gains)
    if (g > q80) excess += g - q80, n += 1;
  // A Bayes factor falls off at least as fast as exp(-gain); few draws must not promise a faster fall.
  const double scale = std::max(1.0, n > 0 ? excess / n : 1.0);
  const double level = q80 + scale * std::log(0.2 / std::min(0.2, rate)) + constants.polish_gain_nats;
  return {std::clamp(level, constants.least_threshold_nats, constants.most_threshold_nats), scale,
          std::max(0.0, level - constants.most_threshold_nats)};
}

double jump_threshold(double rate, const SelectorConstants& constants) {
  return std::max(0.0, constants.first_step_nats + kJumpTail_nats * std::log(kStatedRate / rate));
}

} // namespace imucal
