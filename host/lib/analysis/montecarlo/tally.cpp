// SPDX-License-Identifier: MIT
#include "analysis/montecarlo/tally.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

namespace imucal {

static constexpr int kUnitBits = 44;
static constexpr double kUnit = 0x1p-44;
static constexpr double kLargest = 0x1p62;

// Modulo 2^128, in two's complement: unsigned words may overflow.
void ExactSum::add(int64_t high, uint64_t low) {
  low_ += low;
  const uint64_t carry = low_ < low ? 1 : 0;
  high_ = static_cast<int64_t>(static_cast<uint64_t>(high_) + static_cast<uint64_t>(high) + carry);
}

void ExactSum::negate() {
  high_ = ~high_;
  low_ = ~low_;
  add(0, 1);
}

void ExactSum::add(double x) {
  if (!(std::abs(x) <= kLargest)) throw std::overflow_error("a result is not finite or beyond 4e18");
  // Split so that each half is exact in int64.
  const double whole = std::nearbyint(x);
  const auto n = static_cast<int64_t>(whole);
  const auto units = static_cast<int64_t>(std::nearbyint((x - whole) / kUnit));
  add(n >> (64 - kUnitBits), static_cast<uint64_t>(n) << kUnitBits); // n 2^44
  add(units < 0 ? -1 : 0, static_cast<uint64_t>(units));
}

double ExactSum::value() const {
  ExactSum size = *this;
  if (high_ < 0) size.negate();
  const double units = static_cast<double>(size.high_) * 0x1p64 + static_cast<double>(size.low_);
  return (high_ < 0 ? -units : units) * kUnit;
}

// Decimal digits, the last one first: four words of 32 bits, divided by 10 again and again.
std::string ExactSum::text() const {
  ExactSum size = *this;
  if (high_ < 0) size.negate();
  const auto high = static_cast<uint64_t>(size.high_);
  std::array<uint64_t, 4> words = {high >> 32, high & UINT32_MAX, size.low_ >> 32, size.low_ & UINT32_MAX};
  std::string digits;
  do {
    uint64_t rest = 0;
    for (uint64_t& word : words) {
      rest = rest << 32 | word;
      word = rest / 10;
      rest %= 10;
    }
    digits += static_cast<char>('0' + static_cast<int>(rest));
  } while (words != std::array<uint64_t, 4>{});
  if (high_ < 0) digits += '-';
  std::reverse(digits.begin(), digits.end());
  return digits;
}

ExactSum ExactSum::from_text(const std::string& text) {
  const bool negative = !text.empty() && text[0] == '-';
  const std::string digits = text.substr(negative ? 1 : 0);
  if (digits.empty() || digits.size() > 38 || digits.find_first_not_of("0123456789") != std::string::npos)
    throw std::invalid_argument("not an exact sum: \"" + text + "\"");
  ExactSum out;
  for (const char c : digits) {
    ExactSum twice = out;
    twice.add(out);
    out = twice;
    for (int doubled = 0; doubled < 2; ++doubled) out.add(ExactSum(out)); // 8 times
    out.add(twice);                                                       // 10 times
    out.add(0, static_cast<uint64_t>(c - '0'));
  }
  if (negative) out.negate();
  return out;
}

// The list `name` of `n` entries; a list never changes its length.
template <typename T>
static std::vector<T>& list(std::map<std::string, std::vector<T>>* lists, const std::string& name, size_t n) {
  std::vector<T>& found = (*lists)[name];
  if (found.empty()) found.resize(n);
  if (found.size() != n) throw std::logic_error("tally " + name + ": lists of different length");
  return found;
}

void Tally::add(const std::string& name, const std::vector<double>& values) {
  auto& into = list(&sums_, name, values.size());
  for (size_t i = 0; i < values.size(); ++i) into[i].add(values[i]);
}

void Tally::count(const std::string& name, const std::vector<int64_t>& values) {
  auto& into = list(&counts_, name, values.size());
  for (size_t i = 0; i < values.size(); ++i) into[i] += values[i];
}

void Tally::highest(const std::string& name, const std::vector<double>& values) {
  auto& into = list(&highest_, name, values.size());
  for (size_t i = 0; i < values.size(); ++i) into[i] = std::max(into[i], values[i]);
}

void Tally::merge(const Tally& other) {
  for (const auto& [name, values] : other.sums_) {
    auto& into = list(&sums_, name, values.size());
    for (size_t i = 0; i < values.size(); ++i) into[i].add(values[i]);
  }
  for (const auto& [name, values] : other.counts_) count(name, values);
  for (const auto& [name, values] : other.highest_) highest(name, values);
}

std::vector<double> Tally::sums(const std::string& name) const {
  std::vector<double> out;
  if (const auto it = sums_.find(name); it != sums_.end())
    for (const ExactSum& s : it->second) out.push_back(s.value());
  return out;
}

double Tally::sum(const std::string& name) const {
  const auto all = sums(name);
  return all.empty() ? 0.0 : all.front();
}

std::vector<int64_t> Tally::counts(const std::string& name) const {
  const auto it = counts_.find(name);
  return it == counts_.end() ? std::vector<int64_t>{} : it->second;
}

int64_t Tally::counted(const std::string& name) const {
  const auto all = counts(name);
  return all.empty() ? 0 : all.front();
}

std::vector<double> Tally::maxima(const std::string& name) const {
  const auto it = highest_.find(name);
  return it == highest_.end() ? std::vector<double>{} : it->second;
}

double Tally::maximum(const std::string& name) const {
  const auto all = maxima(name);
  return all.empty() ? 0.0 : all.front();
}

Json Tally::to_json() const {
  Json json = {{"sums", Json::object()}, {"counts", Json::object()}, {"maxima", Json::object()}};
  for (const auto& [name, values] : sums_) {
    Json texts = Json::array();
    for (const ExactSum& s : values) texts.push_back(s.text());
    json["sums"][name] = texts;
  }
  for (const auto& [name, values] : counts_) json["counts"][name] = values;
  for (const auto& [name, values] : highest_) json["maxima"][name] = values;
  return json;
}

Tally Tally::from_json(const JsonField& field) {
  Tally tally;
  const JsonField sums = field.at("sums"), counts = field.at("counts"), maxima = field.at("maxima");
  for (const std::string& name : sums.json().names())
    for (const JsonField& text : sums.at(name).elements()) try {
        tally.sums_[name].push_back(ExactSum::from_text(text.text()));
      } catch (const std::invalid_argument& error) {
        text.refuse(error.what());
      }
  for (const std::string& name : counts.json().names())
    for (const JsonField& n : counts.at(name).elements()) tally.counts_[name].push_back(n.integer(0, INT64_C(1) << 52));
  for (const std::string& name : maxima.json().names()) tally.highest_[name] = maxima.at(name).numbers();
  return tally;
}

} // namespace imucal
