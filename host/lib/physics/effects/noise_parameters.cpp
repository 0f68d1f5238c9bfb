// SPDX-License-Identifier: MIT
// The nominal noise is mis-tuned: white noise and the (first) Markov process have other parameters than
// believed.
#include "base/units.h"
#include "physics/effects/estimation.h"

namespace imucal {
namespace {

class NoiseParameters : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "noise_parameters"; }
  std::string label() const override { return "the believed noise parameters are off"; }
  std::string description() const override {
    return "The noise parameters of the model are wrong: other angle random walk, Markov sigma and time "
           "constant.";
  }
  Family family() const override { return Family::kSlowNoise; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"the data sheet shows typical values, this device has its own", "IEEE Std 1431-2004; fit with errormodel"},
            {"the values were estimated from other data or another bandwidth",
             "El-Sheimy, Hou and Niu, IEEE Trans. Instrum. Meas. 57 (2008)"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"arw_deg_rt_h", 0, 1e4, "angle random walk"},
            {"sigma_dph", 0, 1e6, "standard deviation of the Markov process"},
            {"tau_s", 0.1, 1e6, "time constant of the Markov process"}};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kNoise) return;
    const double white = white_sigma_dph(parameters.number("arw_deg_rt_h"));
    const double sigma = parameters.number("sigma_dph");
    const double tau = parameters.number("tau_s");
    const size_t n = run->t_s.size();
    run->white_sigma_dph.assign(n, white);
    if (run->markov.empty()) run->markov.emplace_back();
    run->markov[0].sigma_dph.assign(n, sigma);
    run->markov[0].tau_s.assign(n, tau);
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kNoise; }
  bool needs_temperature() const override { return false; }
  bool is_slow_noise() const override { return true; }
  std::vector<Theta> starts(const NoiseModel& base) const override {
    const Markov term = base.markov.empty() ? Markov{base.white_sigma_dph / 2, 100} : base.markov[0];
    return {{base.white_sigma_dph, term.sigma_dph, term.tau_s}};
  }
  Theta theta_lo() const override { return {1e-3, 1e-3, 2}; }
  Theta theta_hi() const override { return {1e6, 1e6, 2e4}; }
  NoiseModel noise(const NoiseModel& base, const Theta& theta) const override {
    NoiseModel out = base;
    out.white_sigma_dph = theta[0];
    if (theta.size() < 3) return out;
    if (out.markov.empty()) out.markov.emplace_back();
    out.markov[0] = {theta[1], theta[2]};
    return out;
  }
  bool is_nominal_noise() const override { return true; }
  // Of white noise alone where there is more than one process: the first of them is not the slow noise.
  Parameters values(const Estimate& e) const override {
    const Measured white = e.shape_at(0); // dph in 1-s means
    const Measured arw = {arw_from_white_sigma(white.value), arw_from_white_sigma(white.std_error)};
    if (e.shape.size() < 3) return {{"arw_deg_rt_h", arw}};
    return {{"arw_deg_rt_h", arw}, {"sigma_dph", e.shape_at(1)}, {"tau_s", e.shape_at(2)}};
  }
};

} // namespace

IMUCAL_EFFECT(NoiseParameters)

} // namespace imucal
