// SPDX-License-Identifier: MIT
#include "analysis/diagnose/select.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "analysis/diagnose/blocks.h"
#include "analysis/diagnose/structure.h"

namespace imucal {

using Eigen::VectorXd;

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr size_t kUndecidedTried = 4;
constexpr size_t kPredictionTried = 3;
constexpr size_t kBesideTried = 2;
constexpr size_t kFewNames = 2; // what the library is made for; more names have to be worth more
constexpr size_t kMostLines = 3;
constexpr size_t kFewToDrift = 200000; // samples: lines that drift are not looked for in longer logs
constexpr int kJumpingRounds = 3;      // of levels and of what is found without them
constexpr int kJumpingPasses = 2;      // of the mean and of the noise beside noise that jumps, in turn
constexpr size_t kMostJumps = 2;       // more are a noise that jumps, not events

// A line that stands in the mean.
struct NamedLine {
  const Effect* effect;
  Theta shape;
  double gain_nats, threshold_nats;
};

class Study {
public:
  Study(Campaign* campaign, const Campaign* held_out, NoiseBelief belief, const std::vector<const Effect*>& library,
        const std::vector<bool>& active, const SelectOptions& options)
      : campaign_(*campaign), held_out_(held_out), belief_(std::move(belief)), library_(library), active_(active),
        options_(options) {}

  AxisStudy run() {
    structural();
    if (campaign_.n() < 60) {
      selection().cannot_judge = true;
      selection().effects = structural_;
      selection().verdict = Verdict::kPartlyExplained;
      return std::move(out_);
    }
    do {
      slow_stage(&campaign_, held_out_);
      seconds();
    } while (takes_line());
    if (!lines_.empty()) measure_with_lines();
    fast_stage();
    name_slow();
    name_undecided();
    name_fast();
    name_retuned();
    finish();
    return std::move(out_);
  }

private:
  struct Beside {
    size_t candidate;
    double nats;
  };
  // The search in block means, what held-out data say of it, and what is left beside it.
  void slow_stage(Campaign* logs, const Campaign* held_out) {
    const double block_s = block_length_s(*logs);
    out_.data.reset(new SlowData(block_means(*logs, block_s)));
    logs->spread_dph = out_.data->spread_dph;
    out_.search.reset(new SlowSearch(*out_.data, belief_, library_, active_, options_.constants));
    const bool is_first = logs == &campaign_ && lines_.empty();
    if (options_.calibrate && is_first) options_.constants.mean_nats = options_.calibrate(out_.search.get());
    if (options_.calibrate) out_.search->set_mean_threshold(options_.constants.mean_nats);
    out_.slow = out_.search->run();
    if (held_out) held_blocks_.reset(new Campaign(block_means(*held_out, block_s)));
    weigh_steps();
    weigh_noise();
    hold_out();
    ask_free_function();
    look_beside();
  }
  // A line in the spectrum of what is left was in everybody's way: kinds of noise took its place, and the noise of all
  // hypotheses held it.  It joins the mean, in every run with its own amplitude and phase, and all is asked again.
  bool takes_line() {
    if (lines_.size() == kMostLines) return false;
    const std::optional<NamedLine> line = line_found();
    if (!line) return false;
    lines_.push_back(*line);
    belief_.known.push_back({line->effect->estimator(), line->shape});
    return true;
  }
  // A line that drifts stands still while the temperature rests, and one that stands still drifts a little by chance: the
  // one of more power, each above its threshold, is it.
  std::optional<NamedLine> line_found() const {
    const auto tone = std::find_if(library_.begin(), library_.end(), [](const Effect* effect) {
      return effect->estimator() && effect->estimator()->form() == Form::kTone;
    });
    if (tone == library_.end() || !active_[static_cast<size_t>(tone - library_.begin())]) return std::nullopt;
    std::optional<NamedLine> best;
    double highest = 0;
    const std::vector<VectorXd> e = whitened();
    const Line steady = strongest_line(campaign_, e, false);
    for (const bool drifts : {false, true}) {
      if (drifts && campaign_.n() >= kFewToDrift) break;
      const Line line = drifts ? stronger_drifting(campaign_, e, steady) : steady;
      if (drifts && line.hz_per_degc == 0) break;
      const double threshold_nats = drifts ? constants().drift_nats : constants().line_nats;
      if (line.gain_nats <= threshold_nats) continue;
      const PlacedLine placed = place_of(campaign_, e, *(*tone)->estimator(), line);
      if (placed.power_nats - threshold_nats <= highest) continue;
      highest = placed.power_nats - threshold_nats;
      best = NamedLine{*tone, placed.shape, line.gain_nats, threshold_nats};
    }
    return best;
  }
  // The lines are part of what was there before.
  void measure_with_lines() {
    SlowModel nominal = out_.slow.null;
    nominal.is_without_lines = true;
    out_.gap = measure_gap(*out_.search, *out_.data, held_blocks_.get(), nominal, out_.slow.best);
  }
  Selection& selection() { return out_.selection; }
  const Selection& selection() const { return out_.selection; }
  const SelectorConstants& constants() const { return options_.constants; }
  const Candidate& candidate(size_t j) const { return out_.search->candidates()[j]; }
  Term term_of(const Effect* effect, const EffectEstimator* estimator, const Theta& shape) const {
    Term term;
    term.effect = effect, term.estimator = estimator, term.shape = shape;
    return term;
  }
  CandidateEvidence evidence_of(size_t j, double gain, double threshold) const {
    const Candidate& c = candidate(j);
    return {c.effect, c.reference, false, c.family(), gain, threshold};
  }

  void structural() {
    const StructureResult found = find_structure(&campaign_, library_, active_);
    selection().n_dropouts = found.n_dropouts, selection().n_left_out = found.n_left_out;
    extra_white_dph2_ = belief_.model.extra_white_dph2 = found.extra_white_dph2;
    is_censored_ = found.is_censored;
    for (const StructureFinding& f : found.findings) {
      SelectedEffect effect;
      effect.family = f.effect->family();
      effect.term = term_of(f.effect, f.effect->estimator(), {});
      effect.term.fixed_parameters = f.signature.parameters;
      effect.is_structural = true;
      effect.statement = f.signature.statement;
      effect.gain_nats = effect.evidence_nats = f.signature.evidence_nats;
      effect.held_out_nats = kNaN;
      effect.set = {{f.effect, nullptr, false, effect.family, f.signature.evidence_nats, 0}};
      structural_.push_back(effect);
    }
  }

  // Score of the fitted logs and likelihood of the held-out ones together.
  double all_logs(const SlowModel& m) const {
    return out_.search->score(m) + predicted_nats(*out_.search, *out_.data, held_blocks_.get(), m);
  }

  // A jump in time predicts no other log; a cause that makes one at a temperature does.  Held-out logs count as data of
  // the same likelihood: the answer without jumps stands where it makes all logs together more likely.
  void weigh_steps() {
    if (!held_blocks_ || !out_.slow.without_steps) return;
    const SlowResult& other = *out_.slow.without_steps;
    if (!other.best.names.empty() && all_logs(other.best) > all_logs(out_.slow.best)) {
      const SlowResult chosen = other;
      out_.slow = chosen;
    }
  }

  // The same where slow noise stands alone, of another kind or with other parameters: a cause in the mean that makes all
  // logs together more likely takes its place.  What the fitted logs leave open the held-out ones may tell: there what
  // all logs gain has to be worth a name.
  void weigh_noise() {
    if (!held_blocks_ || !out_.slow.best.names.empty() || !out_.slow.best.steps.empty()) return;
    const SlowModel noise = out_.slow.best;
    const double alone = all_logs(noise);
    double highest = noise.noise_effect ? alone : alone + constants().mean_nats;
    std::vector<std::pair<double, size_t>> order;
    for (size_t j = 0; j < out_.slow.singles.size(); ++j)
      if (!out_.slow.singles[j].model.names.empty()) order.push_back({out_.slow.singles[j].gain_nats, j});
    std::sort(order.rbegin(), order.rend());
    for (size_t i = 0; i < order.size() && i < kPredictionTried; ++i) {
      const SlowModel& single = out_.slow.singles[order[i].second].model;
      double evidence = single.free_score() - out_.slow.null.free_score() - constants().mean_nats;
      if (evidence < 0 && !is_undecided(noise, single)) continue;
      const double value = all_logs(single);
      const bool is_told = evidence < 0;
      if (is_told) evidence = value - alone - constants().mean_nats;
      if (value > highest && evidence > 0) {
        highest = value;
        selection().is_told_by_held_out = is_told;
        out_.slow.best = single;
        out_.slow.evidence = {evidence};
        out_.slow.rivals = {{}};
      }
    }
  }
  // A cause that gains hardly less than slow noise and takes most of what it takes.
  bool is_undecided(const SlowModel& noise, const SlowModel& cause) const {
    return noise.free_score() - cause.free_score() < constants().undecided_nats &&
           part_left(cause) < constants().carried_part;
  }

