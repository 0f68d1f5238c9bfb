// SPDX-License-Identifier: MIT
// What no temperature profile of a given duration can beat.
//
// Two figures, both for the worst one-sigma calibration error over the span, p = order + 1 coefficients:
//
// 1. slow_ramp_dph = sqrt(p S0 / T),  S0 = sum 2 sigma^2 tau + (60 arw)^2.  For ramps that are slow against every
//    tau the noise acts like white noise of density S0.  Then the information matrix is M = (1/S0) int f f' dt,
//    and the mean over time of f(T(t))' M^-1 f(T(t)) is p S0 / T.  The maximum cannot be below the mean (Kiefer &
//    Wolfowitz 1960, equivalence theorem: they are equal for the D-optimal occupancy).
//    This is a yardstick and not a proof.  A fast profile moves the polynomial's signal to frequencies where
//    Markov noise is weaker.  And a short record tells as much as one longer by 2 tau, because the stationary
//    start says something of each Markov error.
//
// 2. proven_dph: a lower bound for *every* profile T(t) inside the span with |dT/dt| <= rho, exact for the
//    sampled filter.  The derivation, in steps:
//    (a) Splitting.  V = sum_m V_m (Markov terms and white noise).  For any split X = sum_m X L_m with diagonal
//        L_m, sum_m L_m = I:   X' V^-1 X <= sum_m L_m X' V_m^-1 X L_m.  (A weighted mean is no better than its
//        parts: joint convexity of x' V^-1 x, Ando 1979, parallel sum.)
//
//    (b) One Markov term, exactly, with phi = exp(-dt/tau), S = sigma^2 (1 + phi)/(1 - phi):
//          x' V_m^-1 x = sum x_k^2 / S + phi (x_1^2 + x_n^2) / (sigma^2 (1 + phi))
//                        + phi sum (x_k - x_{k-1})^2 / (sigma^2 (1 - phi^2)),
//        and (x_k - x_{k-1})^2 <= dt int x'(t)^2 dt.  White noise: sum x_k^2 / r.
//
//    (c) So M <= int G(T(t)) dt + E(T(0)) + E(T(end)).  G contains f f' and rho^2 f_T f_T' (f_T = df/dTn), E the
//        end terms.  Sums over samples differ from integrals by at most rho dt/4 max |d/dTn|, which is added.
//
//    (d) Traversal.  A profile whose extreme temperatures are a and b has passed every temperature between them,
//        at no more than rho: it spends at least the time 1/rho per degree there.  The rest of the time may be
//        spent anywhere in [a, b].  Branch and bound over boxes covers all (a, b): within a box the time of the
//        shorter interval is forced and that of the longer one is free.
//
//    (e) Duality (extends Kiefer-Wolfowitz to this information set).  For any weights mu over the span,
//        A = int f f' dmu, and any Z:  max_T f' M^-1 f >= tr(M^-1 A) >= tr(A^1/2 Z)^2 / tr(Z' M Z).
//        Z and mu come from a numerical saddle point.  The inequality holds for any Z and mu: an error of that
//        solver makes the bound looser, never wrong.  tr(Z' G(T) Z) is a polynomial of degree d <= 2 order.  Its
//        maximum is taken over N + 1 Chebyshev points and divided by cos(d pi / 2N) (Ehlich & Zeller 1964), so
//        that no temperature between the points is missed.
//
//    Without a rate limit f_T is unbounded.  Then every part of the polynomial but the constant is split into the
//    white noise alone.
#pragma once
#include <string>
#include <vector>

#include "io/model.h"

namespace imucal {

struct BoundRequest {
  ErrorModel model;
  int order = 3;
  double duration_s = 0;
  double span_degc = 0;             // width of the calibrated range; needed with a rate only
  double max_rate_degc_per_min = 0; // the larger of heating and cooling; 0: unlimited
  double prior_sigma_dph = kPriorSigma;
  double dt_s = 1.0;
};

struct Bound {
  double slow_ramp_dph = 0; // the contract's bound_dph
  double proven_dph = 0;
  double relaxation_dph = 0; // error of the relaxed design that the proof compares with: how tight the proof is
  double inset_low_frac = 0, inset_high_frac = 0; // part of the range left out by the box that gave the bound
  int boxes = 0;
  std::vector<std::string> assumptions;
  std::vector<std::string> proven_assumptions;
};

double slow_ramp_bound(const ErrorModel& model, int order, double duration_s); // sqrt(p S0 / T)

// usage_error: duration or order out of range; data_error: no noise.
Bound calibration_bound(const BoundRequest& request);

} // namespace imucal
