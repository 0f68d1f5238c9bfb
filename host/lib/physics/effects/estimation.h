// SPDX-License-Identifier: MIT
// The estimation side of an effect: what `diagnose` needs to look for it in logs.  An effect that can be
// estimated returns one of these from Effect::estimator(); the engine (host/lib/analysis/diagnose) knows
// forms, never names.
#pragma once
#include <algorithm>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "noise/noise_model.h"
#include "physics/effects/effect.h"

namespace imucal {

using Theta = std::vector<double>;
using Column = std::vector<double>;

// One log of one axis as the engine sees it, row by row.
struct RunInput {
  size_t log = 0;
  double dt_s = 1;
  std::vector<double> t_s;           // from the start of the log
  std::vector<long> tick;            // t_s in steps of dt_s, whole and increasing: a jump is a gap
  std::vector<double> temp_degc;     // as logged; where empty, interpolated in time
  std::vector<double> smooth_degc;   // without the noise and the steps of the thermometer
  std::vector<double> rate_degc_min; // slope of smooth_degc
  // Where a row is a mean over more time: smooth_degc on the way through it, path_per_row of them for every row.  A memory of the
  // extremes of the temperature (play) follows the way; means miss where it turns.  Empty: every row is one moment.
  std::vector<double> path_degc = {};
  size_t path_per_row = 1;
  std::vector<double> tn;       // normalised logged temperature
  std::vector<double> rate_dph; // NaN where missing
  std::map<std::string, std::vector<double>> auxiliary;
  double t0_degc = 0, range_degc = 1; // normalisation
  int order = 3;                      // of the polynomial that is estimated beside everything
  double lo_degc = 0, hi_degc = 60;   // span of the fitted logs, which free shapes are laid over
  // Rows before which the recorder had stopped for longer than its seconds tell, increasing: what an effect with a memory did
  // meanwhile is as unknown as what it did before the log.
  std::vector<size_t> restarts = {};
  // How often the distance is halved of the states for which a bounded memory (is_start_bounded) has start columns; not at all:
  // its middle and its two extremes.
  int start_halvings = 0;

  size_t size() const { return t_s.size(); }
  double normalised(double temp) const { return (temp - t0_degc) / range_degc; }
  // 0 and 1 a tenth of the span of the fitted logs beyond its ends.
  double place_in_span(double temp) const { return ((temp - lo_degc) / std::max(1e-6, hi_degc - lo_degc) + 0.1) / 1.2; }
};

// How an effect enters the likelihood.
enum class Form {
  kColumns,     // mean: columns with free coefficients common to all runs, shape parameters on a grid
  kTemperature, // mean: another temperature in the polynomial
  kRunRandom,   // mean: columns with random coefficients of every run
  kTone,        // mean: two columns (cosine, sine) with free coefficients in every run
  kSteps,       // mean: a step at a free time of one run, several of them
  kNoise,       // covariance: another NoiseModel
  kStructural,  // deterministic signature in the samples
  kAxes,        // shared between axes
};

// The size that a coefficient may have before any data: a normal distribution of this standard deviation, in
// units of G, the rms of the 60-s means of what the polynomial alone leaves.
struct PriorScale {
  double column = 3;   // of the common columns
  bool by_rms = false; // the columns have units of their own: divide by their rms
  double start = 1;    // of the start columns of every run
};

// What was estimated of one effect.  The errors may be shorter or empty: not known then.
struct Estimate {
  Theta shape;                      // or theta of a noise effect
  std::vector<double> coefficients; // of its common columns; kTone: cosine, sine of every run
  Theta shape_errors;
  std::vector<double> coefficient_errors;

  Measured shape_at(size_t i) const { return measured(shape, shape_errors, i); }
  Measured coefficient(size_t i) const { return measured(coefficients, coefficient_errors, i); }

private:
  static Measured measured(const std::vector<double>& values, const std::vector<double>& errors, size_t i) {
    return {i < values.size() ? values[i] : 0.0, i < errors.size() ? errors[i] : kUnknown};
  }
};

// What a structural detector found in one axis.
struct Signature {
  Parameters parameters;
  std::string statement;
  double evidence_nats = 0;
  std::vector<double> white_dph2;          // per run: variance that it adds to every sample; empty: none
  std::vector<std::vector<char>> unusable; // per run and row: samples that carry no rate
};

// Where a jump may lie: the temperature there, and its slope.
struct JumpPlace {
  double temp_degc = 0, slope_degc_s = 0;
  bool is_rising() const { return slope_degc_s > 0; }
};

class EffectEstimator {
public:
  virtual ~EffectEstimator() = default;
  virtual Form form() const = 0;
  virtual bool needs_temperature() const { return true; }

