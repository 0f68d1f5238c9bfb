// SPDX-License-Identifier: MIT
// The verdict, row by row of the table in host/lib/analysis/diagnose/judge/README.md.
#include "analysis/diagnose/judge/verdict.h"

#include <vector>

#include "near.h"

using namespace imucal;

static const Told kNothing, kCause = {true, true, false, false}, kOpenShape = {true, false, true, false},
                            kUndecided = {true, false, false, true}, kCauseAndShape = {true, true, true, false},
                            kCauseAndUndecided = {true, true, false, true};

// One thing left at a time.
static std::vector<Left> each_thing() {
  std::vector<Left> out(5);
  out[0].finding = out[1].shape = out[2].minutes = out[3].growth = out[4].part = true;
  return out;
}
static void is(Verdict verdict, const Told& told, const Left& left) {
  assert_int_equal(static_cast<int>(verdict_of(told, left)), static_cast<int>(verdict));
}

static void nothing_told_and_nothing_left_is_no_gap(void**) {
  is(Verdict::kNoGap, kNothing, {});
}

static void nothing_told_is_a_gap_where_something_is_left(void**) {
  const std::vector<Left> left = each_thing();
  for (size_t i : {0U, 1U, 2U}) is(Verdict::kUnexplained, kNothing, left[i]);
  // Without an answer nothing grows and nothing is shrunk.
  for (size_t i : {3U, 4U}) is(Verdict::kNoGap, kNothing, left[i]);
}

static void minutes_of_one_passage_prove_no_gap_but_spoil_an_answer(void**) {
  Left left;
  left.minutes = left.are_of_one_passage = true;
  is(Verdict::kNoGap, kNothing, left);
  is(Verdict::kPartlyExplained, kCause, left);
}

static void an_open_shape_alone_explains_nothing(void**) {
  is(Verdict::kUnexplained, kOpenShape, {});
  for (const Left& left : each_thing()) is(Verdict::kUnexplained, kOpenShape, left);
}

static void a_cause_explains_where_nothing_is_left(void**) {
  is(Verdict::kExplained, kCause, {});
  for (const Left& left : each_thing()) is(Verdict::kPartlyExplained, kCause, left);
}

static void a_part_is_explained_where_something_told_is_open(void**) {
  for (const Told& told : {kUndecided, kCauseAndShape, kCauseAndUndecided}) {
    is(Verdict::kPartlyExplained, told, {});
    for (const Left& left : each_thing()) is(Verdict::kPartlyExplained, told, left);
  }
}

int main() {
  const CMUnitTest tests[] = {
      cmocka_unit_test(nothing_told_and_nothing_left_is_no_gap),
      cmocka_unit_test(nothing_told_is_a_gap_where_something_is_left),
      cmocka_unit_test(minutes_of_one_passage_prove_no_gap_but_spoil_an_answer),
      cmocka_unit_test(an_open_shape_alone_explains_nothing),
      cmocka_unit_test(a_cause_explains_where_nothing_is_left),
      cmocka_unit_test(a_part_is_explained_where_something_told_is_open),
  };
  return cmocka_run_group_tests(tests, nullptr, nullptr);
}
