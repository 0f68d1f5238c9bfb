// SPDX-License-Identifier: MIT
#include "analysis/diagnose/stages/own_jumps.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "analysis/diagnose/stages/seconds_noise.h"
#include "base/median.h"

namespace imucal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kLeast_nats = 12; // that a jump gains over none: 1 in 100 over the places of a few logs of white noise
constexpr double kSudden_nats = 5; // and over a change that lasts
constexpr double kLasts_s[] = {200, 600};
constexpr size_t kPlaces = 16; // of a log where one is looked for, by each reach
// Rows to both sides over which innovations are compared: beside a process of long memory a jump is one large innovation, beside
// white noise a change of their level.
constexpr long kReaches[] = {1, 4, 16};
constexpr double kStronger = 1.25;       // times: noise that is not that of the fitted logs
constexpr double kStrongerErrors = 3.09; // beyond which it is no chance: 1 in 1000 logs
// Standard deviations of the logarithm of a strength, times the root of the rows: by the median of differences (100 000
// draws of 30 to 800 rows: 1.28 to 1.30), and by the likelihood of a noise.
constexpr double kErrorOfMedian = 1.29, kErrorOfFit = 0.71;
constexpr size_t kMostOwnJumps = 2;      // of one log
constexpr double kFinestOfRow = 0.05;    // of a row
constexpr double kReachBlocks = 1.5;     // from its place in block means to its sample
constexpr size_t kFewestRows = 30;       // from which a log is asked
constexpr long kFromEnd = 3;             // rows: a jump nearer to the end of a log is one of a few rows
constexpr double kOfNamed_s = 180;       // about a jump of a named cause that one here may be a part of
constexpr double kLeastOfSquares = 1e-6; // two columns are one below it

// What is left of a run, and what changes of its level would be, both less what a constant takes.  The noise of a log may be
// stronger than that of the others: its innovations tell by how much.
class LevelOfRun {
public:
  LevelOfRun(const CampaignRun& run, double dt_s, const NoiseModel& noise, const VectorXd& rest)
      : run_(run), dt_s_(dt_s), gains_(compute_gains(run, noise)), constant_(white(VectorXd::Ones(rest.size()))),
        rest_(less_constant(white(rest))), strength_(strength_of(rest_)) {}

  // The columns of changes at some times.
  MatrixXd changes(const Theta& times_s) const {
    MatrixXd out(rest_.size(), static_cast<long>(times_s.size()));
    for (size_t i = 0; i < times_s.size(); ++i) out.col(static_cast<long>(i)) = change(times_s[i], 0);
    return out;
  }
  // What changes of level gain together.
  double gain_nats(const Theta& times_s) const { return gain_nats(changes(times_s)); }
  // Each at once, and not over minutes.
  bool is_sudden(const Theta& times_s) const {
    const MatrixXd at_once = changes(times_s);
    const double least_nats = gain_nats(at_once) - kSudden_nats;
    for (size_t i = 0; i < times_s.size(); ++i)
      for (const double lasts_s : kLasts_s) {
        MatrixXd slow = at_once;
        slow.col(static_cast<long>(i)) = change(times_s[i], lasts_s);
        if (gain_nats(slow) > least_nats) return false;
      }
    return true;
  }
  // Moved inside their rows to where they gain most.
  Theta placed(Theta times_s) const {
    double best_nats = gain_nats(times_s);
    for (double apart_s = 0.5 * dt_s_; apart_s > kFinestOfRow * dt_s_; apart_s *= 0.5)
      for (size_t i = 0; i < times_s.size(); ++i)
        for (const double way_s : {-apart_s, apart_s}) {
          Theta moved_s = times_s;
          moved_s[i] += way_s;
          const double nats = gain_nats(moved_s);
          if (nats > best_nats) best_nats = nats, times_s = moved_s;
        }
    return times_s;
  }
  // Where the innovations change most.  Those near `taken_s` are not asked.
  Theta likely_times(const Theta& taken_s) const {
    const auto is_taken = [&](long k) {
      return std::any_of(taken_s.begin(), taken_s.end(),
                         [&](double t_s) { return std::fabs(t_s - change_s(k)) < kOfNamed_s; });
    };
    Theta times_s;
    for (const long reach : kReaches) {
      std::vector<std::pair<double, long>> places;
      for (long k = kFromEnd; k + kFromEnd <= rest_.size(); ++k)
        if (!is_taken(k)) places.push_back({-contrast(k, reach), k});
      std::sort(places.begin(), places.end());
      std::vector<long> rows;
      for (const auto& [minus_contrast, k] : places) {
        if (rows.size() == kPlaces) break;
        const auto is_near = [k = k, reach](long row) { return 2 * std::labs(row - k) < reach; };
        if (std::none_of(rows.begin(), rows.end(), is_near)) rows.push_back(k);
      }
      for (const long k : rows) times_s.push_back(change_s(k));
    }
    return times_s;
  }
  // With a level after each: what is left, and the jumps themselves.
  std::vector<OwnJump> take(const Theta& times_s) {
    const MatrixXd x = changes(times_s), inverse = (x.transpose() * x).inverse();
    const VectorXd size_dph = inverse * (x.transpose() * rest_);
    rest_ -= x * size_dph;
    const double strength = strength_; // in which the jumps were noise
    strength_ = strength_of(rest_);
    std::vector<OwnJump> out;
    for (size_t i = 0; i < times_s.size(); ++i) {
      const long j = static_cast<long>(i);
      out.push_back({times_s[i], size_dph[j], strength * std::sqrt(inverse(j, j))});
    }
    return out;
  }
  const VectorXd& rest() const { return rest_; }
  double strength() const { return strength_; }

private:
  // Over lasts_s (0: at once) about a time.
  VectorXd change(double t_s, double lasts_s) const {
    return less_constant(white(share_after(run_, t_s, std::max(dt_s_, lasts_s))));
  }
  double gain_nats(const MatrixXd& x) const {
    const VectorXd product = x.transpose() * rest_;
    return 0.5 * product.dot((x.transpose() * x).ldlt().solve(product)) / (strength_ * strength_);
  }
  // How far the means of as many innovations from this row on and before it lie apart, in standard deviations of white ones.
  double contrast(long k, long reach) const {
    const long after = std::min(reach, rest_.size() - k), before = std::min(reach, k);
    const double apart = rest_.segment(k, after).mean() - rest_.segment(k - before, before).mean();
    return std::fabs(apart) / std::sqrt(1.0 / static_cast<double>(after) + 1.0 / static_cast<double>(before));
  }
  // Before this row.
  double change_s(long k) const {
    return run_.input.t_s[static_cast<size_t>(run_.used[static_cast<size_t>(k)])] - 0.5 * dt_s_;
  }
  VectorXd white(VectorXd x) const {
    whiten(gains_, x.data(), static_cast<size_t>(x.size()));
    return x;
  }
  VectorXd less_constant(const VectorXd& x) const {
    return x - constant_ * (constant_.dot(x) / constant_.squaredNorm());
  }
  static double strength_of(const VectorXd& e) { return std::max(1.0, strength_of_innovations(e)); }

