// SPDX-License-Identifier: MIT
// Door of the room: diagnose the sim-to-real gap of the logs of one device (host/formats.md, Diagnosis).  The answer is a
// structure; words and JSON are made from it in host/tools/diagnose.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "analysis/diagnose/result.h"

namespace imucal {

struct DiagnoseOptions {
  std::string model_path; // empty: nothing is believed of the noise
  // Data sheet in the place of a model: noise known to about a factor of two.
  std::optional<double> arw_deg_rt_h;
  std::optional<Markov> instability;
  std::vector<std::string> logs, held_out;
  std::vector<std::string> axes;          // empty: all gyro axes of the first log
  std::vector<std::string> without, only; // effects
  double false_alarm_rate = 0.01;         // of the whole call: all candidates and axes
  size_t nulls = 150;                     // simulations of the fitted noise that set the threshold
  std::string cache_folder;               // empty: none
  SelectorConstants constants;
  uint64_t seed = 1;
  int threads = 1;
};

// data_error: no log to fit, unreadable files, two identical logs among all that are fitted or held out, an axis that is not
// there or is asked for twice, an effect that is not in the library, no axis that can be judged.
DiagnoseResult diagnose(const DiagnoseOptions& options);
// The same of what has been read already.  `model` is believed where options.model_path names it, otherwise not looked at.
DiagnoseResult diagnose_logs(const DiagnoseOptions& options, const ErrorModel& model, const std::vector<Log>& logs,
                             const std::vector<Log>& held_out);

// $XDG_CACHE_HOME/imucal or ~/.cache/imucal; empty when neither is known.
std::string default_cache_folder();

} // namespace imucal
