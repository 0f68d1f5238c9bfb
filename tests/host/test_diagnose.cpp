// SPDX-License-Identifier: MIT
// The engine of diagnose against dense linear algebra and against what it was told.
#include "analysis/diagnose/evidence/fourier.h"
#include "analysis/diagnose/evidence/lines.h"
#include "analysis/diagnose/evidence/maximise.h"
#include "analysis/diagnose/evidence/minutes.h"
#include "analysis/diagnose/evidence/reduction.h"
#include "analysis/diagnose/evidence/shared.h"
#include "analysis/diagnose/judge/contribution.h"
#include "analysis/diagnose/logs/smoothing.h"
#include "analysis/diagnose/logs/structure.h"
#include "analysis/diagnose/logs/thermometer.h"
#include "analysis/diagnose/search/null_draws.h"
#include "analysis/diagnose/stages/mean_lines.h"
#include "analysis/diagnose/stages/seconds_noise.h"
#include "analysis/diagnose/written_model.h"
#include "dense.h"
#include "diagnose_logs.h"

// Covariance of the used samples of a run, written out.
static MatrixXd dense_covariance(const CampaignRun& run, const NoiseModel& noise) {
  const long n = static_cast<long>(run.n());
  MatrixXd c(n, n);
  for (long i = 0; i < n; ++i)
    for (long j = 0; j < n; ++j) {
      const double ti = static_cast<double>(run.input.tick[static_cast<size_t>(run.used[static_cast<size_t>(i)])]);
      const double tj = static_cast<double>(run.input.tick[static_cast<size_t>(run.used[static_cast<size_t>(j)])]);
      const double t0 = static_cast<double>(run.input.tick[static_cast<size_t>(run.used[0])]);
      c(i, j) = i == j ? noise.white_sigma_dph * noise.white_sigma_dph : 0;
      for (const Markov& m : noise.markov)
        c(i, j) += m.sigma_dph * m.sigma_dph * std::exp(-std::fabs(ti - tj) / m.tau_s);
      c(i, j) += noise.walk_dph_per_rt_s * noise.walk_dph_per_rt_s * (std::min(ti, tj) - t0);
    }
  return c;
}

// A row smooths over its neighbours in time: on a steady ramp, missing minutes make no slopes that were not there.
static void test_slopes_beside_missing_rows_are_those_of_the_temperature(void**) {
  for (const double noise_degc : {0.0, 0.02}) {
    Log log = simulated_log(9, 4000, true, 0);
    Rng rng(9, 0, 0, Stream::kWhite);
    for (double& temp : log.temp_degc) temp += noise_degc * rng.normal();
    const Campaign campaign = make_campaign({log}, "gx_dph", nominal_model());
    const RunInput& in = campaign.runs[0].input;
    for (size_t i = 0; i < in.size(); ++i) {
      const double t = in.t_s[i], half = 2000;
      if (std::fabs(t - half) < 150) continue; // the corner is rounded
      assert_near(in.smooth_degc[i], 60 * (t < half ? t / half : 2 - t / half), 0.01 + noise_degc);
      assert_near(in.rate_degc_min[i], t < half ? 1.8 : -1.8, 0.01 + 4 * noise_degc);
    }
  }
}

// The smoother against the dense normal equations, with holes.
static void test_whittaker_solves_its_normal_equations(void**) {
  for (const size_t n : {3u, 4u, 5u, 40u}) {
    Rng rng(4, n, 0, Stream::kTool);
    std::vector<double> y(n);
    for (double& v : y) v = rng.normal();
    MatrixXd a = MatrixXd::Zero(static_cast<long>(n), static_cast<long>(n));
    VectorXd b = VectorXd::Zero(static_cast<long>(n));
    const double tau = 2.5;
    for (long t = 0; t + 2 < static_cast<long>(n); ++t) {
      VectorXd bend = VectorXd::Zero(static_cast<long>(n));
      bend[t] = 1, bend[t + 1] = -2, bend[t + 2] = 1;
      a += std::pow(tau, 4) * bend * bend.transpose();
    }
    if (n == 40) y[0] = y[7] = y[8] = y[20] = std::nan("");
    for (long t = 0; t < static_cast<long>(n); ++t)
      if (std::isfinite(y[static_cast<size_t>(t)])) a(t, t) += 1, b[t] = y[static_cast<size_t>(t)];
    const VectorXd expected = dense_solve(a, b);
    const std::vector<double> z = whittaker(y, tau);
    for (long t = 0; t < static_cast<long>(n); ++t) assert_near(z[static_cast<size_t>(t)], expected[t], 1e-9);
  }
}

// Root mean square by which the smoothed temperature of a log misses that of its device, away from the ends.
static double miss_degc(const std::vector<double>& device, double noise_degc, double step_degc, uint64_t seed) {
  Log log = simulated_log(9, device.size(), false, 0);
  Rng rng(seed, 0, 0, Stream::kTool);
  for (size_t i = 0; i < device.size(); ++i) {
    const double seen = device[i] + noise_degc * rng.normal();
    log.temp_degc[i] = step_degc > 0 ? step_degc * std::round(seen / step_degc) : seen;
  }
  const Campaign campaign = make_campaign({log}, "gx_dph", nominal_model());
  double squares = 0;
  for (size_t i = 0; i < device.size(); ++i) squares += std::pow(campaign.runs[0].input.smooth_degc[i] - device[i], 2);
  return std::sqrt(squares / static_cast<double>(device.size()));
}

// The cycle of a chamber, 0.05 degC in 82 s, and the corners of ramps stand in the smoothed temperature of a thermometer
// with 0.03 degC of noise; where neither is, it is as quiet as before.
static void test_a_chamber_s_cycle_and_corners_stay_in_the_smoothed_temperature(void**) {
  std::vector<double> cycle, corners, ramp;
  for (size_t i = 0; i < 6000; ++i) {
    const double t = static_cast<double>(i);
    ramp.push_back(0.01 * t);
    cycle.push_back(0.01 * t + 0.05 * std::sin(2 * kPi * t / 82));
    corners.push_back(30 + 10 * std::asin(std::sin(2 * kPi * t / 2400)));
  }
  for (uint64_t seed = 1; seed < 4; ++seed) {
    assert_true(miss_degc(cycle, 0.03, 0.0625, seed) < 0.012);
    assert_true(miss_degc(corners, 0.03, 0, seed) < 0.012);
    assert_true(miss_degc(ramp, 0.03, 0, seed) < 0.006);
  }
}

// A thermometer is coarse by how long one of its steps lasts in a log, not by how many logs there are.
static void test_a_thermometer_is_as_coarse_in_one_log_as_in_six(void**) {
  for (const double step_degc : {0.44, 0.15}) {
    Log log = simulated_log(9, 4000, true, 0); // 0 to 60 degC and back
    for (double& temp : log.temp_degc) temp = step_degc * std::round(temp / step_degc);
    const double one = make_campaign({log}, "gx_dph", nominal_model()).temp_lsb_degc;
    const double six = make_campaign({log, log, log, log, log, log}, "gx_dph", nominal_model()).temp_lsb_degc;
    assert_near(one, step_degc > 0.2 ? step_degc : 0, 1e-9);
    assert_near(six, one, 1e-9);
  }
}

// Across hours without a row nothing is known: each stretch is smoothed alone.
static void test_slopes_do_not_reach_across_a_long_gap(void**) {
  Log log = simulated_log(9, 4000, false, 0);
  for (size_t k = 1000; k < log.t_s.size(); ++k) log.t_s[k] += 7200;
  const Campaign campaign = make_campaign({log}, "gx_dph", nominal_model());
  const RunInput& in = campaign.runs[0].input;
  for (size_t i = 900; i < 1100; ++i) assert_near(in.rate_degc_min[i], 1.8, 1e-6);
}

// The temperature of a log up a ramp, through a soak of ten minutes and on, in steps of its thermometer.
static std::vector<double> ramp_soak_ramp(double step_degc, double noise_degc, double after_degc_per_s) {
  std::vector<double> degc;
  Rng rng(11, 0, 0, Stream::kTool);
  double at = 10;
  for (size_t k = 0; k < 3000; ++k) {
    at += k < 1200 ? 0.02 : k < 1800 ? 0 : k < 1900 ? after_degc_per_s : 0.02;
    const double seen = at + noise_degc * rng.normal();
    degc.push_back(step_degc > 0 ? step_degc * std::round(seen / step_degc) : seen);
  }
  return degc;
}

static std::vector<double> every_second(size_t n) {
  std::vector<double> t_s;
  for (size_t k = 0; k < n; ++k) t_s.push_back(static_cast<double>(k + 1));
  return t_s;
}

static void stick(std::vector<double>* degc, size_t first, size_t end) {
  for (size_t k = first; k < end; ++k) (*degc)[k] = (*degc)[first];
}

static void test_a_stuck_thermometer_is_found_with_its_seconds(void**) {
  for (const double step_degc : {0.0, 0.001, 0.0625, 0.1}) {
    std::vector<double> degc = ramp_soak_ramp(step_degc, 0.01, 0.02);
    stick(&degc, 300, 400);
    stick(&degc, 2000, 2300);
    const std::vector<Hold> holds = stuck_thermometer(every_second(degc.size()), 1, degc);
    assert_int_equal(holds.size(), 2);
    // A coarse thermometer may have shown this reading some seconds before it was stuck.
    assert_in_range(holds[0].first, 290, 300);
    assert_int_equal(holds[0].end, 400);
    assert_in_range(holds[1].first, 1990, 2000);
    assert_int_equal(holds[1].end, 2300);
  }
}

// Ten minutes with one reading: a soak that ends slowly, fast, with a wrong second or in missing rows.
static void test_a_soak_is_no_stuck_thermometer(void**) {
  for (const double step_degc : {0.001, 0.0625, 0.1, 0.5})
    for (const double after_degc_per_s : {0.005, 0.02, 0.15, 2.5}) {
      std::vector<double> degc = ramp_soak_ramp(step_degc, 0, after_degc_per_s);
      std::vector<double> t_s = every_second(degc.size());
      assert_true(stuck_thermometer(t_s, 1, degc).empty());
      degc[1500] += 5;
      assert_true(stuck_thermometer(t_s, 1, degc).empty());
      stick(&degc, 300, 400);
      for (size_t k = 400; k < t_s.size(); ++k) t_s[k] += 60;
      assert_true(stuck_thermometer(t_s, 1, degc).empty());
    }
}

static void test_thermometers_that_mostly_rest_are_not_stuck(void**) {
  const std::vector<double> t_s = every_second(3000);
  std::vector<double> degc = ramp_soak_ramp(0, 0.01, 0.02);
  stick(&degc, 100, 1700); // more than half of the log
  assert_true(stuck_thermometer(t_s, 1, degc).empty());
  degc = ramp_soak_ramp(0, 0.01, 0.15); // read once in 90 s, also while the temperature runs
  for (size_t k = 0; k < degc.size(); ++k) degc[k] = degc[k - k % 90];
  assert_true(stuck_thermometer(t_s, 1, degc).empty());
  assert_true(stuck_thermometer(t_s, 1, std::vector<double>(3000, 20.0)).empty());
  assert_true(stuck_thermometer(t_s, 1, std::vector<double>(3000, std::nan(""))).empty());
  assert_true(stuck_thermometer({}, 1, {}).empty());
}

template <typename T> static void erase_rows(std::vector<T>* column, size_t first, size_t end) {
  column->erase(column->begin() + static_cast<long>(first), column->begin() + static_cast<long>(end));
}

