// SPDX-License-Identifier: MIT
#include "analysis/diagnose/search/time_jumps.h"

#include <algorithm>
#include <cmath>

#include "base/quantile.h"

namespace imucal {

using Eigen::VectorXd;

namespace {

constexpr size_t kStepPlaces = 4, kJumpPlaces = 12; // that are tried: of one step, of jumps at a temperature
constexpr long kNear = 3;                           // rows about a step that show the same
constexpr double kOneHeight = 2;                    // times: of jumps between two levels, the highest over the lowest
constexpr double kMakesUp = 0.5;                    // of what less noise costs: most of it
constexpr double kFinestPlace = 0.05;               // of a row
// Jumps that come again: how near in temperature beside what a row leaves open, of heights within so many standard errors, on
// temperatures that move by so much at least; pairs that moments drawn at random make so seldom.
constexpr double kOnePlace_degc = 0.25, kOneHeightErrors = 3, kLeastPassing_degc_s = 0.05 / 60, kPairsByChance = 1e-3;

struct JumpBlock {
  size_t run;
  long k; // of its used rows
};
// Where a step would gain most, the largest first: one of rows that stand together.
std::vector<JumpBlock> likely_jump_blocks(const SlowLikelihood& of, const SlowModel& m, size_t most) {
  std::vector<std::pair<double, JumpBlock>> list;
  const std::vector<MeanPart> parts = of.parts_on(of.space().data, m);
  const RunGrams::Posterior at = of.grams(m).posterior();
  const std::vector<CampaignRun>& runs = of.space().data.campaign.runs;
  GainsByRun gains(runs, of.noise(m));
  for (size_t r = 0; r < runs.size(); ++r) {
    const VectorXd gain = step_gains(of.space().data, parts, gains.of(runs[r]), at, r);
    const long begin = kNear, end = gain.size() - kNear; // how a run starts or ends is no jump
    for (long k = begin; k < end; ++k) {
      const long first = std::max(begin, k - kNear), last = std::min(end - 1, k + kNear);
      if (gain[k] == gain.segment(first, last - first + 1).maxCoeff()) list.push_back({gain[k], {r, k}});
    }
  }
  const size_t n = std::min(most, list.size());
  std::partial_sort(list.begin(), list.begin() + static_cast<long>(n), list.end(),
                    [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<JumpBlock> blocks;
  for (size_t i = 0; i < n; ++i) blocks.push_back(list[i].second);
  return blocks;
}
std::vector<Theta> likely_steps(const SlowLikelihood& of, const SlowModel& m) {
  std::vector<Theta> places;
  for (const JumpBlock& b : likely_jump_blocks(of, m, kStepPlaces)) {
    const CampaignRun& run = of.space().data.campaign.runs[b.run];
    const double t = run.input.t_s[static_cast<size_t>(run.used[static_cast<size_t>(b.k)])];
    places.push_back({static_cast<double>(b.run), t - 0.5 * of.space().data.campaign.dt_s});
  }
  return places;
}
std::vector<JumpPlace> likely_jumps(const SlowLikelihood& of, const SlowModel& m) {
  std::vector<JumpPlace> places;
  for (const JumpBlock& b : likely_jump_blocks(of, m, kJumpPlaces)) {
    const CampaignRun& run = of.space().data.campaign.runs[b.run];
    const auto row = [&](long k) { return static_cast<size_t>(run.used[static_cast<size_t>(k)]); };
    const auto temp_degc = [&](long k) { return run.input.smooth_degc[row(k)]; };
    const long first = b.k - kNear, last = b.k + kNear;
    places.push_back({0.5 * (temp_degc(b.k - 1) + temp_degc(b.k)),
                      (temp_degc(last) - temp_degc(first)) / (run.input.t_s[row(last)] - run.input.t_s[row(first)])});
  }
  return places;
}

// The last jump of a hypothesis where inside its rows the data have it, ever finer; the noise stays.
void place_last(const SlowLikelihood& of, SlowModel* m) {
  for (double apart_s = 0.5 * of.space().data.campaign.dt_s; apart_s > kFinestPlace * of.space().data.campaign.dt_s;
       apart_s *= 0.5)
    for (const double way_s : {-apart_s, apart_s}) {
      SlowModel moved = *m;
      moved.steps.back()[1] += way_s;
      moved.value = of.evaluate(moved);
      if (moved.value > m->value) *m = moved;
    }
}

// One step more where it gains most of the likely places, the noise as it is.
SlowModel with_likely_step(const SlowLikelihood& of, const SlowModel& m) {
  SlowModel best = m;
  best.value = -1e300;
  for (const Theta& place : likely_steps(of, m)) {
    SlowModel with = m;
    with.steps.push_back(place);
    with.value = of.evaluate(with);
    if (with.value > best.value) best = with;
  }
  return best;
}
// The noise as fitted may have swallowed a step, which then hardly gains beside it: the same beside less noise, where the step
// makes up for most of what that costs; then with the best noise near there.  Without such a step: `m`.
SlowModel with_swallowed_step(const SlowLikelihood& of, const SlowModel& m) {
  if (m.is_believed) return m;
  SlowModel less = m;
  less.drop_swallowed();
  less.value = of.evaluate(less);
  const SlowModel with = with_likely_step(of, less);
  return with.value - less.value > kMakesUp * (m.value - less.value) ? polished(of, with, kQuickEvaluations) : m;
}
// `with` or, where its step is far from earning its cost beside `m` or does not earn it by the best noise either, `m`.
SlowModel with_earned_step(const SlowLikelihood& of, const SlowModel& m, const SlowModel& with) {
  const SelectorConstants& constants = of.space().constants;
  if (with.value < m.value + constants.step_try_part * constants.step_nats) return m;
  const SlowModel best = polished(of, with, kQuickEvaluations);
  return best.value < m.value + constants.step_nats ? m : best;
}

} // namespace

TimeJumps find_steps(const SlowLikelihood& of, const SlowModel& null, size_t most) {
  if (!of.space().steps) return {};
  SlowModel now = null;
  const auto worth = [&](const SlowModel& m) { return m.value - of.space().constants.cost_of_jumps(m.steps.size()); };
  // Each has earned its own cost; together they may not have earned that of the first.
  const auto found = [&] {
    const SlowModel& better = worth(now) < worth(null) ? null : now;
    return TimeJumps{better.steps, better.steps.size() > kFewJumps};
  };
  while (now.steps.size() <= most) {
    SlowModel best = with_earned_step(of, now, with_likely_step(of, now));
    if (best.steps.size() == now.steps.size()) best = with_earned_step(of, now, with_swallowed_step(of, now));
    if (best.steps.size() == now.steps.size()) return found();
    place_last(of, &best); // it has earned its cost at the end of a row: a finer place costs nothing more
    now = polished(of, best, kQuickEvaluations);
  }
  return {{}, true};
}

JumpPattern pattern_of(const SlowLikelihood& of, const SlowModel& m) {
  const auto n = static_cast<long>(m.steps.size());
  const VectorXd sizes_dph = of.grams(m).posterior().common.segment(of.space().data.powers.front().cols(), n);
  std::vector<std::pair<Theta, bool>> is_up; // by run and time
  for (long i = 0; i < n; ++i) is_up.push_back({m.steps[static_cast<size_t>(i)], sizes_dph[i] > 0});
  std::sort(is_up.begin(), is_up.end());
  const VectorXd heights = sizes_dph.cwiseAbs();
  JumpPattern out;
  out.are_two_levels = heights.maxCoeff() < kOneHeight * heights.minCoeff();
  for (size_t i = 1; i < is_up.size(); ++i) {
    const bool turns = is_up[i].second != is_up[i - 1].second;
    out.go_one_way = out.go_one_way && !turns;
    if (is_up[i].first[0] != is_up[i - 1].first[0]) continue; // another run
    out.are_two_levels = out.are_two_levels && turns;
    ++out.n_followed;
  }
  return out;
}

namespace {

struct PlacedJump {
  size_t run;
  JumpMoment at;
  double size_dph, error_dph;
};
std::vector<PlacedJump> placed_jumps(const SlowLikelihood& of, const SlowModel& m) {
  const SlowData& data = of.space().data;
  const RunGrams::Posterior sizes = of.grams(m).posterior();
  std::vector<PlacedJump> out;
  for (size_t i = 0; i < m.steps.size(); ++i) {
    const size_t run = static_cast<size_t>(m.steps[i][0]);
    const std::optional<JumpMoment> at = moment_of(data.campaign.runs[run].input, m.steps[i][1]);
    if (!at || std::fabs(at->place.slope_degc_s) < kLeastPassing_degc_s) continue; // at rest: no temperature is passed
    const long c = data.powers.front().cols() + static_cast<long>(i);
    out.push_back({run, *at, sizes.common[c], std::sqrt(std::max(0.0, sizes.common_covariance(c, c)))});
  }
  return out;
}
// How near two temperatures have to be to be one: a jump is placed to a row.
double near_degc(const PlacedJump& a, const PlacedJump& b) {
  const auto of_row = [](const JumpMoment& at) { return std::fabs(at.place.slope_degc_s) * at.row_s; };
  return kOnePlace_degc + 0.5 * (of_row(a.at) + of_row(b.at));
}
bool are_at_one_place(const PlacedJump& a, const PlacedJump& b) {
  return std::fabs(a.at.place.temp_degc - b.at.place.temp_degc) < near_degc(a, b);
}
bool have_one_height(const PlacedJump& a, const PlacedJump& b) {
  return std::fabs(a.size_dph - b.size_dph) < kOneHeightErrors * std::hypot(a.error_dph, b.error_dph);
}
// On the way down the bias jumps back where it jumped on the way up.
bool jumps_back(const std::vector<PlacedJump>& jumps, const PlacedJump& up) {
  return std::any_of(jumps.begin(), jumps.end(), [&](const PlacedJump& down) {
    return !down.at.place.is_rising() && down.size_dph * up.size_dph < 0 && are_at_one_place(up, down);
  });
}

} // namespace

std::optional<JumpMoment> moment_of(const RunInput& run, double t_s) {
  const auto next = std::lower_bound(run.t_s.begin(), run.t_s.end(), t_s);
  if (next == run.t_s.begin() || next == run.t_s.end()) return {};
  const size_t i = static_cast<size_t>(next - run.t_s.begin());
  const double change_degc = run.smooth_degc[i] - run.smooth_degc[i - 1], row_s = run.t_s[i] - run.t_s[i - 1];
  const double part = (t_s - run.t_s[i - 1]) / row_s;
  return JumpMoment{{run.smooth_degc[i - 1] + part * change_degc, change_degc / row_s}, row_s};
}

RepeatedJumps repeated_jumps(const SlowLikelihood& of, const SlowModel& m) {
  RepeatedJumps out;
  const std::vector<PlacedJump> jumps = placed_jumps(of, m);
  if (jumps.empty()) return out;
  const RunInput& in = of.space().data.campaign.runs.front().input;
  const double span_degc = std::max(kOnePlace_degc, in.hi_degc - in.lo_degc);
  std::vector<char> is_repeated(jumps.size(), 0);
  double expected = 0, pairs = 0;
  for (size_t i = 0; i < jumps.size(); ++i)
    for (size_t j = 0; j < i; ++j) {
      const PlacedJump &a = jumps[i], &b = jumps[j];
      if (a.run == b.run || a.at.place.is_rising() != b.at.place.is_rising() || !have_one_height(a, b)) continue;
      expected += std::min(1.0, 2 * near_degc(a, b) / span_degc);
      if (are_at_one_place(a, b)) pairs += 1, is_repeated[i] = is_repeated[j] = 1;
    }
  const auto n_repeated = std::count(is_repeated.begin(), is_repeated.end(), 1);
  if (2 * static_cast<size_t>(n_repeated) < m.steps.size() || chi2_cdf(2 * expected, 2 * pairs) > kPairsByChance)
    return out;
  out.follow_temperature = true;
  size_t n_up = 0, n_back = 0;
  for (const PlacedJump& jump : jumps)
    if (jump.at.place.is_rising()) ++n_up, n_back += jumps_back(jumps, jump) ? 1 : 0;
  out.are_loops = n_up > 0 && n_up < jumps.size() && 2 * n_back < n_up;
  return out;
}

// A jump between two places of the grid may gain next to nothing on either.  A candidate that jumps is also tried where
// a step beside `m` would gain most, and taken where it alone does better than `in_time`, which jumps at times, or
// where held-out logs are to tell the two.
void try_jumps(const SlowLikelihood& of, const SlowModel& m, const SlowModel& in_time,
               std::vector<SlowCandidateScore>* scores) {
  std::vector<JumpPlace> places;
  for (SlowCandidateScore& s : *scores) {
    if (s.model.names.size() != m.names.size() + 1) continue;
    const Candidate& c = of.space().candidates[s.model.names.back().candidate];
    if (!c.effect || !c.scan.estimator->can_jump()) continue;
    if (places.empty()) places = likely_jumps(of, m);
    SlowModel found = best_of(of, m, s.model, c.scan.estimator->shapes_of_jumps(places));
    if (found.names.empty()) continue;
    approach(of, &found);
    found = polished(of, found);
    if ((c.is_once || of.score(found) > of.score(in_time)) && found.free_score() > s.score_nats)
      s.model = found, s.score_nats = found.free_score();
  }
}

} // namespace imucal
