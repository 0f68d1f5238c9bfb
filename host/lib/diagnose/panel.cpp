// SPDX-License-Identifier: MIT
#include "diagnose/panel.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <unsupported/Eigen/FFT>

#include "base/units.h"
#include "diagnose/spectrum.h"

namespace imucal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kBlocks = 2800; // blocks wanted in all
constexpr double kSlowestTone_hz = 1.0 / 500;
constexpr int kStepMargin_s = 100; // a step this close to an end of a run cannot be told from the constant
constexpr double kAbsorbed = 1e-5; // energy left after projection below which a column is taken as absorbed

enum Generic {
  kTemp,
  kTempDir,
  kTime,
  kTempTime,
  kByRun,
  kTransient,
  kPsd,
  kVarTemp,
  kVarRun,
  kDist,
  kVol,
  kAsym,
  kGenerics
};

// Columns that belong to one candidate or test: after construction orthonormal and free of the design.
struct Group {
  MatrixXd basis;
  Theta shape;
};

double half_energy(const MatrixXd& basis, const VectorXd& e) {
  return 0.5 * (basis.transpose() * e).squaredNorm();
}

// Orthonormal basis of the columns, those that depend on the others left out.  `energy`: squared norms before
// the design was projected out.
MatrixXd orthonormal(const MatrixXd& columns, const VectorXd& energy) {
  MatrixXd scaled = columns;
  for (long c = 0; c < scaled.cols(); ++c) scaled.col(c) *= energy[c] > 0 ? 1.0 / std::sqrt(energy[c]) : 0.0;
  Eigen::ColPivHouseholderQR<MatrixXd> qr(scaled);
  long rank = 0;
  while (rank < std::min(scaled.rows(), scaled.cols()) && std::pow(qr.matrixQR()(rank, rank), 2) > kAbsorbed)
    ++rank;
  MatrixXd basis = MatrixXd::Identity(scaled.rows(), rank);
  basis.applyOnTheLeft(qr.householderQ().setLength(std::min(scaled.rows(), scaled.cols())));
  return basis;
}

double hat(double z) {
  return std::max(0.0, 1.0 - std::fabs(z));
}

} // namespace

const std::vector<std::string>& generic_names() {
  static const std::vector<std::string> names = {"temperature",
                                                 "temperature_and_direction",
                                                 "time_in_log",
                                                 "temperature_and_time",
                                                 "within_each_log",
                                                 "delayed_temperature",
                                                 "spectrum",
                                                 "variance_over_temperature",
                                                 "variance_over_time",
                                                 "distribution",
                                                 "bursts",
                                                 "asymmetry"};
  return names;
}

std::string generic_statement(size_t generic) {
  static const char* const texts[kGenerics] = {
      "a mean that follows temperature and that the polynomial does not",
      "a mean that depends on temperature and on the direction of its change",
      "a mean that follows the time since the start of the log",
      "a mean that depends on temperature and time together",
      "slow changes of the mean that differ from log to log",
      "a mean that follows earlier changes of temperature",
      "noise of another spectrum than the model's",
      "noise of a strength that depends on temperature",
      "noise of a strength that changes with time",
      "noise that is not Gaussian",
      "noise that comes in bursts",
      "noise that is not symmetric"};
  return texts[generic];
}

struct Panel::Impl {
  const Campaign& campaign;
  Hypothesis hypothesis;
  std::vector<const Effect*> library;
  bool with_generic;
  NoiseModel noise; // Gaussian equivalent of the hypothesis'
  std::vector<RunGains> gains;
  size_t block = 12;
  std::vector<long> first_block; // per run, and the end
  MatrixXd design;               // orthonormal, reduced
  std::vector<MatrixXd> full;    // orthonormal whitened design at full rate, per run
  VectorXd null_signal;          // coefficients of the nominal polynomial in `design`

  std::vector<std::vector<Group>> groups;    // per library effect: kColumns
  std::vector<std::vector<Group>> replacing; // per library effect: kTemperature, whole designs
  std::vector<MatrixXd> replaced_cross;      // not stored: see gain_replaced
  struct Random {
    MatrixXd basis;  // reduced columns of all runs
    VectorXd values; // eigenvalues of their Gram matrix
    MatrixXd vectors;
  };
  std::vector<Random> random;
  int random_of = -1;
  struct Steps {
    VectorXd response;          // reduced whitened step, from its block on
    std::vector<double> energy; // per start block, after projection; 0: not allowed
  };
  std::vector<Steps> steps;
  std::vector<MatrixXd> generic; // bases of the mean tests
  std::vector<SpectrumBins> bins;
  RunGains minus_gains, plus_gains;
  struct Slope {
    size_t candidate;
    double h;
    std::vector<RunGains> minus, plus;
  };
  std::vector<Slope> slopes;
  double base_log_s = 0;

  Impl(const Campaign& c, const Hypothesis& h, const std::vector<const Effect*>& l, bool g)
      : campaign(c), hypothesis(h), library(l), with_generic(g) {}

  long n_blocks() const { return first_block.back(); }

  void layout() {
    block = static_cast<size_t>(std::clamp(static_cast<double>(campaign.n()) / kBlocks, 4.0, 64.0));
    first_block = {0};
    for (const CampaignRun& run : campaign.runs)
      first_block.push_back(first_block.back() + static_cast<long>((run.n() + block - 1) / block));
  }

