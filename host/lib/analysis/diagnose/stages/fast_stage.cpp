// SPDX-License-Identifier: MIT
#include "analysis/diagnose/stages/fast_stage.h"
#include "analysis/diagnose/stages/rest.h"

#include <algorithm>
#include <optional>

namespace imucal {

Term term_of(const FastFinding& finding) {
  Term term = term_of(finding.effect, finding.effect->estimator(), finding.theta);
  term.shape_errors = finding.theta_errors;
  return term;
}

namespace {

// Block means found no kind of slow noise: where the spectrum of the seconds does not fit theirs, the seconds are asked.
bool may_ask_slow_noise(const Found& found) {
  const SlowModel& best = found.slow.found.best;
  return !best.noise_effect && best.steps.empty();
}
void drop_hits_that_stay(const AxisQuestion& question, const SecondsAnswer& seconds, FastScan* scan) {
  std::vector<FastFinding>& list = scan->findings;
  const auto stays = [&](const FastFinding& f) {
    const NoiseModel noise = f.noise();
    return noise.hit_probability > 0 &&
           do_hits_stay(question.campaign, seconds.fit.residual, noise, question.constants);
  };
  list.erase(std::remove_if(list.begin(), list.end(), stays), list.end());
}

// Where hits stand out, the noise that swallows them is not what it is without them; nor, mostly, what was believed.
void give_back_hits(const AxisQuestion& question, SecondsAnswer* seconds) {
  if (!seconds->hits) return;
  const double as_believed = ResidualLikelihood(question.campaign, seconds->fit.residual)(seconds->noise.base);
  const SecondsNoise with = fit_seconds_noise(question.campaign, seconds->noise.base, seconds->fit.residual);
  seconds->hits->beside = seconds->noise;
  if (seconds->is_believed) {
    seconds->retuned_nats = with.log_likelihood - as_believed;
    seconds->is_believed = !(seconds->retuned_nats > question.constants.retuned_nats);
  }
  seconds->noise = with;
}
// The noise of the seconds where a better one was found; the believed one stays.
void take_plain(const AxisQuestion& question, const SecondsNoise& plain, SecondsAnswer* seconds) {
  if (seconds->is_believed) return;
  if (question.belief.has_believed) seconds->retuned_nats += plain.log_likelihood - seconds->noise.log_likelihood;
  seconds->noise = plain;
}

// Kinds that may be there beside the best; where that has hits which stand out, of what is left without them.
std::vector<FastFinding> kinds_beside_best(const AxisQuestion& question, const Found& found) {
  const FastFinding& best = found.fast.scan.findings.front();
  const std::optional<StandingOut>& hits = found.seconds.hits;
  if (!hits || !(best.noise().hit_probability > 0)) return found.fast.scan.findings;
  return scan_fast_noise(question.campaign, hits->beside, hits->left, question.library, question.active,
                         question.constants)
      .findings;
}
// A single kind may pass for two: hits, and a white noise that follows the temperature.
void ask_second(const AxisQuestion& question, Found* found) {
  if (!found->fast.best(question.constants)) return;
  std::vector<FastFinding>& list = found->fast.scan.findings;
  const auto is_fast = [](const FastFinding& f) {
    return f.effect->family() == Family::kFastNoise && !f.effect->estimator()->is_jumping();
  };
  if (!is_fast(list.front())) return;
  std::vector<FastFinding> rest = kinds_beside_best(question, *found);
  const auto is_none = [&](const FastFinding& f) { return f.effect == list.front().effect || !is_fast(f); };
  rest.erase(std::remove_if(rest.begin(), rest.end(), is_none), rest.end());
  found->fast.second = second_kind(ResidualLikelihood(question.campaign, found->seconds.fit.residual),
                                   !found->seconds.is_believed, rest, question.constants.fast_nats, &list.front());
}

// Whether the believed noise holds was asked while hits, or a white noise that follows the temperature, passed for a part
// of it: it is asked again beside them.  Returns whether it holds there.
bool believe_beside(const AxisQuestion& question, Found* found) {
  SecondsAnswer& seconds = found->seconds;
  if (!question.belief.has_believed || seconds.is_believed || !found->fast.best(question.constants)) return false;
  FastFinding& best = found->fast.scan.findings.front();
  if (best.effect->estimator()->is_jumping()) return false;
  const ResidualLikelihood log_likelihood(question.campaign, seconds.fit.residual);
  FastFinding refitted = best, believed = best;
  believed.base = believed_noise(*found->slow.search, found->slow.found.best);
  seconds.retuned_nats = fit_again(log_likelihood, true, &refitted) - fit_again(log_likelihood, false, &believed);
  if (seconds.retuned_nats > question.constants.retuned_nats) return false;
  best = believed;
  if (found->fast.second.effect) found->fast.second.base = best.base;
  seconds.is_believed = found->slow.found.best.is_believed = true;
  return true;
}

void add_terms(const FastAnswer& fast, const FastFinding& best, Hypothesis* h) {
  h->terms.push_back(term_of(best));
  if (fast.second.effect) h->terms.push_back(term_of(fast.second));
}

// What the fast noise explains better than a kind of slow noise takes its place.  `holds_beside`: the believed noise does
// beside it; else the noise is estimated there.
void take_best(const AxisQuestion& question, bool holds_beside, Found* found) {
  const FastFinding* best = found->fast.best(question.constants);
  if (!best) return;
  SecondsAnswer& seconds = found->seconds;
  const ResidualLikelihood log_likelihood(question.campaign, seconds.fit.residual);
  set_errors(log_likelihood, &found->fast.scan.findings.front());
  if (found->fast.second.effect) set_errors(log_likelihood, &found->fast.second);
  seconds.noise.base = best->base;
  if (holds_beside)
    fit_own_base(question, found->slow, &seconds);
  else if (found->slow.found.best.noise_effect)
    fit_own_base_beside([best](const NoiseModel& base) { return best->noise_on(base); }, question, found->slow,
                        &seconds);
  add_terms(found->fast, *best, &seconds.final);
}

// What the slow stage named under noise that is the same at all temperatures, asked again beside noise that is not.
class AskedAgain {
public:
  AskedAgain(const AxisQuestion& question, const FastFinding& best, bool holds_beside, Found* found)
      : question_(question), fast_(found->fast), best_kind_(best), holds_beside_(holds_beside), slow_(found->slow),
        seconds_(found->seconds) {}

