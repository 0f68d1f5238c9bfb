// SPDX-License-Identifier: MIT
#include "bench.h"

#include "crc.h"

/* ---- callbacks ---- */

static size_t serial_read(void* ctx, uint8_t* data, size_t capacity) {
  bench_t* bench = ctx;
  size_t n = bench->to_end - bench->to_at;
  if (n > capacity) n = capacity;
  memcpy(data, bench->to_device + bench->to_at, n);
  bench->to_at += n;
  return n;
}

static void keep_record(bench_t* bench, const imucal_link_any_t* message) {
  switch (imucal_link_rx_type(&bench->host_rx)) {
  case IMUCAL_LINK_ID_SECOND:
    if (bench->n_second && (uint16_t)(bench->second.counter + 1) != message->second.counter) bench->n_counter_jumps++;
    bench->second = message->second;
    bench->n_second++;
    break;
  case IMUCAL_LINK_ID_INNOVATION:
    bench->n_innovation++;
    break;
  case IMUCAL_LINK_ID_PROGRESS:
    bench->progress = message->progress;
    bench->n_progress++;
    break;
  case IMUCAL_LINK_ID_EVENT:
    bench->event[bench->n_event++ % 32] = message->event;
    break;
  default:
    bench->reply_id = imucal_link_rx_type(&bench->host_rx);
    bench->reply = *message;
    bench->has_reply = true;
    bench->n_replies++;
    break;
  }
}

static size_t serial_write(void* ctx, const uint8_t* data, size_t length) {
  bench_t* bench = ctx;
  const size_t n = length < bench->line_room ? length : bench->line_room;
  if (bench->line_room != UINT32_MAX) bench->line_room -= (uint32_t)n;
  for (size_t i = 0; i < n; i++) {
    if (imucal_link_rx_put(&bench->host_rx, data[i]) != IMUCAL_FRAME_READY) continue;
    imucal_link_any_t message;
    assert_int_equal(imucal_link_rx_message(&bench->host_rx, &message), IMUCAL_OK);
    keep_record(bench, &message);
  }
  return n;
}

static imucal_port_sample_t sample_read(void* ctx, imucal_sample_t* sample) {
  bench_t* bench = ctx;
  if (bench->n_left == 0) return bench->ends ? IMUCAL_PORT_ENDED : IMUCAL_PORT_NO_SAMPLE;
  bench->n_left--;
  bench->n_read++;
  *sample = (imucal_sample_t){.t_us = bench->t_us, .n_channels = 3};
  if (bench->shape) bench->shape(bench->t_us, sample);
  bench->t_us += bench->step_us;
  return IMUCAL_PORT_SAMPLE;
}

static void sample_enable(void* ctx, bool is_wanted) {
  if (is_wanted) ((bench_t*)ctx)->n_enabled++;
}

static void sample_out(void* ctx, const imucal_sample_t* raw, const int32_t* out, const uint8_t* frac_bits,
                       uint8_t clamped) {
  bench_t* bench = ctx;
  bench->last_raw = *raw;
  memcpy(bench->last_out, out, 3 * sizeof *out);
  memcpy(bench->last_frac_bits, frac_bits, 3);
  bench->last_clamped = clamped;
}

static bool nor_load(void* ctx, uint32_t offset, uint8_t* data, size_t n) {
  memcpy(data, ((bench_t*)ctx)->flash + offset, n);
  return true;
}

static bool nor_save(void* ctx, uint32_t offset, const uint8_t* data, size_t n) {
  memcpy(((bench_t*)ctx)->flash + offset, data, n);
  return true;
}

static imucal_status flash_status(nor_result_t result) {
  assert_true(result == NOR_OK || result == NOR_ERR_NO_POWER); /* the store breaks no rule of the flash */
  return result == NOR_OK ? IMUCAL_OK : IMUCAL_ERR_FLASH;
}

static imucal_status flash_erase(void* ctx, uint32_t slot) {
  return flash_status(nor_erase(&((bench_t*)ctx)->nor, slot * BENCH_SLOT_BYTES, BENCH_SLOT_BYTES));
}

static imucal_status flash_program(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len) {
  return flash_status(nor_program(&((bench_t*)ctx)->nor, slot * BENCH_SLOT_BYTES + offset, data, len));
}

static imucal_status flash_read(void* ctx, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t len) {
  return flash_status(nor_read(&((bench_t*)ctx)->nor, slot * BENCH_SLOT_BYTES + offset, data, len));
}

static uint64_t time_us(void* ctx) {
  return ((bench_t*)ctx)->time_us += 100;
}

static void watchdog(void* ctx) {
  ((bench_t*)ctx)->n_watchdog++;
}

static void reboot(void* ctx) {
  ((bench_t*)ctx)->n_reboots++;
}

