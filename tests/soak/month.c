// SPDX-License-Identifier: MIT
// make month: the whole app calibrates six axes for 30 simulated days, with saturated and faulty axes, lost samples and
// seconds, a thermometer that fails, a host that is away for hours, and clocks that pass 2^32 us every 71 minutes.
// usage: month [days [seed]].  Every second of every axis must be accounted for: used, bridged or refused, by reason; the
// learned polynomial must be within 3 of its own sigma of the truth.  Exit status 1 where it is not.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "app/app.h"
#include "check/reference.h"
#include "emu/torn_nor.h"

enum { RATE_HZ = 4, N_AXES = 6, START_S = 4280 }; // 15 s before the first wrap of 32 bits
enum { KIND_RAIL, KIND_FAULT, KIND_SAMPLES_LOST, KIND_SECONDS_LOST, KIND_THERMOMETER, N_KINDS };

static imucal_app_t app;
static imucal_port_t port;
static imucal_board_t board;
static torn_nor_t nor;
static struct {
  uint64_t t_us, random;
  imucal_sample_t sample;
  int is_ready;
  uint8_t line[IMUCAL_LINK_MAX_FRAME];
  size_t at, end;
  imucal_link_rx_t rx;
  imucal_link_any_t reply;
  uint32_t token, number;
  uint8_t sequence;
  int kind, axis;
  long fault_s, away_s, n_away, n_lost_samples, n_faults[N_KINDS];
  double markov[N_AXES];
} sim;

static double uniform(void) {
  return (double)(torn_nor_mix(sim.random += 0x9E3779B97F4A7C15ULL) >> 11) * 0x1p-53;
}
static double normal(void) {
  return sqrt(-2 * log(uniform() + 1e-18)) * cos(6.283185307179586 * uniform());
}

static size_t serial_read(void* ctx, uint8_t* data, size_t capacity) {
  (void)ctx;
  const size_t left = sim.end - sim.at, n = left < capacity ? left : capacity;
  memcpy(data, sim.line + sim.at, n);
  sim.at += n;
  return n;
}
static size_t serial_write(void* ctx, const uint8_t* data, size_t n) {
  (void)ctx;
  for (size_t i = 0; i < n; i++)
    if (imucal_link_rx_put(&sim.rx, data[i]) == IMUCAL_FRAME_READY && imucal_link_rx_type(&sim.rx) >= 0x80)
      (void)!imucal_link_rx_message(&sim.rx, &sim.reply);
  return n;
}
static imucal_port_sample_t sample_read(void* ctx, imucal_sample_t* sample) {
  (void)ctx;
  if (!sim.is_ready) return IMUCAL_PORT_NO_SAMPLE;
  sim.is_ready = 0;
  *sample = sim.sample;
  return IMUCAL_PORT_SAMPLE;
}
static uint64_t time_us(void* ctx) {
  (void)ctx;
  return sim.t_us;
}
static void nothing(void* ctx) {
  (void)ctx;
}

static void run(void) {
  while (imucal_app_step(&app)) continue;
}
static void ask(uint32_t id, const void* message) {
  imucal_link_command_t command = {.token = sim.token, .number = ++sim.number, .request = (uint8_t)id};
  size_t n = 0;
  if (imucal_link_is_guarded(id)) {
    if (imucal_link_encode(id, message, command.payload, sizeof command.payload, &n) != IMUCAL_OK) abort();
    command.length = (uint8_t)n, id = IMUCAL_LINK_ID_COMMAND, message = &command;
  }
  if (imucal_link_pack(id, ++sim.sequence, message, sim.line, sizeof sim.line, &sim.end) != IMUCAL_OK) abort();
  sim.at = 0;
  run();
}

static void unlock(void) {
  const imucal_link_state_t state = {0};
  ask(IMUCAL_LINK_ID_STATE, &state);
  imucal_link_unlock_t request = {.challenge = sim.reply.state_reply.challenge, .seconds = 600};
  memcpy(request.serial, board.serial, sizeof request.serial);
  ask(IMUCAL_LINK_ID_UNLOCK, &request);
  sim.token = sim.reply.unlock_reply.token, sim.number = 0;
}

static void start(void) {
  static const char* const names[] = {"gx_dph", "gy_dph", "gz_dph", "ax_mg", "ay_mg", "az_mg"};
  memcpy(board.serial, "month", 5);
  board.n_channels = N_AXES, board.rate_hz = RATE_HZ, board.degc_per_count = 0.01f, board.degc_at_zero = 25;
  for (int i = 0; i < N_AXES; i++) {
    memcpy(board.channel[i].name, names[i], strlen(names[i]));
    board.channel[i].unit_per_count = 1, board.channel[i].full_scale_counts = 30000;
  }
  torn_nor_init(&nor, (torn_nor_geometry_t){2048, 2048, 8});
  port = (imucal_port_t){.serial_read = serial_read,
                         .serial_write = serial_write,
                         .sample_read = sample_read,
                         .flash = torn_nor_flash(&nor),
                         .time_us = time_us,
                         .watchdog = nothing,
                         .reboot = nothing,
                         .device = "month"};
  imucal_link_rx_init(&sim.rx);
  if (imucal_app_init(&app, &port, &board) != IMUCAL_OK) abort();
  unlock();
  for (uint8_t i = 0; i < N_AXES; i++) {
    const imucal_link_cal_start_t request = reference_cal_start(i, 3);
    ask(IMUCAL_LINK_ID_CAL_START, &request);
    if (sim.reply.done.status != IMUCAL_OK) abort();
  }
}

