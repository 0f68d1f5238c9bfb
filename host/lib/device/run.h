// SPDX-License-Identifier: MIT
// A calibration run: the device's Kalman filters learn the thermal polynomials while the temperature goes
// through a profile; then every axis is judged, the device makes a table, flashes it, and what it flashed is read back
// and compared.
//
// The filter's parameters are computed on the host, in double, because the device has no exponential (analysis/fit/fit.h:
// kf_config); a model of several Markov terms becomes one of the same variance and the same slow density there.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "analysis/fit/fit.h"
#include "analysis/fit/judge.h"
#include "base/error.h"
#include "base/range.h"
#include "device/device.h"
#include "device/sensor_watch.h"
#include "io/model.h"
#include "io/profile.h"
#include "kf.h"

namespace imucal {

struct RunOptions {
  unsigned order = 3;
  std::vector<ErrorModel> models;        // one for all axes, or one per axis
  std::vector<std::string> axes;         // names; empty: all gyros (or, with one model per channel, all channels)
  std::optional<TemperatureRange> range; // where the table shall be valid
  std::optional<Profile> profile;        // gives range and duration where they are not given
  double until_error = 0;                // end when the predicted worst one-sigma error is below; 0: not
  double duration_s = 0;                 // of sensor time; 0: until the sensor ends or Ctrl-C
  double stall_s = 0;                    // the device answers but no second comes for so long: error; 0: see watch.h
  double faulty_s = kFaultyPatience_s;   // no axis has a second to learn from for so long: error
  JudgeOptions judge;                    // what is accepted, and the largest predicted error
  bool keep_partial = false;             // Ctrl-C: make a table of what is there
  double prior_sigma = kPriorSigma;
  std::string record_path, record_compensated_path;
  bool may_overwrite = false; // of these
  bool quiet = false;
};

struct AxisResult {
  size_t channel = 0;
  std::string name;
  imucal_link_cal_state_reply_t state{};
  imucal_kf_t filter{}; // the device's, bit for bit: predicts the error at any temperature
  imucal_link_health_reply_t health{};
  double residual_rms = 0; // of the seconds seen against the polynomial learned, without as many as the device left out
  double error_factor = 1; // how many times the predicted error is too small by what was seen, against the whole model
};

struct RunResult {
  enum class End { kSensorEnded, kDuration, kErrorReached, kInterrupted };
  End end = End::kInterrupted;
  bool is_error_reached = true; // false: --until-error was asked for and not met
  std::vector<AxisResult> axes;
  bool is_flashed = false; // false: interrupted, not accepted or flash_error; the device keeps the table it had
  // Why the flash did not take what was learnt and accepted: `table` is good and is nowhere else.  Empty: it did.
  std::string flash_error;
  std::vector<FitReason> reasons; // what speaks against it
  imucal_table_t table{};      // as read back from the device; not flashed: as it would be (no axes where interrupted)
  bool is_device_made = false; // false: the host made it of the device's filters, for a narrower span
  TemperatureRange seen;
  double seconds = 0;                                 // seconds received
  double gaps = 0;                                    // of them with too few samples
  std::optional<imucal_link_samples_reply_t> samples; // what became of the samples of this run; absent: older firmware
  std::string record_error;                           // a log that could not be written to its end; empty: all well
  std::vector<std::string> notes;                     // what the user should know
};

// The filter parameters of a channel.  data_error: a model the filter cannot work with.
imucal_link_cal_start_t cal_start_of(const ErrorModel& model, unsigned order, double t0_degc, double range_degc,
                                     const TemperatureRange& span, double prior_sigma);
imucal_kf_config_t kf_config_of(const imucal_link_cal_start_t& start);

// The device's filter on the host, bit for bit; of its statistics only n.
imucal_kf_t kf_from_device(const imucal_link_cal_start_t& start, const imucal_link_cal_filter_reply_t& bits,
                           const imucal_link_cal_state_reply_t& state);

// The difference of two counts of the device.
imucal_link_samples_reply_t samples_between(const imucal_link_samples_reply_t& before,
                                            const imucal_link_samples_reply_t& after);

// Runs it: learns, judges (analysis/fit/judge.h, with what the device found), and flashes where nothing speaks against it or
// all was accepted.  A log that cannot be written does not end the run.  usage_error, data_error (a profile that does not move),
// device_error as the messages say; a flash that fails at the end is no exception but flash_error, for the result is there;
// whenever it throws, the device keeps the table it had, and what it told until then has been said (io/notice.h).
RunResult run_calibration(Device* device, const RunOptions& options);

// Names of RunResult::End for people and for JSON.
const char* end_text(RunResult::End end);

} // namespace imucal
