// SPDX-License-Identifier: MIT
/* The four sensor drivers against facts read in public sources that the drivers' author did not write.  The bus here is a
 * recorder, not a model: it keeps what was written, answers from literal bytes, and knows no chip.  Beside each literal:
 * document and register, and the public driver it was read in.
 *   DS-000347 rev. 1.5, ICM-42688-P (copy in finani/ICM42688); PX4/PX4-Autopilot and zephyrproject-rtos/zephyr, icm42688
 *   RM-MPU-6000A-00 rev. 4.2 (pages 8, 43, 44); torvalds/linux, drivers/iio/imu/inv_mpu6050
 *   STMicroelectronics/lsm6dso-pid, lsm6dso_reg.h and .c; ST's FIFO utility st_fifo.c; torvalds/linux, st_lsm6dsx
 *   BST-BMI088-DS001 rev. 1.3 (pages 20, 21, 27); boschsensortec/BMI08x_SensorAPI; PX4/PX4-Autopilot, bmi088 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "sensors/bmi088.h"
#include "sensors/icm42688p.h"
#include "sensors/lsm6dso.h"
#include "sensors/mpu6050.h"

/* ---- the recorder ---- */

typedef struct access {
  uint64_t at_us; /* sum of the delays before it */
  uint8_t device, reg, value;
  bool is_write;
} access_t;

static struct {
  uint8_t reg[5][128]; /* by chip select, or by register bank */
  const uint8_t* stream;
  uint32_t n_stream, n_accesses;
  uint64_t now_us;
  access_t log[4096];
  uint8_t fifo_device, fifo_reg, bank, bank_reg, reset_device, reset_reg[2], reset_value[2];
  bool is_spi, has_dummy; /* a byte before the data, device 0 */
} bus_log;

static void note(uint8_t device, uint8_t reg, uint8_t value, bool is_write) {
  assert_true(bus_log.n_accesses < sizeof bus_log.log / sizeof bus_log.log[0]);
  bus_log.log[bus_log.n_accesses++] = (access_t){bus_log.now_us, device, reg, value, is_write};
}

static void take_write(uint8_t device, uint8_t reg, uint8_t value) {
  note(device, reg, value, true);
  for (int i = 0; i < 2; i++) /* a reset command leaves nothing behind */
    if (reg == bus_log.reset_reg[i] && value == bus_log.reset_value[i]) return;
  if (bus_log.bank_reg && reg == bus_log.bank_reg) bus_log.bank = value;
  bus_log.reg[device + bus_log.bank][reg] = value;
}

static imucal_status record(void* ctx, uint8_t device, const uint8_t* out, size_t n_out, uint8_t* in, size_t n_in) {
  (void)ctx;
  assert_true(bus_log.is_spi == (n_in > 0 && (out[0] & 0x80)) ||
              n_in == 0); /* all of them: bit 7 reads, on SPI alone */
  const uint8_t reg = out[0] & 0x7F;
  for (size_t i = 1; i < n_out; i++) take_write(device, (uint8_t)(reg + i - 1), out[i]);
  if (n_in > 0) note(device, reg, 0, false);
  const bool is_fifo = reg == bus_log.fifo_reg && device == bus_log.fifo_device;
  const size_t skip = bus_log.has_dummy && device == 0 ? 1 : 0;
  for (size_t i = 0; i < n_in; i++) {
    if (i < skip)
      in[i] = 0xA5;
    else if (is_fifo)
      in[i] = i < bus_log.n_stream ? bus_log.stream[i] : 0;
    else
      in[i] = bus_log.reg[device + bus_log.bank][(reg + i - skip) & 0x7F];
  }
  return IMUCAL_OK;
}

static void pass_time(void* ctx, uint32_t us) {
  (void)ctx;
  bus_log.now_us += us;
}

static imucal_sensor_bus_t open_bus(bool is_spi, uint8_t fifo_device, uint8_t fifo_reg) {
  memset(&bus_log, 0, sizeof bus_log);
  bus_log.is_spi = is_spi;
  bus_log.fifo_device = fifo_device;
  bus_log.fifo_reg = fifo_reg;
  return (imucal_sensor_bus_t){.transfer = record, .delay_us = pass_time, .is_spi = is_spi};
}

static void set_reset(int i, uint8_t reg, uint8_t value) {
  bus_log.reset_reg[i] = reg;
  bus_log.reset_value[i] = value;
}

static void set_stream(const uint8_t* bytes, uint32_t n) {
  bus_log.stream = bytes;
  bus_log.n_stream = n;
}

/* The last write of a register, or NULL. */
static const access_t* last_write(uint8_t device, uint8_t reg) {
  for (uint32_t i = bus_log.n_accesses; i-- > 0;)
    if (bus_log.log[i].is_write && bus_log.log[i].device == device && bus_log.log[i].reg == reg) return bus_log.log + i;
  return NULL;
}

static void assert_written(uint8_t device, uint8_t reg, uint8_t value) {
  const access_t* found = last_write(device, reg);
  if (!found) fail_msg("register %02X was not written", reg);
  if (found->value != value) fail_msg("register %02X: %02X, not %02X", reg, found->value, value);
}

static const access_t* find_write(uint8_t device, uint8_t reg, uint8_t value) {
  for (uint32_t i = 0; i < bus_log.n_accesses; i++) {
    const access_t* a = bus_log.log + i;
    if (a->is_write && a->device == device && a->reg == reg && a->value == value) return a;
  }
  fail_msg("no write of %02X to register %02X", value, reg);
  return NULL;
}

/* Nothing was said to this chip for so long after the first such write (writes_only: nothing was written). */
static void assert_pause_after(const access_t* a, uint64_t us, bool writes_only) {
  const access_t* next = a + 1;
  while (next < bus_log.log + bus_log.n_accesses && (next->device != a->device || (writes_only && !next->is_write)))
    next++;
  assert_true(next < bus_log.log + bus_log.n_accesses);
  assert_true(next->at_us - a->at_us >= us);
}

static void assert_read(uint8_t device, uint8_t reg) {
  for (uint32_t i = 0; i < bus_log.n_accesses; i++) {
    const access_t* a = bus_log.log + i;
    if (!a->is_write && a->device == device && a->reg == reg) return;
  }
  fail_msg("register %02X was not read", reg);
}

static void assert_close(double value, double expected, double tolerance) {
  if (!(fabs(value - expected) <= tolerance)) fail_msg("%.9g, not %.9g", value, expected);
}

static double degc(const imucal_sensor_units_t* units, const imucal_sample_t* sample) {
  return (double)sample->temp_counts * (double)units->degc_per_count + (double)units->degc_at_zero;
}

static void assert_physical(const imucal_sensor_units_t* units, const imucal_sample_t* sample, const double dps[3],
                            const double g[3], double relative) {
  for (int i = 0; i < 3; i++) {
    assert_close(sample->counts[i] * (double)units->dps_per_count, dps[i], fabs(dps[i]) * relative + 1e-9);
    assert_close(sample->counts[3 + i] * (double)units->g_per_count, g[i], fabs(g[i]) * relative + 1e-9);
  }
}

/* ---- ICM-42688-P ---- */

static imucal_icm42688p_t icm;

