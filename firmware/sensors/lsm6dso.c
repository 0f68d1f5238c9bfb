// SPDX-License-Identifier: MIT
#include "lsm6dso.h"

/* DS12140, section 8 (table of registers) and 9. */
enum {
  FIFO_CTRL3 = 0x09,
  FIFO_CTRL4 = 0x0A,
  WHO_AM_I = 0x0F,
  CTRL1_XL = 0x10,
  CTRL2_G = 0x11,
  CTRL3_C = 0x12,
  CTRL4_C = 0x13,
  CTRL5_C = 0x14,
  CTRL6_C = 0x15,
  CTRL9_XL = 0x18,
  OUT_TEMP_L = 0x20,
  OUTX_L_G = 0x22,
  FIFO_STATUS1 = 0x3A,
  INTERNAL_FREQ_FINE = 0x63,
  FIFO_DATA_OUT_TAG = 0x78
};
enum {
  IDENTITY = 0x6C,
  SW_RESET = 0x01,        /* CTRL3_C */
  BDU_IF_INC = 0x44,      /* CTRL3_C: no half-new words, addresses count up */
  I2C_OFF = 0x04,         /* CTRL4_C */
  LPF1_ON = 0x02,         /* CTRL4_C */
  I3C_OFF = 0xE2,         /* CTRL9_XL: reset E0h and bit 1 */
  FIFO_CONTINUOUS = 0x06, /* FIFO_CTRL4: the oldest words are overwritten; no temperature, no time stamps */
  OVERRUN = 0x48,         /* FIFO_STATUS2: FIFO_OVR_IA, FIFO_OVR_LATCHED */
  LEVEL_HIGH = 0x03,      /* FIFO_STATUS2: DIFF_FIFO 9:8 */
  TAG_GYRO = 1,           /* FIFO_DATA_OUT_TAG bits 7:3; bits 2:1 count the time slots, bit 0 makes the parity even */
  TAG_ACCEL = 2,
  TAG_SLOT = 0x06,
  WORD_BYTES = 7,
  FIFO_WORDS = 512,
  RAIL = 32767,
  SELF_TEST_BOTH = 0x05 /* CTRL5_C: both positive */
};
#define START_US 90000u   /* gyro turn-on 70 ms, table 3 */
#define STEP_US_Q8 38400u /* 150 us: 6667 Hz */

/* ---- configuration ---- */

/* Code of the output data rate, and the period 150 us * 2^(10 - code); 0: not one of them. */
static uint8_t odr_code(uint32_t rate_hz) {
  static const uint16_t rates[] = {26, 52, 104, 208, 417, 833, 1667};
  for (uint8_t i = 0; i < sizeof rates / sizeof rates[0]; i++)
    if (rates[i] == rate_hz) return (uint8_t)(i + 2);
  return 0;
}

/* FS_XL, register 10h: 2, 16, 4, 8 g in this order. */
static uint8_t accel_code(uint32_t range_g) {
  return range_g == 2 ? 0 : range_g == 4 ? 2 : range_g == 8 ? 3 : range_g == 16 ? 1 : 0xFF;
}

imucal_sensor_units_t imucal_lsm6dso_units(const imucal_lsm6dso_config_t* config) {
  return (imucal_sensor_units_t){.dps_per_count = 0.00875f * (float)(1u << config->gyro_fs_sel),
                                 .g_per_count = 0.000061f * (float)config->accel_range_g / 2.0f,
                                 .degc_per_count = 1.0f / 256.0f, /* table 4: 256 LSB/degC, 0 at 25 degC */
                                 .degc_at_zero = 25.0f,
                                 .gyro_rail_counts = RAIL,
                                 .accel_rail_counts = RAIL};
}

#define N_SETTINGS 7
static void make_settings(const imucal_lsm6dso_t* sensor, imucal_sensor_setting_t settings[N_SETTINGS]) {
  const imucal_lsm6dso_config_t* config = &sensor->config;
  const uint8_t odr = odr_code(config->rate_hz);
  const imucal_sensor_setting_t wanted[N_SETTINGS] = {
      {CTRL3_C, BDU_IF_INC},
      {CTRL9_XL, I3C_OFF},
      {CTRL4_C, (uint8_t)((sensor->bus->is_spi ? I2C_OFF : 0) | (config->filter ? LPF1_ON : 0))},
      {CTRL6_C, (uint8_t)(config->filter ? config->filter - 1 : 0)},
      {FIFO_CTRL3, (uint8_t)(odr << 4 | odr)},
      {CTRL1_XL, (uint8_t)(odr << 4 | accel_code(config->accel_range_g) << 2)},
      {CTRL2_G, (uint8_t)(odr << 4 | config->gyro_fs_sel << 2)},
  };
  for (size_t i = 0; i < N_SETTINGS; i++) settings[i] = wanted[i];
}

