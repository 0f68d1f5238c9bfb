// SPDX-License-Identifier: MIT
#include "analysis/profile/covariance.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>

#include "base/error.h"
#include "base/units.h"
#include "io/notice.h"
#include "linear/linear.h"
#include "noise/covariance.h"
#include "noise/whiten.h"

namespace imucal {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

double CalibrationRun::duration_s() const {
  if (temp_degc.empty()) return 0;
  if (step_s.empty()) return dt_s * static_cast<double>(temp_degc.size());
  double sum = dt_s;
  for (size_t k = 1; k < step_s.size(); ++k) sum += step_s[k];
  return sum;
}

SampleTimes sample_times(const CalibrationRun& run) {
  SampleTimes times{run.temp_degc.size(), nullptr, run.dt_s};
  if (!run.step_s.empty()) times.step_s = run.step_s.data();
  return times;
}

std::vector<CalibrationRun> runs_of_profile(const Profile& profile, double dt_s, bool restart_each_cycle) {
  std::vector<CalibrationRun> runs;
  if (!restart_each_cycle || profile.repeat == 1) {
    runs.push_back({"run 1", profile.temperatures(dt_s), dt_s, {}});
    return runs;
  }
  // From the second cycle on the segments start where the first cycle ended.
  Profile cycle = profile;
  cycle.repeat = 1;
  for (int i = 0; i < profile.repeat; ++i) {
    runs.push_back({"run " + std::to_string(i + 1), cycle.temperatures(dt_s), dt_s, {}});
    const auto all = legs(cycle);
    if (!all.empty()) cycle.start_degc = all.back().end_degc;
  }
  return runs;
}

CalibrationRun run_of_log(const Log& log) {
  CalibrationRun run;
  run.name = log.path;
  run.dt_s = log.dt_s();
  double last_s = 0;
  bool even = true;
  for (size_t k = 0; k < log.size(); ++k) {
    if (!std::isfinite(log.temp_degc[k])) continue;
    const double step_s = run.temp_degc.empty() ? run.dt_s : log.t_s[k] - last_s;
    if (std::abs(step_s - run.dt_s) > 1e-9) even = false;
    run.step_s.push_back(step_s);
    run.temp_degc.push_back(log.temp_degc[k]);
    last_s = log.t_s[k];
  }
  if (run.temp_degc.empty())
    throw data_error(log.path + ": no temperature in column temp_degc; the calibration error needs temperatures");
  if (*std::min_element(run.temp_degc.begin(), run.temp_degc.end()) > kWarmerThanAnySensor_degc)
    notice(log.path + ": temperatures above " + shown(kWarmerThanAnySensor_degc) +
           " throughout: are they in kelvin? temp_degc is in degrees Celsius");
  if (even) run.step_s.clear();
  return run;
}

void check_noise(const ErrorModel& model, const std::string& whose) {
  if (model.arw_deg_rt_h > 0) return;
  for (const Markov& m : model.markov)
    if (m.sigma_dph > 0) return;
  throw data_error(whose + ": no noise at all, so that every calibration would be perfect; give arw_deg_rt_h > 0 "
                           "(1e-6 is enough) or a Markov term with sigma_dph > 0");
}

void check_setup(const CalibrationSetup& setup) {
  if (setup.order < 0 || setup.order > kMaxOrder)
    throw usage_error("--order " + std::to_string(setup.order) + ": must be 0 to " + std::to_string(kMaxOrder) +
                      " (the core's limit)");
  if (!(setup.hi_degc > setup.lo_degc)) {
    const std::string given = shown(setup.lo_degc) + ":" + shown(setup.hi_degc);
    throw usage_error(
        "range " + given +
        (setup.hi_degc < setup.lo_degc
             ? " is reversed; write " + shown(setup.hi_degc) + ":" + shown(setup.lo_degc)
             : " has no width; widen it, for example " + shown(setup.lo_degc) + ":" + shown(setup.hi_degc + 1)));
  }
  check_noise(setup.filter, "filter model");
  check_noise(setup.truth, "model");
}

void check_distinct_temperatures(const std::vector<CalibrationRun>& runs, int order) {
  std::set<long long> distinct; // in units of 1e-6 degC
  double lo = 1e300, hi = -1e300;
  size_t samples = 0;
  for (const CalibrationRun& run : runs) {
    for (double t : run.temp_degc) {
      if (static_cast<int>(distinct.size()) <= order) distinct.insert(std::llround(t * 1e6));
      lo = std::min(lo, t);
      hi = std::max(hi, t);
    }
    samples += run.temp_degc.size();
  }
  if (samples == 0) throw data_error("no samples: the profile lasts less than one second");
  const int found = static_cast<int>(distinct.size());
  if (found > order) return;
  throw data_error("order " + std::to_string(order) + " has " + std::to_string(order + 1) +
                   " coefficients and needs as many distinct temperatures, but there are only " +
                   std::to_string(found) +
                   (found == 1 ? " (" + shown(lo) + ")" : " between " + shown(lo) + " and " + shown(hi)) +
                   " degC; add soaks at " + std::to_string(order + 1 - found) +
                   " other temperature(s) or a ramp, or use --order " + std::to_string(found - 1));
}

void set_powers(const CalibrationRun& run, const CalibrationSetup& setup, MatrixXd* columns) {
  const auto n = static_cast<Index>(run.temp_degc.size());
  columns->col(0).setOnes();
  if (setup.order < 1) return;
  for (Index k = 0; k < n; ++k) (*columns)(k, 1) = setup.normalised(run.temp_degc[static_cast<size_t>(k)]);
  for (Index i = 2; i <= setup.order; ++i) columns->col(i) = columns->col(i - 1).cwiseProduct(columns->col(1));
}

// X' Vf^-1 X of one run.  A turn-on constant is the extra column 1 with prior information 1/sigma_on^2,
// eliminated.
static MatrixXd run_information(const CalibrationRun& run, const CalibrationSetup& setup) {
  const Index p = setup.order + 1;
  MatrixXd columns(static_cast<Index>(run.temp_degc.size()), p);
  set_powers(run, setup, &columns);
  MatrixXd m = WideColumns(columns).whitened_gram(compute_gains(sample_times(run), noise_of(setup.filter)));
  const double on = setup.turn_on_constants ? setup.filter.turn_on_sigma_dph : 0;
  if (on > 0) { // the column 1 is the column of b0
    const VectorXd cross = m.col(0);
    m -= cross * cross.transpose() / (m(0, 0) + 1 / (on * on));
  }
  return m;
}

// X' Vf^-1 X and U' Vt U of one run, U = Vf^-1 X; turn-on constants by Sherman-Morrison.
static void run_truth(const CalibrationRun& run, const CalibrationSetup& setup, MatrixXd* information,
                      MatrixXd* spread) {
  const Index p = setup.order + 1;
  const auto width = static_cast<size_t>(p);
  MatrixXd powers(static_cast<Index>(run.temp_degc.size()), p);
  set_powers(run, setup, &powers);
  const RowMajor x_map = powers;
  std::vector<double> u(x_map.data(), x_map.data() + x_map.size());
  const SampleTimes times = sample_times(run);
  solve_rows(compute_gains(times, noise_of(setup.filter)), width, u.data());
  const Index n = static_cast<Index>(run.temp_degc.size());
  Eigen::Map<RowMajor> u_map(u.data(), n, p);
  const double on = setup.turn_on_constants ? setup.filter.turn_on_sigma_dph : 0;
  if (on > 0) { // (V + s^2 1 1')^-1 X = U - w (w'X) / (1/s^2 + 1'w),  w = V^-1 1 = first column of U
    const VectorXd w = u_map.col(0);
    const Eigen::RowVectorXd cross = w.transpose() * x_map;
    u_map -= w * (cross / (1 / (on * on) + w.sum()));
  }
  *information += x_map.transpose() * u_map;
  const NoiseModel truth = noise_of(setup.truth);
  for (Index c = 0; c < p; ++c) spread->col(c) += u_map.transpose() * covariance_times(times, truth, u_map.col(c));
  const double true_on = setup.turn_on_constants ? setup.truth.turn_on_sigma_dph : 0;
  const Eigen::RowVectorXd sums = u_map.colwise().sum();
  *spread += true_on * true_on * sums.transpose() * sums;
}

static bool same_noise(const ErrorModel& a, const ErrorModel& b) {
  if (a.arw_deg_rt_h != b.arw_deg_rt_h || a.turn_on_sigma_dph != b.turn_on_sigma_dph ||
      a.markov.size() != b.markov.size())
    return false;
  for (size_t i = 0; i < a.markov.size(); ++i)
    if (a.markov[i].sigma_dph != b.markov[i].sigma_dph || a.markov[i].tau_s != b.markov[i].tau_s) return false;
  return true;
}

// What is judged at Tn: f(Tn), or f(Tn) less its mean over [-1, 1].
static VectorXd judged(double tn, const CalibrationSetup& setup) {
  VectorXd f(setup.order + 1);
  double power = 1;
  for (int i = 0; i <= setup.order; ++i, power *= tn)
    f(i) = power - (setup.shape_only && i % 2 == 0 ? 1.0 / (i + 1) : 0);
  return f;
}

static double sigma_at(double tn, const MatrixXd& cov, const CalibrationSetup& setup) {
  const VectorXd f = judged(tn, setup);
  return std::sqrt(std::max(0.0, f.dot(cov * f)));
}

static double worst_sigma(const MatrixXd& cov, const CalibrationSetup& setup) {
  double worst = 0;
  for (int i = 0; i <= 600; ++i) worst = std::max(worst, sigma_at(-1 + i / 300.0, cov, setup));
  return worst;
}

// Mean of f' C f over [-1, 1]: a polynomial of degree 2M <= 10, exact by 6-point Gauss-Legendre.
static double rms_sigma(const MatrixXd& cov, const CalibrationSetup& setup) {
  static const double node[3] = {0.2386191860831969, 0.6612093864662645, 0.9324695142031521};
  static const double weight[3] = {0.4679139345726910, 0.3607615730481386, 0.1713244923791704};
  double mean = 0;
  for (int i = 0; i < 3; ++i) {
    const double up = sigma_at(node[i], cov, setup), down = sigma_at(-node[i], cov, setup);
    mean += weight[i] / 2 * (up * up + down * down);
  }
  return std::sqrt(mean);
}

std::vector<double> information_matrix(const std::vector<CalibrationRun>& runs, const CalibrationSetup& setup) {
  const Index p = setup.order + 1;
  MatrixXd information = MatrixXd::Zero(p, p);
  for (const CalibrationRun& run : runs) information += run_information(run, setup);
  return {information.data(), information.data() + p * p};
}

CalibrationError calibration_error(const std::vector<CalibrationRun>& runs, const CalibrationSetup& setup) {
  check_setup(setup);
  check_distinct_temperatures(runs, setup.order);
  const Index p = setup.order + 1;
  const bool matched = same_noise(setup.filter, setup.truth);
  MatrixXd information = MatrixXd::Zero(p, p), spread = MatrixXd::Zero(p, p);
  CalibrationError result;
  for (const CalibrationRun& run : runs) {
    if (matched)
      information += run_information(run, setup);
    else
      run_truth(run, setup, &information, &spread);
    result.duration_s += run.duration_s();
  }
  const MatrixXd prior = MatrixXd::Identity(p, p) / (setup.prior_sigma_dph * setup.prior_sigma_dph);
  const MatrixXd believed = inverse_symmetric(information + prior);
  const MatrixXd actual = matched ? believed : MatrixXd(believed * (spread + prior) * believed);

  for (int i = 0; i < setup.points; ++i) {
    const double frac = setup.points > 1 ? static_cast<double>(i) / (setup.points - 1) : 0.5;
    result.temp_degc.push_back(setup.lo_degc + frac * (setup.hi_degc - setup.lo_degc));
    result.sigma_dph.push_back(sigma_at(2 * frac - 1, actual, setup));
    result.believed_sigma_dph.push_back(sigma_at(2 * frac - 1, believed, setup));
  }
  result.worst_dph = worst_sigma(actual, setup);
  result.rms_dph = rms_sigma(actual, setup);
  result.believed_worst_dph = matched ? result.worst_dph : worst_sigma(believed, setup);
  result.covariance.assign(actual.data(), actual.data() + p * p);
  result.believed_covariance.assign(believed.data(), believed.data() + p * p);
  return result;
}

} // namespace imucal
