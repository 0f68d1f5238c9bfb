// SPDX-License-Identifier: MIT
/* What the sketch uses of the Arduino API, declared; native.cpp runs it on a PC. */
#pragma once
#include <stddef.h>
#include <stdint.h>
unsigned long micros();
void delayMicroseconds(unsigned int us);
void delay(unsigned long ms);
struct HardwareSerial {
  void begin(unsigned long baud);
  int available();
  int read();
  int availableForWrite();
  size_t write(const uint8_t* data, size_t n);
  void flush();
};
extern HardwareSerial Serial;
