// SPDX-License-Identifier: MIT
/* Every request of common/link.h, answered and refused. */
#include "bench.h"
#include "crc.h"

static bench_t bench;

static int start(void** state) {
  (void)state;
  bench_start(&bench);
  return 0;
}

static int from_cal(const char* serial) {
  imucal_link_table_from_cal_t request = {.created_s = 1234};
  strncpy(request.serial, serial, sizeof request.serial);
  return bench_done(&bench, IMUCAL_LINK_ID_TABLE_FROM_CAL, &request);
}

static int stop(uint8_t action) {
  const imucal_link_cal_stop_t request = {.action = action};
  return bench_done(&bench, IMUCAL_LINK_ID_CAL_STOP, &request);
}

static const imucal_link_info_reply_t* info(void) {
  const imucal_link_info_t request = {0};
  assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_INFO, &request), IMUCAL_LINK_ID_INFO_REPLY);
  return &bench.reply.info_reply;
}

/* ---- start and hello ---- */

static void test_boot_without_table_says_so_and_passes_samples(void** state) {
  (void)state;
  assert_int_equal(bench_events(&bench, IMUCAL_EVENT_BOOT), 1);
  assert_int_equal(bench_events(&bench, IMUCAL_EVENT_TABLE_NONE), 1);
  assert_int_equal(bench_events(&bench, IMUCAL_EVENT_TABLE_REFUSED), 0); /* empty is no refusal */
  assert_int_equal(info()->table_status, IMUCAL_ERR_NO_TABLE);
  assert_int_equal(info()->ruling_slot, 255);
  assert_int_equal(info()->slot_status[0], IMUCAL_SLOT_EMPTY);
  assert_true(bench.n_watchdog > 0);
}

static void test_init_bad_board_is_refused(void** state) {
  (void)state;
  bench.board.channel[1].unit_per_count = 0.0f;
  assert_int_equal(imucal_app_init(&bench.app, &bench.port, &bench.board), IMUCAL_ERR_SCALE);
  bench.board.channel[1].unit_per_count = 1.0f;
  bench.board.n_channels = 7;
  assert_int_equal(imucal_app_init(&bench.app, &bench.port, &bench.board), IMUCAL_ERR_CHANNELS);
}

static imucal_status init_without(size_t callback_at) {
  imucal_port_t port = bench.port;
  memset((uint8_t*)&port + callback_at, 0, sizeof(void (*)(void)));
  return imucal_app_init(&bench.app, &port, &bench.board);
}

/* Nothing that the app is going to call is missing; what it asks for before it calls may be. */
static void test_init_missing_callbacks_are_refused(void** state) {
  (void)state;
  static const size_t needed[] = {offsetof(imucal_port_t, serial_read),   offsetof(imucal_port_t, serial_write),
                                  offsetof(imucal_port_t, sample_read),   offsetof(imucal_port_t, flash.erase),
                                  offsetof(imucal_port_t, flash.program), offsetof(imucal_port_t, flash.read),
                                  offsetof(imucal_port_t, time_us),       offsetof(imucal_port_t, watchdog),
                                  offsetof(imucal_port_t, reboot)};
  static const size_t optional[] = {offsetof(imucal_port_t, sample_enable), offsetof(imucal_port_t, sample_out),
                                    offsetof(imucal_port_t, sensor_report), offsetof(imucal_port_t, device)};
  for (size_t i = 0; i < sizeof needed / sizeof needed[0]; i++)
    if (init_without(needed[i]) != IMUCAL_ERR_ARGUMENT) fail_msg("callback %zu", i);
  for (size_t i = 0; i < sizeof optional / sizeof optional[0]; i++)
    if (init_without(optional[i]) != IMUCAL_OK) fail_msg("optional callback %zu", i);
  assert_int_equal(imucal_app_init(&bench.app, NULL, &bench.board), IMUCAL_ERR_ARGUMENT);
  assert_int_equal(imucal_app_init(&bench.app, &bench.port, NULL), IMUCAL_ERR_ARGUMENT);
  assert_int_equal(imucal_app_init(NULL, &bench.port, &bench.board), IMUCAL_ERR_ARGUMENT);
}

static void test_hello_tells_who_and_refuses_old_protocol(void** state) {
  (void)state;
  imucal_link_hello_t request = {.protocol = IMUCAL_LINK_PROTOCOL, .nonce = 77};
  assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_HELLO, &request), IMUCAL_LINK_ID_HELLO_REPLY);
  assert_int_equal(bench.reply.hello_reply.nonce, 77);
  assert_string_equal(bench.reply.hello_reply.device, "bench");
  assert_string_equal(bench.reply.hello_reply.serial, BENCH_SERIAL);
  assert_int_equal(bench.reply.hello_reply.n_channels, 3);
  request.protocol = 1;
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_HELLO, &request), IMUCAL_ERR_VERSION);
}

static void test_channel_info_known_and_unknown_channel(void** state) {
  (void)state;
  imucal_link_channel_info_t request = {.channel = 2};
  assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_CHANNEL_INFO, &request), IMUCAL_LINK_ID_CHANNEL_INFO_REPLY);
  assert_string_equal(bench.reply.channel_info_reply.name, "gz_dph");
  assert_int_equal(bench.reply.channel_info_reply.full_scale_counts, 1000000);
  assert_int_equal(bench.reply.channel_info_reply.is_compensated, 0);
  request.channel = 3;
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CHANNEL_INFO, &request), IMUCAL_ERR_UNKNOWN);
}

static void test_unknown_request_and_wrong_payload_are_refused(void** state) {
  (void)state;
  uint8_t frame[IMUCAL_LINK_MAX_FRAME];
  size_t n = 0;
  assert_int_equal(imucal_link_frame(0x3E, 200, NULL, 0, frame, sizeof frame, &n), IMUCAL_OK);
  bench.has_reply = false;
  bench_send(&bench, frame, n);
  assert_true(bench.has_reply && bench.reply_id == IMUCAL_LINK_ID_DONE);
  assert_int_equal(bench.reply.done.status, IMUCAL_ERR_UNKNOWN);
  const uint8_t payload[3] = {0};
  assert_int_equal(imucal_link_frame(IMUCAL_LINK_ID_INFO, 201, payload, 3, frame, sizeof frame, &n), IMUCAL_OK);
  bench_send(&bench, frame, n);
  assert_int_equal(bench.reply.done.status, IMUCAL_ERR_LENGTH);
  const uint32_t n_replies = bench.n_replies; /* replies and records are no requests: not answered */
  assert_int_equal(imucal_link_frame(IMUCAL_LINK_ID_DONE, 202, payload, 3, frame, sizeof frame, &n), IMUCAL_OK);
  bench_send(&bench, frame, n);
  assert_int_equal(bench.n_replies, n_replies);
  const imucal_link_counters_t counters = {0};
  assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_COUNTERS, &counters), IMUCAL_LINK_ID_COUNTERS_REPLY);
  assert_int_equal(bench.reply.counters_reply.rx_unknown, 3);
}

