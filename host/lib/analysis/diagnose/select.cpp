// SPDX-License-Identifier: MIT
#include "analysis/diagnose/select.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "analysis/diagnose/mean_lines.h"
#include "analysis/diagnose/slow_stage.h"
#include "analysis/diagnose/structure.h"

namespace imucal {

using Eigen::VectorXd;

namespace {

constexpr size_t kUndecidedTried = 4;
constexpr size_t kFewNames = 2; // what the library is made for; more names have to be worth more
constexpr size_t kMostLines = 3;
constexpr int kJumpingRounds = 3; // of levels and of what is found without them
constexpr int kJumpingPasses = 2; // of the mean and of the noise beside noise that jumps, in turn
constexpr size_t kMostJumps = 2;  // more are a noise that jumps, not events

class Study {
public:
  Study(Campaign* campaign, const Campaign* held_out, NoiseBelief belief, const std::vector<const Effect*>& library,
        const std::vector<bool>& active, const SelectOptions& options)
      : campaign_(*campaign), question_{*campaign, held_out, library, active, std::move(belief), options.constants},
        calibrate_(options.calibrate) {}

  AxisStudy run() {
    structural();
    if (campaign_.n() < 60) {
      selection().cannot_judge = true;
      selection().effects = structural_;
      selection().verdict = Verdict::kPartlyExplained;
      return std::move(out_);
    }
    do {
      slow_stage();
      seconds();
    } while (takes_line());
    if (!question_.lines.empty()) measure_with_lines();
    fast_stage();
    name_slow();
    name_undecided();
    name_fast();
    name_retuned();
    finish();
    out_.data = std::move(slow_.data), out_.search = std::move(slow_.search);
    out_.slow = std::move(slow_.found), out_.gap = std::move(slow_.gap);
    selection().dropped = std::move(slow_.dropped);
    selection().is_told_by_held_out = slow_.is_told_by_held_out;
    return std::move(out_);
  }

private:
  void slow_stage() {
    prepare_slow(question_, &campaign_, question_.held_out, &slow_);
    if (calibrate_ && question_.lines.empty()) {
      question_.constants.mean_nats = calibrate_(slow_.search.get());
      slow_.search->set_mean_threshold(question_.constants.mean_nats);
    }
    run_slow(question_, &slow_);
  }
  // A line in the spectrum of what is left was in everybody's way: kinds of noise took its place, and the noise of all
  // hypotheses held it.  It joins the mean, in every run with its own amplitude and phase, and all is asked again.
  bool takes_line() {
    if (question_.lines.size() == kMostLines) return false;
    const std::optional<NamedLine> line = line_found(question_, whitened());
    if (!line) return false;
    question_.lines.push_back(*line);
    question_.belief.known.push_back({line->effect->estimator(), line->shape});
    return true;
  }
  // The lines are part of what was there before.
  void measure_with_lines() {
    SlowModel nominal = slow_.found.null;
    nominal.is_without_lines = true;
    slow_.gap = measure_gap(*slow_.search, *slow_.data, slow_.held_blocks.get(), nominal, slow_.found.best);
  }
  Selection& selection() { return out_.selection; }
  const Selection& selection() const { return out_.selection; }
  const SelectorConstants& constants() const { return question_.constants; }

  void structural() {
    const StructureResult found = find_structure(&campaign_, question_.library, question_.active);
    selection().n_dropouts = found.n_dropouts, selection().n_left_out = found.n_left_out;
    question_.extra_white_dph2 = question_.belief.model.extra_white_dph2 = found.extra_white_dph2;
    question_.is_censored = found.is_censored;
    for (const StructureFinding& f : found.findings) {
      SelectedEffect effect;
      effect.family = f.effect->family();
      effect.term = term_of(f.effect, f.effect->estimator(), {});
      effect.term.fixed_parameters = f.signature.parameters;
      effect.is_structural = true;
      effect.statement = f.signature.statement;
      effect.gain_nats = effect.evidence_nats = f.signature.evidence_nats;
      effect.held_out_nats = kPredictsNothing;
      effect.set = {{f.effect, nullptr, false, effect.family, f.signature.evidence_nats, 0}};
      structural_.push_back(effect);
    }
  }

  void leave(const SelectedEffect& effect) { selection().remainders.push_back(effect.set.front()); }
  template <class F> void leave_those(F goes, std::vector<SelectedEffect>* list) {
    const auto kept = [&](const SelectedEffect& effect) { return !goes(effect); };
    const auto gone = std::stable_partition(list->begin(), list->end(), kept);
    for (auto effect = gone; effect != list->end(); ++effect) leave(*effect);
    list->erase(gone, list->end());
  }