static imucal_sensor_bus_t open_icm(void) {
  const imucal_sensor_bus_t bus = open_bus(true, 0, 0x30); /* FIFO_DATA 30h: DS-000347 14.24; PX4 */
  bus_log.bank_reg = 0x76;                                 /* REG_BANK_SEL 76h: DS-000347 14.59; PX4, Zephyr */
  bus_log.reg[0][0x75] = 0x47;                             /* WHO_AM_I 75h, 47h: DS-000347 14.58; PX4 */
  bus_log.reg[0][0x2D] = 0x10; /* INT_STATUS 2Dh, bit 4 after a reset: DS-000347 14.21; PX4 */
  set_reset(0, 0x11, 0x01);    /* DEVICE_CONFIG 11h, bit 0: DS-000347 14.1; PX4 */
  return bus;
}

static void test_icm_settings(void** state) {
  (void)state;
  /* Rate codes of GYRO_CONFIG0 4Fh and ACCEL_CONFIG0 50h, bits 3:0: Zephyr icm42688_reg.h. */
  static const struct {
    uint32_t rate_hz;
    uint8_t code;
  } rates[] = {{8000, 0x03}, {4000, 0x04}, {2000, 0x05}, {1000, 0x06}, {500, 0x0F},
               {200, 0x07},  {100, 0x08},  {50, 0x09},   {25, 0x0A}};
  for (size_t i = 0; i < sizeof rates / sizeof rates[0]; i++) {
    const imucal_sensor_bus_t bus = open_icm();
    /* FS_SEL bits 7:5: 3 is 250 dps, 2 is 4 g: DS-000347 tables 1 and 2; PX4, Zephyr */
    const imucal_icm42688p_config_t config = {
        .rate_hz = rates[i].rate_hz, .gyro_fs_sel = 3, .accel_fs_sel = 2, .filter = 1};
    assert_int_equal(imucal_icm42688p_start(&icm, &bus, &config), IMUCAL_OK);
    assert_written(0, 0x4F, (uint8_t)(0x60 | rates[i].code));
    assert_written(0, 0x50, (uint8_t)(0x40 | rates[i].code));
    assert_written(0, 0x5F, 0x07); /* FIFO_CONFIG1 5Fh: temperature, gyro, accelerometer: DS-000347 14.45; PX4 */
  }
}

static void test_icm_start(void** state) {
  (void)state;
  const imucal_sensor_bus_t bus = open_icm();
  const imucal_icm42688p_config_t config = {.rate_hz = 1000, .is_high_resolution = true, .filter = 1};
  assert_int_equal(imucal_icm42688p_start(&icm, &bus, &config), IMUCAL_OK);
  assert_pause_after(find_write(0, 0x11, 0x01), 1000, false); /* 1 ms: DS-000347 14.1; PX4 */
  const access_t* on = find_write(0, 0x4E, 0x0F);             /* PWR_MGMT0 4Eh, both low noise: DS-000347 14.36; PX4 */
  assert_pause_after(on, 200, true);                          /* no write for 200 us: DS-000347 14.36 */
  assert_true(bus_log.now_us - on->at_us >= 45000);           /* gyro on for at least 45 ms: DS-000347 14.36 */
  assert_written(0, 0x5F, 0x17); /* FIFO_CONFIG1: bit 4 FIFO_HIRES_EN too: DS-000347 14.45; PX4 */
  assert_written(0, 0x16, 0x40); /* FIFO_CONFIG 16h, bits 7:6 = 01 stream: DS-000347 14.4; Zephyr */
  assert_written(0, 0x4C, 0x33); /* INTF_CONFIG0 4Ch: reset 30h, bits 1:0 = 11 I2C off: DS-000347 14.34; PX4 */
  assert_written(0, 0x52, 0x11); /* GYRO_ACCEL_CONFIG0 52h, 1: ODR/4: Zephyr */
  assert_written(0, 0x54, 0x21); /* TMST_CONFIG 54h: reset 23h, bit 1 FSYNC off: DS-000347 14.42; PX4 */
  assert_written(0, 0x64, 0x00); /* INT_CONFIG1 64h, bit 4 to 0: DS-000347 12.6; PX4 */
  assert_written(0, 0x4B, 0x02); /* SIGNAL_PATH_RESET 4Bh, bit 1 FIFO_FLUSH: DS-000347 14.33; PX4 */
  /* All that is not rate, range or mode is written before the sensors are on: DS-000347 12.9. */
  for (const access_t* a = on + 1; a < bus_log.log + bus_log.n_accesses; a++)
    assert_true(!a->is_write || a->reg == 0x4B);
}

/* FIFO packet 4, DS-000347 6.1 and PX4 FIFO::DATA: header, accelerometer, gyro (high word first), temperature, time stamp,
 * then accelerometer bits 3:0 in the high nibble, gyro bits 3:0 in the low one (Zephyr icm4268x_decoder.c).
 * 18 bits at 8192 per g, two zero bits below; 19 bits at 131 per dps, one zero bit below (DS-000347 6.1; PX4). */
static const uint8_t icm_packet4[20] = {
    0x78,                               /* 0110 10xx and bit 4, 20 bits */
    0x08, 0x00, 0xF4, 0x00, 0x00, 0x00, /* 8192 * 4 = 08000h; -12287 * 4 = F4004h; 3 * 4 = 0000Ch */
    0x06, 0x65, 0xFF, 0xFF, 0xC0, 0x09, /* 13100 * 2 = 06658h; -1 * 2 = FFFFEh; -131000 * 2 = C0090h */
    0x05, 0x2D,                         /* 1325 = 132.48 * 10.0015 */
    0x12, 0x34, 0x08, 0x4E, 0xC0};

static void test_icm_packet_of_20_bytes(void** state) {
  (void)state;
  const imucal_sensor_bus_t bus = open_icm();
  const imucal_icm42688p_config_t config = {.rate_hz = 1000, .is_high_resolution = true};
  assert_int_equal(imucal_icm42688p_start(&icm, &bus, &config), IMUCAL_OK);
  bus_log.reg[0][0x2D] = 0;
  bus_log.reg[0][0x2F] = 20; /* FIFO_COUNTH 2Eh, FIFO_COUNTL 2Fh, bytes: DS-000347 14.22; PX4 */
  set_stream(icm_packet4, 20);
  imucal_sample_t sample;
  uint32_t n;
  assert_int_equal(imucal_icm42688p_read(&icm, 1000000, &sample, 1, &n), IMUCAL_OK);
  assert_int_equal(n, 1);
  const int32_t expected[6] = {13100, -1, -131000, 8192, -12287, 3};
  for (int i = 0; i < 6; i++) assert_int_equal(sample.counts[i], expected[i]);
  const imucal_sensor_units_t units = imucal_icm42688p_units(&config);
  assert_physical(&units, &sample, (double[]){100.0, -1 / 131.0, -1000.0}, (double[]){1.0, -12287 / 8192.0, 3 / 8192.0},
                  1e-3);
  assert_close(degc(&units, &sample), 35.0015, 0.001); /* / 132.48 + 25: DS-000347 4.13; PX4 */
  /* -524288 marks an invalid sample: DS-000347 12.8; Zephyr, PX4. */
  uint8_t invalid[20];
  memcpy(invalid, icm_packet4, 20);
  invalid[9] = 0x80, invalid[10] = 0x00, invalid[18] = 0x40;
  set_stream(invalid, 20);
  assert_int_equal(imucal_icm42688p_read(&icm, 1001000, &sample, 1, &n), IMUCAL_OK);
  assert_int_equal(n, 0);
  assert_int_equal(icm.counts.n_invalid, 1);
  set_stream(icm_packet4, 20);
  bus_log.reg[0][0x2D] = 0x02; /* INT_STATUS bit 1 FIFO_FULL_INT: DS-000347 14.21; PX4 */
  assert_int_equal(imucal_icm42688p_read(&icm, 1002000, &sample, 1, &n), IMUCAL_OK);
  assert_int_equal(icm.counts.n_overruns, 1);
  bus_log.reg[0][0x2D] = 0x0D; /* threshold, data ready, AGC: no fault */
  assert_int_equal(imucal_icm42688p_read(&icm, 1003000, &sample, 1, &n), IMUCAL_OK);
  assert_int_equal(icm.counts.n_overruns, 1);
}

