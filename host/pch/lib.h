// SPDX-License-Identifier: MIT
// What the library's sources read from outside, compiled once.  Each source still names what it uses: a build
// with PCH= shows what is missing.
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>
