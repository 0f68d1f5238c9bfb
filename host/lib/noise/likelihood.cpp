// SPDX-License-Identifier: MIT
#include "noise/likelihood.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/simd.h"
#include "noise/states.h"

namespace imucal {
namespace {

constexpr size_t kAbreast = 4;    // runs
constexpr size_t kFollowed = 128; // samples
constexpr size_t kLogEvery =
    8; // samples whose variances are multiplied before the logarithm: within the range of a double

// What the filter reads of a sample: [sample][run].  What no run fills stands for white noise of 1.
struct Followed {
  std::array<double, kFollowed*kAbreast> y = {}, white, phi = {}, q = {};
  Followed() { white.fill(1.0); }
};

// Where runs side by side stand: prediction and its variance; what is summed so far.
struct Standing {
  std::array<double, kAbreast> mean = {}, variance = {}, squares = {}, log_s = {};
};

template <class V> IMUCAL_WIDE_PART void follow_by(const Followed& in, size_t n, Standing* at) {
  constexpr size_t width = sizeof(V) / sizeof(double);
  V mean, variance, squares;
  load_lanes(&mean, at->mean.data()), load_lanes(&variance, at->variance.data());
  load_lanes(&squares, at->squares.data());
  for (size_t first = 0; first < n; first += kLogEvery) {
    V product = V{} + 1.0;
    for (size_t k = first; k < std::min(n, first + kLogEvery); ++k) {
      V y, white, phi, q;
      load_lanes(&y, &in.y[k * kAbreast]), load_lanes(&white, &in.white[k * kAbreast]);
      load_lanes(&phi, &in.phi[k * kAbreast]), load_lanes(&q, &in.q[k * kAbreast]);
      const V s = white + variance, weight = 1.0 / s, gain = variance * weight, nu = y - mean;
      squares += nu * nu * weight;
      product *= s;
      mean = phi * (mean + gain * nu);
      variance = (variance - gain * variance) * phi * phi + q;
    }
    double logs[width];
    store_lanes(product, logs);
    for (size_t l = 0; l < width; ++l) at->log_s[l] += std::log(logs[l]);
  }
  store_lanes(mean, at->mean.data()), store_lanes(variance, at->variance.data());
  store_lanes(squares, at->squares.data());
}
IMUCAL_WIDE void follow_four(const Followed& in, size_t n, Standing* at) {
  follow_by<Lanes>(in, n, at);
}
void follow_one(const Followed& in, size_t n, Standing* at) {
  follow_by<double>(in, n, at);
}

// One run on its way through the samples.
class Runner {
public:
  Runner(const SampleTimes& times, const NoiseModel& noise, const double* y)
      : times_(times), y_(y), states_(times, noise), transitions_(states_) {}
  double start_dph2() const { return states_.size() > 0 ? states_.start_dph2(0) : 0; }
  // Samples first .. first + n into the place of one run.
  void fill(size_t first, size_t n, size_t place, Followed* out) {
    for (size_t i = 0; i < n; ++i) {
      const size_t k = first + i, at = i * kAbreast + place;
      if (k + 1 < times_.n && states_.size() > 0) transitions_.set(states_, k);
      out->y[at] = y_[k], out->white[at] = states_.white_dph2(k), out->phi[at] = *transitions_.phi(),
      out->q[at] = *transitions_.q();
    }
  }

private:
  const SampleTimes& times_;
  const double* y_;
  NoiseStates states_;
  Transitions<1> transitions_; // of one state at most
};

// Up to four runs: side by side as far as the shortest goes, then each alone.
double of_few(const SampleTimes* times, const NoiseModel& noise, const double* const* residuals, size_t runs) {
  std::vector<Runner> runners;
  Standing at;
  size_t together = times[0].n;
  for (size_t r = 0; r < runs; ++r) {
    runners.emplace_back(times[r], noise, residuals[r]);
    at.variance[r] = runners[r].start_dph2();
    together = std::min(together, times[r].n);
  }
  Followed chunk;
  for (size_t k = 0; k < together; k += kFollowed) {
    const size_t n = std::min(kFollowed, together - k);
    for (size_t r = 0; r < runs; ++r) runners[r].fill(k, n, r, &chunk);
    follow_four(chunk, n, &at);
  }
  double sum = 0;
  for (size_t r = 0; r < runs; ++r) {
    Standing own;
    own.mean[0] = at.mean[r], own.variance[0] = at.variance[r];
    for (size_t k = together; k < times[r].n; k += kFollowed) {
      const size_t n = std::min(kFollowed, times[r].n - k);
      runners[r].fill(k, n, 0, &chunk);
      follow_one(chunk, n, &own);
    }
    sum += at.squares[r] + at.log_s[r] + own.squares[0] + own.log_s[0];
  }
  return -0.5 * sum;
}

} // namespace

bool can_follow(const NoiseModel& noise) {
  return noise.markov.size() <= 1 && !(noise.walk_dph_per_rt_s > 0) && !noise.is_mixture();
}

double follow_log_likelihood(const std::vector<SampleTimes>& times, const NoiseModel& noise,
                             const std::vector<const double*>& residuals) {
  double sum = 0;
  for (size_t r = 0; r < times.size(); r += kAbreast)
    sum += of_few(&times[r], noise, &residuals[r], std::min(kAbreast, times.size() - r));
  return sum;
}

} // namespace imucal
