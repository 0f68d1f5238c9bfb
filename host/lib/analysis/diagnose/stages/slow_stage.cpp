// SPDX-License-Identifier: MIT
#include "analysis/diagnose/stages/slow_stage.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "analysis/diagnose/logs/blocks.h"
#include "analysis/diagnose/stages/names.h"
#include "analysis/diagnose/stages/own_jumps.h"

namespace imucal {

namespace {

constexpr size_t kPredictionTried = 6;
constexpr size_t kBesideTried = 2;
constexpr int kExchanges = 3; // of a name for a rival that all logs together prefer

class SlowStage {
public:
  SlowStage(const AxisQuestion& question, SlowAnswer* slow) : question_(question), slow_(*slow) {}

  void run() {
    slow_.found = slow_.search->run();
    slow_.is_told_by_held_out = slow_.is_noise_of_all = false;
    if (slow_.held_blocks) forget_own(&slow_);
    weigh_steps();
    if (slow_.held_blocks) find_own(question_, &slow_);
    weigh_noise();
    weigh_rivals();
    hold_out();
    ask_free_function();
    ask_other_noise();
    weigh_kinds();
    look_beside();
  }
  // Free shapes that still gain beside the answer, or cost little and make data that were not fitted more likely: what
  // it leaves of a cause.  Held-out logs are counted too.
  void look_beside() {
    slow_.beside.clear(), answer_predicts_.reset();
    const SlowModel& best = slow_.found.best;
    if (best.names.empty() && !best.noise_effect) return;
    for (const SlowCandidateScore& s : slow_.search->free_beside(best, kBesideTried)) {
      const double nats = s.score_nats - best.free_score();
      if (is_left(nats, s.model)) slow_.beside.push_back({s.model.names.back().candidate, nats});
    }
  }

private:
  const SelectorConstants& constants() const { return question_.constants; }

  double predicted(const SlowModel& m) const {
    return predicted_nats(*slow_.search, *slow_.data, slow_.held_blocks.get(), m);
  }
  // Score of the fitted logs and likelihood of the held-out ones together.
  double all_logs(const SlowModel& m) const { return slow_.search->score(m) + predicted(m); }

  // Score without thresholds, the same.
  double all_free(const SlowModel& m) const { return m.free_score() + predicted(m); }

  // A free shape pays for its freedom in the fit, not in logs that it has not seen.  Were the answer right, their
  // likelihood ratio would exceed exp(x) with probability exp(-x) at most (Markov's inequality: its mean is 1).
  bool is_left(double fitted_nats, const SlowModel& with_shape) {
    if (fitted_nats <= -constants().lack_nats) return false;
    const bool is_much = slow_.leaves_much(fitted_nats, constants());
    if (is_much && !slow_.held_blocks) return true;
    const bool can_predict = !slow_.found.best.names.empty() && slow_.gap.method != HeldOut::kQuarters;
    if (!is_much && !can_predict) return false;
    if (!answer_predicts_) answer_predicts_ = predicted(slow_.found.best);
    const double foretold = predicted(with_shape) - *answer_predicts_;
    if (is_much && fitted_nats + foretold > constants().lack_nats) return true;
    return can_predict && foretold > constants().foretold_nats;
  }

  // A jump in time predicts no other log; a cause that makes one at a temperature does.  Held-out logs count as data of
  // the same likelihood: the answer without jumps stands where it makes all logs together more likely, and the held-out ones
  // more likely than its noise alone does.
  void weigh_steps() {
    if (!slow_.held_blocks || !slow_.found.without_steps) return;
    const SlowResult& other = *slow_.found.without_steps;
    if (other.best.names.empty()) return;
    const double foretold = predicted(other.best);
    if (slow_.search->score(other.best) + foretold <= all_logs(slow_.found.best)) return;
    if (foretold < predicted(other.null) + constants().least_held_out_nats) return;
    const SlowResult chosen = other;
    slow_.found = chosen;
  }

