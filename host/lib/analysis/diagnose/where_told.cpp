// SPDX-License-Identifier: MIT
#include "analysis/diagnose/where_told.h"

#include <algorithm>

#include "analysis/diagnose/judge/contribution.h"

namespace imucal {

using Eigen::VectorXd;

namespace {

bool names_noise(const SelectedEffect& e) {
  return e.doubt == Doubt::kSlowNoise || (e.term.estimator && e.term.form() == Form::kNoise);
}
bool names_slow_noise(const SelectedEffect& e) {
  return e.doubt == Doubt::kSlowNoise || (names_noise(e) && e.term.estimator->is_slow_noise());
}
bool adds_to_mean(const SelectedEffect& e) {
  return !e.is_structural && !names_noise(e);
}
bool any_named(const std::vector<SelectedEffect>& effects, bool (*is)(const SelectedEffect&)) {
  return std::any_of(effects.begin(), effects.end(), is);
}

// Slow noise that is the same at all times and temperatures, or may be; what structure shows is beside it.
bool is_noise_everywhere(const std::vector<SelectedEffect>& effects) {
  const auto is_asked = [](const SelectedEffect& e) { return !e.is_structural; };
  const auto has_place = [](const SelectedEffect& e) {
    return !e.is_structural &&
           (!names_slow_noise(e) || (e.doubt != Doubt::kSlowNoise && e.term.estimator->needs_temperature()));
  };
  return any_named(effects, is_asked) && !any_named(effects, has_place);
}

// Noise that was believed wrongly shows where the belief is wrong, and noise that was estimated with a cause in it holds the
// cause: a cause shows over the noise that was found beside it.
bool is_over_found_noise(const AxisResult& axis) {
  const Selection& s = axis.study.selection;
  const auto is_cause = [](const SelectedEffect& e) { return !e.is_structural && !names_slow_noise(e); };
  return axis.is_believed ? s.is_noise_retuned && any_named(s.effects, adds_to_mean) : any_named(s.effects, is_cause);
}

// A jump changes the level of all that follows: its place is where it jumps.
std::vector<VectorXd> only_jumps(std::vector<VectorXd> level) {
  for (VectorXd& run : level) {
    const long n = run.size();
    if (n > 1) run.tail(n - 1) = (run.tail(n - 1) - run.head(n - 1)).eval();
    if (n > 0) run[0] = 0;
  }
  return level;
}

// What the names add to the mean, by the noise.
std::vector<VectorXd> place_of_added(const AxisResult& axis, const NoiseModel& noise) {
  const Selection& s = axis.study.selection;
  std::vector<VectorXd> added = added_to_mean(axis.campaign, s.final, axis.final_fit);
  const auto is_smooth = [](const SelectedEffect& e) {
    return adds_to_mean(e) && !(e.term.estimator && e.term.estimator->can_jump());
  };
  if (!any_named(s.effects, is_smooth)) return only_jumps(std::move(added));
  return whitened(axis.campaign.runs, noise, std::move(added));
}

// The jumps in time, where beside them nothing but other parameters of the noise is named.
std::vector<StepValue> lone_jumps(const AxisResult& axis) {
  const std::vector<CampaignRun>& runs = axis.campaign.runs;
  std::vector<StepValue> out;
  for (const SelectedEffect& e : axis.study.selection.effects) {
    const bool is_noise = e.term.estimator && e.term.form() == Form::kNoise;
    if (e.is_structural || (is_noise && e.term.estimator->is_nominal_noise())) continue;
    if (!e.term.effect || e.doubt == Doubt::kSlowNoise || e.term.form() != Form::kSteps) return {};
    for (size_t i = 0; i + 1 < e.term.shape.size(); i += 2) {
      const CampaignRun& run = runs[static_cast<size_t>(e.term.shape[i])];
      out.push_back({static_cast<int>(run.input.log), time_in_log_s(run, e.term.shape[i + 1]), {}});
    }
  }
  return out;
}

} // namespace

WhereResult where_told(const AxisResult& axis) {
  const Selection& s = axis.study.selection;
  Hypothesis nominal = s.nominal;
  WhoseNoise whose = axis.is_believed ? WhoseNoise::kModel : WhoseNoise::kEstimated;
  Fit refitted;
  const Fit* fit = &axis.nominal_fit;
  if (is_over_found_noise(axis)) {
    whose = WhoseNoise::kFound, nominal.base_noise = s.fitted_noise;
    refitted = fit_hypothesis(axis.campaign, nominal), fit = &refitted;
  }
  NamedCause cause;
  cause.has_place = !is_noise_everywhere(s.effects);
  cause.has_times = whose != WhoseNoise::kEstimated || any_named(s.effects, names_slow_noise);
  if (any_named(s.effects, adds_to_mean)) cause.added = place_of_added(axis, gaussian_equivalent(nominal.noise()));
  cause.jumps = lone_jumps(axis);
  return locate(axis.campaign, *fit, whose, cause);
}

} // namespace imucal
