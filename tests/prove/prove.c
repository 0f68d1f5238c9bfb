// SPDX-License-Identifier: MIT
/* What Frama-C Eva is to prove free of undefined behaviour: every function of the core, from the input ranges that its
 * header states.  One entry per room; `make prove` runs each.  Inputs are sets: any_*() is every value of its type,
 * between() every value of the range.  Floats may be NaN or infinite where the header does not exclude it.
 * What lives long (sum, track, kf, health, receiver) is taken in any state inside the bounds that stand here, and given
 * one input: that covers every history. */
#include <__fc_builtin.h>
#include <string.h>

#include "clock.h"
#include "comp.h"
#include "crc.h"
#include "health.h"
#include "kf.h"
#include "learn.h"
#include "link.h"
#include "num.h"
#include "sample.h"
#include "store.h"
#include "sum.h"
#include "table.h"
#include "track.h"

static void any(void* at, unsigned size) {
  Frama_C_make_unknown((char*)at, size);
}
static uint8_t any_u8(void) {
  return Frama_C_unsigned_char_interval(0, 255);
}
static uint32_t between(uint32_t lo, uint32_t hi) {
  return Frama_C_unsigned_int_interval(lo, hi);
}
static uint32_t any_u32(void) {
  return between(0, 0xFFFFFFFFu);
}
static int32_t any_i32(void) {
  return Frama_C_int_interval(INT32_MIN, INT32_MAX);
}
static float any_float(void) {
  return imucal_float_from_bits(any_u32());
}
static bool any_bool(void) {
  return Frama_C_nondet(0, 1) != 0;
}

/* ---- num, crc, sample ---- */

void prove_num(void) {
  float value = any_float();
  (void)imucal_is_within(value, any_float(), any_float());
  (void)imucal_sqrtf(value);
  int64_t numerator = Frama_C_long_long_interval(-(1LL << 62) + 1, (1LL << 62) - 1);
  int64_t denominator = Frama_C_long_long_interval(1, 1LL << 61);
  (void)imucal_divide_rne(numerator, denominator);
  uint8_t bytes[64];
  any(bytes, sizeof bytes);
  (void)imucal_crc32(bytes, between(0, sizeof bytes));
}

static void any_sample(imucal_sample_t* sample) {
  any(sample, sizeof *sample);
}

void prove_sample(void) {
  static imucal_sample_t sample;
  uint8_t record[IMUCAL_SAMPLE_RECORD_BYTES];
  any_sample(&sample);
  sample.n_channels = (uint8_t)between(0, IMUCAL_MAX_CHANNELS);
  imucal_sample_encode(&sample, record);
  any(record, sizeof record);
  (void)imucal_sample_decode(record, &sample);
}

/* ---- sum, track, learn, health, kf: any inputs in any order, for ever ---- */

/* |sums| <= 2^31 n_samples, n_samples <= 10^6 (stamps taken rise by a microsecond or more). */
static imucal_sum_t sum;
static imucal_second_t second;

static int64_t any_total(void) {
  return Frama_C_long_long_interval(-(1LL << 51), 1LL << 51);
}

static void any_sum(void) {
  any(&sum, sizeof sum);
  sum.run.n_channels = (uint8_t)between(1, IMUCAL_MAX_CHANNELS);
  sum.run.n_samples = between(0, IMUCAL_SUM_MAX_SAMPLES);
  sum.run.is_gap = any_bool();
  sum.run.temp_sum = any_total();
  for (int i = 0; i < IMUCAL_MAX_CHANNELS; i++) sum.run.sum[i] = any_total();
}

void prove_sum(void) {
  static imucal_sample_t sample;
  (void)!imucal_sum_init(&sum, any_u32(), any_u32());
  any_sum();
  any_sample(&sample);
  (void)!imucal_sum_add(&sum, &sample, &second);
  any_sum();
  (void)!imucal_sum_flush(&sum, &second);
  any(&second, sizeof second);
  (void)imucal_sum_noise_ratio(&sum, &second, between(0, IMUCAL_MAX_CHANNELS - 1));
}

static uint64_t any_u64(void) {
  return Frama_C_unsigned_long_long_interval(0, UINT64_MAX);
}

