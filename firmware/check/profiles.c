// SPDX-License-Identifier: MIT
/* The filter's own prediction of the calibration error for the profiles of the paper's Figures 7 to 9 (it does not
 * depend on the rates measured): 0 to 60 degC at 0.6 degC/min with soaks at both ends, up and down by turns. */
#include "check.h"
#include "kf.h"
#include "num.h"
#include "reference.h"

#define RAMP_S 6000u
#define DEGC_PER_S 0.01f

static imucal_kf_t filter;

/* One way, soak - ramp - soak. */
static void run_once(uint32_t soak_s, bool is_down, const check_io_t* io) {
  for (uint32_t t = 0; t < RAMP_S + 2 * soak_s; t++) {
    uint32_t on_ramp_s = t < soak_s ? 0 : t - soak_s;
    if (on_ramp_s > RAMP_S) on_ramp_s = RAMP_S;
    const uint32_t at = is_down ? RAMP_S - on_ramp_s : on_ramp_s;
    if (imucal_kf_update(&filter, 0.0f, (float)at * DEGC_PER_S) != IMUCAL_OK) check_text(io, "error: refused\n");
  }
}

static void report(const check_io_t* io, uint32_t soak_min, uint32_t n_cycles) {
  const imucal_kf_config_t config = REFERENCE_FILTER(3);
  if (imucal_kf_init(&filter, &config) != IMUCAL_OK) check_text(io, "error: init\n");
  for (uint32_t cycle = 0; cycle < n_cycles; cycle++) run_once(soak_min * 60u, cycle % 2 == 1, io);
  check_text(io, "profile");
  check_number(io, soak_min);
  check_number(io, n_cycles);
  for (uint32_t degc = 0; degc <= 60; degc += 5)
    check_hex(io, imucal_bits_from_float(imucal_kf_bias_sigma(&filter, (float)degc)));
  check_hex(io, imucal_bits_from_float(imucal_kf_worst_sigma(&filter, 0.0f, 60.0f, 121, NULL)));
  check_text(io, "\n");
}

void check_profiles(const check_io_t* io) {
  static const uint8_t soak_min[] = {0, 5, 10, 20, 30}, n_cycles[] = {2, 4, 8};
  for (uint32_t i = 0; i < sizeof soak_min; i++) report(io, soak_min[i], 1);
  for (uint32_t i = 0; i < sizeof n_cycles; i++) report(io, 20, n_cycles[i]);
  check_text(io, "end\n");
}