static void test_icm_packet_of_16_bytes(void** state) {
  (void)state;
  /* Packet 3: 8 bits of temperature (not used, TEMP_DATA1 1Dh is read), then the time stamp: DS-000347 6.1; Zephyr. */
  static const uint8_t packet[16] = {0x68, 0x20, 0x00, 0xE0, 0x00, 0x00, 0x01, 0x33,
                                     0x34, 0xCC, 0xCC, 0x00, 0x01, 0x15, 0x00, 0x01};
  const imucal_sensor_bus_t bus = open_icm();
  const imucal_icm42688p_config_t config = {.rate_hz = 1000, .gyro_fs_sel = 3, .accel_fs_sel = 2};
  assert_int_equal(imucal_icm42688p_start(&icm, &bus, &config), IMUCAL_OK);
  bus_log.reg[0][0x2D] = 0;
  bus_log.reg[0][0x2F] = 16;
  bus_log.reg[0][0x1D] = 0xF2, bus_log.reg[0][0x1E] = 0x58; /* -3496: 25 - 26.389 */
  set_stream(packet, 16);
  imucal_sample_t sample;
  uint32_t n;
  assert_int_equal(imucal_icm42688p_read(&icm, 1000000, &sample, 1, &n), IMUCAL_OK);
  assert_int_equal(n, 1);
  const imucal_sensor_units_t units = imucal_icm42688p_units(&config);
  /* 131 per dps at 250 dps, 8192 per g at 4 g: DS-000347 tables 1 and 2 */
  assert_physical(&units, &sample, (double[]){13108 / 131.0, -13108 / 131.0, 1 / 131.0},
                  (double[]){1.0, -1.0, 1 / 8192.0}, 1e-3);
  assert_close(degc(&units, &sample), 25.0 - 3496 / 132.48, 0.001);
}

static void test_icm_self_test(void** state) {
  (void)state;
  const imucal_sensor_bus_t bus = open_icm();
  const imucal_icm42688p_config_t config = {.rate_hz = 1000};
  assert_int_equal(imucal_icm42688p_start(&icm, &bus, &config), IMUCAL_OK);
  /* XG_ST_DATA bank 1 5Fh to 61h, XA_ST_DATA bank 2 3Bh to 3Dh: Zephyr.  2620 * 1.01^(code - 1) at 250 dps and 2 g, half
   * to one and a half allowed: INV_ST_OTP_EQUATION of TDK's icm426xx drivers, fs 3.  1.01^100 = 2.704814. */
  static const uint8_t gyro_codes[3] = {1, 101, 2}, accel_codes[3] = {101, 1, 2};
  memcpy(&bus_log.reg[1][0x5F], gyro_codes, 3);
  memcpy(&bus_log.reg[2][0x3B], accel_codes, 3);
  imucal_sensor_self_test_t test;
  assert_int_equal(imucal_icm42688p_self_test(&icm, &test), IMUCAL_OK);
  (void)find_write(0, 0x70, 0x7F); /* SELF_TEST_CONFIG 70h: bit 6 power, 5:3 accelerometer, 2:0 gyro: DS-000347 14.57 */
  assert_written(0, 0x70, 0x00);
  (void)find_write(0, 0x4F, 0x66); /* 250 dps, 2 g, 1 kHz */
  (void)find_write(0, 0x50, 0x66);
  assert_read(0, 0x1F); /* ACCEL_DATA_X1 1Fh, then the gyro from 25h: Zephyr */
  const double factor[6] = {1.0, 2.704814, 1.01, 2.704814, 1.0, 1.01};
  for (int i = 0; i < 6; i++) {
    const double response = 2620.0 * factor[i] / (i < 3 ? 131.072 : 16384.0);
    assert_close((double)test.low[i], 0.5 * response, 1e-3 * response);
    assert_close((double)test.high[i], 1.5 * response, 1e-3 * response);
  }
}

/* ---- MPU-6050, MPU-6500 ---- */

static imucal_mpu6050_t mpu;
static const imucal_mpu6050_config_t mpu_usual = {.rate_hz = 200, .gyro_fs_sel = 3, .accel_fs_sel = 2, .filter = 3};

static imucal_sensor_bus_t open_mpu(uint8_t who_am_i) {
  const imucal_sensor_bus_t bus = open_bus(false, 0, 0x74); /* FIFO_R_W 74h: RM-MPU-6000A p. 44; Linux inv_mpu_iio.h */
  bus_log.reg[0][0x75] = who_am_i;                          /* WHO_AM_I 75h: RM-MPU-6000A p. 8; Linux (117) */
  set_reset(0, 0x6B, 0x80);                                 /* PWR_MGMT_1 6Bh, bit 7: RM-MPU-6000A p. 8; Linux */
  return bus;
}

static void assert_fifo_never_reset_while_on(void) {
  /* USER_CTRL 6Ah: FIFO_RESET (bit 2) works while FIFO_EN (bit 6) is 0: RM-MPU-6000A 4.29, as i2cdevlib's MPU6050 quotes
   * it; Linux inv_mpu6050_prepare_fifo resets first and switches on in a second write. */
  bool was_reset = false;
  for (uint32_t i = 0; i < bus_log.n_accesses; i++) {
    const access_t* a = bus_log.log + i;
    if (!a->is_write || a->reg != 0x6A || !(a->value & 0x04)) continue;
    assert_int_equal(a->value, 0x04);
    was_reset = true;
  }
  assert_true(was_reset);
  assert_written(0, 0x6A, 0x40);
}

