// SPDX-License-Identifier: MIT
#include "analysis/profile/optimize.h"

#include <Eigen/Core>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <mutex>
#include <nlopt.hpp>
#include <optional>
#include <thread>

#include "base/error.h"
#include "base/parallel.h"
#include "base/rng.h"
#include "base/units.h"
#include "base/x87.h"
#include "linear/linear.h"

namespace imucal {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

// Rounded up to a figure that people would type and that is enough.
std::string shown_up(double value) {
  const double unit = std::pow(10.0, std::floor(std::log10(value)) - 3);
  return shown(std::ceil(value / unit - 1e-9) * unit);
}

double objective_of(const CalibrationError& e, Objective objective) {
  return objective == Objective::kWorst ? e.worst_dph : e.rms_dph;
}

// Noise on a coarse grid: terms too fast for it become white noise of the same density.
ErrorModel coarse_model(const ErrorModel& model, double dt_s) {
  ErrorModel out = model;
  out.markov.clear();
  double white = white_sigma_dph(model.arw_deg_rt_h);
  double density = white * white;
  for (const Markov& m : model.markov) {
    if (m.tau_s < 3 * dt_s)
      density += 2 * m.sigma_dph * m.sigma_dph * m.tau_s;
    else
      out.markov.push_back(m);
  }
  out.arw_deg_rt_h = arw_from_white_sigma(std::sqrt(density));
  return out;
}

// One evaluation: variables -> profile -> error (and worst correlation) on a grid of dt_s.
class Evaluator {
public:
  Evaluator(const OptimizeRequest& request, double duration_s, double dt_s)
      : request_(request), duration_s_(duration_s), dt_s_(dt_s), setup_(request.setup) {
    if (dt_s > 1) setup_.filter = setup_.truth = coarse_model(request.setup.truth, dt_s);
    setup_.points = 41;
    if (!request.tell_apart.empty()) judge_.emplace(setup_, request.tell_apart);
  }

  struct Value {
    double smooth_dph = 0, objective_dph = 0, correlation = 0, strength = 0, excess_s = 0;
    bool possible = false;
  };

  Value operator()(const ScheduleShape& shape, const std::vector<double>& x, bool with_correlation,
                   double sharpness) const {
    Value v;
    Profile profile;
    v.possible = make_profile(shape, x, request_.limits, duration_s_, &profile, &v.excess_s);
    if (!v.possible) return v;
    return of_profile(profile, with_correlation, sharpness);
  }

  Value of_profile(const Profile& profile, bool with_correlation, double sharpness = 0) const {
    Value v;
    v.possible = true;
    const std::vector<CalibrationRun> runs = {{"", profile.temperatures(dt_s_), dt_s_, {}}};
    if (dt_s_ > 1) {
      fast_error(runs, sharpness, &v);
    } else {
      const CalibrationError e = calibration_error(runs, setup_);
      v.objective_dph = v.smooth_dph = objective_of(e, request_.objective);
    }
    if (with_correlation) {
      const SignatureTable table = (*judge_)(runs);
      v.correlation = table.worst;
      v.strength = table.mean_separable;
    }
    return v;
  }

private:
  // As calibration_error with fewer temperatures and, beside the worst value, its smooth stand-in: the norm
  // of the variances with the exponent `sharpness` (0: none asked for).
  void fast_error(const std::vector<CalibrationRun>& runs, double sharpness, Value* v) const {
    const Index p = setup_.order + 1;
    const std::vector<double> info = information_matrix(runs, setup_);
    const MatrixXd m = Eigen::Map<const MatrixXd>(info.data(), p, p) +
                       MatrixXd::Identity(p, p) / (setup_.prior_sigma_dph * setup_.prior_sigma_dph);
    const Cholesky factor(m);
    double worst = 0, mean = 0;
    std::vector<double> var(static_cast<size_t>(setup_.points));
    VectorXd f(p);
    for (int i = 0; i < setup_.points; ++i) {
      const double tn = -1 + 2.0 * i / (setup_.points - 1);
      double power = 1;
      for (Index j = 0; j < p; ++j, power *= tn)
        f(j) = power - (setup_.shape_only && j % 2 == 0 ? 1.0 / static_cast<double>(j + 1) : 0.0);
      var[static_cast<size_t>(i)] = factor.half_solve(f).squaredNorm();
      worst = std::max(worst, var[static_cast<size_t>(i)]);
      mean += var[static_cast<size_t>(i)] / setup_.points * (i == 0 || i == setup_.points - 1 ? 0.5 : 1.0);
    }
    if (request_.objective == Objective::kRms) {
      v->objective_dph = v->smooth_dph = std::sqrt(mean);
      return;
    }
    v->objective_dph = v->smooth_dph = std::sqrt(worst);
    if (sharpness <= 0) return;
    double sum = 0;
    for (double x : var) sum += std::pow(x / worst, sharpness);
    v->smooth_dph = std::sqrt(worst * std::pow(sum, 1.0 / sharpness));
  }

