// SPDX-License-Identifier: MIT
// The record of an axis as it was logged, and which of its rows no answer rests on: what a person looks at first.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "analysis/diagnose/logs/structure.h"
#include "io/log.h"

namespace imucal {

// Rows as they were logged; NaN: not there.
struct RecordedRows {
  std::vector<double> t_s, temp_degc, rate_dph;
  void add(const Log& log, const LogAxis& axis, size_t row);
};
// Rows that are left out for one reason.
struct LeftOutRows {
  std::string why;   // the name of an effect that spoils samples, or one of kLeftOut...
  size_t n = 0;      // all of them
  RecordedRows rows; // not every one where there are many
};
constexpr char kLeftOutNoRate[] = "no_rate", kLeftOutFlagged[] = "flagged", kLeftOutStuck[] = "thermometer_stuck",
               kLeftOutZero[] = "zero", kLeftOutNeighbour[] = "neighbour", kLeftOutJump[] = "jump",
               kLeftOutHit[] = "hit";
struct RecordedLog {
  size_t log = 0; // its place among the fitted or among the held-out logs
  bool is_held_out = false;
  std::string why_left_out;          // "has ...": the axis is answered without this log; empty: with it
  size_t every = 1;                  // `used` has one row of so many
  RecordedRows used;                 // of those that count
  std::vector<LeftOutRows> left_out; // in the order in which they are first met
};

// Collects why rows are left out, while an axis is judged.  The logs must outlive it.
class Record {
public:
  // Rows without a rate and flagged ones.  A log without the axis has no rows.
  Record(const std::vector<Log>& fitted, const std::vector<Log>& held_out, const std::string& axis);
  // The campaigns as find_structure left them.
  void leave_out(const StructureResult& found, const Campaign& fitted, const Campaign& held_out);
  // As they are in the end: what was left out since is at a jump; hits are left out of means.
  void leave_out_rest(const Campaign& fitted, const Campaign& held_out);
  std::vector<RecordedLog> logs() const;

private:
  struct Rows {
    const Log* log;
    const LogAxis* axis; // nullptr: the log has none
    bool is_held_out;
    std::string why_left_out;
    std::vector<uint8_t> why; // per row: place in names_
  };
  uint8_t place_of(const std::string& why);
  Rows& rows_of(const CampaignRun& run, bool is_held_out);
  void name_unused(const CampaignRun& run, const char* why, Rows* rows);
  void name_holds(const CampaignRun& run, Rows* rows);
  void name_lost_logs(const Campaign& campaign, bool is_held_out);

  size_t n_fitted_ = 0;
  std::vector<Rows> rows_;                // fitted logs, then held-out ones
  std::vector<std::string> names_ = {""}; // the first: the row counts
};

} // namespace imucal