  const CampaignRun& run_;
  double dt_s_;
  RunGains gains_;
  VectorXd constant_, rest_;
  double strength_; // of the innovations, 1: as the noise says
};

// The likeliest two jumps of a run, if each gains enough beside the other; else the likeliest one; or none.  Two come first: of a
// jump up and back each looks small, or gradual, as long as the other is not known.
Theta likeliest(const LevelOfRun& run, const Theta& taken_s) {
  const Theta times_s = run.likely_times(taken_s);
  const auto time_s = [&](long i) { return times_s[static_cast<size_t>(i)]; };
  const MatrixXd x = run.changes(times_s);
  const MatrixXd square = x.transpose() * x;
  const VectorXd product = x.transpose() * run.rest();
  const double two_variances = 2 * run.strength() * run.strength();
  const auto alone_nats = [&](long i) { return product[i] * product[i] / square(i, i) / two_variances; };
  const auto both_nats = [&](long i, long j) {
    const double determinant = square(i, i) * square(j, j) - square(i, j) * square(i, j);
    if (!(determinant > kLeastOfSquares * square(i, i) * square(j, j))) return 0.0;
    return (product[i] * product[i] * square(j, j) + product[j] * product[j] * square(i, i) -
            2 * product[i] * product[j] * square(i, j)) /
           determinant / two_variances;
  };
  const long n = product.size();
  Theta one, two;
  double one_nats = kLeast_nats, two_nats = 0;
  for (long i = 0; i < n; ++i) {
    const double own_nats = alone_nats(i);
    if (own_nats > one_nats) one_nats = own_nats, one = {time_s(i)};
    for (long j = 0; j < i; ++j) {
      if (std::fabs(time_s(i) - time_s(j)) < kLasts_s[0]) continue; // nothing that stays
      const double nats = both_nats(i, j);
      if (nats > two_nats && nats - std::max(own_nats, alone_nats(j)) > kLeast_nats)
        two_nats = nats, two = {time_s(i), time_s(j)};
    }
  }
  if (!two.empty() && run.is_sudden(two = run.placed(two))) return two;
  return !one.empty() && run.is_sudden(one = run.placed(one)) ? one : Theta();
}

// The jumps of one run, which are taken off it; more than a few: none.
std::vector<OwnJump> take_jumps(const Theta& taken_s, LevelOfRun* run) {
  std::vector<OwnJump> out;
  while (true) {
    const Theta next = likeliest(*run, taken_s);
    if (next.empty()) return out;
    if (out.size() + next.size() > kMostOwnJumps) return {};
    for (const OwnJump& jump : run->take(next)) out.push_back(jump);
  }
}

