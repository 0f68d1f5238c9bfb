// SPDX-License-Identifier: MIT
#include "analysis/diagnose/evidence/where.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>

#include "analysis/diagnose/evidence/minutes.h"
#include "analysis/diagnose/evidence/place.h"
#include "base/quantile.h"

namespace imucal {

using Eigen::VectorXd;

double WhereCell::z() const {
  return n > 0 ? excess / std::sqrt(2 * n) : 0;
}

namespace {

constexpr double kTimesByChance = 0.01; // a right model has an averaging time named so often
constexpr double kClear = 3.0;          // standard deviations of a mean that is worth naming
constexpr double kClearPlace = 3.0;     // standard errors by which a place has to be above the rest
constexpr double kOfMany = 4.0;         // the same where many places are compared
constexpr double kByChance = 0.002;     // of means that are alike everywhere, one span seems to be a place so often
constexpr double kTimesRest = 2.0;      // and how many times its excess has to be that of the rest
constexpr double kCell_degc = 5.0;
constexpr double kSteady_degc_min = 0.05;
constexpr double kSection_s = 600;
constexpr double kPiece_s = 300, kPiece_degc = 1; // of what the names add
constexpr double kToldPerDegc = 10;               // temperatures are told to a tenth

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

// What a temperature is told as: none beyond the readings, however smoothing or an edge of a cell has it.
class ReadTemperatures {
public:
  explicit ReadTemperatures(const Campaign& campaign) {
    for (const CampaignRun& run : campaign.runs)
      for (int row : run.used) {
        const double degc = run.input.temp_degc[static_cast<size_t>(row)];
        if (std::isfinite(degc)) lo_degc_ = std::min(lo_degc_, degc), hi_degc_ = std::max(hi_degc_, degc);
      }
    lo_degc_ = std::ceil(lo_degc_ * kToldPerDegc - kRounding) / kToldPerDegc;
    hi_degc_ = std::floor(hi_degc_ * kToldPerDegc + kRounding) / kToldPerDegc;
  }
  double told(double degc) const {
    if (!(lo_degc_ < hi_degc_)) return degc;
    return std::clamp(std::round(degc * kToldPerDegc) / kToldPerDegc, lo_degc_, hi_degc_) + 0.0; // no -0
  }

private:
  static constexpr double kRounding = 1e-9;
  double lo_degc_ = 1e300, hi_degc_ = -1e300;
};

// The cells of all tables.
struct Tables {
  std::vector<WhereCell> by_tau, by_temperature, by_phase, by_log;
};

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
  Locator(const Campaign& campaign, const Fit& fit, WhoseNoise noise, const NamedCause& cause)
      : campaign_(campaign), fit_(fit), noise_(noise), cause_(cause), lo_degc_(campaign.lo_degc),
        span_degc_(std::max(1e-6, campaign.hi_degc - campaign.lo_degc)), n_temp_(count_cells()), slow_temp_(n_temp_),
        slow_phase_(3) {}

  WhereResult run() {
    tables_ = decomposed();
    for (size_t r = 0; r < campaign_.runs.size(); ++r) {
      add_minutes(campaign_.runs[r], fit_.e[r]);
      add_sections(campaign_.runs[r], fit_.e[r]);
    }
    slow_temp_.write(&tables_.by_temperature);
    slow_phase_.write(&tables_.by_phase);
    name_times();
    start_everywhere();
    if (!cause_.jumps.empty())
      name_jumps();
    else if (!cause_.added.empty())
      name_added();
    else if (cause_.has_place)
      name_excess();
    tell_temperatures();
    say();
    out_.by_tau = std::move(tables_.by_tau), out_.by_temperature = std::move(tables_.by_temperature);
    out_.by_phase = std::move(tables_.by_phase), out_.by_log = std::move(tables_.by_log);
    return std::move(out_);
  }

private:
  size_t count_cells() const {
    if (!campaign_.has_temperature) return 0;
    return static_cast<size_t>(std::max(1.0, std::ceil(span_degc_ / kCell_degc - 1e-9)));
  }
  Tables empty_tables() const {
    Tables out;
    const double n = static_cast<double>(n_temp_);
    for (size_t b = 0; b < n_temp_; ++b) {
      WhereCell cell;
      cell.lo = lo_degc_ + static_cast<double>(b) * span_degc_ / n;
      cell.hi = lo_degc_ + static_cast<double>(b + 1) * span_degc_ / n;
      out.by_temperature.push_back(cell);
    }
    for (const char* name : {"soak", "up", "down"}) {
      WhereCell cell;
      cell.name = name;
      out.by_phase.push_back(cell);
    }
    return out;
  }
  // In which of n equal parts of the range of temperatures.
  size_t part_of(double temp_degc, size_t n) const {
    return std::min(n - 1,
                    static_cast<size_t>(std::max(0.0, (temp_degc - lo_degc_) / span_degc_ * static_cast<double>(n))));
  }
  size_t cell_of(double temp_degc) const { return part_of(temp_degc, n_temp_); }

