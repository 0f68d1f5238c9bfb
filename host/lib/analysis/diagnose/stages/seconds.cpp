// SPDX-License-Identifier: MIT
#include "analysis/diagnose/stages/seconds.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "analysis/diagnose/evidence/free_spectrum.h"
#include "analysis/diagnose/evidence/kalman.h"
#include "analysis/diagnose/evidence/lines.h"
#include "analysis/diagnose/evidence/spectrum.h"
#include "analysis/diagnose/logs/blocks.h"
#include "base/quantile.h"
#include "base/units.h"
#include "noise/likelihood.h"

namespace imucal {

using Eigen::VectorXd;

namespace {

constexpr double kHeavy = 4;               // standard errors of the kurtosis from which hits are looked for
constexpr int kProbe = 30, kThorough = 80; // evaluations of a kind of fast noise; thorough where a probe gains
constexpr double kHopeless_nats = 2;       // after the probe: what gains 8 in the end has gained this by then
constexpr double kWhiteSamples = 3;        // a process that follows the temperature and forgets within so many is white
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
  GainsByRun gains(campaign.runs, noise);
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
    const CampaignRun* before = alike_.empty() ? nullptr : &campaign.runs[alike_.back().first];
    if (!before || before->steps != run.steps || before->own_white_dph2 != run.own_white_dph2)
      alike_.push_back({r, {}});
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

// Gains that follow the temperature are those of one run; others serve all runs of the same times and rounding.
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

// Of white noise, slow density and time constant, as logarithms.  A process that follows the temperature and forgets within a
// few samples is white noise that does: it would pass for that one under the name of slow noise.
std::pair<Theta, Theta> bounds_of_factors(double dt_s, const NoiseModel& noise) {
  Theta lo{-6, -9, -6};
  if (noise.markov_slope == 0 && noise.tau_slope == 0) return {lo, {6, 9, 6}};
  for (const Markov& m : noise.markov) lo[2] = std::max(lo[2], std::log(kWhiteSamples * dt_s / m.tau_s));
  lo[2] = std::min(lo[2], 0.0);
  return {lo, {6, 9, 6}};
}

} // namespace

SecondsNoise fit_seconds_noise(const Campaign& campaign, const NoiseModel& start, const std::vector<VectorXd>& residual,
                               const std::function<NoiseModel(const NoiseModel&)>& with) {
  const ResidualLikelihood log_likelihood(campaign, residual);
  Theta x{0, 0, 0};
  const auto [lo, hi] = bounds_of_factors(campaign.dt_s, with ? with(start) : start);
  SearchOptions options;
  options.step = 0.3, options.max_evaluations = 60, options.tolerance = 0.02;
  SecondsNoise out;
  out.log_likelihood = maximise(
      [&](const Theta& at) {
        const NoiseModel noise = with_factors(start, at.data());
        return log_likelihood(with ? with(noise) : noise);
      },
      &x, lo, hi, options);
  out.base = with_factors(start, x.data());
  return out;
}

std::optional<StandingOut> standing_out(const Campaign& campaign, const std::vector<VectorXd>& residual) {
  StandingOut out;
  double n = 0, squares = 0;
  for (const VectorXd& hits : hits_of(campaign)) {
    n += static_cast<double>((hits.array() != 0).count()), squares += hits.squaredNorm();
    out.left.push_back(residual[out.left.size()] - hits);
  }
  if (n == 0) return std::nullopt;
  out.part = n / static_cast<double>(campaign.n()), out.rms_dph = std::sqrt(squares / n);
  return out;
}

namespace {

RestFinding in_sudden_changes(const Campaign& campaign, const std::vector<VectorXd>& e, const Moments& m, double rate);
RestFinding in_spectrum(const Campaign& campaign, const std::vector<double>& power, double rate);

// What the seconds can show of a kind of noise: hits and telegraph noise where the distribution says so, that one also
// where the innovations change suddenly, white noise over temperature always, another Markov process as far as it is fast.
// Where no slow noise fits their spectrum, all stationary kinds of it.
bool is_asked(const EffectEstimator& e, const Campaign& campaign, const Moments& m, bool changes_suddenly,
              bool asks_slow) {
  if (e.form() != Form::kNoise || e.is_nominal_noise()) return false;
  if (e.needs_temperature() && !campaign.has_temperature) return false;
  const double heavy = (m.kurtosis - 3) * std::sqrt(m.n / 24);
  NoiseModel unit;
  unit.white_sigma_dph = 1, unit.markov = {{1, 100}};
  const std::vector<Theta> starts = e.starts(unit);
  if (starts.empty()) return false;
  const NoiseModel example = e.noise(unit, starts.front());
  if (example.is_mixture()) return heavy > kHeavy || (e.is_jumping() && (heavy < -kHeavy || changes_suddenly));
  return !e.is_slow_noise() || example.markov.size() == 2 || (asks_slow && !e.needs_temperature());
}

// Where a noise effect is searched: factors on the noise beside it (none: that noise stays as it is), then its parameters.
class FastPlace {
public:
  // Only the first factors are free: white noise, slow density, time constant.
  FastPlace(const ResidualLikelihood& log_likelihood, const FastFinding& finding, size_t n_factors)
      : finding_(finding), e_(*finding.effect->estimator()), n_factors_(n_factors),
        bounds_(bounds_of_factors(log_likelihood.dt_s(), finding.base)) {}
  static constexpr size_t kFactors = 3;

