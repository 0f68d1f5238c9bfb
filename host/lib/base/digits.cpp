// SPDX-License-Identifier: MIT
#include "base/digits.h"

#include <algorithm>
#include <cmath>

#include "base/format.h"

namespace imucal {

namespace {

constexpr int kMostPlace = 6, kLeastPlace = -9; // powers of ten that are written in digits
constexpr int kErrorDigits = 2, kPlainDigits = 4;
constexpr double kManyNats = 10;

// Place of the last of the digits that count: 0 for 12, -1 for 1.2, 1 for 120.
int last_place(double value, int digits) {
  const int first = static_cast<int>(std::floor(std::log10(std::fabs(value))));
  // 9.96 in two digits is 10
  const double rounded = std::fabs(value) / std::pow(10.0, first - digits + 1);
  return (std::round(rounded) >= std::pow(10.0, digits) ? first + 1 : first) - digits + 1;
}

std::string to_place(double value, int place) {
  if (place >= 0) {
    const double unit = std::pow(10.0, place);
    return format("%.0f", std::round(value / unit) * unit + 0.0);
  }
  return format("%.*f", -place, value);
}

bool is_written_in_digits(double value, int place) {
  return place >= kLeastPlace && std::fabs(value) < std::pow(10.0, kMostPlace + 1);
}

} // namespace

std::string in_digits(double value, int digits) {
  if (!std::isfinite(value) || value == 0) return format("%g", value);
  const int place = last_place(value, digits);
  return is_written_in_digits(value, place) ? to_place(value, place) : format("%.*e", digits - 1, value);
}

std::string as_known(double value, double error) {
  if (!std::isfinite(error) || !(error > 0)) return in_digits(value, kPlainDigits);
  const int place = last_place(error, kErrorDigits);
  if (!std::isfinite(value) || !is_written_in_digits(std::max(std::fabs(value), error), place))
    return format("%.*g", kPlainDigits, value);
  return to_place(value, place);
}

std::string with_error(double value, double error) {
  if (!std::isfinite(error) || !(error > 0)) return as_known(value, error);
  const bool is_small = is_written_in_digits(std::max(std::fabs(value), error), last_place(error, kErrorDigits));
  return as_known(value, error) + " +- " + (is_small ? as_known(error, error) : format("%.*g", kErrorDigits, error));
}

std::string nats_text(double nats) {
  return format(std::fabs(nats) < kManyNats ? "%.1f" : "%.0f", nats);
}

} // namespace imucal