  bool is_free_function(size_t i) const { return candidate(out_.slow.best.names[i].candidate).is_free_function; }
  bool has_free_function() const {
    for (size_t i = 0; i < out_.slow.best.names.size(); ++i)
      if (is_free_function(i)) return true;
    return false;
  }
  // A free function of everything that repeats joins an answer where it makes all logs together more likely, and what
  // does not do so beside it goes: that function holds what it stood for.  Other noise parameters are an answer too.
  void ask_free_function() {
    const SlowModel& answer = out_.slow.best;
    const bool is_as_believed = answer.is_believed || !belief_.has_believed;
    if (answer.names.empty() && !answer.noise_effect && is_as_believed) return;
    if (out_.gap.method == HeldOut::kQuarters) return; // parts of one passage foretell nothing of another
    std::vector<SlowModel> beside = {answer};
    if (!answer.names.empty() || answer.noise_effect) {
      beside.push_back(answer);
      beside.back().names.clear(), beside.back().noise_effect = nullptr;
    }
    double highest = all_logs(answer);
    std::optional<SlowModel> with;
    for (const SlowModel& less : beside) {
      SlowModel m = out_.search->with_free_function(less, out_.slow.null);
      if (m.names.empty() || all_logs(m) < highest - constants().near_nats) continue;
      m = out_.search->polished(m);
      if (const double value = all_logs(m); value > highest) highest = value, with = m;
    }
    if (!with) return;
    out_.slow.best = without_needless(*with, highest);
    out_.search->judge_again(&out_.slow);
    hold_out();
  }
  // Names beside the free function, which is the last, and a kind of noise go as long as all logs together do not become
  // less likely.
  SlowModel without_needless(const SlowModel& m, double value) const {
    std::vector<SlowModel> fewer;
    for (size_t i = 0; i + 1 < m.names.size(); ++i) fewer.push_back(m.without(i));
    if (m.noise_effect) fewer.push_back(m), fewer.back().noise_effect = nullptr;
    const SlowModel* best = nullptr;
    for (SlowModel& less : fewer) {
      less = out_.search->polished(less);
      if (const double v = all_logs(less); v >= value) value = v, best = &less;
    }
    return best ? without_needless(*best, value) : m;
  }

  // Free shapes that still gain beside the answer, or cost little and make data that were not fitted more likely: what
  // it leaves of a cause.
  void look_beside() {
    beside_.clear(), answer_predicts_.reset();
    const SlowModel& best = out_.slow.best;
    if (best.names.empty() && !best.noise_effect) return;
    for (const SlowCandidateScore& s : out_.search->free_beside(best, kBesideTried)) {
      const double nats = s.gain_nats - best.free_score();
      if (leaves_much(nats) || (nats > -constants().lack_nats && predicts_more(s.model)))
        beside_.push_back({s.model.names.back().candidate, nats});
    }
  }
  // A free shape pays for its freedom in the fit, not in logs that it has not seen.  Were the answer right, their
  // likelihood ratio would exceed exp(x) with probability exp(-x) at most (Markov's inequality: its mean is 1).
  bool predicts_more(const SlowModel& with_shape) {
    if (out_.slow.best.names.empty() || out_.gap.method == HeldOut::kQuarters) return false;
    const auto predicted = [&](const SlowModel& m) {
      return predicted_nats(*out_.search, *out_.data, held_blocks_.get(), m);
    };
    if (!answer_predicts_) answer_predicts_ = predicted(out_.slow.best);
    return predicted(with_shape) - *answer_predicts_ > constants().foretold_nats;
  }
  bool leaves_much(double nats) const {
    const double gain = out_.slow.best.free_score() - out_.slow.null.free_score();
    return nats > constants().lack_nats && nats > constants().lack_part * (std::max(0.0, gain) + nats);
  }
  // Held-out logs that become less likely by the answer.
  bool is_against() const { return held_blocks_ && 0.5 * out_.gap.delta_deviance < -constants().against_nats; }

  // Names live by what they predict: one that the held-out data do not support goes, the least supported first.
  void hold_out() {
    selection().dropped.clear();
    SlowModel& best = out_.slow.best;
    while (true) {
      out_.gap = measure_gap(*out_.search, *out_.data, held_blocks_.get(), out_.slow.null, best);
      size_t worst = 0;
      for (size_t i = 1; i < best.names.size(); ++i)
        if (lacking(i) > lacking(worst)) worst = i;
      if (best.names.empty() || lacking(worst) <= 0) return;
      SelectedEffect gone = slow_effect(worst);
      gone.doubt = Doubt::kAgainst;
      selection().dropped.push_back(gone);
      best = best.without(worst);
      out_.slow.evidence.erase(out_.slow.evidence.begin() + static_cast<long>(worst));
      out_.slow.rivals.erase(out_.slow.rivals.begin() + static_cast<long>(worst));
      if (best.names.empty()) {
        best = best_without_names();
        out_.slow.evidence.clear(), out_.slow.rivals.clear();
        if (best.noise_effect) out_.slow.evidence.push_back(noise_evidence(best));
      } else {
        out_.search->judge_again(&out_.slow);
      }
    }
  }
  // By how much a name predicts too little.  What is repeatable gains on every log about what it gained on the fitted
  // ones, as far as those logs can show it: a log that only rises shows little of a memory, and a start state that is
  // free hides a warm-up; where it hides most, what the whole of the name foretells stands beside what chance may take from
  // the rest.  Quarters of one log are no passages of their own and are only asked for the least.  What
  // differs from run to run by chance predicts nothing: it is not asked to.
  double lacking(size_t i) const {
    const double least = constants().least_held_out_nats, part = constants().predicted_part;
    const GapResult::Support own = out_.gap.beyond_start[i], all = out_.gap.at_all[i];
    if (candidate(out_.slow.best.names[i].candidate).scan.estimator->form() == Form::kRunRandom) return -1e9;
    if (is_free_function(i)) return -1e9; // chosen for what it predicts
    if (out_.gap.method == HeldOut::kQuarters) return least - own.nats;
    const double fitted_h = static_cast<double>(campaign_.n()) * campaign_.dt_s / 3600;
    const double gain = out_.slow.evidence[i] + constants().mean_nats;
    const double wanted = gain * std::min(1.0, out_.gap.hours / fitted_h);
    const auto can_show = [&](const GapResult::Support& s) { return part * s.expected > least; };
    if (!can_show(own) && !can_show(all)) return -constants().against_nats - all.nats;
    if (can_show(own) && can_show(all) && all.nats > part * std::min(wanted, all.expected) && is_by_chance(own))
      return -least;
    const GapResult::Support& s = can_show(own) ? own : all;
    return std::max(least, part * std::min(wanted, s.expected)) - s.nats;
  }
  // Whether a right name could gain so little: of data as predicted it gains E, of data with noise E and a normal error of
  // variance 2 E.
  bool is_by_chance(const GapResult::Support& s) const {
    return s.nats > s.expected - constants().short_by_chance * std::sqrt(2 * s.expected);
  }
  double noise_evidence(const SlowModel& m) const {
    return m.free_score() + m.noise_charge - out_.slow.null.free_score() - constants().noise_nats;
  }
  SlowModel best_without_names() const {
    SlowModel best = out_.slow.null;
    for (const SlowCandidateScore& s : out_.slow.noises)
      if (s.gain_nats > best.free_score()) best = s.model;
    return best;
  }

  SelectedEffect slow_effect(size_t i) const {
    const SlowModel::Name& name = out_.slow.best.names[i];
    const Candidate& c = candidate(name.candidate);
    SelectedEffect effect;
    effect.family = c.family();
    effect.term = term_of(c.effect, c.scan.estimator, name.shape);
    effect.evidence_nats = out_.slow.evidence[i];
    effect.gain_nats = effect.evidence_nats + constants().mean_nats;
    effect.held_out_nats = c.scan.estimator->form() == Form::kRunRandom ? kNaN
                           : i < out_.gap.beyond_start.size()           ? out_.gap.beyond_start[i].nats
                                                                        : kNaN;
    const double threshold = constants().mean_nats;
    effect.set.push_back(evidence_of(name.candidate, effect.gain_nats, threshold));
    double nearest = 1e300; // of another member of the family
    for (const SlowResult::Rival& rival : out_.slow.rivals[i]) {
      const Effect* other = rival.noise_effect ? rival.noise_effect : candidate(rival.candidate).effect;
      if (!other) continue;
      if (other->family() == effect.family) nearest = std::min(nearest, rival.gap_nats);
      effect.set.push_back({other, nullptr, false, other->family(), effect.gain_nats - rival.gap_nats, threshold});
    }
    if (!c.effect || name.is_at_bound) {
      effect.is_family = true;
      effect.doubt = Doubt::kShapeOpen;
      add_members(&effect);
    } else if (nearest < constants().family_margin_nats) {
      open_member(&effect);
    }
    return effect;
  }

