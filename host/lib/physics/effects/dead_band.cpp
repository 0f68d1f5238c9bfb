// SPDX-License-Identifier: MIT
// Small rates read as zero: |rate| < width becomes 0.  Source: dead band of IEEE Std 1431-2004.
#include <algorithm>
#include <cmath>
#include <vector>

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
  // as noise around the local level would put inside.  Zeros far from the level are drop-outs; where the
  // small values of a log stand on a lattice, zero is one of its steps and tells nothing of a band.
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
  static constexpr double kAlike = 3;                   // how far the pile may be from what noise would put inside
  static constexpr double kNear = 2.25, kHalfWay = 1.5; // of the edge
  static constexpr double kDigits = 3.9;                // of the log that an edge has at least: four, less rounding
  static constexpr double kLeastHalfWay = 0.13;         // a third of what even rates have there
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
  // Whether zero is one step of a lattice, printed with few decimals perhaps (steps of 0.549 dph stand as 0.5, 0.6, 1.1, 1.6).
  // A lattice has no rates half-way between its steps; beyond the edge of a band they lie everywhere.  Where the digits of the
  // log are not much finer than the edge, or too few rates are near, it cannot be told.
  static bool is_zero_a_step(const RunInput& run) {
    const double edge = count_zeros({run}).edge_dph;
    std::vector<double> near;
    for (const double y : run.rate_dph)
      if (std::fabs(y) >= edge && std::fabs(y) < kNear * edge) near.push_back(std::fabs(y));
    if (!(edge > 0) || near.size() < kFewest) return true;
    const auto n_half_way =
        std::count_if(near.begin(), near.end(), [&](double y) { return std::fabs(y - kHalfWay * edge) < 0.25 * edge; });
    double digit = edge;
    std::sort(near.begin(), near.end());
    for (size_t k = 1; k < near.size(); ++k)
      if (!is_same_rate(near[k], near[k - 1])) digit = std::min(digit, near[k] - near[k - 1]);
    return edge < kDigits * digit || static_cast<double>(n_half_way) < kLeastHalfWay * static_cast<double>(near.size());
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