static double bias(int axis, double temp_degc) {
  static const double truth[N_AXES][4] = {{80, 300, 150, -100}, {-400, 50, 20, 10},  {20, -90, 5, 40},
                                          {5, 10, 2, -1},       {1000, -800, 30, 3}, {0, 0, 0, 60}};
  const double tn = (temp_degc - 30) / 30, *b = truth[axis];
  return b[0] + tn * (b[1] + tn * (b[2] + tn * b[3]));
}

// What goes wrong in this second: one fault at a time, every 50 min; an axis at its rail for up to an hour, the rest to 2 min.
static void draw_faults(void) {
  if (sim.fault_s > 0)
    sim.fault_s--;
  else if (uniform() < 1.0 / 3000) {
    sim.kind = (int)(uniform() * N_KINDS), sim.axis = (int)(uniform() * N_AXES);
    sim.fault_s = 1 + (long)(uniform() * (sim.kind == KIND_RAIL ? 3600 : 120));
    sim.n_faults[sim.kind]++;
  }
  if (sim.away_s > 0)
    sim.away_s--;
  else if (uniform() < 1.0 / 20000)
    sim.away_s = (long)(uniform() * 18000), sim.n_away++; // up to 5 h
}

static void take_sample(double temp_degc, int may_be_lost) {
  const int kind = sim.fault_s > 0 ? sim.kind : -1;
  const uint64_t t_us = sim.t_us;
  sim.t_us += 1000000u / RATE_HZ;
  if (may_be_lost && (kind == KIND_SECONDS_LOST || (kind == KIND_SAMPLES_LOST && uniform() < 0.4))) {
    sim.n_lost_samples++;
    return;
  }
  sim.sample =
      (imucal_sample_t){.t_us = t_us, .n_channels = N_AXES, .temp_counts = (int32_t)lrint((temp_degc - 25) * 100)};
  for (int i = 0; i < N_AXES; i++)
    sim.sample.counts[i] = (int32_t)lrint(bias(i, temp_degc) + sim.markov[i] + 36 * sqrt(RATE_HZ) * normal());
  if (kind == KIND_RAIL) sim.sample.counts[sim.axis] = 30000;
  if (kind == KIND_FAULT) sim.sample.fault = (uint8_t)(1u << sim.axis), sim.sample.counts[sim.axis] = 12345;
  if (kind == KIND_THERMOMETER) sim.sample.temp_counts = 200000; // open circuit: 2025 degC
  sim.is_ready = 1;
  run();
}

static void simulate(long n_s) {
  for (int i = 0; i < N_AXES; i++) sim.markov[i] = 20 * normal();
  for (long k = 0; k < n_s; k++) {
    const double temp_degc = 30 - 30 * cos(6.283185307179586 * (double)k / 7200);
    draw_faults();
    for (int i = 0; i < N_AXES; i++) sim.markov[i] = sim.markov[i] * 0.99004983374916811 + sqrt(7.92053068) * normal();
    for (int j = 0; j < RATE_HZ; j++) take_sample(temp_degc, k > 10 && k < n_s - 200);
    const imucal_link_info_t info = {0};
    if (k % 60 == 0 && sim.away_s == 0) ask(IMUCAL_LINK_ID_INFO, &info);
  }
}

int main(int argc, char** argv) {
  const long n_s = (long)(86400 * (argc > 1 ? atof(argv[1]) : 30));
  const uint64_t seed = argc > 2 ? strtoull(argv[2], NULL, 10) : 1;
  sim.random = seed;
  sim.t_us = START_S * 1000000ull;
  start();
  simulate(n_s);
  int failed = app.session != IMUCAL_SESSION_CALIBRATING;
  double worst = 0;
  uint64_t n[IMUCAL_LEARN_N_OUTCOMES] = {0}, n_gap_s = 0, n_all = 0;
  for (int i = 0; i < N_AXES; i++) {
    const imucal_learn_t* learn = &app.channel[i].learn;
    uint64_t sum = learn->n_gap_s;
    for (int o = 0; o < IMUCAL_LEARN_N_OUTCOMES; o++) sum += learn->n[o], n[o] += learn->n[o];
    n_gap_s += learn->n_gap_s, n_all += sum;
    if (sum != app.t_s - START_S || sum + 2 < (uint64_t)n_s) {
      failed = 1; // the last second is still open
      fprintf(stderr, "month: axis %d: %llu of %ld seconds\n", i, (unsigned long long)sum, n_s);
    }
    for (int t = 0; t <= 60; t += 5)
      worst = fmax(worst, fabs((double)imucal_kf_bias(&learn->kf, (float)t) - bias(i, t)) /
                              (double)imucal_kf_bias_sigma(&learn->kf, (float)t));
  }
  failed |= !(worst <= 3);
  printf("month: seed %llu, %ld s of 6 axes: %llu used, %llu missing, %llu fault, %llu saturated, %llu temperature, "
         "%llu refused, %llu without a "
         "sample: %llu axis-seconds; faults %ld %ld %ld %ld %ld, host away %ld times, samples lost %ld, wraps of 32 "
         "bits %llu; largest error "
         "%.2f sigma; unaccounted or wrong %d\n",
         (unsigned long long)seed, n_s, (unsigned long long)n[IMUCAL_LEARN_USED],
         (unsigned long long)n[IMUCAL_LEARN_MISSING], (unsigned long long)n[IMUCAL_LEARN_FAULT],
         (unsigned long long)n[IMUCAL_LEARN_SATURATED], (unsigned long long)n[IMUCAL_LEARN_TEMPERATURE],
         (unsigned long long)n[IMUCAL_LEARN_REFUSED], (unsigned long long)n_gap_s, (unsigned long long)n_all,
         sim.n_faults[0], sim.n_faults[1], sim.n_faults[2], sim.n_faults[3], sim.n_faults[4], sim.n_away,
         sim.n_lost_samples, (unsigned long long)(sim.t_us >> 32), worst, failed);
  return failed;
}
