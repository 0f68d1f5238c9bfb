// SPDX-License-Identifier: MIT
#include "mpu6050.h"

/* RM-MPU-6000A-00 rev. 4.2, section 3; names of that document. */
enum {
  SELF_TEST_X_6500 = 0x00, /* RM-MPU-6500A-00: gyro codes; accelerometer codes from 0Dh */
  SELF_TEST_X = 0x0D,
  SMPLRT_DIV = 0x19,
  CONFIG = 0x1A,
  GYRO_CONFIG = 0x1B,
  ACCEL_CONFIG = 0x1C,
  ACCEL_CONFIG2_6500 = 0x1D,
  FIFO_EN = 0x23,
  INT_ENABLE = 0x38,
  INT_STATUS = 0x3A,
  ACCEL_XOUT_H = 0x3B,
  USER_CTRL = 0x6A,
  PWR_MGMT_1 = 0x6B,
  FIFO_COUNTH = 0x72,
  FIFO_R_W = 0x74,
  WHO_AM_I = 0x75
};
enum {
  ID_6050 = 0x68,
  ID_6500 = 0x70,
  ID_9250 = 0x71,
  DEVICE_RESET = 0x80,   /* PWR_MGMT_1 */
  CLOCK_PLL = 0x01,      /* PWR_MGMT_1: awake, PLL on the x gyro */
  FIFO_ALL = 0xF8,       /* FIFO_EN: temperature, three gyros, accelerometer */
  FIFO_OVERFLOW = 0x10,  /* INT_ENABLE, INT_STATUS */
  FIFO_ON = 0x40,        /* USER_CTRL */
  FIFO_RESET = 0x04,     /* USER_CTRL: clears itself; only while FIFO_ON is 0 */
  I2C_OFF = 0x10,        /* USER_CTRL: on SPI */
  SELF_TEST_AXES = 0xE0, /* GYRO_CONFIG, ACCEL_CONFIG */
  PACKET_BYTES = 14,     /* as the registers follow each other: accelerometer, temperature, gyro */
  FIFO_BYTES = 1024,
  RAIL = 32767
};
#define RESET_US 100000u
#define START_US 80000u /* gyro start-up 30 ms (MPU-6500: 35 ms) by the data sheets; Linux waits 60 (70) ms */

/* ---- configuration ---- */

imucal_sensor_units_t imucal_mpu6050_units(const imucal_mpu6050_t* sensor) {
  return (imucal_sensor_units_t){.dps_per_count = 250.0f / 32768.0f * (float)(1u << sensor->config.gyro_fs_sel),
                                 .g_per_count = 2.0f / 32768.0f * (float)(1u << sensor->config.accel_fs_sel),
                                 .degc_per_count = sensor->is_6500 ? 1.0f / 333.87f
                                                                   : 1.0f / 340.0f, /* register 41h of each document */
                                 .degc_at_zero = sensor->is_6500 ? 21.0f : 36.53f,
                                 .gyro_rail_counts = RAIL,
                                 .accel_rail_counts = RAIL};
}

static uint8_t user_control(const imucal_mpu6050_t* sensor) {
  return (uint8_t)(FIFO_ON | (sensor->bus->is_spi ? I2C_OFF : 0));
}

/* The last one is of the MPU-6500 alone. */
#define N_SETTINGS 9
static size_t make_settings(const imucal_mpu6050_t* sensor, imucal_sensor_setting_t settings[N_SETTINGS]) {
  const imucal_mpu6050_config_t* config = &sensor->config;
  const imucal_sensor_setting_t wanted[N_SETTINGS] = {
      {PWR_MGMT_1, CLOCK_PLL},
      {SMPLRT_DIV, (uint8_t)(1000 / config->rate_hz - 1)},
      {CONFIG, config->filter},
      {GYRO_CONFIG, (uint8_t)(config->gyro_fs_sel << 3)},
      {ACCEL_CONFIG, (uint8_t)(config->accel_fs_sel << 3)},
      {INT_ENABLE, FIFO_OVERFLOW},
      {FIFO_EN, FIFO_ALL},
      {USER_CTRL, user_control(sensor)},
      {ACCEL_CONFIG2_6500, config->filter},
  };
  for (size_t i = 0; i < N_SETTINGS; i++) settings[i] = wanted[i];
  return sensor->is_6500 ? N_SETTINGS : N_SETTINGS - 1;
}

