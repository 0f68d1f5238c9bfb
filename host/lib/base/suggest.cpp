// SPDX-License-Identifier: MIT
#include "base/suggest.h"

#include <algorithm>
#include <cctype>

namespace imucal {

namespace {

std::string lower(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

// Damerau and Levenshtein, restricted: rows of the dynamic programme.
size_t edits(const std::string& a, const std::string& b) {
  std::vector<std::vector<size_t>> d(a.size() + 1, std::vector<size_t>(b.size() + 1));
  for (size_t i = 0; i <= a.size(); ++i) d[i][0] = i;
  for (size_t j = 0; j <= b.size(); ++j) d[0][j] = j;
  for (size_t i = 1; i <= a.size(); ++i)
    for (size_t j = 1; j <= b.size(); ++j) {
      d[i][j] = std::min({d[i - 1][j] + 1, d[i][j - 1] + 1, d[i - 1][j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1)});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
        d[i][j] = std::min(d[i][j], d[i - 2][j - 2] + 1);
    }
  return d[a.size()][b.size()];
}

constexpr size_t kLongest = 64; // no name of ours is longer

} // namespace

std::string nearest_name(const std::string& name, const std::vector<std::string>& known) {
  if (name.size() > kLongest) return "";
  std::string best;
  size_t fewest = std::max<size_t>(1, name.size() / 3) + 1;
  for (const std::string& candidate : known) {
    const bool begins_alike = name.size() >= 3 && lower(candidate).compare(0, name.size(), lower(name)) == 0;
    const size_t n = begins_alike ? 1 : edits(lower(name), lower(candidate));
    if (n >= fewest) continue;
    fewest = n;
    best = candidate;
  }
  return best;
}

std::string did_you_mean(const std::string& name, const std::vector<std::string>& known) {
  const std::string near = nearest_name(name, known);
  return near.empty() ? "" : "; did you mean \"" + near + "\"?";
}

} // namespace imucal
