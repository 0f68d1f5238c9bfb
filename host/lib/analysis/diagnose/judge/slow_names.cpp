// SPDX-License-Identifier: MIT
#include "analysis/diagnose/judge/slow_names.h"

#include <algorithm>

#include "analysis/diagnose/judge/noise_kinds.h"

namespace imucal {

namespace {

class SlowNames {
public:
  SlowNames(const AxisQuestion& question, const SlowAnswer& slow) : question_(question), slow_(slow) {
    names_.dropped = slow.dropped;
  }

  Names run() {
    const SlowModel& best = slow_.found.best;
    std::vector<SelectedEffect> list;
    for (size_t i = 0; i < best.names.size(); ++i)
      if (slow_.found.evidence[i] > 0) list.push_back(effect_of_name(slow_, constants(), i));
    std::sort(list.begin(), list.end(), [](const auto& a, const auto& b) { return a.evidence_nats > b.evidence_nats; });
    const bool is_medley = is_made_of_many(list);
    if (is_medley)
      names_.reject_those([](const SelectedEffect&) { return true; }, &list);
    else if (slow_.has_free_function())
      reject_small_beside_function(&list);
    names_.effects = owned(members_before_shapes(list));
    for (const SelectedEffect& effect : names_.effects)
      if (is_free(effect)) {
        reject_small(&names_.effects, effect.gain_nats);
        break;
      }
    for (size_t j : slow_.found.replaced) names_.remainders.push_back(slow_.evidence_of(j, 0, 0));
    open_by_lack();
    reject_beside_open_family();
    reject_relays_of_loops();
    if (!best.steps.empty() && !is_medley && !are_steps_small_beside_function()) name_steps();
    if (slow_.found.has_noise() && !is_medley) name_slow_noise();
    return std::move(names_);
  }

private:
  const SelectorConstants& constants() const { return question_.constants; }

