// SPDX-License-Identifier: MIT
// The list of effects.  To add one: write host/lib/physics/effects/<name>.cpp, declare its accessor in library.h and
// add it to the list here (see README.md in this folder).
#include "physics/effects/library.h"

#include "base/error.h"

namespace imucal {

const std::vector<const Effect*>& effect_library() {
  static const std::vector<const Effect*> library = {
      temperature_rate_effect(),
      thermal_hysteresis_effect(),
      thermal_lag_effect(),
      thermal_anomaly_effect(),
      higher_order_polynomial_effect(),
      rate_ramp_effect(),
      warm_up_effect(),
      sinusoid_effect(),
      bias_step_effect(),
      run_to_run_effect(),
      temperature_sensor_quantization_effect(),
      noise_parameters_effect(),
      second_markov_effect(),
      rate_random_walk_effect(),
      flicker_noise_effect(),
      white_noise_vs_temperature_effect(),
      markov_sigma_vs_temperature_effect(),
      markov_tau_vs_temperature_effect(),
      outliers_effect(),
      telegraph_noise_effect(),
      quantization_effect(),
      saturation_effect(),
      dead_band_effect(),
      held_samples_effect(),
      common_mode_effect(),
      auxiliary_channel_effect(),
  };
  return library;
}

const Effect& find_effect(const std::string& name) {
  std::string known;
  for (const Effect* effect : effect_library()) {
    if (effect->name() == name) return *effect;
    known += (known.empty() ? "" : ", ") + effect->name();
  }
  throw data_error("effect \"" + name + "\" is not in the library (known: " + known + ")");
}

static const EffectParameter* find_parameter(const std::vector<EffectParameter>& list,
                                             const std::string& name) {
  for (const EffectParameter& parameter : list)
    if (parameter.name == name) return &parameter;
  return nullptr;
}

static void check_value(const EffectParameter& parameter, const JsonField& field) {
  switch (parameter.kind) {
  case EffectParameter::kNumber:
    field.number(parameter.lo, parameter.hi);
    break;
  case EffectParameter::kText:
    field.text();
    break;
  case EffectParameter::kSteps:
    for (const JsonField& step : field.elements()) {
      step.only({"log", "t_s", "amplitude_dph"});
      step.at("log").integer(0, 1000000);
      step.at("t_s").number(0.0, 1e9);
      step.at("amplitude_dph").number(parameter.lo, parameter.hi);
    }
    break;
  }
}

void check_parameters(const Effect& effect, const Json& parameters, const std::string& place) {
  const JsonField root(parameters, place + ": " + effect.name());
  const std::vector<EffectParameter> list = effect.parameters();
  if (!parameters.is_object()) root.refuse("expected an object {...}");
  for (const auto& item : parameters.items()) {
    if (find_parameter(list, item.key())) continue;
    std::string known;
    for (const EffectParameter& parameter : list) known += (known.empty() ? "" : ", ") + parameter.name;
    root.refuse("unknown parameter \"" + item.key() + "\" (known: " + known + ")");
  }
  for (const EffectParameter& parameter : list) check_value(parameter, root.at(parameter.name));
}

double effect_number(const Effect& effect, const Json& parameters, const std::string& name) {
  const JsonField root(parameters, "effects: " + effect.name());
  const std::vector<EffectParameter> list = effect.parameters();
  const EffectParameter* parameter = find_parameter(list, name);
  return root.at(name).number(parameter ? parameter->lo : -1e300, parameter ? parameter->hi : 1e300);
}

} // namespace imucal
