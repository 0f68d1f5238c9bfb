// SPDX-License-Identifier: MIT
/* Purpose: InvenSense MPU-6050 on I2C, and MPU-6500 (also the 6-axis part of the MPU-9250) on I2C or SPI: gyro,
 * accelerometer, thermometer out of the FIFO, 14 bytes a sample; the sensor has no time stamps of its own.
 * Source: "MPU-6000 and MPU-6050 Register Map and Descriptions" RM-MPU-6000A-00 rev. 4.2; "MPU-6500 Register Map and
 * Descriptions" RM-MPU-6500A-00 rev. 2.1.  Register numbers (hex) are the same in both where nothing is said.
 * Use: start, then read before the FIFO is full: 73 samples (1024 bytes), MPU-6500: 36 (512 bytes).
 * At 400 kHz a sample takes 0.35 ms of I2C: at most 1 kHz, better 200 Hz.
 * Memory: sizeof(imucal_mpu6050_t), 600 bytes of stack. */
#ifndef IMUCAL_SENSORS_MPU6050_H
#define IMUCAL_SENSORS_MPU6050_H
#include "sensor.h"

#if defined(__cplusplus)
extern "C" {
#endif

typedef struct imucal_mpu6050_config {
  uint16_t rate_hz;     /* 1000 / n, n = 1..250: SMPLRT_DIV 19h */
  uint8_t gyro_fs_sel;  /* 0..3: 250, 500, 1000, 2000 dps (GYRO_CONFIG 1Bh) */
  uint8_t accel_fs_sel; /* 0..3: 2, 4, 8, 16 g (ACCEL_CONFIG 1Ch) */
  uint8_t filter;       /* 1..6: DLPF_CFG of CONFIG 1Ah: gyro 188, 98, 42, 20, 10, 5 Hz (MPU-6500: 184, 92, 41 ...) */
  uint8_t
      identity; /* take this WHO_AM_I alone: the two chips' thermometers differ, and so do the board's units; 0: any */
} imucal_mpu6050_config_t;

typedef struct imucal_mpu6050 {
  const imucal_sensor_bus_t* bus;
  imucal_mpu6050_config_t config;
  imucal_sensor_counts_t counts;
  imucal_sensor_clock_t clock;
  imucal_sensor_watch_t watch;
  uint64_t alive_us;
  uint32_t n_in_fifo;
  uint8_t identity; /* WHO_AM_I 75h: 68h MPU-6050, 70h MPU-6500, 71h MPU-9250 */
  bool is_6500;
} imucal_mpu6050_t;

/* Valid after start: the two chips' thermometers differ. */
imucal_sensor_units_t imucal_mpu6050_units(const imucal_mpu6050_t* sensor);

/* As imucal_icm42688p_start: takes 180 ms. */
IMUCAL_MUST_USE imucal_status imucal_mpu6050_start(imucal_mpu6050_t* sensor, const imucal_sensor_bus_t* bus,
                                                   const imucal_mpu6050_config_t* config);

/* As imucal_icm42688p_read.  The chip overwrites bytes, not packets: after an overrun the FIFO is emptied, and all that
 * was in it counts as lost. */
IMUCAL_MUST_USE imucal_status imucal_mpu6050_read(imucal_mpu6050_t* sensor, uint64_t now_us, imucal_sample_t* samples,
                                                  uint32_t capacity, uint32_t* n);

/* Board at rest, 1 s.  MPU-6050 (registers 0Dh to 10h): within 14 % of the factory trim at 250 dps, 8 g.  MPU-6500
 * (registers 00h to 02h, 0Dh to 0Fh): 0.5 to 1.5 of the factory's at 250 dps, 2 g.  Without factory values (code 0) an
 * axis fails: there is nothing to compare with.  Ends with a start. */
IMUCAL_MUST_USE imucal_status imucal_mpu6050_self_test(imucal_mpu6050_t* sensor, imucal_sensor_self_test_t* test);

/* The same, for source.h. */
extern const imucal_sensor_driver_t imucal_mpu6050_driver;

#if defined(__cplusplus)
}
#endif
#endif
