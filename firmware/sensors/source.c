// SPDX-License-Identifier: MIT
#include "source.h"

#define DPH_PER_DPS 3600.0f
#define MG_PER_G 1000.0f
#define RETRY_US 1000000u
#define FAILING_POLL_US 50000u /* a driver that looks after a silent sensor waits for it: not at every poll */

static const imucal_sensor_counts_t* counts_of(const imucal_source_t* source) {
  return (const void*)((const uint8_t*)source->sensor + source->driver->counts_at);
}

static imucal_sensor_clock_t* clock_of(const imucal_source_t* source) {
  return (void*)((uint8_t*)source->sensor + source->driver->clock_at);
}

static void keep_counts(imucal_sensor_counts_t* past, const imucal_sensor_counts_t* counts) {
  past->n_samples += counts->n_samples;
  past->n_saturated += counts->n_saturated;
  past->n_bus_errors += counts->n_bus_errors;
  past->n_overruns += counts->n_overruns;
  past->n_lost += counts->n_lost;
  past->n_invalid += counts->n_invalid;
  past->n_resets += counts->n_resets;
  past->n_stuck_temp += counts->n_stuck_temp;
  past->n_stuck_data += counts->n_stuck_data;
  past->n_identity += counts->n_identity;
}

/* The clock goes on over a start: the next burst tells how many samples the failure cost, and time does not run back. */
static void start(imucal_source_t* source, uint64_t now_us) {
  const imucal_sensor_clock_t clock = *clock_of(source);
  if (source->n_starts > 0) keep_counts(&source->past, counts_of(source));
  source->status = source->driver->start(source->sensor, source->bus, source->config);
  source->is_running = source->status == IMUCAL_OK;
  source->retry_us = now_us + RETRY_US;
  if (source->n_starts > 0 && clock.newest_q16_us != 0) {
    *clock_of(source) = clock;
    imucal_sensor_clock_break(clock_of(source));
  }
  source->n_starts++;
}

void imucal_source_init(imucal_source_t* source, const imucal_sensor_driver_t* driver, void* sensor, const void* config,
                        const imucal_sensor_bus_t* bus, uint32_t poll_us, uint64_t now_us) {
  source->driver = driver;
  source->bus = bus;
  source->config = config;
  source->sensor = sensor;
  source->poll_us = poll_us;
  source->capacity = IMUCAL_SOURCE_BURST;
  source->due_us = now_us;
  source->past = (imucal_sensor_counts_t){0};
  source->n_starts = source->at = source->n = 0;
  start(source, now_us);
}

/* A read that fails is tried again: the driver knows best what a sensor needs that was away for a moment.  One that was full
 * is followed by the next at once: a FIFO that fills faster than one read a poll would be lost. */
static void read_when_due(imucal_source_t* source, uint64_t now_us) {
  if (!source->is_running || now_us < source->due_us) return;
  const bool was_good = source->status == IMUCAL_OK;
  source->at = 0;
  source->status = source->driver->read(source->sensor, now_us, source->burst, source->capacity, &source->n);
  const bool is_good = source->status == IMUCAL_OK;
  source->due_us = now_us;
  if (is_good && source->n == source->capacity) return;
  source->due_us += is_good || source->poll_us > FAILING_POLL_US ? source->poll_us : FAILING_POLL_US;
  if (was_good && !is_good) source->retry_us = now_us + RETRY_US;
}

imucal_port_sample_t imucal_source_read(imucal_source_t* source, uint64_t now_us, imucal_sample_t* sample) {
  if (source->at == source->n) read_when_due(source, now_us);
  if (source->at < source->n) {
    *sample = source->burst[source->at++];
    return IMUCAL_PORT_SAMPLE;
  }
  if (source->status == IMUCAL_OK || now_us < source->retry_us) return IMUCAL_PORT_NO_SAMPLE;
  start(source, now_us);
  return IMUCAL_PORT_BAD_SAMPLE;
}

void imucal_board_from_sensor(imucal_board_t* board, const imucal_sensor_units_t* units, uint32_t rate_hz) {
  board->n_channels = 6;
  board->rate_hz = rate_hz;
  board->degc_per_count = units->degc_per_count;
  board->degc_at_zero = units->degc_at_zero;
  for (uint32_t i = 0; i < 6; i++) {
    const bool is_gyro = i < 3;
    board->channel[i].unit_per_count = is_gyro ? units->dps_per_count * DPH_PER_DPS : units->g_per_count * MG_PER_G;
    board->channel[i].full_scale_counts = is_gyro ? units->gyro_rail_counts : units->accel_rail_counts;
  }
}

void imucal_source_report(const imucal_source_t* source, imucal_link_sensor_reply_t* report) {
  imucal_sensor_counts_t counts = source->past;
  keep_counts(&counts, counts_of(source));
  report->is_counted = 1;
  for (size_t i = 0; i + 1 < sizeof report->name && source->driver->name[i]; i++)
    report->name[i] = source->driver->name[i];
  report->status = (int16_t)source->status;
  report->identity = *((const uint8_t*)source->sensor + source->driver->identity_at);
  report->starts = source->n_starts;
  report->wrong_identity = counts.n_identity;
  report->bus_errors = counts.n_bus_errors;
  report->overruns = counts.n_overruns;
  report->lost = counts.n_lost;
  report->invalid = counts.n_invalid;
  report->resets = counts.n_resets;
  report->stuck_temp = counts.n_stuck_temp;
  report->stuck_data = counts.n_stuck_data;
  report->saturated = counts.n_saturated;
  report->drift_ppm = imucal_sensor_clock_drift_ppm(clock_of(source));
}
