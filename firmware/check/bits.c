// SPDX-License-Identifier: MIT
/* The same log, the same bits: everything the core computes of it, printed as it is in memory. */
#include <string.h>

#include "check.h"
#include "comp.h"
#include "crc.h"
#include "learn.h"
#include "num.h"
#include "reference.h"
#include "sum.h"
#include "table.h"

enum { N_CHANNELS = 3, N_ORDERS = 2, RATE_HZ = 20, PRINT_EVERY_S = 97 };
#define DEGC_PER_COUNT 0.01f
#define DEGC_AT_ZERO 25.0f

/* Near 1.1 deg/sqrt(h), 14 dph, 20 s (a host would send q = 18.6518661): any filter unlike the reference, always the same. */
#define THIRD_FILTER(order)                                                                                            \
  { order, 30.0f, 30.0f, 0.0487705755f, 18.6518808f, 4356.0f, 196.0f, 1e4f }

static const uint8_t kOrder[N_ORDERS] = {3, 5};
static const float kUnitPerCount[N_CHANNELS] = {1.0f, 36.0f, 0.37f};

static imucal_learn_t filter[N_ORDERS][N_CHANNELS];
static imucal_thermometer_t thermometer;
static imucal_comp_t comp[N_ORDERS][N_CHANNELS];
static imucal_table_t table;
static imucal_sum_t sum;

static void start_filters(void) {
  for (int k = 0; k < N_ORDERS; k++)
    for (int i = 0; i < N_CHANNELS; i++) {
      const imucal_kf_config_t reference = REFERENCE_FILTER(kOrder[k]), third = THIRD_FILTER(kOrder[k]);
      const imucal_kf_config_t config = i < 2 ? reference : third;
      if (imucal_learn_init(&filter[k][i], &config) != IMUCAL_OK) filter[k][i].kf.is_ready = false;
    }
}

static void hex_floats(const check_io_t* io, const char* name, const float* values, uint32_t n) {
  check_text(io, name);
  for (uint32_t i = 0; i < n; i++) check_hex(io, imucal_bits_from_float(values[i]));
}

static void print_filter(const check_io_t* io, uint32_t t_s, int k, int i) {
  const imucal_kf_t* kf = &filter[k][i].kf;
  check_text(io, "filter");
  check_number(io, kOrder[k]);
  check_number(io, (uint32_t)i);
  check_number(io, t_s);
  imucal_kf_state_t state;
  imucal_kf_get_state(kf, &state);
  hex_floats(io, " x", state.x, IMUCAL_KF_MAX_STATES);
  hex_floats(io, " x_lo", state.x_lo, IMUCAL_KF_MAX_STATES);
  hex_floats(io, " d", state.d, IMUCAL_KF_MAX_STATES);
  hex_floats(io, " d_lo", state.d_lo, IMUCAL_KF_MAX_STATES);
  hex_floats(io, " u", state.u, IMUCAL_KF_MAX_U);
  const float derived[] = {imucal_kf_mean_nis(kf),
                           imucal_kf_lag1(kf),
                           imucal_kf_worst_sigma(kf, 0, 60, 25, NULL),
                           imucal_kf_bias(kf, 41.5f),
                           imucal_kf_bias_sigma(kf, 41.5f),
                           imucal_kf_sum(kf, IMUCAL_KF_WEIGHTED),
                           imucal_kf_sum(kf, IMUCAL_KF_INVERSE)};
  hex_floats(io, " derived", derived, sizeof derived / sizeof *derived);
  for (uint32_t c = 0; c <= IMUCAL_MAX_ORDER; c++) {
    const float coefficient = imucal_kf_coefficient(kf, c);
    hex_floats(io, " b", &coefficient, 1);
  }
  check_text(io, "\n");
}

