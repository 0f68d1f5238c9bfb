// SPDX-License-Identifier: MIT
// What the converter or the recorder did to the samples of all logs, fitted or held out: found first, said, and left out of what
// follows.  The rest is judged without it.
#pragma once
#include <string>
#include <vector>

#include "analysis/diagnose/logs/campaign.h"
#include "physics/effects/effect.h"

namespace imucal {

struct StructureFinding {
  const Effect* effect;
  Signature signature;
  std::string logs; // "log 2, held-out log 1" where it is in some logs and not in others; else ""
};

struct StructureResult {
  std::vector<StructureFinding> findings;
  size_t n_dropouts = 0;    // exact zeros that are no rates and in no finding: too few
  size_t n_left_out = 0;    // samples masked, with the neighbourhood that censoring has biased
  bool is_censored = false; // values are missing because of their size
};

// Masks what cannot be used, and gives each run the white noise that its rounding adds.  `held_out`: or nullptr.  `active`: effects
// that may be named.
StructureResult find_structure(Campaign* fitted, Campaign* held_out, const std::vector<const Effect*>& library,
                               const std::vector<bool>& active);

} // namespace imucal
