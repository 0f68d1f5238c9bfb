// SPDX-License-Identifier: MIT
// Kalman gains of a noise model at the samples of one run.
//
// State-space form: one state per Gauss-Markov process (stationary start), one for a rate random walk (zero
// start); measurement = sum of the states + white noise.  Time without a sample is bridged by prediction alone.
// The gains depend on the noise model and on when there are samples, not on the data: they are computed once per
// run and then filter the rates and every regressor column alike (augmented filter of de Jong, Ann. Stat. 1991).
//
// Settling.  On equal steps of a stationary model the gains approach their steady values like pole^(2k), where pole is
// the filter's slowest (steady_filter.h).  From some sample on they are kept.  That is when all changes still to come are
// together below kSettledChange of every gain and of the innovation's standard deviation, or when one step changes them by
// less than rounding does (4 eps).  The gains kept then differ from those that never settle by at most
// kSettledChange + 16 eps / (1 - pole^2) of themselves: one step rounds about a dozen times, and four more times to see
// the change.  Everything on the host that settles uses this rule; test_noise.cpp holds it.
#pragma once
#include <Eigen/Core>
#include <vector>

#include "noise/noise_model.h"

namespace imucal {

constexpr double kSettledChange = 1e-12;
constexpr size_t kMostStates = 32;

// When the samples of one run were taken, and what white noise they alone have.  A view: the arrays belong to the caller and must
// outlive the call.
struct SampleTimes {
  size_t n = 0;
  const int* steps = nullptr;     // [n] ticks of dt_s since the sample before, >= 1; the first is not read;
                                  // nullptr: one tick each
  double dt_s = 1;                // one tick; a sample is the mean over it
  const double* tn = nullptr;     // [n] normalised temperature; read only where the model has slopes
  const double* step_s = nullptr; // [n] instead of steps where they are no whole ticks
  double own_white_dph2 = 0;      // white variance of every sample beside that of the model: rounding of this run

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

// The gains of the first n samples alone (n <= gains.n): what compute_gains makes of their times.  Where a gap follows them, the
// last may differ as far as settling lets it (kSettledChange).
RunGains first_samples(const RunGains& gains, size_t n);

} // namespace imucal
