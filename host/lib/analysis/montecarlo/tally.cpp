// SPDX-License-Identifier: MIT
#include "analysis/montecarlo/tally.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace imucal {

static constexpr double kUnit = 0x1p-44;
static constexpr double kLargest = 0x1p62;

void ExactSum::add(double x) {
  if (!(std::abs(x) <= kLargest)) throw std::overflow_error("a result is not finite or beyond 4e18");
  // Split so that each half is exact in int64.
  const double high = std::nearbyint(x);
  sum_ += static_cast<Int128>(static_cast<int64_t>(high)) * (static_cast<Int128>(1) << 44);
  sum_ += static_cast<int64_t>(std::nearbyint((x - high) / kUnit));
}

double ExactSum::value() const {
  return static_cast<double>(sum_) * kUnit;
}

std::string ExactSum::text() const {
  const bool negative = sum_ < 0;
  Uint128 rest = negative ? -static_cast<Uint128>(sum_) : static_cast<Uint128>(sum_);
  std::string digits;
  do {
    digits += static_cast<char>('0' + static_cast<int>(rest % 10));
    rest /= 10;
  } while (rest != 0);
  if (negative) digits += '-';
  std::reverse(digits.begin(), digits.end());
  return digits;
}

ExactSum ExactSum::from_text(const std::string& text) {
  const bool negative = !text.empty() && text[0] == '-';
  const std::string digits = text.substr(negative ? 1 : 0);
  if (digits.empty() || digits.size() > 38 || digits.find_first_not_of("0123456789") != std::string::npos)
    throw std::invalid_argument("not an exact sum: \"" + text + "\"");
  ExactSum out;
  for (const char c : digits) out.sum_ = out.sum_ * 10 + (c - '0');
  if (negative) out.sum_ = -out.sum_;
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
  for (const auto& item : sums.json().items())
    for (const JsonField& text : sums.at(item.key()).elements()) try {
        tally.sums_[item.key()].push_back(ExactSum::from_text(text.text()));
      } catch (const std::invalid_argument& error) {
        text.refuse(error.what());
      }
  for (const auto& item : counts.json().items())
    for (const JsonField& n : counts.at(item.key()).elements())
      tally.counts_[item.key()].push_back(n.integer(0, 1L << 52));
  for (const auto& item : maxima.json().items()) tally.highest_[item.key()] = maxima.at(item.key()).numbers();
  return tally;
}

} // namespace imucal