/* Any state that 64-bit stamps leave behind, one stamp; its arithmetic is modulo 2^64. */
void prove_clock(void) {
  imucal_clock_t clock;
  imucal_clock_init(&clock);
  any(&clock, sizeof clock);
  clock.has_last = any_bool();
  clock.has_candidate = any_bool();
  clock.has_released = any_bool();
  uint64_t t_us = 0;
  (void)imucal_clock_take(&clock, any_u64(), &t_us);
  imucal_clock_forget_doubted(&clock);
  imucal_clock_restart(&clock);
}

/* |sum| <= 2^31 n: by powers of two of n. */
void prove_mean(void) {
  for (int k = 0; k < 20; k++) {
    const int64_t largest = 1LL << (32 + k);
    const int64_t mean_q16 =
        imucal_mean_q16_rne(Frama_C_long_long_interval(-largest, largest), between(1u << k, (2u << k) - 1));
    (void)imucal_unit_from_q16(mean_q16, any_float(), any_float());
  }
}

/* |level| <= 2^30 (a mean beyond 2^46 is handed back), a rate of at most one count per second, points within a count of
 * the level. */
void prove_track(void) {
  static imucal_track_t track;
  imucal_track_init(&track);
  any(&track, sizeof track);
  track.level = Frama_C_int_interval(-(1 << 30) - 1, (1 << 30) + 1);
  track.rate_q16 = Frama_C_int_interval(-65536, 65536);
  track.edge_q16 = Frama_C_long_long_interval(-(1LL << 47), 1LL << 47);
  track.direction = (int8_t)Frama_C_int_interval(-1, 1);
  track.has_level = any_bool();
  track.is_rate_awaited = any_bool();
  track.is_sure = any_bool();
  (void)imucal_track_update(&track, Frama_C_long_long_interval(-(1LL << 47), 1LL << 47));
  imucal_track_skip(&track, any_u32());
}

static imucal_kf_config_t any_config(void) {
  return (imucal_kf_config_t){.order = any_u8(),
                              .t0_degc = any_float(),
                              .range_degc = any_float(),
                              .m = any_float(),
                              .q = any_float(),
                              .r = any_float(),
                              .markov_variance = any_float(),
                              .prior_sigma = any_float()};
}

static imucal_kf_t kf;

static void any_kf(uint8_t order) {
  any(&kf, sizeof kf);
  kf.config.order = order;
  kf.is_ready = any_bool();
}

static void prove_kf_of(uint8_t order) {
  static imucal_kf_state_t state;
  float where = 0;
  any_kf(order);
  (void)!imucal_kf_update_scaled(&kf, any_float(), any_float(), any_float());
  any_kf(order);
  (void)!imucal_kf_skip(&kf, any_u32());
  (void)!imucal_kf_new_run(&kf, any_float());
  imucal_kf_get_state(&kf, &state);
  imucal_kf_set_state(&kf, &state);
  (void)imucal_kf_coefficient(&kf, any_u32());
  (void)imucal_kf_bias(&kf, any_float());
  (void)imucal_kf_bias_sigma(&kf, any_float());
  (void)imucal_kf_worst_sigma(&kf, any_float(), any_float(), between(0, 1000), &where);
  (void)imucal_kf_mean_nis(&kf);
  (void)imucal_kf_lag1(&kf);
  (void)imucal_kf_innovation_variance(&kf);
}
void prove_kf(void) {
  prove_kf_of(1);
  prove_kf_of(2);
  prove_kf_of(3);
  prove_kf_of(4);
  prove_kf_of(5);
}

/* Every configuration, taken or refused; orders one by one, so that the loops over coefficients have their ends. */
void prove_kf_init(void) {
  for (unsigned order = 0; order <= IMUCAL_MAX_ORDER + 1; order++) {
    imucal_kf_config_t config = any_config();
    config.order = (uint8_t)order;
    (void)!imucal_kf_init(&kf, &config);
  }
  imucal_kf_config_t config = any_config();
  config.order = (uint8_t)between(IMUCAL_MAX_ORDER + 2, 255);
  (void)!imucal_kf_init(&kf, &config);
}

static imucal_health_t health;

static void any_health(void) {
  any(&health, sizeof health);
  health.config.is_ungated = any_bool();
  health.has_last = any_bool();
  health.has_temp = any_bool();
  health.has_seen = any_bool();
  health.has_opened = any_bool();
}

