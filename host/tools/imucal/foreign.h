// SPDX-License-Identifier: MIT
// Files that are not ours but hold logs: known by their first bytes, never by their name.
#pragma once
#include <string>

namespace imucal {

// "px4-ulog", "rosbag", …; empty: not one of them (an imucal log, JSON, text, no file).
std::string foreign_format(const std::string& path);

} // namespace imucal
