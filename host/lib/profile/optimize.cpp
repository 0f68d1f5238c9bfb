// SPDX-License-Identifier: MIT
#include "profile/optimize.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlopt.hpp>

#include "base/error.h"
#include "base/units.h"
#include "sim/rng.h"

namespace imucal {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

std::string shown(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

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
    if (m.tau_s < 3 * dt_s) density += 2 * m.sigma_dph * m.sigma_dph * m.tau_s;
    else out.markov.push_back(m);
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
  }

  struct Value {
    double smooth_dph = 0, objective_dph = 0, correlation = 0, excess_s = 0;
    bool possible = false;
  };

  Value operator()(const ScheduleShape& shape, const std::vector<double>& x, bool with_correlation) const {
    Value v;
    Profile profile;
    v.possible = make_profile(shape, x, request_.limits, duration_s_, &profile, &v.excess_s);
    if (!v.possible) return v;
    return of_profile(profile, with_correlation);
  }

  Value of_profile(const Profile& profile, bool with_correlation) const {
    Value v;
    v.possible = true;
    const std::vector<CalibrationRun> runs = {{"", profile.temperatures(dt_s_), dt_s_, {}}};
    if (dt_s_ > 1) {
      fast_error(runs, &v);
    } else {
      const CalibrationError e = calibration_error(runs, setup_);
      v.objective_dph = v.smooth_dph = objective_of(e, request_.objective);
    }
    if (with_correlation) v.correlation = signature_table(runs, setup_, request_.tell_apart).worst;
    return v;
  }

  double dt_s() const { return dt_s_; }

 private:
  // As calibration_error with fewer temperatures and, beside the worst value, its smooth stand-in: the 40-norm.
  void fast_error(const std::vector<CalibrationRun>& runs, Value* v) const {
    const Index p = setup_.order + 1;
    const std::vector<double> info = information_matrix(runs, setup_);
    const MatrixXd m = Eigen::Map<const MatrixXd>(info.data(), p, p) +
                       MatrixXd::Identity(p, p) / (setup_.prior_sigma_dph * setup_.prior_sigma_dph);
    const Eigen::LLT<MatrixXd> factor(m);
    double worst = 0, mean = 0;
    std::vector<double> var(static_cast<size_t>(setup_.points));
    VectorXd f(p);
    for (int i = 0; i < setup_.points; ++i) {
      const double tn = -1 + 2.0 * i / (setup_.points - 1);
      double power = 1;
      for (Index j = 0; j < p; ++j, power *= tn)
        f(j) = power - (setup_.shape_only && j % 2 == 0 ? 1.0 / static_cast<double>(j + 1) : 0.0);
      var[static_cast<size_t>(i)] = factor.matrixL().solve(f).squaredNorm();
      worst = std::max(worst, var[static_cast<size_t>(i)]);
      mean += var[static_cast<size_t>(i)] / setup_.points * (i == 0 || i == setup_.points - 1 ? 0.5 : 1.0);
    }
    if (request_.objective == Objective::kRms) {
      v->objective_dph = v->smooth_dph = std::sqrt(mean);
      return;
    }
    double sum = 0;
    for (double x : var) sum += std::pow(x / worst, 20);
    v->objective_dph = std::sqrt(worst);
    v->smooth_dph = std::sqrt(worst * std::pow(sum, 1.0 / 20));
  }

  const OptimizeRequest& request_;
  double duration_s_, dt_s_;
  CalibrationSetup setup_;
};

struct Candidate {
  ScheduleShape shape;
  std::vector<double> x;
  double value = 1e300;
};

// One use of NLopt.  The function's value is log(error) + a penalty on the correlation; an impossible schedule costs
// more than any possible one, the more the further off it is.
class Search {
 public:
  Search(const Evaluator& evaluator, bool tell_apart, double max_correlation, long* evaluations)
      : evaluator_(evaluator), tell_apart_(tell_apart), max_correlation_(max_correlation), count_(evaluations) {}

  double value(const ScheduleShape& shape, const std::vector<double>& x, bool smooth) const {
    ++*count_;
    const Evaluator::Value v = evaluator_(shape, x, tell_apart_);
    if (!v.possible) return 20 + v.excess_s / 1000;
    const double log_error = std::log(smooth ? v.smooth_dph : v.objective_dph);
    return log_error + (tell_apart_ ? 4 * std::max(0.0, v.correlation - max_correlation_) : 0.0);
  }

