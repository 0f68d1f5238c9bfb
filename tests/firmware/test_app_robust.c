// SPDX-License-Identifier: MIT
/* A bad line and a power cut anywhere: the device answers again, and holds its old table or its new one. */
#include <stdio.h>

#include "bench.h"

static bench_t bench;
static uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];

static int start(void** state) {
  (void)state;
  bench_start(&bench);
  return 0;
}

/* ---- power cuts ---- */

/* Operations (erases and programs) and the longest of them in bytes, of one upload or rollback with the power
 * on. */
static uint32_t n_operations_of(void (*act)(void)) {
  const uint32_t before = bench.nor.n_operations;
  act();
  return bench.nor.n_operations - before;
}

static void send_quietly(uint32_t id, const void* message) {
  uint8_t frame[IMUCAL_LINK_MAX_FRAME];
  size_t n = 0;
  if (!bench.token) bench_unlock(&bench);
  const imucal_link_command_t command = bench_command(&bench, id, message);
  assert_int_equal(imucal_link_pack(IMUCAL_LINK_ID_COMMAND, ++bench.sequence, &command, frame, sizeof frame, &n),
                   IMUCAL_OK);
  bench_send(&bench, frame, n); /* whether it is answered is not asked: the power may be off */
}

static void upload_new(void) {
  (void)bench_upload(&bench, bytes, bench_table(&bench, 2.0f, bytes));
}

static void roll_back(void) {
  const imucal_link_rollback_t request = {0};
  send_quietly(IMUCAL_LINK_ID_ROLLBACK, &request);
}

static void start_with_tables(uint32_t n_tables) {
  bench_start(&bench);
  for (uint32_t i = 0; i < n_tables; i++)
    assert_int_equal(bench_upload(&bench, bytes, bench_table(&bench, i + 1 == n_tables ? 1.0f : 0.5f, bytes)),
                     IMUCAL_OK);
}

static int origin_told(void) {
  const imucal_link_state_t request = {0};
  assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_STATE, &request), IMUCAL_LINK_ID_STATE_REPLY);
  return bench.reply.state_reply.table_origin;
}

/* Cuts `act` at one operation and byte, boots, demands old or new; then does it again from the cut state,
 * with the power on, and demands new. */
static void cut_and_boot(uint32_t n_tables, void (*act)(void), uint32_t operation, uint32_t byte, float old,
                         float new) {
  start_with_tables(n_tables);
  bench.nor.cut_operation = bench.nor.n_operations + operation;
  bench.nor.cut_byte = byte;
  act();
  const bool was_cut = !bench.nor.has_power;
  bench_power_cycle(&bench);
  const float ruling = bench_ruling_b0(&bench);
  if (ruling != old && ruling != new) fail_msg("operation %u byte %u: neither old nor new", operation, byte);
  if (!was_cut) assert_true(ruling == new);
  const bool is_restored = act == roll_back && ruling == new;
  assert_int_equal(origin_told(), is_restored ? IMUCAL_ORIGIN_ROLLBACK : IMUCAL_ORIGIN_HOST);
  upload_new();
  assert_true(bench_ruling_b0(&bench) == 2.0f);
  bench_power_cycle(&bench);
  assert_true(bench_ruling_b0(&bench) == 2.0f);
}

static void cut_everywhere(uint32_t n_tables, void (*act)(void), float old, float new) {
  start_with_tables(n_tables);
  const uint32_t n = n_operations_of(act);
  assert_true(n >= 1);
  for (uint32_t operation = 0; operation < n; operation++)
    for (uint32_t byte = 0; byte <= BENCH_SLOT_BYTES; byte += byte < 16 || byte > 1000 ? 1 : 13)
      cut_and_boot(n_tables, act, operation, byte, old, new);
}

static void test_cut_while_second_table_is_written_leaves_old_or_new(void** state) {
  (void)state;
  cut_everywhere(1, upload_new, 1.0f, 2.0f);
}

static void test_cut_while_third_table_is_written_leaves_old_or_new(void** state) {
  (void)state;
  cut_everywhere(2, upload_new, 1.0f, 2.0f);
}

static void test_cut_while_rolled_back_leaves_either(void** state) {
  (void)state;
  cut_everywhere(2, roll_back, 1.0f, 0.5f);
}

