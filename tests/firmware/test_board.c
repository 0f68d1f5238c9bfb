// SPDX-License-Identifier: MIT
// board: each field at its limits; what a port fills in wrongly has its own status.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

#include "app/board.h"
#include "sum.h"

static imucal_board_t good_board(void) {
  imucal_board_t board;
  memset(&board, 0, sizeof board);
  strcpy(board.serial, "SN-17");
  board.n_channels = 2;
  board.rate_hz = 100;
  board.degc_per_count = 0.01f;
  board.degc_at_zero = 25;
  for (int i = 0; i < 2; i++) {
    strcpy(board.channel[i].name, i == 0 ? "gx_dph" : "ax_mg");
    board.channel[i].unit_per_count = 18;
    board.channel[i].full_scale_counts = 32767;
  }
  return board;
}

static void test_board_at_its_limits_is_taken(void** state) {
  (void)state;
  imucal_board_t board = good_board();
  assert_int_equal(imucal_board_check(&board), IMUCAL_OK);
  memset(board.serial, '!', sizeof board.serial);
  memcpy(board.channel[1].name, "~~~~~~~~_dph", sizeof board.channel[1].name);
  board.rate_hz = 1;
  board.channel[0].full_scale_counts = 1;
  assert_int_equal(imucal_board_check(&board), IMUCAL_OK);
  board.rate_hz = IMUCAL_SUM_MAX_RATE_HZ;
  assert_int_equal(imucal_board_check(&board), IMUCAL_OK);
  for (int i = 2; i < IMUCAL_MAX_CHANNELS; i++) {
    board.channel[i] = board.channel[0];
    board.channel[i].name[0] = (char)('a' + i);
  }
  board.n_channels = IMUCAL_MAX_CHANNELS;
  assert_int_equal(imucal_board_check(&board), IMUCAL_OK);
}

static void test_board_text_that_is_none_is_refused(void** state) {
  (void)state;
  const char* const bad[] = {"", " x", "a b", "a\x7F", "a\0b"};
  for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
    imucal_board_t board = good_board();
    memset(board.serial, 0, sizeof board.serial);
    memcpy(board.serial, bad[i], i == 4 ? 3 : strlen(bad[i]));
    assert_int_equal(imucal_board_check(&board), IMUCAL_ERR_NAME);
    board = good_board();
    memset(board.channel[1].name, 0, sizeof board.channel[1].name);
    memcpy(board.channel[1].name, bad[i], i == 4 ? 3 : strlen(bad[i]));
    assert_int_equal(imucal_board_check(&board), IMUCAL_ERR_NAME);
  }
}

/* The columns of a record are named after them: gx_dph, gx_flags. */
static void test_board_names_have_a_unit_and_a_stem_of_their_own(void** state) {
  (void)state;
  static const struct {
    const char* name; /* beside gx_dph */
    imucal_status status;
  } at[] = {{"g1x_dph", IMUCAL_OK},      {"gx1_mg", IMUCAL_OK},      {"g_mg", IMUCAL_OK},
            {"gyro_x", IMUCAL_ERR_NAME}, {"ax", IMUCAL_ERR_NAME},    {"_mg", IMUCAL_ERR_NAME},
            {"gx_dph", IMUCAL_ERR_NAME}, {"gx_mg", IMUCAL_ERR_NAME}, {"gy_dps", IMUCAL_ERR_NAME},
            {"ax_ms2", IMUCAL_ERR_NAME}};
  for (size_t i = 0; i < sizeof at / sizeof at[0]; i++) {
    imucal_board_t board = good_board();
    memset(board.channel[1].name, 0, sizeof board.channel[1].name);
    memcpy(board.channel[1].name, at[i].name, strlen(at[i].name));
    if (imucal_board_check(&board) != at[i].status) fail_msg("%s", at[i].name);
  }
}

static void expect_refused(const imucal_board_t* board, imucal_status status, int i_case) {
  if (imucal_board_check(board) != status) fail_msg("case %d", i_case);
}

static void test_board_number_out_of_range_is_refused(void** state) {
  (void)state;
  const float bad_scale[] = {0.0f, -1.0f, NAN, INFINITY};
  for (int i = 0; i < 4; i++) {
    imucal_board_t board = good_board();
    board.degc_per_count = bad_scale[i];
    expect_refused(&board, IMUCAL_ERR_SCALE, i);
    board = good_board();
    board.channel[1].unit_per_count = bad_scale[i];
    expect_refused(&board, IMUCAL_ERR_SCALE, i);
  }
  imucal_board_t board = good_board();
  board.degc_at_zero = NAN;
  expect_refused(&board, IMUCAL_ERR_SCALE, 10);
  board = good_board();
  board.n_channels = 0;
  expect_refused(&board, IMUCAL_ERR_CHANNELS, 11);
  board.n_channels = IMUCAL_MAX_CHANNELS + 1;
  expect_refused(&board, IMUCAL_ERR_CHANNELS, 12);
  board = good_board();
  board.rate_hz = 0;
  expect_refused(&board, IMUCAL_ERR_RANGE, 13);
  board.rate_hz = IMUCAL_SUM_MAX_RATE_HZ + 1;
  expect_refused(&board, IMUCAL_ERR_RANGE, 14);
  board = good_board();
  board.channel[1].full_scale_counts = 0;
  expect_refused(&board, IMUCAL_ERR_RANGE, 15);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_board_at_its_limits_is_taken),
      cmocka_unit_test(test_board_text_that_is_none_is_refused),
      cmocka_unit_test(test_board_names_have_a_unit_and_a_stem_of_their_own),
      cmocka_unit_test(test_board_number_out_of_range_is_refused),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
