// SPDX-License-Identifier: MIT
#include "analysis/errormodel/likelihood.h"

#include <nlopt.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "base/error.h"
#include "base/units.h"
#include "base/x87.h"
#include "linear/linear.h"
#include "noise/gains.h"

namespace imucal {

// The rates that are there and the columns to marginalise, one row each; a constant near the data is taken off where
// it is marginalised anyway: digits.  data_error: a constant rate, hardly more rates than columns.
static Eigen::MatrixXd present_rows(const Series& s, const std::vector<std::vector<double>>& basis,
                                    std::vector<int>* steps) {
  const long present = s.size() - s.n_missing, p = static_cast<long>(basis.size());
  if (present - p < 10)
    throw data_error(s.log + ": axis " + s.axis + ": " + std::to_string(present - p) + " samples beyond the " +
                     std::to_string(p) + " coefficients marginalised; at least 10 are needed");
  Eigen::MatrixXd rows(present, p + 1);
  long row = 0;
  int step = 1;
  for (size_t k = 0; k < s.rate_dph.size(); ++k, ++step) {
    if (std::isnan(s.rate_dph[k])) continue;
    rows(row, 0) = s.rate_dph[k];
    for (long c = 0; c < p; ++c) rows(row, c + 1) = basis[static_cast<size_t>(c)][k];
    steps->push_back(step);
    step = 0;
    ++row;
  }
  const double centre = basis.empty() ? 0 : rows.col(0).mean();
  rows.col(0).array() -= centre;
  if (rows.col(0).cwiseAbs().maxCoeff() <= 1e-12 * (1 + std::fabs(centre)))
    throw data_error(s.log + ": axis " + s.axis + " is constant: nothing to fit (is the sensor alive?)");
  return rows;
}

Likelihood::Likelihood(const std::vector<Series>& series, const Detrend& detrend) {
  for (const Series& s : series) {
    dt_s_ = s.dt_s;
    longest_s_ = std::max(longest_s_, static_cast<double>(s.size()) * s.dt_s);
    std::vector<int> steps;
    const Eigen::MatrixXd rows = present_rows(s, detrend_basis(s, detrend), &steps);
    dof_ += rows.rows() - (rows.cols() - 1);
    records_.push_back({WideColumns(rows), std::move(steps)});
  }
}

Likelihood::Sums Likelihood::sums(const Record& record, const NoiseModel& noise) const {
  const RunGains gains = compute_gains({record.steps.size(), record.steps.data(), dt_s_}, noise);
  const Eigen::MatrixXd gram = record.columns.whitened_gram(gains);
  Sums out{gains.sum_log_s, gram(0, 0), 0};
  if (const long m = gram.rows() - 1; m > 0) {
    const Eigen::VectorXd cross = gram.col(0).tail(m);
    out.rss -= cross.dot(solve_symmetric(gram.bottomRightCorner(m, m), cross, &out.log_det));
  }
  return out;
}

Likelihood::Sums Likelihood::total(const std::vector<double>& variance, const std::vector<double>& tau_s) const {
  NoiseModel noise;
  noise.white_sigma_dph = std::sqrt(dt_s_); // variance 1 of a sample
  for (size_t i = 0; i < variance.size(); ++i) noise.markov.push_back({std::sqrt(variance[i]), tau_s[i]});
  Sums out;
  for (const Record& r : records_) {
    const Sums s = sums(r, noise);
    out.log_s += s.log_s, out.rss += s.rss, out.log_det += s.log_det;
  }
  return out;
}

Likelihood::Profile Likelihood::profile(const std::vector<double>& variance, const std::vector<double>& tau_s) const {
  const Sums s = total(variance, tau_s);
  const auto n = static_cast<double>(dof_);
  const double scale = s.rss / n;
  return {s.log_s + s.log_det + n * (std::log(2 * kPi * scale) + 1), scale};
}

double Likelihood::deviance(const ErrorModel& model) const {
  const double white = std::pow(white_sigma_dph(model.arw_deg_rt_h, dt_s_), 2);
  if (!(white > 0)) throw usage_error("the likelihood needs white noise: arw_deg_rt_h > 0");
  std::vector<double> variance, tau_s;
  for (const Markov& m : model.markov) variance.push_back(m.sigma_dph * m.sigma_dph / white), tau_s.push_back(m.tau_s);
  const Sums s = total(variance, tau_s);
  return s.log_s + s.log_det + s.rss / white + static_cast<double>(dof_) * std::log(2 * kPi * white);
}

namespace {

// Parameters of the search: per term ln g and ln tau, g = variance relative to white * 2 tau/dt: its density at low
// frequencies over that of the white noise, which the data determine best.
class MlSearch {
public:
  explicit MlSearch(const Likelihood& likelihood)
      : likelihood_(likelihood), lo_tau_(std::log(1.5 * likelihood.dt_s())), hi_tau_(std::log(likelihood.longest_s())) {
  }

