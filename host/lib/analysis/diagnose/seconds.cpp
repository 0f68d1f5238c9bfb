// SPDX-License-Identifier: MIT
#include "analysis/diagnose/seconds.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <iterator>

#include "analysis/diagnose/fourier.h"
#include "analysis/diagnose/kalman.h"
#include "analysis/diagnose/spectrum.h"
#include "base/quantile.h"
#include "base/units.h"
#include "noise/likelihood.h"

namespace imucal {

using Eigen::VectorXd;

namespace {

constexpr double kSlowestLine_hz = 1.0 / 400;
constexpr size_t kSurroundings = 60;   // frequencies on either side that a line is compared with
constexpr int kSlopes = 24;            // of the drift, either sign
constexpr double kLargestSlope = 2e-3; // relative change of a unit frequency of 1 Hz per degC
constexpr double kSlopeUnit = kLargestSlope / (kSlopes * kSlopes); // slopes of the grid: k^2 units
constexpr double kHeavy = 4;               // standard errors of the kurtosis from which hits are looked for
constexpr int kProbe = 30, kThorough = 80; // evaluations of a kind of fast noise; thorough where a probe gains
constexpr double kHopeless_nats = 2;       // after the probe: what gains 8 in the end has gained this by then
constexpr double kFastTau_s = 30;          // a second Markov process slower than this belongs to the slow stage

// Upper tail of chi-square as -ln p, by Wilson and Hilferty's cube root.
double minus_log_tail(double x, double dof) {
  if (!(dof > 0)) return 0;
  const double z = (std::cbrt(x / dof) - (1 - 2 / (9 * dof))) / std::sqrt(2 / (9 * dof));
  if (z < -5) return 0;
  if (z < 5) return -std::log(std::max(1e-300, 1 - normal_cdf(z)));
  return 0.5 * z * z + std::log(z * std::sqrt(2 * kPi));
}
// Twice the log-likelihood ratio of a variance v against 1, from n samples.
double variance_ratio(double v, double n) {
  return n > 1 && v > 0 ? n * (v - 1 - std::log(v)) : 0;
}
RestFinding finding(Rest test, double statistic, double dof, double rate) {
  return {test, minus_log_tail(statistic, dof) + std::log(rate)};
}

struct Moments {
  double n = 0, mean = 0, var = 1, kurtosis = 3;
};
Moments moments(const std::vector<VectorXd>& e) {
  Moments m;
  double s1 = 0, s2 = 0, s4 = 0;
  for (const VectorXd& x : e) m.n += static_cast<double>(x.size()), s1 += x.sum();
  m.mean = s1 / m.n;
  for (const VectorXd& x : e) {
    const Eigen::ArrayXd d = (x.array() - m.mean).square();
    s2 += d.sum(), s4 += d.square().sum();
  }
  m.var = s2 / m.n;
  m.kurtosis = m.var > 0 ? s4 / m.n / (m.var * m.var) : 3;
  return m;
}

std::vector<VectorXd> whitened(const Campaign& campaign, const NoiseModel& noise, std::vector<VectorXd> x) {
  GainsByRun gains(noise);
  for (size_t r = 0; r < x.size(); ++r)
    whiten(gains.of(campaign.runs[r]), x[r].data(), static_cast<size_t>(x[r].size()));
  return x;
}

} // namespace

ResidualLikelihood::ResidualLikelihood(const Campaign& campaign, const std::vector<VectorXd>& residual)
    : campaign_(campaign), residual_(residual) {
  for (size_t r = 0; r < residual.size(); ++r) {
    const CampaignRun& run = campaign.runs[r];
    times_.emplace_back(run, true);
    if (alike_.empty() || campaign.runs[alike_.back().first].steps != run.steps) alike_.push_back({r, {}});
    Eigen::MatrixXd& columns = alike_.back().columns;
    columns.conservativeResize(residual[r].size(), columns.cols() + 1);
    columns.rightCols(1) = residual[r];
  }
}

double ResidualLikelihood::operator()(const NoiseModel& noise) const {
  const double sum = noise.is_mixture()                            ? of_mixture(noise)
                     : !noise.is_stationary() && can_follow(noise) ? of_followed(noise)
                                                                   : of_whitened(noise);
  return std::isfinite(sum) ? sum : -1e300;
}

double ResidualLikelihood::of_mixture(const NoiseModel& noise) const {
  double sum = 0;
  for (size_t r = 0; r < residual_.size(); ++r) sum += mixture_log_likelihood(campaign_.runs[r], noise, residual_[r]);
  return sum;
}

double ResidualLikelihood::of_followed(const NoiseModel& noise) const {
  std::vector<SampleTimes> times;
  std::vector<const double*> columns;
  for (size_t r = 0; r < residual_.size(); ++r)
    times.push_back(times_[r].times()), columns.push_back(residual_[r].data());
  return follow_log_likelihood(times, noise, columns);
}

// Gains that follow the temperature are those of one run; others serve all runs of the same times.
double ResidualLikelihood::of_whitened(const NoiseModel& noise) const {
  double sum = 0;
  for (const Alike& runs : alike_) {
    const long together = noise.is_stationary() ? runs.columns.cols() : 1;
    for (long c = 0; c < runs.columns.cols(); c += together) {
      const RunGains gains = compute_gains(campaign_.runs[runs.first + static_cast<size_t>(c)], noise);
      Eigen::MatrixXd x = runs.columns.middleCols(c, together);
      whiten(gains, &x);
      sum -= 0.5 * (gains.sum_log_s * static_cast<double>(together) + x.squaredNorm());
    }
  }
  return sum;
}

namespace {

// White, density and tau of the Markov terms by factors.
NoiseModel with_factors(const NoiseModel& base, const Theta& x) {
  NoiseModel out = base;
  out.white_sigma_dph *= std::exp(x[0]);
  for (Markov& m : out.markov) m.tau_s *= std::exp(x[2]), m.sigma_dph *= std::exp(0.5 * (x[1] + x[2]));
  return out;
}

} // namespace

SecondsNoise fit_seconds_noise(const Campaign& campaign, const NoiseModel& start, const std::vector<VectorXd>& residual,
                               const std::function<NoiseModel(const NoiseModel&)>& with) {
  const ResidualLikelihood log_likelihood(campaign, residual);
  Theta x{0, 0, 0};
  SearchOptions options;
  options.step = 0.3, options.max_evaluations = 60, options.tolerance = 0.02;
  SecondsNoise out;
  out.log_likelihood = maximise(
      [&](const Theta& at) {
        const NoiseModel noise = with_factors(start, at);
        return log_likelihood(with ? with(noise) : noise);
      },
      &x, {-6, -9, -6}, {6, 9, 6}, options);
  out.base = with_factors(start, x);
  return out;
}

namespace {

RestFinding in_sudden_changes(const Campaign& campaign, const std::vector<VectorXd>& e, const Moments& m, double rate);

// What the seconds can show of a kind of noise: hits and telegraph noise where the distribution says so, that one also
// where the innovations change suddenly, white noise over temperature always, another Markov process as far as it is fast.
bool is_asked(const EffectEstimator& e, const Campaign& campaign, const Moments& m, bool changes_suddenly) {
  if (e.form() != Form::kNoise || e.is_nominal_noise()) return false;
  if (e.needs_temperature() && !campaign.has_temperature) return false;
  const double heavy = (m.kurtosis - 3) * std::sqrt(m.n / 24);
  NoiseModel unit;
  unit.white_sigma_dph = 1, unit.markov = {{1, 100}};
  const std::vector<Theta> starts = e.starts(unit);
  if (starts.empty()) return false;
  const NoiseModel example = e.noise(unit, starts.front());
  if (example.is_mixture()) return heavy > kHeavy || (e.is_jumping() && (heavy < -kHeavy || changes_suddenly));
  return !e.is_slow_noise() || example.markov.size() == 2;
}

// Joint search over the parameters of the effect and of the noise beside it.
FastFinding fit_fast(const ResidualLikelihood& log_likelihood, const SecondsNoise& from, const Effect& effect) {
  const EffectEstimator& e = *effect.estimator();
  FastFinding best;
  best.effect = &effect;
  best.gain_nats = -1e300;
  Theta lo{-6, -9, -6}, hi{6, 9, 6};
  const auto in = [&](double v) { return e.is_logarithmic() ? std::log(v) : v; };
  const auto outward = [&](double v) { return e.is_logarithmic() ? std::exp(v) : v; };
  for (size_t i = 0; i < e.theta_lo().size(); ++i) lo.push_back(in(e.theta_lo()[i])), hi.push_back(in(e.theta_hi()[i]));
  const auto theta_of = [&](const Theta& at) {
    Theta theta;
    for (size_t i = 3; i < at.size(); ++i) theta.push_back(outward(at[i]));
    return theta;
  };
  const auto value = [&](const Theta& at) {
    return log_likelihood(e.noise(with_factors(from.base, at), theta_of(at)));
  };
  const auto with_theta = [&](Theta at, const Theta& theta) {
    for (double v : theta) at.push_back(in(v));
    return at;
  };
  const auto best_start = [&] {
    Theta x;
    double highest = -1e300;
    for (const Theta& theta : e.starts(from.base)) {
      const Theta at = with_theta({0, 0, 0}, theta);
      if (const double v = value(at); v > highest) highest = v, x = at;
    }
    return x;
  };
  std::vector<Theta> starts;
  if (const Theta x = best_start(); !x.empty()) starts.push_back(x);
  // The fitted noise has swallowed what jumps: it starts like that process, beside what a smaller and faster one leaves.
  if (e.is_jumping() && !from.base.markov.empty())
    starts.push_back(
        with_theta({0, std::log(kLeftSigma * kLeftSigma / kLeftTau), std::log(kLeftTau)}, e.like(slowest(from.base))));
  SearchOptions options;
  options.step = 0.3, options.max_evaluations = kProbe, options.tolerance = 0.02;
  Theta x;
  double top = -1e300;
  for (Theta at : starts)
    if (const double v = maximise(value, &at, lo, hi, options); v > top) top = v, x = at;
  if (top - from.log_likelihood < kHopeless_nats) return best;
  options.max_evaluations = kThorough;
  top = maximise(value, &x, lo, hi, options);
  best.theta = theta_of(x);
  best.base = with_factors(from.base, x);
  best.gain_nats = top - from.log_likelihood;
  const auto alone = [&](const Theta& at) { return log_likelihood(e.noise(best.base, at)); };
  best.theta_errors = curvature_errors(alone, best.theta, e.theta_lo(), e.theta_hi());
  return best;
}

} // namespace

std::vector<FastFinding> scan_fast_noise(const Campaign& campaign, const SecondsNoise& from,
                                         const std::vector<VectorXd>& residual,
                                         const std::vector<const Effect*>& library, const std::vector<bool>& active,
                                         const SelectorConstants& constants) {
  const std::vector<VectorXd> e_of_base = whitened(campaign, gaussian_equivalent(from.base), residual);
  const Moments m = moments(e_of_base);
  const bool changes_suddenly = in_sudden_changes(campaign, e_of_base, m, constants.rest_rate).evidence_nats > 0;
  const ResidualLikelihood log_likelihood(campaign, residual);
  std::vector<FastFinding> list;
  for (size_t j = 0; j < library.size(); ++j) {
    const EffectEstimator* e = library[j]->estimator();
    if (!e || !active[j] || !is_asked(*e, campaign, m, changes_suddenly)) continue;
    FastFinding f = fit_fast(log_likelihood, from, *library[j]);
    if (f.theta.empty()) continue;
    const NoiseModel with = e->noise(f.base, f.theta);
    const bool is_markov = !with.is_mixture() && with.markov.size() > f.base.markov.size();
    if (is_markov && with.markov.back().tau_s > kFastTau_s) continue;
    list.push_back(f);
  }
  std::sort(list.begin(), list.end(), [](const auto& a, const auto& b) { return a.gain_nats > b.gain_nats; });
  return list;
}

namespace {

// A power of two that holds the longest run.
size_t transform_length(const Campaign& campaign) {
  size_t longest = 0, n_fft = 64;
  for (const CampaignRun& run : campaign.runs)
    longest = std::max(longest, static_cast<size_t>(run.input.tick.back() + 1));
  while (n_fft < longest) n_fft *= 2;
  return n_fft;
}

// Sum over the runs of |transform of e|^2 / n at the bins 0 .. n_fft / 2.
std::vector<double> power_of(const Campaign& campaign, const std::vector<VectorXd>& e, const Fourier& fourier) {
  std::vector<double> power(fourier.n() / 2 + 1, 0.0);
  const auto at_ticks = [&](size_t r) {
    const CampaignRun& run = campaign.runs[r];
    std::vector<double> x(fourier.n(), 0.0);
    for (size_t k = 0; k < run.n(); ++k)
      x[static_cast<size_t>(run.input.tick[static_cast<size_t>(run.used[k])])] = e[r][static_cast<long>(k)];
    return x;
  };
  const auto scale = [&](size_t r) { return 1 / static_cast<double>(campaign.runs[r].n()); };
  for (size_t r = 0; r < e.size(); r += 2) {
    std::vector<double> one = at_ticks(r);
    if (r + 1 == e.size()) {
      add_powers(fourier, one.data(), scale(r), nullptr, 0, &power);
    } else {
      std::vector<double> other = at_ticks(r + 1);
      add_powers(fourier, one.data(), scale(r), other.data(), scale(r + 1), &power);
    }
  }
  return power;
}

// Slopes of drift, in units: the next is `step` further, and the step grows by `growth` each time.
struct Slopes {
  long first, step, growth;
};

// Sums over the runs of |transform of e exp(-i slope phi)|^2 / n, slope after slope; phi is the phase that a slope of one
// unit has run through.  What turns a sample from slope to slope is multiplied by one factor at each: sines and cosines
// are taken once.
class DriftingPower {
public:
  DriftingPower(const Campaign& campaign, const std::vector<VectorXd>& e, const Fourier& fourier, const Slopes& slopes)
      : fourier_(fourier) {
    for (size_t r = 0; r < e.size(); ++r) {
      const CampaignRun& run = campaign.runs[r];
      double phase = 0;
      long last = 0;
      Turned turned;
      for (size_t k = 0; k < run.n(); ++k) {
        const size_t row = static_cast<size_t>(run.used[k]);
        const long tick = run.input.tick[row];
        phase += 2 * kPi * kSlopeUnit * (run.input.smooth_degc[row] - run.input.t0_degc) *
                 static_cast<double>(tick - last) * campaign.dt_s;
        last = tick;
        const auto turn = [&](long units) { return std::polar(1.0, -phase * static_cast<double>(units)); };
        turned.tick.push_back(static_cast<size_t>(tick));
        turned.e.push_back(e[r][static_cast<long>(k)] * turn(slopes.first));
        turned.step.push_back(turn(slopes.step)), turned.growth.push_back(turn(slopes.growth));
      }
      runs_.push_back(std::move(turned));
    }
  }

