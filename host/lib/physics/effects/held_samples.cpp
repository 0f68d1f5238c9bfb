// SPDX-License-Identifier: MIT
// The output is sometimes not refreshed: with a probability a second repeats the value before it or, where
// `reads_dph` is given, reads that fixed value (a drop-out: most often zero).
#include <algorithm>
#include <cmath>

#include "physics/effects/estimation.h"
#include "physics/effects/lattice.h"
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
    if (!found) found = repeats(without_equal_steps(runs));
    return found ? std::vector<Signature>{*found} : std::vector<Signature>();
  }
  int detection_order() const override { return 3; }
  bool counts_drop_outs() const override { return true; }
  Parameters values(const Estimate& e) const override { return {{"probability", e.shape_at(0)}}; }

private:
  static constexpr size_t kFewestDropped = 8, kFewestRepeats = 6;
  static constexpr size_t kMoreOften = 5; // than any other value, than equal values two apart
  static constexpr double kFarShare = 0.8;
  static constexpr double kShared = 0.1; // of the other rates of a log at one value: they are in steps
  static constexpr double kOneStep = 1.5;
  static constexpr double kMoreThanChance = 1.5; // held samples of rates in steps
  static constexpr double kSameChange = 1e-9;    // of the usual change: the digits of a file, not of a sensor
  static constexpr double kRounding = 1e-15;     // of the largest rate: of the difference of two
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
      const std::vector<RunInput> asked = without_steps_at(runs, value);
      const size_t n_at = count_at(asked, value);
      if (n_at < kFewestDropped || n_at < kMoreOften * most_common_other(asked, value)) continue;
      if (2 * n_at > rates.size()) continue; // what most samples read is the rate, in coarse steps
      const double n = static_cast<double>(n_at);
      if (value != 0 && static_cast<double>(count_far_at(asked, local_levels(asked), value)) < kFarShare * n) continue;
      Signature found;
      found.parameters = {{"probability", n / static_cast<double>(rates.size())}, {"reads_dph", value}};
      found.evidence_nats = 5.0 * n;
      found.statement =
          std::to_string(n_at) + " samples read exactly the same value among others that differ: drop-outs";
      found.unusable = samples_at(asked, value);
      return found;
    }
    return std::nullopt;
  }

  // Logs of which the value is one step among others, or the rate itself, are left without rates: they are rounded to coarser
  // steps than the others.
  static std::vector<RunInput> without_steps_at(std::vector<RunInput> runs, double value) {
    for (RunInput& run : runs) {
      const size_t n_at = count_at(run, value), n = finite_rates(run).size(), most = most_common_other({run}, value);
      const bool is_step = most >= kFewestDropped && n_at < kMoreOften * most;
      const bool is_rate = 2 * n_at > n && static_cast<double>(most) >= kShared * static_cast<double>(n - n_at);
      if (is_step || is_rate) run.rate_dph.assign(run.size(), std::nan(""));
    }
    return runs;
  }
  // Equal neighbours of some logs.
  struct Equal {
    size_t n = 0, pairs = 0, two_apart = 0; // two apart: not equal to the one between
    void add(const RunInput& run) {
      for (size_t i = 2; i < run.size(); ++i) {
        const double now = run.rate_dph[i], before = run.rate_dph[i - 1];
        if (!std::isfinite(now) || !std::isfinite(before)) continue;
        ++pairs;
        n += now == before;
        two_apart += now == run.rate_dph[i - 2] && now != before;
      }
    }
  };
  // Steps so much coarser than the noise that most samples are equal to the one before, and others differ by a step: nothing
  // tells what was not refreshed.
  static bool is_quiet(const RunInput& run, double step_dph) {
    size_t n_equal = 0, n_one_step = 0, n = 0;
    for (size_t i = 1; i < run.size(); ++i) {
      const double change = std::fabs(run.rate_dph[i] - run.rate_dph[i - 1]);
      if (!std::isfinite(change)) continue;
      ++n, n_equal += change == 0, n_one_step += change > 0 && change < kOneStep * step_dph;
    }
    return 2 * n_equal > n && 2 * n_one_step >= n - n_equal;
  }
  // Logs in which equal samples are no sign are left without rates as well: the others are judged without them.
  static std::vector<RunInput> without_equal_steps(std::vector<RunInput> runs) {
    std::vector<char> is_left(runs.size(), 0);
    for (const Lattice& lattice : lattices(runs))
      for (const size_t r : lattice.runs) is_left[r] = is_quiet(runs[r], lattice.step_dph);
    for (size_t r = 0; r < runs.size(); ++r) {
      Equal equal;
      equal.add(runs[r]);
      const bool is_in_steps = equal.two_apart >= kFewestRepeats && equal.n < kMoreOften * equal.two_apart;
      if (is_left[r] || is_in_steps) runs[r].rate_dph.assign(runs[r].size(), std::nan(""));
    }
    return runs;
  }

  // Samples that are equal to the one before where each takes the values of its log in a random order: of rates in coarse steps
  // most are.
  static double equal_by_chance(const std::vector<RunInput>& runs) {
    double sum = 0;
    for (const RunInput& run : runs) {
      const std::vector<double> rates = finite_rates(run);
      double squares = 0;
      for (const auto& [value, n] : values_with_counts(rates)) squares += std::pow(static_cast<double>(n), 2);
      sum += rates.empty() ? 0 : squares / static_cast<double>(rates.size());
    }
    return sum;
  }

  // Changes of zero, were they no more frequent than the change of another size that is found most often, up or down.  Rates in
  // fine steps that a compensation has shifted are on a lattice only while the temperature rests: few of their values are
  // equal, but many of their changes are.
  static double unchanged_by_chance(const std::vector<RunInput>& runs) {
    std::vector<double> sizes;
    double largest = 0;
    for (const RunInput& run : runs)
      for (size_t i = 1; i < run.size(); ++i)
        if (const double change = std::fabs(run.rate_dph[i] - run.rate_dph[i - 1]); change > 0)
          sizes.push_back(change), largest = std::max(largest, std::fabs(run.rate_dph[i]));
    if (sizes.empty()) return 0;
    std::sort(sizes.begin(), sizes.end());
    const double same = kSameChange * sizes[sizes.size() / 2] + kRounding * largest;
    size_t most = 1, n = 1;
    for (size_t i = 1; i < sizes.size(); ++i) {
      n = sizes[i] - sizes[i - 1] < same ? n + 1 : 1;
      most = std::max(most, n);
    }
    return most > kChance ? 0.5 * static_cast<double>(most) : 0;
  }

  // Exact repeats of the value before, more than a lattice of values would give.
  static std::optional<Signature> repeats(const std::vector<RunInput>& runs) {
    Equal equal;
    for (const RunInput& run : runs) equal.add(run);
    const double n = static_cast<double>(equal.n);
    if (equal.n < kFewestRepeats || equal.n < kMoreOften * equal.two_apart) return std::nullopt;
    if (equal.two_apart > 0 && n < kMoreThanChance * equal_by_chance(runs)) return std::nullopt;
    const double unchanged = unchanged_by_chance(runs);
    if (n < kMoreThanChance * unchanged + 3 * std::sqrt(unchanged)) return std::nullopt;
    Signature found;
    found.parameters = {{"probability", n / static_cast<double>(equal.pairs)}};
    found.evidence_nats = 5.0 * n;
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
