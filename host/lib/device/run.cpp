// SPDX-License-Identifier: MIT
#include "device/run.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <limits>
#include <memory>

#include "analysis/fit/expected.h"
#include "analysis/fit/fit.h"
#include "base/axis_unit.h"
#include "base/clock.h"
#include "base/error.h"
#include "base/progress.h"
#include "base/repeats.h"
#include "device/recorder.h"
#include "device/watch.h"
#include "io/log.h"
#include "io/notice.h"
#include "io/table_json.h"

namespace imucal {

namespace {

constexpr double kTravelPerOrder_degc = 1.0;          // least movement of the temperature per order of the polynomial
constexpr double kTravelOfRange = 0.25;               // and least part of the range asked for
constexpr double kRangeSlack = 0.02;                  // part of the range that need not be reached at either end
constexpr TemperatureRange kWidestRange{-40.0, 85.0}; // where nothing says what range is meant
constexpr double kManyGaps = 0.1;                     // part of the seconds

std::string text_of(double value, int digits = 1) {
  char text[40];
  std::snprintf(text, sizeof text, "%.*f", digits, value);
  return text;
}

std::string text_of(const TemperatureRange& range) {
  return text_of(range.lo_degc) + " to " + text_of(range.hi_degc) + " degC";
}

// The channels to calibrate.
std::vector<size_t> chosen_channels(const Device& device, const RunOptions& options) {
  std::vector<size_t> chosen;
  const size_t n = device.channels().size();
  for (const std::string& axis : options.axes) {
    size_t i = 0;
    while (i < n && device.channel_name(i) != axis) ++i;
    if (i == n) {
      std::string known;
      for (size_t k = 0; k < n; ++k) known += (k ? " " : "") + device.channel_name(k);
      throw usage_error("axis '" + axis + "': the device has " + known);
    }
    if (std::find(chosen.begin(), chosen.end(), i) != chosen.end())
      throw usage_error("axis '" + axis + "' is given twice: name it once");
    chosen.push_back(i);
  }
  const bool wants_accel = options.models.size() == 1 && options.models.front().unit == "mg";
  if (options.axes.empty())
    for (size_t i = 0; i < n; ++i)
      if (options.models.size() == n || is_accelerometer(device.channel_name(i)) == wants_accel) chosen.push_back(i);
  if (chosen.empty())
    throw usage_error(std::string("the device has no ") + (wants_accel ? "accelerometer" : "gyro") +
                      "; name the axes to calibrate with --axis");
  if (options.models.size() != 1 && options.models.size() != chosen.size())
    throw usage_error(std::to_string(options.models.size()) + " models for " + std::to_string(chosen.size()) +
                      " axes: give one for all, or one per axis");
  return chosen;
}

// The range to learn over; false: nobody said, so the widest is taken and the table made of what was seen.
bool find_range(const RunOptions& options, TemperatureRange* range) {
  if (options.range) {
    *range = *options.range;
  } else if (options.profile) {
    *range = {options.profile->min_degc(), options.profile->max_degc()};
  } else if (const auto& bias = options.models.front().bias) {
    *range = {bias->t0_degc - bias->range_degc, bias->t0_degc + bias->range_degc};
  } else {
    *range = kWidestRange;
    return false;
  }
  return true;
}

// why: what is known of its cause.
void refuse_small_travel(const TemperatureRange& moved, unsigned order, const std::optional<TemperatureRange>& wanted,
                         const std::string& whose, const std::string& why = "") {
  double needed = kTravelPerOrder_degc * order;
  if (wanted) needed = std::max(needed, kTravelOfRange * wanted->width());
  if (moved.width() >= needed) return;
  throw data_error(why + (why.empty() ? "" : "; ") + whose + " moved only from " + text_of(moved.lo_degc, 2) + " to " +
                   text_of(moved.hi_degc, 2) + " degC: a polynomial of order " + std::to_string(order) +
                   (wanted ? " over " + text_of(*wanted) : std::string()) + " needs at least " + text_of(needed) +
                   " degC of travel; use a profile that covers the range" +
                   (wanted ? ", or name a smaller one with --range" : ""));
}

// Everything of one run.
class Run {
public:
  Run(Device* device, const RunOptions& options) : device_(*device), options_(options) {}
  RunResult go();

private:
  struct Axis {
    size_t channel;
    const ErrorModel* model;
    imucal_link_cal_start_t start;
    std::vector<float> rate; // usable seconds
    std::vector<float> temp_degc;
    size_t n_lossy; // of them, with samples missing
  };

