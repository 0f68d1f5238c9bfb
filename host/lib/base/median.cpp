// SPDX-License-Identifier: MIT
#include "base/median.h"

#include <algorithm>

namespace imucal {

double median(std::vector<double> x) {
  const size_t middle = x.size() / 2;
  std::nth_element(x.begin(), x.begin() + static_cast<long>(middle), x.end());
  return x[middle];
}

} // namespace imucal