static imucal_status read_regs(imucal_mpu6050_t* sensor, uint8_t reg, uint8_t* data, size_t n) {
  return imucal_sensor_read_regs(sensor->bus, &sensor->counts, 0, reg, data, n);
}

static imucal_status write_reg(imucal_mpu6050_t* sensor, uint8_t reg, uint8_t value) {
  return imucal_sensor_write_reg(sensor->bus, &sensor->counts, 0, reg, value);
}

static void delay(imucal_mpu6050_t* sensor, uint32_t us) {
  sensor->bus->delay_us(sensor->bus->ctx, us);
}

/* ---- start ---- */

/* The identity asked for, or one of the three. */
static bool is_ours(const imucal_mpu6050_t* sensor) {
  const uint8_t id = sensor->identity;
  return sensor->config.identity ? id == sensor->config.identity : id == ID_6050 || id == ID_6500 || id == ID_9250;
}

static imucal_status identify(imucal_mpu6050_t* sensor) {
  imucal_status status = IMUCAL_OK;
  bool is_known = false;
  for (uint32_t i = 0; i < 3 && !is_known; i++) {
    if (i > 0) delay(sensor, 10000);
    sensor->identity = 0;
    status = read_regs(sensor, WHO_AM_I, &sensor->identity, 1);
    is_known = status == IMUCAL_OK && is_ours(sensor);
  }
  if (status != IMUCAL_OK) return status;
  if (is_known) sensor->is_6500 = sensor->identity != ID_6050;
  if (is_known) return IMUCAL_OK;
  imucal_sensor_count_identity(&sensor->counts, sensor->identity);
  return IMUCAL_ERR_SENSOR;
}

/* FIFO_RESET does its work while FIFO_EN is 0 (section 4.29): off and reset, then on. */
static imucal_status empty_fifo(imucal_mpu6050_t* sensor) {
  const uint8_t on = user_control(sensor);
  sensor->n_in_fifo = 0;
  const imucal_status status = write_reg(sensor, USER_CTRL, (uint8_t)((on & ~FIFO_ON) | FIFO_RESET));
  return status == IMUCAL_OK ? write_reg(sensor, USER_CTRL, on) : status;
}

static imucal_status configure(imucal_mpu6050_t* sensor) {
  imucal_status status = write_reg(sensor, PWR_MGMT_1, DEVICE_RESET);
  if (status != IMUCAL_OK) return status;
  delay(sensor, RESET_US);
  status = identify(sensor);
  if (status == IMUCAL_OK) status = write_reg(sensor, PWR_MGMT_1, CLOCK_PLL); /* nothing else can be written asleep */
  if (status != IMUCAL_OK) return status;
  delay(sensor, START_US);
  imucal_sensor_setting_t settings[N_SETTINGS];
  const size_t n = make_settings(sensor, settings);
  status = imucal_sensor_write_settings(sensor->bus, &sensor->counts, 0, settings, n);
  return status == IMUCAL_OK ? empty_fifo(sensor) : status;
}

imucal_status imucal_mpu6050_start(imucal_mpu6050_t* sensor, const imucal_sensor_bus_t* bus,
                                   const imucal_mpu6050_config_t* config) {
  *sensor = (imucal_mpu6050_t){.bus = bus, .config = *config};
  if (config->rate_hz < 4 || config->rate_hz > 1000 || 1000 % config->rate_hz || config->gyro_fs_sel > 3 ||
      config->accel_fs_sel > 3 || config->filter < 1 || config->filter > 6)
    return IMUCAL_ERR_ARGUMENT;
  imucal_sensor_clock_init(&sensor->clock, 256u * 1000000u / config->rate_hz);
  sensor->watch.limit = config->rate_hz;
  sensor->watch.limit_temp = 60u * config->rate_hz;
  return configure(sensor);
}

