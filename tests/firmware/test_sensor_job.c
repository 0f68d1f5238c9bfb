// SPDX-License-Identifier: MIT
/* The whole job with a real sensor's numbers: gyrosim's chamber and gyros (a log made by the build,
 * sensor_job_model.json, sensor_job_profile.json) -> a modelled ICM-42688-P (2000 dps, 16.4 counts per dps, 1 kHz FIFO, its clock
 * 1 % fast, temperature by its formula) -> driver -> app (sum, kf, table, comp), calibrated over the link.  The same samples,
 * kept, go through the core offline: the table must be the same, byte for byte, and so must every compensated sample. */
#include <stdio.h>
#include <stdlib.h>

#include "bench.h"
#include "emu/icm42688p.h"
#include "sensors/icm42688p.h"
#include "sensors/source.h"

#define LEARN_S 420
#define RUN_S 30
#define MAX_SAMPLES ((LEARN_S + RUN_S + 20) * 1011)

static bench_t bench;
static emu_icm_t icm;
static imucal_sensor_bus_t bus;
static imucal_icm42688p_t sensor;
static imucal_sample_t kept[MAX_SAMPLES], burst[25];
static int32_t out_kept[MAX_SAMPLES][6];
static uint32_t n_kept, n_out, burst_at, burst_n, n_read_errors;
static double end_us;

/* Rows of gyrosim's log: seconds that end at 1, 2, ...; degC and dph. */
static double log_row[LEARN_S + RUN_S + 30][4];
static size_t n_rows;

static void read_log(void) {
  char path[512], line[256];
  const char* build = getenv("BUILD");
  snprintf(path, sizeof path, "%s/tests/firmware/sensor_job.csv", build ? build : "build");
  FILE* file = fopen(path, "r");
  if (!file) fail_msg("%s is missing: make %s", path, path);
  while (fgets(line, sizeof line, file) && n_rows < sizeof log_row / sizeof log_row[0]) {
    double* row = log_row[n_rows];
    double t_s;
    if (sscanf(line, "%lf,%lf,%lf,%lf,%lf", &t_s, &row[0], &row[1], &row[2], &row[3]) == 5) n_rows++;
  }
  (void)fclose(file);
  assert_true(n_rows > LEARN_S + RUN_S);
}

/* Degrees per second and g; beside the log's the sensor's white noise, 2.8 mdps/rt(Hz) and 70 ug/rt(Hz) at 500 Hz of
 * bandwidth. */
static void chamber(void* ctx, uint64_t k, double t_us, emu_world_t* world) {
  (void)ctx;
  const size_t i = (size_t)(t_us * 1e-6) < n_rows ? (size_t)(t_us * 1e-6) : n_rows - 1;
  const double tn = (log_row[i][0] - 30.0) / 30.0;
  world->temp_degc = log_row[i][0];
  for (uint32_t axis = 0; axis < 3; axis++) {
    world->rate_dps[axis] = log_row[i][1 + axis] / 3600.0 + 0.0626 * emu_noise(k, axis);
    world->accel_g[axis] = (axis == 2) + 0.003 * tn + 0.001 * tn * tn + 0.00157 * emu_noise(k, 3 + axis);
  }
}

static imucal_port_sample_t read_sensor(void* ctx, imucal_sample_t* sample) {
  (void)ctx;
  if (burst_at == burst_n) {
    if (icm.bus.now_us >= end_us) return IMUCAL_PORT_NO_SAMPLE;
    emu_icm_advance(&icm, 9000.0);
    n_read_errors += imucal_icm42688p_read(&sensor, (uint64_t)icm.bus.now_us, burst, 25, &burst_n) != IMUCAL_OK;
    burst_at = 0;
    if (burst_n == 0) return IMUCAL_PORT_NO_SAMPLE;
  }
  *sample = burst[burst_at++];
  assert_true(n_kept < MAX_SAMPLES);
  kept[n_kept++] = *sample;
  return IMUCAL_PORT_SAMPLE;
}

static void keep_out(void* ctx, const imucal_sample_t* raw, const int32_t* out, const uint8_t* frac_bits,
                     uint8_t clamped) {
  (void)ctx, (void)raw, (void)frac_bits, (void)clamped;
  memcpy(out_kept[n_out++], out, sizeof out_kept[0]);
}

static void feed(double seconds) {
  end_us += seconds * 1e6;
  for (int i = 0; i < 100000 && icm.bus.now_us < end_us; i++) bench_run(&bench);
}