/* ---- the bench ---- */

static void fill_board(imucal_board_t* board) {
  static const char* const names[] = {"gx_dph", "gy_dph", "gz_dph"};
  memset(board, 0, sizeof *board);
  strncpy(board->serial, BENCH_SERIAL, sizeof board->serial);
  board->n_channels = 3;
  board->rate_hz = 100;
  board->degc_per_count = 0.01f;
  board->degc_at_zero = 25.0f;
  for (int i = 0; i < 3; i++) {
    strncpy(board->channel[i].name, names[i], sizeof board->channel[i].name);
    board->channel[i].unit_per_count = 1.0f;
    board->channel[i].full_scale_counts = 1000000;
  }
}

static void power_on(bench_t* bench) {
  nor_power_on(&bench->nor);
  bench->nor.cut_operation = NOR_NEVER;
  bench->to_at = bench->to_end = 0;
  bench->line_room = UINT32_MAX;
  bench->n_second = bench->n_innovation = bench->n_progress = bench->n_event = 0;
  bench->n_counter_jumps = 0;
  imucal_link_rx_init(&bench->host_rx);
  bench->port.boot_id++;
  bench->token = 0;
  assert_int_equal(imucal_app_init(&bench->app, &bench->port, &bench->board), IMUCAL_OK);
  bench_run(bench);
}

void bench_start(bench_t* bench) {
  memset(bench, 0, sizeof *bench);
  memset(bench->flash, 0xFF, sizeof bench->flash);
  fill_board(&bench->board);
  bench->step_us = 10000;
  bench->nor = (nor_t){.ctx = bench,
                       .load = nor_load,
                       .save = nor_save,
                       .size_bytes = sizeof bench->flash,
                       .page_bytes = BENCH_SLOT_BYTES,
                       .word_bytes = 4};
  bench->port =
      (imucal_port_t){.ctx = bench,
                      .serial_read = serial_read,
                      .serial_write = serial_write,
                      .sample_read = sample_read,
                      .sample_enable = sample_enable,
                      .sample_out = sample_out,
                      .flash = {flash_erase, flash_program, flash_read, bench, BENCH_SLOT_BYTES, BENCH_SLOT_BYTES, 4},
                      .time_us = time_us,
                      .watchdog = watchdog,
                      .reboot = reboot,
                      .is_replay = true,
                      .device = "bench"};
  power_on(bench);
}

void bench_power_cycle(bench_t* bench) {
  memset(&bench->app, 0xA5, sizeof bench->app);
  power_on(bench);
}

void bench_run(bench_t* bench) {
  for (uint32_t i = 0; i < 1000000; i++)
    if (!imucal_app_step(&bench->app)) return;
  fail_msg("the device never comes to rest");
}

void bench_send(bench_t* bench, const uint8_t* bytes, size_t n) {
  assert_true(n <= sizeof bench->to_device);
  memcpy(bench->to_device, bytes, n);
  bench->to_at = 0;
  bench->to_end = n;
  bench_run(bench);
  assert_true(bench->to_at == n || bench->line_room == 0);
}

static uint8_t ask_bare(bench_t* bench, uint32_t id, const void* message) {
  uint8_t frame[IMUCAL_LINK_MAX_FRAME];
  size_t n = 0;
  bench->has_reply = false;
  assert_int_equal(imucal_link_pack(id, ++bench->sequence, message, frame, sizeof frame, &n), IMUCAL_OK);
  bench_send(bench, frame, n);
  assert_true(bench->has_reply);
  return bench->reply_id;
}

void bench_unlock(bench_t* bench) {
  const imucal_link_state_t nothing = {0};
  assert_int_equal(ask_bare(bench, IMUCAL_LINK_ID_STATE, &nothing), IMUCAL_LINK_ID_STATE_REPLY);
  imucal_link_unlock_t unlock = {.challenge = bench->reply.state_reply.challenge, .seconds = IMUCAL_LINK_MAX_UNLOCK_S};
  memcpy(unlock.serial, bench->board.serial, sizeof unlock.serial);
  assert_int_equal(ask_bare(bench, IMUCAL_LINK_ID_UNLOCK, &unlock), IMUCAL_LINK_ID_UNLOCK_REPLY);
  bench->token = bench->reply.unlock_reply.token;
  bench->number = 0;
}

imucal_link_command_t bench_command(bench_t* bench, uint32_t id, const void* message) {
  imucal_link_command_t command = {.token = bench->token, .number = ++bench->number, .request = (uint8_t)id};
  size_t n = 0;
  assert_int_equal(imucal_link_encode(id, message, command.payload, sizeof command.payload, &n), IMUCAL_OK);
  command.length = (uint8_t)n;
  return command;
}

