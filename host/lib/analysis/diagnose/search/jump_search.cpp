// SPDX-License-Identifier: MIT
#include "analysis/diagnose/search/jump_search.h"

#include <algorithm>

#include "analysis/diagnose/search/cause_search.h"
#include "analysis/diagnose/search/slow_judge.h"
#include "analysis/diagnose/search/time_jumps.h"

namespace imucal {

namespace {

class JumpSearch {
public:
  JumpSearch(const SlowLikelihood& likelihood, SlowScan* scans, const SlowModel& start, const SlowModel& start_null)
      : space_(likelihood.space()), likelihood_(likelihood), scans_(*scans), start_(start), start_null_(start_null) {}

  SlowResult run() {
    const TimeJumps jumps = find_steps(likelihood_, start_null_, kManyJumps);
    if (jumps.are_many || jumps.places.empty())
      // Many jumps may be one at a temperature that the logs pass again and again.
      out_ = searched(start_, start_null_, jumps.are_many ? &start_null_ : nullptr);
    else
      run_with_or_without(jumps.places);
    if (!jumps.places.empty() || jumps.are_many) part_jumps();
    more_jumps(jumps.are_many);
    if (jumps.are_many && !jumps.places.empty()) weigh_many(jumps.places);
    std::sort(out_.best.steps.begin(), out_.best.steps.end()); // as they are told: by run and time
    return std::move(out_);
  }

private:
  SlowResult searched(const SlowModel& about, const SlowModel& null, const SlowModel* in_time) const {
    return search_causes(likelihood_, &scans_, about, null, in_time);
  }
  SlowModel jumped(const std::vector<Theta>& places) const {
    SlowModel m = start_;
    m.steps = places;
    polish(likelihood_, &m, kEvaluations);
    return m;
  }
  void run_with_or_without(const std::vector<Theta>& places) {
    const SlowModel in_time = jumped(places);
    out_ = searched(start_, start_null_, &in_time);
    // Names that take all the jumps: a search beside jumps would only come to them again.
    const bool is_once = has_once(out_.best); // held-out logs choose then
    if (!is_once && likelihood_.score(out_.best) > likelihood_.score(in_time) &&
        find_steps(likelihood_, out_.best).places.empty())
      return;
    const SlowResult plain = out_;
    run_beside(in_time, plain);
    if (!is_once && likelihood_.score(out_.best) < likelihood_.score(plain.best)) out_ = plain;
  }
  // The same search beside jumps in time.
  void run_beside(const SlowModel& in_time, const SlowResult& plain) {
    const bool has_believed = space_.belief.has_believed;
    out_ = searched(in_time, has_believed ? polished(likelihood_, in_time, kQuickEvaluations) : in_time, nullptr);
    out_.null = plain.null;
    out_.without_steps = std::make_shared<const SlowResult>(plain);
  }
  // Some jumps may be one at a temperature, others single ones in time: taken all as jumps in time they are too many, or cost too
  // much.  Those in time are looked for beside the likeliest one at a temperature.
  void part_jumps() {
    const SlowResult before = out_;
    const SlowResult& plain = before.without_steps ? *before.without_steps : before;
    const SlowModel* relay = nullptr;
    for (const SlowCandidateScore& s : plain.singles)
      if (!s.model.names.empty() && can_jump(s.model.names.back()) && (!relay || s.score_nats > relay->free_score()))
        relay = &s.model;
    if (!relay || relay->free_score() < plain.null.free_score() + space_.constants.mean_nats) return;
    const TimeJumps beside = find_steps(likelihood_, *relay);
    if (beside.places.empty()) return;
    SlowModel both = *relay;
    both.steps = beside.places;
    both = polished(likelihood_, both);
    if (likelihood_.score(both) <= likelihood_.score(before.best)) return;
    run_beside(jumped(beside.places), plain);
    take_if_better(both);
    // Without one at a temperature these are the jumps in time that were weighed before.
    if (!has_jump(out_.best) || likelihood_.score(out_.best) < likelihood_.score(before.best)) out_ = before;
  }
  // Jumps are looked for beside the hypothesis without a name: a cause that is left there hides some of them, and another name
  // then stands in for these.  More are looked for beside the names, and beside all but one of them.
  void more_jumps(bool are_many) {
    const bool has_steps = !out_.best.steps.empty();
    if (out_.best.names.empty() || (!has_steps && are_many)) return;
    const SlowResult before = out_;
    std::vector<SlowModel> bases = {before.best};
    for (size_t i = 0; i < before.best.names.size() && before.best.names.size() > 1; ++i)
      bases.push_back(polished(likelihood_, before.best.without(i), kQuickEvaluations));
    SlowModel most = before.best;
    for (const SlowModel& base : bases) {
      SlowModel with = base;
      with.steps = find_steps(likelihood_, base, has_steps ? kManyJumps : kFewJumps).places;
      if (with.steps.size() <= base.steps.size()) continue;
      with = polished(likelihood_, with);
      if (likelihood_.score(with) > likelihood_.score(most)) most = with;
    }
    if (most.steps.size() == before.best.steps.size()) return;
    run_beside(jumped(most.steps), before.without_steps ? *before.without_steps : before);
    take_if_better(most);
  }
  // After the names were judged: they are judged again.
  void take_if_better(const SlowModel& m) {
    if (likelihood_.score(out_.best) >= likelihood_.score(m)) return;
    out_.best = m, out_.replaced.clear();
    SlowJudge(likelihood_, scans_, out_).judge_names(&out_);
  }
  // Many jumps in time are a noise.  Where they hold much more than the names do, a name that is not found beside them was a
  // part of that noise.  Jumps with a pattern are teeth of a saw, or a noise of two levels: the seconds tell these.
  void weigh_many(const std::vector<Theta>& places) {
    if (out_.best.names.empty()) return;
    const SlowModel in_time = jumped(places);
    const double null = likelihood_.score(start_null_), of_jumps = likelihood_.score(in_time) - null;
    if (likelihood_.score(out_.best) - null > space_.constants.member_share * of_jumps) return;
    const JumpPattern pattern = pattern_of(likelihood_, in_time);
    if (pattern.go_one_way || pattern.are_two_levels) return;
    const SlowResult before = out_;
    run_beside(in_time, before.without_steps ? *before.without_steps : before);
    more_jumps(true);
    const bool is_one_less = out_.best.names.size() < before.best.names.size();
    if (!is_one_less || likelihood_.score(out_.best) < likelihood_.score(before.best)) out_ = before;
  }
  bool can_jump(const SlowModel::Name& name) const {
    return space_.candidates[name.candidate].scan.estimator->can_jump();
  }
  bool has_jump(const SlowModel& m) const {
    return std::any_of(m.names.begin(), m.names.end(), [&](const auto& name) { return can_jump(name); });
  }
  bool has_once(const SlowModel& m) const {
    return std::any_of(m.names.begin(), m.names.end(),
                       [&](const SlowModel::Name& name) { return space_.candidates[name.candidate].is_once; });
  }

  const SlowSpace& space_;
  const SlowLikelihood& likelihood_;
  SlowScan& scans_;
  const SlowModel &start_, &start_null_;
  SlowResult out_;
};

} // namespace

SlowResult search_with_jumps(const SlowLikelihood& of, SlowScan* scans, const SlowModel& start,
                             const SlowModel& start_null) {
  return JumpSearch(of, scans, start, start_null).run();
}

} // namespace imucal