  // Of the averaging times asked for (empty: all).
  Tables decomposed(const std::vector<char>& bands = {}) const {
    Tables out = empty_tables();
    for (size_t r = 0; r < campaign_.runs.size(); ++r) decompose(campaign_.runs[r], fit_.e[r], bands, &out);
    return out;
  }
  // One Haar coefficient `w` about sample `at`.
  void add(const CampaignRun& run, double w, double at, size_t band, Tables* to) const {
    const double excess = w * w - 1;
    const size_t row = static_cast<size_t>(run.used[std::min(run.n() - 1, static_cast<size_t>(at))]);
    while (to->by_tau.size() <= band) {
      WhereCell cell;
      cell.lo = campaign_.dt_s * std::ldexp(1.0, static_cast<int>(to->by_tau.size()));
      cell.hi = 2 * cell.lo;
      to->by_tau.push_back(cell);
    }
    const auto put = [&](WhereCell* cell) { cell->n += 1, cell->excess += excess, cell->square += excess * excess; };
    put(&to->by_tau[band]);
    put(&to->by_log.back());
    if (!n_temp_) return;
    put(&to->by_temperature[cell_of(run.input.smooth_degc[row])]);
    put(&to->by_phase[static_cast<size_t>(phase_of(run.input.rate_degc_min[row]))]);
  }
  void decompose(const CampaignRun& run, const VectorXd& e, const std::vector<char>& bands, Tables* to) const {
    WhereCell log_cell;
    log_cell.name = std::to_string(run.input.log);
    to->by_log.push_back(log_cell);
    const auto add_if_asked = [&](double w, double at, size_t band) {
      if (bands.empty() || bands[band]) add(run, w, at, band, to);
    };
    std::vector<double> level(e.data(), e.data() + e.size());
    std::vector<double> centre(level.size());
    for (size_t k = 0; k < centre.size(); ++k) centre[k] = static_cast<double>(k);
    size_t band = 0;
    while (level.size() >= 2) {
      std::vector<double> next, next_centre;
      for (size_t i = 0; i + 1 < level.size(); i += 2) {
        const double mid = 0.5 * (centre[i] + centre[i + 1]);
        add_if_asked((level[i] - level[i + 1]) * kRootHalf, mid, band);
        next.push_back((level[i] + level[i + 1]) * kRootHalf);
        next_centre.push_back(mid);
      }
      if (level.size() % 2) add_if_asked(level.back(), centre.back(), band);
      level.swap(next);
      centre.swap(next_centre);
      ++band;
    }
    if (level.size() == 1) add_if_asked(level[0], centre[0], band > 0 ? band - 1 : 0);
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

  // How seldom chance gives an averaging time as much; with an estimated noise, less of it says nothing.
  double by_chance(const WhereCell& cell) const {
    if (cell.excess > 0) return 1 - chi2_cdf(cell.n + cell.excess, cell.n);
    // What the fit takes off is no lack of noise: at worst it is all of one averaging time.
    const double left = cell.n - static_cast<double>(fit_.beta.size());
    return noise_ == WhoseNoise::kModel && left > 0 ? chi2_cdf(cell.n + cell.excess, left) : 1;
  }
  // The averaging times that stand out: from the first to the last of them, all there are where none does.
  void name_times() {
    const std::vector<WhereCell>& cells = tables_.by_tau;
    const double sides = noise_ == WhoseNoise::kModel ? 2 : 1;
    const double seldom = kTimesByChance / (sides * static_cast<double>(cells.size()));
    out_.tau_lo_s = cells.front().lo, out_.tau_hi_s = cells.back().hi;
    clear_.assign(cells.size(), 0);
    for (size_t b = 0; b < cells.size() && cause_.has_times; ++b) {
      if (!(by_chance(cells[b]) < seldom)) continue;
      if (!has_times_) strongest_ = b, out_.tau_lo_s = cells[b].lo;
      has_times_ = true, clear_[b] = 1, out_.tau_hi_s = cells[b].hi;
      if (std::fabs(cells[b].z()) > std::fabs(cells[strongest_].z())) strongest_ = b;
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
  // Jumps in time: their logs, and from the first to the last of them.
  void name_jumps() {
    out_.logs.clear();
    out_.time_lo_s = 1e300, out_.time_hi_s = -1e300, has_time_ = true;
    for (const StepValue& jump : cause_.jumps) {
      out_.time_lo_s = std::min(out_.time_lo_s, jump.t_s), out_.time_hi_s = std::max(out_.time_hi_s, jump.t_s);
      out_.logs.push_back(static_cast<int>(jump.log));
    }
    std::sort(out_.logs.begin(), out_.logs.end());
    out_.logs.erase(std::unique(out_.logs.begin(), out_.logs.end()), out_.logs.end());
    has_logs_ = out_.logs.size() < campaign_.runs.size();
  }
  // Where what the names add lies.
  void name_added() {
    const size_t n_pieces = n_temp_ ? static_cast<size_t>(std::ceil(span_degc_ / kPiece_degc)) : 0;
    std::vector<Piece> by_degc(n_pieces), by_cell(n_temp_), by_phase(3), by_log(campaign_.runs.size());
    std::map<long, Piece> by_time;
    for (size_t r = 0; r < campaign_.runs.size(); ++r) {
      const CampaignRun& run = campaign_.runs[r];
      for (size_t k = 0; k < run.n(); ++k) {
        const size_t row = static_cast<size_t>(run.used[k]);
        const Piece piece{1, std::pow(cause_.added[r][static_cast<long>(k)], 2)};
        by_log[r].add(piece);
        by_time[static_cast<long>((time_in_log_s(run, run.input.t_s[row]) - out_.time_lo_s) / kPiece_s)].add(piece);
        if (!n_temp_) continue;
        by_degc[part_of(run.input.smooth_degc[row], n_pieces)].add(piece);
        by_cell[cell_of(run.input.smooth_degc[row])].add(piece);
        by_phase[static_cast<size_t>(phase_of(run.input.rate_degc_min[row]))].add(piece);
      }
    }
    set_shares(by_cell, &tables_.by_temperature);
    set_shares(by_phase, &tables_.by_phase);
    set_shares(by_log, &tables_.by_log);
    name_pieces(by_degc, by_phase, by_log, by_time);
  }
  static void set_shares(const std::vector<Piece>& pieces, std::vector<WhereCell>* cells) {
    const double whole = sum_of(pieces).weight;
    for (size_t i = 0; i < pieces.size() && whole > 0; ++i) (*cells)[i].share = pieces[i].weight / whole;
  }
  void name_pieces(const std::vector<Piece>& by_degc, const std::vector<Piece>& by_phase,
                   const std::vector<Piece>& by_log, const std::map<long, Piece>& by_time) {
    if (const std::vector<size_t> logs = pieces_of_cause(by_log); !logs.empty()) {
      out_.logs.clear(), has_logs_ = true;
      for (size_t r : logs) out_.logs.push_back(static_cast<int>(campaign_.runs[r].input.log));
    }
    std::vector<long> at;
    std::vector<Piece> pieces;
    for (const auto& [place, piece] : by_time) at.push_back(place), pieces.push_back(piece);
    // In logs of one profile a temperature is a time too: the shorter of both is told.
    const PieceSpan in_degc = span_of_cause(by_degc), in_time = span_of_cause(pieces);
    is_thermal_ = in_degc.is_any() && (!in_time.is_any() || in_degc.n <= in_time.n);
    has_time_ = in_time.is_any() && !is_thermal_;
    if (is_thermal_) {
      const double width_degc = span_degc_ / static_cast<double>(by_degc.size());
      out_.temp_lo_degc = lo_degc_ + static_cast<double>(in_degc.first) * width_degc;
      out_.temp_hi_degc = lo_degc_ + static_cast<double>(in_degc.last + 1) * width_degc;
    }
    if (has_time_) {
      const double from_s = out_.time_lo_s;
      out_.time_lo_s = from_s + static_cast<double>(at[in_time.first]) * kPiece_s;
      out_.time_hi_s = std::min(out_.time_hi_s, from_s + static_cast<double>(at[in_time.last] + 1) * kPiece_s);
    }
    // What lies in a short time went one way then, whatever it was.
    if (const std::vector<size_t> phases = pieces_of_cause(by_phase); phases.size() == 1 && !has_time_)
      out_.direction = tables_.by_phase[phases.front()].name;
  }
  // Where the excess lies: first at the averaging times that are named.
  void name_excess() {
    if (has_times_) name_cells(decomposed(clear_));
    name_cells(tables_);
    if (!is_thermal_) name_mean();
    name_sections();
  }
  void name_cells(const Tables& tables) {
    if (!is_thermal_) name_temperatures(tables.by_temperature);
    if (out_.direction == "any") name_direction(tables.by_phase);
    if (!has_logs_) name_logs(tables.by_log);
  }
  // Spans of neighbouring temperatures, half of all at most: that which is most above the rest; if none is, the shortest one that
  // holds so much of the squares of the means as hardly ever comes by chance.
  void name_temperatures(const std::vector<WhereCell>& cells) {
    const Excess whole = sum_of(cells);
    double best = kOfMany;
    for (size_t from = 0; from < n_temp_; ++from) {
      Excess span;
      for (size_t to = from; to < n_temp_ && 2 * (to - from + 1) <= n_temp_; ++to) {
        span.add(cells[to]);
        const double above = above_rest(span, whole);
        if (above > best) best = above, name_span(from, to);
      }
    }
  }
  void name_span(size_t from, size_t to) {
    is_thermal_ = true;
    out_.temp_lo_degc = tables_.by_temperature[from].lo, out_.temp_hi_degc = tables_.by_temperature[to].hi;
  }
  void name_mean() {
    const auto sum = [&](size_t from, size_t to) {
      double squares = 0;
      for (size_t b = from; b <= to; ++b) squares += std::pow(tables_.by_temperature[b].mean_z, 2);
      return squares;
    };
    const auto is_clear = [&](size_t b) { return std::fabs(tables_.by_temperature[b].mean_z) > kClear; };
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
  void name_direction(const std::vector<WhereCell>& cells) {
    const Excess whole = sum_of(cells);
    double best = kClearPlace;
    for (const WhereCell& cell : cells) {
      const double above = above_rest(sum_of({cell}), whole);
      if (above > best) best = above, out_.direction = cell.name;
    }
  }
  // Logs that are above all others, each and together.
  void name_logs(const std::vector<WhereCell>& cells) {
    const Excess whole = sum_of(cells);
    Excess chosen;
    std::vector<int> logs;
    for (size_t r = 0; r < cells.size(); ++r)
      if (above_rest(sum_of({cells[r]}), whole) > kClearPlace)
        chosen.add(cells[r]), logs.push_back(static_cast<int>(campaign_.runs[r].input.log));
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
  void tell_temperatures() {
    if (!campaign_.has_temperature) return;
    const ReadTemperatures read(campaign_);
    out_.temp_lo_degc = read.told(out_.temp_lo_degc), out_.temp_hi_degc = read.told(out_.temp_hi_degc);
    out_.coldest_degc = read.told(campaign_.lo_degc), out_.hottest_degc = read.told(campaign_.hi_degc);
  }
  // How many times the residual is what the model expects, at the averaging times that stand out most.
  std::string strongest_times() const {
    const WhereCell& cell = tables_.by_tau[strongest_];
    const double times = std::sqrt(std::max(0.0, 1 + cell.excess / std::max(1.0, cell.n)));
    static const char* const kWhose[] = {"the model", "the noise that was estimated without a cause",
                                         "the noise that was found"};
    char most[80] = "", text[300];
    if (cell.lo > out_.tau_lo_s || cell.hi < out_.tau_hi_s)
      std::snprintf(most, sizeof most, ", most at %.0f to %.0f s", cell.lo, cell.hi);
    std::snprintf(text, sizeof text,
                  "at averaging times of %.0f to %.0f s%s: the residual is %.3g times what %s expects there%s",
                  out_.tau_lo_s, out_.tau_hi_s, most, times, kWhose[static_cast<size_t>(noise_)],
                  times < 1 && noise_ == WhoseNoise::kModel ? " (less noise than believed)" : "");
    return text;
  }
  std::string named_logs() const {
    std::string text;
    for (int log : out_.logs) text += (text.empty() ? "" : ", ") + std::to_string(log + 1);
    return (out_.logs.size() > 1 ? "in logs " : "in log ") + text;
  }
  // A place is told in whole degrees that hold it, where these were read.
  double whole_below(double degc) const { return std::floor(degc) >= out_.coldest_degc ? std::floor(degc) : degc; }
  double whole_above(double degc) const { return std::ceil(degc) <= out_.hottest_degc ? std::ceil(degc) : degc; }
  void say() {
    const auto add = [&](const std::string& part) { out_.sentence += (out_.sentence.empty() ? "" : ", ") + part; };
    const auto add_range = [&](const char* pattern, double lo, double hi) {
      char text[100];
      std::snprintf(text, sizeof text, pattern, lo, hi);
      add(text);
    };
    if (has_times_) add(strongest_times());
    if (is_thermal_)
      add_range("between %.0f and %.0f degC", whole_below(out_.temp_lo_degc), whole_above(out_.temp_hi_degc));
    if (has_time_)
      add_range(out_.time_lo_s < out_.time_hi_s ? "from %.0f to %.0f s" : "at %.0f s", out_.time_lo_s, out_.time_hi_s);
    if (out_.direction == "soak")
      add("while the temperature rests");
    else if (out_.direction != "any")
      add("while the temperature goes " + out_.direction);
    if (has_logs_) add(named_logs());
    if (!out_.sentence.empty()) return;
    out_.sentence = campaign_.has_temperature ? "no averaging time, temperature or direction stands out by itself"
                                              : "no averaging time stands out by itself";
    if (!cause_.has_times) out_.sentence += ": the noise was estimated on these logs, with whatever else they hold";
  }

  const Campaign& campaign_;
  const Fit& fit_;
  WhoseNoise noise_;
  const NamedCause& cause_;
  // A place of that kind, or averaging times, are named.
  bool is_thermal_ = false, has_time_ = false, has_logs_ = false, has_times_ = false;
  double lo_degc_, span_degc_;
  size_t n_temp_;
  SlowSums slow_temp_, slow_phase_;
  std::vector<Section> sections_;
  Tables tables_;
  std::vector<char> clear_; // per averaging time: it is named
  size_t strongest_ = 0;    // place in by_tau
  WhereResult out_;
};

} // namespace

WhereResult locate(const Campaign& campaign, const Fit& fit, WhoseNoise noise, const NamedCause& cause) {
  return Locator(campaign, fit, noise, cause).run();
}

} // namespace imucal
