// SPDX-License-Identifier: MIT
/* The core as its headers promise it, for the proof of the firmware's app: each function sets what it may set to any value of the
 * stated range and returns any status it may return.  The core's own bodies are proved to keep this by prove.c; here they
 * would bury the app under a million states.  What the app must keep towards the core stands as an assertion. */
#include <__fc_builtin.h>
#include <stdbool.h>
#include <stdint.h>

#include "clock.h"
#include "comp.h"
#include "crc.h"
#include "health.h"
#include "kf.h"
#include "learn.h"
#include "link.h"
#include "store.h"
#include "sum.h"
#include "table.h"

static void any(void* at, unsigned size) {
  Frama_C_make_unknown((char*)at, size);
}
static uint32_t between(uint32_t lo, uint32_t hi) {
  return Frama_C_unsigned_int_interval(lo, hi);
}
static bool any_bool(void) {
  return Frama_C_nondet(0, 1) != 0;
}
static int32_t any_i32(void) {
  return Frama_C_int_interval(INT32_MIN, INT32_MAX);
}
static float any_float(void) {
  float value;
  any(&value, sizeof value);
  return value;
}
static imucal_status any_refusal(void) {
  return (imucal_status)Frama_C_int_interval(-100, -1);
}
static imucal_status ok_or_refusal(void) {
  return any_bool() ? IMUCAL_OK : any_refusal();
}

/* ---- num, crc, kf ---- */

uint32_t imucal_crc32(const uint8_t* data, size_t len) {
  //@ assert len == 0 || \valid_read(data + (0 .. len - 1));
  (void)data, (void)len;
  return between(0, 0xFFFFFFFFu);
}
float imucal_kf_coefficient(const imucal_kf_t* kf, uint32_t i) {
  (void)kf, (void)i;
  return any_float();
}
float imucal_kf_worst_sigma(const imucal_kf_t* kf, float lo, float hi, uint32_t n_grid, float* worst_temp_degc) {
  (void)kf, (void)lo, (void)hi, (void)n_grid;
  if (worst_temp_degc) *worst_temp_degc = any_float();
  return any_float();
}
void imucal_kf_get_state(const imucal_kf_t* kf, imucal_kf_state_t* state) {
  (void)kf;
  any(state, sizeof *state);
}
float imucal_kf_sum(const imucal_kf_t* kf, imucal_kf_sum_t which) {
  (void)kf, (void)which;
  return any_float();
}
float imucal_kf_innovation_variance(const imucal_kf_t* kf) {
  (void)kf;
  return any_float();
}
float imucal_kf_mean_nis(const imucal_kf_t* kf) {
  (void)kf;
  return any_float();
}
float imucal_kf_lag1(const imucal_kf_t* kf) {
  (void)kf;
  return any_float();
}

/* ---- clock, sum, learn, health ---- */

void imucal_clock_restart(imucal_clock_t* clock) {
  clock->has_last = clock->has_candidate = clock->has_released = false;
}
void imucal_clock_forget_doubted(imucal_clock_t* clock) {
  clock->has_released = false;
}
bool imucal_clock_take(imucal_clock_t* clock, uint64_t stamp_us, uint64_t* t_us) {
  (void)stamp_us;
  clock->has_released = any_bool();
  clock->released_us = Frama_C_unsigned_long_long_interval(0, UINT64_MAX);
  const bool is_good = any_bool();
  //@ split is_good;
  if (!is_good) return false;
  *t_us = Frama_C_unsigned_long_long_interval(0, UINT64_MAX);
  return true;
}
imucal_status imucal_sum_init(imucal_sum_t* sum, uint32_t n_channels, uint32_t rate_hz) {
  //@ assert 1 <= n_channels <= IMUCAL_MAX_CHANNELS;
  //@ assert 1 <= rate_hz <= IMUCAL_SUM_MAX_RATE_HZ;
  (void)n_channels, (void)rate_hz;
  any(sum, sizeof *sum);
  return IMUCAL_OK;
}
static void any_second(imucal_second_t* second) {
  any(second, sizeof *second);
  second->n_samples = between(1, IMUCAL_SUM_MAX_SAMPLES);
  second->n_channels = (uint8_t)between(1, IMUCAL_MAX_CHANNELS);
  second->is_gap = any_bool();
}
/* Whether raw and compensated sum end their second: one case at a time, for *second is set in one of them only. */
bool prove_ends_second[2];
static uint32_t n_sum_calls; /* raw, compensated, raw, ... */

