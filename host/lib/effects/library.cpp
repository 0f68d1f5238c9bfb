// SPDX-License-Identifier: MIT
// The list of all effects and the look-up by name.  An effect joins the library by a line in effect_library().
#include "base/error.h"
#include "effects/effect.h"

namespace imucal {

const std::vector<const Effect*>& effect_library() {
  static const std::vector<const Effect*> all = {};
  return all;
}

const Effect& find_effect(const std::string& name) {
  std::string known;
  for (const Effect* effect : effect_library()) {
    if (effect->name() == name) return *effect;
    known += (known.empty() ? "" : ", ") + effect->name();
  }
  throw data_error("unknown effect \"" + name + "\" (known: " + known + ")");
}

}  // namespace imucal
