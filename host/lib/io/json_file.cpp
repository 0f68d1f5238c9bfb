// SPDX-License-Identifier: MIT
#include "io/json_file.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "base/error.h"
#include "base/suggest.h"
#include "io/input.h"
#include "io/output.h"

namespace imucal {

namespace {

std::string shown(const Json& value) {
  return shortened(value.dump());
}

// Line of the n-th (from 1) member "key" of the text.
long line_of_member(const std::string& text, const std::string& key, int n) {
  const std::string quoted = "\"" + key + "\"";
  size_t at = 0;
  for (size_t found = text.find(quoted); found != std::string::npos; found = text.find(quoted, found + 1)) {
    const size_t after = text.find_first_not_of(" \t\r\n", found + quoted.size());
    if (after == std::string::npos || text[after] != ':') continue;
    at = found;
    if (--n == 0) break;
  }
  return 1 + std::count(text.begin(), text.begin() + static_cast<long>(at), '\n');
}

constexpr size_t kDeepest = 100; // lists and objects in each other, in a file

// Makes the value while the library reads the text.  Refused with their lines: a syntax error, a number beyond double, a
// name that an object has twice, and what stands too deep.
class Builder {
public:
  Builder(const std::string& text, const std::string& name) : text_(text), name_(name) {}
  Json take() { return std::move(root_); }

  // What nlohmann::json::sax_parse calls.
  bool null() { return add(nullptr); }
  bool boolean(bool value) { return add(value); }
  bool number_integer(int64_t value) { return add(value); }
  bool number_unsigned(uint64_t value) { return add(value); }
  bool number_float(double value, const std::string&) { return add(value); }
  bool string(std::string& value) { return add(std::move(value)); }
  bool binary(nlohmann::json::binary_t&) { return false; } // not in texts
  bool start_array(size_t) { return open(Json::array()); }
  bool end_array() { return close(); }
  bool start_object(size_t) { return open(Json::object()); }
  bool end_object() { return close(); }
  bool key(const std::string& key) {
    const int n = ++seen_[key];
    if (open_.back()->contains(key))
      throw data_error(name_ + ":" + std::to_string(line_of_member(text_, key, n)) + ": field \"" + key +
                       "\" is given twice");
    key_ = key;
    return true;
  }
  bool parse_error(size_t byte, const std::string&, const nlohmann::json::exception& error) {
    if (const auto* syntax = dynamic_cast<const nlohmann::json::parse_error*>(&error))
      throw data_error(name_ + ":" + line_at(syntax->byte) + ": not valid JSON: " + from_the_place_on(error.what()));
    throw data_error(name_ + ":" + line_at(byte) + ": the number " + number_in(error.what()) + " is too large");
  }

private:
  std::string line_at(size_t byte) const {
    const auto end = text_.begin() + static_cast<long>(std::min(text_.size(), byte));
    return std::to_string(1 + std::count(text_.begin(), end, '\n'));
  }
  // "[json.exception.parse_error.101] parse error at line 2, column 5: syntax error while …": from the place on.
  static std::string from_the_place_on(const std::string& message) {
    const std::string head = "parse error ";
    const size_t at = message.find(head);
    return at == std::string::npos ? message : message.substr(at + head.size());
  }
  // "... number overflow parsing '1e999'": the number stands between the quotes
  static std::string number_in(const std::string& message) {
    const size_t first = message.find('\''), last = message.rfind('\'');
    return first < last && last != std::string::npos ? shortened(message.substr(first + 1, last - first - 1)) : "";
  }
  Json* place(Json value) {
    Json* at = &root_;
    if (!open_.empty()) {
      Json& parent = *open_.back();
      if (!parent.is_object()) parent.push_back(nullptr);
      at = parent.is_object() ? &parent[key_] : &parent[parent.size() - 1];
    }
    *at = std::move(value);
    return at;
  }
  bool add(Json value) {
    place(std::move(value));
    return true;
  }
  // The innermost one alone grows, so that the outer ones stay where they are.
  bool open(Json value) {
    if (open_.size() == kDeepest)
      throw data_error(name_ + ": lists and objects stand in each other more than " + std::to_string(kDeepest) +
                       " deep");
    open_.push_back(place(std::move(value)));
    return true;
  }
  bool close() {
    open_.pop_back();
    return true;
  }

