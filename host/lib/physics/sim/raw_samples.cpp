// SPDX-License-Identifier: MIT
#include "physics/sim/raw_samples.h"

#include <algorithm>
#include <cmath>

#include "base/error.h"
#include "base/simd.h"
#include "physics/sim/raw_sums.h"

namespace imucal {

// Streams of raw samples do not share a purpose with those of the 1-s simulation.
static constexpr uint32_t kRaw = 0x10000;

static FastNormal stream(uint64_t seed, uint64_t run, size_t axis, Stream purpose) {
  return FastNormal(Rng(seed, run, static_cast<uint32_t>(axis), kRaw + static_cast<uint32_t>(purpose)));
}

// Rounds to a whole count; `carried`, where given, takes the rounding error on to the next value.
static int32_t rounded(double exact, double* carried) {
  if (!carried) return static_cast<int32_t>(std::lrint(exact));
  const double wanted = exact + *carried;
  const double whole = std::nearbyint(wanted);
  *carried = wanted - whole;
  return static_cast<int32_t>(whole);
}

RawSampler::RawSampler(const RawFormat& format, size_t n_axes, uint64_t seed, uint64_t run)
    : format_(format), n_axes_(n_axes), n_(static_cast<size_t>(std::lround(format.rate_hz))),
      thermometer_(stream(seed, run, 0, Stream::kThermometer)), jitter_(stream(seed, run, 0, Stream::kJitter)),
      missing_(stream(seed, run, 0, Stream::kMissing)) {
  if (n_axes == 0 || n_axes > kMaxRawAxes)
    throw usage_error("raw samples: 1 to " + std::to_string(kMaxRawAxes) + " axes, not " + std::to_string(n_axes));
  if (n_ < 1 || std::abs(format.rate_hz - static_cast<double>(n_)) > 1e-9 || n_ > 20000)
    throw usage_error("raw samples: the rate must be a whole number of Hz from 1 to 20000");
  if (!(format.counts_scale_dph > 0) || !(format.temp_lsb_degc > 0))
    throw usage_error("raw samples: the value of one count (rate, temperature) must be positive");
  for (size_t a = 0; a < n_axes; ++a) noise_.push_back(stream(seed, run, a, Stream::kWhite));
  for (size_t a = 0; a < n_axes; ++a)
    if (!(format_.scale(a) > 0)) throw usage_error("raw samples: the value of one count must be positive");
  deviation_.resize(n_);
  carried_counts_.assign(n_axes + 1, 0.0);
}

void RawSampler::second(double t_end_s, double temp_degc, const double* mean_dph, const double* white_sigma_dph,
                        std::vector<RawSample>* out) {
  const size_t first = out->size();
  out->resize(first + n_);
  RawSample* const samples = out->data() + first;
  const double step_s = 1.0 / static_cast<double>(n_);
  for (size_t i = 0; i < n_; ++i) {
    double t_s = t_end_s - 1.0 + (static_cast<double>(i) + 0.5) * step_s;
    if (format_.jitter_s > 0) t_s += std::clamp(format_.jitter_s * jitter_.normal(), -0.4 * step_s, 0.4 * step_s);
    samples[i] = RawSample{};
    samples[i].t_us = static_cast<uint64_t>(std::llrint(t_s * 1e6));
    double shown_degc = temp_degc - format_.temp_offset_degc;
    if (format_.temp_noise_degc > 0) shown_degc += format_.temp_noise_degc * thermometer_.normal();
    samples[i].temp_counts =
        rounded(shown_degc / format_.temp_lsb_degc, format_.dithered ? &carried_counts_[n_axes_] : nullptr);
  }
  const double limit = format_.max_counts;
  for (size_t a = 0; a < n_axes_; ++a) {
    const double per_count = 1.0 / format_.scale(a);
    double* const carried = format_.dithered ? &carried_counts_[a] : nullptr;
    if (!std::isfinite(mean_dph[a])) {
      for (size_t i = 0; i < n_; ++i) samples[i].absent |= 1u << a;
      continue;
    }
    const double sigma = white_sigma_dph[a] * std::sqrt(static_cast<double>(n_)) * per_count;
    double sum = 0;
    for (double& d : deviation_) sum += d = sigma > 0 ? sigma * noise_[a].normal() : 0.0;
    const double offset = mean_dph[a] * per_count - sum * step_s;
    for (size_t i = 0; i < n_; ++i) {
      const double value = std::clamp(offset + deviation_[i], -limit, limit);
      if (std::abs(value) >= limit) samples[i].saturated |= 1u << a;
      samples[i].counts[a] = rounded(value, carried);
    }
  }
  if (format_.missing_frac > 0) {
    const auto gone = std::remove_if(out->begin() + static_cast<long>(first), out->end(),
                                     [&](const RawSample&) { return missing_.uniform() < format_.missing_frac; });
    out->erase(gone, out->end());
  }
}

// ---- sums of eight runs side by side ----

bool RawSummer::can_sum(const RawFormat& format) {
  return !(format.jitter_s > 0) && !(format.missing_frac > 0) && !(format.temp_noise_degc > 0) && !format.dithered;
}

static FastNormalLanes lanes_of(const std::array<uint64_t, RawSummer::kLanes>& seed,
                                const std::array<uint64_t, RawSummer::kLanes>& run) {
  const auto at = [&](size_t i) { return stream(seed[i], run[i], 0, Stream::kWhite); };
  return FastNormalLanes({at(0), at(1), at(2), at(3), at(4), at(5), at(6), at(7)});
}

RawSummer::RawSummer(const RawFormat& format, const std::array<uint64_t, kLanes>& seed,
                     const std::array<uint64_t, kLanes>& run)
    : format_(format), n_(RawSampler(format, 1, 0, 0).samples_per_second()), noise_(lanes_of(seed, run)) {}

int32_t RawSummer::temp_counts(double temp_degc) const {
  return rounded((temp_degc - format_.temp_offset_degc) / format_.temp_lsb_degc, nullptr);
}

// RawSampler::second in lanes.  Adding 1.5 2^52 rounds to whole numbers, ties to even, as lrint does; sums of them are
// exact.
IMUCAL_WIDE static void sum_seconds(size_t n, size_t rate, const double* normals, const double* mean_dph,
                                    const double* format, RawSums* out) {
  const double per_count = format[0], sigma = format[1], step_s = format[2], limit = format[3], whole = 0x1.8p52;
  for (size_t k = 0; k < n; ++k, normals += 8 * rate, mean_dph += 8, ++out) {
    Lanes8 sum = {}, total = {}, most = {}, z, mean;
    for (size_t i = 0; i < rate; ++i) {
      load_lanes(&z, normals + 8 * i);
      sum += sigma * z;
    }
    load_lanes(&mean, mean_dph);
    const Lanes8 offset = mean * per_count - sum * step_s;
    for (size_t i = 0; i < rate; ++i) {
      load_lanes(&z, normals + 8 * i);
      Lanes8 value = offset + sigma * z;
      const Lanes8 size = value < 0 ? -value : value;
      most = most < size ? size : most;
      value = value < -limit ? Lanes8{} - limit : value;
      value = value > limit ? Lanes8{} + limit : value;
      total += (value + whole) - whole;
    }
    out->saturated = 0;
    for (size_t lane = 0; lane < 8; ++lane) {
      out->counts[lane] = static_cast<int64_t>(total[lane]);
      if (most[lane] >= limit) out->saturated |= 1u << lane;
    }
  }
}

void RawSummer::seconds(size_t n, const double* mean_dph, double white_sigma_dph, RawSums* out) {
  const double per_count = 1.0 / format_.scale(0);
  const double format[] = {per_count, white_sigma_dph * std::sqrt(static_cast<double>(n_)) * per_count,
                           1.0 / static_cast<double>(n_), static_cast<double>(format_.max_counts)};
  const size_t piece = std::max<size_t>(1, 200 / n_); // what stays in the nearest cache
  normals_.resize(kLanes * n_ * piece); // zeros the first time: all that is looked at where there is no noise
  for (size_t k = 0; k < n; k += piece) {
    const size_t m = std::min(piece, n - k);
    if (format[1] > 0) noise_.normals(m * n_, normals_.data());
    sum_seconds(m, n_, normals_.data(), mean_dph + kLanes * k, format, out + k);
  }
}

} // namespace imucal
