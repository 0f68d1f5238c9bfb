// SPDX-License-Identifier: MIT
#include "diagnose/effect_words.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/axis_unit.h"
#include "base/digits.h"
#include "base/units.h"
#include "diagnose/noise_words.h"
#include "diagnose/words.h"

namespace imucal {
namespace {

constexpr double kWideSteps = 2.5; // standard deviations of the noise
constexpr size_t kMostStarts = 5;  // that are told one by one
constexpr int kCostDigits = 2, kSlopePlaces = 50;

const char* doubt_text(Doubt doubt) {
  switch (doubt) {
  case Doubt::kMemberOpen:
    return "the logs tell the family of the cause, but not which member it is";
  case Doubt::kShapeOpen:
    return "a free shape of this family follows the logs more closely than any of its members: the family is told, "
           "its member is open";
  case Doubt::kLoopOpen:
    return "only the states in which the runs began are seen, not a loop: whatever begins anew in every run and "
           "fades looks alike; logs that turn, and go far enough both ways, would tell";
  case Doubt::kSlowNoise:
    return "slow noise and a repeatable cause explain these logs equally well: they cannot tell";
  case Doubt::kAgainst:
    return "held-out data do not support it";
  case Doubt::kNone:
    break;
  }
  return "";
}

// The amplitude is half of the opening, positive where the falling temperature has the higher branch.
std::string loop_in_words(const AxisResult& axis, const SelectedEffect& e) {
  const Parameters values = values_of(axis, e);
  const ParameterValue* amplitude = values.find("amplitude_dph");
  if (!amplitude) return "";
  const Measured& half = amplitude->number;
  const std::string branch =
      std::string("the branch of ") + (half.value < 0 ? "rising" : "falling") + " temperature is higher";
  if (e.only_ratio) return branch;
  return branch + ", by up to " + with_error(2 * std::fabs(half.value), 2 * half.std_error) + " " +
         axis_unit(axis.axis);
}
// Where logs do not turn, or not far enough, a wider loop with as much more amplitude has the same course.
std::string only_slope(const AxisResult& axis, const OnlyRatio& only) {
  const std::string least = only.least_shape > 0 ? ", at least " + in_digits(only.least_shape, 2) + " degC," : "";
  return "only the slope at the entry to a branch is seen, amplitude/width = " +
         with_error(only.ratio.value, only.ratio.std_error) + " " + axis_unit(axis.axis) + "/degC: the width" + least +
         " is not seen in logs that go one way or turn too early, nor is the amplitude; the two told are one pair "
         "of many with that slope";
}

// Logs that began from a smaller start than the amplitude says; empty: all began alike.
std::string starts_in_words(const AxisResult& axis, const StartSizes& sizes) {
  std::vector<std::string> largest, others;
  for (const StartSizes::OfRun& run : sizes.runs) {
    const std::string log = std::to_string(run.log + 1);
    if (run.weight > 0)
      largest.push_back(log);
    else if (others.size() < kMostStarts)
      others.push_back("log " + log + " at " + with_error(run.size.value, run.size.std_error));
  }
  if (others.empty()) return "";
  const bool are_more = sizes.runs.size() > largest.size() + others.size();
  return "the amplitude is that of the start nearest to cold (" + std::string(largest.size() > 1 ? "logs " : "log ") +
         joined(largest, ", ") + "); others began warmer: " + joined(others, ", ") + " " + axis_unit(axis.axis) +
         (are_more ? " and more" : "");
}

} // namespace

// Slow noise that a repeatable cause equals has no evidence of its own: neither gains over the other.
bool has_evidence(const SelectedEffect& e) {
  return e.doubt != Doubt::kSlowNoise;
}

// What was seen, or why the name is not more than it is; empty: nothing beside the name.
std::string statement_of(const SelectedEffect& e) {
  return e.statement.empty() ? doubt_text(e.doubt) : e.statement;
}

bool is_weak(const SelectedEffect& e) {
  return has_evidence(e) && e.evidence_nats < kWeak_nats;
}

// What the numbers mean, where they alone do not say it.
std::string in_words(const AxisResult& axis, const SelectedEffect& e) {
  if (!e.term.effect || e.doubt == Doubt::kSlowNoise) return "";
  const bool is_loop = e.term.effect->estimator() && e.term.effect->estimator()->is_start_bounded();
  if (is_loop) return loop_in_words(axis, e);
  if (e.term.estimator && e.term.estimator->is_nominal_noise())
    return e.term.shape.size() > 1 ? "" // the only process is told by its parameters
                                   : processes_in_words(axis.study.selection.fitted_noise.markov, axis_unit(axis.axis));
  return noise_over_temperature(e.term, axis.campaign);
}

// Advice on what makes a noise follow the temperature is of no use where it hardly does.
std::vector<HardwareCause> hardware_causes_of(const AxisResult& axis, const SelectedEffect& e) {
  if (!e.term.effect || e.doubt == Doubt::kSlowNoise || hardly_follows_temperature(e.term, axis.campaign)) return {};
  return e.term.effect->meaning(values_of(axis, e)).hardware_causes;
}

// In the axis' unit: a tenth of a dph, or three digits of a few mg.
std::string figure(double value, const AxisResult& axis) {
  return format(is_accelerometer(axis.axis) ? "%.3g" : "%.1f", value);
}

bool is_note(const AxisResult& axis, const SelectedEffect& e) {
  return is_note(e, axis.study.selection.white_dph);
}

// As people read: what adds most first (what is not known in dph before it), then other parameters of the believed noise, then
// notes.
std::vector<size_t> reading_order(const AxisResult& axis) {
  const std::vector<SelectedEffect>& effects = axis.study.selection.effects;
  std::vector<size_t> order(effects.size());
  for (size_t i = 0; i < order.size(); ++i) order[i] = i;
  const auto rank = [&](size_t i) {
    const SelectedEffect& e = effects[i];
    const bool is_retuned = e.term.estimator && e.term.estimator->is_nominal_noise();
    return std::make_pair(is_note(axis, e) ? 2 : is_retuned ? 1 : 0, std::isfinite(e.rms_dph) ? -e.rms_dph : -HUGE_VAL);
  };
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) { return rank(a) < rank(b); });
  return order;
}

