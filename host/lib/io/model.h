// SPDX-License-Identifier: MIT
// The error model of a sensor (host/formats.md, Model; paper eq. 1): angle random walk, first-order Gauss-Markov
// instabilities, turn-on constant and, optionally, the thermal polynomial B(T) and further effects.
#pragma once
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "io/json.h"

namespace imucal {

// A step of a first-order Gauss-Markov process of variance one, exactly: x <- phi x + drive z, z of variance one.  Filters and
// simulators all take it from here (test_layout.py): the device asks for m, q and r and cannot see a slip in them.
// Every member works its value out anew: take what you need.
class MarkovStep {
public:
  MarkovStep(double dt_s, double tau_s) : MarkovStep(dt_s / tau_s) {}
  explicit MarkovStep(double dt_over_tau) : dt_over_tau_(dt_over_tau) {}
  double phi() const { return std::exp(-dt_over_tau_); }      // correlation over the step
  double m() const { return -std::expm1(-dt_over_tau_); }     // 1 - phi, without cancellation
  double q() const { return -std::expm1(-2 * dt_over_tau_); } // 1 - phi^2, without cancellation
  double drive() const { return std::sqrt(q()); }

private:
  double dt_over_tau_;
};

// First-order Gauss-Markov process with stationary standard deviation and time constant.
struct Markov {
  double sigma_dph = 0;
  double tau_s = 0;
  MarkovStep step(double dt_s = 1.0) const { return {dt_s, tau_s}; }
  double phi(double dt_s = 1.0) const { return step(dt_s).phi(); }
  double q_dph2(double dt_s = 1.0) const { return sigma_dph * sigma_dph * step(dt_s).q(); }
};

// What is believed of every coefficient of B(T) before the first second, unless the user says: one standard deviation, in the
// unit of the channel; far above any bias, so that it costs nothing.
constexpr double kPriorSigma = 1e4;

// B(T) = sum b_i Tn^i [dph], Tn = (T - t0)/range.
struct ThermalPolynomial {
  double t0_degc = 0;
  double range_degc = 1;
  std::vector<double> coeff_dph;
  double normalised(double temp_degc) const { return (temp_degc - t0_degc) / range_degc; }
  double at(double temp_degc) const;
  // The same curve in (T - to_t0)/to_range, without zeros at its end.
  ThermalPolynomial renormalised(double to_t0_degc, double to_range_degc) const;
};

// By which effects normalise the temperature where a model has no `bias`, in the simulator and in diagnose alike.
constexpr double kUsualT0_degc = 30, kUsualRange_degc = 30;

// An effect by name, with its parameters as written in the file (names and units: diagnose --list-effects).  In a file:
// {"name": "warm_up", "parameters": {…}, "axis": "gx", "log": 2}; the last two restrict where it is simulated.
struct EffectSpec {
  std::string name;
  Json parameters = Json::object();
  std::string axis = {};  // simulated on this axis only ("gx_dph", "gx" or the place "0"); empty: on all
  long log = -1;          // simulated in the log of this index only; -1: in all
  std::string place = {}; // in its file, for messages; empty: of no file
};

// Of an accelerometer the members named _dph are in mg, and 60 arw_deg_rt_h is its white noise in mg/sqrt(Hz), which is the
// standard deviation of a 1-s mean: one filter, one mathematics for both.
struct ErrorModel {
  double arw_deg_rt_h = 0;
  std::vector<Markov> markov;
  double turn_on_sigma_dph = 0;
  std::optional<ThermalPolynomial> bias;
  std::vector<EffectSpec> effects;
  std::string unit = {}; // "dph" or "mg"; empty: the file does not say (a gyro's, by default)

  // Where there is none: one without coefficients, of the usual normalisation.
  ThermalPolynomial bias_or_none() const {
    return bias.value_or(ThermalPolynomial{kUsualT0_degc, kUsualRange_degc, {}});
  }
  std::string unit_or_dph() const { return unit.empty() ? "dph" : unit; }
  // data_error where the model is stated to be one of another kind of sensor than the axis.
  void require_unit_of(const std::string& axis) const;
  // What to tell the user of a model without unit that is taken for the accelerometer's axis; empty: nothing.
  std::string note_of_unit(const std::string& axis) const;

  // White-noise density seen by slow signals: sum 2 sigma^2 tau + (60 arw)^2 [dph^2 s] (reference figures A, tests/README.md).
  double slow_density_dph2_s() const;
};

// Both of the above for a model that was read from `path`; the note as a notice (io/notice.h).
void check_unit(const ErrorModel& model, const std::string& path, const std::string& axis);

ErrorModel read_model(const std::string& path); // data_error names the field
ErrorModel model_from_json(const JsonField& field);
Json to_json(const ErrorModel& model);

// Effects file of `gyrosim --effects`: a list, {"effects": [...]}, or a whole model.
std::vector<EffectSpec> read_effects(const std::string& path);

} // namespace imucal
