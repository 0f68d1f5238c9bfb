// SPDX-License-Identifier: MIT
#include "analysis/errormodel/simulate.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/fast_normal.h"
#include "base/simd.h"
#include "base/units.h"
#include "io/model.h"

namespace imucal {

using Kind = NoiseComponent::Kind;

namespace {

// Adds one component.  A loop for each kind: nothing to choose inside.
void add_component(const NoiseComponent& c, FastNormal rng, std::vector<double>* x) {
  const double sigma = std::sqrt(c.power_dph2);
  switch (c.kind) {
  case Kind::kWhite:
    for (double& v : *x) v += sigma * rng.normal();
    break;
  case Kind::kMarkov: {
    const double phi = MarkovStep(c.alpha).phi(), drive = sigma * MarkovStep(c.alpha).drive();
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

FastNormal stream_of(uint64_t seed, const NoiseRecord& record, uint32_t place) {
  return FastNormal(Rng(seed, record.run, record.axis, static_cast<uint32_t>(Stream::kTool) + place));
}

constexpr size_t kLanes = FastNormalLanes::kLanes;
static_assert(kLanes == kStreamsAbreast, "stated in simulate.h");
constexpr size_t kPiece = 256; // samples at a time: the numbers of all lanes stay in the first-level cache

// A component that takes one normal number z a sample:  next = phi state + drive z,  sample = of_state state + of_next next.
// phi, of_state and of_next are whole where add_component has no product: these products are exact.
struct Recursions {
  double phi[kLanes] = {}, drive[kLanes] = {}, state[kLanes] = {}, of_state[kLanes] = {}, of_next[kLanes] = {};

  void set(size_t lane, const NoiseComponent& c, FastNormal* rng) {
    const double sigma = std::sqrt(c.power_dph2);
    const bool is_markov = c.kind == Kind::kMarkov, is_quantization = c.kind == Kind::kAngleQuantization;
    phi[lane] = is_markov ? MarkovStep(c.alpha).phi() : c.kind == Kind::kRandomWalk ? 1 : 0;
    drive[lane] = is_markov ? sigma * MarkovStep(c.alpha).drive() : sigma;
    of_state[lane] = is_markov ? 1 : is_quantization ? -1 : 0;
    of_next[lane] = is_markov ? 0 : 1;
    if (is_markov || is_quantization) state[lane] = sigma * rng->normal();
  }
};

bool is_recursion(const NoiseComponent& c) {
  return c.kind != Kind::kRamp && c.kind != Kind::kSinusoid;
}

// Normal numbers z[kLanes i + lane] become samples.
IMUCAL_WIDE void run_recursions(Recursions* r, size_t n, double* z) {
  for (size_t half = 0; half < kLanes; half += 4) {
    Lanes phi, drive, state, of_state, of_next, number;
    load_lanes(&phi, r->phi + half), load_lanes(&drive, r->drive + half), load_lanes(&state, r->state + half);
    load_lanes(&of_state, r->of_state + half), load_lanes(&of_next, r->of_next + half);
    for (size_t i = 0; i < n; ++i) {
      load_lanes(&number, z + kLanes * i + half);
      const Lanes next = phi * state + drive * number;
      store_lanes(of_state * state + of_next * next, z + kLanes * i + half);
      state = next;
    }
    store_lanes(state, r->state + half);
  }
}

// Records of one length whose components fill at most kLanes.
void simulate_abreast(const std::vector<NoiseComponent>& components, uint64_t seed, const NoiseRecord* records,
                      size_t count, std::vector<double>* x) {
  Recursions recursions;
  const FastNormal idle = stream_of(seed, records[0], 0); // of lanes that nothing needs
  std::array<FastNormal, kLanes> streams = {idle, idle, idle, idle, idle, idle, idle, idle};
  for (size_t r = 0, lane = 0; r < count; ++r)
    for (uint32_t place = 0; place < components.size(); ++place, ++lane) {
      streams[lane] = stream_of(seed, records[r], place);
      recursions.set(lane, components[place], &streams[lane]);
    }
  FastNormalLanes normals(streams);
  double samples[kLanes * kPiece];
  const auto n = static_cast<size_t>(records[0].n);
  for (size_t b = 0; b < n; b += kPiece) {
    const size_t length = std::min(kPiece, n - b);
    normals.normals(length, samples);
    run_recursions(&recursions, length, samples);
    for (size_t r = 0, lane = 0; r < count; ++r)
      for (size_t c = 0; c < components.size(); ++c, ++lane)
        for (size_t i = 0; i < length; ++i) x[r][b + i] += samples[kLanes * i + lane];
  }
}

} // namespace

std::vector<std::vector<double>> simulate_noises(const std::vector<NoiseComponent>& components, uint64_t seed,
                                                 const std::vector<NoiseRecord>& records) {
  std::vector<std::vector<double>> out;
  const bool fits = !components.empty() && std::all_of(components.begin(), components.end(), is_recursion);
  const size_t most = fits ? kLanes / components.size() : 0;
  for (size_t first = 0, count = 0; first < records.size(); first += count) {
    for (count = 1; count < most && first + count < records.size() && records[first + count].n == records[first].n;)
      ++count;
    if (count == 1) {
      const NoiseRecord& record = records[first];
      out.push_back(simulate_noise(components, record.n, seed, record.run, record.axis));
      continue;
    }
    for (size_t k = 0; k < count; ++k) out.emplace_back(static_cast<size_t>(records[first].n), 0.0);
    simulate_abreast(components, seed, &records[first], count, &out[first]);
  }
  return out;
}

std::vector<double> simulate_noise(const std::vector<NoiseComponent>& components, long n, uint64_t seed, uint64_t run,
                                   uint32_t axis) {
  std::vector<double> x(static_cast<size_t>(n), 0.0);
  uint32_t place = 0;
  for (const NoiseComponent& c : components) add_component(c, stream_of(seed, {n, run, axis}, place++), &x);
  return x;
}

} // namespace imucal
