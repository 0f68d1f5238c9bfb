// SPDX-License-Identifier: MIT
/* A register-level sensor model as a process: an emulated device's driver talks to it over two named pipes
 * (firmware/port/sim/bus_sensor.h).  The world it feels is a log of 1-s means (gyrosim log) plus the sensor's own white noise;
 * its clock may be off; faults come and go at given times of the world.
 *
 * usage: sensor_server SENSOR PREFIX [--log LOG.csv] [--clock-error 0.01] [--noise-dps N] [--noise-g N]
 *        [--fault KIND:FROM_S:TO_S]...
 * KIND: zeros ones errors identity temperature (from FROM to TO), reset overrun (at FROM).  Exit status: 0 when the device has
 * closed its end, 2 usage, 3 a log that cannot be read. */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include "emu/bmi088.h"
#include "emu/icm42688p.h"
#include "emu/lsm6dso.h"
#include "emu/mpu6050.h"

#define MAX_FAULTS 16
#define OVERRUN_US 3e6 /* the device is held up for so long: more than any FIFO holds */

static union {
  emu_icm_t icm;
  emu_mpu_t mpu;
  emu_lsm_t lsm;
  emu_bmi_t bmi;
} model;
static emu_bus_t* model_bus;
static imucal_sensor_bus_t bus;
static char kind; /* i m l b */

static struct {
  double (*row)[7]; /* degC, dps, g */
  size_t n;
  double begin_us, noise_dps, noise_g;
} world = {.noise_dps = 0.0626, .noise_g = 0.00157}; /* 2.8 mdps/rt(Hz), 70 ug/rt(Hz) at 500 Hz */

static struct fault {
  char what;
  double from_s, to_s;
  bool is_done;
} faults[MAX_FAULTS];
static int n_faults;

static void fail(int status, const char* what, const char* value) {
  fprintf(stderr, "sensor_server: %s '%s'\n", what, value);
  exit(status);
}

/* ---- the world ---- */

static double now_s(void) {
  return (model_bus->now_us - world.begin_us) * 1e-6;
}

static void feel(void* ctx, uint64_t k, double t_us, emu_world_t* w) {
  (void)ctx;
  const double t_s = (t_us - world.begin_us) * 1e-6;
  const size_t i = t_s <= 0 ? 0 : (size_t)t_s;
  const double* row = world.n ? world.row[i < world.n ? i : world.n - 1] : NULL;
  if (row) w->temp_degc = row[0];
  for (int axis = 0; axis < 3; axis++) {
    w->rate_dps[axis] = (row ? row[1 + axis] : 0) + world.noise_dps * emu_noise(k, 11 + (uint32_t)axis);
    w->accel_g[axis] = (row ? row[4 + axis] : axis == 2) + world.noise_g * emu_noise(k, 21 + (uint32_t)axis);
  }
}

/* Column of the row for a name of the log's header; unit[i] of its values. */
static int column_of(const char* name, double* unit) {
  static const char* const names[7] = {"temp_degc", "gx_dph", "gy_dph", "gz_dph", "ax_mg", "ay_mg", "az_mg"};
  for (int i = 0; i < 7; i++)
    if (!strcmp(name, names[i])) {
      *unit = i == 0 ? 1.0 : i < 4 ? 1.0 / 3600.0 : 0.001;
      return i;
    }
  return -1;
}

static void read_log(const char* path) {
  char line[512];
  int column[64], n_columns = 0;
  double unit[64];
  FILE* file = fopen(path, "r");
  if (!file) fail(3, "cannot read the log", path);
  while (fgets(line, sizeof line, file)) {
    if (line[0] == '#') continue;
    char* at = line;
    int i = 0;
    double row[7] = {25.0, 0, 0, 0, 0, 0, 1.0};
    for (char* field; (field = strsep(&at, ",\r\n")) && i < 64; i++) {
      if (!world.row && n_columns == i)
        column[n_columns++] = column_of(field, &unit[i]);
      else if (i < n_columns && column[i] >= 0)
        row[column[i]] = atof(field) * unit[i];
    }
    if (!world.row) {
      world.row = malloc(sizeof *world.row);
      continue;
    }
    world.row = realloc(world.row, (world.n + 1) * sizeof *world.row);
    memcpy(world.row[world.n++], row, sizeof row);
  }
  fclose(file);
  if (world.n == 0) fail(3, "no rows in the log", path);
}

