// SPDX-License-Identifier: MIT
#include "base/axis_unit.h"

namespace imucal {

bool is_accelerometer(const std::string& axis) {
  const size_t at = axis.rfind('_');
  return at != std::string::npos &&
         (axis.compare(at, std::string::npos, "_mg") == 0 || axis.compare(at, std::string::npos, "_ms2") == 0);
}

std::string axis_stem(const std::string& axis) {
  return axis.substr(0, axis.rfind('_'));
}

const char* axis_unit(const std::string& axis) {
  return is_accelerometer(axis) ? "mg" : "dph";
}

std::string name_in_unit(const std::string& name, const std::string& unit) {
  const std::string gyro = "_dph";
  const size_t at = name.find(gyro);
  return at == std::string::npos ? name : name.substr(0, at) + "_" + unit + name.substr(at + gyro.size());
}

} // namespace imucal