  // Block sums over sqrt(length) of whitened columns of run r, into rows of `out`.
  void reduce_run(size_t r, const MatrixXd& white, MatrixXd* out) const {
    const long n = white.rows(), b = static_cast<long>(block);
    for (long c = 0; c < white.cols(); ++c) {
      const double* x = white.data() + c * n;
      for (long k = 0, row = first_block[r]; k < n; k += b, ++row) {
        const long end = std::min(n, k + b);
        double sum = 0;
        for (long i = k; i < end; ++i) sum += x[i];
        (*out)(row, c) = sum / std::sqrt(static_cast<double>(end - k));
      }
    }
  }
  VectorXd reduce(const std::vector<VectorXd>& e) const {
    MatrixXd out(n_blocks(), 1);
    for (size_t r = 0; r < e.size(); ++r) reduce_run(r, e[r], &out);
    return out;
  }
  MatrixXd whiten_and_reduce(const std::vector<MatrixXd>& columns) const {
    MatrixXd out = MatrixXd::Zero(n_blocks(), columns.front().cols());
    for (size_t r = 0; r < columns.size(); ++r) {
      MatrixXd white = columns[r];
      whiten(gains[r], &white);
      reduce_run(r, white, &out);
    }
    return out;
  }
  void project(MatrixXd* columns) const { *columns -= design * (design.transpose() * *columns); }

  void build_design() {
    NoiseModel gaussian = hypothesis.noise();
    gaussian.hit_probability = 0;
    if (gaussian.telegraph_dph > 0)
      gaussian.markov.push_back({gaussian.telegraph_dph, gaussian.telegraph_tau_s});
    gaussian.telegraph_dph = 0;
    noise = gaussian;
    for (const CampaignRun& run : campaign.runs) {
      gains.push_back(compute_gains(run, gaussian));
      base_log_s += gains.back().sum_log_s;
    }
    const Design d = make_design(campaign, hypothesis);
    const MatrixXd reduced = whiten_and_reduce(d.x);
    design = orthonormal(reduced, reduced.colwise().squaredNorm().transpose());
    if (campaign.order > 0) {
      const long first = static_cast<long>(campaign.runs.size());
      VectorXd coefficients = VectorXd::Zero(campaign.order);
      for (int i = 0; i < campaign.order && i + 1 < static_cast<int>(campaign.coeff_dph.size()); ++i)
        coefficients[i] = campaign.coeff_dph[static_cast<size_t>(i) + 1];
      null_signal = design.transpose() * (reduced.middleCols(first, campaign.order) * coefficients);
    }
    // Full rate, for the projection of null draws.
    const long p = static_cast<long>(d.cols());
    for (size_t r = 0; r < d.x.size(); ++r) {
      MatrixXd white = d.x[r];
      whiten(gains[r], &white);
      full.push_back(white);
    }
    VectorXd scale = VectorXd::Zero(p);
    for (const MatrixXd& w : full) scale += w.colwise().squaredNorm().transpose();
    for (long c = 0; c < p; ++c) scale[c] = scale[c] > 0 ? 1 / std::sqrt(scale[c]) : 0;
    // Gram-Schmidt by QR, run after run, then the inverse triangle.
    MatrixXd top = MatrixXd::Zero(p, p);
    for (const MatrixXd& w : full) {
      MatrixXd stack(p + w.rows(), p);
      stack << top, w * scale.asDiagonal();
      Eigen::HouseholderQR<Eigen::Ref<MatrixXd>> qr(stack);
      top = MatrixXd(stack.topRows(p).triangularView<Eigen::Upper>());
    }
    Eigen::ColPivHouseholderQR<MatrixXd> qr(top);
    qr.setThreshold(1e-8);
    const long rank = qr.rank();
    const MatrixXd inverse = qr.matrixQR()
                                 .topLeftCorner(rank, rank)
                                 .triangularView<Eigen::Upper>()
                                 .solve(MatrixXd::Identity(rank, rank));
    const MatrixXd transform =
        scale.asDiagonal() * (qr.colsPermutation() * MatrixXd::Identity(p, p)).leftCols(rank) * inverse;
    for (MatrixXd& w : full) w = w * transform;
  }

  std::vector<MatrixXd> gathered(const std::vector<std::vector<Column>>& per_run) const {
    std::vector<MatrixXd> out;
    for (size_t r = 0; r < per_run.size(); ++r) {
      const CampaignRun& run = campaign.runs[r];
      MatrixXd m(static_cast<long>(run.n()), static_cast<long>(per_run[r].size()));
      for (size_t c = 0; c < per_run[r].size(); ++c)
        for (size_t k = 0; k < run.n(); ++k)
          m(static_cast<long>(k), static_cast<long>(c)) = per_run[r][c][static_cast<size_t>(run.used[k])];
      out.push_back(std::move(m));
    }
    return out;
  }

  bool can_score(const Effect& effect) const {
    const EffectEstimator* estimator = effect.estimator();
    return estimator && (campaign.has_temperature || !estimator->needs_temperature());
  }

