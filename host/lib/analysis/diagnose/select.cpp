// SPDX-License-Identifier: MIT
#include "analysis/diagnose/select.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "analysis/diagnose/judge/coefficients.h"
#include "analysis/diagnose/judge/contribution.h"
#include "analysis/diagnose/judge/fast_names.h"
#include "analysis/diagnose/judge/rest_names.h"
#include "analysis/diagnose/judge/slow_names.h"
#include "analysis/diagnose/judge/undecided.h"
#include "analysis/diagnose/logs/blocks.h"
#include "analysis/diagnose/stages/bursts.h"
#include "analysis/diagnose/stages/foretold_seconds.h"
#include "analysis/diagnose/stages/mean_lines.h"
#include "analysis/diagnose/stages/own_jumps.h"
#include "analysis/diagnose/stages/slow_stage.h"

namespace imucal {

namespace {

// About a jump at a temperature: what the temperature leaves open of its moment, and how long that may be where it moves slowly.
constexpr double kJump_s = 3, kJump_degc = 0.05, kLongJump_s = 60;

// Of the gap: an answer that surely takes less of it (95 % interval) explains a part.
constexpr double kExplainedPart = 0.95;

double most(const std::vector<double>& values) {
  return values.empty() ? 0 : *std::max_element(values.begin(), values.end());
}

// Asks the stages in turn and puts together what they say.
class Study {
public:
  Study(Campaign* campaign, Campaign* held_out, NoiseBelief belief, const std::vector<const Effect*>& library,
        const std::vector<bool>& active, const SelectOptions& options)
      : campaign_(*campaign),
        held_out_(held_out), question_{*campaign, held_out, library, active, std::move(belief), options.constants},
        calibrate_(options.calibrate), structure_(options.structure) {
    question_.threshold_under = options.threshold_under;
  }

  AxisStudy run() {
    take_structure();
    if (!drop_short_runs(&campaign_)) {
      out_.cannot_judge = true;
      out_.effects = structural_;
      out_.verdict = Verdict::kUnexplained;
      return study();
    }
    do {
      ask_slow();
      mask_jumps();
      found_.seconds = ask_seconds(question_, &found_.slow);
    } while (takes_line());
    if (!question_.lines.empty()) found_.slow.has_lines = true, found_.slow.measure();
    ask_fast(question_, &found_);
    names_ = name_slow(question_, found_.slow);
    name_undecided(question_, found_.slow, &names_);
    name_fast(question_, found_, &names_);
    name_retuned(question_, found_, &names_);
    finish();
    return study();
  }

private:
  const SelectorConstants& constants() const { return question_.constants; }

