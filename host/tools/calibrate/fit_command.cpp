// SPDX-License-Identifier: MIT
#include "calibrate/fit_command.h"

#include <cmath>
#include <cstdio>

#include "base/range.h"
#include "io/table_json.h"

namespace imucal {

namespace {

const char* const kUnknownSerial = "unknown";

void take_range(const std::string& text, FitOptions* options) {
  const TemperatureRange range = parse_range("--range", text);
  options->t0_degc = (range.lo_degc + range.hi_degc) / 2;
  options->range_degc = range.width() / 2;
}

void print(const FitResult& result) {
  std::printf("%s over %zu log%s\n", result.method == FitOptions::Method::kKalman ? "Kalman filter" : "least squares",
              result.logs.size(), result.logs.size() == 1 ? "" : "s");
  for (const FitAxis& axis : result.axes) {
    const char* unit = axis.axis.size() > 3 && axis.axis.compare(axis.axis.size() - 3, 3, "_mg") == 0 ? "mg" : "dph";
    std::printf("%-12s order %d, %ld seconds (%ld without a measurement), residual %.4g %s rms\n", axis.axis.c_str(),
                axis.order, axis.n_used, axis.n_missing, axis.residual_rms_dph, unit);
    std::printf("  B(T) = sum b_i ((T - %.6g)/%.6g)^i, b =", axis.t0_degc, axis.range_degc);
    for (const double b : axis.coeff_dph) std::printf(" %.6g", b);
    std::printf(" %s\n  predicted one-sigma error:", unit);
    for (size_t i = 0; i < axis.temp_degc.size(); i += 2) std::printf("  %.4g at %.4g", axis.sigma_dph[i], axis.temp_degc[i]);
    std::printf(" degC\n");
    if (!axis.turn_on_dph.empty()) {
      std::printf("  turn-on constants:");
      for (const double a : axis.turn_on_dph) std::printf(" %.4g", a);
      std::printf(" %s\n", unit);
    }
  }
}

}  // namespace

void add_fit_options(CLI::App* app, FitArguments* a) {
  app->add_option("LOG", a->log_paths, "logs of one device, each with its own turn-on constant")->required()->type_name("LOG.csv");
  app->add_option("--method", a->method, "kf: the device's Kalman filter; poly: least squares by QR")
      ->check(CLI::IsMember({"kf", "poly"}))
      ->capture_default_str();
  app->add_option("--order", a->options.order, "order of the polynomial")->check(CLI::Range(1, IMUCAL_MAX_ORDER))->capture_default_str();
  app->add_option("--model", a->model_path, "error model (kf: required; poly: makes the predicted error honest)")->type_name("MODEL.json");
  app->add_option("--axis", a->options.axes, "axis to fit (repeat; default: all gyros)")->allow_extra_args(false);
  app->add_option("--range", a->range, "normalisation of temperature, degC (default: the model's, else what the logs span)")
      ->type_name("LOW:HIGH");
  app->add_flag("--shared-turn-on", a->options.shared_turn_on, "no power cycle between the logs: one constant for all");
  app->add_option("--prior-sigma", a->options.prior_sigma_dph, "kf: what is known of a coefficient beforehand")
      ->check(CLI::Range(1e-3, 1e6))
      ->capture_default_str();
  app->add_option("--serial", a->table.serial, "device serial for the table (default: the first log's)");
  app->add_option("-o,--output", a->table_path, "write the table")->type_name("TABLE.json");
}

Exit fit_command(const FitArguments& arguments, const CommonOptions& common) {
  FitOptions options = arguments.options;
  options.method = arguments.method == "poly" ? FitOptions::Method::kPolynomial : FitOptions::Method::kKalman;
  if (!arguments.model_path.empty()) options.model = read_model(arguments.model_path);
  if (!arguments.range.empty()) take_range(arguments.range, &options);
  std::vector<Log> logs;
  for (const std::string& path : arguments.log_paths) logs.push_back(read_log(path));
  FitResult result = fit_logs(logs, options);
  if (!arguments.table_path.empty()) {
    TableInfo info = arguments.table;
    if (info.serial.empty() && result.metadata.count("serial") == 0) {
      info.serial = kUnknownSerial;
      result.warnings.push_back("no serial in the log: the table is for serial \"unknown\" and no device takes it; give --serial");
    }
    write_table(arguments.table_path, make_table(result, info));
  }
  for (const std::string& warning : result.warnings) std::fprintf(stderr, "calibrate: note: %s\n", warning.c_str());
  if (common.wants_json()) write_json(common.json_path, to_json(result));
  if (common.talks()) print(result);
  return Exit::kDone;
}

}  // namespace imucal