  // The same where slow noise stands alone, as believed or not: a cause in the mean takes its place where it makes all logs
  // together more likely by what a name must gain.  What the fitted logs leave open the held-out ones may tell; the noise
  // is estimated on all of them with the cause and without it, since what one log tells of it leaves much for a cause to
  // take.
  void weigh_noise() {
    if (!slow_.held_blocks || !slow_.found.best.names.empty() || !slow_.found.best.steps.empty()) return;
    const std::vector<const SlowModel*> singles = likeliest_singles(all_free(slow_.found.best));
    if (singles.empty()) return;
    const SlowData all = with_held_out(*slow_.data, *slow_.held_blocks);
    const double alone = likeliest_noise_on(all, slow_.found.best);
    double most = 0;
    for (const SlowModel* single : singles) {
      const double evidence = value_on(all, *single) - alone - constants().mean_nats;
      if (evidence <= most) continue;
      most = evidence;
      const double fitted = single->free_score() - slow_.found.null.free_score() - constants().mean_nats;
      slow_.is_told_by_held_out = fitted < 0;
      slow_.found.best = *single;
      slow_.found.evidence = {fitted < 0 ? evidence : fitted}, slow_.found.noise_evidence.reset();
    }
    if (most > 0) slow_.found.rivals = {slow_.search->rivals(slow_.found.best, 0)};
  }
  // Score without thresholds, the noise estimated on these logs; that of the likeliest noise without a name.
  double value_on(const SlowData& all, const SlowModel& m) const {
    return slow_.search->value_on(all, m) - m.charges();
  }
  double likeliest_noise_on(const SlowData& all, const SlowModel& plain) const {
    double most = value_on(all, plain);
    for (const SlowCandidateScore& s : slow_.found.noises) most = std::max(most, value_on(all, s.model));
    return most;
  }
  // Of the causes that gain most alone those that make all logs together more likely than this.
  std::vector<const SlowModel*> likeliest_singles(double than) const {
    std::vector<const SlowCandidateScore*> order;
    for (const SlowCandidateScore& s : slow_.found.singles)
      if (!s.model.names.empty()) order.push_back(&s);
    std::sort(order.begin(), order.end(), [](const auto* a, const auto* b) { return a->score_nats > b->score_nats; });
    if (order.size() > kPredictionTried) order.resize(kPredictionTried);
    std::vector<const SlowModel*> out;
    for (const SlowCandidateScore* s : order)
      if (all_free(s->model) > than) out.push_back(&s->model);
    return out;
  }

  // What comes near a name in the fitted logs may foretell the held-out ones better, or not at all: how far it falls behind is
  // counted in all logs together.
  void count_held_out() {
    if (!slow_.held_blocks || slow_.found.rivals.empty()) return;
    const double own = predicted(slow_.found.best);
    for (std::vector<SlowResult::Rival>& rivals : slow_.found.rivals) {
      for (SlowResult::Rival& rival : rivals) rival.gap_nats += own - predicted(rival.model);
      std::sort(rivals.begin(), rivals.end(), [](const auto& a, const auto& b) { return a.gap_nats < b.gap_nats; });
    }
  }
  void judge_again() {
    slow_.search->judge_again(&slow_.found);
    count_held_out();
  }
  // Of the effects that come near each other in the fitted logs all logs together choose.
  void weigh_rivals() {
    count_held_out();
    for (int round = 0; round < kExchanges; ++round) {
      const SlowResult::Rival* better = preferred();
      if (!better) return;
      exchange(*better);
    }
  }
  void exchange(SlowResult::Rival by) {
    slow_.found.best = by.model;
    if (!slow_.is_told_by_held_out) return judge_again();
    slow_.found.evidence[0] -= by.gap_nats;
    slow_.found.rivals = {slow_.search->rivals(by.model, 0)};
    count_held_out();
  }
  // Whether the held-out logs can show the last name of a model beyond its start states, which are free in every log: these
  // tell no cause from another.
  bool is_shown_beyond_start(const SlowModel& m) const {
    const GapResult gap = measure_gap(*slow_.search, *slow_.data, slow_.held_blocks.get(), slow_.found.null, m);
    return can_show(gap.foretold.beyond_start.back(), constants());
  }
  // An effect in the place of a name: more likely by all logs together, or hardly less where the name has a parameter at its
  // bound, which is no name.
  const SlowResult::Rival* preferred() const {
    for (size_t i = 0; i < slow_.found.best.names.size(); ++i)
      for (const SlowResult::Rival& rival : slow_.found.rivals[i])
        if (!rival.noise_effect && slow_.candidate(rival.candidate).effect && is_worth_a_name(rival, i) &&
            (is_told_by_unseen(rival, i) || is_within_bounds(rival, i)))
          return &rival;
    return nullptr;
  }
  bool is_worth_a_name(const SlowResult::Rival& rival, size_t i) const {
    const double lost = slow_.found.best.free_score() - rival.model.free_score();
    return slow_.is_told_by_held_out || slow_.found.evidence[i] > lost;
  }
  // What differs from run to run by chance has no start states to live off, and shows nothing but its spread: it has to be ahead.
  bool is_told_by_unseen(const SlowResult::Rival& rival, size_t i) const {
    if (!slow_.held_blocks) return false;
    const bool is_within = !slow_.found.best.names[i].is_at_bound;
    if (is_within && rival.model.names.back().is_at_bound && is_little(-rival.gap_nats, rival, i)) return false;
    if (slow_.candidate(rival.candidate).scan.estimator->form() == Form::kRunRandom)
      return rival.gap_nats < -constants().rivals_nats;
    return rival.gap_nats < 0 && is_shown_beyond_start(rival.model);
  }
  bool is_within_bounds(const SlowResult::Rival& rival, size_t i) const {
    return slow_.found.best.names[i].is_at_bound && !rival.model.names.back().is_at_bound &&
           is_little(rival.gap_nats, rival, i);
  }
  // What an effect with a parameter at its bound is ahead by and gives way all the same: to one of its family as little as any
  // shape without a name may gain beside a name.
  bool is_little(double nats, const SlowResult::Rival& rival, size_t i) const {
    if (nats < constants().family_margin_nats) return true;
    const Candidate& own = slow_.candidate(slow_.found.best.names[i].candidate);
    return slow_.candidate(rival.candidate).family() == own.family() && !slow_.leaves_much(nats, constants());
  }

