// SPDX-License-Identifier: MIT
// num, crc, sample, status: small parts that everything else trusts.
#include "unit.h"

#include "crc.h"
#include "num.h"
#include "sample.h"

static void test_crc_check_string_gives_published_value(void** state) {
  (void)state;
  assert_int_equal(imucal_crc32((const uint8_t*)"123456789", 9), 0xCBF43926u); /* Rocksoft model's check value */
  assert_int_equal(imucal_crc32(NULL, 0), 0);
}

static void test_crc_in_pieces_equals_whole(void** state) {
  (void)state;
  uint8_t data[300];
  unit_rng_t rng = {unit_seed()};
  for (size_t i = 0; i < sizeof data; i++) data[i] = (uint8_t)unit_bits(&rng);
  for (size_t cut = 0; cut <= sizeof data; cut += 7) {
    uint32_t running = imucal_crc_add(IMUCAL_CRC_INIT, data, cut);
    running = imucal_crc_add(running, data + cut, sizeof data - cut);
    assert_int_equal(imucal_crc_end(running), imucal_crc32(data, sizeof data));
  }
}

/* The definition, bit by bit: every entry of the table is met. */
static void test_crc_of_every_byte_is_the_polynomial_s(void** state) {
  (void)state;
  uint8_t data[256];
  uint32_t expected = 0xFFFFFFFFu;
  for (uint32_t i = 0; i < 256; i++) {
    data[i] = (uint8_t)i;
    expected ^= i;
    for (int bit = 0; bit < 8; bit++) expected = expected >> 1 ^ (expected & 1u ? 0xEDB88320u : 0u);
    assert_int_equal(imucal_crc32(data, i + 1), (uint32_t)~expected);
  }
}

/* sqrt in double rounded to float is the correctly rounded float root (53 >= 2*24 + 2: Figueroa 1995). */
static void expect_root(uint32_t bits) {
  float value = imucal_float_from_bits(bits);
  uint32_t expected = imucal_bits_from_float((float)sqrt((double)value));
  uint32_t got = imucal_bits_from_float(imucal_sqrtf(value));
  if (got != expected) fail_msg("sqrt of bits 0x%08x: 0x%08x, expected 0x%08x", bits, got, expected);
}

static void test_sqrtf_is_correctly_rounded(void** state) {
  (void)state;
  unit_rng_t rng = {unit_seed()};
  for (int i = 0; i < 2000000; i++) expect_root((uint32_t)unit_bits(&rng) % 0x7F800000u);
  for (uint32_t exponent = 0; exponent < 255; exponent++) {
    for (uint32_t i = 0; i < 64; i++) expect_root(exponent << 23 | i);               /* just above a power of two */
    for (uint32_t i = 0; i < 64; i++) expect_root((exponent << 23) + 0x7FFFFFu - i); /* just below the next */
  }
  for (uint32_t i = 0; i < 4096; i++) { /* squares and their neighbours */
    uint32_t bits = imucal_bits_from_float((float)(i * i));
    expect_root(bits);
    expect_root(bits + 1);
  }
}

static void test_sqrtf_outside_its_domain_gives_zero(void** state) {
  (void)state;
  const uint32_t outside[] = {0x80000000u, 0xBF800000u, 0x7F800000u, 0xFF800000u, 0x7FC00000u, 0};
  for (size_t i = 0; i < sizeof outside / 4; i++)
    assert_int_equal(imucal_bits_from_float(imucal_sqrtf(imucal_float_from_bits(outside[i]))), 0);
}

static void test_is_finite_is_decided_by_bits(void** state) {
  (void)state;
  assert_true(imucal_is_finite(0.0f));
  assert_true(imucal_is_finite(-3.4e38f));
  assert_true(imucal_is_finite(1e-45f));
  assert_false(imucal_is_finite(imucal_float_from_bits(0x7F800000u)));
  assert_false(imucal_is_finite(imucal_float_from_bits(0xFF800000u)));
  assert_false(imucal_is_finite(imucal_float_from_bits(0x7F800001u)));
}

static void test_is_within_takes_both_ends_and_finite_values_only(void** state) {
  (void)state;
  const float infinite = imucal_float_from_bits(0x7F800000u), nan_value = imucal_float_from_bits(0x7FC00000u);
  const float below = imucal_float_from_bits(imucal_bits_from_float(1.0f) - 1u),
              above = imucal_float_from_bits(imucal_bits_from_float(2.0f) + 1u);
  assert_true(imucal_is_within(1.0f, 1.0f, 2.0f));
  assert_true(imucal_is_within(1.5f, 1.0f, 2.0f));
  assert_true(imucal_is_within(2.0f, 1.0f, 2.0f));
  assert_false(imucal_is_within(below, 1.0f, 2.0f));
  assert_false(imucal_is_within(above, 1.0f, 2.0f));
  assert_false(imucal_is_within(nan_value, 1.0f, 2.0f));
  assert_false(imucal_is_within(infinite, 1.0f, infinite));
  assert_false(imucal_is_within(-infinite, -infinite, 2.0f));
}

static void test_divide_rne_rounds_ties_to_even(void** state) {
  (void)state;
  const int64_t cases[][3] = {{5, 2, 2},   {7, 2, 4}, {-5, 2, -2}, {-7, 2, -4}, {1, 3, 0},  {2, 3, 1},  {-1, 3, 0},
                              {-2, 3, -1}, {0, 9, 0}, {9, 9, 1},   {-9, 9, -1}, {10, 4, 2}, {14, 4, 4}, {-10, 4, -2}};
  for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
    assert_int_equal(imucal_divide_rne(cases[i][0], cases[i][1]), cases[i][2]);
}

