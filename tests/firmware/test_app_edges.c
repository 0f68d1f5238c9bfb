// SPDX-License-Identifier: MIT
/* The app at the edges of what ports, hosts and tables may bring: each refused by name or passed as documented. */
#include "bench.h"
#include "crc.h"

static bench_t bench;
static bool is_header_read; /* while the flash is dead: its first bytes still are */
static bool is_flash_dead;

static int start(void** state) {
  (void)state;
  is_flash_dead = false;
  bench_start(&bench);
  return 0;
}

static void test_cal_start_refuses_each_number_that_is_not_finite(void** state) {
  (void)state;
  static const uint32_t not_finite[] = {0x7FC00000u, 0x7F800000u, 0xFF800000u};
  for (size_t k = 0; k < 3; k++) {
    const float value = imucal_float_from_bits(not_finite[k]);
    for (int field = 0; field < 4; field++) {
      imucal_link_cal_start_t bad = reference_cal_start(0, 3);
      float* const fields[] = {&bad.t0_degc, &bad.range_degc, &bad.span_lo_degc, &bad.span_hi_degc};
      *fields[field] = value;
      assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_START, &bad), IMUCAL_ERR_NOT_FINITE);
    }
    for (int field = 0; field < 3; field++) {
      imucal_link_cal_start_t bad = reference_cal_start(0, 3);
      float* const fields[] = {&bad.arw, &bad.markov_sigma[0], &bad.markov_tau_s[0]};
      *fields[field] = value;
      assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_START, &bad), IMUCAL_ERR_MODEL);
    }
  }
  const imucal_link_cal_start_t good = reference_cal_start(0, 3);
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_START, &good), IMUCAL_OK);
}

static void test_cal_start_refuses_negative_noise(void** state) {
  (void)state;
  for (int field = 0; field < 3; field++) {
    imucal_link_cal_start_t bad = reference_cal_start(0, 3);
    float* const fields[] = {&bad.arw, &bad.markov_sigma[0], &bad.markov_tau_s[0]};
    *fields[field] = -1e-6f;
    assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_START, &bad), IMUCAL_ERR_MODEL);
  }
}

/* A port without a name, and one whose name is longer than its field. */
static void test_hello_device_name_is_cut_or_empty(void** state) {
  (void)state;
  const imucal_link_hello_t request = {.protocol = IMUCAL_LINK_PROTOCOL};
  bench.port.device = NULL;
  assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_HELLO, &request), IMUCAL_LINK_ID_HELLO_REPLY);
  assert_string_equal(bench.reply.hello_reply.device, "");
  bench.port.device = "a-board-whose-name-is-longer-than-23-characters";
  assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_HELLO, &request), IMUCAL_LINK_ID_HELLO_REPLY);
  const size_t size = sizeof bench.reply.hello_reply.device;
  assert_int_equal(strlen(bench.reply.hello_reply.device), size - 1);
  assert_memory_equal(bench.reply.hello_reply.device, bench.port.device, size - 1);
}

static void test_start_after_the_watchdog_is_told(void** state) {
  (void)state;
  assert_int_equal(bench_events(&bench, IMUCAL_EVENT_WATCHDOG), 0);
  bench.port.is_watchdog_reset = true;
  bench.port.n_watchdog_resets = 3;
  bench_power_cycle(&bench);
  assert_int_equal(bench_events(&bench, IMUCAL_EVENT_WATCHDOG), 1);
  for (uint32_t i = 0; i < bench.n_event; i++)
    if (bench.event[i].code == IMUCAL_EVENT_WATCHDOG) assert_int_equal(bench.event[i].detail, 3);
}

static void test_frame_of_type_zero_is_no_request(void** state) {
  (void)state;
  uint8_t frame[IMUCAL_LINK_MAX_FRAME];
  size_t n = 0;
  const uint32_t n_replies = bench.n_replies, n_unknown = bench.app.n_rx_unknown;
  assert_int_equal(imucal_link_frame(0, 5, NULL, 0, frame, sizeof frame, &n), IMUCAL_OK);
  bench_send(&bench, frame, n);
  assert_int_equal(bench.n_replies, n_replies);
  assert_int_equal(bench.app.n_rx_unknown, n_unknown + 1);
}

/* ---- tables ---- */

