// SPDX-License-Identifier: MIT
#include "analysis/diagnose/panel.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <mutex>
#include <unsupported/Eigen/FFT>

#include "analysis/diagnose/spectrum.h"
#include "base/units.h"

namespace imucal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kSlowestTone_hz = 1.0 / 500;
constexpr int kStepMargin_s = 100; // a step this close to an end of a run cannot be told from the constant
constexpr double kAbsorbed = 1e-5; // energy left after projection below which a column is taken as absorbed

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
  while (rank < std::min(scaled.rows(), scaled.cols()) && std::pow(qr.matrixQR()(rank, rank), 2) > kAbsorbed) ++rank;
  MatrixXd basis = MatrixXd::Identity(scaled.rows(), rank);
  basis.applyOnTheLeft(qr.householderQ().setLength(std::min(scaled.rows(), scaled.cols())));
  return basis;
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
  static const char* const texts[kGenerics] = {"a mean that follows temperature and that the polynomial does not",
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
  ColumnBank& bank;
  const Campaign& campaign;
  const std::vector<const Effect*>& library;
  Hypothesis hypothesis;
  PanelScope scope;
  NoiseModel noise; // Gaussian equivalent of the hypothesis'
  std::shared_ptr<const WhitenedColumns> white;
  MatrixXd reduced;           // whitened design, reduced
  MatrixXd design;            // its orthonormal basis
  VectorXd null_signal;       // coefficients of the nominal polynomial in `design`
  std::vector<MatrixXd> full; // orthonormal whitened design at full rate, per run: built when first needed
  std::once_flag full_once;

  std::vector<std::vector<Group>> groups;    // per library effect: kColumns
  std::vector<std::vector<Group>> replacing; // per library effect: kTemperature, whole designs
  struct Random {
    MatrixXd basis;  // reduced columns of all runs
    VectorXd values; // eigenvalues of their Gram matrix
    MatrixXd vectors;
  };
  std::vector<Random> random;
  int random_of = -1;
  std::vector<std::vector<double>> step_energy; // per run and start block, after projection; 0: not allowed
  std::vector<MatrixXd> tests;                  // bases of the free means
  SpectrumBins bins;

  Impl(ColumnBank* b, const Hypothesis& h, PanelScope s)
      : bank(*b), campaign(b->campaign()), library(b->library()), hypothesis(h), scope(s),
        noise(gaussian_equivalent(h.noise())), white(b->under(noise, s == PanelScope::kAll)),
        bins(longest(b->campaign()), b->campaign().dt_s) {
    build_design();
    if (scope == PanelScope::kDesign) return;
    build_candidates();
    build_steps();
    if (scope == PanelScope::kAll) build_tests();
  }
  static size_t longest(const Campaign& c) {
    size_t longest = 0;
    for (const CampaignRun& run : c.runs) longest = std::max(longest, static_cast<size_t>(run.input.tick.back() + 1));
    return longest;
  }

  void project(MatrixXd* columns) const { *columns -= design * (design.transpose() * *columns); }
  long n_runs() const { return static_cast<long>(campaign.runs.size()); }

  void build_design() {
    reduced = bank.whiten_and_reduce(white->gains, make_design(campaign, hypothesis).x);
    design = orthonormal(reduced, reduced.colwise().squaredNorm().transpose());
    VectorXd coefficients = VectorXd::Zero(campaign.order);
    for (int i = 0; i < campaign.order && i + 1 < static_cast<int>(campaign.coeff_dph.size()); ++i)
      coefficients[i] = campaign.coeff_dph[static_cast<size_t>(i) + 1];
    null_signal = design.transpose() * (reduced.middleCols(n_runs(), campaign.order) * coefficients);
  }
  // Full rate, for the projection of null draws and of single steps.
  void build_full() {
    full = make_design(campaign, hypothesis).x;
    for (size_t r = 0; r < full.size(); ++r) whiten(white->gains[r], &full[r]);
    const MatrixXd transform = orthonormaliser(full);
    for (MatrixXd& w : full) w *= transform;
  }

  void build_candidates() {
    groups.assign(library.size(), {});
    replacing.assign(library.size(), {});
    for (size_t j = 0; j < library.size(); ++j) {
      const MatrixXd& columns = white->candidates[j];
      if (columns.cols() == 0) continue;
      const EffectEstimator& estimator = *library[j]->estimator();
      const std::vector<Theta>& shapes = bank.shapes(j);
      if (estimator.form() == Form::kTemperature) {
        for (size_t g = 0; g < shapes.size(); ++g) {
          MatrixXd z = reduced;
          z.middleCols(n_runs(), campaign.order) =
              columns.middleCols(static_cast<long>(g) * campaign.order, campaign.order);
          replacing[j].push_back({orthonormal(z, z.colwise().squaredNorm().transpose()), shapes[g]});
        }
        continue;
      }
      MatrixXd z = columns;
      const VectorXd energy = z.colwise().squaredNorm().transpose();
      project(&z);
      if (estimator.form() == Form::kRunRandom) {
        const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(z.transpose() * z);
        random.push_back({z, eigen.eigenvalues().cwiseMax(0.0), eigen.eigenvectors()});
        random_of = static_cast<int>(j);
        continue;
      }
      const long width = static_cast<long>(estimator.n_columns());
      for (size_t g = 0; g < shapes.size(); ++g) {
        const long first = static_cast<long>(g) * width;
        groups[j].push_back({orthonormal(z.middleCols(first, width), energy.segment(first, width)), shapes[g]});
      }
    }
  }

  void build_steps() {
    for (size_t r = 0; r < campaign.runs.size(); ++r) {
      const long nb = bank.first_block(r + 1) - bank.first_block(r);
      std::vector<double> allowed(static_cast<size_t>(nb), 0.0);
      const long margin = kStepMargin_s / bank.block() + 1;
      const MatrixXd q = design.middleRows(bank.first_block(r), nb);
      for (long b = margin; b + margin < nb; ++b) {
        const VectorXd z = white->step[r].head(nb - b);
        const VectorXd absorbed = q.bottomRows(nb - b).transpose() * z;
        const double total = z.squaredNorm(), left = total - absorbed.squaredNorm();
        if (left > 1e-3 * total) allowed[static_cast<size_t>(b)] = left;
      }
      step_energy.push_back(std::move(allowed));
    }
  }

  void build_tests() {
    for (const MatrixXd& columns : white->tests) {
      MatrixXd z = columns;
      if (z.cols() > 0) {
        const VectorXd energy = z.colwise().squaredNorm().transpose();
        project(&z);
        z = orthonormal(z, energy);
      }
      tests.push_back(std::move(z));
    }
  }

  CandidateScore best_step(const VectorXd& e) const {
    CandidateScore best;
    for (size_t r = 0; r < step_energy.size(); ++r) {
      const long nb = bank.first_block(r + 1) - bank.first_block(r);
      const auto er = e.segment(bank.first_block(r), nb);
      const VectorXd& g = white->step[r];
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
        const double energy = step_energy[r][static_cast<size_t>(b)];
        if (!(energy > 0)) continue;
        const long m = std::min(settled, nb - b);
        const double dot = g.head(m).dot(er.segment(b, m)) + last * tail[b + m];
        const double gain = 0.5 * dot * dot / energy;
        if (gain <= best.gain_nats) continue;
        const CampaignRun& run = campaign.runs[r];
        best = {gain,
                {static_cast<double>(r),
                 run.input.t_s[static_cast<size_t>(run.used[static_cast<size_t>(b * bank.block())])]}};
      }
    }
    return best;
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

  PanelScores evaluate(const std::vector<VectorXd>& e, const std::vector<VectorXd>& residual, const VectorXd& signal,
                       const SpectrumNull& null) const;
  void score_means(const VectorXd& eb, const VectorXd& signal, PanelScores* out) const;
  void score_spectrum(const std::vector<VectorXd>& e, const SpectrumNull& null, PanelScores* out) const;
  void score_whittle(const SpectrumNull& null, PanelScores* out) const;
  void score_noise(const std::vector<VectorXd>& e, const std::vector<VectorXd>& residual, PanelScores* out) const;
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
          gain += -0.5 * std::log1p(s * s * r.values[i]) + 0.5 * s * s * u[i] * u[i] / (1 + s * s * r.values[i]);
        if (gain > score.gain_nats) score = {gain, {s}};
      }
    }
  }
}

