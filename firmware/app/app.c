// SPDX-License-Identifier: MIT
/* The device's life: start, and one step: what came, samples, what goes out. */
#include "app.h"

#include <string.h>

#include "parts.h"

#define REBOOT_PATIENCE_US 500000u

enum { STREAMS_SAMPLES = IMUCAL_STREAM_SECOND | IMUCAL_STREAM_INNOVATION | IMUCAL_STREAM_PROGRESS };

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
    app->rx_end = (uint8_t)app_taken(app->port->serial_read(app->port->ctx, app->rx_bytes, most), most);
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
    if (app->port->is_replay && app_tx_room(app) < IMUCAL_APP_BURST_BYTES) break;
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
  bool is_busy = app_flush(app);
  is_busy |= app_send_reply(app);
  is_busy |= take_bytes(app);
  is_busy |= take_samples(app);
  app_watch_sensor_when_due(app);
  stop_when_silent(app);
  is_busy |= app_flush(app);
  if (app->is_reboot_due && app->reboot_us == 0) app->reboot_us = app_now(app) + REBOOT_PATIENCE_US;
  reboot_when_sent(app);
  return is_busy;
}