  const OptimizeRequest& request_;
  double duration_s_, dt_s_;
  CalibrationSetup setup_;
  std::optional<SignatureJudge> judge_; // with tell_apart
};

// Of a search that tells effects apart: starts of each shape, how many of all go on, evaluations of each and of each polish.
constexpr int kStartsToTell = 8, kEvaluationsToTell = 250, kPolishToTell = 250;
constexpr size_t kGoOnToTell = 5;
// Of a search whose result is only a start for another: how many go on.
constexpr size_t kGoOnToStart = 12;

// Exponents of the smooth stand-in for the maximum.
constexpr double kBlunt = 20, kSharp = 100;

struct Candidate {
  ScheduleShape shape;
  std::vector<double> x;
  double value = 1e300;
  double exact_dph = 1e300; // of the rounded profile
};

// One use of NLopt.  The function's value is log(error) + a penalty on the correlation; an impossible
// schedule costs more than any possible one, the more the further off it is.
class Search {
public:
  // limit_dph > 0: the signatures are made strong (geometric mean of what separates them), the error only
  // kept below the limit.
  Search(const Evaluator& evaluator, bool tell_apart, double max_correlation, double limit_dph,
         std::atomic<long>* evaluations)
      : evaluator_(evaluator), tell_apart_(tell_apart), max_correlation_(max_correlation), limit_dph_(limit_dph),
        count_(evaluations) {}

  double value(const ScheduleShape& shape, const std::vector<double>& x, double sharpness) const {
    ++*count_;
    const Evaluator::Value v = evaluator_(shape, x, tell_apart_, sharpness);
    if (!v.possible) return 20 + v.excess_s / 1000;
    const double log_error = std::log(v.smooth_dph);
    if (limit_dph_ > 0)
      return -std::log(v.strength) + 50 * std::max(0.0, log_error - std::log(limit_dph_)) +
             4 * std::max(0.0, v.correlation - max_correlation_);
    return log_error + (tell_apart_ ? 4 * std::max(0.0, v.correlation - max_correlation_) : 0.0);
  }

