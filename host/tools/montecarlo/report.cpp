// SPDX-License-Identifier: MIT
#include "montecarlo/report.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "analysis/montecarlo/reference.h"
#include "analysis/montecarlo/residual.h"
#include "analysis/montecarlo/truth.h"
#include "base/quantile.h"

namespace imucal {

namespace {

constexpr double kOneSigma = 0.682689492137086, kTwoSigma = 0.954499736103642;

double ratio_or_zero(double a, double b) {
  return b > 0 ? a / b : 0.0;
}

std::vector<double> root_mean(const std::vector<double>& sums, double n) {
  std::vector<double> out;
  for (const double s : sums) out.push_back(std::sqrt(s / n));
  return out;
}

// Interval of a mean of `n` chi-square variables of `dof` degrees of freedom each.
Json chi2_mean_interval(double dof, double n) {
  return {chi2_quantile(0.025, dof * n) / n, chi2_quantile(0.975, dof * n) / n};
}

Json accuracy(const Tally& t, Json* json) {
  const auto runs = static_cast<double>(t.counted("runs"));
  const auto predicted = root_mean(t.sums("variance"), runs), empirical = root_mean(t.sums("error2"), runs);
  Json ratio = Json::array(), ci = Json::array(), mean = Json::array();
  double lowest = 1e300, highest = 0;
  for (size_t i = 0; i < predicted.size(); ++i) {
    const double r = empirical[i] / predicted[i];
    ratio.push_back(r);
    ci.push_back({r * std::sqrt(runs / chi2_quantile(0.975, runs)), r * std::sqrt(runs / chi2_quantile(0.025, runs))});
    mean.push_back(t.sums("error")[i] / runs);
    lowest = std::min(lowest, r);
    highest = std::max(highest, r);
  }
  (*json)["predicted_sigma_dph"] = predicted;
  (*json)["empirical_sigma_dph"] = empirical;
  (*json)["ratio"] = ratio;
  (*json)["ratio_ci95"] = ci;
  (*json)["ratio_range"] = {lowest, highest};
  (*json)["mean_error_dph"] = mean;
  (*json)["mean_worst_error_dph"] = t.sum("worst_error") / runs;
  return ratio;
}

Json coverage(const Tally& t) {
  const auto runs = static_cast<double>(t.counted("runs"));
  const auto band = [&](const std::string& name, double expected) {
    Json part = Json::array();
    for (const int64_t n : t.counts(name)) part.push_back(static_cast<double>(n) / runs);
    const double half = 1.959964 * std::sqrt(expected * (1 - expected) / runs);
    return Json{{"part", part}, {"expected", expected}, {"ci95", {expected - half, expected + half}}};
  };
  return {{"one_sigma", band("within1", kOneSigma)}, {"two_sigma", band("within2", kTwoSigma)}};
}

Json whiteness(const CampaignPlan& plan, const Tally& t) {
  Json lags = Json::array(), correlation = Json::array(), half_width = Json::array();
  for (size_t i = 0; i < t.sums("lags").size(); ++i) {
    const auto n = static_cast<double>(t.counts("lags")[i]);
    lags.push_back(kInnovationLags[i]);
    correlation.push_back(ratio_or_zero(t.sums("lags")[i], n));
    half_width.push_back(n > 0 ? 1.959964 / std::sqrt(n) : 1.0);
  }
  const auto runs = static_cast<double>(t.counted("runs"));
  return {{"from_s", plan.chain.white_from_s},
          {"lag_s", lags},
          {"correlation", correlation},
          {"ci95_half_width", half_width},
          // Mean innovation, squared and normalised: 1 when the mean is zero.
          {"mean2", {{"mean", t.sum("mean_innovation2") / runs}, {"ci95", chi2_mean_interval(1, runs)}}}};
}

Json least_squares(const CampaignPlan& plan, const Tally& t) {
  const auto runs = static_cast<double>(t.counted("ls_runs"));
  const auto sigma = root_mean(t.sums("ls_error2"), runs), difference = root_mean(t.sums("ls_difference2"), runs);
  return {{"runs", t.counted("ls_runs")},
          {"every", plan.options.least_squares_every},
          {"empirical_sigma_dph", sigma},
          {"rms_difference_dph", difference},
          {"mean_largest_difference_dph", t.sum("ls_largest_difference") / runs},
          {"largest_difference_dph", t.maximum("ls_largest_difference")}};
}

} // namespace

// Exact covariance beside what was found: the same where filter and truth agree.
static void add_truth(const CampaignPlan& plan, Json* json) {
  const TruthCovariance truth = truth_covariance(plan);
  Json sigma = Json::array(), ratio = Json::array();
  double lowest = 1e300, highest = 0, off = 0;
  for (size_t i = 0; i < plan.temp_degc.size(); ++i) {
    const double tn = (plan.temp_degc[i] - plan.chain.t0_degc) / plan.chain.range_degc;
    const double exact = std::sqrt(bias_variance_dph2(truth.actual, tn));
    const double believed = std::sqrt(bias_variance_dph2(truth.believed, tn));
    const double r = double((*json)["empirical_sigma_dph"][i]) / exact;
    sigma.push_back(exact);
    ratio.push_back(r);
    lowest = std::min(lowest, r);
    highest = std::max(highest, r);
    off = std::max(off, std::abs(double((*json)["predicted_sigma_dph"][i]) / believed - 1));
  }
  (*json)["truth_sigma_dph"] = sigma;
  (*json)["ratio_to_truth"] = ratio;
  (*json)["ratio_to_truth_range"] = {lowest, highest};
  (*json)["predicted_to_exact_rel"] = off; // the core's sigma against exact covariance analysis
}

Json campaign_json(const CampaignPlan& plan, const CampaignResult& result) {
  const Tally& t = result.tally;
  Json json = {{"runs", t.counted("runs")},     {"seed", plan.options.seed},
               {"first_run", result.first_run}, {"interrupted", result.is_interrupted},
               {"order", plan.options.order},   {"duration_s", plan.t_s.size()},
               {"temp_degc", plan.temp_degc}};
  if (t.counted("runs") == 0) return json;
  const auto runs = static_cast<double>(t.counted("runs")), seconds = static_cast<double>(t.counted("seconds"));
  accuracy(t, &json);
  add_truth(plan, &json);
  json["coverage"] = coverage(t);
  if (const auto n = static_cast<double>(t.counted("nees_runs")); n > 0) {
    const double p = plan.options.order + 1;
    json["nees"] = {{"mean", t.sum("nees") / n}, {"expected", p}, {"ci95", chi2_mean_interval(p, n)}};
  } else {
    json["nees"] = nullptr; // the true polynomial is of higher order than the fitted one
  }
  // The first innovations carry the true coefficients, far inside the wide prior, instead of noise: their sum
  // of squares is that of the seconds less the coefficients (exactly: N - p + |b|^2/prior^2 +
  // trace(P)/prior^2).
  const double dof = seconds - runs * (plan.options.order + 1);
  json["nis"] = {{"mean", t.sum("nis") / dof}, {"expected", 1.0}, {"n", dof}, {"ci95", chi2_mean_interval(1, dof)}};
  json["whiteness"] = whiteness(plan, t);
  if (t.counted("ls_runs")) json["least_squares"] = least_squares(plan, t);
  if (t.counted("reference_runs"))
    json["double_reference"] = {{"runs", t.counted("reference_runs")},
                                {"largest_bias_difference_dph", t.maximum("reference_bias_dph")},
                                {"largest_sigma_difference_rel", t.maximum("reference_sigma_rel")}};
  json["compensation"] = {{"largest_error_lsb", t.maximum("comp_lsb")}};
  if (t.has("residual_runs")) json["residual_dp"] = residual_json(plan, t);
  json["seconds_missed_per_run"] = static_cast<double>(t.counted("missed")) / runs;
  json["seconds_refused"] = t.counted("refused");
  json["samples_dropped"] = t.counted("dropped");
  json["raw_rate_hz"] = plan.options.raw.rate_hz;
  json["elapsed_s"] = result.elapsed_s;
  json["samples_per_s"] = ratio_or_zero(seconds, result.elapsed_s);
  json["samples_per_s_per_core"] = ratio_or_zero(seconds, result.cpu_s);
  return json;
}

namespace {

// printf onto the end of a text.
template <typename... Args> void put(std::string* out, const char* format, Args... args) {
  char text[400];
  const int n = std::snprintf(text, sizeof text, format, args...);
  out->append(text, static_cast<size_t>(std::min<int>(n, sizeof text - 1)));
}
void put(std::string* out, const char* text) {
  out->append(text);
}

void put_mean(std::string* out, const char* name, const Json& json) {
  const double mean(json["mean"]), lo(json["ci95"][0]), hi(json["ci95"][1]);
  put(out, "%-24s %10.5f   expected in [%.5f, %.5f] %s\n", name, mean, lo, hi,
      mean >= lo && mean <= hi ? "" : "  OUTSIDE");
}

void put_accuracy(std::string* out, const Json& json) {
  const bool has_ls = json.contains("least_squares");
  put(out, "   degC  predicted  empirical   ratio   95%% interval    1-sigma  2-sigma%s\n",
      has_ls ? "   least sq.  Kalman-LS" : "");
  for (size_t i = 0; i < json["temp_degc"].size(); ++i) {
    put(out, "%7.1f %9.2f %10.2f  %7.4f  [%.3f, %.3f]  %7.4f  %7.4f", double(json["temp_degc"][i]),
        double(json["predicted_sigma_dph"][i]), double(json["empirical_sigma_dph"][i]), double(json["ratio"][i]),
        double(json["ratio_ci95"][i][0]), double(json["ratio_ci95"][i][1]),
        double(json["coverage"]["one_sigma"]["part"][i]), double(json["coverage"]["two_sigma"]["part"][i]));
    if (has_ls)
      put(out, "  %9.2f  %9.2f", double(json["least_squares"]["empirical_sigma_dph"][i]),
          double(json["least_squares"]["rms_difference_dph"][i]));
    put(out, "\n");
  }
}

void put_residual(std::string* out, const Json& json) {
  put(out, "residual after compensation, a fresh test of the same device (DP2, dph; %ld tests):\n", long(json["runs"]));
  put(out, "   tau s      found   standard error   model alone   model + calibration error\n");
  for (size_t i = 0; i < json["tau_s"].size(); ++i)
    put(out, "%8.0f  %9.3f  %15.3f  %12.3f  %26.3f\n", double(json["tau_s"][i]), double(json["dp_dph"][i]),
        double(json["std_error_dph"][i]), double(json["model_dph"][i]), double(json["expected_dph"][i]));
  if (json["left_out_tau_s"].empty()) return;
  put(out, "%8s  no window without a gap after the nominal filter has settled, at %zu of the tau\n", "",
      json["left_out_tau_s"].size());
}

} // namespace

std::string campaign_text(const Json& json) {
  std::string out;
  put(&out, "%ld runs of %ld s, order %d, seed %llu%s\n", long(json["runs"]), long(json["duration_s"]),
      int(json["order"]), static_cast<unsigned long long>(json["seed"]),
      bool(json["interrupted"]) ? "  (stopped before the end)" : "");
  if (long(json["runs"]) == 0) return out;
  put(&out, "one-sigma calibration error, dph\n");
  put_accuracy(&out, json);
  put(&out, "empirical / predicted    %.4f … %.4f\n", double(json["ratio_range"][0]), double(json["ratio_range"][1]));
  put(&out, "empirical / exact        %.4f … %.4f   (truth covariance of this filter on the true model)\n",
      double(json["ratio_to_truth_range"][0]), double(json["ratio_to_truth_range"][1]));
  put(&out, "core's sigma - exact     %.2g relative\n", double(json["predicted_to_exact_rel"]));
  if (!json["nees"].is_null()) put_mean(&out, "NEES of the coefficients", json["nees"]);
  put_mean(&out, "NIS", json["nis"]);
  put_mean(&out, "mean innovation (squared)", json["whiteness"]["mean2"]);
  put(&out, "innovation correlation  ");
  for (size_t i = 0; i < json["whiteness"]["lag_s"].size(); ++i)
    put(&out, " %+.5f @%ds", double(json["whiteness"]["correlation"][i]), int(json["whiteness"]["lag_s"][i]));
  put(&out, "   (95%% within %.5f)\n", double(json["whiteness"]["ci95_half_width"][0]));
  if (json.contains("least_squares"))
    put(&out, "Kalman - least squares   %.2f dph at most, on average over tests; %.2f dph in the worst test\n",
        double(json["least_squares"]["mean_largest_difference_dph"]),
        double(json["least_squares"]["largest_difference_dph"]));
  if (json.contains("double_reference"))
    put(&out, "float32 core - double    B(T) %.2g dph, sigma %.2g relative (largest of %ld tests)\n",
        double(json["double_reference"]["largest_bias_difference_dph"]),
        double(json["double_reference"]["largest_sigma_difference_rel"]), long(json["double_reference"]["runs"]));
  put(&out, "compensation             %.3f LSB of its output at most from the table\n",
      double(json["compensation"]["largest_error_lsb"]));
  if (json.contains("residual_dp")) put_residual(&out, json["residual_dp"]);
  put(&out, "%.3g simulated seconds per second, %.3g per core (%g raw samples each)\n", double(json["samples_per_s"]),
      double(json["samples_per_s_per_core"]), double(json["raw_rate_hz"]));
  return out;
}

} // namespace imucal
