// SPDX-License-Identifier: MIT
/* Purpose: Bosch BMI088 on SPI: gyro and accelerometer are two chips with a chip select and a clock each; the gyro's FIFO
 * sets the pace, each gyro sample takes the newest accelerometer sample with it.
 * Source: BST-BMI088-DS001 rev. 1.9 "BMI088 datasheet", sections 3 to 5 (functions), 5.3 (accelerometer registers), 5.5
 * (gyro registers), 6 (SPI: a read of the accelerometer has a dummy byte before the data).
 * Bus: device 0 is the accelerometer (CSB1), device 1 the gyro (CSB2); mode 0 or 3, up to 10 MHz.
 * Use: start, then read before the gyro's FIFO is full: 100 samples.
 * Memory: sizeof(imucal_bmi088_t), 600 bytes of stack. */
#ifndef IMUCAL_SENSORS_BMI088_H
#define IMUCAL_SENSORS_BMI088_H
#include "sensor.h"

#if defined(__cplusplus)
extern "C" {
#endif

typedef struct imucal_bmi088_config {
  uint16_t rate_hz;     /* gyro: 2000, 1000, 400, 200 or 100 (GYRO_BANDWIDTH 10h: 230, 116, 47, 23, 12 Hz) */
  uint8_t gyro_fs_sel;  /* 0..4: 2000, 1000, 500, 250, 125 dps (GYRO_RANGE 0Fh) */
  uint8_t accel_fs_sel; /* 0..3: 3, 6, 12, 24 g (ACC_RANGE 41h) */
} imucal_bmi088_config_t;

typedef struct imucal_bmi088 {
  const imucal_sensor_bus_t* bus;
  imucal_bmi088_config_t config;
  imucal_sensor_counts_t counts;
  imucal_sensor_clock_t clock; /* the gyro's */
  imucal_sensor_watch_t watch;
  uint64_t alive_us, checked_us; /* samples came; both chips were found as they were set up */
  uint32_t n_in_fifo;
  int32_t accel[3], temp_counts;
  bool is_temp_valid;
  uint8_t accel_identity, gyro_identity; /* 1Eh, 0Fh */
  uint8_t identity;                      /* of the chip that is another one; the gyro's where both are right */
} imucal_bmi088_t;

imucal_sensor_units_t imucal_bmi088_units(const imucal_bmi088_config_t* config);

/* As imucal_icm42688p_start; takes 200 ms. */
IMUCAL_MUST_USE imucal_status imucal_bmi088_start(imucal_bmi088_t* sensor, const imucal_sensor_bus_t* bus,
                                                  const imucal_bmi088_config_t* config);

/* As imucal_icm42688p_read.  The accelerometer has no say in the FIFO: once a second it is asked whether it is still set up.
 * While it marks its temperature as invalid all fault bits are set. */
IMUCAL_MUST_USE imucal_status imucal_bmi088_read(imucal_bmi088_t* sensor, uint64_t now_us, imucal_sample_t* samples,
                                                 uint32_t capacity, uint32_t* n);

/* Board at rest, 0.4 s.  Accelerometer (section 4.6.1, 24 g): positive minus negative deflection at least 1 g on x, y and 0.5 g on z.
 * Gyro (4.6.2): its built-in self-test says pass or fail for all three; the response reads 1 or 0.  Ends with a start. */
IMUCAL_MUST_USE imucal_status imucal_bmi088_self_test(imucal_bmi088_t* sensor, imucal_sensor_self_test_t* test);

/* The same, for source.h. */
extern const imucal_sensor_driver_t imucal_bmi088_driver;

#if defined(__cplusplus)
}
#endif
#endif
