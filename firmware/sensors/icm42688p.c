// SPDX-License-Identifier: MIT
#include "icm42688p.h"

/* DS-000347 rev. 1.7, register map of section 13; bank in the name where it is not 0. */
enum {
  DEVICE_CONFIG = 0x11,
  FIFO_CONFIG = 0x16,
  TEMP_DATA1 = 0x1D,
  ACCEL_DATA_X1 = 0x1F,
  INT_STATUS = 0x2D,
  FIFO_DATA = 0x30,
  SIGNAL_PATH_RESET = 0x4B,
  INTF_CONFIG0 = 0x4C,
  PWR_MGMT0 = 0x4E,
  GYRO_CONFIG0 = 0x4F,
  ACCEL_CONFIG0 = 0x50,
  GYRO_ACCEL_CONFIG0 = 0x52,
  TMST_CONFIG = 0x54,
  FIFO_CONFIG1 = 0x5F,
  INT_CONFIG1 = 0x64,
  SELF_TEST_CONFIG = 0x70,
  WHO_AM_I = 0x75,
  REG_BANK_SEL = 0x76,
  BANK1_XG_ST_DATA = 0x5F,
  BANK2_XA_ST_DATA = 0x3B
};

enum {
  IDENTITY = 0x47,
  RESET = 0x01,             /* DEVICE_CONFIG: bit 0 */
  RESET_DONE = 0x10,        /* INT_STATUS: bit 4, set by a reset, cleared by reading */
  FIFO_FULL = 0x02,         /* INT_STATUS: bit 1 */
  FIFO_STREAM = 0x40,       /* FIFO_CONFIG: bits 7:6 = 1, the oldest are overwritten */
  FIFO_FLUSH = 0x02,        /* SIGNAL_PATH_RESET: bit 1 */
  BIG_ENDIAN_NO_I2C = 0x33, /* INTF_CONFIG0: reset 30h (big-endian data and count), and I2C off */
  BOTH_LOW_NOISE = 0x0F,    /* PWR_MGMT0 */
  TIMESTAMP_ON = 0x21,      /* TMST_CONFIG: reset 23h without FSYNC: absolute, 1 us, on */
  FIFO_GYRO_ACCEL_TEMP = 7, /* FIFO_CONFIG1: bits 2:0 */
  FIFO_HIRES = 0x10,        /* FIFO_CONFIG1: bit 4 */
  SELF_TEST_ALL = 0x7F,     /* SELF_TEST_CONFIG: accelerometer's power and all six axes */
  ODR_1KHZ = 0x06,
  FS_250_DPS_2_G = 0x60 /* bits 7:5 = 3 for both */
};

/* Packets, section 6.1: header, accelerometer 6, gyro 6, temperature 1 or 2, time stamp 2, extensions 0 or 3. */
enum {
  PACKET3_BYTES = 16,
  PACKET4_BYTES = 20,
  HEADER_EMPTY = 0x80,
  HEADER_BOTH = 0x60, /* accelerometer and gyro are in the packet */
  HEADER_20 = 0x10,
  HEADER_STAMP = 0x0C,
  HEADER_ODR_STAMP = 0x08,
  HEADER_FIXED = 0xFC /* all but the two "rate changed" bits */
};
#define FIFO_BYTES 2048u
#define RAIL_16 32767
#define INVALID_16 (-32768)
#define RESET_US 2000u       /* 1 ms until registers may be touched, section 14.1 */
#define GYRO_START_US 45000u /* gyro: at least 45 ms on, register 4Eh */
#define MODE_CHANGE_US 300u  /* no register write for 200 us after PWR_MGMT0 */
#define TICK_US 1u

/* ---- configuration ---- */

static uint8_t odr_code(uint32_t rate_hz) {
  static const struct {
    uint16_t rate_hz;
    uint8_t code;
  } odr[] = {{8000, 3}, {4000, 4}, {2000, 5}, {1000, 6}, {500, 15}, {200, 7}, {100, 8}, {50, 9}, {25, 10}};
  for (size_t i = 0; i < sizeof odr / sizeof odr[0]; i++)
    if (odr[i].rate_hz == rate_hz) return odr[i].code;
  return 0;
}

