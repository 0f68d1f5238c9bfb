// SPDX-License-Identifier: MIT
#include "analysis/dp/ratios.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/format.h"
#include "base/median.h"
#include "base/quantile.h"

namespace imucal {

namespace {

constexpr size_t kMostOutliers = 20;
constexpr long kAround = 8;       // samples beyond the windows on both sides, to see which of them is off
constexpr double kAloneTimes = 2; // a single wrong sample is so many times as far off as any other around it

// Of a prediction over n samples from t0 on that stands out: the sample that did it.  Where one sample alone is wrong, it lies in
// the window predicted or in the one before, from which it was predicted; both errors are the same in size.  Where there is none,
// as beside a jump, it is t0.
long place_of(const Series& s, long t0, long n) {
  const long begin = std::max(0L, t0 - n), end = std::min(s.size(), t0 + n);
  std::vector<double> around;
  for (long i = std::max(0L, begin - kAround); i < std::min(s.size(), end + kAround); ++i)
    if (std::isfinite(s.rate_dph[static_cast<size_t>(i)])) around.push_back(s.rate_dph[static_cast<size_t>(i)]);
  if (around.size() < 3) return t0;
  const double middle = median(around);
  std::vector<double> off;
  for (const double rate : around) off.push_back(std::fabs(rate - middle));
  std::nth_element(off.begin(), off.end() - 2, off.end()); // the last but one, then the largest
  if (!(off.back() > kAloneTimes * off[off.size() - 2])) return t0;
  for (long i = begin; i < end; ++i)
    if (std::fabs(s.rate_dph[static_cast<size_t>(i)] - middle) == off.back()) return i;
  return t0;
}

// Joins windows that stand out at nearly the same time into events, keeping the most conspicuous.
void add_events(const Series& s, const std::vector<double>& temp_degc, const std::vector<long>& t0,
                const std::vector<double>& d, double sigma, double limit, double tau_s,
                std::vector<DpOutlier>* events) {
  DpOutlier event;
  long event_t0 = 0;
  double last_s = -1e300;
  const auto flush = [&] {
    if (event.sigmas > 0) {
      const long at = std::min(place_of(s, event_t0, std::lround(tau_s / s.dt_s)), s.size() - 1);
      event.t_s = s.t_s(at);
      event.temp_degc =
          temp_degc.empty() ? std::numeric_limits<double>::quiet_NaN() : temp_degc[static_cast<size_t>(at)];
      events->push_back(event);
    }
    event = {};
  };
  for (size_t k = 0; k < d.size(); ++k) {
    const double sigmas = std::fabs(d[k]) / sigma;
    if (sigmas <= limit) continue;
    const double t_s = s.t_s(t0[k]);
    if (t_s - last_s > tau_s + s.dt_s) flush();
    last_s = t_s;
    if (sigmas <= event.sigmas) continue;
    event_t0 = t0[k];
    event.tau_s = tau_s;
    event.sigmas = sigmas;
  }
  flush();
}

// Events of different tau at the same time are one.
std::vector<DpOutlier> merged(std::vector<DpOutlier> events) {
  std::sort(events.begin(), events.end(), [](const DpOutlier& a, const DpOutlier& b) { return a.sigmas > b.sigmas; });
  std::vector<DpOutlier> out;
  for (const DpOutlier& e : events) {
    const bool known = std::any_of(
        out.begin(), out.end(), [&](const DpOutlier& o) { return std::fabs(o.t_s - e.t_s) <= o.tau_s + e.tau_s + 1; });
    if (!known) out.push_back(e);
  }
  return out;
}

// Half of the events (at least two, apart in time) within a tenth of the temperature span: where; else NaN.
double common_temperature(const std::vector<double>& temp_degc, const std::vector<DpOutlier>& events, double* share) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  if (temp_degc.empty() || events.size() < 2) return nan;
  double lo = 1e300, hi = -1e300;
  for (double t : temp_degc)
    if (std::isfinite(t)) lo = std::min(lo, t), hi = std::max(hi, t);
  double best = nan;
  size_t most = 0;
  for (const DpOutlier& centre : events) {
    size_t near = 0;
    for (const DpOutlier& e : events) near += std::fabs(e.temp_degc - centre.temp_degc) <= 0.05 * (hi - lo);
    if (near > most) most = near, best = centre.temp_degc;
  }
  *share = static_cast<double>(most) / static_cast<double>(events.size());
  // By chance alone a tenth of the span holds a tenth of the events: two of two or three would still be chance.
  return most >= 2 && *share >= 0.5 && events.size() >= 3 ? best : nan;
}

// Two-sided limits of one record.  Half of the false-alarm rate goes to the outliers and half to the percentile, and each
// half is shared by the octaves of tau.
struct Limits {
  double rate = 0;         // of either test at one octave
  double z_percentile = 0; // standard deviations of the percentile ratio
};

Limits limits_of(const std::vector<double>& tau_s, double false_alarm_rate) {
  const double octaves = std::max(1.0, std::log2(tau_s.back() / tau_s.front()) + 1);
  const double rate = 0.5 * false_alarm_rate / octaves;
  return {rate, normal_quantile(1 - 0.5 * rate)};
}

// The percentile ratio that is furthest from the Gaussian one, among the taus that have degrees of freedom enough.
struct WorstRatio {
  double off = 0, ratio = 1, tau_s = 0; // off: in standard deviations
  bool any_dof = false;

