// SPDX-License-Identifier: MIT
#include "physics/sim/raw_samples.h"

#include <algorithm>
#include <cmath>

#include "base/error.h"

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

} // namespace imucal