  // The next slopes, as many as a transform takes side by side; then power(..) speaks of them.
  void sum_next() {
    const size_t n = fourier_.n();
    sum_.assign(n * kLanes, 0.0);
    std::vector<double> re(n * kLanes), im(n * kLanes);
    for (Turned& run : runs_) {
      std::fill(re.begin(), re.end(), 0.0), std::fill(im.begin(), im.end(), 0.0);
      for (size_t lane = 0; lane < kLanes; ++lane) put_and_turn(&run, lane, re.data(), im.data());
      fourier_.transform_lanes(re.data(), im.data());
      add_squares(re, im, 1 / static_cast<double>(run.e.size()), &sum_);
    }
  }
  // At the bins 0 .. n_fft / 2 - 1, of one of these slopes or of its opposite: the samples are real, so that along the
  // opposite slope a transform has the same values at the negative frequencies.
  std::vector<double> power(size_t lane, bool is_opposite) const {
    const size_t n = fourier_.n();
    std::vector<double> out(n / 2);
    for (size_t i = 0; i < out.size(); ++i)
      out[i] = sum_[fourier_.place(is_opposite && i > 0 ? n - i : i) * kLanes + lane];
    return out;
  }
  static constexpr size_t kLanes = Fourier::kLanes;

private:
  using Complex = std::complex<double>;
  struct Turned {
    std::vector<size_t> tick;
    std::vector<Complex> e, step, growth;
  };
  // Without the checks for infinite parts that the operator makes.
  static Complex times(const Complex& a, const Complex& b) {
    return {a.real() * b.real() - a.imag() * b.imag(), a.real() * b.imag() + a.imag() * b.real()};
  }
  static void put_and_turn(Turned* run, size_t lane, double* re, double* im) {
    for (size_t i = 0; i < run->e.size(); ++i) {
      const size_t at = run->tick[i] * kLanes + lane;
      re[at] = run->e[i].real(), im[at] = run->e[i].imag();
      run->e[i] = times(run->e[i], run->step[i]);
      run->step[i] = times(run->step[i], run->growth[i]);
    }
  }

