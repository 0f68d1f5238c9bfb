// SPDX-License-Identifier: MIT
// The effects of the library, one accessor per file of this folder; library.cpp puts them in order.
#pragma once
#include "physics/effects/effect.h"

namespace imucal {

const Effect* temperature_rate_effect();
const Effect* thermal_hysteresis_effect();
const Effect* thermal_lag_effect();
const Effect* thermal_anomaly_effect();
const Effect* higher_order_polynomial_effect();
const Effect* rate_ramp_effect();
const Effect* warm_up_effect();
const Effect* sinusoid_effect();
const Effect* bias_step_effect();
const Effect* run_to_run_effect();
const Effect* temperature_sensor_quantization_effect();
const Effect* noise_parameters_effect();
const Effect* second_markov_effect();
const Effect* rate_random_walk_effect();
const Effect* flicker_noise_effect();
const Effect* white_noise_vs_temperature_effect();
const Effect* markov_sigma_vs_temperature_effect();
const Effect* markov_tau_vs_temperature_effect();
const Effect* outliers_effect();
const Effect* telegraph_noise_effect();
const Effect* quantization_effect();
const Effect* saturation_effect();
const Effect* dead_band_effect();
const Effect* held_samples_effect();
const Effect* common_mode_effect();
const Effect* auxiliary_channel_effect();

} // namespace imucal
