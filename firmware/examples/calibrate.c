// SPDX-License-Identifier: MIT
/* Your firmware learns by itself, without the link: samples -> seconds -> filters -> table -> flash.  Beside what
 * compensate.c takes: sum, track, health, kf, learn and the writing half of store.  Yours are: imu_sample, is_done, and the flash. */
#include "learn.h"
#include "store.h"

#define N_AXES 3

int imu_sample(imucal_sample_t* sample); /* 0: nothing new */
int is_done(void);
void imu_loop(void);
extern imucal_flash_t imu_flash; /* two slots of your flash: common/store.h says what they must do */
extern imucal_table_t imu_table; /* serial, degc_per_count, names, unit_per_count, full_scale_counts, arw: set by you */
extern const imucal_kf_config_t imu_model; /* order, range, m, q, r: `calibrate run` prints those of an error model */

static void learn_second(const imucal_sum_t* sum, const imucal_second_t* second, imucal_thermometer_t* thermometer,
                         imucal_learn_t learn[N_AXES]) {
  imucal_thermometer_read(thermometer, second);
  for (uint32_t i = 0; i < N_AXES; i++) {
    const float mean = imucal_unit_from_q16(imucal_mean_q16_rne(second->sum[i], second->n_samples),
                                            imu_table.channel[i].unit_per_count, 0.0f);
    (void)imucal_learn_second(&learn[i], thermometer, sum, second, i, mean);
  }
}

void imu_loop(void) {
  static imucal_learn_t learn[N_AXES];
  static imucal_store_work_t work;
  static imucal_sum_t sum;
  imucal_thermometer_t thermometer;
  imucal_second_t second;
  imucal_sample_t sample;
  imucal_store_report_t report;
  imucal_status status = imucal_sum_init(&sum, N_AXES, 1000);
  imucal_thermometer_init(&thermometer, imu_table.degc_per_count, imu_table.degc_at_zero);
  for (uint32_t i = 0; i < N_AXES && status == IMUCAL_OK; i++) status = imucal_learn_init(&learn[i], &imu_model);
  while (status >= IMUCAL_OK && !is_done()) {
    if (!imu_sample(&sample)) continue;
    if (imucal_sum_add(&sum, &sample, &second) == IMUCAL_SECOND_READY) learn_second(&sum, &second, &thermometer, learn);
  }
  for (uint32_t i = 0; i < N_AXES && status == IMUCAL_OK; i++)
    status = imucal_table_from_kf(&imu_table.channel[i], &learn[i].kf, 0.0f, 60.0f);
  if (status == IMUCAL_OK)
    status =
        imucal_store_write(&imu_flash, imu_table.serial, N_AXES, IMUCAL_STORE_NO_ORIGIN, &work, &imu_table, &report);
}
