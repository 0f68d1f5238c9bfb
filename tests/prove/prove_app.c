// SPDX-License-Identifier: MIT
/* What Frama-C Eva is to prove of the firmware's app: its guard and its check of a board.  Not the app's life as a whole:
 * started with a port whose line, sensor and flash do anything, Frama-C 25 stops at the initialiser in imucal_kf_init (as
 * in prove.c), before a step is through.  make fuzz-device is for that. */
#include <__fc_builtin.h>
#include <string.h>

#include "app/board.h"
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