imucal_sensor_units_t imucal_icm42688p_units(const imucal_icm42688p_config_t* config) {
  const uint32_t gyro_fs = config->is_high_resolution ? 0u : config->gyro_fs_sel;
  const uint32_t accel_fs = config->is_high_resolution ? 0u : config->accel_fs_sel;
  const int32_t gyro_fine = config->is_high_resolution ? 8 : 1;  /* 19 bits: 131 LSB/dps at 2000 dps, table 1 */
  const int32_t accel_fine = config->is_high_resolution ? 4 : 1; /* 18 bits: 8192 LSB/g at 16 g, table 2 */
  return (imucal_sensor_units_t){.dps_per_count = 2000.0f / (float)(32768 * gyro_fine) / (float)(1u << gyro_fs),
                                 .g_per_count = 16.0f / (float)(32768 * accel_fine) / (float)(1u << accel_fs),
                                 .degc_per_count = 1.0f / 132.48f, /* section 4.13 */
                                 .degc_at_zero = 25.0f,
                                 .gyro_rail_counts = RAIL_16 * gyro_fine,
                                 .accel_rail_counts = RAIL_16 * accel_fine};
}

#define N_SETTINGS 9
static void make_settings(const imucal_icm42688p_config_t* config, imucal_sensor_setting_t settings[N_SETTINGS]) {
  const uint8_t odr = odr_code(config->rate_hz);
  const uint8_t hires = config->is_high_resolution ? FIFO_HIRES : 0;
  const imucal_sensor_setting_t wanted[N_SETTINGS] = {
      {INTF_CONFIG0, BIG_ENDIAN_NO_I2C},
      {INT_CONFIG1, 0}, /* INT_ASYNC_RESET must be cleared, register 64h */
      {GYRO_CONFIG0, (uint8_t)(config->gyro_fs_sel << 5 | odr)},
      {ACCEL_CONFIG0, (uint8_t)(config->accel_fs_sel << 5 | odr)},
      {GYRO_ACCEL_CONFIG0, (uint8_t)(config->filter << 4 | config->filter)},
      {TMST_CONFIG, TIMESTAMP_ON},
      {FIFO_CONFIG1, (uint8_t)(FIFO_GYRO_ACCEL_TEMP | hires)},
      {FIFO_CONFIG, FIFO_STREAM},
      {PWR_MGMT0, BOTH_LOW_NOISE}, /* last: nothing may be written for a while after it */
  };
  for (size_t i = 0; i < N_SETTINGS; i++) settings[i] = wanted[i];
}

static imucal_status read_regs(imucal_icm42688p_t* sensor, uint8_t reg, uint8_t* data, size_t n) {
  return imucal_sensor_read_regs(sensor->bus, &sensor->counts, 0, reg, data, n);
}

static imucal_status write_reg(imucal_icm42688p_t* sensor, uint8_t reg, uint8_t value) {
  return imucal_sensor_write_reg(sensor->bus, &sensor->counts, 0, reg, value);
}

static void delay(imucal_icm42688p_t* sensor, uint32_t us) {
  sensor->bus->delay_us(sensor->bus->ctx, us);
}

/* ---- start ---- */

static imucal_status reset_and_identify(imucal_icm42688p_t* sensor) {
  imucal_status status = write_reg(sensor, REG_BANK_SEL, 0); /* a reset does not come through from another bank */
  if (status == IMUCAL_OK) status = write_reg(sensor, DEVICE_CONFIG, RESET);
  if (status != IMUCAL_OK) return status;
  delay(sensor, RESET_US);
  status = imucal_sensor_identify(sensor->bus, &sensor->counts, 0, WHO_AM_I, IDENTITY, &sensor->identity);
  if (status != IMUCAL_OK) return status;
  uint8_t int_status = 0;
  status = read_regs(sensor, INT_STATUS, &int_status, 1);
  if (status != IMUCAL_OK) return status;
  return int_status & RESET_DONE ? IMUCAL_OK : IMUCAL_ERR_SENSOR;
}