  void build_columns() {
    groups.assign(library.size(), {});
    replacing.assign(library.size(), {});
    for (size_t j = 0; j < library.size(); ++j) {
      if (!can_score(*library[j])) continue;
      const EffectEstimator& estimator = *library[j]->estimator();
      if (estimator.form() == Form::kColumns) build_mean(j, estimator);
      if (estimator.form() == Form::kTemperature) build_replacing(j, estimator);
      if (estimator.form() == Form::kRunRandom && campaign.runs.size() > 1) build_random(j, estimator);
    }
  }
  void build_mean(size_t j, const EffectEstimator& estimator) {
    const std::vector<Theta> grid =
        estimator.grid_on(campaign.runs.front().input, campaign.lo_degc, campaign.hi_degc);
    if (grid.empty()) return;
    std::vector<std::vector<Column>> per_run(campaign.runs.size());
    for (size_t r = 0; r < per_run.size(); ++r)
      for (const Theta& shape : grid)
        for (Column& column : estimator.columns(campaign.runs[r].input, shape))
          per_run[r].push_back(std::move(column));
    MatrixXd z = whiten_and_reduce(gathered(per_run));
    const VectorXd energy = z.colwise().squaredNorm().transpose();
    project(&z);
    const long width = static_cast<long>(estimator.n_columns());
    for (size_t g = 0; g < grid.size(); ++g) {
      const long first = static_cast<long>(g) * width;
      groups[j].push_back({orthonormal(z.middleCols(first, width), energy.segment(first, width)), grid[g]});
    }
  }
  // Bases of whole designs with another temperature in the polynomial.
  void build_replacing(size_t j, const EffectEstimator& estimator) {
    if (campaign.order < 1) return;
    std::vector<Theta> grid =
        estimator.grid_on(campaign.runs.front().input, campaign.lo_degc, campaign.hi_degc);
    if (library[j]->name() == "temperature_sensor_quantization") {
      if (!(campaign.temp_lsb_degc > 0)) return;
      grid = {{campaign.temp_lsb_degc}};
    }
    for (const Theta& shape : grid) {
      Hypothesis other = hypothesis;
      Term term;
      term.effect = library[j];
      term.estimator = &estimator;
      term.shape = shape;
      other.terms.push_back(term);
      const MatrixXd z = whiten_and_reduce(make_design(campaign, other).x);
      replacing[j].push_back({orthonormal(z, z.colwise().squaredNorm().transpose()), shape});
    }
  }
  void build_random(size_t j, const EffectEstimator& estimator) {
    const long width = static_cast<long>(estimator.n_columns()),
               n_runs = static_cast<long>(campaign.runs.size());
    std::vector<MatrixXd> columns;
    for (size_t r = 0; r < campaign.runs.size(); ++r) {
      const auto values = gathered_one(r, estimator.columns(campaign.runs[r].input, {}));
      MatrixXd m = MatrixXd::Zero(values.rows(), width * n_runs);
      m.middleCols(static_cast<long>(r) * width, width) = values;
      columns.push_back(std::move(m));
    }
    MatrixXd z = whiten_and_reduce(columns);
    project(&z);
    Random out;
    const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(z.transpose() * z);
    out.values = eigen.eigenvalues().cwiseMax(0.0);
    out.basis = z;
    out.vectors = eigen.eigenvectors();
    random.push_back(out);
    random_of = static_cast<int>(j);
  }
  MatrixXd gathered_one(size_t r, const std::vector<Column>& columns) const {
    const CampaignRun& run = campaign.runs[r];
    MatrixXd m(static_cast<long>(run.n()), static_cast<long>(columns.size()));
    for (size_t c = 0; c < columns.size(); ++c)
      for (size_t k = 0; k < run.n(); ++k)
        m(static_cast<long>(k), static_cast<long>(c)) = columns[c][static_cast<size_t>(run.used[k])];
    return m;
  }

  void build_steps() {
    for (size_t r = 0; r < campaign.runs.size(); ++r) {
      const CampaignRun& run = campaign.runs[r];
      const long nb = first_block[r + 1] - first_block[r], n = static_cast<long>(run.n());
      Steps s;
      // The response from the settled filter: a step in the middle of a run twice as long would be exact; the
      // transient of the start is over after the first third of any run of use.
      const long start = static_cast<long>(block) * (nb / 3);
      VectorXd h = VectorXd::Zero(n);
      h.tail(n - start).setOnes();
      whiten(gains[r], h.data(), static_cast<size_t>(n));
      const long nr = nb - nb / 3;
      s.response = VectorXd::Zero(nb);
      for (long b = 0; b < nr; ++b) {
        const long k = start + b * static_cast<long>(block), end = std::min(n, k + static_cast<long>(block));
        if (end > k) s.response[b] = h.segment(k, end - k).sum() / std::sqrt(static_cast<double>(end - k));
      }
      if (nr > 2) s.response.tail(nb - nr + 1).setConstant(s.response[nr - 2]);
      const long margin = kStepMargin_s / static_cast<long>(block) + 1;
      const MatrixXd q = design.middleRows(first_block[r], nb);
      s.energy.assign(static_cast<size_t>(nb), 0.0);
      for (long b = margin; b + margin < nb; ++b) {
        const VectorXd z = s.response.head(nb - b);
        const VectorXd absorbed = q.bottomRows(nb - b).transpose() * z;
        const double total = z.squaredNorm(), left = total - absorbed.squaredNorm();
        if (left > 1e-3 * total) s.energy[static_cast<size_t>(b)] = left;
      }
      steps.push_back(s);
    }
  }
  CandidateScore best_step(const VectorXd& e) const {
    CandidateScore best;
    for (size_t r = 0; r < steps.size(); ++r) {
      const long nb = first_block[r + 1] - first_block[r];
      const auto er = e.segment(first_block[r], nb);
      const VectorXd& g = steps[r].response;
      // Beyond the settling of the response the sum runs over e alone.
      long settled = 1;
      const double last = g[nb - 1];
      for (long b = nb - 1; b >= 0; --b)
        if (std::fabs(g[b] - last) > 1e-3 * std::fabs(g[0]) + 1e-12) {
          settled = b + 1;
          break;
        }
      VectorXd tail = VectorXd::Zero(nb + 1);
      for (long b = nb - 1; b >= 0; --b) tail[b] = tail[b + 1] + er[b];
      for (long b = 0; b < nb; ++b) {
        const double energy = steps[r].energy[static_cast<size_t>(b)];
        if (!(energy > 0)) continue;
        const long m = std::min(settled, nb - b);
        const double dot = g.head(m).dot(er.segment(b, m)) + last * tail[b + m];
        const double gain = 0.5 * dot * dot / energy;
        if (gain <= best.gain_nats) continue;
        const CampaignRun& run = campaign.runs[r];
        best = {gain,
                {static_cast<double>(r),
                 run.input.t_s[static_cast<size_t>(run.used[static_cast<size_t>(b) * block])]}};
      }
    }
    return best;
  }