static imucal_status read_regs(imucal_lsm6dso_t* sensor, uint8_t reg, uint8_t* data, size_t n) {
  return imucal_sensor_read_regs(sensor->bus, &sensor->counts, 0, reg, data, n);
}

static imucal_status write_reg(imucal_lsm6dso_t* sensor, uint8_t reg, uint8_t value) {
  return imucal_sensor_write_reg(sensor->bus, &sensor->counts, 0, reg, value);
}

static void delay(imucal_lsm6dso_t* sensor, uint32_t us) {
  sensor->bus->delay_us(sensor->bus->ctx, us);
}

/* ---- start ---- */

static imucal_status configure(imucal_lsm6dso_t* sensor) {
  imucal_sensor_setting_t settings[N_SETTINGS];
  make_settings(sensor, settings);
  sensor->has_half = false;
  sensor->n_in_fifo = 0;
  imucal_status status = imucal_sensor_identify(sensor->bus, &sensor->counts, 0, WHO_AM_I, IDENTITY, &sensor->identity);
  if (status == IMUCAL_OK) status = write_reg(sensor, CTRL3_C, SW_RESET);
  delay(sensor, 10000);
  if (status == IMUCAL_OK) status = imucal_sensor_write_settings(sensor->bus, &sensor->counts, 0, settings, N_SETTINGS);
  if (status != IMUCAL_OK) return status;
  delay(sensor, START_US);
  return write_reg(sensor, FIFO_CTRL4, FIFO_CONTINUOUS); /* from bypass: it begins empty */
}

imucal_status imucal_lsm6dso_start(imucal_lsm6dso_t* sensor, const imucal_sensor_bus_t* bus,
                                   const imucal_lsm6dso_config_t* config) {
  *sensor = (imucal_lsm6dso_t){.bus = bus, .config = *config};
  const uint8_t odr = odr_code(config->rate_hz);
  if (odr == 0 || config->gyro_fs_sel > 3 || accel_code(config->accel_range_g) > 3 || config->filter > 8)
    return IMUCAL_ERR_ARGUMENT;
  imucal_sensor_clock_init(&sensor->clock, STEP_US_Q8 << (10 - odr));
  sensor->watch.limit = config->rate_hz;
  sensor->watch.limit_temp = 60u * config->rate_hz;
  imucal_status status = configure(sensor);
  uint8_t fine = 0;
  if (status == IMUCAL_OK) status = read_regs(sensor, INTERNAL_FREQ_FINE, &fine, 1);
  /* Register 63h: the rate is 0.15 % higher for each step. */
  if (status == IMUCAL_OK)
    sensor->clock.period_q16_us -= sensor->clock.nominal_q16_us * (int8_t)fine * 15 / (10000 + 15 * (int8_t)fine);
  return status;
}

/* ---- words ---- */

static bool has_even_parity(uint8_t tag) {
  uint8_t x = (uint8_t)(tag ^ tag >> 4);
  x = (uint8_t)(x ^ x >> 2);
  return !((x ^ x >> 1) & 1);
}

static void keep_half(imucal_lsm6dso_t* sensor, const uint8_t* word) {
  for (uint32_t i = 0; i < 6; i++) sensor->half[i] = word[1 + i];
  sensor->tag = word[0];
  sensor->has_half = true;
}

static void make_sample(imucal_lsm6dso_t* sensor, const uint8_t* gyro, const uint8_t* accel, imucal_sample_t* sample) {
  *sample = (imucal_sample_t){.n_channels = 6, .temp_counts = sensor->temp_counts};
  for (uint32_t axis = 0; axis < 3; axis++) {
    sample->counts[axis] = imucal_sensor_le16(gyro + 2 * axis);
    sample->counts[3 + axis] = imucal_sensor_le16(accel + 2 * axis);
  }
  const imucal_sensor_units_t units = imucal_lsm6dso_units(&sensor->config);
  imucal_sensor_mark_rails(&units, &sensor->counts, sample);
  imucal_sensor_watch(&sensor->watch, &sensor->counts, sample);
}

