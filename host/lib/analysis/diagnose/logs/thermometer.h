// SPDX-License-Identifier: MIT
// What the readings of a thermometer show that is not the temperature: minutes in which it was stuck, single wrong readings,
// pauses of the recorder that its time stamps hide, and readings that are repeated until the next one.
//
// A stuck thermometer gives exactly one reading far longer than is usual for it, then jumps to the temperature of that
// second, further than it moves at any time soon after.  Both are asked: a coarse thermometer in a soak rests as long but
// goes on by one step, and a chamber that changes fast leaves a soak as suddenly but goes on as fast.
#pragma once
#include <cstddef>
#include <vector>

namespace imucal {

// Rows [first, end) have the same reading; the row `end` has the one after the jump.
struct Hold {
  size_t first = 0, end = 0;
};

// A thermometer that is read less often than the rates: its reading changes at one row of so many only, and stands in the others
// again.  A step of a coarse thermometer is as far as two of its readings are apart at least.
struct RepeatedReadings {
  double every = 0;         // rows by dt_s, on average; 0: every row has a reading of its own
  std::vector<size_t> rows; // of the new readings
};
// Readings come in even steps of time, to a row; the clock of the thermometer is its own, and the steps may begin anew.  One
// number per row, ticks (seconds in units of dt_s) increase; temp_degc is NaN where missing.
RepeatedReadings repeated_readings(const std::vector<long>& ticks, const std::vector<double>& temp_degc);

// In increasing order.  One number per row; t_s increases, mostly by dt_s; temp_degc is NaN where missing, which ends a hold.
// A hold that ends in missing rows is not told from a soak.  None where holds would be more than half of the log.
std::vector<Hold> stuck_thermometer(const std::vector<double>& t_s, double dt_s, const std::vector<double>& temp_degc);

// Readings that are further apart than the temperature of a board can go: 5 degC from one row to the next, or 1 degC/s where rows
// are further apart.  Rows, increasing.
struct ImpossibleReadings {
  std::vector<size_t> wrong;  // a few that are far from those before and after them, or at an end of the log
  std::vector<size_t> pauses; // from here on all are far from those before
};
// Wrong readings are what a sensor gives at power-up (85 degC), disconnected (-127) or unread (0).  After a hidden pause the log
// goes on as if nothing had been: the recorder had stopped.  One number per row; t_s increases; temp_degc is NaN where missing.
ImpossibleReadings impossible_readings(const std::vector<double>& t_s, const std::vector<double>& temp_degc);

} // namespace imucal
