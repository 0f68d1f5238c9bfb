// SPDX-License-Identifier: MIT
#include "analysis/diagnose/evidence/where.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "analysis/diagnose/evidence/minutes.h"
#include "base/quantile.h"

namespace imucal {

using Eigen::VectorXd;

double WhereCell::z() const {
  return n > 0 ? excess / std::sqrt(2 * n) : 0;
}

namespace {

constexpr double kClear = 3.0;      // standard deviations that make an averaging time worth naming
constexpr double kClearPlace = 3.0; // standard errors by which a place has to be above the rest
constexpr double kOfMany = 4.0;     // the same where many places are compared
constexpr double kByChance = 0.002; // of means that are alike everywhere, one span seems to be a place so often
constexpr double kTimesRest = 2.0;  // and how many times its excess has to be that of the rest
constexpr double kCell_degc = 5.0;
constexpr double kSteady_degc_min = 0.05;
constexpr double kSection_s = 600;

constexpr double kRootHalf = 0.7071067811865476;
constexpr double kClearSection = 4; // standard deviations that make a section of time worth naming: there are many

int phase_of(double rate) {
  return std::fabs(rate) < kSteady_degc_min ? 0 : rate > 0 ? 1 : 2;
}

// Excess of a place or of the rest.
struct Excess {
  double n = 0, sum = 0, square = 0;
  void add(double of_n, double of_sum, double of_square) { n += of_n, sum += of_sum, square += of_square; }
  void add(const WhereCell& c) { add(c.n, c.excess, c.square); }
  Excess without(const Excess& part) const { return {n - part.n, sum - part.sum, square - part.square}; }
  double mean() const { return sum / n; }
};
// By how many standard errors a place is above the rest; 0 where the rest is not clearly lower.  Where the whole is below what
// is expected, a place is what is most below.
double above_rest(const Excess& place, const Excess& whole) {
  const Excess rest = whole.without(place);
  const double sign = whole.sum < 0 ? -1 : 1;
  if (!(place.n > 0) || !(rest.n > 0) || sign * place.sum <= 0) return 0;
  if (sign * place.mean() < kTimesRest * sign * rest.mean()) return 0;
  const double error = std::sqrt(place.square / (place.n * place.n) + std::max(0.0, rest.square) / (rest.n * rest.n));
  return sign * (place.mean() - rest.mean()) / error;
}
Excess sum_of(const std::vector<WhereCell>& cells) {
  Excess sum;
  for (const WhereCell& cell : cells) sum.add(cell);
  return sum;
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
  double t_s, excess, n, square;
};

class Locator {
public:
  Locator(const Campaign& campaign, const Fit& fit, WhoseNoise noise, bool has_place)
      : campaign_(campaign), fit_(fit), noise_(noise), has_place_(has_place), lo_degc_(campaign.lo_degc),
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
    start_everywhere();
    if (has_place_) name_temperatures(), name_direction(), name_logs(), name_sections();
    say();
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
    const auto put = [&](WhereCell* cell) { cell->n += 1, cell->excess += excess, cell->square += excess * excess; };
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
    const long block = rows_of_minute(campaign_.dt_s);
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
      sections_.push_back({time_in_log_s(run, run.input.t_s[static_cast<size_t>(run.used[static_cast<size_t>(k)])]),
                           e.segment(k, n).squaredNorm() - static_cast<double>(n), static_cast<double>(n),
                           (e.segment(k, n).array().square() - 1).square().sum()});
    }
  }

