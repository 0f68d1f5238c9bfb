// SPDX-License-Identifier: MIT
/* What the register-level sensor models share: the world they measure, time that passes when somebody waits, and a bus
 * that can be broken in every way the drivers must notice.  The models are written from the data sheets' register
 * descriptions; they know nothing of the drivers. */
#ifndef IMUCAL_TESTS_EMU_SENSOR_BUS_H
#define IMUCAL_TESTS_EMU_SENSOR_BUS_H
#include <math.h>
#include <string.h>

#include "sensors/sensor.h"

typedef enum { EMU_BUS_GOOD, EMU_BUS_ZEROS, EMU_BUS_ONES, EMU_BUS_ERRORS } emu_fault_t;

/* What the sensor feels at its k-th sample. */
typedef struct emu_world {
  double rate_dps[3], accel_g[3], temp_degc;
} emu_world_t;

typedef struct emu_bus {
  double now_us;      /* the board's clock */
  double clock_error; /* the sensor's clock runs faster by this factor minus 1 */
  emu_fault_t fault;
  uint32_t n_transfers, n_violations; /* the data sheet's rules broken: writes too early, to read-only, unknown */
  void (*feel)(void* ctx, uint64_t k, double t_us, emu_world_t* world); /* null: at rest, 25 degC */
  void* feel_ctx;
} emu_bus_t;

/* Applies the bus's fault to an answer; returns the transfer's status. */
static inline imucal_status emu_bus_answer(emu_bus_t* bus, uint8_t* in, size_t n_in) {
  bus->n_transfers++;
  if (bus->fault == EMU_BUS_ZEROS && n_in) memset(in, 0x00, n_in);
  if (bus->fault == EMU_BUS_ONES && n_in) memset(in, 0xFF, n_in);
  return bus->fault == EMU_BUS_ERRORS ? IMUCAL_ERR_SENSOR : IMUCAL_OK;
}

static inline void emu_feel(emu_bus_t* bus, uint64_t k, double t_us, emu_world_t* world) {
  memset(world, 0, sizeof *world);
  world->accel_g[2] = 1.0;
  world->temp_degc = 25.0;
  if (bus->feel) bus->feel(bus->feel_ctx, k, t_us, world);
}

/* To the nearest whole number between -limit and limit. */
static inline int32_t emu_round(double value, int32_t limit) {
  const double rounded = floor(value + 0.5);
  return rounded > limit ? limit : rounded < -limit ? -limit : (int32_t)rounded;
}

static inline void emu_put_be16(uint8_t* bytes, int32_t value) {
  bytes[0] = (uint8_t)((uint32_t)value >> 8);
  bytes[1] = (uint8_t)value;
}

static inline void emu_put_le16(uint8_t* bytes, int32_t value) {
  bytes[0] = (uint8_t)value;
  bytes[1] = (uint8_t)((uint32_t)value >> 8);
}

/* White noise of one count and more from a counter: models are deterministic. */
static inline double emu_noise(uint64_t k, uint32_t salt) {
  uint64_t x = (k + 1) * 0x9E3779B97F4A7C15u + (uint64_t)salt * 0xD1B54A32D192ED03u;
  x = (x ^ x >> 30) * 0xBF58476D1CE4E5B9u;
  x = (x ^ x >> 27) * 0x94D049BB133111EBu;
  x ^= x >> 31;
  return ((double)(x >> 11) / 9007199254740992.0 - 0.5) * 3.4641016151377544; /* unit variance */
}
#endif
