// SPDX-License-Identifier: MIT
/* Purpose: everything the app asks of a board, as callbacks.  A new MCU = one filled imucal_port_t + one
 * imucal_board_t + a main that calls imucal_app_init once and imucal_app_step for ever (firmware/README.md).
 * All callbacks are called from imucal_app_init and imucal_app_step only, in the caller's context; none may
 * call back into the app.  ctx is the port's own and is passed to each.  Those that may be NULL say so. */
#ifndef IMUCAL_APP_PORT_H
#define IMUCAL_APP_PORT_H
#include "link.h"
#include "sample.h"
#include "store.h"

#if defined(__cplusplus)
extern "C" {
#endif

typedef enum imucal_port_sample {
  IMUCAL_PORT_NO_SAMPLE = 0,  /* none due */
  IMUCAL_PORT_SAMPLE = 1,     /* *sample is set */
  IMUCAL_PORT_BAD_SAMPLE = 2, /* one was lost or unreadable; counted */
  IMUCAL_PORT_ENDED = 3,      /* no more will come (end of a replayed feed) */
  IMUCAL_PORT_FAILED = 4      /* no more will come: the sensor or its feed cannot be read */
} imucal_port_sample_t;

typedef struct imucal_port {
  void* ctx;

  /* Take up to `capacity` bytes that have arrived; 0: none.  Never waits.  (More than was asked for, as an error code made a
   * size, counts as none; so below.) */
  size_t (*serial_read)(void* ctx, uint8_t* data, size_t capacity);

  /* Accept up to `length` bytes for sending; returns how many.  Never waits. */
  size_t (*serial_write)(void* ctx, const uint8_t* data, size_t length);

  /* The next sample in time order.  Never waits (a replay may, and a driver that is started again: 0.2 s, once a second).
   * Time stamps in us of one clock that does not run backwards; counts sign extended with the sensor's own fixed offset
   * removed; saturated and fault bits set. */
  imucal_port_sample_t (*sample_read)(void* ctx, imucal_sample_t* sample);

  /* Replays only, may be NULL: samples are (not) wanted from now on.  Wanted again after the end: start anew.
   */
  void (*sample_enable)(void* ctx, bool is_wanted);

  /* May be NULL.  Each sample after compensation, at full rate: what the rest of the firmware is there for.
   * out[i]: channel i in units of 2^-out_frac_bits[i] counts; clamped: bit i, temperature outside the valid
   * span. */
  void (*sample_out)(void* ctx, const imucal_sample_t* raw, const int32_t* out, const uint8_t* out_frac_bits,
                     uint8_t clamped);

  /* May be NULL.  What sensor and supply have met since the start, at once: the counts never go back.  Asked once a second
   * and by request SENSOR; *report comes all 0. */
  void (*sensor_report)(void* ctx, imucal_link_sensor_reply_t* report);

  /* Two table slots of flash: rules in common/store.h. */
  imucal_flash_t flash;

  /* Microseconds since start, 64 bits: a counter of 32 bits runs back after 71 minutes.  (Then, and after any step back, the
   * app's time goes on all the same, and EVENT CLOCK_BACK tells it; the time stamps of samples are common/clock.h's.) */
  uint64_t (*time_us)(void* ctx);

  /* Feed the watchdog: called once per step.  The longest step holds the first flash write, or ERASE: two slots erased; and
   * 900 bytes programmed and read back. */
  void (*watchdog)(void* ctx);

  /* Let the sent bytes out, then restart the device.  May return (then the main loop does the restart). */
  void (*reboot)(void* ctx);

  /* True for replays: samples are read only while the host streams SECOND, INNOVATION or PROGRESS, and never
   * faster than their records can be sent, so that nothing is lost.  False for a real sensor: samples are
   * always taken; records that do not fit the line are dropped and counted. */
  bool is_replay;

  uint32_t boot_id; /* unlike that of the last start, as UNLOCK's challenge is made of it: random, or a count */
  uint32_t n_watchdog_resets; /* as far as the board can tell; 0 otherwise */
  bool is_watchdog_reset;     /* this start was the watchdog's */
  const char* device;         /* name of board or port for HELLO, at most 23 characters; may be NULL */
} imucal_port_t;

#if defined(__cplusplus)
}
#endif
#endif
