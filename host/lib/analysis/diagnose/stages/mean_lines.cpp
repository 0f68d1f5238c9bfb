// SPDX-License-Identifier: MIT
#include "analysis/diagnose/stages/mean_lines.h"

#include <algorithm>
#include <cmath>
#include <complex>

#include "analysis/diagnose/evidence/lines.h"
#include "analysis/diagnose/logs/blocks.h"
#include "base/units.h"

namespace imucal {

using Eigen::VectorXd;

namespace {

constexpr size_t kFewToDrift = 200000; // samples: lines that drift are not looked for in longer logs
constexpr int kBeside = 10; // resolvable frequencies on either side with which a line is compared, but the nearest
constexpr double kLineOfTemperature = 8; // times their mean power: 1 in 1000 and less of a noise, in one run
constexpr int kPiecesOfRun = 5;          // of a run, four cycles of its line and more
constexpr double kCoherent = 0.5;        // of lines that follow; a tone has it by chance in exp(-n/4) of n pieces

double length_s(const CampaignRun& run) {
  return run.input.t_s.back() - run.input.t_s.front();
}
double swept_hz(const Campaign& campaign, const Theta& shape) {
  return shape.size() > 1 ? std::fabs(shape[1]) * (campaign.hi_degc - campaign.lo_degc) : 0;
}
// A line in the changes of the temperature or the rate over some seconds, which a window tapers (Hann): size and phase.
std::complex<double> line_in_changes(const std::vector<double>& t_s, const Column& values,
                                     const std::vector<Column>& columns, double from_s, double to_s) {
  const double turn = 2 * kPi / (to_s - from_s);
  std::complex<double> sum = 0;
  for (size_t i = 1; i < t_s.size(); ++i) {
    if (t_s[i] < from_s || t_s[i] > to_s) continue;
    const double tapered = 1 - std::cos(turn * (t_s[i] - from_s));
    const double change = tapered * (values[i] - values[i - 1]);
    if (std::isfinite(change)) sum += change * std::complex<double>(columns[0][i], columns[1][i]);
  }
  return sum;
}
std::complex<double> line_of_run(const RunInput& in, const EffectEstimator& tone, const Theta& shape) {
  return line_in_changes(in.t_s, in.temp_degc, tone.columns(in, shape), in.t_s.front(), in.t_s.back());
}
bool is_resolved(const Campaign& campaign, const CampaignRun& run, const Theta& shape) {
  return shape[0] >= 2 * kBeside / length_s(run) + swept_hz(campaign, shape);
}
// Power at a line in units of the mean power beside it, over all runs that are long enough to tell; 0: none is.
double line_of_temperature(const Campaign& campaign, const EffectEstimator& tone, const Theta& shape) {
  double own = 0, beside = 0;
  for (const CampaignRun& run : campaign.runs) {
    if (!is_resolved(campaign, run, shape)) continue;
    own += std::norm(line_of_run(run.input, tone, shape));
    for (int k = 3; k < 3 + kBeside; ++k)
      for (const int side : {-1, 1}) {
        Theta near = shape;
        near[0] += side * (k / length_s(run) + swept_hz(campaign, shape));
        beside += std::norm(line_of_run(run.input, tone, near));
      }
  }
  return beside > 0 ? own * 2 * kBeside / beside : 0;
}
// NaN where there is a hit.
Column rates_less(const CampaignRun& run, const VectorXd& hits) {
  Column out = run.input.rate_dph;
  for (size_t k = 0; k < run.n(); ++k)
    if (hits[static_cast<long>(k)] != 0) out[static_cast<size_t>(run.used[k])] = std::nan("");
  return out;
}
// How well the line of the rates keeps to that of the temperatures, or of their squares (half the frequency), from piece to piece
// of all runs: 1 where its phase to that line is always the same, 1/sqrt(n) on average where n pieces have phases of their own.  A
// sign does not count: what follows the square of the rate of temperature turns with the direction of the ramps.
double coherence(const Campaign& campaign, const EffectEstimator& tone, const Theta& shape,
                 const Theta& of_temperature) {
  const std::vector<VectorXd> hits = hits_of(campaign);
  std::complex<double> sum = 0;
  double all = 0;
  for (size_t r = 0; r < hits.size(); ++r) {
    const CampaignRun& run = campaign.runs[r];
    if (!is_resolved(campaign, run, of_temperature)) continue;
    const RunInput& in = run.input;
    const Column rates = rates_less(run, hits[r]);
    const std::vector<Column> own = tone.columns(in, shape), other = tone.columns(in, of_temperature);
    const double piece_s = length_s(run) / kPiecesOfRun;
    for (int k = 0; k < kPiecesOfRun; ++k) {
      const double from_s = in.t_s.front() + k * piece_s, to_s = from_s + piece_s;
      const std::complex<double> rate = line_in_changes(in.t_s, rates, own, from_s, to_s),
                                 once = line_in_changes(in.t_s, in.temp_degc, other, from_s, to_s),
                                 product = rate * std::conj(of_temperature == shape ? once : once * once);
      sum += product * product, all += std::norm(product);
    }
  }
  return all > 0 ? std::abs(sum) / all : 0;
}

} // namespace

bool is_of_temperature(const Campaign& campaign, const NamedLine& line) {
  if (!campaign.has_temperature) return false;
  Theta half = line.shape;
  for (double& hz : half) hz *= 0.5;
  const EffectEstimator& tone = *line.effect->estimator();
  const auto follows = [&](const Theta& of_temperature) {
    return line_of_temperature(campaign, tone, of_temperature) > kLineOfTemperature &&
           coherence(campaign, tone, line.shape, of_temperature) > kCoherent;
  };
  return follows(line.shape) || follows(half);
}

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
  const Line steady = strongest_line(question.campaign, e);
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
  found.set = {evidence_for(*line.effect, found.gain_nats, line.threshold_nats)};
  return found;
}

// A line was placed while the noise still held a part of it; the noise of the answer does not.
Theta line_errors(const Campaign& campaign, const Design& design, const Fit& fit, const NoiseModel& noise,
                  const Term& line, size_t i_term) {
  const std::optional<StandingOut> hits = standing_out(campaign, fit.residual);
  std::vector<VectorXd> e = hits ? hits->left : fit.residual;
  for (size_t r = 0; r < e.size(); ++r)
    for (const long c : columns_of(design, i_term)) e[r] += fit.beta[c] * design.x[r].col(c);
  e = whitened(campaign.runs, gaussian_equivalent(noise), e);
  return errors_of_place(campaign, e, *line.estimator, line.shape);
}

} // namespace imucal
