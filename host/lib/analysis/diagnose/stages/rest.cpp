// SPDX-License-Identifier: MIT
#include "analysis/diagnose/stages/rest.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "analysis/diagnose/evidence/kalman.h"
#include "analysis/diagnose/evidence/lines.h"
#include "analysis/diagnose/evidence/spectrum.h"
#include "base/quantile.h"
#include "base/units.h"

namespace imucal {

using Eigen::VectorXd;

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

// How far the kurtosis is from that of a normal, in standard errors.
double heavy(const Moments& m) {
  return (m.kurtosis - 3) * std::sqrt(m.n / 24);
}

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

double heavy_tails(const std::vector<VectorXd>& e) {
  return heavy(moments(e));
}
bool changes_suddenly(const Campaign& campaign, const std::vector<VectorXd>& e, const SelectorConstants& constants) {
  return in_sudden_changes(campaign, e, moments(e), constants.rest_rate).evidence_nats > 0;
}
bool has_spectrum(const Campaign& campaign, const std::vector<VectorXd>& e, const SelectorConstants& constants) {
  return in_spectrum(campaign, summed_power(campaign, e), constants.rest_rate).evidence_nats > 0;
}

bool is_one_sided(const Campaign& campaign, const std::vector<VectorXd>& residual, const NoiseModel& noise) {
  const std::vector<VectorXd> e = whitened(campaign.runs, gaussian_equivalent(noise), residual);
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
  const double tails = heavy(m);
  const std::vector<double> power = summed_power(campaign, e);
  std::vector<RestFinding> out = {over_temperature(campaign, e, rate),
                                  over_time(campaign, e, rate),
                                  finding(Rest::kDistribution, tails * tails, 1, rate),
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

std::vector<RestFinding> test_unseen(const Campaign& held_out, const std::vector<VectorXd>& e,
                                     std::vector<VectorXd> e_less_hits, const SelectorConstants& constants) {
  const double variance = moments(e_less_hits).var;
  if (!(variance > 0)) return {};
  for (VectorXd& x : e_less_hits) x /= std::sqrt(variance);
  const Moments m = moments(e_less_hits);
  const double rate = constants.rest_rate, tails = heavy_tails(e);
  std::vector<RestFinding> out = {
      over_time(held_out, e_less_hits, rate), finding(Rest::kDistribution, tails * tails, 1, rate),
      in_bursts(held_out, e_less_hits, m, rate), in_sudden_changes(held_out, e_less_hits, m, rate)};
  for (RestFinding& f : out) f.threshold_nats = -std::log(rate);
  return out;
}

double RestFinding::p_value() const {
  return std::min(1.0, n_places * std::exp(-evidence_nats - threshold_nats));
}

} // namespace imucal
