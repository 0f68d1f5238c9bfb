// SPDX-License-Identifier: MIT
/* Purpose: a driver of firmware/sensors in an emulated device, its bus led out to a register-level model in another process
 * (tests/emu/sensor_server.c): the same driver, the same registers, the same faults as with a chip, in QEMU too.
 * Time is the model's: it moves on while the driver waits and while samples are read, as fast as the line takes the records.
 * On the wire, little-endian.  Request: u8 what (0 transfer, 1 wait, 2 begin the world anew) | u8 device | u16 n_out |
 * u16 n_in | u32 wait_us | n_out bytes.  Answer: i16 status | u8 1 where the world is at its end | u8 0 | u64 now_us | n_in
 * bytes.
 * Memory: sizeof(bus_sensor_t), some 3 KB, and 600 bytes of stack. */
#ifndef IMUCAL_PORT_SIM_BUS_SENSOR_H
#define IMUCAL_PORT_SIM_BUS_SENSOR_H
#include "app/port.h"
#include "board_options.h"
#include "sensors/bmi088.h"
#include "sensors/icm42688p.h"
#include "sensors/lsm6dso.h"
#include "sensors/mpu6050.h"
#include "sensors/source.h"

typedef struct bus_sensor {
  /* Set by the port.  All bytes, or false: the model is gone. */
  bool (*send)(void* ctx, const uint8_t* data, size_t n);
  bool (*receive)(void* ctx, uint8_t* data, size_t n);
  void* ctx;

  uint8_t kind; /* 1 + index of the sensor; 0: none */
  union {
    imucal_icm42688p_t icm;
    imucal_mpu6050_t mpu;
    imucal_lsm6dso_t lsm;
    imucal_bmi088_t bmi;
  } sensor;
  imucal_sensor_bus_t bus;
  imucal_source_t source;
  uint64_t now_us;
  bool is_started, has_ended, has_failed;
} bus_sensor_t;

/* name: icm42688p, mpu6050, mpu6500, lsm6dso, bmi088; fills channels, scales and rate of *board.  False: another name. */
bool bus_sensor_choose(bus_sensor_t* sensor, const char* name, imucal_board_t* board);

/* For imucal_port_t. */
imucal_port_sample_t bus_sensor_read(bus_sensor_t* sensor, imucal_sample_t* sample);
void bus_sensor_restart_if_ended(bus_sensor_t* sensor);
void bus_sensor_report(const bus_sensor_t* sensor, imucal_link_sensor_reply_t* report);
#endif