  void take_structure() {
    const StructureResult& found = structure_;
    if (held_out_ && !drop_short_runs(held_out_)) {
      drop_runs(std::vector<std::string>(held_out_->runs.size(), kTooShort), held_out_);
      question_.held_out = held_out_ = nullptr;
    }
    out_.n_dropouts = found.n_dropouts, out_.n_left_out = found.n_left_out;
    question_.is_censored = found.is_censored;
    for (const StructureFinding& f : found.findings) {
      SelectedEffect effect;
      effect.family = f.effect->family();
      effect.term = term_of(f.effect, f.effect->estimator(), {});
      effect.term.fixed_parameters = f.signature.parameters;
      effect.is_structural = true;
      effect.is_of_some_logs = !f.logs.empty() && !f.signature.white_dph2.empty();
      effect.statement = f.signature.statement + (f.logs.empty() ? "" : ": " + f.logs);
      if (const double white_dph2 = most(f.signature.white_dph2); white_dph2 > 0)
        effect.rms_dph = std::sqrt(white_dph2);
      effect.gain_nats = effect.evidence_nats = f.signature.evidence_nats;
      effect.held_out_nats = kPredictsNothing;
      effect.set = {evidence_for(*f.effect, f.signature.evidence_nats, 0)};
      structural_.push_back(effect);
    }
  }
  // The thresholds are found once, by the search that is asked first.
  void ask_slow() {
    SlowAnswer& slow = found_.slow;
    prepare_slow(question_, &campaign_, question_.held_out, &slow);
    if (calibrate_ && question_.lines.empty()) {
      const Thresholds found = calibrate_(slow.search.get());
      out_.chance = found.mean;
      question_.constants.mean_nats = found.mean.threshold_nats;
      question_.constants.first_step_nats = found.first_step_nats;
      slow.search->set_thresholds(found);
    }
    if (question_.lines.empty() && follow_starts(slow.search->start_halvings()))
      prepare_slow(question_, &campaign_, question_.held_out, &slow);
    run_slow(question_, &slow);
  }
  // Whether the runs have finer start columns now.
  bool follow_starts(int halvings) {
    for (Campaign* campaign : {&campaign_, held_out_})
      for (size_t r = 0; campaign && r < campaign->runs.size(); ++r) campaign->runs[r].input.start_halvings = halvings;
    return halvings > 0;
  }
  static bool is_in_jump(const RunInput& in, size_t jump, size_t k) {
    const double away_s = std::fabs(in.t_s[k] - in.t_s[jump]);
    return away_s <= kJump_s ||
           (away_s <= kLongJump_s && std::fabs(in.smooth_degc[k] - in.smooth_degc[jump]) <= kJump_degc);
  }
  // When a jump at a temperature comes is known to a few seconds, as the temperature is: what these say besides is how wrong
  // that is.  They are no hits, and are left out of the seconds.
  void mask_jumps() {
    mask_jumps_of(&campaign_);
    if (held_out_) mask_jumps_of(held_out_);
  }
  void mask_jumps_of(Campaign* campaign) const {
    std::vector<std::vector<char>> unusable;
    for (const CampaignRun& run : campaign->runs) {
      unusable.emplace_back(run.input.size(), 0);
      for (size_t jump : found_.slow.rows_of_jumps(run.input))
        for (size_t k = 0; k < run.input.size(); ++k)
          if (is_in_jump(run.input, jump, k)) unusable.back()[k] = 1;
    }
    mask(campaign, unusable);
  }
  // A line in the spectrum of what is left was in everybody's way: kinds of noise took its place, and the noise of all
  // hypotheses held it.  It joins the mean, in every run with its own amplitude and phase, and all is asked again.
  bool takes_line() {
    if (question_.lines.size() == kMostLines) return false;
    const std::optional<NamedLine> line = line_found(question_, whitened(campaign_, found_.seconds));
    if (!line) return false;
    question_.lines.push_back(*line);
    question_.belief.known.push_back({line->effect->estimator(), line->shape});
    return true;
  }

