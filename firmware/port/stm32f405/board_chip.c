// SPDX-License-Identifier: MIT
/* The chip: ICM-42688-P on SPI1 at 1 kHz, the table in sectors 1 and 2 of its flash. */
#include <string.h>

#include "board.h"
#include "sensors/icm42688p.h"
#include "sensors/source.h"

#define SPI_HZ 10500000u
#define RATE_HZ 1000u
#define POLL_US 5000u

static struct {
  imucal_sensor_bus_t bus;
  imucal_icm42688p_t icm;
  imucal_source_t source;
} sensor;

static const imucal_icm42688p_config_t config = {.rate_hz = RATE_HZ, .is_high_resolution = true, .filter = 1};

static imucal_status transfer(void* ctx, uint8_t device, const uint8_t* out, size_t n_out, uint8_t* in, size_t n_in) {
  (void)ctx, (void)device;
  return stm32_spi_transfer(out, n_out, in, n_in);
}

static void delay_us(void* ctx, uint32_t us) {
  (void)ctx;
  stm32_delay_us(us);
}

/* A sensor that fails is counted as a bad sample once per second and started again; the line stays alive. */
static imucal_port_sample_t sample_read(void* ctx, imucal_sample_t* sample) {
  (void)ctx;
  return imucal_source_read(&sensor.source, stm32_time_us(), sample);
}

static void sensor_report(void* ctx, imucal_link_sensor_reply_t* report) {
  (void)ctx;
  imucal_source_report(&sensor.source, report);
  report->is_supply_low = !stm32_supply_is_good();
  report->supply_refused = stm32_supply_refused();
}

static imucal_status flash_erase(void* ctx, uint32_t slot) {
  (void)ctx;
  return stm32_flash_erase(slot);
}

static imucal_status flash_program(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len) {
  (void)ctx;
  return stm32_flash_program(slot, offset, data, len);
}

static imucal_status flash_read(void* ctx, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t len) {
  (void)ctx;
  memcpy(data, reg_memory(STM32_SLOT_ADDRESS(slot) + offset), len);
  return IMUCAL_OK;
}

static void put_hex(char* to, uint32_t value, uint32_t digits) {
  for (uint32_t i = 0; i < digits; i++) to[i] = "0123456789ABCDEF"[value >> 4 * (digits - 1 - i) & 0xFu];
}

/* `calibrate info` shows the name: a supply below 2.9 V, the crystal that is missing, the place of the last fault. */
static const char* device_name(const stm32_clocks_t* clocks, bool has_supply) {
  static char name[24] = "stm32f405";
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
  const imucal_sensor_units_t units = imucal_icm42688p_units(&config);
  put_hex(board->serial, reg_read(DEVICE_UID) ^ reg_read(DEVICE_UID + 8u), 8); /* wafer place and lot number */
  board->n_channels = 6;
  board->rate_hz = RATE_HZ;
  board->degc_per_count = units.degc_per_count;
  board->degc_at_zero = units.degc_at_zero;
  for (uint32_t i = 0; i < 6; i++) {
    memcpy(board->channel[i].name, names[i], sizeof names[i]);
    board->channel[i].unit_per_count = i < 3 ? units.dps_per_count * 3600.0f : units.g_per_count * 1000.0f;
    board->channel[i].full_scale_counts = i < 3 ? units.gyro_rail_counts : units.accel_rail_counts;
  }
}

void board_init(imucal_port_t* port, imucal_board_t* board, const stm32_clocks_t* clocks) {
  const bool has_supply = stm32_supply_init() == IMUCAL_OK;
  stm32_spi_init(clocks->apb2_hz, SPI_HZ);
  sensor.bus = (imucal_sensor_bus_t){.transfer = transfer, .delay_us = delay_us, .is_spi = true};
  imucal_source_init(&sensor.source, &imucal_icm42688p_driver, &sensor.icm, &config, &sensor.bus, POLL_US,
                     stm32_time_us());
  port->sample_read = sample_read;
  port->sensor_report = sensor_report;
  port->flash = (imucal_flash_t){.erase = flash_erase,
                                 .program = flash_program,
                                 .read = flash_read,
                                 .slot_bytes = STM32_SLOT_BYTES,
                                 .erase_bytes = STM32_SLOT_BYTES,
                                 .program_bytes = 4};
  port->boot_id = stm32_random();
  port->device = device_name(clocks, has_supply);
  describe(board);
}