  // A member that holds less than a third of all, and less than the free shape beside it, is what that shape leaves.
  void reject_small(std::vector<SelectedEffect>* list, double shape_nats) {
    const double all = slow_.gain_nats();
    const double least = std::min(shape_nats, constants().beside_free_part * all);
    names_.reject_those([&](const SelectedEffect& e) { return !is_free(e) && e.gain_nats < least; }, list);
  }
  // Beside the free function the same, and what both foretell counts: that function is there for what it foretells.
  void reject_small_beside_function(std::vector<SelectedEffect>* list) {
    const double third = constants().beside_free_part * slow_.gain_nats(), function = function_nats();
    names_.reject_those(
        [&](const SelectedEffect& e) {
          return !is_free(e) && e.gain_nats < third && e.gain_nats + std::max(0.0, e.held_out_nats) < function;
        },
        list);
  }
  // What the free function gains in the fitted logs and foretells of others.
  double function_nats() const {
    const SlowResult& found = slow_.found;
    for (size_t i = 0; i < found.best.names.size() && i < slow_.gap.foretold.beyond_start.size(); ++i)
      if (slow_.is_free_function(i))
        return found.evidence[i] + constants().mean_nats + std::max(0.0, slow_.gap.foretold.beyond_start[i].nats);
    return 0;
  }
  // Nor is a member told beside a larger answer of its family whose shape is open.
  void reject_beside_open_family() {
    std::vector<SelectedEffect> open;
    for (const SelectedEffect& effect : names_.effects)
      if (is_shape_open(effect)) open.push_back(effect);
    const auto is_part = [&](const SelectedEffect& effect) {
      return !is_shape_open(effect) && std::any_of(open.begin(), open.end(), [&](const SelectedEffect& whole) {
        return whole.family == effect.family && whole.gain_nats > effect.gain_nats;
      });
    };
    names_.reject_those(is_part, &names_.effects);
  }
  // A loop is plays and relays of many widths (Preisach): a jump at a temperature that holds less than a third of all beside a
  // play that holds more is what that play leaves of it.
  void reject_relays_of_loops() {
    double loop_nats = 0;
    for (const SelectedEffect& effect : names_.effects)
      if (effect.term.effect && effect.term.effect->estimator()->is_start_bounded()) // of any shape too
        loop_nats = std::max(loop_nats, effect.gain_nats);
    const double least = std::min(loop_nats, constants().beside_free_part * slow_.gain_nats());
    const auto is_relay = [&](const SelectedEffect& effect) {
      return effect.term.estimator && effect.term.estimator->can_jump() && effect.gain_nats < least;
    };
    names_.reject_those(is_relay, &names_.effects);
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
      names_.reject(effect);
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
        names_.reject(effect), left_nats = std::max(left_nats, effect.gain_nats);
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
      names_.remainders.push_back(slow_.evidence_of(rest.candidate, rest.nats, 0));
      if (names_.effects.size() == 1 && names_.effects[0].family != family && does_as_well(rest.candidate)) {
        names_.reject(names_.effects[0]);
        names_.effects.clear();
      }
      for (SelectedEffect& effect : names_.effects)
        if (effect.family == family || names_.effects.size() == 1) open_shape(&effect);
    }
  }
  bool does_as_well(size_t free_shape) const {
    const double null = slow_.found.null.free_score(), all = slow_.found.best.free_score() - null;
    return slow_.found.singles[free_shape].score_nats - null > constants().member_share * all;
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
  // Jumps in time beside a free function that holds more, by what it foretells too: what that function leaves where it is not
  // smooth.
  bool are_steps_small_beside_function() const {
    const size_t n = slow_.found.best.names.size();
    for (size_t i = 0; i < n && i < slow_.gap.foretold.beyond_start.size(); ++i)
      if (slow_.is_free_function(i)) {
        const double all = slow_.gain_nats() + std::max(0.0, slow_.gap.foretold.beyond_start[i].nats);
        return slow_.found.step_gain_nats < constants().beside_free_part * all;
      }
    return false;
  }
  bool held_out_logs_jump() const {
    if (!slow_.held_blocks) return false;
    const std::vector<CampaignRun>& runs = slow_.held_blocks->runs;
    return std::any_of(runs.begin(), runs.end(), [](const CampaignRun& run) { return !run.own_jumps.empty(); });
  }
  // A noise that jumps does so in every log; as many jumps as logs and two more are no events either.
  bool come_in_every_log() const {
    const SlowModel& best = slow_.found.best;
    const size_t n_logs = slow_.data->campaign.runs.size();
    std::vector<char> has_jump(n_logs, 0);
    for (const Theta& step : best.steps) has_jump[static_cast<size_t>(step[0])] = 1;
    const auto n_with = static_cast<size_t>(std::count(has_jump.begin(), has_jump.end(), 1));
    return n_with == n_logs || best.steps.size() > n_logs + 1;
  }
  // Jumps that come again and again are a noise, or follow the temperature.
  void open_by_pattern(SelectedEffect* jumps) const {
    const SlowModel& best = slow_.found.best;
    const RepeatedJumps repeated = slow_.search->repeated_jumps(best);
    const bool is_against = names_.effects.empty() && slow_.is_against(constants());
    const bool are_many = come_in_every_log() && jumps_of_weight() > kMostJumps;
    if (repeated.follow_temperature)
      follow_temperature(question_, repeated.are_loops, jumps);
    else if (are_many || is_against || held_out_logs_jump())
      open_jumps(question_, jumps);
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
      effect.evidence_nats = effect.gain_nats - constants().cost_of_jumps(slow_.found.best.steps.size());
      effect.held_out_nats = kPredictsNothing;
      effect.set = {evidence_for(*question_.library[j], effect.gain_nats, effect.gain_nats - effect.evidence_nats)};
      add_jumps_at_temperature(question_, slow_, &effect);
      add_means_without_steps(question_, slow_, &effect);
      open_by_pattern(&effect);
      names_.effects.push_back(effect);
    }
  }
  // Whether a spectrum that no kind owns does as well as the kind named, or better where that is one of those spectra.
  bool is_of_another_spectrum() const {
    const SlowModel& best = slow_.found.best;
    if (best.noise_effect->estimator()->needs_temperature()) return false;
    const double gain = slow_.search->with_free_spectrum(best).free_score() - best.free_score();
    const bool is_one_of_them = !best.noise_effect->estimator()->has_markov_spectrum();
    return gain > (is_one_of_them ? 1 : -1) * constants().rivals_nats;
  }
  void name_slow_noise() {
    const SlowModel& best = slow_.found.best;
    SelectedEffect effect;
    effect.family = best.noise_effect->family();
    effect.term = term_of(best.noise_effect, best.noise_effect->estimator(), best.noise_theta);
    effect.evidence_nats = *slow_.found.noise_evidence;
    effect.gain_nats = effect.evidence_nats + constants().noise_nats;
    effect.held_out_nats = kPredictsNothing;
    effect.set = {evidence_for(*best.noise_effect, effect.gain_nats, constants().noise_nats)};
    add_kinds_within(question_, slow_, constants().noise_margin_nats, best, &effect);
    if (effect.set.size() > 1 || is_of_another_spectrum()) open_member(&effect);
    add_same_spectrum(question_, &effect);
    if (best.names.empty()) add_means_that_do_as_well(question_, slow_, &effect);
    if (slow_.has_free_function()) {
      names_.reject(effect);
    } else if (best.names.empty() && slow_.is_against(constants())) {
      effect.doubt = Doubt::kAgainst, effect.held_out_nats = 0.5 * slow_.gap.foretold.delta_deviance;
      names_.dropped.push_back(effect);
    } else if (SelectedEffect* jumps = names_.open_slow_noise()) {
      add_to_set(effect.set, jumps); // it may be a part of jumps that are told as noise
    } else if (!best.names.empty() || slow_.beside.empty()) {
      names_.effects.push_back(effect);
    }
  }

  const AxisQuestion& question_;
  const SlowAnswer& slow_;
  Names names_;
};

} // namespace

Names name_slow(const AxisQuestion& question, const SlowAnswer& slow) {
  return SlowNames(question, slow).run();
}

} // namespace imucal
