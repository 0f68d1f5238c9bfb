// SPDX-License-Identifier: MIT
#include "analysis/diagnose/written_model.h"

#include <algorithm>
#include <cmath>

namespace imucal {

namespace {

constexpr double kOtherNoise = 1.5; // between two axes: beyond this ratio a model of one is not one of the other
constexpr double kOtherBias = 3;    // the same of two polynomials: standard errors of their difference
constexpr int kBiasPlaces = 9;      // where they are compared, as many as a table has

// Whether an effect of the answer stands in the model that reproduces it.
bool is_written(const SelectedEffect& effect) {
  return effect.term.effect && effect.doubt != Doubt::kSlowNoise && !effect.is_of_some_logs;
}

void add_found(const AxisResult& axis, bool is_only_axis, ErrorModel* model) {
  for (const SelectedEffect& effect : axis.study.selection.effects) {
    if (!is_written(effect)) continue;
    EffectSpec spec = spec_of(*effect.term.effect, effect_values(effect.term, axis.campaign));
    if (!is_only_axis) spec.axis = axis.axis;
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
  model->arw_deg_rt_h = noise.white_sigma_dph / 60;
  model->markov = noise.markov;
}

void tell_other(const std::string& what, const AxisResult& written, const AxisResult& other, DiagnoseResult* out) {
  out->model_warnings.push_back("the model that is written has the " + what + " of axis " + written.axis +
                                "; that of axis " + other.axis + " differs: write a model of its own with --axis " +
                                other.axis);
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

// The polynomial that was fitted, with the normalisation that found effects are written in; its constant is the mean of those
// of the runs.
ThermalPolynomial bias_of(const AxisResult& axis) {
  const Campaign& campaign = axis.campaign;
  const Eigen::VectorXd& beta = axis.final_fit.beta;
  const auto n_runs = static_cast<long>(campaign.runs.size());
  ThermalPolynomial bias{campaign.t0_degc, campaign.range_degc, {beta.head(n_runs).mean()}};
  for (int i = 0; i < campaign.order; ++i) bias.coeff_dph.push_back(beta[n_runs + i]);
  return bias;
}
// Its variance at a temperature.
double variance_of_bias(const AxisResult& axis, double temp_degc) {
  const Campaign& campaign = axis.campaign;
  const auto n_runs = static_cast<long>(campaign.runs.size());
  Eigen::VectorXd weight = Eigen::VectorXd::Zero(axis.final_fit.beta.size());
  weight.head(n_runs).setConstant(1 / static_cast<double>(n_runs));
  const double tn = bias_of(axis).normalised(temp_degc);
  for (int i = 0; i < campaign.order; ++i) weight[n_runs + i] = std::pow(tn, i + 1);
  return weight.dot(axis.final_fit.beta_covariance * weight);
}
bool has_same_bias(const AxisResult& a, const AxisResult& b) {
  const ThermalPolynomial of_a = bias_of(a), of_b = bias_of(b);
  const double lo_degc = std::max(a.campaign.lo_degc, b.campaign.lo_degc),
               hi_degc = std::min(a.campaign.hi_degc, b.campaign.hi_degc);
  for (int k = 0; k < kBiasPlaces; ++k) {
    const double temp_degc = lo_degc + k * (hi_degc - lo_degc) / (kBiasPlaces - 1);
    const double error = std::sqrt(variance_of_bias(a, temp_degc) + variance_of_bias(b, temp_degc));
    if (std::fabs(of_a.at(temp_degc) - of_b.at(temp_degc)) > kOtherBias * error) return false;
  }
  return true;
}
// The format knows one polynomial, too.  Logs without temperature say nothing of it, not even its order.
void add_bias(const AxisResult& first, DiagnoseResult* out) {
  if (!first.campaign.has_temperature) return;
  out->model.bias = bias_of(first);
  for (const AxisResult& axis : out->axes)
    if (is_judged(axis) && axis.campaign.has_temperature && !has_same_bias(first, axis))
      tell_other("bias polynomial", first, axis, out);
}

} // namespace

void complete_model(DiagnoseResult* result) {
  const std::vector<AxisResult>& axes = result->axes;
  for (const AxisResult& axis : axes)
    if (axis.refused.empty()) add_found(axis, axes.size() == 1, &result->model);
  const auto first = std::find_if(axes.begin(), axes.end(), is_judged);
  if (first == axes.end()) return;
  if (!result->has_model) add_noise(*first, result);
  if (!result->model.bias) add_bias(*first, result);
}

} // namespace imucal
