// SPDX-License-Identifier: MIT
#include "analysis/diagnose/judge/verdict.h"

namespace imucal {

Verdict verdict_of(const Told& told, const Left& left) {
  if (!told.answer) {
    const bool has_gap = left.finding || left.shape || (left.minutes && !left.are_of_one_passage);
    return has_gap ? Verdict::kUnexplained : Verdict::kNoGap;
  }
  if (told.open_shape && !told.cause) return Verdict::kUnexplained;
  const bool is_whole = !told.open_shape && !told.undecided;
  const bool leaves_nothing = !left.finding && !left.shape && !left.minutes && !left.growth && !left.part;
  return is_whole && leaves_nothing ? Verdict::kExplained : Verdict::kPartlyExplained;
}

} // namespace imucal