  // Behind what is in the set already, what gains most first.
  static void add_to_set(std::vector<CandidateEvidence> list, SelectedEffect* effect) {
    std::sort(list.begin(), list.end(), [](const auto& a, const auto& b) { return a.gain_nats > b.gain_nats; });
    effect->set.insert(effect->set.end(), list.begin(), list.end());
  }
  // The members of a family whose shape is open, by what each gains alone.
  void add_members(SelectedEffect* effect) const {
    std::vector<CandidateEvidence> members;
    for (size_t j = 0; j < out_.slow.singles.size(); ++j) {
      const Effect* member = candidate(j).effect;
      const double gain = out_.slow.singles[j].gain_nats - out_.slow.null.free_score();
      if (!member || member == effect->term.effect || member->family() != effect->family || gain <= 0) continue;
      members.push_back(evidence_of(j, gain, constants().mean_nats));
    }
    add_to_set(std::move(members), effect);
  }

  static bool is_free(const SelectedEffect& effect) { return !effect.term.effect; }
  static void open_member(SelectedEffect* effect) { effect->is_family = true, effect->doubt = Doubt::kMemberOpen; }
  static void open_shape(SelectedEffect* effect) { effect->is_family = true, effect->doubt = Doubt::kShapeOpen; }
  void leave(const SelectedEffect& effect) { selection().remainders.push_back(effect.set.front()); }
  template <class F> void leave_those(F goes, std::vector<SelectedEffect>* list) {
    const auto kept = [&](const SelectedEffect& effect) { return !goes(effect); };
    const auto gone = std::stable_partition(list->begin(), list->end(), kept);
    for (auto effect = gone; effect != list->end(); ++effect) leave(*effect);
    list->erase(gone, list->end());
  }

  void name_slow() {
    const SlowModel& best = out_.slow.best;
    std::vector<SelectedEffect> list;
    for (size_t i = 0; i < best.names.size(); ++i)
      if (out_.slow.evidence[i] > 0) list.push_back(slow_effect(i));
    std::sort(list.begin(), list.end(), [](const auto& a, const auto& b) { return a.evidence_nats > b.evidence_nats; });
    const bool is_medley = is_made_of_many(list);
    if (is_medley)
      leave_those([](const SelectedEffect&) { return true; }, &list);
    else if (has_free_function())
      leave_small(&list, 1e300);
    named_ = owned(members_before_shapes(list));
    for (const SelectedEffect& effect : named_)
      if (is_free(effect)) {
        leave_small(&named_, effect.gain_nats);
        break;
      }
    for (size_t j : out_.slow.replaced) selection().remainders.push_back(evidence_of(j, 0, 0));
    open_by_lack();
    leave_beside_open_family();
    if (!best.steps.empty() && !is_medley) name_steps();
    if (best.noise_effect && !out_.slow.evidence.empty() && out_.slow.evidence.back() > 0 && !is_medley)
      name_slow_noise();
  }
  // A member that holds less than a third of all, and less than the free shape beside it, is what that shape leaves.
  void leave_small(std::vector<SelectedEffect>* list, double shape_nats) {
    const double all = out_.slow.best.free_score() - out_.slow.null.free_score();
    const double least = std::min(shape_nats, constants().beside_free_part * all);
    leave_those([&](const SelectedEffect& e) { return !is_free(e) && e.gain_nats < least; }, list);
  }
  // Nor is a member told beside a larger answer of its family whose shape is open.
  void leave_beside_open_family() {
    std::vector<SelectedEffect> open;
    for (const SelectedEffect& effect : named_)
      if (effect.doubt == Doubt::kShapeOpen) open.push_back(effect);
    const auto is_part = [&](const SelectedEffect& effect) {
      return effect.doubt != Doubt::kShapeOpen &&
             std::any_of(open.begin(), open.end(), [&](const SelectedEffect& whole) {
               return whole.family == effect.family && whole.gain_nats > effect.gain_nats;
             });
    };
    leave_those(is_part, &named_);
  }
  // More names than few, none of which could be left out: their sum is a stand-in for a cause of another shape.
  bool is_made_of_many(const std::vector<SelectedEffect>& list) const {
    if (list.size() + (out_.slow.best.steps.empty() ? 0 : 1) <= kFewNames) return false;
    double sum = out_.slow.step_gain_nats, least = sum > 0 ? sum : 1e300;
    for (const SelectedEffect& effect : list) sum += effect.gain_nats, least = std::min(least, effect.gain_nats);
    return least > constants().least_share * sum;
  }
  // A free shape beside a member of the same family is what that member leaves, not another cause; where it is much, the
  // member is not the cause.  Two free shapes of one family are one answer.
  std::vector<SelectedEffect> members_before_shapes(const std::vector<SelectedEffect>& list) {
    std::vector<SelectedEffect> kept;
    const auto same_family = [&](const SelectedEffect& effect, bool free) {
      return std::find_if(kept.begin(), kept.end(), [&](const SelectedEffect& other) {
        return other.family == effect.family && is_free(other) == free;
      });
    };
    for (const SelectedEffect& effect : list)
      if (!is_free(effect)) kept.push_back(effect);
    for (const SelectedEffect& effect : list) {
      if (!is_free(effect)) continue;
      const auto member = same_family(effect, false), shape = same_family(effect, true);
      if (member == kept.end() && shape == kept.end()) {
        kept.push_back(effect);
        continue;
      }
      leave(effect);
      const double share = constants().member_share;
      if (member != kept.end() && effect.gain_nats > (1 - share) / share * member->gain_nats) open_shape(&*member);
    }
    std::sort(kept.begin(), kept.end(), [](const auto& a, const auto& b) { return a.evidence_nats > b.evidence_nats; });
    return kept;
  }
  // Free shapes of different kinds together, or one of a kind that no effect is of, are no family: nothing is named then.  Where
  // they hold much, a member alone beside them is not told from its family.
  std::vector<SelectedEffect> owned(const std::vector<SelectedEffect>& list) {
    size_t shapes = 0;
    bool has_owner = true;
    for (const SelectedEffect& effect : list)
      if (is_free(effect)) ++shapes, has_owner = has_owner && has_members(effect);
    std::vector<SelectedEffect> kept;
    double left_nats = 0;
    for (const SelectedEffect& effect : list)
      if (is_free(effect) && (shapes > 1 || !has_owner))
        leave(effect), left_nats = std::max(left_nats, effect.gain_nats);
      else
        kept.push_back(effect);
    const double all = out_.slow.best.free_score() - out_.slow.null.free_score();
    if (kept.size() == 1 && left_nats > constants().lack_part * all) open_shape(&kept[0]);
    return kept;
  }
  static bool has_members(const SelectedEffect& effect) {
    return !effect.set.front().reference || effect.set.front().reference->has_members;
  }
  // Members are names while no free shape beside them gains much.  One of another family that does as well alone shows
  // that the family is not told either.
  void open_by_lack() {
    for (const Beside& rest : beside_) {
      const Family family = candidate(rest.candidate).family();
      selection().remainders.push_back(evidence_of(rest.candidate, rest.nats, 0));
      if (named_.size() == 1 && named_[0].family != family && does_as_well(rest.candidate)) {
        leave(named_[0]);
        named_.clear();
      }
      for (SelectedEffect& effect : named_)
        if (effect.family == family || named_.size() == 1) open_shape(&effect);
    }
  }
  bool does_as_well(size_t free_shape) const {
    const double null = out_.slow.null.free_score(), all = out_.slow.best.free_score() - null;
    return out_.slow.singles[free_shape].gain_nats - null > constants().member_share * all;
  }
  void open_jumps(SelectedEffect* effect) const {
    effect->family = Family::kSlowNoise;
    open_member(effect);
    add_jumping_noise(effect);
    effect->statement = "jumps come again and again: a noise that jumps, not single events; what makes it is open";
  }
  // Jumps that hold a share of what all of them explain: a small one beside large ones is not their kind.
  size_t jumps_of_weight() const {
    const SlowModel& best = out_.slow.best;
    if (best.steps.size() <= kMostJumps) return best.steps.size();
    size_t n = 0;
    for (size_t i = 0; i < best.steps.size(); ++i) {
      SlowModel less = best;
      less.steps.erase(less.steps.begin() + static_cast<long>(i));
      less = out_.search->polished(less);
      n += best.free_score() - less.free_score() > constants().least_share * out_.slow.step_gain_nats ? 1 : 0;
    }
    return n;
  }
  void name_steps() {
    for (size_t j = 0; j < library_.size(); ++j) {
      const EffectEstimator* e = library_[j]->estimator();
      if (!e || e->form() != Form::kSteps) continue;
      Theta shape;
      for (const Theta& step : out_.slow.best.steps) shape.insert(shape.end(), step.begin(), step.end());
      SelectedEffect effect;
      effect.family = library_[j]->family();
      effect.term = term_of(library_[j], e, shape);
      effect.gain_nats = out_.slow.step_gain_nats;
      effect.evidence_nats =
          effect.gain_nats - constants().step_nats * static_cast<double>(out_.slow.best.steps.size());
      effect.held_out_nats = kNaN;
      effect.set = {
          {library_[j], nullptr, false, effect.family, effect.gain_nats, effect.gain_nats - effect.evidence_nats}};
      // Jumps that come again and again are a noise.
      if (jumps_of_weight() > kMostJumps || (named_.empty() && is_against())) open_jumps(&effect);
      named_.push_back(effect);
    }
  }
  void name_slow_noise() {
    const SlowModel& best = out_.slow.best;
    SelectedEffect effect;
    effect.family = best.noise_effect->family();
    effect.term = term_of(best.noise_effect, best.noise_effect->estimator(), best.noise_theta);
    effect.evidence_nats = out_.slow.evidence.back();
    effect.gain_nats = effect.evidence_nats + constants().noise_nats;
    effect.held_out_nats = kNaN;
    const double threshold = constants().noise_nats;
    effect.set = {{best.noise_effect, nullptr, false, effect.family, effect.gain_nats, threshold}};
    add_kinds_within(constants().noise_margin_nats, best, &effect);
    if (effect.set.size() > 1) open_member(&effect);
    add_same_spectrum(&effect);
    if (best.names.empty()) add_means_that_do_as_well(&effect);
    if (has_free_function()) {
      leave(effect);
    } else if (best.names.empty() && is_against()) {
      effect.doubt = Doubt::kAgainst, effect.held_out_nats = 0.5 * out_.gap.delta_deviance;
      selection().dropped.push_back(effect);
    } else if (!best.names.empty() || beside_.empty()) {
      named_.push_back(effect);
    }
  }

