// SPDX-License-Identifier: MIT
// What the converter or the recorder did to the samples: found first, said, and left out of what follows.  The rest of
// the log is judged without it.
#pragma once
#include <vector>

#include "analysis/diagnose/logs/campaign.h"
#include "physics/effects/effect.h"

namespace imucal {

struct StructureFinding {
  const Effect* effect;
  Signature signature;
};

struct StructureResult {
  std::vector<StructureFinding> findings;
  size_t n_dropouts = 0;       // exact zeros far from their neighbours that are in no finding: too few
  size_t n_left_out = 0;       // samples masked, with the neighbourhood that censoring has biased
  double extra_white_dph2 = 0; // of a lattice
  bool is_censored = false;    // values are missing because of their size
};

// Masks in `campaign` what cannot be used.  `active`: effects that may be named.
StructureResult find_structure(Campaign* campaign, const std::vector<const Effect*>& library,
                               const std::vector<bool>& active);

} // namespace imucal
