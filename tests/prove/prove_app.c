// SPDX-License-Identifier: MIT
/* What Frama-C Eva is to prove of the firmware's app, against the core as core_contracts.c states it: the boot, and from any
 * state inside the bounds that stand here each request, each sample, the end of samples.  Sensor, flash and clock
 * do anything that port.h allows.  Not the step that calls these: where the line takes a part of what waits, tx_at <= tx_end is a
 * relation that Eva does not keep; make fuzz-device is for that. */
#include <__fc_builtin.h>
#include <string.h>

#include "app/app.h"
#include "app/board.h"
#include "app/guard.h"
#include "app/parts.h"

static void any(void* at, unsigned size) {
  Frama_C_make_unknown((char*)at, size);
}
static uint32_t any_u32(void) {
  return Frama_C_unsigned_int_interval(0, 0xFFFFFFFFu);
}
static uint64_t any_u64(void) {
  return Frama_C_unsigned_long_long_interval(0, UINT64_MAX);
}
static bool any_bool(void) {
  return Frama_C_nondet(0, 1) != 0;
}

void prove_guard(void) {
  static imucal_app_guard_t guard;
  static imucal_link_unlock_t request;
  static imucal_link_unlock_reply_t reply;
  static char serial[IMUCAL_SERIAL_LEN];
  app_guard_init(&guard, any_u32(), any_u64());
  any(&guard, sizeof guard);
  guard.is_open = any_bool();
  any(&request, sizeof request);
  any(serial, sizeof serial);
  const uint64_t now_us = any_u64();
  (void)app_guard_left_s(&guard, now_us);
  (void)app_guard_unlock(&guard, &request, serial, now_us, &reply);
  (void)app_guard_take(&guard, any_u32(), any_u32(), any_u64());
}

void prove_board(void) {
  static imucal_board_t board;
  any(&board, sizeof board);
  (void)imucal_board_check(&board);
}

/* ---- a port that does what it likes ---- */

static size_t serial_read(void* ctx, uint8_t* data, size_t capacity) {
  (void)ctx;
  any(data, capacity);
  return Frama_C_unsigned_int_interval(0, capacity);
}
static size_t serial_write(void* ctx, const uint8_t* data, size_t length) {
  (void)ctx;
  //@ assert \valid_read(data + (0 .. length - 1));
  return Frama_C_unsigned_int_interval(0, length);
}
static imucal_port_sample_t sample_read(void* ctx, imucal_sample_t* sample) {
  (void)ctx;
  any(sample, sizeof *sample);
  return (imucal_port_sample_t)Frama_C_unsigned_int_interval(IMUCAL_PORT_NO_SAMPLE, IMUCAL_PORT_FAILED);
}
static void sample_enable(void* ctx, bool is_wanted) {
  (void)ctx;
  (void)is_wanted;
}
static void sample_out(void* ctx, const imucal_sample_t* raw, const int32_t* out, const uint8_t* out_frac_bits,
                       uint8_t clamped) {
  (void)ctx, (void)raw, (void)out, (void)out_frac_bits, (void)clamped;
}
static void sensor_report(void* ctx, imucal_link_sensor_reply_t* report) {
  (void)ctx;
  any(report, sizeof *report);
}
static imucal_status flash_read(void* ctx, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t len) {
  (void)ctx;
  //@ assert slot < 2;
  //@ assert offset + len <= 1024;
  any(data, len);
  return any_bool() ? IMUCAL_OK : IMUCAL_ERR_FLASH;
}
static imucal_status flash_erase(void* ctx, uint32_t slot) {
  (void)ctx, (void)slot;
  return any_bool() ? IMUCAL_OK : IMUCAL_ERR_FLASH;
}
static imucal_status flash_program(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len) {
  (void)ctx, (void)slot, (void)offset, (void)data, (void)len;
  return any_bool() ? IMUCAL_OK : IMUCAL_ERR_FLASH;
}
static uint64_t time_us(void* ctx) {
  (void)ctx;
  return any_u64();
}
static void nothing(void* ctx) {
  (void)ctx;
}

static imucal_app_t app;
static imucal_board_t board;
static imucal_port_t port;

static void any_board_and_port(void) {
  any(&board, sizeof board);
  board.n_channels = (uint8_t)Frama_C_unsigned_int_interval(1, IMUCAL_MAX_CHANNELS);
  board.rate_hz = Frama_C_unsigned_int_interval(1, IMUCAL_SUM_MAX_RATE_HZ);
  port = (imucal_port_t){.serial_read = serial_read, .serial_write = serial_write, .sample_read = sample_read};
  port.sample_enable = any_bool() ? sample_enable : NULL;
  port.sample_out = any_bool() ? sample_out : NULL;
  port.sensor_report = any_bool() ? sensor_report : NULL;
  port.flash.read = flash_read; /* the others are called by the store alone: prove_store */
  port.flash.erase = flash_erase, port.flash.program = flash_program;
  port.time_us = time_us;
  port.watchdog = port.reboot = nothing;
  port.is_replay = any_bool();
  port.is_watchdog_reset = any_bool();
  port.boot_id = any_u32();
  port.n_watchdog_resets = any_u32();
  port.device = any_bool() ? "a device with a name too long for its field" : NULL;
}

