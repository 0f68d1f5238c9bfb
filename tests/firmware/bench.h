// SPDX-License-Identifier: MIT
/* A device on the bench: the app on callbacks of this machine's memory, and the host's end of its line. */
#ifndef IMUCAL_TESTS_BENCH_H
#define IMUCAL_TESTS_BENCH_H
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "app/app.h"
#include "check/reference.h"
#include "num.h"
#include "port/sim/nor.h"

#define BENCH_SLOT_BYTES 1024u
#define BENCH_SERIAL "bench-1"

typedef struct {
  imucal_app_t app;
  imucal_port_t port;
  imucal_board_t board;

  nor_t nor;
  uint8_t flash[2 * BENCH_SLOT_BYTES];

  uint8_t to_device[4096];
  size_t to_at, to_end;
  uint32_t line_room; /* bytes the line still takes; SIZE like UINT32_MAX: no limit */

  imucal_link_rx_t host_rx;
  uint8_t sequence;
  uint32_t token, number; /* of the running unlock; 0: none */
  uint8_t reply_id;
  imucal_link_any_t reply;
  bool has_reply;
  uint32_t n_replies;

  /* streamed records as they came */
  uint32_t n_second, n_innovation, n_progress, n_event;
  imucal_link_second_t second; /* the last one */
  imucal_link_progress_t progress;
  imucal_link_event_t event[32];
  uint32_t n_counter_jumps; /* SECOND records lost on the way */

  /* the sensor */
  uint64_t t_us;
  uint32_t step_us;
  uint32_t n_left; /* samples until the end of the feed */
  bool ends;       /* at the end: IMUCAL_PORT_ENDED rather than nothing */
  uint32_t n_read, n_enabled;
  void (*shape)(uint64_t t_us, imucal_sample_t* sample); /* null: zeros */
  imucal_sample_t last_raw;
  int32_t last_out[IMUCAL_MAX_CHANNELS];
  uint8_t last_frac_bits[IMUCAL_MAX_CHANNELS], last_clamped;

  uint64_t time_us;
  uint32_t n_watchdog, n_reboots;
} bench_t;

/* Fills the bench with a board of three gyros and erased flash, and starts the app. */
void bench_start(bench_t* bench);

/* Power off and on: flash stays, everything else starts anew (the board and the sensor's settings stay). */
void bench_power_cycle(bench_t* bench);

/* Steps until nothing happens any more (or the watchdog limit of a million steps: the test fails). */
void bench_run(bench_t* bench);

/* Raw bytes to the device. */
void bench_send(bench_t* bench, const uint8_t* bytes, size_t n);

/* Unlocks the device; bench_ask does it where needed. */
void bench_unlock(bench_t* bench);

/* A request that changes something, in its envelope with the next number. */
imucal_link_command_t bench_command(bench_t* bench, uint32_t id, const void* message);

/* A request, in a COMMAND where it changes something; returns the id of the reply, which is in bench->reply. Fails the
 * test where none comes. */
uint8_t bench_ask(bench_t* bench, uint32_t id, const void* message);

/* A request that DONE answers: its status; bench->reply.done.detail besides. */
int bench_done(bench_t* bench, uint32_t id, const void* message);

int bench_stream(bench_t* bench, uint8_t what);
/* A gyro of 0.6 deg/sqrt(h), 20 dph with 100 s, 0 to 60 degC. */
int bench_cal_start(bench_t* bench, uint8_t channel, uint8_t order);
int bench_upload(bench_t* bench, const uint8_t* bytes, size_t n);

/* A valid table of this board with coefficient b0 on every channel; its length. */
size_t bench_table(const bench_t* bench, float b0, uint8_t* bytes);

/* b0 of the ruling table as the device reports it by TABLE_READ; fails the test where there is none. */
float bench_ruling_b0(bench_t* bench);

/* The sensor delivers n seconds of samples; runs them through. */
void bench_feed(bench_t* bench, uint32_t n_s);

uint32_t bench_events(const bench_t* bench, uint8_t code);
#endif
