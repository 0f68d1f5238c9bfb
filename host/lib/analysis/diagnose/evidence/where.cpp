// SPDX-License-Identifier: MIT
#include "analysis/diagnose/evidence/where.h"

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

constexpr double kRootHalf = 0.7071067811865476;
constexpr double kClearSection = 4; // standard deviations that make a section of time worth naming: there are many

int phase_of(double rate) {
  return std::fabs(rate) < kSteady_degc_min ? 0 : rate > 0 ? 1 : 2;
}
double strength(const WhereCell& c) {
  return std::max(std::fabs(c.z()), std::fabs(c.mean_z));
}

// Sums over slow changes, per cell.
struct SlowSums {
  std::vector<double> sum, n;
  explicit SlowSums(size_t cells) : sum(cells, 0.0), n(cells, 0.0) {}
  void add(size_t cell, double x) { sum[cell] += x, n[cell] += 1; }
  void write(std::vector<WhereCell>* cells) const {
    for (size_t i = 0; i < sum.size(); ++i)
      if (n[i] > 0) (*cells)[i].mean_z = sum[i] / std::sqrt(n[i]);
  }
};

// A stretch of one run.
struct Section {
  double t_s, excess, n;
};

class Locator {
public:
  Locator(const Campaign& campaign, const Fit& fit, bool has_model)
      : campaign_(campaign), fit_(fit), has_model_(has_model), lo_degc_(campaign.lo_degc),
        span_degc_(std::max(1e-6, campaign.hi_degc - campaign.lo_degc)), n_temp_(count_cells()), slow_temp_(n_temp_),
        slow_phase_(3) {}

  WhereResult run() {
    make_cells();
    for (size_t r = 0; r < campaign_.runs.size(); ++r) {
      decompose(campaign_.runs[r], fit_.e[r]);
      add_minutes(campaign_.runs[r], fit_.e[r]);
      add_sections(campaign_.runs[r], fit_.e[r]);
    }
    slow_temp_.write(&out_.by_temperature);
    slow_phase_.write(&out_.by_phase);
    name_times();
    const bool is_thermal = name_temperatures();
    name_direction();
    name_logs();
    name_sections();
    say(is_thermal);
    return std::move(out_);
  }

private:
  size_t count_cells() const {
    if (!campaign_.has_temperature) return 0;
    return static_cast<size_t>(std::max(1.0, std::ceil(span_degc_ / kCell_degc - 1e-9)));
  }
  void make_cells() {
    const double n = static_cast<double>(n_temp_);
    for (size_t b = 0; b < n_temp_; ++b) {
      WhereCell cell;
      cell.lo = lo_degc_ + static_cast<double>(b) * span_degc_ / n;
      cell.hi = lo_degc_ + static_cast<double>(b + 1) * span_degc_ / n;
      out_.by_temperature.push_back(cell);
    }
    for (const char* name : {"soak", "up", "down"}) {
      WhereCell cell;
      cell.name = name;
      out_.by_phase.push_back(cell);
    }
  }
  size_t cell_of(double temp_degc) const {
    return std::min(n_temp_ - 1, static_cast<size_t>(std::max(0.0, (temp_degc - lo_degc_) / span_degc_ *
                                                                       static_cast<double>(n_temp_))));
  }

  // One Haar coefficient `w` about sample `at`.
  void add(const CampaignRun& run, double w, double at, size_t band) {
    const double excess = w * w - 1;
    const size_t row = static_cast<size_t>(run.used[std::min(run.n() - 1, static_cast<size_t>(at))]);
    while (out_.by_tau.size() <= band) {
      WhereCell cell;
      cell.lo = campaign_.dt_s * std::ldexp(1.0, static_cast<int>(out_.by_tau.size()));
      cell.hi = 2 * cell.lo;
      out_.by_tau.push_back(cell);
    }
    const auto put = [&](WhereCell* cell) { cell->n += 1, cell->excess += excess; };
    put(&out_.by_tau[band]);
    put(&out_.by_log.back());
    if (!n_temp_) return;
    put(&out_.by_temperature[cell_of(run.input.smooth_degc[row])]);
    put(&out_.by_phase[static_cast<size_t>(phase_of(run.input.rate_degc_min[row]))]);
  }
  void decompose(const CampaignRun& run, const VectorXd& e) {
    WhereCell log_cell;
    log_cell.name = std::to_string(run.input.log);
    out_.by_log.push_back(log_cell);
    std::vector<double> level(e.data(), e.data() + e.size());
    std::vector<double> centre(level.size());
    for (size_t k = 0; k < centre.size(); ++k) centre[k] = static_cast<double>(k);
    size_t band = 0;
    while (level.size() >= 2) {
      std::vector<double> next, next_centre;
      for (size_t i = 0; i + 1 < level.size(); i += 2) {
        const double mid = 0.5 * (centre[i] + centre[i + 1]);
        add(run, (level[i] - level[i + 1]) * kRootHalf, mid, band);
        next.push_back((level[i] + level[i + 1]) * kRootHalf);
        next_centre.push_back(mid);
      }
      if (level.size() % 2) add(run, level.back(), centre.back(), band);
      level.swap(next);
      centre.swap(next_centre);
      ++band;
    }
    if (level.size() == 1) add(run, level[0], centre[0], band > 0 ? band - 1 : 0);
  }
  // Means of 60 s: where the mean is off.
  void add_minutes(const CampaignRun& run, const VectorXd& e) {
    if (!n_temp_) return;
    const long block = std::max<long>(1, std::lround(60 / campaign_.dt_s));
    for (long k = 0; k + block <= e.size(); k += block) {
      const double s = e.segment(k, block).sum() / std::sqrt(static_cast<double>(block));
      const size_t row = static_cast<size_t>(run.used[static_cast<size_t>(k + block / 2)]);
      slow_temp_.add(cell_of(run.input.smooth_degc[row]), s);
      slow_phase_.add(static_cast<size_t>(phase_of(run.input.rate_degc_min[row])), s);
    }
  }
  void add_sections(const CampaignRun& run, const VectorXd& e) {
    const long length = std::max<long>(1, std::lround(kSection_s / campaign_.dt_s));
    for (long k = 0; k < e.size(); k += length) {
      const long n = std::min(length, static_cast<long>(e.size()) - k);
      sections_.push_back({run.start_s + run.input.t_s[static_cast<size_t>(run.used[static_cast<size_t>(k)])],
                           e.segment(k, n).squaredNorm() - static_cast<double>(n), static_cast<double>(n)});
    }
  }