static void test_stream_unknown_bits_are_refused(void** state) {
  (void)state;
  imucal_link_stream_t request = {.what = 16, .channels = 0, .period_s = 1};
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_STREAM, &request), IMUCAL_ERR_RANGE);
  request = (imucal_link_stream_t){.what = 2, .channels = 8, .period_s = 1};
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_STREAM, &request), IMUCAL_ERR_RANGE);
  request = (imucal_link_stream_t){.what = 2, .channels = 7, .period_s = 0};
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_STREAM, &request), IMUCAL_ERR_RANGE);
  assert_int_equal(info()->stream_what, IMUCAL_STREAM_EVENT);
}

static void test_reboot_answers_first(void** state) {
  (void)state;
  const imucal_link_reboot_t request = {0};
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_REBOOT, &request), IMUCAL_OK);
  assert_int_equal(bench.n_reboots, 1);
}

static void test_reboot_stuck_line_reboots_all_the_same(void** state) {
  (void)state;
  uint8_t frame[IMUCAL_LINK_MAX_FRAME];
  size_t n = 0;
  const imucal_link_reboot_t reboot = {0};
  bench_unlock(&bench);
  const imucal_link_command_t request = bench_command(&bench, IMUCAL_LINK_ID_REBOOT, &reboot);
  assert_int_equal(imucal_link_pack(IMUCAL_LINK_ID_COMMAND, 9, &request, frame, sizeof frame, &n), IMUCAL_OK);
  bench.line_room = 0;
  bench_send(&bench, frame, n);
  assert_int_equal(bench.n_reboots, 0);
  bench.time_us += 600000;
  bench_run(&bench);
  assert_int_equal(bench.n_reboots, 1);
}

/* ---- who may change anything ---- */

static uint8_t frame[IMUCAL_LINK_MAX_FRAME];
static size_t frame_len;

static int send_frame(uint32_t id, const void* message) {
  assert_int_equal(imucal_link_pack(id, ++bench.sequence, message, frame, sizeof frame, &frame_len), IMUCAL_OK);
  bench.has_reply = false;
  bench_send(&bench, frame, frame_len);
  assert_true(bench.has_reply);
  return bench.reply_id == IMUCAL_LINK_ID_DONE ? bench.reply.done.status : IMUCAL_OK;
}

static const imucal_link_state_reply_t* device_state(void) {
  const imucal_link_state_t request = {0};
  assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_STATE, &request), IMUCAL_LINK_ID_STATE_REPLY);
  return &bench.reply.state_reply;
}

static imucal_link_unlock_t unlock_for(const char* serial) {
  imucal_link_unlock_t request = {.challenge = device_state()->challenge, .seconds = 10};
  strncpy(request.serial, serial, sizeof request.serial);
  return request;
}

static void test_bare_requests_that_change_something_are_locked(void** state) {
  (void)state;
  uint32_t n = 0;
  for (uint32_t id = 1; id < 0x40; id++) {
    if (!imucal_link_is_guarded(id)) continue;
    imucal_link_any_t zeros;
    memset(&zeros, 0, sizeof zeros);
    assert_int_equal(send_frame(id, &zeros), IMUCAL_ERR_LOCKED);
    assert_int_equal(bench.reply.done.request, id);
    n++;
  }
  assert_int_equal(n, 10);
  assert_int_equal(device_state()->refused_locked, 10);
  assert_int_equal(bench.n_reboots, 0);
}

static void test_unlock_names_the_serial_and_the_newest_challenge(void** state) {
  (void)state;
  imucal_link_unlock_t request = unlock_for("bench-2");
  assert_int_equal(send_frame(IMUCAL_LINK_ID_UNLOCK, &request), IMUCAL_ERR_SERIAL);
  request = unlock_for(BENCH_SERIAL);
  request.seconds = 0;
  assert_int_equal(send_frame(IMUCAL_LINK_ID_UNLOCK, &request), IMUCAL_ERR_RANGE);
  request.seconds = IMUCAL_LINK_MAX_UNLOCK_S + 1;
  assert_int_equal(send_frame(IMUCAL_LINK_ID_UNLOCK, &request), IMUCAL_ERR_RANGE);
  assert_int_equal(device_state()->unlocked_s, 0);
  request.seconds = 10;
  assert_int_equal(send_frame(IMUCAL_LINK_ID_UNLOCK, &request), IMUCAL_OK);
  assert_int_equal(device_state()->unlocked_s, 10);
  assert_int_equal(send_frame(IMUCAL_LINK_ID_UNLOCK, &request), IMUCAL_ERR_STALE); /* replayed under another sequence */
  assert_int_equal(device_state()->refused_unlock, 3);
  assert_int_equal(device_state()->refused_stale, 1);
}

static void test_commands_late_doubled_or_of_another_token_do_nothing(void** state) {
  (void)state;
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  assert_int_equal(bench_upload(&bench, bytes, bench_table(&bench, 55.0f, bytes)), IMUCAL_OK);
  const imucal_link_erase_t erase = {.confirm = IMUCAL_LINK_ERASE_CONFIRM};
  imucal_link_command_t command = bench_command(&bench, IMUCAL_LINK_ID_ERASE, &erase);
  assert_int_equal(send_frame(IMUCAL_LINK_ID_COMMAND, &command), IMUCAL_OK);
  assert_int_equal(bench_upload(&bench, bytes, bench_table(&bench, 55.0f, bytes)), IMUCAL_OK);
  assert_int_equal(send_frame(IMUCAL_LINK_ID_COMMAND, &command), IMUCAL_ERR_STALE); /* the late ERASE */
  command.number = bench.number + 1;
  command.token ^= 1;
  assert_int_equal(send_frame(IMUCAL_LINK_ID_COMMAND, &command), IMUCAL_ERR_STALE);
  command.token ^= 1;
  const uint32_t old_token = command.token;
  bench_unlock(&bench); /* another host, or the same later */
  assert_true(bench.token != old_token);
  assert_int_equal(send_frame(IMUCAL_LINK_ID_COMMAND, &command), IMUCAL_ERR_STALE);
  assert_int_equal(device_state()->refused_stale, 3);
  bench_power_cycle(&bench);
  command.token = old_token;
  assert_int_equal(send_frame(IMUCAL_LINK_ID_COMMAND, &command), IMUCAL_ERR_STALE);
  bench_unlock(&bench);
  assert_true(bench.token != old_token);
  assert_int_equal(send_frame(IMUCAL_LINK_ID_COMMAND, &command), IMUCAL_ERR_STALE);
  assert_true(bench_ruling_b0(&bench) == 55.0f);
}