/* Gyro and accelerometer words of one time slot make a sample, whichever comes first: the data sheet does not say; the tag
 * tells them apart.  True: *sample is set but for its time. */
static bool take_word(imucal_lsm6dso_t* sensor, const uint8_t* word, imucal_sample_t* sample) {
  const uint8_t kind = word[0] >> 3;
  if (!has_even_parity(word[0]) || (kind != TAG_GYRO && kind != TAG_ACCEL)) {
    sensor->counts.n_invalid++;
    sensor->has_half = false;
    return false;
  }
  const bool is_pair = sensor->has_half && sensor->tag >> 3 != kind && !((sensor->tag ^ word[0]) & TAG_SLOT);
  if (!is_pair) {
    if (sensor->has_half) sensor->counts.n_invalid++; /* its other word never came */
    keep_half(sensor, word);
    return false;
  }
  sensor->has_half = false;
  if (kind == TAG_ACCEL)
    make_sample(sensor, sensor->half, word + 1, sample);
  else
    make_sample(sensor, word + 1, sensor->half, sample);
  return true;
}

/* ---- read ---- */

static imucal_status look_after(imucal_lsm6dso_t* sensor, uint64_t now_us) {
  uint8_t found = 0;
  imucal_status status = imucal_sensor_identify(sensor->bus, &sensor->counts, 0, WHO_AM_I, IDENTITY, &found);
  if (status != IMUCAL_OK) return status;
  imucal_sensor_setting_t settings[N_SETTINGS];
  make_settings(sensor, settings);
  status = imucal_sensor_check_settings(sensor->bus, &sensor->counts, 0, settings, N_SETTINGS);
  const imucal_sensor_setting_t fifo = {FIFO_CTRL4, FIFO_CONTINUOUS}; /* written apart, after the others */
  if (status == IMUCAL_OK) status = imucal_sensor_check_settings(sensor->bus, &sensor->counts, 0, &fifo, 1);
  if (status == IMUCAL_OK) return IMUCAL_ERR_SENSOR; /* all in order, but no samples: not to be trusted */
  if (status != IMUCAL_ERR_STATE) return status;
  sensor->counts.n_resets++;
  imucal_sensor_clock_break(&sensor->clock);
  status = configure(sensor);
  if (status == IMUCAL_OK) sensor->alive_us = now_us;
  return status;
}

static imucal_status read_level(imucal_lsm6dso_t* sensor, uint32_t* n_words, bool* is_full) {
  uint8_t bytes[2], temp[2];
  imucal_status status = read_regs(sensor, FIFO_STATUS1, bytes, 2);
  if (status == IMUCAL_OK) status = read_regs(sensor, OUT_TEMP_L, temp, 2);
  if (status != IMUCAL_OK) return status;
  *n_words = (uint32_t)bytes[0] | (uint32_t)(bytes[1] & LEVEL_HIGH) << 8;
  if (*n_words > FIFO_WORDS) { /* 1023 on a stuck bus */
    sensor->counts.n_bus_errors++;
    return IMUCAL_ERR_SENSOR;
  }
  *is_full = bytes[1] & OVERRUN;
  sensor->temp_counts = imucal_sensor_le16(temp);
  return IMUCAL_OK;
}

static imucal_status take_burst(imucal_lsm6dso_t* sensor, uint32_t n_words, imucal_sample_t* samples, uint32_t capacity,
                                uint32_t* n) {
  uint8_t bytes[IMUCAL_SENSOR_BURST_BYTES];
  const uint32_t most = IMUCAL_SENSOR_BURST_BYTES / WORD_BYTES;
  uint32_t left = n_words, m = 2 * capacity - (sensor->has_half ? 1u : 0u);
  if (m > left) m = left;
  if (m > most) m = most;
  const imucal_status status = read_regs(sensor, FIFO_DATA_OUT_TAG, bytes, m * WORD_BYTES);
  if (status != IMUCAL_OK) return status;
  for (uint32_t i = 0; i < m; i++) {
    left--;
    imucal_sample_t* sample = samples + *n;
    if (!take_word(sensor, bytes + i * WORD_BYTES, sample)) continue;
    sample->t_us = imucal_sensor_clock_time_us(&sensor->clock, left / 2);
    sensor->counts.n_samples++;
    (*n)++;
  }
  sensor->n_in_fifo = (left + (sensor->has_half ? 1u : 0u)) / 2;
  return IMUCAL_OK;
}