// Its values; none where it has none of its own.
Parameters values_of(const AxisResult& axis, const SelectedEffect& e) {
  return e.term.effect && e.doubt != Doubt::kSlowNoise ? effect_values(e.term, axis.campaign) : Parameters();
}

bool is_shared_noise(const SelectedEffect& e) {
  return e.term.estimator && e.term.form() == Form::kAxes && !e.statement.empty();
}

namespace {

// What the parameters of shared noise are: not what was measured.
std::string as_simulated(const AxisResult& axis, const SelectedEffect& e) {
  std::string list;
  for (const ParameterValue& p : values_of(axis, e))
    list += (list.empty() ? "" : ", ") + name_in_unit(p.name, axis_unit(axis.axis)) + format(" %.3g", p.number.value);
  return "a simulation gets that from white noise added to each axis: " + list;
}

// What steps do that are wide beside the noise: the mean of a rounded rate goes round it by at most
// (q / pi) exp(-2 pi^2 sigma^2 / q^2), Widrow and Kollar 2008, Quantization Noise, 3.  Below 2.5 sigma that is 0.03 sigma.
std::string of_wide_steps(const AxisResult& axis, const SelectedEffect& e) {
  if (!e.is_structural || !(e.rms_dph > 0)) return "";
  const double step = e.rms_dph * std::sqrt(12.0), white = axis.study.selection.white_dph;
  const double noise2 = std::max(0.0, white * white - e.rms_dph * e.rms_dph);
  if (step < kWideSteps * std::sqrt(noise2)) return "";
  const double curve = step / kPi * std::exp(-2 * kPi * kPi * noise2 / (step * step));
  return format(
      "the steps are wide beside the noise: by themselves they make a curve of up to %s %s over the rate, and noise "
      "that changes with it; what else is told of this axis may be that",
      figure(curve, axis).c_str(), axis_unit(axis.axis));
}
// The most that a rounded temperature takes the polynomial off: half a step where it is steepest.  Not known: no polynomial.
double most_of_half_step_dph(const AxisResult& axis, double step_degc) {
  const Campaign& campaign = axis.campaign;
  const auto n_runs = static_cast<Eigen::Index>(campaign.runs.size());
  if (axis.final_fit.beta.size() < n_runs + campaign.order) return kUnknown;
  ThermalPolynomial bias{campaign.t0_degc, campaign.range_degc, {0}};
  for (int i = 0; i < campaign.order; ++i) bias.coeff_dph.push_back(axis.final_fit.beta[n_runs + i]);
  double most_dph = 0;
  for (int k = 0; k < kSlopePlaces; ++k) {
    const double at_degc = campaign.lo_degc + k * (campaign.hi_degc - campaign.lo_degc) / (kSlopePlaces - 1);
    most_dph = std::max(most_dph, std::fabs(bias.at(at_degc + step_degc / 2) - bias.at(at_degc)));
  }
  return most_dph;
}
// What rounded temperatures cost is no gap of the sensor while the rates do not show it.
std::string steps_of_thermometer(const AxisResult& axis, const SelectedEffect& e) {
  const double most_dph = e.term.shape.empty() ? kUnknown : most_of_half_step_dph(axis, e.term.shape[0]);
  const std::string cost =
      std::isfinite(most_dph) ? ", up to " + in_digits(most_dph, kCostDigits) + " " + axis_unit(axis.axis) + "," : "";
  return "the log shows these steps of the thermometer; what they cost" + cost +
         " hardly shows in the rates more than by chance: no gap";
}

} // namespace

