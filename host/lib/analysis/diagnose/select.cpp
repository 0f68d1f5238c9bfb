// SPDX-License-Identifier: MIT
#include "analysis/diagnose/select.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

namespace imucal {

namespace {

constexpr double kPolishAbsolute_nats = 15, kPolishRelative = 0.12;
constexpr double kStepCost_nats = 9, kStepKept_nats = 12;
constexpr int kMostSteps = 6;
constexpr double kGrave = 0.002; // part of the samples clipped or dead from which the mean is biased
// A library-free test that explains this much more than the named effects says that the names are wrong.
constexpr double kUnknownFactor = 1.02, kUnknownMargin_nats = 4;
constexpr double kUnknownNoiseFactor = 1.05;
constexpr double kCarries = 0.1; // part of the whole gain that one name at least has to hold
constexpr double kAsGood_nats = 1.0;
constexpr double kNamedShare = 0.9;      // named part of what is explained that still counts as an answer
constexpr double kPatchworkShare = 0.99; // the same of three names, which could approximate any shape
constexpr double kCancel = 2; // gain of one name over that of all: from here on the names cancel each other

class Selector {
public:
  Selector(Campaign* campaign, const Hypothesis& nominal, const std::vector<const Effect*>& library,
           const std::vector<bool>& active, const Calibration& calibration, const Thresholds& thresholds,
           const SelectOptions& options)
      : campaign_(*campaign), library_(library), active_(active), calibration_(calibration), thr_(thresholds),
        options_(options) {
    out_.nominal = nominal;
    for (size_t j = 0; j < library.size(); ++j)
      if (library[j]->estimator() && library[j]->estimator()->is_nominal_noise())
        retune_ = static_cast<int>(j);
  }

  Selection run() {
    structural();
    out_.nominal.terms = h_.terms;
    bank_.reset(new ColumnBank(campaign_, library_));
    start_value_ = fit().log_likelihood;
    start_energy_ = block_energy();
    for (int round = 0; round < options_.max_effects + 1; ++round) {
      if (n_counted() >= options_.max_effects) break;
      const Fit now = fit();
      const Panel panel(bank_.get(), h_, round == 0 ? PanelScope::kAll : PanelScope::kCandidates);
      const PanelScores scores = panel.score(now, calibration_.spectrum);
      if (round == 0) out_.before = findings(scores);
      if (!step(panel, scores, now)) break;
      if (chosen_.size() >= 2) backward();
    }
    finish();
    return out_;
  }

private:
  struct Choice {
    size_t candidate;
    SelectedEffect effect;
  };

  // The structural effects that may be named, in the order of their detection.
  std::vector<size_t> structural_effects() const {
    std::vector<size_t> places;
    for (size_t j = 0; j < library_.size(); ++j)
      if (active_[j] && library_[j]->estimator() && library_[j]->estimator()->is_structural())
        places.push_back(j);
    std::sort(places.begin(), places.end(), [&](size_t a, size_t b) {
      return library_[a]->estimator()->detection_order() < library_[b]->estimator()->detection_order();
    });
    return places;
  }
  bool is_in(size_t j) const {
    for (const Choice& c : chosen_)
      if (c.candidate == j) return true;
    return false;
  }
  // Re-tuned noise is a finding of its own and takes no place.
  int n_counted() const {
    int n = 0;
    for (const Choice& c : chosen_) n += static_cast<int>(c.candidate) != retune_;
    return n;
  }
  // A mixture claims a shape of the distribution besides: one more.
  size_t n_parameters(size_t j) const {
    const EffectEstimator& estimator = *library_[j]->estimator();
    const NoiseModel base = out_.nominal.base_noise;
    const bool is_mixture = estimator.form() == Form::kNoise &&
                            estimator.noise(base, estimator.starts(base).front()).is_mixture();
    return library_[j]->parameters().size() + (is_mixture ? 1 : 0);
  }
  Term term_of(size_t j, const Theta& shape) const {
    Term term;
    term.effect = library_[j];
    term.estimator = library_[j]->estimator();
    term.shape = shape;
    return term;
  }

