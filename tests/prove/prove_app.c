// SPDX-License-Identifier: MIT
/* What Frama-C Eva is to prove of the firmware's app: its guard, its check of a board, and the app itself from its start on,
 * with a port whose line, sensor and flash do anything.  The app's life is followed for a number of steps; what they may
 * leave behind later is the matter of make fuzz-device. */
#include <__fc_builtin.h>
#include <string.h>

#include "app/app.h"
#include "app/guard.h"

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

/* ---- the app's life ---- */

static size_t serial_read(void* ctx, uint8_t* data, size_t capacity) {
  (void)ctx;
  any(data, capacity);
  return Frama_C_unsigned_int_interval(0, capacity);
}
static size_t serial_write(void* ctx, const uint8_t* data, size_t length) {
  (void)ctx;
  (void)data;
  return Frama_C_unsigned_int_interval(0, length);
}
static imucal_port_sample_t sample_read(void* ctx, imucal_sample_t* sample) {
  (void)ctx;
  any(sample, sizeof *sample);
  return (imucal_port_sample_t)Frama_C_int_interval(0, 4);
}
static uint64_t time_us(void* ctx) {
  (void)ctx;
  return any_u64();
}
static void nothing(void* ctx) {
  (void)ctx;
}
static void sensor_report(void* ctx, imucal_link_sensor_reply_t* report) {
  (void)ctx;
  any(report, sizeof *report);
}
static imucal_status flash_erase(void* ctx, uint32_t slot) {
  (void)ctx;
  //@ assert slot < 2;
  return any_bool() ? IMUCAL_OK : IMUCAL_ERR_FLASH;
}
static imucal_status flash_program(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len) {
  (void)ctx;
  (void)data;
  //@ assert slot < 2;
  //@ assert offset + len <= 1024;
  return any_bool() ? IMUCAL_OK : IMUCAL_ERR_FLASH;
}
static imucal_status flash_read(void* ctx, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t len) {
  (void)ctx;
  //@ assert slot < 2;
  //@ assert offset + len <= 1024;
  any(data, len);
  return any_bool() ? IMUCAL_OK : IMUCAL_ERR_FLASH;
}

void prove_app(void) {
  static imucal_app_t app;
  static const imucal_board_t board = {
      .serial = "SN-1",
      .n_channels = 3,
      .rate_hz = 100,
      .degc_per_count = 0.01f,
      .degc_at_zero = 25,
      .channel = {{"gx_dph", 1, 8388607}, {"gy_dph", 1, 8388607}, {"gz_dph", 1, 8388607}}};
  const imucal_port_t port = {.serial_read = serial_read,
                              .serial_write = serial_write,
                              .sample_read = sample_read,
                              .sensor_report = sensor_report,
                              .flash = {flash_erase, flash_program, flash_read, NULL, 1024, 1024, 4},
                              .time_us = time_us,
                              .watchdog = nothing,
                              .reboot = nothing,
                              .boot_id = any_u32(),
                              .n_watchdog_resets = any_u32(),
                              .is_watchdog_reset = any_bool(),
                              .device = "proof"};
  if (imucal_app_init(&app, &port, &board) != IMUCAL_OK) return;
  for (int i = 0; i < 2; i++) (void)imucal_app_step(&app);
}
