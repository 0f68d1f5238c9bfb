// SPDX-License-Identifier: MIT
#include "sensor.h"

#define READ_BIT 0x80u

/* ---- clock ---- */

void imucal_sensor_clock_init(imucal_sensor_clock_t* clock, uint32_t period_us_q8) {
  *clock = (imucal_sensor_clock_t){0};
  clock->nominal_q16_us = (int64_t)period_us_q8 << 8;
  clock->period_q16_us = clock->nominal_q16_us;
}

static int64_t divide_rounded(int64_t value, int64_t by) {
  return (value >= 0 ? value + by / 2 : value - by / 2) / by;
}

/* More than a tenth off its nominal rate is no sensor clock: data sheets allow 1 to 8 %. */
static void limit_period(imucal_sensor_clock_t* clock) {
  const int64_t slack = clock->nominal_q16_us / 10;
  if (clock->period_q16_us > clock->nominal_q16_us + slack) clock->period_q16_us = clock->nominal_q16_us + slack;
  if (clock->period_q16_us < clock->nominal_q16_us - slack) clock->period_q16_us = clock->nominal_q16_us - slack;
}

static void anchor(imucal_sensor_clock_t* clock, int64_t seen_q16) {
  clock->newest_q16_us = seen_q16;
  clock->n_bursts = 1;
}

static void correct(imucal_sensor_clock_t* clock, int64_t error, uint32_t n) {
  if (clock->n_bursts < IMUCAL_SENSOR_CLOCK_MEMORY) clock->n_bursts++;
  const int64_t k = clock->n_bursts;
  int64_t step = divide_rounded(error * 2 * (2 * k - 1), k * (k + 1));
  if (step < -clock->period_q16_us / 2) step = -clock->period_q16_us / 2;
  clock->newest_q16_us += step;
  if (n > 0) clock->period_q16_us += divide_rounded(error * 6, k * (k + 1) * n);
  limit_period(clock);
}

uint32_t imucal_sensor_clock_burst(imucal_sensor_clock_t* clock, uint64_t now_us, uint32_t n, bool is_overrun) {
  if (n == 0 && !is_overrun) return 0;
  const int64_t seen = ((int64_t)now_us << 16) - clock->period_q16_us / 2;
  const bool is_first = clock->newest_q16_us == 0;
  const bool is_broken = clock->n_bursts == 0 || is_overrun;
  const int64_t elapsed = divide_rounded(seen - clock->newest_q16_us, clock->period_q16_us);
  const uint32_t lost = !is_first && is_broken && elapsed > (int64_t)n ? (uint32_t)(elapsed - (int64_t)n) : 0;
  if (clock->n_bursts == 0) {
    anchor(clock, seen);
    return lost;
  }
  clock->newest_q16_us += (int64_t)(n + lost) * clock->period_q16_us;
  const int64_t error = seen - clock->newest_q16_us;
  /* Two periods, and what the largest clock error can add before the line knows the period. */
  const int64_t limit = 2 * clock->period_q16_us + (int64_t)(n + lost) * clock->period_q16_us / 10;
  if (error > limit || error < -limit) {
    clock->n_resyncs++;
    anchor(clock, seen);
  } else {
    correct(clock, error, n + lost);
  }
  return lost;
}

uint64_t imucal_sensor_clock_time_us(imucal_sensor_clock_t* clock, uint32_t age) {
  int64_t t_us = (clock->newest_q16_us - (int64_t)age * clock->period_q16_us) >> 16;
  if (t_us <= clock->last_handed_us) t_us = clock->last_handed_us + 1;
  clock->last_handed_us = t_us;
  return (uint64_t)t_us;
}

void imucal_sensor_clock_break(imucal_sensor_clock_t* clock) {
  clock->n_bursts = 0;
}

float imucal_sensor_clock_drift_ppm(const imucal_sensor_clock_t* clock) {
  const int64_t off = clock->nominal_q16_us - clock->period_q16_us;
  return (float)off / (float)clock->period_q16_us * 1e6f;
}

/* ---- words that stand still ---- */

static uint32_t count_same(bool is_same, uint32_t n) {
  return is_same && n < 0xFFFFFFFFu ? n + 1 : is_same ? n : 0;
}

void imucal_sensor_watch(imucal_sensor_watch_t* watch, imucal_sensor_counts_t* counts, imucal_sample_t* sample) {
  uint32_t sum = 2166136261u; /* FNV-1a over the words: two different samples in a row with one hash are harmless */
  for (uint32_t i = 0; i < sample->n_channels; i++) sum = (sum ^ (uint32_t)sample->counts[i]) * 16777619u;
  watch->n_same_temp = count_same(sample->temp_counts == watch->temp, watch->n_same_temp);
  watch->n_same = count_same((int32_t)sum == watch->sum, watch->n_same);
  watch->temp = sample->temp_counts;
  watch->sum = (int32_t)sum;
  const bool is_temp_stuck = watch->limit_temp && watch->n_same_temp >= watch->limit_temp;
  const bool is_stuck = watch->limit && watch->n_same >= watch->limit;
  if (is_temp_stuck && !watch->is_temp_stuck) counts->n_stuck_temp++;
  if (is_stuck && !watch->is_stuck) counts->n_stuck_data++;
  watch->is_temp_stuck = is_temp_stuck;
  watch->is_stuck = is_stuck;
  if (is_temp_stuck || is_stuck) sample->fault = (uint8_t)((1u << sample->n_channels) - 1);
}