static imucal_status configure(imucal_icm42688p_t* sensor) {
  imucal_sensor_setting_t settings[N_SETTINGS];
  make_settings(&sensor->config, settings);
  imucal_status status = reset_and_identify(sensor);
  for (size_t i = 0; i < N_SETTINGS && status == IMUCAL_OK; i++)
    status = write_reg(sensor, settings[i].reg, settings[i].value);
  if (status != IMUCAL_OK) return status;
  delay(sensor, MODE_CHANGE_US);
  status = imucal_sensor_check_settings(sensor->bus, &sensor->counts, 0, settings, N_SETTINGS);
  if (status != IMUCAL_OK) return status == IMUCAL_ERR_STATE ? IMUCAL_ERR_SENSOR : status;
  delay(sensor, GYRO_START_US);
  sensor->has_ticks = false;
  sensor->n_in_fifo = 0;
  return write_reg(sensor, SIGNAL_PATH_RESET, FIFO_FLUSH);
}

imucal_status imucal_icm42688p_start(imucal_icm42688p_t* sensor, const imucal_sensor_bus_t* bus,
                                     const imucal_icm42688p_config_t* config) {
  *sensor = (imucal_icm42688p_t){.bus = bus, .config = *config};
  if (odr_code(config->rate_hz) == 0 || config->gyro_fs_sel > 7 || config->accel_fs_sel > 3 || config->filter > 7 ||
      !bus->is_spi)
    return IMUCAL_ERR_ARGUMENT;
  imucal_sensor_clock_init(&sensor->clock, 256u * 1000000u / config->rate_hz);
  sensor->watch.limit = config->rate_hz;
  sensor->watch.limit_temp = 60u * config->rate_hz; /* its noise is some counts: it cannot stand still for a minute */
  return configure(sensor);
}

/* ---- packets ---- */

/* High word, and four more bits below it: section 6.1, 20-bit data. */
static int32_t join_20(const uint8_t* high, uint32_t low) {
  return imucal_sensor_be16(high) * 16 + (int32_t)(low & 0xFu);
}

/* True where none of the six words is the mark of invalid data. */
static bool take_words(const imucal_icm42688p_t* sensor, const uint8_t* packet, imucal_sample_t* sample) {
  for (uint32_t axis = 0; axis < 3; axis++) {
    const uint8_t* accel = packet + 1 + 2 * axis;
    const uint8_t* gyro = packet + 7 + 2 * axis;
    if (imucal_sensor_be16(accel) == INVALID_16 || imucal_sensor_be16(gyro) == INVALID_16) return false;
    const uint32_t low = sensor->config.is_high_resolution ? packet[17 + axis] : 0u;
    /* Of the 20 bits the gyro's lowest and the accelerometer's two lowest are always 0. */
    const int32_t gyro_20 = join_20(gyro, low), accel_20 = join_20(accel, low >> 4);
    sample->counts[axis] = sensor->config.is_high_resolution ? gyro_20 / 2 : imucal_sensor_be16(gyro);
    sample->counts[3 + axis] = sensor->config.is_high_resolution ? accel_20 / 4 : imucal_sensor_be16(accel);
  }
  return true;
}

/* Neighbouring packets are one period apart in the sensor's own ticks; further apart: packets between them are lost.
 * A tick is 1 us by the register, 32/30 us without an external clock: both stay below one and a half periods. */
static void check_ticks(imucal_icm42688p_t* sensor, uint16_t ticks) {
  const uint32_t period = 1000000u / sensor->config.rate_hz / TICK_US;
  const uint16_t step = (uint16_t)(ticks - sensor->last_ticks);
  if (sensor->has_ticks && period < 30000u && step > period + period / 2) sensor->counts.n_invalid++;
  sensor->last_ticks = ticks;
  sensor->has_ticks = true;
}