imucal_status imucal_sum_add(imucal_sum_t* sum, const imucal_sample_t* sample, imucal_second_t* second) {
  (void)sum, (void)sample;
  if (!prove_ends_second[n_sum_calls++ & 1u]) return ok_or_refusal();
  any_second(second);
  return IMUCAL_SECOND_READY;
}
imucal_status imucal_sum_flush(imucal_sum_t* sum, imucal_second_t* second) {
  (void)sum;
  if (!prove_ends_second[n_sum_calls++ & 1u]) return IMUCAL_OK;
  any_second(second);
  return IMUCAL_SECOND_READY;
}
int64_t imucal_mean_q16_rne(int64_t sum, uint32_t n) {
  //@ assert n >= 1;
  (void)sum, (void)n;
  return Frama_C_long_long_interval(-(1LL << 48), 1LL << 48);
}
float imucal_unit_from_q16(int64_t mean_q16, float scale, float offset) {
  (void)mean_q16, (void)scale, (void)offset;
  return any_float();
}
void imucal_thermometer_init(imucal_thermometer_t* thermometer, float degc_per_count, float degc_at_zero) {
  (void)degc_per_count, (void)degc_at_zero;
  any(thermometer, sizeof *thermometer);
}
void imucal_thermometer_read(imucal_thermometer_t* thermometer, const imucal_second_t* second) {
  (void)second;
  any(thermometer, sizeof *thermometer);
}
imucal_status imucal_learn_init(imucal_learn_t* learn, const imucal_kf_config_t* config) {
  (void)config;
  if (any_bool()) return any_refusal();
  any(learn, sizeof *learn);
  return IMUCAL_OK;
}
imucal_learn_input_t imucal_learn_input_of(const imucal_thermometer_t* thermometer, const imucal_sum_t* sum,
                                           const imucal_second_t* second, uint32_t i_channel, float value) {
  //@ assert i_channel < second->n_channels;
  (void)thermometer, (void)sum, (void)second, (void)i_channel, (void)value;
  const imucal_learn_input_t input = {any_float(), any_float(), any_float(), between(0, 0xFFFFFFFFu),
                                      (imucal_learn_outcome_t)between(0, IMUCAL_LEARN_N_OUTCOMES - 1)};
  return input;
}
imucal_learn_outcome_t imucal_learn_checked(imucal_learn_t* learn, imucal_health_t* health,
                                            const imucal_learn_input_t* input, uint32_t flags) {
  (void)health, (void)input, (void)flags;
  any(&learn->kf.stats, sizeof learn->kf.stats);
  return (imucal_learn_outcome_t)between(0, IMUCAL_LEARN_N_OUTCOMES - 1);
}
imucal_status imucal_health_init(imucal_health_t* health, const imucal_health_config_t* config) {
  (void)config;
  if (any_bool()) return any_refusal();
  any(health, sizeof *health);
  return IMUCAL_OK;
}
void imucal_health_judge(const imucal_health_t* health, imucal_health_verdict_t* verdict) {
  (void)health;
  any(verdict, sizeof *verdict);
}
float imucal_health_error_factor(const imucal_health_t* health) {
  (void)health;
  return any_float();
}
bool imucal_health_span(const imucal_health_t* health, float* lo_degc, float* hi_degc) {
  (void)health;
  *lo_degc = any_float(), *hi_degc = any_float();
  return any_bool();
}

/* ---- table, comp, store ---- */