/* ---- read ---- */

static void take_packet(imucal_mpu6050_t* sensor, const uint8_t* packet, imucal_sample_t* sample) {
  *sample = (imucal_sample_t){.n_channels = 6, .temp_counts = imucal_sensor_be16(packet + 6)};
  for (uint32_t axis = 0; axis < 3; axis++) {
    sample->counts[axis] = imucal_sensor_be16(packet + 8 + 2 * axis);
    sample->counts[3 + axis] = imucal_sensor_be16(packet + 2 * axis);
  }
  const imucal_sensor_units_t units = imucal_mpu6050_units(sensor);
  imucal_sensor_mark_rails(&units, &sensor->counts, sample);
  imucal_sensor_watch(&sensor->watch, &sensor->counts, sample);
}

static imucal_status look_after(imucal_mpu6050_t* sensor, uint64_t now_us) {
  imucal_status status = identify(sensor);
  if (status != IMUCAL_OK) return status;
  imucal_sensor_setting_t settings[N_SETTINGS];
  const size_t n = make_settings(sensor, settings);
  status = imucal_sensor_check_settings(sensor->bus, &sensor->counts, 0, settings, n);
  if (status == IMUCAL_OK) return IMUCAL_ERR_SENSOR; /* all in order, but no samples: not to be trusted */
  if (status != IMUCAL_ERR_STATE) return status;
  sensor->counts.n_resets++;
  imucal_sensor_clock_break(&sensor->clock);
  status = configure(sensor);
  if (status == IMUCAL_OK) sensor->alive_us = now_us;
  return status;
}

static imucal_status read_level(imucal_mpu6050_t* sensor, uint32_t* level, bool* is_full) {
  uint8_t int_status, bytes[2];
  imucal_status status = read_regs(sensor, FIFO_COUNTH, bytes, 2);
  if (status == IMUCAL_OK) status = read_regs(sensor, INT_STATUS, &int_status, 1); /* clears it */
  if (status != IMUCAL_OK) return status;
  const uint32_t n_bytes = (uint32_t)bytes[0] << 8 | bytes[1];
  if (n_bytes > FIFO_BYTES) { /* a stuck bus */
    sensor->counts.n_bus_errors++;
    return IMUCAL_ERR_SENSOR;
  }
  *level = n_bytes / PACKET_BYTES;
  *is_full = int_status & FIFO_OVERFLOW;
  return IMUCAL_OK;
}

static imucal_status take_burst(imucal_mpu6050_t* sensor, uint32_t level, uint32_t m, imucal_sample_t* samples) {
  uint8_t bytes[IMUCAL_SENSOR_BURST_BYTES];
  const imucal_status status = read_regs(sensor, FIFO_R_W, bytes, m * PACKET_BYTES);
  if (status != IMUCAL_OK) return status;
  if (imucal_sensor_is_flat(bytes, m * PACKET_BYTES)) { /* a sensor is never that quiet: gravity alone is not flat */
    sensor->counts.n_bus_errors++;
    return IMUCAL_ERR_SENSOR;
  }
  for (uint32_t i = 0; i < m; i++) {
    take_packet(sensor, bytes + i * PACKET_BYTES, samples + i);
    samples[i].t_us = imucal_sensor_clock_time_us(&sensor->clock, level - 1 - i);
  }
  sensor->counts.n_samples += m;
  sensor->n_in_fifo = level - m;
  return IMUCAL_OK;
}

