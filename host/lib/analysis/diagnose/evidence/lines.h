// SPDX-License-Identifier: MIT
// Lines in the spectrum of innovations, steady ones and ones that drift with temperature: found on a grid, then placed.
#pragma once
#include <vector>

#include "analysis/diagnose/logs/campaign.h"
#include "physics/effects/effect.h"

namespace imucal {

// A line in the spectrum of innovations, with its drift over temperature.
struct Line {
  double hz = 0, hz_per_degc = 0, gain_nats = 0;
};
// Sum over the runs of |transform of e|^2 / n at the bins 0 .. n_fft / 2; n_fft: the power of two that holds the longest run.
std::vector<double> summed_power(const Campaign& campaign, const std::vector<Eigen::VectorXd>& e);
// The strongest line that does not drift; power as summed_power gives it.
Line steady_line(const Campaign& campaign, const std::vector<double>& power);
// The strongest line above its surroundings, on a grid of frequencies, that does not drift.  What the grid loses on a line
// between its places is not given back: thresholds are those of the grid.
Line strongest_line(const Campaign& campaign, const std::vector<Eigen::VectorXd>& e);
// The strongest along f0 + k (T - t0), on a grid of k, where it gains more than `steady`, else `steady`.
Line stronger_drifting(const Campaign& campaign, const std::vector<Eigen::VectorXd>& e, const Line& steady);
// A line found, with frequency and drift where the power along its cosine and sine is largest near the place on the grid.
// A run of N seconds tells a frequency to a part of 1/N Hz, and what misses it leaves a beat behind.
struct PlacedLine {
  Theta shape;           // as the effect `tone` takes it
  double power_nats = 0; // against white noise of 1, all runs together
};
PlacedLine place_of(const Campaign& campaign, const std::vector<Eigen::VectorXd>& e, const EffectEstimator& tone,
                    const Line& line);
// Standard errors of such a place.  e: innovations with the line in them, of the noise without it.
Theta errors_of_place(const Campaign& campaign, const std::vector<Eigen::VectorXd>& e, const EffectEstimator& tone,
                      const Theta& place);

} // namespace imucal
