// SPDX-License-Identifier: MIT
#include "analysis/diagnose/bank.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/units.h"

namespace imucal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kBlocks = 2800; // blocks wanted in all
constexpr double kSlope = 0.15;
constexpr size_t kModelsKept = 3;
constexpr long kCosinesPerRun = 13;
constexpr long kMostRunsApart = 12; // more runs: no test of each by itself
constexpr int kDegree = 6;          // of the free polynomial in temperature and time

double hat(double z) {
  return std::max(0.0, 1.0 - std::fabs(z));
}

// T_0 .. T_degree at x in [-1, 1].
void chebyshev(double x, int degree, double* t) {
  x = std::clamp(x, -1.0, 1.0);
  t[0] = 1, t[1] = x;
  for (int i = 2; i <= degree; ++i) t[i] = 2 * x * t[i - 1] - t[i - 2];
}

bool is_same(const NoiseModel& a, const NoiseModel& b) {
  const auto values = [](const NoiseModel& n) {
    return std::array<double, 9>{n.white_sigma_dph,  n.walk_dph_per_rt_s, n.white_slope,   n.markov_slope, n.tau_slope,
                                 n.extra_white_dph2, n.hit_probability,   n.hit_sigma_dph, n.telegraph_dph};
  };
  return values(a) == values(b) && a.telegraph_tau_s == b.telegraph_tau_s &&
         std::equal(a.markov.begin(), a.markov.end(), b.markov.begin(), b.markov.end(),
                    [](const Markov& x, const Markov& y) { return x.sigma_dph == y.sigma_dph && x.tau_s == y.tau_s; });
}

MatrixXd side_by_side(const std::vector<MatrixXd>& parts, long rows) {
  long cols = 0;
  for (const MatrixXd& m : parts) cols += m.cols();
  MatrixXd out(rows, cols);
  long first = 0;
  for (const MatrixXd& m : parts) {
    out.middleCols(first, m.cols()) = m;
    first += m.cols();
  }
  return out;
}

} // namespace

ColumnBank::ColumnBank(const Campaign& campaign, const std::vector<const Effect*>& library)
    : campaign_(campaign), library_(library), shapes_(library.size()), raw_(library.size()) {
  block_ = static_cast<long>(std::clamp(static_cast<double>(campaign.n()) / kBlocks, 4.0, 64.0));
  first_block_ = {0};
  for (const CampaignRun& run : campaign.runs)
    first_block_.push_back(first_block_.back() + (static_cast<long>(run.n()) + block_ - 1) / block_);
  const RunInput& first = campaign.runs.front().input;
  for (size_t j = 0; j < library.size(); ++j) {
    if (!can_score(j)) continue;
    const EffectEstimator& estimator = *library[j]->estimator();
    const Form form = estimator.form();
    if (form == Form::kColumns || form == Form::kTemperature)
      shapes_[j] = estimator.grid_on(first, campaign.lo_degc, campaign.hi_degc);
    if (form == Form::kTemperature) {
      if (campaign.order < 1) shapes_[j].clear();
      if (estimator.concerns_coarse_thermometer()) {
        shapes_[j].clear();
        if (campaign.order > 0 && campaign.temp_lsb_degc > 0) shapes_[j] = {{campaign.temp_lsb_degc}};
      }
    }
    if (form == Form::kRunRandom && campaign.runs.size() > 1) shapes_[j] = {Theta{}};
    if (shapes_[j].empty()) continue;
    for (const CampaignRun& run : campaign.runs) {
      std::vector<MatrixXd> parts;
      for (const Theta& shape : shapes_[j])
        parts.push_back(
            form == Form::kTemperature
                ? powers(run, normalised(run.input, estimator.temperature(run.input, shape)), campaign.order)
                : used_rows(run, estimator.columns(run.input, shape)));
      raw_[j].push_back(side_by_side(parts, static_cast<long>(run.n())));
    }
  }
}

bool ColumnBank::can_score(size_t effect) const {
  const EffectEstimator* estimator = library_[effect]->estimator();
  return estimator && (campaign_.has_temperature || !estimator->needs_temperature());
}

void ColumnBank::reduce_run(size_t run, const MatrixXd& white, MatrixXd* out) const {
  const long n = white.rows();
  for (long c = 0; c < white.cols(); ++c) {
    const double* x = white.data() + c * n;
    for (long k = 0, row = first_block_[run]; k < n; k += block_, ++row) {
      const long end = std::min(n, k + block_);
      double sum = 0;
      for (long i = k; i < end; ++i) sum += x[i];
      (*out)(row, c) = sum / std::sqrt(static_cast<double>(end - k));
    }
  }
}

