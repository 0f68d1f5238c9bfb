// SPDX-License-Identifier: MIT
// table: bytes there and back, a golden header, every kind of nonsense with its own status, every flipped bit.
#include "unit.h"

#include "crc.h"
#include "num.h"
#include "table.h"
#include "table_example.h"

static void test_encode_decode_gives_the_same_table(void** state) {
  (void)state;
  for (int n = 1; n <= IMUCAL_MAX_CHANNELS; n++) {
    imucal_table_t table = example_table(n, 5), back;
    uint8_t bytes[IMUCAL_TABLE_MAX_BYTES + 100];
    memset(bytes, 0xEE, sizeof bytes);
    size_t len = 0;
    assert_int_equal(imucal_table_encode(&table, bytes, sizeof bytes, &len), IMUCAL_OK);
    assert_int_equal(len, 48 + 136 * n);
    assert_int_equal(bytes[len], 0xEE);
    assert_int_equal(imucal_table_decode(bytes, sizeof bytes, &back, NULL), IMUCAL_OK);
    assert_memory_equal(&back, &table, sizeof table);
    assert_int_equal(imucal_table_decode(bytes, len, NULL, NULL), IMUCAL_OK);
    assert_int_equal(imucal_table_decode(bytes, len - 1, &back, NULL), IMUCAL_ERR_LENGTH);
    assert_int_equal(imucal_table_encode(&table, bytes, len - 1, &len), IMUCAL_ERR_SPACE);
  }
}

static void test_six_channels_fit_a_1_kb_page_with_the_store_words(void** state) {
  (void)state;
  assert_true(IMUCAL_TABLE_MAX_BYTES + 8 <= 1024);
}

/* The offsets of table.md, by hand. */
static void test_encode_golden_offsets(void** state) {
  (void)state;
  imucal_table_t table = example_table(2, 0);
  table.sequence = 0x01020304;
  uint8_t b[IMUCAL_TABLE_MAX_BYTES];
  size_t len = 0;
  assert_int_equal(imucal_table_encode(&table, b, sizeof b, &len), IMUCAL_OK);
  const uint8_t head[] = {'I', 'M', 'C', 'L', 1, 0, 320 & 255, 320 >> 8, 'S', 'N', '-', '1',  '7',  0,    0, 0, 0, 0,
                          0,   0,   0,   0,   0, 0, 4,         3,        2,   1,   0,   0xB9, 0x55, 0x69, 2, 0, 0, 0};
  assert_memory_equal(b, head, sizeof head);
  assert_true(imucal_get_f32(b + 36) == 0.01f && imucal_get_f32(b + 40) == 25.0f);
  const uint8_t* c = b + 44 + 136; /* the second channel */
  assert_memory_equal(c, "gy_dph\0\0\0\0\0\0\3\1\1\0", 16);
  assert_true(imucal_get_f32(c + 16) == 30.0f && imucal_get_f32(c + 20) == 30.0f);    /* t0, range */
  assert_true(imucal_get_f32(c + 24) == 10.25f && imucal_get_f32(c + 36) == 13.25f);  /* b0, b3 */
  assert_true(imucal_get_f32(c + 48 + 4) == 0.001f);                                  /* m1 */
  assert_true(imucal_get_f32(c + 60) == 0.0f && imucal_get_f32(c + 64) == 60.0f);     /* span */
  assert_true(imucal_get_f32(c + 68) == 5.0f && imucal_get_f32(c + 100) == 13.0f);    /* sigma */
  assert_true(imucal_get_f32(c + 104) == 0.6f && imucal_get_f32(c + 108) == 20.0f);   /* arw, Markov sigma */
  assert_true(imucal_get_f32(c + 116) == 100.0f && imucal_get_f32(c + 124) == 18.0f); /* tau, unit per count */
  assert_int_equal(imucal_get_u32(c + 128), 32767);
  assert_int_equal(imucal_get_u32(c + 132), 8400);
  assert_int_equal(imucal_get_u32(b + 316), imucal_crc32(b, 316));
}

static void test_decode_any_flipped_bit_is_refused(void** state) {
  (void)state;
  imucal_table_t table = example_table(6, 1), back;
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  size_t len = 0;
  assert_int_equal(imucal_table_encode(&table, bytes, sizeof bytes, &len), IMUCAL_OK);
  for (size_t bit = 0; bit < 8 * len; bit++) {
    bytes[bit / 8] ^= (uint8_t)(1 << bit % 8);
    assert_int_not_equal(imucal_table_decode(bytes, len, &back, NULL), IMUCAL_OK);
    bytes[bit / 8] ^= (uint8_t)(1 << bit % 8);
  }
  assert_int_equal(imucal_table_decode(bytes, len, &back, NULL), IMUCAL_OK);
}