// Flags and auxiliary columns included, a log with a stuck thermometer is one without these seconds.
static void test_seconds_of_a_stuck_thermometer_are_as_if_missing(void**) {
  Log log = simulated_log(9, 3000, false, 0);
  Rng rng(12, 0, 0, Stream::kTool);
  for (double& degc : log.temp_degc) degc += 0.01 * rng.normal();
  for (size_t k = 0; k < log.size(); ++k) {
    log.axes[0].flags.push_back(k % 50 == 7 ? kSaturated : 0);
    log.auxiliary["supply_v"].push_back(5 + 0.001 * static_cast<double>(k));
  }
  stick(&log.temp_degc, 700, 1100); // longer than what is smoothed through
  stick(&log.temp_degc, 2000, 2120);
  Log without = log;
  for (const auto& [first, end] : {std::pair<size_t, size_t>{2001, 2120}, {701, 1100}}) {
    erase_rows(&without.t_s, first, end), erase_rows(&without.temp_degc, first, end);
    erase_rows(&without.axes[0].rate_dph, first, end), erase_rows(&without.axes[0].flags, first, end);
    erase_rows(&without.auxiliary["supply_v"], first, end);
  }
  const CampaignRun a = make_campaign({log}, "gx_dph", nominal_model()).runs[0];
  const CampaignRun b = make_campaign({without}, "gx_dph", nominal_model()).runs[0];
  assert_int_equal(a.holds.size(), 2);
  assert_int_equal(b.holds.size(), 0);
  assert_true(a.used == b.used && a.steps == b.steps && a.input.tick == b.input.tick);
  assert_true(a.input.smooth_degc == b.input.smooth_degc && a.input.rate_degc_min == b.input.rate_degc_min);
  assert_true(a.input.tn == b.input.tn && a.input.auxiliary == b.input.auxiliary);
}

static void test_likelihood_equals_that_of_the_dense_gaussian_with_gaps(void**) {
  const Campaign campaign = make_campaign({simulated_log(3, 900, true, 0)}, "gx_dph", nominal_model());
  Hypothesis h = nominal_hypothesis();
  h.base_noise.markov.push_back({7, 700});
  h.base_noise.walk_dph_per_rt_s = 0.3;
  const Design design = make_design(campaign, h);
  const VectorXd y = rates(campaign).front();
  const MatrixXd v = dense_covariance(campaign.runs[0], h.base_noise);
  const DenseFactor factor(v);
  const MatrixXd x = factor.half_solve(design.x[0]);
  const VectorXd z = factor.half_solve(y);
  const VectorXd beta = dense_least_squares(x, z);
  const double expected = -0.5 * (factor.log_det() + (z - x * beta).squaredNorm());
  const Fit fit = fit_hypothesis(campaign, h);
  assert_near(fit.log_likelihood, expected, 1e-6 * std::fabs(expected));
  for (long i = 0; i < beta.size(); ++i) assert_near(fit.beta[i], beta[i], 1e-6 * (1 + std::fabs(beta[i])));
  // Standard errors from the dense information matrix.
  const MatrixXd covariance = dense_inverse(dense_gram(x));
  for (long i = 0; i < beta.size(); ++i)
    for (long j = 0; j < beta.size(); ++j)
      assert_near(fit.beta_covariance(i, j), covariance(i, j),
                  2e-6 * (1 + std::sqrt(covariance(i, i) * covariance(j, j))));
}

static void test_whitening_and_colouring_are_inverse(void**) {
  const Campaign campaign = make_campaign({simulated_log(4, 1500, true, 0)}, "gx_dph", nominal_model());
  const RunGains gains = compute_gains(campaign.runs[0], nominal_hypothesis().base_noise);
  const VectorXd y = rates(campaign).front();
  VectorXd work = y;
  whiten(gains, work.data(), static_cast<size_t>(work.size()));
  MatrixXd wide = y.replicate(1, 11);
  whiten(gains, &wide);
  for (long k = 0; k < y.size(); ++k) assert_near(wide(k, 10), work[k], 1e-9);
  colour(gains, work.data(), static_cast<size_t>(work.size()));
  for (long k = 0; k < y.size(); ++k) assert_near(work[k], y[k], 1e-8);
}

static void test_mixtures_reduce_to_the_gaussian(void**) {
  const Campaign campaign = make_campaign({simulated_log(5, 1200, true, 0)}, "gx_dph", nominal_model());
  const Hypothesis h = nominal_hypothesis();
  const Fit fit = fit_hypothesis(campaign, h);
  NoiseModel rare = h.base_noise, still = h.base_noise;
  rare.hit_probability = 1e-12, rare.hit_sigma_dph = 100;
  still.telegraph_dph = 1e-9, still.telegraph_tau_s = 50;
  assert_near(mixture_log_likelihood(campaign.runs[0], rare, fit.residual[0]), fit.log_likelihood, 1e-6);
  assert_near(mixture_log_likelihood(campaign.runs[0], still, fit.residual[0]), fit.log_likelihood, 1e-6);
}

static void test_steps_count_seconds_and_not_rows(void**) {
  const Campaign campaign = make_campaign({simulated_log(6, 900, true, 0)}, "gx_dph", nominal_model());
  const CampaignRun& run = campaign.runs[0];
  int longest = 0;
  long total = 0;
  for (size_t k = 1; k < run.n(); ++k) longest = std::max(longest, run.steps[k]), total += run.steps[k];
  assert_true(longest >= 119);
  assert_int_equal(total, static_cast<long>(run.input.t_s.back() - run.input.t_s.front()));
}

static void test_decomposition_adds_up(void**) {
  const Campaign campaign = make_campaign({simulated_log(7, 2500, false, 60)}, "gx_dph", nominal_model());
  const Fit fit = fit_hypothesis(campaign, nominal_hypothesis());
  const WhereResult where = locate(campaign, fit, WhoseNoise::kModel);
  double by_tau = 0, by_temp = 0, by_phase = 0, by_log = 0;
  for (const WhereCell& c : where.by_tau) by_tau += c.excess;
  for (const WhereCell& c : where.by_temperature) by_temp += c.excess;
  for (const WhereCell& c : where.by_phase) by_phase += c.excess;
  for (const WhereCell& c : where.by_log) by_log += c.excess;
  assert_near(by_temp, by_tau, 1e-6);
  assert_near(by_phase, by_tau, 1e-6);
  assert_near(by_log, by_tau, 1e-6);
  // Times are those of the log, from the first to the last second of it.
  Campaign later = campaign;
  for (CampaignRun& run : later.runs) run.start_s += 5000;
  Fit loud = fit;
  loud.e[0].segment(1250, 400) *= 3;
  const WhereResult event = locate(campaign, loud, WhoseNoise::kModel),
                    at_later = locate(later, loud, WhoseNoise::kModel);
  assert_true(event.time_lo_s > 500 && event.time_hi_s < 2400);
  assert_near(at_later.time_lo_s, event.time_lo_s + 5000, 1e-9);
  assert_near(at_later.time_hi_s, event.time_hi_s + 5000, 1e-9);
  // Orthonormal: the whole is the excess of the squares.
  assert_near(by_tau, fit.e[0].squaredNorm() - static_cast<double>(fit.e[0].size()), 1e-6);
}

// Strength of an effect of the size called detectable: d^2 / 2 is what a log without noise gains by its column.
static void test_smallest_detectable_size_has_the_strength_that_is_stated(void**) {
  const Campaign campaign = make_campaign({simulated_log(8, 5000, false, 0)}, "gx_dph", nominal_model());
  const Hypothesis h = nominal_hypothesis();
  const std::vector<bool> active(effect_library().size(), true);
  const Identifiability found = identify(campaign, h, effect_library(), active, {300, 150, -100});
  size_t checked = 0;
  for (const Detectability& d : found.effects) {
    if (d.name != "rate_ramp") continue;
    Term term;
    term.effect = &find_effect(d.name), term.estimator = term.effect->estimator();
    Campaign clean = campaign;
    const std::vector<Column> columns = term.estimator->columns(clean.runs[0].input, {});
    for (size_t i = 0; i < columns[0].size(); ++i) clean.runs[0].input.rate_dph[i] = d.smallest * columns[0][i];
    Hypothesis with = h;
    with.terms.push_back(term);
    const double gain = fit_hypothesis(clean, with).log_likelihood - fit_hypothesis(clean, h).log_likelihood;
    assert_near(gain, 5.0 * 5.0 / 2, 1e-6);
    ++checked;
  }
  assert_int_equal(checked, 1);
}

static void test_marginal_likelihood_equals_that_of_the_dense_gaussian(void**) {
  const Campaign campaign =
      make_campaign({simulated_log(3, 1500, true, 0), simulated_log(4, 1500, false, 0)}, "gx_dph", nominal_model());
  const SlowData data(block_means(campaign, 10));
  NoiseModel noise;
  noise.white_sigma_dph = 36;
  noise.markov = {{20, 100}};
  const MeanPart part = mean_part(data, *find_effect("thermal_hysteresis").estimator(), {5});
  const RunGrams grams(data, {&part}, noise);
  NoiseModel per_tick = noise; // dense_covariance counts in ticks
  per_tick.white_sigma_dph /= std::sqrt(data.campaign.dt_s);
  per_tick.markov[0].tau_s /= data.campaign.dt_s;
  // Written out: y ~ N(0, V + X S X'), flat columns with a prior so wide that its size drops out of differences.
  const auto dense = [&](bool with_part) {
    long rows = 0;
    for (const VectorXd& y : data.y) rows += y.size();
    MatrixXd v = MatrixXd::Zero(rows, rows);
    VectorXd y(rows);
    long at = 0;
    for (size_t r = 0; r < data.y.size(); ++r) {
      const long n = data.y[r].size();
      v.block(at, at, n, n) = dense_covariance(data.campaign.runs[r], per_tick);
      v.block(at, at, n, n).array() += 1e8;
      y.segment(at, n) = data.y[r];
      at += n;
    }
    MatrixXd common(rows, data.powers[0].cols() + part.common[0].cols());
    at = 0;
    for (size_t r = 0; r < data.y.size(); ++r) {
      const long n = data.y[r].size();
      common.middleRows(at, n) << data.powers[r], part.common[r];
      if (with_part)
        for (long c = 0; c < part.local[r].cols(); ++c)
          v.block(at, at, n, n) += part.local[r].col(c) * part.local[r].col(c).transpose() / part.local_precision[c];
      at += n;
    }
    for (long c = 0; c < common.cols(); ++c) {
      const bool is_power = c < data.powers[0].cols();
      if (!is_power && !with_part) continue;
      const double variance = is_power ? 1e8 : 1 / part.common_precision[c - data.powers[0].cols()];
      v += variance * common.col(c) * common.col(c).transpose();
    }
    const DenseFactor factor(v);
    return -0.5 * (factor.log_det() + factor.half_solve(y).squaredNorm());
  };
  const double expected = dense(true) - dense(false);
  const double found = grams.log_marginal() - RunGrams(data, {}, noise).log_marginal();
  assert_near(found, expected, 2e-3 * (1 + std::fabs(expected)));
}