  // Bases of the mean-type tests.
  void build_generic() {
    generic.assign(kGenerics, MatrixXd());
    std::vector<std::vector<std::vector<Column>>> sets(
        6, std::vector<std::vector<Column>>(campaign.runs.size()));
    const double lo = campaign.lo_degc, span = std::max(1e-9, campaign.hi_degc - lo);
    double longest = 0;
    for (const CampaignRun& run : campaign.runs) longest = std::max(longest, run.input.t_s.back());
    for (size_t r = 0; r < campaign.runs.size(); ++r) {
      const RunInput& in = campaign.runs[r].input;
      const size_t n = in.size();
      const auto column = [&](const auto& f) {
        Column c(n);
        for (size_t i = 0; i < n; ++i) c[i] = f(i);
        return c;
      };
      if (campaign.has_temperature) {
        for (int k = 0; k < 22; ++k)
          sets[kTemp][r].push_back(
              column([&](size_t i) { return hat((in.smooth_degc[i] - lo) / span * 21 - k); }));
        for (int d = -1; d <= 1; ++d)
          for (int k = 0; k < 11; ++k)
            sets[kTempDir][r].push_back(column([&](size_t i) {
              const double rate = in.rate_degc_min[i];
              const int direction = std::fabs(rate) < 0.05 ? 0 : rate > 0 ? 1 : -1;
              return direction == d ? hat((in.smooth_degc[i] - lo) / span * 10 - k) : 0.0;
            }));
        const Column x = column([&](size_t i) { return 2 * (in.smooth_degc[i] - lo) / span - 1; });
        const Column t = column([&](size_t i) { return 2 * in.t_s[i] / longest - 1; });
        for (int a = 0; a <= 6; ++a)
          for (int b = 0; a + b <= 6; ++b) {
            if (a + b == 0) continue;
            sets[kTempTime][r].push_back(column([&](size_t i) {
              return std::cos(a * std::acos(std::clamp(x[i], -1.0, 1.0))) *
                     std::cos(b * std::acos(std::clamp(t[i], -1.0, 1.0)));
            }));
          }
        for (int a = 0; a <= 3; ++a)
          sets[kTempTime][r].push_back(column([&](size_t i) {
            return in.rate_degc_min[i] * std::cos(a * std::acos(std::clamp(x[i], -1.0, 1.0)));
          }));
        for (double delay : {0., 30., 60., 120., 200., 300., 450., 600., 800., 1000., 1300.})
          sets[kTransient][r].push_back(column([&](size_t i) {
            const size_t back = static_cast<size_t>(delay / in.dt_s);
            return i >= back ? in.rate_degc_min[i - back] : 0.0;
          }));
      }
      for (int k = 0; k < 20; ++k)
        sets[kTime][r].push_back(column([&](size_t i) { return hat(in.t_s[i] / longest * 19 - k); }));
    }
    for (int g : {kTemp, kTempDir, kTime, kTempTime, kTransient}) {
      if (sets[static_cast<size_t>(g)][0].empty()) continue;
      MatrixXd z = whiten_and_reduce(gathered(sets[static_cast<size_t>(g)]));
      const VectorXd energy = z.colwise().squaredNorm().transpose();
      project(&z);
      generic[static_cast<size_t>(g)] = orthonormal(z, energy);
    }
    // Slow changes within each run: cosines over the run, whitened; the columns of different runs do not
    // overlap.
    constexpr int kPerRun = 13;
    const long n_runs = static_cast<long>(campaign.runs.size());
    if (n_runs <= 12) {
      MatrixXd z = MatrixXd::Zero(n_blocks(), kPerRun * n_runs);
      for (size_t r = 0; r < campaign.runs.size(); ++r) {
        const long n = static_cast<long>(campaign.runs[r].n());
        MatrixXd c(n, kPerRun);
        for (int k = 0; k < kPerRun; ++k)
          for (long i = 0; i < n; ++i)
            c(i, k) = std::cos(kPi * (k + 1) * (static_cast<double>(i) + 0.5) / static_cast<double>(n));
        whiten(gains[r], &c);
        MatrixXd one = MatrixXd::Zero(n_blocks(), kPerRun);
        reduce_run(r, c, &one);
        z.middleCols(static_cast<long>(r) * kPerRun, kPerRun) = one;
      }
      const VectorXd energy = z.colwise().squaredNorm().transpose();
      project(&z);
      generic[kByRun] = orthonormal(z, energy);
    }
  }

