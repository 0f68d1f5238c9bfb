// SPDX-License-Identifier: MIT
#include "bmi088.h"

enum { ACCEL = 0, GYRO = 1 };
/* BST-BMI088-DS001, 5.3 and 5.5. */
enum {
  ACC_CHIP_ID = 0x00,
  ACC_X_LSB = 0x12,
  ACC_TEMP_MSB = 0x22,
  ACC_CONF = 0x40,
  ACC_RANGE = 0x41,
  ACC_SELF_TEST = 0x6D,
  ACC_PWR_CONF = 0x7C,
  ACC_PWR_CTRL = 0x7D,
  ACC_SOFTRESET = 0x7E,
  GYRO_CHIP_ID = 0x00,
  GYRO_FIFO_STATUS = 0x0E,
  GYRO_RANGE = 0x0F,
  GYRO_BANDWIDTH = 0x10,
  GYRO_SOFTRESET = 0x14,
  GYRO_SELF_TEST = 0x3C,
  GYRO_FIFO_CONFIG_0 = 0x3D,
  GYRO_FIFO_CONFIG_1 = 0x3E,
  GYRO_FIFO_DATA = 0x3F
};
enum {
  ACC_IDENTITY = 0x1E,
  GYRO_IDENTITY = 0x0F,
  RESET_COMMAND = 0xB6,
  ACC_ACTIVE = 0x00,    /* ACC_PWR_CONF; reset 03h: suspended */
  ACC_ON = 0x04,        /* ACC_PWR_CTRL */
  ACC_NORMAL = 0xA0,    /* ACC_CONF: no oversampling; low nibble: rate */
  GYRO_BW_FIXED = 0x80, /* GYRO_BANDWIDTH: bit 7 always reads 1 */
  FIFO_STREAM = 0x80,   /* FIFO_CONFIG_1: the oldest are overwritten */
  FIFO_OVERRUN = 0x80,  /* FIFO_STATUS */
  FIFO_LEVEL = 0x7F,
  FIFO_FRAMES = 100,
  FRAME_BYTES = 6,
  TEMP_INVALID = 0x80, /* ACC_TEMP_MSB */
  SELF_TEST_POSITIVE = 0x0D,
  SELF_TEST_NEGATIVE = 0x09,
  BIST_START = 0x01,
  BIST_READY = 0x02,
  BIST_FAIL = 0x04,
  RAIL = 32767
};
#define RESET_US 30000u     /* gyro 30 ms, accelerometer 1 ms */
#define ACC_POWER_US 50000u /* accelerometer: 50 ms after ACC_PWR_CTRL */
#define CHECK_US 1000000u

/* ---- configuration ---- */

/* GYRO_BANDWIDTH with the wider of the filters; 0xFF: not a rate of this chip. */
static uint8_t bandwidth_code(uint32_t rate_hz) {
  return rate_hz == 2000   ? 1
         : rate_hz == 1000 ? 2
         : rate_hz == 400  ? 3
         : rate_hz == 200  ? 4
         : rate_hz == 100  ? 5
                           : 0xFF;
}

/* Accelerometer: the rate of ACC_CONF at or above the gyro's: 1600, 800, 400, 200, 100 Hz. */
static uint8_t accel_rate_code(uint32_t rate_hz) {
  return rate_hz >= 1000 ? 0x0C : rate_hz >= 400 ? 0x0A : rate_hz >= 200 ? 0x09 : 0x08;
}

imucal_sensor_units_t imucal_bmi088_units(const imucal_bmi088_config_t* config) {
  return (imucal_sensor_units_t){.dps_per_count = 2000.0f / 32768.0f / (float)(1u << config->gyro_fs_sel),
                                 .g_per_count = 3.0f / 32768.0f * (float)(1u << config->accel_fs_sel),
                                 .degc_per_count = 0.125f, /* 5.3.7: 11 bits, 0 at 23 degC */
                                 .degc_at_zero = 23.0f,
                                 .gyro_rail_counts = RAIL,
                                 .accel_rail_counts = RAIL};
}

