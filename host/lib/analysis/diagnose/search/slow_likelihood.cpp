// SPDX-License-Identifier: MIT
#include "analysis/diagnose/search/slow_likelihood.h"

#include <algorithm>
#include <cmath>

#include "analysis/diagnose/logs/blocks.h"

namespace imucal {

namespace {

constexpr size_t kPartsKept = 12, kColumnsKept = 4;

} // namespace

double log_sum_exp(const std::vector<double>& x) {
  const double top = *std::max_element(x.begin(), x.end());
  double sum = 0;
  for (double v : x) sum += std::exp(v - top);
  return top + std::log(sum);
}
double log_mean_exp(const std::vector<double>& x) {
  return log_sum_exp(x) - std::log(static_cast<double>(x.size()));
}

std::vector<const MeanPart*> pointers_of(const std::vector<SlowLikelihood::Part>& list) {
  std::vector<const MeanPart*> pointers;
  for (const SlowLikelihood::Part& part : list) pointers.push_back(part.get());
  return pointers;
}

NoiseModel SlowLikelihood::base_noise(const SlowModel& m) const {
  if (m.is_noise_white) {
    NoiseModel white;
    white.white_sigma_dph = space_.base.white_sigma_dph * std::exp(m.log_noise[0]);
    return white;
  }
  NoiseModel noise = m.is_believed ? space_.belief.model : with_factors(space_.base, m.log_noise);
  // What is searched stays within what the logs can tell; what is believed may be faster than a second.
  const double least_tau_s = m.is_believed ? 0 : std::min(1.0, space_.data.campaign.dt_s);
  for (Markov& markov : noise.markov) markov.tau_s = std::clamp(markov.tau_s, least_tau_s, space_.longest_tau_s);
  return noise;
}
NoiseModel SlowLikelihood::noise(const SlowModel& m) const {
  return block_equivalent(seconds_noise(m), space_.data.campaign.dt_s);
}
NoiseModel SlowLikelihood::seconds_noise(const SlowModel& m) const {
  const NoiseModel plain = base_noise(m);
  return m.noise_effect ? m.noise_effect->estimator()->noise(plain, m.noise_theta) : plain;
}

// Polishing the noise asks for the same columns again and again.
SlowLikelihood::Part SlowLikelihood::part_at(const SlowModel::Name& name) const {
  for (const KeptPart& kept : kept_parts_)
    if (kept.candidate == name.candidate && kept.is_start_only == name.is_start_only && kept.shape == name.shape)
      return kept.part;
  if (kept_parts_.size() < kPartsKept) kept_parts_.emplace_back();
  KeptPart& place = kept_parts_[next_part_++ % kPartsKept];
  place = {name.candidate, name.shape, name.is_start_only,
           std::make_shared<const MeanPart>(part_on(space_.data, name))};
  return place.part;
}
MeanPart SlowLikelihood::part_on(const SlowData& where, const SlowModel::Name& name) const {
  const ScanCandidate& scan = space_.candidates[name.candidate].scan;
  return name.is_start_only ? start_part(where, *scan.estimator, name.shape) : part_of(where, scan, name.shape);
}

std::vector<SlowLikelihood::Part> SlowLikelihood::parts(const SlowModel& m) const {
  SlowModel beside = m;
  beside.names.clear();
  std::vector<Part> list;
  for (MeanPart& part : parts_on(space_.data, beside))
    list.push_back(std::make_shared<const MeanPart>(std::move(part)));
  for (const SlowModel::Name& name : m.names) list.push_back(part_at(name));
  return list;
}
std::vector<MeanPart> SlowLikelihood::parts_on(const SlowData& where, const SlowModel& m) const {
  std::vector<MeanPart> list;
  for (const NoiseBelief::Known& known : space_.belief.known)
    if (!m.is_without_lines || known.estimator->form() != Form::kTone)
      list.push_back(start_part(where, *known.estimator, known.shape));
  if (MeanPart jumps = own_jumps_part(where); jumps.local_precision.size() > 0) list.push_back(std::move(jumps));
  if (!m.steps.empty()) {
    Theta all;
    for (const Theta& step : m.steps) all.insert(all.end(), step.begin(), step.end());
    list.push_back(mean_part(where, *space_.steps, all));
  }
  for (const SlowModel::Name& name : m.names) list.push_back(part_on(where, name));
  return list;
}

// The columns of the last hypotheses: their noise is varied again and again.
SlowLikelihood::Columns SlowLikelihood::columns(const SlowModel& m) const {
  std::vector<Theta> key = m.steps;
  key.push_back({m.is_without_lines ? 1.0 : 0.0});
  for (const SlowModel::Name& name : m.names)
    key.push_back({static_cast<double>(name.candidate), name.is_start_only ? 1.0 : 0.0}), key.push_back(name.shape);
  for (const KeptColumns& kept : kept_columns_)
    if (kept.n_names == m.names.size() && kept.key == key) return kept.columns;
  const std::vector<Part> own = parts(m);
  if (kept_columns_.size() < kColumnsKept) kept_columns_.emplace_back();
  KeptColumns& place = kept_columns_[next_columns_++ % kColumnsKept];
  place = {m.names.size(), key, std::make_shared<const MeanColumns>(space_.data, pointers_of(own))};
  return place.columns;
}

RunGrams SlowLikelihood::grams(const SlowModel& m) const {
  return RunGrams(space_.data, *columns(m), noise(m));
}
double SlowLikelihood::noise_value(const SlowModel& m) const {
  // Another kind of noise beside the believed one is other than believed too.
  if (m.is_believed) return m.noise_effect ? -space_.constants.reestimated_nats : 0;
  return space_.prior.at(m.log_noise) - (space_.belief.has_believed ? space_.constants.reestimated_nats : 0);
}
double SlowLikelihood::evaluate(const SlowModel& m) const {
  for (const SlowModel::Name& name : m.names) {
    const Candidate& c = space_.candidates[name.candidate];
    if (!c.effect) continue;
    const EffectEstimator& e = *c.scan.estimator;
    if (!space_.is_repeated(e, name.shape, c.is_once) || space_.is_of_steps(e, name.shape)) return -1e300;
  }
  const RunGrams grams = this->grams(m);
  if (!are_jumps_seen(m, grams)) return -1e300;
  return grams.log_marginal_any_scale() + noise_value(m);
}
// A relay is on or off where a run begins, so that a start state is its height or nothing.  The start states are free here: where
// the height is not seen, they are what a jump in time, or another cause, leaves to them.
bool SlowLikelihood::are_jumps_seen(const SlowModel& m, const RunGrams& grams) const {
  const auto can_jump = [&](const SlowModel::Name& name) {
    return !name.is_start_only && space_.candidates[name.candidate].scan.estimator->can_jump();
  };
  if (std::none_of(m.names.begin(), m.names.end(), can_jump)) return true;
  const RunGrams::Posterior at = grams.posterior();
  Eigen::Index column = at.common.size(); // names come last
  for (auto name = m.names.rbegin(); name != m.names.rend(); ++name) {
    column -= part_at(*name)->common_precision.size();
    if (!can_jump(*name)) continue;
    if (std::fabs(at.common[column]) <= kSeenErrors * std::sqrt(at.common_covariance(column, column))) return false;
  }
  return true;
}
double SlowLikelihood::score(const SlowModel& m) const {
  return m.free_score() - space_.constants.mean_nats * static_cast<double>(m.names.size()) -
         space_.constants.cost_of_jumps(m.steps.size());
}

} // namespace imucal