/* True: *sample is set but for its time. */
static bool take_packet(imucal_icm42688p_t* sensor, const uint8_t* packet, imucal_sample_t* sample) {
  *sample = (imucal_sample_t){.n_channels = 6};
  const bool is_hires = sensor->config.is_high_resolution;
  const uint8_t wanted = (uint8_t)(HEADER_BOTH | HEADER_ODR_STAMP | (is_hires ? HEADER_20 : 0));
  if ((packet[0] & HEADER_FIXED) != wanted || !take_words(sensor, packet, sample)) {
    sensor->counts.n_invalid++;
    sensor->has_ticks = false;
    return false;
  }
  if (is_hires && imucal_sensor_be16(packet + 13) != INVALID_16) sensor->temp_counts = imucal_sensor_be16(packet + 13);
  const uint8_t* stamp = packet + (is_hires ? 15 : 14);
  check_ticks(sensor, (uint16_t)(stamp[0] << 8 | stamp[1]));
  sample->temp_counts = sensor->temp_counts;
  const imucal_sensor_units_t units = imucal_icm42688p_units(&sensor->config);
  imucal_sensor_mark_rails(&units, &sensor->counts, sample);
  imucal_sensor_watch(&sensor->watch, &sensor->counts, sample);
  return true;
}

/* ---- read ---- */

/* After a silence: is it still our sensor, set up as we did? */
static imucal_status look_after(imucal_icm42688p_t* sensor, uint64_t now_us, bool has_reset) {
  uint8_t found = 0;
  imucal_status status = imucal_sensor_identify(sensor->bus, &sensor->counts, 0, WHO_AM_I, IDENTITY, &found);
  if (status != IMUCAL_OK) return status;
  imucal_sensor_setting_t settings[N_SETTINGS];
  make_settings(&sensor->config, settings);
  status = imucal_sensor_check_settings(sensor->bus, &sensor->counts, 0, settings, N_SETTINGS);
  if (status == IMUCAL_ERR_STATE || has_reset) {
    sensor->counts.n_resets++;
    imucal_sensor_clock_break(&sensor->clock);
    status = configure(sensor);
  } else if (status == IMUCAL_OK) {
    status = IMUCAL_ERR_SENSOR; /* all in order, but no samples: not to be trusted */
  }
  if (status == IMUCAL_OK) sensor->alive_us = now_us;
  return status;
}

static bool is_silent(const imucal_icm42688p_t* sensor, uint64_t now_us) {
  return imucal_sensor_is_silent(sensor->alive_us, now_us, sensor->config.rate_hz);
}

/* Level of the FIFO in packets; *is_full: it overran since the last look.  The three registers follow each other. */
static imucal_status read_level(imucal_icm42688p_t* sensor, uint32_t* level, bool* is_full, bool* has_reset) {
  uint8_t bytes[3];
  const imucal_status status = read_regs(sensor, INT_STATUS, bytes, sizeof bytes);
  if (status != IMUCAL_OK) return status;
  const uint32_t n_bytes = (uint32_t)bytes[1] << 8 | bytes[2];
  if (n_bytes > FIFO_BYTES + 64u) { /* 2048 and the read cache; 0xFFFF on a stuck bus */
    sensor->counts.n_bus_errors++;
    return IMUCAL_ERR_SENSOR;
  }
  *level = n_bytes / (sensor->config.is_high_resolution ? PACKET4_BYTES : PACKET3_BYTES);
  *is_full = bytes[0] & FIFO_FULL;
  *has_reset = bytes[0] & RESET_DONE;
  return IMUCAL_OK;
}

