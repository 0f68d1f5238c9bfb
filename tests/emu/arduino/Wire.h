// SPDX-License-Identifier: MIT
#pragma once
#include "Arduino.h"
struct TwoWire {
  void begin();
  void setClock(uint32_t hz);
  void beginTransmission(uint8_t address);
  size_t write(const uint8_t* data, size_t n);
  uint8_t endTransmission(bool stop = true);
  uint8_t requestFrom(uint8_t address, size_t n);
  int read();
};
extern TwoWire Wire;