  Theta lo() const { return at(first(bounds_.first), e_.theta_lo()); }
  Theta hi() const { return at(first(bounds_.second), e_.theta_hi()); }
  Theta at(Theta factors, const Theta& theta) const {
    for (double v : theta) factors.push_back(e_.is_logarithmic() ? std::log(v) : v);
    return factors;
  }
  Theta start(const Theta& theta) const { return at(Theta(n_factors_, 0.0), theta); }
  Theta theta(const Theta& x) const {
    Theta out;
    for (size_t i = n_factors_; i < x.size(); ++i) out.push_back(e_.is_logarithmic() ? std::exp(x[i]) : x[i]);
    return out;
  }
  NoiseModel base(const Theta& x) const {
    if (n_factors_ == 0) return finding_.base;
    double factors[kFactors] = {};
    std::copy_n(x.begin(), n_factors_, factors);
    return with_factors(finding_.base, factors);
  }
  NoiseModel noise(const Theta& x) const {
    FastFinding at = finding_;
    at.theta = theta(x);
    return at.noise_on(base(x));
  }

private:
  Theta first(Theta factors) const {
    factors.resize(n_factors_);
    return factors;
  }
  const FastFinding& finding_;
  const EffectEstimator& e_;
  size_t n_factors_;
  std::pair<Theta, Theta> bounds_;
};

// Joint search over the parameters of the effect and of the noise beside it.
FastFinding fit_fast(const ResidualLikelihood& log_likelihood, const SecondsNoise& from, const Effect& effect,
                     bool asks_slow, const Theta& further_start = {}) {
  const EffectEstimator& e = *effect.estimator();
  FastFinding best;
  best.effect = &effect;
  best.gain_nats = -1e300;
  FastFinding about;
  about.effect = &effect, about.base = from.base;
  const FastPlace place(log_likelihood, about, FastPlace::kFactors);
  const Theta lo = place.lo(), hi = place.hi();
  const auto value = [&](const Theta& x) { return log_likelihood(place.noise(x)); };
  const auto best_start = [&] {
    Theta x;
    double highest = -1e300;
    std::vector<Theta> all = e.starts(from.base);
    if (!further_start.empty()) all.push_back(further_start);
    for (const Theta& theta : all) {
      const Theta at = place.start(theta);
      if (const double v = value(at); v > highest) highest = v, x = at;
    }
    return x;
  };
  std::vector<Theta> starts;
  if (const Theta x = best_start(); !x.empty()) starts.push_back(x);
  // The fitted noise has swallowed what jumps: it starts like that process, beside what a smaller and faster one leaves.
  if ((e.is_jumping() || (asks_slow && e.is_slow_noise())) && !from.base.markov.empty())
    starts.push_back(place.at(left_by_swallowed(), e.like(slowest(from.base))));
  SearchOptions options;
  options.step = 0.3, options.max_evaluations = kProbe, options.tolerance = 0.02;
  Theta x;
  double top = -1e300;
  for (Theta at : starts)
    if (const double v = maximise(value, &at, lo, hi, options); v > top) top = v, x = at;
  if (top - from.log_likelihood < kHopeless_nats) return best;
  options.max_evaluations = kThorough;
  top = maximise(value, &x, lo, hi, options);
  best.theta = place.theta(x);
  best.base = place.base(x);
  best.gain_nats = top - from.log_likelihood;
  return best;
}

} // namespace

namespace {

// Where the noise without a kind is searched again: the noise beside it, and the process that the kind adds in the place of
// that one's.
std::vector<NoiseModel> plain_starts(const FastFinding& f) {
  std::vector<NoiseModel> starts = {f.base};
  const NoiseModel with = f.effect->estimator()->noise(f.base, f.theta);
  if (with.is_mixture() || f.base.markov.empty() || with.markov.size() <= f.base.markov.size()) return starts;
  starts.push_back(f.base);
  starts.back().markov = {with.markov.back()};
  return starts;
}

} // namespace

// Beside the process of the noise or that of the kind: either may be the one that the sensor has.
double gain_of_free_spectrum(const Campaign& campaign, const std::vector<VectorXd>& residual,
                             const FastFinding& finding) {
  const ResidualLikelihood log_likelihood(campaign, residual);
  double best = -1e300;
  for (const NoiseModel& base : plain_starts(finding)) {
    const SecondsNoise from{base, log_likelihood(base)};
    best = std::max(best, from.log_likelihood + fit_fast(log_likelihood, from, free_spectrum(), true).gain_nats);
  }
  return best - log_likelihood(finding.noise());
}

NoiseModel FastFinding::noise_on(const NoiseModel& any_base) const {
  return effect->estimator()->noise(other ? other->noise(any_base, other_theta) : any_base, theta);
}
double fit_again(const ResidualLikelihood& log_likelihood, bool is_base_free, FastFinding* finding) {
  const FastFinding from = *finding;
  const FastPlace place(log_likelihood, from, is_base_free ? FastPlace::kFactors : size_t{0});
  Theta x = place.start(finding->theta);
  SearchOptions options;
  options.step = 0.1, options.max_evaluations = kThorough, options.tolerance = 0.02;
  const double top =
      maximise([&](const Theta& at) { return log_likelihood(place.noise(at)); }, &x, place.lo(), place.hi(), options);
  finding->theta = place.theta(x), finding->base = place.base(x);
  return top;
}
namespace {
FastFinding beside(FastFinding kind, const FastFinding& other) {
  kind.base = other.base, kind.other = other.effect->estimator(), kind.other_theta = other.theta;
  return kind;
}
} // namespace
FastFinding second_kind(const ResidualLikelihood& log_likelihood, bool is_base_free,
                        const std::vector<FastFinding>& rest, double least_nats, FastFinding* first) {
  double alone = log_likelihood(first->noise()), both = -1e300;
  FastFinding found, first_beside;
  for (const FastFinding& kind : rest) {
    if (kind.gain_nats < kHopeless_nats) continue;
    FastFinding second = beside(kind, *first);
    fit_again(log_likelihood, is_base_free, &second);
    FastFinding again = beside(*first, second);
    fit_again(log_likelihood, is_base_free, &again);
    second = beside(second, again);
    const double top = fit_again(log_likelihood, is_base_free, &second);
    if (top < std::max(alone + least_nats, both)) continue;
    both = top, found = second, first_beside = beside(again, second);
    // The search for two may have led the first to a better place: what it gains there alone is not the second's.
    FastFinding moved = *first;
    moved.theta = first_beside.theta, moved.base = first_beside.base;
    const double gain = fit_again(log_likelihood, is_base_free, &moved) - alone;
    if (gain > 0) *first = moved, first->gain_nats += gain, alone += gain;
  }
  if (!found.effect || both - alone < least_nats) return {};
  found.gain_nats = both - alone;
  first_beside.gain_nats = first->gain_nats;
  *first = first_beside;
  return found;
}
// A factor that the residual does not tell leaves no curvature: then fewer are free.
void set_errors(const ResidualLikelihood& log_likelihood, FastFinding* finding) {
  const EffectEstimator& e = *finding->effect->estimator();
  const FastFinding from = *finding;
  const bool is_slow_to_ask = from.noise().is_mixture();
  for (const size_t n_free : {is_slow_to_ask ? size_t{1} : FastPlace::kFactors, size_t{1}, size_t{0}}) {
    const FastPlace place(log_likelihood, from, n_free);
    const Theta errors = curvature_errors([&](const Theta& x) { return log_likelihood(place.noise(x)); },
                                          place.start(finding->theta), place.lo(), place.hi());
    finding->theta_errors.assign(errors.begin() + static_cast<long>(n_free), errors.end());
    for (size_t i = 0; e.is_logarithmic() && i < finding->theta.size(); ++i)
      finding->theta_errors[i] *= finding->theta[i];
    const auto is_known = [](double error) { return std::isfinite(error); };
    if (std::all_of(finding->theta_errors.begin(), finding->theta_errors.end(), is_known)) return;
  }
}

FastScan scan_fast_noise(const Campaign& campaign, const SecondsNoise& from, const std::vector<VectorXd>& residual,
                         const std::vector<const Effect*>& library, const std::vector<bool>& active,
                         const SelectorConstants& constants, bool may_ask_slow,
                         const std::optional<StandingOut>& hits) {
  const std::vector<VectorXd> e_of_base = whitened(campaign, gaussian_equivalent(from.base), residual);
  // Hits that stand out are sudden and no jumps.
  const std::vector<VectorXd> e_less_hits =
      hits ? whitened(campaign, gaussian_equivalent(hits->beside.base), hits->left) : e_of_base;
  const Moments m = moments(e_of_base), less = moments(e_less_hits);
  FastScan scan;
  scan.changes_suddenly = in_sudden_changes(campaign, e_less_hits, less, constants.rest_rate).evidence_nats > 0;
  const bool asks_slow =
      may_ask_slow && in_spectrum(campaign, summed_power(campaign, e_of_base), constants.rest_rate).evidence_nats > 0;
  const ResidualLikelihood log_likelihood(campaign, residual);
  std::vector<FastFinding>& list = scan.findings;
  for (size_t j = 0; j < library.size(); ++j) {
    const EffectEstimator* e = library[j]->estimator();
    if (!e || !active[j]) continue;
    if (!is_asked(*e, campaign, e->is_jumping() ? less : m, scan.changes_suddenly, asks_slow)) continue;
    const Theta like_hits = hits ? e->like_hits(hits->part, hits->rms_dph) : Theta();
    const SecondsNoise start = like_hits.empty() ? from : SecondsNoise{hits->beside.base, from.log_likelihood};
    FastFinding f = fit_fast(log_likelihood, start, *library[j], asks_slow, like_hits);
    if (f.theta.empty()) continue;
    const NoiseModel with = e->noise(f.base, f.theta);
    const bool is_markov = !with.is_mixture() && with.markov.size() > f.base.markov.size();
    if (is_markov && !asks_slow && with.markov.back().tau_s > kFastTau_s) continue;
    list.push_back(f);
  }
  std::sort(list.begin(), list.end(), [](const auto& a, const auto& b) { return a.gain_nats > b.gain_nats; });
  scan.plain = from;
  for (const FastFinding& f : list) {
    if (f.gain_nats < constants.fast_nats) break;
    for (const NoiseModel& start : plain_starts(f)) {
      const SecondsNoise alone = fit_seconds_noise(campaign, start, residual);
      if (alone.log_likelihood > scan.plain.log_likelihood) scan.plain = alone;
    }
  }
  for (FastFinding& f : list) f.gain_nats -= scan.plain.log_likelihood - from.log_likelihood;
  return scan;
}

namespace {

constexpr double kTempCell_degc = 4, kTimeBlock_s = 600, kBurst_s = 30;
constexpr double kSudden_s[] = {5., 15., 50., 150.}; // of innovations: where sudden changes show
// Smoothing times in all logs from which a moment is asked, and how much further than a normal one it reaches at 1 in 10,000
// (draws of white noise): the fourth needs more of them, and reaches further.
struct MomentTail {
  double fewest, reach;
};
constexpr MomentTail kThird{100, 1.1}, kFourth{500, 1.4};
constexpr double kPieceTaus = 10, kFewestSidedPieces = 30; // pieces that know nothing of each other, and enough of them
constexpr double kSidedRate =
    0.01; // at which signs drawn at random look one-sided; jumps up and down in turn do far less
constexpr long kAfterHit[] = {3, 10, 30}; // samples after a hit
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
      const double excess = (x.segment(k, block).squaredNorm() / (n * m.var) - 1) * std::sqrt(n / 2);
      if (k > 0) sum += excess * before, count += 1;
      before = excess;
    }
  }
  double z = count > 0 ? std::max(0.0, sum / std::sqrt(count)) : 0;
  for (long reach : kOfOneBurst) z = std::max(z, strong_neighbours(e, m, reach));
  return finding(Rest::kBursts, z * z, 1, rate / (1 + std::size(kOfOneBurst)));
}