  void finish() {
    fit_and_test();
    if (question_.is_censored) forget_tests();
    tell_parameters();
    fill_coefficients(question_, out_.final_fit, &found_, &names_.effects);
    judge_unseen(&names_);
    judge_teeth(campaign_, &names_);
    open_by_rest(question_, found_, out_.after, &names_);
    add_errors_of_shapes(found_.slow, &names_.effects);
    add_errors_of_noise(question_, found_, &names_.effects);
    scan_told();
    for (SelectedEffect& effect : names_.effects) raise_family(&effect);
    out_.effects = structural_;
    out_.effects.insert(out_.effects.end(), names_.effects.begin(), names_.effects.end());
    tell_chance();
    // Beside something unexplained the noise parameters are those of a stand-in.
    if (!leaves_something()) out_.effects.insert(out_.effects.end(), names_.retuned.begin(), names_.retuned.end());
    out_.dropped = std::move(names_.dropped), out_.remainders = std::move(names_.remainders);
    out_.nominal = found_.seconds.nominal, out_.final = found_.seconds.final;
    out_.fitted_noise = found_.seconds.noise.base;
    out_.chance.threshold_nats = constants().mean_nats;
    out_.total_gain_nats = found_.slow.gain_nats();
    out_.is_noise_retuned = question_.belief.has_believed && !found_.seconds.is_believed;
    out_.is_told_by_held_out = found_.slow.is_told_by_held_out;
    fill_contributions(campaign_, out_.final, out_.final_fit, &out_.effects);
    out_.white_dph = white_of_samples_dph(campaign_, out_.final.noise());
    GapResult& gap = found_.slow.gap;
    gap.minutes.believed_rms_dph =
        gap.minutes.rms_of_noise_dph(question_.belief.has_believed ? question_.belief.model : out_.nominal.noise());
    gap.is_of_starts = are_only_starts();
    out_.exceeds_noise = gap.minutes.exceed_noise(constants());
    // Of a noise nothing but its own scatter may be left.
    out_.leaves_mean = gap.minutes.leave_mean(constants()) ||
                       (tells_noise_alone() && out_.exceeds_noise && gap.minutes.times_expected() > kMoreThanNoise);
    gap.hold_what_minutes_show();
    if (has_names_of_seconds(out_.effects)) {
      gap.gain_of_seconds_by_unit = gain_of_seconds(campaign_, held_out_, out_.nominal, out_.final);
      gap.gain_mean_s = campaign_.dt_s;
    }
    out_.verdict = verdict_of(told(), left());
  }
  bool tells_mean() const { return found_.slow.gap.has_mean || !found_.slow.found.best.steps.empty(); }
  bool tells_noise_alone() const {
    const auto is_noise = [](const SelectedEffect& e) {
      return e.term.estimator && e.term.estimator->form() == Form::kNoise;
    };
    return !tells_mean() && std::any_of(out_.effects.begin(), out_.effects.end(), is_noise);
  }
  // Whether all that is named in the mean is a memory of which the logs show how the runs began, and no more.
  bool are_only_starts() const {
    const auto is_in_mean = [](const SelectedEffect& effect) {
      return effect.term.estimator && effect.term.estimator->is_repeatable();
    };
    const auto is_more = [&](const SelectedEffect& effect) {
      return is_in_mean(effect) && effect.doubt != Doubt::kLoopOpen;
    };
    const std::vector<SelectedEffect>& list = names_.effects;
    return std::any_of(list.begin(), list.end(), is_in_mean) && std::none_of(list.begin(), list.end(), is_more);
  }
  void fit_and_test() {
    SecondsAnswer& seconds = found_.seconds;
    seconds.final.base_noise = seconds.noise.base;
    // Noise terms act on the base; the base was fitted with them in it.
    if (found_.slow.found.best.noise_effect) seconds.final.base_noise = seconds.own_base;
    out_.nominal_fit = fit_hypothesis(campaign_, seconds.nominal);
    out_.before = out_.after = test_rest(campaign_, out_.nominal_fit.e, constants());
    if (held_out_) {
      const Hypothesis foretold = without_jumps(seconds.final);
      place_own_jumps(*found_.slow.held_blocks, foretold, held_out_);
      const Fit fit = fit_hypothesis(*held_out_, foretold);
      measure_own_jumps(fit, held_out_);
      for (const CampaignRun& run : found_.slow.held_blocks->runs)
        if (run.own_strength > 1) out_.stronger_noise.push_back({static_cast<int>(run.input.log), run.own_strength});
      for (const CampaignRun& run : held_out_->runs)
        for (const OwnJump& jump : run.own_jumps)
          out_.own_jumps.push_back(
              {static_cast<int>(run.input.log), time_in_log_s(run, jump.t_s), {jump.size_dph, jump.error_dph}});
      out_.unseen =
          test_unseen(*held_out_, fit.e, innovations_less_hits(*held_out_, foretold.noise(), fit), constants());
    }
    if (is_same_fit(seconds.nominal, seconds.final)) {
      out_.final_fit = out_.nominal_fit;
      return;
    }
    out_.final_fit = fit_hypothesis(campaign_, seconds.final, &seconds.fit.residual);
    out_.after = test_rest(campaign_, out_.final_fit.e, constants());
    const RestFinding hits = hits_in_bursts(campaign_, out_.final_fit.residual, seconds.final.noise(), constants());
    for (RestFinding& f : out_.after)
      if (f.test == hits.test && f.evidence_nats < hits.evidence_nats) f = hits;
  }
  // Where samples are gone because of their size, those that are left are not what the tests expect of noise.
  void forget_tests() {
    for (std::vector<RestFinding>* tests : {&out_.after, &out_.unseen})
      for (RestFinding& f : *tests) f.evidence_nats = std::nan("");
  }
  // An effect of any shape is told in the shape of its parameters that comes nearest, and every figure is of what is told, under
  // the noise of what was found.  What the shape has beyond it is left.
  void tell_parameters() {
    SlowAnswer& slow = found_.slow;
    const SlowModel whole = slow.found.best;
    SlowModel told = slow.search->with_parameters(whole);
    const double beyond_nats = whole.free_score() - told.free_score();
    told.take_noise_of(whole), told.noise_theta = whole.noise_theta;
    slow.found.best = told;
    bool is_other = false;
    for (size_t i = 0; i < whole.names.size(); ++i) {
      const Candidate &any = slow.candidate(whole.names[i].candidate),
                      &member = slow.candidate(told.names[i].candidate);
      if (any.is_member() || !member.is_member()) continue;
      is_other = true;
      const Term term = term_of(member.effect, member.scan.estimator, told.names[i].shape);
      for (Term& of_final : found_.seconds.final.terms)
        if (of_final.estimator == any.scan.estimator) of_final = term;
      for (SelectedEffect& effect : names_.effects)
        if (effect.term.estimator == any.scan.estimator) {
          effect.term = term, effect.is_any_shape = true;
          if (slow.leaves_much(beyond_nats, constants()))
            names_.remainders.push_back({nullptr, any_shape_of(*any.effect), false, any.family(), beyond_nats, 0});
        }
    }
    if (!is_other) return;
    out_.final_fit = fit_hypothesis(campaign_, found_.seconds.final);
    // Noise that jumps: the gap was measured on the logs as they are, and these are without its levels.
    if (!(found_.fast.jumping.gain_nats > 0)) slow.measure();
    slow.gap.is_of_nearest = true;
  }
  // What every effect gained alone: without the jumps in time, if any.
  void scan_told() {
    const SlowAnswer& slow = found_.slow;
    const SlowResult& alone = slow.found.without_steps ? *slow.found.without_steps : slow.found;
    const double null = alone.null.free_score();
    for (size_t j = 0; j < alone.singles.size(); ++j)
      if (slow.candidate(j).effect)
        out_.first_scan.push_back(
            slow.evidence_of(j, std::max(0.0, alone.singles[j].score_nats - null), constants().mean_nats));
    for (const SlowCandidateScore& n : alone.noises)
      if (n.model.noise_effect)
        out_.first_scan.push_back(evidence_for(*n.model.noise_effect,
                                               std::max(0.0, n.score_nats + constants().noise_kind_nats - null),
                                               constants().noise_nats));
  }
  bool fires(const std::vector<RestFinding>& tests) const {
    const auto fires = [](const RestFinding& f) { return f.evidence_nats > 0; };
    return std::any_of(tests.begin(), tests.end(), fires);
  }
  // What gained little beyond the threshold, and loses more where it was not fitted, came by chance: it leaves nothing.
  void tell_chance() {
    for (SelectedEffect& e : names_.dropped)
      e.came_by_chance = e.evidence_nats < constants().lack_nats && e.gain_nats + e.held_out_nats < 0;
  }
  static bool leaves_names(const std::vector<SelectedEffect>& dropped) {
    return !std::all_of(dropped.begin(), dropped.end(), [](const SelectedEffect& e) { return e.came_by_chance; });
  }
  bool leaves_something() const {
    return !names_.remainders.empty() || leaves_names(names_.dropped) || fires(out_.after);
  }

