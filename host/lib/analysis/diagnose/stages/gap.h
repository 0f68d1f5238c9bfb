// SPDX-License-Identifier: MIT
// How far the gap shrinks on data that were not fitted.
//
// A hypothesis M predicts a held-out unit u (a log, or a quarter of the only one) with log density
// L(M; train + u) - L(M; train): constants and start states of u are integrated out.  In dph: the mean learned from the
// training data is taken off the held-out rates; the mean square of what is left, averaged over minutes, is told beside what
// the noise model alone leaves in them.  The shrinkage and its interval are those of reduction.h: of the mean without its
// noise.
#pragma once
#include <algorithm>
#include <string>
#include <vector>

#include "analysis/diagnose/evidence/fit.h"
#include "analysis/diagnose/search/search.h"
#include "analysis/diagnose/stages/minutes_left.h"

namespace imucal {

// How far beyond the temperatures of the fitted logs held-out rates still count: so much, and no more than this part of their
// range, since a polynomial leaves what it was fitted to the sooner the smaller that is.
constexpr double kBeyond_degc = 1, kBeyondPart = 0.02;
inline double beyond_degc(double lo_degc, double hi_degc) {
  return std::min(kBeyond_degc, kBeyondPart * (hi_degc - lo_degc));
}
// The temperatures of the rows that were fitted.
class FittedSpan {
public:
  // Used rows [first, end) of a run.
  void add(const CampaignRun& run, size_t first, size_t end);
  // Whether a held-out rate at this temperature counts; no rows: none does.
  bool holds(double temp_degc) const;

private:
  double lo_degc_ = 1e300, hi_degc_ = -1e300;
};

// Width of the 95 % interval of a shrinkage from which it is no figure: the noise of the held-out rates hides the gap.
constexpr double kWidestFigure = 0.4;

enum class HeldOut { kLogs, kEachLog, kQuarters };
constexpr size_t kQuarters = 4;
// A run with the used rows of one of its quarters alone, or without them.
CampaignRun only_quarter(const CampaignRun& run, size_t quarter, bool is_inside);

// What a name is worth to the held-out data, and what it would be worth to data without noise that are just as the fitted
// hypothesis predicts: what they can show of it.
struct Support {
  double nats = 0;     // lost without the name; < 0: they speak against it
  double expected = 0; // NaN: not worked out
};

// What the answer makes of the likelihood of the held-out units, over that of the model.
struct Foretold {
  double delta_deviance = 0;         // of all units
  std::vector<double> delta_by_unit; // deviance
  std::vector<size_t> log_by_unit;   // place among the fitted, or the held-out logs
  std::vector<Support> beyond_start; // per name, against nothing but the start states it leaves
  std::vector<Support> at_all;       // per name, against neither the name nor its start states
  std::vector<double> growth;        // per name, of the rms of the minutes of logs: by it, over neither
  double hours = 0;                  // of the units
};

// What one held-out unit (a log, or a quarter of the only one) shows in minutes, as it is judged: about its own constant.
struct UnitMinutes {
  size_t log = 0; // place among the fitted, or the held-out logs
  std::vector<double> t_s, temp_degc, slope_degc_min, rate_dph, before_dph, after_dph;
};

struct GapResult {
  HeldOut method = HeldOut::kEachLog;
  Foretold foretold; // by block means
  // Deviance, where something of the seconds is named, which block means hide (foretold_seconds.h); else empty.
  std::vector<double> gain_of_seconds_by_unit;
  bool is_gain_of_seconds() const { return !gain_of_seconds_by_unit.empty(); }
  const std::vector<double>& gain_by_unit() const; // of these, or of block means
  double gain() const;                             // deviance per hour
  double gain_mean_s = 1;                          // length of the means whose deviance that is
  MinutesLeft minutes;
  std::vector<UnitMinutes> units; // whose rms `minutes` holds

  // Something in the mean predicts other data; else the figures are of the deviance.  What differs from run to run by chance
  // predicts none: it is left in what remains.
  bool has_mean = false;
  // Of a shape that only comes nearest to what was found.  What it gets wrong has a shape of its own; an interval that does not
  // know that shape is too narrow.
  bool is_of_nearest = false;
  // Of states in which runs began, and no more: they are free in every run and foretell nothing.
  bool is_of_starts = false;
  double before = 0, after = 0;               // mean square above the noise, dph^2
  double shrinkage = 0, ci_lo = 0, ci_hi = 0; // 95 % interval
  // The rates tell the shrinkage well enough for a figure.
  bool has_figure() const { return has_mean && !is_of_nearest && !is_of_starts && ci_hi - ci_lo < kWidestFigure; }
  // Where the minutes exceed the noise, by more than one standard error of it, the answer may miss something whose shape the
  // interval does not know, or the noise is more than it is thought to be: the interval then holds what the minutes themselves
  // show too, and the figure lies between the two.
  void hold_what_minutes_show();
};

// The fitted logs, and then the held-out ones, with the scale of priors of the fitted ones.
SlowData with_held_out(const SlowData& training, const Campaign& held_out);

// `training`: block means of the fitted logs; `held_out`: of further logs, or nullptr.
GapResult measure_gap(const SlowSearch& search, const SlowData& training, const Campaign* held_out,
                      const SlowModel& null, const SlowModel& final);

// log p(held-out units | training data, model): the same for one hypothesis alone.
double predicted_nats(const SlowSearch& search, const SlowData& training, const Campaign* held_out,
                      const SlowModel& model);

} // namespace imucal