/* Reads m packets and hands the good ones out; `level` of them were in the FIFO. */
static imucal_status take_burst(imucal_icm42688p_t* sensor, uint32_t level, uint32_t m, imucal_sample_t* samples,
                                uint32_t* n) {
  const uint32_t packet_bytes = sensor->config.is_high_resolution ? PACKET4_BYTES : PACKET3_BYTES;
  uint8_t bytes[IMUCAL_SENSOR_BURST_BYTES];
  const imucal_status status = read_regs(sensor, FIFO_DATA, bytes, m * packet_bytes);
  if (status != IMUCAL_OK) return status;
  if (imucal_sensor_is_flat(bytes, m * packet_bytes)) sensor->counts.n_bus_errors++;
  for (uint32_t i = 0; i < m; i++) {
    imucal_sample_t* sample = samples + *n;
    if (!take_packet(sensor, bytes + i * packet_bytes, sample)) continue;
    sample->t_us = imucal_sensor_clock_time_us(&sensor->clock, level - 1 - i);
    sensor->counts.n_samples++;
    (*n)++;
  }
  sensor->n_in_fifo = level - m;
  if (*n > 0) return IMUCAL_OK;
  /* Not one good packet: out of step, as an overrun in the middle of a burst leaves it.  Begin at a packet's start again. */
  sensor->n_in_fifo = 0;
  imucal_sensor_clock_break(&sensor->clock);
  return write_reg(sensor, SIGNAL_PATH_RESET, FIFO_FLUSH);
}

static imucal_status read_coarse_temperature(imucal_icm42688p_t* sensor) {
  uint8_t bytes[2];
  const imucal_status status = read_regs(sensor, TEMP_DATA1, bytes, 2);
  if (status == IMUCAL_OK && imucal_sensor_be16(bytes) != INVALID_16) sensor->temp_counts = imucal_sensor_be16(bytes);
  return status;
}

imucal_status imucal_icm42688p_read(imucal_icm42688p_t* sensor, uint64_t now_us, imucal_sample_t* samples,
                                    uint32_t capacity, uint32_t* n) {
  *n = 0;
  if (sensor->alive_us == 0) sensor->alive_us = now_us;
  uint32_t level = 0;
  bool is_full = false, has_reset = false;
  imucal_status status = read_level(sensor, &level, &is_full, &has_reset);
  if (status == IMUCAL_OK && has_reset) return look_after(sensor, now_us, true);
  if (status == IMUCAL_OK && level == 0 && is_silent(sensor, now_us)) return look_after(sensor, now_us, false);
  if (status != IMUCAL_OK || level == 0) return status;
  const uint32_t n_new = level > sensor->n_in_fifo ? level - sensor->n_in_fifo : 0;
  if (is_full) sensor->counts.n_overruns++;
  /* How many an overrun cost only the clock can say. */
  sensor->counts.n_lost += imucal_sensor_clock_burst(&sensor->clock, now_us, n_new, is_full);
  if (is_full) sensor->has_ticks = false;
  if (!sensor->config.is_high_resolution) status = read_coarse_temperature(sensor);
  if (status != IMUCAL_OK) return status;
  const uint32_t most = IMUCAL_SENSOR_BURST_BYTES / PACKET4_BYTES;
  uint32_t m = level < capacity ? level : capacity;
  if (m > most) m = most;
  status = take_burst(sensor, level, m, samples, n);
  if (*n > 0) sensor->alive_us = now_us;
  return status == IMUCAL_OK && *n == 0 && is_silent(sensor, now_us) ? look_after(sensor, now_us, false) : status;
}

/* ---- self-test ---- */

#define SELF_TEST_SAMPLES 200

/* Means of the data registers, counts at 250 dps and 2 g, gyros first. */
static imucal_status mean_of_registers(imucal_icm42688p_t* sensor, float mean[6]) {
  int32_t sum[6] = {0};
  for (uint32_t k = 0; k < SELF_TEST_SAMPLES; k++) {
    uint8_t bytes[12];
    const imucal_status status = read_regs(sensor, ACCEL_DATA_X1, bytes, sizeof bytes);
    if (status != IMUCAL_OK) return status;
    for (uint32_t i = 0; i < 6; i++) sum[i] += imucal_sensor_be16(bytes + 2 * ((i + 3) % 6));
    delay(sensor, 1000);
  }
  for (uint32_t i = 0; i < 6; i++) mean[i] = (float)sum[i] / (float)SELF_TEST_SAMPLES;
  return IMUCAL_OK;
}