static void test_two_cuts_in_a_row_leave_the_old_table(void** state) {
  (void)state;
  for (uint32_t first = 0; first < 4; first++)
    for (uint32_t second = 0; second < 4; second++) {
      start_with_tables(2);
      bench.nor.cut_operation = bench.nor.n_operations + first, bench.nor.cut_byte = 2;
      upload_new();
      bench_power_cycle(&bench);
      bench.nor.cut_operation = second, bench.nor.cut_byte = 2;
      upload_new();
      bench_power_cycle(&bench);
      const float ruling = bench_ruling_b0(&bench);
      assert_true(ruling == 1.0f || ruling == 2.0f);
    }
}

static void test_flipped_bit_in_flash_falls_back_and_says_why(void** state) {
  (void)state;
  start_with_tables(2);
  const uint32_t slot = (uint32_t)bench.app.report.ruling;
  for (uint32_t at = 0; at < IMUCAL_TABLE_BYTES(3); at += 5) {
    bench.flash[slot * BENCH_SLOT_BYTES + at] ^= 0x10;
    bench_power_cycle(&bench);
    assert_int_equal(bench.app.table_status, IMUCAL_OK);
    assert_true(bench_ruling_b0(&bench) == 0.5f);
    assert_int_equal(bench_events(&bench, IMUCAL_EVENT_TABLE_REFUSED), 1);
    bench.flash[slot * BENCH_SLOT_BYTES + at] ^= 0x10;
  }
}

static void test_flash_of_noise_boots_uncompensated(void** state) {
  (void)state;
  uint32_t seed = 7;
  for (int k = 0; k < 200; k++) {
    for (size_t i = 0; i < sizeof bench.flash; i++)
      bench.flash[i] = (uint8_t)((seed = seed * 1664525u + 1013904223u) >> 24);
    bench_power_cycle(&bench);
    assert_int_equal(bench.app.table_status, IMUCAL_ERR_NO_TABLE);
  }
}

/* ---- the line ---- */

static void test_repeated_request_is_answered_again_and_not_done_again(void** state) {
  (void)state;
  start_with_tables(2);
  uint8_t frame[IMUCAL_LINK_MAX_FRAME];
  size_t n = 0;
  const imucal_link_rollback_t rollback = {0};
  bench_unlock(&bench);
  const imucal_link_command_t request = bench_command(&bench, IMUCAL_LINK_ID_ROLLBACK, &rollback);
  assert_int_equal(imucal_link_pack(IMUCAL_LINK_ID_COMMAND, 99, &request, frame, sizeof frame, &n), IMUCAL_OK);
  for (int k = 0; k < 3; k++) {
    bench.has_reply = false;
    bench_send(&bench, frame, n);
    assert_true(bench.has_reply);
    assert_int_equal(bench.reply.done.status, IMUCAL_OK);
  }
  assert_true(bench_ruling_b0(&bench) == 0.5f);
  assert_int_equal(bench.app.server.n_repeated, 2);
}

static void test_replies_wait_for_a_full_line_and_are_not_lost(void** state) {
  (void)state;
  uint8_t frames[6 * IMUCAL_LINK_MAX_FRAME];
  size_t n = 0;
  const imucal_link_info_t request = {0};
  for (uint8_t k = 0; k < 40; k++) {
    size_t one = 0;
    assert_int_equal(imucal_link_pack(IMUCAL_LINK_ID_INFO, k, &request, frames + n, sizeof frames - n, &one),
                     IMUCAL_OK);
    n += one;
  }
  bench.line_room = 0;
  memcpy(bench.to_device, frames, n), bench.to_at = 0, bench.to_end = n;
  bench.n_replies = 0;
  for (int k = 0; k < 3000; k++) {
    bench.line_room = 1;
    for (int j = 0; j < 5; j++) (void)imucal_app_step(&bench.app);
  }
  bench.line_room = UINT32_MAX;
  bench_run(&bench);
  assert_int_equal(bench.n_replies, 40);
}