  const Fourier& fourier_;
  std::vector<Turned> runs_;
  std::vector<double> sum_; // [place][slope]
};

// -ln P(power > x) where `runs` runs give exponential powers of mean 1: the sum's distribution is Gamma(runs), and
// P = exp(-x) (1 + x + .. + x^(runs - 1)/(runs - 1)!).  One run: x itself.  Never more than x.
double gain_of_power(double x, size_t runs) {
  double log_term = 0, log_sum = 0; // many logs with a strong line: the terms themselves would leave the range
  for (size_t k = 1; k < runs; ++k) {
    log_term += std::log(x / static_cast<double>(k));
    log_sum = std::max(log_sum, log_term) + std::log1p(std::exp(-std::abs(log_sum - log_term)));
  }
  return x - log_sum;
}

// A line stands out of the mean of its surroundings.  power: summed over the runs; white noise has 1 in each.
void take_line(const std::vector<double>& power, size_t runs, double hz_of_bin, double slope, size_t bins, Line* best) {
  const size_t first = static_cast<size_t>(kSlowestLine_hz / hz_of_bin) + 1;
  std::vector<double> sum(bins + 1, 0.0);
  for (size_t i = 0; i < bins; ++i) sum[i + 1] = sum[i] + power[i];
  for (size_t i = first; i + 1 < bins; ++i) {
    if (power[i] <= best->gain_nats || power[i] < power[i - 1]) continue;
    const size_t lo = i > first + kSurroundings ? i - kSurroundings : first, hi = std::min(bins - 1, i + kSurroundings);
    const double own = power[i] + power[i - 1] + power[i + 1];
    const double around = (sum[hi + 1] - sum[lo] - own) / static_cast<double>(hi - lo - 2);
    const double background = std::max(1.0, around / static_cast<double>(runs)); // of one run
    const double gain = gain_of_power(power[i] / background, runs);
    if (gain > best->gain_nats) *best = {static_cast<double>(i) * hz_of_bin, slope, gain};
  }
}

// The strongest line that does not drift; power as power_of gives it.
Line steady_line(const Campaign& campaign, const std::vector<double>& power) {
  const size_t bins = power.size() - 1;
  Line best;
  take_line(power, campaign.runs.size(), 1 / (2 * static_cast<double>(bins) * campaign.dt_s), 0, bins, &best);
  return best;
}

} // namespace

Line strongest_line(const Campaign& campaign, const std::vector<VectorXd>& e, bool with_drift) {
  const Line steady = steady_line(campaign, power_of(campaign, e, Fourier(transform_length(campaign))));
  return with_drift ? stronger_drifting(campaign, e, steady) : steady;
}

Line stronger_drifting(const Campaign& campaign, const std::vector<VectorXd>& e, const Line& steady) {
  if (!campaign.has_temperature) return steady;
  const Fourier fourier(transform_length(campaign));
  const size_t bins = fourier.n() / 2, runs = campaign.runs.size();
  const double hz = 1 / (static_cast<double>(fourier.n()) * campaign.dt_s);
  Line best = steady;
  DriftingPower turned(campaign, e, fourier, {1, 3, 2}); // k^2
  for (int k = 1; k <= kSlopes; ++k) {
    const size_t lane = static_cast<size_t>(k - 1) % DriftingPower::kLanes;
    if (lane == 0) turned.sum_next();
    take_line(turned.power(lane, true), runs, hz, -kSlopeUnit * k * k, bins, &best);
    take_line(turned.power(lane, false), runs, hz, kSlopeUnit * k * k, bins, &best);
  }
  return best;
}

namespace {

// The strongest line of all slopes between the neighbours of a slope on the grid, unit by unit.
Line between_slopes(const Campaign& campaign, const std::vector<VectorXd>& e, const Line& line) {
  const Fourier fourier(transform_length(campaign));
  const size_t bins = fourier.n() / 2, runs = campaign.runs.size();
  const double hz = 1 / (static_cast<double>(fourier.n()) * campaign.dt_s);
  const long place = std::lround(std::sqrt(std::abs(line.hz_per_degc) / kSlopeUnit));
  const long first = (place - 1) * (place - 1) + 1, last = (place + 1) * (place + 1) - 1;
  Line best = line;
  DriftingPower turned(campaign, e, fourier, {first, 1, 0});
  for (long units = first; units <= last; ++units) {
    const size_t lane = static_cast<size_t>(units - first) % DriftingPower::kLanes;
    if (lane == 0) turned.sum_next();
    const double slope = std::copysign(kSlopeUnit * static_cast<double>(units), line.hz_per_degc);
    take_line(turned.power(lane, slope < 0), runs, hz, slope, bins, &best);
  }
  return best;
}

// Power along the cosine and the sine of a tone, in nats against white noise of 1, all runs together.
double power_along(const Campaign& campaign, const std::vector<VectorXd>& e, const EffectEstimator& tone,
                   const Theta& shape) {
  double sum = 0;
  for (size_t r = 0; r < e.size(); ++r) {
    const Eigen::MatrixXd x = used_rows(campaign.runs[r], tone.columns(campaign.runs[r].input, shape));
    sum += (x.transpose() * e[r]).squaredNorm() / static_cast<double>(e[r].size());
  }
  return sum;
}

} // namespace

PlacedLine place_of(const Campaign& campaign, const std::vector<VectorXd>& e, const EffectEstimator& tone,
                    const Line& line) {
  const bool drifts = line.hz_per_degc != 0;
  const Line near = drifts ? between_slopes(campaign, e, line) : line;
  const double bin_hz = 1 / (static_cast<double>(transform_length(campaign)) * campaign.dt_s);
  const double t0_degc = campaign.runs.front().input.t0_degc;
  // In bins and units of slope; the effect's frequency is that at 0 degC.
  const auto shape = [&](const Theta& x) {
    const double slope = drifts ? near.hz_per_degc + kSlopeUnit * x[1] : 0;
    const double hz = near.hz + bin_hz * x[0];
    return drifts ? Theta{hz - slope * t0_degc, slope} : Theta{hz};
  };
  Theta x(drifts ? 2 : 1, 0.0);
  SearchOptions options;
  options.max_evaluations = 80, options.tolerance = 1e-3;
  const double power = maximise([&](const Theta& at) { return power_along(campaign, e, tone, shape(at)); }, &x,
                                Theta(x.size(), -1.0), Theta(x.size(), 1.0), options);
  return {shape(x), power};
}

// The power is the gain in log-likelihood with the best amplitude and phase of every run.
Theta errors_of_place(const Campaign& campaign, const std::vector<VectorXd>& e, const EffectEstimator& tone,
                      const Theta& place) {
  const double bin_hz = 1 / (static_cast<double>(transform_length(campaign)) * campaign.dt_s);
  const double unit[] = {bin_hz, kSlopeUnit};
  Theta errors = curvature_errors(
      [&](const Theta& off) {
        Theta shape = place;
        for (size_t i = 0; i < shape.size(); ++i) shape[i] += off[i] * unit[i];
        return power_along(campaign, e, tone, shape);
      },
      Theta(place.size(), 0.0), Theta(place.size(), -1.0), Theta(place.size(), 1.0));
  for (size_t i = 0; i < errors.size(); ++i) errors[i] *= unit[i];
  return errors;
}

namespace {

constexpr double kTempCell_degc = 4, kTimeBlock_s = 600, kBurst_s = 30;
constexpr long kNeighbours[] = {10, 60};       // samples within which hits of one burst follow each other
constexpr double kSudden_s[] = {5., 15., 50.}; // of innovations: where sudden changes show
constexpr double kFewestSmoothed = 500;        // smoothing times in all logs: fewer have no normal moments
constexpr double kMomentTail = 1.4;            // moments of so many reach this much further than a normal
constexpr double kFewestInCell = 60;
constexpr double kFewestPeriods = 6;          // of a frequency in the longest run: the mean takes what is slower
constexpr double kFewestDegreesOfFreedom = 8; // of a bin of the spectrum

// Strength by temperature, in cells of a few degrees.
RestFinding over_temperature(const Campaign& campaign, const std::vector<VectorXd>& e, double rate) {
  const double span_degc = campaign.has_temperature ? campaign.hi_degc - campaign.lo_degc : 0;
  const size_t cells = static_cast<size_t>(std::max(1.0, std::ceil(span_degc / kTempCell_degc)));
  std::vector<double> sum(cells, 0.0), n(cells, 0.0);
  for (size_t r = 0; r < e.size(); ++r) {
    const CampaignRun& run = campaign.runs[r];
    for (long k = 0; k < e[r].size(); ++k) {
      const double temp = run.input.smooth_degc[static_cast<size_t>(run.used[static_cast<size_t>(k)])];
      const size_t c =
          std::min(cells - 1, static_cast<size_t>(std::max(0.0, (temp - campaign.lo_degc) / kTempCell_degc)));
      sum[c] += e[r][k] * e[r][k], n[c] += 1;
    }
  }
  double statistic = 0, dof = 0;
  for (size_t c = 0; c < cells; ++c)
    if (n[c] > kFewestInCell) statistic += variance_ratio(sum[c] / n[c], n[c]), dof += 1;
  return finding(Rest::kVarianceOverTemperature, statistic, dof, rate);
}

// Strength by time, in blocks of ten minutes.
RestFinding over_time(const Campaign& campaign, const std::vector<VectorXd>& e, double rate) {
  const long block = std::max(1L, std::lround(kTimeBlock_s / campaign.dt_s));
  const double n = static_cast<double>(block);
  double statistic = 0, dof = 0;
  for (const VectorXd& x : e)
    for (long k = 0; k + block <= x.size(); k += block)
      statistic += variance_ratio(x.segment(k, block).squaredNorm() / n, n), dof += 1;
  return finding(Rest::kVarianceOverTime, statistic, dof, rate);
}

// Squares of neighbours that are large together, in standard errors.
double strong_neighbours(const std::vector<VectorXd>& e, const Moments& m, long reach) {
  double sum = 0, square = 0, n = 0;
  for (const VectorXd& x : e) {
    const VectorXd h = x.array().square() / m.var - 1;
    double near = 0;
    for (long k = 0; k < h.size(); ++k) {
      sum += h[k] * near, square += h[k] * h[k], n += 1;
      near += h[k] - (k >= reach ? h[k - reach] : 0.0);
    }
  }
  return square > 0 ? std::max(0.0, sum / (square * std::sqrt(static_cast<double>(reach) / n))) : 0;
}

// Strong samples that follow each other within a minute, or neighbouring half minutes that are both strong.
RestFinding in_bursts(const Campaign& campaign, const std::vector<VectorXd>& e, const Moments& m, double rate) {
  const long block = std::max(1L, std::lround(kBurst_s / campaign.dt_s));
  const double n = static_cast<double>(block);
  double sum = 0, count = 0;
  for (const VectorXd& x : e) {
    double before = 0;
    for (long k = 0; k + block <= x.size(); k += block) {
      const double excess = (x.segment(k, block).squaredNorm() / n - m.var) * std::sqrt(n / 2);
      if (k > 0) sum += excess * before, count += 1;
      before = excess;
    }
  }
  double z = count > 0 ? std::max(0.0, sum / std::sqrt(count)) : 0;
  for (long reach : kNeighbours) z = std::max(z, strong_neighbours(e, m, reach));
  return finding(Rest::kBursts, z * z, 1, rate / (1 + std::size(kNeighbours)));
}

// Largest third or fourth Hermite moment of innovations smoothed over tau, in standard errors: of N(0,1) samples with the
// correlation a^n the sum of He_m has the variance m! n (1 + a^m)/(1 - a^m).
double smoothed_moment(const std::vector<VectorXd>& e, double a) {
  double s2 = 0, s3 = 0, s4 = 0, n = 0;
  std::vector<VectorXd> smooth;
  const double b = std::sqrt(1 - a * a);
  for (const VectorXd& x : e) {
    VectorXd z(x.size());
    double state = 0;
    for (long k = x.size() - 1; k >= 0; --k) z[k] = state = a * state + b * x[k];
    s2 += z.squaredNorm(), n += static_cast<double>(z.size());
    smooth.push_back(std::move(z));
  }
  if (!(s2 > 0)) return 0;
  for (const VectorXd& z : smooth) {
    const Eigen::ArrayXd u = z.array() * std::sqrt(n / s2), uu = u.square();
    s3 += (u * (uu - 3)).sum(), s4 += (uu * uu - 6 * uu + 3).sum();
  }
  const double a3 = a * a * a, a4 = a3 * a;
  return std::max(std::fabs(s3) / std::sqrt(6 * n * (1 + a3) / (1 - a3)),
                  std::fabs(s4) / std::sqrt(24 * n * (1 + a4) / (1 - a4)));
}

// Jumps, teeth and slips: a Gaussian noise takes their spectrum, not their moments.  The filter forgets what it knew, so
// that a jump is a run of innovations of one sign.
RestFinding in_sudden_changes(const Campaign& campaign, const std::vector<VectorXd>& e, const Moments& m, double rate) {
  double z = 0;
  for (double tau_s : kSudden_s)
    if (m.n * campaign.dt_s > kFewestSmoothed * tau_s)
      z = std::max(z, smoothed_moment(e, std::exp(-campaign.dt_s / tau_s)));
  z /= kMomentTail;
  return finding(Rest::kSuddenChanges, z * z, 1, rate / (2 * std::size(kSudden_s)));
}

// Binned periodogram against a flat one; power as power_of gives it.
RestFinding in_spectrum(const Campaign& campaign, const std::vector<double>& power, double rate) {
  size_t longest = 0;
  for (const CampaignRun& run : campaign.runs)
    longest = std::max(longest, static_cast<size_t>(run.input.tick.back() + 1));
  const SpectrumBins bins(longest, campaign.dt_s);
  std::vector<double> sum(bins.n_bins(), 0.0), weight(bins.n_bins(), 0.0);
  bins.add(power, static_cast<double>(campaign.runs.size()), &sum, &weight);
  double statistic = 0, dof = 0;
  const double padding = static_cast<double>(longest) / static_cast<double>(bins.n_fft);
  for (size_t b = 0; b < sum.size(); ++b) {
    const double n = 2 * weight[b] * padding; // degrees of freedom: neighbours of a padded transform depend
    if (bins.centres()[b] < kFewestPeriods / (static_cast<double>(longest) * campaign.dt_s) ||
        n < kFewestDegreesOfFreedom)
      continue;
    statistic += variance_ratio(sum[b] / weight[b], n);
    dof += 1;
  }
  return finding(Rest::kSpectrum, statistic, dof, rate);
}

} // namespace

std::vector<RestFinding> test_rest(const Campaign& campaign, const std::vector<VectorXd>& e,
                                   const SelectorConstants& constants) {
  const double rate = constants.rest_rate;
  const Moments m = moments(e);
  const double heavy = (m.kurtosis - 3) * std::sqrt(m.n / 24);
  const Fourier fourier(transform_length(campaign));
  const std::vector<double> power = power_of(campaign, e, fourier);
  return {over_temperature(campaign, e, rate),
          over_time(campaign, e, rate),
          finding(Rest::kDistribution, heavy * heavy, 1, rate),
          in_bursts(campaign, e, m, rate),
          in_spectrum(campaign, power, rate),
          {Rest::kLine, steady_line(campaign, power).gain_nats - constants.rest_line_nats},
          in_sudden_changes(campaign, e, m, rate)};
}

} // namespace imucal