  void run(nlopt::algorithm algorithm, double sharpness, double step, int max_evaluations, Candidate* c) const {
    struct Context {
      const Search* search;
      const ScheduleShape* shape;
      double sharpness;
    } context{this, &c->shape, sharpness};
    nlopt::opt opt(algorithm, static_cast<unsigned>(c->x.size()));
    opt.set_lower_bounds(0.0);
    opt.set_upper_bounds(1.0);
    opt.set_min_objective(
        [](const std::vector<double>& x, std::vector<double>&, void* data) {
          const auto* ctx = static_cast<const Context*>(data);
          return ctx->search->value(*ctx->shape, x, ctx->sharpness);
        },
        &context);
    opt.set_initial_step(step);
    opt.set_ftol_abs(1e-7);
    opt.set_xtol_abs(1e-6);
    opt.set_maxeval(max_evaluations);
    std::vector<double> x = c->x;
    double found = 1e300;
    const RoundsToDouble rounding;
    try {
      opt.optimize(x, found);
    } catch (const nlopt::roundoff_limited&) { // x holds the best so far
    } catch (const std::runtime_error&) {
      return; // nothing better than the start
    }
    const double now = value(c->shape, x, sharpness);
    if (now <= value(c->shape, c->x, sharpness)) {
      c->x = x;
      c->value = now;
    }
  }

private:
  const Evaluator& evaluator_;
  bool tell_apart_;
  double max_correlation_, limit_dph_;
  std::atomic<long>* count_;
};

bool fits(const ScheduleShape& shape, const OptimizeRequest& r, double duration_s) {
  Profile unused;
  double excess_s = 0;
  return make_profile(shape, shape.start(), r.limits, duration_s, &unused, &excess_s);
}

// Up to three passes every soak is free; more passes (fast chambers) share their soaks.
std::vector<ScheduleShape> accuracy_shapes(const OptimizeRequest& r, double duration_s) {
  std::vector<ScheduleShape> out;
  const int interior = std::max(0, r.setup.order - 1);
  const bool slow_ramps = r.limits.max_soak_s > 0;
  const bool alike = r.limits.heating_degc_per_min == r.limits.cooling_degc_per_min;
  const auto add = [&](const ScheduleShape& shape) {
    if (fits(shape, r, duration_s)) out.push_back(shape);
  };
  for (int passes : {1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 16, 24, 32}) {
    const bool tied = passes > 3;
    for (const bool hot : {false, true}) {
      if (hot && alike) continue; // the mirrored profile has the mirrored error
      add(passes_shape(passes, 0, 0, hot, slow_ramps, tied));
      if (interior == 0) continue;
      add(passes_shape(passes, interior, 1, hot, slow_ramps, tied));
      if (passes > 1) add(passes_shape(passes, interior, passes, hot, slow_ramps, true));
    }
  }
  return out;
}

// Chains with reversals inside the run, which alone separate dT/dt, hysteresis, lag and ageing.
std::vector<ScheduleShape> diagnosis_shapes(const OptimizeRequest& r, double duration_s) {
  static const struct {
    const char* name;
    std::vector<double> levels;
  } chains[] = {
      {"one pass", {0, 0.28, 0.72, 1}},
      {"loop at the first soak", {0, 0.3, 0.15, 0.72, 1}},
      {"loop at the second soak", {0, 0.28, 0.8, 0.65, 1}},
      {"loop at the far end", {0, 0.28, 0.72, 1, 0.85, 0.95}},
      {"loop at the near end", {0.15, 0, 0.28, 0.72, 1}},
      {"loops at both ends", {0.15, 0, 0.28, 0.72, 1, 0.85}},
      {"up, back by half, up", {0, 0.7, 0.3, 1}},
      {"from the middle", {0.4, 0, 0.3, 0.7, 1, 0.6}},
      {"up and down", {0, 0.28, 0.72, 1, 0.72, 0.28, 0.01}},
      {"two partial loops", {0, 0.6, 0.25, 1, 0.4, 0.75}},
      {"three passes", {0, 0.5, 1, 0.5, 0, 0.5, 1}},
  };
  std::vector<ScheduleShape> out;
  for (const auto& chain : chains) {
    for (const bool mirrored : {false, true}) {
      std::vector<double> levels = chain.levels;
      if (mirrored)
        for (double& level : levels) level = 1 - level;
      const ScheduleShape shape =
          chain_shape(chain.name + std::string(mirrored ? ", from hot" : ", from cold"), levels, true);
      if (fits(shape, r, duration_s)) out.push_back(shape);
    }
  }
  return out;
}

void randomise(Rng* rng, std::vector<double>* x) {
  for (double& v : *x) v = std::clamp(v + 0.5 * (rng->uniform() - 0.5), 0.02, 0.98);
}

// The same profile with every level, soak and rate on its own.
Candidate untied(const Candidate& c) {
  std::vector<double> levels, weights;
  for (const ScheduleShape::Stop& stop : c.shape.stops) {
    levels.push_back(c.shape.level_of(stop, c.x));
    weights.push_back(c.x[c.shape.n_levels() + static_cast<size_t>(stop.weight_var)]);
  }
  Candidate out{chain_shape(c.shape.name + ", freed", levels, true), {}, 1e300, 1e300};
  out.x = out.shape.start();
  std::copy(weights.begin(), weights.end(), out.x.begin() + static_cast<std::ptrdiff_t>(out.shape.n_levels()));
  std::fill(out.x.begin() + static_cast<std::ptrdiff_t>(out.shape.n_levels() + weights.size()), out.x.end(), 1.0);
  return out;
}

Profile final_profile(const OptimizeRequest& request, const Candidate& c, double duration_s) {
  Profile raw;
  double excess_s = 0;
  make_profile(c.shape, c.x, request.limits, duration_s, &raw, &excess_s);
  return rounded(raw, duration_s, request.limits);
}

// What one search is to find.
struct SearchTask {
  double duration_s = 0;
  bool tell_apart = false;
  double share = 1;      // scales the number of evaluations
  double limit_dph = 0;  // > 0: the strongest signatures within that error
  bool is_start = false; // its result is a start for another search
};

// Steps of the coarse grid: fine enough for the fastest Markov term that matters and for the ramps.  With tell_apart an
// evaluation is dear and the grid coarser: a Markov term is kept down to three steps (coarse_model).
double coarse_step_s(const OptimizeRequest& request, const SearchTask& task) {
  const double per_tau = task.tell_apart ? 3 : 5, per_ramp = task.tell_apart ? 40 : 72;
  double step_s = task.duration_s / 500;
  for (const Markov& m : request.setup.truth.markov)
    if (m.tau_s > 10 && m.sigma_dph > 0) step_s = std::min(step_s, m.tau_s / per_tau);
  step_s = std::min({step_s, request.limits.traverse_s(true) / per_ramp, request.limits.traverse_s(false) / per_ramp});
  return std::max(2.0, std::max(step_s, task.duration_s / 4000));
}

// For the last steps: the exact grid, coarser for tests of many hours.
double fine_step_s(const SearchTask& task) {
  return std::max(1.0, std::floor(task.duration_s / (task.tell_apart ? 4000 : 8000)));
}

void keep_best(size_t n, std::vector<Candidate>* found) {
  std::stable_sort(found->begin(), found->end(),
                   [](const Candidate& a, const Candidate& b) { return a.value < b.value; });
  if (found->size() > n) found->resize(n);
}

// What is counted and shown over all searches of a request, whose candidates are improved side by side.
struct Tally {
  std::atomic<long> evaluations{0};
  std::mutex shown;
  double best_seen = 1e300;
};

// The best candidate for one duration.  Every shape is tried and the best are polished, first on the coarse grid, then on
// the fine one; the rounded profiles, exact, decide.  With tell_apart an evaluation is dear, and a start tells at once whether
// its shape can separate the effects: the best starts go on alone.
// Candidates do not know of each other: the result is the same on any number of threads.
class DurationSearch {
public:
  DurationSearch(const OptimizeRequest& request, const SearchTask& task, Tally* tally)
      : request_(request), task_(task), tally_(tally), coarse_(request, task.duration_s, coarse_step_s(request, task)),
        fine_(request, task.duration_s, fine_step_s(task)), exact_(request, task.duration_s, 1.0),
        on_coarse_(coarse_, task.tell_apart, request.max_correlation - 0.005, 0.999 * task.limit_dph,
                   &tally->evaluations),
        on_fine_(fine_, task.tell_apart, request.max_correlation - 0.001, 0.9995 * task.limit_dph,
                 &tally->evaluations) {}
  DurationSearch(const DurationSearch&) = delete;
  DurationSearch& operator=(const DurationSearch&) = delete;

