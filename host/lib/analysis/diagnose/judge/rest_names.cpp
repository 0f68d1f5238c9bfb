// SPDX-License-Identifier: MIT
#include "analysis/diagnose/judge/rest_names.h"

#include <algorithm>
#include <cmath>

#include "analysis/diagnose/judge/noise_kinds.h"
#include "analysis/diagnose/search/time_jumps.h"
#include "analysis/diagnose/stages/mean_lines.h"

namespace imucal {

namespace {

// Start states are bounded by the size, and by a half more: one at the bound, with a little of another cause, is not beyond it.
constexpr double kBoundPart = 1.5;
constexpr double kBeyondErrors = 3; // by chance in 1 of 370 runs
// Times the believed white noise: kinds of slow noise beside it move it by up to 1.12 (development cases).
constexpr double kWhiteTimes = 1.25;
constexpr double kTakenBack = 0.5; // of what the drift brings, and not more than 1/kTakenBack of it
constexpr int kSizes = 2001;       // that are tried within so many standard errors of the size found

// A memory of which the logs show no more than start states.
bool is_unseen(const Term& term) {
  return term.effect && term.effect->family() == Family::kThermalMemory && term.form() == Form::kColumns &&
         !term.starts.empty() && !term.coefficients.empty() &&
         std::fabs(term.coefficients[0]) <= kSeenErrors * term.coefficient_errors[0];
}
// Whether some run began beyond its bound whatever the size.  Logs that go one way tell the sum of the size and a start state
// better than either: each start state is asked as it would be found if the size were known.
bool is_start_beyond(const Term& term) {
  const double size = term.coefficients[0], size_error = term.coefficient_errors[0];
  for (int i = 0; i < kSizes; ++i) {
    const double off = kBeyondErrors * (2.0 * i / (kSizes - 1) - 1); // of the size [standard errors]
    const double bound = kBoundPart * std::fabs(size + off * size_error);
    double beyond = 0; // the start state that is furthest beyond [standard errors]
    for (size_t r = 0; r < term.starts.size(); ++r) {
      const double follows = size_error > 0 ? term.start_covariances[r] / size_error : 0;
      const double error = std::sqrt(std::max(0.0, std::pow(term.start_errors[r], 2) - follows * follows));
      const double start = std::fabs(term.starts[r] + off * follows);
      if (start > bound) beyond = std::max(beyond, (start - bound) / error);
    }
    if (std::hypot(off, beyond) < kBeyondErrors) return false;
  }
  return true;
}
// What a drift in time brings from the first second of the runs to the last, all together [dph]; 0: not such a cause.
double brought_by(const Campaign& campaign, const SelectedEffect& effect) {
  const bool is_drift = effect.term.effect && !effect.is_family && effect.family == Family::kFunctionOfTime &&
                        effect.term.form() == Form::kColumns && effect.term.coefficients.size() == 1;
  double sum = 0;
  for (size_t r = 0; is_drift && r < campaign.runs.size(); ++r) {
    const Column column = effect.term.estimator->columns(campaign.runs[r].input, effect.term.shape).front();
    sum += effect.term.coefficients.front() * (column.back() - column.front());
  }
  return sum;
}
// A line or a kind of noise is no part of a cause in the mean.
bool is_in_mean(const EffectEstimator* estimator) {
  return estimator && estimator->form() != Form::kTone && estimator->form() != Form::kNoise;
}
bool is_in_mean(const SelectedEffect& effect) {
  return is_in_mean(effect.term.estimator);
}
bool is_in_mean(const CandidateEvidence& cause) {
  if (cause.effect) return is_in_mean(cause.effect->estimator());
  return cause.reference && is_in_mean(cause.reference->candidate.estimator);
}

class RestNames {
public:
  RestNames(const AxisQuestion& question, const Found& found, const std::vector<RestFinding>& after, Names* names)
      : question_(question), found_(found), after_(after), names_(*names) {}

  void run() {
    bool fires = false, has_jumps = false;
    double left = 0;
    Rest strongest = Rest::kCount;
    for (const RestFinding& f : after_) {
      fires = fires || (f.evidence_nats > 0 && f.test != Rest::kLine);
      if (f.test != Rest::kLine && f.evidence_nats > left) left = f.evidence_nats, strongest = f.test;
      has_jumps = has_jumps || (f.evidence_nats > 0 && f.test == Rest::kSuddenChanges);
    }
    reject_noise_beside_shapes();
    if (fires) {
      for (SelectedEffect& effect : names_.effects) {
        if (!effect.term.effect || effect.is_family) continue;
        const Form form = effect.term.form();
        if (form == Form::kNoise) open_noise(&effect);
        if (form == Form::kSteps && has_jumps) open_jumps(question_, &effect);
      }
      if (left > explained_nats() || n_members() > kFewNames) reject_members(strongest);
    }
    join_open_noise();
    reject_small_beside_rest(left);
  }

private:
  const SelectorConstants& constants() const { return question_.constants; }