static void test_upload_for_other_thermometer_or_fewer_channels_is_refused(void** state) {
  (void)state;
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  bench.board.degc_per_count = 0.02f;
  size_t n = bench_table(&bench, 7.0f, bytes);
  bench.board.degc_per_count = 0.01f;
  assert_int_equal(bench_upload(&bench, bytes, n), IMUCAL_ERR_SCALE);
  assert_int_equal(bench.reply.done.detail, 0); /* the header */
  bench.board.n_channels = 2;
  n = bench_table(&bench, 7.0f, bytes);
  bench.board.n_channels = 3;
  assert_int_equal(bench_upload(&bench, bytes, n), IMUCAL_ERR_CHANNELS);
  n = bench_table(&bench, 7.0f, bytes);
  assert_int_equal(bench_upload(&bench, bytes, n), IMUCAL_OK);
}

static imucal_status dying_read(void* ctx, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t len) {
  return is_flash_dead && (!is_header_read || offset != 0) ? IMUCAL_ERR_FLASH
                                                           : bench.port.flash.read(ctx, slot, offset, data, len);
}
static void test_table_read_of_flash_that_cannot_be_read_says_so(void** state) {
  (void)state;
  static imucal_port_t port;
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  assert_int_equal(bench_upload(&bench, bytes, bench_table(&bench, 5.0f, bytes)), IMUCAL_OK);
  port = bench.port;
  port.flash.read = dying_read;
  bench.app.port = &port;
  const imucal_link_table_read_t request = {.slot = IMUCAL_LINK_SLOT_RULING, .offset = 100, .length = 10};
  assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_TABLE_READ, &request), IMUCAL_LINK_ID_TABLE_READ_REPLY);
  is_flash_dead = true;
  is_header_read = false; /* not even the header */
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_READ, &request), IMUCAL_ERR_FLASH);
  is_header_read = true; /* the header, but not the bytes behind it */
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_READ, &request), IMUCAL_ERR_FLASH);
  const imucal_link_state_t state_request = {0};
  assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_STATE, &state_request), IMUCAL_LINK_ID_STATE_REPLY);
  assert_int_equal(bench.reply.state_reply.table_crc, 0);
}

static void test_table_read_of_more_than_a_reply_holds_is_refused(void** state) {
  (void)state;
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  assert_int_equal(bench_upload(&bench, bytes, bench_table(&bench, 5.0f, bytes)), IMUCAL_OK);
  imucal_link_table_read_t request = {.slot = IMUCAL_LINK_SLOT_RULING, .length = IMUCAL_LINK_MAX_DATA};
  assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_TABLE_READ, &request), IMUCAL_LINK_ID_TABLE_READ_REPLY);
  request.length = IMUCAL_LINK_MAX_DATA + 1;
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_READ, &request), IMUCAL_ERR_RANGE);
}

/* ---- seconds ---- */

static void steady(uint64_t t_us, imucal_sample_t* sample) {
  (void)t_us;
  for (int i = 0; i < 3; i++) sample->counts[i] = 1000;
}

/* A table of one calibrated channel: the record says which. */
static void test_second_tells_which_channels_the_table_compensates(void** state) {
  (void)state;
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  const size_t n = bench_table(&bench, 55.0f, bytes);
  uint8_t* channel = bytes + IMUCAL_TABLE_HEADER_BYTES + IMUCAL_TABLE_CHANNEL_BYTES; /* gy: order 0, nothing learnt */
  memset(channel + 12, 0, 4);
  imucal_put_f32(channel + 24, 0.0f);
  imucal_put_u32(bytes + n - 4, imucal_crc32(bytes, n - 4));
  assert_int_equal(bench_upload(&bench, bytes, n), IMUCAL_OK);
  bench.shape = steady;
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND), IMUCAL_OK);
  bench_feed(&bench, 3);
  assert_int_equal(bench.second.compensated, 5);
  assert_float_equal(bench.second.out[0], 945.0f, 0.1f);
  assert_float_equal(bench.second.out[1], 1000.0f, 0.1f);
}

/* The table changes in a second and no sample comes in the rest of it: that second is told as it was measured. */
static void test_second_whose_table_changed_is_not_called_compensated(void** state) {
  (void)state;
  for (int is_end = 0; is_end <= 1; is_end++) {
    uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
    start(state);
    assert_int_equal(bench_upload(&bench, bytes, bench_table(&bench, 55.0f, bytes)), IMUCAL_OK);
    bench.shape = steady;
    assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND), IMUCAL_OK);
    bench.n_left = 250;
    bench_run(&bench);
    assert_int_equal(bench.second.compensated, 7);
    const uint32_t n_before = bench.n_second;
    assert_int_equal(bench_upload(&bench, bytes, bench_table(&bench, 66.0f, bytes)), IMUCAL_OK);
    bench.t_us += 1000000;
    bench.ends = is_end;
    bench.n_left = is_end ? 0 : 1;
    bench_run(&bench);
    assert_int_equal(bench.n_second, n_before + 1);
    assert_int_equal(bench.second.compensated, 0);
    assert_float_equal(bench.second.out[0], bench.second.raw[0], 1e-6f);
  }
}

