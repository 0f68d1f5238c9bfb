// SPDX-License-Identifier: MIT
#include "io/json_file.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <sstream>

#include "base/error.h"
#include "base/suggest.h"
#include "io/input.h"
#include "io/output.h"

namespace imucal {

UnreadJson::UnreadJson() : UnreadJson(Json::object()) {}
UnreadJson::UnreadJson(const Json& value) : value_(std::make_shared<Json>(value)) {}

namespace {

std::string shown(const Json& value) {
  return shortened(value.dump(-1, ' ', false, Json::error_handler_t::replace));
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

// Looks at every member while the text is parsed; a name given twice in one object is refused with its line.
class TwiceGiven {
public:
  TwiceGiven(const std::string& path, const std::string& text) : path_(path), text_(text) {}
  bool see(Json::parse_event_t event, const Json& parsed) {
    if (event == Json::parse_event_t::object_start) open_.emplace_back();
    if (event == Json::parse_event_t::object_end) open_.pop_back();
    if (event != Json::parse_event_t::key) return true;
    const std::string key = parsed.get<std::string>();
    const int n = ++seen_[key];
    if (!open_.back().insert(key).second)
      throw data_error(input_name(path_) + ":" + std::to_string(line_of_member(text_, key, n)) + ": field \"" + key +
                       "\" is given twice");
    return true;
  }

private:
  const std::string &path_, &text_;
  std::vector<std::set<std::string>> open_;
  std::map<std::string, int> seen_;
};

} // namespace

void JsonField::refuse(const std::string& problem) const {
  throw data_error(place_ + ": " + problem);
}

JsonField JsonField::at(const std::string& key) const {
  if (!value_.is_object()) refuse("expected an object {...}");
  const auto it = value_.find(key);
  if (it == value_.end()) refuse("field \"" + key + "\" is missing");
  return {*it, place_ + (place_.find(": ") == std::string::npos ? ": " : ".") + key};
}

std::optional<JsonField> JsonField::find(const std::string& key) const {
  if (!value_.is_object()) refuse("expected an object {...}");
  const auto it = value_.find(key);
  if (it == value_.end() || it->is_null()) return std::nullopt;
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
  const double x = value_.get<double>();
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
  if (!value_.is_string()) refuse("expected a text, found " + shown(value_));
  return value_.get<std::string>();
}

std::vector<double> JsonField::numbers() const {
  std::vector<double> out;
  for (const JsonField& element : elements()) out.push_back(element.number());
  return out;
}

void JsonField::only(std::initializer_list<const char*> known) const {
  if (!value_.is_object()) refuse("expected an object {...}");
  const std::vector<std::string> names(known.begin(), known.end());
  for (const auto& item : value_.items()) {
    const std::string& key = item.key();
    if (key == "comment" || key.compare(0, 1, "_") == 0 || std::find(names.begin(), names.end(), key) != names.end())
      continue;
    std::string list;
    for (const std::string& name : names) list += (list.empty() ? "" : ", ") + name;
    refuse("unknown field \"" + shortened(key) + "\"" + did_you_mean(key, names) + " (known: " + list + ")");
  }
}

JsonField read_json(const std::string& path) {
  const std::string content = read_text(path), name = input_name(path);
  const auto line_at = [&](size_t byte) {
    return std::to_string(
        1 + std::count(content.begin(), content.begin() + static_cast<long>(std::min(content.size(), byte)), '\n'));
  };
  TwiceGiven twice(path, content);
  try {
    return {
        Json::parse(content, [&](int, Json::parse_event_t event, Json& parsed) { return twice.see(event, parsed); }),
        name};
  } catch (const nlohmann::json::parse_error& error) {
    throw data_error(name + ":" + line_at(error.byte) + ": not valid JSON: " + error.what());
  } catch (const nlohmann::json::out_of_range& error) {
    // "... number overflow parsing '1e999'": the number stands between the quotes
    const std::string text = error.what();
    const size_t first = text.find('\''), last = text.rfind('\'');
    const std::string number =
        first < last && last != std::string::npos ? text.substr(first + 1, last - first - 1) : "";
    const size_t at = number.empty() ? std::string::npos : content.find(number);
    throw data_error(name + (at == std::string::npos ? "" : ":" + line_at(at)) + ": the number " + shortened(number) +
                     " is too large");
  }
}

void write_json(const std::string& path, const Json& json) {
  write_text(path, json.dump(1, ' ', false, Json::error_handler_t::replace) + "\n");
}

} // namespace imucal