  static bool is_in_set(const SelectedEffect& effect, const Effect* member) {
    return std::any_of(effect.set.begin(), effect.set.end(), [&](const auto& e) { return e.effect == member; });
  }
  // Whether the kind of noise of a hypothesis takes anything: one that could be left out of it is no rival.
  bool is_needed(const SlowModel& m) const {
    if (!m.noise_effect) return false;
    SlowModel less = m;
    less.noise_effect = nullptr;
    const auto value = [&](const SlowModel& at) { return out_.search->grams_of(at).log_marginal_any_scale(); };
    return value(m) - value(less) > constants().rivals_nats;
  }
  // Kinds of slow noise that gain less than an answer by no more than this, best first.
  void add_kinds_within(double margin_nats, const SlowModel& answer, SelectedEffect* effect) const {
    std::vector<CandidateEvidence> kinds;
    const bool is_alone = answer.names.empty() && answer.steps.empty();
    for (const SlowCandidateScore& s : is_alone ? out_.slow.noises : out_.search->kinds_beside(answer)) {
      if (!s.model.noise_effect || is_in_set(*effect, s.model.noise_effect)) continue;
      const SlowModel m = is_needed(s.model) ? s.model : out_.search->in_place_of_base(s.model);
      const double gap = answer.free_score() - m.free_score();
      if (gap >= margin_nats || !is_needed(m)) continue;
      kinds.push_back(
          {s.model.noise_effect, nullptr, false, Family::kSlowNoise, effect->gain_nats - gap, constants().noise_nats});
    }
    add_to_set(std::move(kinds), effect);
  }
  // Causes in the mean, those that differ from run to run among them, that do as well as a kind of slow noise alone.
  void add_means_that_do_as_well(SelectedEffect* effect) const {
    const SlowModel& best = out_.slow.best;
    std::vector<CandidateEvidence> means;
    for (size_t j = 0; j < out_.slow.singles.size(); ++j) {
      const SlowCandidateScore& s = out_.slow.singles[j];
      const double gap = best.free_score() + best.noise_charge - s.gain_nats;
      if (!candidate(j).effect || s.model.names.empty() || gap >= constants().rivals_nats) continue;
      means.push_back(evidence_of(j, effect->gain_nats - gap, constants().mean_nats));
    }
    add_to_set(std::move(means), effect);
  }
  // Noise that jumps between levels does so again and again.
  void add_jumping_noise(SelectedEffect* effect) const { add_equal(jumping_kind(), effect); }
  // What no likelihood tells from the effect.
  static void add_equal(const Effect* kind, SelectedEffect* effect) {
    if (!kind) return;
    effect->set.push_back(
        {kind, nullptr, false, kind->family(), effect->gain_nats, effect->gain_nats - effect->evidence_nats});
  }

  // Slow noise explains it, but a repeatable cause that takes most of it would do so as well.
  void name_undecided() {
    // What is left of a shape that gains more is not slow noise.
    if (!selection().dropped.empty() || !selection().remainders.empty()) return;
    const SlowModel& best = slow_answer();
    if (!named_.empty() && !(named_.size() == 1 && named_[0].family == Family::kSlowNoise)) return;
    const NoiseModel noise = out_.search->seconds_noise_of(best);
    double longest = 0;
    for (const CampaignRun& run : campaign_.runs) longest = std::max(longest, run.input.t_s.back());
    double slowest = 0;
    for (const Markov& m : noise.markov) slowest = std::max(slowest, m.tau_s);
    if (slowest < constants().slow_tau_part * longest && !(noise.walk_dph_per_rt_s > 0)) return;
    const std::vector<CandidateEvidence> rivals = repeatable_rivals();
    if (rivals.empty()) return;
    SelectedEffect effect;
    if (!named_.empty()) effect = named_[0];
    effect.family = Family::kSlowNoise;
    effect.is_family = true;
    effect.doubt = Doubt::kSlowNoise;
    effect.held_out_nats = kNaN;
    CandidateEvidence own;
    own.is_family = true, own.family = Family::kSlowNoise;
    effect.set.insert(effect.set.begin(), own);
    std::vector<Family> seen;
    for (const CandidateEvidence& rival : rivals)
      if (std::find(seen.begin(), seen.end(), rival.family) == seen.end()) {
        seen.push_back(rival.family);
        CandidateEvidence family = rival;
        family.effect = nullptr, family.is_family = true;
        effect.set.push_back(family);
      }
    effect.set.insert(effect.set.end(), rivals.begin(), rivals.end());
    if (named_.empty()) {
      add_kinds_within(constants().noise_margin_nats, best, &effect);
      add_same_spectrum(&effect);
    }
    named_ = {effect};
  }
  // A kind of slow noise that is not worth its name is not what stands against a repeatable cause: the plain noise is.
  const SlowModel& slow_answer() const { return named_.empty() ? out_.slow.null : out_.slow.best; }
  // Repeatable causes that do as well as slow noise, beside the same kind of it, and take most of what it takes.
  std::vector<CandidateEvidence> repeatable_rivals() const {
    const SlowModel& best = slow_answer();
    std::vector<std::pair<double, size_t>> order;
    for (size_t j = 0; j < out_.slow.singles.size(); ++j)
      if (!out_.slow.singles[j].model.names.empty() && candidate(j).effect &&
          candidate(j).effect->estimator()->is_repeatable())
        order.push_back({out_.slow.singles[j].gain_nats, j});
    std::sort(order.rbegin(), order.rend());
    std::vector<CandidateEvidence> rivals;
    for (size_t i = 0; i < order.size() && i < kUndecidedTried; ++i) {
      SlowModel m = out_.slow.singles[order[i].second].model;
      m.noise_effect = best.noise_effect, m.noise_theta = best.noise_theta, m.noise_charge = best.noise_charge;
      m = out_.search->polished(m);
      if (is_undecided(best, m))
        rivals.push_back(evidence_of(order[i].second, m.free_score() - best.free_score(), constants().mean_nats));
    }
    std::sort(rivals.begin(), rivals.end(), [](const auto& a, const auto& b) { return a.gain_nats > b.gain_nats; });
    return rivals;
  }
  // Part of the spread of the data that a hypothesis leaves to the noise.  Lines in the mean are no part of that spread:
  // no hypothesis would have to take them.
  double part_left(const SlowModel& m) const {
    const double spread = lines_.empty() ? out_.data->spread_dph : spread_left(out_.slow.null, 60);
    return spread_left(m, 0) / std::max(spread, 1e-6);
  }
  // Root mean square of what a hypothesis leaves, in means over `mean_s` (or in the blocks, where they are longer).
  double spread_left(const SlowModel& m, double mean_s) const {
    const std::vector<MeanPart> parts = out_.search->parts_on(*out_.data, m);
    const RunGrams::Posterior at = out_.search->grams_of(m).posterior();
    const long blocks = std::max(1L, std::lround(mean_s / out_.data->campaign.dt_s));
    double sum = 0, n = 0;
    for (size_t r = 0; r < out_.data->y.size(); ++r) {
      const VectorXd rest = residual_of(*out_.data, parts, at, r);
      for (long k = 0; k + blocks <= rest.size(); k += blocks)
        sum += std::pow(rest.segment(k, blocks).mean(), 2), n += 1;
    }
    return n > 0 ? std::sqrt(sum / n) : out_.data->spread_dph;
  }

