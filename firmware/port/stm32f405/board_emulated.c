// SPDX-License-Identifier: MIT
/* QEMU's netduinoplus2: samples from a feed, table slots in a file, both by semihosting.  Arguments
 * (-semihosting-config arg=…): feed=PATH flash=PATH and those of port/sim/board_options.h. */
#include "board.h"
#include "port/arm/semihost.h"
#include "port/arm/semihost_sim.h"

#define PAGE_BYTES 1024u

static struct {
  semihost_feed_t feed;
  sample_stream_t samples;
  uint8_t sample_bytes[100 * IMUCAL_SAMPLE_RECORD_BYTES];
  semihost_flash_t file;
  nor_t nor;
} device;

static imucal_port_sample_t sample_read(void* ctx, imucal_sample_t* sample) {
  (void)ctx;
  stm32_watchdog_feed(); /* a pipe without data stops the machine, not its watchdog */
  return semihost_sample_read(&device.samples, sample);
}

static void sample_enable(void* ctx, bool is_wanted) {
  (void)ctx;
  if (is_wanted && semihost_feed_restart_if_ended(&device.feed)) sample_stream_clear(&device.samples);
}

static imucal_status status_of(nor_result_t result) {
  return result == NOR_OK ? IMUCAL_OK : IMUCAL_ERR_FLASH;
}

static imucal_status flash_erase(void* ctx, uint32_t slot) {
  (void)ctx;
  return status_of(nor_erase(&device.nor, slot * STM32_SLOT_BYTES, STM32_SLOT_BYTES));
}

static imucal_status flash_program(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len) {
  (void)ctx;
  return status_of(nor_program(&device.nor, slot * STM32_SLOT_BYTES + offset, data, len));
}

static imucal_status flash_read(void* ctx, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t len) {
  (void)ctx;
  return status_of(nor_read(&device.nor, slot * STM32_SLOT_BYTES + offset, data, len));
}

static void open_flash(const char* command_line) {
  char path[sizeof device.feed.path];
  device.nor.size_bytes = IMUCAL_STORE_SLOTS * STM32_SLOT_BYTES;
  device.nor.page_bytes = PAGE_BYTES;
  device.nor.word_bytes = 4;
  device.nor.cut_operation = NOR_NEVER;
  nor_power_on(&device.nor);
  if (semihost_option(command_line, "flash", path, sizeof path) && semihost_flash_open(&device.file, &device.nor, path))
    return;
  semihost_print("imucal: argument flash=PATH is missing, or the file cannot be used\n");
  semihost_exit(2);
}

void board_init(imucal_port_t* port, imucal_board_t* board, const stm32_clocks_t* clocks) {
  char command_line[512];
  (void)clocks;
  if (!semihost_command_line(command_line, sizeof command_line)) command_line[0] = '\0';
  board_options_default(board);
  semihost_board(board, command_line);
  device.feed.file = -1;
  if (!semihost_option(command_line, "feed", device.feed.path, sizeof device.feed.path)) device.feed.path[0] = '\0';
  device.samples.ctx = &device.feed;
  device.samples.refill = semihost_feed_refill;
  device.samples.buffer = device.sample_bytes;
  device.samples.capacity = sizeof device.sample_bytes;
  open_flash(command_line);
  port->sample_read = sample_read;
  port->sample_enable = sample_enable;
  port->flash = (imucal_flash_t){.erase = flash_erase,
                                 .program = flash_program,
                                 .read = flash_read,
                                 .slot_bytes = STM32_SLOT_BYTES,
                                 .erase_bytes = STM32_SLOT_BYTES,
                                 .program_bytes = 4};
  port->is_replay = true;
  port->boot_id = semihost_boot_id();
  port->device = "qemu stm32f405";
}
