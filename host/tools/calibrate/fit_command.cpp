// SPDX-License-Identifier: MIT
#include "calibrate/fit_command.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "analysis/fit/judge.h"
#include "base/digits.h"
#include "base/format.h"
#include "base/range.h"
#include "calibrate/fit_json.h"
#include "cli/text.h"
#include "device/recorder.h"
#include "io/table_json.h"

namespace imucal {

namespace {

const char* const kUnknownSerial = "unknown";

void take_range(const std::string& text, FitOptions* options) {
  const TemperatureRange range = parse_range("--range", text);
  options->t0_degc = (range.lo_degc + range.hi_degc) / 2;
  options->range_degc = range.width() / 2;
}

std::string join(const std::vector<std::string>& names) {
  std::string list;
  for (const std::string& name : names) list += (list.empty() ? "" : ", ") + name;
  return list;
}

// What the predicted error rests on where no model was given.
std::string basis_text(const NoiseModel& noise, const char* unit) {
  std::string out =
      format("    of the noise that the residuals show: white %.3g %s (1-s means)", noise.white_sigma_dph, unit);
  for (const Markov& m : noise.markov)
    out += format(", slow about %.3g %s over %s s", m.sigma_dph, unit, in_digits(m.tau_s, 2).c_str());
  return out + ", and of how little they show of it;\n    noise slower than a tenth of the log is not seen: give "
               "--model where "
               "it is known\n";
}

std::string rows_of(double dt_s) {
  char text[40];
  std::snprintf(text, sizeof text, "rows of %.6g s", dt_s);
  return std::abs(dt_s - 1) < 0.01 ? "seconds" : text;
}

// A sensor that shows no noise is not measured: nothing is learnt from it.
bool is_dead(const FitResult& result, const FitAxis& axis) {
  return std::any_of(result.reasons.begin(), result.reasons.end(), [&](const FitReason& r) {
    return r.axis == axis.axis && !r.is_accepted && r.rule == imucal_health_rule_name(IMUCAL_HEALTH_NO_NOISE);
  });
}

std::string axis_text(const FitResult& result, const FitAxis& axis) {
  const char* unit = axis.unit();
  std::string out = format("  B(T) = sum b_i ((T - %.6g)/%.6g)^i, b =", axis.t0_degc, axis.range_degc);
  for (const double b : axis.coeff_dph) out += format(" %.6g", b);
  out += std::string(" ") + unit + "\n  predicted one-sigma error:";
  for (size_t i = 0; i < axis.temp_degc.size(); i += 2)
    out += format("%s %.4g at %.4g", i > 0 ? "," : "", axis.sigma_dph[i], axis.temp_degc[i]);
  out += " degC\n";
  if (axis.residual_noise) out += basis_text(*axis.residual_noise, unit);
  if (const double sigma = turn_on_sigma(result, axis); sigma > 0) out += "  " + turn_on_words(sigma, unit) + "\n";
  if (axis.holds_gravity())
    out += "  b0 holds gravity along the axis, as it lay: a static test cannot tell it from the bias\n";
  if (axis.n_rejected + axis.n_bad_temperature > 0)
    out += format("  left out: %ld seconds with a knock, %ld with a temperature out of reach\n", axis.n_rejected,
                  axis.n_bad_temperature);
  if (!axis.first_left_out.empty()) out += "    the first of them: " + axis.first_left_out + "\n";
  if (!axis.not_judged.empty())
    out += "  not judged: " + join(axis.not_judged) +
           (axis.residual_noise ? " (what compares with a model needs --model)\n" : "\n");
  if (axis.turn_on_dph.empty()) return out;
  out += "  turn-on constants:";
  for (const double a : axis.turn_on_dph) out += format(" %.4g", a);
  return out + " " + unit + "\n";
}

std::string text_of(const FitResult& result) {
  std::string out =
      format("%s over %zu log%s\n", result.method == FitOptions::Method::kKalman ? "Kalman filter" : "least squares",
             result.logs.size(), result.logs.size() == 1 ? "" : "s");
  for (const FitAxis& axis : result.axes) {
    out +=
        format("%-12s order %d, %ld %s (%ld without a measurement), residual %.4g %s rms\n", axis.axis.c_str(),
               axis.order, axis.n_used, rows_of(axis.dt_s).c_str(), axis.n_missing, axis.residual_rms_dph, axis.unit());
    out += is_dead(result, axis) ? "  no noise: not a calibration, so no coefficients\n" : axis_text(result, axis);
  }
  return out;
}

// What became of it, and what to do with it.
std::string outcome_text(const FitResult& result, const std::string& table_path) {
  if (!result.is_accepted()) return ""; // tell_reasons does
  return table_path.empty() ? "no table written: -o TABLE.json writes one\n"
                            : "written to " + table_path + "; next: calibrate --port PORT flash " + table_path + "\n";
}

// Why there is no table, also with --quiet: it is the answer.
void tell_reasons(const FitResult& result, bool wants_table) {
  for (const FitReason& reason : result.reasons)
    say(stderr, std::string("calibrate: ") + (reason.is_accepted ? "accepted: " : "") + reason.axis + ": " +
                    reason.text + "\n");
  if (!result.is_accepted())
    say(stderr, std::string("calibrate: not accepted") + (wants_table ? ", no table written" : "") +
                    "; to insist: --accept RULE\n");
}

} // namespace

void add_prior_sigma(cli::App* app, double* sigma, const std::string& help) {
  const cli::Check check = cli::Range(1e-3, 1e6);
  const cli::Option* option = app->add_option("--prior-sigma-dph", *sigma, help)->check(check)->capture_default_str();
  app->add_old_name("--prior-sigma", *sigma, option)->check(check);
}

void add_fit_options(cli::App* app, FitArguments* a) {
  app->add_option("LOG", a->log_paths, "logs of one device, each with its own turn-on constant")
      ->required()
      ->type_name("LOG.csv");
  app->add_option("--method", a->method, "kf: the device's Kalman filter; poly: least squares by QR")
      ->check(cli::IsMember({"kf", "poly"}))
      ->capture_default_str();
  app->add_option("--order", a->options.order, "order of the polynomial")
      ->check(cli::Range(1, IMUCAL_MAX_ORDER))
      ->capture_default_str();
  app->add_option("--model", a->model_paths,
                  "error model (kf: required; poly: without it the noise is what the residuals show); repeat: one of "
                  "the gyros and one "
                  "of the accelerometers (\"unit\": \"mg\")")
      ->allow_extra_args(false)
      ->type_name("MODEL.json");
  app->add_option("--axis", a->options.axes, "axis to fit (repeat; default: all gyros, or all that the models are of)")
      ->allow_extra_args(false);
  app->add_option("--range", a->range,
                  "normalisation of temperature, degC (default: the model's, else what the logs span)")
      ->type_name("LOW:HIGH");
  app->add_flag("--shared-turn-on", a->options.shared_turn_on, "no power cycle between the logs: one constant for all");
  add_prior_sigma(app, &a->options.prior_sigma_dph, "kf: what is known of a coefficient beforehand");
  app->add_option("--accept", a->options.accept,
                  "make a table although this rule speaks against it (repeat): " + join(fit_rules()))
      ->allow_extra_args(false)
      ->type_name("RULE");
  app->add_option("--max-error", a->options.max_error_dph,
                  "largest predicted one-sigma error to accept, dph (accelerometers: mg); default 100 dph, 10 mg")
      ->check(FinitePositive)
      ->type_name("ERROR");
  app->add_flag("--ignore-metadata", a->options.ignore_metadata,
                "fit logs of different devices or serial numbers together");
  app->add_option("--serial", a->table.serial, "device serial for the table (default: the first log's)");
  app->add_option("-o,--output", a->table_path, "write the table")->writes()->type_name("TABLE.json");
}

namespace {

// One model for all axes, or one of the gyros and one of the accelerometers.
void take_models(const std::vector<std::string>& paths, FitOptions* options) {
  if (paths.size() > 2) throw usage_error("--model: one model, or one of the gyros and one of the accelerometers");
  for (const std::string& path : paths) {
    const ErrorModel model = read_model(path);
    if (options->method == FitOptions::Method::kKalman && !(model.arw_deg_rt_h > 0))
      throw data_error(path + ": arw_deg_rt_h is 0: the filter needs white noise; state the sensor's " +
                       (model.unit == "mg" ? "white noise (white_mg_rt_hz)" : "angle random walk"));
    std::optional<ErrorModel>* place =
        paths.size() == 2 && model.unit == "mg" ? &options->accel_model : &options->model;
    if (*place)
      throw usage_error("--model " + path + ": two models of one kind; of two one must be an accelerometer's and say " +
                        "\"unit\": \"mg\"");
    *place = model;
  }
}

} // namespace

Exit fit_command(const FitArguments& arguments, const CommonOptions& common) {
  FitOptions options = arguments.options;
  options.method = arguments.method == "poly" ? FitOptions::Method::kPolynomial : FitOptions::Method::kKalman;
  take_models(arguments.model_paths, &options);
  if (!arguments.range.empty()) take_range(arguments.range, &options);
  std::vector<Log> logs;
  for (const std::string& path : arguments.log_paths) logs.push_back(read_log(path));
  FitResult result = fit_logs(logs, options);
  if (result.is_accepted() && !arguments.table_path.empty()) {
    TableInfo info = arguments.table;
    if (info.serial.empty() && result.metadata.count("serial") == 0) {
      info.serial = kUnknownSerial;
      result.warnings.push_back(
          "no serial in the log: the table is for serial \"unknown\" and no device takes it; give --serial");
    }
    write_table(arguments.table_path, make_table(result, info), table_notes(result));
  }
  for (const std::string& warning : result.warnings) say(stderr, "calibrate: note: " + warning + "\n");
  if (common.wants_json()) write_json(common.json_path, to_json(result));
  if (common.talks()) say(stdout, text_of(result) + outcome_text(result, arguments.table_path));
  tell_reasons(result, !arguments.table_path.empty());
  return result.is_accepted() ? Exit::kDone : Exit::kNegative;
}

Exit recover_command(const RecoverArguments& arguments, const CommonOptions& common) {
  const std::string& part = arguments.part_path;
  const std::string suffix = ".part";
  std::string output = arguments.output_path;
  if (output.empty()) {
    if (part.size() <= suffix.size() || part.compare(part.size() - suffix.size(), suffix.size(), suffix) != 0)
      throw usage_error(part + ": does not end in .part; name the log to write with -o");
    output = part.substr(0, part.size() - suffix.size());
  }
  const size_t rows = recover_log(part, output, arguments.may_overwrite);
  if (common.wants_json()) write_json(common.json_path, {{"log", output}, {"seconds", rows}});
  if (common.talks()) std::printf("%s: %zu seconds recovered\n", output.c_str(), rows);
  return Exit::kDone;
}

} // namespace imucal
