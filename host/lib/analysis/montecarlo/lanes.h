// SPDX-License-Identifier: MIT
// The seconds of eight runs through eight filters side by side.  The filter is the core's: the build takes what kf.c says of
// one second, word for word, with a vector of eight floats where it says float (montecarlo.mk).  A lane then has the bits
// that the core gives alone (test_batch_gives_the_bits_of_each_run).
// Order of calls: construct; push every second; finish; then the tests hold everything, as though pushed one by one.
#pragma once
#include <memory>
#include <vector>

#include "analysis/montecarlo/campaign.h"
#include "physics/sim/raw_sums.h"

namespace imucal {

class ChainLanes {
public:
  // Tests of one plan, 1 to 8, nothing pushed yet; *tests outlives this.
  explicit ChainLanes(std::vector<CalibrationTest>* tests);
  ~ChainLanes();

  // Pre: second is whole, but for sum[0] and flags[0], which are every run's own.
  // A second that every filter takes goes through all at once; any other one through each by itself.
  void push(imucal_second_t second, const RawSums& sums, const imucal_thermometer_t& thermometer);
  void finish();

private:
  struct Filters;
  bool push_together(const float* z_dph, float temp_degc);
  void push_one_by_one(imucal_second_t second, const RawSums& sums, const imucal_thermometer_t& thermometer);
  bool take(); // the filters' numbers out of the tests; false: they have not taken the same seconds
  void give_back();

  std::vector<CalibrationTest>& tests_;
  std::unique_ptr<Filters> filters_;
  bool is_held_ = false; // the numbers are in filters_
};

} // namespace imucal
