// SPDX-License-Identifier: MIT
// Names and lists in words, for all that diagnose prints.
#pragma once
#include <string>
#include <vector>

#include "analysis/diagnose/diagnose.h"
#include "base/format.h"

namespace imucal {

// Behind what is said, unless it is said already: more than one candidate may be called the same.
void add_once(const std::string& text, std::vector<std::string>* said);
std::string joined(const std::vector<std::string>& list, const char* between);

// "a_b" -> "a b".
std::string in_plain_words(std::string name);
// "a warm up", "an outlier".
std::string with_article(const std::string& words);
std::string capitalised(std::string sentence);

// The name of an effect, or of the family that stands for it.
std::string name_of(const CandidateEvidence& c);
std::string name_of(const SelectedEffect& e);

// Why seconds are left out, as RecordedLog says it: in words.
std::string left_out_text(const std::string& why);

} // namespace imucal