  // The hypotheses of the seconds, and the noise of the seconds under them.
  void seconds() {
    SlowModel nominal = out_.slow.null;
    nominal.is_believed = nominal.is_believed || belief_.has_believed;
    selection().nominal = hypothesis_of(nominal, false);
    selection().final = hypothesis_of(out_.slow.best, true);
    final_fit_ = fit_hypothesis(campaign_, selection().final);
    from_ = fit_seconds_noise(campaign_, selection().final.noise(), final_fit_.residual);
    believe_again();
    if (is_believed_ && gives_up_unnamed_noise()) return seconds();
    fit_own_base();
  }
  // The believed noise does beside a kind of noise that is not worth its name, and does not without it: other parameters
  // are the simpler answer.
  bool gives_up_unnamed_noise() {
    SlowModel& best = out_.slow.best;
    if (!best.names.empty() || !best.steps.empty() || !best.noise_effect) return false;
    if (out_.slow.evidence.back() > 0 || out_.slow.null.is_believed) return false;
    best = out_.slow.null;
    out_.slow.evidence.clear();
    out_.gap = measure_gap(*out_.search, *out_.data, held_blocks_.get(), out_.slow.null, best);
    look_beside();
    return true;
  }
  // Noise beside a kind of slow noise, of the seconds: block means do not show all of it.
  void fit_own_base() {
    const SlowModel& m = out_.slow.best;
    if (!m.noise_effect) return;
    own_base_ = out_.search->base_noise_of(m);
    own_base_.extra_white_dph2 = extra_white_dph2_;
    if (is_believed_) return;
    fit_own_base_beside(nullptr, {});
  }
  void fit_own_base_beside(const EffectEstimator* fast, const Theta& theta) {
    const SlowModel& m = out_.slow.best;
    const auto with = [&](const NoiseModel& base) {
      const NoiseModel slow = m.noise_effect->estimator()->noise(base, m.noise_theta);
      return fast ? fast->noise(slow, theta) : slow;
    };
    own_base_ = fit_seconds_noise(campaign_, own_base_, final_fit_.residual, with).base;
  }
  // Whether the believed noise parameters hold is a question to the seconds, under the causes found.
  void believe_again() {
    is_believed_ = false;
    if (!belief_.has_believed) return;
    SlowModel m = out_.slow.best;
    m.is_believed = true;
    const NoiseModel believed = out_.search->seconds_noise_of(m);
    retuned_nats_ = from_.log_likelihood - ResidualLikelihood(campaign_, final_fit_.residual)(believed);
    if (retuned_nats_ > constants().retuned_nats) return;
    is_believed_ = true;
    from_.base = believed, from_.log_likelihood -= retuned_nats_;
    out_.slow.best.is_believed = true; // its noise is the believed one from here on
    selection().final = hypothesis_of(out_.slow.best, true);
  }
  std::vector<VectorXd> whitened() const {
    std::vector<VectorXd> e = final_fit_.residual;
    for (size_t r = 0; r < e.size(); ++r)
      whiten(compute_gains(campaign_.runs[r], gaussian_equivalent(from_.base)), e[r].data(),
             static_cast<size_t>(e[r].size()));
    return e;
  }
  Hypothesis hypothesis_of(const SlowModel& m, bool with_names) const {
    Hypothesis h;
    h.base_noise = out_.search->base_noise_of(m);
    h.base_noise.extra_white_dph2 = extra_white_dph2_;
    for (const NoiseBelief::Known& known : belief_.known)
      if (known.estimator->form() != Form::kTone) h.known.push_back(term_of(nullptr, known.estimator, known.shape));
    if (!with_names) return h;
    for (const NamedLine& line : lines_) h.terms.push_back(term_of(line.effect, line.effect->estimator(), line.shape));
    for (const SlowModel::Name& name : m.names) {
      const Candidate& c = candidate(name.candidate);
      h.terms.push_back(term_of(c.effect, c.scan.estimator, name.shape));
    }
    if (!m.steps.empty()) {
      Theta shape;
      for (const Theta& step : m.steps) shape.insert(shape.end(), step.begin(), step.end());
      for (const Effect* effect : library_)
        if (effect->estimator() && effect->estimator()->form() == Form::kSteps)
          h.terms.push_back(term_of(effect, effect->estimator(), shape));
    }
    if (m.noise_effect) h.terms.push_back(term_of(m.noise_effect, m.noise_effect->estimator(), m.noise_theta));
    return h;
  }

  // What the seconds say beside the slow causes.
  void fast_stage() {
    if (is_censored_) return; // the spread of what is left is not that of the noise
    fast_ =
        scan_fast_noise(campaign_, from_, final_fit_.residual, library_, active_, constants(), may_ask_slow_noise());
    leave_hits_that_stay();
    ask_jumping_noise();
  }

  void leave_hits_that_stay() {
    std::vector<FastFinding>& list = fast_.findings;
    const auto stays = [&](const FastFinding& f) {
      const NoiseModel noise = f.effect->estimator()->noise(f.base, f.theta);
      return noise.hit_probability > 0 && do_hits_stay(campaign_, final_fit_.residual, noise, constants());
    };
    list.erase(std::remove_if(list.begin(), list.end(), stays), list.end());
  }

