// SPDX-License-Identifier: MIT
#include "analysis/errormodel/simulate.h"

#include <cmath>

#include "base/fast_normal.h"
#include "base/units.h"

namespace imucal {

using Kind = NoiseComponent::Kind;

namespace {

// Adds one component.  A loop for each kind: nothing to choose inside.
void add_component(const NoiseComponent& c, FastNormal rng, std::vector<double>* x) {
  const double sigma = std::sqrt(c.power_dph2);
  const double phi = std::exp(-c.alpha), drive = sigma * std::sqrt(-std::expm1(-2 * c.alpha));
  switch (c.kind) {
  case Kind::kWhite:
    for (double& v : *x) v += sigma * rng.normal();
    break;
  case Kind::kMarkov: {
    double state = sigma * rng.normal();
    for (double& v : *x) v += state, state = phi * state + drive * rng.normal();
    break;
  }
  case Kind::kAngleQuantization: {
    double last = sigma * rng.normal();
    for (double& v : *x) {
      const double next = sigma * rng.normal();
      v += next - last;
      last = next;
    }
    break;
  }
  case Kind::kRandomWalk: {
    double state = 0;
    for (double& v : *x) v += state += sigma * rng.normal();
    break;
  }
  case Kind::kRamp:
    for (size_t i = 0; i < x->size(); ++i)
      (*x)[i] += sigma * (static_cast<double>(i) - 0.5 * (static_cast<double>(x->size()) - 1));
    break;
  case Kind::kSinusoid: {
    const double phase = 2 * kPi * rng.uniform();
    for (size_t i = 0; i < x->size(); ++i) (*x)[i] += sigma * std::cos(c.omega_rad * static_cast<double>(i) + phase);
    break;
  }
  }
}

} // namespace

std::vector<double> simulate_noise(const std::vector<NoiseComponent>& components, long n, uint64_t seed, uint64_t run,
                                   uint32_t axis) {
  std::vector<double> x(static_cast<size_t>(n), 0.0);
  uint32_t place = 0;
  for (const NoiseComponent& c : components)
    add_component(c, FastNormal(Rng(seed, run, axis, static_cast<uint32_t>(Stream::kTool) + place++)), &x);
  return x;
}

} // namespace imucal