  void run(nlopt::algorithm algorithm, bool smooth, double step, int max_evaluations, Candidate* c) const {
    struct Context {
      const Search* search;
      const ScheduleShape* shape;
      bool smooth;
    } context{this, &c->shape, smooth};
    nlopt::opt opt(algorithm, static_cast<unsigned>(c->x.size()));
    opt.set_lower_bounds(0.0);
    opt.set_upper_bounds(1.0);
    opt.set_min_objective(
        [](const std::vector<double>& x, std::vector<double>&, void* data) {
          const auto* ctx = static_cast<const Context*>(data);
          return ctx->search->value(*ctx->shape, x, ctx->smooth);
        },
        &context);
    opt.set_initial_step(step);
    opt.set_ftol_abs(1e-6);
    opt.set_xtol_abs(1e-5);
    opt.set_maxeval(max_evaluations);
    std::vector<double> x = c->x;
    double found = 1e300;
    try {
      opt.optimize(x, found);
    } catch (const nlopt::roundoff_limited&) {  // x holds the best so far
    } catch (const std::runtime_error&) {
      return;  // nothing better than the start
    }
    const double now = value(c->shape, x, smooth);
    if (now <= value(c->shape, c->x, smooth)) {
      c->x = x;
      c->value = now;
    }
  }

 private:
  const Evaluator& evaluator_;
  bool tell_apart_;
  double max_correlation_;
  long* count_;
};

// Shapes that fit into the duration.
std::vector<ScheduleShape> accuracy_shapes(const OptimizeRequest& r, double duration_s) {
  std::vector<ScheduleShape> out;
  const int interior = std::max(0, r.setup.order - 1);
  const bool slow_ramps = r.limits.max_soak_s > 0;
  for (int passes : {1, 2, 3, 4, 6, 9, 12}) {
    for (const bool hot : {false, true}) {
      if (hot && passes % 2 == 0 && r.limits.heating_degc_per_min == r.limits.cooling_degc_per_min) continue;
      const int up = hot ? passes / 2 : (passes + 1) / 2;
      const double ramps_s = up * r.limits.traverse_s(true) + (passes - up) * r.limits.traverse_s(false);
      for (int n : {0, interior}) {
        const int stops = passes + 1 + n;
        if (ramps_s + r.limits.min_soak_s * stops > duration_s) continue;
        out.push_back(passes_shape(passes, n, 1, hot, slow_ramps));
        if (n == 0 && interior == 0) break;
      }
    }
  }
  return out;
}

std::vector<ScheduleShape> diagnosis_shapes(const OptimizeRequest& r, double duration_s) {
  std::vector<ScheduleShape> out;
  const auto chain = [](const char* name, std::vector<ScheduleShape::Stop> stops) {
    ScheduleShape s;
    s.name = name;
    s.stops = std::move(stops);
    s.free_rates = true;
    return s;
  };
  std::vector<ScheduleShape> all = {
      passes_shape(1, 2, 1, false, true),
      passes_shape(2, 2, 2, false, true),
      passes_shape(3, 1, 3, false, true),
      chain("up, back by half, up", {{0, false}, {0.6, true}, {0.3, true}, {1, false}}),
      chain("staircase up and down", {{0, false}, {0.33, true}, {0.67, true}, {1, false}, {0.67, true}, {0.33, true}, {0, true}}),
      chain("two partial loops", {{0, false}, {0.6, true}, {0.25, true}, {1, false}, {0.4, true}, {0.75, true}}),
      chain("from the middle", {{0.5, true}, {0, false}, {0.7, true}, {0.3, true}, {1, false}, {0.5, true}}),
  };
  for (const ScheduleShape& shape : all) {
    for (const bool mirrored : {false, true}) {
      ScheduleShape s = shape;
      if (mirrored) {
        for (ScheduleShape::Stop& stop : s.stops) stop.level = 1 - stop.level;
        s.name += ", mirrored";
      }
      Profile unused;
      double excess_s = 0;
      if (make_profile(s, s.start(), r.limits, duration_s, &unused, &excess_s)) out.push_back(s);
    }
  }
  return out;
}

void randomise(Rng* rng, std::vector<double>* x) {
  for (double& v : *x) v = std::clamp(v + 0.5 * (rng->uniform() - 0.5), 0.02, 0.98);
}

class Optimizer {
 public:
  explicit Optimizer(const OptimizeRequest& request) : request_(request) {}