  // Noise that jumps, beside what a hypothesis of the slow stage puts into the mean.
  struct Jumping {
    SlowModel mean;
    FastFinding noise;
    Fit fit;
    bool is_believed = false; // the noise beside it
    double log_likelihood = -1e300, retuned_nats = 0;
    double score = -1e300; // less what its names and its noise cost
  };
  // What the slow stage says.
  struct Answer {
    std::unique_ptr<SlowData> data;
    std::unique_ptr<SlowSearch> search;
    SlowResult slow;
    GapResult gap;
    std::unique_ptr<Campaign> held_blocks;
    std::vector<Beside> beside;
    std::vector<SelectedEffect> dropped;
    bool is_told_by_held_out = false;
  };
  void swap_answer(Answer* other) {
    std::swap(out_.data, other->data), std::swap(out_.search, other->search), std::swap(out_.slow, other->slow);
    std::swap(out_.gap, other->gap), std::swap(held_blocks_, other->held_blocks), std::swap(beside_, other->beside);
    std::swap(selection().dropped, other->dropped);
    std::swap(selection().is_told_by_held_out, other->is_told_by_held_out);
  }
  // Block means know no noise that jumps: other noise parameters, other kinds of noise, jumps in time and causes in the mean
  // stand in for it there.  Where the seconds change suddenly it is asked for without them, beside the noise as believed;
  // the levels that the logs show are taken out, and everything is asked again.
  void ask_jumping_noise() {
    const FastFinding* found = jumping_finding();
    if (!jumping_kind() || !(fast_.changes_suddenly || (found && found->gain_nats > constants().fast_nats))) return;
    if (!found && !belief_.has_believed) return;
    has_teeth_ = found && is_one_sided(campaign_, final_fit_.residual, with_jumps(*found));
    if (has_teeth_) return;
    const double gaussian = from_.log_likelihood - charges(out_.slow.best, is_believed_);
    const double fast = fast_.findings.empty() ? 0 : fast_.findings.front().gain_nats - constants().fast_nats;
    Jumping alone = beside_mean(out_.slow.null, jumping_start(out_.slow.null));
    Jumping first = first_jumping(alone);
    Answer other;
    const Jumping with = ask_in_turn(first, &alone, &other);
    has_teeth_ = is_one_sided(campaign_, with.fit.residual, with_jumps(with.noise));
    if (!has_teeth_ && with.score > gaussian + std::max(0.0, fast) + foretold_by_lost(other))
      take_jumping(with, gaussian, other);
    else
      swap_answer(&other);
  }
  // Levels follow a jump at a temperature as well as one by chance, but foretell nothing: what the names that would go
  // foretell of logs that were not fitted, as right names do, stands against them.
  double foretold_by_lost(const Answer& before) const {
    if (before.gap.method == HeldOut::kQuarters) return 0; // parts of one passage foretell nothing of another
    const std::vector<SlowModel::Name>& now = out_.slow.best.names;
    double sum = 0;
    for (size_t i = 0; i < before.slow.best.names.size() && i < before.gap.at_all.size(); ++i) {
      const size_t j = before.slow.best.names[i].candidate;
      const GapResult::Support& all = before.gap.at_all[i];
      const bool is_kept = std::any_of(now.begin(), now.end(), [&](const auto& name) { return name.candidate == j; });
      if (!is_kept && all.nats > constants().foretold_part * all.expected) sum += std::max(0.0, all.nats);
    }
    return sum;
  }
  // Levels, and what is found without them, until nothing else is found.  Jumps in time are levels that are wrong, unless
  // the seconds are less likely without them.
  // `before`: where the answer goes that stood.
  Jumping ask_in_turn(Jumping first, Jumping* alone, Answer* before) {
    Jumping with;
    for (int round = 0; round < kJumpingRounds; ++round) {
      Campaign quiet = campaign_, quiet_held;
      take_levels(first.noise, first.fit.residual, &quiet);
      if (held_out_) {
        quiet_held = *held_out_;
        take_levels(first.noise, fit_hypothesis(quiet_held, hypothesis_beside(first)).residual, &quiet_held);
      }
      if (round == 0) swap_answer(before);
      slow_stage(&quiet, held_out_ ? &quiet_held : nullptr);
      with = last_jumping(first, *alone);
      SlowModel causes = out_.slow.best;
      if (is_bare(causes)) return with;
      if (causes.steps.empty() && SlowSearch::have_same_names(causes, first.mean)) return with;
      if (causes.steps.empty() && !causes.noise_effect) {
        first = with;
        continue;
      }
      causes.steps.clear(), causes.noise_effect = nullptr;
      first = beside_mean(causes, with.noise, less_steps(with));
      if (!causes.names.empty()) continue;
      if (first.score > alone->score) *alone = first;
      if (first.score < with.score) continue;
      forget_causes();
      return first;
    }
    return with;
  }
  // What the mean would leave if it had no jumps in time.
  std::vector<VectorXd> less_steps(const Jumping& jumping) const {
    std::vector<VectorXd> residual = jumping.fit.residual;
    const Hypothesis h = hypothesis_beside(jumping);
    const Design design = make_design(campaign_, h);
    for (size_t c = 0; c < design.cols(); ++c) {
      const int term = design.term_of_column[c];
      if (term < 0 || h.terms[static_cast<size_t>(term)].form() != Form::kSteps) continue;
      const auto column = static_cast<long>(c);
      for (size_t r = 0; r < residual.size(); ++r) residual[r] += jumping.fit.beta[column] * design.x[r].col(column);
    }
    return residual;
  }
  // The first effect of the library that is asked for and is of a kind, if any.
  template <class F> const Effect* first_kind(F is_it) const {
    for (size_t j = 0; j < library_.size(); ++j)
      if (const EffectEstimator* e = library_[j]->estimator(); e && active_[j] && is_it(*e)) return library_[j];
    return nullptr;
  }
  const Effect* jumping_kind() const {
    return first_kind([](const EffectEstimator& e) { return e.is_jumping(); });
  }
  const FastFinding* jumping_finding() const {
    for (const FastFinding& f : fast_.findings)
      if (f.effect->estimator()->is_jumping()) return &f;
    return nullptr;
  }
  static bool is_bare(const SlowModel& m) { return m.names.empty() && m.steps.empty() && !m.noise_effect; }
  static NoiseModel with_jumps(const FastFinding& f) { return f.effect->estimator()->noise(f.base, f.theta); }
  // What the names of a hypothesis and other noise than the believed one cost.
  double charges(const SlowModel& m, bool is_believed) const {
    const bool is_retuned = belief_.has_believed && !is_believed;
    return m.value - out_.search->score(m) + (is_retuned ? constants().retuned_nats : 0);
  }
  Hypothesis hypothesis_beside(const Jumping& jumping) const {
    SlowModel mean = jumping.mean;
    mean.noise_effect = nullptr;
    Hypothesis h = hypothesis_of(mean, true);
    h.base_noise = jumping.noise.base;
    h.terms.push_back(term_of(jumping.noise.effect, jumping.noise.effect->estimator(), jumping.noise.theta));
    return h;
  }
  NoiseModel believed_beside(SlowModel m) const {
    m.is_believed = true;
    return out_.search->seconds_noise_of(m);
  }
  // The mean and the noise in turn, from what they are; returns the log-likelihood.
  double improve(bool is_base_free, Jumping* jumping) const {
    const std::vector<VectorXd> near = jumping->fit.residual;
    jumping->fit = fit_hypothesis(campaign_, hypothesis_beside(*jumping), near.empty() ? nullptr : &near);
    return fit_again(ResidualLikelihood(campaign_, jumping->fit.residual), is_base_free, &jumping->noise);
  }
  // Beside this mean, from this start: beside the believed noise, and beside other parameters where these gain more than
  // they cost.  They also stand in for levels that are wrong: where they gain, the believed ones are tried with theirs.
  // `near`: a residual that may be like that of this mean.
  Jumping beside_mean(const SlowModel& mean, const FastFinding& start, const std::vector<VectorXd>& near = {}) const {
    const bool has_believed = belief_.has_believed;
    Jumping out;
    out.mean = mean, out.noise = start, out.fit.residual = near;
    if (has_believed) out.noise.base = believed_beside(mean);
    for (int pass = 0; pass < kJumpingPasses; ++pass) out.log_likelihood = improve(!has_believed, &out);
    for (int pass = 0; has_believed && !out.is_believed && pass < kJumpingPasses; ++pass) {
      Jumping free = out;
      const double value = improve(true, &free);
      out.fit = free.fit, out.noise.theta = free.noise.theta;
      out.log_likelihood = improve(false, &out);
      out.retuned_nats = value - out.log_likelihood;
      out.is_believed = out.retuned_nats <= constants().retuned_nats;
      if (out.is_believed || pass + 1 < kJumpingPasses) continue;
      out.noise = free.noise, out.fit = free.fit, out.log_likelihood = value;
    }
    set_errors(ResidualLikelihood(campaign_, out.fit.residual), &out.noise);
    out.score = out.log_likelihood - charges(mean, out.is_believed) - constants().fast_nats;
    return out;
  }
  // Like the finding, or like the process that the noise without it has taken it for, beside the believed noise.
  FastFinding jumping_start(const SlowModel& mean) const {
    FastFinding best;
    best.effect = jumping_kind();
    const EffectEstimator& e = *best.effect->estimator();
    const FastFinding* found = jumping_finding();
    if (!belief_.has_believed) return *found;
    SlowModel causes = mean;
    causes.noise_effect = nullptr;
    Hypothesis h = hypothesis_of(causes, true);
    h.base_noise = hypothesis_of(out_.slow.null, false).base_noise;
    const Fit fit = fit_hypothesis(campaign_, h);
    const ResidualLikelihood log_likelihood(campaign_, fit.residual);
    best.base = believed_beside(mean);
    std::vector<Theta> starts = e.starts(best.base);
    if (found) starts.push_back(found->theta);
    if (!h.base_noise.markov.empty()) starts.push_back(e.like(slowest(h.base_noise)));
    double highest = -1e300;
    for (const Theta& theta : starts)
      if (const double v = log_likelihood(e.noise(best.base, theta)); best.theta.empty() || v > highest)
        highest = v, best.theta = theta;
    return best;
  }
  // Beside the causes that the slow stage named, or without them.
  Jumping first_jumping(const Jumping& alone) const {
    if (out_.slow.best.names.empty()) return alone;
    SlowModel causes = out_.slow.best;
    causes.steps.clear(), causes.noise_effect = nullptr;
    const Jumping beside = beside_mean(causes, jumping_start(causes));
    return beside.score > alone.score ? beside : alone;
  }
  // What these logs show of the levels goes.
  static void take_levels(const FastFinding& jumping, const std::vector<VectorXd>& residual, Campaign* logs) {
    const NoiseModel noise = with_jumps(jumping);
    for (size_t r = 0; r < logs->runs.size(); ++r) {
      CampaignRun& run = logs->runs[r];
      const VectorXd level = telegraph_level(run, noise, residual[r]).mean_dph;
      for (long k = 0; k < level.size(); ++k)
        run.input.rate_dph[static_cast<size_t>(run.used[static_cast<size_t>(k)])] -= level[k];
    }
  }
  // Beside what is found without the levels, as far as the seconds are more likely with it.
  Jumping last_jumping(const Jumping& first, const Jumping& alone) {
    const SlowModel& best = out_.slow.best;
    if (is_bare(best)) return alone;
    const Jumping with = beside_mean(best, first.noise);
    if (alone.score < with.score) return with;
    forget_causes();
    return alone;
  }
  void forget_causes() {
    out_.slow.best = out_.slow.null;
    out_.slow.evidence.clear(), out_.slow.rivals.clear(), out_.slow.replaced.clear();
    beside_.clear(), selection().dropped.clear(), selection().is_told_by_held_out = false;
  }
  // `gaussian`: score of the best answer without noise that jumps; `before`: that answer.
  void take_jumping(const Jumping& jumping, double gaussian, const Answer& before) {
    FastFinding found = jumping.noise;
    found.gain_nats = jumping_nats_ = jumping.score + constants().fast_nats - gaussian;
    std::vector<FastFinding>& list = fast_.findings;
    list.erase(std::remove_if(list.begin(), list.end(), [&](const auto& f) { return f.effect == found.effect; }),
               list.end());
    list.insert(list.begin(), found);
    final_fit_ = jumping.fit;
    from_.base = found.base, from_.log_likelihood = jumping.log_likelihood;
    is_believed_ = jumping.is_believed, retuned_nats_ = jumping.retuned_nats;
    SlowModel& best = out_.slow.best;
    if (belief_.has_believed) best.is_believed = is_believed_;
    if (is_believed_ && is_bare(best)) out_.slow.null.is_believed = true; // no slow noise beside the jumps
    selection().final = hypothesis_of(best, true);
    fit_own_base();
    // Of the logs as they are.
    SlowModel nominal = before.slow.null, causes = best;
    causes.noise_effect = nullptr;
    causes.take_noise_of(nominal);
    nominal.is_without_lines = !lines_.empty();
    out_.gap = measure_gap(*before.search, *before.data, before.held_blocks.get(), nominal, causes);
  }