static uint32_t crc_floats(uint32_t running, const float* values, uint32_t n) {
  uint8_t bytes[4];
  for (uint32_t i = 0; i < n; i++) {
    imucal_put_f32(bytes, values[i]);
    running = imucal_crc_add(running, bytes, 4);
  }
  return running;
}

/* The whole state of all filters in one number: printed every second. */
static uint32_t crc_filters(void) {
  uint32_t crc = IMUCAL_CRC_INIT;
  for (int k = 0; k < N_ORDERS; k++)
    for (int i = 0; i < N_CHANNELS; i++) {
      const imucal_kf_t* kf = &filter[k][i].kf;
      imucal_kf_state_t state;
      imucal_kf_get_state(kf, &state);
      crc = crc_floats(crc, state.x, IMUCAL_KF_MAX_STATES);
      crc = crc_floats(crc, state.x_lo, IMUCAL_KF_MAX_STATES);
      crc = crc_floats(crc, state.d, IMUCAL_KF_MAX_STATES);
      crc = crc_floats(crc, state.d_lo, IMUCAL_KF_MAX_STATES);
      crc = crc_floats(crc, state.u, IMUCAL_KF_MAX_U);
      crc = crc_floats(crc, &kf->stats.innovation, 1);
      crc = crc_floats(crc, &kf->stats.innovation_weight, 1);
    }
  return imucal_crc_end(crc);
}

static void learn_second(const check_io_t* io, const imucal_second_t* second) {
  float mean[N_CHANNELS + 1];
  for (int i = 0; i < N_CHANNELS; i++)
    mean[i] = imucal_unit_from_q16(imucal_mean_q16_rne(second->sum[i], second->n_samples), kUnitPerCount[i], 0.0f);
  imucal_thermometer_read(&thermometer, second);
  mean[N_CHANNELS] = thermometer.temp_degc;
  for (int k = 0; k < N_ORDERS; k++)
    for (int i = 0; i < N_CHANNELS; i++)
      if (imucal_learn_second(&filter[k][i], &thermometer, &sum, second, (uint32_t)i, mean[i]) == IMUCAL_LEARN_REFUSED)
        check_text(io, "error: the filter refuses\n");
  check_text(io, "second");
  check_number(io, second->t_s);
  check_number(io, second->n_samples);
  check_number(io, second->n_skipped);
  for (int i = 0; i < N_CHANNELS; i++) check_number(io, second->flags[i]);
  hex_floats(io, " mean", mean, N_CHANNELS + 1);
  check_hex(io, crc_filters());
  check_text(io, "\n");
  if (second->t_s % PRINT_EVERY_S != 0) return;
  for (int k = 0; k < N_ORDERS; k++)
    for (int i = 0; i < N_CHANNELS; i++) print_filter(io, second->t_s, k, i);
}

static void learn(const check_io_t* io) {
  imucal_second_t second;
  imucal_sample_t sample;
  start_filters();
  imucal_thermometer_init(&thermometer, DEGC_PER_COUNT, DEGC_AT_ZERO);
  if (imucal_sum_init(&sum, N_CHANNELS, RATE_HZ) != IMUCAL_OK) check_text(io, "error: sum\n");
  for (bool is_first = true; io->sample(io->ctx, is_first, &sample); is_first = false)
    if (imucal_sum_add(&sum, &sample, &second) == IMUCAL_SECOND_READY) learn_second(io, &second);
  if (imucal_sum_flush(&sum, &second) == IMUCAL_SECOND_READY) learn_second(io, &second);
  for (int k = 0; k < N_ORDERS; k++)
    for (int i = 0; i < N_CHANNELS; i++)
      if (imucal_kf_new_run(&filter[k][i].kf, 12.5f) != IMUCAL_OK) check_text(io, "error: new run\n");
  print_filter(io, sum.last_t_s, 0, 0);
  print_filter(io, sum.last_t_s, 1, 2);
}

/* ---- table ---- */

