// SPDX-License-Identifier: MIT
// The large headers from outside that many sources read, compiled once.  Each source still names what it uses: a build
// with BY_FILE=1 PCH= shows what is missing.
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <sstream>
#include <string>
#include <vector>