  // A free function of everything that repeats joins an answer where it makes all logs together more likely, and what
  // does not do so beside it goes: that function holds what it stood for.  Other noise parameters are an answer too.
  void ask_free_function() {
    const SlowModel& answer = slow_.found.best;
    const bool is_as_believed = answer.is_believed || !question_.belief.has_believed;
    if (answer.names.empty() && !answer.noise_effect && is_as_believed) return;
    if (slow_.gap.method == HeldOut::kQuarters) return; // parts of one passage foretell nothing of another
    std::vector<SlowModel> beside = {answer};
    if (!answer.names.empty() || answer.noise_effect) {
      beside.push_back(answer);
      beside.back().names.clear(), beside.back().noise_effect = nullptr;
    }
    if (!answer.steps.empty()) {
      beside.push_back(beside.back());
      beside.back().steps.clear();
    }
    const double of_answer = all_logs(answer);
    double highest = of_answer;
    std::optional<SlowModel> with;
    for (const SlowModel& less : beside) {
      SlowModel m = slow_.search->with_free_function(less, slow_.found.null);
      if (m.names.empty() || all_logs(m) < highest - constants().near_nats) continue;
      m = slow_.search->polished(m);
      if (const double value = all_logs(m); value > highest) highest = value, with = m;
    }
    if (!with) return;
    const SlowResult before = slow_.found;
    if (!holds_nearly_all(answer, of_answer, highest)) {
      slow_.found.best = without_needless(*with, highest);
      judge_again();
      // Of the function, by all logs together: over the answer, and over nothing.
      const double evidence = highest - std::max(of_answer, all_logs(slow_.found.null)) - constants().mean_nats;
      for (size_t i = 0; i < slow_.found.best.names.size(); ++i)
        if (evidence > 0 && slow_.is_free_function(i)) slow_.found.evidence[i] = evidence;
      if (has_evidence(slow_.found) || !has_evidence(before)) return hold_out();
    }
    slow_.found = before; // and the function is what it leaves
    slow_.found.replaced.push_back(with->names.back().candidate);
  }
  static bool has_evidence(const SlowResult& r) {
    return r.has_noise() || std::any_of(r.evidence.begin(), r.evidence.end(), [](double nats) { return nats > 0; });
  }
  // Whether one or two members are nearly all that the free function would be: what it has beside them, as the product of
  // two causes, is no reason to doubt them.
  bool holds_nearly_all(const SlowModel& answer, double of_answer, double highest) const {
    const std::vector<SlowModel::Name>& names = answer.names;
    const auto is_member = [&](const auto& name) {
      return slow_.candidate(name.candidate).effect && !name.is_at_bound;
    };
    if (names.empty() || names.size() > kFewNames || !std::all_of(names.begin(), names.end(), is_member)) return false;
    if (answer.noise_effect || !answer.steps.empty()) return false;
    const double nothing = all_logs(slow_.found.null);
    return of_answer - nothing > constants().member_share * (highest - nothing);
  }
  // Names beside the free function, which is the last, a kind of noise and jumps in time go as long as all logs together do not become
  // less likely.
  SlowModel without_needless(const SlowModel& m, double value) const {
    std::vector<SlowModel> fewer;
    for (size_t i = 0; i + 1 < m.names.size(); ++i) fewer.push_back(m.without(i));
    if (m.noise_effect) fewer.push_back(m), fewer.back().noise_effect = nullptr;
    if (!m.steps.empty()) fewer.push_back(m), fewer.back().steps.clear();
    const SlowModel* best = nullptr;
    for (SlowModel& less : fewer) {
      less = slow_.search->polished(less);
      if (const double v = all_logs(less); v >= value) value = v, best = &less;
    }
    return best ? without_needless(*best, value) : m;
  }