static void test_unlock_expires(void** state) {
  (void)state;
  const imucal_link_stream_t stream = {.what = 8, .period_s = 1};
  bench_unlock(&bench);
  imucal_link_command_t command = bench_command(&bench, IMUCAL_LINK_ID_STREAM, &stream);
  assert_int_equal(send_frame(IMUCAL_LINK_ID_COMMAND, &command), IMUCAL_OK);
  bench.time_us += (uint64_t)IMUCAL_LINK_MAX_UNLOCK_S * 1000000u;
  command = bench_command(&bench, IMUCAL_LINK_ID_STREAM, &stream);
  assert_int_equal(send_frame(IMUCAL_LINK_ID_COMMAND, &command), IMUCAL_ERR_LOCKED);
  assert_int_equal(device_state()->unlocked_s, 0);
}

/* LOCKED says "nothing was done": never to a command that may have been, whose reply was lost. */
static void test_command_sent_again_after_a_restart_or_too_late_is_stale(void** state) {
  (void)state;
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  assert_int_equal(bench_upload(&bench, bytes, bench_table(&bench, 55.0f, bytes)), IMUCAL_OK);
  assert_int_equal(bench_upload(&bench, bytes, bench_table(&bench, 66.0f, bytes)), IMUCAL_OK);
  const imucal_link_rollback_t rollback = {0};
  const imucal_link_command_t command = bench_command(&bench, IMUCAL_LINK_ID_ROLLBACK, &rollback);
  assert_int_equal(send_frame(IMUCAL_LINK_ID_COMMAND, &command), IMUCAL_OK);
  bench.time_us += (uint64_t)IMUCAL_LINK_MAX_UNLOCK_S * 1000000u;
  assert_int_equal(send_frame(IMUCAL_LINK_ID_COMMAND, &command), IMUCAL_ERR_STALE);
  bench_power_cycle(&bench);
  assert_int_equal(send_frame(IMUCAL_LINK_ID_COMMAND, &command), IMUCAL_ERR_STALE);
  assert_int_equal(device_state()->refused_stale, 1);
  assert_true(bench_ruling_b0(&bench) == 55.0f);
}

static void test_command_of_wrong_content_is_refused(void** state) {
  (void)state;
  bench_unlock(&bench);
  imucal_link_command_t command = {.token = bench.token, .number = 1, .request = IMUCAL_LINK_ID_INFO, .length = 1};
  assert_int_equal(send_frame(IMUCAL_LINK_ID_COMMAND, &command), IMUCAL_ERR_UNKNOWN); /* needs no COMMAND */
  command.request = IMUCAL_LINK_ID_COMMAND;
  assert_int_equal(send_frame(IMUCAL_LINK_ID_COMMAND, &command), IMUCAL_ERR_UNKNOWN);
  command.request = IMUCAL_LINK_ID_ERASE;
  assert_int_equal(send_frame(IMUCAL_LINK_ID_COMMAND, &command), IMUCAL_ERR_LENGTH);
  assert_int_equal(bench.reply.done.request, IMUCAL_LINK_ID_ERASE);
}

static void test_reserved_fields_are_checked(void** state) {
  (void)state;
  const imucal_link_info_t request = {.reserved = 1};
  assert_int_equal(send_frame(IMUCAL_LINK_ID_INFO, &request), IMUCAL_ERR_RESERVED);
  assert_int_equal(send_frame(IMUCAL_LINK_ID_COUNTERS, &request), IMUCAL_ERR_RESERVED);
  assert_int_equal(send_frame(IMUCAL_LINK_ID_STATE, &request), IMUCAL_ERR_RESERVED);
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_ROLLBACK, &request), IMUCAL_ERR_RESERVED);
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_COMMIT, &request), IMUCAL_ERR_RESERVED);
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_REBOOT, &request), IMUCAL_ERR_RESERVED);
  assert_int_equal(bench.n_reboots, 0);
  assert_int_equal(device_state()->refused_reserved, 6);
}

/* As it was before the power cycle. */
static void assert_origin_stays(int origin) {
  assert_int_equal(device_state()->table_origin, origin);
  bench_power_cycle(&bench);
  assert_int_equal(device_state()->table_origin, origin);
}

static void test_state_tells_crc_time_and_origin_of_the_ruling_table(void** state) {
  (void)state;
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  assert_int_equal(device_state()->table_origin, IMUCAL_ORIGIN_NONE);
  assert_int_equal(device_state()->table_crc, 0);
  const size_t n = bench_table(&bench, 55.0f, bytes);
  imucal_put_u32(bytes + 28, 1234);
  imucal_put_u32(bytes + n - 4, imucal_crc32(bytes, n - 4));
  assert_int_equal(bench_upload(&bench, bytes, n), IMUCAL_OK);
  assert_origin_stays(IMUCAL_ORIGIN_HOST);
  assert_int_equal(device_state()->table_created_s, 1234);
  assert_int_equal(device_state()->table_crc, imucal_get_u32(bytes + n - 4)); /* sequence 1 in both */
  assert_int_equal(bench_upload(&bench, bytes, n), IMUCAL_OK);
  const imucal_link_rollback_t nothing = {0};
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_ROLLBACK, &nothing), IMUCAL_OK);
  assert_origin_stays(IMUCAL_ORIGIN_ROLLBACK);
  assert_int_equal(bench_cal_start(&bench, 0, 1), IMUCAL_OK);
  assert_int_equal(bench_stream(&bench, 15), IMUCAL_OK);
  bench_feed(&bench, 20);
  assert_int_equal(stop(IMUCAL_STOP_KEEP), IMUCAL_OK);
  assert_int_equal(from_cal(BENCH_SERIAL), IMUCAL_OK);
  assert_origin_stays(IMUCAL_ORIGIN_FILTERS);
}

/* A table written before origins were noted rules, with its time; its origin is unknown, not made up. */
static void test_state_origin_of_an_old_table_is_unknown(void** state) {
  (void)state;
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  const size_t n = bench_table(&bench, 55.0f, bytes);
  assert_int_equal(bench_upload(&bench, bytes, n), IMUCAL_OK);
  uint8_t* slot = bench.flash + (uint32_t)bench.app.report.ruling * BENCH_SLOT_BYTES;
  memset(slot + n, 0xFF, 4);
  bench_power_cycle(&bench);
  assert_true(bench_ruling_b0(&bench) == 55.0f);
  assert_int_equal(device_state()->table_origin, IMUCAL_ORIGIN_UNKNOWN);
}

