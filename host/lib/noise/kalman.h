// SPDX-License-Identifier: MIT
// Exact Kalman innovations of a noise model, run by run.  It knows steps in time, not logs or campaigns.
//
// State-space form: one state per Gauss-Markov process (stationary start), one for a rate random walk (zero
// start), measurement = sum of the states + white noise.  Seconds without a sample are bridged by prediction
// alone.  The gains depend on the noise model and on which seconds are there, not on the data: they are
// computed once per run and then whiten the rates and every regressor column alike (augmented filter of de
// Jong, Ann. Stat. 1991).
#pragma once
#include <Eigen/Dense>
#include <vector>

#include "noise/noise_model.h"

namespace imucal {

// Where the samples of one run stand.  A view: the arrays belong to the caller and must outlive the call.
struct SampleTimes {
  size_t n = 0;
  const int* steps = nullptr;  // [n] ticks of dt_s since the sample before, >= 1; the first is not read
  double dt_s = 1;             // one tick
  const double* tn = nullptr;  // [n] normalised temperature; read only where the model has slopes
};

// Gains of one run: per used sample.
struct RunGains {
  size_t n_states = 0;
  std::vector<double> inv_sqrt_s; // 1/sqrt(innovation variance)
  std::vector<double> gain;       // [sample][state]
  std::vector<double> phi;        // [sample][state]: from this sample to the next
  double sum_log_s = 0;
};

// `extra_dph2`: additional white variance of every used sample (expected hits), or nullptr.
RunGains compute_gains(const SampleTimes& times, const NoiseModel& noise,
                       const Eigen::VectorXd* extra_dph2 = nullptr);

// Whitens columns (one row per used sample) in place: innovation over its standard deviation.
void whiten(const RunGains& gains, Eigen::MatrixXd* columns);
void whiten(const RunGains& gains, double* column, size_t n);

// Columns of one run laid out for the filters: many noise models, the same columns.
class WideColumns {
public:
  explicit WideColumns(const Eigen::MatrixXd& columns); // one row per used sample
  // W'W of the whitened columns W.
  Eigen::MatrixXd whitened_gram(const RunGains& gains) const;

private:
  size_t n_, p_;
  std::vector<double> data_;
};

// The inverse: the sample path whose whitened innovations are `column`.
void colour(const RunGains& gains, double* column, size_t n);

// Log-likelihood of mixtures for a residual (rate minus its fitted mean): outliers by assumed-density
// filtering of the contaminated normal, telegraph noise by interacting multiple models with two modes (Blom
// and Bar-Shalom 1988). `scores`, when given, receives Phi^-1 of the predictive distribution function: N(0,1)
// and white when the model is true.  `hit` (outliers): the probability that the sample is a hit.
double mixture_log_likelihood(const SampleTimes& times, const NoiseModel& noise,
                              const Eigen::VectorXd& residual, Eigen::VectorXd* scores = nullptr,
                              Eigen::VectorXd* hit = nullptr);

} // namespace imucal
