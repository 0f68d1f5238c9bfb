// SPDX-License-Identifier: MIT
// The logs of one call as the engine sees them: runs of one axis with derived inputs, and which of their
// samples can be used.
#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "analysis/diagnose/logs/thermometer.h"
#include "io/log.h"
#include "physics/effects/estimation.h"

namespace imucal {

// Below this range of temperature nothing thermal can be asked.
constexpr double kLeastSpan_degc = 2;

// A jump in time that only one log has.
struct OwnJump {
  double t_s = 0, size_dph = 0, error_dph = 0;
};

// A pause that lasts another time in the seconds of a run than in its log.  t_s is in its middle; later rows came cut_s later than
// t_s says, or earlier, where it is negative: the log hides the pause.
struct CutPause {
  double t_s = 0, cut_s = 0;
};

struct CampaignRun {
  RunInput input;
  std::vector<int> used;         // rows with a usable rate, increasing
  std::vector<int> steps;        // per used row: seconds (in units of dt) since the used row before; first: 0
  double start_s = 0;            // t_s of the first row in the log
  std::vector<CutPause> cuts;    // increasing
  std::vector<Hold> holds;       // rows of the log: all but the first of each are left out
  ImpossibleReadings impossible; // rows of the log: no temperature; a pause before them
  RepeatedReadings repeated;     // between readings the temperature is on a straight line
  double own_white_dph2 = 0;     // white variance of every row that is of this log: its rates are rounded
  // Of a held-out log:
  std::vector<OwnJump> own_jumps = {}; // the level after each is free in every hypothesis
  double own_strength = 1;             // standard deviations of its noise are so many times those of the fitted logs
  size_t n() const { return used.size(); }
};

// A log of which an axis has no run.
struct LeftOutLog {
  size_t log = 0;  // its place among those given, as RunInput::log
  std::string why; // "has ..."
};

struct Campaign {
  std::vector<CampaignRun> runs;    // increasing in input.log, which alone says of which log a run is
  std::vector<LeftOutLog> left_out; // all other logs
  std::string axis;
  bool has_temperature = true;        // and it moves
  bool is_temperature_steady = false; // logged, but moves by less than kLeastSpan_degc
  double lo_degc = 0, hi_degc = 0;    // over all runs
  double temp_lsb_degc = 0;           // step of the thermometer where it is coarse; else 0
  double dt_s = 1;
  int order = 3; // of the polynomial
  double t0_degc = kUsualT0_degc, range_degc = kUsualRange_degc;
  double spread_dph = 0; // rms of what the polynomial alone leaves in minutes: scale of priors; 0: not known yet

  size_t n() const;         // used samples
  double longest_s() const; // time from the start to the end of its longest log
};

// A moment of a run, in seconds as RunInput::t_s, by the clock of the log: what is told, and what a simulator is given.
double time_in_log_s(const CampaignRun& run, double t_s);
// The rows of its log that the rows of a run are; the log has n_rows.
std::vector<size_t> rows_of_log(const CampaignRun& run, size_t n_rows);

// The runs of one axis.  Seconds without a rate, or flagged as saturated or faulty, are left out: the filters
// then predict over them.  Seconds in which the thermometer was stuck have no row, as if they were missing in the
// log.  Wrong readings of the thermometer count as missing; where the recorder hid a pause an hour has passed.  `steps` counts
// seconds by time stamps, never rows.  Left out are logs in which the axis has one and the same rate in every second, fewer than
// 60 usable seconds, or temperatures that are not in degC: all is as if they had not been given, but the places of the others.
// `left_out`: further ones.  No runs: no log can be used.  data_error: a log without that axis.
Campaign make_campaign(const std::vector<Log>& logs, const std::string& axis, const ErrorModel& model,
                       const std::vector<LeftOutLog>& left_out = {});
// Further logs, seen as the fitted ones are: the same polynomial and thermometer, and thermal questions if and only if those
// ask them, however little their own temperatures move.
Campaign make_campaign_like(const Campaign& fitted, const std::vector<Log>& logs, const ErrorModel& model);

// Leaves out runs: of each why ("has ..."); empty: it stays.
void drop_runs(const std::vector<std::string>& why, Campaign* campaign);

// Leaves the auxiliary columns that every run of these campaigns has: a column is known by its place among those of a run.
void keep_common_columns(const std::vector<Campaign*>& campaigns);

// Leave further samples out (those a structural effect has spoilt): per run and row.
void mask(Campaign* campaign, const std::vector<std::vector<char>>& unusable);

// Fills `used` and `steps` from the rates and ticks of the run.
void find_used(CampaignRun* run);

// Rows of columns that are used.
Eigen::MatrixXd used_rows(const CampaignRun& run, const std::vector<Column>& columns);
// Tn of a temperature, row by row.
Column normalised(const RunInput& in, Column temp_degc);
// Tn, Tn^2, .. Tn^order at the used rows.
Eigen::MatrixXd powers(const CampaignRun& run, const Column& tn, int order);

} // namespace imucal
