// SPDX-License-Identifier: MIT
#include "analysis/diagnose/checks.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <sstream>

#include "analysis/diagnose/logs/blocks.h"
#include "analysis/diagnose/stages/gap.h"
#include "base/axis_unit.h"
#include "base/error.h"
#include "base/units.h"

namespace imucal {

namespace {

constexpr double kSameStep = 0.05; // by which the steps of two logs may differ: of a clock, not of another rate

std::string identity(const Log& log) {
  std::string out;
  for (const char* key : {"device", "serial"}) {
    const auto it = log.metadata.find(key);
    out += (it == log.metadata.end() ? std::string("?") : it->second) + "/";
  }
  return out;
}

// All logs are fitted and predicted as rows of one step.
void require_one_step(const std::vector<const Log*>& logs) {
  const auto is_faster = [](const Log* a, const Log* b) { return a->dt_s() < b->dt_s(); };
  const auto [fastest, slowest] = std::minmax_element(logs.begin(), logs.end(), is_faster);
  const double fast_s = (*fastest)->dt_s(), slow_s = (*slowest)->dt_s();
  if (!(slow_s > (1 + kSameStep) * fast_s)) return;
  std::ostringstream text;
  text << (*fastest)->path << " has a row every " << fast_s << " s, " << (*slowest)->path << " every " << slow_s
       << " s: all logs of one call need one step; average the rows of the first to that of the second";
  throw data_error(text.str());
}

// Columns that one log has and another has not: those are asked of none.
void tell_missing_columns(const std::vector<const Log*>& logs, std::vector<std::string>* warnings) {
  std::map<std::string, const Log*> with;
  for (const Log* log : logs)
    for (const auto& column : log->auxiliary) with.emplace(column.first, log);
  for (const auto& [name, has] : with)
    for (const Log* log : logs)
      if (log->auxiliary.count(name) == 0)
        warnings->push_back(log->path + " has no column " + name + ", " + has->path +
                            " has: whether the rate follows it is not asked");
}

// Without temperatures in all of them nothing thermal could be asked of any.
void require_all_temperatures(const std::vector<Log>& logs) {
  const auto has = [](const Log& log) { return log.has_temperature(); };
  const auto with = std::find_if(logs.begin(), logs.end(), has),
             without = std::find_if_not(logs.begin(), logs.end(), has);
  if (with != logs.end() && without != logs.end())
    throw data_error(without->path + ": without temperatures, which " + with->path +
                     " has: give a log with a column temp_degc, or take it out of --log");
}

// A record that is given twice counts twice, and one that is fitted foretells itself.  The first `n_fitted` logs are fitted.
void require_distinct(const std::vector<const Log*>& logs, size_t n_fitted) {
  for (size_t i = 0; i < logs.size(); ++i)
    for (size_t j = i + 1; j < logs.size(); ++j) {
      const Log &a = *logs[i], &b = *logs[j];
      if (same_rows(a, b))
        throw data_error(i < n_fitted && j >= n_fitted
                             ? b.path + ": held out, but the same data as " + a.path +
                                   ", which is fitted: take it out of --log or --holdout"
                             : b.path + ": the same data as " + a.path + ": give every log once");
      if (const std::string text = shared_rows_text(a, b); !text.empty()) throw data_error(text);
    }
}

} // namespace

void check_logs(const std::vector<Log>& logs, const std::vector<Log>& held_out, const ErrorModel& model,
                std::vector<std::string>* warnings) {
  if (logs.empty()) throw data_error("no log is given that could be fitted: name one with --log");
  require_all_temperatures(logs);
  std::vector<const Log*> all;
  for (const Log& log : logs) all.push_back(&log);
  for (const Log& log : held_out) all.push_back(&log);
  require_distinct(all, logs.size());
  require_one_step(all);
  tell_missing_columns(all, warnings);
  for (const Log* log : all)
    if (identity(*log) != identity(*all.front())) {
      warnings->push_back(log->path + " and " + all.front()->path +
                          " name different devices or serial numbers in their metadata: all logs of one call have to "
                          "be runs of one device");
      break;
    }
  double longest = 0;
  for (const Markov& m : model.markov) longest = std::max(longest, m.tau_s);
  for (const Log* log : all)
    if (log->t_s.back() - log->t_s.front() < 3 * longest)
      warnings->push_back(log->path + " is shorter than three of the model's longest time constant (" +
                          std::to_string(std::lround(longest)) + " s): slow noise cannot be judged on it");
  for (const Log* log : all)
    if (std::fabs(log->dt_s() - 1) > 0.05)
      warnings->push_back(log->path + " has a row every " + std::to_string(log->dt_s()) +
                          " s, not every second: rates are taken as means over that step");
}

// White noise of the log from differences of neighbouring seconds, robustly: another order of magnitude than the
// model's is most often a mistaken unit.
void check_scale(const Campaign& campaign, const NoiseModel& noise, std::vector<std::string>* warnings) {
  const double sigma = white_between_samples(campaign) / std::sqrt(campaign.dt_s);
  if (sigma > 0 && (sigma > 100 * noise.white_sigma_dph || sigma < 0.01 * noise.white_sigma_dph)) {
    std::ostringstream text;
    text.precision(3);
    const char* unit = axis_unit(campaign.axis);
    text << "axis " << campaign.axis << ": its noise from second to second is " << sigma << " " << unit
         << ", the model's " << noise.white_sigma_dph << " " << unit
         << ": are the units of the model and of the log's column right?";
    warnings->push_back(text.str());
  }
}

// The line of a data sheet is known to about a factor of two: beyond that the sensor, or the unit, is another one.
static constexpr double kAsOnSheet = 2;
void tell_data_sheet(const std::string& axis, const NoiseModel& sheet, const NoiseModel& fitted,
                     std::vector<std::string>* warnings) {
  const bool is_mg = is_accelerometer(axis);
  const double per_unit = is_mg ? 1 : white_sigma_dph(1); // white noise of a 1-s mean
  const double said = sheet.white_sigma_dph / per_unit, found = fitted.white_sigma_dph / per_unit;
  if (!(said > 0) || !(found > 0) || std::max(said, found) < kAsOnSheet * std::min(said, found)) return;
  char text[240];
  std::snprintf(
      text, sizeof text,
      "axis %s: %s %.3g %s was given, these logs show %.3g: give what they show, or look for what makes them %s",
      axis.c_str(), is_mg ? "white noise of" : "an angle random walk of", said, is_mg ? "mg/sqrt(Hz)" : "deg/sqrt(h)",
      found, found > said ? "noisier" : "quieter");
  warnings->push_back(text);
}

// No bias moves so far: 10 deg/s, or a third of gravity.  Single hits are no motion.
static constexpr double kTurned_dph = 36000, kTurned_mg = 330;
void check_rest(const Campaign& campaign, std::vector<std::string>* warnings) {
  const bool is_mg = is_accelerometer(campaign.axis);
  double widest = 0;
  for (const CampaignRun& run : campaign.runs) {
    std::vector<double> rates;
    for (const int row : run.used) rates.push_back(run.input.rate_dph[static_cast<size_t>(row)]);
    const auto value_at = [&](size_t place) {
      std::nth_element(rates.begin(), rates.begin() + static_cast<long>(place), rates.end());
      return rates[place];
    };
    const size_t hundredth = rates.size() / 100;
    widest = std::max(widest, value_at(rates.size() - 1 - hundredth) - value_at(hundredth));
  }
  if (widest < (is_mg ? kTurned_mg : kTurned_dph)) return;
  char text[240];
  std::snprintf(
      text, sizeof text,
      "axis %s moves by %.3g %s within a log: the device seems to have been turned; give logs of a device at rest, "
      "or look at the unit of the column",
      campaign.axis.c_str(), is_mg ? widest : widest / 3600, is_mg ? "mg" : "deg/s");
  warnings->push_back(text);
}

// A temperature that does not move says nothing about thermal causes.
void check_steady(const Campaign& campaign, std::vector<std::string>* warnings) {
  if (!campaign.is_temperature_steady) return;
  const std::string text =
      "the temperature moves by less than " + std::to_string(std::lround(kLeastSpan_degc)) +
      " degC over all logs: nothing thermal can be asked, and no polynomial is fitted; the rest is answered";
  if (std::find(warnings->begin(), warnings->end(), text) == warnings->end()) warnings->push_back(text);
}

void tell_impossible(const Campaign& campaign, const std::vector<Log>& logs, std::vector<std::string>* warnings) {
  for (const CampaignRun& run : campaign.runs) {
    const Log& log = logs[run.input.log];
    char text[300];
    if (run.repeated.every > 0) {
      std::snprintf(text, sizeof text,
                    ": the thermometer is read every %.4g s, and its reading stands in the rows between again: the "
                    "temperature there is taken to be on a straight line",
                    run.repeated.every * campaign.dt_s);
      warnings->push_back(log.path + text);
    }
    if (const std::vector<size_t>& wrong = run.impossible.wrong; !wrong.empty()) {
      std::snprintf(text, sizeof text,
                    ": %zu wrong reading%s of the thermometer, the first of %g degC at %.0f s: no board changes its "
                    "temperature so fast; taken as missing",
                    wrong.size(), wrong.size() == 1 ? "" : "s", log.temp_degc[wrong[0]], log.t_s[wrong[0]]);
      warnings->push_back(log.path + text);
    }
    for (const size_t row : run.impossible.pauses) {
      std::snprintf(text, sizeof text,
                    ": the temperature is another one from %.0f s on (%g degC) than before: the recorder had stopped; "
                    "taken as a pause of an hour",
                    log.t_s[row], log.temp_degc[row]);
      warnings->push_back(log.path + text);
    }
  }
}

// A stuck thermometer is the engineer's to mend, and what he may look for in those minutes is not in the answer.
void tell_stuck(const Campaign& campaign, const std::vector<Log>& logs, std::vector<std::string>* warnings) {
  for (const CampaignRun& run : campaign.runs) {
    const Log& log = logs[run.input.log];
    for (const Hold& hold : run.holds) {
      char text[200];
      std::snprintf(text, sizeof text,
                    ": the thermometer is stuck at %g degC from %.0f to %.0f s and then jumps to %g degC: "
                    "these seconds are left out",
                    log.temp_degc[hold.first], log.t_s[hold.first], log.t_s[hold.end - 1], log.temp_degc[hold.end]);
      warnings->push_back(log.path + text);
    }
  }
}

// A log that ends while the thermometer stands still for that long, though it moves from row to row elsewhere: a rest of the
// chamber or a thermometer that has stopped.  The log does not tell the two; whoever reads an answer about the time should know.
static constexpr double kLongRest_s = 1800, kLongRestPart = 0.25, kMovesWithin = 3; // seconds, of the log, rows
void tell_frozen(const Campaign& campaign, const std::vector<Log>& logs, std::vector<std::string>* warnings) {
  for (const CampaignRun& run : campaign.runs) {
    const Log& log = logs[run.input.log];
    if (!campaign.has_temperature || log.temp_degc.empty()) continue;
    size_t first = log.temp_degc.size() - 1, changes = 0;
    while (first > 0 && log.temp_degc[first - 1] == log.temp_degc.back()) --first;
    for (size_t i = 1; i <= first; ++i) changes += log.temp_degc[i] != log.temp_degc[i - 1] ? 1 : 0;
    const double rest_s = log.t_s.back() - log.t_s[first], all_s = log.t_s.back() - log.t_s.front();
    if (rest_s < std::max(kLongRest_s, kLongRestPart * all_s) ||
        kMovesWithin * static_cast<double>(changes) < static_cast<double>(first))
      continue;
    char text[240];
    std::snprintf(text, sizeof text,
                  ": the thermometer shows exactly %g degC from %.0f s to the end: if it has stopped, what is said to "
                  "follow the time may follow the temperature; cut the log there",
                  log.temp_degc.back(), log.t_s[first]);
    warnings->push_back(log.path + text);
  }
}

void tell_thermometer_noise(const std::string& axis, const ThermometerNoise& noise,
                            std::vector<std::string>* warnings) {
  char text[320];
  std::snprintf(
      text, sizeof text,
      "%s does not follow the noise of the thermometer, %.2g degC rms about the smoothed temperature: compensated "
      "at every reading it gets %.2g %s of it.  Here the temperature is smoothed; smooth it in the device too",
      axis.c_str(), noise.rms_degc, noise.rms_dph, is_accelerometer(axis) ? "mg" : "dph");
  warnings->push_back(text);
}

// A polynomial that goes beyond what it was fitted to is off by itself.
void tell_beyond(const Campaign& fitted, const Campaign& unseen, const std::vector<Log>& logs,
                 std::vector<std::string>* warnings) {
  if (!fitted.has_temperature || !unseen.has_temperature) return;
  for (const CampaignRun& run : unseen.runs) {
    const auto [lo, hi] = std::minmax_element(run.input.smooth_degc.begin(), run.input.smooth_degc.end());
    const double below = fitted.lo_degc - *lo, above = *hi - fitted.hi_degc;
    if (std::max(below, above) <= beyond_degc(fitted.lo_degc, fitted.hi_degc)) continue;
    char text[300];
    std::snprintf(
        text, sizeof text,
        " goes %.2g degC %s the temperatures of the fitted logs (%.0f to %.0f degC), where every answer is an "
        "extrapolated polynomial: the residual and how far the gap shrinks are judged without that part",
        std::max(below, above), above > below ? "above" : "below", fitted.lo_degc, fitted.hi_degc);
    warnings->push_back(logs[run.input.log].path + text);
  }
}

void tell_left_out(const Campaign& campaign, const std::vector<Log>& logs, AxisResult* axis) {
  for (const LeftOutLog& left : campaign.left_out) {
    const std::string& path = logs[left.log].path;
    axis->warnings.push_back(path + ": axis " + campaign.axis + " " + left.why +
                             ": this log is left out of its answer");
    axis->left_out.push_back({path, left.why});
  }
}

void require_own_channel(const std::vector<Log>& logs, const std::vector<std::string>& axes, const std::string& axis) {
  const auto is_one = [](double a, double b) { return a == b || (std::isnan(a) && std::isnan(b)); };
  for (const std::string& before : axes) {
    if (before == axis) return;
    const bool is_same = std::all_of(logs.begin(), logs.end(), [&](const Log& log) {
      const std::vector<double>&a = log.axis(before).rate_dph, &b = log.axis(axis).rate_dph;
      return std::equal(a.begin(), a.end(), b.begin(), b.end(), is_one);
    });
    if (is_same)
      throw data_error(
          "axis " + axis + " has the rates of axis " + before +
          " in every second: one channel was recorded twice; look at the wiring, or at the columns of the recorder");
  }
}

void require_runs(const Campaign& campaign, const std::vector<Log>& logs) {
  if (!campaign.runs.empty()) return;
  std::map<std::string, std::string> paths; // by reason
  for (const LeftOutLog& left : campaign.left_out) {
    std::string& list = paths[left.why];
    list += (list.empty() ? "" : ", ") + logs[left.log].path;
  }
  std::string all;
  for (const auto& [why, list] : paths) all += list + ": axis " + campaign.axis + " " + why + "; ";
  throw data_error(all +
                   "no log of this axis can be used: choose the other axes with --axis, or give logs that hold it");
}

// What follows temperature cannot be predicted where it is not known: a constant would be taken for it.
void require_temperature(const Campaign& unseen, const std::vector<Log>& held_out) {
  for (const CampaignRun& run : unseen.runs)
    if (!held_out[run.input.log].has_temperature())
      throw data_error(held_out[run.input.log].path +
                       ": held out, but without temperatures, which the fitted logs have: give a log with a "
                       "column temp_degc, or take it out of --holdout");
}
void tell_held_out(const Campaign& unseen, const std::vector<Log>& held_out, AxisResult* axis) {
  tell_left_out(unseen, held_out, axis);
  if (!held_out.empty() && unseen.runs.empty())
    axis->warnings.push_back("axis " + axis->axis +
                             ": no held-out log can be used: it is judged as if none had been given");
}

} // namespace imucal