static void describe_board(imucal_board_t* board) {
  static const char* const names[] = {"gx_dph", "gy_dph", "gz_dph", "ax_mg", "ay_mg", "az_mg"};
  const imucal_sensor_units_t units = imucal_icm42688p_units(&sensor.config);
  imucal_board_from_sensor(board, &units, 1000);
  for (int i = 0; i < 6; i++) {
    memset(board->channel[i].name, 0, sizeof board->channel[i].name);
    strncpy(board->channel[i].name, names[i], sizeof board->channel[i].name);
  }
}

static imucal_link_cal_start_t start_request(uint8_t channel) {
  return (imucal_link_cal_start_t){.channel = channel,
                                   .order = 3,
                                   .t0_degc = 30.0f,
                                   .range_degc = 30.0f,
                                   .m = REFERENCE_M,
                                   .q = 0.0198013267f, /* 1 dph (mg), 100 s */
                                   .r = 64.0f,
                                   .markov_variance = 1.0f,
                                   .prior_sigma = 1e4f,
                                   .span_lo_degc = 2.0f,
                                   .span_hi_degc = 58.0f,
                                   .arw = 0.133333f,
                                   .n_markov = 1,
                                   .markov_sigma = {1.0f},
                                   .markov_tau_s = {100.0f}};
}

static size_t download(uint8_t* bytes) {
  size_t total = 1;
  for (size_t at = 0; at < total; at += bench.reply.table_read_reply.length) {
    const imucal_link_table_read_t request = {.slot = IMUCAL_LINK_SLOT_RULING, .offset = (uint16_t)at, .length = 97};
    assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_TABLE_READ, &request), IMUCAL_LINK_ID_TABLE_READ_REPLY);
    memcpy(bytes + at, bench.reply.table_read_reply.data, bench.reply.table_read_reply.length);
    total = bench.reply.table_read_reply.total;
  }
  return total;
}

/* The core alone, over samples [0, n): filters of six channels. */
static void learn_offline(uint32_t n, imucal_learn_t learn[6]) {
  static imucal_health_t health[6];
  imucal_clock_t clock;
  imucal_sum_t sum;
  imucal_thermometer_t thermometer;
  const imucal_board_t* board = &bench.board;
  assert_int_equal(imucal_sum_init(&sum, 6, 1000), IMUCAL_OK);
  imucal_clock_init(&clock);
  imucal_thermometer_init(&thermometer, board->degc_per_count, board->degc_at_zero);
  for (uint8_t i = 0; i < 6; i++) {
    const imucal_link_cal_start_t r = start_request(i);
    const imucal_kf_config_t config = {.order = r.order,
                                       .t0_degc = r.t0_degc,
                                       .range_degc = r.range_degc,
                                       .m = r.m,
                                       .q = r.q,
                                       .r = r.r,
                                       .markov_variance = r.markov_variance,
                                       .prior_sigma = r.prior_sigma};
    const imucal_health_config_t expected = {.r = r.r,
                                             .markov_variance = r.markov_variance,
                                             .lo_degc = r.span_lo_degc,
                                             .hi_degc = r.span_hi_degc,
                                             .temp_step_degc = board->degc_per_count};
    assert_int_equal(imucal_learn_init(&learn[i], &config), IMUCAL_OK);
    assert_int_equal(imucal_health_init(&health[i], &expected), IMUCAL_OK);
  }
  for (uint32_t k = 0; k < n; k++) {
    imucal_second_t second;
    imucal_sample_t sample = kept[k];
    if (!imucal_clock_take(&clock, sample.t_us, &sample.t_us)) continue;
    if (imucal_sum_add(&sum, &sample, &second) != IMUCAL_SECOND_READY) continue;
    imucal_thermometer_read(&thermometer, &second);
    for (uint32_t i = 0; i < 6; i++) {
      const float value = imucal_unit_from_q16(imucal_mean_q16_rne(second.sum[i], second.n_samples),
                                               board->channel[i].unit_per_count, 0.0f);
      const imucal_learn_input_t input = imucal_learn_input_of(&thermometer, &sum, &second, i, value);
      (void)imucal_learn_checked(&learn[i], &health[i], &input, second.flags[i]);
    }
  }
}

