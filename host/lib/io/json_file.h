// SPDX-License-Identifier: MIT
// JSON files: reading with errors that name file and field, writing so that nothing half-written stays.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "io/json.h"

namespace imucal {

// A value inside a JSON file that knows its place ("model.json: markov[1].tau_s") for messages.
class JsonField {
public:
  JsonField(const Json& value, std::string place) : value_(value), place_(std::move(place)) {}

  const Json& json() const { return value_; }
  const std::string& place() const { return place_; }

  // Required member / element.  Throws data_error when it is missing or of another kind.
  JsonField at(const std::string& key) const;
  std::vector<JsonField> elements() const;
  std::optional<JsonField> find(const std::string& key) const; // absent or null: empty

  // The member that says what file it is, and its version; a file of another kind is refused by its name.
  JsonField version_of(const std::string& key, const std::string& what) const;

  // Typed values; a number must be finite and inside [lo, hi].
  double number(double lo = -1e300, double hi = 1e300) const;
  double number_or(const std::string& key, double fallback, double lo = -1e300, double hi = 1e300) const;
  int64_t integer(int64_t lo, int64_t hi) const;
  std::string text() const;
  std::vector<double> numbers() const;

  // Refuse members other than these, with the nearest known name: a typing error must not pass in silence.  Taken anywhere:
  // "comment", and names that begin with "_".
  void only(std::initializer_list<const char*> known) const;
  [[noreturn]] void refuse(const std::string& problem) const; // data_error: "<place>: <problem>"

private:
  Json value_;
  std::string place_;
};

// Parse a file ("-": standard input; gzip is unpacked); data_error names the file and, for a syntax error, a member given
// twice or a number beyond double, the line.
JsonField read_json(const std::string& path);
JsonField parse_json(const std::string& text, const std::string& name); // text that is at hand; `name` for messages

void write_json(const std::string& path, const Json& json); // as io/output.h writes

} // namespace imucal
