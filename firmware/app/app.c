// SPDX-License-Identifier: MIT
/* The device's life: start, table, the line's two directions, one step. */
#include "app.h"

#include <string.h>

#include "num.h"
#include "parts.h"

#define REBOOT_PATIENCE_US 500000u

enum { STREAMS_SAMPLES = IMUCAL_STREAM_SECOND | IMUCAL_STREAM_INNOVATION | IMUCAL_STREAM_PROGRESS };

/* ---- sending ---- */

static size_t tx_room(const imucal_app_t* app) {
  return sizeof app->tx - (size_t)(app->tx_end - app->tx_at);
}

static void tx_compact(imucal_app_t* app) {
  if (app->tx_at == 0) return;
  memmove(app->tx, app->tx + app->tx_at, (size_t)(app->tx_end - app->tx_at));
  app->tx_end = (uint16_t)(app->tx_end - app->tx_at);
  app->tx_at = 0;
}

/* What a callback says it took: none where that is more than it was given (an error code as a size, SIZE_MAX). */
static size_t taken(size_t n, size_t most) {
  return n <= most ? n : 0;
}

/* True where some bytes went out. */
static bool tx_flush(imucal_app_t* app) {
  if (app->tx_at == app->tx_end) return false;
  const size_t waiting = (size_t)(app->tx_end - app->tx_at);
  const size_t n = taken(app->port->serial_write(app->port->ctx, app->tx + app->tx_at, waiting), waiting);
  app->tx_at = (uint16_t)(app->tx_at + n);
  if (app->tx_at == app->tx_end) app->tx_at = app->tx_end = 0;
  return n > 0;
}

static uint32_t stream_index(uint8_t what) {
  return what == IMUCAL_STREAM_SECOND       ? 0
         : what == IMUCAL_STREAM_INNOVATION ? 1
         : what == IMUCAL_STREAM_PROGRESS   ? 2
                                            : 3;
}

uint16_t app_stream_count(imucal_app_t* app, uint8_t what) {
  return app->stream_counter[stream_index(what)]++;
}

/* A record that finds no room is dropped and counted; its counter has moved on, so the host sees the loss. */
void app_stream(imucal_app_t* app, uint8_t what, uint32_t id, const void* message) {
  if (!(app->stream_what & what)) return;
  tx_compact(app);
  size_t n = 0;
  const uint8_t sequence = (uint8_t)(app->stream_counter[stream_index(what)] - 1);
  if (imucal_link_pack(id, sequence, message, app->tx + app->tx_end, sizeof app->tx - app->tx_end, &n) == IMUCAL_OK)
    app->tx_end = (uint16_t)(app->tx_end + n);
  else
    app->n_tx_dropped++;
}

void app_event(imucal_app_t* app, uint8_t code, imucal_status status, uint32_t detail) {
  if (!(app->stream_what & IMUCAL_STREAM_EVENT)) return;
  const imucal_link_event_t event = {
      .counter = app_stream_count(app, IMUCAL_STREAM_EVENT), .code = code, .status = (int16_t)status, .detail = detail};
  app_stream(app, IMUCAL_STREAM_EVENT, IMUCAL_LINK_ID_EVENT, &event);
}

/* ---- the table ---- */

/* Counts mean here what they meant where the table was made, and every channel has a fixed-point form.
 * detail: channel + 1 of the first that does not fit, 0 for the header. */
imucal_status app_check_table(imucal_app_t* app, uint32_t* detail) {
  const imucal_board_t* board = app->board;
  const imucal_table_t* table = &app->table;
  *detail = 0;
  if (!imucal_text_equal(table->serial, board->serial, IMUCAL_SERIAL_LEN)) return IMUCAL_ERR_SERIAL;
  if (table->n_channels != board->n_channels) return IMUCAL_ERR_CHANNELS;
  if (imucal_bits_from_float(table->degc_per_count) != imucal_bits_from_float(board->degc_per_count) ||
      imucal_bits_from_float(table->degc_at_zero) != imucal_bits_from_float(board->degc_at_zero))
    return IMUCAL_ERR_SCALE;
  for (uint32_t i = 0; i < table->n_channels; i++) {
    const imucal_table_channel_t* channel = &table->channel[i];
    *detail = i + 1;
    if (!imucal_text_equal(channel->name, board->channel[i].name, IMUCAL_NAME_LEN)) return IMUCAL_ERR_NAME;
    if (imucal_bits_from_float(channel->unit_per_count) != imucal_bits_from_float(board->channel[i].unit_per_count))
      return IMUCAL_ERR_SCALE;
    imucal_comp_t trial;
    const imucal_status status = imucal_comp_prepare(&trial, table, i);
    if (status != IMUCAL_OK) return status;
  }
  *detail = 0;
  return IMUCAL_OK;
}