void imucal_sensor_mark_rails(const imucal_sensor_units_t* units, imucal_sensor_counts_t* counts,
                              imucal_sample_t* sample) {
  for (uint32_t i = 0; i < sample->n_channels; i++) {
    const int32_t rail = i < 3 ? units->gyro_rail_counts : units->accel_rail_counts;
    if (sample->counts[i] >= rail || sample->counts[i] <= -rail)
      sample->saturated = (uint8_t)(sample->saturated | 1u << i);
  }
  if (sample->saturated) counts->n_saturated++;
}

bool imucal_sensor_is_silent(uint64_t alive_us, uint64_t now_us, uint32_t rate_hz) {
  return now_us - alive_us > 20000u + 50u * 1000000u / rate_hz;
}

/* ---- registers ---- */

imucal_status imucal_sensor_read_regs(const imucal_sensor_bus_t* bus, imucal_sensor_counts_t* counts, uint8_t device,
                                      uint8_t reg, uint8_t* data, size_t n) {
  const uint8_t out = (uint8_t)(bus->is_spi ? reg | READ_BIT : reg);
  const imucal_status status = bus->transfer(bus->ctx, device, &out, 1, data, n);
  if (status != IMUCAL_OK) counts->n_bus_errors++;
  return status;
}

imucal_status imucal_sensor_write_reg(const imucal_sensor_bus_t* bus, imucal_sensor_counts_t* counts, uint8_t device,
                                      uint8_t reg, uint8_t value) {
  const uint8_t out[2] = {reg, value};
  const imucal_status status = bus->transfer(bus->ctx, device, out, 2, NULL, 0);
  if (status != IMUCAL_OK) counts->n_bus_errors++;
  return status;
}

imucal_status imucal_sensor_write_settings(const imucal_sensor_bus_t* bus, imucal_sensor_counts_t* counts,
                                           uint8_t device, const imucal_sensor_setting_t* settings, size_t n) {
  for (size_t i = 0; i < n; i++) {
    const imucal_status status = imucal_sensor_write_reg(bus, counts, device, settings[i].reg, settings[i].value);
    if (status != IMUCAL_OK) return status;
  }
  const imucal_status status = imucal_sensor_check_settings(bus, counts, device, settings, n);
  return status == IMUCAL_ERR_STATE ? IMUCAL_ERR_SENSOR : status;
}

imucal_status imucal_sensor_check_settings(const imucal_sensor_bus_t* bus, imucal_sensor_counts_t* counts,
                                           uint8_t device, const imucal_sensor_setting_t* settings, size_t n) {
  for (size_t i = 0; i < n; i++) {
    uint8_t value = 0;
    const imucal_status status = imucal_sensor_read_regs(bus, counts, device, settings[i].reg, &value, 1);
    if (status != IMUCAL_OK) return status;
    if (value != settings[i].value) return IMUCAL_ERR_STATE;
  }
  return IMUCAL_OK;
}

void imucal_sensor_count_identity(imucal_sensor_counts_t* counts, uint8_t found) {
  if (imucal_sensor_is_flat(&found, 1))
    counts->n_bus_errors++;
  else
    counts->n_identity++;
}

imucal_status imucal_sensor_identify(const imucal_sensor_bus_t* bus, imucal_sensor_counts_t* counts, uint8_t device,
                                     uint8_t reg, uint8_t expected, uint8_t* found) {
  imucal_status status = IMUCAL_ERR_SENSOR;
  for (uint32_t i = 0; i < 3; i++) {
    if (i > 0) bus->delay_us(bus->ctx, 10000);
    *found = 0;
    status = imucal_sensor_read_regs(bus, counts, device, reg, found, 1);
    if (status == IMUCAL_OK && *found == expected) return IMUCAL_OK;
  }
  if (status != IMUCAL_OK) return status;
  imucal_sensor_count_identity(counts, *found);
  return IMUCAL_ERR_SENSOR;
}

int32_t imucal_sensor_be16(const uint8_t* bytes) {
  return (int16_t)((uint16_t)bytes[0] << 8 | bytes[1]);
}

int32_t imucal_sensor_le16(const uint8_t* bytes) {
  return (int16_t)((uint16_t)bytes[1] << 8 | bytes[0]);
}

bool imucal_sensor_is_flat(const uint8_t* bytes, size_t n) {
  if (n == 0 || (bytes[0] != 0x00 && bytes[0] != 0xFF)) return false;
  for (size_t i = 1; i < n; i++)
    if (bytes[i] != bytes[0]) return false;
  return true;
}

void imucal_sensor_judge(imucal_sensor_self_test_t* test) {
  test->failed = 0;
  for (uint32_t i = 0; i < IMUCAL_MAX_CHANNELS; i++)
    if (!(test->response[i] >= test->low[i] && test->response[i] <= test->high[i]))
      test->failed = (uint8_t)(test->failed | 1u << i);
}
