// SPDX-License-Identifier: MIT
#include "io/json_file.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iostream>
#include <sstream>

#include "base/error.h"

namespace imucal {

void JsonField::refuse(const std::string& problem) const { throw data_error(place_ + ": " + problem); }

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
  if (!value_.is_number()) refuse("expected a number, found " + value_.dump());
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

long JsonField::integer(long lo, long hi) const {
  const double x = number(static_cast<double>(lo), static_cast<double>(hi));
  if (x != std::floor(x)) refuse("expected a whole number, found " + value_.dump());
  return static_cast<long>(x);
}

std::string JsonField::text() const {
  if (!value_.is_string()) refuse("expected a text, found " + value_.dump());
  return value_.get<std::string>();
}

std::vector<double> JsonField::numbers() const {
  std::vector<double> out;
  for (const JsonField& element : elements()) out.push_back(element.number());
  return out;
}

void JsonField::only(std::initializer_list<const char*> known) const {
  if (!value_.is_object()) refuse("expected an object {...}");
  for (const auto& item : value_.items()) {
    bool found = false;
    for (const char* name : known) found = found || item.key() == name;
    if (found) continue;
    std::string list;
    for (const char* name : known) list += (list.empty() ? "" : ", ") + std::string(name);
    refuse("unknown field \"" + item.key() + "\" (known: " + list + ")");
  }
}

JsonField read_json(const std::string& path) {
  std::ifstream in(path);
  if (!in) throw data_error(path + ": cannot open: " + std::strerror(errno));
  std::stringstream text;
  text << in.rdbuf();
  const std::string content = text.str();
  try {
    return {Json::parse(content), path};
  } catch (const nlohmann::json::parse_error& error) {
    const size_t upto = std::min(content.size(), error.byte);
    const long line = 1 + std::count(content.begin(), content.begin() + static_cast<long>(upto), '\n');
    throw data_error(path + ":" + std::to_string(line) + ": not valid JSON: " + error.what());
  }
}

void write_stream(const std::string& path, const std::function<void(std::ostream&)>& write) {
  if (path == "-") {
    write(std::cout);
    std::cout.flush();
    return;
  }
  // A device or pipe cannot be renamed onto; anything else is written aside and moved into place.
  struct stat existing {};
  const bool special = ::stat(path.c_str(), &existing) == 0 && !S_ISREG(existing.st_mode);
  const std::string target = special ? path : path + ".part" + std::to_string(::getpid());
  std::ofstream out(target, std::ios::binary);
  if (!out) throw data_error(path + ": cannot write: " + std::strerror(errno) + "; does the folder exist?");
  try {
    write(out);
  } catch (...) {
    out.close();
    if (!special) std::remove(target.c_str());
    throw;
  }
  out.close();
  if (!out || (!special && std::rename(target.c_str(), path.c_str()) != 0)) {
    const std::string reason = std::strerror(errno);
    if (!special) std::remove(target.c_str());
    throw data_error(path + ": cannot write: " + reason);
  }
}

void write_text(const std::string& path, const std::string& text) {
  write_stream(path, [&](std::ostream& out) { out << text; });
}

void write_json(const std::string& path, const Json& json) { write_text(path, json.dump(1) + "\n"); }

}  // namespace imucal
