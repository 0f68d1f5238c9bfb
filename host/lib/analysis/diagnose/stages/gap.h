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
#include "analysis/diagnose/evidence/minutes.h"
#include "analysis/diagnose/search/search.h"

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

struct GapResult {
  HeldOut method = HeldOut::kEachLog;
  double before = 0, after = 0; // mean square above the noise, dph^2
  double shrinkage = 0, ci_lo = 0, ci_hi = 0;
  double part_within = 1; // of the held-out rates that are at temperatures that were fitted
  // Without any such rate the residual is that of an extrapolated polynomial, which may be anything.
  bool has_residual() const { return part_within > 0; }
  // The rates tell the shrinkage well enough for a figure.
  bool has_figure() const { return has_mean && !is_of_nearest && !is_of_starts && ci_hi - ci_lo < kWidestFigure; }
  // Of a shape that only comes nearest to what was found.  What it gets wrong has a shape of its own; an interval that does not
  // know that shape is too narrow.
  bool is_of_nearest = false;
  // Of states in which runs began, and no more: they are free in every run and foretell nothing.
  bool is_of_starts = false;
  // Something in the mean predicts other data; else the figures are of the deviance.  What differs from run to run by chance
  // predicts none: it is left in what remains.
  bool has_mean = false;
  double gain = 0;                   // deviance per hour that the names remove
  double delta_deviance = 0;         // of all held-out units
  std::vector<double> delta_by_unit; // deviance
  std::vector<size_t> log_by_unit;   // place among the fitted, or the held-out logs
  // What a name is worth to the held-out data, and what it would be worth to data without noise that are just as the
  // fitted hypothesis predicts: what they can show of it.
  struct Support {
    double nats = 0;     // lost without the name; < 0: they speak against it
    double expected = 0; // NaN: not worked out
  };
  std::vector<Support> beyond_start; // per name, against nothing but the start states it leaves
  std::vector<Support> at_all;       // per name, against neither the name nor its start states
  double hours = 0,
         hours_fitted = 0; // the latter where the noise was estimated on other logs; 0: believed, or on the same
  double minute_s = 60;    // length of the means of what follows (minutes.h)
  double rms_before_dph = 0, rms_after_dph = 0, noise_rms_dph = 0; // of minutes
  double run_to_run_rms_dph = 0; // of what is left: what an effect that differs from run to run by chance would take
  std::vector<Minutes> minutes;  // of the held-out units, after
  // What a noise alone would leave in them about the mean of their unit, in each log as strong as it is there.
  double rms_of_noise_dph(const NoiseModel& noise) const;
  // What the believed noise, or that estimated without a cause, would leave; noise_rms_dph holds the noise that was found.
  double believed_rms_dph = 0;
  // Standard error of noise_rms_dph: by how far one draw of that noise scatters; NaN: not known.
  double noise_error_dph = 0;
  // What the errors of the fitted coefficients are expected to add to the mean square of these minutes (a polynomial of one log
  // goes astray in others), and its standard deviation.
  double fit_ms_dph2 = 0, fit_ms_error_dph2 = 0;
  double expected_ms_dph2() const { return noise_rms_dph * noise_rms_dph + fit_ms_dph2; } // of noise and these errors
  // How many times what noise and errors of the fit are expected to leave is left, without what differs from run to run.
  double times_expected() const;
  // Of noise_rms_dph, by which the minutes exceed it.
  double errors_above_noise() const;
  // Of the held-out minutes more is left than noise and errors of the fit are expected to leave, beyond the scatter of both and,
  // where the fitted logs told the noise, of what they told (the same per hour): the ratio of two such mean squares has an
  // F distribution, its logarithm is nearly normal.  And so much more that the answer misses something of weight.  What is named
  // as different from run to run is not missed.
  bool exceeds_noise(const SelectorConstants& constants) const;
  bool leaves_mean(const SelectorConstants& constants) const;
  double ms_after_dph2(bool with_run_to_run) const;
  // Where the minutes exceed the noise, by more than one standard error of it, the answer may miss something whose shape the
  // interval does not know, or the noise is more than it is thought to be: the interval then holds what the minutes themselves
  // show too, and the figure lies between the two.
  void hold_what_minutes_show();
  // Of the mean square of the held-out minutes above the noise.
  double part_left(bool with_run_to_run = true) const;
  double dp2_before_dph = 0, dp2_after_dph = 0; // distance of the DP2 curves of data and model
  std::vector<double> dp2_tau_s, dp2_data_dph, dp2_nominal_dph, dp2_final_dph;
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
