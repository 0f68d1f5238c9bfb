// SPDX-License-Identifier: MIT
// The whole app under a list of operations: requests that are good, wrong inside, mutated, replayed, late, out of order;
// samples, time, power cuts, a flash driver that fails.  Input: bytes, each operation takes what it needs.
// What must hold, else the program aborts:
//   every request that arrives whole is answered, once; nothing else is;
//   the flash is touched only while a command runs that has the newest token, a fresh number, and one of the four requests
//   that write; and at the start nothing is written at all;
//   what was reported as done rules after the next start; what rules was once sent as a table, or learnt;
//   the app comes to rest in a bounded number of steps.
#ifndef TESTS_FUZZ_DEVICE_H
#define TESTS_FUZZ_DEVICE_H
#include <stdio.h>
#include <stdlib.h>

#include "app/app.h"
#include "check/reference.h"
#include "crc.h"
#include "emu/torn_nor.h"
#include "num.h"

#define FUZZ_CHECK(condition)                                                                                          \
  do {                                                                                                                 \
    if (!(condition)) {                                                                                                \
      fprintf(stderr, "fuzz_device: %s:%d: %s\n", __FILE__, __LINE__, #condition);                                     \
      abort();                                                                                                         \
    }                                                                                                                  \
  } while (0)

enum { FUZZ_KEPT_FRAMES = 16, FUZZ_MARKS = 64, FUZZ_MAX_STEPS = 200000 };

typedef struct {
  imucal_app_t app;
  imucal_port_t port;
  imucal_board_t board;
  torn_nor_t nor;
  const uint8_t* data;
  size_t left;

  uint8_t line[1024];
  size_t line_at, line_end;
  imucal_link_rx_t device_rx; // what the device should make of the line
  imucal_link_rx_t host_rx;
  uint32_t n_due, n_replies;
  imucal_link_any_t reply;
  uint8_t reply_type;

  struct {
    uint8_t bytes[IMUCAL_LINK_MAX_FRAME];
    size_t len;
  } kept[FUZZ_KEPT_FRAMES];
  uint32_t n_kept;

  uint32_t token, number; // newest unlock as the host knows it, newest number that reached the device with it
  uint32_t next_number;
  uint8_t sequence;
  bool is_meant;      // a command that may write is among the bytes on the line
  uint32_t n_marks;   // tables ever sent or learnt: created_s 1 .. n_marks
  uint32_t must_rule; // mark that was reported as done and not touched since; 0: nothing is sure

  uint64_t time_us, t_us;
  uint32_t n_samples_left;
  uint8_t sample_kind;
  bool is_rebooting;
} fuzz_t;

typedef struct {
  uint64_t n_inputs, n_operations, n_frames, n_replies, n_replays, n_flash_commands, n_cuts, n_power_cycles;
} fuzz_counts_t;

static fuzz_t fuzz;
static fuzz_counts_t fuzz_counts;

static uint8_t fuzz_byte(void) {
  return fuzz.left ? fuzz.left--, *fuzz.data++ : 0;
}
static uint32_t fuzz_u32(void) {
  uint32_t value = 0;
  for (int i = 0; i < 4; i++) value = value << 8 | fuzz_byte();
  return value;
}

/* ---- the port ---- */

static size_t fuzz_serial_read(void* ctx, uint8_t* data, size_t capacity) {
  (void)ctx;
  size_t n = fuzz.line_end - fuzz.line_at;
  if (n > capacity) n = capacity;
  memcpy(data, fuzz.line + fuzz.line_at, n);
  fuzz.line_at += n;
  return n;
}
static size_t fuzz_serial_write(void* ctx, const uint8_t* data, size_t n) {
  (void)ctx;
  for (size_t i = 0; i < n; i++) {
    if (imucal_link_rx_put(&fuzz.host_rx, data[i]) != IMUCAL_FRAME_READY) continue;
    imucal_link_any_t message;
    FUZZ_CHECK(imucal_link_rx_message(&fuzz.host_rx, &message) == IMUCAL_OK);
    if (imucal_link_rx_type(&fuzz.host_rx) < 0x80) continue;
    fuzz.n_replies++;
    fuzz_counts.n_replies++;
    fuzz.reply = message;
    fuzz.reply_type = imucal_link_rx_type(&fuzz.host_rx);
    if (fuzz.reply_type != IMUCAL_LINK_ID_UNLOCK_REPLY || fuzz.token == message.unlock_reply.token) continue;
    fuzz.token = message.unlock_reply.token;
    fuzz.number = fuzz.next_number = 0;
  }
  return n;
}
static imucal_port_sample_t fuzz_sample_read(void* ctx, imucal_sample_t* sample) {
  (void)ctx;
  if (fuzz.n_samples_left == 0) return IMUCAL_PORT_NO_SAMPLE;
  const uint32_t n = fuzz.n_samples_left--, kind = fuzz.sample_kind;
  if (kind % 16 == 1 && n == 1) return IMUCAL_PORT_BAD_SAMPLE;
  if (kind % 16 == 2 && n == 1) return IMUCAL_PORT_ENDED;
  if (kind % 16 == 3 && n == 1) return IMUCAL_PORT_FAILED;
  fuzz.t_us += kind % 16 == 4 ? 3000000u : kind % 16 == 5 ? 0u : 100000u;
  *sample = (imucal_sample_t){.t_us = kind % 16 == 6   ? fuzz.t_us - 5000000u
                                      : kind % 16 == 7 ? UINT64_MAX - fuzz.t_us
                                                       : fuzz.t_us,
                              .n_channels = kind % 16 == 8 ? 6 : 3,
                              .temp_counts = kind % 16 == 9 ? INT32_MAX : (int32_t)(fuzz.t_us / 100000u),
                              .saturated = kind >> 6};
  for (int i = 0; i < 3; i++)
    sample->counts[i] = kind % 16 == 10 ? INT32_MIN : (int32_t)(torn_nor_mix(fuzz.t_us + (uint64_t)i) % 200);
  return IMUCAL_PORT_SAMPLE;
}
static uint64_t fuzz_time_us(void* ctx) {
  (void)ctx;
  return fuzz.time_us += 10;
}
static void fuzz_watchdog(void* ctx) {
  (void)ctx;
}
static void fuzz_reboot(void* ctx) {
  (void)ctx;
  fuzz.is_rebooting = true;
}
static imucal_status fuzz_erase(void* ctx, uint32_t slot) {
  FUZZ_CHECK(fuzz.is_meant);
  return torn_nor_erase(ctx, slot);
}
static imucal_status fuzz_program(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len) {
  FUZZ_CHECK(fuzz.is_meant);
  return torn_nor_program(ctx, slot, offset, data, len);
}

/* ---- the host ---- */

static void fuzz_start(void) {
  fuzz.is_meant = false;
  fuzz.is_rebooting = false;
  fuzz.line_at = fuzz.line_end = 0;
  fuzz.n_due = fuzz.n_replies = 0;
  fuzz.token = 0;
  imucal_link_rx_init(&fuzz.device_rx);
  imucal_link_rx_init(&fuzz.host_rx);
  torn_nor_power_on(&fuzz.nor);
  fuzz.nor.fail_at_call = 0; // a read that fails at the start hides a table for that time
  fuzz.port.boot_id++;
  memset(&fuzz.app, 0xA5, sizeof fuzz.app);
  FUZZ_CHECK(imucal_app_init(&fuzz.app, &fuzz.port, &fuzz.board) == IMUCAL_OK);
  const bool has_table = fuzz.app.table_status == IMUCAL_OK;
  const uint32_t mark = has_table ? fuzz.app.table.created_s : 0;
  FUZZ_CHECK(mark <= fuzz.n_marks);
  FUZZ_CHECK(fuzz.must_rule == 0 || mark == fuzz.must_rule);
  FUZZ_CHECK(fuzz.nor.n_violations == 0);
}

static void fuzz_power_cycle(void) {
  fuzz_counts.n_power_cycles++;
  fuzz_counts.n_cuts += fuzz.nor.is_off != 0;
  fuzz_start();
}

static void fuzz_run(void) {
  uint32_t n = 0;
  while (imucal_app_step(&fuzz.app) || fuzz.app.tx_at != fuzz.app.tx_end) FUZZ_CHECK(++n < FUZZ_MAX_STEPS);
}

/* Is this request, as the device will see it, a command that may write? */
static bool fuzz_may_write(const imucal_link_rx_t* rx) {
  imucal_link_any_t message;
  if (imucal_link_rx_type(rx) != IMUCAL_LINK_ID_COMMAND) return false;
  if (imucal_link_decode(IMUCAL_LINK_ID_COMMAND, imucal_link_rx_payload(rx), imucal_link_rx_payload_len(rx),
                         &message) != IMUCAL_OK)
    return false;
  if (fuzz.token == 0 || message.command.token != fuzz.token || message.command.number <= fuzz.number) return false;
  imucal_link_any_t inside;
  if (imucal_link_decode(message.command.request, message.command.payload, message.command.length, &inside) !=
      IMUCAL_OK)
    return false;
  if (!imucal_link_is_guarded(message.command.request)) return false;
  fuzz.number = message.command.number;
  const uint8_t id = message.command.request;
  return id == IMUCAL_LINK_ID_TABLE_COMMIT || id == IMUCAL_LINK_ID_ROLLBACK || id == IMUCAL_LINK_ID_ERASE ||
         id == IMUCAL_LINK_ID_TABLE_FROM_CAL;
}

static void fuzz_give(void) {
  fuzz_run();
  FUZZ_CHECK(fuzz.n_replies == fuzz.n_due);
  if (fuzz.nor.is_off || fuzz.is_rebooting) fuzz_power_cycle();
}

/* Byte by byte: the flash may be touched only from the end of a command that may write to the next byte. */
static void fuzz_send(const uint8_t* bytes, size_t n) {
  for (size_t i = 0; i < n; i++) {
    fuzz.line[0] = bytes[i], fuzz.line_at = 0, fuzz.line_end = 1;
    fuzz.is_meant = false;
    if (imucal_link_rx_put(&fuzz.device_rx, bytes[i]) == IMUCAL_FRAME_READY) {
      const uint8_t type = imucal_link_rx_type(&fuzz.device_rx);
      fuzz.n_due += type != 0 && type < 0x40;
      fuzz_counts.n_frames++;
      fuzz.is_meant = fuzz_may_write(&fuzz.device_rx);
      fuzz_counts.n_flash_commands += fuzz.is_meant;
      if (fuzz.is_meant) fuzz.must_rule = 0;
    }
    if (fuzz.line_end && bytes[i] == 0)
      fuzz_give();
    else
      fuzz_run();
  }
  fuzz.is_meant = false;
}

static void fuzz_send_frame(const uint8_t* bytes, size_t n) {
  const uint32_t at = fuzz.n_kept++ % FUZZ_KEPT_FRAMES;
  memcpy(fuzz.kept[at].bytes, bytes, n);
  fuzz.kept[at].len = n;
  fuzz_send(bytes, n);
}

static void fuzz_ask(uint32_t id, const void* message) {
  uint8_t frame[IMUCAL_LINK_MAX_FRAME];
  size_t n = 0;
  FUZZ_CHECK(imucal_link_pack(id, ++fuzz.sequence, message, frame, sizeof frame, &n) == IMUCAL_OK);
  fuzz_send_frame(frame, n);
}

/* A command; `twist` makes it foreign, late or of another kind. */
static void fuzz_command(uint32_t id, const void* message, uint8_t twist) {
  imucal_link_command_t command = {.token = fuzz.token, .number = ++fuzz.next_number, .request = (uint8_t)id};
  size_t n = 0;
  if (imucal_link_encode(id, message, command.payload, sizeof command.payload, &n) != IMUCAL_OK) return;
  command.length = (uint8_t)n;
  if (twist == 1) command.token ^= 1u << (fuzz_byte() & 31);
  if (twist == 2) command.number = fuzz_byte();
  if (twist == 3) command.request = fuzz_byte();
  if (twist == 4) command.length = fuzz_byte() % 207;
  fuzz_ask(IMUCAL_LINK_ID_COMMAND, &command);
}

static void fuzz_unlock(uint8_t twist) {
  const imucal_link_state_t state = {.reserved = twist == 1};
  fuzz_ask(IMUCAL_LINK_ID_STATE, &state);
  if (fuzz.reply_type != IMUCAL_LINK_ID_STATE_REPLY) return;
  imucal_link_unlock_t unlock = {.challenge = fuzz.reply.state_reply.challenge ^ (twist == 2),
                                 .seconds = twist == 3 ? fuzz_byte() * 257u : 60};
  memcpy(unlock.serial, fuzz.board.serial, sizeof unlock.serial);
  unlock.serial[1] ^= twist == 4;
  fuzz_ask(IMUCAL_LINK_ID_UNLOCK, &unlock);
}

static size_t fuzz_table(uint32_t mark, uint8_t* bytes) {
  imucal_table_t table;
  memset(&table, 0, sizeof table);
  memcpy(table.serial, fuzz.board.serial, sizeof table.serial);
  table.sequence = 1, table.created_s = mark, table.n_channels = fuzz.board.n_channels;
  table.degc_per_count = fuzz.board.degc_per_count, table.degc_at_zero = fuzz.board.degc_at_zero;
  for (int i = 0; i < table.n_channels; i++) {
    imucal_table_channel_t* c = &table.channel[i];
    memcpy(c->name, fuzz.board.channel[i].name, sizeof c->name);
    c->order = 1, c->t0_degc = c->range_degc = 30, c->coeff[0] = (float)mark, c->span_hi_degc = 60;
    for (int k = 0; k < IMUCAL_TABLE_SIGMA_N; k++) c->sigma[k] = 5;
    c->unit_per_count = 1, c->full_scale_counts = fuzz.board.channel[i].full_scale_counts;
  }
  size_t n = 0;
  FUZZ_CHECK(imucal_table_encode(&table, bytes, IMUCAL_TABLE_MAX_BYTES, &n) == IMUCAL_OK);
  return n;
}

static bool fuzz_is_done(uint32_t request) {
  return fuzz.reply_type == IMUCAL_LINK_ID_DONE && fuzz.reply.done.request == request &&
         fuzz.reply.done.status == IMUCAL_OK;
}

static void fuzz_upload(uint8_t twist) {
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  if (fuzz.n_marks >= FUZZ_MARKS) return;
  const uint32_t mark = ++fuzz.n_marks;
  const size_t n = fuzz_table(mark, bytes);
  if (twist == 1) bytes[fuzz_byte() % n] ^= 1;
  if (twist == 2)
    imucal_put_f32(bytes + 44 + 16 + fuzz_byte() % 29 * 4, imucal_float_from_bits(fuzz_u32())),
        imucal_put_u32(bytes + n - 4, imucal_crc32(bytes, n - 4));
  const imucal_link_table_begin_t begin = {.total = (uint16_t)n, .crc = imucal_get_u32(bytes + n - 4)};
  fuzz_command(IMUCAL_LINK_ID_TABLE_BEGIN, &begin, 0);
  for (size_t at = 0; at < n; at += 200) {
    imucal_link_table_data_t data = {.offset = (uint16_t)at, .length = (uint8_t)(n - at < 200 ? n - at : 200)};
    memcpy(data.data, bytes + at, data.length);
    fuzz_command(IMUCAL_LINK_ID_TABLE_DATA, &data, 0);
  }
  const imucal_link_table_commit_t commit = {.reserved = twist == 3};
  const uint32_t boot_id = fuzz.port.boot_id;
  fuzz_command(IMUCAL_LINK_ID_TABLE_COMMIT, &commit, twist > 4 ? twist - 4 : 0);
  if (fuzz.port.boot_id == boot_id && fuzz_is_done(IMUCAL_LINK_ID_TABLE_COMMIT)) fuzz.must_rule = mark;
}

static void fuzz_cal_start(uint8_t which) {
  imucal_link_cal_start_t start = reference_cal_start(which & 3, (uint8_t)(1 + (which >> 2 & 7)));
  float* const fields[] = {&start.t0_degc,
                           &start.range_degc,
                           &start.m,
                           &start.q,
                           &start.r,
                           &start.markov_variance,
                           &start.prior_sigma,
                           &start.span_lo_degc,
                           &start.span_hi_degc,
                           &start.arw,
                           &start.markov_sigma[0],
                           &start.markov_tau_s[0]};
  if (which & 0x80) *fields[fuzz_byte() % 12] = imucal_float_from_bits(fuzz_u32());
  fuzz_command(IMUCAL_LINK_ID_CAL_START, &start, 0);
}

static void fuzz_any_request(void) {
  static const uint8_t ids[] = {IMUCAL_LINK_ID_HELLO,      IMUCAL_LINK_ID_INFO,
                                IMUCAL_LINK_ID_COUNTERS,   IMUCAL_LINK_ID_CHANNEL_INFO,
                                IMUCAL_LINK_ID_CAL_STATE,  IMUCAL_LINK_ID_CAL_FILTER,
                                IMUCAL_LINK_ID_TABLE_READ, IMUCAL_LINK_ID_STATE,
                                IMUCAL_LINK_ID_UNLOCK,     IMUCAL_LINK_ID_ERASE,
                                IMUCAL_LINK_ID_ROLLBACK,   IMUCAL_LINK_ID_CAL_START,
                                IMUCAL_LINK_ID_REBOOT,     0x3F};
  uint8_t frame[IMUCAL_LINK_MAX_FRAME], payload[64];
  const uint8_t id = ids[fuzz_byte() % sizeof ids];
  const size_t len = fuzz_byte() % sizeof payload;
  for (size_t i = 0; i < len; i++) payload[i] = fuzz_byte();
  size_t n = 0;
  FUZZ_CHECK(imucal_link_frame(id, ++fuzz.sequence, payload, len, frame, sizeof frame, &n) == IMUCAL_OK);
  fuzz_send_frame(frame, n);
}

static void fuzz_from_cal(void) {
  if (fuzz.n_marks >= FUZZ_MARKS) return;
  imucal_link_table_from_cal_t request = {.created_s = ++fuzz.n_marks};
  memcpy(request.serial, fuzz.board.serial, sizeof request.serial);
  const uint32_t boot_id = fuzz.port.boot_id;
  fuzz_command(IMUCAL_LINK_ID_TABLE_FROM_CAL, &request, 0);
  if (fuzz.port.boot_id == boot_id && fuzz_is_done(IMUCAL_LINK_ID_TABLE_FROM_CAL)) fuzz.must_rule = fuzz.n_marks;
}

/* An old frame again, whole, cut short, or with one byte changed. */
static void fuzz_replay(uint8_t how) {
  if (fuzz.n_kept == 0) return;
  const uint32_t n = fuzz.n_kept < FUZZ_KEPT_FRAMES ? fuzz.n_kept : FUZZ_KEPT_FRAMES;
  const uint32_t at = fuzz_byte() % n;
  uint8_t bytes[IMUCAL_LINK_MAX_FRAME];
  size_t len = fuzz.kept[at].len;
  memcpy(bytes, fuzz.kept[at].bytes, len);
  if (how == 1) bytes[fuzz_byte() % len] ^= (uint8_t)(1 << (fuzz_byte() & 7));
  if (how == 2) len = fuzz_byte() % (len + 1);
  fuzz_counts.n_replays++;
  fuzz_send(bytes, len);
}

static void fuzz_operate(void) {
  const uint8_t op = fuzz_byte(), how = op >> 4;
  const imucal_link_stream_t stream = {.what = how, .channels = 7, .period_s = 1};
  const imucal_link_erase_t erase = {.confirm = IMUCAL_LINK_ERASE_CONFIRM ^ (how == 15)};
  const imucal_link_cal_stop_t stop = {.action = how % 3};
  const imucal_link_rollback_t nothing = {.reserved = how == 15};
  switch (op & 15) {
  case 0:
    fuzz_unlock(how < 5 ? how : 0);
    break;
  case 1:
    fuzz_upload(how < 9 ? how : 0);
    break;
  case 2:
    fuzz_command(IMUCAL_LINK_ID_ROLLBACK, &nothing, how & 7);
    break;
  case 3:
    fuzz_command(IMUCAL_LINK_ID_ERASE, &erase, how & 7);
    break;
  case 4:
    fuzz_from_cal();
    break;
  case 5:
    fuzz_cal_start(fuzz_byte());
    break;
  case 6:
    fuzz_command(IMUCAL_LINK_ID_CAL_STOP, &stop, 0);
    break;
  case 7:
    fuzz_command(IMUCAL_LINK_ID_STREAM, &stream, 0);
    break;
  case 8:
    fuzz_any_request();
    break;
  case 9:
    fuzz_replay(how % 3);
    break;
  case 10: // samples
    fuzz.sample_kind = fuzz_byte(), fuzz.n_samples_left = 1u + fuzz_byte();
    fuzz_give();
    break;
  case 11:
    fuzz.time_us += how == 15 ? (uint64_t)IMUCAL_APP_SILENCE_S * 1000000u : (uint64_t)how * 10000000u;
    fuzz_give();
    break;
  case 12:
    fuzz_power_cycle();
    break;
  case 13:
    fuzz.nor.steps_left = fuzz_byte() % 160, fuzz.nor.pattern = how % TORN_NOR_PATTERNS;
    break;
  case 14:
    fuzz.nor.fail_how = how % 3, fuzz.nor.fail_at_call = 1 + fuzz_byte() % 16, fuzz.nor.n_calls = 0;
    break;
  default: // raw bytes
    for (int i = 0; i < how; i++) {
      const uint8_t byte = fuzz_byte();
      fuzz_send(&byte, 1);
    }
  }
  if (fuzz.nor.fail_at_call && (op & 15) != 14) fuzz.nor.fail_at_call = 0; // one operation long
}

static void fuzz_device(const uint8_t* data, size_t size) {
  static const torn_nor_geometry_t geometries[] = {{1024, 1024, 4}, {1024, 1024, 32}, {2048, 2048, 8}};
  static const char* const names[] = {"gx_dph", "gy_dph", "gz_dph"};
  memset(&fuzz, 0, sizeof fuzz);
  fuzz.data = data, fuzz.left = size;
  memcpy(fuzz.board.serial, "fuzz-1", 6);
  fuzz.board.n_channels = 3, fuzz.board.rate_hz = 10, fuzz.board.degc_per_count = 0.01f, fuzz.board.degc_at_zero = 25;
  for (int i = 0; i < 3; i++) {
    memcpy(fuzz.board.channel[i].name, names[i], 6);
    fuzz.board.channel[i].unit_per_count = 1, fuzz.board.channel[i].full_scale_counts = 1000000;
  }
  const uint8_t first = fuzz_byte();
  torn_nor_init(&fuzz.nor, geometries[first % 3]);
  fuzz.nor.mode = first >> 2 & 3;
  fuzz.nor.random = first;
  fuzz.port = (imucal_port_t){.ctx = &fuzz,
                              .serial_read = fuzz_serial_read,
                              .serial_write = fuzz_serial_write,
                              .sample_read = fuzz_sample_read,
                              .time_us = fuzz_time_us,
                              .watchdog = fuzz_watchdog,
                              .reboot = fuzz_reboot,
                              .is_replay = first >> 4 & 1,
                              .boot_id = first,
                              .device = "fuzz"};
  fuzz.port.flash = torn_nor_flash(&fuzz.nor);
  fuzz.port.flash.erase = fuzz_erase, fuzz.port.flash.program = fuzz_program;
  fuzz_start();
  if (first & 0x80) fuzz_unlock(0);
  while (fuzz.left) {
    fuzz_counts.n_operations++;
    fuzz_operate();
  }
  fuzz_counts.n_inputs++;
  fuzz_power_cycle();
}
#endif
