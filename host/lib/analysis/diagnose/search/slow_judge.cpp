// SPDX-License-Identifier: MIT
#include "analysis/diagnose/search/slow_judge.h"

#include <algorithm>
#include <cmath>

#include "analysis/diagnose/search/slow_polish.h"

namespace imucal {

namespace {

constexpr double kMemberPart = 0.4; // of its gain, on the places of the grids
constexpr int kSettlings = 4;
constexpr double kSettled_nats = 0.5;

} // namespace

std::vector<SlowCandidateScore> SlowJudge::free_beside(const SlowModel& m, size_t most) const {
  std::vector<SlowCandidateScore> list;
  for (SlowCandidateScore& s : scans_.scan(m, scans_.likely_nodes(m), true))
    if (!s.model.names.empty() && s.score_nats > -1e299) list.push_back(std::move(s));
  sort_by_score(&list);
  if (list.size() > most) list.resize(most);
  for (SlowCandidateScore& s : list)
    if (s.score_nats > m.free_score() - space_.constants.near_nats) {
      s.model = polished(likelihood_, s.model, kQuickEvaluations);
      s.score_nats = s.model.free_score();
    }
  sort_by_score(&list);
  return list;
}

SlowModel SlowJudge::with_free_function(const SlowModel& m, const SlowModel& also) const {
  SlowModel best;
  if (space_.candidates.empty() || !space_.candidates.back().is_free_function) return best;
  std::vector<SlowModel> starts = {m, m};
  starts[1].take_noise_of(also);
  if (likelihood_.noise(starts[1]) == likelihood_.noise(m) && also.is_believed == m.is_believed) starts.pop_back();
  const std::vector<Theta>& shapes = space_.candidates.back().scan.shapes;
  for (const Theta& shape : shapes)
    for (SlowModel with : starts) {
      with.names.push_back({space_.candidates.size() - 1, shape, std::log(static_cast<double>(shapes.size())), false});
      with.value = likelihood_.evaluate(with);
      if (with.value > best.value) best = with;
    }
  return best;
}

// Searched anew from where a search of few evaluations ended, while that gains: a simplex along a ridge of several parameters
// ends before its top.
SlowModel SlowJudge::settled(SlowModel m) const {
  for (int round = 0; round < kSettlings; ++round) {
    const SlowModel again = polished(likelihood_, m, kEvaluations);
    const bool is_there = again.value < m.value + kSettled_nats;
    if (again.value > m.value) m = again;
    if (is_there) break;
  }
  return m;
}

// A free shape has more freedom than any member: where a member gains nearly as much, it is the answer, and what the
// shape gains beyond it is a remainder where it is as much as one beside the answer must gain.  An effect of any shape gives way to that of its parameters alone, and also stands where
// it is better by what a free shape beside an answer would open it for.
SlowModel SlowJudge::with_members(SlowModel best, std::vector<size_t>* replaced) const {
  for (size_t i = 0; i < best.names.size(); ++i) {
    const Candidate& c = space_.candidates[best.names[i].candidate];
    if (c.is_member() || c.is_free_function) continue;
    const SlowModel less = without(best, i);
    const double free_gain = best.free_score() - less.free_score();
    SlowModel top = c.effect ? with_nearest(best, i) : with_best_member(less, best, free_gain);
    if (top.names.empty()) continue;
    double least = space_.constants.member_share * free_gain;
    if (c.effect) least = std::max(least, free_gain - space_.constants.lack_nats);
    if (top.free_score() - less.free_score() < least) continue;
    const double beyond = best.free_score() - top.free_score();
    if (!c.effect && beyond > std::max(space_.constants.lack_nats, space_.constants.lack_part * free_gain))
      replaced->push_back(best.names[i].candidate);
    if (c.effect) top.names[i].beyond_nats = std::max(0.0, beyond);
    best = top;
  }
  return best;
}

// The member beside `less` that does best in the place of the free shape of `best`, which gains so much; no names: none does.
SlowModel SlowJudge::with_best_member(const SlowModel& less, const SlowModel& best, double free_gain) const {
  SlowModel top;
  const SlowScan::OwnNode own = scans_.node_of(best);
  const std::vector<SlowCandidateScore> found = scans_.scan_members(less, scans_.nodes_with(*own, best));
  for (size_t k = 0; k < found.size() && k < kMembersTried; ++k) {
    if (found[k].score_nats < less.free_score() + kMemberPart * free_gain) break;
    const SlowModel member = polished(likelihood_, found[k].model, kEvaluations);
    if (member.free_score() > top.free_score()) top = member;
  }
  return top;
}

SlowModel SlowJudge::with_parameters(SlowModel m) const {
  for (size_t i = 0; i < m.names.size(); ++i) {
    if (!space_.candidates[m.names[i].candidate].is_any_shape) continue;
    const SlowModel told = with_nearest(m, i);
    if (!told.names.empty()) m = told;
  }
  return m;
}
// From the best place of the grid, and from the place of the other shape where it has the same parameters; no names: the
// effect is not asked in its own shape.
SlowModel SlowJudge::with_nearest(const SlowModel& m, size_t i) const {
  const Candidate& any = space_.candidates[m.names[i].candidate];
  const SlowScan::OwnNode own = scans_.node_of(m);
  SlowModel best;
  for (const SlowCandidateScore& s : scans_.scan_members(m.without(i), {own.get()})) {
    const SlowModel::Name& member = s.model.names.back();
    if (space_.candidates[member.candidate].effect != any.effect) continue;
    for (const Theta& shape : {member.shape, m.names[i].shape}) {
      if (shape.size() != member.shape.size()) continue;
      SlowModel told = m;
      told.names[i] = member, told.names[i].shape = shape;
      told = settled(polished(likelihood_, told, kEvaluations));
      if (told.free_score() > best.free_score()) best = told;
    }
    break;
  }
  return best;
}

SlowModel SlowJudge::at_its_best(const SlowModel& m) const {
  SlowModel best = polished(likelihood_, m, kQuickEvaluations);
  if (best.can_be()) return best;
  for (size_t i = 0; i < m.names.size(); ++i)
    if (const SlowModel less = at_its_best(m.without(i)); less.free_score() > best.free_score()) best = less;
  return best;
}
// The hypothesis without one of its names, as good as it can be made.
SlowModel SlowJudge::without(const SlowModel& m, size_t i) const {
  SlowModel less = at_its_best(m.without(i));
  if (less.names.empty()) {
    if (so_far_.null.free_score() > less.free_score()) less = so_far_.null;
    for (const SlowCandidateScore& s : so_far_.noises)
      if (s.model.free_score() > less.free_score()) less = s.model;
  }
  return less;
}

// Nothing named at all is without it, too: what is left of several names may be far from its best noise.
double SlowJudge::evidence_of(const SlowModel& m, size_t i) const {
  const double less = std::max(without(m, i).free_score(), so_far_.null.free_score());
  return m.free_score() - less - space_.constants.mean_nats;
}

void SlowJudge::judge_names(SlowResult* result) const {
  result->best = with_members(result->best, &result->replaced);
  const SlowModel best = result->best;
  result->rivals.clear(), result->evidence.clear(), result->noise_evidence.reset(), result->step_gain_nats = 0;
  for (size_t i = 0; i < best.names.size(); ++i) {
    result->evidence.push_back(evidence_of(best, i));
    result->rivals.push_back(rivals(best, i));
  }
  if (!best.steps.empty()) {
    SlowModel less = best;
    less.steps.clear();
    less = at_its_best(less);
    result->step_gain_nats = best.free_score() - less.free_score();
  }
  if (best.noise_effect) {
    SlowModel less = best;
    less.noise_effect = nullptr;
    less = at_its_best(less);
    result->noise_evidence = best.free_score() + best.noise_charge - less.free_score() - space_.constants.noise_nats;
  }
}
std::vector<SlowResult::Rival> SlowJudge::rivals(const SlowModel& best, size_t i) const {
  const double own = best.free_score() + best.names[i].beyond_nats; // the effect, of whatever shape
  const SlowScan::OwnNode node = scans_.node_of(best); // a rival may be far below its best under every other noise
  std::vector<SlowCandidateScore> others = scans_.scan(best.without(i), scans_.nodes_with(*node, best));
  others[best.names[i].candidate].model.names.clear();
  for (SlowCandidateScore& s : others)
    if (!s.model.names.empty() && s.score_nats > own - space_.constants.near_nats) {
      s.model = polished(likelihood_, s.model, kQuickEvaluations);
      s.score_nats = s.model.free_score();
    }
  std::vector<SlowResult::Rival> list;
  for (size_t j = 0; j < others.size(); ++j)
    if (!others[j].model.names.empty() && others[j].score_nats > own - space_.constants.near_nats)
      list.push_back({j, nullptr, own - others[j].score_nats, others[j].model});
  if (best.names.size() == 1 && !best.noise_effect)
    for (const SlowCandidateScore& s : so_far_.noises)
      if (s.score_nats + space_.constants.noise_kind_nats > own - space_.constants.near_nats)
        list.push_back({0, s.model.noise_effect, own - s.score_nats - space_.constants.noise_kind_nats, s.model});
  std::sort(list.begin(), list.end(), [](const auto& a, const auto& b) { return a.gap_nats < b.gap_nats; });
  return list;
}

} // namespace imucal
