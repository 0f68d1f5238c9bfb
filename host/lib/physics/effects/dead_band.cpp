// SPDX-License-Identifier: MIT
// Small rates read as zero: |rate| < width becomes 0.  Source: dead band of IEEE Std 1431-2004.
#include <algorithm>
#include <cmath>
#include <map>

#include "base/median.h"
#include "physics/effects/estimation.h"
#include "physics/effects/sample_shape.h"

namespace imucal {
namespace {

class DeadBand : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "dead_band"; }
  std::string label() const override { return "a dead band: small rates read as zero"; }
  std::string description() const override { return "Small rates read as zero."; }
  Family family() const override { return Family::kStructural; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"a threshold in firmware (\"zero-rate\" filter) or stiction of a loop",
             "IEEE Std 1431-2004, threshold and dead band"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"width_dph", 0, 1e7, "rates between minus and plus this read as zero"}};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kOutput) return;
    const double width = parameters.number("width_dph");
    for (double& rate : run->rate_dph)
      if (std::fabs(rate) < width) rate = 0.0;
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kStructural; }
  bool needs_temperature() const override { return false; }
  // A dead band has a shape of its own: no value between zero and an edge, and at zero about as many samples
  // as noise around the local level would put inside.  Zeros far from the level are drop-outs; where all
  // small values of a log are multiples of the edge, zero is one step of its lattice and tells nothing of a band.
  std::vector<Signature> detect(const std::vector<RunInput>& runs) const override {
    const std::vector<RunInput> asked = without_lattices(runs);
    const Zeros zeros = count_zeros(asked);
    if (zeros.n < kFewest || !(zeros.edge_dph > 0)) return {};
    const double expected = expected_between(local_levels(asked), -zeros.edge_dph, zeros.edge_dph);
    const double n = static_cast<double>(zeros.n);
    if (expected < n / kAlike || n < expected / kAlike) return {};
    Signature found;
    found.parameters = {{"width_dph", zeros.edge_dph}};
    found.evidence_nats = 5.0 * n;
    found.statement = "rates pile up at zero, and none lies between zero and the edge of a band";
    found.unusable = samples_at(asked, 0.0);
    return {found};
  }
  bool is_censoring() const override { return true; }
  int detection_order() const override { return 1; }
  Parameters values(const Estimate& e) const override { return {{"width_dph", e.shape_at(0)}}; }

private:
  static constexpr size_t kFewest = 8;
  static constexpr double kAlike = 3; // how far the pile may be from what noise would put inside
  static constexpr double kSteps = 6, kNearStep = 0.15, kSamePlace = 1e-3; // of the smallest rate
  struct Zeros {
    size_t n = 0;        // samples at zero
    double edge_dph = 0; // smallest other rate
  };

  static Zeros count_zeros(const std::vector<RunInput>& runs) {
    Zeros out;
    double edge = 1e300;
    for (const RunInput& run : runs)
      for (const double y : run.rate_dph) {
        out.n += y == 0;
        if (std::isfinite(y) && y != 0) edge = std::min(edge, std::fabs(y));
      }
    out.edge_dph = edge < 1e300 ? edge : 0;
    return out;
  }
  // Whether most rates within six times the smallest one share places near its whole multiples: a lattice, printed with few decimals
  // perhaps (steps of 27.48 dph stand as 27, 55, 82).  Rates beyond the edge of a band have no place in common.
  static bool is_zero_a_step(const RunInput& run) {
    const double edge = count_zeros({run}).edge_dph;
    std::map<long, std::vector<double>> by_step;
    size_t n_near = 0, n_shared = 0;
    for (const double y : run.rate_dph)
      if (std::fabs(y) <= (kSteps + 0.5) * edge && y != 0)
        by_step[std::lround(std::fabs(y) / edge)].push_back(std::fabs(y)), ++n_near;
    for (const auto& [step, rates] : by_step) {
      const double place = median(rates);
      if (std::fabs(place / edge - static_cast<double>(step)) > kNearStep) continue;
      const auto n =
          std::count_if(rates.begin(), rates.end(), [&](double y) { return std::fabs(y - place) < kSamePlace * edge; });
      if (n > 1) n_shared += static_cast<size_t>(n);
    }
    return 2 * n_shared > n_near;
  }
  // Logs of one device may be rounded to different steps.  Those of which zero is a step are left without rates.
  static std::vector<RunInput> without_lattices(std::vector<RunInput> runs) {
    for (RunInput& run : runs)
      if (is_zero_a_step(run)) run.rate_dph.assign(run.size(), std::nan(""));
    return runs;
  }
};

} // namespace

IMUCAL_EFFECT(DeadBand)

} // namespace imucal
