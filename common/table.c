// SPDX-License-Identifier: MIT
#include "table.h"

#include <string.h>

#include "crc.h"
#include "num.h"

#define MAX_ABS_TEMP_DEGC 1000.0f
#define SPAN_SLACK 1.00001f /* t0 +- range in float32 may round outward; comp clamps |Tn| to 1 */
#define MAX_SCALE_SUM 0.0625f
/* No sensor is outside these; a table that is was not made by a calibration (units: dph or mg). */
#define MIN_SIGMA 1e-9f
#define MAX_SIGMA 1e6f
#define MAX_ARW 1e4f
#define MIN_TAU_S 1e-3f
#define MAX_TAU_S 1e9f
#define MIN_SCALE 1e-12f
#define MAX_SCALE 1e9f

/* ---- texts of fixed size ---- */

bool imucal_text_is_valid(const char* text, size_t size) {
  size_t n = 0;
  while (n < size && text[n] > ' ' && text[n] <= '~') n++;
  if (n == 0) return false;
  for (size_t i = n; i < size; i++)
    if (text[i] != 0) return false;
  return true;
}

imucal_status imucal_text_set(char* to, size_t size, const char* text) {
  size_t n = 0;
  while (n <= size && text[n] != 0) n++;
  if (n > size) return IMUCAL_ERR_NAME;
  for (size_t i = 0; i < n; i++)
    if (text[i] <= ' ' || text[i] > '~') return IMUCAL_ERR_NAME;
  if (n == 0) return IMUCAL_ERR_NAME;
  memset(to, 0, size);
  memcpy(to, text, n);
  return IMUCAL_OK;
}

bool imucal_text_equal(const char* a, const char* b, size_t size) {
  for (size_t i = 0; i < size; i++) {
    if (a[i] != b[i]) return false;
    if (a[i] == 0) return true;
  }
  return true;
}

/* Does a text of `size` end, at `at`, in exactly this? */
static bool is_rest(const char* text, size_t at, size_t size, const char* rest) {
  for (; at < size && text[at] != 0; at++, rest++)
    if (text[at] != *rest) return false;
  return *rest == 0;
}

size_t imucal_name_stem(const char* name) {
  static const char unit[][7] = {"_dph", "_mg", "_dps", "_radps", "_ms2"};
  if (!imucal_text_is_valid(name, IMUCAL_NAME_LEN)) return 0;
  for (size_t at = 1; at < IMUCAL_NAME_LEN; at++)
    for (size_t i = 0; i < sizeof unit / sizeof unit[0]; i++)
      if (is_rest(name, at, IMUCAL_NAME_LEN, unit[i])) return at;
  return 0;
}

/* ---- validation: the first field that fails, in the order of the bytes ---- */

/* The judging functions return the field that is wrong, IMUCAL_FIELD_NONE where all is well: the status follows from it.
 * The names stand in imucal_table_field_text alone: who does not print them does not link them. */
typedef imucal_table_field_t field_t;
#define STATUS(name, status, text) status,
static const int8_t status_of[IMUCAL_N_FIELDS] = {IMUCAL_OK, IMUCAL_TABLE_FIELDS(STATUS)};

/* field: one that is wrong. */
static imucal_status tell(field_t field, int32_t channel, imucal_table_place_t* place) {
  if (place != NULL) *place = (imucal_table_place_t){(int8_t)channel, (uint8_t)field};
  return (imucal_status)status_of[field];
}

static float absolute(float value) {
  return value < 0 ? -value : value;
}

/* The floats of a channel in the order of their bytes (table.md), with what they may be: each of the first `used` in
 * [lo, hi] (with order 0 a sigma may be 0), the rest 0. */