// Beside a loop, with start states of every run: the same as a step whose size is free, at rows of every part of either run.
static void test_gains_of_steps_are_those_of_steps_in_the_mean(void**) {
  const Campaign campaign =
      make_campaign({simulated_log(3, 1500, true, 0), simulated_log(4, 2500, false, 0)}, "gx_dph", nominal_model());
  SlowData data(block_means(campaign, 10));
  data.campaign.runs[1].own_strength = 1.3;
  NoiseModel noise;
  noise.white_sigma_dph = 36;
  noise.markov = {{20, 100}};
  const std::vector<MeanPart> parts = {mean_part(data, *find_effect("thermal_hysteresis").estimator(), {5})};
  const RunGrams::Posterior at = RunGrams(data, pointers_of(parts), noise).posterior();
  for (size_t r = 0; r < 2; ++r) {
    const VectorXd gains = step_gains(data, parts, compute_gains(data.campaign.runs[r], noise), at, r);
    assert_near(gains[0], 0, 0);
    const CampaignRun& run = data.campaign.runs[r];
    for (size_t k = 1; k < run.n(); k += 13) {
      MeanPart step = mean_part(data, *find_effect("rate_ramp").estimator(), {});
      for (size_t i = 0; i < 2; ++i) step.common[i].setZero();
      step.common[r].bottomRows(static_cast<long>(run.n() - k)).setOnes();
      step.common_precision.setZero();
      const RunGrams::Posterior with = RunGrams(data, {&parts[0], &step}, noise).posterior();
      const long last = with.common.size() - 1;
      const double expected = 0.5 * std::pow(with.common[last], 2) / with.common_covariance(last, last);
      assert_near(gains[static_cast<long>(k)], expected, 1e-6 * (1 + expected));
    }
  }
}

static void test_scan_scores_are_those_of_the_marginal_likelihood(void**) {
  const Campaign campaign =
      make_campaign({simulated_log(5, 3000, true, 30), simulated_log(6, 3000, false, 30)}, "gx_dph", nominal_model());
  const SlowData data(block_means(campaign, 10));
  NoiseModel noise;
  noise.white_sigma_dph = 30;
  noise.markov = {{25, 150}};
  std::vector<ScanCandidate> candidates;
  for (const char* name : {"thermal_hysteresis", "thermal_lag", "temperature_rate", "run_to_run"}) {
    ScanCandidate c;
    c.estimator = find_effect(name).estimator();
    c.shapes = {Theta{}};
    if (std::string(name) == "thermal_hysteresis") c.shapes = {{3}, {8}};
    if (std::string(name) == "thermal_lag") c.shapes = {{110}, {640}};
    candidates.push_back(c);
  }
  const ScanBank bank(data, candidates);
  const ScanNode node(bank, noise);
  std::vector<MatrixXd> y;
  for (const VectorXd& rate : data.y) y.push_back(rate);
  const MeanPart base = mean_part(data, *find_effect("rate_ramp").estimator(), {});
  const ScanNode::Scores scores = node.score({&base}, y, std::vector<char>(4, 0));
  assert_near(scores.base[0], RunGrams(data, {&base}, noise).log_marginal(), 1e-6 * std::fabs(scores.base[0]));
  for (size_t g = 0; g < bank.groups().size(); ++g) {
    const MeanPart part = part_of(data, candidates[bank.groups()[g].candidate], bank.groups()[g].shape);
    // The scan averages over the prior scales of the group alone.
    double values[3], top = -1e300, sum = 0;
    const double scales[3] = {1.0 / 3, 1, 3};
    for (int i = 0; i < 3; ++i) {
      MeanPart scaled = part;
      scaled.common_precision /= scales[i] * scales[i], scaled.local_precision /= scales[i] * scales[i];
      values[i] = RunGrams(data, {&base, &scaled}, noise).log_marginal();
      top = std::max(top, values[i]);
    }
    for (double v : values) sum += std::exp(v - top) / 3;
    assert_near(scores.group(static_cast<long>(g), 0), top + std::log(sum), 1e-6 * std::fabs(top));
  }
}

static void test_block_noise_has_the_covariance_of_block_means(void**) {
  NoiseModel noise;
  noise.white_sigma_dph = 36;
  noise.markov = {{20, 100}};
  const NoiseModel blocks = block_equivalent(noise, 10);
  // Sums over the ten seconds of both blocks, written out.
  for (int apart = 0; apart < 3; ++apart) {
    double expected = 0;
    for (int i = 0; i < 1000; ++i)
      for (int j = 0; j < 1000; ++j) expected += 400 * std::exp(-std::fabs(0.01 * (i - j) + 10.0 * apart) / 100) / 1e6;
    if (apart == 0) expected += 36.0 * 36 / 10;
    double found = blocks.markov[0].sigma_dph * blocks.markov[0].sigma_dph * std::exp(-10.0 * apart / 100);
    if (apart == 0) found += (36.0 * 36 + blocks.extra_white_dph2) / 10;
    assert_near(found, expected, 1e-4 * expected);
  }
}

static CampaignRun run_of_rows(long n, double dt_s) {
  CampaignRun run;
  RunInput& in = run.input;
  in.dt_s = dt_s;
  for (long i = 0; i < n; ++i)
    in.t_s.push_back(dt_s * static_cast<double>(i)), in.rate_dph.push_back(0), in.tn.push_back(0), in.tick.push_back(i);
  find_used(&run);
  return run;
}

// Rows of 14 s make minutes of 56 s, rows of 286 s one each: what the noise makes of them agrees with draws.
static void test_noise_of_minutes_is_that_of_their_length(void**) {
  NoiseModel noise;
  noise.white_sigma_dph = 36;
  noise.markov = {{4, 2000}};
  for (const double dt_s : {1.0, 14.0, 41.0, 286.0}) {
    const long n = static_cast<long>(20000 / dt_s);
    const CampaignRun run = run_of_rows(n, dt_s);
    const RunGains gains = compute_gains(run, block_equivalent(noise, dt_s));
    std::vector<Minutes> all;
    for (uint64_t draw = 0; draw < 200; ++draw) {
      const Rng rng(91, draw, 0, static_cast<uint32_t>(Stream::kTool));
      VectorXd x(n);
      rng.normals(0, static_cast<size_t>(n), x.data());
      colour(gains, x.data(), static_cast<size_t>(n));
      all.push_back(minutes_of(x, dt_s));
    }
    const double expected = noise_of_all(noise, minute_s(dt_s), all);
    const double error = error_of_minutes(noise, minute_s(dt_s), all);
    assert_near(mean_square(all), expected, 4 * error);
    assert_true(error < 0.05 * expected);
    for (Minutes& m : all) m.strength = 2;
    assert_near(noise_of_all(noise, minute_s(dt_s), all), 4 * expected, 1e-9 * expected);
  }
}

// Of samples of 2 s, a variance that each has is twice as much in 1-s means, and as in all means falls with their number.
static void test_variance_of_samples_is_theirs_at_any_step(void**) {
  NoiseModel noise;
  noise.extra_white_dph2 = 7 * 2;
  assert_near(compute_gains(run_of_rows(4, 2), noise).sum_log_s, 4 * std::log(7.0), 1e-9);
  assert_near(block_equivalent(noise, 10).extra_white_dph2 / 10, 7.0 / 5, 1e-9);
}

static void test_blocks_hold_telegraph_noise_by_its_covariance(void**) {
  NoiseModel markov, telegraph;
  markov.white_sigma_dph = telegraph.white_sigma_dph = 36;
  markov.markov = {{20, 100}, {50, 600}}, telegraph.markov = {{20, 100}};
  telegraph.telegraph_dph = 50, telegraph.telegraph_tau_s = 600;
  assert_true(block_equivalent(telegraph, 10) == block_equivalent(markov, 10));
}

static void test_every_constant_of_the_selector_is_listed_once(void**) {
  const std::vector<SelectorConstant>& list = selector_constants();
  assert_int_equal(list.size() * sizeof(double), sizeof(SelectorConstants));
  SelectorConstants marked;
  std::set<std::string> names;
  for (const SelectorConstant& c : list) {
    assert_true(marked.*c.value != -1); // each is another member
    marked.*c.value = -1;
    assert_true(names.insert(c.name).second);
    assert_true(c.meaning[0] && c.source[0]);
  }
}

static void test_constants_that_are_handed_down_decide(void**) {
  std::vector<Log> logs;
  for (uint64_t seed = 41; seed < 43; ++seed) logs.push_back(simulated_log(seed, 4000, false, 60));
  const Campaign campaign = make_campaign(logs, "gx_dph", nominal_model());
  const SlowData data(block_means(campaign, block_length_s(campaign)));
  const auto names_with = [&](const SelectorConstants& constants) {
    SlowSearch search(data, nothing_believed(), effect_library(), all_active(), constants);
    return search.run().best.names.size();
  };
  SelectorConstants strict;
  strict.mean_nats = 1e4;
  assert_int_equal(names_with({}), 1);
  assert_int_equal(names_with(strict), 0);
}

static void test_draws_of_the_fitted_noise_seldom_exceed_the_threshold(void**) {
  std::vector<Log> logs = {simulated_log(9, 3000, false, 0), simulated_log(10, 3000, false, 0)};
  const Campaign campaign = make_campaign(logs, "gx_dph", nominal_model());
  const SlowData data(block_means(campaign, 10));
  SlowSearch search(data, nothing_believed(), effect_library(), all_active(), {});
  const double threshold = null_tail(search.null_gains(100, 21), 0.1).threshold_nats;
  int alarms = 0;
  for (double gain : search.null_gains(100, 22)) alarms += gain > threshold;
  // 10 at most expected; the floor of the threshold and the charge for polishing make it fewer.
  assert_true(alarms <= 20);
  // Thresholds rise as the rate falls.
  const std::vector<double> gains = search.null_gains(100, 23);
  assert_true(null_tail(gains, 0.001).threshold_nats >= null_tail(gains, 0.1).threshold_nats);
}

// An exponential tail of 2 nats is seen as one, also where the threshold is held at its highest.
static void test_the_tail_of_chance_is_that_of_the_draws(void**) {
  Rng rng(77, 0, 0, Stream::kTool);
  std::vector<double> gains;
  for (int i = 0; i < 4000; ++i) gains.push_back(-2 * std::log(rng.uniform()));
  const SelectorConstants constants;
  const double at_1e2 = 2 * std::log(100.0) + constants.polish_gain_nats, at_1e4 = at_1e2 + 2 * std::log(100.0);
  const NullTail often = null_tail(gains, 0.01), seldom = null_tail(gains, 1e-4);
  assert_near(often.scale_nats, 2, 0.15);
  assert_near(often.threshold_nats, at_1e2, 0.6);
  assert_near(often.over_nats, 0, 1e-12);
  assert_near(seldom.threshold_nats, constants.most_threshold_nats, 1e-12);
  assert_near(seldom.over_nats, at_1e4 - constants.most_threshold_nats, 1.2);
}

// Draws of a noise that has a slow process beside the believed one gain more than those of the believed kind: what a second process
// makes by chance is no name.
static void test_draws_of_another_kind_of_slow_noise_gain_more(void**) {
  std::vector<Log> logs;
  for (uint64_t k = 0; k < 4; ++k) {
    logs.push_back(simulated_log(7100 + k, 6000, false, 0));
    Rng rng(7100 + k, 1, 0, Stream::kTool);
    double slow = 10 * rng.normal();
    const double phi = std::exp(-1 / 600.0);
    for (double& rate : logs.back().axes[0].rate_dph) {
      rate += slow;
      slow = phi * slow + 10 * std::sqrt(1 - phi * phi) * rng.normal();
    }
  }
  const Campaign campaign = make_campaign(logs, "gx_dph", nominal_model());
  const SlowData data(block_means(campaign, block_length_s(campaign)));
  SlowSearch search(data, true_noise_believed(), effect_library(), all_active(), {});
  std::vector<double> plain = search.null_gains(100, 1);
  const SlowResult found = search.run();
  const auto second = std::find_if(found.noises.begin(), found.noises.end(), [](const SlowCandidateScore& s) {
    return s.model.noise_effect == &find_effect("second_markov");
  });
  assert_true(second != found.noises.end());
  std::vector<double> other = search.gains_under(second->model, 100, 1);
  assert_true(other == search.gains_under(second->model, 100, 1)); // and the same draws again
  std::sort(plain.begin(), plain.end()), std::sort(other.begin(), other.end());
  assert_true(other[90] > plain[90]);
}