/* ---- faults ---- */

static void set_identity(bool is_wrong) {
  uint8_t* id = kind == 'i'   ? &model.icm.reg[0][0x75]
                : kind == 'm' ? &model.mpu.reg[0x75]
                : kind == 'l' ? &model.lsm.reg[0x0F]
                              : &model.bmi.gyr[0x00];
  *id = is_wrong      ? 0x12
        : kind == 'i' ? model.icm.who_am_i
        : kind == 'm' ? model.mpu.who_am_i
        : kind == 'l' ? model.lsm.who_am_i
                      : model.bmi.gyr_id;
}

static void set_frozen(bool is_frozen) {
  model.icm.frozen_degc = kind == 'i' ? 30.0 : model.icm.frozen_degc;
  if (kind == 'i') model.icm.is_temp_frozen = is_frozen;
  if (kind == 'm') model.mpu.is_temp_frozen = is_frozen;
  if (kind == 'l') model.lsm.is_temp_frozen = is_frozen;
}

static void brown_out(void) {
  if (kind == 'i') {
    emu_icm_brown_out(&model.icm);
    model.icm.reg[0][0x2D] |= 0x10;
  }
  if (kind == 'm') emu_mpu_brown_out(&model.mpu);
  if (kind == 'l') emu_lsm_reset_registers(&model.lsm);
  if (kind == 'b') {
    emu_bmi_reset_accel(&model.bmi);
    emu_bmi_reset_gyro(&model.bmi);
  }
}

static void apply(struct fault* fault) {
  const double t_s = now_s();
  const bool is_now = t_s >= fault->from_s && t_s < fault->to_s;
  if (fault->what == 'z' || fault->what == 'o' || fault->what == 'e') {
    const emu_fault_t state = fault->what == 'z' ? EMU_BUS_ZEROS : fault->what == 'o' ? EMU_BUS_ONES : EMU_BUS_ERRORS;
    if (is_now || model_bus->fault == state) model_bus->fault = is_now ? state : EMU_BUS_GOOD;
  }
  if (fault->what == 'i' && (is_now || (t_s >= fault->to_s && !fault->is_done))) {
    set_identity(is_now);
    fault->is_done = t_s >= fault->to_s;
  }
  if (fault->what == 't') set_frozen(is_now);
  if (t_s < fault->from_s || fault->is_done) return;
  if (fault->what == 'r') {
    brown_out();
    fault->is_done = true;
  }
  if (fault->what == 'v') {
    fault->is_done = true;
    bus.delay_us(bus.ctx, (uint32_t)OVERRUN_US);
  }
}

static void add_fault(const char* text) {
  char name[16];
  struct fault* fault = &faults[n_faults++];
  if (n_faults > MAX_FAULTS || sscanf(text, "%15[a-z]:%lf:%lf", name, &fault->from_s, &fault->to_s) < 2)
    fail(2, "--fault wants KIND:FROM_S:TO_S, not", text);
  static const char* const names[] = {"zeros", "ones", "errors", "identity", "temperature", "reset", "overrun"};
  for (size_t i = 0; i < 7; i++)
    if (!strcmp(name, names[i])) fault->what = "zoeitrv"[i];
  if (!fault->what) fail(2, "no such fault:", name);
}

/* ---- the line ---- */

static bool read_all(int fd, uint8_t* data, size_t n) {
  for (size_t at = 0; at < n;) {
    const ssize_t got = read(fd, data + at, n - at);
    if (got <= 0) return false;
    at += (size_t)got;
  }
  return true;
}