  // Deterministic signatures first: what they spoil is left out of all that follows.
  void structural() {
    h_ = out_.nominal;
    for (const size_t j : structural_effects()) {
      const EffectEstimator* estimator = library_[j]->estimator();
      std::vector<RunInput> inputs;
      for (const CampaignRun& run : campaign_.runs) inputs.push_back(run.input);
      const auto signature = estimator->detect(inputs);
      if (!signature) continue;
      SelectedEffect effect;
      effect.term = term_of(j, {});
      effect.term.fixed_parameters = signature->parameters;
      effect.is_structural = true;
      effect.statement = signature->statement;
      effect.gain_nats = effect.evidence_nats = signature->evidence_nats;
      effect.p_value = 0;
      effect.set = {{library_[j]->name(), signature->evidence_nats, 0, signature->evidence_nats,
                     std::numeric_limits<double>::quiet_NaN()}};
      structural_.push_back(effect);
      h_.base_noise.extra_white_dph2 += signature->extra_white_dph2;
      const double samples = static_cast<double>(campaign_.n());
      is_on_lattice_ = is_on_lattice_ || signature->extra_white_dph2 > 0;
      if (!signature->unusable.empty()) mask(&campaign_, signature->unusable);
      if (estimator->is_censoring()) {
        is_censored_ = true;
        is_gravely_censored_ = static_cast<double>(campaign_.n()) < (1 - kGrave) * samples;
      }
    }
    out_.nominal.base_noise = h_.base_noise;
  }

  // What censoring distorts cannot be judged: the spread of the samples; the mean too, where many are
  // missing.
  bool is_suppressed(size_t j) const {
    if (is_gravely_censored_) return true;
    if (!is_censored_) return false;
    const Form form = library_[j]->estimator()->form();
    return form == Form::kNoise || form == Form::kRunRandom;
  }

  std::vector<GenericFinding> findings(const PanelScores& scores) const {
    std::vector<GenericFinding> out;
    for (size_t g = 0; g < scores.generic.size(); ++g) {
      const std::string& name = generic_names()[g];
      if (is_gravely_censored_) continue;
      if (is_on_lattice_ && (name == "distribution" || name == "asymmetry")) continue;
      if (is_censored_ && (name.rfind("variance", 0) == 0 || name == "distribution" || name == "spectrum" ||
                           name == "bursts" || name == "asymmetry"))
        continue;
      out.push_back({g, scores.generic[g], thr_.generic[g]});
    }
    return out;
  }

  // Evidence of all candidates over h_; noise candidates near the top by their exact likelihood.
  std::vector<CandidateEvidence> scan(const PanelScores& scores, std::vector<Theta>* shapes) {
    const size_t n = library_.size();
    std::vector<CandidateEvidence> list(n);
    shapes->assign(n, {});
    double top = 0;
    for (size_t j = 0; j < n; ++j) {
      list[j].name = library_[j]->name();
      list[j].threshold_nats = thr_.named[j];
      list[j].gain_nats = usable(j) ? scores.named[j].gain_nats : 0;
      if (static_cast<int>(j) == retune_) list[j].gain_nats *= options_.noise_discount;
      (*shapes)[j] = scores.named[j].shape;
      list[j].gain_reestimated_nats = std::numeric_limits<double>::quiet_NaN();
      top = std::max(top, list[j].gain_nats);
    }
    const double near = top - std::max(kPolishAbsolute_nats, kPolishRelative * top);
    std::unique_ptr<NoiseObjective> objective;
    double base_value = 0;
    for (size_t j = 0; j < n; ++j) {
      if (!usable(j) || library_[j]->estimator()->form() != Form::kNoise) continue;
      if (list[j].gain_nats < near || list[j].gain_nats < list[j].threshold_nats - 4) continue;
      const NoiseModel base = h_.noise();
      if (!objective) {
        objective.reset(new NoiseObjective(campaign_, h_));
        base_value = base.is_mixture() ? objective->mixture(base) : objective->reml(base);
      }
      const NoiseFit best = polish(*objective, j, base, scores.named[j].shape);
      list[j].gain_nats = std::max(0.0, best.value - base_value);
      if (static_cast<int>(j) == retune_) list[j].gain_nats *= options_.noise_discount;
      (*shapes)[j] = best.theta;
    }
    for (CandidateEvidence& c : list) c.evidence_nats = c.gain_nats - c.threshold_nats;
    return list;
  }
  NoiseFit polish(const NoiseObjective& objective, size_t j, const NoiseModel& base,
                  const Theta& start) const {
    std::vector<Theta> starts;
    if (!start.empty()) starts.push_back(start);
    if (library_[j]->estimator()->noise(base, library_[j]->estimator()->starts(base).front()).is_mixture() &&
        library_[j]->estimator()->has_markov_spectrum())
      for (Theta other : library_[j]->estimator()->starts(base)) starts.push_back(other);
    return fit_noise(objective, *library_[j]->estimator(), base, starts, 40);
  }
  bool usable(size_t j) const {
    const EffectEstimator* estimator = library_[j]->estimator();
    if (!estimator || !active_[j] || is_suppressed(j)) return false;
    if (is_in(j)) return false;
    return true;
  }
  bool is_mean(size_t j) const {
    const Form form = library_[j]->estimator()->form();
    return form == Form::kColumns || form == Form::kTemperature || form == Form::kRunRandom ||
           form == Form::kTone || form == Form::kSteps;
  }
  // The same cause repeats in every run: what slow noise cannot do.
  bool is_repeatable(size_t j) const {
    const Form form = library_[j]->estimator()->form();
    return form == Form::kColumns || form == Form::kTemperature;
  }