static void test_a_jump_must_gain_more_at_a_lower_rate(void**) {
  assert_near(jump_threshold(0.01), SelectorConstants().first_step_nats, 1e-12);
  assert_true(jump_threshold(0.001) > jump_threshold(0.01) + 2);
  assert_near(jump_threshold(0.9), 0, 1e-12);
}

static void test_gram_of_wide_columns_is_that_of_whitened_ones(void**) {
  const Campaign campaign = make_campaign({simulated_log(5, 1500, true, 0)}, "gx_dph", nominal_model());
  const CampaignRun& run = campaign.runs.front();
  MatrixXd columns(static_cast<long>(run.n()), 11); // two blocks of eight, one of them not full
  Rng rng(6, 0, 0, Stream::kWhite);
  for (long i = 0; i < columns.size(); ++i) columns.data()[i] = rng.normal();
  for (int states = 0; states < 3; ++states) {
    NoiseModel noise;
    noise.white_sigma_dph = 36;
    for (int m = 0; m < states; ++m) noise.markov.push_back({20.0 + m, 30.0 + 200 * m});
    const RunGains gains = compute_gains(run, noise);
    MatrixXd white = columns;
    whiten(gains, &white);
    VectorXd alone = columns.col(9); // a single column takes another path
    whiten(gains, alone.data(), run.n());
    assert_near((white.col(9) - alone).norm(), 0, 1e-12 * alone.norm());
    const MatrixXd expected = dense_gram(white), found = WideColumns(columns).whitened_gram(gains);
    assert_near((found - expected).norm(), 0, 1e-11 * expected.norm());
  }
}

// White innovations of a campaign, with a tone whose frequency follows the temperature.
static std::vector<VectorXd> innovations_with_tone(const Campaign& campaign, double amplitude, double hz,
                                                   double hz_per_degc, uint64_t draw = 0) {
  std::vector<VectorXd> e;
  Rng rng(77, draw, 0, Stream::kWhite);
  for (const CampaignRun& run : campaign.runs) {
    VectorXd x(static_cast<long>(run.n()));
    double phase = 0.3;
    for (size_t k = 0; k < run.n(); ++k) {
      const size_t row = static_cast<size_t>(run.used[k]);
      phase += 2 * kPi * (hz + hz_per_degc * (run.input.smooth_degc[row] - run.input.t0_degc));
      x[static_cast<long>(k)] = rng.normal() + amplitude * std::cos(phase);
    }
    e.push_back(std::move(x));
  }
  return e;
}

// Sums as they are written, for lengths that are powers of four and that are not, in and beyond a part of the cache.
static void test_a_transform_is_the_sum_it_stands_for(void**) {
  for (const size_t n : {4u, 8u, 64u, 256u, 512u, 2048u, 4096u}) {
    const Fourier fourier(n);
    constexpr size_t kLanes = Fourier::kLanes;
    Rng rng(5, n, 0, Stream::kWhite);
    std::vector<double> re(n * kLanes), im(n * kLanes);
    for (size_t i = 0; i < re.size(); ++i) re[i] = rng.normal(), im[i] = rng.normal();
    std::vector<double> re_out = re, im_out = im;
    fourier.transform_lanes(re_out.data(), im_out.data());
    for (size_t lane = 0; lane < kLanes; lane += 7) {
      std::vector<double> one_re(n), one_im(n);
      for (size_t t = 0; t < n; ++t) one_re[t] = re[t * kLanes + lane], one_im[t] = im[t * kLanes + lane];
      const std::vector<double> x = one_re, y = one_im;
      fourier.transform(one_re.data(), one_im.data());
      for (size_t k = 0; k<n; k += n> 64 ? 37 : 1) {
        double sum_re = 0, sum_im = 0;
        for (size_t t = 0; t < n; ++t) {
          const double angle = 2 * kPi * static_cast<double>(k * t % n) / static_cast<double>(n);
          sum_re += x[t] * std::cos(angle) + y[t] * std::sin(angle);
          sum_im += y[t] * std::cos(angle) - x[t] * std::sin(angle);
        }
        const size_t at = fourier.place(k);
        assert_near(one_re[at], sum_re, 1e-10);
        assert_near(one_im[at], sum_im, 1e-10);
        assert_true(re_out[at * kLanes + lane] == one_re[at] && im_out[at * kLanes + lane] == one_im[at]);
      }
    }
  }
}

// Two real sequences in one transform are as far from each other as in two.
static void test_powers_of_two_sequences_are_those_of_each(void**) {
  constexpr size_t kN = 128;
  const Fourier fourier(kN);
  Rng rng(6, 0, 0, Stream::kWhite);
  std::vector<double> a(kN), b(kN), together, apart;
  for (size_t t = 0; t < kN; ++t) a[t] = rng.normal(), b[t] = 30 * rng.normal();
  std::vector<double> one = a, other = b;
  add_powers(fourier, one.data(), 2, other.data(), 0.5, &together);
  one = a, other = b;
  add_powers(fourier, one.data(), 2, nullptr, 0, &apart);
  add_powers(fourier, other.data(), 0.5, nullptr, 0, &apart);
  assert_int_equal(together.size(), kN / 2 + 1);
  double energy = 0, expected = 0; // Parseval: both halves of the spectrum hold n times the energy
  for (size_t k = 0; k <= kN / 2; ++k) {
    assert_near(together[k], apart[k], 1e-8);
    energy += (k == 0 || k == kN / 2 ? 1 : 2) * together[k] / kN;
  }
  for (size_t t = 0; t < kN; ++t) expected += 2 * a[t] * a[t] + 0.5 * b[t] * b[t];
  assert_near(energy, expected, 1e-8);
}

static Line strongest_of_all(const Campaign& campaign, const std::vector<VectorXd>& e) {
  return stronger_drifting(campaign, e, strongest_line(campaign, e));
}

static void test_a_line_that_drifts_with_temperature_is_found_as_one(void**) {
  const Campaign campaign = make_campaign({simulated_log(21, 6000, false, 0)}, "gx_dph", nominal_model());
  constexpr double kHz = 0.11;
  for (const double hz_per_degc : {2e-3 * 0.25, -2e-3 * 0.25}) { // slopes of the grid: (12/24)^2 of its largest
    const std::vector<VectorXd> drifting = innovations_with_tone(campaign, 0.25, kHz, hz_per_degc);
    const Line steady = strongest_line(campaign, drifting), line = stronger_drifting(campaign, drifting, steady);
    assert_near(line.hz, kHz, 2.0 / 8192);
    assert_near(line.hz_per_degc, hz_per_degc, 1e-9);
    // Energy n A^2 / 4 of a line that is in one bin; smeared over 60 degC * slope = 200 bins otherwise.
    assert_near(line.gain_nats, 6000 * 0.25 * 0.25 / 4, 40);
    assert_true(steady.gain_nats < 22);
  }
  const std::vector<VectorXd> nothing = innovations_with_tone(campaign, 0, kHz, 0);
  assert_true(strongest_of_all(campaign, nothing).gain_nats < 28);
}

// A slope half the way between two of the grid, where the steps of the grid spread a line over some forty bins.
static void test_a_line_that_drifts_between_two_slopes_of_the_grid_is_found(void**) {
  const Campaign campaign = make_campaign({simulated_log(21, 6000, false, 0)}, "gx_dph", nominal_model());
  for (const double hz_per_degc : {2e-3 * 12.5 * 12.5 / 576, -2e-3 * 20.5 * 20.5 / 576}) {
    const std::vector<VectorXd> drifting = innovations_with_tone(campaign, 0.25, 0.21, hz_per_degc);
    const Line line = strongest_of_all(campaign, drifting);
    assert_near(line.hz, 0.21, 2.0 / 8192);
    assert_near(line.hz_per_degc, hz_per_degc, 2e-3 / 576);
    assert_near(line.gain_nats, 6000 * 0.25 * 0.25 / 4, 50);
  }
}

// Between the places of both grids: what is found misses less than a tenth of a beat over the run, and has the power of the
// whole line, where the grid has some of it.
static void test_a_line_is_placed_between_the_places_of_the_grid(void**) {
  const Campaign campaign = make_campaign({simulated_log(21, 6000, false, 0)}, "gx_dph", nominal_model());
  const EffectEstimator& tone = *find_effect("sinusoid").estimator();
  const double t0_degc = campaign.runs[0].input.t0_degc;
  constexpr double kHz = 0.11 + 0.4 / 8192, kAmplitude = 0.6, kAll = 6000 * kAmplitude * kAmplitude / 4;
  const std::vector<VectorXd> steady = innovations_with_tone(campaign, kAmplitude, kHz, 0);
  const Line line = strongest_line(campaign, steady);
  const PlacedLine placed = place_of(campaign, steady, tone, line);
  assert_near(placed.shape[0], kHz, 0.1 / 6000);
  assert_near(placed.power_nats, kAll, 60);
  assert_true(line.gain_nats < 0.9 * placed.power_nats);
  for (const double hz_per_degc : {2e-3 * 0.1, -2e-3 * 0.1}) { // between (7/24)^2 and (8/24)^2 of the largest
    const std::vector<VectorXd> drifting = innovations_with_tone(campaign, kAmplitude, kHz, hz_per_degc);
    const PlacedLine found = place_of(campaign, drifting, tone, strongest_of_all(campaign, drifting));
    assert_near(found.shape[1], hz_per_degc, 1e-6);
    assert_near(found.shape[0] + found.shape[1] * t0_degc, kHz, 0.1 / 6000);
    assert_near(found.power_nats, kAll, 60);
  }
}

// A chamber that goes up and down every 87 s: what follows its cycle, or half of it, is not a tone of the gyro, with or without
// a drift that chance gave it; what has another frequency is, and so is what drifts far across the cycle.
static void test_a_line_of_the_temperature_is_known(void**) {
  constexpr double kCycle_hz = 1 / 87.0;
  Log log = simulated_log(23, 7000, false, 0);
  Rng rng(23, 0, 0, Stream::kWhite);
  for (size_t k = 0; k < log.temp_degc.size(); ++k) {
    const double cycle = std::sin(2 * kPi * kCycle_hz * log.t_s[k]);
    log.temp_degc[k] += 0.1 * cycle + 0.01 * rng.normal();
    log.axes[0].rate_dph[k] += 20 * cycle + 20 * cycle * cycle;
  }
  const Campaign campaign = make_campaign({log}, "gx_dph", nominal_model());
  const auto is_its = [&](double hz, double hz_per_degc) {
    const double at_0_degc = hz - hz_per_degc * 30; // `hz`: in the middle of 0 to 60 degC
    const Theta shape = hz_per_degc == 0 ? Theta{hz} : Theta{at_0_degc, hz_per_degc};
    return is_of_temperature(campaign, NamedLine{&find_effect("sinusoid"), shape, 100, 20});
  };
  for (const double times : {1.0, 2.0}) {
    assert_true(is_its(times * kCycle_hz, 0));
    for (const double hz_per_degc : {4e-6, -1e-5}) assert_true(is_its(times * kCycle_hz, times * hz_per_degc));
  }
  for (const double hz : {0.02, 0.11, 0.3})
    for (const double hz_per_degc : {0.0, 1e-5, -3e-4}) assert_true(!is_its(hz, hz_per_degc));
  assert_true(!is_its(0.04, 1e-3)); // 0.01 to 0.07 Hz
}