/* Any state between two calls of the app's parts.  tx_at: 0, as the line left it or tx_compact will. */
static void any_app(void) {
  any_board_and_port();
  any(&app, sizeof app);
  app.port = &port;
  app.board = &board;
  app.has_sensor_ended = any_bool();
  app.is_enabled = any_bool();
  app.is_reply_due = any_bool();
  app.is_reboot_due = any_bool();
  app.guard.is_open = any_bool();
  app.clock.has_released = any_bool();
  app.table.n_channels = (uint8_t)Frama_C_unsigned_int_interval(1, IMUCAL_MAX_CHANNELS);
  app.table_status = any_bool() ? IMUCAL_OK : IMUCAL_ERR_NO_TABLE;
  app.report.ruling = (int8_t)Frama_C_int_interval(-1, 1);
  if (app.table_status == IMUCAL_OK) app.report.ruling = (int8_t)Frama_C_int_interval(0, 1);
  for (int i = 0; i < IMUCAL_MAX_CHANNELS; i++)
    app.channel[i].n_markov = (uint8_t)Frama_C_unsigned_int_interval(0, IMUCAL_TABLE_MARKOV_N);
  app.upload_total = (uint16_t)Frama_C_unsigned_int_interval(0, IMUCAL_TABLE_MAX_BYTES);
  app.upload_at = (uint16_t)Frama_C_unsigned_int_interval(0, IMUCAL_TABLE_MAX_BYTES);
  app.rx.len = (uint16_t)Frama_C_unsigned_int_interval(6, IMUCAL_LINK_MAX_RAW);
  app.rx_at = app.rx_end = 0;
  app.tx_at = 0;
  app.tx_end = (uint16_t)Frama_C_unsigned_int_interval(0, sizeof app.tx);
  app.server.reply_len = (uint16_t)Frama_C_unsigned_int_interval(0, sizeof app.server.reply);
}

void prove_app_boot(void) {
  any_board_and_port();
  (void)!imucal_app_init(&app, &port, &board);
}

/* One request, alone or (inside: its id) in a COMMAND; each channel that it may name, and one beyond. */
extern uint8_t prove_inside, prove_channel;
static bool names_channel(uint8_t id) {
  return id == IMUCAL_LINK_ID_CAL_START || id == IMUCAL_LINK_ID_CAL_STATE || id == IMUCAL_LINK_ID_CAL_FILTER ||
         id == IMUCAL_LINK_ID_HEALTH;
}
static void request(uint8_t id, uint8_t inside) {
  const uint8_t last = names_channel(id) || names_channel(inside) ? IMUCAL_MAX_CHANNELS : 0;
  for (uint8_t channel = 0; channel <= last; channel++) {
    any_app();
    app.rx.buffer[0] = id;
    prove_inside = inside;
    prove_channel = channel;
    app_serve(&app);
  }
}

#define ALONE(id, name, NAME)                                                                                          \
  if (id < 0x40) request(id, 0);
#define IN_COMMAND(id, name, NAME)                                                                                     \
  if (imucal_link_is_guarded(id)) request(IMUCAL_LINK_ID_COMMAND, id);
void prove_app_request(void) {
  IMUCAL_LINK_MESSAGES(ALONE)
  request((uint8_t)Frama_C_unsigned_int_interval(0x26, 0x3F), 0);
}
void prove_app_command(void) {
  IMUCAL_LINK_MESSAGES(IN_COMMAND)
  request(IMUCAL_LINK_ID_COMMAND, (uint8_t)Frama_C_unsigned_int_interval(0, 9));
}

extern bool prove_ends_second[2];
static void sample_that(bool ends_raw, bool ends_out) {
  static imucal_sample_t sample;
  any_app();
  any(&sample, sizeof sample);
  prove_ends_second[0] = ends_raw;
  prove_ends_second[1] = ends_out;
  app_take_sample(&app, &sample);
}
void prove_app_sample(void) {
  sample_that(false, false);
  sample_that(false, true);
  sample_that(true, false);
  sample_that(true, true);
}

static void end_that(bool ends_raw, bool ends_out) {
  any_app();
  prove_ends_second[0] = ends_raw;
  prove_ends_second[1] = ends_out;
  app_end_of_samples(&app, any_bool() ? IMUCAL_OK : IMUCAL_ERR_SENSOR);
}
void prove_app_end_of_samples(void) {
  end_that(false, false);
  end_that(true, false);
  end_that(true, true);
}
