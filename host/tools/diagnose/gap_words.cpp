// SPDX-License-Identifier: MIT
#include "diagnose/gap_words.h"

#include <algorithm>
#include <cmath>

#include "base/axis_unit.h"
#include "base/digits.h"
#include "diagnose/effect_words.h"
#include "diagnose/words.h"

namespace imucal {
namespace {

constexpr double kNearlyAll = 0.95;   // a shrinkage that surely stays below leaves something
constexpr double kScaleEnd = -0.995;  // a shrinkage is not told below -100 %
constexpr double kOtherFigure = 0.05; // of a shrinkage
constexpr double kMuchOfGap = 0.5, kHardlyLess = 0.95;
constexpr double kSeldom = 0.025; // of such logs, on either side

template <typename Is> bool finds(const Selection& s, const Is& is) {
  return std::any_of(s.effects.begin(), s.effects.end(), is);
}

} // namespace

const char* rest_text(Rest test) {
  static const char* const texts[] = {"noise of another spectrum than the model's",
                                      "noise of a strength that depends on temperature",
                                      "noise of a strength that changes with time",
                                      "noise that is not Gaussian",
                                      "noise that comes in bursts",
                                      "a line in the spectrum",
                                      "sudden changes of the bias"};
  return texts[static_cast<size_t>(test)];
}

const char* held_out_text(HeldOut method) {
  return method == HeldOut::kLogs      ? "held-out logs"
         : method == HeldOut::kEachLog ? "each log held out in turn"
                                       : "quarters of the one log held out in turn, each with a constant of its own";
}

// Jumps in time, one after the other.
std::string steps_text(const std::vector<StepValue>& steps, bool tells_log, const char* unit) {
  std::string out;
  for (const StepValue& step : steps) {
    char line[120];
    const Measured& size = step.amplitude_dph;
    out += out.empty() ? "" : ", ";
    out += (size.value >= 0 ? "+" : "") + with_error(size.value, size.std_error);
    std::snprintf(line, sizeof line, " %s at %.10g s", unit, step.t_s), out += line;
    if (tells_log) out += " of log " + std::to_string(step.log + 1);
  }
  return out;
}

namespace {

// What the fit gets wrong in other logs is worth a word beside the noise.
bool has_errors_of_fit(const GapResult& g) {
  return g.minutes.fit_ms_dph2 > 0.1 * g.minutes.noise_rms_dph * g.minutes.noise_rms_dph;
}

// What such a test sees is what is named, or more of it.
bool stands_for(const SelectedEffect& e, Rest test) {
  if (!e.term.estimator) return test == Rest::kSpectrum && e.family == Family::kSlowNoise;
  const EffectEstimator& effect = *e.term.estimator;
  const bool is_noise = effect.form() == Form::kNoise;
  switch (test) {
  case Rest::kSpectrum:
    return e.family == Family::kSlowNoise || (is_noise && effect.is_slow_noise());
  case Rest::kVarianceOverTemperature:
  case Rest::kVarianceOverTime:
    return is_noise && effect.needs_temperature();
  case Rest::kDistribution:
  case Rest::kBursts:
    return is_noise && !effect.is_slow_noise() && !effect.needs_temperature() && !effect.is_nominal_noise();
  case Rest::kSuddenChanges:
    return effect.form() == Form::kSteps || effect.is_jumping();
  case Rest::kLine:
    return effect.form() == Form::kTone;
  case Rest::kCount:
    break;
  }
  return false;
}

} // namespace

namespace {

// Of minutes that lie further from the predicted mean than before: by what is named, or by the polynomial beside slow noise,
// which was bent by that.
std::string further_text(const GapResult& g) {
  const std::vector<double>& by_name = g.foretold.growth;
  const bool is_nearer =
      !by_name.empty() && std::all_of(by_name.begin(), by_name.end(), [](double growth) { return growth < 1; });
  if (is_nearer && g.minutes.is_before_least_squares)
    return "a polynomial of least squares alone is nearer to the held-out rates, since slow noise bends the one beside "
           "it; what is named brings that one nearer";
  return std::string("the predicted mean is further from the held-out rates than before") +
         (g.has_figure() ? "" : ", as far as their noise tells");
}

} // namespace

// What is left, in sentences.
std::string remainder(const AxisResult& axis) {
  const Selection& s = axis.study.selection;
  const GapResult& g = axis.study.gap;
  std::vector<std::string> said;
  const auto add = [&](const std::string& text) { add_once(text, &said); };
  std::vector<std::string> rejected; // names that were taken back: they stand for something else
  for (const CandidateEvidence& c : s.remainders)
    if (c.reference)
      add(std::string(c.reference->what) + " would follow the logs more closely");
    else
      add_once(name_of(c), &rejected);
  for (const SelectedEffect& e : s.dropped)
    if (!e.came_by_chance) add("what " + name_of(e) + " took in the fitted logs and held-out data do not support");
  std::vector<std::string> more;
  for (const RestFinding& f : s.after)
    if (f.evidence_nats > 0 && !finds(s, [&](const SelectedEffect& e) { return stands_for(e, f.test); }))
      add(rest_text(f.test));
    else if (f.evidence_nats > 0)
      more.push_back(rest_text(f.test));
  if (!more.empty()) add("more of the kind that was found: " + joined(more, ", "));
  std::vector<std::string> unseen;
  for (const RestFinding& f : s.unseen)
    if (f.evidence_nats > 0) unseen.push_back(rest_text(f.test));
  if (!unseen.empty()) add("in the held-out logs alone: " + joined(unseen, ", "));
  if (g.minutes.run_to_run_rms_dph > 0)
    add(format("what differs from run to run, %s %s", figure(g.minutes.run_to_run_rms_dph, axis).c_str(),
               axis_unit(axis.axis)));
  if (!s.own_jumps.empty()) add("jumps in time that held-out logs have of their own");
  for (const SelectedEffect& e : s.effects)
    if (e.doubt == Doubt::kShapeOpen)
      add("the shape is open: " + family_label(e.family));
    else if (e.doubt == Doubt::kLoopOpen)
      add("what the states in which the runs began belong to is open: " + family_label(e.family));
  if (g.has_mean && g.minutes.has_residual() && g.minutes.rms_after_dph > 1.1 * g.minutes.rms_before_dph)
    add(further_text(g));
  for (const Selection::Strength& noise : s.stronger_noise)
    add(format("the noise of held-out log %d is %.1f times as strong as that of the fitted logs", noise.log + 1,
               noise.times));
  if (s.leaves_mean || (s.exceeds_noise && g.minutes.times_expected() > kMoreThanNoise))
    add(format("the held-out residual is %.1f times what %s would leave", g.minutes.times_expected(),
               has_errors_of_fit(g) ? "noise and errors of the fit" : "the noise alone"));
  if (s.verdict != Verdict::kUnexplained && g.has_figure() && g.ci_hi < kNearlyAll)
    add(format("%.0f %% of the gap on data that were not fitted", 100 * (1 - g.shrinkage)));
  if (!g.has_mean &&
      finds(s, [](const SelectedEffect& e) { return e.term.estimator && e.term.form() == Form::kSteps; }))
    add("jumps at single moments predict no other data");
  if (!g.has_mean && finds(s, is_noise)) add("a noise has no mean to predict");
  if (!rejected.empty() && said.empty()) return "considered and rejected: " + joined(rejected, ", ");
  if (!rejected.empty()) return joined(said, "; ") + ".  Considered and rejected: " + joined(rejected, ", ");
  return said.empty() ? "nothing detectable on the held-out data" : joined(said, "; ");
}

namespace {

// What is named is of the mean of other data, not of their noise alone.
bool names_mean(const Selection& s) {
  return std::any_of(s.effects.begin(), s.effects.end(), [&](const SelectedEffect& e) {
    if (is_note(e, s.white_dph)) return false;
    return !e.term.effect || (e.term.form() != Form::kNoise && e.term.form() != Form::kSteps &&
                              e.term.form() != Form::kStructural && e.term.form() != Form::kAxes);
  });
}

bool claims_shrinkage(const AxisResult& axis) {
  const Selection& s = axis.study.selection;
  const bool has_gap = s.verdict == Verdict::kExplained || s.verdict == Verdict::kPartlyExplained;
  return has_gap && axis.study.gap.has_mean && names_mean(s);
}

} // namespace

bool has_figure(const AxisResult& axis) {
  return claims_shrinkage(axis) && axis.study.gap.has_figure();
}

// What a stand-in removes; a figure of which the residual says the contrary is none.
bool has_stand_in(const AxisResult& axis) {
  const GapResult& g = axis.study.gap;
  const bool is_contradicted = g.shrinkage > 0 && g.minutes.rms_after_dph > g.minutes.rms_before_dph;
  return axis.study.selection.verdict == Verdict::kUnexplained && g.has_figure() && !is_contradicted;
}

namespace {

std::string stand_in_does(double shrinkage) {
  if (shrinkage >= 0) return format("removes %.0f %% of the gap", 100 * shrinkage);
  if (shrinkage <= kScaleEnd) return "makes the gap more than 100 % worse";
  return format("makes the gap %.0f %% worse", -100 * shrinkage);
}

// What the residuals are means of.
std::string means_text(const GapResult& gap) {
  return std::lround(gap.minutes.minute_s) == 60 ? "one-minute means"
                                                 : format("means over %.0f s", gap.minutes.minute_s);
}

// Much of the gap goes, and the means show nothing of it: it was within them, as what the steps of a thermometer make.
bool is_within_means(const GapResult& g) {
  return g.has_figure() && g.shrinkage > kMuchOfGap && g.minutes.rms_after_dph > kHardlyLess * g.minutes.rms_before_dph;
}

// The noise with which these means are to be compared, and what errors of the fit add to it.  One fit errs once: by how much
// may be far from what is expected, and surely no more than is left.
std::string expected_text(const AxisResult& axis) {
  const GapResult& g = axis.study.gap;
  std::string out =
      std::string(finds(axis.study.selection, is_slow_noise) ? "noise with the slow noise found " : "noise alone ") +
      figure(g.minutes.noise_rms_dph, axis);
  if (!has_errors_of_fit(g)) return out;
  const double errors_dph = std::sqrt(g.minutes.fit_ms_dph2);
  if (errors_dph < g.minutes.rms_after_dph) return out + ", errors of the fit " + figure(errors_dph, axis);
  return out + ", the rest no more than errors of the fit (" + figure(errors_dph, axis) + " expected)";
}

// What the means of one draw of noise and errors show, where that is another figure than what their likelihood tells.
std::string shown_by_means(const GapResult& g) {
  const double shown = 1 - g.minutes.part_left();
  if (std::fabs(shown - g.shrinkage) < kOtherFigure || is_within_means(g)) return "";
  return format(" (%.0f %% %s above the noise)", 100 * std::fabs(shown), shown < 0 ? "more" : "less");
}

// What the noise that was found leaves, and how far that scatters in logs that are so short.
std::string found_noise_text(const AxisResult& axis) {
  const MinutesLeft& minutes = axis.study.gap.minutes;
  const double expected_dph = std::sqrt(minutes.expected_ms_dph2());
  const auto of_chance = [&](double p) {
    return figure(expected_dph * std::sqrt(minutes.times_square_by_chance(p)), axis);
  };
  std::string out = std::string(has_errors_of_fit(axis.study.gap) ? "and errors of the fit " : "") +
                    figure(expected_dph, axis) + " is expected";
  if (std::isnan(minutes.times_square_by_chance(0.5))) return out;
  return out + ", " + of_chance(kSeldom) + " to " + of_chance(1 - kSeldom) + " in 95 of 100 such logs";
}
// Slow noise that was found beside the noise that was believed.
std::string noise_statement(const AxisResult& axis) {
  const GapResult& g = axis.study.gap;
  if (g.has_mean || !finds(axis.study.selection, is_slow_noise)) return "";
  return format("%s: %s would leave %s %s, these logs show %s; with the noise that was found %s", means_text(g).c_str(),
                axis.is_believed ? "the believed noise" : "the noise that was estimated without a cause",
                figure(g.minutes.believed_rms_dph, axis).c_str(), axis_unit(axis.axis),
                figure(g.minutes.rms_after_dph, axis).c_str(), found_noise_text(axis).c_str());
}

} // namespace

namespace {

// Why there is no figure where nothing that is named foretells the mean of other data.
std::string no_mean_statement(const AxisResult& axis) {
  const Selection& s = axis.study.selection;
  const GapResult& g = axis.study.gap;
  if (s.verdict == Verdict::kNoGap) return "";
  const auto has_form = [&](Form form) {
    return finds(s, [&](const SelectedEffect& e) { return e.term.estimator && e.term.form() == form; });
  };
  std::vector<std::string> why;
  if (has_form(Form::kTone)) why.push_back("a tone has a phase of its own in every log");
  if (has_form(Form::kSteps)) why.push_back("jumps in time are of their logs alone");
  if (finds(s, is_noise) || has_form(Form::kAxes))
    why.push_back("noise predicts how far rates scatter, not where they are");
  if (finds(s, [](const SelectedEffect& e) { return e.is_structural; }))
    why.push_back("what was done to the samples is no part of the mean");
  if (why.empty()) why.push_back("nothing is named that predicts the mean of other data");
  std::string out = "how far the gap shrinks is not known: " + joined(why, ", ");
  if (g.is_gain_of_seconds())
    out += format("; the held-out seconds are %s by %.3g nats in %.2g h", g.gain() < 0 ? "less likely" : "likelier",
                  0.5 * std::fabs(g.gain()) * g.foretold.hours, g.foretold.hours);
  const std::string noise = noise_statement(axis);
  return noise.empty() ? out : out + "; " + noise;
}

} // namespace

// How far the gap shrinks on data that were not fitted, or why that is not known; empty: not asked.
std::string held_out_statement(const AxisResult& axis) {
  const GapResult& g = axis.study.gap;
  if (!g.minutes.has_residual())
    return axis.study.selection.verdict == Verdict::kNoGap
               ? ""
               : "how far the gap shrinks is not known: no rates at temperatures that were fitted (" +
                     std::string(held_out_text(g.method)) + ")";
  const std::string residual =
      format("residual of %s %s -> %s %s%s, %s", means_text(g).c_str(), figure(g.minutes.rms_before_dph, axis).c_str(),
             figure(g.minutes.rms_after_dph, axis).c_str(), axis_unit(axis.axis),
             has_figure(axis) ? shown_by_means(g).c_str() : "", expected_text(axis).c_str()) +
      (g.minutes.run_to_run_rms_dph > 0
           ? format(", what differs from run to run %s", figure(g.minutes.run_to_run_rms_dph, axis).c_str())
           : "") +
      (is_within_means(g) ? "; the gap lies within these means, which hardly show it" : "");
  if (axis.study.selection.verdict == Verdict::kUnexplained && g.has_figure())
    return format("a flexible stand-in%s %s: not an explanation; %s",
                  axis.study.selection.effects.empty() ? "" : " of that family",
                  has_stand_in(axis) ? stand_in_does(g.shrinkage).c_str() : "leaves more than before",
                  residual.c_str());
  if (!g.has_mean && g.minutes.run_to_run_rms_dph > 0)
    return "how far the gap shrinks is not known: what differs from run to run predicts no other run; " + residual;
  if (!claims_shrinkage(axis)) return no_mean_statement(axis);
  if (g.is_of_starts)
    return format("how far the gap shrinks is not known: only the states in which the runs began are seen, and these "
                  "predict nothing (%s); %s",
                  held_out_text(g.method), residual.c_str());
  if (g.is_of_nearest)
    return format("how far the gap shrinks is not known: what the nearest shape with parameters gets wrong is not "
                  "known well enough (%s); %s",
                  held_out_text(g.method), residual.c_str());
  if (!g.has_figure())
    return format("how far the gap shrinks is hidden by noise (95 %%: %.0f to %.0f %%; %s); %s", 100 * g.ci_lo,
                  100 * g.ci_hi, held_out_text(g.method), residual.c_str());
  if (g.ci_hi <= kScaleEnd)
    return format("the gap grows by more than 100 %% (%s); %s", held_out_text(g.method), residual.c_str());
  return format("the gap %s by %.0f %% (95 %%: %.0f to %.0f; %s); %s", g.shrinkage < 0 ? "grows" : "shrinks",
                100 * std::fabs(g.shrinkage), 100 * (g.shrinkage < 0 ? -g.ci_hi : g.ci_lo),
                100 * (g.shrinkage < 0 ? -g.ci_lo : g.ci_hi), held_out_text(g.method), residual.c_str());
}

} // namespace imucal
