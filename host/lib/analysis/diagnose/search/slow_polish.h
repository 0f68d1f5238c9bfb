// SPDX-License-Identifier: MIT
// The search over noise and shape parameters of one hypothesis: from a place on the grids to the best one near it.
#pragma once
#include "analysis/diagnose/search/slow_likelihood.h"

namespace imucal {

constexpr int kEvaluations = 110, kQuickEvaluations = 60;

// Noise parameters, where they are not the believed ones, and shapes, by a simplex from where they are.  Sets value.
void polish(const SlowLikelihood& of, SlowModel* m, int evaluations);
// The same names with the noise as believed, where something is believed, and with other noise: the better of the two.
SlowModel polished(const SlowLikelihood& of, SlowModel m, int evaluations = kQuickEvaluations);
// The log likelihood of more logs than those searched, with the prior of the noise: its parameters are estimated on all of
// them, the shapes of names stay.  The logs searched come first in `all`.
double value_on(const SlowLikelihood& of, const SlowData& all, SlowModel m);
// The best neighbour of the last name's shape, again and again while it gains, with the noise as it is.
void approach(const SlowLikelihood& of, SlowModel* m);
// The last name of `with` beside `m`, at the best of these shapes, with the noise of `m`.  No names: none can be had.
SlowModel best_of(const SlowLikelihood& of, const SlowModel& m, const SlowModel& with,
                  const std::vector<Theta>& shapes);

} // namespace imucal