  void prepare();
  void listen();
  void check_sensor();
  void take(uint8_t id, const imucal_link_any_t& record);
  void take(const SecondRecord& second);
  bool is_at_end();
  void show(bool is_last);
  void close_logs();
  void count_samples();
  void finish();
  void require_seconds();
  void see_span();
  AxisResult learned(const Axis& axis);
  double residual_rms(const Axis& axis, const AxisResult& learned) const;
  FitAxis as_fit(const AxisResult& axis) const;
  void see_renewal(const Renewal& renewal, FitAxis* fit);
  void judge();
  void try_to_flash();
  void flash();
  imucal_table_t table_made_here(bool is_for_flash);
  void check_read_back();
  TemperatureRange table_span() const;

  Device& device_;
  const RunOptions& options_;
  RunResult result_;
  std::vector<Axis> axes_;
  TemperatureRange range_;
  bool is_range_known_ = false;
  double total_s_ = 0; // 0: unknown
  std::unique_ptr<LogRecorder> raw_log_, compensated_log_;

  // the state of listening
  std::optional<Watch> watch_;
  std::optional<SensorWatch> sensor_;
  bool is_given_up_ = false; // the device is well, its sensor is not
  std::optional<imucal_link_samples_reply_t> samples_before_;
  std::vector<double> record_t_s_, record_temp_degc_; // of the seconds that were no gaps
  uint32_t told_trouble_ = 0;                         // IMUCAL_SENSOR_* that a note speaks of
  double start_s_ = 0, last_shown_s_ = 0;
  uint32_t t_s_ = 0;
  double temp_degc_ = 0, worst_sigma_ = std::numeric_limits<double>::infinity();
};

void Run::prepare() {
  if (options_.profile)
    refuse_small_travel({options_.profile->min_degc(), options_.profile->max_degc()}, options_.order, options_.range,
                        "the profile");
  is_range_known_ = find_range(options_, &range_);
  if (range_.width() <= 0)
    throw usage_error("temperature range " + text_of(range_) + " is reversed or empty; give --range LOW:HIGH");
  if (!is_range_known_ && options_.until_error > 0)
    throw usage_error("--until-error needs to know over which temperatures: give --range LOW:HIGH or --profile");
  total_s_ = options_.duration_s > 0 ? options_.duration_s : options_.profile ? options_.profile->duration_s() : 0;
  const std::vector<size_t> channels = chosen_channels(device_, options_);
  for (size_t i = 0; i < channels.size(); ++i) {
    const ErrorModel& model = options_.models.size() > 1 ? options_.models[i] : options_.models.front();
    model.require_unit_of(device_.channel_name(channels[i]));
    Axis axis{channels[i],
              &model,
              cal_start_of(model, options_.order, (range_.lo_degc + range_.hi_degc) / 2, range_.width() / 2, range_,
                           options_.prior_sigma),
              {},
              {},
              0};
    axis.start.channel = static_cast<uint8_t>(channels[i]);
    axes_.push_back(axis);
  }
  sensor_.emplace(static_cast<double>(device_.hello().rate_hz),
                  static_cast<double>(device_.channels().front().degc_per_count), channels);
  raw_log_ =
      std::make_unique<LogRecorder>(options_.record_path, device_, LogRecorder::What::kRaw, options_.may_overwrite);
  compensated_log_ = std::make_unique<LogRecorder>(options_.record_compensated_path, device_,
                                                   LogRecorder::What::kCompensated, options_.may_overwrite);
}

void Run::take(const SecondRecord& second) {
  if (result_.seconds == 0) result_.seen = {second.temp_degc, second.temp_degc};
  ++result_.seconds;
  t_s_ = second.t_s;
  temp_degc_ = static_cast<double>(second.temp_degc);
  raw_log_->add(second);
  compensated_log_->add(second);
  sensor_->add(second);
  if (second.is_gap) {
    ++result_.gaps;
    return;
  }
  record_t_s_.push_back(second.t_s);
  record_temp_degc_.push_back(temp_degc_);
  result_.seen.lo_degc = std::min(result_.seen.lo_degc, temp_degc_);
  result_.seen.hi_degc = std::max(result_.seen.hi_degc, temp_degc_);
  for (Axis& axis : axes_) {
    if (second.flags[axis.channel] & (kSaturated | kSensorFault)) continue;
    axis.rate.push_back(second.raw[axis.channel]);
    axis.temp_degc.push_back(second.temp_degc);
    axis.n_lossy += (second.flags[axis.channel] & kSamplesMissing) != 0;
  }
}

void Run::take(uint8_t id, const imucal_link_any_t& record) {
  watch_->saw(id, record);
  if (id == IMUCAL_LINK_ID_SECOND) {
    take(record.second);
  } else if (id == IMUCAL_LINK_ID_PROGRESS) {
    worst_sigma_ = 0;
    for (const Axis& axis : axes_)
      worst_sigma_ = std::max(worst_sigma_, static_cast<double>(record.progress.worst_sigma[axis.channel]));
  } else if (id == IMUCAL_LINK_ID_EVENT && record.event.code == IMUCAL_EVENT_SENSOR_FAULT) {
    result_.notes.push_back("at " + std::to_string(t_s_) + " s the sensor reported a fault (channel bits " +
                            std::to_string(record.event.detail) + ")");
  } else if (id == IMUCAL_LINK_ID_EVENT && record.event.code == IMUCAL_EVENT_SENSOR_COUNTED) {
    sensor_->told(record.event.detail);
    const uint32_t untold = record.event.detail & ~told_trouble_; // each once: calibrate info has the counts
    told_trouble_ |= untold;
    if (untold) result_.notes.push_back("from " + std::to_string(t_s_) + " s: " + sensor_trouble(untold));
  }
}

bool Run::is_at_end() {
  if (interrupted()) {
    result_.end = RunResult::End::kInterrupted;
  } else if (options_.until_error > 0 && worst_sigma_ > 0 && worst_sigma_ <= options_.until_error) {
    result_.end = RunResult::End::kErrorReached;
  } else if (watch_->has_sensor_ended()) {
    result_.end = RunResult::End::kSensorEnded;
  } else if (total_s_ > 0 && watch_->elapsed_s() >= total_s_) {
    result_.end = RunResult::End::kDuration;
  } else {
    return false;
  }
  return true;
}

void Run::show(bool is_last) {
  if (options_.quiet || !::isatty(STDERR_FILENO)) return;
  const double now = now_s();
  if (!is_last && now - last_shown_s_ < 0.1) return;
  last_shown_s_ = now;
  const double done_s = watch_->elapsed_s();
  std::string line = "\r\033[K" + text_of(done_s, 0) + " s";
  if (total_s_ > 0) line += " of " + text_of(total_s_, 0) + " s";
  line += "  " + text_of(temp_degc_, 2) + " degC";
  if (is_range_known_ && std::isfinite(worst_sigma_))
    line += "  predicted worst error " + text_of(worst_sigma_, 2) + " " +
            axis_unit(device_.channel_name(axes_.front().channel));
  if (device_.statistics().lost_records > 0)
    line += "  " + std::to_string(device_.statistics().lost_records) + " records lost";
  if (total_s_ > 0 && done_s > 0)
    line += "  " + text_of((now - start_s_) * std::max(0.0, total_s_ - done_s) / done_s, 0) + " s left";
  std::fprintf(stderr, "%s%s", line.c_str(), is_last ? "\n" : "");
  std::fflush(stderr);
}

// A sensor of which nothing can come ends the run now and not in the end.
void Run::check_sensor() {
  if (const std::string warning = sensor_->new_rate_warning(); !warning.empty()) {
    if (!options_.quiet) notice(warning); // now, while a restart costs nothing
    result_.notes.push_back(warning);
  }
  is_given_up_ = true; // where one of these throws
  sensor_->require_rate(device_.port());
  sensor_->require_usable(device_.port(), options_.faulty_s);
  is_given_up_ = false;
}

void Run::listen() {
  device_.stream(0, 0, 1); // what a former program left running
  samples_before_ = device_.samples();
  start_s_ = now_s();
  watch_.emplace(&device_, options_.stall_s);
  device_.on_stream([this](uint8_t id, const imucal_link_any_t& record) { take(id, record); });
  for (const Axis& axis : axes_) device_.cal_start(axis.start);
  (void)device_.health(axes_.front().start.channel); // firmware that cannot judge says so now and not in the end
  watch_.emplace(&device_, options_.stall_s);
  device_.stream(IMUCAL_STREAM_SECOND | IMUCAL_STREAM_PROGRESS | IMUCAL_STREAM_EVENT, 0, 20);
  while (!is_at_end()) {
    device_.poll(0.2);
    show(false);
    watch_->check();
    check_sensor();
  }
  show(true);
  device_.cal_stop(IMUCAL_STOP_KEEP);
  device_.stream(0, 0, 1);
  device_.on_stream({});
}

TemperatureRange Run::table_span() const {
  const double slack = is_range_known_ ? kRangeSlack * range_.width() : 0;
  TemperatureRange span = range_;
  if (result_.seen.lo_degc > range_.lo_degc + slack) span.lo_degc = result_.seen.lo_degc;
  if (result_.seen.hi_degc < range_.hi_degc - slack) span.hi_degc = result_.seen.hi_degc;
  return span;
}

// Of the device's filters, read bit for bit, but valid only where the temperature has been.  Not for the flash: an axis of
// which nothing can be made stays uncalibrated.
imucal_table_t Run::table_made_here(bool is_for_flash) {
  const TemperatureRange span = table_span();
  imucal_table_t table{};
  std::copy_n(device_.hello().serial, sizeof table.serial, table.serial);
  table.sequence = 1; // the device gives the next one
  table.created_s = static_cast<uint32_t>(std::time(nullptr));
  table.n_channels = device_.hello().n_channels;
  table.degc_per_count = device_.channels().front().degc_per_count;
  table.degc_at_zero = device_.channels().front().degc_at_zero;
  for (size_t i = 0; i < table.n_channels; ++i) {
    imucal_table_channel_t& channel = table.channel[i];
    std::copy_n(device_.channels()[i].name, sizeof channel.name, channel.name);
    channel.unit_per_count = device_.channels()[i].unit_per_count;
    channel.full_scale_counts = device_.channels()[i].full_scale_counts;
    channel.t0_degc = static_cast<float>((span.lo_degc + span.hi_degc) / 2);
    channel.range_degc = static_cast<float>(span.width() / 2 * 1.0001);
    channel.span_lo_degc = static_cast<float>(span.lo_degc);
    channel.span_hi_degc = static_cast<float>(span.hi_degc);
  }
  for (size_t k = 0; k < axes_.size(); ++k) {
    const Axis& axis = axes_[k];
    imucal_table_channel_t& channel = table.channel[axis.channel];
    const imucal_status status = imucal_table_from_kf(
        &channel, &result_.axes[k].filter, static_cast<float>(span.lo_degc), static_cast<float>(span.hi_degc));
    if (status != IMUCAL_OK && !is_for_flash) {
      channel.order = 0;
      continue;
    }
    if (status != IMUCAL_OK) throw data_error(result_.axes[k].name + ": no table: " + imucal_status_text(status));
    channel.arw = axis.start.arw;
    channel.n_markov = axis.start.n_markov;
    std::copy_n(axis.start.markov_sigma, IMUCAL_TABLE_MARKOV_N, channel.markov_sigma);
    std::copy_n(axis.start.markov_tau_s, IMUCAL_TABLE_MARKOV_N, channel.markov_tau_s);
  }
  return table;
}

void Run::check_read_back() {
  result_.table = table_from_bytes(device_.read_table(), device_.port());
  for (const AxisResult& axis : result_.axes) {
    const imucal_table_channel_t& channel = result_.table.channel[axis.channel];
    bool is_same = channel.order == axis.state.order;
    for (size_t i = 0; i < IMUCAL_MAX_COEFF; ++i) is_same = is_same && channel.coeff[i] == axis.state.coeff[i];
    if (!is_same)
      throw device_error(device_.port() + ": " + axis.name +
                         ": the table read back from flash is not what the filter "
                         "learned; do not use it (calibrate rollback returns to the one before)");
  }
}

void Run::require_seconds() {
  if (result_.seconds == 0)
    throw device_error(device_.port() + ": no second came from the device; nothing to learn from");
  if (result_.gaps <= kManyGaps * result_.seconds) return;
  const std::string text = text_of(result_.gaps, 0) + " of " + text_of(result_.seconds, 0) +
                           " seconds held fewer than half of the samples the device expects (" +
                           text_of(static_cast<double>(device_.hello().rate_hz), 0) +
                           " per second) and were not used; check the sensor or its nominal rate";
  if (result_.gaps == result_.seconds) throw device_error(device_.port() + ": " + text);
  result_.notes.push_back(text);
}

// What the device saw robustly, for any axis: one bad second of the thermometer widens nothing.
void Run::see_span() {
  bool is_first = true;
  for (const AxisResult& axis : result_.axes) {
    if (!axis.health.has_span) continue;
    const TemperatureRange seen{static_cast<double>(axis.health.span_lo_degc),
                                static_cast<double>(axis.health.span_hi_degc)};
    result_.seen = is_first ? seen
                            : TemperatureRange{std::min(seen.lo_degc, result_.seen.lo_degc),
                                               std::max(seen.hi_degc, result_.seen.hi_degc)};
    is_first = false;
  }
}

// Seconds that the device left out were not learnt and are no residuals of the polynomial; which they were it does not
// say, but they are the largest.
double Run::residual_rms(const Axis& axis, const AxisResult& learned) const {
  ThermalPolynomial polynomial;
  polynomial.t0_degc = static_cast<double>(axis.start.t0_degc);
  polynomial.range_degc = static_cast<double>(axis.start.range_degc);
  polynomial.coeff_dph.assign(learned.state.coeff, learned.state.coeff + axis.start.order + 1);
  std::vector<double> squares;
  for (size_t k = 0; k < axis.rate.size(); ++k) {
    const double residual = static_cast<double>(axis.rate[k]) - polynomial.at(static_cast<double>(axis.temp_degc[k]));
    squares.push_back(residual * residual);
  }
  std::sort(squares.begin(), squares.end());
  const size_t left_out = learned.health.n_rejected + learned.health.n_spikes;
  squares.resize(squares.size() - std::min(squares.size(), left_out));
  double sum = 0;
  for (const double square : squares) sum += square;
  return squares.empty() ? 0 : std::sqrt(sum / static_cast<double>(squares.size()));
}

AxisResult Run::learned(const Axis& axis) {
  AxisResult result;
  result.channel = axis.channel;
  result.name = device_.channel_name(axis.channel);
  result.state = device_.cal_state(static_cast<uint8_t>(axis.channel));
  result.health = device_.health(static_cast<uint8_t>(axis.channel));
  result.filter = kf_from_device(axis.start, device_.cal_filter(static_cast<uint8_t>(axis.channel)), result.state);
  result.residual_rms = residual_rms(axis, result);
  return result;
}

// As the rules want it.  Where nobody said for which temperatures the table shall be, none of them is missed.
FitAxis Run::as_fit(const AxisResult& axis) const {
  FitAxis fit;
  fit.axis = axis.name;
  fit.t0_degc = static_cast<double>(axis.filter.config.t0_degc);
  fit.range_degc = static_cast<double>(axis.filter.config.range_degc);
  fit.coeff_dph.assign(axis.state.coeff, axis.state.coeff + axis.state.order + 1);
  fit.residual_rms_dph = axis.residual_rms;
  fit.n_used = static_cast<long>(axis.state.n);
  fit.error_factor = static_cast<double>(axis.health.error_factor);
  fit.health.bits = axis.health.bits;
  fit.health.judged = axis.health.judged;
  if (!is_range_known_) fit.health.bits &= ~(1U << IMUCAL_HEALTH_SPAN | 1U << IMUCAL_HEALTH_TEMP_RAMP);
  const size_t n_rules = std::min<size_t>(axis.health.n_rules, IMUCAL_HEALTH_N_RULES);
  std::copy_n(axis.health.value, n_rules, fit.health.value);
  std::copy_n(axis.health.limit, n_rules, fit.health.limit);
  const TemperatureRange span = table_span();
  for (int i = 0; i < IMUCAL_TABLE_SIGMA_N; ++i) {
    fit.temp_degc.push_back(span.lo_degc + span.width() * i / (IMUCAL_TABLE_SIGMA_N - 1));
    fit.sigma_dph.push_back(
        static_cast<double>(imucal_kf_bias_sigma(&axis.filter, static_cast<float>(fit.temp_degc.back()))));
  }
  return fit;
}

// A thermometer that is renewed seldom: what its delay may have cost, said where no rule says it.
void Run::see_renewal(const Renewal& renewal, FitAxis* fit) {
  if (renewal.every_s <= 0) return;
  fit->renewal = renewal;
  fit->renewal_cost_dph =
      renewal_cost(renewal, record_t_s_, record_temp_degc_, fit->coeff_dph, fit->t0_degc, fit->range_degc);
  if (const std::string note = fit->renewal_note(); !note.empty()) result_.notes.push_back(note);
}

void Run::judge() {
  std::vector<FitAxis> axes;
  std::vector<const ErrorModel*> models;
  const Renewal renewal = thermometer_renewal(record_t_s_, record_temp_degc_,
                                              static_cast<double>(device_.channels().front().degc_per_count));
  for (size_t i = 0; i < axes_.size(); ++i) {
    axes.push_back(as_fit(result_.axes[i]));
    axes.back().lossy_frac =
        static_cast<double>(axes_[i].n_lossy) / std::max(1.0, static_cast<double>(axes_[i].rate.size()));
    axes.back().repeated_frac = repeated_share({axes_[i].rate.begin(), axes_[i].rate.end()});
    see_renewal(renewal, &axes.back());
    if (const ErrorModel* model = axes_[i].model; model && model->markov.size() > 1)
      judge_by_expected(expected_innovations(result_.axes[i].filter.config, noise_of(*model), 1.0), axes.back().n_used,
                        &axes.back());
    result_.axes[i].error_factor = axes.back().error_factor;
    models.push_back(axes_[i].model);
  }
  result_.reasons = judge_axes(axes, models, 1.0, options_.judge);
}

// What was learnt is on this machine by now: a flash that fails, or a device that is gone, costs the flashing alone.
void Run::try_to_flash() {
  const imucal_table_t made = table_made_here(true);
  try {
    flash();
  } catch (const Error& e) {
    if (e.exit() != Exit::kDevice) throw;
    result_.flash_error = e.what();
    result_.table = made;
    result_.is_flashed = result_.is_device_made = false;
  }
}

void Run::flash() {
  const TemperatureRange span = table_span();
  result_.is_device_made = span.lo_degc == range_.lo_degc && span.hi_degc == range_.hi_degc;
  if (result_.is_device_made) {
    device_.table_from_cal(static_cast<uint32_t>(std::time(nullptr)));
  } else {
    if (is_range_known_)
      result_.notes.push_back("the temperature covered " + text_of(result_.seen) + " of " + text_of(range_) +
                              ": the table is valid from " + text_of(span));
    device_.write_table(table_bytes(table_made_here(true), device_.port()));
  }
  result_.is_flashed = true;
  check_read_back();
}

void Run::finish() {
  require_seconds();
  for (const Axis& axis : axes_) result_.axes.push_back(learned(axis));
  see_span();
  refuse_small_travel(result_.seen, options_.order,
                      is_range_known_ ? std::optional<TemperatureRange>(range_) : std::nullopt, "the temperature",
                      sensor_->standing_text());
  judge();
  if (is_accepted(result_.reasons))
    try_to_flash();
  else
    result_.table = table_made_here(false);
  if (result_.flash_error.empty()) device_.cal_stop(IMUCAL_STOP_DISCARD); // else its filters stay, and it may be gone
}

// What cannot be written costs the log and not the calibration.
void Run::close_logs() {
  for (LogRecorder* log : {raw_log_.get(), compensated_log_.get()}) {
    try {
      log->close();
    } catch (const Error& e) {
      result_.record_error += (result_.record_error.empty() ? "" : "; ") + std::string(e.what());
    }
  }
}

void Run::count_samples() {
  const std::optional<imucal_link_samples_reply_t> now = device_.samples();
  if (samples_before_ && now) result_.samples = samples_between(*samples_before_, *now);
}

RunResult Run::go() {
  (void)interrupted(); // from here on Ctrl-C ends the run in order
  prepare();
  try {
    listen();
    close_logs();
    count_samples();
    if (result_.end != RunResult::End::kInterrupted || options_.keep_partial)
      finish();
    else
      device_.cal_stop(IMUCAL_STOP_DISCARD);
  } catch (const Error& e) {
    if (!options_.quiet)
      for (const std::string& note : result_.notes) notice(note); // nobody else will say what the device told
    // the device is fine: leave it idle
    const bool is_sensors_fault = is_given_up_ || (watch_ && watch_->is_sensor_silent());
    if (e.exit() != Exit::kDevice || is_sensors_fault) device_.cal_stop(IMUCAL_STOP_DISCARD);
    throw;
  }
  if (options_.until_error > 0) result_.is_error_reached = result_.end == RunResult::End::kErrorReached;
  return result_;
}

} // namespace

imucal_link_samples_reply_t samples_between(const imucal_link_samples_reply_t& before,
                                            const imucal_link_samples_reply_t& after) {
  imucal_link_samples_reply_t n = after;
  n.samples -= before.samples;
  n.summed -= before.summed;
  n.duplicates -= before.duplicates;
  n.behind -= before.behind;
  n.ahead -= before.ahead;
  n.refused -= before.refused;
  n.unreadable -= before.unreadable;
  n.clock_set -= before.clock_set;
  n.clock_wrapped -= before.clock_wrapped;
  n.jumps -= before.jumps;
  n.seconds -= before.seconds;
  n.gaps -= before.gaps;
  return n;
}

imucal_link_cal_start_t cal_start_of(const ErrorModel& model, unsigned order, double t0_degc, double range_degc,
                                     const TemperatureRange& span, double prior_sigma) {
  const imucal_kf_config_t config = kf_config(model, static_cast<int>(order), t0_degc, range_degc, prior_sigma);
  imucal_link_cal_start_t start{};
  start.order = config.order;
  start.t0_degc = config.t0_degc;
  start.range_degc = config.range_degc;
  start.m = config.m;
  start.q = config.q;
  start.r = config.r;
  start.markov_variance = config.markov_variance;
  start.prior_sigma = config.prior_sigma;
  start.span_lo_degc = static_cast<float>(span.lo_degc);
  start.span_hi_degc = static_cast<float>(span.hi_degc);
  start.arw = static_cast<float>(model.arw_deg_rt_h);
  start.n_markov = static_cast<uint8_t>(std::min<size_t>(model.markov.size(), IMUCAL_TABLE_MARKOV_N));
  for (size_t i = 0; i < start.n_markov; ++i) {
    start.markov_sigma[i] = static_cast<float>(model.markov[i].sigma_dph);
    start.markov_tau_s[i] = static_cast<float>(model.markov[i].tau_s);
  }
  return start;
}

imucal_kf_config_t kf_config_of(const imucal_link_cal_start_t& start) {
  imucal_kf_config_t config{};
  config.order = start.order;
  config.t0_degc = start.t0_degc;
  config.range_degc = start.range_degc;
  config.m = start.m;
  config.q = start.q;
  config.r = start.r;
  config.markov_variance = start.markov_variance;
  config.prior_sigma = start.prior_sigma;
  return config;
}

imucal_kf_t kf_from_device(const imucal_link_cal_start_t& start, const imucal_link_cal_filter_reply_t& bits,
                           const imucal_link_cal_state_reply_t& state) {
  const imucal_kf_config_t config = kf_config_of(start);
  imucal_kf_t kf{};
  if (const imucal_status status = imucal_kf_init(&kf, &config); status != IMUCAL_OK)
    throw data_error(std::string("filter of the device: ") + imucal_status_text(status));
  imucal_kf_state_t numbers;
  static_assert(sizeof numbers.x == sizeof bits.x && sizeof numbers.u == sizeof bits.u,
                "the link carries the whole filter");
  std::memcpy(numbers.x, bits.x, sizeof numbers.x);
  std::memcpy(numbers.x_lo, bits.x_lo, sizeof numbers.x_lo);
  std::memcpy(numbers.d, bits.d, sizeof numbers.d);
  std::memcpy(numbers.d_lo, bits.d_lo, sizeof numbers.d_lo);
  std::memcpy(numbers.u, bits.u, sizeof numbers.u);
  imucal_kf_set_state(&kf, &numbers);
  kf.stats.n = state.n;
  return kf;
}

const char* end_text(RunResult::End end) {
  switch (end) {
  case RunResult::End::kSensorEnded:
    return "the sensor's data ended";
  case RunResult::End::kDuration:
    return "the duration is over";
  case RunResult::End::kErrorReached:
    return "the predicted error is reached";
  default:
    return "interrupted";
  }
}

RunResult run_calibration(Device* device, const RunOptions& options) {
  return Run(device, options).go();
}

} // namespace imucal
