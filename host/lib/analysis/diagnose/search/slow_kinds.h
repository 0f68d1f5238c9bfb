// SPDX-License-Identifier: MIT
// Kinds of slow noise beside the causes of a hypothesis.  The noise fitted without a kind has often swallowed it, and a search
// from there stays there: each kind has several starts.
#pragma once
#include "analysis/diagnose/search/slow_polish.h"

namespace imucal {

// Every kind beside `m`, each from its best start, those of `so_far` among them; the most promising ones are polished.
std::vector<SlowCandidateScore> scan_noises(const SlowLikelihood& of, const SlowResult& so_far, const SlowModel& m,
                                            size_t polish_most);
// Every kind in the place of that of `m`, all polished.
std::vector<SlowCandidateScore> kinds_beside(const SlowLikelihood& of, const SlowResult& so_far, const SlowModel& m);
// A kind that is none of the library in the place of that of `m`, from the best of its starts and from where `m` is.
SlowModel with_kind(const SlowLikelihood& of, const SlowResult& so_far, const SlowModel& m, const Effect& kind);
// The same kind where it takes most of what the rest of the noise held.
SlowModel in_place_of_base(const SlowLikelihood& of, const SlowModel& m);
// The same kind beside the noise as believed, from the best of its own starts: beside other noise it may have faded away.
SlowModel beside_believed(const SlowLikelihood& of, SlowModel m);

} // namespace imucal