// Innovations smoothed by a^n, of the same variance.  The filter forgets what it knew, so that a jump is a run of innovations
// of one sign; smoothed from the end.
VectorXd smoothed(const VectorXd& e, double a) {
  VectorXd z(e.size());
  const double b = std::sqrt(1 - a * a);
  double state = 0;
  for (long k = e.size() - 1; k >= 0; --k) z[k] = state = a * state + b * e[k];
  return z;
}

// Larger of the third and the fourth Hermite moment of innovations smoothed over tau, in standard errors of a normal: of N(0,1)
// samples with the correlation a^n the sum of He_m has the variance m! n (1 + a^m)/(1 - a^m).  times: of smoothing, in all logs.
double smoothed_moment(const std::vector<VectorXd>& e, double a, double times) {
  double s2 = 0, s3 = 0, s4 = 0, n = 0;
  std::vector<VectorXd> smooth;
  for (const VectorXd& x : e) {
    smooth.push_back(smoothed(x, a));
    s2 += smooth.back().squaredNorm(), n += static_cast<double>(x.size());
  }
  if (!(s2 > 0)) return 0;
  for (const VectorXd& z : smooth) {
    const Eigen::ArrayXd u = z.array() * std::sqrt(n / s2), uu = u.square();
    s3 += (u * (uu - 3)).sum(), s4 += (uu * uu - 6 * uu + 3).sum();
  }
  const double a3 = a * a * a, a4 = a3 * a;
  const auto in_errors = [times](const MomentTail& tail, double sum, double variance) {
    return times < tail.fewest ? 0 : std::fabs(sum) / (tail.reach * std::sqrt(variance));
  };
  return std::max(in_errors(kThird, s3, 6 * n * (1 + a3) / (1 - a3)),
                  in_errors(kFourth, s4, 24 * n * (1 + a4) / (1 - a4)));
}

