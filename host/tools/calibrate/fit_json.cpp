// SPDX-License-Identifier: MIT
#include "calibrate/fit_json.h"

#include <cmath>

#include "base/format.h"

namespace imucal {

double turn_on_sigma(const FitResult& result, const FitAxis& axis) {
  const std::optional<ErrorModel>& model =
      axis.holds_gravity() && result.accel_model ? result.accel_model : result.model;
  return model ? model->turn_on_sigma_dph : 0;
}

std::string turn_on_words(double sigma, const std::string& unit) {
  return format("b0 holds the turn-on constant (%.4g %s from run to run), which the predicted error does not count",
                sigma, unit.c_str());
}

Json judgement_json(const std::vector<FitReason>& reasons) {
  Json list = Json::array();
  for (const FitReason& r : reasons)
    list.push_back({{"axis", r.axis},
                    {"rule", r.rule},
                    {"value", r.value},
                    {"limit", r.limit},
                    {"text", r.text},
                    {"accepted", r.is_accepted}});
  return {{"accepted", is_accepted(reasons)}, {"reasons", list}};
}

namespace {

std::vector<double> scaled(std::vector<double> values, double factor) {
  for (double& value : values) value *= factor;
  return values;
}

Json health_json(const imucal_health_verdict_t& verdict) {
  Json json = Json::object();
  for (uint32_t rule = 0; rule < IMUCAL_HEALTH_N_RULES; ++rule)
    if (verdict.judged >> rule & 1U)
      json[imucal_health_rule_name(rule)] = {{"value", verdict.value[rule]}, {"limit", verdict.limit[rule]}};
  return json;
}

Json noise_json(const NoiseModel& noise) {
  Json json = {{"white_1s_dph", noise.white_sigma_dph}, {"markov", Json::array()}};
  for (const Markov& m : noise.markov) json["markov"].push_back({{"sigma_dph", m.sigma_dph}, {"tau_s", m.tau_s}});
  return json;
}

} // namespace

Json to_json(const FitResult& result) {
  Json json;
  json["method"] = result.method == FitOptions::Method::kKalman ? "kf" : "poly";
  json["logs"] = result.logs;
  json["axes"] = Json::array();
  for (const FitAxis& axis : result.axes) {
    Json a;
    a["axis"] = axis.axis;
    a["unit"] = axis.unit();
    if (axis.holds_gravity()) a["b0_holds"] = "gravity along the axis as it lay, and the bias";
    a["order"] = axis.order;
    a["t0_degc"] = axis.t0_degc;
    a["range_degc"] = axis.range_degc;
    a["coeff_dph"] = axis.coeff_dph;
    Json sigma = Json::array();
    const size_t n = axis.coeff_dph.size();
    for (size_t i = 0; i < n; ++i) sigma.push_back(std::sqrt(std::max(0.0, axis.covariance_dph2[i * n + i])));
    a["coeff_sigma_dph"] = sigma;
    a["temp_degc"] = axis.temp_degc;
    a["sigma_dph"] = axis.sigma_dph;
    a["sigma_basis"] = axis.sigma_basis;
    if (const double turn_on = turn_on_sigma(result, axis); turn_on > 0) a["turn_on_sigma_dph"] = turn_on;
    if (axis.residual_noise) a["residual_noise"] = noise_json(*axis.residual_noise);
    a["residual_rms_dph"] = axis.residual_rms_dph;
    if (axis.residual_noise) a["expected_residual_dph"] = axis.expected_residual_dph;
    a["span_degc"] = {axis.span_lo_degc, axis.span_hi_degc};
    a["n_used"] = axis.n_used;
    a["n_missing"] = axis.n_missing;
    if (!axis.turn_on_dph.empty()) a["turn_on_dph"] = axis.turn_on_dph;
    if (result.method == FitOptions::Method::kKalman) {
      a["mean_nis"] = axis.mean_nis;
      a["lag1"] = axis.lag1;
    }
    a["n_rejected"] = axis.n_rejected;
    if (!axis.first_left_out.empty()) a["first_left_out"] = axis.first_left_out;
    if (axis.n_far_off > 0) a["far_off"] = {{"n", axis.n_far_off}, {"first", axis.first_far_off}};
    a["not_judged"] = axis.not_judged;
    a["n_bad_temperature"] = axis.n_bad_temperature;
    a["error_factor"] = axis.error_factor;
    if (axis.error_factor > 1) a["rescaled_sigma_dph"] = scaled(axis.sigma_dph, axis.error_factor);
    a["health"] = health_json(axis.health);
    json["axes"].push_back(a);
  }
  json["judgement"] = judgement_json(result.reasons);
  if (!result.warnings.empty()) json["warnings"] = result.warnings;
  return json;
}

} // namespace imucal
