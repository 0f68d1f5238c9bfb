// SPDX-License-Identifier: MIT
#include "analysis/diagnose/search/search.h"

#include "analysis/diagnose/evidence/free_spectrum.h"
#include "analysis/diagnose/search/cause_search.h"
#include "analysis/diagnose/search/jump_search.h"
#include "analysis/diagnose/search/null_draws.h"
#include "analysis/diagnose/search/slow_judge.h"
#include "analysis/diagnose/search/slow_kinds.h"
#include "analysis/diagnose/search/start_halvings.h"
#include "analysis/diagnose/search/time_jumps.h"

namespace imucal {

struct SlowSearch::Impl {
  SlowSpace space;
  SlowLikelihood likelihood;
  SlowScan scans;
  bool is_prepared = false;
  SlowModel start,
      start_null; // the hypothesis without a name, as fitted first; or with the noise as believed, if that does better
  SlowResult found;

  Impl(const SlowData& data, const NoiseBelief& belief, const std::vector<const Effect*>& library,
       const std::vector<bool>& active, const SelectorConstants& constants, const Campaign* held_out)
      : space(make_slow_space(data, belief, library, active, constants, held_out)), likelihood(space),
        scans(likelihood) {}
  SlowJudge judge() const { return SlowJudge(likelihood, scans, found); }
  // Fits the hypothesis without a name, once.
  void prepare() {
    if (is_prepared) return;
    start = fit_null(likelihood);
    start_null = space.belief.has_believed ? imucal::polished(likelihood, start, kQuickEvaluations) : start;
    is_prepared = true;
  }
};

std::string SlowSearch::null_key(size_t draws, uint64_t seed) const {
  return imucal::null_key(impl_->space, draws, seed);
}
std::vector<double> SlowSearch::null_gains(size_t draws, uint64_t seed) {
  impl_->prepare();
  impl_->scans.make_nodes(impl_->start);
  return imucal::null_gains(impl_->likelihood, impl_->scans.all_nodes(), impl_->start_null, draws, seed);
}
std::vector<double> SlowSearch::gains_under(const SlowModel& noise, size_t draws, uint64_t seed) const {
  impl_->scans.make_nodes(impl_->start); // as null_gains has them, whatever was searched last
  std::vector<const SlowNode*> nodes = impl_->scans.all_nodes();
  const SlowScan::OwnNode own = impl_->scans.node_of(noise);
  nodes.push_back(own.get());
  return imucal::null_gains(impl_->likelihood, nodes, noise, draws, seed);
}
int SlowSearch::start_halvings() {
  impl_->prepare();
  impl_->scans.make_nodes(impl_->start);
  return imucal::start_halvings(impl_->likelihood, impl_->scans, impl_->start_null);
}
void SlowSearch::forget_scans() {
  impl_->scans.forget_white();
}
void SlowSearch::set_thresholds(const Thresholds& thresholds) {
  impl_->space.constants.mean_nats = thresholds.mean.threshold_nats;
  impl_->space.constants.first_step_nats = thresholds.first_step_nats;
}

SlowSearch::SlowSearch(const SlowData& data, const NoiseBelief& belief, const std::vector<const Effect*>& library,
                       const std::vector<bool>& active, const SelectorConstants& constants, const Campaign* held_out)
    : impl_(new Impl(data, belief, library, active, constants, held_out)) {}
SlowSearch::~SlowSearch() = default;
SlowResult SlowSearch::run() {
  impl_->prepare();
  impl_->found = search_with_jumps(impl_->likelihood, &impl_->scans, impl_->start, impl_->start_null);
  return impl_->found;
}
const std::vector<Candidate>& SlowSearch::candidates() const {
  return impl_->space.candidates;
}
NoiseModel SlowSearch::noise_of(const SlowModel& model) const {
  return impl_->likelihood.noise(model);
}
NoiseModel SlowSearch::seconds_noise_of(const SlowModel& model) const {
  return impl_->likelihood.seconds_noise(model);
}
NoiseModel SlowSearch::base_noise_of(const SlowModel& model) const {
  return impl_->likelihood.base_noise(model);
}
std::vector<MeanPart> SlowSearch::parts_on(const SlowData& data, const SlowModel& model) const {
  return impl_->likelihood.parts_on(data, model);
}
double SlowSearch::score(const SlowModel& model) const {
  return impl_->likelihood.score(model);
}
std::vector<SlowResult::Rival> SlowSearch::rivals(const SlowModel& model, size_t name) const {
  return impl_->judge().rivals(model, name);
}
std::vector<SlowCandidateScore> SlowSearch::free_beside(const SlowModel& model, size_t most) const {
  return impl_->judge().free_beside(model, most);
}
std::vector<SlowCandidateScore> SlowSearch::kinds_beside(const SlowModel& model) const {
  return imucal::kinds_beside(impl_->likelihood, impl_->found, model);
}
SlowModel SlowSearch::with_free_spectrum(const SlowModel& model) const {
  return with_kind(impl_->likelihood, impl_->found, model, free_spectrum());
}
SlowModel SlowSearch::with_free_function(const SlowModel& model, const SlowModel& also) const {
  return impl_->judge().with_free_function(model, also);
}
SlowModel SlowSearch::polished(const SlowModel& model) const {
  return imucal::polished(impl_->likelihood, model);
}
double SlowSearch::value_on(const SlowData& all, const SlowModel& model) const {
  return imucal::value_on(impl_->likelihood, all, model);
}
SlowModel SlowSearch::beside_believed(const SlowModel& model) const {
  return imucal::beside_believed(impl_->likelihood, model);
}
SlowModel SlowSearch::in_place_of_base(const SlowModel& model) const {
  return imucal::in_place_of_base(impl_->likelihood, model);
}
bool SlowSearch::has_teeth(const SlowModel& model) const {
  if (model.steps.size() < kFewestTeeth) return false;
  const JumpPattern pattern = pattern_of(impl_->likelihood, model);
  return pattern.go_one_way && pattern.n_followed > 0;
}
RepeatedJumps SlowSearch::repeated_jumps(const SlowModel& model) const {
  return imucal::repeated_jumps(impl_->likelihood, model);
}
SlowModel SlowSearch::with_parameters(const SlowModel& model) const {
  return impl_->judge().with_parameters(model);
}
void SlowSearch::judge_again(SlowResult* result) const {
  result->best = impl_->judge().at_its_best(result->best);
  impl_->judge().judge_names(result);
}
SlowModel SlowSearch::best_with(const std::vector<const Effect*>& effects) const {
  return imucal::best_with(impl_->likelihood, impl_->scans, impl_->found, effects);
}
RunGrams SlowSearch::grams_of(const SlowModel& model) const {
  return impl_->likelihood.grams(model);
}

} // namespace imucal