static void test_mpu_start(void** state) {
  (void)state;
  /* 68h MPU-6050, 70h MPU-6500, 71h MPU-9250: Linux inv_mpu_iio.h */
  static const uint8_t identities[3] = {0x68, 0x70, 0x71};
  for (int i = 0; i < 3; i++) {
    const imucal_sensor_bus_t bus = open_mpu(identities[i]);
    assert_int_equal(imucal_mpu6050_start(&mpu, &bus, &mpu_usual), IMUCAL_OK);
    const access_t* reset = find_write(0, 0x6B, 0x80);
    assert_pause_after(reset, 100000, false); /* 100 ms: Linux INV_MPU6050_POWER_UP_TIME */
    assert_written(0, 0x6B, 0x01);            /* awake, CLKSEL 1: Linux INV_CLK_PLL */
    assert_written(0, 0x19, 4);               /* SMPLRT_DIV 19h: 1000 / (1 + 4): Linux FIFO_RATE_TO_DIVIDER */
    assert_written(0, 0x1A, 3);               /* CONFIG 1Ah: DLPF_CFG 3: Linux INV_MPU6050_FILTER_45HZ */
    assert_written(0, 0x1B, 0x18);            /* GYRO_CONFIG 1Bh, bits 4:3 = 3: 2000 dps: Linux */
    assert_written(0, 0x1C, 0x10);            /* ACCEL_CONFIG 1Ch, bits 4:3 = 2: 8 g: Linux */
    assert_written(0, 0x23, 0xF8);            /* FIFO_EN 23h: 80h temperature, 70h gyros, 08h accelerometer: Linux */
    assert_written(0, 0x38, 0x10);            /* INT_ENABLE 38h, overflow, as 3Ah bit 4: Linux */
    if (i > 0)
      assert_written(0, 0x1D, 3); /* ACCEL_CONFIG_2 1Dh: Linux, from the MPU-6500 on */
    else
      assert_null(last_write(0, 0x1D));
    assert_fifo_never_reset_while_on();
    /* Gyro start-up 60 ms, MPU-6500 70 ms: Linux INV_MPU6050_GYRO_STARTUP_TIME, INV_MPU6500_GYRO_STARTUP_TIME */
    assert_true(last_write(0, 0x6A)->at_us - find_write(0, 0x6B, 0x01)->at_us >= 70000);
  }
  imucal_sensor_bus_t spi = open_mpu(0x70);
  spi.is_spi = bus_log.is_spi = true;
  assert_int_equal(imucal_mpu6050_start(&mpu, &spi, &mpu_usual), IMUCAL_OK);
  assert_written(0, 0x6A, 0x50);                    /* bit 4 I2C_IF_DIS: RM-MPU-6000A p. 8; Linux */
  const imucal_sensor_bus_t other = open_mpu(0x98); /* ICM-20689: Linux */
  assert_int_equal(imucal_mpu6050_start(&mpu, &other, &mpu_usual), IMUCAL_ERR_SENSOR);
}

static void test_mpu_packet(void** state) {
  (void)state;
  /* FIFO in order of register number, 3Bh accelerometer, 41h temperature, 43h gyro, high byte first: RM-MPU-6000A p. 44;
   * Linux inv_mpu6050_scan.  -12420 and -7011 are 0 degC: Linux INV_MPU6050_TEMP_OFFSET, INV_MPU6500_TEMP_OFFSET. */
  static const uint8_t packets[2][14] = {
      {0x10, 0x00, 0xF0, 0x00, 0x08, 0x00, 0xCF, 0x7C, 0x06, 0x68, 0xBF, 0xF0, 0x00, 0x01},
      {0x10, 0x00, 0xF0, 0x00, 0x08, 0x00, 0xE4, 0x9D, 0x06, 0x68, 0xBF, 0xF0, 0x00, 0x01}};
  /* Linux INV_MPU6050_TEMP_SCALE and INV_MPU6500_TEMP_SCALE: milli-degC per count */
  static const double milli_degc[2] = {2.941176, 2.995178};
  /* Linux gyro_scale_6050[3] rad/s per count; accel_scale[2] m/s2 per count */
  const double dps = 0.001064724 * 180.0 / 3.14159265358979, g = 0.002392 / 9.80665;
  for (int k = 0; k < 2; k++) {
    const imucal_sensor_bus_t bus = open_mpu(k ? 0x70 : 0x68);
    assert_int_equal(imucal_mpu6050_start(&mpu, &bus, &mpu_usual), IMUCAL_OK);
    bus_log.reg[0][0x73] = 14; /* FIFO_COUNTH 72h, FIFO_COUNTL 73h: RM-MPU-6000A p. 43; Linux, big-endian */
    set_stream(packets[k], 14);
    imucal_sample_t sample;
    uint32_t n;
    assert_int_equal(imucal_mpu6050_read(&mpu, 1000000, &sample, 1, &n), IMUCAL_OK);
    assert_int_equal(n, 1);
    const int32_t expected[6] = {1640, -16400, 1, 4096, -4096, 2048};
    for (int i = 0; i < 6; i++) assert_int_equal(sample.counts[i], expected[i]);
    const imucal_sensor_units_t units = imucal_mpu6050_units(&mpu);
    assert_physical(&units, &sample, (double[]){1640 * dps, -16400 * dps, dps},
                    (double[]){4096 * g, -4096 * g, 2048 * g}, 1e-3);
    assert_close(degc(&units, &sample), 0.0, 0.01);
    assert_close((double)units.degc_per_count * 1000.0, milli_degc[k], 1e-4);
  }
}

static void test_mpu_overflow_empties_the_fifo(void** state) {
  (void)state;
  const imucal_sensor_bus_t bus = open_mpu(0x68);
  assert_int_equal(imucal_mpu6050_start(&mpu, &bus, &mpu_usual), IMUCAL_OK);
  bus_log.n_accesses = 0;
  bus_log.reg[0][0x3A] = 0x10; /* INT_STATUS 3Ah, bit 4: Linux INV_MPU6050_BIT_FIFO_OVERFLOW_INT */
  bus_log.reg[0][0x72] = 0x04; /* 1024 bytes: Linux reads the count big-endian */
  imucal_sample_t sample;
  uint32_t n;
  assert_int_equal(imucal_mpu6050_read(&mpu, 1000000, &sample, 1, &n), IMUCAL_OK);
  assert_int_equal(mpu.counts.n_overruns, 1);
  assert_fifo_never_reset_while_on();
}

static void test_mpu_factory_trim(void** state) {
  (void)state;
  /* RM-MPU-6000A 4.1, as public self-tests have it: gyro 25 * 131 * 1.046^(code-1), y negative, at 131 per dps;
   * accelerometer 4096 * 0.34 * (0.92/0.34)^((code-1)/30): code 1 is 0.34 g, code 31 is 0.92 g; within 14 %.
   * 0Dh to 0Fh: accelerometer bits 4:2 above, gyro 5 bits; 10h: accelerometer bits 1:0, x in 5:4. */
  static const uint8_t codes[4] = {7 << 5 | 1, 0 << 5 | 1, 7 << 5 | 2, 3 << 4 | 1 << 2 | 3};
  const double trim[6] = {25.0, -25.0, 25.0 * 1.046, 0.92, 0.34, 0.92};
  imucal_sensor_bus_t bus = open_mpu(0x68);
  memcpy(&bus_log.reg[0][0x0D], codes, 4);
  imucal_sensor_self_test_t test;
  assert_int_equal(imucal_mpu6050_start(&mpu, &bus, &mpu_usual), IMUCAL_OK);
  assert_int_equal(imucal_mpu6050_self_test(&mpu, &test), IMUCAL_OK);
  for (int i = 0; i < 6; i++) {
    assert_close(((double)test.low[i] + (double)test.high[i]) / 2, trim[i], 1e-3 * fabs(trim[i]));
    assert_close((double)test.high[i] - (double)test.low[i], 0.28 * fabs(trim[i]), 1e-3 * fabs(trim[i]));
  }
  (void)find_write(0, 0x1B, 0xE0); /* 250 dps and the three self-test bits 7:5 */
  (void)find_write(0, 0x1C, 0xF0); /* 8 g and bits 7:5 */
  assert_read(0, 0x3B);            /* accelerometer 3Bh, temperature 41h, gyro 43h: Linux */
  /* MPU-6500, 00h to 02h and 0Dh to 0Fh: 2620 * 1.01^(code-1), table in public MPU-9250 self-tests; 1.01^100 = 2.704814 */
  bus = open_mpu(0x70);
  static const uint8_t gyro_codes[3] = {1, 101, 2}, accel_codes[3] = {101, 1, 2};
  const double factor[6] = {1.0, 2.704814, 1.01, 2.704814, 1.0, 1.01};
  memcpy(&bus_log.reg[0][0x00], gyro_codes, 3);
  memcpy(&bus_log.reg[0][0x0D], accel_codes, 3);
  assert_int_equal(imucal_mpu6050_start(&mpu, &bus, &mpu_usual), IMUCAL_OK);
  assert_int_equal(imucal_mpu6050_self_test(&mpu, &test), IMUCAL_OK);
  for (int i = 0; i < 6; i++) {
    const double response = 2620.0 * factor[i] / (i < 3 ? 131.072 : 16384.0);
    assert_close((double)test.low[i], 0.5 * response, 1e-3 * response);
  }
}

