// SPDX-License-Identifier: MIT
/* A 32-bit RISC-V without floating point (rv32imac, as in CH32V, GD32VF103, ESP32-C3), in QEMU's `virt` machine: line =
 * UART, flash = a semihosting file, samples = a feed, or by a driver from a sensor model (port/arm/semihost_bus.h).
 * Arguments: those of port/mps2_an386/main.c, or sensor=mpu6050 bus=PREFIX instead of feed=PATH.  The smallest port with flash: the
 * porting guide counts its lines. */
#include "app/app.h"
#include "port/arm/semihost.h"
#include "port/arm/semihost_bus.h"
#include "port/arm/semihost_sim.h"
#include "virt.h"

#define SLOT_BYTES 1024u

void port_fault(void);

static struct {
  semihost_feed_t feed;
  sample_stream_t samples;
  uint8_t sample_bytes[20 * IMUCAL_SAMPLE_RECORD_BYTES];
  bus_sensor_t sensor;
  semihost_flash_t file;
  nor_t nor;
} device;
static imucal_app_t app;
static imucal_board_t board;

void port_fault(void) {
  semihost_print("imucal: processor fault\n");
  semihost_exit(70);
}

static size_t serial_read(void* ctx, uint8_t* data, size_t capacity) {
  (void)ctx;
  size_t n = 0;
  while (n < capacity && (UART_STATUS & 0x01)) data[n++] = UART_DATA;
  return n;
}

static size_t serial_write(void* ctx, const uint8_t* data, size_t length) {
  (void)ctx;
  size_t n = 0;
  while (n < length && (UART_STATUS & 0x20)) UART_DATA = data[n++];
  return n;
}

static imucal_port_sample_t sample_read(void* ctx, imucal_sample_t* sample) {
  (void)ctx;
  return semihost_sample_read(&device.samples, sample);
}

static void sample_enable(void* ctx, bool is_wanted) {
  (void)ctx;
  semihost_sample_enable(&device.samples, is_wanted);
}

static uint64_t time_us(void* ctx) {
  (void)ctx;
  uint32_t high, low;
  do {
    high = MTIME_HIGH;
    low = MTIME_LOW;
  } while (high != MTIME_HIGH);
  return ((uint64_t)high << 32 | low) / 10u;
}

static void watchdog(void* ctx) {
  (void)ctx;
}

static void reboot(void* ctx) {
  (void)ctx;
  virt_reset();
}

/* Board, samples and flash from the arguments. */
static imucal_flash_t set_up(imucal_port_t* port) {
  static char text[384];
  if (!semihost_command_line(text, sizeof text)) text[0] = '\0';
  board_options_default(&board);
  if (semihost_bus_sensor(&device.sensor, text, &board)) {
    port->ctx = &device.sensor;
    port->sample_read = semihost_bus_read;
    port->sample_enable = semihost_bus_enable;
    port->sensor_report = semihost_bus_report;
  }
  semihost_board(&board, text);
  semihost_feed_init(&device.feed, text, &device.samples, device.sample_bytes, sizeof device.sample_bytes);
  return semihost_flash(text, &device.file, &device.nor, SLOT_BYTES, SLOT_BYTES);
}

int main(void) {
  UART_FIFO = 0xC1; /* FIFO on; QEMU hands over up to 14 bytes at a time at this trigger level, else one */
  imucal_port_t port = {.serial_read = serial_read,
                        .serial_write = serial_write,
                        .sample_read = sample_read,
                        .sample_enable = sample_enable,
                        .time_us = time_us,
                        .watchdog = watchdog,
                        .reboot = reboot,
                        .is_replay = true,
                        .boot_id = semihost_boot_id(),
                        .device = "qemu riscv virt"};
  port.flash = set_up(&port);
  if (imucal_app_init(&app, &port, &board) != IMUCAL_OK) semihost_exit(2);
  for (;;) (void)imucal_app_step(&app); /* emulated: nothing to save by sleeping */
}
