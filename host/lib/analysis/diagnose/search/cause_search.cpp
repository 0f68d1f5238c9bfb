// SPDX-License-Identifier: MIT
#include "analysis/diagnose/search/cause_search.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "analysis/diagnose/search/slow_judge.h"
#include "analysis/diagnose/search/slow_kinds.h"
#include "analysis/diagnose/search/time_jumps.h"

namespace imucal {

namespace {

constexpr double kStartTaus_s[] = {100, 1000};
constexpr size_t kNoisesBeside = 2, kNoiseBases = 4;
constexpr size_t kPolished = 7, kPairBases = 6, kPairsPolished = 6, kPartners = 3;
constexpr size_t kPairsTried = 10, kAddedTried = 4;
constexpr int kRounds = 2;               // of exchanges
constexpr double kWorthwhile_nats = 0.5; // that a round has to gain for another one
constexpr size_t kMostNames = 3;

class CauseSearch {
public:
  CauseSearch(const SlowLikelihood& likelihood, SlowScan* scans)
      : space_(likelihood.space()), likelihood_(likelihood), scans_(*scans) {}

  SlowResult run(const SlowModel& about, const SlowModel& null, const SlowModel* in_time) {
    scans_.make_nodes(about);
    out_.null = null;
    out_.best = out_.null;
    out_.singles = scans_.scan(out_.null, scans_.all_nodes());
    if (in_time) try_jumps(likelihood_, out_.null, *in_time, &out_.singles);
    polish_best(&out_.singles, kPolished, out_.null.free_score() - space_.constants.below_null_nats, kEvaluations);
    out_.noises = scan_noises(likelihood_, out_, out_.null, space_.noise_effects.size());
    for (const SlowCandidateScore& s : out_.singles) consider(s.model);
    for (const SlowCandidateScore& s : out_.noises) consider(s.model);
    double strongest = -1e300;
    for (const SlowCandidateScore& s : out_.singles) strongest = std::max(strongest, s.score_nats);
    if (strongest > out_.null.free_score() + space_.constants.more_names_nats) {
      more_noise_beside(out_.singles);
      pairs(out_.singles);
      while (out_.best.names.size() >= 2 && out_.best.names.size() < kMostNames) {
        const size_t before = out_.best.names.size();
        one_more(out_.best);
        if (out_.best.names.size() == before) break;
      }
      if (out_.best.names.size() >= 2) more_noise(out_.best);
      refine();
      if (!out_.best.names.empty() && !out_.best.noise_effect)
        for (const SlowCandidateScore& s : kinds_beside(likelihood_, out_, out_.best)) consider(s.model);
    }
    SlowJudge(likelihood_, scans_, out_).judge_names(&out_);
    return std::move(out_);
  }

private:
  // How far below the best, which gains so much, a place of the grid is still polished.
  double near_nats(double gain_nats) const {
    return std::max(space_.constants.near_nats, space_.constants.near_part * gain_nats);
  }
  // Polishes the best of a scan; the others keep their values from the grid.
  void polish_best(std::vector<SlowCandidateScore>* scores, size_t count, double floor, int evaluations) const {
    std::vector<size_t> order(scores->size());
    for (size_t j = 0; j < order.size(); ++j) order[j] = j;
    std::sort(order.begin(), order.end(),
              [&](size_t a, size_t b) { return (*scores)[a].score_nats > (*scores)[b].score_nats; });
    const double best = order.empty() ? 0 : (*scores)[order[0]].score_nats;
    for (size_t i = 0; i < order.size() && i < count; ++i) {
      SlowCandidateScore& s = (*scores)[order[i]];
      if (s.model.names.empty() || s.score_nats < floor || s.score_nats < best - near_nats(best - floor)) break;
      approach(likelihood_, &s.model);
      s.model = polished(likelihood_, s.model, evaluations);
      s.score_nats = s.model.free_score();
    }
  }

  void consider(const SlowModel& m) {
    if (likelihood_.score(m) > likelihood_.score(out_.best)) out_.best = m;
  }