  // `also` (may be null) joins the starts.
  Candidate best(const Candidate* also) {
    try_shapes(also);
    keep_best(task_.tell_apart ? 2 : 4, &found_);
    each([this](Candidate* c) { polish(c); });
    keep_best(task_.tell_apart ? 2 : 3, &found_);
    each([this](Candidate* c) {
      c->value = on_fine_.value(c->shape, c->x, 0);
      on_fine_.run(nlopt::LN_SBPLX, 0, 0.01, budget(task_.tell_apart ? 40 : 60), c);
    });
    if (!task_.tell_apart && !task_.is_start) add_paper_profiles();
    return best_rounded();
  }

private:
  int budget(int n) const { return std::max(20, static_cast<int>(task_.share * request_.effort * n)); }

  void each(const std::function<void(Candidate*)>& improve) {
    parallel_for(static_cast<long>(found_.size()), static_cast<int>(std::thread::hardware_concurrency()),
                 [&](long i) { improve(&found_[static_cast<size_t>(i)]); });
  }

  void report(const Candidate& c) {
    const std::lock_guard<std::mutex> hold(tally_->shown);
    tally_->best_seen = std::min(tally_->best_seen, c.value);
    if (request_.progress) request_.progress(0.5, std::exp(tally_->best_seen));
  }

