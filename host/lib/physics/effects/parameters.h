// SPDX-License-Identifier: MIT
// Parameters of an effect as typed values with units and standard errors.  JSON is read and written here, at
// the door; nothing behind it looks into JSON.
#pragma once
#include <initializer_list>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "io/model.h"

namespace imucal {

class Effect;

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

// What a parameter of an effect may be.
struct EffectParameter {
  enum Kind { kNumber, kText, kSteps }; // kSteps: list of {log, t_s, amplitude_dph}
  std::string name;                     // carries its unit
  double lo, hi;                        // bounds of what makes sense
  std::string meaning;
  Kind kind = kNumber;
  bool is_optional = false;
  std::vector<std::string> words = {}; // kText: the words it may be; none: any text

  std::string unit() const;
};

// Unit of a parameter in plain words, by the end of its name: "sigma_dph" -> "dph"; "" for a pure number.
std::string unit_of(const std::string& parameter_name);
// Of an axis in that unit: "mg" for "dph".
std::string unit_of(const std::string& parameter_name, const std::string& axis_unit);

struct Measured {
  double value = 0;
  double std_error = kUnknown; // NaN: not known
};

// One jump of `bias_step`: it belongs to one log (its place in the list of logs, from 0).
struct StepValue {
  long log = 0;
  double t_s = 0;
  Measured amplitude_dph;
};

struct ParameterValue {
  ParameterValue(std::string n, Measured m) : name(std::move(n)), number(m) {}
  ParameterValue(std::string n, double v) : name(std::move(n)), number{v, kUnknown} {}
  ParameterValue(std::string n, std::string t) : name(std::move(n)), kind(EffectParameter::kText), text(std::move(t)) {}
  ParameterValue(std::string n, std::vector<StepValue> s)
      : name(std::move(n)), kind(EffectParameter::kSteps), steps(std::move(s)) {}

  std::string name;
  EffectParameter::Kind kind = EffectParameter::kNumber;
  Measured number;
  std::string text;
  std::vector<StepValue> steps;
  std::string unit() const { return unit_of(name); }
};

// Values of the parameters of one effect, in the order of the contract.
class Parameters {
public:
  Parameters() = default;
  Parameters(std::initializer_list<ParameterValue> values) : values_(values) {}

  void add(ParameterValue value) { values_.push_back(std::move(value)); }
  bool empty() const { return values_.empty(); }
  std::vector<ParameterValue>::const_iterator begin() const { return values_.begin(); }
  std::vector<ParameterValue>::const_iterator end() const { return values_.end(); }
  const ParameterValue* find(const std::string& name) const; // nullptr: not given

  // Value of a parameter that must be there (std::logic_error: the caller forgot to read them through
  // read_parameters), and of one that may be left out.
  double number(const std::string& name) const;
  double number_or(const std::string& name, double fallback) const;
  std::string text_or(const std::string& name, const std::string& fallback) const;
  const std::vector<StepValue>& steps(const std::string& name) const;

private:
  std::vector<ParameterValue> values_;
};

// From JSON.  data_error, naming place, effect and parameter: missing, unknown, out of bounds, of another
// kind.
Parameters read_parameters(const Effect& effect, const Json& json, const std::string& place = "effects");

// Of an effect as a file names it, which the messages name.
Parameters read_parameters(const EffectSpec& spec);

// To JSON: {"amplitude_dph": 12, …}, and the standard errors that are known, by the same names.
Json parameters_json(const Parameters& parameters);
Json std_errors_json(const Parameters& parameters);

// The effect with these values as a model names it.
EffectSpec spec_of(const Effect& effect, const Parameters& parameters);

} // namespace imucal