  // Filters with a slope of the Markov process' log-variance or log-tau: two-sided differences of the
  // likelihood.
  void build_slopes() {
    if (!campaign.has_temperature) return;
    for (size_t j = 0; j < library.size(); ++j) {
      if (!can_score(*library[j]) || library[j]->estimator()->form() != Form::kNoise) continue;
      const EffectEstimator& estimator = *library[j]->estimator();
      if (estimator.is_logarithmic()) continue;
      Slope slope;
      slope.candidate = j;
      slope.h = 0.15;
      for (const CampaignRun& run : campaign.runs) {
        slope.minus.push_back(compute_gains(run, estimator.noise(noise, {-slope.h})));
        slope.plus.push_back(compute_gains(run, estimator.noise(noise, {slope.h})));
      }
      slopes.push_back(std::move(slope));
    }
  }
  double gaussian_value(const std::vector<VectorXd>& residual, const std::vector<RunGains>& g) const {
    double sum = 0;
    VectorXd work;
    for (size_t r = 0; r < residual.size(); ++r) {
      work = residual[r];
      whiten(g[r], work.data(), static_cast<size_t>(work.size()));
      sum -= 0.5 * (g[r].sum_log_s + work.squaredNorm());
    }
    return sum;
  }

  PanelScores evaluate(const std::vector<VectorXd>& e, const std::vector<VectorXd>& residual,
                       const VectorXd& signal, const SpectrumNull& null) const;
  void score_means(const VectorXd& eb, const VectorXd& signal, PanelScores* out) const;
  void score_spectrum(const std::vector<VectorXd>& e, const SpectrumNull& null, PanelScores* out) const;
  void score_whittle(const SpectrumNull& null, PanelScores* out) const;
  void score_noise(const std::vector<VectorXd>& e, const std::vector<VectorXd>& residual,
                   PanelScores* out) const;
  void score_generic(const std::vector<VectorXd>& e, const VectorXd& eb, PanelScores* out) const;
};

void Panel::Impl::score_means(const VectorXd& eb, const VectorXd& signal, PanelScores* out) const {
  const VectorXd y = design * signal + eb;
  const double base = (design.transpose() * y).squaredNorm();
  for (size_t j = 0; j < library.size(); ++j) {
    CandidateScore& score = out->named[j];
    for (const Group& group : groups[j]) {
      const double gain = half_energy(group.basis, eb);
      if (gain > score.gain_nats) score = {gain, group.shape};
    }
    for (const Group& group : replacing[j]) {
      const double gain = half_energy(group.basis, y) - 0.5 * base;
      if (gain > score.gain_nats) score = {gain, group.shape};
    }
    if (!library[j]->estimator()) continue;
    if (library[j]->estimator()->form() == Form::kSteps) score = best_step(eb);
    if (static_cast<int>(j) == random_of) {
      const Random& r = random.front();
      const VectorXd u = r.vectors.transpose() * (r.basis.transpose() * eb);
      for (double s : {0.2, 0.4, 0.8, 1.5, 3., 5., 8., 12., 18., 27., 40., 60., 120., 250., 500., 1000.}) {
        double gain = 0;
        for (long i = 0; i < u.size(); ++i)
          gain +=
              -0.5 * std::log1p(s * s * r.values[i]) + 0.5 * s * s * u[i] * u[i] / (1 + s * s * r.values[i]);
        if (gain > score.gain_nats) score = {gain, {s}};
      }
    }
  }
}

void Panel::Impl::score_spectrum(const std::vector<VectorXd>& e, const SpectrumNull& null,
                                 PanelScores* out) const {
  static thread_local Eigen::FFT<double> fft;
  fft.SetFlag(Eigen::FFT<double>::HalfSpectrum);
  const double dt = campaign.dt_s;
  std::vector<double> tone;
  std::vector<double> sum(bins.front().n_bins(), 0.0), weight(bins.front().n_bins(), 0.0);
  const size_t n_tone = bins.front().n_fft;
  tone.assign(n_tone / 2 + 1, 0.0);
  for (size_t r = 0; r < e.size(); ++r) {
    const CampaignRun& run = campaign.runs[r];
    std::vector<double> x(n_tone, 0.0);
    for (size_t k = 0; k < run.n(); ++k)
      x[static_cast<size_t>(run.input.tick[static_cast<size_t>(run.used[k])])] = e[r][static_cast<long>(k)];
    std::vector<std::complex<double>> f;
    fft.fwd(f, x);
    const double scale = 1.0 / static_cast<double>(run.n());
    for (size_t i = 0; i < tone.size(); ++i) tone[i] += std::norm(f[i]) * scale;
    bins.front().add(f, scale, &sum, &weight);
  }
  out->psd.assign(sum.size(), 1.0);
  for (size_t b = 0; b < sum.size(); ++b)
    if (weight[b] > 0) out->psd[b] = sum[b] / weight[b];
  for (size_t j = 0; j < library.size(); ++j) {
    if (!can_score(*library[j]) || library[j]->estimator()->form() != Form::kTone) continue;
    for (size_t i = 1; i + 1 < tone.size(); ++i) {
      const double hz = static_cast<double>(i) / (static_cast<double>(n_tone) * dt);
      if (hz > kSlowestTone_hz && tone[i] > out->named[j].gain_nats) out->named[j] = {tone[i], {hz}};
    }
  }
  score_whittle(null, out);
}