  // The threshold of a name holds where what is left is noise.  Beside an open shape a member or a jump in time that holds less
  // than a tenth of what the slow search explains may be of that shape; one that gains little beyond its threshold, and less than
  // the tests find left, may be of what is left.
  void reject_small_beside_rest(double left_nats) {
    const double least = has_open_shape() ? constants().lack_part * found_.slow.gain_nats() : 0;
    const auto is_small = [&](const SelectedEffect& effect) {
      const bool is_weak = effect.evidence_nats < constants().lack_nats && effect.gain_nats < left_nats;
      return !effect.is_family && is_in_mean(effect) && (effect.gain_nats < least || is_weak);
    };
    names_.reject_those(is_small, &names_.effects);
  }
  // What stands beside slow noise whose kind is open, and may be of it, goes into its set.
  void join_open_noise() {
    SelectedEffect* open = names_.open_slow_noise();
    if (!open) return;
    join_parameters(open);
    join_jumps(open);
  }
  // What of the noise the believed process holds is open too: that it has other parameters is no finding of its own, but where
  // the white noise has.
  void join_parameters(SelectedEffect* open) {
    const auto is_about_slow_noise = [&](const SelectedEffect& effect) {
      const double times = effect.term.shape[0] / question_.belief.model.white_sigma_dph;
      return times < kWhiteTimes && 1 / times < kWhiteTimes;
    };
    join(is_about_slow_noise, &names_.retuned, open);
  }
  // Single jumps that hold less than a noise that jumps are some of its own; where it may be one, those that hold little at all.
  void join_jumps(SelectedEffect* open) {
    const auto is_jumping = [](const EffectEstimator* e) { return e && e->is_jumping(); };
    const bool jumps = is_jumping(open->term.estimator);
    const bool may_jump = std::any_of(open->set.begin(), open->set.end(), [&](const CandidateEvidence& member) {
      return member.effect && is_jumping(member.effect->estimator());
    });
    const double most_nats = open->gain_nats;
    const auto is_small_step = [&](const SelectedEffect& effect) {
      const bool is_step = !effect.is_family && effect.term.effect && effect.term.form() == Form::kSteps;
      const bool is_weak = effect.evidence_nats < constants().lack_nats;
      return is_step && effect.gain_nats < most_nats && (jumps || (may_jump && is_weak));
    };
    join(is_small_step, &names_.effects, open);
  }
  // Those of a list that are of the open noise; `open` may be one of the others.
  template <class F> static void join(F is_of_it, std::vector<SelectedEffect>* list, SelectedEffect* open) {
    for (const SelectedEffect& effect : *list)
      if (is_of_it(effect)) add_equal(effect.term.effect, open);
    list->erase(std::remove_if(list->begin(), list->end(), is_of_it), list->end());
  }
  // The tests contradict the kind that is most likely: likelihoods do not exclude the others, which gain at all.
  void open_noise(SelectedEffect* effect) const {
    open_member(effect);
    if (effect->family == Family::kSlowNoise && found_.slow.found.best.names.empty()) {
      add_kinds_within(question_, found_.slow, found_.slow.gain_nats() + constants().noise_kind_nats,
                       found_.slow.found.best, effect);
      add_same_spectrum(question_, effect);
    }
    if (effect->statement.empty() && effect->set.size() == 1)
      effect->statement = "only the family is known: the only one that comes near leaves more than plain noise";
  }
  // A line is what it is: it stands in for nothing, unless lines remain.
  bool is_member(const SelectedEffect& effect) const {
    return !effect.is_family && (effect.family != Family::kTone || question_.lines.size() == kMostLines);
  }
  size_t n_members() const {
    return static_cast<size_t>(
        std::count_if(names_.effects.begin(), names_.effects.end(), [&](const auto& e) { return is_member(e); }));
  }
  // The strength of the noise, its tails and its bursts say nothing of the mean: what foretells logs that were not fitted is no
  // stand-in for them.  Lines, other spectra and sudden changes may be a part of what such a cause leaves.
  static bool is_of_strength(Rest test) {
    return test == Rest::kVarianceOverTemperature || test == Rest::kVarianceOverTime || test == Rest::kDistribution ||
           test == Rest::kBursts;
  }
  // More is left than was explained, or many causes together leave something: members stand in for another cause then.
  // A family says no more than that: of sudden changes what foretells logs that were not fitted is told as one, since a loop of
  // relays jumps.
  void reject_members(Rest strongest) {
    for (SelectedEffect& effect : names_.effects)
      if (strongest == Rest::kSuddenChanges && is_member(effect) && foretells(effect)) open_member(&effect);
    const auto is_left = [&](const SelectedEffect& effect) {
      const bool is_kept = is_of_strength(strongest) && is_in_mean(effect) && foretells(effect);
      return is_member(effect) && !is_kept;
    };
    names_.reject_those(is_left, &names_.effects);
  }
  bool foretells(const SelectedEffect& effect) const { return effect.held_out_nats > constants().foretold_nats; }
  bool has_open_shape() const { return std::any_of(names_.effects.begin(), names_.effects.end(), is_shape_open); }
  double explained_nats() const {
    double sum = found_.slow.gain_nats() + found_.fast.jumping.gain_nats;
    for (const SelectedEffect& effect : names_.effects)
      if (effect.family == Family::kFastNoise || effect.family == Family::kTone) sum += effect.gain_nats;
    return sum;
  }
  // A kind of slow noise beside a cause whose shape is open, or beside causes of which none is named, is what that shape leaves,
  // and so are one of fast noise and other noise parameters that hold little beside it.
  void reject_noise_beside_shapes() {
    const auto is_of_mean = [](const auto& cause) { return is_in_mean(cause); };
    const auto has_mean = [&](const auto& list) { return std::any_of(list.begin(), list.end(), is_of_mean); };
    const bool is_mean_left = has_mean(names_.remainders) && !has_mean(names_.effects);
    const bool leaves_shape = is_mean_left || found_.slow.has_free_function() || has_open_shape();
    if (!leaves_shape) return;
    const double least = constants().beside_free_part * explained_nats();
    const auto is_noise = [&](const SelectedEffect& effect) {
      if (!effect.term.effect || effect.term.form() != Form::kNoise) return false;
      return effect.family == Family::kSlowNoise || effect.gain_nats < least;
    };
    names_.reject_those(is_noise, &names_.effects);
    names_.reject_those([&](const SelectedEffect& effect) { return effect.gain_nats < least; }, &names_.retuned);
  }