static void test_table_out_of_physical_limits_is_refused(void** state) {
  (void)state;
  static const struct {
    size_t at; /* in the bytes of channel 0 (table.md) */
    float value;
    int status;
  } cases[] = {{68, 0.0f, IMUCAL_ERR_SIGMA},   {68, 1e30f, IMUCAL_ERR_SIGMA},      {100, -1.0f, IMUCAL_ERR_SIGMA},
               {104, 1e5f, IMUCAL_ERR_MODEL},  {24, 2e7f, IMUCAL_ERR_COEFFICIENT}, {16, 2000.0f, IMUCAL_ERR_SPAN},
               {124, 1e-20f, IMUCAL_ERR_SCALE}};
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
    const size_t n = bench_table(&bench, 55.0f, bytes);
    imucal_put_f32(bytes + IMUCAL_TABLE_HEADER_BYTES + cases[i].at, cases[i].value);
    imucal_put_u32(bytes + n - 4, imucal_crc32(bytes, n - 4));
    assert_int_equal(bench_upload(&bench, bytes, n), cases[i].status);
  }
  assert_int_equal(device_state()->refused_table, sizeof cases / sizeof cases[0]);
  assert_int_equal(info()->table_status, IMUCAL_ERR_NO_TABLE);
}

static void test_session_refuses_to_start_a_running_channel_again(void** state) {
  (void)state;
  assert_int_equal(bench_cal_start(&bench, 0, 3), IMUCAL_OK);
  assert_int_equal(bench_cal_start(&bench, 1, 3), IMUCAL_OK); /* another channel joins */
  assert_int_equal(bench_stream(&bench, 15), IMUCAL_OK);
  bench_feed(&bench, 50);
  assert_int_equal(bench_cal_start(&bench, 0, 2), IMUCAL_ERR_BUSY);
  const imucal_link_cal_state_t ask = {.channel = 0};
  assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_CAL_STATE, &ask), IMUCAL_LINK_ID_CAL_STATE_REPLY);
  assert_true(bench.reply.cal_state_reply.n >= 49 && bench.reply.cal_state_reply.order == 3);
  const imucal_link_cal_stop_t stop_request = {.action = IMUCAL_STOP_DISCARD};
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_STOP, &stop_request), IMUCAL_OK);
  assert_int_equal(bench_cal_start(&bench, 0, 2), IMUCAL_OK);
  assert_int_equal(device_state()->refused_busy, 1);
}

static void test_host_that_died_does_not_leave_the_device_busy(void** state) {
  (void)state;
  assert_int_equal(bench_cal_start(&bench, 0, 3), IMUCAL_OK);
  bench.time_us += (uint64_t)(IMUCAL_APP_SILENCE_S - 1) * 1000000u;
  bench_run(&bench);
  assert_int_equal(bench.app.session, IMUCAL_SESSION_CALIBRATING);
  bench.time_us += 2000000u;
  bench_run(&bench);
  assert_int_equal(bench.app.session, IMUCAL_SESSION_KEPT);
  assert_int_equal(bench_events(&bench, IMUCAL_EVENT_HOST_SILENT), 1);
  assert_int_equal(device_state()->sessions_silent, 1);
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  bench_unlock(&bench);
  assert_int_equal(bench_upload(&bench, bytes, bench_table(&bench, 55.0f, bytes)), IMUCAL_OK); /* not busy */
}

/* ---- calibration ---- */

/* 80 + 300 Tn dph, a ramp 0..60 degC in 600 s, white noise by a small generator. */
static void ramp(uint64_t t_us, imucal_sample_t* sample) {
  static uint32_t seed = 1;
  const int32_t centi_degc = (int32_t)(t_us / 100000u); /* 0.1 degC per second */
  sample->temp_counts = centi_degc - 2500;
  for (int i = 0; i < 3; i++) {
    int32_t noise = 0;
    for (int k = 0; k < 4; k++) noise += (int32_t)((seed = seed * 1664525u + 1013904223u) >> 23) - 256;
    sample->counts[i] = 80 + (centi_degc - 3000) / 10 + noise;
  }
}

static void calibrate(uint8_t channels) {
  for (uint8_t i = 0; i < 3; i++)
    if (channels & (1u << i)) assert_int_equal(bench_cal_start(&bench, i, 3), IMUCAL_OK);
  bench.shape = ramp;
  bench.t_us = 0;
  assert_int_equal(bench_stream(&bench, 15), IMUCAL_OK);
  bench.ends = true;
  bench_feed(&bench, 600);
  bench.ends = false;
}

static void test_session_learns_stores_and_compensates(void** state) {
  (void)state;
  calibrate(7);
  assert_int_equal(bench.n_second, 600);
  assert_int_equal(bench.n_innovation, 1800);
  assert_int_equal(bench.n_progress, 60);
  assert_int_equal(bench_events(&bench, IMUCAL_EVENT_SENSOR_ENDED), 1);
  assert_int_equal(info()->session, IMUCAL_SESSION_SENSOR_ENDED);
  const imucal_link_cal_state_t ask = {.channel = 1};
  assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_CAL_STATE, &ask), IMUCAL_LINK_ID_CAL_STATE_REPLY);
  const imucal_link_cal_state_reply_t learnt = bench.reply.cal_state_reply;
  assert_int_equal(learnt.n, 600);
  assert_true(learnt.coeff[0] > 40 && learnt.coeff[0] < 120 && learnt.coeff[1] > 240 && learnt.coeff[1] < 360);
  assert_true(bench.progress.worst_sigma[1] > 5 && bench.progress.worst_sigma[1] < 30);
  assert_int_equal(from_cal(BENCH_SERIAL), IMUCAL_OK);
  assert_int_equal(bench.reply.done.detail, 1);
  assert_true(bench_ruling_b0(&bench) == imucal_kf_coefficient(&bench.app.channel[0].learn.kf, 0));
  bench_power_cycle(&bench);
  assert_int_equal(info()->table_status, IMUCAL_OK);
  assert_int_equal(bench_events(&bench, IMUCAL_EVENT_TABLE_LOADED), 1);
  bench.t_us = 0;
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND), IMUCAL_OK);
  float worst_raw = 0, worst_out = 0;
  for (int k = 0; k < 60; k++) {
    bench_feed(&bench, 10);
    const float raw = bench.second.raw[1], out = bench.second.out[1];
    if (raw * raw > worst_raw) worst_raw = raw * raw;
    if (out * out > worst_out) worst_out = out * out;
  }
  assert_int_equal(bench.second.compensated, 7);
  assert_true(worst_raw > 300.0f * 300.0f); /* the bias was large */
  assert_true(worst_out < 150.0f * 150.0f); /* the noise alone: 30 dph per mean of a second, five sigma */
}