// How sure a name is and what else it may be, a line each: the same in text, JSON and on the page.
std::vector<std::string> remarks_on(const AxisResult& axis, const SelectedEffect& e) {
  std::vector<std::string> out;
  const EffectMeaning meaning = e.term.effect ? e.term.effect->meaning(values_of(axis, e)) : EffectMeaning();
  if (!meaning.remark.empty()) out.push_back(meaning.remark);
  if (are_steps_unfelt(e))
    out.push_back(steps_of_thermometer(axis, e));
  else if (is_weak(e))
    out.push_back("weak evidence, odds of " + in_digits(std::exp(std::max(0.0, e.evidence_nats)), 2) +
                  " to 1: confirm it by another log");
  if (const std::string statement = statement_of(e); !statement.empty()) out.push_back(statement);
  if (is_shared_noise(e)) out.push_back(as_simulated(axis, e));
  if (is_note(axis, e) && !are_steps_unfelt(e))
    out.push_back(format("a small part of the noise: %s of %s %s from second to second",
                         figure(e.rms_dph, axis).c_str(), figure(axis.study.selection.white_dph, axis).c_str(),
                         axis_unit(axis.axis)));
  if (const std::string steps = of_wide_steps(axis, e); !steps.empty()) out.push_back(steps);
  if (e.only_ratio) out.push_back(only_slope(axis, *e.only_ratio));
  if (const std::string starts = starts_in_words(axis, e.start_sizes); !starts.empty()) out.push_back(starts);
  if (e.is_untested) out.push_back("the held-out logs cannot test it");
  if (e.is_of_starts)
    out.push_back(
        "in the held-out logs only the state in which each began is seen, read from that log itself: by the size "
        "told here alone a new log is not foretold, and the gap shrinks by less");
  std::vector<std::string> rivals;
  for (const CandidateEvidence& c : e.set)
    if (name_of(c) != name_of(e) && (!c.effect || c.effect != e.term.effect)) rivals.push_back(name_of(c));
  if (!rivals.empty()) out.push_back("cannot be told from: " + joined(rivals, ", "));
  return out;
}

bool is_noise(const SelectedEffect& e) {
  return e.doubt != Doubt::kSlowNoise && e.term.estimator && e.term.form() == Form::kNoise;
}

bool is_slow_noise(const SelectedEffect& e) {
  return is_noise(e) && e.term.estimator->is_slow_noise();
}

} // namespace imucal
