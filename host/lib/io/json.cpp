// SPDX-License-Identifier: MIT
#include "io/json.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace imucal {
namespace {

[[noreturn]] void misused(const std::string& problem) {
  throw std::logic_error("JSON: " + problem);
}

bool is_pair(const Json& json) {
  return json.is_array() && json.size() == 2 && json[0].is_text();
}

bool same_number(const Json& a, const Json& b) {
  const auto is_negative = [](const Json& x) {
    return x.kind() == Json::Kind::kInteger && static_cast<int64_t>(x) < 0;
  };
  if (a.kind() == Json::Kind::kReal || b.kind() == Json::Kind::kReal)
    return static_cast<double>(a) == static_cast<double>(b);
  return is_negative(a) == is_negative(b) && static_cast<uint64_t>(a) == static_cast<uint64_t>(b);
}

} // namespace

Json::Json() = default;
Json::Json(std::nullptr_t) {}
Json::Json(bool value) : kind_(Kind::kBool) {
  number_.truth = value;
}
Json::Json(double value) : kind_(Kind::kReal) {
  number_.real = value;
}
Json::Json(const char* text) : Json(std::string(text)) {}
Json::Json(std::string text) : Json(Kind::kText, std::make_unique<Body>()) {
  body_->text = std::move(text);
}
Json::Json(Kind kind, std::unique_ptr<Body> body) : kind_(kind), body_(std::move(body)) {}

Json::Json(std::initializer_list<Json> elements) : Json(array(elements)) {
  if (!std::all_of(elements.begin(), elements.end(), is_pair)) return;
  Json object = Json::object();
  for (Json& pair : body_->elements) // a name that is given twice: the first one holds
    if (!object.contains(pair[0].text())) object[pair[0].text()] = std::move(pair.body_->elements[1]);
  *this = std::move(object);
}

Json Json::array(std::initializer_list<Json> elements) {
  Json list(Kind::kList, std::make_unique<Body>());
  list.body_->elements = elements;
  return list;
}

Json Json::object() {
  return {Kind::kObject, std::make_unique<Body>()};
}

Json::Json(const Json& other)
    : kind_(other.kind_), number_(other.number_), body_(other.body_ ? std::make_unique<Body>(*other.body_) : nullptr) {}

Json::Json(Json&& other) noexcept
    : kind_(std::exchange(other.kind_, Kind::kNull)), number_(other.number_), body_(std::move(other.body_)) {}

Json& Json::operator=(Json other) noexcept {
  kind_ = std::exchange(other.kind_, Kind::kNull);
  number_ = other.number_;
  body_.swap(other.body_);
  return *this;
}

Json::~Json() = default;

bool Json::truth() const {
  if (kind_ != Kind::kBool) misused("is neither true nor false");
  return number_.truth;
}

double Json::real() const {
  if (kind_ != Kind::kReal) misused("is not a number");
  return number_.real;
}

const std::string& Json::text() const {
  if (!is_text()) misused("is not a text");
  return body_->text;
}

size_t Json::size() const {
  return body_ ? body_->elements.size() : 0;
}

const Json* Json::begin() const {
  return body_ ? body_->elements.data() : nullptr;
}

const Json* Json::end() const {
  return begin() + size();
}

const std::vector<std::string>& Json::names() const {
  static const std::vector<std::string> none;
  return body_ ? body_->names : none;
}

const Json& Json::operator[](size_t i) const {
  if (i >= size()) misused("has no element " + std::to_string(i));
  return body_->elements[i];
}

const Json* Json::find(const std::string& name) const {
  const auto at = std::find(names().begin(), names().end(), name);
  return at == names().end() ? nullptr : begin() + (at - names().begin());
}

const Json& Json::operator[](const std::string& name) const {
  const Json* member = find(name);
  if (!member) misused("has no member \"" + name + "\"");
  return *member;
}

void Json::become(Kind kind, const char* what) {
  if (is_null()) *this = Json(kind, std::make_unique<Body>());
  if (kind_ != kind) misused(std::string("is not ") + what);
}

void Json::push_back(Json element) {
  become(Kind::kList, "a list");
  body_->elements.push_back(std::move(element));
}

Json& Json::operator[](const std::string& name) {
  become(Kind::kObject, "an object");
  if (const Json* member = find(name)) return const_cast<Json&>(*member);
  body_->names.push_back(name);
  return body_->elements.emplace_back();
}

void Json::update(const Json& object) {
  for (size_t i = 0; i < object.names().size(); ++i) (*this)[object.names()[i]] = object[i];
}

bool operator==(const Json& a, const Json& b) {
  if (a.is_number() && b.is_number()) return same_number(a, b);
  if (a.kind_ != b.kind_) return false;
  if (a.kind_ == Json::Kind::kBool) return a.number_.truth == b.number_.truth;
  return a.is_null() ||
         (a.body_->text == b.body_->text && a.body_->names == b.body_->names && a.body_->elements == b.body_->elements);
}

} // namespace imucal
