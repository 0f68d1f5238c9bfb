// SPDX-License-Identifier: MIT
/* Purpose: TDK InvenSense ICM-42688-P on SPI: gyro, accelerometer, thermometer out of its FIFO.
 * Source: TDK DS-000347 "ICM-42688-P datasheet" rev. 1.7; register addresses below are bank/address of its section 13
 * and 14 ff. (user banks 0 to 4), FIFO packets of its section 6.
 * Use: start, then read before the FIFO is full, 2048 / (packet bytes) samples (100 ms at 1 kHz), until a read is not full:
 * one hands out 512 / (packet bytes) at most, 25.  SPI mode 0 or 3, up to 24 MHz.
 * Memory: sizeof(imucal_icm42688p_t) and 600 bytes of stack.  Time: one or two transfers per read, 20 bytes a sample. */
#ifndef IMUCAL_SENSORS_ICM42688P_H
#define IMUCAL_SENSORS_ICM42688P_H
#include "sensor.h"

#if defined(__cplusplus)
extern "C" {
#endif

typedef struct imucal_icm42688p_config {
  /* 8000, 4000, 2000, 1000, 500, 200, 100, 50 or 25: GYRO_ODR and ACCEL_ODR, registers 4Fh and 50h. */
  uint32_t rate_hz;
  /* true: 20-byte packets (packet 4): gyro 19 bits at +-2000 dps, accelerometer 18 bits at +-16 g whatever the ranges
   * say, temperature 16 bits.  false: 16-byte packets (packet 3) at the ranges below. */
  bool is_high_resolution;
  uint8_t gyro_fs_sel;  /* 0..7: 2000, 1000, 500, 250, 125, 62.5, 31.25, 15.625 dps (register 4Fh) */
  uint8_t accel_fs_sel; /* 0..3: 16, 8, 4, 2 g (register 50h) */
  uint8_t filter;       /* 0..7: bandwidth of the user-interface filter, register 52h: 0 is ODR/2, 7 ODR/40 */
} imucal_icm42688p_config_t;

typedef struct imucal_icm42688p {
  const imucal_sensor_bus_t* bus;
  imucal_icm42688p_config_t config;
  imucal_sensor_counts_t counts;
  imucal_sensor_clock_t clock;
  imucal_sensor_watch_t watch;
  uint64_t alive_us;   /* when samples last came */
  uint32_t n_in_fifo;  /* left there by the last read */
  uint16_t last_ticks; /* time stamp of the last packet */
  int32_t temp_counts; /* last valid */
  uint8_t identity;    /* what WHO_AM_I said: 0x47 */
  bool has_ticks;
} imucal_icm42688p_t;

/* What the counts of this configuration mean. */
imucal_sensor_units_t imucal_icm42688p_units(const imucal_icm42688p_config_t* config);

/* Resets and configures; takes 60 ms by bus->delay_us.  IMUCAL_ERR_ARGUMENT: a setting the chip does not have;
 * IMUCAL_ERR_SENSOR: another chip, a stuck bus, or registers that do not hold what was written (sensor->identity and
 * sensor->counts say which); or the bus's error.  May be called again at any time. */
IMUCAL_MUST_USE imucal_status imucal_icm42688p_start(imucal_icm42688p_t* sensor, const imucal_sensor_bus_t* bus,
                                                     const imucal_icm42688p_config_t* config);

/* The samples that wait, oldest first, at most `capacity` and at most what one burst holds; *n says how many.
 * IMUCAL_OK: also with *n = 0.  IMUCAL_ERR_SENSOR: no sample for 20 ms and 50 periods, and it neither answers as it
 * should nor could be set up again: call start later.  A sensor that reset itself is set up again here. */
IMUCAL_MUST_USE imucal_status imucal_icm42688p_read(imucal_icm42688p_t* sensor, uint64_t now_us,
                                                    imucal_sample_t* samples, uint32_t capacity, uint32_t* n);

/* Runs the self-test (datasheet section 4.9; SELF_TEST_CONFIG 70h) at +-250 dps and +-2 g with the board at rest, 1 s;
 * limits: half to one and a half of the factory's response where it is stored, else 60 dps and 50 to 1200 mg.  Ends with
 * a start.  IMUCAL_OK: it ran; test->failed says the rest. */
IMUCAL_MUST_USE imucal_status imucal_icm42688p_self_test(imucal_icm42688p_t* sensor, imucal_sensor_self_test_t* test);

/* The same, for source.h. */
extern const imucal_sensor_driver_t imucal_icm42688p_driver;

#if defined(__cplusplus)
}
#endif
#endif
