// SPDX-License-Identifier: MIT
// What one call answers, axis by axis.
#pragma once
#include <string>
#include <vector>

#include "analysis/diagnose/evidence/identify.h"
#include "analysis/diagnose/evidence/where.h"
#include "analysis/diagnose/record.h"
#include "analysis/diagnose/select.h"
#include "analysis/diagnose/stages/dp2.h"

namespace imucal {

// A log, fitted or held out, that an axis is answered without.
struct UnusedLog {
  std::string path, why; // "has ..."
};
// Runs of the advised profile, half of them mirrored.
constexpr size_t kAdvisedRuns = 4;

struct AxisResult {
  std::string axis;
  std::string refused; // why there is no answer; the rest is then empty
  AxisStudy study;
  Campaign campaign; // as masked by structure
  Fit nominal_fit, final_fit;
  Fit plain_fit; // of the nominal model by least squares: the polynomial that a table would hold
  WhereResult where;
  Dp2Comparison dp2;
  Identifiability identifiability;
  Identifiability with_advised; // of kAdvisedRuns of the advised profile; empty without temperatures
  bool is_believed = false;     // the noise is that of a model
  bool is_calibration_cached = false;
  double seconds = 0, calibration_s = 0; // wall clock, without and of the calibration
  std::vector<UnusedLog> left_out;
  std::vector<RecordedLog> record; // as it was logged, of an axis that is refused too
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

// The parameters of a term with their standard errors, by the names of the contract.  `campaign`: the one that the term
// was fitted on, with one run at least; not looked at where term.fixed_parameters are given.
Parameters effect_values(const Term& term, const Campaign& campaign);

} // namespace imucal
