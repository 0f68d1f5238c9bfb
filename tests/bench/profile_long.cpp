// SPDX-License-Identifier: MIT
// Long checks: truth covariance of the basic profile against Monte Carlo of whole tests, and the proven bound
// against the optimiser's best profiles over orders, rates and models.  Usage: profile_long [SEED].
#include <Eigen/Dense>
#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "analysis/profile/optimize.h"
#include "base/rng.h"
#include "noise/whiten.h"

using namespace imucal;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

static ErrorModel model_of(double arw_deg_rt_h, std::vector<Markov> markov) {
  ErrorModel m;
  m.arw_deg_rt_h = arw_deg_rt_h;
  m.markov = std::move(markov);
  return m;
}

static OptimizeRequest request_of(const ErrorModel& model, double duration_s, double rate, int order) {
  OptimizeRequest r;
  r.setup.order = order;
  r.setup.hi_degc = 60;
  r.setup.truth = r.setup.filter = model;
  r.limits = {0, 60, rate, rate, 0, 0};
  r.duration_s = duration_s;
  return r;
}

// Variance ratios at 13 temperatures; standard error sqrt(2/n).  Returns false beyond 4.5 standard errors
// (false alarm rate of 13 dependent ratios below 1e-4).
static bool monte_carlo(const ErrorModel& filter, const ErrorModel& truth, int n_runs, uint64_t seed) {
  OptimizeRequest r = request_of(truth, 8400, 0.6, 3);
  r.setup.filter = filter;
  r.setup.points = 13;
  const auto runs = runs_of_profile(paper_profile(r.limits, 8400));
  const CalibrationError predicted = calibration_error(runs, r.setup);
  const size_t n = runs[0].temp_degc.size(), p = 4;
  std::vector<double> u(n * p);
  MatrixXd x(static_cast<Index>(n), 4);
  for (size_t k = 0; k < n; ++k)
    for (size_t i = 0; i < p; ++i)
      u[k * p + i] = x(static_cast<Index>(k), static_cast<Index>(i)) =
          std::pow(r.setup.normalised(runs[0].temp_degc[k]), static_cast<double>(i));
  solve_rows(compute_gains(sample_times(runs[0]), noise_of(filter)), p, u.data());
  const Eigen::Map<const MatrixXd> ut(u.data(), 4, static_cast<Index>(n));
  const MatrixXd gain = (ut * x).ldlt().solve(ut);
  std::vector<double> sums(13, 0.0);
  VectorXd noise(static_cast<Index>(n));
  for (int run = 0; run < n_runs; ++run) {
    Rng white(seed, static_cast<uint64_t>(run), 0, Stream::kWhite),
        drive(seed, static_cast<uint64_t>(run), 0, Stream::kMarkov);
    std::vector<double> state;
    for (const Markov& m : truth.markov) state.push_back(m.sigma_dph * drive.normal());
    for (Index k = 0; k < noise.size(); ++k) {
      noise(k) = 60 * truth.arw_deg_rt_h * white.normal();
      for (size_t i = 0; i < state.size(); ++i) {
        noise(k) += state[i];
        state[i] = truth.markov[i].phi() * state[i] + std::sqrt(truth.markov[i].q_dph2()) * drive.normal();
      }
    }
    const VectorXd b = gain * noise;
    for (size_t i = 0; i < 13; ++i) {
      const double tn = r.setup.normalised(predicted.temp_degc[i]);
      const double e = b(0) + tn * (b(1) + tn * (b(2) + tn * b(3)));
      sums[i] += e * e;
    }
  }
  double furthest = 0;
  for (size_t i = 0; i < 13; ++i) {
    const double ratio = sums[i] / n_runs / (predicted.sigma_dph[i] * predicted.sigma_dph[i]);
    if (std::abs(ratio - 1) > std::abs(furthest)) furthest = ratio - 1;
  }
  const double error = std::sqrt(2.0 / n_runs);
  std::printf("  filter (%g, %g s)%s: furthest variance ratio %.4f = %+.1f standard errors\n",
              filter.markov[0].sigma_dph, filter.markov[0].tau_s, truth.markov.size() > 1 ? ", truth of two terms" : "",
              1 + furthest, furthest / error);
  std::fflush(stdout);
  return std::abs(furthest) < 4.5 * error;
}

int main(int argc, char** argv) {
  const uint64_t seed = argc > 1 ? std::strtoull(argv[1], nullptr, 10) : 1;
  bool good = true;
  const ErrorModel nominal = model_of(0.6, {{20, 100}});
  std::printf("truth covariance of the basic profile against 4000 simulated tests each (seed %llu):\n",
              (unsigned long long)seed);
  for (const Markov& m :
       {Markov{20, 100}, Markov{10, 30}, Markov{10, 250}, Markov{5, 100}, Markov{40, 100}, Markov{40, 250}})
    good &= monte_carlo(model_of(0.6, {m}), nominal, 4000, seed);
  good &= monte_carlo(nominal, model_of(1.1, {{14, 20}, {14, 70}}), 4000, seed);

  std::printf("best profile found over proven bound (must be above 1):\n  order  rate  duration_s  model  "
              "ratio  efficiency (slow-ramp)\n");
  const ErrorModel models[] = {nominal, model_of(1.1, {{14, 20}, {14, 70}}), model_of(0.1, {{10, 600}})};
  for (int order = 1; order <= 5; ++order)
    for (double rate : {0.6, 2.0, 6.0, 20.0})
      for (int i = 0; i < 3; ++i) {
        const double duration_s = 8400 + 2000 * order;
        OptimizeRequest r = request_of(models[i], duration_s, rate, order);
        r.seed = seed;
        const OptimizeResult best = optimize_profile(r);
        const double ratio =
            best.error.worst_dph / calibration_bound({models[i], order, duration_s, 60, rate}).proven_dph;
        std::printf("  %5d %5.1f %11.0f %6d  %.3f  %.3f\n", order, rate, duration_s, i, ratio,
                    slow_ramp_bound(models[i], order, duration_s) / best.error.worst_dph);
        std::fflush(stdout);
        good &= ratio > 1;
      }
  std::printf(good ? "all good\n" : "FAILED\n");
  return good ? 0 : 1;
}