  // Names that gained less than twice their threshold go where they gain less than it now, and noise that follows the
  // temperature whatever it gained.
  void run() {
    const bool leaves_noise = weigh_noise(), leaves_names = weigh_names();
    if (!leaves_noise && !leaves_names) return;
    seconds_.fit = fit_hypothesis(question_.campaign, hypothesis());
    slow_.measure();
  }

private:
  SlowModel& best() const { return slow_.found.best; }
  Hypothesis hypothesis() const {
    Hypothesis h = hypothesis_of(question_, *slow_.search, best(), true);
    h.base_noise = best().noise_effect ? seconds_.own_base : seconds_.noise.base;
    add_terms(fast_, best_kind_, &h);
    return h;
  }
  bool weigh_noise() {
    std::optional<double>& evidence = slow_.found.noise_evidence;
    const double threshold = question_.constants.noise_nats;
    if (!best().noise_effect || !evidence) return false;
    // Whatever follows the temperature in block means may have been the white noise of their seconds.
    if (*evidence > threshold && !best().noise_effect->estimator()->needs_temperature()) return false;
    const Fit fit = fit_hypothesis(question_.campaign, hypothesis());
    const ResidualLikelihood log_likelihood(question_.campaign, fit.residual);
    const auto fast = [&](const NoiseModel& base) { return best_kind_.noise_on(base); };
    const NoiseModel slow = best().noise_effect->estimator()->noise(seconds_.own_base, best().noise_theta);
    SecondsNoise without;
    without.base = seconds_.own_base, without.log_likelihood = log_likelihood(fast(seconds_.own_base));
    if (!holds_beside_) without = fit_seconds_noise(question_.campaign, slow_base(slow), fit.residual, fast);
    if (log_likelihood(fast(slow)) - without.log_likelihood > threshold) return false;
    best().noise_effect = nullptr, evidence.reset();
    seconds_.noise = without;
    seconds_.final = hypothesis();
    return true;
  }
  // The noise without the kind, from the process of it that holds most.
  static NoiseModel slow_base(const NoiseModel& slow) {
    NoiseModel base;
    base.white_sigma_dph = slow.white_sigma_dph, base.extra_white_dph2 = slow.extra_white_dph2;
    const auto by_sigma = [](const Markov& a, const Markov& b) { return a.sigma_dph < b.sigma_dph; };
    if (!slow.markov.empty()) base.markov = {*std::max_element(slow.markov.begin(), slow.markov.end(), by_sigma)};
    return base;
  }
  // Of a term of `h`, whose fit is `with`, less what its further columns (start states of runs) gain by chance.
  double gain_of(const Hypothesis& h, const Fit& with, size_t term) const {
    Hypothesis less = h;
    less.terms.erase(less.terms.begin() + static_cast<long>(term));
    const Fit without = fit_hypothesis(question_.campaign, less);
    const auto further = static_cast<double>(with.beta.size() - without.beta.size() - 1);
    return with.log_likelihood - without.log_likelihood - 0.5 * further;
  }
  bool weigh_names() {
    if (slow_.is_told_by_held_out) return false; // not by the fitted logs
    std::vector<double>& evidence = slow_.found.evidence;
    const double threshold = question_.constants.mean_nats;
    bool has_left = false;
    while (true) {
      const Hypothesis h = hypothesis();
      std::optional<Fit> with; // where a name is asked
      double least = threshold;
      std::optional<size_t> weakest;
      for (size_t i = 0; i < best().names.size(); ++i) {
        if (evidence[i] > threshold) continue;
        if (!with) with = fit_hypothesis(question_.campaign, h);
        if (const double gain = gain_of(h, *with, question_.lines.size() + i); gain < least) least = gain, weakest = i;
      }
      if (!weakest) return has_left;
      const auto i = static_cast<long>(*weakest);
      best() = best().without(*weakest);
      evidence.erase(evidence.begin() + i);
      slow_.found.rivals.erase(slow_.found.rivals.begin() + i);
      seconds_.final = hypothesis();
      has_left = true;
    }
  }