  // The best candidate for a duration; `start_from` (may be empty) joins the starts.
  Candidate best_for(double duration_s, bool tell_apart, const std::vector<Candidate>& start_from, double share) {
    const double dt_s = coarse_step(duration_s);
    const Evaluator coarse(request_, duration_s, dt_s), exact(request_, duration_s, 1.0);
    const Search search(coarse, tell_apart, request_.max_correlation - 0.005, &evaluations_);
    const Search exact_search(exact, tell_apart, request_.max_correlation - 0.001, &evaluations_);
    std::vector<Candidate> found;
    std::vector<ScheduleShape> shapes = accuracy_shapes(request_, duration_s);
    if (tell_apart) shapes = diagnosis_shapes(request_, duration_s);
    const double scale = share * request_.effort;
    const int starts = tell_apart ? 2 : 3, first = static_cast<int>(scale * (tell_apart ? 250 : 300));
    Rng rng(request_.seed, 0, 0, Stream::kTool);
    if (start_from.empty()) {
      for (const ScheduleShape& shape : shapes) {
        for (int start = 0; start < starts; ++start) {
          Candidate c{shape, shape.start(), 1e300};
          if (start > 0) randomise(&rng, &c.x);
          search.run(nlopt::LN_BOBYQA, true, 0.2, first, &c);
          found.push_back(c);
          report(c);
        }
      }
    } else {
      found = start_from;
      for (Candidate& c : found) c.value = search.value(c.shape, c.x, true);
    }
    std::stable_sort(found.begin(), found.end(), [](const Candidate& a, const Candidate& b) { return a.value < b.value; });
    if (found.size() > 4) found.resize(4);
    for (Candidate& c : found) {
      search.run(nlopt::LN_SBPLX, false, 0.1, static_cast<int>(scale * (tell_apart ? 700 : 600)), &c);
      c.value = search.value(c.shape, c.x, false);
      report(c);
    }
    std::stable_sort(found.begin(), found.end(), [](const Candidate& a, const Candidate& b) { return a.value < b.value; });
    last_ = found;
    // The coarse grid leaves the ranking open within a few 1e-4: the exact figures decide.
    if (!tell_apart && start_from.empty())
      for (int passes : {1, 2, 3}) {
        Candidate paper{passes_shape(passes, 0, 0, false, false), {}, 1e300};
        paper.x = paper.shape.start();
        found.insert(found.begin() + std::min<std::ptrdiff_t>(2, static_cast<std::ptrdiff_t>(found.size())), paper);
      }
    Candidate best;
    for (size_t i = 0; i < found.size(); ++i) {
      Candidate& c = found[i];
      if (i < 2) exact_search.run(nlopt::LN_SBPLX, false, 0.02, static_cast<int>(scale * (tell_apart ? 60 : 120)), &c);
      c.value = exact_search.value(c.shape, c.x, false);
      if (c.value < best.value) best = c;
    }
    return best;
  }

  double exact_objective(const Candidate& c, double duration_s) {
    Profile profile;
    double excess_s = 0;
    if (!make_profile(c.shape, c.x, request_.limits, duration_s, &profile, &excess_s)) return 1e300;
    ++evaluations_;
    return Evaluator(request_, duration_s, 1.0).of_profile(profile, false).objective_dph;
  }

  const std::vector<Candidate>& last() const { return last_; }
  long evaluations() const { return evaluations_; }

  // Steps of the coarse grid: fine enough for the fastest Markov term that matters and for the ramps.
  double coarse_step(double duration_s) const {
    double step_s = duration_s / 500;
    for (const Markov& m : request_.setup.truth.markov)
      if (m.tau_s > 10 && m.sigma_dph > 0) step_s = std::min(step_s, m.tau_s / 5);
    step_s = std::min({step_s, request_.limits.traverse_s(true) / 30, request_.limits.traverse_s(false) / 30});
    return std::max(2.0, std::max(step_s, duration_s / 4000));
  }

 private:
  void report(const Candidate& c) {
    best_seen_ = std::min(best_seen_, c.value);
    if (request_.progress) request_.progress(0.5, std::exp(best_seen_));
  }

