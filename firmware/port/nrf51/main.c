// SPDX-License-Identifier: MIT
/* nRF51822 (Cortex-M0, 16 KB RAM), as on the micro:bit and in QEMU's microbit: serial line = UART0, the table
 * in the last two pages of the chip's flash through its own controller. The sensor is a semihosting file;
 * with a real one, port_sample_read is the only function to replace. Arguments (-semihosting-config arg=…):
 * feed=PATH and those of board_options.h. */
#include <string.h>

#include "app/app.h"
#include "nrf51.h"
#include "port/arm/cortexm.h"
#include "port/arm/semihost.h"
#include "port/arm/semihost_sim.h"

#define SLOT_ADDRESS(slot) (0x0003F800u + (slot)*NRF51_PAGE_BYTES)
#define TICKS_PER_US 16u
#define WAKE_IRQS (1u << NRF51_UART_IRQ | 1u << NRF51_TIMER0_IRQ)

void port_fault(void);

typedef struct {
  semihost_feed_t feed;
  sample_stream_t samples;
  uint8_t sample_bytes[12 * IMUCAL_SAMPLE_RECORD_BYTES];
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
  return nrf51_uart_read(data, capacity);
}

static size_t port_serial_write(void* ctx, const uint8_t* data, size_t length) {
  (void)ctx;
  return nrf51_uart_write(data, length);
}

static imucal_port_sample_t port_sample_read(void* ctx, imucal_sample_t* sample) {
  return semihost_sample_read(&((device_t*)ctx)->samples, sample);
}

static void port_sample_enable(void* ctx, bool is_wanted) {
  semihost_sample_enable(&((device_t*)ctx)->samples, is_wanted);
}

static uint64_t port_time_us(void* ctx) {
  device_t* self = ctx;
  const uint32_t now = nrf51_timer_ticks();
  self->ticks += now - self->last_ticks;
  self->last_ticks = now;
  return self->ticks / TICKS_PER_US;
}

static imucal_status port_flash_erase(void* ctx, uint32_t slot) {
  (void)ctx;
  nrf51_flash_erase_page(SLOT_ADDRESS(slot));
  return IMUCAL_OK; /* the controller reports nothing: the store reads back */
}

static imucal_status port_flash_program(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len) {
  (void)ctx;
  nrf51_flash_program(SLOT_ADDRESS(slot) + offset, data, len);
  return IMUCAL_OK;
}

static imucal_status port_flash_read(void* ctx, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t len) {
  (void)ctx;
  memcpy(data, (const void*)(uintptr_t)(SLOT_ADDRESS(slot) + offset), len);
  return IMUCAL_OK;
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
  char command_line[384];
  if (!semihost_command_line(command_line, sizeof command_line)) command_line[0] = '\0';
  board_options_default(&board);
  semihost_board(&board, command_line);
  semihost_feed_init(&device.feed, command_line, &device.samples, device.sample_bytes, sizeof device.sample_bytes);
}

int main(void) {
  nrf51_uart_init();
  nrf51_timer_init();
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
                                        .slot_bytes = NRF51_PAGE_BYTES,
                                        .erase_bytes = NRF51_PAGE_BYTES,
                                        .program_bytes = 4},
                              .time_us = port_time_us,
                              .watchdog = port_watchdog,
                              .reboot = port_reboot,
                              .is_replay = true,
                              .boot_id = nrf51_random(),
                              .device = "nrf51"};
  if (imucal_app_init(&app, &port, &board) != IMUCAL_OK) semihost_exit(2);
  for (;;) {
    if (imucal_app_step(&app) || app.tx_at != app.tx_end || app.is_reboot_due) continue;
    cortexm_wait(WAKE_IRQS);
    nrf51_timer_clear_wrap();
    (void)port_time_us(&device);
  }
}
