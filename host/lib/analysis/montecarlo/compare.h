// SPDX-License-Identifier: MIT
// Methods of calibration side by side on the same simulated tests: the C core's Kalman filter, least squares
// over all seconds, and two ways of hobby autopilots (methods.h), on several temperature profiles and
// thermometers. All methods see the same 1-s means; the Kalman filter with a coarse thermometer sees tracked
// temperatures (common/track.h), the others the reading, as they would on their boards.
#pragma once
#include <functional>
#include <string>
#include <vector>

#include "analysis/montecarlo/campaign.h"
#include "analysis/montecarlo/methods.h"

namespace imucal {

struct Scenario {
  std::string name;
  Profile profile;
  double temp_lsb_degc = 0.01, temp_noise_degc = 0.02;
};

// Ramp, ramp with soaks, freezer warm-up, up and down; each with a fine and with a 1-degC thermometer.
std::vector<Scenario> standard_scenarios();

struct MethodScore {
  Method method = Method::kKalman;
  std::string thermometer_use;       // "tracked", "reading"
  std::vector<double> sigma_dph;     // rms error over runs at each temperature
  double worst_dph = 0, rms_dph = 0; // of sigma_dph
  double rms_std_error_dph = 0;      // sampling error of rms_dph
  double part_fitted = 0;            // of the runs in which the method determined the polynomial
};

struct Comparison {
  Scenario scenario;
  size_t duration_s = 0;
  std::vector<double> temp_degc;
  std::vector<MethodScore> methods;
};

// base: model, order, seed, runs, threads, raw rate; its profile and thermometer are the scenario's.
Comparison compare_methods(const CampaignOptions& base, const Scenario& scenario, const std::function<bool()>& stop);

Json to_json(const std::vector<Comparison>& all, const CampaignOptions& base);
std::string to_text(const std::vector<Comparison>& all, const CampaignOptions& base);

} // namespace imucal
