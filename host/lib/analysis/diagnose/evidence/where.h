// SPDX-License-Identifier: MIT
// Where the gap lies: an additive decomposition of the standardised innovations of the nominal model.
//
// Each run's innovations are transformed by an orthonormal Haar transform; the excess w^2 - 1 of every
// coefficient belongs to one averaging time, one temperature, one phase and one log, so that the cells of
// each table add up to the whole excess.  Under a true model a cell of n coefficients has mean 0 and standard
// deviation sqrt(2 n): its z.
//
// Averaging times are named whose excess comes by chance in one of a hundred right models, all of them together.
//
// A place (of temperature, time, direction, or logs) of a cause in the mean is where what the names add to the mean lies, its
// squares measured by the noise (place.h); jumps in time are in their logs, at their times.  Of anything else it is where the
// excess lies, at the averaging times that are named or, where these show none, at all: the mean excess of a coefficient is at
// least twice that of the rest, and their difference is three standard errors (four where many places are compared), each
// coefficient with its own square as its variance.  So a few large coefficients of slow noise make no place.  A span of
// temperatures is also named where it holds a share of the squares of mean_z that comes by chance in one of 500, were all
// temperatures alike.
#pragma once
#include <string>
#include <vector>

#include "analysis/diagnose/evidence/fit.h"

namespace imucal {

struct WhereCell {
  double lo = 0, hi = 0; // of averaging time [s] or temperature [degC]
  std::string name;      // of a phase or log
  double n = 0, excess = 0;
  double square = 0; // sum of (w^2 - 1)^2
  double mean_z = 0; // of the mean: sum e / sqrt(n) over slow changes, signed (temperature and phase cells)
  double share = 0;  // of the squares of what the names add to the mean; 0 where they add nothing
  double z() const;
};

struct WhereResult {
  std::vector<WhereCell> by_tau, by_temperature, by_phase, by_log;
  double tau_lo_s = 0, tau_hi_s = 0, temp_lo_degc = 0, temp_hi_degc = 0, time_lo_s = 0, time_hi_s = 0;
  double coldest_degc = 0, hottest_degc = 0; // that were read, to a tenth
  std::string direction = "any";
  std::vector<int> logs;
  std::string sentence;
};

// Whose noise a residual is measured by; for the words.
enum class WhoseNoise { kModel, kEstimated, kFound };

// What is named.
struct NamedCause {
  bool has_place = true; // false: a noise that is everywhere the same
  bool has_times = true; // false: the noise was estimated on these logs, nothing was named, and it holds what there is
  std::vector<Eigen::VectorXd> added = {}; // to the mean by the names, standardised as the innovations; empty: nothing
  std::vector<StepValue> jumps = {};       // by the clocks of their logs, where nothing else is named
};
// `fit`: of the nominal mean, under the noise that is measured by.
WhereResult locate(const Campaign& campaign, const Fit& fit, WhoseNoise noise, const NamedCause& cause = {});

} // namespace imucal
