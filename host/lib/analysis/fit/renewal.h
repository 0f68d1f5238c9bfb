// SPDX-License-Identifier: MIT
// A thermometer whose reading is renewed only every so many seconds (an external sensor that a slow task polls): what every
// second is told is as old as half of that on average.  On a ramp the polynomial then belongs to temperatures that are past.
//
// How it shows: the mean of a second equals that of the second before, exactly, and then the reading is at once ten quanta
// and more further.  A thermometer that is read every second does not do that: where its means stand it moves by less than a
// quantum in a second, or its noise would move them.  Steps of a converter that are coarser than the quantum that the device
// declares look alike, but its readings all lie on one lattice (but one in a hundred).  Those of a thermometer that is renewed
// seldom do so only where the ramp is steady to a quantum and the thermometer without noise: then the delay is not seen.
// False alarms: 0 of 756 healthy thermometers of many kinds (test_renewal.cpp), less than 0.4 % with 95 % confidence.
#pragma once
#include <string>
#include <vector>

namespace imucal {

struct Renewal {
  double every_s = 0;   // 0: as often as the rows, or it cannot be told (fewer than three rows)
  double move_degc = 0; // usual step from one reading to the next where the temperature moves
  double delay_s() const { return every_s / 2; } // mean age of a reading
};

// Rows of a record: t_s increases, mostly by one second; temp_degc is finite.  degc_per_count: the thermometer's quantum, as
// declared, above 0.
Renewal thermometer_renewal(const std::vector<double>& t_s, const std::vector<double>& temp_degc,
                            double degc_per_count);

// What the delay may have cost the polynomial, in the unit of coeff: the largest, over the temperatures, of delay x dB/dT x mean
// dT/dt there (ramps up and down at one temperature undo each other).  B(T) = sum coeff_i ((T - t0)/range)^i.
double renewal_cost(const Renewal& renewal, const std::vector<double>& t_s, const std::vector<double>& temp_degc,
                    const std::vector<double>& coeff, double t0_degc, double range_degc);

// In words: what was seen and what it may cost an axis, against its predicted error.
std::string renewal_text(const Renewal& renewal, double cost, double predicted, const std::string& unit);

} // namespace imucal