static void seal(uint8_t* bytes, size_t len) {
  imucal_put_u32(bytes + len - 4, imucal_crc32(bytes, len - 4));
}

static void test_decode_header_nonsense_has_its_own_status(void** state) {
  (void)state;
  imucal_table_t table = example_table(3, 1), back;
  uint8_t good[IMUCAL_TABLE_MAX_BYTES], b[IMUCAL_TABLE_MAX_BYTES];
  size_t len = 0;
  assert_int_equal(imucal_table_encode(&table, good, sizeof good, &len), IMUCAL_OK);
  const struct {
    size_t at;
    uint8_t value;
    imucal_status status;
    const char* field;
  } bad[] = {{0, 'X', IMUCAL_ERR_MAGIC, "header"}, {4, 2, IMUCAL_ERR_VERSION, "version"},
             {6, 47, IMUCAL_ERR_LENGTH, "length"}, {7, 9, IMUCAL_ERR_LENGTH, "header"},
             {32, 2, IMUCAL_ERR_LENGTH, "length"}, {33, 1, IMUCAL_ERR_RESERVED, "reserved"},
             {8, 0, IMUCAL_ERR_NAME, "serial"},    {9, ' ', IMUCAL_ERR_NAME, "serial"},
             {20, 'x', IMUCAL_ERR_NAME, "serial"}, {44 + 136 + 15, 9, IMUCAL_ERR_RESERVED, "reserved"}};
  for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
    memcpy(b, good, len);
    b[bad[i].at] = bad[i].value;
    size_t sealed = imucal_get_u16(b + 6);
    if (sealed >= 8 && sealed <= sizeof b) seal(b, sealed);
    imucal_table_place_t place = {0, IMUCAL_FIELD_NONE};
    imucal_status status = imucal_table_decode(b, sizeof b, &back, &place);
    if (status != bad[i].status) fail_msg("case %zu: %s", i, imucal_status_text(status));
    assert_string_equal(imucal_table_field_text(place.field), bad[i].field);
  }
  memcpy(b, good, len);
  b[100] ^= 1;
  assert_int_equal(imucal_table_decode(b, len, &back, NULL), IMUCAL_ERR_CRC);
  assert_int_equal(imucal_table_decode(b, 10, &back, NULL), IMUCAL_ERR_LENGTH);
}