static void any_table(imucal_table_t* table) {
  any(table, sizeof *table);
  table->n_channels = (uint8_t)between(1, IMUCAL_MAX_CHANNELS);
}
bool imucal_text_equal(const char* a, const char* b, size_t size) {
  //@ assert \valid_read(a + (0 .. size - 1)) && \valid_read(b + (0 .. size - 1));
  (void)a, (void)b, (void)size;
  return any_bool();
}
size_t imucal_name_stem(const char* name) {
  (void)name;
  return between(0, IMUCAL_NAME_LEN - 3);
}
bool imucal_text_is_valid(const char* text, size_t size) {
  //@ assert \valid_read(text + (0 .. size - 1));
  (void)text, (void)size;
  return any_bool();
}
imucal_status imucal_table_peek(const uint8_t* bytes, size_t have_bytes, size_t* len_bytes) {
  //@ assert \valid_read(bytes + (0 .. have_bytes - 1));
  (void)bytes, (void)have_bytes;
  const bool is_good = any_bool();
  //@ split is_good;
  if (!is_good) return any_refusal();
  *len_bytes = between(IMUCAL_TABLE_BYTES(1), IMUCAL_TABLE_MAX_BYTES);
  return IMUCAL_OK;
}
imucal_status imucal_table_decode(const uint8_t* bytes, size_t have_bytes, imucal_table_t* table,
                                  imucal_table_place_t* place) {
  //@ assert \valid_read(bytes + (0 .. have_bytes - 1));
  (void)bytes, (void)have_bytes;
  place->channel = Frama_C_int_interval(-1, IMUCAL_MAX_CHANNELS - 1);
  if (any_bool()) return any_refusal();
  any_table(table);
  return IMUCAL_OK;
}
imucal_status imucal_table_from_kf(imucal_table_channel_t* channel, const imucal_kf_t* kf, float span_lo_degc,
                                   float span_hi_degc) {
  (void)kf, (void)span_lo_degc, (void)span_hi_degc;
  any(channel, sizeof *channel);
  return ok_or_refusal();
}
imucal_status imucal_comp_prepare(imucal_comp_t* comp, const imucal_table_t* table, uint32_t i_channel) {
  //@ assert i_channel < table->n_channels;
  (void)table, (void)i_channel;
  any(comp, sizeof *comp);
  return ok_or_refusal();
}
imucal_status imucal_table_validate_channel(const imucal_table_channel_t* channel, float degc_per_count,
                                            float degc_at_zero) {
  (void)channel, (void)degc_per_count, (void)degc_at_zero;
  return ok_or_refusal();
}
imucal_status imucal_comp_prepare_channel(imucal_comp_t* comp, const imucal_table_channel_t* channel,
                                          float degc_per_count, float degc_at_zero) {
  (void)channel, (void)degc_per_count, (void)degc_at_zero;
  any(comp, sizeof *comp);
  return ok_or_refusal();
}
imucal_status imucal_comp_pass(imucal_comp_t* comp, float unit_per_count, int32_t full_scale_counts) {
  (void)unit_per_count, (void)full_scale_counts;
  any(comp, sizeof *comp);
  return ok_or_refusal();
}
int32_t imucal_comp_apply(const imucal_comp_t* comp, int32_t temp_counts, int32_t counts, uint32_t* flags) {
  (void)comp, (void)temp_counts, (void)counts;
  *flags |= between(0, IMUCAL_COMP_TEMP_CLAMPED | IMUCAL_COMP_SATURATED);
  return any_i32();
}
static imucal_status any_report(imucal_table_t* table, imucal_store_report_t* report) {
  any(report, sizeof *report);
  report->slot_status[0] = ok_or_refusal();
  report->slot_status[1] = ok_or_refusal();
  report->ruling = (int8_t)Frama_C_int_interval(-1, 1);
  if (any_bool()) return any_refusal();
  report->ruling = (int8_t)between(0, 1);
  any_table(table);
  return IMUCAL_OK;
}
imucal_status imucal_store_check(const imucal_flash_t* flash) {
  (void)flash;
  return ok_or_refusal();
}
imucal_status imucal_store_load(const imucal_flash_t* flash, const char* serial, uint32_t n_channels,
                                imucal_store_work_t* work, imucal_table_t* table, imucal_store_report_t* report) {
  (void)flash, (void)serial, (void)n_channels;
  any(work, sizeof *work);
  return any_report(table, report);
}
imucal_status imucal_store_write(const imucal_flash_t* flash, const char* serial, uint32_t n_channels, uint8_t origin,
                                 imucal_store_work_t* work, imucal_table_t* table, imucal_store_report_t* report) {
  (void)flash, (void)serial, (void)n_channels, (void)origin;
  any(work, sizeof *work);
  return any_report(table, report);
}
imucal_status imucal_store_rollback(const imucal_flash_t* flash, const char* serial, uint32_t n_channels,
                                    imucal_store_work_t* work, imucal_table_t* table, imucal_store_report_t* report) {
  (void)flash, (void)serial, (void)n_channels;
  any(work, sizeof *work);
  return any_report(table, report);
}
imucal_status imucal_store_erase(const imucal_flash_t* flash, imucal_store_work_t* work,
                                 imucal_store_report_t* report) {
  (void)flash;
  any(work, sizeof *work);
  any(report, sizeof *report);
  report->ruling = (int8_t)Frama_C_int_interval(-1, 1);
  return ok_or_refusal();
}
imucal_store_origin_t imucal_store_origin(const imucal_flash_t* flash, const imucal_store_report_t* report,
                                          uint32_t n_channels) {
  //@ assert -1 <= report->ruling <= 1;
  (void)flash, (void)report, (void)n_channels;
  const imucal_store_origin_t origin = {(uint8_t)between(0, 255), any_bool()};
  return origin;
}