/* Factory response in counts at 250 dps / 2 g: 2620 * 1.01^(code - 1); code 0: none stored. */
static float factory_response(uint8_t code) {
  float response = code ? 2620.0f : 0.0f;
  for (uint32_t i = 1; i < code; i++) response *= 1.01f;
  return response;
}

static imucal_status read_factory_codes(imucal_icm42688p_t* sensor, uint8_t codes[6]) {
  imucal_status status = write_reg(sensor, REG_BANK_SEL, 1);
  if (status == IMUCAL_OK) status = read_regs(sensor, BANK1_XG_ST_DATA, codes, 3);
  if (status == IMUCAL_OK) status = write_reg(sensor, REG_BANK_SEL, 2);
  if (status == IMUCAL_OK) status = read_regs(sensor, BANK2_XA_ST_DATA, codes + 3, 3);
  const imucal_status back = write_reg(sensor, REG_BANK_SEL, 0);
  return status != IMUCAL_OK ? status : back;
}

static imucal_status measure_responses(imucal_icm42688p_t* sensor, float response[6]) {
  float quiet[6] = {0};
  imucal_status status = write_reg(sensor, GYRO_CONFIG0, FS_250_DPS_2_G | ODR_1KHZ);
  if (status == IMUCAL_OK) status = write_reg(sensor, ACCEL_CONFIG0, FS_250_DPS_2_G | ODR_1KHZ);
  delay(sensor, 100000);
  if (status == IMUCAL_OK) status = mean_of_registers(sensor, quiet);
  if (status == IMUCAL_OK) status = write_reg(sensor, SELF_TEST_CONFIG, SELF_TEST_ALL);
  delay(sensor, 200000);
  if (status == IMUCAL_OK) status = mean_of_registers(sensor, response);
  const imucal_status off = write_reg(sensor, SELF_TEST_CONFIG, 0);
  for (uint32_t i = 0; i < 6 && status == IMUCAL_OK; i++) response[i] -= quiet[i];
  return status != IMUCAL_OK ? status : off;
}

imucal_status imucal_icm42688p_self_test(imucal_icm42688p_t* sensor, imucal_sensor_self_test_t* test) {
  *test = (imucal_sensor_self_test_t){.failed = 0x3F};
  uint8_t codes[6];
  imucal_status status = configure(sensor);
  if (status == IMUCAL_OK) status = read_factory_codes(sensor, codes);
  if (status == IMUCAL_OK) status = measure_responses(sensor, test->response);
  for (uint32_t i = 0; i < 6 && status == IMUCAL_OK; i++) {
    const float unit = i < 3 ? 250.0f / 32768.0f : 2.0f / 32768.0f;
    const float factory = factory_response(codes[i]) * unit;
    test->response[i] *= unit;
    test->low[i] = codes[i] ? 0.5f * factory : i < 3 ? 60.0f : 0.05f;
    test->high[i] = codes[i] ? 1.5f * factory : i < 3 ? 250.0f : 1.2f;
  }
  if (status == IMUCAL_OK) imucal_sensor_judge(test);
  imucal_sensor_clock_break(&sensor->clock);
  const imucal_status again = configure(sensor);
  return status != IMUCAL_OK ? status : again;
}

/* ---- as a value ---- */

static imucal_status start_any(void* sensor, const imucal_sensor_bus_t* bus, const void* config) {
  return imucal_icm42688p_start(sensor, bus, config);
}

static imucal_status read_any(void* sensor, uint64_t now_us, imucal_sample_t* samples, uint32_t capacity, uint32_t* n) {
  return imucal_icm42688p_read(sensor, now_us, samples, capacity, n);
}

const imucal_sensor_driver_t imucal_icm42688p_driver = {.name = "icm42688p",
                                                        .start = start_any,
                                                        .read = read_any,
                                                        .counts_at = offsetof(imucal_icm42688p_t, counts),
                                                        .clock_at = offsetof(imucal_icm42688p_t, clock),
                                                        .identity_at = offsetof(imucal_icm42688p_t, identity)};