void Panel::Impl::score_whittle(const SpectrumNull& null, PanelScores* out) const {
  if (null.empty()) return;
  const double dt = campaign.dt_s;
  // Whittle likelihood of the binned periodogram for every stationary noise candidate.
  std::vector<double> power(out->psd.size());
  for (size_t b = 0; b < power.size(); ++b) power[b] = out->psd[b] / null.mean[b];
  double generic_gain = 0;
  for (size_t b = 0; b < power.size(); ++b)
    generic_gain += 0.5 * null.dof[b] * (power[b] - 1 - std::log(std::max(power[b], 1e-12)));
  if (with_generic) out->generic[kPsd] = generic_gain;
  const std::vector<double> hz = bins.front().centres();
  std::vector<double> base = spectral_density(noise, hz, dt);
  const Effect* second = nullptr;
  size_t second_at = 0;
  for (size_t j = 0; j < library.size(); ++j) {
    if (!can_score(*library[j]) || library[j]->estimator()->form() != Form::kNoise) continue;
    const EffectEstimator& estimator = *library[j]->estimator();
    if (!estimator.is_logarithmic()) continue;
    const auto f = [&](const Theta& theta) {
      NoiseModel other = estimator.noise(noise, theta);
      if (other.telegraph_dph > 0) other.markov.push_back({other.telegraph_dph, other.telegraph_tau_s});
      const std::vector<double> density = spectral_density(other, hz, dt);
      double gain = 0;
      for (size_t b = 0; b < density.size(); ++b) {
        const double g = density[b] / base[b];
        gain += 0.5 * null.dof[b] * (power[b] - power[b] / g - std::log(g));
      }
      return gain;
    };
    if (estimator.noise(noise, estimator.starts(noise).front()).hit_probability > 0) continue;
    if (library[j]->name() == "telegraph_noise" && second) { // the same spectrum
      out->named[j] = out->named[second_at];
      continue;
    }
    SearchOptions options;
    options.is_logarithmic = true;
    options.max_evaluations = 60;
    options.tolerance = 0.02;
    options.step = 0.5;
    for (Theta theta : estimator.starts(noise)) {
      const double gain = maximise(f, &theta, estimator.theta_lo(), estimator.theta_hi(), options);
      if (gain > out->named[j].gain_nats || out->named[j].shape.empty())
        out->named[j] = {std::max(gain, 0.0), theta};
    }
    if (library[j]->name() == "second_markov") second = library[j], second_at = j;
  }
}

void Panel::Impl::score_noise(const std::vector<VectorXd>& e, const std::vector<VectorXd>& residual,
                              PanelScores* out) const {
  for (const Slope& slope : slopes) {
    const double minus = gaussian_value(residual, slope.minus), plus = gaussian_value(residual, slope.plus);
    double middle = -0.5 * base_log_s;
    for (const VectorXd& er : e) middle -= 0.5 * er.squaredNorm();
    // Parabola through the three values.
    const double first = (plus - minus) / (2 * slope.h),
                 second = (plus + minus - 2 * middle) / (slope.h * slope.h);
    const double at = second < 0 ? std::clamp(-first / second, -3.0, 3.0) : std::copysign(1.0, first);
    const double gain = second < 0 ? -0.5 * first * first / second : std::max(plus, minus) - middle;
    out->named[slope.candidate] = {std::max(0.0, gain), {at}};
  }
  // Outliers: contaminated normal on the innovations, from a histogram of |e|.
  constexpr int kCells = 400;
  constexpr double kTop = 20;
  std::vector<double> count(kCells + 1, 0.0);
  std::vector<double> beyond;
  for (const VectorXd& er : e)
    for (long k = 0; k < er.size(); ++k) {
      const double z = std::fabs(er[k]);
      if (z < kTop)
        count[static_cast<size_t>(z * kCells / kTop)] += 1;
      else
        beyond.push_back(z);
    }
  for (size_t j = 0; j < library.size(); ++j) {
    if (!can_score(*library[j]) || library[j]->estimator()->form() != Form::kNoise) continue;
    const EffectEstimator& estimator = *library[j]->estimator();
    const NoiseModel probe = estimator.noise(noise, estimator.starts(noise).front());
    if (!(probe.hit_probability > 0)) continue;
    const double s = 1.0 / (gains.front().inv_sqrt_s.back() * gains.front().inv_sqrt_s.back());
    CandidateScore& score = out->named[j];
    for (double p : {3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1})
      for (double a : {2.6, 3.6, 5.0, 8.0, 14.0, 30.0, 80.0}) {
        const double variance = 1 + a * a, norm = p / std::sqrt(variance), slope = 0.5 * (1 - 1 / variance);
        double gain = 0;
        for (int c = 0; c < kCells; ++c) {
          if (count[static_cast<size_t>(c)] == 0) continue;
          const double z = (c + 0.5) * kTop / kCells;
          gain += count[static_cast<size_t>(c)] * std::log(1 - p + norm * std::exp(slope * z * z));
        }
        for (double z : beyond) gain += std::log(norm) + slope * z * z;
        if (gain > score.gain_nats) score = {gain, {p, a * std::sqrt(s)}};
      }
  }
}

