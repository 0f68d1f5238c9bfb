// SPDX-License-Identifier: MIT
// The numbers of a log, read at the speed of the text.
//
// Nearly every number of a log is a sign, a few digits, a point and a few more: the quotient of a whole number below 2^53
// and a power of ten below 10^22 is then the nearest double (Clinger, "How to read floating point numbers accurately",
// PLDI 1990), so that one division replaces the search.  All else is left to std::from_chars.  The digits are found and
// summed eight at a time (Lemire, "Number parsing at a gigabyte per second", Softw. Pract. Exper. 2021, section 4).
#pragma once
#include <cfloat>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>

namespace imucal {

// How many bytes behind the line end plain_number may touch.
constexpr size_t kNumberPadding = 16;

namespace number_detail {

// Eight characters, the first in the lowest byte.
inline uint64_t eight_characters(const char* at) {
  uint64_t v;
  std::memcpy(&v, at, sizeof v);
  return __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__ ? __builtin_bswap64(v) : v;
}

// The value of the digits at `at`; sets their number, 8 also where there are more.
inline uint32_t up_to_eight_digits(const char* at, int* n_digits) {
  uint64_t v = eight_characters(at) ^ 0x3030303030303030ULL; // a digit becomes 0..9
  // The lowest byte above 9 marks its high bit; what it carries upwards does not matter.
  const uint64_t other = ((v + 0x7676767676767676ULL) | v) & 0x8080808080808080ULL;
  const int n = other == 0 ? 8 : __builtin_ctzll(other) / 8;
  *n_digits = n;
  // Zeros in front: eight digits, pairs, fours, the sum.
  v = n == 0 ? 0 : v << (64 - 8 * n);
  v = v * 10 + (v >> 8);
  constexpr uint64_t kPairs = 0x000000FF000000FFULL;
  v = (v & kPairs) * 0x000F424000000064ULL + ((v >> 16) & kPairs) * 0x0000271000000001ULL;
  return static_cast<uint32_t>(v >> 32);
}

} // namespace number_detail

// Reads a plain number, or nothing (a missing value: NaN), and moves *at behind it.  Plain: an optional minus, at most
// seven digits, then perhaps a point and at most seven more.  Returns false, *at as it was, for all else, such as
// exponents, blanks or text.  The caller sees to it that a line end lies at or behind *at and kNumberPadding bytes behind
// that may be read; the number never reaches over it.
inline bool plain_number(const char** at, double* value) {
  static constexpr double kPowers[] = {1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7};
  static constexpr double kSigns[] = {1, -1}; // no branch: signs cannot be foreseen
  static constexpr uint64_t kWhole[] = {1, 10, 100, 1000, 10000, 100000, 1000000, 10000000};
  if (FLT_EVAL_METHOD != 0) return false; // the quotient would be rounded twice
  const char* p = *at;
  const bool is_negative = *p == '-';
  p += is_negative;
  int n_whole = 0, n_part = 0;
  const uint64_t whole = number_detail::up_to_eight_digits(p, &n_whole);
  if (n_whole == 8) return false;
  p += n_whole;
  uint64_t digits = whole;
  if (*p == '.') {
    const uint32_t part = number_detail::up_to_eight_digits(++p, &n_part);
    if (n_part == 8) return false;
    p += n_part;
    digits = whole * kWhole[n_part] + part;
  }
  if (n_whole + n_part == 0) {
    if (p != *at || (*p != ',' && *p != '\r' && *p != '\n')) return false;
    *value = std::numeric_limits<double>::quiet_NaN();
    return true;
  }
  *value = kSigns[is_negative] * (static_cast<double>(static_cast<int64_t>(digits)) / kPowers[n_part]);
  *at = p;
  return true;
}

} // namespace imucal