  // From the start of each shape and from points near it.
  void try_shapes(const Candidate* also) {
    const std::vector<ScheduleShape> shapes =
        task_.tell_apart ? diagnosis_shapes(request_, task_.duration_s) : accuracy_shapes(request_, task_.duration_s);
    Rng rng(request_.seed, 0, 0, Stream::kTool);
    const int starts = task_.tell_apart ? kStartsToTell : 3;
    for (const ScheduleShape& shape : shapes) {
      for (int start = 0; start < starts; ++start) {
        found_.push_back({shape, shape.start(), 1e300, 1e300});
        if (start > 0) randomise(&rng, &found_.back().x);
      }
    }
    each([this](Candidate* c) { c->value = on_coarse_.value(c->shape, c->x, kBlunt); });
    if (task_.tell_apart) keep_best(kGoOnToTell, &found_);
    if (task_.is_start) keep_best(kGoOnToStart, &found_);
    if (also) {
      found_.push_back(*also);
      found_.back().value = on_coarse_.value(also->shape, also->x, kBlunt);
    }
    // A fixed number of evaluations is shared by the starts.
    const int n_starts = std::max(1, static_cast<int>(found_.size()));
    const int all = task_.is_start ? 4000 : 9000;
    const int evaluations = task_.tell_apart ? kEvaluationsToTell : std::clamp(all / n_starts, 150, 800);
    each([&](Candidate* c) {
      on_coarse_.run(task_.tell_apart ? nlopt::LN_SBPLX : nlopt::LN_BOBYQA, kBlunt, 0.2, budget(evaluations), c);
      report(*c);
    });
  }

  void polish(Candidate* c) {
    if (!task_.tell_apart) {
      on_coarse_.run(nlopt::LN_BOBYQA, kSharp, 0.03, budget(500), c);
      on_coarse_.run(nlopt::LN_BOBYQA, 10 * kSharp, 0.005, budget(300), c);
    }
    // Subplex may stop on a ridge of the maximum: begun again, twice.
    for (double step : {0.1, 0.03, 0.01})
      on_coarse_.run(nlopt::LN_SBPLX, 0, step, budget(task_.tell_apart ? kPolishToTell : 300), c);
    c->value = on_coarse_.value(c->shape, c->x, 0);
    report(*c);
  }

  void add_paper_profiles() {
    for (int passes = 1; passes <= 40; ++passes) {
      const ScheduleShape paper = passes_shape(passes, 0, 0, false, false, true);
      if (!fits(paper, request_, task_.duration_s)) break;
      found_.push_back({paper, paper.start(), 1e300, 1e300});
    }
  }

  // The coarse grid and the rounding leave the ranking open within a few 1e-4: the rounded, exact figures decide.
  Candidate best_rounded() {
    Candidate best;
    for (Candidate& c : found_) {
      const Evaluator::Value v = exact_.of_profile(final_profile(request_, c, task_.duration_s), task_.tell_apart);
      ++tally_->evaluations;
      c.exact_dph = v.objective_dph;
      c.value = rank(v);
      if (c.value < best.value) best = c;
    }
    return best;
  }

  // Less is better.
  double rank(const Evaluator::Value& v) const {
    const bool too_alike = v.correlation > request_.max_correlation;
    if (task_.limit_dph > 0) return (v.objective_dph > task_.limit_dph || too_alike ? 1e3 : 1.0) / v.strength;
    return v.objective_dph * (task_.tell_apart && too_alike ? 10 + v.correlation : 1.0);
  }