static void fill_channel(imucal_table_channel_t* channel, int i) {
  static const char names[N_CHANNELS][IMUCAL_NAME_LEN] = {"gx_dph", "gy_dph", "gz_dph"};
  memcpy(channel->name, names[i], IMUCAL_NAME_LEN);
  channel->arw = 0.6f;
  channel->n_markov = 1;
  channel->markov_sigma[0] = 20.0f;
  channel->markov_tau_s[0] = 100.0f;
  channel->unit_per_count = kUnitPerCount[i];
  channel->full_scale_counts = i == 1 ? 32767 : 8388607;
  if (i != 2) return;
  channel->scale_order = 2; /* a scale factor, as a rate table gives it */
  channel->scale_coeff[0] = 0.00123f;
  channel->scale_coeff[1] = -0.0021f;
  channel->scale_coeff[2] = 0.0004f;
}

static void make_table(const check_io_t* io, int k) {
  memset(&table, 0, sizeof table);
  memcpy(table.serial, "check", 5);
  table.sequence = 1;
  table.n_channels = N_CHANNELS;
  table.degc_per_count = DEGC_PER_COUNT;
  table.degc_at_zero = DEGC_AT_ZERO;
  for (int i = 0; i < N_CHANNELS; i++) {
    fill_channel(&table.channel[i], i);
    if (imucal_table_from_kf(&table.channel[i], &filter[k][i].kf, 2.0f, 58.5f) != IMUCAL_OK)
      check_text(io, "error: table\n");
    if (imucal_comp_prepare(&comp[k][i], &table, (uint32_t)i) != IMUCAL_OK) check_text(io, "error: comp\n");
  }
  static uint8_t bytes[IMUCAL_TABLE_BYTES(N_CHANNELS)];
  size_t n = 0;
  if (imucal_table_encode(&table, bytes, sizeof bytes, &n) != IMUCAL_OK) check_text(io, "error: encode\n");
  check_text(io, "table");
  check_number(io, kOrder[k]);
  for (size_t i = 0; i + 4 <= n; i += 4) check_hex(io, imucal_get_u32(bytes + i));
  check_text(io, "\n");
  for (int i = 0; i < N_CHANNELS; i++) {
    const imucal_comp_t* c = &comp[k][i];
    check_text(io, "comp");
    check_number(io, kOrder[k]);
    check_number(io, c->out_frac_bits);
    check_hex(io, (uint32_t)c->temp_lo_counts);
    check_hex(io, (uint32_t)c->temp_hi_counts);
    for (int j = 0; j < IMUCAL_MAX_COEFF; j++) check_hex(io, (uint32_t)c->coeff[j]);
    for (int j = 0; j < IMUCAL_TABLE_SCALE_N; j++) check_hex(io, (uint32_t)c->scale_coeff[j]);
    check_text(io, "\n");
  }
}

/* ---- compensation of every sample ---- */

static void compensate(const check_io_t* io) {
  imucal_sample_t sample;
  uint32_t crc = IMUCAL_CRC_INIT, flags = 0, n = 0;
  for (bool is_first = true; io->sample(io->ctx, is_first, &sample); is_first = false) {
    uint8_t bytes[4];
    for (int k = 0; k < N_ORDERS; k++)
      for (int i = 0; i < N_CHANNELS; i++) {
        imucal_put_u32(bytes, (uint32_t)imucal_comp_apply(&comp[k][i], sample.temp_counts, sample.counts[i], &flags));
        crc = imucal_crc_add(crc, bytes, 4);
      }
    if (++n % RATE_HZ != 0) continue;
    check_text(io, "out");
    check_number(io, n);
    check_hex(io, imucal_crc_end(crc));
    check_hex(io, flags);
    check_text(io, "\n");
  }
}

void check_bits(const check_io_t* io) {
  learn(io);
  for (int k = 0; k < N_ORDERS; k++) make_table(io, k);
  compensate(io);
  check_text(io, "end\n");
}
