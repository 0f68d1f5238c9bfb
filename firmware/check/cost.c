// SPDX-License-Identifier: MIT
/* Instructions and stack of the core's functions, as the processor counts them. */
#include <string.h>

#include "check.h"
#include "clock.h"
#include "comp.h"
#include "crc.h"
#include "health.h"
#include "learn.h"
#include "link.h"
#include "num.h"
#include "reference.h"
#include "sum.h"
#include "table.h"

enum { N_CALLS = 500 };

/* What every measured call works on. */
static struct {
  imucal_learn_t learn;
  imucal_thermometer_t thermometer;
  imucal_health_t health;
  imucal_comp_t comp;
  imucal_clock_t clock;
  imucal_sum_t sum;
  imucal_table_t table;
  imucal_sample_t sample;
  imucal_second_t second;
  imucal_link_second_t record;
  imucal_link_rx_t rx;
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  size_t n_bytes;
  uint32_t i, flags, seed;
  volatile int32_t sink;
} work;

static int32_t noise(void) {
  return (int32_t)((work.seed = work.seed * 1664525u + 1013904223u) >> 22) - 512;
}

typedef void (*call_t)(void);

/* Two floats and the temperature ramp of a test, made outside of what is measured. */
static float next_rate, next_degc;

static void prepare_nothing(void) {
  work.i++;
}
static void prepare_second(void) {
  work.i++;
  next_rate = 80.0f + (float)noise() * 0.1f;
  next_degc = (float)(work.i % 600u) * 0.1f;
}
static void prepare_sample(void) {
  work.i++;
  work.sample.t_us += 10000;
  work.sample.temp_counts = (int32_t)(work.i * 7u % 6000u) - 2500;
  for (int i = 0; i < IMUCAL_MAX_CHANNELS; i++) work.sample.counts[i] = noise() * 100;
}

static void call_nothing(void) {
  __asm volatile("" ::: "memory");
}
static void call_kf_update(void) {
  work.sink = imucal_kf_update(&work.learn.kf, next_rate, next_degc);
}
static void call_health(void) {
  work.sink = imucal_health_second(&work.health, next_rate, next_degc, 0, true, 0) &&
              imucal_health_gate(&work.health, next_rate - 80.0f, 0.0007f);
}
static void call_health_judge(void) {
  imucal_health_verdict_t verdict;
  imucal_health_judge(&work.health, &verdict);
  work.sink = (int32_t)verdict.bits;
}
static void call_kf_copy(void) {
  static imucal_kf_t copy;
  copy = work.learn.kf;
  __asm volatile("" ::"r"(&copy) : "memory");
}
static void call_kf_skip(void) {
  work.sink = imucal_kf_skip(&work.learn.kf, 1);
}
static void call_kf_sigma(void) {
  work.sink = imucal_kf_bias_sigma(&work.learn.kf, next_degc) > 1.0f;
}
static void call_kf_worst(void) {
  work.sink = imucal_kf_worst_sigma(&work.learn.kf, 0.0f, 60.0f, 25, NULL) > 1.0f;
}
static void call_thermometer(void) {
  imucal_thermometer_read(&work.thermometer, &work.second);
}
static void call_learn(void) {
  work.sink = (int32_t)imucal_learn_second(&work.learn, &work.thermometer, &work.sum, &work.second, 0, next_rate);
}
static void call_learn_checked(void) {
  const imucal_learn_input_t input = imucal_learn_input_of(&work.thermometer, &work.sum, &work.second, 0, next_rate);
  work.sink = (int32_t)imucal_learn_checked(&work.learn, &work.health, &input, 0);
}
static void call_clock(void) {
  uint64_t t_us;
  work.sink = imucal_clock_take(&work.clock, work.sample.t_us, &t_us);
}
static void call_sum_add(void) {
  work.sink = imucal_sum_add(&work.sum, &work.sample, &work.second);
}
static void call_mean(void) {
  const int64_t mean = imucal_mean_q16_rne(work.second.sum[0], work.second.n_samples);
  work.sink = imucal_unit_from_q16(mean, 0.5f, 25.0f) > 1.0f;
}
static void call_comp(void) {
  work.sink = imucal_comp_apply(&work.comp, work.sample.temp_counts, work.sample.counts[0], &work.flags);
}
static void call_comp_prepare(void) {
  work.sink = imucal_comp_prepare(&work.comp, &work.table, 0);
}
static void call_encode(void) {
  work.sink = imucal_table_encode(&work.table, work.bytes, sizeof work.bytes, &work.n_bytes);
}
static void call_decode(void) {
  work.sink = imucal_table_decode(work.bytes, work.n_bytes, &work.table, NULL);
}
static void call_crc(void) {
  work.sink = (int32_t)imucal_crc32(work.bytes, 100);
}
static void call_pack(void) {
  work.sink = imucal_link_pack(IMUCAL_LINK_ID_SECOND, 1, &work.record, work.bytes, sizeof work.bytes, &work.n_bytes);
}
static void call_receive(void) {
  for (size_t i = 0; i < work.n_bytes; i++) work.sink = imucal_link_rx_put(&work.rx, work.bytes[i]);
}