/* With a checked table prepare cannot fail; without one every channel passes through. */
static void prepare_compensation(imucal_app_t* app) {
  for (uint32_t i = 0; i < app->board->n_channels; i++) {
    imucal_comp_t* comp = &app->channel[i].comp;
    if (app->table_status == IMUCAL_OK && imucal_comp_prepare(comp, &app->table, i) == IMUCAL_OK) continue;
    const imucal_status passed =
        imucal_comp_pass(comp, app->board->channel[i].unit_per_count, app->board->channel[i].full_scale_counts);
    if (passed != IMUCAL_OK) memset(comp, 0, sizeof *comp);
  }
}

static void tell_table(imucal_app_t* app, uint32_t detail) {
  for (uint32_t slot = 0; slot < IMUCAL_STORE_SLOTS; slot++) {
    const imucal_status status = app->report.slot_status[slot];
    if (status < 0) app_event(app, IMUCAL_EVENT_TABLE_REFUSED, status, slot);
  }
  if (app->table_status == IMUCAL_OK)
    app_event(app, IMUCAL_EVENT_TABLE_LOADED, IMUCAL_OK, app->table.sequence);
  else
    app_event(app, IMUCAL_EVENT_TABLE_NONE, app->table_status, detail);
}

/* What flash says of the ruling table's origin, so that it is the same before and after a start. */
static uint8_t table_origin(const imucal_app_t* app) {
  if (app->table_status != IMUCAL_OK) return IMUCAL_ORIGIN_NONE;
  const imucal_store_origin_t origin = imucal_store_origin(&app->port->flash, &app->report, app->table.n_channels);
  if (origin.is_restored) return IMUCAL_ORIGIN_ROLLBACK;
  const bool is_known = origin.noted == IMUCAL_ORIGIN_FILTERS || origin.noted == IMUCAL_ORIGIN_HOST;
  return is_known ? origin.noted : (uint8_t)IMUCAL_ORIGIN_UNKNOWN;
}

/* Loads what the slots hold. The compensated samples may change their unit: their running sum starts anew. */
imucal_status app_load_table(imucal_app_t* app) {
  uint32_t detail = 0;
  app->table_status = imucal_store_load(&app->port->flash, app->board->serial, app->board->n_channels, &app->work,
                                        &app->table, &app->report);
  if (app->table_status == IMUCAL_OK) app->table_status = app_check_table(app, &detail);
  app->table_origin = table_origin(app);
  prepare_compensation(app);
  tell_table(app, detail);
  const imucal_status restarted = app_restart_out_sum(app);
  if (restarted != IMUCAL_OK) return restarted;
  return app->table_status;
}

/* ---- one step ---- */

/* sample_enable, sample_out, sensor_report and device may be missing (port.h). */
static bool is_port_whole(const imucal_port_t* port) {
  const imucal_flash_t* flash = &port->flash;
  return port->serial_read != NULL && port->serial_write != NULL && port->sample_read != NULL && flash->erase != NULL &&
         flash->program != NULL && flash->read != NULL && port->time_us != NULL && port->watchdog != NULL &&
         port->reboot != NULL;
}

imucal_status imucal_app_init(imucal_app_t* app, const imucal_port_t* port, const imucal_board_t* board) {
  if (app == NULL || port == NULL || board == NULL || !is_port_whole(port)) return IMUCAL_ERR_ARGUMENT;
  memset(app, 0, sizeof *app);
  imucal_status status = imucal_board_check(board);
  if (status == IMUCAL_OK) status = imucal_store_check(&port->flash);
  if (status != IMUCAL_OK) return status;
  app->port = port;
  app->board = board;
  app->stream_what = IMUCAL_STREAM_EVENT;
  app->progress_period_s = 1;
  imucal_link_rx_init(&app->rx);
  imucal_link_server_init(&app->server);
  app->heard_us = app_now(app);
  app_guard_init(&app->guard, port->boot_id, app->heard_us);
  app_event(app, IMUCAL_EVENT_BOOT, IMUCAL_OK, port->boot_id);
  if (port->is_watchdog_reset) app_event(app, IMUCAL_EVENT_WATCHDOG, IMUCAL_OK, port->n_watchdog_resets);
  (void)app_load_table(app); /* without a table the device runs on, uncompensated, and has said so */
  return app_restart_sums(app);
}