/* ---- LSM6DSO ---- */

static imucal_lsm6dso_t lsm;

static imucal_sensor_bus_t open_lsm(void) {
  const imucal_sensor_bus_t bus = open_bus(true, 0, 0x78); /* FIFO_DATA_OUT_TAG 78h: lsm6dso_reg.h; Linux */
  bus_log.reg[0][0x0F] = 0x6C;                             /* WHO_AM_I 0Fh, 6Ch: lsm6dso_reg.h */
  set_reset(0, 0x12, 0x01);                                /* CTRL3_C 12h, bit 0 SW_RESET: lsm6dso_reg.h */
  return bus;
}

static void test_lsm_settings(void** state) {
  (void)state;
  /* Codes of LSM6DSO_XL_ODR_*, GY_ODR_*, *_BATCHED_AT_*: lsm6dso_reg.h */
  static const struct {
    uint16_t rate_hz;
    uint8_t code;
  } rates[] = {{26, 2}, {52, 3}, {104, 4}, {208, 5}, {417, 6}, {833, 7}, {1667, 8}};
  /* LSM6DSO_2g = 0, 16g = 1, 4g = 2, 8g = 3, CTRL1_XL bits 3:2; LSM6DSO_250dps = 0, 500 = 2, 1000 = 4, 2000 = 6, CTRL2_G
   * bits 3:1; 0.061, 0.122, 0.244, 0.488 mg and 8.75, 17.5, 35, 70 mdps: lsm6dso_reg.h and .c */
  static const struct {
    uint8_t range_g, accel_code, gyro_code;
    double mg, mdps;
  } ranges[] = {{2, 0, 0, 0.061, 8.75}, {4, 2, 2, 0.122, 17.5}, {8, 3, 4, 0.244, 35.0}, {16, 1, 6, 0.488, 70.0}};
  for (uint8_t i = 0; i < 7; i++) {
    const uint8_t k = i & 3;
    const imucal_sensor_bus_t bus = open_lsm();
    const imucal_lsm6dso_config_t config = {
        .rate_hz = rates[i].rate_hz, .gyro_fs_sel = k, .accel_range_g = ranges[k].range_g, .filter = 3};
    assert_int_equal(imucal_lsm6dso_start(&lsm, &bus, &config), IMUCAL_OK);
    assert_written(0, 0x10, (uint8_t)(rates[i].code << 4 | ranges[k].accel_code << 2)); /* CTRL1_XL 10h */
    assert_written(0, 0x11, (uint8_t)(rates[i].code << 4 | ranges[k].gyro_code << 1));  /* CTRL2_G 11h */
    assert_written(0, 0x09, (uint8_t)(rates[i].code << 4 | rates[i].code));             /* FIFO_CTRL3 09h: gyro above */
    const imucal_sensor_units_t units = imucal_lsm6dso_units(&config);
    assert_close((double)units.g_per_count * 1000.0, ranges[k].mg, 1e-6);
    assert_close((double)units.dps_per_count * 1000.0, ranges[k].mdps, 1e-4);
    (void)find_write(0, 0x12, 0x01);
    assert_written(0, 0x12, 0x44);                    /* CTRL3_C: bit 6 BDU, bit 2 IF_INC: lsm6dso_reg.h */
    assert_written(0, 0x13, 0x06);                    /* CTRL4_C 13h: bit 2 I2C off, bit 1 LPF1: lsm6dso_reg.h */
    assert_written(0, 0x15, 0x02);                    /* CTRL6_C 15h: FTYPE bits 2:0: lsm6dso_reg.h */
    assert_true(last_write(0, 0x18)->value >> 1 & 1); /* CTRL9_XL 18h: bit 1 I3C off: lsm6dso_reg.h */
    assert_written(0, 0x0A, 0x06);                    /* FIFO_CTRL4 0Ah: LSM6DSO_STREAM_MODE: lsm6dso_reg.h; Linux */
  }
}

static void test_lsm_words(void** state) {
  (void)state;
  /* Tag: sensor in bits 7:3 (1 gyro, 2 accelerometer), counter 2:1, bit 0 parity: lsm6dso_reg.h; the whole byte's parity is
   * even: st_fifo.c.  Words low byte first: Linux st_lsm6dsx_buffer.c. */
  static const uint8_t words[28] = {0x09, 0x95, 0x05, 0x18, 0xFC, 0x01, 0x00,  /* slot 0: gyro */
                                    0x11, 0x05, 0x20, 0xFB, 0xDF, 0x01, 0x00,  /* accelerometer */
                                    0x0A, 0x01, 0x00, 0x00, 0x00, 0x00, 0x00,  /* slot 1 */
                                    0x13, 0x00, 0x00, 0x00, 0x00, 0x05, 0x20}; /* parity wrong: 12h is right */
  const imucal_sensor_bus_t bus = open_lsm();
  const imucal_lsm6dso_config_t config = {.rate_hz = 833, .gyro_fs_sel = 3, .accel_range_g = 4};
  bus_log.reg[0][0x63] =
      0xEC; /* INTERNAL_FREQ_FINE 63h: -20 steps of 0.15 %: lsm6dso_reg.h; Linux (37.5 ns of 25 us) */
  assert_int_equal(imucal_lsm6dso_start(&lsm, &bus, &config), IMUCAL_OK);
  assert_close((double)lsm.clock.period_q16_us / 65536.0, 1200.0 / 0.97, 0.1);
  bus_log.reg[0][0x3A] = 4;                                 /* FIFO_STATUS1 3Ah: words: lsm6dso_reg.h */
  bus_log.reg[0][0x20] = 0x00, bus_log.reg[0][0x21] = 0xF6; /* OUT_TEMP_L 20h: -2560 / 256 + 25: lsm6dso_reg.c */
  set_stream(words, sizeof words);
  imucal_sample_t samples[4];
  uint32_t n;
  assert_int_equal(imucal_lsm6dso_read(&lsm, 1000000, samples, 4, &n), IMUCAL_OK);
  assert_int_equal(n, 1);
  assert_int_equal(lsm.counts.n_invalid, 1);
  const imucal_sensor_units_t units = imucal_lsm6dso_units(&config);
  /* 70 mdps, 0.122 mg: lsm6dso_reg.c */
  assert_physical(&units, samples, (double[]){100.03, -70.0, 0.07}, (double[]){1.000034, -1.000034, 0.000122}, 1e-5);
  assert_close(degc(&units, samples), 15.0, 1e-5);
  /* FIFO_STATUS2 3Bh: bits 1:0 are bits 9:8 of the level, bits 6 and 3 overrun: lsm6dso_reg.h */
  bus_log.reg[0][0x3A] = 0, bus_log.reg[0][0x3B] = 0x40 | 0x02;
  set_stream(words, 0);
  assert_int_equal(imucal_lsm6dso_read(&lsm, 1005000, samples, 0, &n), IMUCAL_OK);
  assert_int_equal(lsm.counts.n_overruns, 1);
  bus_log.reg[0][0x3B] = 0x08;
  assert_int_equal(imucal_lsm6dso_read(&lsm, 1006000, samples, 0, &n), IMUCAL_OK);
  assert_int_equal(lsm.counts.n_overruns, 2);
  bus_log.reg[0][0x3B] = 0xB4; /* watermark, full, counter: nothing lost */
  assert_int_equal(imucal_lsm6dso_read(&lsm, 1007000, samples, 0, &n), IMUCAL_OK);
  assert_int_equal(lsm.counts.n_overruns, 2);
  bus_log.reg[0][0x3B] = 0x03; /* 768 words: more than the 512 there are */
  assert_int_equal(imucal_lsm6dso_read(&lsm, 1008000, samples, 0, &n), IMUCAL_ERR_SENSOR);
  bus_log.reg[0][0x3B] = 0x01; /* 256 */
  lsm.n_in_fifo = 0;
  set_stream(words, sizeof words);
  assert_int_equal(imucal_lsm6dso_read(&lsm, 1009000, samples, 1, &n), IMUCAL_OK);
  assert_int_equal(n, 1);
}