  void name_slow() {
    const SlowModel& best = slow_.found.best;
    std::vector<SelectedEffect> list;
    for (size_t i = 0; i < best.names.size(); ++i)
      if (slow_.found.evidence[i] > 0) list.push_back(effect_of_name(slow_, constants(), i));
    std::sort(list.begin(), list.end(), [](const auto& a, const auto& b) { return a.evidence_nats > b.evidence_nats; });
    const bool is_medley = is_made_of_many(list);
    if (is_medley)
      leave_those([](const SelectedEffect&) { return true; }, &list);
    else if (slow_.has_free_function())
      leave_small(&list, 1e300);
    named_ = owned(members_before_shapes(list));
    for (const SelectedEffect& effect : named_)
      if (is_free(effect)) {
        leave_small(&named_, effect.gain_nats);
        break;
      }
    for (size_t j : slow_.found.replaced) selection().remainders.push_back(slow_.evidence_of(j, 0, 0));
    open_by_lack();
    leave_beside_open_family();
    if (!best.steps.empty() && !is_medley) name_steps();
    if (best.noise_effect && !slow_.found.evidence.empty() && slow_.found.evidence.back() > 0 && !is_medley)
      name_slow_noise();
  }
  // A member that holds less than a third of all, and less than the free shape beside it, is what that shape leaves.
  void leave_small(std::vector<SelectedEffect>* list, double shape_nats) {
    const double all = slow_.gain_nats();
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
    if (list.size() + (slow_.found.best.steps.empty() ? 0 : 1) <= kFewNames) return false;
    double sum = slow_.found.step_gain_nats, least = sum > 0 ? sum : 1e300;
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
    const double all = slow_.gain_nats();
    if (kept.size() == 1 && left_nats > constants().lack_part * all) open_shape(&kept[0]);
    return kept;
  }
  static bool has_members(const SelectedEffect& effect) {
    return !effect.set.front().reference || effect.set.front().reference->has_members;
  }
  // Members are names while no free shape beside them gains much.  One of another family that does as well alone shows
  // that the family is not told either.
  void open_by_lack() {
    for (const Beside& rest : slow_.beside) {
      const Family family = slow_.candidate(rest.candidate).family();
      selection().remainders.push_back(slow_.evidence_of(rest.candidate, rest.nats, 0));
      if (named_.size() == 1 && named_[0].family != family && does_as_well(rest.candidate)) {
        leave(named_[0]);
        named_.clear();
      }
      for (SelectedEffect& effect : named_)
        if (effect.family == family || named_.size() == 1) open_shape(&effect);
    }
  }
  bool does_as_well(size_t free_shape) const {
    const double null = slow_.found.null.free_score(), all = slow_.found.best.free_score() - null;
    return slow_.found.singles[free_shape].gain_nats - null > constants().member_share * all;
  }
  void open_jumps(SelectedEffect* effect) const {
    effect->family = Family::kSlowNoise;
    open_member(effect);
    add_jumping_noise(effect);
    effect->statement = "jumps come again and again: a noise that jumps, not single events; what makes it is open";
  }
  // Jumps that hold a share of what all of them explain: a small one beside large ones is not their kind.
  size_t jumps_of_weight() const {
    const SlowModel& best = slow_.found.best;
    if (best.steps.size() <= kMostJumps) return best.steps.size();
    size_t n = 0;
    for (size_t i = 0; i < best.steps.size(); ++i) {
      SlowModel less = best;
      less.steps.erase(less.steps.begin() + static_cast<long>(i));
      less = slow_.search->polished(less);
      n += best.free_score() - less.free_score() > constants().least_share * slow_.found.step_gain_nats ? 1 : 0;
    }
    return n;
  }
  void name_steps() {
    for (size_t j = 0; j < question_.library.size(); ++j) {
      const EffectEstimator* e = question_.library[j]->estimator();
      if (!e || e->form() != Form::kSteps) continue;
      Theta shape;
      for (const Theta& step : slow_.found.best.steps) shape.insert(shape.end(), step.begin(), step.end());
      SelectedEffect effect;
      effect.family = question_.library[j]->family();
      effect.term = term_of(question_.library[j], e, shape);
      effect.gain_nats = slow_.found.step_gain_nats;
      effect.evidence_nats =
          effect.gain_nats - constants().step_nats * static_cast<double>(slow_.found.best.steps.size());
      effect.held_out_nats = kPredictsNothing;
      effect.set = {{question_.library[j], nullptr, false, effect.family, effect.gain_nats,
                     effect.gain_nats - effect.evidence_nats}};
      // Jumps that come again and again are a noise.
      if (jumps_of_weight() > kMostJumps || (named_.empty() && slow_.is_against(constants()))) open_jumps(&effect);
      named_.push_back(effect);
    }
  }
  void name_slow_noise() {
    const SlowModel& best = slow_.found.best;
    SelectedEffect effect;
    effect.family = best.noise_effect->family();
    effect.term = term_of(best.noise_effect, best.noise_effect->estimator(), best.noise_theta);
    effect.evidence_nats = slow_.found.evidence.back();
    effect.gain_nats = effect.evidence_nats + constants().noise_nats;
    effect.held_out_nats = kPredictsNothing;
    const double threshold = constants().noise_nats;
    effect.set = {{best.noise_effect, nullptr, false, effect.family, effect.gain_nats, threshold}};
    add_kinds_within(constants().noise_margin_nats, best, &effect);
    if (effect.set.size() > 1) open_member(&effect);
    add_same_spectrum(&effect);
    if (best.names.empty()) add_means_that_do_as_well(&effect);
    if (slow_.has_free_function()) {
      leave(effect);
    } else if (best.names.empty() && slow_.is_against(constants())) {
      effect.doubt = Doubt::kAgainst, effect.held_out_nats = 0.5 * slow_.gap.delta_deviance;
      slow_.dropped.push_back(effect);
    } else if (!best.names.empty() || slow_.beside.empty()) {
      named_.push_back(effect);
    }
  }