  // What gains most beside the best single is asked for its own partners too: the shape that the best single has alone is
  // that of a stand-in for both.
  static void add_partners(std::vector<SlowCandidateScore> beside, const std::vector<SlowCandidateScore>& singles,
                           std::vector<size_t>* bases) {
    sort_by_score(&beside);
    for (size_t i = 0, added = 0; i < beside.size() && added < kPartners; ++i) {
      if (beside[i].model.names.empty()) continue;
      const size_t j = beside[i].model.names.back().candidate;
      if (singles[j].model.names.empty() || std::find(bases->begin(), bases->end(), j) != bases->end()) continue;
      bases->push_back(j), ++added;
    }
  }
  // The best single is scanned under every node of noise and its own: those likely under one cause alone are the ones
  // whose noise has swallowed the other.  The nodes likely under the best pair, and that one, serve the other singles.
  void pairs(const std::vector<SlowCandidateScore>& singles) {
    std::vector<size_t> order;
    for (size_t j = 0; j < singles.size(); ++j)
      if (!singles[j].model.names.empty()) order.push_back(j);
    std::sort(order.begin(), order.end(),
              [&](size_t a, size_t b) { return singles[a].score_nats > singles[b].score_nats; });
    if (order.size() > kPairBases) order.resize(kPairBases);
    std::vector<SlowCandidateScore> found;
    if (order.empty()) return;
    const SlowScan::OwnNode own = scans_.node_of(singles[order[0]].model);
    std::vector<const SlowNode*> where = scans_.all_nodes();
    where.push_back(own.get());
    std::vector<SlowCandidateScore> beside = scans_.scan(singles[order[0]].model, where);
    add_partners(beside, singles, &order);
    const auto best = std::max_element(beside.begin(), beside.end(),
                                       [](const auto& a, const auto& b) { return a.score_nats < b.score_nats; });
    if (!best->model.names.empty()) where = scans_.nodes_with(*own, best->model);
    const auto add = [&found](std::vector<SlowCandidateScore>& scores) {
      for (SlowCandidateScore& s : scores)
        if (!s.model.names.empty()) found.push_back(std::move(s));
    };
    add(beside);
    std::vector<SlowModel> others;
    for (size_t i = 1; i < order.size(); ++i) others.push_back(singles[order[i]].model);
    for (std::vector<SlowCandidateScore>& scores : scans_.scan_each(others, where)) add(scores);
    consider_best(std::move(found), kPairsTried,
                  near_nats(likelihood_.score(out_.best) - likelihood_.score(out_.null)));
  }
  void one_more(const SlowModel& m) { one_more(m, m); }
  // `from`: where `m` comes from, of the same kind of noise.
  void one_more(const SlowModel& m, const SlowModel& from) {
    if (m.names.size() >= kMostNames) return;
    const SlowScan::OwnNode own = scans_.node_of(from);
    std::vector<SlowCandidateScore> found = scans_.scan(m, scans_.nodes_with(*own, out_.best));
    if (!m.names.empty()) try_jumps(likelihood_, m, m, &found);
    consider_best(std::move(found), kAddedTried,
                  near_nats(likelihood_.score(out_.best) - likelihood_.score(out_.null)));
  }
  // The best of a scan, each first brought near its own best shape: places of a grid lie so far apart that a right cause
  // may gain less there than a wrong one.
  void consider_best(std::vector<SlowCandidateScore> found, size_t tried, double near) {
    sort_by_score(&found);
    std::vector<SlowCandidateScore> list;
    for (SlowCandidateScore& s : found) {
      if (list.size() == tried || s.model.names.empty()) break;
      if (std::any_of(list.begin(), list.end(), [&](const auto& o) { return have_same_names(o.model, s.model); }))
        continue;
      approach(likelihood_, &s.model);
      s.model.value = likelihood_.evaluate(s.model);
      s.score_nats = likelihood_.score(s.model);
      list.push_back(std::move(s));
    }
    sort_by_score(&list);
    if (list.size() > kPairsPolished) list.resize(kPairsPolished);
    for (const SlowCandidateScore& s : list)
      if (s.score_nats > likelihood_.score(out_.best) - near)
        consider(polished(likelihood_, s.model, kQuickEvaluations));
  }
  // One name exchanged, one less, one more, or the kind of noise left out: what singles and pairs miss where a stand-in
  // of three parts, or noise, gains more than any true cause alone.
  void refine() {
    for (int round = 0; round < kRounds && !out_.best.names.empty(); ++round) {
      const SlowModel from = out_.best;
      members_for_shapes();
      place_without_shapes(from);
      for (size_t i = 0; i < from.names.size() && from.names.size() + (from.noise_effect ? 1 : 0) > 1; ++i) {
        SlowModel less = from.without(i);
        try_about(less);
        if (less.noise_effect && !less.names.empty()) less.noise_effect = nullptr, try_about(less);
      }
      if (from.noise_effect) {
        SlowModel quiet = from;
        quiet.noise_effect = nullptr;
        try_about(quiet);
        quiet.value = likelihood_.evaluate(quiet);
        one_more(quiet); // its shapes as they are: alone it moves to where it takes what the noise took
      }
      if (likelihood_.score(out_.best) < likelihood_.score(from) + kWorthwhile_nats) break;
    }
    if (out_.best.names.size() > 1 || out_.best.noise_effect) consider(polished(likelihood_, out_.best, kEvaluations));
  }
  // A free shape may stand for two members, of which neither does as well alone.
  void members_for_shapes() {
    const SlowModel from = out_.best;
    for (size_t i = 0; i < from.names.size() && from.names.size() < kMostNames; ++i) {
      if (space_.candidates[from.names[i].candidate].is_member()) continue;
      const SlowScan::OwnNode own = scans_.node_of(from);
      const std::vector<SlowCandidateScore> firsts = scans_.scan_members(from.without(i), {own.get()});
      std::vector<SlowCandidateScore> found;
      for (size_t k = 0; k < firsts.size() && k < kMembersTried; ++k)
        for (SlowCandidateScore& both : scans_.scan_members(polished(likelihood_, firsts[k].model), {own.get()}))
          found.push_back(std::move(both));
      // A free shape has no shape parameters to polish, members have.
      consider_best(std::move(found), kMembersTried, near_nats(likelihood_.score(from) - likelihood_.score(out_.null)));
    }
  }
  // A member beside a free shape stands where both together gain most: without the shape, each is placed anew.
  void place_without_shapes(const SlowModel& from) {
    for (size_t i = 0; i < from.names.size() && from.names.size() == kMostNames; ++i) {
      if (space_.candidates[from.names[i].candidate].is_member()) continue;
      const SlowModel members = from.without(i);
      for (size_t j = 0; j < members.names.size(); ++j)
        one_more(polished(likelihood_, members.without(j), kQuickEvaluations), from);
    }
  }
  void try_about(SlowModel m) {
    const SlowModel as_found = m;
    m = polished(likelihood_, m, kQuickEvaluations);
    consider(m);
    one_more(m, as_found);
    more_noise(m);
  }
  void more_noise(const SlowModel& about) {
    if (about.noise_effect) return;
    for (const SlowCandidateScore& s : scan_noises(likelihood_, out_, about, kNoisesBeside)) consider(s.model);
  }