// A run of a few cycles, first or last, takes nothing away from what the long ones show.
static void test_a_short_log_hides_no_line_of_the_temperature(void**) {
  constexpr double kCycle_hz = 1 / 60.0;
  std::vector<Log> logs;
  for (const size_t seconds : {7000u, 7000u, 400u}) {
    logs.push_back(simulated_log(24 + logs.size(), seconds, false, 0));
    for (size_t k = 0; k < seconds; ++k) {
      const double cycle = std::sin(2 * kPi * kCycle_hz * logs.back().t_s[k]);
      logs.back().temp_degc[k] += 0.4 * cycle, logs.back().axes[0].rate_dph[k] += 20 * cycle;
    }
  }
  const auto has_line = [](const std::vector<Log>& of) {
    return is_of_temperature(make_campaign(of, "gx_dph", nominal_model()),
                             NamedLine{&find_effect("sinusoid"), {kCycle_hz}, 100, 20});
  };
  assert_true(has_line({logs[0], logs[1]}));
  assert_true(has_line(logs));
  assert_true(has_line({logs[2], logs[0], logs[1]}));
  assert_true(!has_line({logs[2]})); // it alone cannot tell
}

// A tone of the gyro that has the frequency of the chamber's cycle by chance, or twice that, does not keep to its phases.
static void test_a_tone_with_phases_of_its_own_is_not_of_the_temperature(void**) {
  constexpr double kCycle_hz = 1 / 87.0, kLag_s = 9;
  for (const double times : {1.0, 2.0})
    for (const bool follows : {true, false}) {
      std::vector<Log> logs;
      Rng rng(61, 0, 0, Stream::kTool);
      for (uint64_t seed = 61; seed < 66; ++seed) {
        Log log = simulated_log(seed, 7000, false, 0);
        const double phase = 2 * kPi * rng.uniform(), own = 2 * kPi * rng.uniform();
        for (size_t k = 0; k < log.size(); ++k) {
          const double turn = 2 * kPi * kCycle_hz * log.t_s[k];
          log.temp_degc[k] += 0.1 * std::sin(turn + phase);
          log.axes[0].rate_dph[k] +=
              10 * std::sin(times * (turn - 2 * kPi * kCycle_hz * kLag_s) + (follows ? times * phase : own));
        }
        log.axes[0].rate_dph[1000] += 1e6; // a hit tells nothing of a phase
        logs.push_back(log);
      }
      const Campaign campaign = make_campaign(logs, "gx_dph", nominal_model());
      assert_true(follows == is_of_temperature(campaign, {&find_effect("sinusoid"), {times * kCycle_hz}, 100, 20}));
    }
}

static void test_a_strong_line_in_many_logs_has_a_finite_gain(void**) {
  std::vector<Log> logs;
  for (uint64_t seed = 1; seed <= 80; ++seed) logs.push_back(simulated_log(seed, 600, false, 0));
  const Campaign campaign = make_campaign(logs, "gx_dph", nominal_model());
  const Line line = strongest_line(campaign, innovations_with_tone(campaign, 10, 0.11, 0));
  assert_near(line.hz, 0.11, 2.0 / 1024);
  assert_true(std::isfinite(line.gain_nats) &&
              line.gain_nats > 1e4); // less than n A^2 / 4: its own leakage is around it
}

// Logs of one kind: what a tone gains in each of them adds up, and the largest of nothing stays where theory has it:
// ln(number of frequencies) + 0.58, whatever the number of logs.
static void test_lines_of_several_logs_add_up(void**) {
  std::vector<Log> logs;
  for (uint64_t seed = 31; seed < 35; ++seed) logs.push_back(simulated_log(seed, 6000, false, 0));
  const Campaign campaign = make_campaign(logs, "gx_dph", nominal_model());
  const double amplitude = 2 * std::sqrt(13.0 / 6000); // 13 nats in each log
  const Line line = strongest_line(campaign, innovations_with_tone(campaign, amplitude, 0.11, 0));
  assert_near(line.hz, 0.11, 2.0 / 8192);
  assert_near(line.gain_nats, 56 - std::log(56.0 * 56 * 56 / 6), 25);
  double mean = 0;
  constexpr int kDraws = 12;
  for (uint64_t draw = 1; draw <= kDraws; ++draw)
    mean += strongest_line(campaign, innovations_with_tone(campaign, 0, 0, 0, draw)).gain_nats / kDraws;
  assert_near(mean, std::log(3000.0) + 0.58, 1.3);
}

// Runs share gains only where their samples lie at the same times, as far as they go, their rates are rounded alike, and the noise
// does not follow the temperature.
static void test_gains_run_by_run_are_those_of_each_run(void**) {
  Campaign campaign = make_campaign({simulated_log(22, 900, false, 0), simulated_log(23, 900, false, 0),
                                     simulated_log(24, 40, false, 0), simulated_log(25, 700, false, 0)},
                                    "gx_dph", nominal_model());
  campaign.runs.push_back(campaign.runs.front());
  for (size_t i = 300; i < 400; ++i) campaign.runs.back().input.rate_dph[i] = std::nan("");
  find_used(&campaign.runs.back());
  for (double& tn : campaign.runs[1].input.tn) tn += 0.5;
  campaign.runs.push_back(campaign.runs.front());
  campaign.runs.back().own_white_dph2 = 300;
  for (const double slope : {0.0, 0.7}) {
    NoiseModel noise;
    noise.white_sigma_dph = 36, noise.markov = {{20, 100}}, noise.white_slope = slope;
    GainsByRun by_run(campaign.runs, noise);
    std::vector<CampaignRun> asked = campaign.runs;
    asked.push_back(asked[4]), asked.push_back(asked[4]); // no beginning of the longest, twice
    for (const CampaignRun& run : asked) {
      const RunGains alone = compute_gains(run, noise), &found = by_run.of(run);
      assert_true(found.gain == alone.gain && found.inv_sqrt_s == alone.inv_sqrt_s && found.n == alone.n);
      assert_true(found.stretches.size() == alone.stretches.size() && found.sum_log_s == alone.sum_log_s);
    }
  }
}

// Rounding of one run: seconds, their blocks and their minutes have its variance there and nowhere else.
static void test_rounding_of_one_run_is_noise_of_that_run(void**) {
  constexpr double kStep_dph = 60, kAdded_dph2 = kStep_dph * kStep_dph / 12;
  const Campaign plain =
      make_campaign({simulated_log(26, 900, false, 0), simulated_log(27, 900, false, 0)}, "gx_dph", nominal_model());
  Campaign mixed = plain;
  mixed.runs[1].own_white_dph2 = kAdded_dph2;
  const NoiseModel noise = nominal_hypothesis().base_noise;
  NoiseModel louder = noise;
  louder.extra_white_dph2 = kAdded_dph2;
  std::vector<VectorXd> rates;
  for (const CampaignRun& run : plain.runs) rates.push_back(used_rows(run, {run.input.rate_dph}));
  const auto one = [&](size_t r, const NoiseModel& of) {
    Campaign alone = plain;
    alone.runs = {plain.runs[r]};
    const std::vector<VectorXd> of_run = {rates[r]};
    return ResidualLikelihood(alone, of_run)(of);
  };
  const double expected = one(0, noise) + one(1, louder);
  assert_near(ResidualLikelihood(mixed, rates)(noise), expected, 1e-9 * std::fabs(expected));
  const Campaign blocks = block_means(mixed, 10);
  assert_near(blocks.runs[0].own_white_dph2, 0, 0);
  assert_near(blocks.runs[1].own_white_dph2, kAdded_dph2 / 10, 1e-9);
  const double minutes = noise_of_minutes(noise, 60, 900), of_louder = noise_of_minutes(louder, 60, 900);
  assert_near(noise_of_all(noise, 60, {{0, 15, 1, 0}, {0, 15, 1, kAdded_dph2}}), 0.5 * (minutes + of_louder), 1e-9);
  const double white = white_of_samples_dph(mixed, noise);
  assert_near(white * white, 36 * 36 + kAdded_dph2 / 2, 1e-9);
}

// Innovations of a filter that loses a jump within 30 s, of noise that is white otherwise.
static std::vector<VectorXd> innovations_with_jumps(const Campaign& campaign, double height, long every) {
  std::vector<VectorXd> e;
  Rng rng(8, 0, 0, Stream::kWhite);
  for (const CampaignRun& run : campaign.runs) {
    VectorXd x(static_cast<long>(run.n()));
    for (long k = 0; k < x.size(); ++k) x[k] = rng.normal() + height * std::exp(-static_cast<double>(k % every) / 30);
    e.push_back(std::move(x));
  }
  return e;
}

static double evidence_of_test(const Campaign& campaign, const std::vector<VectorXd>& e, Rest test) {
  for (const RestFinding& f : test_rest(campaign, e, {}))
    if (f.test == test) return f.evidence_nats;
  return 1e9;
}

static void test_sudden_changes_show_in_smoothed_moments_and_noise_does_not(void**) {
  const Campaign campaign =
      make_campaign({simulated_log(21, 8000, false, 0), simulated_log(22, 8000, true, 0)}, "gx_dph", nominal_model());
  assert_true(evidence_of_test(campaign, innovations_with_jumps(campaign, 0, 800), Rest::kSuddenChanges) < 0);
  assert_true(evidence_of_test(campaign, innovations_with_jumps(campaign, 1.2, 800), Rest::kSuddenChanges) > 5);
  // As large a wave is slow and Gaussian in its moments: another test's business.
  assert_true(evidence_of_test(campaign, innovations_with_tone(campaign, 0.15, 0.002, 0), Rest::kSuddenChanges) < 0);
}

// Evidence of a test on white innovations of standard deviation `sigma` in runs of these lengths.
static double evidence_on_white(const std::vector<size_t>& seconds, uint64_t seed, double sigma, Rest test) {
  std::vector<Log> logs;
  for (const size_t n : seconds) logs.push_back(simulated_log(seed, n, false, 0));
  const Campaign campaign = make_campaign(logs, "gx_dph", nominal_model());
  Rng rng(seed, 0, 0, Stream::kTool);
  std::vector<VectorXd> e;
  for (const CampaignRun& run : campaign.runs) {
    e.emplace_back(static_cast<long>(run.n()));
    for (double& x : e.back()) x = sigma * rng.normal();
  }
  return evidence_of_test(campaign, e, test);
}

static void test_a_flat_spectrum_is_flat_whatever_the_lengths_of_the_logs(void**) {
  for (uint64_t seed = 61; seed < 65; ++seed) {
    assert_true(evidence_on_white({30000, 4000, 4000}, seed, 1, Rest::kSpectrum) < 0);
    assert_true(evidence_on_white({20000, 2000}, seed, 1, Rest::kSpectrum) < 0);
  }
}

static void test_bursts_are_not_noise_of_another_size(void**) {
  for (uint64_t seed = 71; seed < 75; ++seed) {
    const double plain = evidence_on_white({8000}, seed, 1, Rest::kBursts);
    assert_true(plain < 0);
    assert_near(evidence_on_white({8000}, seed, 3, Rest::kBursts), plain, 1e-9);
  }
}

// A jump inside a block has its share of the mean, whatever its size, and one second that is far off has none.
static void test_a_block_holds_the_share_of_a_jump_and_no_hit(void**) {
  for (const double height : {30.0, 3000.0})
    for (const size_t second : {2u, 4u, 7u, 9u}) {
      Log log = simulated_log(77, 2000, false, 0);
      Rng rng(77, 0, 0, Stream::kTool);
      for (double& rate : log.axes[0].rate_dph) rate = rng.normal();
      for (size_t i = 1000 + second; i < log.size(); ++i) log.axes[0].rate_dph[i] += height;
      log.axes[0].rate_dph[500] += height;
      const Campaign blocks = block_means(make_campaign({log}, "gx_dph", nominal_model()), 10);
      const std::vector<double>& y = blocks.runs[0].input.rate_dph;
      const auto tenths = static_cast<double>(10 - second);
      assert_near(y[100], 0.1 * tenths * height, 1.5); // means of ten are within 5 standard deviations
      assert_near(y[50], 0, 1.6);
      assert_near(y[101], height, 1.6);
    }
}