/* ---- link ---- */

/* Counts in front of arrays are at most what their arrays hold: prove_link_decode. */
uint8_t prove_channel; /* that a request names: one at a time, as prove_inside */
uint8_t prove_inside; /* the request in a COMMAND: one at a time, so that what holds for it is not joined with others */

static imucal_status any_message(uint32_t id, imucal_link_any_t* message) {
  any(message, sizeof *message); /* zeros in front of a refusal */
  const bool is_good = any_bool();
  //@ split is_good;
  if (!is_good) return any_refusal();
  if (id == IMUCAL_LINK_ID_COMMAND) message->command.request = prove_inside;
  if (id == IMUCAL_LINK_ID_COMMAND) message->command.length = (uint8_t)between(0, sizeof message->command.payload);
  if (id == IMUCAL_LINK_ID_CAL_START) message->cal_start.channel = prove_channel;
  if (id == IMUCAL_LINK_ID_CAL_STATE) message->cal_state.channel = prove_channel;
  if (id == IMUCAL_LINK_ID_CAL_FILTER) message->cal_filter.channel = prove_channel;
  if (id == IMUCAL_LINK_ID_HEALTH) message->health.channel = prove_channel;
  if (id == IMUCAL_LINK_ID_CAL_START) message->cal_start.n_markov = (uint8_t)between(0, IMUCAL_TABLE_MARKOV_N);
  if (id == IMUCAL_LINK_ID_TABLE_DATA)
    message->table_data.length = (uint8_t)between(0, sizeof message->table_data.data);
  return IMUCAL_OK;
}
imucal_status imucal_link_decode(uint32_t id, const uint8_t* payload, size_t payload_len, imucal_link_any_t* message) {
  //@ assert payload_len == 0 || \valid_read(payload + (0 .. payload_len - 1));
  (void)payload, (void)payload_len;
  return any_message(id, message);
}
imucal_status imucal_link_rx_message(imucal_link_rx_t* rx, imucal_link_any_t* message) {
  return any_message(imucal_link_rx_type(rx), message);
}
void imucal_link_rx_init(imucal_link_rx_t* rx) {
  any(rx, sizeof *rx);
  rx->len = 0;
}
imucal_status imucal_link_rx_put(imucal_link_rx_t* rx, uint8_t byte) {
  (void)byte;
  any(rx, sizeof *rx);
  rx->len = (uint16_t)between(0, IMUCAL_LINK_MAX_RAW);
  if (any_bool()) return ok_or_refusal();
  rx->len = (uint16_t)between(6, IMUCAL_LINK_MAX_RAW);
  return IMUCAL_FRAME_READY;
}
void imucal_link_server_init(imucal_link_server_t* server) {
  server->reply_len = 0;
}
imucal_status imucal_link_server_request(imucal_link_server_t* server, const imucal_link_rx_t* rx) {
  //@ assert rx->len >= 6;
  (void)rx;
  if (any_bool()) return IMUCAL_FRAME_REPEATED;
  server->reply_len = 0;
  return IMUCAL_OK;
}
imucal_status imucal_link_server_reply(imucal_link_server_t* server, uint32_t id, const void* message) {
  (void)id, (void)message;
  any(server->reply, sizeof server->reply);
  server->reply_len = (uint16_t)between(1, sizeof server->reply);
  return ok_or_refusal();
}
imucal_status imucal_link_pack(uint32_t id, uint8_t sequence, const void* message, uint8_t* out, size_t max_out,
                               size_t* out_len) {
  (void)id, (void)sequence, (void)message;
  if (max_out < 10) return IMUCAL_ERR_SPACE;
  //@ assert \valid(out + (0 .. max_out - 1));
  *out_len = between(10, max_out);
  return IMUCAL_OK;
}
