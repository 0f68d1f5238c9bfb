// SPDX-License-Identifier: MIT
#include "physics/effects/parameters.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "io/json_file.h"
#include "physics/effects/effect.h"

namespace imucal {

namespace {

struct UnitEnding {
  const char *ending, *unit;
};

// Longest endings first: the first that fits is the unit.
constexpr UnitEnding kUnits[] = {{"_dph_per_degc_min", "dph per degC/min"},
                                 {"_dph_per_rt_s", "dph/sqrt(s)"},
                                 {"_dph_per_degc", "dph/degC"},
                                 {"_dph_per_h", "dph/h"},
                                 {"_hz_per_degc", "Hz/degC"},
                                 {"_deg_rt_h", "deg/sqrt(h)"},
                                 {"_dph", "dph"},
                                 {"_degc", "degC"},
                                 {"_hz", "Hz"},
                                 {"_s", "s"}};

const EffectParameter* find_parameter(const std::vector<EffectParameter>& list, const std::string& name) {
  for (const EffectParameter& parameter : list)
    if (parameter.name == name) return &parameter;
  return nullptr;
}

std::vector<StepValue> read_steps(const EffectParameter& parameter, const JsonField& field) {
  std::vector<StepValue> steps;
  for (const JsonField& step : field.elements()) {
    step.only({"log", "t_s", "amplitude_dph"});
    StepValue value;
    value.log = static_cast<long>(step.at("log").integer(0, 1000000));
    value.t_s = step.at("t_s").number(0.0, 1e9);
    value.amplitude_dph.value = step.at("amplitude_dph").number(parameter.lo, parameter.hi);
    steps.push_back(value);
  }
  return steps;
}

std::string read_text(const EffectParameter& parameter, const JsonField& field) {
  const std::string text = field.text();
  if (parameter.words.empty()) return text;
  std::string known;
  for (const std::string& word : parameter.words) {
    if (word == text) return text;
    known += (known.empty() ? "" : ", ") + word;
  }
  field.refuse("\"" + text + "\" is not one of " + known);
}

ParameterValue read_value(const EffectParameter& parameter, const JsonField& field) {
  switch (parameter.kind) {
  case EffectParameter::kText:
    return {parameter.name, read_text(parameter, field)};
  case EffectParameter::kSteps:
    return {parameter.name, read_steps(parameter, field)};
  case EffectParameter::kNumber:
    break;
  }
  return {parameter.name, field.number(parameter.lo, parameter.hi)};
}

Json value_json(const ParameterValue& value) {
  if (value.kind == EffectParameter::kText) return value.text;
  if (value.kind == EffectParameter::kNumber) return value.number.value;
  Json steps = Json::array();
  for (const StepValue& step : value.steps)
    steps.push_back({{"log", step.log}, {"t_s", step.t_s}, {"amplitude_dph", step.amplitude_dph.value}});
  return steps;
}

} // namespace

std::string unit_of(const std::string& parameter_name) {
  for (const UnitEnding& known : kUnits) {
    const std::string ending = known.ending;
    if (parameter_name.size() >= ending.size() &&
        parameter_name.compare(parameter_name.size() - ending.size(), ending.size(), ending) == 0)
      return known.unit;
  }
  return "";
}

std::string unit_of(const std::string& parameter_name, const std::string& axis_unit) {
  const std::string gyro = "dph", unit = unit_of(parameter_name);
  return unit.compare(0, gyro.size(), gyro) == 0 ? axis_unit + unit.substr(gyro.size()) : unit;
}

std::string EffectParameter::unit() const {
  return kind == kNumber ? unit_of(name) : "";
}

const ParameterValue* Parameters::find(const std::string& name) const {
  for (const ParameterValue& value : values_)
    if (value.name == name) return &value;
  return nullptr;
}

double Parameters::number(const std::string& name) const {
  const ParameterValue* value = find(name);
  if (!value) throw std::logic_error("parameter " + name + " was not read");
  return value->number.value;
}

double Parameters::number_or(const std::string& name, double fallback) const {
  const ParameterValue* value = find(name);
  return value ? value->number.value : fallback;
}

std::string Parameters::text_or(const std::string& name, const std::string& fallback) const {
  const ParameterValue* value = find(name);
  return value ? value->text : fallback;
}

const std::vector<StepValue>& Parameters::steps(const std::string& name) const {
  const ParameterValue* value = find(name);
  if (!value) throw std::logic_error("parameter " + name + " was not read");
  return value->steps;
}

Parameters read_parameters(const Effect& effect, const Json& json, const std::string& place) {
  const JsonField root(json, place + ": " + effect.name());
  const std::vector<EffectParameter> list = effect.parameters();
  if (!json.is_object()) root.refuse("expected an object {...}");
  for (const std::string& name : json.names()) {
    if (find_parameter(list, name)) continue;
    std::string known;
    for (const EffectParameter& parameter : list) known += (known.empty() ? "" : ", ") + parameter.name;
    root.refuse("unknown parameter \"" + name + "\" (known: " + known + ")");
  }
  Parameters values;
  for (const EffectParameter& parameter : list)
    if (!parameter.is_optional || json.contains(parameter.name))
      values.add(read_value(parameter, root.at(parameter.name)));
  return values;
}

Parameters read_parameters(const EffectSpec& spec) {
  return read_parameters(find_effect(spec), spec.parameters, spec.place.empty() ? "effects" : spec.place);
}

Json parameters_json(const Parameters& parameters) {
  Json out = Json::object();
  for (const ParameterValue& value : parameters) out[value.name] = value_json(value);
  return out;
}

EffectSpec spec_of(const Effect& effect, const Parameters& parameters) {
  return {effect.name(), parameters_json(parameters)};
}

Json std_errors_json(const Parameters& parameters) {
  Json out = Json::object();
  for (const ParameterValue& value : parameters) {
    if (value.kind == EffectParameter::kNumber && std::isfinite(value.number.std_error))
      out[value.name] = value.number.std_error;
    if (value.kind != EffectParameter::kSteps) continue;
    Json steps = Json::array();
    for (const StepValue& step : value.steps)
      steps.push_back(
          {{"amplitude_dph",
            std::isfinite(step.amplitude_dph.std_error) ? Json(step.amplitude_dph.std_error) : Json(nullptr)}});
    out[value.name] = steps;
  }
  return out;
}

} // namespace imucal
