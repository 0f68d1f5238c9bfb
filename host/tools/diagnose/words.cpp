// SPDX-License-Identifier: MIT
#include "diagnose/words.h"

#include <algorithm>

namespace imucal {

void add_once(const std::string& text, std::vector<std::string>* said) {
  if (std::find(said->begin(), said->end(), text) == said->end()) said->push_back(text);
}
std::string joined(const std::vector<std::string>& list, const char* between) {
  std::string out;
  for (const std::string& text : list) out += (out.empty() ? "" : between) + text;
  return out;
}

std::string name_of(const CandidateEvidence& c) {
  return c.effect ? c.effect->name() : family_name(c.family);
}
std::string name_of(const SelectedEffect& e) {
  return e.is_family || !e.term.effect ? family_name(e.family) : e.term.effect->name();
}

} // namespace imucal
