// SPDX-License-Identifier: MIT
// A JSON value: null, truth, number, text, list, or object, whose members keep their order.
//
//   Json json = {{"axis", "gx"}, {"tau_s", tau_s}, {"ci95", {lo, hi}}, {"events", Json::array()}};
//   json["events"].push_back({{"t_s", 3.5}, {"sigmas", 4.1}});
//   std::printf("%g %zu\n", double(json["ci95"][0]), json["events"].size());
//
// Braces mean what they mean to nlohmann/json: an object where every element is a list of two that begins with a text, else
// a list.  That library reads and writes the text, in io/json_file.cpp alone: its header takes the compiler three seconds
// wherever it is read, and each value that is made with it takes more.  This one takes a tenth of a second.
//
// To ask a value for what it is not (a member that is not there, the number of a text) is an error of the program:
// std::logic_error.  What comes from a file is read through JsonField (io/json_file.h), whose errors name the place.
#pragma once
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace imucal {

class Json {
public:
  enum class Kind : unsigned char { kNull, kBool, kInteger, kUnsigned, kReal, kText, kList, kObject };

  Json(); // null
  Json(std::nullptr_t);
  Json(bool value);
  Json(double value); // not finite: written as null
  Json(const char* text);
  Json(std::string text);
  template <typename T, std::enable_if_t<std::is_integral_v<T>, int> = 0> Json(T value) {
    if constexpr (std::is_signed_v<T>)
      kind_ = Kind::kInteger, number_.integer = value;
    else
      kind_ = Kind::kUnsigned, number_.whole = value;
  }
  template <typename T> Json(const std::vector<T>& list) : Json(array()) {
    for (const T& value : list) push_back(value);
  }
  Json(std::initializer_list<Json> elements);
  Json(const void*) = delete; // a pointer is no truth
  static Json array(std::initializer_list<Json> elements = {});
  static Json object();

  Json(const Json& other);
  Json(Json&& other) noexcept;
  Json& operator=(Json other) noexcept;
  ~Json();

  Kind kind() const { return kind_; }
  bool is_null() const { return kind_ == Kind::kNull; }
  bool is_number() const { return kind_ == Kind::kInteger || kind_ == Kind::kUnsigned || kind_ == Kind::kReal; }
  bool is_text() const { return kind_ == Kind::kText; }
  bool is_array() const { return kind_ == Kind::kList; }
  bool is_object() const { return kind_ == Kind::kObject; }

  // The value as a number or a truth.  An integer that T does not hold is cut as static_cast does.
  template <typename T, std::enable_if_t<std::is_arithmetic_v<T>, int> = 0> explicit operator T() const {
    if constexpr (std::is_same_v<T, bool>) return truth();
    if (kind_ == Kind::kInteger) return static_cast<T>(number_.integer);
    if (kind_ == Kind::kUnsigned) return static_cast<T>(number_.whole);
    return static_cast<T>(real());
  }
  const std::string& text() const;

  // Lists and objects; anything else has no elements.
  size_t size() const;
  bool empty() const { return size() == 0; }
  const Json* begin() const; // the elements, or the values of the members
  const Json* end() const;
  const std::vector<std::string>& names() const; // of the members, in the order of the elements
  const Json& operator[](size_t i) const;
  const Json& operator[](int i) const { return (*this)[static_cast<size_t>(i)]; }
  const Json* find(const std::string& name) const; // absent: nullptr
  bool contains(const std::string& name) const { return find(name) != nullptr; }
  const Json& operator[](const std::string& name) const;
  const Json& operator[](const char* name) const { return (*this)[std::string(name)]; }

  void push_back(Json element);              // to a list; null becomes one
  Json& operator[](const std::string& name); // of an object, added where absent; null becomes one
  Json& operator[](const char* name) { return (*this)[std::string(name)]; }
  Json& operator[](size_t i) { return const_cast<Json&>(std::as_const(*this)[i]); }
  Json& operator[](int i) { return (*this)[static_cast<size_t>(i)]; }
  void update(const Json& object); // its members, added or in place of those of the same name

  // Numbers are compared as numbers; objects are the same in the same order only.
  friend bool operator==(const Json& a, const Json& b);
  friend bool operator!=(const Json& a, const Json& b) { return !(a == b); }

  // The value as text: on one line, or on lines that are indented by so many spaces each level.  Bytes that are no UTF-8
  // are replaced.
  std::string dump(int indent = -1) const;

private:
  struct Body { // of a text, a list or an object
    std::string text;
    std::vector<std::string> names; // an object's
    std::vector<Json> elements;
  };
  Json(Kind kind, std::unique_ptr<Body> body);
  bool truth() const;
  double real() const;
  void become(Kind kind, const char* what); // null becomes it; anything else has to be it

  Kind kind_ = Kind::kNull;
  union {
    bool truth;
    int64_t integer;
    uint64_t whole;
    double real;
  } number_ = {};
  std::unique_ptr<Body> body_; // of kText, kList and kObject
};

class JsonField; // io/json_file.h

} // namespace imucal