static void test_session_one_channel_keeps_others_of_ruling_table(void** state) {
  (void)state;
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  const size_t n = bench_table(&bench, 55.0f, bytes);
  assert_int_equal(bench_upload(&bench, bytes, n), IMUCAL_OK);
  calibrate(2);
  assert_int_equal(from_cal(BENCH_SERIAL), IMUCAL_OK);
  assert_true(bench_ruling_b0(&bench) == 55.0f);
  assert_true(bench.app.table.channel[1].coeff[0] == imucal_kf_coefficient(&bench.app.channel[1].learn.kf, 0));
}

static void test_session_one_channel_without_table_leaves_others_uncalibrated(void** state) {
  (void)state;
  calibrate(2);
  assert_int_equal(from_cal(BENCH_SERIAL), IMUCAL_OK);
  const imucal_link_channel_info_t first = {.channel = 0}, second = {.channel = 1};
  bench_ask(&bench, IMUCAL_LINK_ID_CHANNEL_INFO, &first);
  assert_int_equal(bench.reply.channel_info_reply.is_compensated, 0);
  bench_ask(&bench, IMUCAL_LINK_ID_CHANNEL_INFO, &second);
  assert_int_equal(bench.reply.channel_info_reply.is_compensated, 1);
  bench.t_us = 300000000; /* 30 degC */
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND), IMUCAL_OK);
  bench_feed(&bench, 3);
  assert_int_equal(bench.second.temp_clamped, 0); /* of what is not calibrated no temperature is outside the span */
  assert_int_equal(bench.second.compensated, 2);
}

/* A table may hold the scale factor of a channel alone: its counts are changed, and the device says so. */
static void test_channel_with_a_scale_factor_alone_is_compensated(void** state) {
  (void)state;
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  imucal_table_t table;
  size_t n = bench_table(&bench, 0.0f, bytes);
  assert_int_equal(imucal_table_decode(bytes, n, &table, NULL), IMUCAL_OK);
  for (uint32_t i = 0; i < 2; i++) { /* channel 1: scale factor alone; channel 0: nothing */
    table.channel[i].order = 0;
    memset(table.channel[i].coeff, 0, sizeof table.channel[i].coeff);
    table.channel[i].scale_coeff[0] = i == 1 ? 0.05f : 0.0f;
  }
  assert_int_equal(imucal_table_encode(&table, bytes, sizeof bytes, &n), IMUCAL_OK);
  assert_int_equal(bench_upload(&bench, bytes, n), IMUCAL_OK);
  bench.shape = ramp;
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND), IMUCAL_OK);
  bench_feed(&bench, 3);
  assert_true(bench.second.out[0] == bench.second.raw[0]);
  assert_float_equal(bench.second.out[1], 1.05f * bench.second.raw[1], 0.01f);
  assert_int_equal(bench.second.compensated, 6);
  for (uint8_t i = 0; i < 3; i++) {
    const imucal_link_channel_info_t which = {.channel = i};
    assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_CHANNEL_INFO, &which), IMUCAL_LINK_ID_CHANNEL_INFO_REPLY);
    assert_int_equal(bench.reply.channel_info_reply.is_compensated, i > 0);
  }
}

/* The other channels must not be refused for a polynomial that they do not have. */
static void test_session_one_channel_with_a_coarse_thermometer_makes_a_table(void** state) {
  (void)state;
  bench.board.degc_per_count = 2.5f;
  bench_power_cycle(&bench);
  assert_int_equal(bench_cal_start(&bench, 0, 1), IMUCAL_OK);
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND), IMUCAL_OK);
  bench_feed(&bench, 20);
  assert_int_equal(stop(IMUCAL_STOP_KEEP), IMUCAL_OK);
  assert_int_equal(from_cal(BENCH_SERIAL), IMUCAL_OK);
  assert_int_equal(info()->table_status, IMUCAL_OK);
}

static void test_session_rules(void** state) {
  (void)state;
  assert_int_equal(from_cal(BENCH_SERIAL), IMUCAL_ERR_NOT_LEARNT);
  assert_int_equal(stop(IMUCAL_STOP_KEEP), IMUCAL_ERR_STATE);
  assert_int_equal(stop(2), IMUCAL_ERR_RANGE);
  assert_int_equal(bench_cal_start(&bench, 3, 3), IMUCAL_ERR_UNKNOWN);
  assert_int_equal(bench_cal_start(&bench, 0, 6), IMUCAL_ERR_ORDER);
  assert_int_equal(info()->session, IMUCAL_SESSION_IDLE);
  assert_int_equal(bench_cal_start(&bench, 0, 3), IMUCAL_OK);
  assert_int_equal(info()->session, IMUCAL_SESSION_CALIBRATING);
  assert_int_equal(from_cal(BENCH_SERIAL), IMUCAL_ERR_BUSY);
  const imucal_link_rollback_t nothing = {0};
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_ROLLBACK, &nothing), IMUCAL_ERR_BUSY);
  const imucal_link_erase_t erase = {.confirm = IMUCAL_LINK_ERASE_CONFIRM};
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_ERASE, &erase), IMUCAL_ERR_BUSY);
  const imucal_link_table_begin_t begin = {.total = 400};
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_BEGIN, &begin), IMUCAL_ERR_BUSY);
  assert_int_equal(stop(IMUCAL_STOP_KEEP), IMUCAL_OK);
  assert_int_equal(info()->session, IMUCAL_SESSION_KEPT);
  assert_int_equal(from_cal("bench-2"), IMUCAL_ERR_SERIAL);
  assert_int_equal(from_cal(BENCH_SERIAL), IMUCAL_ERR_NOT_LEARNT); /* not one second was measured */
  assert_int_equal(info()->table_status, IMUCAL_ERR_NO_TABLE);
  assert_int_equal(stop(IMUCAL_STOP_DISCARD), IMUCAL_OK);
  const imucal_link_cal_state_t ask = {.channel = 0};
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_STATE, &ask), IMUCAL_ERR_STATE);
  const imucal_link_cal_filter_t ask_filter = {.channel = 9};
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_FILTER, &ask_filter), IMUCAL_ERR_UNKNOWN);
}

