// SPDX-License-Identifier: MIT
#include "io/kept_numbers.h"

#include <cstdio>

#include "base/error.h"
#include "io/json_file.h"

namespace imucal {

constexpr long kKeptVersion = 2;

std::optional<std::vector<double>> read_kept_numbers(const std::string& path, const std::string& key) {
  try {
    const JsonField kept = read_json(path);
    if (kept.at("imucal_nulls").integer(0, 1000) != kKeptVersion || kept.at("key").text() != key) return std::nullopt;
    return kept.at("gains").numbers();
  } catch (const Error&) {
    return std::nullopt;
  }
}

void write_kept_numbers(const std::string& path, const std::string& key, const std::vector<double>& numbers) {
  (void)std::remove(path.c_str()); // one that was read and holds something else would be protected
  write_json(path, {{"imucal_nulls", kKeptVersion}, {"key", key}, {"gains", numbers}});
}

} // namespace imucal
