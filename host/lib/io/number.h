// SPDX-License-Identifier: MIT
// The numbers of a log, read at the speed of the text.
//
// Nearly every number of a log is a sign, a few digits, a point and a few more: the quotient of a whole number below 2^53
// and a power of ten below 10^22 is then the nearest double (Clinger, "How to read floating point numbers accurately",
// PLDI 1990), so that one division replaces the search.  All else is left to std::from_chars.  The digits are found and
// summed eight at a time (Lemire, "Number parsing at a gigabyte per second", Softw. Pract. Exper. 2021, section 4).
//
// Where a number ends is found before it is read, for 64 characters at once (as in Langdale and Lemire, "Parsing gigabytes of
// JSON per second", VLDB Journal 2019, section 3.1): the processor then works on several numbers side by side, where it would
// else wait for the end of each before it can begin the next.
#pragma once
#include <algorithm>
#include <cfloat>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>

#include "base/simd.h"

namespace imucal {

// How many bytes behind the last line end FieldEnds and plain_number may touch.
constexpr size_t kNumberPadding = 64;

namespace number_detail {

// Eight characters, the first in the lowest byte.
inline uint64_t eight_characters(const char* at) {
  uint64_t v;
  std::memcpy(&v, at, sizeof v);
  return __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__ ? __builtin_bswap64(v) : v;
}

} // namespace number_detail

// One field of a line: its first character, its point (its end where it has none), the delimiter or line end behind it.
struct Field {
  const char* begin;
  const char* point;
  const char* end;
};

// Of the last field of a line that ends with \r\n.
inline void leave_carriage_return_out(Field* field) {
  if (field->end == field->begin || field->end[-1] != '\r') return;
  --field->end;
  field->point = std::min(field->point, field->end);
}

// Finds fields one after the other; kNumberPadding bytes behind the last line end may be read.
class FieldEnds {
public:
  explicit FieldEnds(char delimiter) : delimiter_(delimiter) {}

  // A line begins at `at`.  Not needed, but the processor foresees a look at the start of each line, and none at other places.
  void begin_line(const char* at) { look_at(at); }

  // The field that begins at `at`; false where it is longer than a number can be.
  bool find(const char* at, Field* field) {
    auto offset = static_cast<size_t>(at - from_);
    if (from_ == nullptr || offset >= kWindow || ends_ >> offset == 0) {
      look_at(at);
      offset = 0;
      if (ends_ == 0) return false;
    }
    const uint64_t ends = ends_ >> offset;
    *field = {at, at + __builtin_ctzll(ends | points_ >> offset), at + __builtin_ctzll(ends)};
    return true;
  }

private:
  static constexpr size_t kWindow = 64;

  void look_at(const char* at) {
    from_ = at;
    ends_ = points_ = 0;
    for (size_t i = 0; i < kWindow; i += 16) {
      ends_ |= static_cast<uint64_t>(where_16(at + i, delimiter_, '\n')) << i;
      points_ |= static_cast<uint64_t>(where_16(at + i, '.', '.')) << i;
    }
  }

  char delimiter_;
  const char* from_ = nullptr;
  uint64_t ends_ = 0, points_ = 0; // bit i: of the character from_[i]
};

namespace number_detail {

// The value of n digits, n from 0 to 8, that are the lowest bytes of `text`; false where there are other characters.
inline bool value_of(uint64_t text, size_t n, uint64_t* value) {
  if (n == 0) return *value = 0, true;
  uint64_t v = (text ^ 0x3030303030303030ULL) << (64 - 8 * n); // a digit becomes 0..9; zeros in front
  const bool is_fine = (((v + 0x7676767676767676ULL) | v) & 0x8080808080808080ULL) == 0;
  // Eight digits, pairs, fours, the sum.
  v = v * 10 + (v >> 8);
  constexpr uint64_t kPairs = 0x000000FF000000FFULL;
  v = (v & kPairs) * 0x000F424000000064ULL + ((v >> 16) & kPairs) * 0x0000271000000001ULL;
  *value = v >> 32;
  return is_fine;
}

// Eight characters from `at` on without the one at place n_before, n_before from 0 to 7.
inline uint64_t without_point(const char* at, size_t n_before) {
  const uint64_t text = eight_characters(at), before = (uint64_t{1} << (8 * n_before)) - 1;
  return (text & before) | ((text >> 8) & ~before);
}

} // namespace number_detail

// Reads a field that is a plain number, or empty (a missing value: NaN).  Plain: an optional minus, at most seven digits,
// then perhaps a point and at most seven more; its size is then below 1e7.  False for all else, such as exponents, blanks or
// text.
inline bool plain_number(const Field& field, double* value) {
  static constexpr double kPowers[] = {1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7};
  static constexpr double kSigns[] = {1, -1}; // no branch: signs cannot be foreseen
  static constexpr uint64_t kWhole[] = {1, 10, 100, 1000, 10000, 100000, 1000000, 10000000};
  if (FLT_EVAL_METHOD != 0) return false; // the quotient would be rounded twice
  const size_t is_negative = *field.begin == '-';
  const char* const begin = field.begin + is_negative;
  const auto n_whole = static_cast<size_t>(field.point - begin);
  const size_t has_point = field.point != field.end;
  const size_t n_part = static_cast<size_t>(field.end - field.point) - has_point;
  if (n_whole > 7 || n_part > 7) return false; // also of a point in front of its minus
  if (n_whole + n_part == 0) {
    *value = std::numeric_limits<double>::quiet_NaN();
    return field.begin == field.end;
  }
  uint64_t all = 0;
  bool is_fine = false;
  if (has_point && n_whole + n_part <= 7) {
    is_fine = number_detail::value_of(number_detail::without_point(begin, n_whole), n_whole + n_part, &all);
  } else {
    uint64_t part = 0;
    is_fine = number_detail::value_of(number_detail::eight_characters(begin), n_whole, &all) &&
              number_detail::value_of(number_detail::eight_characters(field.point + 1), n_part, &part);
    all = all * kWhole[n_part] + part;
  }
  *value = kSigns[is_negative] * (static_cast<double>(static_cast<int64_t>(all)) / kPowers[n_part]);
  return is_fine;
}

} // namespace imucal