  void name_fast() {
    for (const NamedLine& line : lines_) name_line(line);
    const std::vector<FastFinding>& found = fast_.findings;
    if (found.empty() || found.front().gain_nats < constants().fast_nats) return;
    const FastFinding& best = found.front();
    SelectedEffect effect;
    effect.family = best.effect->family();
    effect.term = term_of(best.effect, best.effect->estimator(), best.theta);
    effect.term.shape_errors = best.theta_errors;
    effect.gain_nats = best.gain_nats;
    effect.evidence_nats = best.gain_nats - constants().fast_nats;
    effect.held_out_nats = kNaN;
    const bool is_slow = effect.family == Family::kSlowNoise;
    for (const FastFinding& f : found)
      if (f.gain_nats > best.gain_nats - (is_slow ? constants().noise_margin_nats : constants().rivals_nats))
        effect.set.push_back({f.effect, nullptr, false, f.effect->family(), f.gain_nats, constants().fast_nats});
    if (is_slow && effect.set.size() > 1) open_member(&effect);
    if (is_slow && !effect.term.estimator->is_jumping()) add_same_spectrum(&effect);
    if (has_teeth_ && best.effect->estimator()->is_jumping()) {
      open_member(&effect);
      effect.statement = "the family of the cause, not its member: it jumps one way more than the other, as teeth do";
    } else if (jumps_seldom(best)) {
      open_seldom_jumps(&effect);
    }
    // What the fast noise explains better than a kind of slow noise takes its place.
    insert_by_evidence(effect);
    from_.base = best.base;
    if (out_.slow.best.noise_effect) fit_own_base_beside(best.effect->estimator(), best.theta);
    selection().final.terms.push_back(effect.term);
  }
  // Whether a process that jumps is expected to do so no more often than what is said to be single events.
  bool jumps_seldom(const FastFinding& found) const {
    if (!found.effect->estimator()->is_jumping()) return false;
    const NoiseModel noise = found.effect->estimator()->noise(found.base, found.theta);
    const double seconds = static_cast<double>(campaign_.n()) * campaign_.dt_s;
    return seconds / (2 * noise.telegraph_tau_s) <= static_cast<double>(kMostJumps);
  }
  // Two levels are not told from single jumps by so few of them.
  void open_seldom_jumps(SelectedEffect* effect) {
    open_member(effect);
    effect->statement = "the family of the cause, not its member: so few jumps are single events or a noise that jumps";
    const auto is_steps = [](const SelectedEffect& e) { return e.term.effect && e.term.form() == Form::kSteps; };
    named_.erase(std::remove_if(named_.begin(), named_.end(), is_steps), named_.end());
    add_equal(first_kind([](const EffectEstimator& e) { return e.form() == Form::kSteps; }), effect);
  }
  // Block means were content with other parameters of the noise: where the spectrum of the seconds is not, they are asked.
  bool may_ask_slow_noise() const {
    const SlowModel& best = out_.slow.best;
    return best.names.empty() && !best.noise_effect && best.steps.empty() && !is_believed_;
  }
  // The strongest first; but what these logs leave open stands before what is beside it.
  void insert_by_evidence(const SelectedEffect& effect) {
    const bool is_first =
        named_.empty() || (named_[0].doubt != Doubt::kSlowNoise && named_[0].evidence_nats < effect.evidence_nats);
    named_.insert(is_first ? named_.begin() : named_.end(), effect);
  }
  void name_line(const NamedLine& line) {
    SelectedEffect found;
    found.family = line.effect->family();
    found.term = term_of(line.effect, line.effect->estimator(), line.shape);
    found.gain_nats = line.gain_nats;
    found.evidence_nats = line.gain_nats - line.threshold_nats;
    found.held_out_nats = kNaN;
    found.set = {{line.effect, nullptr, false, found.family, found.gain_nats, line.threshold_nats}};
    insert_by_evidence(found);
  }

  // Re-tuned noise is a finding of its own: it comes last and takes nobody's place.
  void name_retuned() {
    const bool is_retuned = belief_.has_believed && !is_believed_;
    selection().is_noise_retuned = is_retuned;
    if (!is_retuned) return;
    for (size_t j = 0; j < library_.size(); ++j) {
      const EffectEstimator* e = library_[j]->estimator();
      if (!e || !active_[j] || !e->is_nominal_noise()) continue;
      SelectedEffect effect;
      effect.family = library_[j]->family();
      const NoiseModel& noise = from_.base;
      effect.term = term_of(library_[j], e,
                            {noise.white_sigma_dph, noise.markov.empty() ? 0 : noise.markov[0].sigma_dph,
                             noise.markov.empty() ? 1 : noise.markov[0].tau_s});
      effect.gain_nats = retuned_nats_;
      effect.evidence_nats = retuned_nats_ - constants().retuned_nats;
      effect.held_out_nats = kNaN;
      effect.set = {{library_[j], nullptr, false, effect.family, effect.gain_nats, constants().retuned_nats}};
      add_kinds_of_noise(&effect);
      retuned_.push_back(effect);
    }
  }

  // Another kind of noise beside the believed one, or beside other parameters, that does as well as these.
  void add_kinds_of_noise(SelectedEffect* retuned) const {
    const SlowModel& null = out_.slow.null;
    const SlowModel& best = out_.slow.best;
    if (!best.names.empty() || (best.noise_effect && out_.slow.evidence.back() > 0)) return;
    std::vector<CandidateEvidence> kinds;
    for (const SlowCandidateScore& s : out_.slow.noises) {
      if (!s.model.noise_effect) continue;
      const SlowModel m = out_.search->beside_believed(s.model);
      const double gap = null.free_score() - m.free_score() - constants().noise_kind_nats;
      const double gap_beside_others = is_needed(s.model) ? best.free_score() - s.gain_nats : 1e300;
      if (gap < constants().noise_margin_nats || gap_beside_others < constants().rivals_nats)
        kinds.push_back({m.noise_effect, nullptr, false, retuned->family,
                         retuned->gain_nats - std::min(gap, gap_beside_others), constants().noise_nats});
    }
    add_to_set(std::move(kinds), retuned);
    add_same_spectrum(retuned);
  }
  // Telegraph noise has the spectrum of a Markov process: where this one stands in a set of slow noises and the seconds
  // did not tell the two by their distribution, neither is excluded.
  void add_same_spectrum(SelectedEffect* effect) const {
    const auto has_markov_spectrum = [](const CandidateEvidence& e) {
      return e.effect && e.effect->estimator() && e.effect->estimator()->has_markov_spectrum();
    };
    const auto own = std::find_if(effect->set.begin(), effect->set.end(), has_markov_spectrum);
    if (own == effect->set.end()) return;
    const CandidateEvidence as_well = *own;
    for (size_t j = 0; j < library_.size(); ++j) {
      CandidateEvidence other = as_well;
      other.effect = library_[j];
      if (active_[j] && !is_in_set(*effect, library_[j]) && has_markov_spectrum(other)) effect->set.push_back(other);
    }
  }