  // The averaging times that stand out; the strongest where none is clear.
  void name_times() {
    for (size_t b = 0; b < out_.by_tau.size(); ++b)
      if (std::fabs(out_.by_tau[b].z()) > std::fabs(out_.by_tau[strongest_].z())) strongest_ = b;
    out_.tau_lo_s = out_.by_tau[strongest_].lo, out_.tau_hi_s = out_.by_tau[strongest_].hi;
    for (const WhereCell& cell : out_.by_tau)
      if (std::fabs(cell.z()) > kClear) {
        out_.tau_lo_s = std::min(out_.tau_lo_s, cell.lo);
        out_.tau_hi_s = std::max(out_.tau_hi_s, cell.hi);
      }
  }
  bool name_temperatures() {
    out_.temp_lo_degc = campaign_.lo_degc, out_.temp_hi_degc = campaign_.hi_degc;
    bool any = false;
    for (const WhereCell& cell : out_.by_temperature)
      if (strength(cell) > kClear) {
        out_.temp_lo_degc = any ? std::min(out_.temp_lo_degc, cell.lo) : cell.lo;
        out_.temp_hi_degc = any ? std::max(out_.temp_hi_degc, cell.hi) : cell.hi;
        any = true;
      }
    return any;
  }
  void name_direction() {
    size_t top = 0;
    int clear_phases = 0;
    for (size_t p = 0; p < out_.by_phase.size(); ++p) {
      if (strength(out_.by_phase[p]) > strength(out_.by_phase[top])) top = p;
      clear_phases += strength(out_.by_phase[p]) > kClear;
    }
    if (clear_phases == 1) out_.direction = out_.by_phase[top].name;
  }
  void name_logs() {
    for (size_t r = 0; r < out_.by_log.size(); ++r)
      if (std::fabs(out_.by_log[r].z()) > kClear) out_.logs.push_back(static_cast<int>(campaign_.runs[r].input.log));
    if (!out_.logs.empty()) return;
    for (const CampaignRun& run : campaign_.runs) out_.logs.push_back(static_cast<int>(run.input.log));
  }
  void name_sections() {
    double last = 0;
    for (const CampaignRun& run : campaign_.runs) last = std::max(last, run.start_s + run.input.t_s.back());
    out_.time_lo_s = campaign_.runs.front().start_s, out_.time_hi_s = last;
    bool any = false;
    for (const Section& s : sections_)
      if (s.n > 0 && std::fabs(s.excess) > kClearSection * std::sqrt(2 * s.n)) {
        out_.time_lo_s = any ? std::min(out_.time_lo_s, s.t_s) : s.t_s;
        out_.time_hi_s = any ? std::max(out_.time_hi_s, s.t_s + kSection_s) : s.t_s + kSection_s;
        any = true;
      }
  }
  // How many times the residual is what the model expects, at the averaging times that stand out most.
  std::string strongest_times() const {
    const WhereCell& cell = out_.by_tau[strongest_];
    const double times = std::sqrt(std::max(0.0, 1 + cell.excess / std::max(1.0, cell.n)));
    char text[300];
    std::snprintf(text, sizeof text,
                  "at averaging times of %.0f to %.0f s, most at %.0f to %.0f s: the residual is %.3g times what %s "
                  "expects there%s",
                  out_.tau_lo_s, out_.tau_hi_s, cell.lo, cell.hi, times,
                  has_model_ ? "the model" : "the noise that was estimated without a cause",
                  has_model_ && times < 1 ? " (less noise than believed)" : "");
    return text;
  }
  void say(bool is_thermal) {
    const auto add = [&](const std::string& part) { out_.sentence += (out_.sentence.empty() ? "" : ", ") + part; };
    if (std::fabs(out_.by_tau[strongest_].z()) > kClear) add(strongest_times());
    if (is_thermal) {
      char text[100];
      std::snprintf(text, sizeof text, "between %.0f and %.0f degC", out_.temp_lo_degc, out_.temp_hi_degc);
      add(text);
    }
    if (out_.direction == "soak")
      add("while the temperature rests");
    else if (out_.direction != "any")
      add("while the temperature goes " + out_.direction);
    if (out_.sentence.empty()) out_.sentence = "no averaging time, temperature or direction stands out by itself";
  }

  const Campaign& campaign_;
  const Fit& fit_;
  bool has_model_;
  double lo_degc_, span_degc_;
  size_t n_temp_;
  SlowSums slow_temp_, slow_phase_;
  std::vector<Section> sections_;
  size_t strongest_ = 0; // place in by_tau
  WhereResult out_;
};

} // namespace

WhereResult locate(const Campaign& campaign, const Fit& fit, bool has_model) {
  return Locator(campaign, fit, has_model).run();
}

} // namespace imucal