uint8_t bench_ask(bench_t* bench, uint32_t id, const void* message) {
  if (!imucal_link_is_guarded(id)) return ask_bare(bench, id, message);
  if (!bench->token) bench_unlock(bench);
  const imucal_link_command_t command = bench_command(bench, id, message);
  return ask_bare(bench, IMUCAL_LINK_ID_COMMAND, &command);
}

int bench_done(bench_t* bench, uint32_t id, const void* message) {
  assert_int_equal(bench_ask(bench, id, message), IMUCAL_LINK_ID_DONE);
  assert_int_equal(bench->reply.done.request, id);
  return bench->reply.done.status;
}

int bench_stream(bench_t* bench, uint8_t what) {
  const imucal_link_stream_t request = {.what = what, .channels = 7, .period_s = 10};
  return bench_done(bench, IMUCAL_LINK_ID_STREAM, &request);
}

int bench_cal_start(bench_t* bench, uint8_t channel, uint8_t order) {
  const imucal_link_cal_start_t request = reference_cal_start(channel, order);
  return bench_done(bench, IMUCAL_LINK_ID_CAL_START, &request);
}

int bench_upload(bench_t* bench, const uint8_t* bytes, size_t n) {
  const imucal_link_table_begin_t begin = {.total = (uint16_t)n, .crc = imucal_crc32(bytes, n)};
  int status = bench_done(bench, IMUCAL_LINK_ID_TABLE_BEGIN, &begin);
  for (size_t at = 0; status == IMUCAL_OK && at < n; at += IMUCAL_LINK_MAX_DATA) {
    imucal_link_table_data_t data = {.offset = (uint16_t)at};
    data.length = (uint8_t)(n - at < IMUCAL_LINK_MAX_DATA ? n - at : IMUCAL_LINK_MAX_DATA);
    memcpy(data.data, bytes + at, data.length);
    status = bench_done(bench, IMUCAL_LINK_ID_TABLE_DATA, &data);
  }
  const imucal_link_table_commit_t commit = {0};
  return status == IMUCAL_OK ? bench_done(bench, IMUCAL_LINK_ID_TABLE_COMMIT, &commit) : status;
}

size_t bench_table(const bench_t* bench, float b0, uint8_t* bytes) {
  imucal_table_t table;
  memset(&table, 0, sizeof table);
  memcpy(table.serial, bench->board.serial, sizeof table.serial);
  table.sequence = 1;
  table.n_channels = bench->board.n_channels;
  table.degc_per_count = bench->board.degc_per_count;
  table.degc_at_zero = bench->board.degc_at_zero;
  for (int i = 0; i < table.n_channels; i++) {
    imucal_table_channel_t* channel = &table.channel[i];
    memcpy(channel->name, bench->board.channel[i].name, sizeof channel->name);
    channel->order = 1;
    channel->t0_degc = channel->range_degc = 30.0f;
    channel->coeff[0] = b0;
    channel->span_hi_degc = 60.0f;
    for (int k = 0; k < IMUCAL_TABLE_SIGMA_N; k++) channel->sigma[k] = 5.0f;
    channel->arw = 0.6f;
    channel->unit_per_count = bench->board.channel[i].unit_per_count;
    channel->full_scale_counts = bench->board.channel[i].full_scale_counts;
    channel->n_seconds = 100;
  }
  size_t n = 0;
  assert_int_equal(imucal_table_encode(&table, bytes, IMUCAL_TABLE_MAX_BYTES, &n), IMUCAL_OK);
  return n;
}

float bench_ruling_b0(bench_t* bench) {
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  size_t total = 1;
  for (size_t at = 0; at < total; at += bench->reply.table_read_reply.length) {
    const imucal_link_table_read_t request = {.slot = IMUCAL_LINK_SLOT_RULING, .offset = (uint16_t)at, .length = 97};
    assert_int_equal(bench_ask(bench, IMUCAL_LINK_ID_TABLE_READ, &request), IMUCAL_LINK_ID_TABLE_READ_REPLY);
    const imucal_link_table_read_reply_t* part = &bench->reply.table_read_reply;
    assert_int_equal(part->offset, at);
    memcpy(bytes + at, part->data, part->length);
    total = part->total;
  }
  imucal_table_t table;
  assert_int_equal(imucal_table_decode(bytes, total, &table, NULL), IMUCAL_OK);
  return table.channel[0].coeff[0];
}

void bench_feed(bench_t* bench, uint32_t n_s) {
  bench->n_left += n_s * (1000000u / bench->step_us);
  bench_run(bench);
}

uint32_t bench_events(const bench_t* bench, uint8_t code) {
  uint32_t n = 0;
  for (uint32_t i = 0; i < bench->n_event && i < 32; i++) n += bench->event[i].code == code;
  return n;
}