  void more_noise_beside(const std::vector<SlowCandidateScore>& singles) {
    std::vector<size_t> order(singles.size());
    for (size_t j = 0; j < order.size(); ++j) order[j] = j;
    std::sort(order.begin(), order.end(),
              [&](size_t a, size_t b) { return singles[a].score_nats > singles[b].score_nats; });
    for (size_t i = 0; i < order.size() && i < kNoiseBases; ++i)
      if (!singles[order[i]].model.names.empty()) more_noise(singles[order[i]].model);
  }

  const SlowSpace& space_;
  const SlowLikelihood& likelihood_;
  SlowScan& scans_;
  SlowResult out_;
};

// The candidate of an effect in the mean; where asked for and there is one, that of any shape.
std::optional<size_t> candidate_of(const SlowSpace& space, const Effect& effect, bool any_shape) {
  std::optional<size_t> found;
  for (size_t j = 0; j < space.candidates.size(); ++j)
    if (space.candidates[j].effect == &effect && (!found || any_shape)) found = j;
  return found;
}
// The candidates added in this order, each where the grid is best, all polished; empty: one of them cannot be added.
SlowModel built(const SlowLikelihood& of, const SlowScan& scans, const SlowModel& null,
                const std::vector<size_t>& order) {
  SlowModel m = null;
  for (const size_t j : order) {
    std::vector<SlowCandidateScore> found = scans.scan(m, scans.all_nodes());
    if (found[j].model.names.empty()) return {};
    m = found[j].model;
    approach(of, &m);
  }
  return order.empty() ? m : polished(of, polished(of, m, kEvaluations), kEvaluations);
}

} // namespace

SlowModel fit_null(const SlowLikelihood& of) {
  const SlowSpace& space = of.space();
  SlowModel best;
  for (double tau : kStartTaus_s) {
    SlowModel m;
    m.log_noise[0] = space.prior.centre[0];
    m.log_noise[1] = space.prior.centre[1];
    m.log_noise[2] = std::log(tau / space.base.markov[0].tau_s);
    polish(of, &m, kEvaluations);
    if (m.value > best.value) best = m;
  }
  return best;
}

SlowResult search_causes(const SlowLikelihood& of, SlowScan* scans, const SlowModel& about, const SlowModel& null,
                         const SlowModel* in_time) {
  return CauseSearch(of, scans).run(about, null, in_time);
}

SlowModel best_with(const SlowLikelihood& of, const SlowScan& scans, const SlowResult& found,
                    const std::vector<const Effect*>& effects) {
  const SlowSpace& space = of.space();
  const Effect* noise = nullptr;
  for (const Effect* effect : effects)
    if (std::find(space.noise_effects.begin(), space.noise_effects.end(), effect) != space.noise_effects.end())
      noise = effect;
  SlowModel best;
  for (const bool any_shape : {false, true}) {
    std::vector<size_t> order;
    for (const Effect* effect : effects)
      if (const std::optional<size_t> j = candidate_of(space, *effect, any_shape)) order.push_back(*j);
    std::sort(order.begin(), order.end());
    do {
      const SlowModel m = built(of, scans, found.null, order);
      if (m.free_score() > best.free_score()) best = m;
    } while (std::next_permutation(order.begin(), order.end()));
  }
  if (!noise) return best;
  SlowModel with;
  for (const SlowCandidateScore& s : scan_noises(of, found, best, space.noise_effects.size()))
    if (s.model.noise_effect == noise) with = polished(of, s.model, kEvaluations);
  return with;
}

} // namespace imucal