static void test_lsm_self_test_register(void** state) {
  (void)state;
  const imucal_sensor_bus_t bus = open_lsm();
  const imucal_lsm6dso_config_t config = {.rate_hz = 208, .gyro_fs_sel = 3, .accel_range_g = 4};
  imucal_sensor_self_test_t test;
  assert_int_equal(imucal_lsm6dso_start(&lsm, &bus, &config), IMUCAL_OK);
  assert_int_equal(imucal_lsm6dso_self_test(&lsm, &test), IMUCAL_OK);
  (void)find_write(0, 0x14, 0x05); /* CTRL5_C 14h: ST_G bits 3:2 = 1, ST_XL bits 1:0 = 1: lsm6dso_reg.h */
  assert_read(0, 0x22);            /* OUTX_L_G 22h, then OUTX_L_A 28h: lsm6dso_reg.h */
}

/* ---- BMI088: device 0 the accelerometer, 1 the gyro ---- */

static imucal_bmi088_t bmi;

static imucal_sensor_bus_t open_bmi(void) {
  const imucal_sensor_bus_t bus = open_bus(true, 1, 0x3F); /* gyro FIFO_DATA 3Fh: bmi08_defs.h; PX4 */
  bus_log.has_dummy = true;                                /* accelerometer on SPI: PX4, datasheet 6.1.2 */
  bus_log.reg[0][0x00] = 0x1E;                             /* ACC_CHIP_ID 00h: DS001 p. 20; bmi08x.h */
  bus_log.reg[1][0x00] = 0x0F;                             /* GYRO_CHIP_ID 00h: DS001 p. 27; bmi08_defs.h */
  set_reset(0, 0x7E, 0xB6);                                /* ACC_SOFTRESET 7Eh: bmi08_defs.h; PX4 */
  set_reset(1, 0x14, 0xB6);                                /* GYRO_SOFTRESET 14h: bmi08_defs.h; PX4 */
  return bus;
}

static void test_bmi_settings(void** state) {
  (void)state;
  /* GYRO_BANDWIDTH 10h: BMI08_GYRO_BW_230_ODR_2000_HZ 1, 116/1000 2, 47/400 3, 23/200 4, 12/100 5, bit 7 as at reset;
   * ACC_CONF 40h: BMI08_ACCEL_BW_NORMAL Ah, 1600 Hz Ch, 400 Ah, 200 9, 100 8: bmi08_defs.h */
  static const struct {
    uint16_t rate_hz;
    uint8_t bandwidth, accel_conf;
  } rates[] = {{2000, 0x81, 0xAC}, {1000, 0x82, 0xAC}, {400, 0x83, 0xAA}, {200, 0x84, 0xA9}, {100, 0x85, 0xA8}};
  for (uint8_t i = 0; i < 5; i++) {
    const imucal_sensor_bus_t bus = open_bmi();
    const imucal_bmi088_config_t config = {.rate_hz = rates[i].rate_hz, .gyro_fs_sel = i, .accel_fs_sel = i & 3};
    assert_int_equal(imucal_bmi088_start(&bmi, &bus, &config), IMUCAL_OK);
    assert_written(1, 0x10, rates[i].bandwidth);
    assert_written(0, 0x40, rates[i].accel_conf);
    assert_written(1, 0x0F, i);                                  /* GYRO_RANGE 0Fh: 0 is 2000 dps: bmi08_defs.h */
    assert_written(0, 0x41, i & 3);                              /* ACC_RANGE 41h: 0 is 3 g: bmi08x.h */
    assert_written(0, 0x7C, 0x00);                               /* ACC_PWR_CONF 7Ch: active: bmi08_defs.h; PX4 */
    assert_written(0, 0x7D, 0x04);                               /* ACC_PWR_CTRL 7Dh: on: bmi08_defs.h */
    assert_written(1, 0x3E, 0x80);                               /* FIFO_CONFIG_1 3Eh: stream, bits 7:6: bmi08_defs.h */
    assert_pause_after(find_write(1, 0x14, 0xB6), 30000, false); /* 30 ms: bmi08_defs.h; PX4 */
    assert_pause_after(find_write(0, 0x7E, 0xB6), 1000, false);  /* 1 ms: bmi08_defs.h; PX4 */
    assert_pause_after(find_write(0, 0x7C, 0x00), 450, false);   /* 450 us after suspend: bmi08a.c */
    assert_pause_after(find_write(0, 0x7D, 0x04), 50000, false); /* 50 ms: datasheet 3; Bosch waits 5 ms */
    const imucal_sensor_units_t units = imucal_bmi088_units(&config);
    /* 16.384 per dps at 2000 dps and up: PX4.  int16 / 32768 * 1.5 * 2^(range + 1) g: DS001 p. 21; PX4 */
    assert_close((double)units.dps_per_count, 1.0 / (16.384 * (1 << i)), 1e-7);
    assert_close((double)units.g_per_count, 1.5 * (2 << (i & 3)) / 32768.0, 1e-9);
  }
}