  Likelihood::Profile at(const std::vector<double>& x) const {
    std::vector<double> variance, tau_s;
    for (size_t k = 0; k + 1 < x.size(); k += 2) {
      tau_s.push_back(std::exp(x[k + 1]));
      variance.push_back(std::exp(x[k]) / (2 * tau_s.back() / likelihood_.dt_s()));
    }
    ++evaluations;
    return likelihood_.profile(variance, tau_s);
  }

  double refine(std::vector<double>* x) const {
    std::vector<double> lo, hi;
    for (size_t k = 0; k < x->size(); k += 2) {
      lo.insert(lo.end(), {kLeastLogDensity, lo_tau_});
      hi.insert(hi.end(), {kMostLogDensity, hi_tau_});
    }
    for (size_t i = 0; i < x->size(); ++i) (*x)[i] = std::clamp((*x)[i], lo[i], hi[i]);
    nlopt_opt opt = nlopt_create(NLOPT_LN_BOBYQA, static_cast<unsigned>(x->size()));
    nlopt_set_min_objective(
        opt,
        [](unsigned n, const double* point, double*, void* self) {
          return static_cast<const MlSearch*>(self)->at(std::vector<double>(point, point + n)).deviance;
        },
        const_cast<MlSearch*>(this));
    nlopt_set_lower_bounds(opt, lo.data());
    nlopt_set_upper_bounds(opt, hi.data());
    nlopt_set_initial_step1(opt, 0.3);
    nlopt_set_xtol_abs1(opt, 1e-4);
    nlopt_set_ftol_abs(opt, 1e-5);
    nlopt_set_maxeval(opt, static_cast<int>(80 * x->size()));
    double value = std::numeric_limits<double>::infinity();
    const RoundsToDouble rounding;
    if (nlopt_optimize(opt, x->data(), &value) < 0 && !std::isfinite(value)) value = at(*x).deviance;
    nlopt_destroy(opt);
    return value;
  }

  // Adds a term to those of `base`: a coarse grid, then the best `n_starts` refined.
  double add_term(const std::vector<double>& base, size_t n_starts, std::vector<double>* best) const {
    struct Start {
      double deviance;
      std::vector<double> x;
    };
    std::vector<Start> starts;
    const int n_tau = base.empty() ? 7 : 8;
    for (int i = 0; i < n_tau; ++i)
      for (double log_g : base.empty() ? std::vector<double>{-1, 1, 3, 6} : std::vector<double>{-1, 2, 5}) {
        std::vector<double> x = base;
        x.push_back(log_g);
        x.push_back(lo_tau_ + 0.5 + (hi_tau_ - 1.2 - lo_tau_) * i / (n_tau - 1));
        starts.push_back({at(x).deviance, x});
      }
    std::sort(starts.begin(), starts.end(), [](const Start& a, const Start& b) { return a.deviance < b.deviance; });
    double least = std::numeric_limits<double>::infinity();
    std::vector<std::vector<double>> used;
    for (Start& s : starts) {
      if (used.size() == n_starts) break;
      // Starts of different time constants only.
      const bool near =
          std::any_of(used.begin(), used.end(), [&](const auto& u) { return std::fabs(u.back() - s.x.back()) < 0.9; });
      if (near) continue;
      // A start so much worse than what was reached already is not refined.
      if (s.deviance > least + 0.01 * static_cast<double>(likelihood_.dof())) break;
      used.push_back(s.x);
      const double value = refine(&s.x);
      if (value < least) least = value, *best = s.x;
    }
    return least;
  }

  static constexpr double kLeastLogDensity = -12, kMostLogDensity = 25;
  mutable int evaluations = 0;

private:
  const Likelihood& likelihood_;
  double lo_tau_, hi_tau_;
};

// r, then sigma and tau of each term, without their errors.
std::vector<MlParameter> parameters_of(const ErrorModel& model) {
  std::vector<MlParameter> out = {{"arw_deg_rt_h", model.arw_deg_rt_h, 0, 0, 0}};
  for (size_t k = 0; k < model.markov.size(); ++k) {
    const std::string head = "markov[" + std::to_string(k) + "].";
    out.push_back({head + "sigma_dph", model.markov[k].sigma_dph, 0, 0, 0});
    out.push_back({head + "tau_s", model.markov[k].tau_s, 0, 0, 0});
  }
  return out;
}

// Half the second derivatives of the deviance in the logarithms of the parameters, by differences about the maximum.
class ObservedInformation {
public:
  ObservedInformation(const Likelihood& likelihood, const std::vector<MlParameter>& parameters, int* evaluations)
      : likelihood_(likelihood), evaluations_(evaluations), centre_(static_cast<long>(parameters.size())) {
    for (long i = 0; i < centre_.size(); ++i) centre_[i] = std::log(parameters[static_cast<size_t>(i)].value);
    f0_ = deviance(centre_);
    step_ = Eigen::VectorXd::Constant(centre_.size(), 0.01);
    plus_ = minus_ = Eigen::VectorXd(centre_.size());
    for (long i = 0; i < centre_.size(); ++i) choose_step(i);
  }