static void test_validate_field_nonsense_has_its_own_status_and_place(void** state) {
  (void)state;
  const float nan_value = imucal_float_from_bits(0x7FC00000u), infinite = imucal_float_from_bits(0x7F800000u);
  imucal_table_t t;
  imucal_table_place_t place;
  int n = 0;
#define REFUSED(change, expected, name)                                                                                \
  t = example_table(6, 2);                                                                                             \
  change;                                                                                                              \
  place = (imucal_table_place_t){99, IMUCAL_FIELD_NONE};                                                               \
  assert_int_equal(imucal_table_validate(&t, &place), expected);                                                       \
  assert_string_equal(imucal_table_field_text(place.field), name);                                                     \
  assert_int_equal(place.channel, strstr(#change, "channel[4]") ? 4 : -1);                                             \
  n++
#define C t.channel[4]
  REFUSED(t.channel[4].coeff[2] = nan_value, IMUCAL_ERR_COEFFICIENT, "coeff");
  REFUSED(t.channel[4].coeff[0] = infinite, IMUCAL_ERR_COEFFICIENT, "coeff");
  REFUSED(t.channel[4].coeff[1] = 1.1e7f, IMUCAL_ERR_COEFFICIENT, "coeff");
  REFUSED(t.channel[4].coeff[4] = 1, IMUCAL_ERR_COEFFICIENT, "coeff"); /* above the order */
  REFUSED(t.channel[4].order = 0, IMUCAL_ERR_COEFFICIENT, "coeff");    /* uncalibrated with coefficients */
  REFUSED(t.channel[4].order = 6, IMUCAL_ERR_ORDER, "order");
  REFUSED(t.channel[4].scale_order = 3, IMUCAL_ERR_ORDER, "scale_order");
  REFUSED(t.channel[4].scale_coeff[0] = 0.07f, IMUCAL_ERR_COEFFICIENT, "scale_coeff");
  REFUSED(t.channel[4].scale_coeff[0] = -0.062f, IMUCAL_ERR_COEFFICIENT, "scale_coeff"); /* with m1 above 1/16 */
  REFUSED(t.channel[4].scale_coeff[0] = nan_value, IMUCAL_ERR_COEFFICIENT, "scale_coeff");
  REFUSED(t.channel[4].scale_coeff[2] = 1e-9f, IMUCAL_ERR_COEFFICIENT, "scale_coeff");
  REFUSED(t.channel[4].span_hi_degc = -1, IMUCAL_ERR_SPAN, "span_degc"); /* reversed */
  REFUSED(t.channel[4].span_hi_degc = 0, IMUCAL_ERR_SPAN, "span_degc");  /* empty */
  REFUSED(t.channel[4].span_hi_degc = 60.1f, IMUCAL_ERR_SPAN, "span_degc");
  REFUSED(t.channel[4].span_lo_degc = -0.1f, IMUCAL_ERR_SPAN, "span_degc");
  REFUSED(t.channel[4].span_lo_degc = nan_value, IMUCAL_ERR_SPAN, "span_degc");
  REFUSED(t.channel[4].range_degc = 0, IMUCAL_ERR_SPAN, "range_degc");
  REFUSED(t.channel[4].t0_degc = infinite, IMUCAL_ERR_SPAN, "t0_degc");
  REFUSED(t.channel[4].sigma[8] = -1, IMUCAL_ERR_SIGMA, "sigma");
  REFUSED(t.channel[4].sigma[0] = nan_value, IMUCAL_ERR_SIGMA, "sigma");
  REFUSED(t.channel[4].arw = -1, IMUCAL_ERR_MODEL, "model");
  REFUSED(t.channel[4].markov_tau_s[0] = 0, IMUCAL_ERR_MODEL, "model");
  REFUSED(t.channel[4].markov_sigma[1] = 1, IMUCAL_ERR_MODEL, "model"); /* above n_markov */
  REFUSED(t.channel[4].n_markov = 3, IMUCAL_ERR_MODEL, "markov");
  REFUSED(t.channel[4].unit_per_count = 0, IMUCAL_ERR_SCALE, "unit_per_count");
  REFUSED(t.channel[4].unit_per_count = nan_value, IMUCAL_ERR_SCALE, "unit_per_count");
  REFUSED(t.channel[4].full_scale_counts = 0, IMUCAL_ERR_SCALE, "full_scale_counts");
  REFUSED(t.channel[4].name[0] = 0, IMUCAL_ERR_NAME, "name");
  REFUSED(t.channel[4].name[11] = 'x', IMUCAL_ERR_NAME, "name");            /* text after its end */
  REFUSED(t.channel[4].name[2] = '-', IMUCAL_ERR_NAME, "name");             /* no unit */
  REFUSED(memcpy(t.channel[4].name, "gx_dph", 6), IMUCAL_ERR_NAME, "name"); /* of another channel */
  REFUSED(memcpy(t.channel[4].name, "gy_dph", 6), IMUCAL_ERR_NAME, "name");
  REFUSED(t.degc_per_count = -0.01f, IMUCAL_ERR_SCALE, "degc_per_count");
  REFUSED(t.degc_at_zero = nan_value, IMUCAL_ERR_SCALE, "degc_at_zero");
  REFUSED(t.n_channels = 0, IMUCAL_ERR_CHANNELS, "channels");
  REFUSED(t.n_channels = 7, IMUCAL_ERR_CHANNELS, "channels");
  REFUSED(t.sequence = 0, IMUCAL_ERR_SEQUENCE, "sequence");
  REFUSED(t.sequence = UINT32_MAX, IMUCAL_ERR_SEQUENCE, "sequence");
  REFUSED(t.serial[2] = '\n', IMUCAL_ERR_NAME, "serial");
  assert_int_equal(n, 39);
  t = example_table(6, 2);
  assert_int_equal(imucal_table_validate(&t, NULL), IMUCAL_OK);
}

static void test_validate_channel_says_what_validate_says_of_its_table(void** state) {
  (void)state;
  imucal_table_t t = example_table(1, 2);
  const imucal_table_channel_t* c = &t.channel[0];
  assert_int_equal(imucal_table_validate_channel(c, t.degc_per_count, t.degc_at_zero), IMUCAL_OK);
  assert_int_equal(imucal_table_validate_channel(c, 0.0f, t.degc_at_zero), IMUCAL_ERR_SCALE);
  assert_int_equal(imucal_table_validate_channel(c, t.degc_per_count, 2e6f), IMUCAL_ERR_SCALE);
  t.channel[0].name[2] = 'x';
  assert_int_equal(imucal_table_validate_channel(c, t.degc_per_count, t.degc_at_zero), IMUCAL_ERR_NAME);
  t.channel[0].name[2] = '_';
  t.channel[0].arw = -1.0f;
  assert_int_equal(imucal_table_validate_channel(c, t.degc_per_count, t.degc_at_zero), IMUCAL_ERR_MODEL);
  t.channel[0].span_hi_degc = t.channel[0].span_lo_degc; /* the first field that is wrong */
  assert_int_equal(imucal_table_validate_channel(c, t.degc_per_count, t.degc_at_zero), IMUCAL_ERR_SPAN);
}

static void test_text_set_refuses_what_does_not_fit(void** state) {
  (void)state;
  char text[12];
  assert_int_equal(imucal_text_set(text, 12, "gx_dph"), IMUCAL_OK);
  assert_memory_equal(text, "gx_dph\0\0\0\0\0\0", 12);
  assert_int_equal(imucal_text_set(text, 12, "123456789012"), IMUCAL_OK);
  assert_int_equal(imucal_text_set(text, 12, "1234567890123"), IMUCAL_ERR_NAME);
  assert_int_equal(imucal_text_set(text, 12, ""), IMUCAL_ERR_NAME);
  assert_int_equal(imucal_text_set(text, 12, "a b"), IMUCAL_ERR_NAME);
  assert_true(imucal_text_equal("ab\0x", "ab\0y", 4));
  assert_false(imucal_text_equal("ab", "ac", 3));
}

static void test_text_is_valid_up_to_its_zeros(void** state) {
  (void)state;
  assert_true(imucal_text_is_valid("ab\0\0", 4));
  assert_true(imucal_text_is_valid("abcd", 4)); /* full: no zero */
  assert_false(imucal_text_is_valid("\0\0\0\0", 4));
  assert_false(imucal_text_is_valid("a b\0", 4));
  assert_false(imucal_text_is_valid("ab\x7F\0", 4));
  assert_false(imucal_text_is_valid("a\0b\0", 4));
}

static void test_from_kf_takes_what_the_filter_learnt(void** state) {
  (void)state;
  imucal_kf_config_t config = {.order = 2,
                               .t0_degc = 20,
                               .range_degc = 25,
                               .m = 0.01f,
                               .q = 8,
                               .r = 1296,
                               .markov_variance = 400,
                               .prior_sigma = 1e4f};
  imucal_kf_t kf;
  imucal_table_t table = example_table(1, 0);
  assert_int_equal(imucal_kf_init(&kf, &config), IMUCAL_OK);
  assert_int_equal(imucal_table_from_kf(&table.channel[0], &kf, 0, 45), IMUCAL_ERR_NOT_LEARNT);
  for (int i = 0; i < 5000; i++)
    assert_int_equal(imucal_kf_update(&kf, 100.0f + (float)i * 0.01f, (float)i * 0.009f), IMUCAL_OK);
  assert_int_equal(imucal_table_from_kf(&table.channel[0], &kf, 45, 0), IMUCAL_ERR_SPAN);
  assert_int_equal(imucal_table_from_kf(&table.channel[0], &kf, 0, 46), IMUCAL_ERR_SPAN);
  assert_int_equal(imucal_table_from_kf(&table.channel[0], &kf, 0, 45), IMUCAL_OK);
  assert_int_equal(imucal_table_validate(&table, NULL), IMUCAL_OK);
  assert_int_equal(table.channel[0].order, 2);
  assert_int_equal(table.channel[0].n_seconds, 5000);
  for (uint32_t i = 0; i <= 5; i++) assert_true(table.channel[0].coeff[i] == imucal_kf_coefficient(&kf, i));
  assert_true(table.channel[0].sigma[0] == imucal_kf_bias_sigma(&kf, 0));
  assert_true(table.channel[0].sigma[4] == imucal_kf_bias_sigma(&kf, 22.5f));
  assert_true(table.channel[0].sigma[8] == imucal_kf_bias_sigma(&kf, 45));
}

static void test_from_kf_never_initialised_is_not_learnt(void** state) {
  (void)state;
  imucal_kf_t kf;
  memset(&kf, 0, sizeof kf);
  kf.stats.n = 5000;
  imucal_table_t table = example_table(1, 0);
  const imucal_table_t before = table;
  assert_int_equal(imucal_table_from_kf(&table.channel[0], &kf, 0, 45), IMUCAL_ERR_NOT_LEARNT);
  assert_memory_equal(&table, &before, sizeof table);
}

static void test_encode_refuses_what_validate_refuses_and_writes_nothing(void** state) {
  (void)state;
  imucal_table_t table = example_table(2, 0);
  table.channel[1].coeff[0] = imucal_float_from_bits(0x7FC00000u);
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  memset(bytes, 0x5A, sizeof bytes);
  size_t len = 77;
  const imucal_status refused = imucal_table_validate(&table, NULL);
  assert_int_not_equal(refused, IMUCAL_OK);
  assert_int_equal(imucal_table_encode(&table, bytes, sizeof bytes, &len), refused);
  assert_int_equal(len, 77);
  for (size_t i = 0; i < sizeof bytes; i++) assert_int_equal(bytes[i], 0x5A);
}

static float next_after(float value, int steps) {
  const uint32_t bits = imucal_bits_from_float(value);
  return imucal_float_from_bits(bits + (uint32_t)steps); /* away from 0 where steps > 0 */
}

/* Every bound itself is taken; the next float beyond it is not. */
#define BOUND(member, bound, status, where)                                                                            \
  t = example_table(1, 0);                                                                                             \
  t.channel[0].range_degc = 2000, t.channel[0].span_lo_degc = -1, t.channel[0].span_hi_degc = 1;                       \
  t.channel[0].t0_degc = 0, t.channel[0].n_markov = 2, t.channel[0].markov_tau_s[1] = 1;                               \
  t.member = bound;                                                                                                    \
  if (imucal_table_validate(&t, &place) != IMUCAL_OK)                                                                  \
    fail_msg("%s = %s: %s", #member, #bound, imucal_table_field_text(place.field));                                    \
  t.member = next_after(bound, beyond);                                                                                \
  assert_int_equal(imucal_table_validate(&t, &place), status);                                                         \
  assert_string_equal(imucal_table_field_text(place.field), where);                                                    \
  assert_int_equal(place.channel, is_header ? -1 : 0)

static void test_validate_takes_each_bound_and_not_the_next_number(void** state) {
  (void)state;
  imucal_table_t t;
  imucal_table_place_t place;
  int beyond = 1, is_header = 1; /* away from 0 */
  BOUND(degc_at_zero, 1e6f, IMUCAL_ERR_SCALE, "degc_at_zero");
  BOUND(degc_at_zero, -1e6f, IMUCAL_ERR_SCALE, "degc_at_zero");
  BOUND(degc_per_count, 1e9f, IMUCAL_ERR_SCALE, "degc_per_count");
  is_header = 0;
  BOUND(channel[0].t0_degc, 1000.0f, IMUCAL_ERR_SPAN, "t0_degc");
  BOUND(channel[0].t0_degc, -1000.0f, IMUCAL_ERR_SPAN, "t0_degc");
  BOUND(channel[0].range_degc, 2000.0f, IMUCAL_ERR_SPAN, "range_degc");
  BOUND(channel[0].coeff[3], 1e7f, IMUCAL_ERR_COEFFICIENT, "coeff");
  BOUND(channel[0].coeff[3], -1e7f, IMUCAL_ERR_COEFFICIENT, "coeff");
  BOUND(channel[0].span_hi_degc, 1000.0f, IMUCAL_ERR_SPAN, "span_degc");
  BOUND(channel[0].span_lo_degc, -1000.0f, IMUCAL_ERR_SPAN, "span_degc");
  BOUND(channel[0].sigma[8], 1e6f, IMUCAL_ERR_SIGMA, "sigma");
  BOUND(channel[0].arw, 1e4f, IMUCAL_ERR_MODEL, "model");
  BOUND(channel[0].markov_sigma[1], 1e6f, IMUCAL_ERR_MODEL, "model");
  BOUND(channel[0].markov_tau_s[1], 1e9f, IMUCAL_ERR_MODEL, "model");
  BOUND(channel[0].unit_per_count, 1e9f, IMUCAL_ERR_SCALE, "unit_per_count");
  beyond = -1; /* towards 0 */
  BOUND(channel[0].sigma[0], 1e-9f, IMUCAL_ERR_SIGMA, "sigma");
  BOUND(channel[0].unit_per_count, 1e-12f, IMUCAL_ERR_SCALE, "unit_per_count");
  BOUND(channel[0].markov_tau_s[0], 1e-3f, IMUCAL_ERR_MODEL, "model");
  is_header = 1;
  BOUND(degc_per_count, 1e-12f, IMUCAL_ERR_SCALE, "degc_per_count");
}

static void test_name_stem_is_what_stands_before_the_unit(void** state) {
  (void)state;
  static const struct {
    const char name[IMUCAL_NAME_LEN + 1];
    size_t stem;
  } at[] = {{"gx_dph", 2},       {"ax_mg", 2},   {"a_dps", 1},    {"a_radps", 1}, {"a_ms2", 1}, {"gyro_x_dph_a", 0},
            {"gyro_abc_dph", 8}, {"a_b_dph", 3}, {"_dph_dph", 4}, {"_dph", 0},    {"dph", 0},   {"gyro_x", 0},
            {"gx", 0},           {"", 0},        {"gx_dph_", 0},  {"gx_DPH", 0},  {"a_mgs", 0}, {"gyro_abcd_dp", 0}};
  for (size_t i = 0; i < sizeof at / sizeof at[0]; i++)
    if (imucal_name_stem(at[i].name) != at[i].stem) fail_msg("%s: %zu", at[i].name, imucal_name_stem(at[i].name));
}

static void test_validate_takes_what_is_allowed_to_be_zero_or_largest(void** state) {
  (void)state;
  imucal_table_t t = example_table(1, 0);
  imucal_table_channel_t* c = &t.channel[0];
  c->arw = c->markov_sigma[0] = 0.0f;
  c->order = IMUCAL_MAX_ORDER;
  c->coeff[5] = 1.0f;
  c->n_markov = 2;
  c->markov_tau_s[1] = 1.0f;
  c->scale_order = 2;
  c->scale_coeff[0] = -0.03125f, c->scale_coeff[1] = 0.015625f, c->scale_coeff[2] = 0.015625f; /* 1/16 together */
  c->full_scale_counts = 1;
  memcpy(c->name, "~!gx_~_radps", IMUCAL_NAME_LEN); /* fills its field */
  assert_int_equal(imucal_table_validate(&t, NULL), IMUCAL_OK);
  memset(c->name, 0, sizeof c->name);
  memcpy(c->name, "~_mg", 4);
  assert_int_equal(imucal_table_validate(&t, NULL), IMUCAL_OK);
  c->name[0] = 127;
  assert_int_equal(imucal_table_validate(&t, NULL), IMUCAL_ERR_NAME);
  t = example_table(1, 0); /* a channel that is not calibrated has no error to state */
  memset(c->sigma, 0, sizeof c->sigma);
  assert_int_equal(imucal_table_validate(&t, NULL), IMUCAL_ERR_SIGMA);
  c->order = 0;
  memset(c->coeff, 0, sizeof c->coeff);
  assert_int_equal(imucal_table_validate(&t, NULL), IMUCAL_OK);
  t = example_table(1, 0);
  c->order = 1;
  c->coeff[2] = c->coeff[3] = 0.0f;
  assert_int_equal(imucal_table_validate(&t, NULL), IMUCAL_OK);
  c->order = 0;
  c->coeff[1] = 0.0f;
  assert_int_equal(imucal_table_validate(&t, NULL), IMUCAL_ERR_COEFFICIENT); /* b0 is left */
  c->coeff[0] = 0.0f;
  assert_int_equal(imucal_table_validate(&t, NULL), IMUCAL_OK);
  t = example_table(1, 0); /* the smallest range; its span may reach a rounding beyond it */
  c->t0_degc = 0.0f;
  c->range_degc = 1e-3f;
  c->span_lo_degc = -1e-3f * 1.00001f, c->span_hi_degc = 1e-3f * 1.00001f;
  assert_int_equal(imucal_table_validate(&t, NULL), IMUCAL_OK);
  c->span_lo_degc = next_after(c->span_lo_degc, 1);
  assert_int_equal(imucal_table_validate(&t, NULL), IMUCAL_ERR_SPAN);
  c->span_lo_degc = 0.0f, c->span_hi_degc = next_after(c->span_hi_degc, 1);
  assert_int_equal(imucal_table_validate(&t, NULL), IMUCAL_ERR_SPAN);
  c->span_hi_degc = 1e-4f, c->range_degc = next_after(1e-3f, -1);
  assert_int_equal(imucal_table_validate(&t, NULL), IMUCAL_ERR_SPAN);
}

/* Two wrong fields: the first in the order of the bytes is named. */
static void test_every_field_has_a_name(void** state) {
  (void)state;
  assert_string_equal(imucal_table_field_text(IMUCAL_FIELD_NONE), "");
  for (uint32_t field = 1; field <= IMUCAL_FIELD_FULL_SCALE; field++)
    assert_true(imucal_table_field_text(field)[0] != 0);
  assert_string_equal(imucal_table_field_text(IMUCAL_FIELD_FULL_SCALE), "full_scale_counts");
  assert_string_equal(imucal_table_field_text(IMUCAL_FIELD_FULL_SCALE + 1), "");
  assert_string_equal(imucal_table_field_text(UINT32_MAX), "");
}

static void test_validate_names_the_first_field(void** state) {
  (void)state;
  imucal_table_place_t place;
  imucal_table_t t = example_table(2, 0);
  t.channel[0].span_hi_degc = 100.0f; /* outside t0 +- range */
  t.channel[0].sigma[0] = -1.0f;
  t.channel[1].arw = -1.0f;
  assert_int_equal(imucal_table_validate(&t, &place), IMUCAL_ERR_SPAN);
  assert_string_equal(imucal_table_field_text(place.field), "span_degc");
  assert_int_equal(place.channel, 0);
  t.channel[0].span_lo_degc = (float)NAN;
  t.channel[0].span_hi_degc = 2000.0f;
  assert_int_equal(imucal_table_validate(&t, &place), IMUCAL_ERR_SPAN);
  assert_string_equal(imucal_table_field_text(place.field), "span_degc");
}

static void test_decode_header_refusals_are_of_the_header(void** state) {
  (void)state;
  imucal_table_t t = example_table(1, 0);
  imucal_table_place_t place;
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  size_t len = 0;
  assert_int_equal(imucal_table_encode(&t, bytes, sizeof bytes, &len), IMUCAL_OK);
  size_t claimed = 0;
  assert_int_equal(imucal_table_peek(bytes, IMUCAL_TABLE_HEADER_BYTES, &claimed), IMUCAL_OK);
  assert_int_equal(claimed, len);
  assert_int_equal(imucal_table_peek(bytes, IMUCAL_TABLE_HEADER_BYTES - 1, &claimed), IMUCAL_ERR_LENGTH);
  const struct {
    size_t at, have;
    uint8_t value;
    const char* field;
  } wrong[] = {{0, sizeof bytes, 'i', "header"},
               {4, sizeof bytes, 2, "version"},
               {6, sizeof bytes, IMUCAL_TABLE_BYTES(0), "header"},
               {0, 100, 'I', "length"},
               {50, sizeof bytes, 77, "crc"}};
  for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
    uint8_t copy[sizeof bytes];
    memcpy(copy, bytes, sizeof copy);
    copy[wrong[i].at] = wrong[i].value;
    assert_int_not_equal(imucal_table_decode(copy, wrong[i].have, &t, &place), IMUCAL_OK);
    assert_string_equal(imucal_table_field_text(place.field), wrong[i].field);
    assert_int_equal(place.channel, -1);
  }
}

static void test_text_first_and_last_character_count(void** state) {
  (void)state;
  char text[12];
  assert_int_equal(imucal_text_set(text, 12, " b"), IMUCAL_ERR_NAME);
  assert_int_equal(imucal_text_set(text, 12, "\x7F"), IMUCAL_ERR_NAME);
  assert_int_equal(imucal_text_set(text, 12, "~"), IMUCAL_OK);
  assert_memory_equal(text, "~\0\0\0\0\0\0\0\0\0\0\0", 12);
  assert_false(imucal_text_equal("ab", "bb", 3));
  assert_true(imucal_text_equal("abX", "abY", 2));
  assert_false(imucal_text_equal("abX", "abY", 3));
}

/* What is wrong in any channel is found, with its place, though the CRC is right; faults of the header name no channel. */
static void test_decode_finds_the_fault_of_any_channel(void** state) {
  (void)state;
  const imucal_table_t table = example_table(3, 0);
  const struct {
    uint8_t at, value;
    imucal_status status;
    const char* field;
  } fault[] = {{0, ' ', IMUCAL_ERR_NAME, "name"},
               {12, 6, IMUCAL_ERR_ORDER, "order"},
               {13, 3, IMUCAL_ERR_ORDER, "scale_order"},
               {14, 3, IMUCAL_ERR_MODEL, "markov"},
               {131, 0x80, IMUCAL_ERR_SCALE, "full_scale_counts"}};
  for (uint8_t channel = 0; channel < 3; channel++) {
    for (size_t i = 0; i < sizeof fault / sizeof fault[0]; i++) {
      uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
      size_t len = 0;
      imucal_table_t got;
      imucal_table_place_t place = {99, IMUCAL_FIELD_NONE};
      assert_int_equal(imucal_table_encode(&table, bytes, sizeof bytes, &len), IMUCAL_OK);
      bytes[IMUCAL_TABLE_HEADER_BYTES + IMUCAL_TABLE_CHANNEL_BYTES * channel + fault[i].at] = fault[i].value;
      seal(bytes, len);
      assert_int_equal(imucal_table_decode(bytes, len, &got, &place), fault[i].status);
      assert_int_equal(place.channel, channel);
      assert_string_equal(imucal_table_field_text(place.field), fault[i].field);
      assert_int_equal(imucal_table_decode(bytes, len, NULL, NULL), fault[i].status);
    }
  }
}

static void test_decode_length_and_reserved_of_the_header_name_no_channel(void** state) {
  (void)state;
  const imucal_table_t table = example_table(2, 0);
  for (uint8_t at = 32; at < 36; at++) {
    uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
    size_t len = 0;
    imucal_table_place_t place = {99, IMUCAL_FIELD_NONE};
    assert_int_equal(imucal_table_encode(&table, bytes, sizeof bytes, &len), IMUCAL_OK);
    bytes[at] = 1;
    seal(bytes, len);
    const imucal_status status = imucal_table_decode(bytes, len, NULL, &place);
    assert_int_equal(status, at == 32 ? IMUCAL_ERR_LENGTH : IMUCAL_ERR_RESERVED);
    assert_int_equal(place.channel, -1);
    assert_string_equal(imucal_table_field_text(place.field), at == 32 ? "length" : "reserved");
  }
}

static void test_from_kf_span_and_sigma_are_of_the_span_asked(void** state) {
  (void)state;
  const imucal_kf_config_t config = {.order = 2,
                                     .t0_degc = 30,
                                     .range_degc = 25,
                                     .m = 0.01f,
                                     .q = 8,
                                     .r = 1296,
                                     .markov_variance = 400,
                                     .prior_sigma = 1e4f};
  imucal_kf_t kf;
  imucal_table_t table = example_table(1, 0);
  assert_int_equal(imucal_kf_init(&kf, &config), IMUCAL_OK);
  for (int i = 0; i < 500; i++) assert_int_equal(imucal_kf_update(&kf, 100.0f, 10.0f + (float)i * 0.08f), IMUCAL_OK);
  assert_int_equal(imucal_table_from_kf(&table.channel[0], &kf, 13, 53), IMUCAL_OK);
  assert_true(table.channel[0].span_lo_degc == 13 && table.channel[0].span_hi_degc == 53);
  for (int i = 0; i < IMUCAL_TABLE_SIGMA_N; i++)
    assert_true(table.channel[0].sigma[i] == imucal_kf_bias_sigma(&kf, 13 + 5 * (float)i));
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_encode_decode_gives_the_same_table),
      cmocka_unit_test(test_six_channels_fit_a_1_kb_page_with_the_store_words),
      cmocka_unit_test(test_encode_golden_offsets),
      cmocka_unit_test(test_decode_any_flipped_bit_is_refused),
      cmocka_unit_test(test_decode_header_nonsense_has_its_own_status),
      cmocka_unit_test(test_validate_field_nonsense_has_its_own_status_and_place),
      cmocka_unit_test(test_validate_channel_says_what_validate_says_of_its_table),
      cmocka_unit_test(test_validate_takes_each_bound_and_not_the_next_number),
      cmocka_unit_test(test_validate_takes_what_is_allowed_to_be_zero_or_largest),
      cmocka_unit_test(test_every_field_has_a_name),
      cmocka_unit_test(test_name_stem_is_what_stands_before_the_unit),
      cmocka_unit_test(test_validate_names_the_first_field),
      cmocka_unit_test(test_decode_header_refusals_are_of_the_header),
      cmocka_unit_test(test_text_first_and_last_character_count),
      cmocka_unit_test(test_text_set_refuses_what_does_not_fit),
      cmocka_unit_test(test_text_is_valid_up_to_its_zeros),
      cmocka_unit_test(test_from_kf_takes_what_the_filter_learnt),
      cmocka_unit_test(test_from_kf_never_initialised_is_not_learnt),
      cmocka_unit_test(test_encode_refuses_what_validate_refuses_and_writes_nothing),
      cmocka_unit_test(test_decode_finds_the_fault_of_any_channel),
      cmocka_unit_test(test_decode_length_and_reserved_of_the_header_name_no_channel),
      cmocka_unit_test(test_from_kf_span_and_sigma_are_of_the_span_asked),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