void Panel::Impl::score_generic(const std::vector<VectorXd>& e, const VectorXd& eb, PanelScores* out) const {
  for (int g : {kTemp, kTempDir, kTime, kTempTime, kByRun, kTransient})
    if (generic[static_cast<size_t>(g)].cols() > 0)
      out->generic[static_cast<size_t>(g)] = half_energy(generic[static_cast<size_t>(g)], eb);
  const auto kl = [](double sum, double n) {
    if (n < 1) return 0.0;
    const double v = std::max(sum / n, 1e-9);
    return 0.5 * n * (v - 1 - std::log(v));
  };
  // Variance by temperature (4 degC) and by time (600 s of each run).
  const long n_bins = std::max<long>(1, std::lround((campaign.hi_degc - campaign.lo_degc) / 4.0));
  std::vector<double> by_temp(static_cast<size_t>(n_bins), 0.0), n_temp = by_temp;
  double third = 0, fourth = 0, n_all = 0, volatility = 0, by_run = 0;
  constexpr int kCells = 40;
  std::vector<double> histogram(kCells, 0.0);
  std::vector<double> block_third;
  double skew_blocks = 0, skew_norm = 0;
  for (size_t r = 0; r < e.size(); ++r) {
    const CampaignRun& run = campaign.runs[r];
    double sum = 0, n = 0;
    const long length = e[r].size();
    std::vector<double> squares;
    double block_square = 0;
    for (long k = 0; k < length; ++k) {
      const double z = e[r][k], z2 = z * z;
      if (campaign.has_temperature) {
        const double temp = run.input.smooth_degc[static_cast<size_t>(run.used[static_cast<size_t>(k)])];
        const long b =
            std::clamp<long>(static_cast<long>((temp - campaign.lo_degc) /
                                               std::max(1e-9, campaign.hi_degc - campaign.lo_degc) *
                                               static_cast<double>(n_bins)),
                             0, n_bins - 1);
        by_temp[static_cast<size_t>(b)] += z2;
        n_temp[static_cast<size_t>(b)] += 1;
      }
      sum += z2, n += 1;
      if (n >= 600 || k + 1 == length) by_run += kl(sum, n), sum = n = 0;
      third += z2 * z, fourth += z2 * z2, n_all += 1;
      histogram[static_cast<size_t>(
          std::clamp(0.5 * std::erfc(-z * 0.70710678) * kCells, 0.0, kCells - 0.5))] += 1;
      block_square += z2 - 1;
      if (k % 8 == 7) squares.push_back(block_square / 4.0), block_square = 0; // variance 2 * 8 = 16
    }
    // Bursts: Haar coefficients of the squares over 8, 16, … s, excess over their expected variance.
    std::vector<double> level = squares;
    while (level.size() >= 8) {
      double energy = 0;
      std::vector<double> next;
      for (size_t i = 0; i + 1 < level.size(); i += 2) {
        const double d = (level[i] - level[i + 1]) * 0.70710678;
        energy += d * d;
        next.push_back((level[i] + level[i + 1]) * 0.70710678);
      }
      const double count = static_cast<double>(next.size()), v = energy / count;
      if (v > 1) volatility += 0.5 * count * (v - 1 - std::log(v));
      level = next;
    }
    // Asymmetry of slow changes: third moment of differences of 32-s means.
    for (long k = 0; k + 64 <= length; k += 64) {
      const double d = (e[r].segment(k + 32, 32).sum() - e[r].segment(k, 32).sum()) / 8.0;
      skew_blocks += d * d * d, skew_norm += 15;
    }
  }
  double temp_gain = 0;
  for (size_t b = 0; b < by_temp.size(); ++b) temp_gain += kl(by_temp[b], n_temp[b]);
  out->generic[kVarTemp] = temp_gain;
  out->generic[kVarRun] = by_run;
  double dist = 0;
  for (double c : histogram)
    if (c > 0) dist += c * std::log(c * kCells / n_all);
  const double excess = fourth / n_all - 3;
  out->generic[kDist] = dist + excess * excess * n_all / 48; // var of the fourth moment's excess: 24/n
  out->generic[kVol] = volatility;
  out->generic[kAsym] =
      third * third / n_all / 30 + (skew_norm > 0 ? skew_blocks * skew_blocks / skew_norm / 2 : 0);
}

PanelScores Panel::Impl::evaluate(const std::vector<VectorXd>& e, const std::vector<VectorXd>& residual,
                                  const VectorXd& signal, const SpectrumNull& null) const {
  PanelScores out;
  out.named.resize(library.size());
  out.generic.assign(kGenerics, 0.0);
  const VectorXd eb = reduce(e);
  score_means(eb, signal, &out);
  score_spectrum(e, null, &out);
  score_noise(e, residual, &out);
  if (with_generic) score_generic(e, eb, &out);
  return out;
}