  void finish() {
    Selection& s = selection();
    s.final.base_noise = from_.base;
    s.final.base_noise.extra_white_dph2 = extra_white_dph2_;
    // Noise terms act on the base; the base was fitted with them in it.
    if (out_.slow.best.noise_effect) s.final.base_noise = own_base_;
    s.fitted_noise = from_.base;
    s.threshold_nats = constants().mean_nats;
    fit_and_test();
    fill_coefficients(s.final_fit);
    open_by_rest();
    s.total_gain_nats = out_.slow.best.free_score() - out_.slow.null.free_score();
    for (size_t j = 0; j < out_.slow.singles.size(); ++j)
      if (candidate(j).effect)
        s.first_scan.push_back(evidence_of(
            j, std::max(0.0, out_.slow.singles[j].gain_nats - out_.slow.null.free_score()), s.threshold_nats));
    for (const SlowCandidateScore& n : out_.slow.noises)
      if (n.model.noise_effect)
        s.first_scan.push_back({n.model.noise_effect, nullptr, false, n.model.noise_effect->family(),
                                std::max(0.0, n.gain_nats + constants().noise_kind_nats - out_.slow.null.free_score()),
                                constants().noise_nats});
    s.effects = structural_;
    s.effects.insert(s.effects.end(), named_.begin(), named_.end());
    // Beside something unexplained the noise parameters are those of a stand-in.
    if (!leaves_something()) s.effects.insert(s.effects.end(), retuned_.begin(), retuned_.end());
    judge();
  }
  void fit_and_test() {
    Selection& s = selection();
    s.nominal_fit = fit_hypothesis(campaign_, s.nominal);
    s.before = s.after = test_rest(campaign_, s.nominal_fit.e, constants());
    if (is_same_fit(s.nominal, s.final)) {
      s.final_fit = s.nominal_fit;
      return;
    }
    s.final_fit = fit_hypothesis(campaign_, s.final, &final_fit_.residual);
    s.after = test_rest(campaign_, s.final_fit.e, constants());
  }
  bool leaves_something() {
    bool leaves = !selection().remainders.empty() || !selection().dropped.empty();
    for (const RestFinding& f : selection().after) leaves = leaves || (!is_censored_ && f.evidence_nats > 0);
    return leaves;
  }
  // A kind of noise, or jumps, are names while what remains is noise by the tests.
  void open_by_rest() {
    bool fires = false, has_jumps = false;
    double left = 0;
    for (const RestFinding& f : selection().after) {
      fires = fires || (f.evidence_nats > 0 && f.test != Rest::kLine);
      if (f.test != Rest::kLine) left = std::max(left, f.evidence_nats);
      has_jumps = has_jumps || (f.evidence_nats > 0 && f.test == Rest::kSuddenChanges);
    }
    leave_noise_beside_shapes();
    if (is_censored_ || !fires) return;
    for (SelectedEffect& effect : named_) {
      if (!effect.term.effect || effect.is_family) continue;
      const Form form = effect.term.form();
      if (form == Form::kNoise) open_noise(&effect);
      if (form == Form::kSteps && has_jumps) open_jumps(&effect);
    }
    if (left > explained_nats() || n_members() > kFewNames) leave_members();
  }
  // The tests contradict the kind that is most likely: likelihoods do not exclude the others, which gain at all.
  void open_noise(SelectedEffect* effect) const {
    open_member(effect);
    if (effect->family == Family::kSlowNoise && out_.slow.best.names.empty()) {
      add_kinds_within(out_.slow.best.free_score() - out_.slow.null.free_score() + constants().noise_kind_nats,
                       out_.slow.best, effect);
      add_same_spectrum(effect);
    }
    if (effect->statement.empty() && effect->set.size() == 1)
      effect->statement =
          "the family of the cause, not its member: the only one that explains it leaves what is no noise";
  }
  // A line is what it is: it stands in for nothing, unless lines remain.
  bool is_member(const SelectedEffect& effect) const {
    return !effect.is_family && (effect.family != Family::kTone || lines_.size() == kMostLines);
  }
  size_t n_members() const {
    return static_cast<size_t>(
        std::count_if(named_.begin(), named_.end(), [&](const auto& e) { return is_member(e); }));
  }
  // More is left than was explained, or many causes together leave something: members stand in for another cause then.
  // A family says no more than that.
  void leave_members() {
    leave_those([&](const SelectedEffect& effect) { return is_member(effect); }, &named_);
  }
  double explained_nats() const {
    double sum = out_.slow.best.free_score() - out_.slow.null.free_score() + jumping_nats_;
    for (const SelectedEffect& effect : named_)
      if (effect.family == Family::kFastNoise || effect.family == Family::kTone) sum += effect.gain_nats;
    return sum;
  }
  // A kind of slow noise beside a cause whose shape is open is what that shape leaves, and so are one of fast noise and
  // other noise parameters that hold little beside it.
  void leave_noise_beside_shapes() {
    const auto is_open = [](const SelectedEffect& effect) { return effect.doubt == Doubt::kShapeOpen; };
    const bool leaves_shape = has_free_function() || std::any_of(named_.begin(), named_.end(), is_open);
    if (!leaves_shape) return;
    const double least = constants().beside_free_part * explained_nats();
    const auto is_noise = [&](const SelectedEffect& effect) {
      if (!effect.term.effect || effect.term.form() != Form::kNoise) return false;
      return effect.family == Family::kSlowNoise || effect.gain_nats < least;
    };
    leave_those(is_noise, &named_);
    leave_those([&](const SelectedEffect& effect) { return effect.gain_nats < least; }, &retuned_);
  }

  void fill_coefficients(const Fit& fit) {
    Hypothesis& h = selection().final;
    const Design design = make_design(campaign_, h);
    for (size_t t = 0; t < h.terms.size(); ++t) {
      Term& term = h.terms[t];
      term.coefficients.clear(), term.coefficient_errors.clear();
      for (size_t c = 0; c < design.cols(); ++c)
        if (design.term_of_column[c] == static_cast<int>(t)) {
          term.coefficients.push_back(fit.beta[static_cast<long>(c)]);
          term.coefficient_errors.push_back(fit.beta_errors[static_cast<long>(c)]);
        }
      for (SelectedEffect& effect : named_)
        if (effect.term.estimator == term.estimator &&
            (term.form() != Form::kTone || effect.term.shape == term.shape)) {
          effect.term.coefficients = term.coefficients;
          effect.term.coefficient_errors = term.coefficient_errors;
          if (term.form() == Form::kTone)
            effect.term.shape_errors = line_errors(t, design, fit);
          else if (effect.term.shape_errors.empty())
            effect.term.shape_errors = shape_errors(effect);
        }
    }
  }
  // A line was placed while the noise still held a part of it; the noise of the answer does not.
  Theta line_errors(size_t term, const Design& design, const Fit& fit) const {
    std::vector<VectorXd> e = fit.residual;
    for (size_t r = 0; r < e.size(); ++r) {
      for (size_t c = 0; c < design.cols(); ++c)
        if (design.term_of_column[c] == static_cast<int>(term))
          e[r] += fit.beta[static_cast<long>(c)] * design.x[r].col(static_cast<long>(c));
      whiten(compute_gains(campaign_.runs[r], gaussian_equivalent(from_.base)), e[r].data(),
             static_cast<size_t>(e[r].size()));
    }
    const Term& line = selection().final.terms[term];
    return errors_of_place(campaign_, e, *line.estimator, line.shape);
  }
  // Curvature of the marginal likelihood over the shape of one name, the rest as found.
  Theta shape_errors(const SelectedEffect& effect) const {
    const SlowModel& best = out_.slow.best;
    for (size_t i = 0; i < best.names.size(); ++i) {
      const EffectEstimator& e = *candidate(best.names[i].candidate).scan.estimator;
      if (&e != effect.term.estimator || e.shape_lo().size() != best.names[i].shape.size() || e.shape_lo().empty())
        continue;
      SlowModel m = best;
      return curvature_errors(
          [&](const Theta& shape) {
            m.names[i].shape = shape;
            return out_.search->grams_of(m).log_marginal(1);
          },
          best.names[i].shape, e.shape_lo(), e.shape_hi());
    }
    return {};
  }

  void judge() {
    Selection& s = selection();
    bool fires = false, has_open = false, has_member = false, is_undecided = false;
    if (!is_censored_)
      for (const RestFinding& f : s.after) fires = fires || f.evidence_nats > 0;
    for (const SelectedEffect& e : s.effects) {
      has_open = has_open || e.doubt == Doubt::kShapeOpen;
      is_undecided = is_undecided || e.doubt == Doubt::kSlowNoise;
      has_member = has_member || (e.doubt != Doubt::kShapeOpen && e.doubt != Doubt::kSlowNoise);
    }
    const bool has_mean = out_.gap.has_mean || !out_.slow.best.steps.empty();
    const bool grows = has_mean && out_.gap.rms_after_dph > (1 + constants().growth_part) * out_.gap.rms_before_dph;
    fires = fires || !s.dropped.empty();
    if (s.effects.empty() && !s.remainders.empty())
      s.verdict = Verdict::kUnexplained;
    else if (s.effects.empty())
      s.verdict = fires ? Verdict::kUnexplained : Verdict::kNoGap;
    else if (!has_member && has_open)
      s.verdict = Verdict::kUnexplained;
    else if (fires || has_open || is_undecided || grows || !s.remainders.empty())
      s.verdict = Verdict::kPartlyExplained;
    else
      s.verdict = Verdict::kExplained;
  }

  Campaign& campaign_;
  const Campaign* held_out_;
  std::unique_ptr<Campaign> held_blocks_;
  NoiseBelief belief_;
  const std::vector<const Effect*>& library_;
  const std::vector<bool>& active_;
  SelectOptions options_;
  AxisStudy out_;
  std::vector<SelectedEffect> structural_, named_, retuned_;
  double extra_white_dph2_ = 0, retuned_nats_ = 0;
  bool is_censored_ = false, is_believed_ = false;
  Fit final_fit_;
  SecondsNoise from_;
  NoiseModel own_base_; // under a kind of slow noise
  std::vector<Beside> beside_;
  std::optional<double> answer_predicts_; // log density of what was not fitted
  std::vector<NamedLine> lines_;          // in the mean already
  FastScan fast_;
  bool has_teeth_ = false;  // sudden changes go one way
  double jumping_nats_ = 0; // gained by noise that jumps and that was taken out before the slow causes were asked for
};

} // namespace

AxisStudy study_axis(Campaign* campaign, const Campaign* held_out, const NoiseBelief& belief,
                     const std::vector<const Effect*>& library, const std::vector<bool>& active,
                     const SelectOptions& options) {
  return Study(campaign, held_out, belief, library, active, options).run();
}

} // namespace imucal
