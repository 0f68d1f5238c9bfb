// SPDX-License-Identifier: MIT
// Kalman gains of a noise model at the samples of one run.
//
// State-space form: one state per Gauss-Markov process (stationary start), one for a rate random walk (zero
// start); measurement = sum of the states + white noise.  Time without a sample is bridged by prediction alone.
// The gains depend on the noise model and on when there are samples, not on the data: they are computed once per
// run and then filter the rates and every regressor column alike (augmented filter of de Jong, Ann. Stat. 1991).
//
// Settling, the one rule of the host: on even steps of a stationary model the gains approach their steady values
// like pole^(2k), pole being the filter's slowest (steady_filter.h).  They are kept as soon as what is left of this
// series is below kSettledChange of every gain and of the innovation's standard deviation, or the change of one step below
// rounding: 4 eps.  So the gains kept differ from those that never settle by kSettledChange + 16 eps / (1 - pole^2) of
// themselves at most: a step of the recursion rounds about a dozen times, the change that is seen four times more.
// test_noise.cpp holds this.
#pragma once
#include <Eigen/Dense>
#include <vector>

#include "noise/noise_model.h"

namespace imucal {

constexpr double kSettledChange = 1e-12;
constexpr size_t kMostStates = 32;

// When the samples of one run were taken.  A view: the arrays belong to the caller and must outlive the call.
struct SampleTimes {
  size_t n = 0;
  const int* steps = nullptr;     // [n] ticks of dt_s since the sample before, >= 1; the first is not read;
                                  // nullptr: one tick each
  double dt_s = 1;                // one tick; a sample is the mean over it
  const double* tn = nullptr;     // [n] normalised temperature; read only where the model has slopes
  const double* step_s = nullptr; // [n] instead of steps where they are no whole ticks

  // Time from sample k - 1 to sample k.
  double seconds(size_t k) const { return step_s ? step_s[k] : (steps ? steps[k] * dt_s : dt_s); }
};

// Row r holds one set of gains.  Samples of a settled stretch share one row, others have a row each.
struct RunGains {
  struct Stretch {
    size_t begin = 0, end = 0; // samples
    size_t row = 0;            // of the first sample
    bool is_settled = false;   // all samples use that row
  };
  size_t n = 0, n_states = 0;
  std::vector<Stretch> stretches;
  std::vector<double> inv_sqrt_s; // [row] 1/sqrt(innovation variance)
  std::vector<double> gain;       // [row][state]
  std::vector<double> phi;        // [row][state]: transition to the next sample
  double sum_log_s = 0;           // over the samples: logarithms of the innovation variances

  size_t row_of(const Stretch& s, size_t sample) const { return s.is_settled ? s.row : s.row + sample - s.begin; }
};

// usage_error: more than kMostStates states.
// `extra_dph2`: additional white variance of every sample (expected hits), or nullptr; with it nothing settles.
RunGains compute_gains(const SampleTimes& times, const NoiseModel& noise, const Eigen::VectorXd* extra_dph2 = nullptr);

} // namespace imucal