VectorXd ColumnBank::reduce(const std::vector<VectorXd>& e) const {
  MatrixXd out(n_blocks(), 1);
  for (size_t r = 0; r < e.size(); ++r) reduce_run(r, e[r], &out);
  return out;
}

MatrixXd ColumnBank::whiten_and_reduce(const std::vector<RunGains>& gains, std::vector<MatrixXd> columns) const {
  MatrixXd out = MatrixXd::Zero(n_blocks(), columns.front().cols());
  for (size_t r = 0; r < columns.size(); ++r) {
    whiten(gains[r], &columns[r]);
    reduce_run(r, columns[r], &out);
  }
  return out;
}

// Columns of the free means, for all runs.
void ColumnBank::evaluate_tests() {
  tests_.assign(kMeanTests, {});
  const double lo = campaign_.lo_degc, span = std::max(1e-9, campaign_.hi_degc - lo);
  double longest = 0;
  for (const CampaignRun& run : campaign_.runs) longest = std::max(longest, run.input.t_s.back());
  for (const CampaignRun& run : campaign_.runs) {
    const RunInput& in = run.input;
    const long n = static_cast<long>(run.n());
    const auto row = [&](long k) { return static_cast<size_t>(run.used[static_cast<size_t>(k)]); };
    const auto add = [&](Generic test, long cols) -> MatrixXd& {
      tests_[test].push_back(MatrixXd::Zero(n, cols));
      return tests_[test].back();
    };
    if (campaign_.has_temperature) {
      MatrixXd& temp = add(kTemp, 22);
      MatrixXd& direction = add(kTempDir, 33);
      MatrixXd& transient = add(kTransient, 11);
      for (long k = 0; k < n; ++k) {
        const size_t i = row(k);
        const double at = (in.smooth_degc[i] - lo) / span, rate = in.rate_degc_min[i];
        for (long c = 0; c < 22; ++c) temp(k, c) = hat(at * 21 - static_cast<double>(c));
        const long first = std::fabs(rate) < 0.05 ? 11 : rate > 0 ? 22 : 0;
        for (long c = 0; c < 11; ++c) direction(k, first + c) = hat(at * 10 - static_cast<double>(c));
        for (long c = 0; c < 11; ++c) {
          const size_t back = static_cast<size_t>(kDelays_s[c] / in.dt_s);
          if (i >= back) transient(k, c) = in.rate_degc_min[i - back];
        }
      }
      MatrixXd& both = add(kTempTime, (kDegree + 1) * (kDegree + 2) / 2 - 1 + 4);
      double tx[kDegree + 1], tt[kDegree + 1];
      for (long k = 0; k < n; ++k) {
        const size_t i = row(k);
        chebyshev(2 * (in.smooth_degc[i] - lo) / span - 1, kDegree, tx);
        chebyshev(2 * in.t_s[i] / longest - 1, kDegree, tt);
        long c = 0;
        for (int a = 0; a <= kDegree; ++a)
          for (int b = 0; a + b <= kDegree; ++b)
            if (a + b > 0) both(k, c++) = tx[a] * tt[b];
        for (int a = 0; a <= 3; ++a) both(k, c++) = in.rate_degc_min[i] * tx[a];
      }
    }
    MatrixXd& time = add(kTime, 20);
    for (long k = 0; k < n; ++k)
      for (long c = 0; c < 20; ++c) time(k, c) = hat(in.t_s[row(k)] / longest * 19 - static_cast<double>(c));
  }
}

