// SPDX-License-Identifier: MIT
#include "analysis/diagnose/stages/mean_lines.h"

#include <algorithm>

#include "analysis/diagnose/evidence/lines.h"

namespace imucal {

using Eigen::VectorXd;

namespace {

constexpr size_t kFewToDrift = 200000; // samples: lines that drift are not looked for in longer logs

} // namespace

// A line that drifts stands still while the temperature rests, and one that stands still drifts a little by chance: the
// one of more power, each above its threshold, is it.
std::optional<NamedLine> line_found(const AxisQuestion& question, const std::vector<VectorXd>& e) {
  const auto tone = std::find_if(question.library.begin(), question.library.end(), [](const Effect* effect) {
    return effect->estimator() && effect->estimator()->form() == Form::kTone;
  });
  if (tone == question.library.end() || !question.active[static_cast<size_t>(tone - question.library.begin())])
    return std::nullopt;
  std::optional<NamedLine> best;
  double highest = 0;
  const Line steady = strongest_line(question.campaign, e, false);
  for (const bool drifts : {false, true}) {
    if (drifts && question.campaign.n() >= kFewToDrift) break;
    const Line line = drifts ? stronger_drifting(question.campaign, e, steady) : steady;
    if (drifts && line.hz_per_degc == 0) break;
    const double threshold_nats = drifts ? question.constants.drift_nats : question.constants.line_nats;
    if (line.gain_nats <= threshold_nats) continue;
    const PlacedLine placed = place_of(question.campaign, e, *(*tone)->estimator(), line);
    if (placed.power_nats - threshold_nats <= highest) continue;
    highest = placed.power_nats - threshold_nats;
    best = NamedLine{*tone, placed.shape, line.gain_nats, threshold_nats};
  }
  return best;
}

SelectedEffect effect_of_line(const NamedLine& line) {
  SelectedEffect found;
  found.family = line.effect->family();
  found.term = term_of(line.effect, line.effect->estimator(), line.shape);
  found.gain_nats = line.gain_nats;
  found.evidence_nats = line.gain_nats - line.threshold_nats;
  found.held_out_nats = kPredictsNothing;
  found.set = {{line.effect, nullptr, false, found.family, found.gain_nats, line.threshold_nats}};
  return found;
}

// A line was placed while the noise still held a part of it; the noise of the answer does not.
Theta line_errors(const Campaign& campaign, const Design& design, const Fit& fit, const NoiseModel& noise,
                  const Term& line, size_t i_term) {
  std::vector<VectorXd> e = fit.residual;
  for (size_t r = 0; r < e.size(); ++r) {
    for (size_t c = 0; c < design.cols(); ++c)
      if (design.term_of_column[c] == static_cast<int>(i_term))
        e[r] += fit.beta[static_cast<long>(c)] * design.x[r].col(static_cast<long>(c));
    whiten(compute_gains(campaign.runs[r], gaussian_equivalent(noise)), e[r].data(), static_cast<size_t>(e[r].size()));
  }
  return errors_of_place(campaign, e, *line.estimator, line.shape);
}

} // namespace imucal
