// SPDX-License-Identifier: MIT
// What is wrong, or odd, with the logs and the noise that were given: refused with the remedy, or told as a warning.
#pragma once
#include <string>
#include <vector>

#include "analysis/diagnose/logs/campaign.h"
#include "analysis/diagnose/logs/thermometer_noise.h"
#include "analysis/diagnose/result.h"
#include "io/log.h"
#include "io/model.h"
#include "noise/noise_model.h"

namespace imucal {

// data_error: no log, a record given twice or in parts, fitted logs with and without temperatures, steps that differ.  Told: other
// devices, columns that some lack, logs that are too short.
void check_logs(const std::vector<Log>& logs, const std::vector<Log>& held_out, const ErrorModel& model,
                std::vector<std::string>* warnings);
// data_error: in all logs an axis, one of these that stands before it, has the same rates.
void require_own_channel(const std::vector<Log>& logs, const std::vector<std::string>& axes, const std::string& axis);
// data_error: no log of this axis can be used.
void require_runs(const Campaign& campaign, const std::vector<Log>& logs);
// data_error: a held-out log without temperatures.
void require_temperature(const Campaign& unseen, const std::vector<Log>& held_out);

// The noise of the logs is of another size than that of the model.
void check_scale(const Campaign& campaign, const NoiseModel& noise, std::vector<std::string>* warnings);
// It is not what the data sheet says.
void tell_data_sheet(const std::string& axis, const NoiseModel& sheet, const NoiseModel& fitted,
                     std::vector<std::string>* warnings);
// The rates move as those of a device that is turned.
void check_rest(const Campaign& campaign, std::vector<std::string>* warnings);
// The temperature does not move.
void check_steady(const Campaign& campaign, std::vector<std::string>* warnings);
// Readings of the thermometer that are repeated, or wrong; pauses that the recorder hid.
void tell_impossible(const Campaign& campaign, const std::vector<Log>& logs, std::vector<std::string>* warnings);
// The thermometer was stuck, or may have stopped; held-out logs go beyond the temperatures of the fitted ones.
void tell_stuck(const Campaign& campaign, const std::vector<Log>& logs, std::vector<std::string>* warnings);
void tell_frozen(const Campaign& campaign, const std::vector<Log>& logs, std::vector<std::string>* warnings);
void tell_beyond(const Campaign& fitted, const Campaign& unseen, const std::vector<Log>& logs,
                 std::vector<std::string>* warnings);
// The rates do without the noise of the thermometer.
void tell_thermometer_noise(const std::string& axis, const ThermometerNoise& noise, std::vector<std::string>* warnings);
// Logs of which the axis has no run; no held-out log can be used.
void tell_left_out(const Campaign& campaign, const std::vector<Log>& logs, AxisResult* axis);
void tell_held_out(const Campaign& unseen, const std::vector<Log>& held_out, AxisResult* axis);

} // namespace imucal
