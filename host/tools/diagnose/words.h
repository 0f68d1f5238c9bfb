// SPDX-License-Identifier: MIT
// Names and lists in words, for all that diagnose prints.
#pragma once
#include <cstdio>
#include <string>
#include <vector>

#include "analysis/diagnose/diagnose.h"

namespace imucal {

template <typename... Args> std::string format(const char* pattern, Args... args) {
  char line[600];
  std::snprintf(line, sizeof line, pattern, args...);
  return line;
}

// Behind what is said, unless it is said already: more than one candidate may be called the same.
void add_once(const std::string& text, std::vector<std::string>* said);
std::string joined(const std::vector<std::string>& list, const char* between);

// The name of an effect, or of the family that stands for it.
std::string name_of(const CandidateEvidence& c);
std::string name_of(const SelectedEffect& e);

} // namespace imucal