  // What re-estimated noise parameters gain over a hypothesis, by restricted likelihood.
  double retuned(const Hypothesis& h, const std::vector<Theta>& starts) {
    const NoiseObjective objective(campaign_, h);
    const NoiseModel base = h.noise();
    const EffectEstimator& retune = *library_[static_cast<size_t>(retune_)]->estimator();
    return std::max(0.0, fit_noise(objective, retune, base, starts, 40).value - objective.reml(base));
  }
  // Gain of candidate j with the noise parameters estimated with and without it (`retune_gain`).
  double reestimated_gain(size_t j, const Theta& shape, double retune_gain) {
    Hypothesis with = h_;
    with.terms.push_back(term_of(j, shape));
    return fit_hypothesis(campaign_, with).log_likelihood - fit().log_likelihood + retuned(with, {}) -
           retune_gain;
  }

  // One addition to h_.  False: nothing holds.
  bool step(const Panel& panel, const PanelScores& scores, const Fit& fit) {
    std::vector<Theta> shapes;
    std::vector<CandidateEvidence> list = scan(scores, &shapes);
    if (out_.first_scan.empty()) out_.first_scan = list;
    std::vector<bool> excluded(list.size(), false);
    double retune_gain = retune_ >= 0 ? scores.named[static_cast<size_t>(retune_)].gain_nats : 0;
    bool is_exact = false; // a periodogram takes a mean that is left for noise, and counts it too high
    while (true) {
      int best = -1;
      for (size_t j = 0; j < list.size(); ++j)
        if (usable(j) && !excluded[j] && list[j].evidence_nats > 0 &&
            (best < 0 || list[j].evidence_nats > list[static_cast<size_t>(best)].evidence_nats))
          best = static_cast<int>(j);
      if (best < 0) return false;
      // Of those that explain it as well, the one with fewest parameters (telegraph noise has the spectrum of
      // a Markov process, which has that of a random walk as its limit).
      const int strongest = best;
      for (size_t j = 0; j < list.size(); ++j)
        if (usable(j) && !excluded[j] && list[j].evidence_nats > 0 &&
            list[j].evidence_nats > list[static_cast<size_t>(strongest)].evidence_nats - kAsGood_nats &&
            n_parameters(j) < n_parameters(static_cast<size_t>(best)))
          best = static_cast<int>(j);
      const size_t b = static_cast<size_t>(best);
      if (is_mean(b) && retune_ >= 0 && list[b].evidence_nats < retune_gain && !h_.noise().is_mixture() &&
          !is_in(static_cast<size_t>(retune_))) {
        if (!is_exact) {
          const Theta& start = scores.named[static_cast<size_t>(retune_)].shape;
          retune_gain = retuned(h_, start.empty() ? std::vector<Theta>{} : std::vector<Theta>{start});
          is_exact = true;
        }
        const double gain = reestimated_gain(b, shapes[b], retune_gain);
        list[b].gain_reestimated_nats = gain;
        if (gain < list[b].threshold_nats) {
          excluded[b] = true;
          out_.notes.push_back(list[b].name + " gains " + number(list[b].gain_nats) +
                               " nats with the nominal noise but only " + number(gain) +
                               " when the noise is re-estimated: not named");
          continue;
        }
      }
      if (!is_mean(b) && library_[b]->estimator()->is_slow_noise()) {
        if (const int repeatable = repeatable_under(b, shapes, list); repeatable >= 0) {
          const size_t j = static_cast<size_t>(repeatable);
          out_.notes.push_back(list[b].name + " alone would explain " + number(list[b].gain_nats) +
                               " nats, but slow noise can absorb any smooth change; with it in place " +
                               list[j].name + " still gains " + number(list[j].gain_reestimated_nats) +
                               " nats, so the repeatable cause is named first");
          accept(j, shapes[j], list, panel, fit);
          return true;
        }
      }
      accept(b, shapes[b], list, panel, fit);
      return true;
    }
  }
  static std::string number(double x) {
    char text[32];
    std::snprintf(text, sizeof text, "%.0f", x);
    return text;
  }

