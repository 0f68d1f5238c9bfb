// SPDX-License-Identifier: MIT
#pragma once
#include "Arduino.h"
struct EEPROMClass {
  void begin(size_t size);
  uint8_t read(int at);
  void write(int at, uint8_t value);
  bool commit();
};
extern EEPROMClass EEPROM;
