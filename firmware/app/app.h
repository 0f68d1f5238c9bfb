// SPDX-License-Identifier: MIT
/* Purpose: the life of a device: boot, load the table, take samples, compensate them at full rate, sum them
 * to seconds, calibrate, stream, and serve every request of common/link.h.  A pure function of the callbacks
 * in port.h: no globals, no heap, no waiting.
 * Data: sample_read -> comp -> sample_out;  raw and compensated -> clock -> sum -> SECOND;
 *       raw seconds -> health, learn per channel;  filters -> table -> store -> comp.
 * Order: imucal_app_init once per start, then imucal_app_step for ever.
 * Memory: sizeof(imucal_app_t), all of it the caller's.  Thread/ISR: one context. */
#ifndef IMUCAL_APP_H
#define IMUCAL_APP_H
#include "board.h"
#include "clock.h"
#include "comp.h"
#include "guard.h"
#include "health.h"
#include "learn.h"
#include "link.h"
#include "port.h"
#include "store.h"
#include "sum.h"
#include "table.h"
#include "version.h"

#if defined(__cplusplus)
extern "C" {
#endif

#define IMUCAL_FIRMWARE_VERSION IMUCAL_VERSION

/* Bytes waiting for the line.  What one sample brings takes at most IMUCAL_APP_BURST_BYTES: with six channels a second's
 * records are 292 bytes, an event is 18, and behind a gap the sample that was doubted ends a second and the next one
 * another.  A replay reads a sample where so much is free. */
#ifndef IMUCAL_APP_TX_BYTES
#define IMUCAL_APP_TX_BYTES 1024
#endif
#define IMUCAL_APP_BURST_BYTES 700
#if IMUCAL_APP_TX_BYTES < IMUCAL_APP_BURST_BYTES
#error "IMUCAL_APP_TX_BYTES must hold the records of two seconds: at least 700"
#endif

/* A calibration that hears nothing from a host for so long stops and keeps its filters; the device is free again. */
#ifndef IMUCAL_APP_SILENCE_S
#define IMUCAL_APP_SILENCE_S 21600u
#endif

/* Samples taken at most per step, so that a request waits no longer than that. */
#define IMUCAL_APP_SAMPLES_PER_STEP 64

/* What the host asked of one channel's calibration, beside the filter's own configuration. */
typedef struct imucal_app_channel {
  imucal_learn_t learn;
  imucal_health_t health; /* of what learn was given */
  imucal_comp_t comp;
  float span_lo_degc, span_hi_degc;
  float arw, markov_sigma[IMUCAL_TABLE_MARKOV_N], markov_tau_s[IMUCAL_TABLE_MARKOV_N];
  uint8_t n_markov;
} imucal_app_channel_t;

/* Readable by anybody, written only by the functions below. */
typedef struct imucal_app {
  const imucal_port_t* port;
  const imucal_board_t* board;
  imucal_app_channel_t channel[IMUCAL_MAX_CHANNELS];

  imucal_clock_t clock;
  imucal_sample_t doubted_raw, doubted_out; /* the last one that clock left out */
  imucal_sum_t raw_sum, out_sum;
  imucal_thermometer_t thermometer;
  uint8_t clamped;                       /* channels outside their valid span in the running second */
  uint8_t fault;                         /* channels that reported a fault in the last second */
  uint64_t watch_us;                     /* when the sensor's counts are looked at next where no second ends before */
  uint32_t seen[IMUCAL_SENSOR_N_COUNTS]; /* of the sensor's counts, at the last look */
  uint32_t growing;                      /* IMUCAL_SENSOR_*: those that grew then */
  bool has_sensor_ended;                 /* until samples are wanted again */
  bool is_enabled;                       /* last said to sample_enable */

  imucal_table_t table;             /* the ruling one where table_status is IMUCAL_OK */
  imucal_store_report_t report;     /* what the slots hold */
  imucal_status table_status;       /* IMUCAL_OK, or why the device runs uncompensated */
  imucal_store_work_t work;         /* the store's, and the staging area of an upload */
  uint16_t upload_total, upload_at; /* upload_total 0: no upload */
  uint32_t upload_crc;

  uint8_t session;     /* IMUCAL_SESSION_* */
  uint8_t calibrating; /* bit i: channel i has a filter */
  uint8_t stream_what, stream_channels;
  uint16_t progress_period_s;
  uint32_t t_s;               /* end of the newest second */
  uint32_t progress_t_s;      /* of the last PROGRESS */
  uint16_t stream_counter[4]; /* SECOND, INNOVATION, PROGRESS, EVENT */

  imucal_link_rx_t rx;
  imucal_link_server_t server;
  bool is_reply_due;  /* the kept reply waits for room in tx */
  bool is_reboot_due; /* when everything is sent, or at reboot_us */
  uint64_t reboot_us;
  uint8_t rx_bytes[32];
  uint8_t rx_at, rx_end;
  uint16_t tx_at, tx_end;
  uint8_t tx[IMUCAL_APP_TX_BYTES];

  imucal_app_guard_t guard;
  uint8_t request;                 /* type of the request being served, inside COMMAND or bare */
  uint8_t table_origin;            /* IMUCAL_ORIGIN_*, of the ruling table as flash says it */
  uint64_t now_us, time_offset_us; /* the newest time; what is added to the port's so that it runs forward only */
  uint32_t n_clock_back;           /* times the port's ran back */
  uint64_t heard_us;               /* when the last valid frame came */
  uint32_t n_locked, n_stale, n_unlock_refused, n_busy, n_reserved, n_table_refused, n_flash_failed, n_silent;

  uint32_t n_foreign; /* samples of another number of channels, in n_bad_samples too */
  uint32_t n_samples, n_bad_samples, n_seconds, n_gaps, n_tx_dropped, n_rx_unknown;
} imucal_app_t;

/* Starts: loads the table (or says why not, then runs uncompensated), queues the boot's events.  Stream EVENT
 * is on, the others off.  port and board must stay valid.  Fails only for a board that imucal_board_check refuses, for
 * flash that imucal_store_check does (no calibration could end in a table), and where a callback is missing that may not be
 * NULL: IMUCAL_ERR_ARGUMENT.  Then there is no step to call. */
IMUCAL_MUST_USE imucal_status imucal_app_init(imucal_app_t* app, const imucal_port_t* port,
                                              const imucal_board_t* board);

/* A bounded piece of work.  True: there was something to do; false: the caller may sleep until a byte or a
 * sample comes (or 10 ms have passed). */
bool imucal_app_step(imucal_app_t* app);

#if defined(__cplusplus)
}
#endif
#endif