void prove_health(void) {
  const imucal_health_config_t config = {.r = any_float(),
                                         .markov_variance = any_float(),
                                         .lo_degc = any_float(),
                                         .hi_degc = any_float(),
                                         .is_ungated = any_bool(),
                                         .temp_step_degc = any_float()};
  static imucal_health_verdict_t verdict;
  float lo, hi;
  (void)!imucal_health_init(&health, &config);
  any_health();
  (void)imucal_health_second(&health, any_float(), any_float(), any_u32(), any_bool(), any_u32());
  (void)imucal_health_gate(&health, any_float(), any_float());
  imucal_health_new_run(&health);
  any_health();
  imucal_health_judge(&health, &verdict);
  (void)imucal_health_error_factor(&health);
  (void)imucal_health_span(&health, &lo, &hi);
  (void)imucal_health_rule_name(any_u32());
}

void prove_learn(void) {
  static imucal_learn_t learn;
  static imucal_thermometer_t thermometer;
  imucal_thermometer_init(&thermometer, any_float(), any_float());
  any_sum();
  any(&learn, sizeof learn);
  any_kf(IMUCAL_MAX_ORDER);
  learn.kf = kf;
  any_health();
  second.n_samples = 1; /* prove_mean */
  second.temp_sum = any_i32();
  second.n_skipped = any_u32();
  second.is_gap = any_bool();
  any(second.flags, sizeof second.flags);
  thermometer.is_tracked = false; /* prove_track */
  imucal_thermometer_read(&thermometer, &second);
  (void)imucal_learn_second(&learn, &thermometer, &sum, &second, between(0, IMUCAL_MAX_CHANNELS - 1), any_float());
  const imucal_learn_input_t input = {any_float(), any_float(), any_float(), any_u32(),
                                      (imucal_learn_outcome_t)between(0, IMUCAL_LEARN_N_OUTCOMES - 1)};
  (void)imucal_learn_checked(&learn, &health, &input, any_u32());
}

/* ---- table, comp, store ---- */

/* A table as its decoder lets it pass: the only ones that comp and store are given. */
static imucal_table_t table;
static uint8_t image[IMUCAL_TABLE_MAX_BYTES];

static void any_table(void) {
  any(&table, sizeof table);
  table.n_channels = (uint8_t)between(0, IMUCAL_MAX_CHANNELS);
}

void prove_table(void) {
  static imucal_table_place_t place;
  size_t len = 0;
  any(image, sizeof image);
  (void)imucal_table_decode(image, between(0, sizeof image), &table, &place);
  (void)imucal_table_decode(image, between(0, sizeof image), NULL, NULL);
  any_table();
  if (imucal_table_validate(&table, &place) != IMUCAL_OK) return;
  (void)imucal_table_encode(&table, image, between(0, sizeof image), &len);
  char name[IMUCAL_NAME_LEN];
  (void)imucal_text_set(name, sizeof name, "gx_dph");
}

void prove_comp(void) {
  static imucal_comp_t comp;
  imucal_table_t* t = &table;
  t->n_channels = 1;
  t->degc_per_count = Frama_C_float_interval(1e-12f, 1e9f);
  t->degc_at_zero = Frama_C_float_interval(-1e6f, 1e6f);
  imucal_table_channel_t* c = &t->channel[0];
  c->order = (uint8_t)between(0, IMUCAL_MAX_ORDER);
  c->scale_order = (uint8_t)between(0, IMUCAL_TABLE_SCALE_N - 1);
  c->t0_degc = Frama_C_float_interval(-1000, 1000);
  c->range_degc = Frama_C_float_interval(1e-3f, 2000);
  c->span_lo_degc = Frama_C_float_interval(-1000, 1000);
  c->span_hi_degc = Frama_C_float_interval(-1000, 1000);
  for (int i = 0; i < IMUCAL_MAX_COEFF; i++) c->coeff[i] = Frama_C_float_interval(-1e7f, 1e7f);
  for (int i = 0; i < IMUCAL_TABLE_SCALE_N; i++) c->scale_coeff[i] = Frama_C_float_interval(-0.0625f, 0.0625f);
  c->unit_per_count = Frama_C_float_interval(1e-12f, 1e9f);
  c->full_scale_counts = Frama_C_int_interval(1, INT32_MAX);
  imucal_status status = any_bool() ? imucal_comp_prepare(&comp, t, 0)
                                    : imucal_comp_pass(&comp, Frama_C_float_interval(1e-12f, 1e9f), any_i32());
  (void)status;
}

