// SPDX-License-Identifier: MIT
// The output is sometimes not refreshed: with a probability a second repeats the value before it or, where
// `reads_dph` is given, reads that fixed value (a drop-out: most often zero).
#include <algorithm>
#include <cmath>

#include "physics/effects/estimation.h"
#include "physics/effects/sample_shape.h"

namespace imucal {
namespace {

class HeldSamples : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "held_samples"; }
  std::string label() const override { return "readings that were not refreshed"; }
  std::string description() const override {
    return "The output is sometimes not refreshed: it repeats the value before it or reads a fixed one "
           "(drop-out).";
  }
  Family family() const override { return Family::kFastNoise; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"reader and sensor run on different clocks, or a read failed",
             "look at data-ready and the flags of the recorder"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {
        {"probability", 0, 1, "probability that a second is not refreshed"},
        {"reads_dph", -1e9, 1e9, "what it reads then (left out: the value before it)", EffectParameter::kNumber, true}};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* rng) const override {
    if (stage != SimStage::kOutput) return;
    const double probability = parameters.number("probability");
    const ParameterValue* fixed = parameters.find("reads_dph");
    for (size_t i = fixed ? 0 : 1; rng && i < run->rate_dph.size(); ++i)
      if (rng->uniform() < probability) run->rate_dph[i] = fixed ? fixed->number.value : run->rate_dph[i - 1];
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kStructural; }
  bool needs_temperature() const override { return false; }
  // Drop-outs first: consecutive ones are no repeats.
  std::vector<Signature> detect(const std::vector<RunInput>& runs) const override {
    std::optional<Signature> found = drop_outs(runs);
    if (!found) found = repeats(runs);
    return found ? std::vector<Signature>{*found} : std::vector<Signature>();
  }
  int detection_order() const override { return 3; }
  bool counts_drop_outs() const override { return true; }
  Parameters values(const Estimate& e) const override { return {{"probability", e.shape_at(0)}}; }

private:
  static constexpr size_t kFewestDropped = 8, kFewestRepeats = 6;
  static constexpr size_t kMoreOften = 5; // than any other value, than equal values two apart
  static constexpr double kFarShare = 0.8;
  static constexpr double kMoreThanChance = 1.5; // held samples of rates in steps
  static constexpr double kSameChange = 1e-9;    // of the usual change: the digits of a file, not of a sensor
  static constexpr size_t kChance = 2;           // changes of one size that no lattice made

  // A value that comes back again and again as no other does: zero wherever the level is, an extreme one
  // where it lies far from the samples around it (near them it would be a limit).
  static std::optional<Signature> drop_outs(const std::vector<RunInput>& runs) {
    const std::vector<double> rates = finite_rates(runs);
    if (rates.empty()) return std::nullopt;
    const auto [lowest, highest] = std::minmax_element(rates.begin(), rates.end());
    const double lo = *lowest, hi = *highest;
    if (!(hi > lo)) return std::nullopt;
    for (const double value : {0.0, lo, hi}) {
      const size_t n_at = count_at(runs, value);
      if (n_at < kFewestDropped || n_at < kMoreOften * most_common_other(runs, value)) continue;
      if (2 * n_at > rates.size()) continue; // what most samples read is the rate, in coarse steps
      const double n = static_cast<double>(n_at);
      if (value != 0 && static_cast<double>(count_far_at(runs, local_levels(runs), value)) < kFarShare * n) continue;
      Signature found;
      found.parameters = {{"probability", n / static_cast<double>(rates.size())}, {"reads_dph", value}};
      found.evidence_nats = 5.0 * n;
      found.statement =
          std::to_string(n_at) + " samples read exactly the same value among others that differ: drop-outs";
      found.unusable = samples_at(runs, value);
      return found;
    }
    return std::nullopt;
  }

  // Samples that are equal to the one before where each takes the values of all in a random order: of rates in coarse steps
  // most are.
  static double equal_by_chance(const std::vector<RunInput>& runs) {
    const std::vector<double> rates = finite_rates(runs);
    double squares = 0;
    for (const auto& [value, n] : values_with_counts(rates)) squares += std::pow(static_cast<double>(n), 2);
    return squares / static_cast<double>(rates.size());
  }

  // Changes of zero, were they no more frequent than the change of another size that is found most often, up or down.  Rates in
  // fine steps that a compensation has shifted are on a lattice only while the temperature rests: few of their values are
  // equal, but many of their changes are.
  static double unchanged_by_chance(const std::vector<RunInput>& runs) {
    std::vector<double> sizes;
    for (const RunInput& run : runs)
      for (size_t i = 1; i < run.size(); ++i)
        if (const double change = std::fabs(run.rate_dph[i] - run.rate_dph[i - 1]); change > 0) sizes.push_back(change);
    if (sizes.empty()) return 0;
    std::sort(sizes.begin(), sizes.end());
    const double same = kSameChange * sizes[sizes.size() / 2];
    size_t most = 1, n = 1;
    for (size_t i = 1; i < sizes.size(); ++i) {
      n = sizes[i] - sizes[i - 1] < same ? n + 1 : 1;
      most = std::max(most, n);
    }
    return most > kChance ? 0.5 * static_cast<double>(most) : 0;
  }

  // Exact repeats of the value before, more than a lattice of values would give.
  static std::optional<Signature> repeats(const std::vector<RunInput>& runs) {
    size_t n = 0, pairs = 0, equal_two_apart = 0;
    for (const RunInput& run : runs)
      for (size_t i = 2; i < run.size(); ++i) {
        const double now = run.rate_dph[i], before = run.rate_dph[i - 1];
        if (!std::isfinite(now) || !std::isfinite(before)) continue;
        ++pairs;
        n += now == before;
        equal_two_apart += now == run.rate_dph[i - 2] && now != before;
      }
    if (n < kFewestRepeats || n < kMoreOften * equal_two_apart) return std::nullopt;
    if (equal_two_apart > 0 && static_cast<double>(n) < kMoreThanChance * equal_by_chance(runs)) return std::nullopt;
    const double unchanged = unchanged_by_chance(runs);
    if (static_cast<double>(n) < kMoreThanChance * unchanged + 3 * std::sqrt(unchanged)) return std::nullopt;
    Signature found;
    found.parameters = {{"probability", static_cast<double>(n) / static_cast<double>(pairs)}};
    found.evidence_nats = 5.0 * static_cast<double>(n);
    found.statement = "samples repeat the one before exactly";
    for (const RunInput& run : runs) {
      std::vector<char> bad(run.size(), 0);
      for (size_t i = 1; i < bad.size(); ++i) bad[i] = run.rate_dph[i] == run.rate_dph[i - 1];
      found.unusable.push_back(bad);
    }
    return found;
  }
};

} // namespace

IMUCAL_EFFECT(HeldSamples)

} // namespace imucal
