// SPDX-License-Identifier: MIT
#include "analysis/diagnose/search/search.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "analysis/diagnose/evidence/free_spectrum.h"
#include "analysis/diagnose/search/null_draws.h"
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

} // namespace

// Singles, pairs, a third name, kinds of slow noise, jumps in time, and exchanges among them.
class CauseSearch {
public:
  CauseSearch(const SlowLikelihood& likelihood, SlowScan* scans)
      : space_(likelihood.space()), likelihood_(likelihood), scans_(*scans) {}

  const SlowResult& found() const { return out_; }
  const SlowModel& start() const { return start_; }           // the hypothesis without a name, as fitted first
  const SlowModel& start_null() const { return start_null_; } // or with the noise as believed, where that does better

  // Fits the hypothesis without a name, once.
  void prepare() {
    if (is_prepared_) return;
    start_ = fit_null();
    start_null_ = space_.belief.has_believed ? polished(likelihood_, start_, kQuickEvaluations) : start_;
    is_prepared_ = true;
  }

  void run() {
    prepare();
    const TimeJumps jumps = find_steps(likelihood_, start_null_, kManyJumps);
    if (jumps.are_many || jumps.places.empty())
      // Many jumps may be one at a temperature that the logs pass again and again.
      run_with(start_, start_null_, jumps.are_many ? &start_null_ : nullptr);
    else
      run_with_or_without(jumps.places);
    if (!jumps.places.empty() || jumps.are_many) part_jumps();
    more_jumps(jumps.are_many);
    if (jumps.are_many && !jumps.places.empty()) weigh_many(jumps.places);
    std::sort(out_.best.steps.begin(), out_.best.steps.end()); // as they are told: by run and time
  }
  // The best hypothesis with exactly these causes.
  SlowModel best_with(const std::vector<const Effect*>& effects) const {
    const Effect* noise = nullptr;
    for (const Effect* effect : effects)
      if (std::find(space_.noise_effects.begin(), space_.noise_effects.end(), effect) != space_.noise_effects.end())
        noise = effect;
    SlowModel best;
    for (const bool any_shape : {false, true}) {
      std::vector<size_t> order;
      for (const Effect* effect : effects)
        if (const std::optional<size_t> j = candidate_of(*effect, any_shape)) order.push_back(*j);
      std::sort(order.begin(), order.end());
      do {
        const SlowModel m = built(order);
        if (m.free_score() > best.free_score()) best = m;
      } while (std::next_permutation(order.begin(), order.end()));
    }
    if (!noise) return best;
    SlowModel with;
    for (const SlowCandidateScore& s : scan_noises(likelihood_, out_, best, space_.noise_effects.size()))
      if (s.model.noise_effect == noise) with = polished(likelihood_, s.model, kEvaluations);
    return with;
  }

private:
  SlowModel jumped(const std::vector<Theta>& places) const {
    SlowModel m = start_;
    m.steps = places;
    polish(likelihood_, &m, kEvaluations);
    return m;
  }
  void run_with_or_without(const std::vector<Theta>& places) {
    const SlowModel in_time = jumped(places);
    run_with(start_, start_null_, &in_time);
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
    out_ = SlowResult();
    run_with(in_time, space_.belief.has_believed ? polished(likelihood_, in_time, kQuickEvaluations) : in_time,
             nullptr);
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
  // The candidate of an effect in the mean; where asked for and there is one, that of any shape.
  std::optional<size_t> candidate_of(const Effect& effect, bool any_shape) const {
    std::optional<size_t> found;
    for (size_t j = 0; j < space_.candidates.size(); ++j)
      if (space_.candidates[j].effect == &effect && (!found || any_shape)) found = j;
    return found;
  }
  // `in_time`: the null with the jumps in time that were found, or none.
  void run_with(const SlowModel& about, const SlowModel& null, const SlowModel* in_time) {
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
  }
  SlowModel fit_null() const {
    SlowModel best;
    for (double tau : kStartTaus_s) {
      SlowModel m;
      m.log_noise[0] = space_.prior.centre[0];
      m.log_noise[1] = space_.prior.centre[1];
      m.log_noise[2] = std::log(tau / space_.base.markov[0].tau_s);
      polish(likelihood_, &m, kEvaluations);
      if (m.value > best.value) best = m;
    }
    return best;
  }

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
  // The candidates added in this order, each where the grid is best, all polished; empty: one of them cannot be added.
  SlowModel built(const std::vector<size_t>& order) const {
    SlowModel m = out_.null;
    for (const size_t j : order) {
      std::vector<SlowCandidateScore> found = scans_.scan(m, scans_.all_nodes());
      if (found[j].model.names.empty()) return {};
      m = found[j].model;
      approach(likelihood_, &m);
    }
    return order.empty() ? m : polished(likelihood_, polished(likelihood_, m, kEvaluations), kEvaluations);
  }

  const SlowSpace& space_;
  const SlowLikelihood& likelihood_;
  SlowScan& scans_;
  SlowResult out_;
  SlowModel start_, start_null_;
  bool is_prepared_ = false;
};

struct SlowSearch::Impl {
  SlowSpace space;
  SlowLikelihood likelihood;
  SlowScan scans;
  CauseSearch causes;