void Panel::Impl::score_spectrum(const std::vector<VectorXd>& e, const SpectrumNull& null, PanelScores* out) const {
  static thread_local Eigen::FFT<double> fft;
  fft.SetFlag(Eigen::FFT<double>::HalfSpectrum);
  const double dt = campaign.dt_s;
  std::vector<double> tone;
  std::vector<double> sum(bins.n_bins(), 0.0), weight(bins.n_bins(), 0.0);
  const size_t n_tone = bins.n_fft;
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
    bins.add(f, scale, &sum, &weight);
  }
  out->psd.assign(sum.size(), 1.0);
  for (size_t b = 0; b < sum.size(); ++b)
    if (weight[b] > 0) out->psd[b] = sum[b] / weight[b];
  for (size_t j = 0; j < library.size(); ++j) {
    if (!bank.can_score(j) || library[j]->estimator()->form() != Form::kTone) continue;
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
  if (scope == PanelScope::kAll) out->generic[kPsd] = generic_gain;
  const std::vector<double> hz = bins.centres();
  std::vector<double> base = spectral_density(noise, hz, dt);
  const Effect* second = nullptr;
  size_t second_at = 0;
  for (size_t j = 0; j < library.size(); ++j) {
    if (!bank.can_score(j) || library[j]->estimator()->form() != Form::kNoise) continue;
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
    if (estimator.has_markov_spectrum() && second) { // the same spectrum
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
      if (gain > out->named[j].gain_nats || out->named[j].shape.empty()) out->named[j] = {std::max(gain, 0.0), theta};
    }
    if (estimator.has_markov_spectrum()) second = library[j], second_at = j;
  }
}