// Two samples of 5 s have no middle that is neither.
static void test_a_block_of_few_samples_holds_no_hit(void**) {
  Log log = simulated_log(79, 400, false, 0);
  Rng rng(79, 0, 0, Stream::kTool);
  for (size_t i = 0; i < log.size(); ++i) log.t_s[i] *= 5, log.axes[0].rate_dph[i] = rng.normal();
  log.axes[0].rate_dph[200] += 1e6, log.axes[0].rate_dph[301] -= 1e6;
  const Campaign seconds = make_campaign({log}, "gx_dph", nominal_model());
  const VectorXd hits = hits_of(seconds).front();
  assert_int_equal((hits.array() != 0).count(), 2);
  assert_near(hits[200], 1e6, 5);
  assert_near(hits[301], -1e6, 5);
  const Campaign blocks = block_means(seconds, 10);
  for (double y : blocks.runs[0].input.rate_dph) assert_near(y, 0, 5);
}

// Rests, and a bias so steep that rows on a ramp are far from those before and after them: no hits, however many; one on the ramp is.
static void test_a_steep_ramp_holds_no_hits(void**) {
  Log log = simulated_log(79, 800, false, 0);
  Rng rng(79, 0, 0, Stream::kTool);
  const auto ramp = [](size_t row) { return 500.0 * std::clamp(static_cast<double>(row % 200) - 140, 0.0, 59.0); };
  for (size_t i = 0; i < log.size(); ++i) log.t_s[i] *= 14, log.axes[0].rate_dph[i] = ramp(i) + 15 * rng.normal();
  log.axes[0].rate_dph[371] += 1e4, log.axes[0].rate_dph[373] -= 2e4;
  const Campaign rows = make_campaign({log}, "gx_dph", nominal_model());
  const VectorXd hits = hits_of(rows).front();
  assert_int_equal((hits.array() != 0).count(), 2);
  assert_near(hits[371], 1e4, 600);
  assert_near(hits[373], -2e4, 600);
  const std::vector<double> y = block_means(rows, 14).runs[0].input.rate_dph;
  for (size_t i = 0; i < y.size(); ++i)
    if (i == 371 || i == 373)
      assert_false(std::isfinite(y[i])); // its place on the ramp would be a guess
    else
      assert_near(y[i], ramp(i), 75);
}

// What a run begins with may fade within a few seconds; a hit is gone with its sample.
static void test_what_fades_from_the_start_is_no_hit(void**) {
  for (const double kept : {0.68, 0.0}) {
    Log log = simulated_log(79, 4000, false, 0);
    double off_dph = 1000;
    for (size_t i = 0; i < 20; ++i) log.axes[0].rate_dph[i] += off_dph, off_dph *= kept;
    const Campaign seconds = make_campaign({log}, "gx_dph", nominal_model());
    assert_int_equal((hits_of(seconds).front().array() != 0).count(), kept > 0 ? 0 : 1);
  }
}

// However far the rate is from zero.
static void test_all_drop_outs_are_counted(void**) {
  for (const double level : {40.0, 80.0, 100.0, 300.0}) {
    Log log = simulated_log(78, 8000, false, 0);
    Rng rng(78, 0, 0, Stream::kTool);
    for (double& rate : log.axes[0].rate_dph) rate = level + 10 * rng.normal();
    for (size_t i = 70; i < 8000; i += 160) log.axes[0].rate_dph[i] = 0;
    Campaign campaign = make_campaign({log}, "gx_dph", nominal_model());
    const StructureResult found = find_structure(&campaign, nullptr, effect_library(), all_active());
    assert_int_equal(found.findings.size(), 1);
    assert_string_equal(found.findings[0].effect->name().c_str(), "held_samples");
    assert_near(found.findings[0].signature.parameters.number("probability"), 50.0 / 8000, 1e-12);
    assert_int_equal(found.n_dropouts, 0); // none beside the finding
    assert_int_equal(campaign.n(), 7950);
  }
  Log log = simulated_log(79, 8000, false, 0);
  for (double& rate : log.axes[0].rate_dph) rate += 3000;
  for (const size_t i : {70u, 900u, 7000u}) log.axes[0].rate_dph[i] = 0; // too few for a finding
  Campaign campaign = make_campaign({log}, "gx_dph", nominal_model());
  const StructureResult found = find_structure(&campaign, nullptr, effect_library(), all_active());
  assert_int_equal(found.findings.size(), 0);
  assert_int_equal(found.n_dropouts, 3);
}

// A band wider than the noise leaves most samples at zero, and the spread from second to second is then 0: zeros are no
// drop-outs for that.
static void test_a_band_wider_than_the_noise_is_a_dead_band(void**) {
  for (const double level_dph : {0.0, 12.0, -12.0})
    for (const double widths : {0.6, 1.1, 1.4}) {
      Log log = simulated_log(83, 8000, false, 0);
      Rng rng(83, 0, 0, Stream::kTool);
      const double band_dph = widths * 36 + std::fabs(level_dph);
      for (double& rate : log.axes[0].rate_dph) {
        rate = level_dph + 36 * rng.normal();
        if (std::fabs(rate) < band_dph) rate = 0;
      }
      Campaign campaign = make_campaign({log}, "gx_dph", nominal_model());
      const StructureResult found = find_structure(&campaign, nullptr, effect_library(), all_active());
      assert_int_equal(found.n_dropouts, 0);
      assert_int_equal(found.findings.size(), 1);
      assert_string_equal(found.findings[0].effect->name().c_str(), "dead_band");
      assert_near(found.findings[0].signature.parameters.number("width_dph") / band_dph, 1.0, 0.02);
    }
}

// Where the rate itself passes zero too: among rates of 0.01 dph an exact zero is no rate.
static void test_drop_outs_between_small_rates_are_counted(void**) {
  for (const double step_dph : {0.01, 20.0}) {
    std::vector<Log> logs;
    for (uint64_t k = 0; k < 3; ++k) {
      logs.push_back(simulated_log(80 + k, 8000, false, 0));
      for (double& rate : logs[k].axes[0].rate_dph) rate = step_dph * std::round(rate / step_dph);
    }
    std::vector<double>& rates = logs[2].axes[0].rate_dph;
    for (size_t i = 70; i < 8000; i += 500) rates[i] = 0; // too few for a finding
    const size_t n_zeros = static_cast<size_t>(std::count(rates.begin(), rates.end(), 0.0));
    Campaign campaign = make_campaign(logs, "gx_dph", nominal_model());
    const StructureResult found = find_structure(&campaign, nullptr, effect_library(), all_active());
    if (step_dph < 1) {
      assert_true(found.findings.empty());
      assert_int_equal(found.n_dropouts, n_zeros);
      assert_int_equal(campaign.n(), 24000 - n_zeros);
    } else {
      assert_true(n_zeros > 100 && campaign.n() > 24000 - 16); // most are rates
    }
  }
}

// One step for each log: a finding for each that matters, its logs, and its variance in their runs alone.
static void test_rounding_is_told_log_by_log(void**) {
  std::vector<Log> logs;
  for (const double step_dph : {1e-4, 60.0, 18.0, 60.0}) {
    logs.push_back(simulated_log(84 + logs.size(), 8000, false, 0));
    for (double& rate : logs.back().axes[0].rate_dph) rate = step_dph * std::round(rate / step_dph);
  }
  Campaign fitted = make_campaign({logs[0], logs[1], logs[2]}, "gx_dph", nominal_model());
  Campaign held_out = make_campaign({logs[3]}, "gx_dph", nominal_model());
  const StructureResult found = find_structure(&fitted, &held_out, effect_library(), all_active());
  assert_int_equal(found.findings.size(), 2);
  assert_near(found.findings[0].signature.parameters.number("lsb_dph"), 60, 1e-9);
  assert_string_equal(found.findings[0].logs.c_str(), "log 2, held-out log 1");
  assert_near(found.findings[1].signature.parameters.number("lsb_dph"), 18, 1e-9);
  assert_string_equal(found.findings[1].logs.c_str(), "log 3");
  const double expected_dph2[] = {0, 300, 27};
  for (size_t r = 0; r < 3; ++r) assert_near(fitted.runs[r].own_white_dph2, expected_dph2[r], 1e-6);
  assert_near(held_out.runs[0].own_white_dph2, 300, 1e-6);
  assert_int_equal(found.n_left_out, 0);
}

// A model is one of the device: a simulation would round all of its logs.
static void test_rounding_of_single_logs_is_not_in_the_written_model(void**) {
  for (const bool is_of_some_logs : {false, true}) {
    DiagnoseResult result;
    result.has_model = true, result.model = nominal_model();
    SelectedEffect rounding;
    rounding.term = term_of(&find_effect("quantization"), find_effect("quantization").estimator(), {});
    rounding.term.fixed_parameters = {{"lsb_dph", 60.0}};
    rounding.is_structural = true, rounding.is_of_some_logs = is_of_some_logs;
    result.axes.emplace_back();
    result.axes[0].study.selection.effects = {rounding};
    complete_model({"gx_dph"}, &result);
    assert_int_equal(result.model.effects.size(), is_of_some_logs ? 0 : 1);
  }
}

// Beside a free shape the polynomial may be any: the shape follows part of it.  What is written is fitted as it is written.
static void test_the_written_model_follows_the_logs_where_a_free_shape_was_found(void**) {
  const Reference& response = free_shapes()[2];
  for (const bool has_member : {true, false}) {
    DiagnoseResult result;
    AxisResult& axis = result.axes.emplace_back();
    axis.axis = "gx_dph";
    axis.campaign =
        make_campaign({simulated_log(3, 8000, false, 60), simulated_log(4, 6000, false, 60)}, axis.axis, {});
    Selection& said = axis.study.selection;
    said.final = nominal_hypothesis();
    said.final.terms = {term_of(nullptr, response.candidate.estimator, response.candidate.shapes[0])};
    axis.final_fit = fit_hypothesis(axis.campaign, said.final);
    SelectedEffect memory;
    memory.family = Family::kThermalMemory, memory.is_family = true, memory.doubt = Doubt::kShapeOpen;
    if (has_member)
      memory.term = term_of(&find_effect("thermal_hysteresis"), find_effect("thermal_hysteresis").estimator(), {5});
    said.effects = {memory};
    complete_model({"gx_dph"}, &result);
    assert_int_equal(result.model.effects.size(), has_member ? 1 : 0);
    if (has_member)
      assert_near(read_parameters(find_effect("thermal_hysteresis"), result.model.effects[0].parameters)
                      .number("amplitude_dph"),
                  60, 6);
    for (const double temp_degc : {5.0, 30.0, 55.0}) // a loop alone tilts it by 5 dph and more
      assert_near(result.model.bias->at(temp_degc) - result.model.bias->at(20), bias_dph(temp_degc) - bias_dph(20),
                  has_member ? 10 : 40);
    const bool warns = !result.model_warnings.empty();
    assert_true(warns == has_member);
  }
}