static void test_cal_start_bad_numbers_are_refused(void** state) {
  (void)state;
  const imucal_link_cal_start_t good = reference_cal_start(0, 3);
  imucal_link_cal_start_t bad = good;
  bad.span_lo_degc = 60, bad.span_hi_degc = 0; /* reversed */
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_START, &bad), IMUCAL_ERR_SPAN);
  bad = good, bad.span_hi_degc = 70; /* outside t0 +- range */
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_START, &bad), IMUCAL_ERR_SPAN);
  bad = good, bad.t0_degc = imucal_float_from_bits(0x7FC00000u);
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_START, &bad), IMUCAL_ERR_NOT_FINITE);
  bad = good, bad.markov_tau_s[0] = 0;
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_START, &bad), IMUCAL_ERR_MODEL);
  bad = good, bad.r = -1;
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_START, &bad), IMUCAL_ERR_MODEL);
  bad = good, bad.prior_sigma = 0;
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_START, &bad), IMUCAL_ERR_RANGE);
  assert_int_equal(info()->session, IMUCAL_SESSION_IDLE);
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_START, &good), IMUCAL_OK);
}

/* What the table of the filters must be refused for is refused before the hours of learning, not after them. */
static void test_cal_start_refuses_what_no_table_can_hold(void** state) {
  (void)state;
  const imucal_link_cal_start_t good = reference_cal_start(0, 3);
  imucal_link_cal_start_t bad = good;
  bad.arw = 2e4f;
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_START, &bad), IMUCAL_ERR_MODEL);
  bad = good, bad.markov_sigma[0] = 2e6f;
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_START, &bad), IMUCAL_ERR_MODEL);
  bad = good, bad.markov_tau_s[0] = 1e-4f;
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_START, &bad), IMUCAL_ERR_MODEL);
  bad = good, bad.markov_tau_s[0] = 2e9f;
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_START, &bad), IMUCAL_ERR_MODEL);
  bad = good, bad.t0_degc = bad.range_degc = 1000.0f, bad.span_hi_degc = 1500.0f; /* no sensor is so hot */
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_START, &bad), IMUCAL_ERR_SPAN);
  bad = good, bad.t0_degc = 25.0f, bad.range_degc = 0.05f, bad.span_lo_degc = 24.96f, bad.span_hi_degc = 25.04f;
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_START, &bad), IMUCAL_ERR_PRECISION);
  assert_int_equal(info()->session, IMUCAL_SESSION_IDLE);
  bench.board.degc_at_zero = 2e6f; /* no table of this board at all */
  bench_power_cycle(&bench);
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_START, &good), IMUCAL_ERR_SCALE);
  bench.board.degc_at_zero = 25.0f;
  bench_power_cycle(&bench);
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_START, &good), IMUCAL_OK);
}

/* Flash whose sizes hold no table: not started with, and where it changes under the app no calibration begins. */
static void test_flash_that_holds_no_table_is_refused_before_learning(void** state) {
  (void)state;
  bench.port.flash.program_bytes = 3;
  assert_int_equal(bench_cal_start(&bench, 0, 3), IMUCAL_ERR_GEOMETRY);
  assert_int_equal(info()->session, IMUCAL_SESSION_IDLE);
  assert_int_equal(imucal_app_init(&bench.app, &bench.port, &bench.board), IMUCAL_ERR_GEOMETRY);
  bench.port.flash.program_bytes = 4;
  bench_power_cycle(&bench);
  assert_int_equal(bench_cal_start(&bench, 0, 3), IMUCAL_OK);
}

static void test_cal_filter_gives_the_filters_bits(void** state) {
  (void)state;
  calibrate(1);
  const imucal_link_cal_filter_t ask = {.channel = 0};
  assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_CAL_FILTER, &ask), IMUCAL_LINK_ID_CAL_FILTER_REPLY);
  assert_int_equal(bench.reply.cal_filter_reply.n_states, 5);
  const imucal_kf_t* kf = &bench.app.channel[0].learn.kf;
  const imucal_link_cal_filter_reply_t* reply = &bench.reply.cal_filter_reply;
  imucal_kf_state_t numbers;
  imucal_kf_get_state(kf, &numbers);
  assert_memory_equal(reply->x, numbers.x, sizeof numbers.x);
  assert_memory_equal(reply->x_lo, numbers.x_lo, sizeof numbers.x_lo);
  assert_memory_equal(reply->d, numbers.d, sizeof numbers.d);
  assert_memory_equal(reply->d_lo, numbers.d_lo, sizeof numbers.d_lo);
  assert_memory_equal(reply->u, numbers.u, sizeof numbers.u);
}

static double value_of(uint32_t bits) {
  return (double)imucal_float_from_bits(bits);
}

/* The reply read as link.md says, at both ends of the range: T_k(1) = 1, T_k(-1) = (-1)^k. */
static void test_cal_filter_reads_as_documented(void** state) {
  (void)state;
  calibrate(1);
  const imucal_link_cal_filter_t ask = {.channel = 0};
  assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_CAL_FILTER, &ask), IMUCAL_LINK_ID_CAL_FILTER_REPLY);
  const imucal_link_cal_filter_reply_t* reply = &bench.reply.cal_filter_reply;
  const imucal_kf_t* kf = &bench.app.channel[0].learn.kf;
  const int order = reply->n_states - 2;
  for (int end = -1; end <= 1; end += 2) {
    double c[6], y[6], bias = 0, variance = 0;
    for (int k = order; k >= 0; k--) { /* R c = x */
      c[k] = value_of(reply->x[k + 1]) + value_of(reply->x_lo[k + 1]);
      for (int j = k + 1; j <= order; j++) c[k] -= value_of(reply->u[6 + j * (j - 1) / 2 + k]) * c[j];
    }
    for (int k = 0; k <= order; k++) { /* h' R^-1 D^-1 R^-T h with R' y = h */
      const double h = k % 2 ? end : 1;
      y[k] = h;
      for (int i = 0; i < k; i++) y[k] -= value_of(reply->u[6 + k * (k - 1) / 2 + i]) * y[i];
      bias += h * c[k];
      variance += y[k] * y[k] / (value_of(reply->d[k + 1]) + value_of(reply->d_lo[k + 1]));
    }
    const float temp_degc = kf->config.t0_degc + (float)end * kf->config.range_degc;
    assert_float_equal((float)bias, imucal_kf_bias(kf, temp_degc), 0.01f);
    assert_float_equal((float)variance / imucal_kf_bias_variance(kf, temp_degc), 1.0f, 1e-4f);
  }
}

/* ---- tables ---- */

