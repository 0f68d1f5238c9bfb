// SPDX-License-Identifier: MIT
#include "analysis/diagnose/written_model.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "analysis/diagnose/believed.h"
#include "analysis/diagnose/judge/start_sizes.h"
#include "base/units.h"

namespace imucal {

namespace {

constexpr double kOtherNoise = 1.5; // between two axes: beyond this ratio a model of one is not one of the other
constexpr double kOtherBias = 3;    // the same of two polynomials: standard errors of their difference
constexpr int kBiasPlaces = 9;      // where they are compared, as many as a table has
// Of a process that an effect is: faster ones are white noise from second to second.
constexpr double kLeastTauOfEffect_s = 0.1;

// Whether an effect of the answer stands in the model that reproduces it.
bool is_written(const SelectedEffect& effect) {
  return effect.term.effect && effect.doubt != Doubt::kSlowNoise && !effect.is_of_some_logs;
}

bool is_in_mean(const Term& term) {
  return term.form() == Form::kColumns || term.form() == Form::kTemperature;
}

// What is written of one axis: its effects, the noise that they act on, the polynomial beside them, and the fit of both.
struct Written {
  const AxisResult& axis;
  std::vector<Term> effects;
  NoiseModel noise;
  Fit fit;
};

// The answer with the causes that are written.  Others stand in its mean too, free shapes above all, and may follow part of what
// the polynomial and the members do.
Hypothesis with_written(const Hypothesis& answer, const std::vector<Term>& effects, bool* is_other) {
  Hypothesis out = answer;
  out.terms.clear();
  const auto has = [](const std::vector<Term>& terms, const Term& term) {
    return std::any_of(terms.begin(), terms.end(), [&](const Term& t) { return t.estimator == term.estimator; });
  };
  for (const Term& term : answer.terms)
    if (!is_in_mean(term) || has(effects, term)) out.terms.push_back(term);
  *is_other = out.terms.size() < answer.terms.size();
  for (const Term& effect : effects)
    if (is_in_mean(effect) && !has(out.terms, effect)) out.terms.push_back(effect), *is_other = true;
  return out;
}

// The noise that the found effects act on, beside which they are written.  A kind of noise that is not written stays in it.
NoiseModel noise_beside_found(const Selection& s) {
  NoiseModel noise = s.final.base_noise;
  noise.telegraph_dph = noise.telegraph_tau_s = 0; // of the model that is believed, which keeps that effect
  for (const Term& term : s.final.terms) {
    const auto is_it = [&](const SelectedEffect& e) { return is_written(e) && e.term.effect == term.effect; };
    if (term.form() == Form::kNoise && std::none_of(s.effects.begin(), s.effects.end(), is_it))
      noise = term.estimator->noise(noise, term.shape);
  }
  return gaussian_equivalent(noise);
}
// How large the noise is, the seconds tell: where no kind is written, or one that adds a process, what is written is their noise.
void take_noise_of_seconds(const NoiseModel& seconds, Written* written) {
  NoiseModel& beside = written->noise;
  std::vector<Term>::iterator kind = written->effects.end();
  for (auto term = written->effects.begin(); term != written->effects.end(); ++term) {
    if (term->form() != Form::kNoise || term->estimator->is_nominal_noise()) continue;
    NoiseModel alone = term->estimator->noise({}, term->shape);
    const bool is_process = alone.markov.size() == 1;
    alone.markov.clear();
    if (!is_process || !(alone == NoiseModel()) || kind != written->effects.end()) return;
    kind = term;
  }
  const bool has_kind = kind != written->effects.end();
  if (has_kind && seconds.markov.size() != beside.markov.size() + 1) return;
  beside.white_sigma_dph = seconds.white_sigma_dph;
  beside.markov.assign(seconds.markov.begin(), seconds.markov.end() - (has_kind ? 1 : 0));
  if (has_kind) kind->shape = kind->estimator->like(seconds.markov.back());
}

Written written_of(const AxisResult& axis) {
  Written out{axis, {}, {}, {}};
  if (!axis.refused.empty()) return out;
  const Selection& selection = axis.study.selection;
  for (const SelectedEffect& effect : selection.effects)
    if (is_written(effect)) out.effects.push_back(effect.term);
  out.noise = noise_beside_found(selection);
  take_noise_of_seconds(selection.fitted_noise, &out);
  bool is_other = false;
  const Hypothesis h = with_written(selection.final, out.effects, &is_other);
  if (!is_other) {
    out.fit = axis.final_fit;
    return out;
  }
  out.fit = fit_hypothesis(axis.campaign, h);
  const Design design = make_design(axis.campaign, h);
  for (Term& effect : out.effects)
    for (size_t t = 0; t < h.terms.size(); ++t)
      if (is_in_mean(effect) && h.terms[t].estimator == effect.estimator) {
        effect.coefficients.clear();
        for (const long c : columns_of(design, t)) effect.coefficients.push_back(out.fit.beta[c]);
        const StartSizes sizes = start_sizes(axis.campaign, design, out.fit, h.terms[t], t);
        if (!sizes.runs.empty()) effect.coefficients = {sizes.largest.value};
      }
  return out;
}

// Other parameters of the believed noise are written as that noise.
void add_found(const Written& written, bool is_only_axis, ErrorModel* model) {
  for (const Term& effect : written.effects) {
    if (effect.estimator->is_nominal_noise()) continue;
    EffectSpec spec = spec_of(*effect.effect, effect_values(effect, written.axis.campaign));
    if (!is_only_axis) spec.axis = written.axis.axis;
    model->effects.push_back(spec);
  }
}

void set_noise(const NoiseModel& noise, ErrorModel* model) {
  model->arw_deg_rt_h = arw_from_white_sigma(noise.white_sigma_dph);
  model->markov = noise.markov;
}

void tell_other(const std::string& what, const AxisResult& written, const AxisResult& other, DiagnoseResult* out) {
  out->model_warnings.push_back("the model that is written has the " + what + " of axis " + written.axis +
                                "; that of axis " + other.axis + " differs: write a model of its own with --axis " +
                                other.axis);
}

// A model holds members, and the answer may be a family.
void tell_stand_ins(const AxisResult& axis, DiagnoseResult* out) {
  if (!axis.refused.empty()) return;
  for (const SelectedEffect& effect : axis.study.selection.effects)
    if (is_written(effect) && effect.is_family)
      out->model_warnings.push_back("axis " + axis.axis + ": the model that is written has " +
                                    effect.term.effect->name() + " in the place of the family " +
                                    family_name(effect.family) + ", whose member these logs do not tell");
}

// Without a believed model the one that is written has the noise of the first axis that was judged: the format knows one for
// all axes.
void add_noise(const Written& first, const std::vector<Written>& all, DiagnoseResult* out) {
  set_noise(first.noise, &out->model);
  const auto differs = [](double a, double b) { return std::max(a, b) > kOtherNoise * std::min(a, b); };
  for (const Written& other : all) {
    if (!is_judged(other.axis)) continue;
    ErrorModel own;
    set_noise(other.noise, &own);
    if (differs(own.arw_deg_rt_h, out->model.arw_deg_rt_h) ||
        differs(std::sqrt(own.slow_density_dph2_s()), std::sqrt(out->model.slow_density_dph2_s())))
      tell_other("noise", first.axis, other.axis, out);
  }
}

// Whether the answer names other noise than the believed one, and that one was estimated again: as other parameters, or beside a
// kind that is named.
bool has_other_noise(const AxisResult& axis) {
  if (!is_judged(axis) || !axis.study.selection.is_noise_retuned) return false;
  const std::vector<SelectedEffect>& effects = axis.study.selection.effects;
  return std::any_of(effects.begin(), effects.end(),
                     [](const SelectedEffect& e) { return is_written(e) && e.term.form() == Form::kNoise; });
}

// An effect of the library that is_it, with this theta, on one axis.
template <class F> EffectSpec noise_effect(F is_it, const Theta& theta, const std::string& axis) {
  EffectSpec spec;
  for (const Effect* effect : effect_library()) {
    const EffectEstimator* e = effect->estimator();
    if (!e || !is_it(*e)) continue;
    spec = spec_of(*effect, e->values({theta, {}, {}, {}}));
    break;
  }
  spec.axis = axis;
  return spec;
}
EffectSpec process_on(const std::string& axis, const Markov& process) {
  const Markov written{process.sigma_dph, std::max(process.tau_s, kLeastTauOfEffect_s)};
  const auto is_it = [&](const EffectEstimator& e) { // it adds this process and nothing else
    const Theta theta = e.like(written);
    if (theta.empty()) return false;
    NoiseModel alone;
    alone.markov = {written};
    return e.noise(NoiseModel(), theta) == alone;
  };
  return noise_effect(is_it, {written.sigma_dph, written.tau_s}, axis);
}
// All of the noise of one axis: it replaces white noise and the only process of the model.
void add_noise_of_axis(const std::string& axis, const NoiseModel& noise, std::vector<EffectSpec>* effects) {
  const Markov first = noise.markov.empty() ? Markov{0, 1} : noise.markov.front();
  const Theta theta = {noise.white_sigma_dph, first.sigma_dph, std::max(first.tau_s, kLeastTauOfEffect_s)};
  effects->push_back(noise_effect([](const EffectEstimator& e) { return e.is_nominal_noise(); }, theta, axis));
  for (size_t i = 1; i < noise.markov.size(); ++i) effects->push_back(process_on(axis, noise.markov[i]));
}

// Takes from the axes with other noise what the model believes of it beside white noise and one process, which
// add_noise_of_axis replaces: the others of `sensor` keep it, as effects of their own.
void keep_noise_of_others(const std::vector<std::string>& others, const std::vector<std::string>& changed,
                          ErrorModel* model) {
  std::vector<EffectSpec> kept;
  for (size_t i = 1; i < model->markov.size(); ++i)
    for (const std::string& axis : others) kept.push_back(process_on(axis, model->markov[i]));
  if (model->markov.size() > 1) model->markov.resize(1);
  for (const EffectSpec& spec : model->effects) {
    const auto is_of = [&](const std::string& axis) { return is_for(spec, axis); };
    if (!is_part_of_base_noise(spec) || std::none_of(changed.begin(), changed.end(), is_of)) {
      kept.push_back(spec);
      continue;
    }
    for (const std::string& axis : others)
      if (is_of(axis)) kept.push_back(spec), kept.back().axis = axis;
  }
  model->effects = kept;
}

// The noise that was found in the place of the believed one, whole: all processes were estimated again together.  Of a single
// axis it is that of the model; of several, each has its own.  It comes first: other effects change it.
void replace_noise(const std::vector<std::string>& sensor, const std::vector<Written>& all, DiagnoseResult* out) {
  std::vector<std::string> changed, others;
  std::vector<EffectSpec> own;
  for (const Written& written : all) {
    if (!has_other_noise(written.axis)) continue;
    changed.push_back(written.axis.axis);
    add_noise_of_axis(written.axis.axis, written.noise, &own);
  }
  if (changed.empty()) return;
  const bool is_only_axis = all.size() == 1;
  if (!is_only_axis)
    std::copy_if(sensor.begin(), sensor.end(), std::back_inserter(others), [&](const std::string& axis) {
      return std::find(changed.begin(), changed.end(), axis) == changed.end();
    });
  keep_noise_of_others(others, changed, &out->model);
  if (is_only_axis)
    set_noise(all.front().noise, &out->model);
  else
    out->model.effects.insert(out->model.effects.begin(), own.begin(), own.end());
}

// The polynomial that was fitted, with the normalisation that found effects are written in, and what their columns hold of it;
// its constant is the mean of those of the runs.
ThermalPolynomial bias_of(const Written& written) {
  const Campaign& campaign = written.axis.campaign;
  const Eigen::VectorXd& beta = written.fit.beta;
  const auto n_runs = static_cast<long>(campaign.runs.size());
  ThermalPolynomial bias{campaign.t0_degc, campaign.range_degc, {beta.head(n_runs).mean()}};
  for (int i = 0; i < campaign.order; ++i) bias.coeff_dph.push_back(beta[n_runs + i]);
  for (const Term& effect : written.effects) {
    if (!is_in_mean(effect)) continue;
    const std::vector<double> beside =
        effect.estimator->polynomial_beside(campaign.runs.front().input, effect.estimate());
    for (size_t i = 0; i < beside.size() && i < bias.coeff_dph.size(); ++i) bias.coeff_dph[i] += beside[i];
  }
  return bias;
}
// Its variance at a temperature.
double variance_of_bias(const Written& written, double temp_degc) {
  const Campaign& campaign = written.axis.campaign;
  const auto n_runs = static_cast<long>(campaign.runs.size());
  Eigen::VectorXd weight = Eigen::VectorXd::Zero(written.fit.beta.size());
  weight.head(n_runs).setConstant(1 / static_cast<double>(n_runs));
  const double tn = bias_of(written).normalised(temp_degc);
  for (int i = 0; i < campaign.order; ++i) weight[n_runs + i] = std::pow(tn, i + 1);
  return weight.dot(written.fit.beta_covariance * weight);
}
bool has_same_bias(const Written& a, const Written& b) {
  const ThermalPolynomial of_a = bias_of(a), of_b = bias_of(b);
  const double lo_degc = std::max(a.axis.campaign.lo_degc, b.axis.campaign.lo_degc),
               hi_degc = std::min(a.axis.campaign.hi_degc, b.axis.campaign.hi_degc);
  for (int k = 0; k < kBiasPlaces; ++k) {
    const double temp_degc = lo_degc + k * (hi_degc - lo_degc) / (kBiasPlaces - 1);
    const double error = std::sqrt(variance_of_bias(a, temp_degc) + variance_of_bias(b, temp_degc));
    if (std::fabs(of_a.at(temp_degc) - of_b.at(temp_degc)) > kOtherBias * error) return false;
  }
  return true;
}
// The format knows one polynomial, too.  Logs without temperature say nothing of it, not even its order.
void add_bias(const Written& first, const std::vector<Written>& all, DiagnoseResult* out) {
  if (!first.axis.campaign.has_temperature) return;
  out->model.bias = bias_of(first);
  for (const Written& other : all)
    if (is_judged(other.axis) && other.axis.campaign.has_temperature && !has_same_bias(first, other))
      tell_other("bias polynomial", first.axis, other.axis, out);
}

} // namespace

void complete_model(const std::vector<std::string>& sensor, DiagnoseResult* result) {
  std::vector<Written> all;
  for (const AxisResult& axis : result->axes) {
    all.push_back(written_of(axis));
    tell_stand_ins(axis, result);
  }
  if (result->has_model) replace_noise(sensor, all, result);
  for (const Written& written : all) add_found(written, all.size() == 1, &result->model);
  const auto first = std::find_if(all.begin(), all.end(), [](const Written& w) { return is_judged(w.axis); });
  if (first == all.end()) return;
  if (!result->has_model) add_noise(*first, all, result);
  if (!result->model.bias) add_bias(*first, all, result);
}

} // namespace imucal