imucal_status imucal_mpu6050_read(imucal_mpu6050_t* sensor, uint64_t now_us, imucal_sample_t* samples,
                                  uint32_t capacity, uint32_t* n) {
  *n = 0;
  if (sensor->alive_us == 0) sensor->alive_us = now_us;
  uint32_t level = 0;
  bool is_full = false;
  imucal_status status = read_level(sensor, &level, &is_full);
  if (status != IMUCAL_OK) return status;
  if (is_full) {
    sensor->counts.n_overruns++;
    /* All since the last read and what was left then; the clock stands at the newest sample that was. */
    sensor->counts.n_lost += sensor->n_in_fifo + imucal_sensor_clock_burst(&sensor->clock, now_us, 0, true);
    return empty_fifo(sensor);
  }
  if (level == 0)
    return imucal_sensor_is_silent(sensor->alive_us, now_us, sensor->config.rate_hz) ? look_after(sensor, now_us)
                                                                                     : IMUCAL_OK;
  const uint32_t n_new = level > sensor->n_in_fifo ? level - sensor->n_in_fifo : 0;
  sensor->counts.n_lost += imucal_sensor_clock_burst(&sensor->clock, now_us, n_new, false);
  uint32_t m = level < capacity ? level : capacity;
  if (m > IMUCAL_SENSOR_BURST_BYTES / PACKET_BYTES) m = IMUCAL_SENSOR_BURST_BYTES / PACKET_BYTES;
  status = take_burst(sensor, level, m, samples);
  if (status != IMUCAL_OK) { /* part of a packet may be gone: begin at a packet's start again */
    imucal_sensor_clock_break(&sensor->clock);
    const imucal_status emptied = empty_fifo(sensor);
    return emptied != IMUCAL_OK ? emptied : status;
  }
  *n = m;
  sensor->alive_us = now_us;
  return IMUCAL_OK;
}

/* ---- self-test ---- */

#define SELF_TEST_SAMPLES 200

static imucal_status mean_of_registers(imucal_mpu6050_t* sensor, float mean[6]) {
  int32_t sum[6] = {0};
  for (uint32_t k = 0; k < SELF_TEST_SAMPLES; k++) {
    uint8_t bytes[PACKET_BYTES];
    const imucal_status status = read_regs(sensor, ACCEL_XOUT_H, bytes, sizeof bytes);
    if (status != IMUCAL_OK) return status;
    for (uint32_t i = 0; i < 3; i++) {
      sum[i] += imucal_sensor_be16(bytes + 8 + 2 * i);
      sum[3 + i] += imucal_sensor_be16(bytes + 2 * i);
    }
    delay(sensor, 1000);
  }
  for (uint32_t i = 0; i < 6; i++) mean[i] = (float)sum[i] / (float)SELF_TEST_SAMPLES;
  return IMUCAL_OK;
}

static imucal_status measure_responses(imucal_mpu6050_t* sensor, uint8_t accel_fs, float response[6]) {
  float quiet[6] = {0};
  imucal_status status = write_reg(sensor, SMPLRT_DIV, 0);
  if (status == IMUCAL_OK) status = write_reg(sensor, GYRO_CONFIG, 0);
  if (status == IMUCAL_OK) status = write_reg(sensor, ACCEL_CONFIG, (uint8_t)(accel_fs << 3));
  delay(sensor, 250000);
  if (status == IMUCAL_OK) status = mean_of_registers(sensor, quiet);
  if (status == IMUCAL_OK) status = write_reg(sensor, GYRO_CONFIG, SELF_TEST_AXES);
  if (status == IMUCAL_OK) status = write_reg(sensor, ACCEL_CONFIG, (uint8_t)(SELF_TEST_AXES | accel_fs << 3));
  delay(sensor, 250000);
  if (status == IMUCAL_OK) status = mean_of_registers(sensor, response);
  for (uint32_t i = 0; i < 6 && status == IMUCAL_OK; i++) response[i] -= quiet[i];
  return status;
}

static float power(float base, uint32_t n) {
  float value = 1.0f;
  for (uint32_t i = 0; i < n; i++) value *= base;
  return value;
}

/* Factory trim in counts, RM-MPU-6000A-00 section 4.1 f.: gyro at 250 dps 25 * 131 * 1.046^(code-1), y negative;
 * accelerometer at 8 g 4096 * 0.34 * (0.92/0.34)^((code-1)/30).  0: no code. */
