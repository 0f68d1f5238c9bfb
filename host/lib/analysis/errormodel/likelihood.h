// SPDX-License-Identifier: MIT
// Exact likelihood of white noise + Markov terms; the coefficients of the trend are integrated out.
//
// y_k = b' X_k + sum_i s_i(k) + v_k: the columns X are the thermal polynomial and the turn-on constant of the record
// (the basis that `detrend` names), their coefficients b are given a flat prior and integrated out (REML), not subtracted.
// One Kalman filter (noise/gains.h) whitens y and every column alike (de Jong 1991).  With innovations e_y, E of unit variance,
//   -2 ln L = sum ln S_k + e_y'e_y - e_y'E (E'E)^-1 E'e_y + ln |E'E| + (n - p) ln 2 pi,
// summed over records, which share the noise parameters but nothing else.  The overall scale is maximised in closed form.
#pragma once
#include <string>
#include <vector>

#include "analysis/dp/series.h"
#include "io/model.h"
#include "noise/whiten.h"

namespace imucal {

class Likelihood {
public:
  // Rates need no detrending (do not remove what is to be marginalised).  data_error as detrend_basis.
  Likelihood(const std::vector<Series>& series, const Detrend& detrend);

  // -2 ln L of a model (its white noise must be > 0).
  double deviance(const ErrorModel& model) const;

  // With variances relative to the white one: -2 ln L at the best scale, and that white variance.
  struct Profile {
    double deviance = 0, white_variance = 0;
  };
  Profile profile(const std::vector<double>& relative_variance, const std::vector<double>& tau_s) const;

  long dof() const { return dof_; } // samples present less columns
  double dt_s() const { return dt_s_; }
  double longest_s() const { return longest_s_; }

private:
  struct Record {
    WideColumns columns;    // y, then what is marginalised, of the samples present
    std::vector<int> steps; // noise/gains.h
  };
  struct Sums {
    double log_s = 0, rss = 0, log_det = 0;
  };
  Sums sums(const Record& record, const NoiseModel& noise) const;
  Sums total(const std::vector<double>& relative_variance, const std::vector<double>& tau_s) const;

  std::vector<Record> records_;
  long dof_ = 0;
  double dt_s_ = 1, longest_s_ = 0;
};

struct MlParameter {
  std::string name; // arw_deg_rt_h, markov[0].sigma_dph, markov[0].tau_s …
  double value = 0;
  double log_std_error = 0; // of ln value; infinite where the likelihood does not bound it
  double ci95_lo = 0, ci95_hi = 0;
};

struct MlFit {
  ErrorModel model;
  double log_likelihood = 0, bic = 0;
  std::vector<MlParameter> parameters;
  std::vector<double> bic_by_terms, log_likelihood_by_terms; // index: number of Markov terms tried
  int evaluations = 0;
};

// Maximum over ln variances and ln time constants from a coarse grid and several starts (BOBYQA), standard errors from
// the observed information.  n_markov < 0: chosen by BIC among 0 … 3.
// Time constants are sought between two samples and the longest record.
MlFit fit_maximum_likelihood(const Likelihood& likelihood, int n_markov);

} // namespace imucal