static size_t table_offline(const imucal_learn_t learn[6], uint32_t created_s, uint8_t* bytes, imucal_table_t* table) {
  memset(table, 0, sizeof *table);
  memcpy(table->serial, bench.board.serial, sizeof table->serial);
  table->sequence = 1;
  table->created_s = created_s;
  table->n_channels = 6;
  table->degc_per_count = bench.board.degc_per_count;
  table->degc_at_zero = bench.board.degc_at_zero;
  for (uint8_t i = 0; i < 6; i++) {
    const imucal_link_cal_start_t r = start_request(i);
    imucal_table_channel_t* channel = &table->channel[i];
    assert_int_equal(imucal_table_from_kf(channel, &learn[i].kf, r.span_lo_degc, r.span_hi_degc), IMUCAL_OK);
    memcpy(channel->name, bench.board.channel[i].name, sizeof channel->name);
    channel->arw = r.arw;
    channel->n_markov = r.n_markov;
    channel->markov_sigma[0] = r.markov_sigma[0];
    channel->markov_tau_s[0] = r.markov_tau_s[0];
    channel->unit_per_count = bench.board.channel[i].unit_per_count;
    channel->full_scale_counts = bench.board.channel[i].full_scale_counts;
  }
  size_t n = 0;
  assert_int_equal(imucal_table_encode(table, bytes, IMUCAL_TABLE_MAX_BYTES, &n), IMUCAL_OK);
  return n;
}

static void set_up(void) {
  read_log();
  emu_icm_power_on(&icm);
  icm.bus.clock_error = 0.01;
  icm.bus.feel = chamber;
  bus = emu_icm_bus(&icm);
  const imucal_icm42688p_config_t config = {.rate_hz = 1000, .filter = 0};
  assert_int_equal(imucal_icm42688p_start(&sensor, &bus, &config), IMUCAL_OK);
  bench_start(&bench);
  describe_board(&bench.board);
  assert_true(fabs(1.0 / (double)imucal_icm42688p_units(&config).dps_per_count - 16.384) < 1e-4);
  bench.port.sample_read = read_sensor;
  bench.port.sample_out = keep_out;
  bench_power_cycle(&bench);
}

static void test_table_from_the_sensor_equals_the_table_of_its_log(void** state) {
  (void)state;
  set_up();
  for (uint8_t i = 0; i < 6; i++) {
    const imucal_link_cal_start_t request = start_request(i);
    assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_START, &request), IMUCAL_OK);
  }
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND), IMUCAL_OK);
  feed(LEARN_S);
  const imucal_link_cal_stop_t stop = {.action = IMUCAL_STOP_KEEP};
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_STOP, &stop), IMUCAL_OK);
  const uint32_t n_learnt = n_kept;
  imucal_link_table_from_cal_t from_cal = {.created_s = 1750000000};
  memcpy(from_cal.serial, bench.board.serial, sizeof from_cal.serial);
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_TABLE_FROM_CAL, &from_cal), IMUCAL_OK);

  static imucal_learn_t learn[6];
  static imucal_table_t table;
  uint8_t device_bytes[IMUCAL_TABLE_MAX_BYTES], offline_bytes[IMUCAL_TABLE_MAX_BYTES];
  learn_offline(n_learnt, learn);
  const size_t n = table_offline(learn, from_cal.created_s, offline_bytes, &table);
  assert_int_equal(download(device_bytes), n);
  assert_memory_equal(device_bytes, offline_bytes, n);

  /* The learnt bias is the chamber's, the sensor's faults are none, its clock is known. */
  for (int i = 0; i < 3; i++) {
    const double truth_dph = 360.0; /* coefficient 0 of sensor_job_model.json */
    assert_true(fabs((double)imucal_kf_bias(&learn[i].kf, 30.0f) - truth_dph) < 8.0);
  }
  assert_true(fabs((double)imucal_sensor_clock_drift_ppm(&sensor.clock) - 10000.0) < 30.0);
  assert_int_equal(n_read_errors + sensor.counts.n_bus_errors + sensor.counts.n_lost + sensor.counts.n_resets, 0);
  assert_true(learn[0].n[IMUCAL_LEARN_USED] > LEARN_S - 5);

  /* With the table in force: every compensated sample of the device is the one of comp on the kept sample. */
  const uint32_t first = n_out;
  assert_int_equal(n_kept - n_learnt, 0);
  feed(RUN_S);
  assert_true(n_out - first > 1000u * (RUN_S - 1));
  imucal_comp_t comp[6];
  for (uint32_t i = 0; i < 6; i++) assert_int_equal(imucal_comp_prepare(&comp[i], &table, i), IMUCAL_OK);
  double mean_dph = 0;
  for (uint32_t k = 0; first + k < n_out; k++) {
    const imucal_sample_t* raw = &kept[n_learnt + k];
    for (uint32_t i = 0; i < 6; i++) {
      uint32_t flags = 0;
      assert_int_equal(imucal_comp_apply(&comp[i], raw->temp_counts, raw->counts[i], &flags), out_kept[first + k][i]);
    }
    mean_dph += (double)out_kept[first + k][0] * (double)comp[0].unit_per_lsb;
  }
  assert_true(fabs(mean_dph / (n_out - first)) < 12.0); /* hundreds before */
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_table_from_the_sensor_equals_the_table_of_its_log)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