  // kColumns, kTemperature: values of the shape parameters to scan, and how far they may be refined.
  // lo_degc, hi_degc: coldest and hottest temperature of all runs.
  virtual std::vector<Theta> grid(double /*lo_degc*/, double /*hi_degc*/) const { return {Theta{}}; }
  // The same where the grid depends on what the log holds (auxiliary columns).
  virtual std::vector<Theta> grid_on(const RunInput& /*run*/, double lo_degc, double hi_degc) const {
    return grid(lo_degc, hi_degc);
  }
  virtual Theta shape_lo() const { return {}; }
  virtual Theta shape_hi() const { return {}; }
  // The thermometer is never quite where an effect arises.  Where seconds between the two matter, one more parameter
  // stands last in a shape: by how much that place lags the thermometer (negative: leads it), at most kNearby_s.  It
  // belongs to the measurement, not to the effect: nothing is said of it.
  virtual bool is_near_thermometer() const { return false; }
  static constexpr double kNearby_s = 15;
  // The lags that a scan tries; between them and beyond, it is refined like the shape.
  virtual std::vector<double> nearby_lags_s() const { return {-0.5 * kNearby_s, 0, 0.5 * kNearby_s}; }
  // Whether a shape holds all that is refined: the parameters within shape_lo and shape_hi, and that lag.
  bool is_refined(const Theta& shape) const {
    return shape.size() == shape_lo().size() + (is_near_thermometer() ? 1 : 0);
  }
  virtual size_t n_columns() const { return 1; }
  // Per column: its prior in units of `prior`.  Empty: 1.
  virtual std::vector<double> relative_sd() const { return {}; }
  // The same effect of a shape that its parameters do not tell: it has more columns, and start states of its own.  It competes
  // under the name of the effect; what is told are the parameters of the shape with parameters that comes nearest.
  struct AnyShape {
    const EffectEstimator* estimator = nullptr; // nullptr: the effect has no other shape
    const char* what = "";                      // in words
  };
  virtual AnyShape of_any_shape() const { return {}; }
  // The auxiliary column of the log that the effect follows at this shape; empty: none.
  virtual std::string column_of(const RunInput& /*run*/, const Theta& /*shape*/) const { return ""; }
  // kColumns, kRunRandom, kTone: one value per row of the run, for each column.
  virtual std::vector<Column> columns(const RunInput&, const Theta&) const { return {}; }
  // The state in which an effect with a memory began the run is free: columns with coefficients of this run
  // alone, of size about one, that add what another start makes.  Empty: no memory, or none that this run
  // could show.  Their number may differ from shape to shape and from run to run.  For kTemperature they are
  // about the fit with the temperature in equilibrium at the start; other columns start in the middle state.
  virtual std::vector<Column> start_columns(const RunInput&, const Theta&) const { return {}; }
  // Whether that state lies between two extremes of the effect's own size: then no coefficient of the first start column of
  // a run is larger than that of the first column.
  virtual bool is_start_bounded() const { return false; }
  // The columns where the run began such a part of the way from the middle state (0) to one of those extremes (-1 and 1).
  virtual std::vector<Column> columns_from(const RunInput& run, const Theta& shape, double /*start*/) const {
    return columns(run, shape);
  }
  // Whether a start state is no more than another size of the effect in that run, and its parameter is the largest of them: that of
  // a run which began at rest.  It then has one column, and one start column, which is the same.
  virtual bool is_start_a_size() const { return false; }
  // Whether logs of this length can show the shape; else any slow change would do, and it is no name.
  virtual bool is_shown_in(double /*log_s*/, const Theta& /*shape*/) const { return true; }
  // Whether the likelihood over the shape, of one parameter, has corners and several tops: its curvature at one of them says
  // little of where the others are.
  virtual bool has_many_tops() const { return false; }
  // Whether these runs hold what the effect does at this shape: whole, and what comes at a moment at least twice.  What happens
  // once cannot be told from something that happened at that time, and is no candidate.
  virtual bool is_repeated(const std::vector<const RunInput*>& /*runs*/, const Theta& /*shape*/) const { return true; }
  // Shapes about one of the grid that are tried before it is refined: where a small change of one parameter alone leads
  // over a ridge.  `spacing`: of the grid, in units of the first parameter.
  virtual std::vector<Theta> neighbours(const Theta& /*shape*/, double /*spacing*/) const { return {}; }
  // Whether the effect jumps; then shapes with which it would at these places, which lie between those of a grid.
  virtual bool can_jump() const { return false; }
  virtual std::vector<Theta> shapes_of_jumps(const std::vector<JumpPlace>& /*places*/) const { return {}; }
  virtual PriorScale prior() const { return {}; }
  // kTemperature: the temperature at which B is taken.
  virtual Column temperature(const RunInput&, const Theta&) const { return {}; }