// Jumps, teeth and slips: a Gaussian noise takes their spectrum, not their moments.
RestFinding in_sudden_changes(const Campaign& campaign, const std::vector<VectorXd>& e, const Moments& m, double rate) {
  double z = 0;
  for (double tau_s : kSudden_s)
    z = std::max(z, smoothed_moment(e, std::exp(-campaign.dt_s / tau_s), m.n * campaign.dt_s / tau_s));
  return finding(Rest::kSuddenChanges, z * z, 1, rate / (2 * std::size(kSudden_s)));
}

// Third moment of innovations smoothed over tau against its own spread over pieces of the runs, in which it changes sign as
// often as not where jumps up and jumps down are alike.
double one_sided_moment(const std::vector<VectorXd>& e, double a, long piece) {
  double sum = 0, squares = 0;
  for (const VectorXd& x : e) {
    const VectorXd z = smoothed(x, a);
    double cubes = 0;
    for (long k = z.size() - 1; k >= 0; --k) {
      cubes += z[k] * (z[k] * z[k] - 3); // free of the mean's own linear part
      if (k % piece == 0) sum += cubes, squares += cubes * cubes, cubes = 0;
    }
  }
  return squares > 0 ? std::fabs(sum) / std::sqrt(squares) : 0;
}

// Binned periodogram against a flat one; power as summed_power gives it.  A run of n samples has n/2 independent frequencies
// of two degrees of freedom, however long its transform is.  The mean of R runs, each with a power of 1, has at K frequencies
// of the transform the variance of 2 K R h/n_fft degrees of freedom, h: harmonic mean of the runs' samples.
RestFinding in_spectrum(const Campaign& campaign, const std::vector<double>& power, double rate) {
  size_t longest = 0;
  double sum_of_inverse = 0;
  for (const CampaignRun& run : campaign.runs) {
    longest = std::max(longest, static_cast<size_t>(run.input.tick.back() + 1));
    sum_of_inverse += 1 / static_cast<double>(run.n());
  }
  const SpectrumBins bins(longest, campaign.dt_s);
  std::vector<double> sum(bins.n_bins(), 0.0), weight(bins.n_bins(), 0.0);
  bins.add(power, static_cast<double>(campaign.runs.size()), &sum, &weight);
  double statistic = 0, dof = 0;
  const double samples = static_cast<double>(campaign.runs.size()) / sum_of_inverse; // harmonic mean
  for (size_t b = 0; b < sum.size(); ++b) {
    const double n = 2 * weight[b] * samples / static_cast<double>(bins.n_fft); // degrees of freedom
    if (bins.centres()[b] < kFewestPeriods / (static_cast<double>(longest) * campaign.dt_s) ||
        n < kFewestDegreesOfFreedom)
      continue;
    statistic += variance_ratio(sum[b] / weight[b], n);
    dof += 1;
  }
  return finding(Rest::kSpectrum, statistic, dof, rate);
}

} // namespace