/* Instructions of n calls, with what makes their input taken off. */
static uint32_t instructions(const check_io_t* io, call_t prepare, call_t call, uint32_t n) {
  uint32_t total[2];
  for (int pass = 0; pass < 2; pass++) {
    const call_t measured = pass == 0 ? call_nothing : call;
    const uint32_t begin = io->ticks();
    for (uint32_t i = 0; i < n; i++) {
      prepare();
      measured();
    }
    total[pass] = io->ticks() - begin;
  }
  const uint64_t ticks = total[1] > total[0] ? total[1] - total[0] : 0;
  return (uint32_t)((ticks * io->instructions_per_1000_ticks + 500u) / 1000u);
}

static void report_n(const check_io_t* io, const char* name, call_t prepare, call_t call, uint32_t n) {
  const uint32_t count = instructions(io, prepare, call, n);
  check_text(io, name);
  check_number(io, (count + n / 2) / n);
  check_text(io, "\n");
}

static void report(const check_io_t* io, const char* name, call_t prepare, call_t call) {
  report_n(io, name, prepare, call, N_CALLS);
}

static void start_filter(uint8_t order) {
  const imucal_kf_config_t config = REFERENCE_FILTER(order);
  work.sink = imucal_kf_init(&work.learn.kf, &config);
  for (int i = 0; i < 600; i++) {
    prepare_second();
    call_kf_update();
  }
}

static void start_table(uint8_t order, uint8_t scale_order) {
  imucal_table_t* table = &work.table;
  memset(table, 0, sizeof *table);
  memcpy(table->serial, "cost", 4);
  table->sequence = 1;
  table->n_channels = IMUCAL_MAX_CHANNELS;
  table->degc_per_count = 0.01f;
  table->degc_at_zero = 25.0f;
  for (int i = 0; i < IMUCAL_MAX_CHANNELS; i++) {
    imucal_table_channel_t* channel = &table->channel[i];
    memcpy(channel->name, "gx_dph", 6);
    channel->name[1] = (char)('u' + i);
    channel->order = order;
    channel->t0_degc = channel->range_degc = 30.0f;
    for (int k = 0; k <= order; k++) channel->coeff[k] = 300.0f - (float)k * 77.0f;
    channel->scale_order = scale_order;
    for (int k = 0; k <= scale_order && scale_order > 0; k++) channel->scale_coeff[k] = 0.001f + (float)k * 0.002f;
    channel->span_hi_degc = 60.0f;
    for (int k = 0; k < IMUCAL_TABLE_SIGMA_N; k++) channel->sigma[k] = 5.0f;
    channel->arw = 0.6f;
    channel->unit_per_count = 1.0f;
    channel->full_scale_counts = 8388607;
    channel->n_seconds = 8400;
  }
  call_comp_prepare();
  if (work.sink != IMUCAL_OK) work.comp.order = 99; /* shows as nonsense in the figures */
}

static void start_sum(uint32_t n_channels) {
  work.sink = imucal_sum_init(&work.sum, n_channels, 100);
  memset(&work.sample, 0, sizeof work.sample);
  work.sample.n_channels = (uint8_t)n_channels;
}

static const char* const kOrderName[5] = {"1", "2", "3", "4", "5"};

static void report_order(const check_io_t* io, const char* name, uint8_t order, call_t prepare, call_t call) {
  check_text(io, name);
  report(io, kOrderName[order - 1], prepare, call);
}

