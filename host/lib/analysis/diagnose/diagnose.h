// SPDX-License-Identifier: MIT
// Door of the room: diagnose the sim-to-real gap of the logs of one device (design 1.1, 1.6).
#pragma once
#include <string>
#include <vector>

#include "analysis/diagnose/gap.h"
#include "analysis/diagnose/identify.h"
#include "analysis/diagnose/where.h"

namespace imucal {

struct DiagnoseOptions {
  std::string model_path;
  std::vector<std::string> logs, held_out;
  std::vector<std::string> axes;          // empty: all gyro axes of the first log
  std::vector<std::string> without, only; // effects
  double false_alarm_rate = 0.01;         // of the whole call: all candidates, tests and axes
  size_t nulls = 500;
  std::string cache_folder; // empty: none
  uint64_t seed = 1;
  int threads = 1;
  double model_seconds = 0; // the model's noise was itself estimated from this much data; 0: known
  bool quiet = true;
};

struct AxisResult {
  std::string axis;
  Selection selection;
  WhereResult where;
  GapResult gap;
  Identifiability identifiability;
  std::vector<std::string> advice;
  double seconds = 0;
};

struct DiagnoseResult {
  Json json;        // contract 1.6
  std::string text; // at most a screen
  ErrorModel model; // nominal with the effects found
  std::vector<std::string> warnings;
};

// data_error: unreadable files, an axis that is not there, identical logs, a held-out log that is fitted too,
// an effect that is not in the library.
DiagnoseResult diagnose(const DiagnoseOptions& options);

// The library as JSON: names, descriptions, parameters.
Json library_json();

// Used by report.cpp.
Json axis_json(const AxisResult& axis, const Campaign& campaign, const Fit& nominal_fit,
               const Fit& final_fit);
std::string axis_text(const AxisResult& axis, const Campaign& campaign);

} // namespace imucal