void Panel::Impl::score_noise(const std::vector<VectorXd>& e, const std::vector<VectorXd>& residual,
                              PanelScores* out) const {
  for (const WhitenedColumns::Slope& slope : white->slopes) {
    const double minus = gaussian_value(residual, slope.minus), plus = gaussian_value(residual, slope.plus);
    double middle = -0.5 * white->sum_log_s;
    for (const VectorXd& er : e) middle -= 0.5 * er.squaredNorm();
    // Parabola through the three values.
    const double first = (plus - minus) / (2 * slope.h), second = (plus + minus - 2 * middle) / (slope.h * slope.h);
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
    if (!bank.can_score(j) || library[j]->estimator()->form() != Form::kNoise) continue;
    const EffectEstimator& estimator = *library[j]->estimator();
    const NoiseModel probe = estimator.noise(noise, estimator.starts(noise).front());
    if (!(probe.hit_probability > 0)) continue;
    const double s = 1.0 / (white->gains.front().inv_sqrt_s.back() * white->gains.front().inv_sqrt_s.back());
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
  for (size_t g = 0; g < tests.size(); ++g)
    if (tests[g].cols() > 0) out->generic[g] = half_energy(tests[g], eb);
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
        const long b = std::clamp<long>(
            static_cast<long>((temp - campaign.lo_degc) / std::max(1e-9, campaign.hi_degc - campaign.lo_degc) *
                              static_cast<double>(n_bins)),
            0, n_bins - 1);
        by_temp[static_cast<size_t>(b)] += z2;
        n_temp[static_cast<size_t>(b)] += 1;
      }
      sum += z2, n += 1;
      if (n >= 600 || k + 1 == length) by_run += kl(sum, n), sum = n = 0;
      third += z2 * z, fourth += z2 * z2, n_all += 1;
      histogram[static_cast<size_t>(std::clamp(0.5 * std::erfc(-z * 0.70710678) * kCells, 0.0, kCells - 0.5))] += 1;
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
  out->generic[kAsym] = third * third / n_all / 30 + (skew_norm > 0 ? skew_blocks * skew_blocks / skew_norm / 2 : 0);
}

PanelScores Panel::Impl::evaluate(const std::vector<VectorXd>& e, const std::vector<VectorXd>& residual,
                                  const VectorXd& signal, const SpectrumNull& null) const {
  PanelScores out;
  out.named.resize(library.size());
  out.generic.assign(kGenerics, 0.0);
  const VectorXd eb = bank.reduce(e);
  score_means(eb, signal, &out);
  score_spectrum(e, null, &out);
  score_noise(e, residual, &out);
  if (scope == PanelScope::kAll) score_generic(e, eb, &out);
  return out;
}