Panel::Panel(const Campaign& campaign, const Hypothesis& hypothesis,
             const std::vector<const Effect*>& library, bool with_generic)
    : impl_(new Impl(campaign, hypothesis, library, with_generic)) {
  impl_->layout();
  impl_->build_design();
  impl_->build_columns();
  impl_->build_steps();
  if (with_generic) impl_->build_generic();
  impl_->build_slopes();
  size_t longest = 0;
  for (const CampaignRun& run : campaign.runs)
    longest = std::max(longest, static_cast<size_t>(run.input.tick.back() + 1));
  impl_->bins.emplace_back(longest, campaign.dt_s);
}

Panel::~Panel() = default;

size_t Panel::n_blocks() const {
  return static_cast<size_t>(impl_->n_blocks());
}

PanelScores Panel::score(const Fit& fit, const SpectrumNull& spectrum) const {
  // The signal of the fitted mean in the reduced design: what the replaced temperatures have to explain.
  const Design d = make_design(impl_->campaign, impl_->hypothesis);
  std::vector<MatrixXd> mean;
  for (const MatrixXd& x : d.x) mean.push_back(x * fit.beta);
  const VectorXd signal = impl_->design.transpose() * impl_->whiten_and_reduce(mean);
  return impl_->evaluate(fit.e, fit.residual, signal, spectrum);
}

void Panel::score_whittle(const SpectrumNull& spectrum, PanelScores* scores) const {
  impl_->score_whittle(spectrum, scores);
}

double Panel::gain_at(const EffectEstimator& estimator, const Theta& shape, const Fit& fit) const {
  const Impl& m = *impl_;
  const VectorXd eb = m.reduce(fit.e);
  if (estimator.form() == Form::kTone) {
    double gain = 0;
    for (size_t r = 0; r < fit.e.size(); ++r) {
      const CampaignRun& run = m.campaign.runs[r];
      double c = 0, s = 0;
      for (size_t k = 0; k < run.n(); ++k) {
        const double angle = 2 * kPi * shape[0] * run.input.t_s[static_cast<size_t>(run.used[k])];
        c += fit.e[r][static_cast<long>(k)] * std::cos(angle);
        s += fit.e[r][static_cast<long>(k)] * std::sin(angle);
      }
      gain += (c * c + s * s) / static_cast<double>(run.n());
    }
    return gain;
  }
  if (estimator.form() == Form::kSteps) {
    const size_t r = static_cast<size_t>(shape[0]);
    const CampaignRun& run = m.campaign.runs[r];
    MatrixXd h(static_cast<long>(run.n()), 1);
    for (size_t k = 0; k < run.n(); ++k)
      h(static_cast<long>(k), 0) = run.input.t_s[static_cast<size_t>(run.used[k])] >= shape[1] ? 1.0 : 0.0;
    whiten(m.gains[r], &h);
    h -= m.full[r] * (m.full[r].transpose() * h); // the rest of the projection lies in other runs
    const double energy = h.squaredNorm(), dot = h.col(0).dot(fit.e[r]);
    return energy > 0 ? 0.5 * dot * dot / energy : 0;
  }
  if (estimator.form() == Form::kTemperature) {
    Hypothesis other = m.hypothesis;
    Term term;
    term.estimator = &estimator;
    term.shape = shape;
    other.terms.push_back(term);
    const MatrixXd z = m.whiten_and_reduce(make_design(m.campaign, other).x);
    const MatrixXd basis = orthonormal(z, z.colwise().squaredNorm().transpose());
    const Design d = make_design(m.campaign, m.hypothesis);
    std::vector<MatrixXd> mean;
    for (const MatrixXd& x : d.x) mean.push_back(x * fit.beta);
    const VectorXd y = m.design * (m.design.transpose() * m.whiten_and_reduce(mean)) + eb;
    return half_energy(basis, y) - 0.5 * (m.design.transpose() * y).squaredNorm();
  }
  std::vector<std::vector<Column>> per_run;
  for (const CampaignRun& run : m.campaign.runs) per_run.push_back(estimator.columns(run.input, shape));
  MatrixXd z = m.whiten_and_reduce(m.gathered(per_run));
  const VectorXd energy = z.colwise().squaredNorm().transpose();
  m.project(&z);
  return half_energy(orthonormal(z, energy), eb);
}

PanelScores Panel::score_null(std::vector<VectorXd> e, const SpectrumNull& spectrum) const {
  VectorXd projection = VectorXd::Zero(impl_->full.front().cols());
  for (size_t r = 0; r < e.size(); ++r) projection += impl_->full[r].transpose() * e[r];
  std::vector<VectorXd> residual;
  for (size_t r = 0; r < e.size(); ++r) {
    e[r] -= impl_->full[r] * projection;
    residual.push_back(e[r]);
    colour(impl_->gains[r], residual.back().data(), static_cast<size_t>(e[r].size()));
  }
  const VectorXd signal =
      impl_->null_signal.size() ? impl_->null_signal : VectorXd::Zero(impl_->design.cols());
  return impl_->evaluate(e, residual, signal, spectrum);
}

MatrixXd Panel::reduce(const std::vector<MatrixXd>& columns) const {
  MatrixXd z = impl_->whiten_and_reduce(columns);
  impl_->project(&z);
  return z;
}

double Panel::absorbed(size_t candidate, const VectorXd& reduced) const {
  double best = 0;
  for (const Group& group : impl_->groups[candidate])
    best = std::max(best, 2 * half_energy(group.basis, reduced));
  return best;
}

} // namespace imucal
