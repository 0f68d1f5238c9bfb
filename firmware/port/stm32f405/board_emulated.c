// SPDX-License-Identifier: MIT
/* QEMU's netduinoplus2: samples from a feed, or by a driver from a sensor model (port/arm/semihost_bus.h), table slots in a
 * file, all by semihosting.  Arguments (-semihosting-config arg=…): flash=PATH, feed=PATH or sensor=NAME bus=PREFIX, and those
 * of port/sim/board_options.h. */
#include "board.h"
#include "port/arm/semihost.h"
#include "port/arm/semihost_bus.h"
#include "port/arm/semihost_sim.h"

#define PAGE_BYTES 1024u

static struct {
  semihost_feed_t feed;
  sample_stream_t samples;
  uint8_t sample_bytes[100 * IMUCAL_SAMPLE_RECORD_BYTES];
  bus_sensor_t sensor;
  semihost_flash_t file;
  nor_t nor;
} device;

static imucal_port_sample_t sample_read(void* ctx, imucal_sample_t* sample) {
  (void)ctx;
  stm32_watchdog_feed(); /* a pipe without data stops the machine, not its watchdog */
  return semihost_sample_read(&device.samples, sample);
}

static imucal_port_sample_t bus_read(void* ctx, imucal_sample_t* sample) {
  stm32_watchdog_feed();
  return semihost_bus_read(ctx, sample);
}

static void sample_enable(void* ctx, bool is_wanted) {
  (void)ctx;
  semihost_sample_enable(&device.samples, is_wanted);
}

void board_init(imucal_port_t* port, imucal_board_t* board, const stm32_clocks_t* clocks) {
  char command_line[512];
  (void)clocks;
  if (!semihost_command_line(command_line, sizeof command_line)) command_line[0] = '\0';
  board_options_default(board);
  const bool has_bus = semihost_bus_sensor(&device.sensor, command_line, board);
  semihost_board(board, command_line);
  semihost_feed_init(&device.feed, command_line, &device.samples, device.sample_bytes, sizeof device.sample_bytes);
  port->sample_read = sample_read;
  port->sample_enable = sample_enable;
  if (has_bus) {
    port->ctx = &device.sensor;
    port->sample_read = bus_read;
    port->sample_enable = semihost_bus_enable;
    port->sensor_report = semihost_bus_report;
  }
  port->flash = semihost_flash(command_line, &device.file, &device.nor, STM32_SLOT_BYTES, PAGE_BYTES);
  port->is_replay = true;
  port->boot_id = semihost_boot_id();
  port->device = "qemu stm32f405";
}