static void test_bmi_words(void** state) {
  (void)state;
  const imucal_sensor_bus_t bus = open_bmi();
  const imucal_bmi088_config_t config = {.rate_hz = 1000, .gyro_fs_sel = 0, .accel_fs_sel = 1};
  assert_int_equal(imucal_bmi088_start(&bmi, &bus, &config), IMUCAL_OK);
  /* Frames of 6 bytes without a header, low byte first: PX4; rate registers DS001 p. 27 */
  static const uint8_t frames[12] = {0x01, 0x00, 0x02, 0x00, 0x03, 0x00, 0x66, 0x06, 0x9A, 0xF9, 0x01, 0x00};
  static const uint8_t accel[6] = {0x55, 0x15, 0xAB, 0xEA, 0x01, 0x00}; /* ACC_X_LSB 12h: DS001 p. 20 */
  memcpy(&bus_log.reg[0][0x12], accel, 6);
  /* TEMP_MSB 22h, TEMP_LSB 23h: the table of DS001 5.3.7, p. 21 */
  static const struct {
    uint8_t msb, lsb;
    double degc;
  } temps[] = {{0x3E, 0x00, 85.0}, {0x00, 0x60, 23.375}, {0x00, 0x20, 23.125}, {0x00, 0x00, 23.0}, {0xC1, 0x00, -40.0}};
  bus_log.reg[1][0x0E] = 2; /* FIFO_STATUS 0Eh: frames in bits 6:0: bmi08_defs.h; PX4 */
  set_stream(frames, 12);
  imucal_sample_t samples[2];
  uint32_t n;
  const imucal_sensor_units_t units = imucal_bmi088_units(&config);
  for (uint32_t i = 0; i < 5; i++) {
    bus_log.reg[0][0x22] = temps[i].msb, bus_log.reg[0][0x23] = temps[i].lsb;
    assert_int_equal(imucal_bmi088_read(&bmi, 1000000 + 1000 * i, samples, 2, &n), IMUCAL_OK);
    assert_int_equal(n, 2);
    assert_int_equal(samples[0].counts[2], 3);
    assert_int_equal(samples[1].fault, 0);
    assert_close(degc(&units, samples + 1), temps[i].degc, 1e-6);
    assert_physical(&units, samples + 1, (double[]){1638 / 16.384, -1638 / 16.384, 1 / 16.384},
                    (double[]){5461 / 32768.0 * 6, -5461 / 32768.0 * 6, 6 / 32768.0}, 1e-6);
  }
  bus_log.reg[0][0x22] = 0x80; /* invalid: same table */
  bus_log.reg[1][0x0E] = 1;
  assert_int_equal(imucal_bmi088_read(&bmi, 1006000, samples, 2, &n), IMUCAL_OK);
  assert_int_equal(n, 1);
  assert_int_equal(samples[0].fault, 0x3F);
}

static void test_bmi_overrun(void** state) {
  (void)state;
  const imucal_sensor_bus_t bus = open_bmi();
  const imucal_bmi088_config_t config = {.rate_hz = 1000};
  assert_int_equal(imucal_bmi088_start(&bmi, &bus, &config), IMUCAL_OK);
  bus_log.n_accesses = 0;
  bus_log.reg[1][0x0E] = 0x80 | 100; /* bit 7 overrun: bmi08_defs.h; PX4 */
  imucal_sample_t sample;
  uint32_t n;
  assert_int_equal(imucal_bmi088_read(&bmi, 1000000, &sample, 1, &n), IMUCAL_OK);
  assert_int_equal(bmi.counts.n_overruns, 1);
  /* A write of FIFO_CONFIG_0 3Dh empties the FIFO, one of FIFO_CONFIG_1 3Eh clears the flag: PX4 BMI088_Gyroscope.cpp. */
  assert_written(1, 0x3D, 0x00);
  assert_written(1, 0x3E, 0x80);
  assert_true(last_write(1, 0x3D) < last_write(1, 0x3E));
}

static void test_bmi_self_test(void** state) {
  (void)state;
  const imucal_sensor_bus_t bus = open_bmi();
  const imucal_bmi088_config_t config = {.rate_hz = 1000};
  imucal_sensor_self_test_t test;
  bus_log.reg[0][0x12] = 1;
  assert_int_equal(imucal_bmi088_start(&bmi, &bus, &config), IMUCAL_OK);
  assert_int_equal(imucal_bmi088_self_test(&bmi, &test), IMUCAL_OK);
  /* ACC_SELF_TEST 6Dh: 0Dh, 09h, 50 ms each; 24 g; 1000, 1000, 500 mg; gyro 3Ch bit 0 starts: bmi08_defs.h, bmi08xa.c */
  (void)find_write(0, 0x41, 0x03);
  assert_pause_after(find_write(0, 0x6D, 0x0D), 50000, false);
  assert_pause_after(find_write(0, 0x6D, 0x09), 50000, false);
  assert_written(0, 0x6D, 0x00);
  (void)find_write(1, 0x3C, 0x01);
  assert_close((double)test.low[3], 1.0, 1e-6);
  assert_close((double)test.low[4], 1.0, 1e-6);
  assert_close((double)test.low[5], 0.5, 1e-6);
}

/* ---- what is counted, by the registers that say it (fourth reading; README.md has the table) ---- */

static imucal_sensor_bus_t open_mpu_6050(void) {
  return open_mpu(0x68);
}
static const imucal_icm42688p_config_t icm_counted = {.rate_hz = 1000, .is_high_resolution = true};
static const imucal_lsm6dso_config_t lsm_counted = {.rate_hz = 833, .gyro_fs_sel = 3, .accel_range_g = 4};
static const imucal_bmi088_config_t bmi_counted = {.rate_hz = 1000};

typedef struct reg_value {
  uint8_t device, reg, value;
} reg_value_t;
static const struct counted {
  const imucal_sensor_driver_t* driver;
  void* sensor;
  const void* config;
  imucal_sensor_bus_t (*open)(void);
  reg_value_t identity;
  uint8_t others[3];       /* WHO_AM_I of relatives */
  reg_value_t asleep[5];   /* what registers hold after the chip reset itself; the first of its list sees it alone */
  reg_value_t harmless[4]; /* status bits that tell of nothing lost and no reset */
} counted[] = {
    /* WHO_AM_I 75h; ICM-42605 42h, ICM-42686-P 44h, ICM-40609-D 3Bh: PX4, Zephyr.  INT_STATUS 2Dh: bit 4 RESET_DONE, 3 DATA_RDY,
     * 2 FIFO_THS, 1 FIFO_FULL, 0 AGC_RDY: PX4 INT_STATUS_BIT; reset values 4Eh 00h, 16h 00h, 5Fh 00h: TDK register map. */
    {&imucal_icm42688p_driver,
     &icm,
     &icm_counted,
     open_icm,
     {0, 0x75, 0x47},
     {0x42, 0x44, 0x3B},
     {{0, 0x2D, 0x10}, {0, 0x4E, 0x00}, {0, 0x16, 0x00}, {0, 0x5F, 0x00}, {0, 0x4C, 0x30}},
     {{0, 0x2D, 0x08}, {0, 0x2D, 0x04}, {0, 0x2D, 0x01}, {0, 0x2D, 0x0D}}},
    /* WHO_AM_I 75h; ICM-20608 AFh, ICM-20689 98h, ICM-20602 12h: Linux inv_mpu_iio.h.  PWR_MGMT_1 6Bh: asleep, 40h, after a reset;
     * all others 00h: RM-MPU-6000A 3.  INT_STATUS 3Ah: bit 0 data ready, 3 I2C master: Linux, RM-MPU-6000A 4.17. */
    {&imucal_mpu6050_driver,
     &mpu,
     &mpu_usual,
     open_mpu_6050,
     {0, 0x75, 0x68},
     {0xAF, 0x98, 0x12},
     {{0, 0x6B, 0x40}, {0, 0x1B, 0x00}, {0, 0x1C, 0x00}, {0, 0x23, 0x00}, {0, 0x6A, 0x00}},
     {{0, 0x3A, 0x01}, {0, 0x3A, 0x08}, {0, 0x3A, 0x09}, {0, 0x3A, 0x40}}},
    /* WHO_AM_I 0Fh; LSM6DSL 6Ah, LSM6DS3 69h, LSM6DSR 6Bh: Linux st_lsm6dsx.  After a reset CTRL1_XL, CTRL2_G 00h, CTRL3_C 04h, FIFO_CTRL4
     * 00h: ArduPilot, lsm6dso_reg.h.  FIFO_STATUS2 3Bh: 7 watermark, 5 full, 4 counter: lsm6dso_fifo_status2_t. */
    {&imucal_lsm6dso_driver,
     &lsm,
     &lsm_counted,
     open_lsm,
     {0, 0x0F, 0x6C},
     {0x6A, 0x69, 0x6B},
     {{0, 0x10, 0x00}, {0, 0x11, 0x00}, {0, 0x12, 0x04}, {0, 0x0A, 0x00}, {0, 0x09, 0x00}},
     {{0, 0x3B, 0x80}, {0, 0x3B, 0x20}, {0, 0x3B, 0x10}, {0, 0x3B, 0xB0}}},
    /* ACC_CHIP_ID 00h: BMI085 1Fh: bmi08x.h; GYRO_CHIP_ID 0Fh below.  After a reset ACC_PWR_CTRL 00h, ACC_PWR_CONF 03h, ACC_CONF A8h, ACC_RANGE
     * 01h: DS001 5.3; bmi08_defs.h.  FIFO_STATUS 0Eh: bit 7 alone is the overrun: PX4 FIFO_STATUS_BIT. */
    {&imucal_bmi088_driver,
     &bmi,
     &bmi_counted,
     open_bmi,
     {0, 0x00, 0x1E},
     {0x1F, 0x0F, 0x10},
     {{0, 0x7D, 0x00}, {0, 0x7C, 0x03}, {0, 0x40, 0xA8}, {0, 0x41, 0x01}, {0, 0x6D, 0x00}},
     {{1, 0x0E, 0x00}, {1, 0x0E, 0x00}, {1, 0x0E, 0x00}, {1, 0x0E, 0x00}}},
};
enum { N_COUNTED = sizeof counted / sizeof counted[0] };

