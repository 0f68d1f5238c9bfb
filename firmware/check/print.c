// SPDX-License-Identifier: MIT
#include "check.h"

void check_text(const check_io_t* io, const char* text) {
  io->print(io->ctx, text);
}

void check_number(const check_io_t* io, uint32_t value) {
  char digits[12];
  char* at = &digits[11];
  *at = '\0';
  do {
    *--at = (char)('0' + value % 10);
    value /= 10;
  } while (value);
  *--at = ' ';
  io->print(io->ctx, at);
}

void check_hex(const check_io_t* io, uint32_t value) {
  char digits[10] = " 00000000";
  for (int i = 8; i > 0; i--, value >>= 4) digits[i] = "0123456789abcdef"[value & 15u];
  io->print(io->ctx, digits);
}
