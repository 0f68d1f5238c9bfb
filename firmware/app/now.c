// SPDX-License-Identifier: MIT
/* The app's time: the port's, made to run forward only. */
#include "app.h"
#include "parts.h"

#define WRAP_US ((uint64_t)1 << 32)

/* A step back of nearly 2^32 us is a counter of 32 bits that began anew, and as much is added; any other costs itself.  The
 * first is told, and each wrap. */
uint64_t app_now(imucal_app_t* app) {
  const uint64_t now_us = app->port->time_us(app->port->ctx) + app->time_offset_us;
  if (now_us >= app->now_us) return app->now_us = now_us;
  const uint64_t back_us = app->now_us - now_us;
  const bool is_wrap = back_us > WRAP_US / 2 && back_us <= WRAP_US;
  app->time_offset_us += is_wrap ? WRAP_US : back_us;
  app->now_us = now_us + (is_wrap ? WRAP_US : back_us);
  app->n_clock_back++;
  if (is_wrap || app->n_clock_back == 1) app_event(app, IMUCAL_EVENT_CLOCK_BACK, IMUCAL_ERR_PERIOD, app->n_clock_back);
  return app->now_us;
}
