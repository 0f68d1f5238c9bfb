// SPDX-License-Identifier: MIT
/* The ruling table: out of flash, against this board, into the compensation. */
#include <string.h>

#include "app.h"
#include "num.h"
#include "parts.h"

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
