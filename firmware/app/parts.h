// SPDX-License-Identifier: MIT
/* What the parts of the app use of each other; not for ports. */
#ifndef IMUCAL_APP_PARTS_H
#define IMUCAL_APP_PARTS_H
#include "app.h"

#if defined(__cplusplus)
extern "C" {
#endif

/* Grid over the valid span for the worst predicted error: 25 temperatures, every 2.5 degC of a 60-degC span.
 */
#define IMUCAL_APP_GRID 25u

/* In the order of the files: each calls those above it here, none below (tests/system/test_layout.py).  app.c calls all. */

/* stream.c */
size_t app_taken(size_t n, size_t most);
size_t app_tx_room(const imucal_app_t* app);
bool app_flush(imucal_app_t* app);
bool app_send_reply(imucal_app_t* app);
void app_stream(imucal_app_t* app, uint8_t what, uint32_t id, const void* message);
uint16_t app_stream_count(imucal_app_t* app, uint8_t what);
void app_event(imucal_app_t* app, uint8_t code, imucal_status status, uint32_t detail);

/* now.c */
uint64_t app_now(imucal_app_t* app);

/* watch.c */
imucal_link_sensor_reply_t app_sensor_report(const imucal_app_t* app);
void app_watch_sensor(imucal_app_t* app);
void app_watch_sensor_when_due(imucal_app_t* app);

/* seconds.c */
bool app_is_compensated(const imucal_app_t* app, uint32_t i);
imucal_status app_restart_sums(imucal_app_t* app);
imucal_status app_restart_out_sum(imucal_app_t* app);
void app_take_sample(imucal_app_t* app, const imucal_sample_t* sample);
void app_end_of_samples(imucal_app_t* app, imucal_status why);
float app_worst_sigma(const imucal_app_t* app, uint32_t i, float* worst_temp_degc);

/* tables.c */
imucal_status app_load_table(imucal_app_t* app);
imucal_status app_check_table(imucal_app_t* app, uint32_t* detail);

/* requests.c */
void app_serve(imucal_app_t* app);

#if defined(__cplusplus)
}
#endif
#endif
