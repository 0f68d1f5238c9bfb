// SPDX-License-Identifier: MIT
#include "diagnose/library_json.h"

#include "diagnose/json_parts.h"
#include "physics/effects/estimation.h"

namespace imucal {
namespace {

Json properties_json(const EffectEstimator* e) {
  if (!e) return Json::object();
  return {{"is_slow_noise", e->is_slow_noise()},
          {"is_nominal_noise", e->is_nominal_noise()},
          {"is_repeatable", e->is_repeatable()},
          {"is_structural", e->is_structural()},
          {"is_censoring", e->is_censoring()},
          {"needs_temperature", e->needs_temperature()},
          {"concerns_coarse_thermometer", e->concerns_coarse_thermometer()},
          {"has_markov_spectrum", e->has_markov_spectrum()}};
}

} // namespace

Json library_json() {
  Json list = Json::array();
  for (const Effect* effect : effect_library()) {
    Json parameters = Json::array();
    for (const EffectParameter& p : effect->parameters()) {
      Json entry = {{"name", p.name}, {"meaning", p.meaning}, {"unit", p.unit()}};
      if (p.kind == EffectParameter::kNumber) entry["min"] = p.lo, entry["max"] = p.hi;
      if (p.is_optional) entry["optional"] = true;
      if (!p.words.empty()) entry["words"] = p.words;
      parameters.push_back(entry);
    }
    list.push_back({{"name", effect->name()},
                    {"label", effect->label()},
                    {"description", effect->description()},
                    {"family", family_name(effect->family())},
                    {"parameters", parameters},
                    {"hardware_causes", causes_json(effect->hardware_causes())},
                    {"properties", properties_json(effect->estimator())},
                    {"can_be_diagnosed", effect->estimator() != nullptr}});
  }
  Json families = Json::array();
  for (Family family : all_families())
    families.push_back({{"name", family_name(family)}, {"label", family_label(family)}});
  return {{"imucal_effects", 1}, {"effects", list}, {"families", families}};
}

} // namespace imucal
