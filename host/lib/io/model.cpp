// SPDX-License-Identifier: MIT
#include "io/model.h"

#include <cmath>

#include "base/axis_unit.h"
#include "base/error.h"
#include "base/units.h"
#include "io/json_file.h"
#include "io/notice.h"

namespace imucal {

double ThermalPolynomial::at(double temp_degc) const {
  const double tn = normalised(temp_degc);
  double sum = 0;
  for (size_t i = coeff_dph.size(); i-- > 0;) sum = sum * tn + coeff_dph[i];
  return sum;
}

// Tn = offset + slope Tn_new.
ThermalPolynomial ThermalPolynomial::renormalised(double to_t0_degc, double to_range_degc) const {
  const double offset = (to_t0_degc - t0_degc) / range_degc, slope = to_range_degc / range_degc;
  ThermalPolynomial out{to_t0_degc, to_range_degc, {0.0}};
  for (size_t i = coeff_dph.size(); i-- > 0;) { // Horner on polynomials: out = out (offset + slope x) + c_i
    std::vector<double> next(out.coeff_dph.size() + 1, 0.0);
    for (size_t j = 0; j < out.coeff_dph.size(); ++j) {
      next[j] += offset * out.coeff_dph[j];
      next[j + 1] += slope * out.coeff_dph[j];
    }
    next[0] += coeff_dph[i];
    out.coeff_dph = next;
  }
  while (out.coeff_dph.size() > 1 && out.coeff_dph.back() == 0) out.coeff_dph.pop_back();
  return out;
}

double ErrorModel::slow_density_dph2_s() const {
  const double white = white_sigma_dph(arw_deg_rt_h);
  double density = white * white;
  for (const Markov& m : markov) density += 2.0 * m.sigma_dph * m.sigma_dph * m.tau_s;
  return density;
}

static std::vector<EffectSpec> effects_from_json(const JsonField& list) {
  std::vector<EffectSpec> effects;
  for (const JsonField& field : list.elements()) {
    field.only({"name", "parameters", "axis", "log"});
    EffectSpec effect;
    effect.name = field.at("name").text();
    effect.place = field.place();
    if (const auto parameters = field.find("parameters")) {
      if (!parameters->json().is_object()) parameters->refuse("expected an object {...}");
      effect.parameters = parameters->json();
    }
    if (const auto axis = field.find("axis"))
      effect.axis = axis->json().is_number() ? std::to_string(axis->integer(0, 1000)) : axis->text();
    if (const auto log = field.find("log")) effect.log = static_cast<long>(log->integer(0, 1000000));
    effects.push_back(effect);
  }
  return effects;
}

// A member by its name in the contract (…_dph) or, in a model that states the unit mg, by the name in mg.
static JsonField in_unit(const JsonField& parent, const std::string& name, const std::string& unit) {
  const std::string other = name_in_unit(name, unit);
  const auto found = other == name ? std::nullopt : parent.find(other);
  if (found && parent.find(name)) found->refuse("the same as " + name + ": give one of the two");
  return found ? *found : parent.at(name);
}

static Markov markov_from_json(const JsonField& term, const std::string& unit) {
  const std::string sigma = name_in_unit("sigma_dph", unit);
  term.only({"sigma_dph", sigma.c_str(), "tau_s"});
  return {in_unit(term, "sigma_dph", unit).number(0.0, 1e9), term.at("tau_s").number(1e-3, 1e9)};
}

static ThermalPolynomial bias_from_json(const JsonField& bias, const std::string& unit) {
  const std::string coeff = name_in_unit("coeff_dph", unit);
  bias.only({"t0_degc", "range_degc", "coeff_dph", coeff.c_str()});
  ThermalPolynomial poly;
  poly.t0_degc = bias.at("t0_degc").number(-300.0, 2000.0);
  poly.range_degc = bias.at("range_degc").number(1e-6, 2000.0);
  for (const JsonField& coefficient : in_unit(bias, "coeff_dph", unit).elements())
    poly.coeff_dph.push_back(coefficient.number(-1e12, 1e12));
  if (poly.coeff_dph.empty()) in_unit(bias, "coeff_dph", unit).refuse("needs at least one coefficient");
  return poly;
}

static std::string unit_from_json(const JsonField& model) {
  const auto unit = model.find("unit");
  if (!unit) return "";
  std::string text = unit->text();
  if (text != "dph" && text != "mg") unit->refuse("expected \"dph\" (a gyro) or \"mg\" (an accelerometer)");
  return text;
}

static double white_from_json(const JsonField& model, const std::string& unit) {
  const auto white = unit == "mg" ? model.find("white_mg_rt_hz") : std::nullopt;
  if (!white) return model.at("arw_deg_rt_h").number(0.0, 1e6);
  if (model.find("arw_deg_rt_h")) white->refuse("the same as 60 arw_deg_rt_h: give one of the two");
  return arw_from_white_sigma(white->number(0.0, 1e6));
}

void ErrorModel::require_unit_of(const std::string& axis) const {
  if (unit.empty() || unit == axis_unit(axis)) return;
  throw data_error(std::string("the model is ") + (unit == "mg" ? "an accelerometer's" : "a gyro's") +
                   " (\"unit\": \"" + unit + "\"), axis " + axis + " is in " + axis_unit(axis) +
                   ": give a model of that sensor, or choose axes with --axis");
}

std::string ErrorModel::note_of_unit(const std::string& axis) const {
  if (!unit.empty() || !is_accelerometer(axis)) return "";
  return "the model does not state its unit: its figures are taken as mg; write \"unit\": \"mg\" into it";
}

void check_unit(const ErrorModel& model, const std::string& path, const std::string& axis) {
  model.require_unit_of(axis);
  const std::string note = model.note_of_unit(axis);
  if (!note.empty()) notice(path + ": " + note);
}

ErrorModel model_from_json(const JsonField& field) {
  if (field.version_of("imucal_model", "an error model").integer(0, 1000000) != 1)
    field.at("imucal_model").refuse("version not known to this program (it knows 1)");
  ErrorModel model;
  model.unit = unit_from_json(field);
  const std::string unit = model.unit_or_dph(), turn_on = name_in_unit("turn_on_sigma_dph", unit);
  field.only({"imucal_model", "unit", "arw_deg_rt_h", unit == "mg" ? "white_mg_rt_hz" : "arw_deg_rt_h", "markov",
              "turn_on_sigma_dph", turn_on.c_str(), "bias", "effects"});
  model.arw_deg_rt_h = white_from_json(field, unit);
  if (const auto list = field.find("markov")) {
    for (const JsonField& term : list->elements()) model.markov.push_back(markov_from_json(term, unit));
  }
  if (field.find("turn_on_sigma_dph") || field.find(turn_on))
    model.turn_on_sigma_dph = in_unit(field, "turn_on_sigma_dph", unit).number(0.0, 1e9);
  if (const auto bias = field.find("bias")) model.bias = bias_from_json(*bias, unit);
  if (const auto effects = field.find("effects")) model.effects = effects_from_json(*effects);
  return model;
}

ErrorModel read_model(const std::string& path) {
  return model_from_json(read_json(path));
}

std::vector<EffectSpec> read_effects(const std::string& path) {
  const JsonField file = read_json(path);
  return effects_from_json(file.json().is_array() ? file : file.at("effects"));
}

Json to_json(const ErrorModel& model) {
  Json json = {{"imucal_model", 1}, {"arw_deg_rt_h", model.arw_deg_rt_h}, {"markov", Json::array()}};
  if (!model.unit.empty()) json["unit"] = model.unit;
  for (const Markov& m : model.markov) json["markov"].push_back({{"sigma_dph", m.sigma_dph}, {"tau_s", m.tau_s}});
  json["turn_on_sigma_dph"] = model.turn_on_sigma_dph;
  if (model.bias)
    json["bias"] = {
        {"t0_degc", model.bias->t0_degc}, {"range_degc", model.bias->range_degc}, {"coeff_dph", model.bias->coeff_dph}};
  if (!model.effects.empty()) {
    json["effects"] = Json::array();
    for (const EffectSpec& e : model.effects) {
      Json effect = {{"name", e.name}, {"parameters", e.parameters}};
      if (!e.axis.empty()) effect["axis"] = e.axis;
      if (e.log >= 0) effect["log"] = e.log;
      json["effects"].push_back(effect);
    }
  }
  return json;
}

} // namespace imucal