  // A repeatable candidate that holds with the nominal noise and with the slow noise `b` in the model: the
  // best one.
  int repeatable_under(size_t b, const std::vector<Theta>& shapes, std::vector<CandidateEvidence>& list) {
    bool any = false;
    for (size_t j = 0; j < list.size(); ++j)
      any = any || (usable(j) && j != b && is_repeatable(j) && list[j].evidence_nats > 0);
    if (!any) return -1;
    Hypothesis slow = h_;
    slow.terms.push_back(term_of(b, shapes[b]));
    const Panel panel(bank_.get(), slow, PanelScope::kCandidates);
    const PanelScores scores = panel.score(fit_hypothesis(campaign_, slow), {});
    int best = -1;
    double best_evidence = 0;
    for (size_t j = 0; j < list.size(); ++j) {
      if (!usable(j) || !is_repeatable(j) || list[j].evidence_nats <= 0) continue;
      list[j].gain_reestimated_nats = scores.named[j].gain_nats;
      const double evidence = scores.named[j].gain_nats - list[j].threshold_nats;
      if (evidence > best_evidence) best = static_cast<int>(j), best_evidence = evidence;
    }
    return best;
  }

  void accept(size_t j, const Theta& shape, const std::vector<CandidateEvidence>& list, const Panel& panel,
              const Fit& fit) {
    Choice choice;
    choice.candidate = j;
    choice.effect.term = term_of(j, shape);
    choice.effect.gain_nats = list[j].gain_nats;
    choice.effect.evidence_nats = list[j].evidence_nats;
    choice.effect.set.push_back(list[j]);
    for (size_t i = 0; i < list.size(); ++i)
      if (i != j && usable(i) && list[i].evidence_nats > 0 &&
          list[i].evidence_nats > list[j].evidence_nats - options_.set_width_nats)
        choice.effect.set.push_back(list[i]);
    std::sort(choice.effect.set.begin() + 1, choice.effect.set.end(),
              [](const auto& a, const auto& b) { return a.evidence_nats > b.evidence_nats; });
    choice.effect.p_value = thr_.p_value(choice.effect.evidence_nats);
    refine(panel, fit, &choice.effect.term);
    chosen_.push_back(choice);
    rebuild();
    if (choice.effect.term.form() == Form::kSteps) more_steps();
    if (chosen_.size() > 1) refine_together();
  }
  Hypothesis all_but(const Choice& left_out) const {
    Hypothesis others = out_.nominal;
    for (const Choice& c : chosen_)
      if (&c != &left_out) others.terms.push_back(c.effect.term);
    return others;
  }
  // What was found first was found without the rest: its shape is searched again beside it.
  void refine_together() {
    for (Choice& c : chosen_) {
      const Hypothesis others = all_but(c);
      const Form form = c.effect.term.form();
      if (form == Form::kNoise) {
        const NoiseObjective objective(campaign_, others);
        const NoiseFit best =
            fit_noise(objective, *c.effect.term.estimator, others.noise(), {c.effect.term.shape}, 25);
        if (best.theta.size()) c.effect.term.shape = best.theta;
      } else if (form == Form::kColumns || form == Form::kTemperature) {
        const Panel panel(bank_.get(), others, PanelScope::kDesign);
        refine(panel, fit_hypothesis(campaign_, others), &c.effect.term);
      }
    }
    rebuild();
  }
  void rebuild() {
    Hypothesis h = out_.nominal;
    for (const Choice& c : chosen_) h.terms.push_back(c.effect.term);
    h_ = h;
    fit_.reset();
  }
  // The fit of h_.
  const Fit& fit() {
    if (!fit_) fit_.reset(new Fit(fit_hypothesis(campaign_, h_)));
    return *fit_;
  }

