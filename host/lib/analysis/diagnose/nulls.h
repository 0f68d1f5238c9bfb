// SPDX-License-Identifier: MIT
// Null calibration: what every candidate and every test scores when the nominal model is true, found by
// simulating the nominal model on the very profiles (and gaps) of the logs.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "analysis/diagnose/panel.h"

namespace imucal {

struct CalibrationOptions {
  size_t nulls = 500;
  uint64_t seed = 1;
  int threads = 1;
  std::string cache_folder; // empty: no cache
  bool quiet = true;
};

// Gains of every null, per candidate and test, and the spectrum of the innovations.
struct Calibration {
  size_t nulls = 0;
  bool from_cache = false;
  std::string key;                                 // hash of profiles, gaps, model, library and version
  std::vector<std::vector<double>> named, generic; // [candidate][null]
  SpectrumNull spectrum;
};

// `known`: a calibration at hand; taken when it has the same key (the axes of a log share their profiles).
Calibration calibrate(const Campaign& campaign, const Hypothesis& nominal,
                      const std::vector<const Effect*>& library, const CalibrationOptions& options,
                      const Calibration* known = nullptr);

// $XDG_CACHE_HOME/imucal or ~/.cache/imucal; empty when neither is known.
std::string default_cache_folder();

// Thresholds for a false-alarm rate of the whole family (candidates, tests, axes).
struct Thresholds {
  std::vector<double> named, generic;
  // Probability that the strongest of all candidates and tests exceeds its threshold by `evidence` under the
  // null.
  double p_value(double evidence) const;
  double level = 0;      // common offset in units of each candidate's scale
  double alpha_axis = 0; // rate per axis
};
Thresholds thresholds(const Calibration& calibration, const std::vector<bool>& active,
                      double false_alarm_rate, size_t n_axes);

} // namespace imucal
