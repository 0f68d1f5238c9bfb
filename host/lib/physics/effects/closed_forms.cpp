// SPDX-License-Identifier: MIT
#include "physics/effects/closed_forms.h"

#include "base/error.h"
#include "io/json_file.h"
#include "physics/effects/effect.h"

namespace imucal {

static NoiseComponent component_of(const EffectSpec& spec, double dt_s) {
  if (spec.name == "angle_quantization") {
    const JsonField field(spec.parameters, "effect " + spec.name);
    return angle_component(field.at("q_arcsec").number(0, 1e9) / dt_s);
  }
  const auto component = find_effect(spec).closed_form(read_parameters(spec), dt_s);
  if (!component)
    throw data_error((spec.place.empty() ? "" : spec.place + ": ") + "effect \"" + spec.name +
                     "\" has no closed form with these parameters: simulate it (gyrosim log), then dp");
  return *component;
}

std::vector<NoiseComponent> noise_components(const ErrorModel& model, double dt_s) {
  std::vector<NoiseComponent> out = model_components(model, dt_s);
  for (const EffectSpec& spec : model.effects) out.push_back(component_of(spec, dt_s));
  return out;
}

} // namespace imucal