  // Shape parameters off the grid.
  void refine(const Panel& panel, const Fit& fit, Term* term) {
    const EffectEstimator& estimator = *term->estimator;
    Theta lo = estimator.shape_lo(), hi = estimator.shape_hi();
    SearchOptions options;
    options.max_evaluations = 30;
    options.tolerance = 0.005;
    if (term->form() == Form::kTone) {
      const double width = 1.0 / longest();
      lo = {term->shape[0] - width}, hi = {term->shape[0] + width};
      options.step = 0.3 * width;
      options.tolerance = 1e-4;
    } else if (term->form() == Form::kSteps) {
      refine_step(panel, fit, estimator, &term->shape, 0);
      return;
    } else if ((term->form() != Form::kColumns && term->form() != Form::kTemperature) || lo.empty()) {
      return;
    } else {
      options.step = std::max(0.02, 0.1 * std::fabs(term->shape[0]));
    }
    maximise([&](const Theta& shape) { return panel.gain_at(estimator, shape, fit); }, &term->shape, lo, hi,
             options);
  }
  void refine_step(const Panel& panel, const Fit& fit, const EffectEstimator& estimator, Theta* shape,
                   size_t s) {
    const size_t r = static_cast<size_t>((*shape)[2 * s]);
    const RunInput& in = campaign_.runs[r].input;
    const double centre = (*shape)[2 * s + 1];
    double best = -1, at = centre;
    for (double t : in.t_s) {
      if (t < centre - 45 || t > centre + 45) continue;
      const double gain = panel.gain_at(estimator, {(*shape)[2 * s], t}, fit);
      if (gain > best) best = gain, at = t;
    }
    (*shape)[2 * s + 1] = at;
  }
  // Further steps: each has to earn more than its cost.
  void more_steps() {
    SelectedEffect& effect = chosen_.back().effect;
    for (int i = 1; i < kMostSteps; ++i) {
      const Panel panel(bank_.get(), h_, PanelScope::kDesign);
      const CandidateScore next = panel.best_step(fit());
      if (next.gain_nats < kStepKept_nats || next.shape.size() != 2) return;
      Theta one = next.shape;
      refine_step(panel, fit(), *effect.term.estimator, &one, 0);
      effect.term.shape.insert(effect.term.shape.end(), one.begin(), one.end());
      effect.gain_nats += next.gain_nats;
      effect.evidence_nats += next.gain_nats - kStepCost_nats;
      rebuild();
    }
  }
  double longest() const {
    double t = 1;
    for (const CampaignRun& run : campaign_.runs) t = std::max(t, run.input.t_s.back());
    return t;
  }

  // Each earlier effect is taken out and the scan repeated: another may now be better, or none needed.
  void backward() {
    for (size_t c = 0; c + 1 < chosen_.size(); ++c) {
      const std::vector<Choice> before = chosen_;
      const double total = fit().log_likelihood;
      const Choice removed = chosen_[c];
      chosen_.erase(chosen_.begin() + static_cast<long>(c));
      rebuild();
      const Fit now = fit();
      const Panel panel(bank_.get(), h_, PanelScope::kCandidates);
      std::vector<Theta> shapes;
      std::vector<CandidateEvidence> list = scan(panel.score(now, calibration_.spectrum), &shapes);
      size_t best = removed.candidate;
      for (size_t j = 0; j < list.size(); ++j)
        if (usable(j) && list[j].evidence_nats > list[best].evidence_nats + 1.0) best = j;
      if (list[removed.candidate].evidence_nats <= 0 && list[best].evidence_nats <= 0) {
        return; // dropped: the later effect explains it all
      }
      if (best != removed.candidate && list[best].evidence_nats > 0) {
        accept(best, shapes[best], list, panel, now);
        if (fit().log_likelihood > total + 0.5) return;
      }
      const double evidence = list[removed.candidate].evidence_nats;
      chosen_ = before;
      chosen_[c].effect.evidence_nats = evidence;
      chosen_[c].effect.gain_nats = list[removed.candidate].gain_nats;
      chosen_[c].effect.p_value = thr_.p_value(evidence);
      // The set anew, over a model in which the other effects are known.
      std::vector<CandidateEvidence> set{list[removed.candidate]};
      for (size_t j = 0; j < list.size(); ++j)
        if (j != removed.candidate && usable_beside(j, c) && list[j].evidence_nats > 0 &&
            list[j].evidence_nats > evidence - options_.set_width_nats)
          set.push_back(list[j]);
      std::sort(set.begin() + 1, set.end(),
                [](const auto& a, const auto& b) { return a.evidence_nats > b.evidence_nats; });
      chosen_[c].effect.set = set;
      rebuild();
    }
  }
  bool usable_beside(size_t j, size_t c) const {
    for (size_t i = 0; i < chosen_.size(); ++i)
      if (i != c && chosen_[i].candidate == j) return false;
    return library_[j]->estimator() && active_[j] && !is_suppressed(j);
  }

