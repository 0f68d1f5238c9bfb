// SPDX-License-Identifier: MIT
// JSON values: written as nlohmann/json writes them, read as it reads them, and braces mean what they mean to it.
#include <cmath>
#include <csetjmp>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>
extern "C" {
#include <cmocka.h>
}

#include "base/error.h"
#include "io/json_file.h"

using namespace imucal;
using Peer = nlohmann::ordered_json;

namespace {

void assert_same(const Json& json, const Peer& peer) {
  for (const int indent : {-1, 0, 1, 4})
    assert_string_equal(json.dump(indent).c_str(),
                        peer.dump(indent, ' ', false, Peer::error_handler_t::replace).c_str());
}

std::string refusal(const std::string& text) {
  try {
    parse_json(text, "t.json");
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

void test_text_read_and_written_is_that_of_the_library(void**) {
  for (const char* text :
       {"null", "true", "[]", "{}", "[[]]", R"({"a":{}})", R"({"b":[1,-2,3.5,"x",null,false],"a":{"c":[{}]}})",
        "[0.1,1e-7,1e300,-0.0,1.0,123456789012345678,-9223372036854775808,18446744073709551615,1e2]",
        R"(["\u00e9\u0001\"\\\n","\ud83d\ude00",""])"})
    assert_same(parse_json(text, "t").json(), Peer::parse(text));
}

void test_values_made_with_braces_are_those_of_the_library(void**) {
  const std::vector<double> numbers = {1.5, NAN, std::numeric_limits<double>::infinity()};
  const std::vector<std::vector<int>> rows = {{1, 2}, {}};
  assert_same({{"n", 1}, {"u", 7u}, {"x", 0.25f}, {"no", nullptr}, {"list", {1, 2}}, {"texts", {"a", "b"}}},
              {{"n", 1}, {"u", 7u}, {"x", 0.25f}, {"no", nullptr}, {"list", {1, 2}}, {"texts", {"a", "b"}}});
  assert_same({{"numbers", numbers}, {"rows", rows}, {"yes", true}},
              {{"numbers", numbers}, {"rows", rows}, {"yes", true}});
  assert_same({{"a", 1}, {"a", 2}}, {{"a", 1}, {"a", 2}});
  assert_same(Json::array({{"a", "b"}, {"c", "d"}}), Peer::array({{"a", "b"}, {"c", "d"}}));
  assert_same({1, {2, "x"}}, {1, {2, "x"}});
  assert_same("bad \xff bytes", "bad \xff bytes");
}

void test_members_keep_their_order_and_are_replaced_in_place(void**) {
  Json json;
  json["z"] = 1, json["a"].push_back(2), json["z"] = "new";
  json.update({{"a", nullptr}, {"m", true}});
  assert_string_equal(json.dump().c_str(), R"({"z":"new","a":null,"m":true})");
  assert_true(json.contains("m") && !json.contains("b") && json.size() == 3);
}

void test_copies_are_apart_and_what_was_moved_is_null(void**) {
  Json a = {{"list", {1, 2}}};
  Json b = a;
  b["list"].push_back(3);
  assert_int_equal(a["list"].size(), 2);
  const Json c = std::move(b);
  assert_int_equal(c["list"].size(), 3);
  assert_true(b.is_null() && b.empty());
}

void test_numbers_are_equal_as_numbers(void**) {
  assert_true(Json(1) == Json(1u) && Json(1) == Json(1.0) && Json(-1) == Json(-1.0));
  assert_true(Json(-1) != Json(std::numeric_limits<uint64_t>::max()) && Json(1) != Json(true) &&
              Json(0) != Json(nullptr));
  assert_true(Json({{"a", 1}, {"b", 2}}) != Json({{"b", 2}, {"a", 1}}));
  assert_true(Json({{"a", {1, "x"}}}) == Json({{"a", {1.0, "x"}}}));
}

template <typename Ask> bool is_misuse(const Ask& ask) {
  try {
    ask();
  } catch (const std::logic_error&) {
    return true;
  }
  return false;
}

void test_to_ask_for_what_is_not_there_is_an_error(void**) {
  const Json json = {{"list", {1, 2}}, {"text", "x"}};
  assert_true(is_misuse([&] { json["other"]; }) && is_misuse([&] { json["list"][2]; }));
  assert_true(is_misuse([&] { static_cast<void>(double(json["text"])); }));
  assert_true(is_misuse([&] { static_cast<void>(bool(json["list"][0])); }));
  assert_true(is_misuse([&] { json["list"].text(); }) && is_misuse([] { Json("x").push_back(1); }));
  assert_true(int(json["list"][1]) == 2 && json["text"].text() == "x");
}

void test_malformed_text_is_refused_with_its_line(void**) {
  assert_string_equal(refusal("{\n\"a\": 1,\n\"a\": 2}").c_str(), "t.json:3: field \"a\" is given twice");
  assert_string_equal(refusal("[1,\n1e999]").c_str(), "t.json:2: the number 1e999 is too large");
  assert_non_null(std::strstr(refusal("[1,\n2").c_str(), "t.json:2: not valid JSON"));
  assert_non_null(std::strstr(refusal("{} x").c_str(), "t.json:1: not valid JSON"));
  assert_non_null(
      std::strstr(refusal(std::string("{}\n\0 \"a\": 1}", 12)).c_str(), "t.json:2: not valid JSON: a zero byte"));
  assert_string_equal(refusal("{\"a\":{\"a\":[{\"a\":1}]}}").c_str(), ""); // the same name in other objects
}

void test_text_that_is_too_deep_is_refused(void**) {
  const auto nested = [](size_t n) { return std::string(n, '[') + std::string(n, ']'); };
  assert_string_equal(refusal(nested(100)).c_str(), "");
  assert_string_equal(refusal(nested(101)).c_str(), "t.json: lists and objects stand in each other more than 100 deep");
  assert_string_not_equal(refusal(nested(1000000)).c_str(), "");
}

} // namespace

int main() {
  const CMUnitTest tests[] = {
      cmocka_unit_test(test_text_read_and_written_is_that_of_the_library),
      cmocka_unit_test(test_values_made_with_braces_are_those_of_the_library),
      cmocka_unit_test(test_members_keep_their_order_and_are_replaced_in_place),
      cmocka_unit_test(test_copies_are_apart_and_what_was_moved_is_null),
      cmocka_unit_test(test_numbers_are_equal_as_numbers),
      cmocka_unit_test(test_to_ask_for_what_is_not_there_is_an_error),
      cmocka_unit_test(test_malformed_text_is_refused_with_its_line),
      cmocka_unit_test(test_text_that_is_too_deep_is_refused),
  };
  return cmocka_run_group_tests(tests, nullptr, nullptr);
}
