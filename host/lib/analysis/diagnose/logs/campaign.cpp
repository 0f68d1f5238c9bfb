// SPDX-License-Identifier: MIT
#include "analysis/diagnose/logs/campaign.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "analysis/diagnose/logs/smoothing.h"
#include "base/error.h"
#include "base/median.h"

namespace imucal {
namespace {

constexpr double kSmoothing_s = 40.0; // standard deviation of the Gaussian for a coarse thermometer
constexpr double kLeastTau_s = 1, kMostTau_s = 120, kNextTau = 1.4; // of the smoother for all others
constexpr double kValidated_s = 10;                                 // means that choose among them
constexpr double kDithered = 0.4;                                   // noise in steps, those of the rounding included
constexpr double kLongestFilled_s = 300; // longer holes: what the temperature did in them is not known
constexpr double kSameDegc = 1e-6;       // rounding of a printed temperature
constexpr double kCoarseRows = 12.5;     // rows of a log to each temperature, on average: coarse steps
constexpr size_t kFewestSeconds = 60;
constexpr double kLongestGap_s = 20000;
constexpr double kHiddenPause_s = 3600; // long enough that little of before is left
constexpr double kLeastKelvin = 200;    // and no board calibrated in air is so hot in degC

// Missing temperatures are interpolated in time; beyond the ends the nearest one holds.
std::vector<double> filled(const std::vector<double>& t_s, const std::vector<double>& temp) {
  std::vector<double> out = temp;
  const size_t n = temp.size();
  size_t last = n; // last finite row
  for (size_t i = 0; i < n; ++i) {
    if (!std::isfinite(temp[i])) continue;
    if (last == n) {
      for (size_t k = 0; k < i; ++k) out[k] = temp[i];
    } else {
      for (size_t k = last + 1; k < i; ++k)
        out[k] = temp[last] + (temp[i] - temp[last]) * (t_s[k] - t_s[last]) / (t_s[i] - t_s[last]);
    }
    last = i;
  }
  for (size_t k = last + 1; last < n && k < n; ++k) out[k] = temp[last];
  return out;
}

// Distance of neighbouring temperatures where a log has many rows to each, else 0.  All rows of all runs, sorted.  Logs pass the
// same temperatures, so further logs add rows and no temperatures: the rows of one log count, on average.
double coarse_step(const std::vector<double>& all, size_t n_runs) {
  if (all.size() < 200) return 0;
  std::vector<double> gaps;
  for (size_t i = 1; i < all.size(); ++i)
    if (all[i] - all[i - 1] > 1e-6) gaps.push_back(all[i] - all[i - 1]);
  const double distinct = static_cast<double>(gaps.size()) + 1;
  if (gaps.size() < 2 || kCoarseRows * distinct * static_cast<double>(n_runs) > static_cast<double>(all.size()))
    return 0;
  // The median: the end of the range and skipped levels leave odd gaps.
  std::nth_element(gaps.begin(), gaps.begin() + static_cast<long>(gaps.size() / 2), gaps.end());
  return gaps[gaps.size() / 2];
}

// Coarse temperatures: straight lines through the midpoints of the transitions; plateaus between two
// transitions in opposite directions are held.
std::vector<double> dequantised(const std::vector<double>& t_s, const std::vector<double>& temp) {
  const size_t n = temp.size();
  std::vector<double> knot_t{t_s[0]}, knot_v{temp[0]};
  double previous_level = temp[0];
  bool has_transition = false;
  double last_sign = 0;
  for (size_t i = 1; i < n; ++i) {
    if (std::fabs(temp[i] - temp[i - 1]) <= 1e-9) continue;
    const double sign = temp[i] > temp[i - 1] ? 1 : -1;
    const double middle_t = 0.5 * (t_s[i] + t_s[i - 1]), middle_v = 0.5 * (temp[i] + temp[i - 1]);
    if (!has_transition || sign != last_sign) {
      // The plateau before this transition is a turning point (or the start): hold its level in the middle.
      const double from = has_transition ? knot_t.back() : t_s[0];
      knot_t.push_back(0.5 * (from + middle_t));
      knot_v.push_back(previous_level);
    }
    knot_t.push_back(middle_t);
    knot_v.push_back(middle_v);
    has_transition = true;
    last_sign = sign;
    previous_level = temp[i];
  }
  knot_t.push_back(t_s[n - 1]);
  knot_v.push_back(temp[n - 1]);
  std::vector<double> out(n);
  size_t k = 0;
  for (size_t i = 0; i < n; ++i) {
    while (k + 2 < knot_t.size() && knot_t[k + 1] < t_s[i]) ++k;
    const double width = knot_t[k + 1] - knot_t[k];
    const double part = width > 0 ? std::clamp((t_s[i] - knot_t[k]) / width, 0.0, 1.0) : 1.0;
    out[i] = knot_v[k] + part * (knot_v[k + 1] - knot_v[k]);
  }
  return out;
}

// The straight line through the first samples of x, continued to the `n` places before them.
std::vector<double> line_before(const std::vector<double>& x, size_t fitted, size_t n) {
  const size_t m = std::min(fitted, x.size());
  double mean = 0, sxy = 0, sxx = 0;
  const double centre = 0.5 * static_cast<double>(m - 1);
  for (size_t i = 0; i < m; ++i) mean += x[i] / static_cast<double>(m);
  for (size_t i = 0; i < m; ++i) {
    const double u = static_cast<double>(i) - centre;
    sxy += u * (x[i] - mean), sxx += u * u;
  }
  std::vector<double> out(n);
  for (size_t k = 0; k < n; ++k) out[k] = mean + sxy / sxx * (static_cast<double>(k) - static_cast<double>(n) - centre);
  return out;
}

// Gaussian smoothing in time: three boxes of equal length have a standard deviation of half their length, so three passes
// of a running mean do.  Beyond the ends the series goes on as the straight line through what is next to them: a ramp
// stays a ramp, and the slope at an end is as quiet as elsewhere (a window that shrank there would show every step of a
// coarse thermometer).
std::vector<double> smoothed(const std::vector<double>& x, size_t half) {
  if (x.size() < 3 || half == 0) return x;
  std::vector<double> y = line_before(x, 2 * half + 1, 3 * half);
  std::vector<double> after = line_before({x.rbegin(), x.rend()}, 2 * half + 1, 3 * half);
  y.insert(y.end(), x.begin(), x.end());
  y.insert(y.end(), after.rbegin(), after.rend());
  for (int pass = 0; pass < 3; ++pass) {
    std::vector<double> sum(y.size() + 1, 0.0);
    for (size_t i = 0; i < y.size(); ++i) sum[i + 1] = sum[i] + (y[i] - x[0]);
    y.resize(y.size() - 2 * half);
    for (size_t i = 0; i < y.size(); ++i)
      y[i] = x[0] + (sum[i + 2 * half + 1] - sum[i]) / static_cast<double>(2 * half + 1);
  }
  return y;
}

// Whether the noise of a coarse thermometer spreads each temperature over its steps: then means know more than one step,
// and straight lines through the transitions would follow the noise.
bool is_dithered(const std::vector<double>& temp, double step_degc) {
  double squares = 0;
  for (size_t i = 2; i < temp.size(); ++i) squares += std::pow(temp[i] - 2 * temp[i - 1] + temp[i - 2], 2);
  return squares / static_cast<double>(temp.size()) > 6 * std::pow(kDithered * step_degc, 2);
}

// One column on the grid of its seconds, without the noise of the thermometer.
Column without_noise(const Column& grid, double dt_s) {
  std::vector<double> taus;
  for (double tau_s = kLeastTau_s; tau_s < kMostTau_s; tau_s *= kNextTau) taus.push_back(tau_s / dt_s);
  return whittaker(grid, best_tau(grid, taus, std::max(1L, std::lround(kValidated_s / dt_s))));
}

// Smooth temperature and its slope in the rows [first, end), between which no more than short holes are, by seconds: a row
// smooths over its neighbours in time, not over the rows that happen to stand next to it.
void smooth_stretch(const Column& temp, size_t first, size_t end, bool is_stepped, RunInput* in) {
  const size_t from = static_cast<size_t>(in->tick[first]);
  const auto place = [&](size_t row) { return static_cast<size_t>(in->tick[row]) - from; };
  Column ticks(place(end - 1) + 1), grid(ticks.size(), std::nan(""));
  std::iota(ticks.begin(), ticks.end(), 0.0);
  for (size_t row = first; row < end; ++row) grid[place(row)] = temp[row];
  if (is_stepped || grid.size() < kFewestSeconds)
    grid = smoothed(filled(ticks, grid), static_cast<size_t>(std::lround(kSmoothing_s / in->dt_s)));
  else
    grid = without_noise(grid, in->dt_s);
  for (size_t row = first; row < end; ++row) {
    const size_t k = place(row), before = k ? k - 1 : 0, after = k + 1 < grid.size() ? k + 1 : k;
    in->smooth_degc[row] = grid[k];
    if (after > before)
      in->rate_degc_min[row] = 60.0 * (grid[after] - grid[before]) / (static_cast<double>(after - before) * in->dt_s);
  }
}

// step_degc: of a coarse thermometer, else 0.
void derive(CampaignRun* run, double step_degc, bool has_temperature) {
  RunInput& in = run->input;
  const size_t n = in.size();
  in.tn.assign(n, 0.0);
  in.rate_degc_min.assign(n, 0.0);
  in.smooth_degc = in.temp_degc;
  if (!has_temperature) return;
  for (size_t i = 0; i < n; ++i) in.tn[i] = in.normalised(in.temp_degc[i]);
  const bool is_stepped = step_degc > 0 && !is_dithered(in.temp_degc, step_degc);
  const Column temp = is_stepped ? dequantised(in.t_s, in.temp_degc) : in.temp_degc;
  for (size_t first = 0, i = 1; i <= n; ++i) {
    if (i < n && in.t_s[i] - in.t_s[i - 1] <= kLongestFilled_s) continue;
    smooth_stretch(temp, first, i, is_stepped, &in);
    first = i;
  }
}

} // namespace

void find_used(CampaignRun* run) {
  run->used.clear();
  run->steps.clear();
  long last = 0;
  for (size_t i = 0; i < run->input.size(); ++i) {
    if (!std::isfinite(run->input.rate_dph[i])) continue;
    run->steps.push_back(run->used.empty() ? 0 : static_cast<int>(run->input.tick[i] - last));
    run->used.push_back(static_cast<int>(i));
    last = run->input.tick[i];
  }
}

double Campaign::longest_s() const {
  double longest = 0;
  for (const CampaignRun& run : runs) longest = std::max(longest, run.input.t_s.back());
  return longest;
}
size_t Campaign::n() const {
  size_t sum = 0;
  for (const CampaignRun& run : runs) sum += run.n();
  return sum;
}

// Seconds from the start and ticks.  A jump of hours (a clock that was set) becomes one long gap: nothing is known
// across it, and no filter runs over decades.  `pauses`: places before which the recorder had stopped.
static void set_times(const std::vector<double>& t_s, const std::vector<char>& pauses, double dt_s, CampaignRun* run) {
  RunInput& in = run->input;
  run->start_s = t_s.front();
  double cut_s = 0;
  for (size_t i = 0; i < t_s.size(); ++i) {
    const double gap_s = i ? t_s[i] - t_s[i - 1] : 0.0;
    const double kept_s = pauses[i] ? std::max(gap_s, kHiddenPause_s) : std::min(gap_s, kLongestGap_s);
    if (kept_s != gap_s) {
      in.restarts.push_back(i);
      run->cuts.push_back({in.t_s.back() + 0.5 * kept_s, gap_s - kept_s});
      cut_s += gap_s - kept_s;
    }
    in.t_s.push_back(t_s[i] - t_s[0] - cut_s);
    const long tick = std::lround(in.t_s.back() / dt_s);
    in.tick.push_back(i ? std::max(tick, in.tick.back() + 1) : tick);
  }
}

double time_in_log_s(const CampaignRun& run, double t_s) {
  double out = run.start_s + t_s;
  for (const CutPause& pause : run.cuts)
    if (t_s > pause.t_s) out += pause.cut_s;
  return out;
}

// Without those in which its thermometer gave the reading of an earlier one.
std::vector<size_t> rows_of_log(const CampaignRun& run, size_t n_rows) {
  std::vector<size_t> rows;
  size_t next = 0;
  for (const Hold& hold : run.holds) {
    for (; next <= hold.first; ++next) rows.push_back(next);
    next = hold.end;
  }
  for (; next < n_rows; ++next) rows.push_back(next);
  return rows;
}

static bool is_stuck(const CampaignRun& run) {
  for (size_t k = 1; k < run.n(); ++k)
    if (run.input.rate_dph[static_cast<size_t>(run.used[k])] != run.input.rate_dph[static_cast<size_t>(run.used[0])])
      return false;
  return run.n() > 1;
}

// Thermometer noise widens the range: its 1 and 99 % points count.  All rows of all runs, sorted.
static void refuse_steady_temperature(const std::vector<double>& all, Campaign* campaign) {
  if (!campaign->has_temperature) return;
  const size_t n = all.size();
  if (all[n - 1 - n / 100] - all[n / 100] >= kLeastSpan_degc) return;
  campaign->has_temperature = false, campaign->is_temperature_steady = true;
  campaign->order = 0, campaign->temp_lsb_degc = 0;
}

namespace {

// Settings of the campaign: time step, temperature or none, polynomial and its normalisation.
Campaign empty_campaign(const std::vector<Log>& logs, const std::vector<size_t>& places, const std::string& axis,
                        const ErrorModel& model) {
  Campaign campaign;
  campaign.axis = axis;
  std::vector<double> steps;
  for (size_t place : places) {
    campaign.has_temperature = campaign.has_temperature && logs[place].has_temperature();
    steps.push_back(logs[place].dt_s());
  }
  std::sort(steps.begin(), steps.end());
  campaign.dt_s = steps[steps.size() / 2];
  if (std::fabs(campaign.dt_s - 1.0) < 0.05) campaign.dt_s = 1.0;
  if (model.bias) {
    campaign.order = static_cast<int>(model.bias->coeff_dph.size()) - 1;
    campaign.t0_degc = model.bias->t0_degc;
    campaign.range_degc = model.bias->range_degc;
  }
  if (!campaign.has_temperature) campaign.order = 0;
  return campaign;
}

template <class T> std::vector<T> picked(const std::vector<T>& column, const std::vector<size_t>& rows) {
  std::vector<T> out;
  out.reserve(rows.size());
  for (size_t row : rows) out.push_back(column[row]);
  return out;
}

// The jump at the end of a hold is the thermometer's: the recorder went on.
void drop_ends_of_holds(CampaignRun* run) {
  const auto is_end = [&](size_t row) {
    return std::any_of(run->holds.begin(), run->holds.end(), [row](const Hold& hold) { return hold.end == row; });
  };
  std::vector<size_t>& rows = run->impossible.pauses;
  rows.erase(std::remove_if(rows.begin(), rows.end(), is_end), rows.end());
}

CampaignRun run_of(const Campaign& campaign, const Log& log, size_t place) {
  const LogAxis& column = log.axis(campaign.axis);
  CampaignRun run;
  Column temp_degc = campaign.has_temperature ? log.temp_degc : Column(log.size(), 0.0);
  std::vector<char> pauses(log.size(), 0);
  if (campaign.has_temperature) {
    std::vector<long> ticks;
    for (double t_s : log.t_s) ticks.push_back(std::lround((t_s - log.t_s.front()) / campaign.dt_s));
    run.repeated = repeated_readings(ticks, temp_degc);
    if (run.repeated.every > 0) {
      Column read(temp_degc.size(), std::nan(""));
      for (size_t row : run.repeated.rows) read[row] = temp_degc[row];
      temp_degc = read;
    }
    run.impossible = impossible_readings(log.t_s, temp_degc);
    for (size_t row : run.impossible.wrong) temp_degc[row] = std::nan("");
    run.holds = stuck_thermometer(log.t_s, campaign.dt_s, temp_degc);
    drop_ends_of_holds(&run);
    for (size_t row : run.impossible.pauses) pauses[row] = 1;
  }
  const std::vector<size_t> rows = rows_of_log(run, log.size());
  RunInput& in = run.input;
  in.log = place;
  in.dt_s = campaign.dt_s;
  in.t0_degc = campaign.t0_degc;
  in.range_degc = campaign.range_degc;
  in.order = campaign.order;
  for (const auto& [name, values] : log.auxiliary) in.auxiliary[name] = picked(values, rows);
  set_times(picked(log.t_s, rows), picked(pauses, rows), campaign.dt_s, &run);
  in.rate_dph = picked(column.rate_dph, rows);
  for (size_t i = 0; i < rows.size() && !column.flags.empty(); ++i)
    if (column.flags[rows[i]] & (kSaturated | kSensorFault)) in.rate_dph[i] = std::nan("");
  in.temp_degc = filled(in.t_s, picked(temp_degc, rows));
  return run;
}

// Why nothing can be asked of a run; empty: it can.
std::string why_unusable(const CampaignRun& run) {
  if (is_stuck(run)) return "has one and the same rate in every second: it is stuck or not connected";
  const std::vector<double>& temp = run.input.temp_degc;
  if (!temp.empty() && median(temp) > kLeastKelvin)
    return "has temperatures about " + std::to_string(std::lround(median(temp))) +
           ": they are not in degC (kelvin?), convert them";
  if (run.n() >= kFewestSeconds) return "";
  return "has " + std::to_string(run.n()) + " usable seconds; at least " + std::to_string(kFewestSeconds) +
         " are needed";
}

// The runs as they were recorded.  Where a log is left out the settings are made anew without it.
Campaign usable_runs(const std::vector<Log>& logs, const std::string& axis, const ErrorModel& model,
                     std::vector<LeftOutLog> left_out) {
  std::vector<size_t> places;
  for (size_t place = 0; place < logs.size(); ++place)
    if (std::none_of(left_out.begin(), left_out.end(), [&](const LeftOutLog& l) { return l.log == place; }))
      places.push_back(place);
  while (!places.empty()) {
    Campaign campaign = empty_campaign(logs, places, axis, model);
    std::vector<size_t> kept;
    for (size_t place : places) {
      CampaignRun run = run_of(campaign, logs[place], place);
      find_used(&run);
      if (const std::string why = why_unusable(run); !why.empty())
        left_out.push_back({place, why});
      else
        kept.push_back(place), campaign.runs.push_back(std::move(run));
    }
    campaign.left_out = left_out;
    if (kept.size() == places.size()) return campaign;
    places = std::move(kept);
  }
  Campaign none;
  none.axis = axis, none.left_out = std::move(left_out);
  return none;
}

} // namespace

// Temperatures of all runs, sorted; none where there are no temperatures.
static std::vector<double> sorted_temperatures(const Campaign& campaign) {
  std::vector<double> all;
  if (!campaign.has_temperature) return all;
  for (const CampaignRun& run : campaign.runs)
    all.insert(all.end(), run.input.temp_degc.begin(), run.input.temp_degc.end());
  std::sort(all.begin(), all.end());
  return all;
}
static void derive_all(Campaign* campaign) {
  campaign->lo_degc = 1e300, campaign->hi_degc = -1e300;
  for (CampaignRun& run : campaign->runs) {
    derive(&run, campaign->temp_lsb_degc, campaign->has_temperature);
    for (double temp : run.input.smooth_degc) {
      campaign->lo_degc = std::min(campaign->lo_degc, temp);
      campaign->hi_degc = std::max(campaign->hi_degc, temp);
    }
  }
}
// Free shapes are laid over the temperatures that are fitted, in all logs alike.
static void set_span(double lo_degc, double hi_degc, Campaign* campaign) {
  for (CampaignRun& run : campaign->runs) run.input.lo_degc = lo_degc, run.input.hi_degc = hi_degc;
}

Campaign make_campaign(const std::vector<Log>& logs, const std::string& axis, const ErrorModel& model,
                       const std::vector<LeftOutLog>& left_out) {
  Campaign campaign = usable_runs(logs, axis, model, left_out);
  if (campaign.runs.empty()) return campaign;
  const std::vector<double> temperatures = sorted_temperatures(campaign);
  campaign.temp_lsb_degc = coarse_step(temperatures, campaign.runs.size());
  refuse_steady_temperature(temperatures, &campaign);
  derive_all(&campaign);
  set_span(campaign.lo_degc, campaign.hi_degc, &campaign);
  return campaign;
}

Campaign make_campaign_like(const Campaign& fitted, const std::vector<Log>& logs, const ErrorModel& model) {
  Campaign campaign = usable_runs(logs, fitted.axis, model, {});
  if (campaign.runs.empty()) return campaign;
  const double own_lsb_degc = coarse_step(sorted_temperatures(campaign), campaign.runs.size());
  campaign.temp_lsb_degc = fitted.temp_lsb_degc > 0 ? fitted.temp_lsb_degc : own_lsb_degc;
  campaign.has_temperature = campaign.has_temperature && fitted.has_temperature;
  campaign.is_temperature_steady = fitted.is_temperature_steady;
  campaign.order = campaign.has_temperature ? fitted.order : 0;
  derive_all(&campaign);
  set_span(fitted.lo_degc, fitted.hi_degc, &campaign);
  return campaign;
}

void drop_runs(const std::vector<std::string>& why, Campaign* campaign) {
  std::vector<CampaignRun> kept;
  for (size_t r = 0; r < campaign->runs.size(); ++r)
    if (why[r].empty())
      kept.push_back(std::move(campaign->runs[r]));
    else
      campaign->left_out.push_back({campaign->runs[r].input.log, why[r]});
  campaign->runs = std::move(kept);
}

void keep_common_columns(const std::vector<Campaign*>& campaigns) {
  std::map<std::string, size_t> runs_with;
  size_t n_runs = 0;
  for (const Campaign* campaign : campaigns)
    for (const CampaignRun& run : campaign->runs) {
      ++n_runs;
      for (const auto& column : run.input.auxiliary) ++runs_with[column.first];
    }
  for (const auto& [name, n] : runs_with)
    for (Campaign* campaign : campaigns)
      for (CampaignRun& run : campaign->runs)
        if (n < n_runs) run.input.auxiliary.erase(name);
}

void mask(Campaign* campaign, const std::vector<std::vector<char>>& unusable) {
  for (size_t r = 0; r < campaign->runs.size() && r < unusable.size(); ++r) {
    CampaignRun& run = campaign->runs[r];
    for (size_t i = 0; i < run.input.size(); ++i)
      if (unusable[r][i]) run.input.rate_dph[i] = std::nan("");
    find_used(&run);
  }
}

Eigen::MatrixXd used_rows(const CampaignRun& run, const std::vector<Column>& columns) {
  Eigen::MatrixXd m(static_cast<long>(run.n()), static_cast<long>(columns.size()));
  const bool is_all = run.n() > 0 && static_cast<size_t>(run.used.back()) + 1 == run.n(); // they increase
  for (size_t c = 0; c < columns.size(); ++c) {
    double* to = m.data() + c * run.n();
    if (is_all)
      std::copy_n(columns[c].begin(), run.n(), to);
    else
      for (size_t k = 0; k < run.n(); ++k) to[k] = columns[c][static_cast<size_t>(run.used[k])];
  }
  return m;
}

Column normalised(const RunInput& in, Column temp_degc) {
  for (double& t : temp_degc) t = in.normalised(t);
  return temp_degc;
}

Eigen::MatrixXd powers(const CampaignRun& run, const Column& tn, int order) {
  Eigen::MatrixXd out(static_cast<long>(run.n()), order);
  for (size_t k = 0; k < run.n(); ++k) {
    double power = 1;
    for (int i = 0; i < order; ++i) out(static_cast<long>(k), i) = power *= tn[static_cast<size_t>(run.used[k])];
  }
  return out;
}

} // namespace imucal
