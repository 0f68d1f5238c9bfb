// SPDX-License-Identifier: MIT
#include "semihost_bus.h"

#include <string.h>

#include "semihost.h"

static char prefix[140];
static int32_t request = -1, answer = -1;

static int32_t open_pipe(const char* end, uint32_t mode) {
  char path[sizeof prefix + 16];
  strcpy(path, prefix);
  strcat(path, end);
  return semihost_open(path, mode);
}

/* The request's end is opened for both directions, which does not wait; the answer's waits for the model. */
static bool send(void* ctx, const uint8_t* data, size_t n) {
  (void)ctx;
  if (request < 0) {
    request = open_pipe(".request", SEMIHOST_UPDATE);
    answer = open_pipe(".answer", SEMIHOST_READ);
  }
  return request >= 0 && answer >= 0 && semihost_write(request, data, n);
}

static bool receive(void* ctx, uint8_t* data, size_t n) {
  (void)ctx;
  for (size_t at = 0; at < n;) {
    const int32_t got = semihost_read(answer, data + at, n - at);
    if (got <= 0) return false;
    at += (size_t)got;
  }
  return true;
}

bool semihost_bus_sensor(bus_sensor_t* sensor, const char* command_line, imucal_board_t* board) {
  char name[16];
  if (!semihost_option(command_line, "sensor", name, sizeof name)) return false;
  if (!semihost_option(command_line, "bus", prefix, sizeof prefix) || !bus_sensor_choose(sensor, name, board)) {
    semihost_print("imucal: sensor=NAME needs bus=PREFIX and one of icm42688p mpu6050 mpu6500 lsm6dso bmi088\n");
    semihost_exit(2);
  }
  sensor->send = send;
  sensor->receive = receive;
  return true;
}

imucal_port_sample_t semihost_bus_read(void* ctx, imucal_sample_t* sample) {
  return bus_sensor_read(ctx, sample);
}

void semihost_bus_enable(void* ctx, bool is_wanted) {
  if (is_wanted) bus_sensor_restart_if_ended(ctx);
}

void semihost_bus_report(void* ctx, imucal_link_sensor_reply_t* report) {
  bus_sensor_report(ctx, report);
}
