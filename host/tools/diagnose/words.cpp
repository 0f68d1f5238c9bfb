// SPDX-License-Identifier: MIT
#include "diagnose/words.h"

#include <algorithm>
#include <cctype>
#include <utility>

namespace imucal {

void add_once(const std::string& text, std::vector<std::string>* said) {
  if (std::find(said->begin(), said->end(), text) == said->end()) said->push_back(text);
}
std::string joined(const std::vector<std::string>& list, const char* between) {
  std::string out;
  for (const std::string& text : list) out += (out.empty() ? "" : between) + text;
  return out;
}

std::string in_plain_words(std::string name) {
  std::replace(name.begin(), name.end(), '_', ' ');
  return name;
}
std::string with_article(const std::string& words) {
  return (std::string("aeiou").find(words[0]) == std::string::npos ? "a " : "an ") + words;
}
std::string capitalised(std::string sentence) {
  if (!sentence.empty()) sentence[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(sentence[0])));
  return sentence;
}

std::string name_of(const CandidateEvidence& c) {
  return c.effect ? c.effect->name() : family_name(c.family);
}
std::string name_of(const SelectedEffect& e) {
  return e.is_family || !e.term.effect ? family_name(e.family) : e.term.effect->name();
}

std::string left_out_text(const std::string& why) {
  static const std::pair<const char*, const char*> texts[] = {
      {kLeftOutNoRate, "no rate in the log"},          {kLeftOutFlagged, "flagged as saturated or faulty"},
      {kLeftOutStuck, "the thermometer was stuck"},    {kLeftOutZero, "exact zeros that are no rates"},
      {kLeftOutNeighbour, "within 10 s of those"},     {kLeftOutJump, "at a jump in time"},
      {kLeftOutHit, "single seconds out of all noise"}};
  for (const auto& [name, text] : texts)
    if (why == name) return text;
  return find_effect(why).label();
}

} // namespace imucal
