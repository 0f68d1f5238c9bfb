// SPDX-License-Identifier: MIT
// Are rows repeated: a sensor read more often than it measures (sample and hold)?  Then neighbours are equal more often than by
// chance, and what is made of them as of so many measurements is too sure.
//
// Chance.  Neighbours of a healthy sensor are equal where both round to one quantum: of Gaussian steps of standard deviation
// s quanta and any phase with probability P(0) = G(1) - 2 G(0) + G(-1), G'' the density of N(0, s^2) (a rounded difference is
// spread by a triangle of two quanta).  s follows from the share of the steps other than 0 that are one quantum,
// P(1) + P(-1) over 1 - P(0): a few jumps hardly move it.  The quantum is the 5 % quantile of those steps: of fine or no
// rounding P(0) would then be 4 % (below 6 % it counts as nothing).  Nothing is told where more than 80 % are one quantum (noise
// below 0.7 quanta: the phase counts), nor where fewer than a quarter of the changes turn against the one before: a staircase
// of a ramp without noise.
//
// By stretches of 64 steps other than 0, so that noise may change over the record; the median over them.
#pragma once
#include <string>
#include <vector>

namespace imucal {

// Beyond chance this share of the rows repeats the row before, 0..1: (k - 1)/k where every reading stands k rows and rounding is
// fine.  0 where it cannot be told (fewer than 16 changes).  values: rows in order; not finite: none.
double repeated_share(const std::vector<double>& values);

// Above it the data are held ones.  Of 3600 simulated healthy records (tests/host/test_repeats.cpp: white and Markov noise,
// telegraph noise, bursts, ramps, knocks, changing levels, Student's t of 3 degrees; not rounded, and to 0.001 .. 2 standard
// deviations) the largest has 0.23: false alarms below 0.08 % with 95 % confidence.  Readings that stand two rows have 0.43 and
// more at a quantum of 0.3 standard deviations or less, 0.3 at one; above that some are not seen.
constexpr double kMostRepeatedShare = 0.28;

// How it is said: what was seen and what to do.  dt_s: step of the rows.
std::string repeated_text(double share, double dt_s);

} // namespace imucal