static imucal_status trim_6050(imucal_mpu6050_t* sensor, float trim[6]) {
  uint8_t bytes[4];
  const imucal_status status = read_regs(sensor, SELF_TEST_X, bytes, sizeof bytes);
  if (status != IMUCAL_OK) return status;
  for (uint32_t i = 0; i < 3; i++) {
    const uint32_t gyro = bytes[i] & 0x1Fu;
    const uint32_t high = bytes[i] >> 5, low = (uint32_t)bytes[3] >> (4 - 2 * i) & 3u;
    const uint32_t accel = high << 2 | low;
    trim[i] = gyro ? 25.0f * 131.0f * power(1.046f, gyro - 1) * (i == 1 ? -1.0f : 1.0f) : 0.0f;
    trim[3 + i] = accel ? 4096.0f * 0.34f * power(1.0337376f, accel - 1) : 0.0f; /* (0.92/0.34)^(1/30) */
  }
  return IMUCAL_OK;
}

/* RM-MPU-6500A-00, registers 00h and 0Dh: 2620 * 1.01^(code-1) counts at 250 dps and 2 g. */
static imucal_status trim_6500(imucal_mpu6050_t* sensor, float trim[6]) {
  uint8_t codes[6];
  imucal_status status = read_regs(sensor, SELF_TEST_X_6500, codes, 3);
  if (status == IMUCAL_OK) status = read_regs(sensor, SELF_TEST_X, codes + 3, 3);
  for (uint32_t i = 0; i < 6; i++) trim[i] = codes[i] ? 2620.0f * power(1.01f, codes[i] - 1u) : 0.0f;
  return status;
}

static void set_limits(const imucal_mpu6050_t* sensor, float unit, float trim, uint32_t i,
                       imucal_sensor_self_test_t* test) {
  const float slack = sensor->is_6500 ? 0.5f : 0.14f;
  const float one = trim * unit * (1.0f - slack), other = trim * unit * (1.0f + slack);
  test->response[i] *= unit;
  test->low[i] = one < other ? one : other;
  test->high[i] = one < other ? other : one;
}

imucal_status imucal_mpu6050_self_test(imucal_mpu6050_t* sensor, imucal_sensor_self_test_t* test) {
  *test = (imucal_sensor_self_test_t){.failed = 0x3F};
  float trim[6] = {0};
  imucal_status status = configure(sensor);
  const uint8_t accel_fs = sensor->is_6500 ? 0 : 2;
  if (status == IMUCAL_OK) status = sensor->is_6500 ? trim_6500(sensor, trim) : trim_6050(sensor, trim);
  if (status == IMUCAL_OK) status = measure_responses(sensor, accel_fs, test->response);
  for (uint32_t i = 0; i < 6 && status == IMUCAL_OK; i++)
    set_limits(sensor, i < 3 ? 250.0f / 32768.0f : 2.0f / 32768.0f * (float)(1u << accel_fs), trim[i], i, test);
  if (status == IMUCAL_OK) imucal_sensor_judge(test);
  for (uint32_t i = 0; i < 6 && status == IMUCAL_OK; i++)
    if (trim[i] == 0.0f) test->failed = (uint8_t)(test->failed | 1u << i);
  imucal_sensor_clock_break(&sensor->clock);
  const imucal_status again = configure(sensor);
  return status != IMUCAL_OK ? status : again;
}

/* ---- as a value ---- */

static imucal_status start_any(void* sensor, const imucal_sensor_bus_t* bus, const void* config) {
  return imucal_mpu6050_start(sensor, bus, config);
}

static imucal_status read_any(void* sensor, uint64_t now_us, imucal_sample_t* samples, uint32_t capacity, uint32_t* n) {
  return imucal_mpu6050_read(sensor, now_us, samples, capacity, n);
}

const imucal_sensor_driver_t imucal_mpu6050_driver = {.name = "mpu6050",
                                                      .start = start_any,
                                                      .read = read_any,
                                                      .counts_at = offsetof(imucal_mpu6050_t, counts),
                                                      .clock_at = offsetof(imucal_mpu6050_t, clock),
                                                      .identity_at = offsetof(imucal_mpu6050_t, identity)};