static void test_little_endian_round_trip_and_order(void** state) {
  (void)state;
  uint8_t bytes[8];
  imucal_put_u64(bytes, 0x0102030405060708ULL);
  const uint8_t expected[8] = {8, 7, 6, 5, 4, 3, 2, 1};
  assert_memory_equal(bytes, expected, 8);
  assert_true(imucal_get_u64(bytes) == 0x0102030405060708ULL);
  imucal_put_f32(bytes, -1.5f);
  assert_int_equal(imucal_get_u32(bytes), 0xBFC00000u);
  assert_true(imucal_get_f32(bytes) == -1.5f);
}

static void test_sample_record_golden_bytes(void** state) {
  (void)state;
  imucal_sample_t sample = {.t_us = 0x1122334455667788ULL,
                            .temp_counts = -2,
                            .counts = {1, -1, INT32_MIN, 7, 8, 9},
                            .n_channels = 3,
                            .saturated = 4,
                            .fault = 1};
  uint8_t record[IMUCAL_SAMPLE_RECORD_BYTES];
  imucal_sample_encode(&sample, record);
  const uint8_t expected[IMUCAL_SAMPLE_RECORD_BYTES] = {
      0xA5, 3,    4,    1,    0xFE, 0xFF, 0xFF, 0xFF, 0x88, 0x77, 0x66, 0x55, 0x44, 0x33, 0x22, 0x11, 1, 0, 0, 0,
      0xFF, 0xFF, 0xFF, 0xFF, 0,    0,    0,    0x80, 0,    0,    0,    0,    0,    0,    0,    0,    0, 0, 0, 0};
  assert_memory_equal(record, expected, sizeof expected);
  imucal_sample_t back;
  assert_int_equal(imucal_sample_decode(record, &back), IMUCAL_OK);
  assert_true(back.t_us == sample.t_us && back.temp_counts == -2 && back.counts[2] == INT32_MIN);
  assert_int_equal(back.saturated, 4);
  assert_int_equal(back.fault, 1);
}

static void test_sample_record_of_all_channels_and_not_a_byte_more(void** state) {
  (void)state;
  imucal_sample_t sample = {.n_channels = IMUCAL_MAX_CHANNELS}, back;
  for (int i = 0; i < IMUCAL_MAX_CHANNELS; i++) sample.counts[i] = 1000 + i;
  uint8_t record[IMUCAL_SAMPLE_RECORD_BYTES + 8];
  memset(record, 0xEE, sizeof record);
  memset(&back, 0x5A, sizeof back);
  imucal_sample_encode(&sample, record);
  for (size_t i = IMUCAL_SAMPLE_RECORD_BYTES; i < sizeof record; i++) assert_int_equal(record[i], 0xEE);
  assert_int_equal(imucal_sample_decode(record, &back), IMUCAL_OK);
  assert_int_equal(back.n_channels, IMUCAL_MAX_CHANNELS);
  for (int i = 0; i < IMUCAL_MAX_CHANNELS; i++) assert_int_equal(back.counts[i], 1000 + i);
}

static void test_sample_record_malformed_is_refused(void** state) {
  (void)state;
  uint8_t record[IMUCAL_SAMPLE_RECORD_BYTES] = {IMUCAL_SAMPLE_MARKER, 7};
  imucal_sample_t sample;
  assert_int_equal(imucal_sample_decode(record, &sample), IMUCAL_ERR_CHANNELS);
  record[1] = 0;
  assert_int_equal(imucal_sample_decode(record, &sample), IMUCAL_ERR_CHANNELS);
  record[0] = 0;
  assert_int_equal(imucal_sample_decode(record, &sample), IMUCAL_ERR_SYNC);
}

static void test_status_every_value_has_its_own_text(void** state) {
  (void)state;
  const char* unknown = imucal_status_text((imucal_status)-1000);
  int n_known = 0;
  for (int a = -120; a < 20; a++) {
    const char* text = imucal_status_text((imucal_status)a);
    assert_non_null(text);
    if (strcmp(text, unknown) == 0) continue;
    n_known++;
    for (int b = -120; b < a; b++) assert_string_not_equal(text, imucal_status_text((imucal_status)b));
  }
  assert_true(n_known >= 40);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_crc_check_string_gives_published_value),
      cmocka_unit_test(test_crc_in_pieces_equals_whole),
      cmocka_unit_test(test_sqrtf_is_correctly_rounded),
      cmocka_unit_test(test_sqrtf_outside_its_domain_gives_zero),
      cmocka_unit_test(test_is_finite_is_decided_by_bits),
      cmocka_unit_test(test_divide_rne_rounds_ties_to_even),
      cmocka_unit_test(test_little_endian_round_trip_and_order),
      cmocka_unit_test(test_sample_record_golden_bytes),
      cmocka_unit_test(test_crc_of_every_byte_is_the_polynomial_s),
      cmocka_unit_test(test_is_within_takes_both_ends_and_finite_values_only),
      cmocka_unit_test(test_sample_record_of_all_channels_and_not_a_byte_more),
      cmocka_unit_test(test_sample_record_malformed_is_refused),
      cmocka_unit_test(test_status_every_value_has_its_own_text),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
