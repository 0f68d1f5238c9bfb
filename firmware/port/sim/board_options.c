// SPDX-License-Identifier: MIT
#include "board_options.h"

#include <string.h>

static bool is_end(char c) {
  return c == '\0' || c == ' ';
}

static bool is_option(const char* name, const char* wanted) {
  return strcmp(name, wanted) == 0;
}

/* 10^n, n <= 22: exact in double. */
static double power_of_ten(uint32_t n) {
  double value = 1.0;
  while (n-- > 0) value *= 10.0;
  return value;
}

static const char* read_exponent(const char* at, int32_t* exponent) {
  if (*at != 'e' && *at != 'E') return at;
  const bool is_negative = at[1] == '-';
  at += at[1] == '-' || at[1] == '+' ? 2 : 1;
  int32_t value = 0;
  for (; *at >= '0' && *at <= '9' && value < 1000; at++) value = value * 10 + (*at - '0');
  *exponent += is_negative ? -value : value;
  return at;
}

bool board_options_number(const char* text, float* value, const char** end) {
  const char* at = text;
  const bool is_negative = *at == '-';
  if (*at == '-' || *at == '+') at++;
  double digits = 0.0; /* up to 15 digits are exact */
  int32_t exponent = 0, n_digits = 0;
  bool is_fraction = false;
  for (; (*at >= '0' && *at <= '9') || (*at == '.' && !is_fraction); at++) {
    if (*at == '.') {
      is_fraction = true;
      continue;
    }
    if (++n_digits > 15) return false;
    digits = digits * 10.0 + (*at - '0');
    exponent -= is_fraction ? 1 : 0;
  }
  if (n_digits == 0) return false;
  at = read_exponent(at, &exponent);
  if (exponent < -22 || exponent > 22) return false;
  digits = exponent < 0 ? digits / power_of_ten((uint32_t)-exponent) : digits * power_of_ten((uint32_t)exponent);
  *value = (float)(is_negative ? -digits : digits);
  *end = at;
  return true;
}

static bool read_whole(const char* text, uint32_t* value) {
  uint64_t number = 0;
  if (is_end(*text)) return false;
  for (; *text >= '0' && *text <= '9'; text++)
    if ((number = number * 10 + (uint32_t)(*text - '0')) > 0xFFFFFFFFu) return false;
  *value = (uint32_t)number;
  return is_end(*text);
}

static bool read_single(const char* text, float* value) {
  const char* end;
  return board_options_number(text, value, &end) && is_end(*end);
}

static bool set_text(char* to, size_t size, const char** at) {
  size_t n = 0;
  memset(to, 0, size);
  for (; !is_end(**at) && **at != ','; (*at)++) {
    if (n == size) return false;
    to[n++] = **at;
  }
  return n > 0;
}

static bool set_names(imucal_board_t* board, const char* value) {
  for (uint32_t i = 0; i < IMUCAL_MAX_CHANNELS; i++) {
    if (!set_text(board->channel[i].name, sizeof board->channel[i].name, &value)) return false;
    if (is_end(*value)) return true;
    value++;
  }
  return false;
}

/* A list of numbers, the last of which holds for the channels left. */
static bool set_numbers(imucal_board_t* board, const char* value, void (*set)(imucal_board_t*, uint32_t, float)) {
  float number = 0.0f;
  for (uint32_t i = 0; i < IMUCAL_MAX_CHANNELS; i++) {
    if (*value != '\0' && *value != ' ') {
      const char* end;
      if (!board_options_number(value, &number, &end)) return false;
      if (*end != ',' && !is_end(*end)) return false;
      value = *end == ',' ? end + 1 : end;
    }
    set(board, i, number);
  }
  return is_end(*value);
}

static void set_scale(imucal_board_t* board, uint32_t i, float number) {
  board->channel[i].unit_per_count = number;
}

static void set_full_scale(imucal_board_t* board, uint32_t i, float number) {
  const bool is_in_range = number >= 1.0f && number < 2147483648.0f;
  board->channel[i].full_scale_counts = is_in_range ? (int32_t)number : 0;
}

bool board_options_set(imucal_board_t* board, const char* name, const char* value) {
  uint32_t whole;
  if (is_option(name, "serial")) return set_text(board->serial, sizeof board->serial, &value) && is_end(*value);
  if (is_option(name, "names")) return set_names(board, value);
  if (is_option(name, "scale")) return set_numbers(board, value, set_scale);
  if (is_option(name, "full-scale")) return set_numbers(board, value, set_full_scale);
  if (is_option(name, "temp-scale")) return read_single(value, &board->degc_per_count);
  if (is_option(name, "temp-zero")) return read_single(value, &board->degc_at_zero);
  if (is_option(name, "rate")) return read_whole(value, &board->rate_hz);
  if (!is_option(name, "channels") || !read_whole(value, &whole) || whole > 255) return false;
  board->n_channels = (uint8_t)whole;
  return true;
}

void board_options_default(imucal_board_t* board) {
  memset(board, 0, sizeof *board);
  const char* serial = "0001";
  (void)set_text(board->serial, sizeof board->serial, &serial);
  board->n_channels = 3;
  board->rate_hz = 100;
  board->degc_per_count = 0.01f;
  board->degc_at_zero = 25.0f;
  (void)set_names(board, "gx_dph,gy_dph,gz_dph,ax_mg,ay_mg,az_mg");
  (void)set_numbers(board, "1,1,1,0.01", set_scale);
  (void)set_numbers(board, "8388607", set_full_scale);
}
