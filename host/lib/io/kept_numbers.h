// SPDX-License-Identifier: MIT
// A list of numbers that took long to compute, kept in a file: {"imucal_nulls": 2, "key": "...", "gains": [...]}.
#pragma once
#include <optional>
#include <string>
#include <vector>

namespace imucal {

// Empty: there is no such file, it is damaged or of another key; then compute them again.
std::optional<std::vector<double>> read_kept_numbers(const std::string& path, const std::string& key);
// data_error: cannot be written.
void write_kept_numbers(const std::string& path, const std::string& key, const std::vector<double>& numbers);

} // namespace imucal