/* Requests of one life of the device. */
static void serve(int request, int answer) {
  uint8_t head[10], out[64], back[12 + 1024];
  while (read_all(request, head, sizeof head)) {
    const size_t n_out = head[2] | (size_t)head[3] << 8, n_in = head[4] | (size_t)head[5] << 8;
    const uint32_t wait_us = head[6] | (uint32_t)head[7] << 8 | (uint32_t)head[8] << 16 | (uint32_t)head[9] << 24;
    if (n_out > sizeof out || n_in > sizeof back - 12 || !read_all(request, out, n_out)) return;
    for (int i = 0; i < n_faults; i++) apply(&faults[i]);
    imucal_status status = IMUCAL_OK;
    memset(back, 0, 12 + n_in);
    if (head[0] == 0) status = bus.transfer(bus.ctx, head[1], out, n_out, back + 12, n_in);
    if (head[0] == 1) bus.delay_us(bus.ctx, wait_us);
    if (head[0] == 2) world.begin_us = model_bus->now_us;
    back[0] = (uint8_t)status;
    back[1] = (uint8_t)((uint32_t)status >> 8);
    back[2] = world.n && now_s() >= (double)world.n;
    const uint64_t now_us = (uint64_t)model_bus->now_us;
    for (int i = 0; i < 8; i++) back[4 + i] = (uint8_t)(now_us >> 8 * i);
    if (write(answer, back, 12 + n_in) < 0) return;
  }
}

static void power_on(const char* name, double clock_error) {
  if (!strcmp(name, "icm42688p")) {
    kind = 'i', emu_icm_power_on(&model.icm), bus = emu_icm_bus(&model.icm), model_bus = &model.icm.bus;
  } else if (!strcmp(name, "mpu6050") || !strcmp(name, "mpu6500")) {
    kind = 'm', emu_mpu_power_on(&model.mpu, name[4] == '5'), bus = emu_mpu_bus(&model.mpu), model_bus = &model.mpu.bus;
  } else if (!strcmp(name, "lsm6dso")) {
    kind = 'l', emu_lsm_power_on(&model.lsm), bus = emu_lsm_bus(&model.lsm, false), model_bus = &model.lsm.bus;
  } else if (!strcmp(name, "bmi088")) {
    kind = 'b', emu_bmi_power_on(&model.bmi), bus = emu_bmi_bus(&model.bmi), model_bus = &model.bmi.bus;
  } else {
    fail(2, "no such sensor:", name);
  }
  model_bus->feel = feel;
  model_bus->clock_error = clock_error;
}

static int open_pipe(const char* prefix, const char* end, int mode) {
  char path[512];
  snprintf(path, sizeof path, "%s%s", prefix, end);
  if (mkfifo(path, 0600) && access(path, F_OK)) fail(2, "cannot make the pipe", path);
  return mode < 0 ? -1 : open(path, mode);
}

int main(int argc, char** argv) {
  double clock_error = 0;
  if (argc < 3 || argc % 2 == 0)
    fail(2, "usage: sensor_server SENSOR PREFIX [--option VALUE]..., given", argc > 1 ? argv[1] : "");
  for (int i = 3; i + 1 < argc; i += 2) {
    if (!strcmp(argv[i], "--log"))
      read_log(argv[i + 1]);
    else if (!strcmp(argv[i], "--clock-error"))
      clock_error = atof(argv[i + 1]);
    else if (!strcmp(argv[i], "--noise-dps"))
      world.noise_dps = atof(argv[i + 1]);
    else if (!strcmp(argv[i], "--noise-g"))
      world.noise_g = atof(argv[i + 1]);
    else if (!strcmp(argv[i], "--fault"))
      add_fault(argv[i + 1]);
    else
      fail(2, "unknown option", argv[i]);
  }
  power_on(argv[1], clock_error);
  (void)open_pipe(argv[2], ".answer", -1);
  (void)open_pipe(argv[2], ".request", -1);
  printf("ready\n");
  fflush(stdout);
  const int request = open_pipe(argv[2], ".request", O_RDONLY), answer = open_pipe(argv[2], ".answer", O_WRONLY);
  serve(request, answer);
  return 0;
}