#define N_ACCEL 4
#define N_GYRO 3
static void make_settings(const imucal_bmi088_config_t* config, imucal_sensor_setting_t accel[N_ACCEL],
                          imucal_sensor_setting_t gyro[N_GYRO]) {
  accel[0] = (imucal_sensor_setting_t){ACC_PWR_CONF, ACC_ACTIVE};
  accel[1] = (imucal_sensor_setting_t){ACC_PWR_CTRL, ACC_ON};
  accel[2] = (imucal_sensor_setting_t){ACC_CONF, (uint8_t)(ACC_NORMAL | accel_rate_code(config->rate_hz))};
  accel[3] = (imucal_sensor_setting_t){ACC_RANGE, config->accel_fs_sel};
  gyro[0] = (imucal_sensor_setting_t){GYRO_RANGE, config->gyro_fs_sel};
  gyro[1] = (imucal_sensor_setting_t){GYRO_BANDWIDTH, (uint8_t)(GYRO_BW_FIXED | bandwidth_code(config->rate_hz))};
  gyro[2] = (imucal_sensor_setting_t){GYRO_FIFO_CONFIG_1, FIFO_STREAM};
}

static imucal_status read_gyro(imucal_bmi088_t* sensor, uint8_t reg, uint8_t* data, size_t n) {
  return imucal_sensor_read_regs(sensor->bus, &sensor->counts, GYRO, reg, data, n);
}

/* The accelerometer's first byte means nothing (section 6.1.2). n <= 8. */
static imucal_status read_accel(imucal_bmi088_t* sensor, uint8_t reg, uint8_t* data, size_t n) {
  uint8_t bytes[9];
  const imucal_status status = imucal_sensor_read_regs(sensor->bus, &sensor->counts, ACCEL, reg, bytes, n + 1);
  for (size_t i = 0; i < n; i++) data[i] = bytes[i + 1];
  return status;
}

static imucal_status write_reg(imucal_bmi088_t* sensor, uint8_t device, uint8_t reg, uint8_t value) {
  return imucal_sensor_write_reg(sensor->bus, &sensor->counts, device, reg, value);
}

static void delay(imucal_bmi088_t* sensor, uint32_t us) {
  sensor->bus->delay_us(sensor->bus->ctx, us);
}

/* IMUCAL_ERR_STATE: a register of either chip is not as it was set. */
static imucal_status check_settings(imucal_bmi088_t* sensor) {
  imucal_sensor_setting_t accel[N_ACCEL], gyro[N_GYRO];
  make_settings(&sensor->config, accel, gyro);
  for (size_t i = 0; i < N_ACCEL; i++) {
    uint8_t value = 0;
    const imucal_status status = read_accel(sensor, accel[i].reg, &value, 1);
    if (status != IMUCAL_OK) return status;
    if (value != accel[i].value) return IMUCAL_ERR_STATE;
  }
  return imucal_sensor_check_settings(sensor->bus, &sensor->counts, GYRO, gyro, N_GYRO);
}

/* ---- start ---- */

static imucal_status identify(imucal_bmi088_t* sensor) {
  imucal_status status =
      imucal_sensor_identify(sensor->bus, &sensor->counts, GYRO, GYRO_CHIP_ID, GYRO_IDENTITY, &sensor->gyro_identity);
  sensor->identity = sensor->gyro_identity;
  if (status == IMUCAL_OK) status = read_accel(sensor, ACC_CHIP_ID, &sensor->accel_identity, 1);
  if (status != IMUCAL_OK) return status;
  if (sensor->accel_identity == ACC_IDENTITY) return IMUCAL_OK;
  sensor->identity = sensor->accel_identity;
  imucal_sensor_count_identity(&sensor->counts, sensor->accel_identity);
  return IMUCAL_ERR_SENSOR;
}

/* A rising edge of its chip select switches the accelerometer from I2C to SPI (section 6.1): a read that is not used. */
static imucal_status reset_both(imucal_bmi088_t* sensor) {
  uint8_t ignored;
  delay(sensor, RESET_US); /* they may have got their supply just now */
  imucal_status status = write_reg(sensor, GYRO, GYRO_SOFTRESET, RESET_COMMAND);
  if (status == IMUCAL_OK) status = read_accel(sensor, ACC_CHIP_ID, &ignored, 1);
  if (status == IMUCAL_OK) status = write_reg(sensor, ACCEL, ACC_SOFTRESET, RESET_COMMAND);
  delay(sensor, RESET_US);
  return status == IMUCAL_OK ? read_accel(sensor, ACC_CHIP_ID, &ignored, 1) : status;
}