  const AxisQuestion& question_;
  const FastAnswer& fast_;
  const FastFinding& best_kind_;
  const bool holds_beside_; // the believed noise does beside it
  SlowAnswer& slow_;
  SecondsAnswer& seconds_;
};
void ask_slow_again(const AxisQuestion& question, bool holds_beside, Found* found) {
  const FastFinding* best = found->fast.best(question.constants);
  const FastFinding& second = found->fast.second;
  const bool follows_temperature = best && (best->effect->estimator()->needs_temperature() ||
                                            (second.effect && second.effect->estimator()->needs_temperature()));
  if (follows_temperature) AskedAgain(question, *best, holds_beside, found).run();
}

} // namespace

const FastFinding* FastAnswer::best(const SelectorConstants& constants) const {
  const bool has_one = !scan.findings.empty() && !(scan.findings.front().gain_nats < constants.fast_nats);
  return has_one ? &scan.findings.front() : nullptr;
}

void ask_fast(const AxisQuestion& question, Found* found) {
  if (question.is_censored) return; // the spread of what is left is not that of the noise
  FastScan& scan = found->fast.scan;
  SecondsAnswer& seconds = found->seconds;
  give_back_hits(question, &seconds);
  scan = scan_fast_noise(question.campaign, seconds.noise, seconds.fit.residual, question.library, question.active,
                         question.constants, may_ask_slow_noise(*found), seconds.hits);
  take_plain(question, scan.plain, &seconds);
  drop_hits_that_stay(question, seconds, &scan);
  found->fast.jumping = ask_jumping_noise(question, &found->slow, &seconds, &scan);
  ask_second(question, found);
  const bool holds_beside = believe_beside(question, found);
  take_best(question, holds_beside, found);
  ask_slow_again(question, holds_beside, found);
}

} // namespace imucal