  Told told() const {
    Told told;
    for (const SelectedEffect& e : out_.effects) {
      if (is_note(e, out_.white_dph)) continue;
      told.answer = true;
      told.open_shape |= is_shape_unknown(e);
      told.undecided |= e.doubt == Doubt::kSlowNoise;
      told.cause |= !is_shape_unknown(e) && e.doubt != Doubt::kSlowNoise;
    }
    return told;
  }
  Left left() const {
    const GapResult& gap = found_.slow.gap;
    const MinutesLeft& minutes = gap.minutes;
    Left left;
    left.finding = fires(out_.after) || fires(out_.unseen) || !out_.own_jumps.empty() || !out_.stronger_noise.empty() ||
                   leaves_names(out_.dropped);
    left.shape = !out_.remainders.empty();
    left.minutes = out_.leaves_mean;
    left.are_of_one_passage = gap.method == HeldOut::kQuarters;
    left.growth = tells_mean() && minutes.has_residual() &&
                  minutes.rms_after_dph > (1 + constants().growth_part) * minutes.rms_before_dph;
    left.part = leaves_part(gap);
    return left;
  }
  // What is named as different from run to run is not missed: it is in what is left.
  static bool leaves_part(const GapResult& gap) {
    return gap.has_figure() && gap.ci_hi < kExplainedPart && !(gap.minutes.run_to_run_rms_dph > 0);
  }
  AxisStudy study() {
    SlowAnswer& slow = found_.slow;
    return {std::move(out_), std::move(slow.data), std::move(slow.search), std::move(slow.found), std::move(slow.gap)};
  }

  Campaign& campaign_; // that of the question
  Campaign* held_out_; // the same, or nullptr
  AxisQuestion question_;
  std::function<Thresholds(SlowSearch*)> calibrate_;
  StructureResult structure_;
  Found found_;
  Names names_;
  std::vector<SelectedEffect> structural_;
  Selection out_;
};

} // namespace

AxisStudy study_axis(Campaign* campaign, Campaign* held_out, const NoiseBelief& belief,
                     const std::vector<const Effect*>& library, const std::vector<bool>& active,
                     const SelectOptions& options) {
  return Study(campaign, held_out, belief, library, active, options).run();
}

} // namespace imucal
