// SPDX-License-Identifier: MIT
#include "analysis/diagnose/nulls.h"

#include <sys/stat.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "base/error.h"
#include "base/parallel.h"
#include "base/progress.h"
#include "io/json_file.h"

namespace imucal {

using Eigen::VectorXd;

namespace {

// Changes whenever a score is computed in another way: old calibrations are then not found.
constexpr int kScoreVersion = 4;
constexpr double kSmallestThreshold = 0.8;

class Hash {
public:
  void add(const void* data, size_t n) {
    const unsigned char* p = static_cast<const unsigned char*>(data);
    for (size_t i = 0; i < n; ++i) {
      a_ = (a_ ^ p[i]) * 0x100000001b3ull;
      b_ = (b_ ^ p[i]) * 0x9E3779B97F4A7C15ull;
      b_ ^= b_ >> 29;
    }
  }
  void add(double x) { add(&x, sizeof x); }
  void add(const std::string& text) { add(text.data(), text.size()); }
  std::string text() const {
    char out[40];
    std::snprintf(out, sizeof out, "%016llx%016llx", static_cast<unsigned long long>(a_),
                  static_cast<unsigned long long>(b_));
    return out;
  }

private:
  uint64_t a_ = 0xcbf29ce484222325ull, b_ = 0x84222325cbf29ce4ull;
};

std::string cache_key(const Campaign& campaign, const Hypothesis& nominal,
                      const std::vector<const Effect*>& library, const CalibrationOptions& options) {
  Hash hash;
  hash.add(std::string(IMUCAL_VERSION));
  hash.add(kScoreVersion);
  for (const Effect* effect : library) hash.add(effect->name());
  hash.add(static_cast<double>(options.nulls));
  hash.add(static_cast<double>(options.seed));
  hash.add(campaign.dt_s), hash.add(campaign.order), hash.add(campaign.t0_degc),
      hash.add(campaign.range_degc);
  for (double c : campaign.coeff_dph) hash.add(c);
  const NoiseModel noise = nominal.noise();
  hash.add(noise.white_sigma_dph), hash.add(noise.extra_white_dph2), hash.add(noise.walk_dph_per_rt_s);
  hash.add(noise.white_slope), hash.add(noise.markov_slope), hash.add(noise.tau_slope);
  hash.add(noise.hit_probability), hash.add(noise.hit_sigma_dph);
  hash.add(noise.telegraph_dph), hash.add(noise.telegraph_tau_s);
  for (const Markov& m : noise.markov) hash.add(m.sigma_dph), hash.add(m.tau_s);
  for (const CampaignRun& run : campaign.runs) {
    hash.add(static_cast<double>(run.n()));
    for (int step : run.steps) hash.add(&step, sizeof step);
    for (double temp : run.input.temp_degc) hash.add(std::round(temp * 1e6));
    for (const auto& [name, column] : run.input.auxiliary) {
      hash.add(name);
      for (double value : column) hash.add(std::isfinite(value) ? value : -1e300);
    }
  }
  return hash.text();
}

std::string cache_path(const std::string& folder, const std::string& key) {
  return folder + "/nulls-" + key + ".json";
}

void make_folder(const std::string& folder) {
  for (size_t slash = 1; slash <= folder.size(); ++slash)
    if (slash == folder.size() || folder[slash] == '/') ::mkdir(folder.substr(0, slash).c_str(), 0777);
}

std::vector<std::vector<double>> matrix_from(const Json& json) {
  std::vector<std::vector<double>> out;
  for (const Json& row : json) {
    out.emplace_back();
    for (const Json& value : row) out.back().push_back(value.get<double>());
  }
  return out;
}

// Four digits are enough for quantiles.
Json rounded(const std::vector<std::vector<double>>& rows) {
  Json out = Json::array();
  for (const auto& row : rows) {
    Json line = Json::array();
    for (double value : row) line.push_back(std::round(value * 1e4) / 1e4);
    out.push_back(line);
  }
  return out;
}

bool load(const std::string& path, Calibration* out) {
  std::FILE* probe = std::fopen(path.c_str(), "r");
  if (!probe) return false;
  std::fclose(probe);
  try {
    const Json json = read_json(path).json();
    if (json.at("key").get<std::string>() != out->key) return false;
    out->named = matrix_from(json.at("named"));
    out->generic = matrix_from(json.at("generic"));
    out->spectrum.mean = json.at("spectrum_mean").get<std::vector<double>>();
    out->spectrum.dof = json.at("spectrum_dof").get<std::vector<double>>();
    out->from_cache = true;
    return !out->named.empty();
  } catch (const std::exception&) { // a damaged file: calibrate anew and overwrite it
    *out = Calibration{out->nulls, false, out->key, {}, {}, {}};
    return false;
  }
}

void save(const std::string& path, const Calibration& calibration) {
  const Json json = {{"imucal_nulls", 1},
                     {"key", calibration.key},
                     {"nulls", calibration.nulls},
                     {"named", rounded(calibration.named)},
                     {"generic", rounded(calibration.generic)},
                     {"spectrum_mean", calibration.spectrum.mean},
                     {"spectrum_dof", calibration.spectrum.dof}};
  try {
    write_json(path, json);
  } catch (const Error&) { // a cache that cannot be written is no reason to fail
  }
}

SpectrumNull spectrum_of(const std::vector<PanelScores>& scores) {
  SpectrumNull out;
  const size_t n = scores.size(), bins = scores.front().psd.size();
  for (size_t b = 0; b < bins; ++b) {
    double sum = 0, squares = 0;
    for (const PanelScores& s : scores) sum += s.psd[b], squares += s.psd[b] * s.psd[b];
    const double mean = sum / static_cast<double>(n);
    const double variance = std::max(1e-12, squares / static_cast<double>(n) - mean * mean);
    out.mean.push_back(std::max(mean, 1e-6));
    out.dof.push_back(2 * mean * mean / variance);
  }
  return out;
}

double quantile(std::vector<double> x, double p) {
  std::sort(x.begin(), x.end());
  const double at = p * static_cast<double>(x.size() - 1);
  const size_t i = static_cast<size_t>(at);
  return i + 1 < x.size() ? x[i] + (at - static_cast<double>(i)) * (x[i + 1] - x[i]) : x.back();
}

double mean_excess(const std::vector<double>& x, double over) {
  double sum = 0, n = 0;
  for (double v : x)
    if (v > over) sum += v - over, n += 1;
  return n > 0 ? sum / n : 1.0;
}

} // namespace

std::string default_cache_folder() {
  if (const char* xdg = std::getenv("XDG_CACHE_HOME"); xdg && *xdg) return std::string(xdg) + "/imucal";
  if (const char* home = std::getenv("HOME"); home && *home) return std::string(home) + "/.cache/imucal";
  return "";
}

Calibration calibrate(const Campaign& campaign, const Hypothesis& nominal,
                      const std::vector<const Effect*>& library, const CalibrationOptions& options,
                      const Calibration* known) {
  Calibration out;
  out.nulls = options.nulls;
  out.key = cache_key(campaign, nominal, library, options);
  if (known && known->key == out.key) return *known;
  const std::string path = options.cache_folder.empty() ? "" : cache_path(options.cache_folder, out.key);
  if (!path.empty() && load(path, &out)) return out;

  ColumnBank bank(campaign, library);
  const Panel panel(&bank, nominal, PanelScope::kAll);
  std::vector<PanelScores> scores(options.nulls);
  std::atomic<size_t> done{0};
  Progress progress("calibrating on simulated logs", static_cast<double>(options.nulls), options.quiet);
  const auto draw = [&](long i) {
    std::vector<VectorXd> e;
    for (size_t r = 0; r < campaign.runs.size(); ++r) {
      Rng rng(options.seed, (static_cast<uint64_t>(i) << 16) + r, 0,
              static_cast<uint32_t>(Stream::kTool) + 7);
      VectorXd er(static_cast<long>(campaign.runs[r].n()));
      for (long k = 0; k < er.size(); ++k) er[k] = rng.normal();
      e.push_back(std::move(er));
    }
    scores[static_cast<size_t>(i)] = panel.score_null(std::move(e), {});
    ++done;
  };
  const auto nulls = static_cast<long>(options.nulls);
  parallel_for(nulls, options.threads, draw, [&] { progress.update(static_cast<double>(done)); });
  progress.finish();

  out.spectrum = spectrum_of(scores);
  parallel_for(nulls, options.threads,
               [&](long i) { panel.score_whittle(out.spectrum, &scores[static_cast<size_t>(i)]); });

  out.named.assign(library.size(), {});
  out.generic.assign(generic_names().size(), {});
  for (const PanelScores& s : scores) {
    for (size_t j = 0; j < library.size(); ++j) out.named[j].push_back(s.named[j].gain_nats);
    for (size_t g = 0; g < out.generic.size(); ++g) out.generic[g].push_back(s.generic[g]);
  }
  if (!path.empty()) {
    make_folder(options.cache_folder);
    save(path, out);
  }
  return out;
}

double Thresholds::p_value(double evidence) const {
  return std::min(1.0, alpha_axis * std::exp(-evidence));
}

Thresholds thresholds(const Calibration& calibration, const std::vector<bool>& active,
                      double false_alarm_rate, size_t n_axes) {
  struct Scale {
    double q90 = 0, scale = 1;
  };
  const auto scale_of = [](const std::vector<double>& gains, bool is_generic) {
    Scale s;
    s.q90 = quantile(gains, 0.9);
    // Gains of few parameters have the tail of chi2/2: scale 1.  Tests of many degrees of freedom fall off
    // slower.
    s.scale = is_generic ? std::max(1.0, mean_excess(gains, quantile(gains, 0.85))) : 1.0;
    return s;
  };
  std::vector<Scale> named, generic;
  for (const auto& gains : calibration.named) named.push_back(scale_of(gains, false));
  for (const auto& gains : calibration.generic) generic.push_back(scale_of(gains, true));
  std::vector<double> largest(calibration.nulls, -1e300);
  for (size_t i = 0; i < calibration.nulls; ++i) {
    for (size_t j = 0; j < named.size(); ++j)
      if (active[j])
        largest[i] = std::max(largest[i], (calibration.named[j][i] - named[j].q90) / named[j].scale);
    for (size_t g = 0; g < generic.size(); ++g)
      largest[i] = std::max(largest[i], (calibration.generic[g][i] - generic[g].q90) / generic[g].scale);
  }
  Thresholds out;
  out.alpha_axis = 1 - std::pow(1 - false_alarm_rate, 1.0 / static_cast<double>(std::max<size_t>(1, n_axes)));
  // Exponential tail of the largest above its 80 % point.
  const double q80 = quantile(largest, 0.8), excess = std::max(0.8, mean_excess(largest, q80));
  out.level = q80 + excess * std::log(0.2 / std::min(0.2, out.alpha_axis));
  for (const Scale& s : named) out.named.push_back(std::max(kSmallestThreshold, s.q90 + s.scale * out.level));
  for (const Scale& s : generic)
    out.generic.push_back(std::max(kSmallestThreshold, s.q90 + s.scale * out.level));
  return out;
}

} // namespace imucal