enum { USED_ALL, USED_ORDER, USED_SCALE, USED_MARKOV, USED_CALIBRATED };
typedef struct rule {
  float lo, hi;
  uint8_t offset; /* of the member in the struct */
  uint8_t n;      /* 1, or the member's length */
  uint8_t used;
  uint8_t field; /* imucal_table_field_t */
} rule_t;
#define MEMBER(name, n) offsetof(imucal_table_channel_t, name), n
static const rule_t rules[] = {
    {-MAX_ABS_TEMP_DEGC, MAX_ABS_TEMP_DEGC, MEMBER(t0_degc, 1), USED_ALL, IMUCAL_FIELD_T0},
    {1e-3f, 2 * MAX_ABS_TEMP_DEGC, MEMBER(range_degc, 1), USED_ALL, IMUCAL_FIELD_RANGE},
    {-IMUCAL_TABLE_MAX_COEFF, IMUCAL_TABLE_MAX_COEFF, MEMBER(coeff, IMUCAL_MAX_COEFF), USED_ORDER, IMUCAL_FIELD_COEFF},
    {-MAX_SCALE_SUM, MAX_SCALE_SUM, MEMBER(scale_coeff, IMUCAL_TABLE_SCALE_N), USED_SCALE, IMUCAL_FIELD_SCALE_COEFF},
    {-MAX_ABS_TEMP_DEGC, MAX_ABS_TEMP_DEGC, MEMBER(span_lo_degc, 1), USED_ALL, IMUCAL_FIELD_SPAN},
    {-MAX_ABS_TEMP_DEGC, MAX_ABS_TEMP_DEGC, MEMBER(span_hi_degc, 1), USED_ALL, IMUCAL_FIELD_SPAN},
    {MIN_SIGMA, MAX_SIGMA, MEMBER(sigma, IMUCAL_TABLE_SIGMA_N), USED_CALIBRATED, IMUCAL_FIELD_SIGMA},
    {0.0f, MAX_ARW, MEMBER(arw, 1), USED_ALL, IMUCAL_FIELD_MODEL},
    {0.0f, MAX_SIGMA, MEMBER(markov_sigma, IMUCAL_TABLE_MARKOV_N), USED_MARKOV, IMUCAL_FIELD_MODEL},
    {MIN_TAU_S, MAX_TAU_S, MEMBER(markov_tau_s, IMUCAL_TABLE_MARKOV_N), USED_MARKOV, IMUCAL_FIELD_MODEL},
    {MIN_SCALE, MAX_SCALE, MEMBER(unit_per_count, 1), USED_ALL, IMUCAL_FIELD_UNIT_PER_COUNT}};
enum { RULE_SPAN_HI = 5, N_RULES = sizeof rules / sizeof rules[0] };

/* The member of a rule: an array of floats, or one. */
static const float* values_of(const imucal_table_channel_t* c, const rule_t* rule) {
  return (const float*)(const void*)((const uint8_t*)c + rule->offset);
}

static uint32_t n_used(const imucal_table_channel_t* c, const rule_t* rule) {
  switch (rule->used) {
  case USED_ORDER:
    return c->order == 0 ? 0 : c->order + 1u;
  case USED_SCALE:
    return c->scale_order + 1u;
  case USED_MARKOV:
    return c->n_markov;
  default:
    return rule->n;
  }
}

static bool follows(const imucal_table_channel_t* c, const rule_t* rule) {
  const float* values = values_of(c, rule);
  const uint32_t used = n_used(c, rule);
  const float lo = rule->used == USED_CALIBRATED && c->order == 0 ? 0.0f : rule->lo;
  float sum = 0.0f;
  for (uint32_t i = 0; i < rule->n; i++) {
    if (!imucal_is_within(values[i], i < used ? lo : 0.0f, i < used ? rule->hi : 0.0f)) return false;
    sum += absolute(values[i]);
  }
  return rule->used != USED_SCALE || sum <= MAX_SCALE_SUM;
}

static bool is_span(const imucal_table_channel_t* c) {
  const float reach = c->range_degc * SPAN_SLACK;
  return c->span_lo_degc < c->span_hi_degc && absolute(c->span_lo_degc - c->t0_degc) <= reach &&
         absolute(c->span_hi_degc - c->t0_degc) <= reach;
}

static bool is_scale(float value) {
  return imucal_is_within(value, MIN_SCALE, MAX_SCALE);
}