  // Whether the kind of noise of a hypothesis takes anything: one that could be left out of it is no rival.
  bool is_needed(const SlowModel& m) const {
    if (!m.noise_effect) return false;
    SlowModel less = m;
    less.noise_effect = nullptr;
    const auto value = [&](const SlowModel& at) { return slow_.search->grams_of(at).log_marginal_any_scale(); };
    return value(m) - value(less) > constants().rivals_nats;
  }
  // Kinds of slow noise that gain less than an answer by no more than this, best first.
  void add_kinds_within(double margin_nats, const SlowModel& answer, SelectedEffect* effect) const {
    std::vector<CandidateEvidence> kinds;
    const bool is_alone = answer.names.empty() && answer.steps.empty();
    for (const SlowCandidateScore& s : is_alone ? slow_.found.noises : slow_.search->kinds_beside(answer)) {
      if (!s.model.noise_effect || is_in_set(*effect, s.model.noise_effect)) continue;
      const SlowModel m = is_needed(s.model) ? s.model : slow_.search->in_place_of_base(s.model);
      const double gap = answer.free_score() - m.free_score();
      if (gap >= margin_nats || !is_needed(m)) continue;
      kinds.push_back(
          {s.model.noise_effect, nullptr, false, Family::kSlowNoise, effect->gain_nats - gap, constants().noise_nats});
    }
    add_to_set(std::move(kinds), effect);
  }
  // Causes in the mean, those that differ from run to run among them, that do as well as a kind of slow noise alone.
  void add_means_that_do_as_well(SelectedEffect* effect) const {
    const SlowModel& best = slow_.found.best;
    std::vector<CandidateEvidence> means;
    for (size_t j = 0; j < slow_.found.singles.size(); ++j) {
      const SlowCandidateScore& s = slow_.found.singles[j];
      const double gap = best.free_score() + best.noise_charge - s.gain_nats;
      if (!slow_.candidate(j).effect || s.model.names.empty() || gap >= constants().rivals_nats) continue;
      means.push_back(slow_.evidence_of(j, effect->gain_nats - gap, constants().mean_nats));
    }
    add_to_set(std::move(means), effect);
  }
  // Noise that jumps between levels does so again and again.
  void add_jumping_noise(SelectedEffect* effect) const { add_equal(question_.jumping_kind(), effect); }
  // Slow noise explains it, but a repeatable cause that takes most of it would do so as well.
  void name_undecided() {
    // What is left of a shape that gains more is not slow noise.
    if (!slow_.dropped.empty() || !selection().remainders.empty()) return;
    const SlowModel& best = slow_answer();
    if (!named_.empty() && !(named_.size() == 1 && named_[0].family == Family::kSlowNoise)) return;
    const NoiseModel noise = slow_.search->seconds_noise_of(best);
    double longest = 0;
    for (const CampaignRun& run : question_.campaign.runs) longest = std::max(longest, run.input.t_s.back());
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
    effect.held_out_nats = kPredictsNothing;
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
  const SlowModel& slow_answer() const { return named_.empty() ? slow_.found.null : slow_.found.best; }
  // Repeatable causes that do as well as slow noise, beside the same kind of it, and take most of what it takes.
  std::vector<CandidateEvidence> repeatable_rivals() const {
    const SlowModel& best = slow_answer();
    std::vector<std::pair<double, size_t>> order;
    for (size_t j = 0; j < slow_.found.singles.size(); ++j)
      if (!slow_.found.singles[j].model.names.empty() && slow_.candidate(j).effect &&
          slow_.candidate(j).effect->estimator()->is_repeatable())
        order.push_back({slow_.found.singles[j].gain_nats, j});
    std::sort(order.rbegin(), order.rend());
    std::vector<CandidateEvidence> rivals;
    for (size_t i = 0; i < order.size() && i < kUndecidedTried; ++i) {
      SlowModel m = slow_.found.singles[order[i].second].model;
      m.noise_effect = best.noise_effect, m.noise_theta = best.noise_theta, m.noise_charge = best.noise_charge;
      m = slow_.search->polished(m);
      if (is_undecided(slow_, constants(), !question_.lines.empty(), best, m))
        rivals.push_back(slow_.evidence_of(order[i].second, m.free_score() - best.free_score(), constants().mean_nats));
    }
    std::sort(rivals.begin(), rivals.end(), [](const auto& a, const auto& b) { return a.gain_nats > b.gain_nats; });
    return rivals;
  }
  // The hypotheses of the seconds, and the noise of the seconds under them.
  void seconds() {
    SlowModel nominal = slow_.found.null;
    nominal.is_believed = nominal.is_believed || question_.belief.has_believed;
    selection().nominal = hypothesis_of(nominal, false);
    selection().final = hypothesis_of(slow_.found.best, true);
    final_fit_ = fit_hypothesis(question_.campaign, selection().final);
    from_ = fit_seconds_noise(question_.campaign, selection().final.noise(), final_fit_.residual);
    believe_again();
    if (is_believed_ && gives_up_unnamed_noise()) return seconds();
    fit_own_base();
  }
  // The believed noise does beside a kind of noise that is not worth its name, and does not without it: other parameters
  // are the simpler answer.
  bool gives_up_unnamed_noise() {
    SlowModel& best = slow_.found.best;
    if (!best.names.empty() || !best.steps.empty() || !best.noise_effect) return false;
    if (slow_.found.evidence.back() > 0 || slow_.found.null.is_believed) return false;
    best = slow_.found.null;
    slow_.found.evidence.clear();
    slow_.gap = measure_gap(*slow_.search, *slow_.data, slow_.held_blocks.get(), slow_.found.null, best);
    look_beside(question_, &slow_);
    return true;
  }
  // Noise beside a kind of slow noise, of the seconds: block means do not show all of it.
  void fit_own_base() {
    const SlowModel& m = slow_.found.best;
    if (!m.noise_effect) return;
    own_base_ = slow_.search->base_noise_of(m);
    own_base_.extra_white_dph2 = question_.extra_white_dph2;
    if (is_believed_) return;
    fit_own_base_beside(nullptr, {});
  }
  void fit_own_base_beside(const EffectEstimator* fast, const Theta& theta) {
    const SlowModel& m = slow_.found.best;
    const auto with = [&](const NoiseModel& base) {
      const NoiseModel slow = m.noise_effect->estimator()->noise(base, m.noise_theta);
      return fast ? fast->noise(slow, theta) : slow;
    };
    own_base_ = fit_seconds_noise(question_.campaign, own_base_, final_fit_.residual, with).base;
  }
  // Whether the believed noise parameters hold is a question to the seconds, under the causes found.
  void believe_again() {
    is_believed_ = false;
    if (!question_.belief.has_believed) return;
    SlowModel m = slow_.found.best;
    m.is_believed = true;
    const NoiseModel believed = slow_.search->seconds_noise_of(m);
    retuned_nats_ = from_.log_likelihood - ResidualLikelihood(question_.campaign, final_fit_.residual)(believed);
    if (retuned_nats_ > constants().retuned_nats) return;
    is_believed_ = true;
    from_.base = believed, from_.log_likelihood -= retuned_nats_;
    slow_.found.best.is_believed = true; // its noise is the believed one from here on
    selection().final = hypothesis_of(slow_.found.best, true);
  }
  std::vector<VectorXd> whitened() const {
    std::vector<VectorXd> e = final_fit_.residual;
    for (size_t r = 0; r < e.size(); ++r)
      whiten(compute_gains(question_.campaign.runs[r], gaussian_equivalent(from_.base)), e[r].data(),
             static_cast<size_t>(e[r].size()));
    return e;
  }
  Hypothesis hypothesis_of(const SlowModel& m, bool with_names) const {
    Hypothesis h;
    h.base_noise = slow_.search->base_noise_of(m);
    h.base_noise.extra_white_dph2 = question_.extra_white_dph2;
    for (const NoiseBelief::Known& known : question_.belief.known)
      if (known.estimator->form() != Form::kTone) h.known.push_back(term_of(nullptr, known.estimator, known.shape));
    if (!with_names) return h;
    for (const NamedLine& line : question_.lines)
      h.terms.push_back(term_of(line.effect, line.effect->estimator(), line.shape));
    for (const SlowModel::Name& name : m.names) {
      const Candidate& c = slow_.candidate(name.candidate);
      h.terms.push_back(term_of(c.effect, c.scan.estimator, name.shape));
    }
    if (!m.steps.empty()) {
      Theta shape;
      for (const Theta& step : m.steps) shape.insert(shape.end(), step.begin(), step.end());
      for (const Effect* effect : question_.library)
        if (effect->estimator() && effect->estimator()->form() == Form::kSteps)
          h.terms.push_back(term_of(effect, effect->estimator(), shape));
    }
    if (m.noise_effect) h.terms.push_back(term_of(m.noise_effect, m.noise_effect->estimator(), m.noise_theta));
    return h;
  }

  // What the seconds say beside the slow causes.
  void fast_stage() {
    if (question_.is_censored) return; // the spread of what is left is not that of the noise
    fast_ = scan_fast_noise(question_.campaign, from_, final_fit_.residual, question_.library, question_.active,
                            constants(), may_ask_slow_noise());
    leave_hits_that_stay();
    ask_jumping_noise();
  }

  void leave_hits_that_stay() {
    std::vector<FastFinding>& list = fast_.findings;
    const auto stays = [&](const FastFinding& f) {
      const NoiseModel noise = f.effect->estimator()->noise(f.base, f.theta);
      return noise.hit_probability > 0 && do_hits_stay(question_.campaign, final_fit_.residual, noise, constants());
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
  // Block means know no noise that jumps: other noise parameters, other kinds of noise, jumps in time and causes in the mean
  // stand in for it there.  Where the seconds change suddenly it is asked for without them, beside the noise as believed;
  // the levels that the logs show are taken out, and everything is asked again.
  void ask_jumping_noise() {
    const FastFinding* found = jumping_finding();
    if (!question_.jumping_kind() || !(fast_.changes_suddenly || (found && found->gain_nats > constants().fast_nats)))
      return;
    if (!found && !question_.belief.has_believed) return;
    has_teeth_ = found && is_one_sided(question_.campaign, final_fit_.residual, with_jumps(*found));
    if (has_teeth_) return;
    const double gaussian = from_.log_likelihood - charges(slow_.found.best, is_believed_);
    const double fast = fast_.findings.empty() ? 0 : fast_.findings.front().gain_nats - constants().fast_nats;
    Jumping alone = beside_mean(slow_.found.null, jumping_start(slow_.found.null));
    Jumping first = first_jumping(alone);
    SlowAnswer other;
    const Jumping with = ask_in_turn(first, &alone, &other);
    has_teeth_ = is_one_sided(question_.campaign, with.fit.residual, with_jumps(with.noise));
    if (!has_teeth_ && with.score > gaussian + std::max(0.0, fast) + foretold_by_lost(other))
      take_jumping(with, gaussian, other);
    else
      std::swap(slow_, other);
  }
  // Levels follow a jump at a temperature as well as one by chance, but foretell nothing: what the names that would go
  // foretell of logs that were not fitted, as right names do, stands against them.
  double foretold_by_lost(const SlowAnswer& before) const {
    if (before.gap.method == HeldOut::kQuarters) return 0; // parts of one passage foretell nothing of another
    const std::vector<SlowModel::Name>& now = slow_.found.best.names;
    double sum = 0;
    for (size_t i = 0; i < before.found.best.names.size() && i < before.gap.at_all.size(); ++i) {
      const size_t j = before.found.best.names[i].candidate;
      const GapResult::Support& all = before.gap.at_all[i];
      const bool is_kept = std::any_of(now.begin(), now.end(), [&](const auto& name) { return name.candidate == j; });
      if (!is_kept && all.nats > constants().foretold_part * all.expected) sum += std::max(0.0, all.nats);
    }
    return sum;
  }
  // Levels, and what is found without them, until nothing else is found.  Jumps in time are levels that are wrong, unless
  // the seconds are less likely without them.
  // `before`: where the answer goes that stood.
  Jumping ask_in_turn(Jumping first, Jumping* alone, SlowAnswer* before) {
    Jumping with;
    for (int round = 0; round < kJumpingRounds; ++round) {
      Campaign quiet = question_.campaign, quiet_held;
      take_levels(first.noise, first.fit.residual, &quiet);
      if (question_.held_out) {
        quiet_held = *question_.held_out;
        take_levels(first.noise, fit_hypothesis(quiet_held, hypothesis_beside(first)).residual, &quiet_held);
      }
      if (round == 0) std::swap(slow_, *before);
      prepare_slow(question_, &quiet, question_.held_out ? &quiet_held : nullptr, &slow_);
      run_slow(question_, &slow_);
      with = last_jumping(first, *alone);
      SlowModel causes = slow_.found.best;
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
      slow_.forget_causes();
      return first;
    }
    return with;
  }
  // What the mean would leave if it had no jumps in time.
  std::vector<VectorXd> less_steps(const Jumping& jumping) const {
    std::vector<VectorXd> residual = jumping.fit.residual;
    const Hypothesis h = hypothesis_beside(jumping);
    const Design design = make_design(question_.campaign, h);
    for (size_t c = 0; c < design.cols(); ++c) {
      const int term = design.term_of_column[c];
      if (term < 0 || h.terms[static_cast<size_t>(term)].form() != Form::kSteps) continue;
      const auto column = static_cast<long>(c);
      for (size_t r = 0; r < residual.size(); ++r) residual[r] += jumping.fit.beta[column] * design.x[r].col(column);
    }
    return residual;
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
    const bool is_retuned = question_.belief.has_believed && !is_believed;
    return m.value - slow_.search->score(m) + (is_retuned ? constants().retuned_nats : 0);
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
    return slow_.search->seconds_noise_of(m);
  }
  // The mean and the noise in turn, from what they are; returns the log-likelihood.
  double improve(bool is_base_free, Jumping* jumping) const {
    const std::vector<VectorXd> near = jumping->fit.residual;
    jumping->fit = fit_hypothesis(question_.campaign, hypothesis_beside(*jumping), near.empty() ? nullptr : &near);
    return fit_again(ResidualLikelihood(question_.campaign, jumping->fit.residual), is_base_free, &jumping->noise);
  }
  // Beside this mean, from this start: beside the believed noise, and beside other parameters where these gain more than
  // they cost.  They also stand in for levels that are wrong: where they gain, the believed ones are tried with theirs.
  // `near`: a residual that may be like that of this mean.
  Jumping beside_mean(const SlowModel& mean, const FastFinding& start, const std::vector<VectorXd>& near = {}) const {
    const bool has_believed = question_.belief.has_believed;
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
    set_errors(ResidualLikelihood(question_.campaign, out.fit.residual), &out.noise);
    out.score = out.log_likelihood - charges(mean, out.is_believed) - constants().fast_nats;
    return out;
  }
  // Like the finding, or like the process that the noise without it has taken it for, beside the believed noise.
  FastFinding jumping_start(const SlowModel& mean) const {
    FastFinding best;
    best.effect = question_.jumping_kind();
    const EffectEstimator& e = *best.effect->estimator();
    const FastFinding* found = jumping_finding();
    if (!question_.belief.has_believed) return *found;
    SlowModel causes = mean;
    causes.noise_effect = nullptr;
    Hypothesis h = hypothesis_of(causes, true);
    h.base_noise = hypothesis_of(slow_.found.null, false).base_noise;
    const Fit fit = fit_hypothesis(question_.campaign, h);
    const ResidualLikelihood log_likelihood(question_.campaign, fit.residual);
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
    if (slow_.found.best.names.empty()) return alone;
    SlowModel causes = slow_.found.best;
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
    const SlowModel& best = slow_.found.best;
    if (is_bare(best)) return alone;
    const Jumping with = beside_mean(best, first.noise);
    if (alone.score < with.score) return with;
    slow_.forget_causes();
    return alone;
  }
  // `gaussian`: score of the best answer without noise that jumps; `before`: that answer.
  void take_jumping(const Jumping& jumping, double gaussian, const SlowAnswer& before) {
    FastFinding found = jumping.noise;
    found.gain_nats = jumping_nats_ = jumping.score + constants().fast_nats - gaussian;
    std::vector<FastFinding>& list = fast_.findings;
    list.erase(std::remove_if(list.begin(), list.end(), [&](const auto& f) { return f.effect == found.effect; }),
               list.end());
    list.insert(list.begin(), found);
    final_fit_ = jumping.fit;
    from_.base = found.base, from_.log_likelihood = jumping.log_likelihood;
    is_believed_ = jumping.is_believed, retuned_nats_ = jumping.retuned_nats;
    SlowModel& best = slow_.found.best;
    if (question_.belief.has_believed) best.is_believed = is_believed_;
    if (is_believed_ && is_bare(best)) slow_.found.null.is_believed = true; // no slow noise beside the jumps
    selection().final = hypothesis_of(best, true);
    fit_own_base();
    // Of the logs as they are.
    SlowModel nominal = before.found.null, causes = best;
    causes.noise_effect = nullptr;
    causes.take_noise_of(nominal);
    nominal.is_without_lines = !question_.lines.empty();
    slow_.gap = measure_gap(*before.search, *before.data, before.held_blocks.get(), nominal, causes);
  }

  void name_fast() {
    for (const NamedLine& line : question_.lines) insert_by_evidence(effect_of_line(line));
    const std::vector<FastFinding>& found = fast_.findings;
    if (found.empty() || found.front().gain_nats < constants().fast_nats) return;
    const FastFinding& best = found.front();
    SelectedEffect effect;
    effect.family = best.effect->family();
    effect.term = term_of(best.effect, best.effect->estimator(), best.theta);
    effect.term.shape_errors = best.theta_errors;
    effect.gain_nats = best.gain_nats;
    effect.evidence_nats = best.gain_nats - constants().fast_nats;
    effect.held_out_nats = kPredictsNothing;
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
    if (slow_.found.best.noise_effect) fit_own_base_beside(best.effect->estimator(), best.theta);
    selection().final.terms.push_back(effect.term);
  }
  // Whether a process that jumps is expected to do so no more often than what is said to be single events.
  bool jumps_seldom(const FastFinding& found) const {
    if (!found.effect->estimator()->is_jumping()) return false;
    const NoiseModel noise = found.effect->estimator()->noise(found.base, found.theta);
    const double seconds = static_cast<double>(question_.campaign.n()) * question_.campaign.dt_s;
    return seconds / (2 * noise.telegraph_tau_s) <= static_cast<double>(kMostJumps);
  }
  // Two levels are not told from single jumps by so few of them.
  void open_seldom_jumps(SelectedEffect* effect) {
    open_member(effect);
    effect->statement = "the family of the cause, not its member: so few jumps are single events or a noise that jumps";
    const auto is_steps = [](const SelectedEffect& e) { return e.term.effect && e.term.form() == Form::kSteps; };
    named_.erase(std::remove_if(named_.begin(), named_.end(), is_steps), named_.end());
    add_equal(question_.first_kind([](const EffectEstimator& e) { return e.form() == Form::kSteps; }), effect);
  }
  // Block means were content with other parameters of the noise: where the spectrum of the seconds is not, they are asked.
  bool may_ask_slow_noise() const {
    const SlowModel& best = slow_.found.best;
    return best.names.empty() && !best.noise_effect && best.steps.empty() && !is_believed_;
  }
  // The strongest first; but what these logs leave open stands before what is beside it.
  void insert_by_evidence(const SelectedEffect& effect) {
    const bool is_first =
        named_.empty() || (named_[0].doubt != Doubt::kSlowNoise && named_[0].evidence_nats < effect.evidence_nats);
    named_.insert(is_first ? named_.begin() : named_.end(), effect);
  }
  // Re-tuned noise is a finding of its own: it comes last and takes nobody's place.
  void name_retuned() {
    const bool is_retuned = question_.belief.has_believed && !is_believed_;
    selection().is_noise_retuned = is_retuned;
    if (!is_retuned) return;
    for (size_t j = 0; j < question_.library.size(); ++j) {
      const EffectEstimator* e = question_.library[j]->estimator();
      if (!e || !question_.active[j] || !e->is_nominal_noise()) continue;
      SelectedEffect effect;
      effect.family = question_.library[j]->family();
      const NoiseModel& noise = from_.base;
      effect.term = term_of(question_.library[j], e,
                            {noise.white_sigma_dph, noise.markov.empty() ? 0 : noise.markov[0].sigma_dph,
                             noise.markov.empty() ? 1 : noise.markov[0].tau_s});
      effect.gain_nats = retuned_nats_;
      effect.evidence_nats = retuned_nats_ - constants().retuned_nats;
      effect.held_out_nats = kPredictsNothing;
      effect.set = {{question_.library[j], nullptr, false, effect.family, effect.gain_nats, constants().retuned_nats}};
      add_kinds_of_noise(&effect);
      retuned_.push_back(effect);
    }
  }

  // Another kind of noise beside the believed one, or beside other parameters, that does as well as these.
  void add_kinds_of_noise(SelectedEffect* retuned) const {
    const SlowModel& null = slow_.found.null;
    const SlowModel& best = slow_.found.best;
    if (!best.names.empty() || (best.noise_effect && slow_.found.evidence.back() > 0)) return;
    std::vector<CandidateEvidence> kinds;
    for (const SlowCandidateScore& s : slow_.found.noises) {
      if (!s.model.noise_effect) continue;
      const SlowModel m = slow_.search->beside_believed(s.model);
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
    for (size_t j = 0; j < question_.library.size(); ++j) {
      CandidateEvidence other = as_well;
      other.effect = question_.library[j];
      if (question_.active[j] && !is_in_set(*effect, question_.library[j]) && has_markov_spectrum(other))
        effect->set.push_back(other);
    }
  }

  void finish() {
    Selection& s = selection();
    s.final.base_noise = from_.base;
    s.final.base_noise.extra_white_dph2 = question_.extra_white_dph2;
    // Noise terms act on the base; the base was fitted with them in it.
    if (slow_.found.best.noise_effect) s.final.base_noise = own_base_;
    s.fitted_noise = from_.base;
    s.threshold_nats = constants().mean_nats;
    fit_and_test();
    fill_coefficients(s.final_fit);
    open_by_rest();
    s.total_gain_nats = slow_.gain_nats();
    for (size_t j = 0; j < slow_.found.singles.size(); ++j)
      if (slow_.candidate(j).effect)
        s.first_scan.push_back(slow_.evidence_of(
            j, std::max(0.0, slow_.found.singles[j].gain_nats - slow_.found.null.free_score()), s.threshold_nats));
    for (const SlowCandidateScore& n : slow_.found.noises)
      if (n.model.noise_effect)
        s.first_scan.push_back(
            {n.model.noise_effect, nullptr, false, n.model.noise_effect->family(),
             std::max(0.0, n.gain_nats + constants().noise_kind_nats - slow_.found.null.free_score()),
             constants().noise_nats});
    s.effects = structural_;
    s.effects.insert(s.effects.end(), named_.begin(), named_.end());
    // Beside something unexplained the noise parameters are those of a stand-in.
    if (!leaves_something()) s.effects.insert(s.effects.end(), retuned_.begin(), retuned_.end());
    judge();
  }
  void fit_and_test() {
    Selection& s = selection();
    s.nominal_fit = fit_hypothesis(question_.campaign, s.nominal);
    s.before = s.after = test_rest(question_.campaign, s.nominal_fit.e, constants());
    if (is_same_fit(s.nominal, s.final)) {
      s.final_fit = s.nominal_fit;
      return;
    }
    s.final_fit = fit_hypothesis(question_.campaign, s.final, &final_fit_.residual);
    s.after = test_rest(question_.campaign, s.final_fit.e, constants());
  }
  bool leaves_something() {
    bool leaves = !selection().remainders.empty() || !slow_.dropped.empty();
    for (const RestFinding& f : selection().after) leaves = leaves || (!question_.is_censored && f.evidence_nats > 0);
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
    if (question_.is_censored || !fires) return;
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
    if (effect->family == Family::kSlowNoise && slow_.found.best.names.empty()) {
      add_kinds_within(slow_.gain_nats() + constants().noise_kind_nats, slow_.found.best, effect);
      add_same_spectrum(effect);
    }
    if (effect->statement.empty() && effect->set.size() == 1)
      effect->statement =
          "the family of the cause, not its member: the only one that explains it leaves what is no noise";
  }
  // A line is what it is: it stands in for nothing, unless lines remain.
  bool is_member(const SelectedEffect& effect) const {
    return !effect.is_family && (effect.family != Family::kTone || question_.lines.size() == kMostLines);
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
    double sum = slow_.gain_nats() + jumping_nats_;
    for (const SelectedEffect& effect : named_)
      if (effect.family == Family::kFastNoise || effect.family == Family::kTone) sum += effect.gain_nats;
    return sum;
  }
  // A kind of slow noise beside a cause whose shape is open is what that shape leaves, and so are one of fast noise and
  // other noise parameters that hold little beside it.
  void leave_noise_beside_shapes() {
    const auto is_open = [](const SelectedEffect& effect) { return effect.doubt == Doubt::kShapeOpen; };
    const bool leaves_shape = slow_.has_free_function() || std::any_of(named_.begin(), named_.end(), is_open);
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
    const Design design = make_design(question_.campaign, h);
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
            effect.term.shape_errors = line_errors(question_.campaign, design, fit, from_.base, term, t);
          else if (effect.term.shape_errors.empty())
            effect.term.shape_errors = shape_errors(effect);
        }
    }
  }
  // Curvature of the marginal likelihood over the shape of one name, the rest as found.
  Theta shape_errors(const SelectedEffect& effect) const {
    const SlowModel& best = slow_.found.best;
    for (size_t i = 0; i < best.names.size(); ++i) {
      const EffectEstimator& e = *slow_.candidate(best.names[i].candidate).scan.estimator;
      if (&e != effect.term.estimator || e.shape_lo().size() != best.names[i].shape.size() || e.shape_lo().empty())
        continue;
      SlowModel m = best;
      return curvature_errors(
          [&](const Theta& shape) {
            m.names[i].shape = shape;
            return slow_.search->grams_of(m).log_marginal(1);
          },
          best.names[i].shape, e.shape_lo(), e.shape_hi());
    }
    return {};
  }

  void judge() {
    Selection& s = selection();
    bool fires = false, has_open = false, has_member = false, is_undecided = false;
    if (!question_.is_censored)
      for (const RestFinding& f : s.after) fires = fires || f.evidence_nats > 0;
    for (const SelectedEffect& e : s.effects) {
      has_open = has_open || e.doubt == Doubt::kShapeOpen;
      is_undecided = is_undecided || e.doubt == Doubt::kSlowNoise;
      has_member = has_member || (e.doubt != Doubt::kShapeOpen && e.doubt != Doubt::kSlowNoise);
    }
    const bool has_mean = slow_.gap.has_mean || !slow_.found.best.steps.empty();
    const bool grows = has_mean && slow_.gap.rms_after_dph > (1 + constants().growth_part) * slow_.gap.rms_before_dph;
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

  Campaign& campaign_; // that of the question
  AxisQuestion question_;
  std::function<double(SlowSearch*)> calibrate_;
  SlowAnswer slow_;
  AxisStudy out_;
  std::vector<SelectedEffect> structural_, named_, retuned_;
  double retuned_nats_ = 0;
  bool is_believed_ = false;
  Fit final_fit_;
  SecondsNoise from_;
  NoiseModel own_base_; // under a kind of slow noise
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
