// SPDX-License-Identifier: MIT
/* What the sensor's driver and the supply have counted: the report, and an event when a count begins to grow. */
#include "app.h"
#include "parts.h"

#define WATCH_US 1000000u

imucal_link_sensor_reply_t app_sensor_report(const imucal_app_t* app) {
  imucal_link_sensor_reply_t report = {0};
  if (app->port->sensor_report) app->port->sensor_report(app->port->ctx, &report);
  return report;
}

/* IMUCAL_SENSOR_*: counts that are not as they were. */
static uint32_t take_counts(imucal_app_t* app, const imucal_link_sensor_reply_t* report) {
  const uint32_t now[IMUCAL_SENSOR_N_COUNTS] = {report->wrong_identity, report->bus_errors, report->overruns,
                                                report->lost,           report->invalid,    report->resets,
                                                report->stuck_temp,     report->stuck_data, report->supply_refused};
  uint32_t bits = report->is_supply_low ? IMUCAL_SENSOR_SUPPLY : 0u;
  for (uint32_t i = 0; i < IMUCAL_SENSOR_N_COUNTS; i++) {
    if (now[i] != app->seen[i]) bits |= 1u << i;
    app->seen[i] = now[i];
  }
  return bits;
}

/* One event where a trouble begins, not one for each second that it lasts. */
void app_watch_sensor(imucal_app_t* app) {
  const imucal_link_sensor_reply_t report = app_sensor_report(app);
  const uint32_t growing = take_counts(app, &report);
  if (growing & ~app->growing)
    app_event(app, IMUCAL_EVENT_SENSOR_COUNTED, (imucal_status)report.status, growing & ~app->growing);
  app->growing = growing;
  app->watch_us = app_now(app) + WATCH_US;
}

/* A sensor that is silent finishes no seconds. */
void app_watch_sensor_when_due(imucal_app_t* app) {
  if (app_now(app) >= app->watch_us) app_watch_sensor(app);
}
