// SPDX-License-Identifier: MIT
// What the profiles of the logs can tell at all, whatever the data say: smallest detectable effects, pairs
// that look alike, and a profile that would tell them apart.
#pragma once
#include <string>
#include <vector>

#include "analysis/diagnose/evidence/fit.h"
#include "io/profile.h"

namespace imucal {

struct Detectability {
  std::string name;
  std::string column;             // the auxiliary column that the effect follows; empty: none
  double column_range = 0;        // by how much block means of it move within a log, at most
  bool is_column_thermal = false; // it would be seen, but for moving as temperature and its powers do
  Parameters smallest_detectable; // parameters of the effect at detection strength d = 5
  double smallest = 0;            // its amplitude (thermal_lag: tau)
  bool is_notable = true;         // small enough: an effect worth seeing would be seen
};

// Two effects that look alike at twice their smallest detectable size.
struct Alike {
  std::string first, second;
  double told_from = 0; // how many times that size has to be until one is told from the other; may be infinite
};

struct Identifiability {
  std::vector<Detectability> effects; // one per effect; per column of the log where it follows one
  std::vector<Alike> indistinguishable;
};

// `beta`: coefficients of the polynomial x, x^2, … [dph]: a lag shows only where B(T) has a slope.
Identifiability identify(const Campaign& campaign, const Hypothesis& nominal, const std::vector<const Effect*>& library,
                         const std::vector<bool>& active, const std::vector<double>& beta);

// The separating staircase for a temperature range: up fast with soaks, down slowly with
// soaks.
Profile separating_profile(double lo_degc, double hi_degc);
// The same the other way: the hottest temperature for the coldest, a fall for every rise.
Profile mirrored(Profile profile, double lo_degc, double hi_degc);

// What `n_runs` of that profile, every other one mirrored, would be in the place of `campaign`: its settings and step, no rates.
Campaign advised_campaign(const Campaign& campaign, size_t n_runs);

} // namespace imucal
