// SPDX-License-Identifier: MIT
#include "analysis/diagnose/logs/structure.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "analysis/diagnose/logs/blocks.h"

namespace imucal {
namespace {

constexpr double kFarZero = 8; // noise standard deviations of the values around a zero that is no rate
constexpr double kMostCrossed =
    0.1; // of the zeros far from the rates: a rate crosses zero seldom, noise in every second sample
constexpr size_t kFewZeros = 3;  // of a run that make it one with drop-outs
constexpr double kNearSteps = 5; // rates so near to zero tell how many zeros are rates
constexpr double kTimesExpected = 3;
constexpr double kGuard_s = 10; // next to censored samples: those that just escaped are biased too
constexpr long kFarTicks = 1L << 40;
constexpr double kMostLost = 0.5; // part of the samples that the guard may cost; else only the samples themselves go

using Rows = std::vector<std::vector<char>>; // per run and row of the log

// Smallest difference between neighbours that differ: the step to which the rates of a log were rounded.
double smallest_change(const CampaignRun& run) {
  double smallest = 1e300;
  for (const double change : changes_between_samples(run))
    if (change > 0) smallest = std::min(smallest, change);
  return smallest;
}

// All zeros of a run of which a few are drop-outs, where rates as near to zero as a few of their steps are too rare for as many
// zeros: those between small rates are drop-outs as well.
void add_near_zeros(const RunInput& in, double step_dph, std::vector<char>* bad) {
  const size_t n_far = static_cast<size_t>(std::count(bad->begin(), bad->end(), 1));
  if (n_far < kFewZeros) return;
  size_t n_zeros = 0, n_near = 0;
  for (size_t i = 0; i < in.size(); ++i) {
    const double size_dph = std::fabs(in.rate_dph[i]);
    n_zeros += size_dph == 0 && !(*bad)[i], n_near += size_dph > 0 && size_dph < (kNearSteps + 0.5) * step_dph;
  }
  const double expected = static_cast<double>(n_near) / (2 * kNearSteps);
  if (static_cast<double>(n_zeros) < kFewZeros + kTimesExpected * expected) return;
  for (size_t i = 0; i < in.size(); ++i)
    if (in.rate_dph[i] == 0) (*bad)[i] = 1;
}
// Of a run: zeros between rates that are far from zero on one side of it, and how many stand between such rates on both sides.
struct FarZeros {
  std::vector<char> is_far;
  size_t n_far = 0, n_crossed = 0;
};
FarZeros far_zeros(const CampaignRun& run, double noise_dph) {
  FarZeros out;
  out.is_far.assign(run.input.size(), 0);
  const auto rate_of = [&](size_t k) { return run.input.rate_dph[static_cast<size_t>(run.used[k])]; };
  std::vector<double> next(run.n() + 1, std::nan("")); // the next rate that is not zero
  for (size_t k = run.n(); k-- > 0;) next[k] = rate_of(k) != 0 ? rate_of(k) : next[k + 1];
  double last = std::nan("");
  for (size_t k = 0; k < run.n(); ++k) {
    if (rate_of(k) != 0) {
      last = rate_of(k);
      continue;
    }
    const double before = std::isfinite(last) ? last : next[k], after = std::isfinite(next[k]) ? next[k] : last;
    if (!(std::min(std::fabs(before), std::fabs(after)) > kFarZero * noise_dph)) continue;
    if (before * after > 0)
      out.is_far[static_cast<size_t>(run.used[k])] = 1, ++out.n_far;
    else
      ++out.n_crossed;
  }
  return out;
}
// Zeros between values that are far from zero: the recorder's, not the gyro's.  Of coarse rates most are equal to the one
// before, and zero may be the next step.  Rates that are far on both sides of zero are noise that was taken for too small (most
// of the samples are equal): then zeros are where they pass.
Rows drop_outs(const Campaign& campaign) {
  const double of_all_dph = white_between_samples(campaign) / std::sqrt(campaign.dt_s);
  Rows zeros;
  for (const CampaignRun& run : campaign.runs) {
    const double step_dph = smallest_change(run);
    FarZeros found = far_zeros(run, std::max(of_all_dph, step_dph));
    if (static_cast<double>(found.n_crossed) > kMostCrossed * static_cast<double>(found.n_far))
      found.is_far.assign(run.input.size(), 0);
    add_near_zeros(run.input, step_dph, &found.is_far);
    zeros.push_back(std::move(found.is_far));
  }
  return zeros;
}
// Rows of `some` that are not in `others` (empty: none are).
size_t count_beside(const Rows& some, const Rows& others) {
  size_t n = 0;
  for (size_t r = 0; r < some.size(); ++r)
    for (size_t i = 0; i < some[r].size(); ++i) n += some[r][i] && (others.empty() || !others[r][i]);
  return n;
}

// Seconds within the guard of a censored one.
Rows with_guard(const Campaign& campaign, const Rows& bad) {
  const long guard = std::lround(kGuard_s / campaign.dt_s);
  size_t lost = 0;
  Rows wide = bad;
  for (size_t r = 0; r < bad.size(); ++r) {
    const std::vector<long>& tick = campaign.runs[r].input.tick;
    long last = -kFarTicks; // tick of the bad sample before, and then of the one after
    for (size_t i = 0; i < bad[r].size(); ++i) {
      if (bad[r][i]) last = tick[i];
      if (tick[i] - last <= guard) wide[r][i] = 1;
    }
    last = kFarTicks;
    for (size_t i = bad[r].size(); i-- > 0;) {
      if (bad[r][i]) last = tick[i];
      if (last - tick[i] <= guard) wide[r][i] = 1;
    }
    for (char w : wide[r]) lost += w != 0;
  }
  return static_cast<double>(lost) < kMostLost * static_cast<double>(campaign.n()) ? wide : bad;
}

bool is_in(const Signature& found, size_t r) {
  const bool spoils = !found.unusable.empty() && std::count(found.unusable[r].begin(), found.unusable[r].end(), 1) > 0;
  return spoils || (!found.white_dph2.empty() && found.white_dph2[r] > 0);
}
// Where a finding is, if it is not in all logs.
std::string logs_of(const Campaign& campaign, size_t n_fitted, const Signature& found) {
  std::string out;
  size_t n = 0;
  for (size_t r = 0; r < campaign.runs.size(); ++r) {
    if (!is_in(found, r)) continue;
    ++n, out += std::string(out.empty() ? "" : ", ") + (r < n_fitted ? "log " : "held-out log ") +
                std::to_string(campaign.runs[r].input.log + 1);
  }
  return n == campaign.runs.size() ? "" : out;
}

// What a finding leaves of the samples, and of what it makes noise.
void take(const Signature& found, bool is_censoring, Campaign* campaign) {
  for (size_t r = 0; r < found.white_dph2.size(); ++r) campaign->runs[r].own_white_dph2 += found.white_dph2[r];
  if (!found.unusable.empty()) mask(campaign, is_censoring ? with_guard(*campaign, found.unusable) : found.unusable);
}

StructureResult find_in_all(Campaign* campaign, size_t n_fitted, const std::vector<const Effect*>& library,
                            const std::vector<bool>& active) {
  StructureResult out;
  const size_t before = campaign->n();
  const Rows zeros = drop_outs(*campaign); // no detector takes them for a limit or a dead band
  mask(campaign, zeros);
  out.n_dropouts = count_beside(zeros, {});
  std::vector<const Effect*> detectors;
  for (size_t j = 0; j < library.size(); ++j)
    if (active[j] && library[j]->estimator() && library[j]->estimator()->form() == Form::kStructural)
      detectors.push_back(library[j]);
  std::stable_sort(detectors.begin(), detectors.end(), [](const Effect* a, const Effect* b) {
    return a->estimator()->detection_order() < b->estimator()->detection_order();
  });
  for (const Effect* effect : detectors) {
    std::vector<RunInput> inputs;
    for (const CampaignRun& run : campaign->runs) inputs.push_back(run.input);
    if (effect->estimator()->counts_drop_outs())
      for (size_t r = 0; r < zeros.size(); ++r)
        for (size_t i = 0; i < zeros[r].size(); ++i)
          if (zeros[r][i]) inputs[r].rate_dph[i] = 0;
    for (const Signature& found : effect->estimator()->detect(inputs)) {
      out.findings.push_back({effect, found, logs_of(*campaign, n_fitted, found)});
      if (effect->estimator()->counts_drop_outs()) out.n_dropouts = count_beside(zeros, found.unusable);
      out.is_censored = out.is_censored || effect->estimator()->is_censoring();
      take(found, effect->estimator()->is_censoring(), campaign);
    }
  }
  out.n_left_out = before - campaign->n();
  return out;
}
void move_runs(std::vector<CampaignRun>* from, size_t first, std::vector<CampaignRun>* to) {
  std::move(from->begin() + static_cast<long>(first), from->end(), std::back_inserter(*to));
  from->resize(first);
}

} // namespace

StructureResult find_structure(Campaign* fitted, Campaign* held_out, const std::vector<const Effect*>& library,
                               const std::vector<bool>& active) {
  const size_t n_fitted = fitted->runs.size();
  if (held_out) move_runs(&held_out->runs, 0, &fitted->runs);
  StructureResult out = find_in_all(fitted, n_fitted, library, active);
  if (held_out) move_runs(&fitted->runs, n_fitted, &held_out->runs);
  return out;
}

} // namespace imucal
