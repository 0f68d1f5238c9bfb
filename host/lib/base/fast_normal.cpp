// SPDX-License-Identifier: MIT
#include "base/fast_normal.h"

#include <cmath>

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

} // namespace imucal