static imucal_status configure(imucal_bmi088_t* sensor) {
  imucal_sensor_setting_t accel[N_ACCEL], gyro[N_GYRO];
  make_settings(&sensor->config, accel, gyro);
  sensor->n_in_fifo = 0;
  imucal_status status = reset_both(sensor);
  if (status == IMUCAL_OK) status = identify(sensor);
  for (size_t i = 0; i < N_ACCEL && status == IMUCAL_OK; i++) {
    status = write_reg(sensor, ACCEL, accel[i].reg, accel[i].value);
    delay(sensor, i < 2 ? ACC_POWER_US : 1000u); /* between writes at least 2 us, after power 50 ms */
  }
  if (status == IMUCAL_OK) status = imucal_sensor_write_settings(sensor->bus, &sensor->counts, GYRO, gyro, N_GYRO);
  if (status == IMUCAL_OK) status = check_settings(sensor);
  return status == IMUCAL_ERR_STATE ? IMUCAL_ERR_SENSOR : status;
}

imucal_status imucal_bmi088_start(imucal_bmi088_t* sensor, const imucal_sensor_bus_t* bus,
                                  const imucal_bmi088_config_t* config) {
  *sensor = (imucal_bmi088_t){.bus = bus, .config = *config};
  if (bandwidth_code(config->rate_hz) == 0xFF || config->gyro_fs_sel > 4 || config->accel_fs_sel > 3 || !bus->is_spi)
    return IMUCAL_ERR_ARGUMENT;
  imucal_sensor_clock_init(&sensor->clock, 256u * 1000000u / config->rate_hz);
  sensor->watch.limit = config->rate_hz;
  /* 0.125 degC a count: a good chamber holds that for hours; a day without a step is a stuck register. */
  sensor->watch.limit_temp = 86400u * config->rate_hz;
  return configure(sensor);
}

/* ---- read ---- */

static imucal_status look_after(imucal_bmi088_t* sensor, uint64_t now_us, bool is_silent) {
  imucal_status status = identify(sensor);
  if (status == IMUCAL_OK) status = check_settings(sensor);
  sensor->checked_us = now_us;
  if (status == IMUCAL_OK) return is_silent ? IMUCAL_ERR_SENSOR : IMUCAL_OK;
  if (status != IMUCAL_ERR_STATE) return status;
  sensor->counts.n_resets++;
  imucal_sensor_clock_break(&sensor->clock);
  status = configure(sensor);
  if (status == IMUCAL_OK) sensor->alive_us = now_us;
  return status;
}

/* 5.3.7: 11 bits, two's complement: MSB * 8 + LSB / 32. */
static imucal_status read_accel_words(imucal_bmi088_t* sensor) {
  uint8_t words[6], temp[2];
  imucal_status status = read_accel(sensor, ACC_X_LSB, words, 6);
  if (status == IMUCAL_OK) status = read_accel(sensor, ACC_TEMP_MSB, temp, 2);
  if (status != IMUCAL_OK) return status;
  if (imucal_sensor_is_flat(words, 6)) { /* gravity is never flat */
    sensor->counts.n_bus_errors++;
    return IMUCAL_ERR_SENSOR;
  }
  for (uint32_t i = 0; i < 3; i++) sensor->accel[i] = imucal_sensor_le16(words + 2 * i);
  sensor->is_temp_valid = temp[0] != TEMP_INVALID;
  if (!sensor->is_temp_valid) return IMUCAL_OK;
  const int32_t counts = temp[0] * 8 + temp[1] / 32;
  sensor->temp_counts = counts > 1023 ? counts - 2048 : counts;
  return IMUCAL_OK;
}