/* More samples in a second than the record's field holds. */
static void test_second_of_many_samples_is_clipped_in_the_record(void** state) {
  (void)state;
  bench.step_us = 10;
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND), IMUCAL_OK);
  bench.n_left = 100001;
  for (int i = 0; i < 20; i++) bench_run(&bench);
  assert_int_equal(bench.n_second, 1);
  assert_int_equal(bench.second.n_samples, 0xFFFF);
}

static imucal_link_sensor_reply_t told;
static void tell(void* ctx, imucal_link_sensor_reply_t* report) {
  (void)ctx;
  *report = told;
}

/* A supply that is low, and stays so, is told once; when it is low again, once more. */
static void test_low_supply_is_told_when_it_begins(void** state) {
  (void)state;
  bench.port.sensor_report = tell;
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND | IMUCAL_STREAM_EVENT), IMUCAL_OK);
  uint32_t expected = 0;
  for (int k = 0; k < 3; k++) {
    told.is_supply_low = k != 1;
    bench_feed(&bench, 4);
    expected += k != 1;
    assert_int_equal(bench_events(&bench, IMUCAL_EVENT_SENSOR_COUNTED), expected);
  }
  assert_int_equal(bench.event[(bench.n_event - 1) % 32].detail, IMUCAL_SENSOR_SUPPLY);
  told.is_supply_low = false;
  told.wrong_identity = 1;
  bench_feed(&bench, 4);
  assert_int_equal(bench_events(&bench, IMUCAL_EVENT_SENSOR_COUNTED), expected + 1);
  assert_int_equal(bench.event[(bench.n_event - 1) % 32].detail, 1);
}

static imucal_status erase_without_supply(void* ctx, uint32_t slot) {
  (void)ctx;
  (void)slot;
  return IMUCAL_ERR_SUPPLY;
}

static void test_flash_refused_for_its_supply_is_told_and_counted(void** state) {
  (void)state;
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  assert_int_equal(bench_upload(&bench, bytes, bench_table(&bench, 55.0f, bytes)), IMUCAL_OK);
  bench.port.flash.erase = erase_without_supply;
  const imucal_link_erase_t erase = {.confirm = IMUCAL_LINK_ERASE_CONFIRM};
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_ERASE, &erase), IMUCAL_ERR_SUPPLY);
  assert_int_equal(bench.app.n_flash_failed, 1);
}

static imucal_status (*erase_one)(void* ctx, uint32_t slot);
static imucal_status erase_both(void* ctx, uint32_t slot) {
  const imucal_status other = erase_one(ctx, 1 - slot);
  return other != IMUCAL_OK ? other : erase_one(ctx, slot);
}

/* The second upload finds it: told and counted, and its table rules. */
static void test_slots_in_one_page_are_told_and_counted(void** state) {
  (void)state;
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  erase_one = bench.port.flash.erase;
  bench.port.flash.erase = erase_both;
  assert_int_equal(bench_upload(&bench, bytes, bench_table(&bench, 55.0f, bytes)), IMUCAL_OK);
  assert_int_equal(bench_upload(&bench, bytes, bench_table(&bench, 66.0f, bytes)), IMUCAL_ERR_SLOTS);
  assert_int_equal(bench.app.n_flash_failed, 1);
  assert_int_equal(bench.app.table_status, IMUCAL_OK);
  assert_int_equal(bench.app.table.sequence, 2);
}

static uint64_t clock_of_32_bits(void* ctx) {
  return (uint32_t)(((bench_t*)ctx)->time_us += 100);
}

/* time_us from a counter of 32 bits: the session, the unlock and the uptime go over its end, every time. */
static void test_clock_that_wraps_ends_no_session(void** state) {
  (void)state;
  bench.time_us = UINT32_MAX - 5000000u;
  bench.port.time_us = clock_of_32_bits;
  bench_power_cycle(&bench);
  assert_int_equal(bench_cal_start(&bench, 0, 3), IMUCAL_OK);
  for (int hour = 0; hour < 4; hour++) {
    for (int i = 0; i < 360; i++) {
      bench.time_us += 10000000u;
      bench_run(&bench);
    }
    assert_int_equal(bench.app.session, IMUCAL_SESSION_CALIBRATING);
    assert_int_equal(bench_events(&bench, IMUCAL_EVENT_CLOCK_BACK), bench.time_us >> 32);
    assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_INFO, &(imucal_link_info_t){0}), IMUCAL_LINK_ID_INFO_REPLY);
    assert_true(bench.time_us - bench.reply.info_reply.uptime_us < 10000);
  }
  assert_int_equal(bench.time_us >> 32, 4);
}