  const AxisQuestion& question_;
  const Found& found_;
  const std::vector<RestFinding>& after_;
  Names& names_;
};

} // namespace

void judge_unseen(Names* names) {
  double stand_in_nats = -1;
  const auto is_contradicted = [&](const SelectedEffect& effect) {
    const bool is_bounded = effect.term.estimator && effect.term.estimator->is_start_bounded();
    if (effect.is_family || effect.is_any_shape || !is_bounded || !is_unseen(effect.term) ||
        !is_start_beyond(effect.term))
      return false;
    stand_in_nats = std::max(stand_in_nats, effect.gain_nats);
    return true;
  };
  names->reject_those(is_contradicted, &names->effects);
  const auto is_part = [&](const SelectedEffect& effect) {
    return !effect.is_family && is_in_mean(effect) && effect.gain_nats < stand_in_nats;
  };
  names->reject_those(is_part, &names->effects);
  for (SelectedEffect& effect : names->effects)
    if (!effect.is_family && is_unseen(effect.term)) open_loop(&effect);
}

void judge_teeth(const Campaign& campaign, Names* names) {
  for (SelectedEffect& jumps : names->effects) {
    if (!jumps.term.effect || jumps.term.form() != Form::kSteps) continue;
    const std::vector<double>& sizes = jumps.term.coefficients;
    const auto is_up = [](double size_dph) { return size_dph > 0; };
    const auto n_up = static_cast<size_t>(std::count_if(sizes.begin(), sizes.end(), is_up));
    if (sizes.size() < kFewestTeeth || (n_up > 0 && n_up < sizes.size())) continue;
    double sum = 0;
    for (const double size_dph : sizes) sum += size_dph;
    const auto is_taken_back = [&](const SelectedEffect& effect) {
      const double part = -sum / brought_by(campaign, effect); // infinite where it is no drift
      return part > kTakenBack && part < 1 / kTakenBack;
    };
    if (std::none_of(names->effects.begin(), names->effects.end(), is_taken_back)) continue;
    open_member(&jumps);
    jumps.statement = "only the family is known: jumps that take back what a drift brings, as the teeth of a saw";
    names->reject_those(is_taken_back, &names->effects);
    return;
  }
}

void open_by_rest(const AxisQuestion& question, const Found& found, const std::vector<RestFinding>& after,
                  Names* names) {
  RestNames(question, found, after, names).run();
}

} // namespace imucal
