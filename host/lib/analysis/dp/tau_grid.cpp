// SPDX-License-Identifier: MIT
#include "analysis/dp/tau_grid.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

#include "base/error.h"
#include "base/format.h"
#include "io/notice.h"

namespace imucal {

namespace {

constexpr double kSameTau = 0.01; // samples: a clock's rounding

std::vector<double> numbers(const std::string& text, char separator, const std::string& whole) {
  std::vector<double> out;
  size_t at = 0;
  while (at <= text.size()) {
    const size_t end = std::min(text.find(separator, at), text.size());
    const std::string field = text.substr(at, end - at);
    char* stop = nullptr;
    const double value = std::strtod(field.c_str(), &stop);
    if (field.empty() || *stop != 0 || !(value > 0) || !std::isfinite(value))
      throw usage_error("--tau " + whole +
                        ": expected FIRST:LAST[:STEP], log:FIRST:LAST[:PER_DECADE], octave or a list; \"" + field +
                        "\" is not a positive number");
    out.push_back(value);
    at = end + 1;
  }
  return out;
}

bool starts_with(const std::string& text, const std::string& head) {
  return text.rfind(head, 0) == 0;
}

// Of averaging times that were asked for one by one (a logarithmic grid lies between the samples anyway).
void note_between_samples(const std::vector<double>& tau_s, double dt_s, const std::string& what) {
  for (const double t : tau_s) {
    const double taken_s = std::max(1.0, std::round(t / dt_s)) * dt_s;
    if (std::fabs(t - taken_s) <= kSameTau * dt_s || t < 0.5 * dt_s) continue;
    return notice(what +
                  format(": averaging times are whole samples of %.6g s: %.6g s is taken as %.6g s", dt_s, t, taken_s));
  }
}

} // namespace

std::vector<double> parse_tau(const std::string& text, double dt_s, double longest_s) {
  std::vector<double> tau;
  const auto check = [&](const std::vector<double>& v, size_t lo, size_t hi) {
    if (v.size() < lo || v.size() > hi) throw usage_error("--tau " + text + ": wrong number of fields");
    if (v[1] < v[0]) throw usage_error("--tau " + text + ": the last is smaller than the first");
  };
  const auto logarithmic = [&](double first, double last, double per_decade) {
    for (double k = 0;; ++k) {
      const double t = first * std::pow(10.0, k / per_decade);
      if (t > last * (1 + 1e-9)) break;
      tau.push_back(t);
    }
  };
  if (text.empty()) {
    logarithmic(dt_s, longest_s, 20);
  } else if (starts_with(text, "octave")) {
    double first = dt_s, last = longest_s;
    if (text.size() > 6) {
      if (text[6] != ':') throw usage_error("--tau " + text + ": expected octave or octave:FIRST:LAST");
      const auto v = numbers(text.substr(7), ':', text);
      check(v, 2, 2);
      first = v[0], last = v[1];
    }
    for (double t = first; t <= last * (1 + 1e-9); t *= 2) tau.push_back(t);
  } else if (starts_with(text, "log:")) {
    const auto v = numbers(text.substr(4), ':', text);
    check(v, 2, 3);
    if (v.size() > 2 && v[2] * std::log10(v[1] / v[0]) > 1e6)
      throw usage_error("--tau " + text + ": more than a million points");
    logarithmic(v[0], v[1], v.size() > 2 ? v[2] : 20);
  } else if (text.find(':') != std::string::npos) {
    const auto v = numbers(text, ':', text);
    check(v, 2, 3);
    const double step = v.size() > 2 ? v[2] : 1;
    if ((v[1] - v[0]) / step > 1e6) throw usage_error("--tau " + text + ": more than a million points");
    for (double k = 0; v[0] + k * step <= v[1] * (1 + 1e-12); ++k) tau.push_back(v[0] + k * step);
    note_between_samples(tau, dt_s, "--tau " + text);
  } else {
    tau = numbers(text, ',', text);
    note_between_samples(tau, dt_s, "--tau " + text);
  }
  return whole_taus(std::move(tau), dt_s, "--tau " + text);
}

std::vector<double> whole_taus(std::vector<double> tau_s, double dt_s, const std::string& what) {
  for (double& t : tau_s) {
    if (!(t > 0) || !std::isfinite(t)) throw usage_error(what + ": " + std::to_string(t) + " is not a positive number");
    if (t < 0.5 * dt_s) throw usage_error(what + ": " + std::to_string(t) + " s is less than one sample");
    t = std::max(1.0, std::round(t / dt_s)) * dt_s;
  }
  std::sort(tau_s.begin(), tau_s.end());
  tau_s.erase(std::unique(tau_s.begin(), tau_s.end()), tau_s.end());
  return tau_s;
}

} // namespace imucal
