// SPDX-License-Identifier: MIT
#include "analysis/diagnose/stages/seconds_noise.h"

#include <algorithm>
#include <cmath>

#include "analysis/diagnose/evidence/free_spectrum.h"
#include "analysis/diagnose/evidence/kalman.h"
#include "analysis/diagnose/evidence/maximise.h"
#include "analysis/diagnose/logs/blocks.h"
#include "analysis/diagnose/stages/rest.h"
#include "noise/likelihood.h"

namespace imucal {

using Eigen::VectorXd;

namespace {

constexpr double kHeavy = 4;               // standard errors of the kurtosis from which hits are looked for
constexpr int kProbe = 30, kThorough = 80; // evaluations of a kind of fast noise; thorough where a probe gains
constexpr double kHopeless_nats = 2;       // after the probe: what gains 8 in the end has gained this by then
constexpr double kWhiteSamples = 3;        // a process that follows the temperature and forgets within so many is white
constexpr double kFastTau_s = 30;          // a second Markov process slower than this belongs to the slow stage

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

std::vector<VectorXd> innovations_less_hits(const Campaign& campaign, const NoiseModel& noise, const Fit& fit) {
  const std::optional<StandingOut> hits = standing_out(campaign, fit.residual);
  if (!hits || noise.is_mixture()) return fit.e;
  return whitened(campaign.runs, gaussian_equivalent(noise), hits->left);
}

namespace {

// What the seconds can show of a kind of noise: hits and telegraph noise where the distribution says so, that one also
// where the innovations change suddenly, white noise over temperature always, another Markov process as far as it is fast.
// Where no slow noise fits their spectrum, all stationary kinds of it.
bool is_asked(const EffectEstimator& e, const Campaign& campaign, double heavy, bool changes_suddenly, bool asks_slow) {
  if (e.form() != Form::kNoise || e.is_nominal_noise()) return false;
  if (e.needs_temperature() && !campaign.has_temperature) return false;
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
  const std::vector<VectorXd> e_of_base = whitened(campaign.runs, gaussian_equivalent(from.base), residual);
  // Hits that stand out are sudden and no jumps.
  const std::vector<VectorXd> e_less_hits =
      hits ? whitened(campaign.runs, gaussian_equivalent(hits->beside.base), hits->left) : e_of_base;
  const double heavy = heavy_tails(e_of_base), heavy_less_hits = heavy_tails(e_less_hits);
  FastScan scan;
  scan.changes_suddenly = changes_suddenly(campaign, e_less_hits, constants);
  const bool asks_slow = may_ask_slow && has_spectrum(campaign, e_of_base, constants);
  const ResidualLikelihood log_likelihood(campaign, residual);
  std::vector<FastFinding>& list = scan.findings;
  for (size_t j = 0; j < library.size(); ++j) {
    const EffectEstimator* e = library[j]->estimator();
    if (!e || !active[j]) continue;
    if (!is_asked(*e, campaign, e->is_jumping() ? heavy_less_hits : heavy, scan.changes_suddenly, asks_slow)) continue;
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

} // namespace imucal
