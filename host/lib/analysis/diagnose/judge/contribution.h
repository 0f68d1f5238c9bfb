// SPDX-License-Identifier: MIT
// What each finding adds to the rates: what people want to read first.
#pragma once
#include <vector>

#include "analysis/diagnose/stages/selected.h"

namespace imucal {

// Fills rms_dph of what `final` holds; `fit`: of that hypothesis to the seconds of `campaign`.
void fill_contributions(const Campaign& campaign, const Hypothesis& final, const Fit& fit,
                        std::vector<SelectedEffect>* effects);
// What all terms of a hypothesis add to the mean [dph], each run about its mean, or about nothing where they add next to nothing
// half of the time.
std::vector<Eigen::VectorXd> added_to_mean(const Campaign& campaign, const Hypothesis& hypothesis, const Fit& fit);
// White noise from second to second over the samples of the logs: it may follow the temperature.
double white_of_samples_dph(const Campaign& campaign, const NoiseModel& noise);

} // namespace imucal