VectorXd with_jump_moved(VectorXd residual, double size_dph, long from, long to) {
  if (to < from) residual.segment(to, from - to).array() -= size_dph;
  if (to > from) residual.segment(from, to - from).array() += size_dph;
  return residual;
}
long sample_of_jump(const CampaignRun& run, const NoiseModel& noise, const VectorXd& residual, double size_dph, long at,
                    long reach) {
  const RunGains gains = compute_gains(run, gaussian_equivalent(noise));
  const long n = residual.size();
  long best = at;
  double least = 1e300;
  for (long k = std::max(1L, at - reach); k <= std::min(n - 1, at + reach); ++k) {
    VectorXd e = with_jump_moved(residual, size_dph, at, k);
    whiten(gains, e.data(), static_cast<size_t>(n));
    if (e.squaredNorm() < least) least = e.squaredNorm(), best = k;
  }
  return best;
}

bool is_one_sided(const Campaign& campaign, const std::vector<VectorXd>& residual, const NoiseModel& noise) {
  const std::vector<VectorXd> e = whitened(campaign, gaussian_equivalent(noise), residual);
  double z = 0, n = 0;
  for (const VectorXd& x : e) n += static_cast<double>(x.size());
  for (const double tau_s : kSudden_s) {
    const long piece = std::lround(kPieceTaus * tau_s / campaign.dt_s);
    if (n < kFewestSidedPieces * static_cast<double>(piece)) continue;
    z = std::max(z, one_sided_moment(e, std::exp(-campaign.dt_s / tau_s), std::max(1L, piece)));
  }
  return z > 0 && finding(Rest::kSuddenChanges, z * z, 1, kSidedRate / std::size(kSudden_s)).evidence_nats > 0;
}