  Impl(const SlowData& data, const NoiseBelief& belief, const std::vector<const Effect*>& library,
       const std::vector<bool>& active, const SelectorConstants& constants, const Campaign* held_out)
      : space(make_slow_space(data, belief, library, active, constants, held_out)), likelihood(space),
        scans(likelihood), causes(likelihood, &scans) {}
  SlowJudge judge() const { return SlowJudge(likelihood, scans, causes.found()); }
};

std::string SlowSearch::null_key(size_t draws, uint64_t seed) const {
  return imucal::null_key(impl_->space, draws, seed);
}
std::vector<double> SlowSearch::null_gains(size_t draws, uint64_t seed) {
  impl_->causes.prepare();
  impl_->scans.make_nodes(impl_->causes.start());
  return imucal::null_gains(impl_->likelihood, impl_->scans.all_nodes(), impl_->causes.start_null(), draws, seed);
}
void SlowSearch::forget_scans() {
  impl_->scans.forget_white();
}
void SlowSearch::set_mean_threshold(double nats) {
  impl_->space.constants.mean_nats = nats;
}

SlowSearch::SlowSearch(const SlowData& data, const NoiseBelief& belief, const std::vector<const Effect*>& library,
                       const std::vector<bool>& active, const SelectorConstants& constants, const Campaign* held_out)
    : impl_(new Impl(data, belief, library, active, constants, held_out)) {}
SlowSearch::~SlowSearch() = default;
SlowResult SlowSearch::run() {
  impl_->causes.run();
  return impl_->causes.found();
}
const std::vector<Candidate>& SlowSearch::candidates() const {
  return impl_->space.candidates;
}
NoiseModel SlowSearch::noise_of(const SlowModel& model) const {
  return impl_->likelihood.noise(model);
}
NoiseModel SlowSearch::seconds_noise_of(const SlowModel& model) const {
  return impl_->likelihood.seconds_noise(model);
}
NoiseModel SlowSearch::base_noise_of(const SlowModel& model) const {
  return impl_->likelihood.base_noise(model);
}
std::vector<MeanPart> SlowSearch::parts_on(const SlowData& data, const SlowModel& model) const {
  return impl_->likelihood.parts_on(data, model);
}
double SlowSearch::score(const SlowModel& model) const {
  return impl_->likelihood.score(model);
}
std::vector<SlowResult::Rival> SlowSearch::rivals(const SlowModel& model, size_t name) const {
  return impl_->judge().rivals(model, name);
}
std::vector<SlowCandidateScore> SlowSearch::free_beside(const SlowModel& model, size_t most) const {
  return impl_->judge().free_beside(model, most);
}
std::vector<SlowCandidateScore> SlowSearch::kinds_beside(const SlowModel& model) const {
  return imucal::kinds_beside(impl_->likelihood, impl_->causes.found(), model);
}
SlowModel SlowSearch::with_free_spectrum(const SlowModel& model) const {
  return with_kind(impl_->likelihood, impl_->causes.found(), model, free_spectrum());
}
SlowModel SlowSearch::with_free_function(const SlowModel& model, const SlowModel& also) const {
  return impl_->judge().with_free_function(model, also);
}
SlowModel SlowSearch::polished(const SlowModel& model) const {
  return imucal::polished(impl_->likelihood, model);
}
double SlowSearch::value_on(const SlowData& all, const SlowModel& model) const {
  return imucal::value_on(impl_->likelihood, all, model);
}
SlowModel SlowSearch::beside_believed(const SlowModel& model) const {
  return imucal::beside_believed(impl_->likelihood, model);
}
SlowModel SlowSearch::in_place_of_base(const SlowModel& model) const {
  return imucal::in_place_of_base(impl_->likelihood, model);
}
bool SlowSearch::has_teeth(const SlowModel& model) const {
  if (model.steps.size() < kFewestTeeth) return false;
  const JumpPattern pattern = pattern_of(impl_->likelihood, model);
  return pattern.go_one_way && pattern.n_followed > 0;
}
SlowModel SlowSearch::with_parameters(const SlowModel& model) const {
  return impl_->judge().with_parameters(model);
}
void SlowSearch::judge_again(SlowResult* result) const {
  result->best = impl_->judge().at_its_best(result->best);
  impl_->judge().judge_names(result);
}
SlowModel SlowSearch::best_with(const std::vector<const Effect*>& effects) const {
  return impl_->causes.best_with(effects);
}
RunGrams SlowSearch::grams_of(const SlowModel& model) const {
  return impl_->likelihood.grams(model);
}

} // namespace imucal
