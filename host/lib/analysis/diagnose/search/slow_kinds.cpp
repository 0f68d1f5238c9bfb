// SPDX-License-Identifier: MIT
#include "analysis/diagnose/search/slow_kinds.h"

#include <algorithm>
#include <cmath>

namespace imucal {

namespace {

constexpr int kProbeEvaluations = 25;
constexpr double kHiddenTau_s = 5; // of a process that white noise may have swallowed

// A kind of noise at the best of these starts.
SlowModel best_with_noise(const SlowLikelihood& of, const std::vector<SlowModel>& starts, const Effect& kind) {
  SlowModel best;
  for (SlowModel with : starts) {
    with.noise_effect = &kind, with.noise_charge = of.space().constants.noise_kind_nats;
    with.value = of.evaluate(with);
    if (with.value > best.value) best = with;
  }
  return best;
}
// The noise of `m` may have swallowed what this kind is.  It then starts like half of the white noise, like the slowest
// process beside what a smaller and faster one leaves, or like that one beside the noise as believed.
SlowModel at_hidden_start(const SlowLikelihood& of, const SlowModel& m, const Effect& kind) {
  SlowModel free = m;
  free.is_believed = false;
  const NoiseModel own = of.base_noise(free);
  if (own.markov.empty()) return {};
  const Theta slow = kind.estimator()->like(slowest(own));
  const double white = own.white_sigma_dph * std::sqrt(0.5);
  const Theta fast = kind.estimator()->like({white / std::sqrt(2 * kHiddenTau_s), kHiddenTau_s});
  if (slow.empty()) return {};
  SlowModel quieter = free, less = free, believed = m;
  quieter.log_noise[0] += std::log(white / own.white_sigma_dph);
  less.drop_swallowed();
  quieter.noise_theta = fast, less.noise_theta = believed.noise_theta = slow;
  if (!of.space().belief.has_believed || of.space().belief.model.markov.empty())
    return best_with_noise(of, {quieter, less}, kind);
  believed.is_believed = true;
  std::fill(believed.log_noise, believed.log_noise + 3, 0.0);
  return best_with_noise(of, {quieter, less, believed}, kind);
}
// Whether a kind of noise beside `m` gains anything after a few evaluations; the start of the rest.
bool is_hopeful(const SlowLikelihood& of, const SlowModel& m, SlowModel* with) {
  for (SlowModel probe : {*with, at_hidden_start(of, m, *with->noise_effect)}) {
    if (!probe.noise_effect) continue;
    probe.is_believed = false;
    polish(of, &probe, kProbeEvaluations);
    if (probe.value > with->value) *with = probe;
  }
  return with->value > m.value;
}
// `m` with the starts of a kind of noise: its own, and where it was found alone or beside other names.
std::vector<SlowModel> noise_starts(const SlowLikelihood& of, const SlowResult& so_far, const SlowModel& m,
                                    const Effect& effect) {
  std::vector<SlowModel> starts;
  for (const Theta& theta : effect.estimator()->starts(of.base_noise(m))) {
    starts.push_back(m);
    starts.back().noise_theta = theta;
  }
  const auto add = [&](const SlowModel& found) {
    if (found.noise_effect != &effect) return;
    starts.push_back(m);
    SlowModel& at = starts.back();
    at.noise_theta = found.noise_theta;
    at.take_noise_of(found);
  };
  for (const SlowCandidateScore& s : so_far.noises) add(s.model);
  add(so_far.best);
  return starts;
}
// Kinds of noise that could be like the best of them, from there: a random walk is the end of a valley of Markov
// processes, along which a search from elsewhere stops.
void start_like_best(const SlowLikelihood& of, const SlowModel& m, std::vector<SlowCandidateScore>* list) {
  const auto best = std::max_element(list->begin(), list->end(),
                                     [](const auto& a, const auto& b) { return a.score_nats < b.score_nats; });
  if (best == list->end() || best->score_nats <= m.free_score()) return;
  const SlowModel from = best->model;
  const NoiseModel base_of_best = of.base_noise(from);
  const NoiseModel all = from.noise_effect->estimator()->noise(base_of_best, from.noise_theta);
  Markov process{all.walk_dph_per_rt_s * std::sqrt(0.5 * of.space().longest_log_s()), of.space().longest_log_s()};
  if (all.markov.size() == base_of_best.markov.size() + 1) process = all.markov.back();
  if (!(process.sigma_dph > 0)) return;
  for (SlowCandidateScore& s : *list) {
    if (!s.model.noise_effect || s.model.noise_effect == from.noise_effect) continue;
    const Theta alike = s.model.noise_effect->estimator()->like(process);
    if (alike.empty()) continue;
    SlowModel with = from;
    with.noise_theta = alike;
    with = best_with_noise(of, {with}, *s.model.noise_effect);
    if (with.value <= s.model.value) continue;
    s.model = polished(of, with, kQuickEvaluations);
    s.score_nats = s.model.free_score();
  }
}

// `m` with the process of its kind of noise in the place of that of the rest: either may be the one that the sensor has.
SlowModel at_process(const SlowLikelihood& of, SlowModel m) {
  const NoiseModel base = of.base_noise(m), all = of.seconds_noise(m);
  if (base.markov.empty() || all.markov.size() != base.markov.size() + 1) return m;
  const Markov &own = of.space().base.markov.front(), &process = all.markov.back();
  m.is_believed = false;
  m.log_noise[0] = std::log(all.white_sigma_dph / of.space().base.white_sigma_dph);
  m.log_noise[1] = std::log(std::pow(process.sigma_dph / own.sigma_dph, 2) * own.tau_s / process.tau_s);
  m.log_noise[2] = std::log(process.tau_s / own.tau_s);
  return m;
}

} // namespace

std::vector<SlowCandidateScore> scan_noises(const SlowLikelihood& of, const SlowResult& so_far, const SlowModel& m,
                                            size_t polish_most) {
  std::vector<SlowCandidateScore> list;
  for (const Effect* effect : of.space().noise_effects) {
    const SlowModel with = best_with_noise(of, noise_starts(of, so_far, m, *effect), *effect);
    list.push_back({with.noise_effect ? with.free_score() : -1e300, with});
  }
  std::vector<size_t> order(list.size());
  for (size_t j = 0; j < order.size(); ++j) order[j] = j;
  std::sort(order.begin(), order.end(), [&](size_t a, size_t b) { return list[a].score_nats > list[b].score_nats; });
  for (size_t i = 0; i < order.size() && i < polish_most; ++i) {
    SlowCandidateScore& s = list[order[i]];
    if (!s.model.noise_effect || !is_hopeful(of, m, &s.model)) continue;
    s.model = polished(of, s.model, kQuickEvaluations);
    s.score_nats = s.model.free_score();
  }
  start_like_best(of, m, &list);
  return list;
}
std::vector<SlowCandidateScore> kinds_beside(const SlowLikelihood& of, const SlowResult& so_far, const SlowModel& m) {
  SlowModel quiet = m;
  quiet.noise_effect = nullptr;
  return scan_noises(of, so_far, polished(of, quiet), of.space().noise_effects.size());
}
SlowModel with_kind(const SlowLikelihood& of, const SlowResult& so_far, const SlowModel& m, const Effect& kind) {
  SlowModel quiet = m;
  quiet.noise_effect = nullptr;
  quiet = polished(of, quiet);
  std::vector<SlowModel> places = {quiet, m, at_process(of, m)};
  if (of.space().belief.has_believed) places.push_back(quiet), places.back().is_believed = true;
  SlowModel best;
  for (const SlowModel& place : places) {
    SlowModel with = best_with_noise(of, noise_starts(of, so_far, place, kind), kind);
    polish(of, &with, kQuickEvaluations);
    if (with.value > best.value) best = with;
  }
  return polished(of, best, kEvaluations);
}
SlowModel in_place_of_base(const SlowLikelihood& of, const SlowModel& m) {
  SlowModel plain = m;
  plain.noise_effect = nullptr;
  const SlowModel with = at_hidden_start(of, polished(of, plain), *m.noise_effect);
  return with.noise_effect ? polished(of, with) : m;
}
SlowModel beside_believed(const SlowLikelihood& of, SlowModel m) {
  m.is_believed = true;
  m.value = -1e300;
  SlowModel best = m;
  for (const Theta& theta : m.noise_effect->estimator()->starts(of.base_noise(m))) {
    m.noise_theta = theta;
    polish(of, &m, kQuickEvaluations);
    if (m.value > best.value) best = m;
  }
  return best;
}

} // namespace imucal