  void finish() {
    const Fit last = fit();
    out_.total_gain_nats = last.log_likelihood - start_value_;
    // Comparable only under one and the same noise.
    block_gain_ = h_.noise().is_mixture() || any_noise_term() ? -1e300 : start_energy_ - block_energy();
    estimate_shape_errors();
    if (chosen_.empty())
      out_.after = out_.before;
    else
      out_.after = findings(Panel(bank_.get(), h_, PanelScope::kAll).score(last, calibration_.spectrum));
    fill_coefficients(last);
    out_.final = h_;
    out_.effects = structural_;
    for (Choice& c : chosen_) out_.effects.push_back(c.effect);
    judge();
  }

  double block_energy() { return 0.5 * bank_->reduce(fit().e).squaredNorm(); }
  bool any_noise_term() const {
    for (const Choice& c : chosen_)
      if (c.effect.term.form() == Form::kNoise) return true;
    return false;
  }

  // Curvature of the likelihood over the shape parameters of one effect, the others as found.
  void estimate_shape_errors() {
    for (Choice& c : chosen_) {
      Term& term = c.effect.term;
      const EffectEstimator& estimator = *term.estimator;
      const Hypothesis others = all_but(c);
      if (term.form() == Form::kNoise) {
        const NoiseObjective objective(campaign_, others);
        const NoiseModel base = others.noise();
        const auto f = [&](const Theta& theta) {
          const NoiseModel noise = estimator.noise(base, theta);
          return noise.is_mixture() ? objective.mixture(noise) : objective.reml(noise);
        };
        term.shape_errors = curvature_errors(f, term.shape, estimator.theta_lo(), estimator.theta_hi());
      } else if ((term.form() == Form::kColumns || term.form() == Form::kTemperature) &&
                 !estimator.shape_lo().empty()) {
        const Panel panel(bank_.get(), others, PanelScope::kDesign);
        const Fit without = fit_hypothesis(campaign_, others);
        term.shape_errors =
            curvature_errors([&](const Theta& shape) { return panel.gain_at(estimator, shape, without); },
                             term.shape, estimator.shape_lo(), estimator.shape_hi());
      }
    }
  }

  void fill_coefficients(const Fit& fit) {
    const Design design = make_design(campaign_, h_);
    for (size_t t = 0; t < chosen_.size(); ++t) {
      Term& term = chosen_[t].effect.term;
      term.coefficients.clear();
      term.coefficient_errors.clear();
      for (size_t c = 0; c < design.cols(); ++c)
        if (design.term_of_column[c] == static_cast<int>(t)) {
          term.coefficients.push_back(fit.beta[static_cast<long>(c)]);
          term.coefficient_errors.push_back(fit.beta_errors[static_cast<long>(c)]);
        }
    }
    rebuild();
  }

