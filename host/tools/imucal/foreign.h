// SPDX-License-Identifier: MIT
// Files that are not ours but hold logs: known by their first bytes or lines, never by their name.
#pragma once
#include <string>

namespace imucal {

// "px4-ulog", "rosbag1", "csv", …; empty: not one of them (an imucal log, JSON, other text, no file).
std::string foreign_format(const std::string& path);

} // namespace imucal
