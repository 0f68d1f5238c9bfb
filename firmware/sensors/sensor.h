// SPDX-License-Identifier: MIT
/* Purpose: what the sensor drivers of this folder share: the bus they are given, the counts of what went wrong,
 * the clock that turns "the n-th sample" into microseconds of the board, and the watch over stuck words.
 * Data: a driver's read function is given the board's time and fills imucal_sample_t (gyros x y z, then
 * accelerometers x y z, in the sensor's counts) in order of time.  Order: start once, read for ever.
 * Memory: the caller's structs; no heap, no globals.  Thread/ISR: one context per sensor.
 * Nothing here knows a processor: bus and delay are the only two callbacks. */
#ifndef IMUCAL_SENSORS_SENSOR_H
#define IMUCAL_SENSORS_SENSOR_H
#include "sample.h"
#include "status.h"

#if defined(__cplusplus)
extern "C" {
#endif

/* ---- the two callbacks ---- */

typedef struct imucal_sensor_bus {
  void* ctx;
  /* One transaction: select chip `device` (0; BMI088 also 1), send n_out >= 1 bytes, then receive n_in bytes,
   * deselect.  SPI: one chip select around all.  I2C: the address, the bytes, and for n_in > 0 a repeated start.
   * IMUCAL_OK, or what was wrong (no acknowledge, time-out, overrun); then `in` may hold anything. */
  imucal_status (*transfer)(void* ctx, uint8_t device, const uint8_t* out, size_t n_out, uint8_t* in, size_t n_in);
  void (*delay_us)(void* ctx, uint32_t us); /* waits at least so long */
  bool is_spi;                              /* SPI: bit 7 of the register address says "read" */
} imucal_sensor_bus_t;

/* Longest register write of a driver, address included, and longest burst it asks the bus for. */
#define IMUCAL_SENSOR_BURST_BYTES 512

/* ---- what went wrong, readable by anybody ---- */

typedef struct imucal_sensor_counts {
  uint32_t n_samples;    /* handed out */
  uint32_t n_saturated;  /* of these: at least one channel on its rail */
  uint32_t n_bus_errors; /* transfers that failed, or an answer that no sensor gives (all zeros or ones) */
  uint32_t n_overruns;   /* times the FIFO was full before it was read */
  uint32_t n_lost;       /* samples lost in overruns, gaps and resets, by the clock */
  uint32_t n_invalid;    /* packets refused: header, tag, parity or the sensor's own mark of invalid data */
  uint32_t n_resets;     /* the sensor was found in its reset state and was set up again */
  uint32_t n_stuck_temp; /* times the temperature word stood still for too long */
  uint32_t n_stuck_data; /* times all six words stood still for a second */
  uint32_t n_identity;   /* times another chip answered */
} imucal_sensor_counts_t;

/* ---- the sensor's clock in the board's clock ---- */

/* The newest sample in the FIFO is between 0 and 1 period old when its level is read.  A line through these points (least
 * squares over all bursts at first, over the last IMUCAL_SENSOR_CLOCK_MEMORY bursts in the long run: an alpha-beta
 * filter with the gains of the growing line fit, alpha = 2(2k-1)/(k(k+1)), beta = 6/(k(k+1))) gives the sample's
 * time and the sensor's true period.
 * Scaling and overflow: times are int64 in 2^-16 us: 4.4 years; periods up to 1 s are below 2^36; the largest product is
 * an error of at most 2^36 times 6 k: below 2^51. */
#define IMUCAL_SENSOR_CLOCK_MEMORY 1024

typedef struct imucal_sensor_clock {
  int64_t newest_q16_us;  /* time of the newest sample counted so far */
  int64_t period_q16_us;  /* estimated */
  int64_t nominal_q16_us; /* by the data sheet */
  int64_t last_handed_us; /* time stamps never run back */
  uint32_t n_bursts;      /* that the line holds, at most IMUCAL_SENSOR_CLOCK_MEMORY; 0: no anchor yet */
  uint32_t n_resyncs;     /* times the line was given up because the samples did not fit it */
} imucal_sensor_clock_t;

/* period_us: of the output data rate in force; > 0. */
void imucal_sensor_clock_init(imucal_sensor_clock_t* clock, uint32_t period_us_q8);

/* n new samples have come since the last call and now_us was read with the level; is_overrun: some were lost before
 * them.  Returns how many were lost before them (0 where neither an overrun nor a break was). */
uint32_t imucal_sensor_clock_burst(imucal_sensor_clock_t* clock, uint64_t now_us, uint32_t n, bool is_overrun);

/* Time of the sample `age` places behind the newest counted; never before the one handed out last. */
uint64_t imucal_sensor_clock_time_us(imucal_sensor_clock_t* clock, uint32_t age);

/* The samples' chain is broken (reset): the next burst is a new anchor; the period is kept. */
void imucal_sensor_clock_break(imucal_sensor_clock_t* clock);

/* Sensor clock against the board's in parts per million, positive: the sensor is fast.  Good to some ppm once n_bursts
 * has reached its memory. */
float imucal_sensor_clock_drift_ppm(const imucal_sensor_clock_t* clock);

/* ---- words that stand still ---- */

typedef struct imucal_sensor_watch {
  int32_t temp, sum;            /* last temperature word; a hash of the last six words */
  uint32_t n_same_temp, n_same; /* samples they have not changed for */
  /* Samples; 0: not watched.  limit_temp: longer than one step of the thermometer takes on the slowest soak, 60 s for fine words;
   * with one of 0.5 degC a healthy soak stands still for many minutes, and each second of it would be a fault. */
  uint32_t limit_temp, limit;
  bool is_temp_stuck, is_stuck;
} imucal_sensor_watch_t;

/* Looks at a sample, counts, and sets all fault bits of a sample whose words stand still. */
void imucal_sensor_watch(imucal_sensor_watch_t* watch, imucal_sensor_counts_t* counts, imucal_sample_t* sample);

/* What a driver's counts mean in its configuration, for imucal_board_t. */
typedef struct imucal_sensor_units {
  float dps_per_count, g_per_count;
  float degc_per_count, degc_at_zero; /* degC = counts * degc_per_count + degc_at_zero */
  int32_t gyro_rail_counts, accel_rail_counts;
} imucal_sensor_units_t;

/* Sets the saturated bits of a sample of six channels, and counts. */
void imucal_sensor_mark_rails(const imucal_sensor_units_t* units, imucal_sensor_counts_t* counts,
                              imucal_sample_t* sample);

/* No sample for 20 ms and 50 periods: something is wrong. */
bool imucal_sensor_is_silent(uint64_t alive_us, uint64_t now_us, uint32_t rate_hz);

/* ---- registers ---- */

/* Both count failures in *counts and pass the bus's status on.  n <= IMUCAL_SENSOR_BURST_BYTES. */
IMUCAL_MUST_USE imucal_status imucal_sensor_read_regs(const imucal_sensor_bus_t* bus, imucal_sensor_counts_t* counts,
                                                      uint8_t device, uint8_t reg, uint8_t* data, size_t n);
IMUCAL_MUST_USE imucal_status imucal_sensor_write_reg(const imucal_sensor_bus_t* bus, imucal_sensor_counts_t* counts,
                                                      uint8_t device, uint8_t reg, uint8_t value);

/* {register, value} pairs, then each is read back: IMUCAL_ERR_SENSOR where a register does not hold what was
 * written. */
typedef struct imucal_sensor_setting {
  uint8_t reg, value;
} imucal_sensor_setting_t;
IMUCAL_MUST_USE imucal_status imucal_sensor_write_settings(const imucal_sensor_bus_t* bus,
                                                           imucal_sensor_counts_t* counts, uint8_t device,
                                                           const imucal_sensor_setting_t* settings, size_t n);
/* IMUCAL_OK: all as written; IMUCAL_ERR_STATE: one is not (the sensor was reset); or the bus's error. */
IMUCAL_MUST_USE imucal_status imucal_sensor_check_settings(const imucal_sensor_bus_t* bus,
                                                           imucal_sensor_counts_t* counts, uint8_t device,
                                                           const imucal_sensor_setting_t* settings, size_t n);

/* An identity that is not the wanted one: another chip, or a stuck bus (0x00, 0xFF). */
void imucal_sensor_count_identity(imucal_sensor_counts_t* counts, uint8_t found);

/* Reads the identity until it is there, at most 3 times with pauses of 10 ms.  IMUCAL_ERR_SENSOR: answers, but is
 * another chip (or a stuck bus: 0x00 or 0xFF); *found holds what it said. */
IMUCAL_MUST_USE imucal_status imucal_sensor_identify(const imucal_sensor_bus_t* bus, imucal_sensor_counts_t* counts,
                                                     uint8_t device, uint8_t reg, uint8_t expected, uint8_t* found);

/* Words. */
int32_t imucal_sensor_be16(const uint8_t* bytes);
int32_t imucal_sensor_le16(const uint8_t* bytes);
/* Is every byte 0x00, or every byte 0xFF? */
bool imucal_sensor_is_flat(const uint8_t* bytes, size_t n);

/* ---- a driver as a value, for what must not care which it is (source.h) ---- */

typedef struct imucal_sensor_driver {
  const char* name; /* at most 15 characters */
  imucal_status (*start)(void* sensor, const imucal_sensor_bus_t* bus, const void* config);
  imucal_status (*read)(void* sensor, uint64_t now_us, imucal_sample_t* samples, uint32_t capacity, uint32_t* n);
  size_t counts_at, clock_at, identity_at; /* where the sensor's struct has them */
} imucal_sensor_driver_t;

/* ---- self-test ---- */

typedef struct imucal_sensor_self_test {
  float response[IMUCAL_MAX_CHANNELS]; /* dps, g: output with the test force minus without */
  float low[IMUCAL_MAX_CHANNELS];      /* allowed from here ... */
  float high[IMUCAL_MAX_CHANNELS];     /* ... to here */
  uint8_t failed;                      /* bit i: channel i is outside */
} imucal_sensor_self_test_t;

/* Sets `failed` from the three arrays. */
void imucal_sensor_judge(imucal_sensor_self_test_t* test);

#if defined(__cplusplus)
}
#endif
#endif