/* A step back of a second, or far: time stands for it and goes on; told once. */
static void test_clock_that_steps_back_goes_on(void** state) {
  (void)state;
  bench.time_us = 100000000u;
  bench_run(&bench);
  for (int i = 0; i < 5; i++) {
    const uint64_t before_us = bench.app.now_us;
    bench.time_us -= 1000000u << (i == 4 ? 4 : 0);
    bench_run(&bench);
    assert_true(bench.app.now_us >= before_us && bench.app.now_us - before_us < 10000);
    bench.time_us += 500000u;
    bench_run(&bench);
    assert_true(bench.app.now_us - before_us >= 500000 && bench.app.now_us - before_us < 510000);
  }
  assert_int_equal(bench.app.n_clock_back, 5);
  bench.time_us += (uint64_t)3 << 32; /* days forward, and back again */
  bench_run(&bench);
  const uint64_t days_us = bench.app.now_us;
  bench.time_us -= (uint64_t)3 << 32;
  bench_run(&bench);
  assert_true(bench.app.now_us >= days_us && bench.app.now_us - days_us < 10000);
  assert_int_equal(bench_events(&bench, IMUCAL_EVENT_CLOCK_BACK), 1);
}

static size_t failing_read(void* ctx, uint8_t* data, size_t capacity) {
  (void)ctx, (void)data, (void)capacity;
  return (size_t)-1;
}
static uint32_t n_writes;
static size_t failing_write(void* ctx, const uint8_t* data, size_t length) {
  (void)ctx;
  assert_true(data >= bench.app.tx && length <= sizeof bench.app.tx &&
              data + length <= bench.app.tx + sizeof bench.app.tx);
  n_writes++;
  return n_writes % 2 ? (size_t)-1 : length + 1;
}

/* `return read(fd, ...)` that failed, or the HAL's error code: nothing came, nothing went out. */
static void test_sizes_of_callbacks_beyond_what_was_asked_count_as_none(void** state) {
  (void)state;
  const imucal_port_t good = bench.port;
  bench.port.serial_read = failing_read;
  bench_run(&bench);
  assert_true(bench.app.rx_at == 0 && bench.app.rx_end == 0);
  bench.port.serial_read = good.serial_read;
  bench.port.serial_write = failing_write;
  bench_power_cycle(&bench); /* with events to send */
  bench_run(&bench);
  assert_true(n_writes > 1 && bench.app.tx_at == 0 && bench.app.tx_end > 0);
  bench.port.serial_write = good.serial_write;
  bench_run(&bench);
  assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_INFO, &(imucal_link_info_t){0}), IMUCAL_LINK_ID_INFO_REPLY);
  assert_int_equal(bench_events(&bench, IMUCAL_EVENT_BOOT), 1); /* the second start's came whole */
}

#define CASE(test) cmocka_unit_test_setup(test, start)

int main(void) {
  const struct CMUnitTest tests[] = {
      CASE(test_cal_start_refuses_each_number_that_is_not_finite),
      CASE(test_cal_start_refuses_negative_noise),
      CASE(test_hello_device_name_is_cut_or_empty),
      CASE(test_start_after_the_watchdog_is_told),
      CASE(test_frame_of_type_zero_is_no_request),
      CASE(test_upload_for_other_thermometer_or_fewer_channels_is_refused),
      CASE(test_table_read_of_flash_that_cannot_be_read_says_so),
      CASE(test_table_read_of_more_than_a_reply_holds_is_refused),
      CASE(test_second_tells_which_channels_the_table_compensates),
      CASE(test_second_whose_table_changed_is_not_called_compensated),
      CASE(test_second_of_many_samples_is_clipped_in_the_record),
      CASE(test_low_supply_is_told_when_it_begins),
      CASE(test_flash_refused_for_its_supply_is_told_and_counted),
      CASE(test_slots_in_one_page_are_told_and_counted),
      CASE(test_sizes_of_callbacks_beyond_what_was_asked_count_as_none),
      CASE(test_clock_that_wraps_ends_no_session),
      CASE(test_clock_that_steps_back_goes_on),
  };
  return cmocka_run_group_tests_name("app_edges", tests, NULL, NULL);
}