Panel::Panel(ColumnBank* bank, const Hypothesis& hypothesis, PanelScope scope)
    : impl_(new Impl(bank, hypothesis, scope)) {}

Panel::~Panel() = default;

PanelScores Panel::score(const Fit& fit, const SpectrumNull& spectrum) const {
  // The signal of the fitted mean in the reduced design: what the replaced temperatures have to explain.
  const VectorXd signal = impl_->design.transpose() * (impl_->reduced * fit.beta);
  return impl_->evaluate(fit.e, fit.residual, signal, spectrum);
}

void Panel::score_whittle(const SpectrumNull& spectrum, PanelScores* scores) const {
  impl_->score_whittle(spectrum, scores);
}

CandidateScore Panel::best_step(const Fit& fit) const {
  if (impl_->step_energy.empty()) impl_->build_steps();
  return impl_->best_step(impl_->bank.reduce(fit.e));
}

double Panel::gain_at(const EffectEstimator& estimator, const Theta& shape, const Fit& fit) const {
  Impl& m = *impl_;
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
    std::call_once(m.full_once, [&] { m.build_full(); });
    const size_t r = static_cast<size_t>(shape[0]);
    const CampaignRun& run = m.campaign.runs[r];
    MatrixXd h(static_cast<long>(run.n()), 1);
    for (size_t k = 0; k < run.n(); ++k)
      h(static_cast<long>(k), 0) = run.input.t_s[static_cast<size_t>(run.used[k])] >= shape[1] ? 1.0 : 0.0;
    whiten(m.white->gains[r], &h);
    h -= m.full[r] * (m.full[r].transpose() * h); // the rest of the projection lies in other runs
    const double energy = h.squaredNorm(), dot = h.col(0).dot(fit.e[r]);
    return energy > 0 ? 0.5 * dot * dot / energy : 0;
  }
  const VectorXd eb = m.bank.reduce(fit.e);
  std::vector<MatrixXd> columns;
  if (estimator.form() == Form::kTemperature) {
    for (const CampaignRun& run : m.campaign.runs)
      columns.push_back(powers(run, normalised(run.input, estimator.temperature(run.input, shape)), m.campaign.order));
    MatrixXd z = m.reduced;
    z.middleCols(m.n_runs(), m.campaign.order) = m.bank.whiten_and_reduce(m.white->gains, std::move(columns));
    const MatrixXd basis = orthonormal(z, z.colwise().squaredNorm().transpose());
    const VectorXd y = m.design * (m.design.transpose() * (m.reduced * fit.beta)) + eb;
    return half_energy(basis, y) - 0.5 * (m.design.transpose() * y).squaredNorm();
  }
  for (const CampaignRun& run : m.campaign.runs) columns.push_back(used_rows(run, estimator.columns(run.input, shape)));
  MatrixXd z = m.bank.whiten_and_reduce(m.white->gains, std::move(columns));
  const VectorXd energy = z.colwise().squaredNorm().transpose();
  m.project(&z);
  return half_energy(orthonormal(z, energy), eb);
}

PanelScores Panel::score_null(std::vector<VectorXd> e, const SpectrumNull& spectrum) const {
  Impl& m = *impl_;
  std::call_once(m.full_once, [&] { m.build_full(); });
  VectorXd projection = VectorXd::Zero(m.full.front().cols());
  for (size_t r = 0; r < e.size(); ++r) projection += m.full[r].transpose() * e[r];
  std::vector<VectorXd> residual;
  for (size_t r = 0; r < e.size(); ++r) {
    e[r] -= m.full[r] * projection;
    residual.push_back(e[r]);
    colour(m.white->gains[r], residual.back().data(), static_cast<size_t>(e[r].size()));
  }
  return m.evaluate(e, residual, m.null_signal, spectrum);
}

MatrixXd Panel::project(MatrixXd reduced) const {
  impl_->project(&reduced);
  return reduced;
}

const WhitenedColumns& Panel::columns() const {
  return *impl_->white;
}

} // namespace imucal