void ColumnBank::whiten_tests(WhitenedColumns* out) const {
  out->tests.assign(kMeanTests, MatrixXd());
  for (size_t g = 0; g < kMeanTests; ++g)
    if (!tests_[g].empty()) out->tests[g] = whiten_and_reduce(out->gains, tests_[g]);
  // Slow changes within each run: cosines over the run; the columns of different runs do not overlap.
  const long n_runs = static_cast<long>(campaign_.runs.size());
  if (n_runs > kMostRunsApart) return;
  MatrixXd z = MatrixXd::Zero(n_blocks(), kCosinesPerRun * n_runs);
  for (size_t r = 0; r < campaign_.runs.size(); ++r) {
    const long n = static_cast<long>(campaign_.runs[r].n());
    MatrixXd c(n, kCosinesPerRun);
    for (long k = 0; k < kCosinesPerRun; ++k)
      for (long i = 0; i < n; ++i)
        c(i, k) = std::cos(kPi * static_cast<double>(k + 1) * (static_cast<double>(i) + 0.5) / static_cast<double>(n));
    whiten(out->gains[r], &c);
    MatrixXd one = MatrixXd::Zero(n_blocks(), kCosinesPerRun);
    reduce_run(r, c, &one);
    z.middleCols(static_cast<long>(r) * kCosinesPerRun, kCosinesPerRun) = one;
  }
  out->tests[kByRun] = std::move(z);
}

// The response from the settled filter: a step in the middle of a run twice as long would be exact; the
// transient of the start is over after the first third of any run of use.
void ColumnBank::step_responses(WhitenedColumns* out) const {
  for (size_t r = 0; r < campaign_.runs.size(); ++r) {
    const long nb = first_block_[r + 1] - first_block_[r], n = static_cast<long>(campaign_.runs[r].n());
    const long start = block_ * (nb / 3);
    VectorXd h = VectorXd::Zero(n);
    h.tail(n - start).setOnes();
    whiten(out->gains[r], h.data(), static_cast<size_t>(n));
    const long nr = nb - nb / 3;
    VectorXd response = VectorXd::Zero(nb);
    for (long b = 0; b < nr; ++b) {
      const long k = start + b * block_, end = std::min(n, k + block_);
      if (end > k) response[b] = h.segment(k, end - k).sum() / std::sqrt(static_cast<double>(end - k));
    }
    if (nr > 2) response.tail(nb - nr + 1).setConstant(response[nr - 2]);
    out->step.push_back(response);
  }
}

std::shared_ptr<WhitenedColumns> ColumnBank::whiten_all(const NoiseModel& gaussian) const {
  auto out = std::make_shared<WhitenedColumns>();
  for (const CampaignRun& run : campaign_.runs) {
    out->gains.push_back(compute_gains(run, gaussian));
    out->sum_log_s += out->gains.back().sum_log_s;
  }
  out->candidates.resize(library_.size());
  for (size_t j = 0; j < library_.size(); ++j) {
    if (!can_score(j)) continue;
    const EffectEstimator& estimator = *library_[j]->estimator();
    if (!raw_[j].empty() && estimator.form() == Form::kRunRandom) {
      const long width = raw_[j].front().cols(), n_runs = static_cast<long>(campaign_.runs.size());
      MatrixXd z = MatrixXd::Zero(n_blocks(), width * n_runs);
      for (size_t r = 0; r < campaign_.runs.size(); ++r) {
        MatrixXd own = raw_[j][r], one = MatrixXd::Zero(n_blocks(), width);
        whiten(out->gains[r], &own);
        reduce_run(r, own, &one);
        z.middleCols(static_cast<long>(r) * width, width) = one;
      }
      out->candidates[j] = std::move(z);
    } else if (!raw_[j].empty()) {
      out->candidates[j] = whiten_and_reduce(out->gains, raw_[j]);
    } else if (campaign_.has_temperature && estimator.form() == Form::kNoise && !estimator.is_logarithmic()) {
      WhitenedColumns::Slope slope;
      slope.candidate = j;
      slope.h = kSlope;
      for (const CampaignRun& run : campaign_.runs) {
        slope.minus.push_back(compute_gains(run, estimator.noise(gaussian, {-slope.h})));
        slope.plus.push_back(compute_gains(run, estimator.noise(gaussian, {slope.h})));
      }
      out->slopes.push_back(std::move(slope));
    }
  }
  step_responses(out.get());
  return out;
}

std::shared_ptr<const WhitenedColumns> ColumnBank::under(const NoiseModel& gaussian, bool with_tests) {
  auto at = std::find_if(kept_.begin(), kept_.end(), [&](const Kept& k) { return is_same(k.noise, gaussian); });
  if (at == kept_.end()) {
    if (kept_.size() == kModelsKept) kept_.erase(kept_.begin());
    kept_.push_back({gaussian, whiten_all(gaussian)});
    at = kept_.end() - 1;
  }
  if (with_tests && at->columns->tests.empty()) {
    if (tests_.empty()) evaluate_tests();
    whiten_tests(at->columns.get());
  }
  return at->columns;
}

} // namespace imucal