  Eigen::MatrixXd matrix() const {
    const long n = centre_.size();
    Eigen::MatrixXd information(n, n);
    for (long i = 0; i < n; ++i) {
      information(i, i) = 0.5 * bend(i) / (step_[i] * step_[i]);
      for (long j = 0; j < i; ++j) information(i, j) = information(j, i) = 0.5 * mixed(i, j);
    }
    return information;
  }

private:
  double deviance(const Eigen::VectorXd& log_value) const {
    ErrorModel m;
    m.arw_deg_rt_h = std::exp(log_value[0]);
    for (long i = 1; i + 1 < log_value.size(); i += 2)
      m.markov.push_back({std::exp(log_value[i]), std::exp(log_value[i + 1])});
    ++*evaluations_;
    return likelihood_.deviance(m);
  }

  // A step that changes the deviance by about 0.1: far from rounding, near enough to be quadratic.
  void choose_step(long i) {
    for (int attempt = 0; attempt < 3; ++attempt) {
      Eigen::VectorXd at = centre_;
      at[i] += step_[i];
      plus_[i] = deviance(at);
      at[i] -= 2 * step_[i];
      minus_[i] = deviance(at);
      if (bend(i) > 0.02 && bend(i) < 1) break;
      step_[i] = std::clamp(step_[i] * (bend(i) > 1e-9 ? std::sqrt(0.2 / bend(i)) : 10.0), 1e-5, 0.3);
    }
  }

  double bend(long i) const { return plus_[i] + minus_[i] - 2 * f0_; }

  double mixed(long i, long j) const {
    Eigen::VectorXd at = centre_;
    at[i] += step_[i], at[j] += step_[j];
    const double both = deviance(at);
    at[i] -= 2 * step_[i], at[j] -= 2 * step_[j];
    const double neither = deviance(at);
    return (both + neither - plus_[i] - minus_[i] - plus_[j] - minus_[j] + 2 * f0_) / (2 * step_[i] * step_[j]);
  }

  const Likelihood& likelihood_;
  int* evaluations_;
  Eigen::VectorXd centre_, step_, plus_, minus_; // logarithms; deviance one step up and down in one of them
  double f0_ = 0;
};

void set_error(double log_std_error, MlParameter* p) {
  p->log_std_error = log_std_error;
  p->ci95_lo = p->value * std::exp(-1.959964 * log_std_error);
  p->ci95_hi = p->value * std::exp(1.959964 * log_std_error);
}

std::vector<MlParameter> parameters_with_errors(const Likelihood& likelihood, const ErrorModel& model,
                                                int* evaluations) {
  std::vector<MlParameter> out = parameters_of(model);
  const auto [values, vectors] = symmetric_spectrum(ObservedInformation(likelihood, out, evaluations).matrix());
  const bool sound = values.minCoeff() > 1e-6 * std::max(1.0, values.maxCoeff() * 1e-6);
  for (long i = 0; i < values.size(); ++i) {
    double variance = 0;
    for (long j = 0; j < values.size(); ++j) variance += std::pow(vectors(i, j), 2) / std::max(values[j], 1e-8);
    const double error = std::sqrt(variance);
    set_error(!sound && error > 10 ? std::numeric_limits<double>::infinity() : error, &out[static_cast<size_t>(i)]);
  }
  return out;
}

ErrorModel model_at(const MlSearch& search, const std::vector<double>& x, double dt_s) {
  ErrorModel m;
  const double white = search.at(x).white_variance;
  m.arw_deg_rt_h = arw_from_white_sigma(std::sqrt(white * dt_s));
  for (size_t k = 0; k + 1 < x.size(); k += 2) {
    const double tau_s = std::exp(x[k + 1]);
    m.markov.push_back({std::sqrt(white * std::exp(x[k]) * dt_s / (2 * tau_s)), tau_s});
  }
  std::sort(m.markov.begin(), m.markov.end(), [](const Markov& a, const Markov& b) { return a.tau_s < b.tau_s; });
  return m;
}

} // namespace

MlFit fit_maximum_likelihood(const Likelihood& likelihood, int n_markov) {
  const MlSearch search(likelihood);
  MlFit best;
  std::vector<double> x, winner;
  double best_bic = std::numeric_limits<double>::infinity();
  const int most = n_markov < 0 ? 3 : n_markov;
  for (int n = 0; n <= most; ++n) {
    double deviance;
    if (n == 0) {
      deviance = search.at(x).deviance;
    } else {
      std::vector<double> next;
      deviance = search.add_term(x, n == 1 ? 2 : 3, &next);
      x = next;
    }
    best.log_likelihood_by_terms.push_back(-0.5 * deviance);
    best.bic_by_terms.push_back(deviance + (1 + 2 * n) * std::log(static_cast<double>(likelihood.dof())));
    const bool chosen = n_markov >= 0 ? n == n_markov : best.bic_by_terms.back() < best_bic;
    if (!chosen && n_markov < 0 && n > 1) break;
    if (!chosen) continue;
    best_bic = best.bic_by_terms.back();
    best.log_likelihood = -0.5 * deviance;
    best.bic = best_bic;
    winner = x;
  }
  best.model = model_at(search, winner, likelihood.dt_s());
  best.evaluations = search.evaluations;
  best.parameters = parameters_with_errors(likelihood, best.model, &best.evaluations);
  return best;
}

} // namespace imucal