  void add(double p95_over_rms, double dof, double at_tau_s) {
    any_dof = true;
    const double now = (p95_over_rms - kPercentileRatio) * std::sqrt(dof) / kPercentileSpread;
    if (std::fabs(now) > std::fabs(off)) off = now, ratio = p95_over_rms, tau_s = at_tau_s;
  }
};

// Fills the ratios of `out` tau by tau and collects what stands out.
WorstRatio add_ratios(const Series& s, const std::vector<double>& temp_degc, const DpRecord& record,
                      const DpCurve& curve, const Limits& limits, DpRatios* out, std::vector<DpOutlier>* events) {
  WorstRatio worst;
  std::vector<long> n;
  for (double tau_s : out->tau_s) n.push_back(std::lround(tau_s / s.dt_s));
  const std::vector<DpRecord::Size> sizes = record.sizes(n);
  const std::vector<DpRecord::Moments> moments = curve.moments.empty() ? record.moments(n) : curve.moments;
  for (size_t i = 0; i < n.size(); ++i) {
    const DpRecord::Size& size = sizes[i];
    const double tau_s = out->tau_s[i], dof = out->dof[i];
    const double rms = std::sqrt(moments[i].mean_square()), percentile = 0.5 * size.percentile;
    out->max_over_rms.push_back(size.largest / 3 / rms);
    out->p95_over_rms.push_back(percentile / rms);
    const double limit = normal_quantile(1 - 0.5 * limits.rate / static_cast<double>(size.n_windows));
    // The sigma itself is uncertain: widened by its own 3-sigma error.
    const double sigma = percentile * (1 + 3 / std::sqrt(2 * dof));
    out->max_limit.push_back(limit * sigma / (3 * rms));
    if (dof < kLeastDof) continue;
    worst.add(percentile / rms, dof, tau_s);
    if (size.largest <= limit * sigma) continue;
    std::vector<double> d;
    std::vector<long> t0;
    record.samples(n[i], &d, &t0);
    add_events(s, temp_degc, t0, d, sigma, limit, tau_s, events);
  }
  return worst;
}

struct Verdict {
  const char* name;
  std::string statement;
};

// Of outliers, largest first: one place in temperature, or single events.
Verdict verdict_of_events(const std::vector<double>& temp_degc, const std::vector<DpOutlier>& events) {
  const auto n_events = static_cast<double>(events.size());
  double share = 0;
  const double at_degc = common_temperature(temp_degc, events, &share);
  if (std::isfinite(at_degc))
    return {"singularity", format("%.0f events, %.0f %% of them near %.1f degC: a thermal singularity", n_events,
                                  100 * share, at_degc)};
  return {"outliers",
          format("%.0f event(s); the largest at t = %.0f s, %.1f sigma; look there, and use --estimator p95", n_events,
                 events[0].t_s, events[0].sigmas)};
}

Verdict verdict_of(const std::vector<double>& temp_degc, const std::vector<DpOutlier>& events, const WorstRatio& worst,
                   double z_percentile) {
  if (!worst.any_dof) return {"too_short", "fewer than 20 degrees of freedom at every tau: no verdict"};
  if (!events.empty()) return verdict_of_events(temp_degc, events);
  if (std::fabs(worst.off) <= z_percentile)
    return {"gaussian", "ratios as a Gaussian error has them: rms is the right estimator"};
  const std::string ratio =
      format("percentile over rms is %.3f at tau = %.0f s (Gaussian 0.998): ", worst.ratio, worst.tau_s);
  if (worst.off < 0) return {"heavy_tails", ratio + "the noise level changes along the record"};
  return {"light_tails", ratio + "the error has no tails (a limit, a few values, a drift)"};
}

} // namespace

DpRatios dp_ratios(const Series& s, const std::vector<double>& temp_degc, const DpRecord& record, const DpCurve& curve,
                   const std::vector<double>& dof, double false_alarm_rate) {
  DpRatios out;
  out.log = s.log, out.axis = s.axis, out.type = record.op().type;
  out.tau_s = curve.tau_s, out.dof = dof;
  const Limits limits = limits_of(curve.tau_s, false_alarm_rate);
  std::vector<DpOutlier> events;
  const WorstRatio worst = add_ratios(s, temp_degc, record, curve, limits, &out, &events);
  events = merged(std::move(events));
  out.n_events = static_cast<long>(events.size());
  const Verdict verdict = verdict_of(temp_degc, events, worst, limits.z_percentile);
  out.verdict = verdict.name, out.statement = verdict.statement;
  if (events.size() > kMostOutliers) events.resize(kMostOutliers);
  out.outliers = events;
  return out;
}

} // namespace imucal