  const std::string &text_, &name_;
  Json root_;
  std::vector<Json*> open_; // from the root to the innermost
  std::string key_;         // of the member that comes
  std::map<std::string, int> seen_;
};

// Numbers and texts as the library writes them.
std::string scalar(const Json& value) {
  switch (value.kind()) {
  case Json::Kind::kBool:
    return static_cast<bool>(value) ? "true" : "false";
  case Json::Kind::kInteger:
    return std::to_string(static_cast<int64_t>(value));
  case Json::Kind::kUnsigned:
    return std::to_string(static_cast<uint64_t>(value));
  case Json::Kind::kReal:
    return nlohmann::json(static_cast<double>(value)).dump();
  case Json::Kind::kText:
    return nlohmann::json(value.text()).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  default:
    return "null";
  }
}

void put(std::string* out, const Json& value, int indent, int level) {
  if (!value.is_array() && !value.is_object()) {
    *out += scalar(value);
    return;
  }
  const auto new_line = [&](int at) {
    if (indent >= 0 && !value.empty()) out->append(1, '\n').append(static_cast<size_t>(indent * at), ' ');
  };
  *out += value.is_array() ? '[' : '{';
  for (size_t i = 0; i < value.size(); ++i) {
    if (i > 0) *out += ',';
    new_line(level + 1);
    if (value.is_object()) *out += scalar(value.names()[i]) + (indent >= 0 ? ": " : ":");
    put(out, value[i], indent, level + 1);
  }
  new_line(level);
  *out += value.is_array() ? ']' : '}';
}

} // namespace

void JsonField::refuse(const std::string& problem) const {
  throw data_error(place_ + ": " + problem);
}

JsonField JsonField::at(const std::string& key) const {
  if (!value_.is_object()) refuse("expected an object {...}");
  const Json* value = value_.find(key);
  if (!value) refuse("field \"" + key + "\" is missing");
  return {*value, place_ + (place_.find(": ") == std::string::npos ? ": " : ".") + key};
}

JsonField JsonField::version_of(const std::string& key, const std::string& what) const {
  if (find(key)) return at(key);
  static const struct {
    const char *key, *what;
  } kinds[] = {{"imucal_model", "an error model"},
               {"imucal_profile", "a profile"},
               {"imucal_table", "a table"},
               {"imucal_diagnosis", "a diagnosis"}};
  for (const auto& kind : kinds)
    if (find(kind.key))
      refuse("field \"" + key + "\" is missing: this is " + kind.what + " (" + kind.key + "), and " + what +
             " is wanted");
  refuse("field \"" + key + "\" is missing: is it " + what + "? host/formats.md has a complete example");
}

std::optional<JsonField> JsonField::find(const std::string& key) const {
  if (!value_.is_object()) refuse("expected an object {...}");
  const Json* value = value_.find(key);
  if (!value || value->is_null()) return std::nullopt;
  return at(key);
}

std::vector<JsonField> JsonField::elements() const {
  if (!value_.is_array()) refuse("expected a list [...]");
  std::vector<JsonField> out;
  for (size_t i = 0; i < value_.size(); ++i) out.emplace_back(value_[i], place_ + "[" + std::to_string(i) + "]");
  return out;
}

double JsonField::number(double lo, double hi) const {
  if (!value_.is_number()) refuse("expected a number, found " + shown(value_));
  const double x = static_cast<double>(value_);
  if (!std::isfinite(x)) refuse("is not a finite number");
  if (x < lo || x > hi) {
    std::ostringstream range;
    range << "is " << x << ", outside [" << lo << ", " << hi << "]";
    refuse(range.str());
  }
  return x;
}

double JsonField::number_or(const std::string& key, double fallback, double lo, double hi) const {
  const auto field = find(key);
  return field ? field->number(lo, hi) : fallback;
}

int64_t JsonField::integer(int64_t lo, int64_t hi) const {
  const double x = number(static_cast<double>(lo), static_cast<double>(hi));
  if (x != std::floor(x)) refuse("expected a whole number, found " + shown(value_));
  return static_cast<int64_t>(x);
}

std::string JsonField::text() const {
  if (!value_.is_text()) refuse("expected a text, found " + shown(value_));
  return value_.text();
}

std::vector<double> JsonField::numbers() const {
  std::vector<double> out;
  for (const JsonField& element : elements()) out.push_back(element.number());
  return out;
}

void JsonField::only(std::initializer_list<const char*> known) const {
  if (!value_.is_object()) refuse("expected an object {...}");
  const std::vector<std::string> names(known.begin(), known.end());
  for (const std::string& key : value_.names()) {
    if (key == "comment" || key.compare(0, 1, "_") == 0 || std::find(names.begin(), names.end(), key) != names.end())
      continue;
    std::string list;
    for (size_t i = 0; i < names.size(); ++i)
      if (std::find(names.begin(), names.begin() + static_cast<long>(i), names[i]) ==
          names.begin() + static_cast<long>(i))
        list += (list.empty() ? "" : ", ") + names[i];
    refuse("unknown field \"" + shortened(key) + "\"" + did_you_mean(key, names) + " (known: " + list + ")");
  }
}

JsonField read_json(const std::string& path) {
  return parse_json(read_text(path), input_name(path));
}

// The library takes a zero byte for the end of the text.
static void refuse_zero_bytes(const std::string& text, const std::string& name) {
  const size_t at = text.find('\0');
  if (at == std::string::npos) return;
  const auto line = 1 + std::count(text.begin(), text.begin() + static_cast<long>(at), '\n');
  throw data_error(name + ":" + std::to_string(line) +
                   ": not valid JSON: a zero byte; is the file damaged, or not a text?");
}

JsonField parse_json(const std::string& text, const std::string& name) {
  refuse_zero_bytes(text, name);
  Builder builder(text, name);
  nlohmann::json::sax_parse(text, &builder);
  return {builder.take(), name};
}

std::string Json::dump(int indent) const {
  std::string out;
  put(&out, *this, indent, 0);
  return out;
}

void write_json(const std::string& path, const Json& json) {
  write_text(path, json.dump(1) + "\n");
}

} // namespace imucal