static field_t judge_channel(const imucal_table_channel_t* c) {
  if (!imucal_text_is_valid(c->name, IMUCAL_NAME_LEN)) return IMUCAL_FIELD_NAME;
  if (c->order > IMUCAL_MAX_ORDER) return IMUCAL_FIELD_ORDER;
  if (c->scale_order >= IMUCAL_TABLE_SCALE_N) return IMUCAL_FIELD_SCALE_ORDER;
  if (c->n_markov > IMUCAL_TABLE_MARKOV_N) return IMUCAL_FIELD_MARKOV;
  for (size_t k = 0; k < N_RULES; k++)
    if (!follows(c, &rules[k]) || (k == RULE_SPAN_HI && !is_span(c))) return (field_t)rules[k].field;
  if (c->full_scale_counts <= 0) return IMUCAL_FIELD_FULL_SCALE;
  return IMUCAL_FIELD_NONE;
}

/* Of the header's fields those that a struct and bytes have in common. */
typedef struct header {
  const char* serial;
  uint32_t sequence, n_channels;
  float degc_per_count, degc_at_zero;
} header_t;

static field_t judge_thermometer(float degc_per_count, float degc_at_zero) {
  if (!is_scale(degc_per_count)) return IMUCAL_FIELD_DEGC_PER_COUNT;
  if (!imucal_is_within(degc_at_zero, -1e6f, 1e6f)) return IMUCAL_FIELD_DEGC_AT_ZERO;
  return IMUCAL_FIELD_NONE;
}

static field_t judge_header(const header_t* header) {
  if (!imucal_text_is_valid(header->serial, IMUCAL_SERIAL_LEN)) return IMUCAL_FIELD_SERIAL;
  if (header->sequence == 0 || header->sequence == UINT32_MAX) return IMUCAL_FIELD_SEQUENCE;
  if (header->n_channels == 0 || header->n_channels > IMUCAL_MAX_CHANNELS) return IMUCAL_FIELD_CHANNELS;
  return judge_thermometer(header->degc_per_count, header->degc_at_zero);
}

/* What is asked of who makes a table, and not of bytes: a device compares the names with its own (0.2 kB less there). */
static bool is_name_good(const imucal_table_channel_t* channels, uint32_t i) {
  for (uint32_t k = 0; k < i; k++)
    if (imucal_text_equal(channels[k].name, channels[i].name, IMUCAL_NAME_LEN)) return false;
  return imucal_name_stem(channels[i].name) > 0;
}

imucal_status imucal_table_validate(const imucal_table_t* table, imucal_table_place_t* place) {
  header_t header = {table->serial, table->sequence, table->n_channels, table->degc_per_count, table->degc_at_zero};
  field_t wrong = judge_header(&header);
  if (wrong != IMUCAL_FIELD_NONE) return tell(wrong, -1, place);
  for (uint32_t i = 0; i < table->n_channels; i++) {
    wrong = judge_channel(&table->channel[i]);
    if (!is_name_good(table->channel, i)) wrong = IMUCAL_FIELD_NAME;
    if (wrong != IMUCAL_FIELD_NONE) return tell(wrong, (int32_t)i, place);
  }
  return IMUCAL_OK;
}

imucal_status imucal_table_validate_channel(const imucal_table_channel_t* channel, float degc_per_count,
                                            float degc_at_zero) {
  field_t wrong = judge_thermometer(degc_per_count, degc_at_zero);
  if (wrong == IMUCAL_FIELD_NONE) wrong = is_name_good(channel, 0) ? judge_channel(channel) : IMUCAL_FIELD_NAME;
  return (imucal_status)status_of[wrong];
}

/* ---- bytes (table.md) ---- */

enum { FLOATS_AT = 16, FULL_SCALE_AT = 128, N_SECONDS_AT = 132 }; /* from the start of a channel */

static void encode_channel(const imucal_table_channel_t* c, uint8_t* at) {
  memcpy(at, c->name, IMUCAL_NAME_LEN);
  imucal_put_u32(at + 12, c->order | (uint32_t)c->scale_order << 8 | (uint32_t)c->n_markov << 16);
  uint8_t* to = at + FLOATS_AT;
  for (size_t k = 0; k < N_RULES; k++)
    for (size_t i = 0; i < rules[k].n; i++, to += 4) imucal_put_f32(to, values_of(c, &rules[k])[i]);
  imucal_put_u32(at + FULL_SCALE_AT, (uint32_t)c->full_scale_counts);
  imucal_put_u32(at + N_SECONDS_AT, c->n_seconds);
}