/* It takes the staging area, so what comes after is refused at once and not as a damaged table at the end. */
static void test_upload_is_closed_by_a_table_of_the_filters_that_fails(void** state) {
  (void)state;
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  const size_t n = bench_table(&bench, 55.0f, bytes);
  assert_int_equal(bench_upload(&bench, bytes, n), IMUCAL_OK);
  assert_int_equal(bench_cal_start(&bench, 0, 1), IMUCAL_OK);
  assert_int_equal(stop(IMUCAL_STOP_KEEP), IMUCAL_OK);
  const imucal_link_table_begin_t begin = {.total = (uint16_t)n, .crc = imucal_crc32(bytes, n)};
  imucal_link_table_data_t data = {.length = 200};
  memcpy(data.data, bytes, 200);
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_BEGIN, &begin), IMUCAL_OK);
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_DATA, &data), IMUCAL_OK);
  assert_int_equal(from_cal(BENCH_SERIAL), IMUCAL_ERR_NOT_LEARNT); /* not one second was measured */
  data.offset = 200;
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_DATA, &data), IMUCAL_ERR_STATE);
  assert_true(bench_ruling_b0(&bench) == 55.0f);
  assert_int_equal(bench_upload(&bench, bytes, n), IMUCAL_OK);
}

static void refresh_crc(uint8_t* bytes, size_t n) {
  imucal_put_u32(bytes + n - 4, imucal_crc32(bytes, n - 4));
}

/* Uploads a damaged copy: refused with `status`, and the table before still rules, also after a power cycle.
 */
static void expect_refused(const uint8_t* bytes, size_t n, int status) {
  assert_int_equal(bench_upload(&bench, bytes, n), status);
  assert_true(bench_ruling_b0(&bench) == 55.0f);
  bench_power_cycle(&bench);
  assert_true(bench_ruling_b0(&bench) == 55.0f);
}

static void test_upload_bad_tables_leave_the_last_good_one(void** state) {
  (void)state;
  uint8_t good[IMUCAL_TABLE_MAX_BYTES], bad[IMUCAL_TABLE_MAX_BYTES];
  const size_t n = bench_table(&bench, 55.0f, good);
  assert_int_equal(bench_upload(&bench, good, n), IMUCAL_OK);
  memcpy(bad, good, n), bad[60] ^= 1;
  expect_refused(bad, n, IMUCAL_ERR_CRC);
  memcpy(bad, good, n), bad[0] ^= 1, refresh_crc(bad, n);
  expect_refused(bad, n, IMUCAL_ERR_MAGIC);
  memcpy(bad, good, n), bad[4] = 9, refresh_crc(bad, n);
  expect_refused(bad, n, IMUCAL_ERR_VERSION);

  strncpy(bench.board.serial, "bench-2", sizeof bench.board.serial); /* a table of another device */
  bench_table(&bench, 7.0f, bad);
  strncpy(bench.board.serial, BENCH_SERIAL, sizeof bench.board.serial);
  expect_refused(bad, n, IMUCAL_ERR_SERIAL);
  bench.board.channel[1].unit_per_count = 36.0f; /* of another sensor */
  bench_table(&bench, 7.0f, bad);
  bench.board.channel[1].unit_per_count = 1.0f;
  expect_refused(bad, n, IMUCAL_ERR_SCALE);
  bench.board.channel[2].name[1] = 'w';
  bench_table(&bench, 7.0f, bad);
  bench.board.channel[2].name[1] = 'z';
  expect_refused(bad, n, IMUCAL_ERR_NAME);
  bench.board.degc_at_zero = 20.0f;
  bench_table(&bench, 7.0f, bad);
  bench.board.degc_at_zero = 25.0f;
  expect_refused(bad, n, IMUCAL_ERR_SCALE);

  float b0 = 55.0f; /* the coefficient, wherever it stands, becomes NaN */
  uint8_t pattern[4];
  imucal_put_f32(pattern, b0);
  memcpy(bad, good, n);
  size_t at = 0;
  while (memcmp(bad + at, pattern, 4)) at++;
  imucal_put_u32(bad + at, 0x7FC00000u), refresh_crc(bad, n);
  expect_refused(bad, n, IMUCAL_ERR_COEFFICIENT);
  assert_int_equal(bench_upload(&bench, good, n), IMUCAL_OK); /* and a good one is still taken */
  assert_int_equal(bench.reply.done.detail, 2);
}

static void test_upload_rules(void** state) {
  (void)state;
  const imucal_link_table_commit_t commit = {0};
  imucal_link_table_data_t data = {.offset = 0, .length = 10};
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_DATA, &data), IMUCAL_ERR_STATE);
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_COMMIT, &commit), IMUCAL_ERR_STATE);
  imucal_link_table_begin_t begin = {.total = 10};
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_BEGIN, &begin), IMUCAL_ERR_LENGTH);
  begin.total = 0xFFFF;
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_BEGIN, &begin), IMUCAL_ERR_LENGTH);
  begin.total = 456;
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_BEGIN, &begin), IMUCAL_OK);
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_DATA, &data), IMUCAL_OK);
  data.offset = 20; /* a hole: told what is expected */
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_DATA, &data), IMUCAL_ERR_STATE);
  assert_int_equal(bench.reply.done.detail, 10);
  data.offset = 10, data.length = 0;
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_DATA, &data), IMUCAL_ERR_LENGTH);
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_COMMIT, &commit), IMUCAL_ERR_STATE); /* too early */
  begin.total = 456;
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_BEGIN, &begin), IMUCAL_OK);
  data.length = 200;
  for (data.offset = 0; data.offset < 400; data.offset = (uint16_t)(data.offset + 200))
    assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_DATA, &data), IMUCAL_OK);
  data.length = 57; /* one byte more than was said */
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_DATA, &data), IMUCAL_ERR_LENGTH);
}

static void test_upload_whole_table_but_other_crc_announced_is_refused(void** state) {
  (void)state;
  uint8_t good[IMUCAL_TABLE_MAX_BYTES];
  const size_t n = bench_table(&bench, 55.0f, good);
  const imucal_link_table_begin_t begin = {.total = (uint16_t)n, .crc = imucal_crc32(good, n) ^ 1u};
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_BEGIN, &begin), IMUCAL_OK);
  for (size_t at = 0; at < n; at += 152) {
    imucal_link_table_data_t data = {.offset = (uint16_t)at, .length = 152};
    memcpy(data.data, good + at, 152);
    assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_DATA, &data), IMUCAL_OK);
  }
  const imucal_link_table_commit_t commit = {0};
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_COMMIT, &commit), IMUCAL_ERR_CRC);
  assert_int_equal(info()->table_status, IMUCAL_ERR_NO_TABLE);
}

