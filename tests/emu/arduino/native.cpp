// SPDX-License-Identifier: MIT
// The Arduino API that the sketch uses, on this machine: Serial is a pseudo-terminal whose name is printed, Wire leads to a
// modelled MPU-6050, EEPROM is a file.  A turn of loop() takes 0.5 ms of the board's time, which runs up to 50 times as fast as
// ours: tests are short, and a machine that is busy makes the board slow but never late.  Once set up, the board waits for its first
// byte before its time goes on: it has not warmed up when a busy machine is late to talk to it.
//
// usage: sketch EEPROM_FILE [--no-sensor]
#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include <cstdio>

#include "EEPROM.h"
#include "Wire.h"
#include "wire_model.h"

void setup();
void loop();

HardwareSerial Serial;
TwoWire Wire;
EEPROMClass EEPROM;

namespace {

constexpr double kSpeed = 50.0, kSlack_us = 1e5, kTurn_us = 500.0;
int pty = -1;
const char* eeprom_path;
uint8_t eeprom[2052];

constexpr size_t kWireBytes = 32; // the smallest buffer among the cores' Wire libraries
uint8_t out[kWireBytes], in[kWireBytes];
size_t n_out, n_in, at_in;

double now_us; // of the board

double real_us() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  static const timespec start = now;
  return static_cast<double>(now.tv_sec - start.tv_sec) * 1e6 + static_cast<double>(now.tv_nsec - start.tv_nsec) * 1e-3;
}

// The board's time never waits for ours, ours for the board's: late turns are not made up for.
void wait_us(double us) {
  static double slack_us = 0; // how far the board's time may still run before ours has caught up
  static double last_us = 0;
  now_us += us;
  const double real = real_us();
  slack_us = slack_us + (real - last_us) * kSpeed > kSlack_us ? kSlack_us : slack_us + (real - last_us) * kSpeed;
  last_us = real;
  slack_us -= us;
  if (slack_us < 0) usleep(static_cast<useconds_t>(-slack_us / kSpeed) + 1);
}

} // namespace

unsigned long micros() {
  return static_cast<uint32_t>(static_cast<uint64_t>(now_us)); // 32 bits on every board
}
void delayMicroseconds(unsigned int us) {
  if (us > 0) wait_us(us);
}
void delay(unsigned long ms) {
  if (ms > 0) wait_us(static_cast<double>(ms) * 1e3);
}

void HardwareSerial::begin(unsigned long) {
  pty = posix_openpt(O_RDWR | O_NOCTTY);
  if (pty < 0 || grantpt(pty) || unlockpt(pty)) exit(2);
  termios raw{};
  tcgetattr(pty, &raw);
  cfmakeraw(&raw);
  tcsetattr(pty, TCSANOW, &raw);
  fcntl(pty, F_SETFL, O_NONBLOCK);
  std::printf("serial %s\n", ptsname(pty));
  std::fflush(stdout);
}
int HardwareSerial::available() {
  int n = 0;
  return ioctl(pty, FIONREAD, &n) ? 0 : n;
}
int HardwareSerial::read() {
  uint8_t byte = 0;
  return ::read(pty, &byte, 1) == 1 ? byte : -1;
}
int HardwareSerial::availableForWrite() {
  pollfd line{pty, POLLOUT, 0};
  return poll(&line, 1, 0) == 1 && (line.revents & POLLOUT) ? 63 : 0;
}
size_t HardwareSerial::write(const uint8_t* data, size_t n) {
  const ssize_t written = ::write(pty, data, n);
  return written < 0 ? 0 : static_cast<size_t>(written);
}
void HardwareSerial::flush() {}

void TwoWire::begin() {}
void TwoWire::setClock(uint32_t) {}
void TwoWire::beginTransmission(uint8_t) {
  n_out = 0;
}
size_t TwoWire::write(const uint8_t* data, size_t n) {
  if (n > kWireBytes) n = kWireBytes;
  memcpy(out, data, n);
  n_out = n;
  return n;
}
// With a stop the transaction is done; without one the read that follows does it.
uint8_t TwoWire::endTransmission(bool stop) {
  return stop ? static_cast<uint8_t>(wire_model_transfer(now_us, out, n_out, nullptr, 0)) : 0;
}
uint8_t TwoWire::requestFrom(uint8_t, size_t n) {
  if (n > kWireBytes || wire_model_transfer(now_us, out, n_out, in, n)) return 0;
  at_in = 0;
  n_in = n;
  return static_cast<uint8_t>(n);
}
int TwoWire::read() {
  return at_in < n_in ? in[at_in++] : -1;
}

void EEPROMClass::begin(size_t) {
  memset(eeprom, 0xFF, sizeof eeprom);
  if (FILE* file = std::fopen(eeprom_path, "rb")) {
    if (std::fread(eeprom, 1, sizeof eeprom, file) != sizeof eeprom) memset(eeprom, 0xFF, sizeof eeprom);
    (void)std::fclose(file);
  }
}
uint8_t EEPROMClass::read(int at) {
  return eeprom[at];
}
void EEPROMClass::write(int at, uint8_t value) {
  eeprom[at] = value;
}
bool EEPROMClass::commit() {
  FILE* file = std::fopen(eeprom_path, "wb");
  if (!file) return false;
  const bool is_good = std::fwrite(eeprom, 1, sizeof eeprom, file) == sizeof eeprom;
  return std::fclose(file) == 0 && is_good;
}

int main(int argc, char** argv) {
  bool has_sensor = true;
  if (argc < 2) {
    std::fprintf(stderr, "usage: sketch EEPROM_FILE [--no-sensor]\n");
    return 2;
  }
  eeprom_path = argv[1];
  for (int i = 2; i < argc; i++)
    if (!strcmp(argv[i], "--no-sensor")) has_sensor = false;
  wire_model_power_on(has_sensor);
  setup();
  while (Serial.available() == 0) usleep(1000);
  for (;;) {
    loop();
    wait_us(kTurn_us);
  }
}
