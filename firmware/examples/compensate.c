// SPDX-License-Identifier: MIT
/* Your firmware, your sensor driver, your main loop; from imucal only the table and its use: store, table, comp, crc, num.
 * The table was made elsewhere (calibrate fit) and lies at IMU_TABLES in flash as two slots; nothing is written here.
 * Yours are: imu_read, use_rates, board_serial. */
#include <string.h>

#include "comp.h"
#include "store.h"

#define IMU_TABLES 0x08004000u
#define SLOT_BYTES 0x4000u
#define N_AXES 3

int imu_read(int32_t* temp_counts, int32_t counts[N_AXES]); /* 0: nothing new */
void use_rates(const float dph[N_AXES], int is_in_span);
extern const char board_serial[IMUCAL_SERIAL_LEN];
void imu_loop(void);

static imucal_status flash_read(void* ctx, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t len) {
  (void)ctx;
  memcpy(data, (const void*)(uintptr_t)(IMU_TABLES + slot * SLOT_BYTES + offset), len);
  return IMUCAL_OK;
}

void imu_loop(void) {
  const imucal_flash_t flash = {
      .read = flash_read, .slot_bytes = SLOT_BYTES, .erase_bytes = SLOT_BYTES, .program_bytes = 4};
  static imucal_store_work_t work;
  static imucal_table_t table;
  imucal_store_report_t report;
  imucal_comp_t comp[N_AXES];
  imucal_status status = imucal_store_load(&flash, board_serial, N_AXES, &work, &table, &report);
  for (uint32_t i = 0; i < N_AXES && status == IMUCAL_OK; i++) status = imucal_comp_prepare(&comp[i], &table, i);
  if (status != IMUCAL_OK) return; /* no table of this board: go on uncompensated, and say so */
  for (;;) {
    int32_t temp_counts, counts[N_AXES];
    float dph[N_AXES];
    uint32_t flags = 0;
    if (!imu_read(&temp_counts, counts)) continue;
    for (uint32_t i = 0; i < N_AXES; i++)
      dph[i] = (float)imucal_comp_apply(&comp[i], temp_counts, counts[i], &flags) * comp[i].unit_per_lsb;
    use_rates(dph, !(flags & IMUCAL_COMP_TEMP_CLAMPED));
  }
}
