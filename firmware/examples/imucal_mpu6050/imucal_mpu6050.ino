// SPDX-License-Identifier: MIT
/* An MPU-6050 on a hobby board that speaks the link: `calibrate --port /dev/ttyACM0 info` works with it.
 * Board: 32 KB of RAM and a processor of 32 bits (ESP32, RP2040, Teensy, SAMD, STM32), EEPROM library of 2052 bytes; on
 * cores without EEPROM.begin and commit delete these lines.  Wiring: SDA, SCL, 3V3, GND; AD0 low (address 68h).
 * To build: copy common/, firmware/app and firmware/sensors into the sketch's folder src/ and add src/common and src to the
 * include path, or make a library of them.  Compiled here for a Cortex-M4, and run on a PC against a modelled MPU-6050 over a
 * pseudo-terminal (tests/system/test_arduino_sketch.py); never run on a board. */
#include <EEPROM.h>
#include <Wire.h>

#include "app/app.h"
#include "sensors/mpu6050.h"
#include "sensors/source.h"

static const uint8_t ADDRESS = 0x68;
static const uint32_t SLOT_BYTES = 1024;
static const uint32_t N_STARTS_AT = 2 * SLOT_BYTES;
static imucal_mpu6050_t sensor;
static imucal_source_t source; /* starts the sensor again when it fails, and counts */
static imucal_app_t app;
static imucal_board_t board;
static imucal_port_t port;
static bool is_restart_due;

static imucal_status transfer(void*, uint8_t, const uint8_t* out, size_t n_out, uint8_t* in, size_t n_in) {
  Wire.beginTransmission(ADDRESS);
  Wire.write(out, n_out);
  if (Wire.endTransmission(n_in == 0) != 0) return IMUCAL_ERR_SENSOR;
  if (n_in > 0 && Wire.requestFrom(ADDRESS, n_in) != n_in) return IMUCAL_ERR_SENSOR;
  for (size_t i = 0; i < n_in; i++) in[i] = (uint8_t)Wire.read();
  return IMUCAL_OK;
}

static void wait_us(void*, uint32_t us) {
  delay(us / 1000);
  delayMicroseconds(us % 1000);
}

static uint64_t time_us(void*) {
  static uint32_t last;
  static uint64_t total;
  const uint32_t now = micros(); /* wraps after 71 minutes */
  total += now - last;
  last = now;
  return total;
}

static imucal_port_sample_t sample_read(void*, imucal_sample_t* sample) {
  return imucal_source_read(&source, time_us(nullptr), sample);
}

static void sensor_report(void*, imucal_link_sensor_reply_t* report) {
  imucal_source_report(&source, report);
}

static size_t serial_read(void*, uint8_t* data, size_t capacity) {
  size_t n = 0;
  while (n < capacity && Serial.available() > 0) data[n++] = (uint8_t)Serial.read();
  return n;
}

static size_t serial_write(void*, const uint8_t* data, size_t length) {
  const int room = Serial.availableForWrite();
  return room <= 0 ? 0 : Serial.write(data, (size_t)room < length ? (size_t)room : length);
}

/* Where the EEPROM library rewrites a whole sector at commit, a power cut in it costs both tables: what store.h promises
 * needs flash of two slots that are erased apart. */
static imucal_status flash_program(void*, uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t n) {
  for (uint32_t i = 0; i < n; i++) EEPROM.write((int)(slot * SLOT_BYTES + offset + i), data[i]);
  return EEPROM.commit() ? IMUCAL_OK : IMUCAL_ERR_FLASH;
}

static imucal_status flash_erase(void*, uint32_t slot) {
  for (uint32_t i = 0; i < SLOT_BYTES; i++) EEPROM.write((int)(slot * SLOT_BYTES + i), 0xFF);
  return EEPROM.commit() ? IMUCAL_OK : IMUCAL_ERR_FLASH;
}

static imucal_status flash_read(void*, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t n) {
  for (uint32_t i = 0; i < n; i++) data[i] = EEPROM.read((int)(slot * SLOT_BYTES + offset + i));
  return IMUCAL_OK;
}

static void nothing(void*) {
}

/* loop() does it, behind the step that sent the reply. */
static void reboot(void*) {
  is_restart_due = true;
}

/* No start is numbered as the one before: a frame from before it must do nothing. */
static uint32_t count_start() {
  uint32_t n_starts = 0;
  for (int i = 0; i < 4; i++) n_starts |= (uint32_t)EEPROM.read((int)N_STARTS_AT + i) << 8 * i;
  n_starts++;
  for (int i = 0; i < 4; i++) EEPROM.write((int)N_STARTS_AT + i, (uint8_t)(n_starts >> 8 * i));
  EEPROM.commit();
  return n_starts;
}

static bool start_app() {
  port.boot_id = count_start();
  return imucal_app_init(&app, &port, &board) == IMUCAL_OK;
}

/* 200 Hz, 500 dps, 4 g, 42 Hz, WHO_AM_I 68h alone: for an MPU-6500 write 0x70 and sensor.is_6500 = true. */
static const imucal_mpu6050_config_t config = {200, 1, 1, 3, 0x68};

static bool describe_board() {
  sensor.config = config; /* what a count means is known before any sensor answers */
  static const char* const names[6] = {"gx_dph", "gy_dph", "gz_dph", "ax_mg", "ay_mg", "az_mg"};
  const imucal_sensor_units_t units = imucal_mpu6050_units(&sensor);
  bool is_good = imucal_text_set(board.serial, sizeof board.serial, "hobby-1") == IMUCAL_OK; /* yours */
  board.n_channels = 6;
  board.rate_hz = config.rate_hz;
  board.degc_per_count = units.degc_per_count;
  board.degc_at_zero = units.degc_at_zero;
  for (int i = 0; i < 6; i++) {
    is_good = is_good && imucal_text_set(board.channel[i].name, sizeof board.channel[i].name, names[i]) == IMUCAL_OK;
    board.channel[i].unit_per_count = i < 3 ? units.dps_per_count * 3600.0f : units.g_per_count * 1000.0f;
    board.channel[i].full_scale_counts = i < 3 ? units.gyro_rail_counts : units.accel_rail_counts;
  }
  return is_good;
}

void setup() {
  static const imucal_sensor_bus_t bus = {nullptr, transfer, wait_us, false};
  Serial.begin(115200);
  EEPROM.begin(N_STARTS_AT + 4);
  Wire.begin();
  Wire.setClock(400000);
  /* Where no MPU-6050 answers at 68h the line works all the same, and `calibrate info` says so. */
  imucal_source_init(&source, &imucal_mpu6050_driver, &sensor, &config, &bus, 5000, time_us(nullptr));
  source.capacity = 2; /* 28 bytes: what every Wire library takes at once */
  port.serial_read = serial_read;
  port.serial_write = serial_write;
  port.sample_read = sample_read;
  port.sensor_report = sensor_report;
  port.flash.erase = flash_erase;
  port.flash.program = flash_program;
  port.flash.read = flash_read;
  port.flash.slot_bytes = port.flash.erase_bytes = SLOT_BYTES;
  port.flash.program_bytes = 4;
  port.time_us = time_us;
  port.watchdog = nothing;
  port.reboot = reboot;
  port.device = "arduino mpu6050";
  if (!describe_board() || !start_app())
    for (;;) delay(1000);
}

void loop() {
  imucal_app_step(&app);
  if (!is_restart_due) return;
  is_restart_due = false;
  start_app();
}
