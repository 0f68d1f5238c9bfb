// SPDX-License-Identifier: MIT
/* The chip: a sensor (board_icm42688p.c or board_mpu6050.c) and a place for the tables (board_store_*.c). */
#include <string.h>

#include "board.h"

static board_sensor_t sensor;
static imucal_source_t source;

/* A sensor that fails is counted as a bad sample once per second and started again; the line stays alive. */
static imucal_port_sample_t sample_read(void* ctx, imucal_sample_t* sample) {
  (void)ctx;
  return imucal_source_read(&source, stm32_time_us(), sample);
}

static void sensor_report(void* ctx, imucal_link_sensor_reply_t* report) {
  (void)ctx;
  imucal_source_report(&source, report);
  report->is_supply_low = !stm32_supply_is_good();
  report->supply_refused = board_store_supply_refused();
}

static void put_hex(char* to, uint32_t value, uint32_t digits) {
  for (uint32_t i = 0; i < digits; i++) to[i] = "0123456789ABCDEF"[value >> 4 * (digits - 1 - i) & 0xFu];
}

/* `calibrate info` shows the name: an external flash that cannot be used, a supply below 2.9 V, the crystal that is missing, the
 * place of the last fault; the last of these that is so. */
static const char* device_name(const stm32_clocks_t* clocks, bool has_supply, const char* store_trouble) {
  static char name[24];
  strcpy(name, "stm32f405");
  if (store_trouble) strcat(strcat(name, " "), store_trouble);
  if (!has_supply) strcpy(name, "stm32f405 low supply");
  if (!clocks->is_crystal) strcpy(name, "stm32f405 no crystal");
  if (stm32_was_fault()) {
    strcpy(name, "stm32f405 fault ");
    put_hex(name + 16, stm32_record()->fault.pc & 0xFFFFFFu, 6);
    name[22] = '\0';
  }
  return name;
}

static void describe(imucal_board_t* board) {
  static const char names[6][8] = {"gx_dph", "gy_dph", "gz_dph", "ax_mg", "ay_mg", "az_mg"};
  put_hex(board->serial, reg_read(DEVICE_UID) ^ reg_read(DEVICE_UID + 8u), 8); /* wafer place and lot number */
  imucal_board_from_sensor(board, &sensor.units, sensor.rate_hz);
  for (uint32_t i = 0; i < 6; i++) memcpy(board->channel[i].name, names[i], sizeof names[i]);
}

void board_init(imucal_port_t* port, imucal_board_t* board, const stm32_clocks_t* clocks) {
  const bool has_supply = stm32_supply_init() == IMUCAL_OK;
  const board_store_t store = board_store_init(clocks);
  sensor = board_sensor_init(clocks);
  imucal_source_init(&source, sensor.driver, sensor.state, sensor.config, sensor.bus, sensor.poll_us, stm32_time_us());
  port->sample_read = sample_read;
  port->sensor_report = sensor_report;
  port->flash = store.flash;
  port->boot_id = stm32_random();
  port->device = device_name(clocks, has_supply, store.trouble);
  describe(board);
}