  // Names live by what they predict: one that the held-out data do not support goes, the least supported first.
  void hold_out() {
    slow_.dropped.clear();
    SlowModel& best = slow_.found.best;
    while (true) {
      slow_.measure();
      size_t worst = 0;
      for (size_t i = 1; i < best.names.size(); ++i)
        if (lacking(i) > lacking(worst)) worst = i;
      if (best.names.empty() || lacking(worst) <= 0) return;
      SelectedEffect gone = effect_of_name(slow_, constants(), worst);
      gone.doubt = Doubt::kAgainst;
      slow_.dropped.push_back(gone);
      best = best.without(worst);
      slow_.found.evidence.erase(slow_.found.evidence.begin() + static_cast<long>(worst));
      slow_.found.rivals.erase(slow_.found.rivals.begin() + static_cast<long>(worst));
      best.names.empty() ? take_best_without_names() : judge_again();
    }
  }
  // Jumps in time, slow noise, both, or neither.  What each gains is judged anew: of noise beside jumps, what it gains beside them.
  void take_best_without_names() {
    slow_.found.best = best_without_names();
    slow_.is_told_by_held_out = false;
    slow_.found.replaced.clear();
    judge_again();
  }

  // The threshold of a name was drawn from noise of the believed kind.  Slow noise of another kind that the logs may hold, too
  // little of it to be named, makes more by chance: one name alone must also gain what it gains in draws of the likeliest kind,
  // on the fitted logs or on all of them: what came by chance does not come back.
  void ask_other_noise() {
    const SlowModel& best = slow_.found.best;
    if (!question_.threshold_under || best.names.size() != 1 || best.noise_effect || !best.steps.empty()) return;
    const double gain = slow_.found.evidence[0] + constants().mean_nats;
    if (slow_.found.evidence[0] <= 0 || gain > constants().most_threshold_nats) return;
    const SlowModel* kind = nullptr;
    for (const SlowCandidateScore& s : slow_.found.noises)
      if (s.model.noise_effect && (!kind || s.model.value > kind->value)) kind = &s.model;
    if (!kind) return;
    const double threshold = question_.threshold_under(*slow_.search, *kind);
    if (gain > threshold || (slow_.held_blocks && gain_on_all() > threshold)) return;
    take_best_without_names();
    slow_.measure();
  }
  double gain_on_all() const {
    const SlowData all = with_held_out(*slow_.data, *slow_.held_blocks);
    return value_on(all, slow_.found.best) - likeliest_noise_on(all, slow_.found.null);
  }
  // Of slow noise one log holds little, and parameters that the fitted logs tell may be wrong for the others.  Where the held-out logs
  // speak against the kind that was found, or leave more than a noise without one, all logs together are asked.
  void weigh_kinds() {
    const SlowModel& best = slow_.found.best;
    if (!slow_.held_blocks || !best.names.empty() || !best.steps.empty()) return;
    if (best.noise_effect ? !slow_.is_against(constants()) : !slow_.gap.minutes.leave_mean(constants())) return;
    const SlowData all = with_held_out(*slow_.data, *slow_.held_blocks);
    const SlowModel* kind = nullptr;
    double most = value_on(all, slow_.found.null) + constants().noise_nats;
    const double least = most;
    for (const SlowCandidateScore& s : slow_.found.noises) {
      const double value = s.model.noise_effect ? value_on(all, s.model) + s.model.noise_charge : -1e300;
      if (value > most) most = value, kind = &s.model;
    }
    if (!kind) return;
    slow_.found.best = *kind;
    slow_.found.noise_evidence = most - least, slow_.found.rivals.clear();
    slow_.is_noise_of_all = true;
    slow_.measure();
  }