imucal_status imucal_lsm6dso_read(imucal_lsm6dso_t* sensor, uint64_t now_us, imucal_sample_t* samples,
                                  uint32_t capacity, uint32_t* n) {
  *n = 0;
  if (sensor->alive_us == 0) sensor->alive_us = now_us;
  uint32_t n_words = 0;
  bool is_full = false;
  imucal_status status = read_level(sensor, &n_words, &is_full);
  if (status != IMUCAL_OK) return status;
  if (is_full) {
    sensor->counts.n_overruns++;
    sensor->has_half = false;
  }
  const uint32_t level = (n_words + (sensor->has_half ? 1u : 0u)) / 2; /* whole samples */
  const uint32_t n_new = level > sensor->n_in_fifo ? level - sensor->n_in_fifo : 0;
  sensor->counts.n_lost += imucal_sensor_clock_burst(&sensor->clock, now_us, n_new, is_full);
  if (n_words > 0 && capacity > 0) status = take_burst(sensor, n_words, samples, capacity, n);
  if (*n > 0) sensor->alive_us = now_us;
  if (status == IMUCAL_OK && imucal_sensor_is_silent(sensor->alive_us, now_us, sensor->config.rate_hz))
    return look_after(sensor, now_us);
  return status;
}

/* ---- self-test ---- */

#define SELF_TEST_SAMPLES 20

static imucal_status mean_of_registers(imucal_lsm6dso_t* sensor, float mean[6]) {
  int32_t sum[6] = {0};
  for (uint32_t k = 0; k < SELF_TEST_SAMPLES; k++) {
    uint8_t bytes[12];
    delay(sensor, 5000);
    const imucal_status status = read_regs(sensor, OUTX_L_G, bytes, sizeof bytes);
    if (status != IMUCAL_OK) return status;
    for (uint32_t i = 0; i < 6; i++) sum[i] += imucal_sensor_le16(bytes + 2 * i);
  }
  for (uint32_t i = 0; i < 6; i++) mean[i] = (float)sum[i] / (float)SELF_TEST_SAMPLES;
  return IMUCAL_OK;
}

imucal_status imucal_lsm6dso_self_test(imucal_lsm6dso_t* sensor, imucal_sensor_self_test_t* test) {
  static const imucal_lsm6dso_config_t settings = {.rate_hz = 208, .gyro_fs_sel = 3, .accel_range_g = 4};
  const imucal_lsm6dso_config_t wanted = sensor->config;
  const imucal_sensor_units_t units = imucal_lsm6dso_units(&settings);
  float quiet[6] = {0};
  *test = (imucal_sensor_self_test_t){.failed = 0x3F};
  sensor->config = settings;
  imucal_status status = configure(sensor);
  if (status == IMUCAL_OK) status = mean_of_registers(sensor, quiet);
  if (status == IMUCAL_OK) status = write_reg(sensor, CTRL5_C, SELF_TEST_BOTH);
  delay(sensor, 100000);
  if (status == IMUCAL_OK) status = mean_of_registers(sensor, test->response);
  for (uint32_t i = 0; i < 6 && status == IMUCAL_OK; i++) {
    const float change = (test->response[i] - quiet[i]) * (i < 3 ? units.dps_per_count : units.g_per_count);
    test->response[i] = change < 0 ? -change : change;
    test->low[i] = i < 3 ? 150.0f : 0.05f;
    test->high[i] = i < 3 ? 700.0f : 1.7f;
  }
  if (status == IMUCAL_OK) imucal_sensor_judge(test);
  sensor->config = wanted;
  imucal_sensor_clock_break(&sensor->clock);
  const imucal_status again = configure(sensor);
  return status != IMUCAL_OK ? status : again;
}

/* ---- as a value ---- */

static imucal_status start_any(void* sensor, const imucal_sensor_bus_t* bus, const void* config) {
  return imucal_lsm6dso_start(sensor, bus, config);
}

static imucal_status read_any(void* sensor, uint64_t now_us, imucal_sample_t* samples, uint32_t capacity, uint32_t* n) {
  return imucal_lsm6dso_read(sensor, now_us, samples, capacity, n);
}

const imucal_sensor_driver_t imucal_lsm6dso_driver = {.name = "lsm6dso",
                                                      .start = start_any,
                                                      .read = read_any,
                                                      .counts_at = offsetof(imucal_lsm6dso_t, counts),
                                                      .clock_at = offsetof(imucal_lsm6dso_t, clock),
                                                      .identity_at = offsetof(imucal_lsm6dso_t, identity)};
