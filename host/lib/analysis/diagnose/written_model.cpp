// SPDX-License-Identifier: MIT
#include "analysis/diagnose/written_model.h"

#include <algorithm>
#include <cmath>

#include "analysis/diagnose/judge/start_sizes.h"
#include "base/units.h"

namespace imucal {

namespace {

constexpr double kOtherNoise = 1.5; // between two axes: beyond this ratio a model of one is not one of the other
constexpr double kOtherBias = 3;    // the same of two polynomials: standard errors of their difference
constexpr int kBiasPlaces = 9;      // where they are compared, as many as a table has

// Whether an effect of the answer stands in the model that reproduces it.
bool is_written(const SelectedEffect& effect) {
  return effect.term.effect && effect.doubt != Doubt::kSlowNoise && !effect.is_of_some_logs;
}

bool is_in_mean(const Term& term) {
  return term.form() == Form::kColumns || term.form() == Form::kTemperature;
}

// What is written of one axis: its effects, the polynomial beside them, and the fit of both.
struct Written {
  const AxisResult& axis;
  std::vector<Term> effects;
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

Written written_of(const AxisResult& axis) {
  Written out{axis, {}, {}};
  if (!axis.refused.empty()) return out;
  const Selection& selection = axis.study.selection;
  for (const SelectedEffect& effect : selection.effects)
    if (is_written(effect)) out.effects.push_back(effect.term);
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

void add_found(const Written& written, bool is_only_axis, ErrorModel* model) {
  for (const Term& effect : written.effects) {
    EffectSpec spec = spec_of(*effect.effect, effect_values(effect, written.axis.campaign));
    if (!is_only_axis) spec.axis = written.axis.axis;
    model->effects.push_back(spec);
  }
}

// The noise that the found effects act on, beside which they are written.  A kind of noise that is not written stays in it.
NoiseModel noise_beside_found(const Selection& s) {
  NoiseModel noise = s.final.base_noise;
  for (const Term& term : s.final.terms) {
    const auto is_it = [&](const SelectedEffect& e) { return is_written(e) && e.term.effect == term.effect; };
    if (term.form() == Form::kNoise && std::none_of(s.effects.begin(), s.effects.end(), is_it))
      noise = term.estimator->noise(noise, term.shape);
  }
  return gaussian_equivalent(noise);
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
void add_noise(const AxisResult& first, DiagnoseResult* out) {
  set_noise(noise_beside_found(first.study.selection), &out->model);
  const auto differs = [](double a, double b) { return std::max(a, b) > kOtherNoise * std::min(a, b); };
  for (const AxisResult& axis : out->axes) {
    if (!is_judged(axis)) continue;
    ErrorModel own;
    set_noise(noise_beside_found(axis.study.selection), &own);
    if (differs(own.arw_deg_rt_h, out->model.arw_deg_rt_h) ||
        differs(std::sqrt(own.slow_density_dph2_s()), std::sqrt(out->model.slow_density_dph2_s())))
      tell_other("noise", first, axis, out);
  }
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

void complete_model(DiagnoseResult* result) {
  std::vector<Written> all;
  for (const AxisResult& axis : result->axes) {
    all.push_back(written_of(axis));
    tell_stand_ins(axis, result);
  }
  for (const Written& written : all) add_found(written, all.size() == 1, &result->model);
  const auto first = std::find_if(all.begin(), all.end(), [](const Written& w) { return is_judged(w.axis); });
  if (first == all.end()) return;
  if (!result->has_model) add_noise(first->axis, result);
  if (!result->model.bias) add_bias(*first, all, result);
}

} // namespace imucal
