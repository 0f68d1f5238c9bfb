// SPDX-License-Identifier: MIT
/* Purpose: ST LSM6DSO on SPI or I2C: gyro and accelerometer out of its FIFO of tagged words, thermometer from its
 * registers.  Source: ST DS12140 rev. 5 "LSM6DSO datasheet", sections 8 and 9 (registers), AN5192 section 9 (FIFO).
 * Use: start, then read before the FIFO is full: 512 words, two a sample: 256 samples.  SPI mode 3, up to 10 MHz.
 * Memory: sizeof(imucal_lsm6dso_t), 600 bytes of stack. */
#ifndef IMUCAL_SENSORS_LSM6DSO_H
#define IMUCAL_SENSORS_LSM6DSO_H
#include "sensor.h"

#if defined(__cplusplus)
extern "C" {
#endif

typedef struct imucal_lsm6dso_config {
  uint16_t rate_hz;      /* 26, 52, 104, 208, 417, 833 or 1667: CTRL1_XL 10h, CTRL2_G 11h; truly 6667 Hz / 2^n */
  uint8_t gyro_fs_sel;   /* 0..3: 250, 500, 1000, 2000 dps: 8.75 mdps per count and up (table 2) */
  uint8_t accel_range_g; /* 2, 4, 8 or 16: 0.061 mg per count and up */
  uint8_t filter;        /* 0: gyro's LPF1 off; 1..8: on, CTRL6_C FTYPE = filter - 1 */
} imucal_lsm6dso_config_t;

typedef struct imucal_lsm6dso {
  const imucal_sensor_bus_t* bus;
  imucal_lsm6dso_config_t config;
  imucal_sensor_counts_t counts;
  imucal_sensor_clock_t clock;
  imucal_sensor_watch_t watch;
  uint64_t alive_us;
  uint32_t n_in_fifo; /* whole samples left there */
  int32_t temp_counts;
  uint8_t half[6], tag; /* a word whose other one of its time slot has not come yet, and its tag */
  bool has_half;
  uint8_t identity; /* WHO_AM_I 0Fh: 6Ch */
} imucal_lsm6dso_t;

imucal_sensor_units_t imucal_lsm6dso_units(const imucal_lsm6dso_config_t* config);

/* As imucal_icm42688p_start; takes 100 ms.  The clock starts from INTERNAL_FREQ_FINE (63h). */
IMUCAL_MUST_USE imucal_status imucal_lsm6dso_start(imucal_lsm6dso_t* sensor, const imucal_sensor_bus_t* bus,
                                                   const imucal_lsm6dso_config_t* config);

/* As imucal_icm42688p_read. */
IMUCAL_MUST_USE imucal_status imucal_lsm6dso_read(imucal_lsm6dso_t* sensor, uint64_t now_us, imucal_sample_t* samples,
                                                  uint32_t capacity, uint32_t* n);

/* Board at rest, 0.6 s: 150 to 700 dps at 2000 dps, 50 to 1700 mg at 4 g (table 2 f., self-test change), either sign.
 * Ends with a start. */
IMUCAL_MUST_USE imucal_status imucal_lsm6dso_self_test(imucal_lsm6dso_t* sensor, imucal_sensor_self_test_t* test);

/* The same, for source.h. */
extern const imucal_sensor_driver_t imucal_lsm6dso_driver;

#if defined(__cplusplus)
}
#endif
#endif
