// SPDX-License-Identifier: MIT
// Door of the room: diagnose the sim-to-real gap of the logs of one device (host/formats.md, Diagnosis).  The answer is a
// structure; words and JSON are made from it in host/tools/diagnose.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "analysis/diagnose/identify.h"
#include "analysis/diagnose/select.h"
#include "analysis/diagnose/where.h"

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
  double model_seconds = 0; // kept for old command lines: the noise is estimated again in any case
  bool quiet = true;
};

struct AxisResult {
  std::string axis;
  std::string refused; // why there is no answer; the rest is then empty
  AxisStudy study;
  Campaign campaign; // as masked by structure
  Fit nominal_fit, final_fit;
  WhereResult where;
  Identifiability identifiability;
  bool is_calibration_cached = false;
  double seconds = 0, calibration_s = 0; // wall clock, without and of the calibration
  std::vector<std::string> warnings;
};

bool is_judged(const AxisResult& axis); // there is an answer

struct DiagnoseResult {
  std::vector<AxisResult> axes;
  ErrorModel model; // nominal with the effects found
  std::vector<std::string> warnings;
  std::vector<std::string> model_warnings; // for who writes `model`
  double calibration_s = 0;
  bool has_model = false;
};

// data_error: unreadable files, an axis that is not there, identical logs, a held-out log that is fitted too,
// an effect that is not in the library, no axis that can be judged.
DiagnoseResult diagnose(const DiagnoseOptions& options);
// The same of what has been read already.  `model` is believed where options.model_path names it, otherwise not looked at.
DiagnoseResult diagnose_logs(const DiagnoseOptions& options, const ErrorModel& model, const std::vector<Log>& logs,
                             const std::vector<Log>& held_out);

// The parameters of a term with their standard errors, by the names of the contract.  `campaign`: the one that the term
// was fitted on, with one run at least; not looked at where term.fixed_parameters are given.
Parameters effect_values(const Term& term, const Campaign& campaign);

// $XDG_CACHE_HOME/imucal or ~/.cache/imucal; empty when neither is known.
std::string default_cache_folder();

} // namespace imucal
