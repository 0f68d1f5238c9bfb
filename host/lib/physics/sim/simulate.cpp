// SPDX-License-Identifier: MIT
#include "physics/sim/simulate.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "base/axis_unit.h"
#include "base/error.h"
#include "base/rng.h"
#include "base/units.h"

namespace imucal {

namespace {

// An effect that acts on one axis of one log, with its place in the list (it addresses its random stream).
struct ActiveEffect {
  const Effect* effect;
  Parameters parameters;
  uint32_t place;
};

// Gyros and accelerometers are counted by themselves.
std::vector<std::string> axis_names(const std::vector<ErrorModel>& models, size_t n_axes) {
  std::vector<std::string> names;
  size_t n_gyros = 0, n_accels = 0;
  for (size_t a = 0; a < n_axes; ++a) {
    const std::string unit = (models.size() > 1 ? models[a] : models[0]).unit_or_dph();
    names.push_back(sim_axis_name(unit == "mg" ? n_accels++ : n_gyros++, unit));
  }
  return names;
}

bool acts_on(const EffectSpec& spec, const std::vector<std::string>& names, size_t axis, size_t log) {
  if (spec.log >= 0 && static_cast<size_t>(spec.log) != log) return false;
  if (spec.axis.empty()) return true;
  const std::string& name = names[axis];
  return spec.axis == name || spec.axis == axis_stem(name) || spec.axis == std::to_string(axis);
}

void check_axes(const std::vector<EffectSpec>& effects, const std::vector<std::string>& names) {
  for (const EffectSpec& spec : effects) {
    bool known = spec.axis.empty();
    EffectSpec any_log = spec;
    any_log.log = -1;
    for (size_t a = 0; a < names.size(); ++a) known = known || acts_on(any_log, names, a, 0);
    if (!known)
      throw data_error("effect " + spec.name + ": axis \"" + spec.axis + "\" is not simulated; the axes are " +
                       names.front() + (names.size() > 1 ? " to " + names.back() : "") +
                       " (simulate more with --axes)");
  }
}

class AxisSimulator {
public:
  AxisSimulator(std::vector<ActiveEffect> effects, SimRun* run, uint64_t address)
      : effects_(std::move(effects)), run_(run), address_(address) {
    for (const ActiveEffect& e : effects_)
      rngs_.emplace_back(run->seed, address, static_cast<uint32_t>(run->axis),
                         static_cast<uint32_t>(Stream::kEffect) + e.place);
  }
  void stage(SimStage stage) {
    for (size_t i = 0; i < effects_.size(); ++i)
      effects_[i].effect->simulate(stage, effects_[i].parameters, run_, &rngs_[i]);
  }
  void go(const SimOptions& options, double turn_on_dph) {
    SimRun& run = *run_;
    const size_t n = run.t_s.size();
    stage(SimStage::kTemperature);
    if (options.temp_lsb_degc > 0)
      for (double& t : run.thermometer_degc) t = quantised(t, options.temp_lsb_degc);
    stage(SimStage::kBias);
    for (size_t k = 0; k < n; ++k) run.rate_dph[k] += turn_on_dph + run.bias.at(run.gyro_temp_degc[k]);
    stage(SimStage::kNoise);
    add_noise(&run, run.seed, address_);
    stage(SimStage::kOutput);
    if (options.rate_lsb_dph > 0)
      for (double& r : run.rate_dph) r = quantised(r, options.rate_lsb_dph);
  }

private:
  std::vector<ActiveEffect> effects_;
  std::vector<Rng> rngs_;
  SimRun* run_;
  uint64_t address_;
};

SimRun start_run(const ErrorModel& model, const std::vector<double>& t_s, const std::vector<double>& temp_degc) {
  SimRun run;
  run.model = &model;
  run.t_s = t_s;
  run.case_temp_degc = temp_degc;
  run.gyro_temp_degc = temp_degc;
  run.thermometer_degc = temp_degc;
  run.bias = model.bias_or_none();
  run.rate_dph.assign(t_s.size(), 0.0);
  run.white_sigma_dph.assign(t_s.size(), white_sigma_dph(model.arw_deg_rt_h));
  for (const Markov& m : model.markov)
    run.markov.push_back({std::vector<double>(t_s.size(), m.sigma_dph), std::vector<double>(t_s.size(), m.tau_s)});
  return run;
}

// The thermometer is one per device: its noise does not depend on the axis.
std::vector<double> thermometer(const std::vector<double>& temp_degc, const SimOptions& options) {
  std::vector<double> shown = temp_degc;
  if (options.temp_noise_degc > 0) {
    Rng rng(options.seed, stream_run(options), 0, Stream::kThermometer);
    for (double& t : shown) t += options.temp_noise_degc * rng.normal();
  }
  return shown;
}

void add_recording_flaws(const std::vector<double>& t_s, const SimOptions& options, SimulatedLog* out) {
  out->stamp_s = t_s;
  if (options.jitter_s > 0) {
    Rng rng(options.seed, stream_run(options), 0, Stream::kJitter);
    for (size_t k = 0; k < t_s.size(); ++k) {
      const double step_s = k > 0 ? t_s[k] - t_s[k - 1] : 1.0;
      out->stamp_s[k] += std::clamp(options.jitter_s * rng.normal(), -step_s / 3, step_s / 3);
    }
  }
  out->is_missing.assign(t_s.size(), false);
  if (options.missing_frac > 0) {
    Rng rng(options.seed, stream_run(options), 0, Stream::kMissing);
    for (size_t k = 0; k < t_s.size(); ++k) out->is_missing[k] = rng.uniform() < options.missing_frac;
  }
}

} // namespace

std::string sim_axis_name(size_t i, const std::string& unit) {
  return (unit == "mg" ? "a" : "g") + (i < 3 ? std::string(1, "xyz"[i]) : std::to_string(i)) + "_" + unit;
}

uint64_t stream_run(const SimOptions& options) {
  return (options.device << 16) + options.log_index;
}

uint64_t device_seed(const SimOptions& options) {
  return options.seed + 0x9E3779B97F4A7C15u * options.device;
}

double quantised(double value, double lsb) {
  return lsb > 0 ? lsb * std::nearbyint(value / lsb) : value;
}

void add_noise(SimRun* run, uint64_t seed, uint64_t run_address) {
  const size_t n = run->t_s.size();
  Rng white(seed, run_address, static_cast<uint32_t>(run->axis), Stream::kWhite);
  for (size_t k = 0; k < n; ++k) run->rate_dph[k] += run->white_sigma_dph[k] * white.normal();
  Rng walk(seed, run_address, static_cast<uint32_t>(run->axis), Stream::kMarkov);
  double first_dph = 0;
  for (const SimRun::MarkovPath& path : run->markov) {
    double unit = 0; // unit-variance process; stationary at the start
    double last_dt_s = -1, last_tau_s = -1, phi = 0, rest = 1;
    for (size_t k = 0; k < n; ++k) {
      const double dt_s = k > 0 ? run->t_s[k] - run->t_s[k - 1] : 0.0;
      if (k == 0) {
        unit = walk.normal();
      } else {
        if (dt_s != last_dt_s || path.tau_s[k] != last_tau_s) {
          last_dt_s = dt_s;
          last_tau_s = path.tau_s[k];
          phi = MarkovStep(dt_s, last_tau_s).phi();
          rest = MarkovStep(dt_s, last_tau_s).drive();
        }
        unit = phi * unit + rest * walk.normal();
      }
      if (k == 0) first_dph += path.sigma_dph[0] * unit;
      run->rate_dph[k] += path.sigma_dph[k] * unit;
    }
  }
  if (!run->markov.empty()) run->start_state["markov_dph"] = first_dph;
}

SimulatedLog simulate(const std::vector<ErrorModel>& models, size_t n_axes, const std::vector<double>& t_s,
                      const std::vector<double>& temp_degc, const std::vector<EffectSpec>& effects,
                      const SimOptions& options) {
  if (models.empty() || (models.size() > 1 && models.size() != n_axes))
    throw usage_error("give one error model, or one per axis (" + std::to_string(n_axes) + " axes, " +
                      std::to_string(models.size()) + " models)");
  const std::vector<std::string> names = axis_names(models, n_axes);
  check_axes(effects, names);
  SimulatedLog out;
  const std::vector<double> shown_degc = thermometer(temp_degc, options);
  const uint64_t address = stream_run(options);
  for (size_t a = 0; a < n_axes; ++a) {
    const ErrorModel& model = models.size() > 1 ? models[a] : models[0];
    SimulatedAxis axis;
    axis.name = names[a];
    axis.run = start_run(model, t_s, temp_degc);
    axis.run.thermometer_degc = shown_degc;
    axis.run.axis = a;
    axis.run.n_axes = n_axes;
    axis.run.log = options.log_index;
    axis.run.n_logs = options.n_logs;
    axis.run.start = options.start;
    axis.run.seed = device_seed(options);
    if (model.turn_on_sigma_dph > 0)
      axis.turn_on_dph =
          model.turn_on_sigma_dph * Rng(axis.run.seed, address, static_cast<uint32_t>(a), Stream::kTurnOn).normal();
    std::vector<ActiveEffect> active;
    uint32_t place = 0;
    for (const std::vector<EffectSpec>* list : {&model.effects, &effects})
      for (const EffectSpec& spec : *list) {
        if (acts_on(spec, names, a, options.log_index))
          active.push_back({&find_effect(spec), read_parameters(spec), place});
        ++place;
      }
    AxisSimulator(active, &axis.run, address).go(options, axis.turn_on_dph);
    axis.run.model = nullptr; // the caller's models may go before the result does
    out.axes.push_back(std::move(axis));
  }
  add_recording_flaws(t_s, options, &out);
  return out;
}

SimulatedLog simulate(const std::vector<ErrorModel>& models, size_t n_axes, const Profile& profile,
                      const std::vector<EffectSpec>& effects, const SimOptions& options) {
  const std::vector<double> temp_degc = profile.temperatures(1.0);
  std::vector<double> t_s(temp_degc.size());
  for (size_t k = 0; k < t_s.size(); ++k) t_s[k] = static_cast<double>(k + 1);
  return simulate(models, n_axes, t_s, temp_degc, effects, options);
}

static std::string digits(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

Log to_log(const SimulatedLog& simulated, const SimOptions& options) {
  Log log;
  log.metadata["device"] = "simulated";
  log.metadata["serial"] = std::to_string(options.seed) + "." + std::to_string(options.device);
  log.metadata["run"] = std::to_string(options.log_index);
  log.metadata["seed"] = std::to_string(options.seed);
  for (const SimulatedAxis& a : simulated.axes)
    for (const auto& [what, value] : a.run.start_state) log.metadata["start." + a.name + "." + what] = digits(value);
  const size_t n = simulated.stamp_s.size();
  // A device has one thermometer: an effect on it that is restricted to some axes shows in the log all the
  // same.
  const std::vector<double>* shown = &simulated.axes.front().run.thermometer_degc;
  for (const SimulatedAxis& a : simulated.axes)
    if (a.run.thermometer_degc != a.run.gyro_temp_degc) {
      shown = &a.run.thermometer_degc;
      break;
    }
  for (const SimulatedAxis& a : simulated.axes) {
    LogAxis axis;
    axis.name = a.name;
    axis.is_gyro = !is_accelerometer(a.name);
    axis.rate_dph.reserve(n);
    log.axes.push_back(std::move(axis));
  }
  for (size_t k = 0; k < n; ++k) {
    if (simulated.is_missing[k]) continue;
    log.t_s.push_back(simulated.stamp_s[k]);
    log.temp_degc.push_back((*shown)[k]);
    for (size_t a = 0; a < simulated.axes.size(); ++a)
      log.axes[a].rate_dph.push_back(simulated.axes[a].run.rate_dph[k]);
    // Columns that an effect made or used belong to the device, not to an axis.
    for (const SimulatedAxis& a : simulated.axes)
      for (const auto& [name, column] : a.run.auxiliary)
        if (log.auxiliary[name].size() < log.t_s.size()) log.auxiliary[name].push_back(column[k]);
  }
  return log;
}

} // namespace imucal
