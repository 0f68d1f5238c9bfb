// SPDX-License-Identifier: MIT
// The verdict on what was learnt, of a log (fit.h) or on a device: the same rules, words and limits.
#pragma once
#include <map>
#include <string>
#include <vector>

#include "analysis/fit/fit.h"
#include "io/table_json.h"

namespace imucal {

struct JudgeOptions {
  std::vector<std::string> accept; // rules (fit_rules) that shall not refuse
  // Largest predicted error that is accepted without asking, in the axis' unit; 0: kMaxErrorDph or kMaxErrorMg.
  double max_error_dph = 0;
};

// Reasons against the axes: the core's rules of each (FitAxis::health, error_factor), then residual, temp-held, measurements
// and error.
// models: one per axis, null where none is known (then the residual is judged by its own noise, where that is known).
// Read of an axis: axis, health, error_factor, sigma_dph, residual_rms_dph, expected_residual_dph,
// repeated_frac, n_used, lossy_frac, renewal,
// renewal_cost_dph.
std::vector<FitReason> judge_axes(const std::vector<FitAxis>& axes, const std::vector<const ErrorModel*>& models,
                                  double dt_s, const JudgeOptions& options);

// Every reason was accepted beforehand.
bool is_accepted(const std::vector<FitReason>& reasons);

// Of the axes against which a reason was accepted: what their table is to say of it.  error_factor: of each axis, by name.
std::vector<TableNote> table_notes(const std::vector<FitReason>& reasons,
                                   const std::map<std::string, double>& error_factor);
std::vector<TableNote> table_notes(const FitResult& result);

// usage_error, with a suggestion: no rule has this name.
void require_rules(const std::vector<std::string>& names);

} // namespace imucal
