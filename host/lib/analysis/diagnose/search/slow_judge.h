// SPDX-License-Identifier: MIT
// What becomes of the best hypothesis of a search: members in the place of free shapes, what every name gains, and what would do
// as well.
#pragma once
#include "analysis/diagnose/search/slow_scan.h"

namespace imucal {

constexpr size_t kMembersTried = 3; // in the place of a free shape

class SlowJudge {
public:
  // All must outlive it.  `so_far`: the hypotheses without a name in the mean are read from it.
  SlowJudge(const SlowLikelihood& likelihood, const SlowScan& scans, const SlowResult& so_far)
      : space_(likelihood.space()), likelihood_(likelihood), scans_(scans), so_far_(so_far) {}

  // Members for free shapes in result->best, then its evidence and rivals.
  void judge_names(SlowResult* result) const;
  // What a name gains over the best hypothesis without it, less its threshold.
  double evidence_of(const SlowModel& m, size_t name) const;
  // What comes near a name in its place, best first.
  std::vector<SlowResult::Rival> rivals(const SlowModel& m, size_t name) const;
  // Free shapes beside `m`, best first.
  std::vector<SlowCandidateScore> free_beside(const SlowModel& m, size_t most) const;
  // The free function of everything beside `m`, under its noise or that of `also`, at the likelier shape; no names: there is
  // none.
  SlowModel with_free_function(const SlowModel& m, const SlowModel& also) const;

  // The hypothesis as good as it can be made.  Where a jump at a temperature is not seen in it, it cannot be: then the best of
  // those with one name less.
  SlowModel at_its_best(const SlowModel& m) const;

  // The same with every effect of any shape in that of its parameters which comes nearest.
  SlowModel with_parameters(SlowModel m) const;

private:
  SlowModel with_members(SlowModel best, std::vector<size_t>* replaced) const;
  SlowModel with_best_member(const SlowModel& less, const SlowModel& best, double free_gain) const;
  SlowModel with_nearest(const SlowModel& m, size_t name) const;
  SlowModel settled(SlowModel m) const;
  SlowModel without(const SlowModel& m, size_t name) const;

  const SlowSpace& space_;
  const SlowLikelihood& likelihood_;
  const SlowScan& scans_;
  const SlowResult& so_far_;
};

} // namespace imucal