/* A finished reply waits for room and holds further requests back; it is never dropped. */
static bool send_reply(imucal_app_t* app) {
  if (!app->is_reply_due || tx_room(app) < app->server.reply_len) return false;
  tx_compact(app);
  memcpy(app->tx + app->tx_end, app->server.reply, app->server.reply_len);
  app->tx_end = (uint16_t)(app->tx_end + app->server.reply_len);
  app->is_reply_due = false;
  return true;
}

static void take_request(imucal_app_t* app) {
  const uint8_t type = imucal_link_rx_type(&app->rx);
  if (type == 0 || type >= 0x40) { /* not a request: an echo of ourselves, or noise with a good CRC */
    app->n_rx_unknown++;
    return;
  }
  app->heard_us = app_now(app);
  if (imucal_link_server_request(&app->server, &app->rx) != IMUCAL_FRAME_REPEATED) app_serve(app);
  app->is_reply_due = app->server.reply_len > 0;
}

static bool take_bytes(imucal_app_t* app) {
  if (app->rx_at == app->rx_end) {
    app->rx_at = 0;
    const size_t most = sizeof app->rx_bytes;
    app->rx_end = (uint8_t)taken(app->port->serial_read(app->port->ctx, app->rx_bytes, most), most);
  }
  const bool is_busy = app->rx_at < app->rx_end;
  while (app->rx_at < app->rx_end && !app->is_reply_due)
    if (imucal_link_rx_put(&app->rx, app->rx_bytes[app->rx_at++]) == IMUCAL_FRAME_READY) take_request(app);
  return is_busy;
}

/* A replay waits for the host; a real sensor does not. */
static bool is_wanting_samples(const imucal_app_t* app) {
  return !app->port->is_replay || (app->stream_what & STREAMS_SAMPLES);
}

static void enable_samples(imucal_app_t* app, bool is_wanted) {
  if (is_wanted == app->is_enabled) return;
  app->is_enabled = is_wanted;
  if (app->port->sample_enable) app->port->sample_enable(app->port->ctx, is_wanted);
}

static bool take_samples(imucal_app_t* app) {
  enable_samples(app, is_wanting_samples(app) && !app->has_sensor_ended);
  if (!app->is_enabled) return false;
  bool is_busy = false;
  for (uint32_t i = 0; i < IMUCAL_APP_SAMPLES_PER_STEP; i++) {
    if (app->port->is_replay && tx_room(app) < IMUCAL_APP_BURST_BYTES) break;
    imucal_sample_t sample;
    const imucal_port_sample_t result = app->port->sample_read(app->port->ctx, &sample);
    if (result == IMUCAL_PORT_NO_SAMPLE) break;
    is_busy = true;
    if (result == IMUCAL_PORT_SAMPLE) app_take_sample(app, &sample);
    if (result == IMUCAL_PORT_BAD_SAMPLE) app->n_bad_samples++;
    if (result >= IMUCAL_PORT_ENDED) {
      app_end_of_samples(app, result == IMUCAL_PORT_ENDED ? IMUCAL_OK : IMUCAL_ERR_SENSOR);
      break;
    }
  }
  return is_busy;
}

/* A host that died does not leave the device calibrating, and refusing, for ever. */
static void stop_when_silent(imucal_app_t* app) {
  if (app->session != IMUCAL_SESSION_CALIBRATING) return;
  const uint64_t silence_us = app_now(app) - app->heard_us;
  if (silence_us < (uint64_t)IMUCAL_APP_SILENCE_S * 1000000u) return;
  app->session = IMUCAL_SESSION_KEPT;
  app->stream_what = IMUCAL_STREAM_EVENT;
  app->n_silent++;
  app_event(app, IMUCAL_EVENT_HOST_SILENT, IMUCAL_OK, IMUCAL_APP_SILENCE_S);
}

static void reboot_when_sent(imucal_app_t* app) {
  const bool is_sent = app->tx_at == app->tx_end && !app->is_reply_due;
  if (!app->is_reboot_due || (!is_sent && app_now(app) < app->reboot_us)) return;
  app->is_reboot_due = false;
  app->port->reboot(app->port->ctx);
}

bool imucal_app_step(imucal_app_t* app) {
  app->port->watchdog(app->port->ctx);
  bool is_busy = tx_flush(app);
  is_busy |= send_reply(app);
  is_busy |= take_bytes(app);
  is_busy |= take_samples(app);
  app_watch_sensor_when_due(app);
  stop_when_silent(app);
  is_busy |= tx_flush(app);
  if (app->is_reboot_due && app->reboot_us == 0) app->reboot_us = app_now(app) + REBOOT_PATIENCE_US;
  reboot_when_sent(app);
  return is_busy;
}