// Rates in steps of 36 dph: of a level of 20 dph most samples are equal to the one before, and zero is the next step.
static void test_zeros_of_coarse_rates_are_no_drop_outs(void**) {
  Log log = simulated_log(76, 8000, false, 0);
  Rng rng(76, 0, 0, Stream::kTool);
  for (double& rate : log.axes[0].rate_dph) rate = 36 * std::round((20 + 10 * rng.normal()) / 36);
  Campaign campaign = make_campaign({log}, "gx_dph", nominal_model());
  const StructureResult found = find_structure(&campaign, nullptr, effect_library(), all_active());
  assert_int_equal(found.n_dropouts, 0);
  for (const StructureFinding& f : found.findings) assert_string_not_equal(f.effect->name().c_str(), "held_samples");
  assert_int_equal(campaign.n(), 8000);
  // Halfway between two steps, beside logs in finer ones.
  std::vector<Log> logs = {simulated_log(77, 8000, false, 0), simulated_log(78, 8000, false, 0), log};
  for (double& rate : logs[2].axes[0].rate_dph) rate = 400 * std::round((200 + 36 * rng.normal()) / 400);
  campaign = make_campaign(logs, "gx_dph", nominal_model());
  assert_int_equal(find_structure(&campaign, nullptr, effect_library(), all_active()).n_dropouts, 0);
  // Of a level of 5 dph nearly all are zero.
  for (double& rate : log.axes[0].rate_dph) rate = 36 * std::round((5 + 7 * rng.normal()) / 36);
  campaign = make_campaign({log}, "gx_dph", nominal_model());
  for (const StructureFinding& f : find_structure(&campaign, nullptr, effect_library(), all_active()).findings)
    assert_string_not_equal(f.effect->name().c_str(), "held_samples");
}

static void test_short_bursts_are_told_from_single_hits(void**) {
  const Campaign campaign = make_campaign({simulated_log(23, 8000, false, 0)}, "gx_dph", nominal_model());
  std::vector<VectorXd> bursts = innovations_with_jumps(campaign, 0, 800), hits = bursts;
  Rng rng(9, 0, 0, Stream::kWhite);
  for (int burst = 0; burst < 12; ++burst)
    for (long k = 0; k < 8; ++k) {
      bursts[0][600 * burst + 100 + k] *= 3;
      hits[0][static_cast<long>(rng.uniform() * 7999)] *= 3;
    }
  assert_true(evidence_of_test(campaign, bursts, Rest::kBursts) > 0);
  assert_true(evidence_of_test(campaign, hits, Rest::kBursts) < 0);
}

// One held-out log over a triangle in temperature.  The answer knows a loop of 15 dph but for its size and a slow wander;
// the rates hold `noise_part` of the nominal noise.
struct KnownReduction {
  HeldOutUnit unit;
  NoiseModel noise;
  double shrinkage; // of the means without noise
};

static KnownReduction known_reduction(uint64_t seed, double noise_part) {
  KnownReduction out;
  const Campaign blocks =
      block_means(make_campaign({simulated_log(seed, 5000, false, 0)}, "gx_dph", nominal_model()), 10);
  HeldOutUnit& unit = out.unit;
  unit.run = blocks.runs[0];
  NoiseModel seconds = nominal_hypothesis().base_noise;
  seconds.white_sigma_dph *= noise_part, seconds.markov[0].sigma_dph *= noise_part;
  out.noise = block_equivalent(seconds, blocks.dt_s);
  const long n = static_cast<long>(unit.run.n());
  Rng rng(seed, 1, 0, Stream::kTool);
  const double size = 0.3 * rng.normal(), wander = 2 * rng.normal();
  VectorXd wrong(n);
  unit.change.resize(n), unit.left.resize(n);
  for (long k = 0; k < n; ++k) {
    const double part = static_cast<double>(k) / static_cast<double>(n);
    unit.change[k] = 15 * (part < 0.5 ? 1 : -1);
    wrong[k] = size * unit.change[k] + wander * std::cos(9 * part);
    unit.left[k] = rng.normal();
  }
  colour(compute_gains(unit.run, out.noise), unit.left.data(), static_cast<size_t>(n));
  unit.left += wrong;
  unit.starts.resize(n, 0);
  unit.shapes = powers(unit.run, unit.run.input.tn, 3);
  const auto spread = [](VectorXd x) { return (x.array() - x.mean()).matrix().squaredNorm(); };
  out.shrinkage = 1 - spread(wrong) / spread(wrong + unit.change);
  return out;
}

static void test_the_interval_of_one_held_out_log_holds_the_true_reduction(void**) {
  int n_inside = 0;
  double width = 0;
  for (uint64_t seed = 0; seed < 100; ++seed) {
    const KnownReduction known = known_reduction(seed, 0.5);
    const Reduction found = reduction_of({known.unit}, known.noise);
    assert_true(found.lo <= found.shrinkage && found.shrinkage <= found.hi && found.lo < found.hi);
    n_inside += found.lo <= known.shrinkage && known.shrinkage <= found.hi;
    width += (found.hi - found.lo) / 100;
  }
  // 87 and more: 95 % are 86 or fewer with a chance of 1 in 2000.
  if (n_inside < 87 || width > 0.4) fail_msg("%d of 100 inside, mean width %g", n_inside, width);
}

// Its first rows.
static HeldOutUnit cut(HeldOutUnit unit, long n) {
  for (size_t k = static_cast<size_t>(n); k < unit.run.n(); ++k)
    unit.run.input.rate_dph[static_cast<size_t>(unit.run.used[k])] = std::nan("");
  find_used(&unit.run);
  unit.left.conservativeResize(n), unit.change.conservativeResize(n);
  unit.starts.conservativeResize(n, Eigen::NoChange), unit.shapes.conservativeResize(n, Eigen::NoChange);
  return unit;
}

static void test_units_of_few_rows_or_none_change_no_interval(void**) {
  const KnownReduction known = known_reduction(3, 0.5);
  const Reduction one = reduction_of({known.unit}, known.noise);
  for (long n = 0; n < 4; ++n) {
    const Reduction two = reduction_of({known.unit, cut(known.unit, n)}, known.noise);
    assert_near(two.lo, one.lo, 0.05);
    assert_near(two.hi, one.hi, 0.05);
    const Reduction alone = reduction_of({cut(known.unit, n)}, known.noise);
    assert_true(alone.lo <= alone.shrinkage && alone.shrinkage <= alone.hi);
  }
}

static void test_noise_that_hides_the_gap_makes_the_interval_wide(void**) {
  double loud = 0, quiet = 0;
  for (uint64_t seed = 0; seed < 10; ++seed) {
    const KnownReduction a = known_reduction(seed, 4), b = known_reduction(seed, 0.05);
    const Reduction hidden = reduction_of({a.unit}, a.noise), clear = reduction_of({b.unit}, b.noise);
    loud += (hidden.hi - hidden.lo) / 10, quiet += (clear.hi - clear.lo) / 10;
  }
  if (!(loud > kWidestFigure && quiet < 0.1)) fail_msg("mean widths %g (loud) and %g (quiet)", loud, quiet);
  assert_true(reduction_of({}, nominal_hypothesis().base_noise).hi == 1);
}

// A log with noise of twice the strength says as little of the gap as if all noise were so strong.
static void test_a_loud_log_says_less_of_the_reduction(void**) {
  KnownReduction known = known_reduction(5, 0.5);
  const NoiseModel twice = with_factors(known.noise, std::vector<double>{std::log(2.0), std::log(4.0), 0}.data());
  NoiseModel louder = twice;
  louder.extra_white_dph2 *= 4;
  const Reduction expected = reduction_of({known.unit}, louder);
  known.unit.run.own_strength = 2;
  const Reduction found = reduction_of({known.unit}, known.noise);
  assert_near(found.lo, expected.lo, 1e-6);
  assert_near(found.hi, expected.hi, 1e-6);
}

static void test_a_coarse_thermometer_has_a_quiet_slope_up_to_the_ends(void**) {
  // Between two steps at the start and at the end: it shows now this, now that one.  Elsewhere it mostly stays as it is.
  Log log = simulated_log(121, 6000, false, 0);
  for (size_t i = 0; i < log.size(); ++i) {
    const double t = log.t_s[i], ramp = std::min(std::max(t - 600, 0.0), 4800.0) / 4800;
    log.temp_degc[i] = 10.125 + 40 * ramp + (i % 3 == 0 ? 0.01 : -0.01);
    log.temp_degc[i] = 0.25 * std::round(log.temp_degc[i] / 0.25);
  }
  const Campaign campaign = make_campaign({log}, "gx_dph", nominal_model());
  const Column& slope = campaign.runs[0].input.rate_degc_min;
  for (size_t i = 0; i < slope.size(); ++i)
    if (i < 300 || i + 300 >= slope.size()) assert_near(slope[i], 0, 0.15);
  assert_near(slope[slope.size() / 2], 0.5, 0.1);
}

static void test_levels_do_not_bend_the_mean(void**) {
  // The mean beside telegraph noise is as good as without it; under its Gaussian twin it is not.
  Log log = simulated_log(321, 6000, false, 0), plain = log;
  auto jumps = jumps_between_levels(321, 90, 300);
  for (double& rate : log.axes[0].rate_dph) rate += jumps(0, 0);
  const Campaign campaign = make_campaign({log}, "gx_dph", nominal_model());
  const auto with = [&](const char* name) {
    Term term;
    term.effect = &find_effect(name), term.estimator = term.effect->estimator(), term.shape = {45, 150};
    Hypothesis h = nominal_hypothesis();
    h.terms = {term};
    return fit_hypothesis(campaign, h);
  };
  const auto without = fit_hypothesis(make_campaign({plain}, "gx_dph", nominal_model()), nominal_hypothesis());
  const auto rms_off = [&](const Fit& fit) {
    VectorXd off = fit.residual[0] - without.residual[0];
    for (long k = 0; k < off.size(); ++k)
      off[k] -= log.axes[0].rate_dph[static_cast<size_t>(k)] - plain.axes[0].rate_dph[static_cast<size_t>(k)];
    return std::sqrt((off.array() - off.mean()).square().mean());
  };
  assert_true(rms_off(with("telegraph_noise")) < 3);
  assert_true(rms_off(with("second_markov")) > 6);
  assert_true(with("telegraph_noise").beta_covariance(1, 1) < 0.36 * with("second_markov").beta_covariance(1, 1));
}

static void test_noise_that_axes_share_is_told_from_slow_causes_of_both(void**) {
  const Log first = simulated_log(31, 5000, false, 0);
  Log other = simulated_log(32, 5000, true, 0);
  const auto rest_of = [](const Campaign& campaign, Fit* fit) {
    *fit = fit_hypothesis(campaign, nominal_hypothesis());
    return AxisRest{&campaign, fit, nominal_hypothesis().base_noise};
  };
  const Campaign a = make_campaign({first}, "gx_dph", nominal_model()),
                 b = make_campaign({other}, "gx_dph", nominal_model());
  Fit fit_a, fit_b;
  assert_true(shared_noise(rest_of(a, &fit_a), rest_of(b, &fit_b)).gain_nats < SelectorConstants().shared_nats);

  // 10 dph of common noise of opposite sign: covariance -100 dph^2.
  Campaign c = a, d = a;
  Rng rng(5, 0, 0, Stream::kWhite);
  for (size_t i = 0; i < c.runs[0].input.size(); ++i) {
    const double common = 10 * rng.normal();
    c.runs[0].input.rate_dph[i] += common;
    d.runs[0].input.rate_dph[i] = 36 * rng.normal() - common;
  }
  const SharedNoise found = shared_noise(rest_of(c, &fit_a), rest_of(d, &fit_b));
  assert_true(found.gain_nats > SelectorConstants().shared_nats && found.correlation < 0);
  assert_near(found.covariance_dph2, -100, 4 * 37 * 37 / std::sqrt(5000.0));

  // A slow cause on both, which no answer takes: not shared noise.
  for (Campaign* slow : {&c, &d})
    for (size_t i = 0; i < slow->runs[0].input.size(); ++i)
      slow->runs[0].input.rate_dph[i] =
          (slow == &c ? a : b).runs[0].input.rate_dph[i % 4500] + 60 * std::sin(2 * kPi * static_cast<double>(i) / 900);
  assert_true(shared_noise(rest_of(c, &fit_a), rest_of(d, &fit_b)).gain_nats < SelectorConstants().shared_nats);
}