/* Two good tables of one length: their CRC over everything is the same number, their own CRC is not. */
static void test_upload_of_another_table_than_announced_is_refused(void** state) {
  (void)state;
  uint8_t announced[IMUCAL_TABLE_MAX_BYTES], sent[IMUCAL_TABLE_MAX_BYTES];
  const size_t n = bench_table(&bench, 55.0f, announced);
  assert_int_equal(bench_table(&bench, 56.0f, sent), n);
  assert_int_equal(imucal_crc32(announced, n), imucal_crc32(sent, n));
  const uint8_t* candidates[] = {sent, announced};
  const imucal_link_table_begin_t begin = {.total = (uint16_t)n, .crc = imucal_get_u32(announced + n - 4)};
  for (int i = 0; i < 2; i++) {
    assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_BEGIN, &begin), IMUCAL_OK);
    for (size_t at = 0; at < n; at += 152) {
      imucal_link_table_data_t data = {.offset = (uint16_t)at, .length = 152};
      memcpy(data.data, candidates[i] + at, 152);
      assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_DATA, &data), IMUCAL_OK);
    }
    const imucal_link_table_commit_t commit = {0};
    assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_COMMIT, &commit), i == 0 ? IMUCAL_ERR_CRC : IMUCAL_OK);
  }
  assert_int_equal(info()->table_status, IMUCAL_OK);
}

static void test_table_read_refusals(void** state) {
  (void)state;
  imucal_link_table_read_t request = {.slot = 255, .length = 10};
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_READ, &request), IMUCAL_ERR_NO_TABLE);
  request.slot = 2;
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_READ, &request), IMUCAL_ERR_UNKNOWN);
  request.slot = 1; /* erased */
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_READ, &request), IMUCAL_ERR_MAGIC);
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  assert_int_equal(bench_upload(&bench, bytes, bench_table(&bench, 5.0f, bytes)), IMUCAL_OK);
  request.slot = 255, request.offset = 456;
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_READ, &request), IMUCAL_ERR_RANGE);
  request.offset = 0, request.length = 0;
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_READ, &request), IMUCAL_ERR_RANGE);
  for (request.offset = 0; request.offset < 456; request.offset++) { /* every alignment */
    request.length = 200;
    assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_TABLE_READ, &request), IMUCAL_LINK_ID_TABLE_READ_REPLY);
    const imucal_link_table_read_reply_t* part = &bench.reply.table_read_reply;
    assert_int_equal(part->length, 456 - request.offset < 200 ? 456 - request.offset : 200);
    assert_memory_equal(part->data, bench.flash + request.offset, part->length);
  }
}

static void test_rollback_and_erase(void** state) {
  (void)state;
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  const imucal_link_rollback_t rollback = {0};
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_ROLLBACK, &rollback), IMUCAL_ERR_NO_TABLE);
  assert_int_equal(bench_upload(&bench, bytes, bench_table(&bench, 1.0f, bytes)), IMUCAL_OK);
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_ROLLBACK, &rollback), IMUCAL_ERR_NO_OTHER);
  assert_true(bench_ruling_b0(&bench) == 1.0f);
  assert_int_equal(bench_upload(&bench, bytes, bench_table(&bench, 2.0f, bytes)), IMUCAL_OK);
  assert_true(bench_ruling_b0(&bench) == 2.0f);
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_ROLLBACK, &rollback), IMUCAL_OK);
  assert_int_equal(bench.reply.done.detail, 1);
  assert_true(bench_ruling_b0(&bench) == 1.0f);
  bench_power_cycle(&bench);
  assert_true(bench_ruling_b0(&bench) == 1.0f);
  imucal_link_erase_t erase = {.confirm = 1};
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_ERASE, &erase), IMUCAL_ERR_ARGUMENT);
  assert_true(bench_ruling_b0(&bench) == 1.0f);
  erase.confirm = IMUCAL_LINK_ERASE_CONFIRM;
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_ERASE, &erase), IMUCAL_OK);
  assert_int_equal(info()->table_status, IMUCAL_ERR_NO_TABLE);
  assert_int_equal(info()->slot_status[1], IMUCAL_SLOT_EMPTY);
}

#define CASE(test) cmocka_unit_test_setup(test, start)

int main(void) {
  const struct CMUnitTest tests[] = {
      CASE(test_boot_without_table_says_so_and_passes_samples),
      CASE(test_init_bad_board_is_refused),
      CASE(test_init_missing_callbacks_are_refused),
      CASE(test_hello_tells_who_and_refuses_old_protocol),
      CASE(test_channel_info_known_and_unknown_channel),
      CASE(test_unknown_request_and_wrong_payload_are_refused),
      CASE(test_stream_unknown_bits_are_refused),
      CASE(test_bare_requests_that_change_something_are_locked),
      CASE(test_unlock_names_the_serial_and_the_newest_challenge),
      CASE(test_commands_late_doubled_or_of_another_token_do_nothing),
      CASE(test_unlock_expires),
      CASE(test_command_sent_again_after_a_restart_or_too_late_is_stale),
      CASE(test_command_of_wrong_content_is_refused),
      CASE(test_reserved_fields_are_checked),
      CASE(test_state_tells_crc_time_and_origin_of_the_ruling_table),
      CASE(test_state_origin_of_an_old_table_is_unknown),
      CASE(test_table_out_of_physical_limits_is_refused),
      CASE(test_session_refuses_to_start_a_running_channel_again),
      CASE(test_host_that_died_does_not_leave_the_device_busy),
      CASE(test_reboot_answers_first),
      CASE(test_reboot_stuck_line_reboots_all_the_same),
      CASE(test_session_learns_stores_and_compensates),
      CASE(test_session_one_channel_keeps_others_of_ruling_table),
      CASE(test_session_one_channel_without_table_leaves_others_uncalibrated),
      CASE(test_channel_with_a_scale_factor_alone_is_compensated),
      CASE(test_session_one_channel_with_a_coarse_thermometer_makes_a_table),
      CASE(test_session_rules),
      CASE(test_cal_start_bad_numbers_are_refused),
      CASE(test_cal_start_refuses_what_no_table_can_hold),
      CASE(test_flash_that_holds_no_table_is_refused_before_learning),
      CASE(test_upload_is_closed_by_a_table_of_the_filters_that_fails),
      CASE(test_cal_filter_gives_the_filters_bits),
      CASE(test_cal_filter_reads_as_documented),
      CASE(test_upload_bad_tables_leave_the_last_good_one),
      CASE(test_upload_rules),
      CASE(test_upload_whole_table_but_other_crc_announced_is_refused),
      CASE(test_upload_of_another_table_than_announced_is_refused),
      CASE(test_table_read_refusals),
      CASE(test_rollback_and_erase),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
