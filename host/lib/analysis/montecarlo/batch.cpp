// SPDX-License-Identifier: MIT
#include "analysis/montecarlo/batch.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "analysis/montecarlo/lanes.h"
#include "base/rng.h"
#include "base/simd.h"
#include "base/units.h"
#include "physics/sim/raw_sums.h"

namespace imucal {

namespace {

constexpr size_t kLanes = RawSummer::kLanes;
static_assert(kLanes == kBatch, "a batch fills the lanes");
constexpr size_t kPiece = 64; // seconds at a time, whose numbers stay in the nearest cache

// unit <- phi unit + rest normal, added to the rate; the first second of a test is stationary.
IMUCAL_WIDE void add_markov(size_t n, bool is_first, double phi, double rest, double sigma_dph, const double* normals,
                            double* unit_state, double* rate_dph) {
  Lanes8 unit, z, rate;
  load_lanes(&unit, unit_state);
  for (size_t k = 0; k < n; ++k) {
    load_lanes(&z, normals + kLanes * k);
    load_lanes(&rate, rate_dph + kLanes * k);
    unit = is_first && k == 0 ? z : Lanes8(phi * unit + rest * z);
    store_lanes(Lanes8(rate + sigma_dph * unit), rate_dph + kLanes * k);
  }
  store_lanes(unit, unit_state);
}

IMUCAL_WIDE void add_white(size_t n, double sigma_dph, const double* normals, double* rate_dph) {
  for (size_t i = 0; i < kLanes * n; ++i) rate_dph[i] += sigma_dph * normals[i];
}

// What physics/sim/simulate.h makes of a model without effects, in lanes: rates of the seconds, piece by piece.
class Truth {
public:
  Truth(const CampaignPlan& plan, uint64_t first_run) : plan_(plan), model_(plan.options.model) {
    for (size_t lane = 0; lane < kLanes; ++lane) {
      const SimOptions sim = run_options(plan, first_run + lane, 0);
      seed_[lane] = device_seed(sim);
      address_[lane] = stream_run(sim);
      turn_on_dph_[lane] =
          model_.turn_on_sigma_dph > 0 ? model_.turn_on_sigma_dph * stream(lane, Stream::kTurnOn).normal() : 0.0;
    }
    for (const Markov& m : model_.markov) steps_.push_back({m.step().phi(), m.step().drive(), m.sigma_dph, {}});
    if (model_.bias) bias_ = *model_.bias;
  }

  // Seconds first … first + n - 1 into rate_dph[8 k + lane]; n <= kPiece.
  void rates(size_t first, size_t n, double* rate_dph) {
    for (size_t k = 0; k < n; ++k) {
      const double bias_dph = bias_.at(plan_.chamber_degc[first + k]);
      for (size_t lane = 0; lane < kLanes; ++lane) rate_dph[kLanes * k + lane] = turn_on_dph_[lane] + bias_dph;
    }
    draw(Stream::kWhite, first, n);
    add_white(n, white_dph(), normals_, rate_dph);
    for (size_t i = 0; i < steps_.size(); ++i) {
      Step& step = steps_[i];
      draw(Stream::kMarkov, i * plan_.t_s.size() + first, n);
      add_markov(n, first == 0, step.phi, step.rest, step.sigma_dph, normals_, step.unit, rate_dph);
    }
  }
  double white_dph() const { return white_sigma_dph(model_.arw_deg_rt_h); }
  double turn_on_dph(size_t lane) const { return turn_on_dph_[lane]; }
  const std::array<uint64_t, kLanes>& seed() const { return seed_; }
  const std::array<uint64_t, kLanes>& address() const { return address_; }

private:
  struct Step {
    double phi, rest, sigma_dph, unit[kLanes];
  };
  Rng stream(size_t lane, Stream purpose) const { return Rng(seed_[lane], address_[lane], 0, purpose); }
  void draw(Stream purpose, size_t first, size_t n) {
    for (size_t lane = 0; lane < kLanes; ++lane)
      stream(lane, purpose).normals(static_cast<uint32_t>(first), n, normals_ + lane, kLanes);
  }

  const CampaignPlan& plan_;
  const ErrorModel& model_;
  ThermalPolynomial bias_;
  std::array<uint64_t, kLanes> seed_, address_;
  double turn_on_dph_[kLanes];
  std::vector<Step> steps_;
  double normals_[kLanes * kPiece];
};

// A whole second as imucal_sum_add hands it out.
imucal_second_t second_of(uint32_t t_s, uint32_t n_samples, int32_t temp_counts) {
  imucal_second_t second = {};
  second.t_s = t_s;
  second.n_samples = n_samples;
  second.n_channels = 1;
  second.temp_sum = static_cast<int64_t>(temp_counts) * n_samples;
  return second;
}

} // namespace

bool can_batch(const CampaignPlan& plan) {
  const CampaignOptions& o = plan.options;
  return o.effects.empty() && o.model.effects.empty() && !(o.missing_frac > 0) && RawSummer::can_sum(o.raw);
}

std::vector<CalibrationTest> calibrate_batch(const CampaignPlan& plan, uint64_t first_run, uint64_t n) {
  Truth truth(plan, first_run);
  RawSummer summer(plan.options.raw, truth.seed(), truth.address());
  ChainSetup setup = plan.chain;
  setup.keeps_seconds = plan.options.least_squares_every > 0 || plan.options.reference_every > 0;
  std::vector<CalibrationTest> tests;
  for (size_t lane = 0; lane < n; ++lane) {
    std::vector<double> coeff = plan.truth.coeff_dph;
    coeff[0] += truth.turn_on_dph(lane);
    tests.push_back({CoreChain(setup), std::move(coeff), truth.turn_on_dph(lane)});
  }
  imucal_thermometer_t thermometer = tests[0].chain.thermometer(); // one for all: they read the same
  ChainLanes lanes(&tests);
  double rate_dph[kLanes * kPiece];
  RawSums sums[kPiece];
  for (size_t first = 0; first < plan.t_s.size(); first += kPiece) {
    const size_t m = std::min(kPiece, plan.t_s.size() - first);
    truth.rates(first, m, rate_dph);
    summer.seconds(m, rate_dph, truth.white_dph(), sums);
    for (size_t k = 0; k < m; ++k) {
      const imucal_second_t second = second_of(static_cast<uint32_t>(first + k + 1), summer.samples_per_second(),
                                               summer.temp_counts(plan.chamber_degc[first + k]));
      imucal_thermometer_read(&thermometer, &second);
      lanes.push(second, sums[k], thermometer);
    }
  }
  lanes.finish();
  return tests;
}

} // namespace imucal
