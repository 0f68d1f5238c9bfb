// SPDX-License-Identifier: MIT
// Rare wrong samples: each 1-s mean is hit with a probability and then gets an additional N(0, sigma^2)
// (contaminated normal of Tukey 1960).
#include <algorithm>

#include "physics/effects/estimation.h"

namespace imucal {
namespace {

// A hit that is hardly larger than the noise is no outlier but more noise: noise_parameters says that better.
constexpr double kDistinct = 2.5;

class Outliers : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "outliers"; }
  std::string label() const override { return "single wrong seconds"; }
  std::string description() const override { return "Rare wrong samples: contaminated normal noise (Tukey)."; }
  Family family() const override { return Family::kFastNoise; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"bit errors on the bus, resets, electrostatic or radio interference", "look at the flags of the recorder"},
            {"knocks on the table", "IEEE Std 1431-2004, shock"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"probability", 0, 1, "probability that a second is hit"},
            {"sigma_dph", 0, 1e7, "standard deviation of the hit"}};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* rng) const override {
    if (stage != SimStage::kNoise) return;
    const double probability = parameters.number("probability");
    const double sigma = parameters.number("sigma_dph");
    for (size_t i = 0; rng && i < run->rate_dph.size(); ++i)
      if (rng->uniform() < probability) run->rate_dph[i] += sigma * rng->normal();
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kNoise; }
  bool needs_temperature() const override { return false; }
  std::vector<Theta> starts(const NoiseModel& base) const override {
    return {{0.003, 6 * base.white_sigma_dph}, {0.03, 2.5 * base.white_sigma_dph}};
  }
  Theta like_hits(double part, double rms_dph) const override { return {part, rms_dph}; }
  Theta theta_lo() const override { return {2e-5, 1e-2}; }
  Theta theta_hi() const override { return {0.2, 1e7}; }
  NoiseModel noise(const NoiseModel& base, const Theta& theta) const override {
    NoiseModel out = base;
    out.hit_probability = theta[0];
    out.hit_sigma_dph = std::max(theta[1], kDistinct * base.white_sigma_dph);
    return out;
  }
  Parameters values(const Estimate& e) const override {
    return {{"probability", e.shape_at(0)}, {"sigma_dph", e.shape_at(1)}};
  }
};

} // namespace

IMUCAL_EFFECT(Outliers)

} // namespace imucal