// Of two logs one is stuck on x and has no temperature: only on x are the seconds of the other's stuck thermometer left out.
// The rows of both axes then differ, their seconds do not.
static void test_noise_is_shared_second_by_second_where_axes_leave_out_other_logs(void**) {
  std::vector<Log> logs = {simulated_log(41, 3000, false, 0), simulated_log(42, 3000, false, 0)};
  Rng rng(13, 0, 0, Stream::kTool);
  for (Log& log : logs) {
    log.axes.push_back(log.axes[0]), log.axes[1].name = "gy_dph";
    for (size_t i = 0; i < log.size(); ++i) {
      const double common = 25 * rng.normal();
      log.axes[0].rate_dph[i] += common, log.axes[1].rate_dph[i] = 36 * rng.normal() + common;
    }
  }
  for (double& degc : logs[1].temp_degc) degc += 0.01 * rng.normal();
  stick(&logs[1].temp_degc, 300, 700);
  logs[0].temp_degc.assign(logs[0].size(), std::nan(""));
  logs[0].axes[0].rate_dph.assign(logs[0].size(), 7);
  const Campaign x = make_campaign(logs, "gx_dph", nominal_model()), y = make_campaign(logs, "gy_dph", nominal_model());
  assert_int_equal(x.runs.size(), 1);
  assert_int_equal(x.runs[0].input.log, 1);
  assert_int_equal(x.left_out.size(), 1);
  assert_int_equal(x.left_out[0].log, 0);
  assert_int_equal(y.runs.size(), 2);
  assert_true(x.has_temperature && !y.has_temperature && x.runs[0].n() + 399 == y.runs[1].n());
  Hypothesis noise = nominal_hypothesis();
  noise.base_noise.white_sigma_dph = 44;
  const Fit fit_x = fit_hypothesis(x, noise), fit_y = fit_hypothesis(y, noise);
  const SharedNoise found = shared_noise({&x, &fit_x, noise.base_noise}, {&y, &fit_y, noise.base_noise});
  assert_int_equal(found.n, x.runs[0].n());
  assert_true(found.correlation > 0.2);
}

// A lag of next to nothing predicts what no lag does, although its polynomial is made anew.
static void test_a_polynomial_at_another_temperature_is_the_same_on_a_part_of_a_log(void**) {
  const Campaign campaign = make_campaign({simulated_log(81, 6000, false, 0)}, "gx_dph", nominal_model());
  const SlowData data(block_means(campaign, block_length_s(campaign)));
  SlowSearch search(data, nothing_believed(), effect_library(), all_active(), {});
  const SlowModel null = search.run().null;
  SlowModel lag = search.best_with({&find_effect("thermal_lag")});
  assert_int_equal(lag.names.size(), 1);
  lag.take_noise_of(null);
  lag.names[0].shape[0] = 1e-3;
  assert_near(predicted_nats(search, data, nullptr, lag), predicted_nats(search, data, nullptr, null), 0.05);
}

// The first and the last log rest where the normalised temperature is zero.
static void test_a_log_between_logs_at_rest_tells_the_polynomial(void**) {
  std::vector<Log> logs;
  for (uint64_t seed = 83; seed < 86; ++seed) logs.push_back(simulated_log(seed, 3000, false, 0));
  for (const size_t i : {0u, 2u})
    for (double& temp : logs[i].temp_degc) temp = 30;
  const Campaign campaign = make_campaign(logs, "gx_dph", nominal_model());
  const SlowData data(block_means(campaign, block_length_s(campaign)));
  const RunGrams::Posterior at = RunGrams(data, {}, nominal_hypothesis().base_noise).posterior();
  // The curve spans 600 dph; noise of 23 dph in ten seconds is left.
  assert_true(residual_of(data, {}, at, 1).cwiseAbs().maxCoeff() < 100);
}

static void test_curvature_gives_the_errors_of_a_gaussian(void**) {
  // Standard deviations 0.3 and 20, correlation 0.8; a step of a tenth of the value is far from either.
  const auto f = [](const Theta& x) {
    const double a = (x[0] - 5) / 0.3, b = (x[1] - 100) / 20;
    return -0.5 * (a * a - 1.6 * a * b + b * b) / (1 - 0.64);
  };
  const Theta errors = curvature_errors(f, {5, 100}, {0, 0}, {1000, 1000});
  assert_near(errors[0], 0.3, 1e-6);
  assert_near(errors[1], 20, 1e-4);
  // A bound that is far away says nothing of the step.
  const auto narrow = [](const Theta& x) { return -0.5 * std::pow((x[0] - 5) / 0.002, 2); };
  assert_near(curvature_errors(narrow, {5}, {-250}, {2000})[0], 0.002, 1e-6);
  const auto wings = [](const Theta& x) { return -0.5 * std::log1p(std::pow((x[0] - 5) / 0.002, 2)); };
  assert_near(curvature_errors(wings, {5}, {-250}, {2000})[0], 0.003,
              0.001); // it depends on the step: 0.6 to 1.7 errors
  // On a bound, and where the likelihood does not fall off: no error rather than a wrong one.
  assert_true(std::isnan(curvature_errors(f, {5, 100}, {5, 0}, {1000, 1000})[0]));
  assert_true(std::isnan(curvature_errors([](const Theta&) { return 1.0; }, {5}, {0}, {9})[0]));
}

int main() {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_likelihood_equals_that_of_the_dense_gaussian_with_gaps),
      cmocka_unit_test(test_whitening_and_colouring_are_inverse),
      cmocka_unit_test(test_mixtures_reduce_to_the_gaussian),
      cmocka_unit_test(test_steps_count_seconds_and_not_rows),
      cmocka_unit_test(test_decomposition_adds_up),
      cmocka_unit_test(test_smallest_detectable_size_has_the_strength_that_is_stated),
      cmocka_unit_test(test_marginal_likelihood_equals_that_of_the_dense_gaussian),
      cmocka_unit_test(test_gains_of_steps_are_those_of_steps_in_the_mean),
      cmocka_unit_test(test_scan_scores_are_those_of_the_marginal_likelihood),
      cmocka_unit_test(test_block_noise_has_the_covariance_of_block_means),
      cmocka_unit_test(test_noise_of_minutes_is_that_of_their_length),
      cmocka_unit_test(test_variance_of_samples_is_theirs_at_any_step),
      cmocka_unit_test(test_blocks_hold_telegraph_noise_by_its_covariance),
      cmocka_unit_test(test_every_constant_of_the_selector_is_listed_once),
      cmocka_unit_test(test_constants_that_are_handed_down_decide),
      cmocka_unit_test(test_draws_of_the_fitted_noise_seldom_exceed_the_threshold),
      cmocka_unit_test(test_the_tail_of_chance_is_that_of_the_draws),
      cmocka_unit_test(test_draws_of_another_kind_of_slow_noise_gain_more),
      cmocka_unit_test(test_a_jump_must_gain_more_at_a_lower_rate),
      cmocka_unit_test(test_gram_of_wide_columns_is_that_of_whitened_ones),
      cmocka_unit_test(test_a_transform_is_the_sum_it_stands_for),
      cmocka_unit_test(test_powers_of_two_sequences_are_those_of_each),
      cmocka_unit_test(test_a_line_that_drifts_with_temperature_is_found_as_one),
      cmocka_unit_test(test_a_line_that_drifts_between_two_slopes_of_the_grid_is_found),
      cmocka_unit_test(test_a_line_is_placed_between_the_places_of_the_grid),
      cmocka_unit_test(test_a_line_of_the_temperature_is_known),
      cmocka_unit_test(test_a_short_log_hides_no_line_of_the_temperature),
      cmocka_unit_test(test_a_tone_with_phases_of_its_own_is_not_of_the_temperature),
      cmocka_unit_test(test_a_strong_line_in_many_logs_has_a_finite_gain),
      cmocka_unit_test(test_lines_of_several_logs_add_up),
      cmocka_unit_test(test_gains_run_by_run_are_those_of_each_run),
      cmocka_unit_test(test_rounding_of_one_run_is_noise_of_that_run),
      cmocka_unit_test(test_sudden_changes_show_in_smoothed_moments_and_noise_does_not),
      cmocka_unit_test(test_a_flat_spectrum_is_flat_whatever_the_lengths_of_the_logs),
      cmocka_unit_test(test_bursts_are_not_noise_of_another_size),
      cmocka_unit_test(test_a_block_holds_the_share_of_a_jump_and_no_hit),
      cmocka_unit_test(test_a_block_of_few_samples_holds_no_hit),
      cmocka_unit_test(test_a_steep_ramp_holds_no_hits),
      cmocka_unit_test(test_what_fades_from_the_start_is_no_hit),
      cmocka_unit_test(test_all_drop_outs_are_counted),
      cmocka_unit_test(test_a_band_wider_than_the_noise_is_a_dead_band),
      cmocka_unit_test(test_drop_outs_between_small_rates_are_counted),
      cmocka_unit_test(test_rounding_is_told_log_by_log),
      cmocka_unit_test(test_rounding_of_single_logs_is_not_in_the_written_model),
      cmocka_unit_test(test_the_written_model_follows_the_logs_where_a_free_shape_was_found),
      cmocka_unit_test(test_zeros_of_coarse_rates_are_no_drop_outs),
      cmocka_unit_test(test_a_polynomial_at_another_temperature_is_the_same_on_a_part_of_a_log),
      cmocka_unit_test(test_a_log_between_logs_at_rest_tells_the_polynomial),
      cmocka_unit_test(test_short_bursts_are_told_from_single_hits),
      cmocka_unit_test(test_the_interval_of_one_held_out_log_holds_the_true_reduction),
      cmocka_unit_test(test_units_of_few_rows_or_none_change_no_interval),
      cmocka_unit_test(test_a_loud_log_says_less_of_the_reduction),
      cmocka_unit_test(test_noise_that_hides_the_gap_makes_the_interval_wide),
      cmocka_unit_test(test_a_coarse_thermometer_has_a_quiet_slope_up_to_the_ends),
      cmocka_unit_test(test_slopes_beside_missing_rows_are_those_of_the_temperature),
      cmocka_unit_test(test_slopes_do_not_reach_across_a_long_gap),
      cmocka_unit_test(test_whittaker_solves_its_normal_equations),
      cmocka_unit_test(test_a_thermometer_is_as_coarse_in_one_log_as_in_six),
      cmocka_unit_test(test_a_chamber_s_cycle_and_corners_stay_in_the_smoothed_temperature),
      cmocka_unit_test(test_a_stuck_thermometer_is_found_with_its_seconds),
      cmocka_unit_test(test_a_soak_is_no_stuck_thermometer),
      cmocka_unit_test(test_thermometers_that_mostly_rest_are_not_stuck),
      cmocka_unit_test(test_seconds_of_a_stuck_thermometer_are_as_if_missing),
      cmocka_unit_test(test_levels_do_not_bend_the_mean),
      cmocka_unit_test(test_noise_that_axes_share_is_told_from_slow_causes_of_both),
      cmocka_unit_test(test_noise_is_shared_second_by_second_where_axes_leave_out_other_logs),
      cmocka_unit_test(test_curvature_gives_the_errors_of_a_gaussian),
  };
  return cmocka_run_group_tests_name("diagnose", tests, nullptr, nullptr);
}
