// SPDX-License-Identifier: MIT
#include "base/fast_normal.h"

#include <cmath>

#include "base/simd.h"

#if defined(IMUCAL_AVX512)
#include <immintrin.h>
#endif

namespace imucal {

// Marsaglia and Tsang's constants for 256 layers: start of the tail and area of every layer.
static constexpr double kTail = 3.6541528853610088;
static constexpr double kArea = 0.00492867323399;

static double density(double x) {
  return std::exp(-0.5 * x * x);
}

FastNormal::Table::Table() {
  // Layer 0 is the bottom strip with the tail: as wide as its area over its height.
  x_edge[0] = kArea / density(kTail);
  x_edge[1] = kTail;
  for (int i = 2; i < 256; ++i) x_edge[i] = std::sqrt(-2.0 * std::log(kArea / x_edge[i - 1] + density(x_edge[i - 1])));
  x_edge[256] = 0;
  y[0] = 0;
  for (int i = 1; i < 257; ++i) y[i] = density(x_edge[i]);
  for (int i = 0; i < 256; ++i) {
    scale[i] = x_edge[i] * 0x1p-52;
    inside[i] = static_cast<int64_t>(x_edge[i + 1] / x_edge[i] * 0x1p52);
  }
}

const FastNormal::Table& FastNormal::table() {
  static const Table the_table;
  return the_table;
}

FastNormal::FastNormal(Rng seeder) {
  for (uint64_t& word : s_) {
    word = static_cast<uint64_t>(seeder.bits()) << 32;
    word |= seeder.bits();
  }
  s_[0] |= 1; // the all-zero state is the one that must not occur
}

// A point outside the surely-inside part of its layer: accept under the curve, draw from the tail, or start
// again.
double FastNormal::rare(unsigned layer, double x) {
  if (layer == 0) {
    double beyond, height;
    do {
      beyond = -std::log(uniform()) / kTail;
      height = -std::log(uniform());
    } while (2 * height < beyond * beyond);
    return x > 0 ? kTail + beyond : -kTail - beyond;
  }
  if (table_->y[layer] + uniform() * (table_->y[layer + 1] - table_->y[layer]) < density(x)) return x;
  return normal();
}

// ---- eight side by side ----

void FastNormalLanes::normals_one_by_one(size_t n, double* out) {
  for (size_t lane = 0; lane < kLanes; ++lane) {
    FastNormal stream = streams_[lane]; // a copy that can live in registers
    for (size_t i = 0; i < n; ++i) out[kLanes * i + lane] = stream.normal();
    streams_[lane] = stream;
  }
}

#if defined(IMUCAL_AVX512)
typedef uint64_t Words __attribute__((vector_size(64)));

// FastNormal::bits and ::normal on vectors.  An integer below 2^52 becomes a double by standing in the fraction of 2^52:
// AVX-512F has no conversion of 64 bits.  States are in registers; one vector in ten has a lane that must look closer and
// for that goes through memory.
IMUCAL_AVX512 void FastNormalLanes::normals_avx512(size_t n, double* out) {
  const FastNormal::Table& table = *streams_[0].table_;
  Words s[4];
  for (size_t lane = 0; lane < kLanes; ++lane)
    for (size_t j = 0; j < 4; ++j) s[j][lane] = streams_[lane].s_[j];
  for (size_t i = 0; i < n; ++i, out += kLanes) {
    const Words sum = s[0] + s[3], random = (sum << 23 | sum >> 41) + s[0], t = s[1] << 17;
    s[2] ^= s[0];
    s[3] ^= s[1];
    s[1] ^= s[2];
    s[0] ^= s[3];
    s[2] ^= t;
    s[3] = s[3] << 45 | s[3] >> 19;
    const Words minus = Words(__m512i(random) >> 63), size = (Words(__m512i(random) >> 11) ^ minus) - minus;
    const auto layer = __m512i(random & 0xff);
    const auto scale = Lanes8(_mm512_mask_i64gather_pd(_mm512_setzero_pd(), 0xff, layer, table.scale, 8));
    const __m512i inside = _mm512_mask_i64gather_epi64(_mm512_setzero_si512(), 0xff, layer, table.inside, 8);
    const Lanes8 x = (Lanes8(size + 0x4330000000000000) - 0x1p52) * scale;
    store_lanes(Lanes8(Words(x) | (minus << 63)), out);
    unsigned outside = _mm512_cmpge_epi64_mask(__m512i(size), inside);
    for (; outside != 0; outside &= outside - 1) {
      const auto lane = static_cast<size_t>(__builtin_ctz(outside));
      FastNormal& stream = streams_[lane];
      for (size_t j = 0; j < 4; ++j) stream.s_[j] = s[j][lane];
      out[lane] = stream.rare(random[lane] & 0xff, out[lane]);
      const auto only = static_cast<__mmask8>(1u << lane);
      for (size_t j = 0; j < 4; ++j)
        s[j] = Words(_mm512_mask_set1_epi64(__m512i(s[j]), only, static_cast<int64_t>(stream.s_[j])));
    }
  }
  for (size_t lane = 0; lane < kLanes; ++lane)
    for (size_t j = 0; j < 4; ++j) streams_[lane].s_[j] = s[j][lane];
}
#endif

void FastNormalLanes::normals(size_t n, double* out) {
#if defined(IMUCAL_AVX512)
  if (has_avx512()) return normals_avx512(n, out);
#endif
  normals_one_by_one(n, out);
}

} // namespace imucal