bool do_hits_stay(const Campaign& campaign, const std::vector<VectorXd>& residual, const NoiseModel& noise,
                  const SelectorConstants& constants) {
  double sum[std::size(kAfterHit)] = {}, squares[std::size(kAfterHit)] = {};
  for (size_t r = 0; r < residual.size(); ++r) {
    VectorXd score, hit;
    mixture_log_likelihood(campaign.runs[r], noise, residual[r], &score, &hit);
    for (long k = 0; k < score.size(); ++k)
      for (size_t i = 0; i < std::size(kAfterHit); ++i) {
        const long n = kAfterHit[i];
        if (k + n >= score.size()) continue;
        const double after = score.segment(k + 1, n).sum() / std::sqrt(static_cast<double>(n));
        sum[i] += std::copysign(hit[k], score[k]) * after, squares[i] += hit[k] * hit[k];
      }
  }
  double z = 0;
  for (size_t i = 0; i < std::size(kAfterHit); ++i)
    if (squares[i] > 0) z = std::max(z, sum[i] / std::sqrt(squares[i]));
  const double rate = constants.rest_rate / std::size(kAfterHit);
  return finding(Rest::kSuddenChanges, z * z, 1, rate).evidence_nats > 0;
}

std::vector<RestFinding> test_rest(const Campaign& campaign, const std::vector<VectorXd>& e,
                                   const SelectorConstants& constants) {
  const double rate = constants.rest_rate;
  const Moments m = moments(e);
  const double heavy = (m.kurtosis - 3) * std::sqrt(m.n / 24);
  const std::vector<double> power = summed_power(campaign, e);
  std::vector<RestFinding> out = {over_temperature(campaign, e, rate),
                                  over_time(campaign, e, rate),
                                  finding(Rest::kDistribution, heavy * heavy, 1, rate),
                                  in_bursts(campaign, e, m, rate),
                                  in_spectrum(campaign, power, rate),
                                  {Rest::kLine, steady_line(campaign, power).gain_nats - constants.rest_line_nats},
                                  in_sudden_changes(campaign, e, m, rate)};
  for (RestFinding& f : out) {
    const bool is_line = f.test == Rest::kLine;
    f.threshold_nats = is_line ? constants.rest_line_nats : -std::log(rate);
    if (is_line) f.n_places = static_cast<double>(power.size());
  }
  return out;
}

Hypothesis without_jumps(Hypothesis h) {
  const auto is_of_one_log = [](const Term& term) { return term.form() == Form::kSteps; };
  h.terms.erase(std::remove_if(h.terms.begin(), h.terms.end(), is_of_one_log), h.terms.end());
  return h;
}
std::vector<RestFinding> test_unseen(const Campaign& held_out, std::vector<VectorXd> e,
                                     const SelectorConstants& constants) {
  const double variance = moments(e).var;
  if (!(variance > 0)) return {};
  for (VectorXd& x : e) x /= std::sqrt(variance);
  const Moments m = moments(e);
  const double rate = constants.rest_rate, heavy = (m.kurtosis - 3) * std::sqrt(m.n / 24);
  std::vector<RestFinding> out = {over_time(held_out, e, rate), finding(Rest::kDistribution, heavy * heavy, 1, rate),
                                  in_bursts(held_out, e, m, rate), in_sudden_changes(held_out, e, m, rate)};
  for (RestFinding& f : out) f.threshold_nats = -std::log(rate);
  return out;
}

double RestFinding::p_value() const {
  return std::min(1.0, n_places * std::exp(-evidence_nats - threshold_nats));
}

} // namespace imucal
