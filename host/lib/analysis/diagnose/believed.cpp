// SPDX-License-Identifier: MIT
#include "analysis/diagnose/believed.h"

#include "base/axis_unit.h"
#include "base/units.h"

namespace imucal {

bool is_for(const EffectSpec& spec, const std::string& axis) {
  return spec.axis.empty() || spec.axis == axis || spec.axis == axis_stem(axis);
}

Theta theta_of(const Effect& effect, const Parameters& parameters) {
  Theta theta;
  for (const EffectParameter& p : effect.parameters()) {
    if (p.is_optional || p.kind != EffectParameter::kNumber) continue;
    const double value = parameters.number(p.name);
    theta.push_back(p.name == "arw_deg_rt_h" ? white_sigma_dph(value) : value);
  }
  return theta;
}

namespace {

bool is_noise(const Effect& effect) {
  return effect.estimator() && effect.estimator()->form() == Form::kNoise;
}

} // namespace

NoiseModel known_noise(const ErrorModel& model, const std::string& axis, NoiseModel noise) {
  for (const EffectSpec& spec : model.effects) {
    const Effect& effect = find_effect(spec);
    if (is_for(spec, axis) && is_noise(effect))
      noise = effect.estimator()->noise(noise, theta_of(effect, read_parameters(spec)));
  }
  return noise;
}

bool is_part_of_base_noise(const EffectSpec& spec) {
  const Effect& effect = find_effect(spec);
  if (!is_noise(effect)) return false;
  NoiseModel with = effect.estimator()->noise(NoiseModel(), theta_of(effect, read_parameters(spec)));
  with.white_sigma_dph = 0, with.markov.clear();
  return with == NoiseModel();
}

} // namespace imucal