static void decode_channel(const uint8_t* at, imucal_table_channel_t* c) {
  memcpy(c->name, at, IMUCAL_NAME_LEN);
  c->order = at[12];
  c->scale_order = at[13];
  c->n_markov = at[14];
  const uint8_t* from = at + FLOATS_AT;
  for (size_t k = 0; k < N_RULES; k++) {
    float* values = (float*)(void*)((uint8_t*)c + rules[k].offset);
    for (size_t i = 0; i < rules[k].n; i++, from += 4) values[i] = imucal_get_f32(from);
  }
  c->full_scale_counts = (int32_t)imucal_get_u32(at + FULL_SCALE_AT);
  c->n_seconds = imucal_get_u32(at + N_SECONDS_AT);
}

imucal_status imucal_table_encode(const imucal_table_t* table, uint8_t* bytes, size_t max_bytes, size_t* len_bytes) {
  imucal_status status = imucal_table_validate(table, NULL);
  if (status != IMUCAL_OK) return status;
  size_t len = IMUCAL_TABLE_BYTES((size_t)table->n_channels);
  if (len > max_bytes) return IMUCAL_ERR_SPACE;
  imucal_put_u32(bytes, IMUCAL_TABLE_MAGIC);
  imucal_put_u16(bytes + 4, IMUCAL_TABLE_VERSION);
  imucal_put_u16(bytes + 6, (uint32_t)len);
  memcpy(bytes + 8, table->serial, IMUCAL_SERIAL_LEN);
  imucal_put_u32(bytes + 24, table->sequence);
  imucal_put_u32(bytes + 28, table->created_s);
  imucal_put_u32(bytes + 32, table->n_channels); /* and three reserved bytes */
  imucal_put_f32(bytes + 36, table->degc_per_count);
  imucal_put_f32(bytes + 40, table->degc_at_zero);
  for (size_t i = 0; i < table->n_channels; i++)
    encode_channel(&table->channel[i], bytes + IMUCAL_TABLE_HEADER_BYTES + IMUCAL_TABLE_CHANNEL_BYTES * i);
  imucal_put_u32(bytes + len - 4, imucal_crc32(bytes, len - 4));
  *len_bytes = len;
  return IMUCAL_OK;
}

/* What can be seen before the whole table is there. */
static field_t judge_start(const uint8_t* bytes, size_t have_bytes, size_t* len_bytes) {
  if (have_bytes < IMUCAL_TABLE_HEADER_BYTES) return IMUCAL_FIELD_SIZE;
  if (imucal_get_u32(bytes) != IMUCAL_TABLE_MAGIC) return IMUCAL_FIELD_MAGIC;
  if (imucal_get_u16(bytes + 4) != IMUCAL_TABLE_VERSION) return IMUCAL_FIELD_VERSION;
  const size_t len = imucal_get_u16(bytes + 6);
  if (len < IMUCAL_TABLE_BYTES(1u) || len > IMUCAL_TABLE_MAX_BYTES) return IMUCAL_FIELD_SIZE;
  *len_bytes = len;
  return IMUCAL_FIELD_NONE;
}

imucal_status imucal_table_peek(const uint8_t* bytes, size_t have_bytes, size_t* len_bytes) {
  return (imucal_status)status_of[judge_start(bytes, have_bytes, len_bytes)];
}

