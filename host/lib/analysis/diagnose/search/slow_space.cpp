// SPDX-License-Identifier: MIT
#include "analysis/diagnose/search/slow_space.h"

#include <algorithm>
#include <cmath>

#include "analysis/diagnose/logs/blocks.h"

namespace imucal {

bool SlowSpace::is_repeated(const EffectEstimator& estimator, const Theta& shape, bool with_held_out) const {
  std::vector<const RunInput*> runs;
  for (const CampaignRun& run : data.campaign.runs) runs.push_back(&run.input);
  if (with_held_out)
    for (const CampaignRun& run : held_out->runs) runs.push_back(&run.input);
  return estimator.is_repeated(runs, shape);
}
bool SlowSpace::is_of_steps(const EffectEstimator& estimator, const Theta& shape) const {
  const auto is_about_steps = [](const Candidate& c) { return c.scan.estimator->concerns_coarse_thermometer(); };
  return estimator.is_only_nearby(shape) && std::any_of(candidates.begin(), candidates.end(), is_about_steps);
}

namespace {

constexpr double kUsualTau_s = 300;

void set_noise(SlowSpace* out) {
  SlowSpace& space = *out;
  space.longest_tau_s = std::max(3 * space.data.campaign.longest_s(), 1000.0);
  space.base = space.belief.model;
  if (space.base.markov.empty()) space.base.markov.push_back({space.data.spread_dph, kUsualTau_s});
  if (!(space.base.markov[0].sigma_dph > 0)) space.base.markov[0].sigma_dph = space.data.spread_dph;
  if (space.belief.has_data_sheet) {
    space.prior.sd[0] = 0.7, space.prior.sd[1] = 1.4, space.prior.sd[2] = 1;
    return;
  }
  const double white = white_between_samples(space.data.campaign);
  if (!(space.base.white_sigma_dph > 0)) space.base.white_sigma_dph = std::max(white, 1e-6);
  if (white > 0) space.prior.centre[0] = std::log(white / space.base.white_sigma_dph);
  const Markov& m = space.base.markov[0];
  space.prior.centre[1] = std::log(std::pow(space.data.spread_dph / m.sigma_dph, 2) * m.tau_s / kUsualTau_s);
  space.prior.centre[2] = std::log(kUsualTau_s / m.tau_s);
}
bool can_ask(const Campaign& campaign, const EffectEstimator& estimator) {
  const Form form = estimator.form();
  if (form != Form::kColumns && form != Form::kTemperature && form != Form::kRunRandom) return false;
  if (form == Form::kRunRandom && campaign.runs.size() < 2) return false;
  if (estimator.needs_temperature() && (!campaign.has_temperature || campaign.order < 1)) return false;
  return !(estimator.concerns_coarse_thermometer() && !(campaign.temp_lsb_degc > 0));
}

// A kind of slow noise that the block means can show: Gaussian ones.
bool is_slow_kind(const Campaign& campaign, const NoiseModel& base, const EffectEstimator& e) {
  if (e.form() != Form::kNoise || !e.is_slow_noise() || e.is_nominal_noise()) return false;
  // One run passes each temperature once or twice: noise that follows it cannot be told from noise that changes.
  if (e.needs_temperature() && (!campaign.has_temperature || campaign.runs.size() < 2)) return false;
  const std::vector<Theta> starts = e.starts(base);
  return !starts.empty() && !e.noise(base, starts.front()).is_mixture();
}

std::vector<Theta> at_nearby_lags(const EffectEstimator& estimator, const std::vector<Theta>& grid) {
  std::vector<Theta> out;
  for (double lag_s : estimator.nearby_lags_s())
    for (Theta shape : grid) {
      shape.push_back(lag_s);
      out.push_back(shape);
    }
  return out;
}
std::vector<Theta> shapes_of(const SlowSpace& space, const Candidate& candidate) {
  const EffectEstimator& estimator = *candidate.scan.estimator;
  const RunInput& run = space.data.campaign.runs.front().input;
  if (estimator.form() == Form::kRunRandom) return {{space.data.spread_dph}};
  std::vector<Theta> grid = estimator.grid_on(run, space.data.campaign.lo_degc, space.data.campaign.hi_degc);
  if (estimator.concerns_coarse_thermometer()) grid = {{space.data.campaign.temp_lsb_degc}};
  if (estimator.is_near_thermometer()) grid = at_nearby_lags(estimator, grid);
  const auto is_out = [&](const Theta& at) {
    return !space.is_repeated(estimator, at, candidate.is_once) ||
           (candidate.is_once && space.is_repeated(estimator, at, false));
  };
  grid.erase(std::remove_if(grid.begin(), grid.end(), is_out), grid.end());
  return grid;
}
// A candidate with all of its shapes, where it has any.
void add_candidate(Candidate candidate, SlowSpace* space) {
  candidate.scan.shapes = shapes_of(*space, candidate);
  if (!candidate.scan.shapes.empty()) space->candidates.push_back(std::move(candidate));
}
// Shapes that do the same as the steps of a coarse thermometer are left to these, where they are asked.
void drop_shapes_of_steps(SlowSpace* space) {
  for (Candidate& c : space->candidates) {
    const auto is_of_steps = [&](const Theta& at) { return space->is_of_steps(*c.scan.estimator, at); };
    c.scan.shapes.erase(std::remove_if(c.scan.shapes.begin(), c.scan.shapes.end(), is_of_steps), c.scan.shapes.end());
  }
}
void add_effects(const std::vector<const Effect*>& library, const std::vector<bool>& active, SlowSpace* out) {
  SlowSpace& space = *out;
  const Campaign& campaign = space.data.campaign;
  for (size_t j = 0; j < library.size(); ++j) {
    const EffectEstimator* estimator = library[j]->estimator();
    if (estimator && estimator->form() == Form::kSteps) space.steps = active[j] ? estimator : nullptr;
    if (!estimator || !active[j]) continue;
    if (is_slow_kind(campaign, space.base, *estimator)) space.noise_effects.push_back(library[j]);
    if (!can_ask(campaign, *estimator)) continue;
    Candidate c;
    c.effect = library[j], c.place = j;
    c.scan.estimator = estimator;
    add_candidate(c, &space);
    // Several logs pass nearly every temperature more than once.
    if (space.held_out && campaign.runs.size() == 1 && estimator->can_jump()) {
      Candidate once = c;
      once.is_once = true;
      add_candidate(once, &space);
    }
    if (const Reference* any = any_shape_of(*library[j])) {
      Candidate other = c;
      other.is_any_shape = true;
      other.scan = any->candidate;
      add_candidate(other, &space);
    }
  }
  drop_shapes_of_steps(&space);
}
// Free shapes that the campaign can hold.
void add_free_shapes(SlowSpace* out) {
  SlowSpace& space = *out;
  const Campaign& campaign = space.data.campaign;
  for (size_t j = 0; j < free_shapes().size(); ++j) {
    const Reference& free = free_shapes()[j];
    // In one run anything is a function of the time.
    if (!can_ask(campaign, *free.candidate.estimator) ||
        (free.family == Family::kFunctionOfTime && campaign.runs.size() < 2))
      continue;
    Candidate c;
    c.reference = &free, c.place = j, c.scan = free.candidate;
    c.scan.shapes = {{space.longest_log_s()}};
    space.candidates.push_back(std::move(c));
  }
}
// The free function of everything that repeats: no scan asks it.
void add_free_function(SlowSpace* out) {
  SlowSpace& space = *out;
  const Campaign& campaign = space.data.campaign;
  if (!campaign.has_temperature || campaign.order < 1) return;
  Candidate all;
  all.is_free_function = true;
  all.reference = &free_function(campaign.runs.size() > 1);
  all.scan = all.reference->candidate;
  all.scan.shapes = free_function_shapes(campaign, space.longest_log_s());
  space.candidates.push_back(std::move(all));
}

} // namespace

SlowSpace make_slow_space(const SlowData& data, const NoiseBelief& belief, const std::vector<const Effect*>& library,
                          const std::vector<bool>& active, const SelectorConstants& constants,
                          const Campaign* held_out) {
  SlowSpace space{data, belief, constants, held_out};
  set_noise(&space);
  add_effects(library, active, &space);
  add_free_shapes(&space);
  std::vector<ScanCandidate> scans;
  for (const Candidate& c : space.candidates) scans.push_back(c.scan);
  space.bank.reset(new ScanBank(data, scans));
  add_free_function(&space);
  return space;
}

} // namespace imucal