  void judge() {
    double cost = 0;
    for (const Choice& c : chosen_) cost += thr_.named[c.candidate];
    double fired = 0, most_mean = -1e300, most_noise = -1e300;
    for (const GenericFinding& f : out_.after) fired = std::max(fired, f.evidence_nats());
    for (const GenericFinding& f : out_.before) {
      const std::string& name = generic_names()[f.test];
      if (!competes(name)) continue;
      double& most = name == "spectrum" || name == "variance_over_temperature" ? most_noise : most_mean;
      most = std::max(most, f.evidence_nats());
    }
    const bool remains = fired > 0;
    // A free mean that explains more than the names (slow noise in the place of an unknown cause, mostly)
    // takes them back; both gains are those of block sums.  A free spectrum is compared with a margin: its
    // gain is that of an approximation, which overstates what a mean leaves in the lowest bins; a cause in
    // the mean is not judged by it.
    const double in_blocks = block_gain_ - cost, limit = total_named_gain() - cost;
    const bool is_stand_in =
        !chosen_.empty() && most_mean > kUnknownFactor * std::max(limit, in_blocks) + kUnknownMargin_nats;
    const bool outdone = is_stand_in || (!chosen_.empty() && !is_carried_by_mean() &&
                                         most_noise > kUnknownNoiseFactor * limit + kUnknownMargin_nats);
    const double most_before = is_stand_in ? most_mean : std::max(most_mean, most_noise);
    // Several names of which none carries the gain.
    double strongest = 0;
    for (const Choice& c : chosen_) strongest = std::max(strongest, c.effect.evidence_nats);
    const double rest = std::max(0.0, fired), named_all = std::max(1e-9, total_named_gain());
    const bool is_patchwork =
        (chosen_.size() >= 3 && (strongest < kCarries * named_all ||
                                 (remains && named_all < kPatchworkShare * (named_all + rest)))) ||
        (remains && chosen_.size() >= 2 && strongest > kCancel * named_all);
    if (out_.effects.empty()) {
      out_.verdict = remains ? Verdict::kUnexplained : Verdict::kNoGap;
    } else if (structural_.empty() && (is_stand_in || is_patchwork)) {
      out_.verdict = Verdict::kUnexplained;
      out_.notes.push_back(
          is_stand_in ? "a library-free mean explains " + number(most_mean) +
                            " nats beyond its threshold, the named effects " + number(total_named_gain()) +
                            " in all: the names are stand-ins"
                      : "the named effects approximate the gap together, none of them carries it: the "
                        "names are stand-ins");
    } else if (!remains && !outdone) {
      out_.verdict = Verdict::kExplained;
    } else {
      double left = 0;
      for (const GenericFinding& f : out_.after) left = std::max(left, f.evidence_nats());
      if (outdone) left = std::max(left, most_before - total_named_gain());
      const double named = std::max(0.0, total_named_gain());
      if (outdone)
        out_.notes.push_back("a library-free shape explains " + number(most_before) +
                             " nats beyond its threshold, the named effects " + number(named) +
                             " in all: the names may be stand-ins for something else");
      const bool mostly = !structural_.empty() || named > kNamedShare * (named + left);
      out_.verdict = mostly ? Verdict::kPartlyExplained : Verdict::kUnexplained;
    }
  }
  double total_named_gain() const { return out_.total_gain_nats; }
  bool is_carried_by_mean() const {
    double mean = 0, all = 0;
    for (const Choice& c : chosen_) {
      all += c.effect.gain_nats;
      if (is_mean(c.candidate)) mean += c.effect.gain_nats;
    }
    return mean > 0.5 * all;
  }
  static bool competes(const std::string& name) {
    return name == "temperature" || name == "temperature_and_direction" || name == "time_in_log" ||
           name == "temperature_and_time" || name == "delayed_temperature" || name == "spectrum" ||
           name == "variance_over_temperature";
  }

  Campaign& campaign_;
  const std::vector<const Effect*>& library_;
  const std::vector<bool>& active_;
  const Calibration& calibration_;
  const Thresholds& thr_;
  SelectOptions options_;
  Selection out_;
  std::unique_ptr<ColumnBank> bank_; // of the campaign as masked
  Hypothesis h_;
  std::unique_ptr<Fit> fit_; // of h_, when known
  std::vector<Choice> chosen_;
  std::vector<SelectedEffect> structural_;
  bool is_censored_ = false, is_gravely_censored_ = false, is_on_lattice_ = false;
  int retune_ = -1;
  double start_value_ = 0, start_energy_ = 0, block_gain_ = 0;
};

} // namespace

std::string to_text(Verdict verdict) {
  switch (verdict) {
  case Verdict::kNoGap:
    return "no_gap";
  case Verdict::kExplained:
    return "explained";
  case Verdict::kPartlyExplained:
    return "partly_explained";
  case Verdict::kUnexplained:
    return "unexplained";
  }
  return "";
}

Selection select_effects(Campaign* campaign, const Hypothesis& nominal,
                         const std::vector<const Effect*>& library, const std::vector<bool>& active,
                         const Calibration& calibration, const Thresholds& thresholds,
                         const SelectOptions& options) {
  return Selector(campaign, nominal, library, active, calibration, thresholds, options).run();
}

} // namespace imucal