static const imucal_sensor_counts_t* counts_of(const struct counted* c) {
  return (const imucal_sensor_counts_t*)(const void*)((const uint8_t*)c->sensor + c->driver->counts_at);
}

static void put_reg(reg_value_t r) {
  bus_log.reg[r.device][r.reg] = r.value;
}

/* Nothing in the FIFO for two seconds. */
static imucal_status read_in_silence(const struct counted* c, uint64_t from_us) {
  imucal_sample_t samples[4];
  uint32_t n;
  imucal_status status = IMUCAL_OK;
  for (int i = 0; i < 3; i++) {
    status = c->driver->read(c->sensor, from_us + 1000000u * (unsigned)i, samples, 4, &n);
    assert_int_equal(n, 0);
  }
  return status;
}

static void start_counted(const struct counted* c, imucal_sensor_bus_t* bus) {
  *bus = c->open();
  set_stream(NULL, 0);
  assert_int_equal(c->driver->start(c->sensor, bus, c->config), IMUCAL_OK);
  if (c->driver == &imucal_icm42688p_driver) bus_log.reg[0][0x2D] = 0; /* cleared by reading */
}

static void test_each_register_of_a_reset_is_counted_as_one_reset(void** state) {
  (void)state;
  for (int k = 0; k < N_COUNTED; k++)
    for (int i = 0; i < 4; i++) {
      const struct counted* c = &counted[k];
      imucal_sensor_bus_t bus;
      start_counted(c, &bus);
      const bool is_flag =
          c->asleep[i].reg == 0x2D; /* the flag alone; the driver wants to see it after its own reset too */
      bus_log.n_accesses = 0;
      put_reg(c->asleep[i]);
      if (k == 0) bus_log.reg[0][0x2D] = 0x10;
      imucal_sample_t sample;
      uint32_t n;
      assert_int_equal(c->driver->read(c->sensor, 1000000, &sample, 1, &n), IMUCAL_OK);
      if (k == 0) bus_log.reg[0][0x2D] = 0;
      if (k > 0) (void)c->driver->read(c->sensor, 3000000, &sample, 1, &n);
      if (counts_of(c)->n_resets != 1)
        fail_msg("%s, register %02X: %u", c->driver->name, c->asleep[i].reg, counts_of(c)->n_resets);
      assert_int_equal(counts_of(c)->n_identity + counts_of(c)->n_bus_errors + counts_of(c)->n_overruns, 0);
      if (!is_flag) assert_true(last_write(c->asleep[i].device, c->asleep[i].reg) != NULL); /* set up again */
      bus_log.n_accesses = 0;
      (void)read_in_silence(c, 3000001);
      assert_int_equal(counts_of(c)->n_resets, 1);
    }
}

/* A relative's identity is one wrong identity; a line that is stuck says 00h or FFh and is a bus error. */
static void test_identities_of_relatives_are_counted_and_flat_ones_are_bus_errors(void** state) {
  (void)state;
  for (int k = 0; k < N_COUNTED; k++)
    for (int i = 0; i < 5; i++) {
      const struct counted* c = &counted[k];
      const imucal_sensor_bus_t bus = c->open();
      const reg_value_t wrong = {c->identity.device, c->identity.reg, i < 3 ? c->others[i] : i == 3 ? 0x00 : 0xFF};
      put_reg(wrong);
      assert_int_equal(c->driver->start(c->sensor, &bus, c->config), IMUCAL_ERR_SENSOR);
      assert_int_equal(counts_of(c)->n_identity, i < 3 ? 1 : 0);
      assert_int_equal(counts_of(c)->n_bus_errors, i < 3 ? 0 : 1);
      assert_int_equal(*((const uint8_t*)c->sensor + c->driver->identity_at), wrong.value);
    }
  const imucal_sensor_bus_t bus = open_bmi();
  bus_log.reg[1][0x00] = 0x00 | 0x0E; /* the BMI088's other half; 0Eh: no chip of Bosch's list */
  assert_int_equal(imucal_bmi088_start(&bmi, &bus, &bmi_counted), IMUCAL_ERR_SENSOR);
  assert_int_equal(bmi.counts.n_identity, 1);
}

static void test_status_bits_beside_the_flags_count_nothing(void** state) {
  (void)state;
  for (int k = 0; k < N_COUNTED; k++)
    for (int i = 0; i < 4; i++) {
      const struct counted* c = &counted[k];
      imucal_sensor_bus_t bus;
      imucal_sample_t sample;
      uint32_t n;
      start_counted(c, &bus);
      put_reg(c->harmless[i]);
      assert_int_equal(c->driver->read(c->sensor, 1000000, &sample, 1, &n), IMUCAL_OK);
      const imucal_sensor_counts_t* now = counts_of(c);
      assert_int_equal(
          now->n_overruns + now->n_resets + now->n_bus_errors + now->n_identity + now->n_lost + now->n_invalid, 0);
    }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_icm_settings),
      cmocka_unit_test(test_icm_start),
      cmocka_unit_test(test_icm_packet_of_20_bytes),
      cmocka_unit_test(test_icm_packet_of_16_bytes),
      cmocka_unit_test(test_icm_self_test),
      cmocka_unit_test(test_mpu_start),
      cmocka_unit_test(test_mpu_packet),
      cmocka_unit_test(test_mpu_overflow_empties_the_fifo),
      cmocka_unit_test(test_mpu_factory_trim),
      cmocka_unit_test(test_lsm_settings),
      cmocka_unit_test(test_lsm_words),
      cmocka_unit_test(test_lsm_self_test_register),
      cmocka_unit_test(test_bmi_settings),
      cmocka_unit_test(test_bmi_words),
      cmocka_unit_test(test_bmi_overrun),
      cmocka_unit_test(test_each_register_of_a_reset_is_counted_as_one_reset),
      cmocka_unit_test(test_identities_of_relatives_are_counted_and_flat_ones_are_bus_errors),
      cmocka_unit_test(test_status_bits_beside_the_flags_count_nothing),
      cmocka_unit_test(test_bmi_self_test),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
