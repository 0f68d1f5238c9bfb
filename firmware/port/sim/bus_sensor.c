// SPDX-License-Identifier: MIT
#include "bus_sensor.h"

#include <string.h>

#define REQUEST_BYTES 10u
#define ANSWER_BYTES 12u
#define MAX_OUT 16u

enum { TRANSFER = 0, WAIT = 1, BEGIN = 2 };

/* ---- the bus ---- */

static void put_u16(uint8_t* to, uint32_t value) {
  to[0] = (uint8_t)value;
  to[1] = (uint8_t)(value >> 8);
}

/* One request and its answer; the status of the bus. */
static imucal_status exchange(bus_sensor_t* self, uint8_t what, uint8_t device, uint32_t wait_us, const uint8_t* out,
                              size_t n_out, uint8_t* in, size_t n_in) {
  uint8_t request[REQUEST_BYTES + MAX_OUT] = {what, device}, answer[ANSWER_BYTES];
  if (n_out > MAX_OUT) return IMUCAL_ERR_ARGUMENT;
  put_u16(request + 2, (uint32_t)n_out);
  put_u16(request + 4, (uint32_t)n_in);
  put_u16(request + 6, wait_us & 0xFFFFu);
  put_u16(request + 8, wait_us >> 16);
  for (size_t i = 0; i < n_out; i++) request[REQUEST_BYTES + i] = out[i];
  if (self->has_failed || !self->send(self->ctx, request, REQUEST_BYTES + n_out) ||
      !self->receive(self->ctx, answer, ANSWER_BYTES) || (n_in > 0 && !self->receive(self->ctx, in, n_in))) {
    self->has_failed = true;
    return IMUCAL_ERR_SENSOR;
  }
  uint64_t now_us = 0;
  for (uint32_t i = 0; i < 8; i++) now_us |= (uint64_t)answer[4 + i] << 8 * i;
  self->now_us = now_us;
  self->has_ended = answer[2] != 0;
  return (imucal_status)imucal_sensor_le16(answer);
}

static imucal_status transfer(void* ctx, uint8_t device, const uint8_t* out, size_t n_out, uint8_t* in, size_t n_in) {
  return exchange(ctx, TRANSFER, device, 0, out, n_out, in, n_in);
}

static void wait_us(void* ctx, uint32_t us) {
  (void)exchange(ctx, WAIT, 0, us, NULL, 0, NULL, 0);
}

/* ---- the sensors ---- */

/* 2000 dps and 16.4 counts per dps, in 16-bit words, as most autopilots run it. */
static const imucal_icm42688p_config_t icm_config = {.rate_hz = 1000, .filter = 1};
static const imucal_mpu6050_config_t mpu_config = {
    .rate_hz = 200, .gyro_fs_sel = 1, .accel_fs_sel = 1, .filter = 3, .identity = 0x68};
static const imucal_mpu6050_config_t mpu6500_config = {
    .rate_hz = 200, .gyro_fs_sel = 1, .accel_fs_sel = 1, .filter = 3, .identity = 0x70};
static const imucal_lsm6dso_config_t lsm_config = {.rate_hz = 208, .gyro_fs_sel = 1, .accel_range_g = 4, .filter = 1};
static const imucal_bmi088_config_t bmi_config = {.rate_hz = 400, .gyro_fs_sel = 1, .accel_fs_sel = 1};

static const struct {
  const char* name;
  const imucal_sensor_driver_t* driver;
  const void* config;
  uint32_t rate_hz, poll_us;
} kinds[] = {{"icm42688p", &imucal_icm42688p_driver, &icm_config, 1000, 20000},
             {"mpu6050", &imucal_mpu6050_driver, &mpu_config, 200, 100000},
             {"mpu6500", &imucal_mpu6050_driver, &mpu6500_config, 200, 100000},
             {"lsm6dso", &imucal_lsm6dso_driver, &lsm_config, 208, 100000},
             {"bmi088", &imucal_bmi088_driver, &bmi_config, 400, 40000}};
enum { ICM = 1, MPU, MPU_6500, LSM, BMI };

static imucal_sensor_units_t units_of(uint8_t kind) {
  const imucal_mpu6050_t mpu = {.config = mpu_config, .is_6500 = kind == MPU_6500};
  return kind == ICM   ? imucal_icm42688p_units(&icm_config)
         : kind == LSM ? imucal_lsm6dso_units(&lsm_config)
         : kind == BMI ? imucal_bmi088_units(&bmi_config)
                       : imucal_mpu6050_units(&mpu);
}

bool bus_sensor_choose(bus_sensor_t* self, const char* name, imucal_board_t* board) {
  self->kind = 0;
  for (uint8_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++)
    if (!strcmp(name, kinds[i].name)) self->kind = (uint8_t)(i + 1);
  if (!self->kind) return false;
  const imucal_sensor_units_t units = units_of(self->kind);
  imucal_board_from_sensor(board, &units, kinds[self->kind - 1].rate_hz);
  return true;
}

/* ---- samples ---- */

static void start(bus_sensor_t* self) {
  self->bus = (imucal_sensor_bus_t){
      .ctx = self, .transfer = transfer, .delay_us = wait_us, .is_spi = self->kind == ICM || self->kind == BMI};
  self->is_started = true;
  wait_us(self, 50000); /* the chip's own power-on; and the time is known */
  imucal_source_init(&self->source, kinds[self->kind - 1].driver, &self->sensor, kinds[self->kind - 1].config,
                     &self->bus, kinds[self->kind - 1].poll_us, self->now_us);
}

imucal_port_sample_t bus_sensor_read(bus_sensor_t* self, imucal_sample_t* sample) {
  if (!self->is_started) start(self);
  const imucal_port_sample_t result = imucal_source_read(&self->source, self->now_us, sample);
  if (self->has_failed) return IMUCAL_PORT_FAILED;
  if (result != IMUCAL_PORT_NO_SAMPLE) return result;
  if (self->has_ended) return IMUCAL_PORT_ENDED;
  wait_us(self, self->source.poll_us);
  return imucal_source_read(&self->source, self->now_us, sample);
}

void bus_sensor_restart_if_ended(bus_sensor_t* self) {
  if (self->has_ended) (void)exchange(self, BEGIN, 0, 0, NULL, 0, NULL, 0);
}

void bus_sensor_report(const bus_sensor_t* self, imucal_link_sensor_reply_t* report) {
  if (self->is_started) imucal_source_report(&self->source, report);
}
