// SPDX-License-Identifier: MIT
// The hypotheses of the seconds that the slow stage leads to, and the noise of the seconds under them: whether the believed
// one holds there, and what it is beside a kind of slow noise.
#pragma once
#include "analysis/diagnose/stages/seconds_noise.h"
#include "analysis/diagnose/stages/slow_answer.h"

namespace imucal {

struct SecondsAnswer {
  Hypothesis nominal, final; // without and with the names
  Fit fit;                   // of the mean of `final`; noise that was found after it is in `final` alone
  SecondsNoise noise;       // under `final`, what kinds of slow noise make of it included, without a kind of fast noise
  NoiseModel own_base;      // under a kind of slow noise: what that acts on
  bool is_believed = false; // the noise as believed does under `final`
  double retuned_nats = 0;  // what other parameters than the believed ones gain
  // Samples of the residual of `fit` that stand out: the noise is that of what is left, until kinds of fast noise are asked.
  std::optional<StandingOut> hits;
  const std::vector<Eigen::VectorXd>& without_hits() const { return hits ? hits->left : fit.residual; }
};

// The seconds under what the slow stage found.  Where the believed noise does without a kind of slow noise that is not
// worth its name, that kind goes from `slow`.
SecondsAnswer ask_seconds(const AxisQuestion& question, SlowAnswer* slow);

// A hypothesis of the slow stage as one of the seconds; `with_names`: names, jumps, lines and kind of noise too.
Hypothesis hypothesis_of(const AxisQuestion& question, const SlowSearch& search, const SlowModel& m, bool with_names);
// Noise of the seconds under a hypothesis, its kind of slow noise included, with the base as believed.
NoiseModel believed_noise(const SlowSearch& search, SlowModel m);
// `seconds->own_base` anew, after `slow` or the noise was changed.
void fit_own_base(const AxisQuestion& question, const SlowAnswer& slow, SecondsAnswer* seconds);
// The same beside what kinds of fast noise make of a noise; empty: beside none.
void fit_own_base_beside(const std::function<NoiseModel(const NoiseModel&)>& fast, const AxisQuestion& question,
                         const SlowAnswer& slow, SecondsAnswer* seconds);
// Innovations of the residual of `fit` without hits under the noise of the seconds, run by run.
std::vector<Eigen::VectorXd> whitened(const Campaign& campaign, const SecondsAnswer& seconds);

} // namespace imucal