/* Bytes lost, doubled and changed at random, then one clean request: it is answered, and the table rules. */
static void test_noise_on_the_line_costs_only_the_frames_it_touches(void** state) {
  (void)state;
  start_with_tables(1);
  uint32_t seed = 12345;
  for (int round = 0; round < 400; round++) {
    uint8_t clean[4 * IMUCAL_LINK_MAX_FRAME], noisy[sizeof bench.to_device];
    size_t n = 0, n_noisy = 0;
    const imucal_link_info_t info = {0};
    const imucal_link_table_read_t read = {.slot = 255, .length = 200};
    imucal_link_table_data_t data = {.offset = 0, .length = 200};
    size_t one = 0;
    memset(data.data, round, sizeof data.data);
    assert_int_equal(imucal_link_pack(IMUCAL_LINK_ID_INFO, 1, &info, clean, sizeof clean, &one), IMUCAL_OK);
    n += one;
    assert_int_equal(imucal_link_pack(IMUCAL_LINK_ID_TABLE_DATA, 2, &data, clean + n, sizeof clean - n, &one),
                     IMUCAL_OK);
    n += one;
    assert_int_equal(imucal_link_pack(IMUCAL_LINK_ID_TABLE_READ, 3, &read, clean + n, sizeof clean - n, &one),
                     IMUCAL_OK);
    n += one;
    for (size_t i = 0; i < n; i++) {
      seed = seed * 1664525u + 1013904223u;
      const uint32_t dice = seed >> 24, value = seed >> 16 & 0xFF;
      if (dice < 4) continue;                                  /* lost */
      noisy[n_noisy++] = dice < 8 ? (uint8_t)value : clean[i]; /* changed */
      if (dice >= 8 && dice < 12) noisy[n_noisy++] = clean[i]; /* doubled */
    }
    bench_send(&bench, noisy, n_noisy);
    const uint8_t zero = 0; /* a host that has timed out begins with a delimiter */
    bench_send(&bench, &zero, 1);
    assert_true(bench_ruling_b0(&bench) == 1.0f);
  }
  assert_true(bench.app.rx.n_crc + bench.app.rx.n_resync > 100);
}

static void test_random_bytes_never_stop_the_device(void** state) {
  (void)state;
  start_with_tables(1);
  uint32_t seed = 99;
  for (int round = 0; round < 500; round++) {
    uint8_t noise[997];
    for (size_t i = 0; i < sizeof noise; i++) noise[i] = (uint8_t)((seed = seed * 1664525u + 1013904223u) >> 24);
    bench_send(&bench, noise, sizeof noise);
  }
  const uint8_t zero = 0;
  bench_send(&bench, &zero, 1);
  assert_true(bench_ruling_b0(&bench) == 1.0f);
}

/* Valid frames of every request with random payloads: nothing but an answer comes of them. */
static void test_random_payloads_are_answered(void** state) {
  (void)state;
  uint32_t seed = 4711;
  for (uint32_t k = 0; k < 20000; k++) {
    uint8_t payload[IMUCAL_LINK_MAX_PAYLOAD], frame[IMUCAL_LINK_MAX_FRAME];
    size_t n = 0, len = 0;
    imucal_link_any_t any;
    for (size_t i = 0; i < sizeof payload; i++) payload[i] = (uint8_t)((seed = seed * 1664525u + 1013904223u) >> 24);
    const uint8_t type = (uint8_t)(1 + k % 0x3F);
    for (len = 0; len < 60; len++) /* the length that fits the message, if there is one */
      if (imucal_link_decode(type, payload, len, &any) == IMUCAL_OK) break;
    assert_int_equal(imucal_link_frame(type, (uint8_t)k, payload, len, frame, sizeof frame, &n), IMUCAL_OK);
    bench.has_reply = false;
    bench_send(&bench, frame, n);
    assert_true(bench.has_reply);
  }
}

#define CASE(test) cmocka_unit_test_setup(test, start)

int main(void) {
  const struct CMUnitTest tests[] = {
      CASE(test_cut_while_second_table_is_written_leaves_old_or_new),
      CASE(test_cut_while_third_table_is_written_leaves_old_or_new),
      CASE(test_cut_while_rolled_back_leaves_either),
      CASE(test_two_cuts_in_a_row_leave_the_old_table),
      CASE(test_flipped_bit_in_flash_falls_back_and_says_why),
      CASE(test_flash_of_noise_boots_uncompensated),
      CASE(test_repeated_request_is_answered_again_and_not_done_again),
      CASE(test_replies_wait_for_a_full_line_and_are_not_lost),
      CASE(test_noise_on_the_line_costs_only_the_frames_it_touches),
      CASE(test_random_bytes_never_stop_the_device),
      CASE(test_random_payloads_are_answered),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
