// SPDX-License-Identifier: MIT
// How much chance gains: the tail of what draws of the noise gain.
#pragma once

namespace imucal {

struct NullTail {
  double threshold_nats = 6; // what a name must gain
  double scale_nats = 1;     // chance gains so much more e times less often
  double over_nats = 0; // by how much chance at the asked rate exceeds the threshold, where that is held at its highest
};

} // namespace imucal
