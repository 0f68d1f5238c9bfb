// SPDX-License-Identifier: MIT
#include "analysis/errormodel/simulate.h"

#include <cmath>

#include "base/fast_normal.h"
#include "base/units.h"

namespace imucal {

using Kind = NoiseComponent::Kind;

std::vector<double> simulate_noise(const std::vector<NoiseComponent>& components, long n, uint64_t seed, uint64_t run,
                                   uint32_t axis) {
  std::vector<double> x(static_cast<size_t>(n), 0.0);
  uint32_t place = 0;
  for (const NoiseComponent& c : components) {
    FastNormal rng(Rng(seed, run, axis, static_cast<uint32_t>(Stream::kTool) + place++));
    const double sigma = std::sqrt(c.power_dph2);
    const double phi = std::exp(-c.alpha), drive = sigma * std::sqrt(-std::expm1(-2 * c.alpha));
    const double phase = c.kind == Kind::kSinusoid ? 2 * kPi * rng.uniform() : 0;
    double state = c.kind == Kind::kMarkov || c.kind == Kind::kAngleQuantization ? sigma * rng.normal() : 0;
    for (size_t i = 0; i < x.size(); ++i) {
      const auto k = static_cast<double>(i);
      switch (c.kind) {
      case Kind::kWhite:
        x[i] += sigma * rng.normal();
        break;
      case Kind::kMarkov:
        x[i] += state;
        state = phi * state + drive * rng.normal();
        break;
      case Kind::kAngleQuantization: {
        const double next = sigma * rng.normal();
        x[i] += next - state;
        state = next;
        break;
      }
      case Kind::kRandomWalk:
        x[i] += state += sigma * rng.normal();
        break;
      case Kind::kRamp:
        x[i] += sigma * (k - 0.5 * static_cast<double>(n - 1));
        break;
      case Kind::kSinusoid:
        x[i] += sigma * std::cos(c.omega_rad * k + phase);
        break;
      }
    }
  }
  return x;
}

} // namespace imucal