// The rows of a run at temperatures that were fitted.  Beyond them an extrapolated polynomial is foretold.  Its error looks like
// stronger noise, or like jumps.
CampaignRun within_fitted(const Campaign& fitted, CampaignRun run) {
  if (!fitted.has_temperature) return run;
  FittedSpan span;
  for (const CampaignRun& of : fitted.runs) span.add(of, 0, of.n());
  for (size_t i = 0; i < run.input.size(); ++i)
    if (!span.holds(run.input.smooth_degc[i])) run.input.rate_dph[i] = std::nan("");
  find_used(&run);
  return run;
}
// What is left of a run, in the rows that `part` of it uses.
VectorXd rest_of_part(const CampaignRun& run, const VectorXd& rest, const CampaignRun& part) {
  VectorXd out(static_cast<long>(part.n()));
  size_t k = 0;
  for (size_t j = 0; j < part.n(); ++j) {
    while (run.used[k] != part.used[j]) ++k;
    out[static_cast<long>(j)] = rest[static_cast<long>(k)];
  }
  return out;
}

// When the named causes jump in a run.
Theta times_of_named_jumps(const SlowAnswer& slow, const CampaignRun& run) {
  Theta out;
  for (size_t k : slow.rows_of_jumps(run.input)) out.push_back(0.5 * (run.input.t_s[k - 1] + run.input.t_s[k]));
  return out;
}

} // namespace

double strength_of_innovations(const VectorXd& e) {
  const VectorXd apart = (e.tail(e.size() - 1) - e.head(e.size() - 1)).cwiseAbs() / std::sqrt(2.0);
  return kSigmaOfMedianSize * median({apart.data(), apart.data() + apart.size()});
}
bool is_clearly_stronger(double strength, size_t n, size_t n_fitted) {
  const double error = std::hypot(kErrorOfMedian / std::sqrt(static_cast<double>(n)),
                                  kErrorOfFit / std::sqrt(static_cast<double>(n_fitted)));
  return strength > kStronger && std::log(strength) > kStrongerErrors * error;
}

void forget_own(SlowAnswer* slow) {
  for (CampaignRun& run : slow->held_blocks->runs) run.own_jumps.clear(), run.own_strength = 1;
}
void find_own(const AxisQuestion& question, SlowAnswer* slow) {
  const bool can_be_named = question.first_kind([](const auto& e) { return e.form() == Form::kSteps; }) != nullptr;
  const SlowModel& best = slow->found.best;
  const bool is_noise_that_jumps = best.noise_effect && best.noise_effect->estimator()->is_jumping();
  const SlowData all = with_held_out(*slow->data, *slow->held_blocks);
  const std::vector<MeanPart> parts = slow->search->parts_on(all, best);
  const NoiseModel noise = slow->search->noise_of(best);
  std::vector<char> is_fitted(all.campaign.runs.size(), 1);
  const size_t n_fitted = slow->data->campaign.runs.size();
  std::fill(is_fitted.begin() + static_cast<long>(n_fitted), is_fitted.end(), 0);
  const RunGrams::Posterior at = RunGrams(all, pointers_of(parts), noise).posterior(is_fitted);
  for (size_t r = n_fitted; r < all.campaign.runs.size(); ++r) {
    CampaignRun& run = slow->held_blocks->runs[r - n_fitted];
    const CampaignRun within = within_fitted(slow->data->campaign, run);
    if (within.n() < kFewestRows) continue;
    LevelOfRun level(within, all.campaign.dt_s, noise, rest_of_part(run, residual_of(all, parts, at, r), within));
    if (can_be_named && !is_noise_that_jumps) run.own_jumps = take_jumps(times_of_named_jumps(*slow, run), &level);
    if (is_clearly_stronger(level.strength(), within.n(), slow->data->campaign.n()))
      run.own_strength = level.strength();
  }
}

void place_own_jumps(const Campaign& blocks, const Hypothesis& found, Campaign* seconds) {
  bool has_any = false;
  for (size_t r = 0; r < seconds->runs.size(); ++r) {
    seconds->runs[r].own_jumps = blocks.runs[r].own_jumps;
    has_any = has_any || !blocks.runs[r].own_jumps.empty();
  }
  if (!has_any) return;
  const Fit fit = fit_hypothesis(*seconds, found);
  const long reach = std::lround(kReachBlocks * blocks.dt_s / seconds->dt_s);
  for (size_t r = 0; r < seconds->runs.size(); ++r) {
    CampaignRun& run = seconds->runs[r];
    const auto t_s = [&](long k) { return run.input.t_s[static_cast<size_t>(run.used[static_cast<size_t>(k)])]; };
    for (OwnJump& jump : run.own_jumps) {
      long at = 0;
      while (at + 1 < static_cast<long>(run.n()) && t_s(at) < jump.t_s) ++at;
      const long k = sample_of_jump(run, found.noise(), fit.residual[r], jump.size_dph, at, reach);
      jump.t_s = t_s(k) - 0.5 * seconds->dt_s;
    }
  }
}
void measure_own_jumps(const Fit& fit, Campaign* seconds) {
  size_t n = 0;
  for (const CampaignRun& run : seconds->runs) n += run.own_jumps.size();
  long at = fit.beta.size() - static_cast<long>(n); // their columns are the last ones
  for (CampaignRun& run : seconds->runs)
    for (OwnJump& jump : run.own_jumps) {
      jump.size_dph = fit.beta[at], jump.error_dph = std::sqrt(fit.beta_covariance(at, at));
      ++at;
    }
}

} // namespace imucal
