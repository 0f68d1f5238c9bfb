// SPDX-License-Identifier: MIT
/* A slow turn while the board warms up: 20 degC and 0.1 degC/s for 200 s; the x gyro's bias goes with it. */
#include "wire_model.h"

#include "emu/mpu6050.h"

static emu_mpu_t mpu;
static int is_present;

static void feel(void* ctx, uint64_t k, double t_us, emu_world_t* world) {
  (void)ctx;
  const double t_s = t_us * 1e-6 < 200.0 ? t_us * 1e-6 : 200.0;
  world->temp_degc = 20.0 + 0.1 * t_s;
  world->rate_dps[0] = 1.0 + 0.002 * t_s + 0.05 * emu_noise(k, 1);
  world->rate_dps[1] = -2.0 + 0.05 * emu_noise(k, 2);
  world->rate_dps[2] = 0.05 * emu_noise(k, 3);
  world->accel_g[2] = 1.0 + 0.002 * emu_noise(k, 4);
}

void wire_model_power_on(int is_there) {
  emu_mpu_power_on(&mpu, false);
  mpu.bus.feel = feel;
  is_present = is_there;
}

int wire_model_transfer(double now_us, const uint8_t* out, size_t n_out, uint8_t* in, size_t n_in) {
  if (!is_present) return 2;
  if (now_us > mpu.bus.now_us) emu_mpu_advance(&mpu, now_us - mpu.bus.now_us);
  const imucal_sensor_bus_t bus = emu_mpu_bus(&mpu);
  return bus.transfer(bus.ctx, 0, out, n_out, in, n_in) == IMUCAL_OK ? 0 : 2;
}