  const OptimizeRequest& request_;
  long evaluations_ = 0;
  double best_seen_ = 1e300;
  std::vector<Candidate> last_;
};

}  // namespace

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
    if (soaks_s > 0) text += " and two soaks of " + shown(limits.min_soak_s) + " s, " + shown(traverse_s + soaks_s) + " s in all";
    text += ", longer than --duration-s " + shown(duration_s) + "; any one of these makes it possible: --duration-s " +
            shown_up(traverse_s + soaks_s);
    if (duration_s > soaks_s) {
      const double time_s = duration_s - soaks_s;
      text += ", --max-rate " + shown_up(60 * limits.span_degc() / time_s) + ", a range of at most " +
              shown(std::floor(rate * time_s / 60 * 100) / 100) + " degC";
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
  Optimizer optimizer(request);
  const bool tell_apart = !request.tell_apart.empty();
  OptimizeResult result;
  double duration_s = request.duration_s;
  Candidate best;
  if (duration_s > 0) {
    best = optimizer.best_for(duration_s, tell_apart, {}, 1.0);
  } else {
    // Error falls about as 1/sqrt(duration): secant in logarithms, kept inside a bracket, shapes found anew each time
    // by the first search and polished from the last ones afterwards.
    const double shortest_s = std::min(request.limits.traverse_s(true), request.limits.traverse_s(false)) +
                              2 * request.limits.min_soak_s;
    const double p = request.setup.order + 1;
    double guess_s = std::max(shortest_s * 1.001 + 1, 1.1 * p * request.setup.truth.slow_density_dph2_s() /
                                                          (request.required_dph * request.required_dph));
    if (guess_s > 3e7)
      throw usage_error("--required-error " + shown(request.required_dph) + " dph would take about " +
                        shown(guess_s / 86400) + " days; the smallest error within 30 days is about " +
                        shown(std::sqrt(1.1 * p * request.setup.truth.slow_density_dph2_s() / 2592000)) + " dph");
    double lo_s = shortest_s, hi_s = 0;  // too short; long enough
    double share = 0.5;
    for (int round = 0; round < 10; ++round) {
      const Candidate c = optimizer.best_for(guess_s, tell_apart, {}, share);
      const double error_dph = optimizer.exact_objective(c, guess_s);
      if (error_dph <= request.required_dph) {
        hi_s = guess_s;
        best = c;
      } else {
        lo_s = guess_s;
      }
      if (hi_s > 0 && (hi_s - lo_s < 0.003 * hi_s || hi_s <= shortest_s * 1.0011 + 1)) break;
      double next_s = guess_s * std::pow(error_dph / request.required_dph * (error_dph > request.required_dph ? 1.0005 : 0.9995), 2);
      if (hi_s > 0) next_s = std::clamp(next_s, lo_s + 0.05 * (hi_s - lo_s), hi_s - 0.05 * (hi_s - lo_s));
      guess_s = std::max(next_s, shortest_s * 1.001 + 1);
    }
    if (hi_s == 0) throw usage_error("--required-error " + shown(request.required_dph) + " dph was not reached within " + shown(guess_s) + " s");
    duration_s = std::ceil(hi_s);
    best = optimizer.best_for(duration_s, tell_apart, {best}, 1.0);
  }
  Profile raw;
  double excess_s = 0;
  make_profile(best.shape, best.x, request.limits, duration_s, &raw, &excess_s);
  result.profile = rounded(raw, duration_s);
  result.shape = best.shape.name;
  const auto runs = runs_of_profile(result.profile);
  result.error = calibration_error(runs, request.setup);
  result.objective_dph = objective_of(result.error, request.objective);
  result.signatures = signature_table(runs, request.setup, tell_apart ? request.tell_apart : standard_effects(request.setup.order));
  if (tell_apart) {
    result.meets_correlation = result.signatures.worst <= request.max_correlation;
    const Candidate free = optimizer.best_for(duration_s, false, {}, 1.0);
    result.accuracy_only_dph = optimizer.exact_objective(free, duration_s);
  }
  if (request.required_dph > 0) result.meets_error = result.objective_dph <= request.required_dph * 1.0005;
  for (int passes = 1; passes <= 100; ++passes) {
    const Profile paper = paper_profile(request.limits, duration_s, passes);
    if (paper.duration_s() > duration_s + 1) break;
    const CalibrationError e = calibration_error(runs_of_profile(paper), request.setup);
    if (passes > 1 && objective_of(e, request.objective) >= objective_of(result.paper_error, request.objective)) {
      if (passes > result.paper_passes + 3) break;
      continue;
    }
    result.paper = paper;
    result.paper_passes = passes;
    result.paper_error = e;
  }
  result.evaluations = optimizer.evaluations();
  return result;
}

}  // namespace imucal