  // By how much a name predicts too little.  What is repeatable gains on every log about what it gained on the fitted
  // ones, as far as those logs can show it: a log that only rises shows little of a memory, and a start state that is
  // free hides a warm-up; where it hides most, what the whole of the name foretells stands beside what chance may take from
  // the rest.  Quarters of one log are no passages of their own and are only asked for the least.  What
  // differs from run to run by chance predicts nothing: it is not asked to.
  double lacking(size_t i) const {
    const double least = constants().least_held_out_nats, part = constants().predicted_part;
    const Support own = slow_.gap.foretold.beyond_start[i], all = slow_.gap.foretold.at_all[i];
    if (slow_.candidate(slow_.found.best.names[i].candidate).scan.estimator->form() == Form::kRunRandom) return -1e9;
    if (slow_.is_free_function(i)) return -1e9; // chosen for what it predicts
    if (slow_.gap.method == HeldOut::kQuarters) return least - own.nats;
    const double fitted_h = static_cast<double>(question_.campaign.n()) * question_.campaign.dt_s / 3600;
    const double gain = slow_.found.evidence[i] + constants().mean_nats;
    const double wanted = gain * std::min(1.0, slow_.gap.foretold.hours / fitted_h);
    const bool shows_own = can_show(own, constants()), shows_all = can_show(all, constants());
    if (!shows_own && !shows_all) return -constants().against_nats - all.nats;
    if (shows_own && shows_all && all.nats > part * std::min(wanted, all.expected) && is_by_chance(own)) return -least;
    const Support& s = shows_own ? own : all;
    return std::max(least, part * std::min(wanted, s.expected)) - s.nats;
  }
  // Whether a right name could gain so little: of data as predicted it gains E, of data with noise E and a normal error of
  // variance 2 E.
  bool is_by_chance(const Support& s) const {
    return s.nats > s.expected - constants().short_by_chance * std::sqrt(2 * s.expected);
  }
  SlowModel best_without_names() const {
    std::vector<SlowModel> others;
    for (const SlowCandidateScore& s : slow_.found.noises) others.push_back(s.model);
    if (!slow_.found.best.steps.empty()) {
      SlowModel jumps = slow_.found.null;
      jumps.steps = slow_.found.best.steps;
      others.push_back(slow_.search->polished(jumps));
    }
    SlowModel best = slow_.found.null;
    for (const SlowModel& m : others)
      if (slow_.search->score(m) > slow_.search->score(best)) best = m;
    return best;
  }

  const AxisQuestion& question_;
  SlowAnswer& slow_;
  std::optional<double> answer_predicts_; // log density of what was not fitted
};

} // namespace

void prepare_slow(const AxisQuestion& question, Campaign* logs, const Campaign* held_out, SlowAnswer* slow) {
  const double block_s = block_length_s(*logs);
  slow->data.reset(new SlowData(block_means(*logs, block_s)));
  logs->spread_dph = slow->data->spread_dph;
  if (held_out) slow->held_blocks.reset(new Campaign(block_means(*held_out, block_s)));
  slow->search.reset(new SlowSearch(*slow->data, question.belief, question.library, question.active, question.constants,
                                    slow->held_blocks.get()));
}
void run_slow(const AxisQuestion& question, SlowAnswer* slow) {
  SlowStage(question, slow).run();
  slow->search->forget_scans();
}
void look_beside(const AxisQuestion& question, SlowAnswer* slow) {
  SlowStage(question, slow).look_beside();
  slow->search->forget_scans();
}

} // namespace imucal