  // kNoise: parameters (all positive ones are searched in their logarithm), starting points from a base
  // model, and the model that results.
  virtual std::vector<Theta> starts(const NoiseModel& /*base*/) const { return {}; }
  // Parameters with which it is most like a Markov process: a start where the base has swallowed it.  Empty: none.
  virtual Theta like(const Markov& /*process*/) const { return {}; }
  // Parameters with which it is most like single samples that stand out, such a part of all and so far off.  Empty: none.
  virtual Theta like_hits(double /*part*/, double /*rms_dph*/) const { return {}; }
  virtual Theta theta_lo() const { return {}; }
  virtual Theta theta_hi() const { return {}; }
  virtual bool is_logarithmic() const { return true; }
  virtual NoiseModel noise(const NoiseModel& base, const Theta&) const { return base; }

  // Properties.  Slow noise can absorb any smooth effect of one run; white or output noise cannot.
  virtual bool is_slow_noise() const { return false; }
  // It says that the nominal noise itself has other parameters: a finding of its own beside all others.
  virtual bool is_nominal_noise() const { return false; }
  // Its spectrum is that of a Markov process: only the distribution tells them apart.
  virtual bool has_markov_spectrum() const { return false; }
  // It jumps: jumps in time that come again and again may be it.
  virtual bool is_jumping() const { return false; }
  // The same in every run, so that it predicts runs that were not fitted.
  virtual bool is_repeatable() const { return form() == Form::kColumns || form() == Form::kTemperature; }
  virtual bool is_structural() const { return form() == Form::kStructural; }
  // It is about the steps of the thermometer: there is nothing to look for where they are fine.
  virtual bool concerns_coarse_thermometer() const { return false; }
  // Whether the effect, at this shape, does no more than that place near the thermometer does: where its steps are coarse,
  // they are the cause then, and not the few seconds.
  virtual bool is_only_nearby(const Theta& /*shape*/) const { return false; }
  // kStructural: what it spoils is missing by its value, so that the spread of the rest is distorted.
  virtual bool is_censoring() const { return false; }
  // kStructural: whether zeros far from the rates around them, which other detectors do not see, are its to count.
  virtual bool counts_drop_outs() const { return false; }
  // kStructural: detectors are asked in this order, each on what those before left usable.
  virtual int detection_order() const { return 0; }

  // Before any data: the size of the effect that an engineer would want to see, in units of the white noise
  // of 1-s means (kTemperature: in units of its shape).  A profile that cannot show it is said to be unfit.
  virtual double notable() const { return 1.7; }

  // kStructural.  Several where logs show it with other parameters.
  virtual std::vector<Signature> detect(const std::vector<RunInput>&) const { return {}; }

  // The parameters by their names of the contract, with standard errors.  kSteps: shape holds the log and
  // the time since the start of its file of every step.
  virtual Parameters values(const Estimate&) const = 0;
  // The same where the names depend on what the log holds (auxiliary columns).
  virtual Parameters values_on(const RunInput& /*run*/, const Estimate& estimate) const { return values(estimate); }
  // What its columns hold beside what those parameters say, and the polynomial of the bias takes: coefficients of powers of Tn.
  virtual std::vector<double> polynomial_beside(const RunInput& /*run*/, const Estimate&) const { return {}; }
};

// Legendre polynomial by its recursion.
double legendre(int degree, double x);

// The start columns of an effect on a run, and those of the states in which it is free again (RunInput::restarts).
std::vector<Column> free_states(const EffectEstimator& effect, const RunInput& run, const Theta& shape);

} // namespace imucal