  // Whether an averaging time may be a place of the gap: with an estimated noise, less of it is none.
  bool is_told(const WhereCell& cell) const { return noise_ == WhoseNoise::kModel || cell.excess > 0; }
  // The averaging times that stand out; the strongest where none is clear.
  void name_times() {
    for (size_t b = 0; b < out_.by_tau.size(); ++b) {
      const WhereCell &cell = out_.by_tau[b], &top = out_.by_tau[strongest_];
      if (is_told(cell) && (!is_told(top) || std::fabs(cell.z()) > std::fabs(top.z()))) strongest_ = b;
    }
    out_.tau_lo_s = out_.by_tau[strongest_].lo, out_.tau_hi_s = out_.by_tau[strongest_].hi;
    for (const WhereCell& cell : out_.by_tau)
      if (is_told(cell) && std::fabs(cell.z()) > kClear) {
        out_.tau_lo_s = std::min(out_.tau_lo_s, cell.lo);
        out_.tau_hi_s = std::max(out_.tau_hi_s, cell.hi);
      }
  }
  void start_everywhere() {
    out_.temp_lo_degc = campaign_.lo_degc, out_.temp_hi_degc = campaign_.hi_degc;
    out_.time_lo_s = campaign_.runs.front().start_s, out_.time_hi_s = 0;
    for (const CampaignRun& run : campaign_.runs) {
      out_.time_hi_s = std::max(out_.time_hi_s, time_in_log_s(run, run.input.t_s.back()));
      out_.logs.push_back(static_cast<int>(run.input.log));
    }
  }
  // Spans of neighbouring temperatures, half of all at most: that which is most above the rest; if none is, the shortest one that
  // holds so much of the squares of the means as hardly ever comes by chance.
  void name_temperatures() {
    const Excess whole = sum_of(out_.by_temperature);
    double best = kOfMany;
    for (size_t from = 0; from < n_temp_; ++from) {
      Excess span;
      for (size_t to = from; to < n_temp_ && 2 * (to - from + 1) <= n_temp_; ++to) {
        span.add(out_.by_temperature[to]);
        const double above = above_rest(span, whole);
        if (above > best) best = above, name_span(from, to);
      }
    }
    if (!is_thermal_) name_mean();
  }
  void name_span(size_t from, size_t to) {
    is_thermal_ = true;
    out_.temp_lo_degc = out_.by_temperature[from].lo, out_.temp_hi_degc = out_.by_temperature[to].hi;
  }
  void name_mean() {
    const auto sum = [&](size_t from, size_t to) {
      double squares = 0;
      for (size_t b = from; b <= to; ++b) squares += std::pow(out_.by_temperature[b].mean_z, 2);
      return squares;
    };
    const auto is_clear = [&](size_t b) { return std::fabs(out_.by_temperature[b].mean_z) > kClear; };
    const double whole = n_temp_ ? sum(0, n_temp_ - 1) : 0;
    for (size_t n = 1; 2 * n <= n_temp_; ++n) {
      // The share of the squares of n of them, were all alike.
      double best =
          whole * beta_quantile(1 - kByChance, 0.5 * static_cast<double>(n), 0.5 * static_cast<double>(n_temp_ - n));
      for (size_t from = 0; from + n <= n_temp_; ++from)
        if (is_clear(from) && is_clear(from + n - 1) && sum(from, from + n - 1) > best)
          best = sum(from, from + n - 1), name_span(from, from + n - 1);
      if (is_thermal_) return;
    }
  }
  void name_direction() {
    const Excess whole = sum_of(out_.by_phase);
    double best = kClearPlace;
    for (const WhereCell& cell : out_.by_phase) {
      const double above = above_rest(sum_of({cell}), whole);
      if (above > best) best = above, out_.direction = cell.name;
    }
  }
  // Logs that are above all others, each and together.
  void name_logs() {
    const Excess whole = sum_of(out_.by_log);
    Excess chosen;
    std::vector<int> logs;
    for (size_t r = 0; r < out_.by_log.size(); ++r)
      if (above_rest(sum_of({out_.by_log[r]}), whole) > kClearPlace)
        chosen.add(out_.by_log[r]), logs.push_back(static_cast<int>(campaign_.runs[r].input.log));
    if (!logs.empty() && above_rest(chosen, whole) > kClearPlace) out_.logs = logs, has_logs_ = true;
  }
  // From the first to the last section that stands out, if the time before and after is clearly lower.
  void name_sections() {
    double lo_s = 1e300, hi_s = -1e300;
    for (const Section& s : sections_)
      if (s.n > 0 && std::fabs(s.excess) > kClearSection * std::sqrt(2 * s.n))
        lo_s = std::min(lo_s, s.t_s), hi_s = std::max(hi_s, s.t_s + kSection_s);
    Excess span, whole;
    for (const Section& s : sections_) {
      whole.add(s.n, s.excess, s.square);
      if (s.t_s >= lo_s && s.t_s < hi_s) span.add(s.n, s.excess, s.square);
    }
    if (above_rest(span, whole) <= kOfMany) return;
    out_.time_lo_s = lo_s, out_.time_hi_s = hi_s, has_time_ = true;
  }
  // How many times the residual is what the model expects, at the averaging times that stand out most.
  std::string strongest_times() const {
    const WhereCell& cell = out_.by_tau[strongest_];
    const double times = std::sqrt(std::max(0.0, 1 + cell.excess / std::max(1.0, cell.n)));
    static const char* const kWhose[] = {"the model", "the noise that was estimated without a cause",
                                         "the noise that was found"};
    char text[300];
    std::snprintf(text, sizeof text,
                  "at averaging times of %.0f to %.0f s, most at %.0f to %.0f s: the residual is %.3g times what %s "
                  "expects there%s",
                  out_.tau_lo_s, out_.tau_hi_s, cell.lo, cell.hi, times, kWhose[static_cast<size_t>(noise_)],
                  times < 1 && noise_ == WhoseNoise::kModel ? " (less noise than believed)" : "");
    return text;
  }
  std::string named_logs() const {
    std::string text;
    for (int log : out_.logs) text += (text.empty() ? "" : ", ") + std::to_string(log + 1);
    return (out_.logs.size() > 1 ? "in logs " : "in log ") + text;
  }
  void say() {
    const auto add = [&](const std::string& part) { out_.sentence += (out_.sentence.empty() ? "" : ", ") + part; };
    const auto add_range = [&](const char* pattern, double lo, double hi) {
      char text[100];
      std::snprintf(text, sizeof text, pattern, lo, hi);
      add(text);
    };
    const WhereCell& top = out_.by_tau[strongest_];
    if (is_told(top) && std::fabs(top.z()) > kClear) add(strongest_times());
    if (is_thermal_) add_range("between %.0f and %.0f degC", out_.temp_lo_degc, out_.temp_hi_degc);
    if (has_time_) add_range("from %.0f to %.0f s", out_.time_lo_s, out_.time_hi_s);
    if (out_.direction == "soak")
      add("while the temperature rests");
    else if (out_.direction != "any")
      add("while the temperature goes " + out_.direction);
    if (has_logs_) add(named_logs());
    if (out_.sentence.empty())
      out_.sentence = campaign_.has_temperature ? "no averaging time, temperature or direction stands out by itself"
                                                : "no averaging time stands out by itself";
  }

  const Campaign& campaign_;
  const Fit& fit_;
  WhoseNoise noise_;
  bool has_place_;
  bool is_thermal_ = false, has_time_ = false, has_logs_ = false; // a place of that kind is named
  double lo_degc_, span_degc_;
  size_t n_temp_;
  SlowSums slow_temp_, slow_phase_;
  std::vector<Section> sections_;
  size_t strongest_ = 0; // place in by_tau
  WhereResult out_;
};

} // namespace

WhereResult locate(const Campaign& campaign, const Fit& fit, WhoseNoise noise, bool has_place) {
  return Locator(campaign, fit, noise, has_place).run();
}

} // namespace imucal