static void take_frame(imucal_bmi088_t* sensor, const uint8_t* frame, imucal_sample_t* sample) {
  *sample = (imucal_sample_t){.n_channels = 6, .temp_counts = sensor->temp_counts};
  for (uint32_t i = 0; i < 3; i++) {
    sample->counts[i] = imucal_sensor_le16(frame + 2 * i);
    sample->counts[3 + i] = sensor->accel[i];
  }
  const imucal_sensor_units_t units = imucal_bmi088_units(&sensor->config);
  imucal_sensor_mark_rails(&units, &sensor->counts, sample);
  imucal_sensor_watch(&sensor->watch, &sensor->counts, sample);
  if (!sensor->is_temp_valid) {
    sensor->counts.n_invalid++;
    sample->fault = 0x3F;
  }
}

static imucal_status take_burst(imucal_bmi088_t* sensor, uint32_t level, uint32_t m, imucal_sample_t* samples) {
  uint8_t bytes[IMUCAL_SENSOR_BURST_BYTES];
  imucal_status status = read_accel_words(sensor);
  if (status == IMUCAL_OK) status = read_gyro(sensor, GYRO_FIFO_DATA, bytes, m * FRAME_BYTES);
  if (status != IMUCAL_OK) return status;
  for (uint32_t i = 0; i < m; i++) {
    take_frame(sensor, bytes + i * FRAME_BYTES, samples + i);
    samples[i].t_us = imucal_sensor_clock_time_us(&sensor->clock, level - 1 - i);
  }
  sensor->counts.n_samples += m;
  sensor->n_in_fifo = level - m;
  return IMUCAL_OK;
}

/* A write of FIFO_CONFIG_0 (no watermark, no tags: its reset value) empties the FIFO, one of FIFO_CONFIG_1 clears the
 * overrun flag. */
static imucal_status clear_overrun(imucal_bmi088_t* sensor, uint64_t now_us) {
  sensor->counts.n_overruns++;
  sensor->counts.n_lost += sensor->n_in_fifo + imucal_sensor_clock_burst(&sensor->clock, now_us, 0, true);
  sensor->n_in_fifo = 0;
  const imucal_status status = write_reg(sensor, GYRO, GYRO_FIFO_CONFIG_0, 0);
  return status == IMUCAL_OK ? write_reg(sensor, GYRO, GYRO_FIFO_CONFIG_1, FIFO_STREAM) : status;
}

imucal_status imucal_bmi088_read(imucal_bmi088_t* sensor, uint64_t now_us, imucal_sample_t* samples, uint32_t capacity,
                                 uint32_t* n) {
  *n = 0;
  if (sensor->alive_us == 0) sensor->alive_us = sensor->checked_us = now_us;
  if (now_us - sensor->checked_us > CHECK_US) {
    const imucal_status status = look_after(sensor, now_us, false);
    if (status != IMUCAL_OK) return status;
  }
  uint8_t fifo = 0;
  imucal_status status = read_gyro(sensor, GYRO_FIFO_STATUS, &fifo, 1);
  if (status != IMUCAL_OK) return status;
  const uint32_t level = fifo & FIFO_LEVEL;
  if (level > FIFO_FRAMES) { /* 127 on a stuck bus */
    sensor->counts.n_bus_errors++;
    return IMUCAL_ERR_SENSOR;
  }
  if (fifo & FIFO_OVERRUN) return clear_overrun(sensor, now_us);
  if (level == 0)
    return imucal_sensor_is_silent(sensor->alive_us, now_us, sensor->config.rate_hz) ? look_after(sensor, now_us, true)
                                                                                     : IMUCAL_OK;
  const uint32_t n_new = level > sensor->n_in_fifo ? level - sensor->n_in_fifo : 0;
  sensor->counts.n_lost += imucal_sensor_clock_burst(&sensor->clock, now_us, n_new, false);
  uint32_t m = level < capacity ? level : capacity;
  if (m > IMUCAL_SENSOR_BURST_BYTES / FRAME_BYTES) m = IMUCAL_SENSOR_BURST_BYTES / FRAME_BYTES;
  status = take_burst(sensor, level, m, samples);
  if (status != IMUCAL_OK) return status;
  *n = m;
  sensor->alive_us = now_us;
  return IMUCAL_OK;
}