  const OptimizeRequest& request_;
  SearchTask task_;
  Tally* tally_;
  Evaluator coarse_, fine_, exact_;
  Search on_coarse_, on_fine_;
  std::vector<Candidate> found_;
};

struct Found {
  Candidate best;
  double duration_s = 0;
  double accuracy_only_dph = 0; // with tell_apart: what the search without it reaches
};

Found found_for(const OptimizeRequest& request, double duration_s, double share, Tally* tally) {
  const auto search = [&](const SearchTask& task, const Candidate* also) {
    return DurationSearch(request, task, tally).best(also);
  };
  if (request.tell_apart.empty()) return {search({duration_s, false, share, 0, false}, nullptr), duration_s, 0};
  const Candidate accurate = search({duration_s, false, 0.4 * share, 0, true}, nullptr);
  const Candidate freed = untied(accurate);
  const Candidate least = search({duration_s, true, share, 0, false}, freed.x.size() <= 45 ? &freed : nullptr);
  if (request.spend_frac <= 0) return {least, duration_s, accurate.exact_dph};
  const double limit_dph = (1 + request.spend_frac) * accurate.exact_dph;
  return {search({duration_s, true, share, limit_dph, false}, &least), duration_s, accurate.exact_dph};
}

// Durations too short and long enough for the required error; the error falls about as 1/sqrt(duration).
class DurationBracket {
public:
  explicit DurationBracket(const OptimizeRequest& r)
      : required_dph_(r.required_dph),
        shortest_s_(std::min(r.limits.traverse_s(true), r.limits.traverse_s(false)) + 2 * r.limits.min_soak_s),
        lo_s_(shortest_s_) {}

  // From the bound of slow ramps.  usage_error where it takes about a year.
  double first_guess_s(const CalibrationSetup& setup) const {
    const std::string unit = " " + setup.truth.unit_or_dph();
    const double p = setup.order + 1, density = setup.truth.slow_density_dph2_s();
    const double guess_s = std::max(least_s(), 1.1 * p * density / (required_dph_ * required_dph_));
    if (guess_s > 3e7)
      throw usage_error("--required-error " + shown(required_dph_) + unit + " would take about " +
                        shown(guess_s / 86400) + " days; the smallest error within 30 days is about " +
                        shown(std::sqrt(1.1 * p * density / 2592000)) + unit);
    return guess_s;
  }

  // Returns whether the error is small enough.
  bool add(double duration_s, double error_dph) {
    const bool reached = error_dph <= required_dph_;
    (reached ? hi_s_ : lo_s_) = duration_s;
    return reached;
  }

  bool narrow() const { return reached() && (hi_s_ - lo_s_ < 0.003 * hi_s_ || hi_s_ <= shortest_s_ * 1.0011 + 1); }
  bool reached() const { return hi_s_ > 0; }

  // Secant in logarithms, kept inside the bracket.
  double next_guess_s(double duration_s, double error_dph) const {
    const double margin = error_dph > required_dph_ ? 1.0005 : 0.9995;
    double next_s = duration_s * std::pow(error_dph / required_dph_ * margin, 2);
    const double inset_s = 0.05 * (hi_s_ - lo_s_);
    if (reached()) next_s = std::clamp(next_s, lo_s_ + inset_s, hi_s_ - inset_s);
    return std::max(next_s, least_s());
  }

private:
  double least_s() const { return shortest_s_ * 1.001 + 1; }

