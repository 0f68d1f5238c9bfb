// SPDX-License-Identifier: MIT
/* What waits for the line: replies and streamed records. */
#include <string.h>

#include "app.h"
#include "parts.h"

/* What a callback says it took: none where that is more than it was given (an error code as a size, SIZE_MAX). */
size_t app_taken(size_t n, size_t most) {
  return n <= most ? n : 0;
}

size_t app_tx_room(const imucal_app_t* app) {
  return sizeof app->tx - (size_t)(app->tx_end - app->tx_at);
}

static void tx_compact(imucal_app_t* app) {
  if (app->tx_at == 0) return;
  memmove(app->tx, app->tx + app->tx_at, (size_t)(app->tx_end - app->tx_at));
  app->tx_end = (uint16_t)(app->tx_end - app->tx_at);
  app->tx_at = 0;
}

/* True where some bytes went out. */
bool app_flush(imucal_app_t* app) {
  if (app->tx_at == app->tx_end) return false;
  const size_t waiting = (size_t)(app->tx_end - app->tx_at);
  const size_t n = app_taken(app->port->serial_write(app->port->ctx, app->tx + app->tx_at, waiting), waiting);
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

/* A finished reply waits for room and holds further requests back; it is never dropped. */
bool app_send_reply(imucal_app_t* app) {
  if (!app->is_reply_due || app_tx_room(app) < app->server.reply_len) return false;
  tx_compact(app);
  memcpy(app->tx + app->tx_end, app->server.reply, app->server.reply_len);
  app->tx_end = (uint16_t)(app->tx_end + app->server.reply_len);
  app->is_reply_due = false;
  return true;
}
