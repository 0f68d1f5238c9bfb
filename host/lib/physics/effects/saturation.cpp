// SPDX-License-Identifier: MIT
// The rate is clipped at plus and minus a limit.
#include <algorithm>
#include <cmath>

#include "physics/effects/estimation.h"
#include "physics/effects/sample_shape.h"

namespace imucal {
namespace {

class Saturation : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "saturation"; }
  std::string label() const override { return "readings clipped at a limit"; }
  std::string description() const override { return "The rate is clipped at a limit of the output."; }
  Family family() const override { return Family::kStructural; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"range of sensor or converter too small for rate and bias together", "IEEE Std 1431-2004, input limits"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"limit_dph", 1e-9, 1e9, "largest rate the output shows, both signs"}};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kOutput) return;
    const double limit = parameters.number("limit_dph");
    for (double& rate : run->rate_dph) rate = std::clamp(rate, -limit, limit);
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kStructural; }
  bool needs_temperature() const override { return false; }
  // One limit for all logs; else each log may have been recorded with one of its own.
  std::vector<Signature> detect(const std::vector<RunInput>& runs) const override {
    if (const std::optional<Signature> found = detect_one_limit(runs)) return {*found};
    std::vector<Signature> out;
    for (size_t r = 0; r < runs.size() && runs.size() > 1; ++r) {
      const std::optional<Signature> of_log = detect_one_limit({runs[r]});
      if (!of_log) continue;
      const double limit_dph = of_log->parameters.number("limit_dph");
      const auto has_limit = [&](const Signature& s) { return s.parameters.number("limit_dph") == limit_dph; };
      auto found = std::find_if(out.begin(), out.end(), has_limit);
      if (found == out.end()) {
        out.push_back(*of_log);
        found = out.end() - 1;
        found->evidence_nats = 0, found->unusable = no_samples(runs);
      }
      found->evidence_nats += of_log->evidence_nats;
      found->unusable[r] = of_log->unusable.front();
    }
    return out;
  }
  bool is_censoring() const override { return true; }
  int detection_order() const override { return 0; }
  Parameters values(const Estimate& e) const override { return {{"limit_dph", e.shape_at(0)}}; }

private:
  static constexpr size_t kFewest = 8;
  static constexpr double kBeyond = 4; // how many times more than the noise explains may be piled up

  // Many samples exactly at the extreme value, where noise around the local level reaches beyond it.  A pile
  // far from the level is wrong readings, not a limit; so is one at zero.
  static std::optional<Signature> detect_one_limit(const std::vector<RunInput>& runs) {
    double lo = 1e300, hi = -1e300;
    for (const RunInput& run : runs)
      for (const double y : run.rate_dph)
        if (std::isfinite(y)) lo = std::min(lo, y), hi = std::max(hi, y);
    if (!(hi > lo)) return std::nullopt;
    const size_t n_lo = limited(runs, lo, 1), n_hi = limited(runs, hi, -1);
    if (n_lo + n_hi == 0) return std::nullopt;
    Signature found;
    found.parameters = {{"limit_dph", std::fabs(n_hi > 0 ? hi : lo)}};
    found.evidence_nats = 5.0 * static_cast<double>(n_lo + n_hi);
    found.statement = "samples pile up at the extreme value";
    found.unusable = no_samples(runs);
    if (n_lo > 0) add(samples_at(runs, lo), &found.unusable);
    if (n_hi > 0) add(samples_at(runs, hi), &found.unusable);
    return found;
  }
  static std::vector<std::vector<char>> no_samples(const std::vector<RunInput>& runs) {
    std::vector<std::vector<char>> out;
    for (const RunInput& run : runs) out.emplace_back(run.size(), 0);
    return out;
  }

  static void add(const std::vector<std::vector<char>>& more, std::vector<std::vector<char>>* all) {
    for (size_t r = 0; r < more.size(); ++r)
      for (size_t i = 0; i < more[r].size(); ++i) (*all)[r][i] = (*all)[r][i] || more[r][i];
  }

  // Samples at the value of a log beside the extreme one; `inward`: +1 from the lowest, -1 from the highest.
  static size_t n_beside(const RunInput& run, double extreme, double inward) {
    double next = 1e300;
    for (const double y : run.rate_dph)
      if (std::isfinite(y) && !is_same_rate(y, extreme)) next = std::min(next, inward * y);
    return count_at(run, inward * next);
  }

  // How many samples lie at this extreme because a limit holds them there; else 0.  Logs that do not reach it say nothing of it
  // but what the noise is: they may be rounded to other steps.
  static size_t limited(const std::vector<RunInput>& runs, double extreme, double inward) {
    const size_t n = count_at(runs, extreme);
    if (n < kFewest || extreme == 0) return 0;
    LocalLevels levels = local_levels(runs);
    size_t beside = 0;
    for (size_t r = 0; r < runs.size(); ++r)
      if (count_at(runs[r], extreme) > 0)
        beside += n_beside(runs[r], extreme, inward);
      else
        levels.level_dph[r].clear();
    // On a lattice the extreme repeats too, but less often than the value beside it.
    if (n <= 2 * beside) return 0;
    const double beyond =
        inward > 0 ? expected_between(levels, -1e300, extreme) : expected_between(levels, extreme, 1e300);
    return kBeyond * beyond >= static_cast<double>(n) ? n : 0;
  }
};

} // namespace

IMUCAL_EFFECT(Saturation)

} // namespace imucal