  double required_dph_, shortest_s_;
  double lo_s_, hi_s_ = 0; // too short; long enough (0: none yet)
};

// The shortest duration that reaches the required error; shapes are found anew for each one tried.
Found shortest_that_reaches(const OptimizeRequest& request, Tally* tally) {
  DurationBracket bracket(request);
  double guess_s = bracket.first_guess_s(request.setup);
  Found best;
  for (int round = 0; round < 10; ++round) {
    guess_s = std::ceil(guess_s);
    const Found now = found_for(request, guess_s, 0.4, tally);
    if (bracket.add(guess_s, now.best.exact_dph)) best = now;
    if (bracket.narrow()) break;
    guess_s = bracket.next_guess_s(guess_s, now.best.exact_dph);
  }
  if (!bracket.reached())
    throw usage_error("--required-error " + shown(request.required_dph) + " " + request.setup.truth.unit_or_dph() +
                      " was not reached within " + shown(guess_s) + " s");
  return best;
}

// Profile, error, signatures, and whether they are what was asked for.
void set_best(const OptimizeRequest& request, const Found& found, OptimizeResult* result) {
  const bool tell_apart = !request.tell_apart.empty();
  result->profile = final_profile(request, found.best, found.duration_s);
  result->shape = found.best.shape.name;
  const auto runs = runs_of_profile(result->profile);
  result->error = calibration_error(runs, request.setup);
  result->objective_dph = objective_of(result->error, request.objective);
  result->signatures =
      signature_table(runs, request.setup, tell_apart ? request.tell_apart : standard_effects(request.setup.order));
  result->accuracy_only_dph = found.accuracy_only_dph;
  if (tell_apart) result->meets_correlation = result->signatures.worst <= request.max_correlation;
  if (request.required_dph > 0) result->meets_error = result->objective_dph <= request.required_dph;
}

// The paper's profile with the number of passes that suits it best.
void set_paper(const OptimizeRequest& request, double duration_s, OptimizeResult* result) {
  for (int passes = 1; passes <= 100; ++passes) {
    const Profile paper = paper_profile(request.limits, duration_s, passes);
    if (paper.duration_s() > duration_s + 1) break;
    const CalibrationError e = calibration_error(runs_of_profile(paper), request.setup);
    if (passes > 1 && objective_of(e, request.objective) >= objective_of(result->paper_error, request.objective)) {
      if (passes > result->paper_passes + 3) break;
      continue;
    }
    result->paper = paper;
    result->paper_passes = passes;
    result->paper_error = e;
  }
}

} // namespace

void check_limits(const ChamberLimits& limits, int order, double duration_s) {
  const std::string range = shown(limits.lo_degc) + ":" + shown(limits.hi_degc);
  if (!(limits.heating_degc_per_min > 0 && limits.cooling_degc_per_min > 0))
    throw usage_error("--max-rate must be above 0 degC/min; a chamber that cannot move cannot calibrate over " + range);
  if (limits.min_soak_s < 0) throw usage_error("--min-soak-s must not be negative");
  if (limits.max_soak_s > 0 && limits.max_soak_s < limits.min_soak_s)
    throw usage_error("--max-soak-s " + shown(limits.max_soak_s) + " is below --min-soak-s " +
                      shown(limits.min_soak_s) + "; raise it to " + shown(limits.min_soak_s));
  if (duration_s <= 0) return;
  const bool heat = limits.traverse_s(true) <= limits.traverse_s(false);
  const double traverse_s = std::min(limits.traverse_s(true), limits.traverse_s(false));
  const double rate = heat ? limits.heating_degc_per_min : limits.cooling_degc_per_min;
  const double soaks_s = 2 * limits.min_soak_s;
  if (duration_s < traverse_s + soaks_s - 1e-6) {
    std::string text = "the range " + range + " takes " + shown(traverse_s) + " s at " + shown(rate) + " degC/min";
    if (soaks_s > 0)
      text += " and two soaks of " + shown(limits.min_soak_s) + " s, " + shown(traverse_s + soaks_s) + " s in all";
    text += ", longer than --duration-s " + shown(duration_s) + "; any one of these makes it possible: --duration-s " +
            shown_up(traverse_s + soaks_s);
    if (duration_s > soaks_s) {
      const double time_s = duration_s - soaks_s;
      text += ", --max-rate " + shown_up(kSecondsPerMinute * limits.span_degc() / time_s) + ", a range of at most " +
              shown(std::floor(rate * time_s / kSecondsPerMinute * 100) / 100) + " degC";
    } else {
      text += ", --min-soak-s 0";
    }
    throw usage_error(text);
  }
  if (duration_s < order + 1)
    throw usage_error("--duration-s " + shown(duration_s) + ": an order-" + std::to_string(order) +
                      " polynomial needs at least " + std::to_string(order + 1) + " s");
}

OptimizeResult optimize_profile(const OptimizeRequest& request) {
  check_setup(request.setup);
  check_limits(request.limits, request.setup.order, request.duration_s);
  Tally tally;
  const Found found = request.duration_s > 0 ? found_for(request, request.duration_s, 1.0, &tally)
                                             : shortest_that_reaches(request, &tally);
  OptimizeResult result;
  set_best(request, found, &result);
  set_paper(request, found.duration_s, &result);
  result.evaluations = tally.evaluations;
  return result;
}

} // namespace imucal
