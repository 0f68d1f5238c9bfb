// SPDX-License-Identifier: MIT
/* ARM MPS2+ AN386 (Cortex-M4F), as QEMU models it: serial line = UART0, sensor and flash = semihosting files.
 * Arguments (-semihosting-config arg=…): feed=PATH flash=PATH flash-delay-us=N and those of board_options.h.
 */
#include "app/app.h"
#include "port/arm/cmsdk.h"
#include "port/arm/cortexm.h"
#include "port/arm/semihost.h"
#include "port/arm/semihost_sim.h"

#define SLOT_BYTES 4096u
#define PAGE_BYTES 1024u
#define TICKS_PER_US (CMSDK_CLOCK_HZ / 1000000u)
#define WAKE_IRQS (1u << CMSDK_UART0_RX_IRQ | 1u << CMSDK_TIMER0_IRQ)

void port_fault(void);

typedef struct {
  semihost_feed_t feed;
  sample_stream_t samples;
  uint8_t sample_bytes[100 * IMUCAL_SAMPLE_RECORD_BYTES];
  semihost_flash_t flash_file;
  nor_t nor;
  uint32_t flash_delay_us;
  uint32_t last_ticks;
  uint64_t ticks;
} device_t;

static device_t device;
static imucal_app_t app;
static imucal_board_t board;

void port_fault(void) {
  semihost_print("imucal: processor fault\n");
  semihost_exit(70);
}

/* ---- callbacks ---- */

static size_t port_serial_read(void* ctx, uint8_t* data, size_t capacity) {
  (void)ctx;
  return cmsdk_uart_read(data, capacity);
}

static size_t port_serial_write(void* ctx, const uint8_t* data, size_t length) {
  (void)ctx;
  return cmsdk_uart_write(data, length);
}

static imucal_port_sample_t port_sample_read(void* ctx, imucal_sample_t* sample) {
  return semihost_sample_read(&((device_t*)ctx)->samples, sample);
}

static void port_sample_enable(void* ctx, bool is_wanted) {
  semihost_sample_enable(&((device_t*)ctx)->samples, is_wanted);
}

static uint64_t port_time_us(void* ctx) {
  device_t* self = ctx;
  const uint32_t now = cmsdk_timer_ticks();
  self->ticks += now - self->last_ticks;
  self->last_ticks = now;
  return self->ticks / TICKS_PER_US;
}

static void flash_delay(device_t* self) {
  const uint64_t end_us = port_time_us(self) + self->flash_delay_us;
  while (port_time_us(self) < end_us) {
  }
}

static imucal_status port_flash_erase(void* ctx, uint32_t slot) {
  device_t* self = ctx;
  flash_delay(self);
  return semihost_flash_erase(&self->nor, slot);
}

/* Word by word, as a chip does: killing the emulator in between is a power cut. */
static imucal_status port_flash_program(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len) {
  device_t* self = ctx;
  imucal_status status = IMUCAL_OK;
  for (uint32_t at = 0; at < len && status == IMUCAL_OK; at += SEMIHOST_WORD_BYTES) {
    flash_delay(self);
    status = semihost_flash_program(&self->nor, slot, offset + at, data + at, SEMIHOST_WORD_BYTES);
  }
  return status;
}

static imucal_status port_flash_read(void* ctx, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t len) {
  return semihost_flash_read(&((device_t*)ctx)->nor, slot, offset, data, len);
}

static void port_watchdog(void* ctx) {
  (void)ctx;
}

static void port_reboot(void* ctx) {
  (void)ctx;
  cortexm_reset();
}

/* ---- start ---- */

static void read_arguments(void) {
  char command_line[512];
  if (!semihost_command_line(command_line, sizeof command_line)) command_line[0] = '\0';
  board_options_default(&board);
  semihost_board(&board, command_line);
  semihost_feed_init(&device.feed, command_line, &device.samples, device.sample_bytes, sizeof device.sample_bytes);
  device.flash_delay_us = semihost_option_u32(command_line, "flash-delay-us", 0);
  /* Opened; what it does is done by the callbacks above, after a delay. */
  (void)semihost_flash(command_line, &device.flash_file, &device.nor, SLOT_BYTES, PAGE_BYTES);
}

int main(void) {
  cmsdk_uart_init();
  cmsdk_timer_init();
  read_arguments();
  const imucal_port_t port = {.ctx = &device,
                              .serial_read = port_serial_read,
                              .serial_write = port_serial_write,
                              .sample_read = port_sample_read,
                              .sample_enable = port_sample_enable,
                              .flash = {.erase = port_flash_erase,
                                        .program = port_flash_program,
                                        .read = port_flash_read,
                                        .ctx = &device,
                                        .slot_bytes = SLOT_BYTES,
                                        .erase_bytes = PAGE_BYTES,
                                        .program_bytes = SEMIHOST_WORD_BYTES},
                              .time_us = port_time_us,
                              .watchdog = port_watchdog,
                              .reboot = port_reboot,
                              .is_replay = true,
                              .boot_id = semihost_boot_id(),
                              .device = "qemu mps2-an386"};
  if (imucal_app_init(&app, &port, &board) != IMUCAL_OK) semihost_exit(2);
  for (;;) {
    if (imucal_app_step(&app) || app.tx_at != app.tx_end || app.is_reboot_due) continue;
    cortexm_wait(WAKE_IRQS);
    cmsdk_timer_clear_wrap();
    (void)port_time_us(&device);
  }
}