void check_cycles(const check_io_t* io) {
  work.seed = 1;
  for (uint8_t order = 1; order <= IMUCAL_MAX_ORDER; order++) {
    start_filter(order);
    report_order(io, "kf_update order ", order, prepare_second, call_kf_update);
  }
  start_filter(3);
  report(io, "kf_skip order 3", prepare_nothing, call_kf_skip);
  report(io, "kf_bias_sigma order 3", prepare_second, call_kf_sigma);
  const imucal_health_config_t expected = {.r = 1296.0f, .markov_variance = 400.0f, .hi_degc = 60.0f};
  work.sink = imucal_health_init(&work.health, &expected);
  report(io, "health second and gate", prepare_second, call_health);
  report_n(io, "health_judge", prepare_nothing, call_health_judge, 20);
  report(io, "copy of a filter (the gate's way back)", prepare_nothing, call_kf_copy);
  report_n(io, "kf_worst_sigma order 3, 25 points", prepare_nothing, call_kf_worst, 20);
  static const uint32_t channels[] = {1, 3, 6};
  for (int i = 0; i < 3; i++) {
    start_sum(channels[i]);
    check_text(io, "sum_add channels");
    check_number(io, channels[i]);
    report(io, "", prepare_sample, call_sum_add);
  }
  work.second.sum[0] = 123456789;
  work.second.n_samples = 99;
  report(io, "mean_q16 + unit_from_q16", prepare_nothing, call_mean);
  imucal_thermometer_init(&work.thermometer, 0.01f, 25.0f);
  report(io, "learn: thermometer_read", prepare_nothing, call_thermometer);
  report(io, "learn: learn_second order 3, kf_update included", prepare_second, call_learn);
  work.sink = imucal_health_init(&work.health, &expected);
  report(io, "learn: learn_checked order 3, kf_update and health included", prepare_second, call_learn_checked);
  imucal_thermometer_init(&work.thermometer, 1.0f, 25.0f);
  report(io, "learn: thermometer_read, coarse", prepare_nothing, call_thermometer);
  start_sum(6);
  imucal_clock_init(&work.clock);
  report(io, "clock_take", prepare_sample, call_clock);
  for (uint8_t order = 1; order <= IMUCAL_MAX_ORDER; order++) {
    start_table(order, 0);
    report_order(io, "comp_apply order ", order, prepare_sample, call_comp);
  }
  start_table(3, 2);
  report(io, "comp_apply order 3, scale factor order 2", prepare_sample, call_comp);
  start_table(IMUCAL_MAX_ORDER, 2);
  report(io, "comp_apply order 5, scale factor order 2", prepare_sample, call_comp);
  start_table(3, 2);
  report_n(io, "comp_prepare order 3", prepare_nothing, call_comp_prepare, 20);
  start_table(3, 0);
  report_n(io, "table_encode 6 channels", prepare_nothing, call_encode, 20);
  report_n(io, "table_decode 6 channels", prepare_nothing, call_decode, 20);
  report_n(io, "crc32 100 bytes", prepare_nothing, call_crc, 100);
  work.record.n_channels = 6;
  report_n(io, "link_pack SECOND 6 channels", prepare_nothing, call_pack, 50);
  imucal_link_rx_init(&work.rx);
  report_n(io, "link_rx_put SECOND 6 channels", prepare_nothing, call_receive, 50);
  check_text(io, work.rx.n_frames == 50 ? "end\n" : "error: frames lost\n");
}

static void report_stack(const check_io_t* io, const char* name, call_t call) {
  io->stack_paint();
  const uint32_t before = io->stack_used_bytes();
  call();
  check_text(io, name);
  check_number(io, io->stack_used_bytes() - before);
  check_text(io, "\n");
}

void check_stack(const check_io_t* io) {
  start_filter(5);
  prepare_second();
  report_stack(io, "kf_update order 5", call_kf_update);
  report_stack(io, "kf_worst_sigma order 5", call_kf_worst);
  start_table(5, 2);
  start_sum(6);
  prepare_sample();
  report_stack(io, "comp_apply order 5", call_comp);
  report_stack(io, "comp_prepare order 5", call_comp_prepare);
  report_stack(io, "sum_add 6 channels", call_sum_add);
  report_stack(io, "table_encode 6 channels", call_encode);
  report_stack(io, "table_decode 6 channels", call_decode);
  work.record.n_channels = 6;
  report_stack(io, "link_pack SECOND", call_pack);
  imucal_link_rx_init(&work.rx);
  report_stack(io, "link_rx_put SECOND", call_receive);
  check_text(io, "end\n");
}
