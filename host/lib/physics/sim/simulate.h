// SPDX-License-Identifier: MIT
// Simulated gyro logs: a chamber profile, a thermal polynomial, angle random walk, Gauss-Markov
// instabilities, a turn-on constant per log, effects of the library, and the flaws of recording
// (quantisation, time jitter, missing seconds).  One call simulates one log (one run) of a device with any
// number of axes.
//
// Model (paper eq. 1 at zero rate):  rate = B(T) + turn-on + sum of Markov processes + white noise + effects.
// Noise is generated per second: white of standard deviation 60 arw, Markov discretised exactly over the step
// between rows (phi = exp(-dt/tau)), stationary at the start of every log, unit variance scaled by sigma.
// Random streams are addressed by (seed, run, axis, purpose): the same seed gives the same noise whatever
// else is switched on, so that a log with and without an effect differ by the effect alone.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "io/log.h"
#include "io/model.h"
#include "io/profile.h"
#include "physics/effects/effect.h"

namespace imucal {

struct SimOptions {
  uint64_t seed = 1;
  size_t log_index = 0; // which run of the device: turn-on, noise, run_to_run, bias_step differ by it
  size_t n_logs = 1;    // how many runs there are in all
  uint64_t device = 0;  // another device of the same seed: independent of device 0 in everything

  // How effects with a memory begin every run (one's own parameter `start` goes before).  Markov processes
  // always begin stationary.
  StartState start = StartState::kRandom;

  double temp_noise_degc = 0; // white noise of the thermometer per second
  double temp_lsb_degc = 0;   // quantum of the thermometer; 0: none
  double rate_lsb_dph = 0;    // quantum of the 1-s means; 0: none
  double jitter_s = 0;        // standard deviation of the time stamps, cut at a third of the step
  double missing_frac = 0;    // part of the seconds that is not in the log at all
};

// One axis of a simulated log with the truth behind it.
struct SimulatedAxis {
  std::string name; // gx_dph, gy_dph, gz_dph, g3_dph, … ; ax_mg, … where its model states the unit mg
  double turn_on_dph = 0;
  SimRun run; // run.rate_dph: what the log shows; run.bias: this run's polynomial
};

struct SimulatedLog {
  std::vector<SimulatedAxis> axes;
  std::vector<double> stamp_s;  // time stamps with jitter, strictly increasing
  std::vector<bool> is_missing; // seconds left out of the log
};

// Name of axis `i`: gx_dph gy_dph gz_dph g3_dph …, of an accelerometer (unit "mg") ax_mg ay_mg az_mg a3_mg …
std::string sim_axis_name(size_t i, const std::string& unit = "dph");

// Simulate over the given seconds.  t_s: end of each second, strictly increasing (a step of k s is a gap);
// temp_degc: true temperature, one per t_s.  models: one per axis, or one for all (n_axes says how many).
// Effects: those inside the axis's model first, then `effects` in order; an effect with `axis` or `log` set
// acts there only.  data_error: an unknown effect (the known names are listed) or a parameter it refuses.
SimulatedLog simulate(const std::vector<ErrorModel>& models, size_t n_axes, const std::vector<double>& t_s,
                      const std::vector<double>& temp_degc, const std::vector<EffectSpec>& effects,
                      const SimOptions& options);
// The same over a chamber profile at 1-s steps.
SimulatedLog simulate(const std::vector<ErrorModel>& models, size_t n_axes, const Profile& profile,
                      const std::vector<EffectSpec>& effects, const SimOptions& options);

// As a log (host/formats.md, Log), missing seconds left out, with the seed and run in its metadata.
Log to_log(const SimulatedLog& simulated, const SimOptions& options);

// Building blocks, used by the raw-sample generator too.
// White noise plus Markov processes of run.white_sigma_dph and run.markov, added to run.rate_dph.
// run_address: the random streams' run number.
void add_noise(SimRun* run, uint64_t seed, uint64_t run_address);
// Round to multiples of lsb; lsb <= 0 leaves as is.
double quantised(double value, double lsb);
// The run number that addresses the random streams of one log of one device.
uint64_t stream_run(const SimOptions& options);
// The seed of one device: draws that all its logs share come from it.
uint64_t device_seed(const SimOptions& options);

} // namespace imucal