/* Everything but the channels. */
static field_t judge_bytes(const uint8_t* bytes, size_t have_bytes, header_t* header) {
  size_t len = 0;
  const field_t wrong = judge_start(bytes, have_bytes, &len);
  if (wrong != IMUCAL_FIELD_NONE) return wrong;
  if (len > have_bytes) return IMUCAL_FIELD_LENGTH;
  if (imucal_crc32(bytes, len - 4) != imucal_get_u32(bytes + len - 4)) return IMUCAL_FIELD_CRC;
  const uint32_t channels = imucal_get_u32(bytes + IMUCAL_TABLE_AT_CHANNELS);
  if (len != IMUCAL_TABLE_BYTES((size_t)(channels & 0xFFu))) return IMUCAL_FIELD_LENGTH;
  if (channels >> 8 != 0) return IMUCAL_FIELD_RESERVED;
  header->serial = (const char*)bytes + IMUCAL_TABLE_AT_SERIAL;
  header->sequence = imucal_get_u32(bytes + IMUCAL_TABLE_AT_SEQUENCE);
  header->n_channels = channels;
  header->degc_per_count = imucal_get_f32(bytes + 36);
  header->degc_at_zero = imucal_get_f32(bytes + 40);
  return judge_header(header);
}

imucal_status imucal_table_decode(const uint8_t* bytes, size_t have_bytes, imucal_table_t* table,
                                  imucal_table_place_t* place) {
  header_t header = {NULL, 0, 0, 0.0f, 0.0f};
  field_t wrong = judge_bytes(bytes, have_bytes, &header);
  if (wrong != IMUCAL_FIELD_NONE) return tell(wrong, -1, place);
  if (table != NULL) {
    memset(table, 0, sizeof *table);
    memcpy(table->serial, bytes + IMUCAL_TABLE_AT_SERIAL, IMUCAL_SERIAL_LEN);
    table->sequence = header.sequence;
    table->created_s = imucal_get_u32(bytes + 28);
    table->n_channels = (uint8_t)header.n_channels;
    table->degc_per_count = header.degc_per_count;
    table->degc_at_zero = header.degc_at_zero;
  }
  imucal_table_channel_t channel;      /* one at a time: checking needs no whole table */
  memset(&channel, 0, sizeof channel); /* padding too: equal tables are equal bytes in memory */
  for (uint32_t i = 0; i < header.n_channels; i++) {
    const uint8_t* at = bytes + IMUCAL_TABLE_HEADER_BYTES + IMUCAL_TABLE_CHANNEL_BYTES * i;
    if (at[15] != 0) return tell(IMUCAL_FIELD_RESERVED, (int32_t)i, place);
    decode_channel(at, &channel);
    wrong = judge_channel(&channel);
    if (wrong != IMUCAL_FIELD_NONE) return tell(wrong, (int32_t)i, place);
    if (table != NULL) memcpy(&table->channel[i], &channel, sizeof channel);
  }
  return IMUCAL_OK;
}

imucal_status imucal_table_from_kf(imucal_table_channel_t* channel, const imucal_kf_t* kf, float span_lo_degc,
                                   float span_hi_degc) {
  if (!kf->is_ready || kf->stats.n == 0) return IMUCAL_ERR_NOT_LEARNT;
  imucal_table_channel_t learnt = *channel;
  learnt.order = kf->config.order;
  learnt.t0_degc = kf->config.t0_degc;
  learnt.range_degc = kf->config.range_degc;
  learnt.span_lo_degc = span_lo_degc;
  learnt.span_hi_degc = span_hi_degc;
  if (!is_span(&learnt)) return IMUCAL_ERR_SPAN;
  for (uint32_t i = 0; i < IMUCAL_MAX_COEFF; i++) learnt.coeff[i] = imucal_kf_coefficient(kf, i);
  for (uint32_t i = 0; i < IMUCAL_TABLE_SIGMA_N; i++) {
    float part = (float)i / (float)(IMUCAL_TABLE_SIGMA_N - 1);
    learnt.sigma[i] = imucal_kf_bias_sigma(kf, span_lo_degc + part * (span_hi_degc - span_lo_degc));
  }
  learnt.n_seconds = kf->stats.n;
  *channel = learnt;
  return IMUCAL_OK;
}

#define TEXT(name, status, text) text,
const char* imucal_table_field_text(uint32_t field) {
  static const char* const text[IMUCAL_N_FIELDS] = {"", IMUCAL_TABLE_FIELDS(TEXT)};
  return text[field < IMUCAL_N_FIELDS ? field : IMUCAL_FIELD_NONE];
}
