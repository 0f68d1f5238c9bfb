// SPDX-License-Identifier: MIT
#include "analysis/diagnose/where.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace imucal {

using Eigen::VectorXd;

double WhereCell::z() const {
  return n > 0 ? excess / std::sqrt(2 * n) : 0;
}

namespace {

constexpr double kClear = 3.0; // standard deviations that make a cell worth naming
constexpr double kCell_degc = 5.0;
constexpr double kSteady_degc_min = 0.05;
constexpr double kSection_s = 600;

int phase_of(double rate) {
  return std::fabs(rate) < kSteady_degc_min ? 0 : rate > 0 ? 1 : 2;
}

} // namespace

WhereResult locate(const Campaign& campaign, const Fit& fit) {
  WhereResult out;
  const double lo = campaign.lo_degc, span = std::max(1e-6, campaign.hi_degc - lo);
  const size_t n_temp =
      campaign.has_temperature ? static_cast<size_t>(std::max(1.0, std::ceil(span / kCell_degc - 1e-9))) : 0;
  for (size_t b = 0; b < n_temp; ++b) {
    WhereCell cell;
    cell.lo = lo + static_cast<double>(b) * span / static_cast<double>(n_temp);
    cell.hi = lo + static_cast<double>(b + 1) * span / static_cast<double>(n_temp);
    out.by_temperature.push_back(cell);
  }
  for (const char* name : {"soak", "up", "down"}) {
    WhereCell cell;
    cell.name = name;
    out.by_phase.push_back(cell);
  }
  std::vector<double> temp_sum(n_temp, 0.0), temp_n(n_temp, 0.0), phase_sum(3, 0.0), phase_n(3, 0.0);
  std::vector<double> section_excess;
  std::vector<double> slow_by_temp(n_temp, 0.0), slow_by_phase(3, 0.0), slow_n_temp(n_temp, 0.0), slow_n_phase(3, 0.0);
  const double dt = campaign.dt_s;
  struct Spot {
    size_t run;
    double t, excess, n;
  };
  std::vector<Spot> sections;
  for (size_t r = 0; r < campaign.runs.size(); ++r) {
    const CampaignRun& run = campaign.runs[r];
    const VectorXd& e = fit.e[r];
    WhereCell log_cell;
    log_cell.name = std::to_string(run.input.log);
    std::vector<double> level(e.data(), e.data() + e.size());
    std::vector<double> centre(level.size());
    for (size_t k = 0; k < centre.size(); ++k) centre[k] = static_cast<double>(k);
    const auto add = [&](double w, double at, size_t band) {
      const double excess = w * w - 1;
      const size_t row = static_cast<size_t>(run.used[std::min(run.n() - 1, static_cast<size_t>(at))]);
      while (out.by_tau.size() <= band) {
        WhereCell cell;
        cell.lo = dt * std::ldexp(1.0, static_cast<int>(out.by_tau.size()));
        cell.hi = 2 * cell.lo;
        out.by_tau.push_back(cell);
      }
      out.by_tau[band].n += 1, out.by_tau[band].excess += excess;
      log_cell.n += 1, log_cell.excess += excess;
      if (n_temp) {
        const double temp = run.input.smooth_degc[row];
        const size_t b =
            std::min(n_temp - 1, static_cast<size_t>(std::max(0.0, (temp - lo) / span * static_cast<double>(n_temp))));
        out.by_temperature[b].n += 1, out.by_temperature[b].excess += excess;
        WhereCell& phase = out.by_phase[static_cast<size_t>(phase_of(run.input.rate_degc_min[row]))];
        phase.n += 1, phase.excess += excess;
      }
    };
    size_t band = 0;
    while (level.size() >= 2) {
      std::vector<double> next, next_centre;
      for (size_t i = 0; i + 1 < level.size(); i += 2) {
        const double mid = 0.5 * (centre[i] + centre[i + 1]);
        add((level[i] - level[i + 1]) * 0.7071067811865476, mid, band);
        next.push_back((level[i] + level[i + 1]) * 0.7071067811865476);
        next_centre.push_back(mid);
      }
      if (level.size() % 2) add(level.back(), centre.back(), band);
      level.swap(next);
      centre.swap(next_centre);
      ++band;
    }
    if (level.size() == 1) add(level[0], centre[0], band > 0 ? band - 1 : 0);
    out.by_log.push_back(log_cell);
    // Means of 60 s: where the mean is off.
    const long block = std::max<long>(1, std::lround(60 / dt));
    for (long k = 0; k + block <= e.size(); k += block) {
      const double s = e.segment(k, block).sum() / std::sqrt(static_cast<double>(block));
      const size_t row = static_cast<size_t>(run.used[static_cast<size_t>(k + block / 2)]);
      if (n_temp) {
        const size_t b = std::min(
            n_temp - 1,
            static_cast<size_t>(std::max(0.0, (run.input.smooth_degc[row] - lo) / span * static_cast<double>(n_temp))));
        temp_sum[b] += s, temp_n[b] += 1;
        const size_t phase = static_cast<size_t>(phase_of(run.input.rate_degc_min[row]));
        phase_sum[phase] += s, phase_n[phase] += 1;
      }
    }
    const long section = std::max<long>(1, std::lround(kSection_s / dt));
    for (long k = 0; k < e.size(); k += section) {
      const long n = std::min(section, static_cast<long>(e.size()) - k);
      sections.push_back({r, run.input.t_s[static_cast<size_t>(run.used[static_cast<size_t>(k)])],
                          e.segment(k, n).squaredNorm() - static_cast<double>(n), static_cast<double>(n)});
    }
  }
  for (size_t b = 0; b < n_temp; ++b)
    if (temp_n[b] > 0) out.by_temperature[b].mean_z = temp_sum[b] / std::sqrt(temp_n[b]);
  for (size_t p = 0; p < 3; ++p)
    if (phase_n[p] > 0) out.by_phase[p].mean_z = phase_sum[p] / std::sqrt(phase_n[p]);

  // The averaging times that stand out; the strongest where none is clear.
  size_t strongest = 0;
  for (size_t b = 0; b < out.by_tau.size(); ++b)
    if (std::fabs(out.by_tau[b].z()) > std::fabs(out.by_tau[strongest].z())) strongest = b;
  out.tau_lo_s = out.by_tau[strongest].lo, out.tau_hi_s = out.by_tau[strongest].hi;
  for (const WhereCell& cell : out.by_tau)
    if (std::fabs(cell.z()) > kClear) {
      out.tau_lo_s = std::min(out.tau_lo_s, cell.lo);
      out.tau_hi_s = std::max(out.tau_hi_s, cell.hi);
    }
  const auto strength = [](const WhereCell& c) { return std::max(std::fabs(c.z()), std::fabs(c.mean_z)); };
  out.temp_lo_degc = campaign.lo_degc, out.temp_hi_degc = campaign.hi_degc;
  bool any = false;
  for (const WhereCell& cell : out.by_temperature)
    if (strength(cell) > kClear) {
      out.temp_lo_degc = any ? std::min(out.temp_lo_degc, cell.lo) : cell.lo;
      out.temp_hi_degc = any ? std::max(out.temp_hi_degc, cell.hi) : cell.hi;
      any = true;
    }
  size_t top = 0;
  int clear_phases = 0;
  for (size_t p = 0; p < out.by_phase.size(); ++p) {
    if (strength(out.by_phase[p]) > strength(out.by_phase[top])) top = p;
    clear_phases += strength(out.by_phase[p]) > kClear;
  }
  if (clear_phases == 1) out.direction = out.by_phase[top].name;
  for (size_t r = 0; r < out.by_log.size(); ++r)
    if (std::fabs(out.by_log[r].z()) > kClear) out.logs.push_back(static_cast<int>(campaign.runs[r].input.log));
  if (out.logs.empty())
    for (const CampaignRun& run : campaign.runs) out.logs.push_back(static_cast<int>(run.input.log));
  double last = 0;
  for (const CampaignRun& run : campaign.runs) last = std::max(last, run.start_s + run.input.t_s.back());
  out.time_lo_s = campaign.runs.front().start_s, out.time_hi_s = last;
  bool any_section = false;
  for (const Spot& s : sections)
    if (s.n > 0 && std::fabs(s.excess) > 4 * std::sqrt(2 * s.n)) {
      out.time_lo_s = any_section ? std::min(out.time_lo_s, s.t) : s.t;
      out.time_hi_s = any_section ? std::max(out.time_hi_s, s.t + kSection_s) : s.t + kSection_s;
      any_section = true;
    }
  char text[300];
  std::snprintf(text, sizeof text, "strongest at averaging times of %.0f to %.0f s (%+.1f standard deviations)",
                out.tau_lo_s, out.tau_hi_s, out.by_tau[strongest].z());
  out.sentence = text;
  if (any) {
    std::snprintf(text, sizeof text, ", between %.0f and %.0f degC", out.temp_lo_degc, out.temp_hi_degc);
    out.sentence += text;
  }
  if (out.direction != "any")
    out.sentence +=
        out.direction == "soak" ? ", while the temperature rests" : ", while the temperature goes " + out.direction;
  return out;
}

} // namespace imucal
