// SPDX-License-Identifier: MIT
/* Purpose: a driver of this folder as the app's sensor (app/port.h): read when its time has come, started again when it has
 * failed for a second, and everything it counts kept over those starts for SENSOR of the link.
 * Order: imucal_source_init once, then imucal_source_read for ever.  Memory: the caller's.  Thread/ISR: one context. */
#ifndef IMUCAL_SENSORS_SOURCE_H
#define IMUCAL_SENSORS_SOURCE_H
#include "app/board.h"
#include "app/port.h"
#include "sensor.h"

#if defined(__cplusplus)
extern "C" {
#endif

#ifndef IMUCAL_SOURCE_BURST
#define IMUCAL_SOURCE_BURST 25 /* samples held between driver and app: 512 bytes of the longest packet */
#endif

typedef struct imucal_source {
  const imucal_sensor_driver_t* driver;
  const imucal_sensor_bus_t* bus;
  const void* config;
  void* sensor;
  uint32_t poll_us;
  uint32_t capacity; /* samples asked for at a time: IMUCAL_SOURCE_BURST, or fewer where the bus takes no long reads */
  imucal_status status;        /* of the newest start or read */
  uint64_t retry_us, due_us;   /* next start of a sensor that fails; next read */
  bool is_running;             /* the newest start went well */
  imucal_sensor_counts_t past; /* what the driver counted before its newest start, which begins at 0 */
  uint32_t n_starts;
  imucal_sample_t burst[IMUCAL_SOURCE_BURST];
  uint32_t at, n;
} imucal_source_t;

/* The driver, its struct and configuration (which must stay), how often it is read; and starts it, which takes up to 0.2 s.
 * poll_us: well below the time in which the sensor's FIFO fills; where more than `capacity` samples come in it, several reads
 * follow each other, each as long as the bus takes for them. */
void imucal_source_init(imucal_source_t* source, const imucal_sensor_driver_t* driver, void* sensor, const void* config,
                        const imucal_sensor_bus_t* bus, uint32_t poll_us, uint64_t now_us);

/* What imucal_port_t.sample_read returns: a sample, none, or a bad one: once per second while the sensor fails, when it is
 * started again. */
imucal_port_sample_t imucal_source_read(imucal_source_t* source, uint64_t now_us, imucal_sample_t* sample);

/* A board of these six channels: gyros in dph, accelerometers in mg.  Names and serial are left alone. */
void imucal_board_from_sensor(imucal_board_t* board, const imucal_sensor_units_t* units, uint32_t rate_hz);

/* The fields of the sensor; those of the supply are left alone. */
void imucal_source_report(const imucal_source_t* source, imucal_link_sensor_reply_t* report);

#if defined(__cplusplus)
}
#endif
#endif