/* ---- self-test ---- */

static imucal_status deflect(imucal_bmi088_t* sensor, uint8_t how, int32_t words[3]) {
  imucal_status status = write_reg(sensor, ACCEL, ACC_SELF_TEST, how);
  delay(sensor, 60000); /* at least 50 ms */
  if (status == IMUCAL_OK) status = read_accel_words(sensor);
  for (uint32_t i = 0; i < 3; i++) words[i] = sensor->accel[i];
  return status;
}

static imucal_status test_accel(imucal_bmi088_t* sensor, imucal_sensor_self_test_t* test) {
  const imucal_bmi088_config_t range = {.accel_fs_sel = 3};
  const float g_per_count = imucal_bmi088_units(&range).g_per_count;
  int32_t positive[3] = {0}, negative[3] = {0};
  imucal_status status = write_reg(sensor, ACCEL, ACC_RANGE, range.accel_fs_sel);
  if (status == IMUCAL_OK) status = write_reg(sensor, ACCEL, ACC_CONF, ACC_NORMAL | 0x0C); /* 1600 Hz */
  delay(sensor, 3000);
  if (status == IMUCAL_OK) status = deflect(sensor, SELF_TEST_POSITIVE, positive);
  if (status == IMUCAL_OK) status = deflect(sensor, SELF_TEST_NEGATIVE, negative);
  const imucal_status off = write_reg(sensor, ACCEL, ACC_SELF_TEST, 0);
  for (uint32_t i = 0; i < 3 && status == IMUCAL_OK; i++) {
    test->response[3 + i] = (float)(positive[i] - negative[i]) * g_per_count;
    test->low[3 + i] = i < 2 ? 1.0f : 0.5f;
    test->high[3 + i] = 48.0f;
  }
  return status != IMUCAL_OK ? status : off;
}

static imucal_status test_gyro(imucal_bmi088_t* sensor, imucal_sensor_self_test_t* test) {
  uint8_t result = 0;
  imucal_status status = write_reg(sensor, GYRO, GYRO_SELF_TEST, BIST_START);
  for (uint32_t i = 0; i < 50 && status == IMUCAL_OK && !(result & BIST_READY); i++) {
    delay(sensor, 2000);
    status = read_gyro(sensor, GYRO_SELF_TEST, &result, 1);
  }
  const bool is_good = (result & BIST_READY) && !(result & BIST_FAIL) && result != 0xFF;
  for (uint32_t i = 0; i < 3; i++) {
    test->response[i] = is_good ? 1.0f : 0.0f;
    test->low[i] = test->high[i] = 1.0f;
  }
  return status;
}

imucal_status imucal_bmi088_self_test(imucal_bmi088_t* sensor, imucal_sensor_self_test_t* test) {
  *test = (imucal_sensor_self_test_t){.failed = 0x3F};
  imucal_status status = configure(sensor);
  if (status == IMUCAL_OK) status = test_accel(sensor, test);
  if (status == IMUCAL_OK) status = test_gyro(sensor, test);
  if (status == IMUCAL_OK) imucal_sensor_judge(test);
  imucal_sensor_clock_break(&sensor->clock);
  const imucal_status again = configure(sensor);
  return status != IMUCAL_OK ? status : again;
}

/* ---- as a value ---- */

static imucal_status start_any(void* sensor, const imucal_sensor_bus_t* bus, const void* config) {
  return imucal_bmi088_start(sensor, bus, config);
}

static imucal_status read_any(void* sensor, uint64_t now_us, imucal_sample_t* samples, uint32_t capacity, uint32_t* n) {
  return imucal_bmi088_read(sensor, now_us, samples, capacity, n);
}

const imucal_sensor_driver_t imucal_bmi088_driver = {.name = "bmi088",
                                                     .start = start_any,
                                                     .read = read_any,
                                                     .counts_at = offsetof(imucal_bmi088_t, counts),
                                                     .clock_at = offsetof(imucal_bmi088_t, clock),
                                                     .identity_at = offsetof(imucal_bmi088_t, identity)};