/* The run time alone, from what comp.c says that prepare makes: (a), (c) and (d) there. */
void prove_apply(void) {
  imucal_comp_t comp = {0};
  comp.order = (uint8_t)between(0, IMUCAL_MAX_ORDER);
  comp.out_frac_bits = (uint8_t)between(0, 8);
  comp.scale_shift = (uint8_t)between(34, 36);
  comp.has_scale = any_bool();
  comp.temp_lo_counts = any_i32();
  comp.temp_hi_counts = any_i32();
  comp.temp_mid_counts = any_i32();
  comp.tn_gain = Frama_C_int_interval(0, INT32_MAX);
  comp.tn_shift = (uint8_t)between(0, 30);
  comp.tn_mid_q30 = Frama_C_int_interval(-(1 << 30), (1 << 30) + 2);
  for (int i = 0; i < IMUCAL_MAX_COEFF; i++) comp.coeff[i] = Frama_C_int_interval(-(1 << 27), 1 << 27);
  for (int i = 0; i < IMUCAL_TABLE_SCALE_N; i++) comp.scale_coeff[i] = Frama_C_int_interval(-(1 << 28), 1 << 28);
  uint32_t flags = 0;
  (void)imucal_comp_apply(&comp, any_i32(), any_i32(), &flags);
}

static imucal_status flash_erase(void* ctx, uint32_t slot) {
  (void)ctx;
  //@ assert slot < 2;
  return any_bool() ? IMUCAL_OK : IMUCAL_ERR_FLASH;
}
static imucal_status flash_program(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len) {
  (void)ctx;
  (void)data;
  //@ assert slot < 2;
  //@ assert offset + len <= 1024;
  return any_bool() ? IMUCAL_OK : IMUCAL_ERR_FLASH;
}
static imucal_status flash_read(void* ctx, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t len) {
  (void)ctx;
  //@ assert slot < 2;
  //@ assert offset + len <= 1024;
  any(data, len);
  return any_bool() ? IMUCAL_OK : IMUCAL_ERR_FLASH;
}

/* Flash that reads anything at any time, and whose operations fail at will. */
static void prove_store_of(uint32_t program_bytes) {
  const imucal_flash_t flash = {flash_erase, flash_program, flash_read, NULL, 1024, 1024, program_bytes};
  static imucal_store_work_t work;
  static imucal_store_report_t report;
  const char* serial = any_bool() ? "0123456789abcde" : NULL;
  const uint32_t n_channels = between(0, IMUCAL_MAX_CHANNELS);
  (void)imucal_store_load(&flash, serial, n_channels, &work, &table, &report);
  any_table();
  (void)imucal_store_write(&flash, serial, n_channels, (uint8_t)between(0, 255), &work, &table, &report);
  (void)imucal_store_origin(&flash, &report, n_channels);
  (void)imucal_store_rollback(&flash, serial, n_channels, &work, &table, &report);
  (void)imucal_store_erase(&flash, &work, &report);
}
void prove_store(void) {
  prove_store_of(4);
}
void prove_store_units_of_32(void) {
  prove_store_of(32);
}

/* ---- link ---- */

void prove_link_receive(void) {
  static imucal_link_rx_t rx;
  static imucal_link_server_t server;
  imucal_link_rx_init(&rx);
  imucal_link_server_init(&server);
  any(&rx, sizeof rx);
  rx.len = (uint16_t)between(0, IMUCAL_LINK_MAX_RAW);
  rx.is_skipping = any_bool();
  rx.is_started = any_bool();
  (void)!imucal_link_rx_put(&rx, any_u8());
  rx.len = (uint16_t)between(6, IMUCAL_LINK_MAX_RAW); /* what a ready frame has */
  (void)!imucal_link_server_request(&server, &rx);
}

void prove_link_decode(void) {
  static uint8_t payload[IMUCAL_LINK_MAX_PAYLOAD];
  static imucal_link_any_t message;
  any(payload, sizeof payload);
  (void)imucal_link_decode(any_u8(), payload, between(0, sizeof payload), &message);
}

void prove_link_send(void) {
  static uint8_t frame[IMUCAL_LINK_MAX_FRAME];
  static imucal_link_any_t message;
  static imucal_link_server_t server;
  size_t len = 0;
  any(&message, sizeof message);
  (void)imucal_link_pack(any_u8(), any_u8(), &message, frame, between(0, sizeof frame), &len);
  imucal_link_server_init(&server);
  (void)imucal_link_server_reply(&server, any_u8(), &message);
}
