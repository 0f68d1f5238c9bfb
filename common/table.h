// SPDX-License-Identifier: MIT
/* Purpose: the calibration table of one device, as a struct and as bytes for flash and link.
 * Bytes: little-endian, versioned, length-prefixed, CRC-32 over everything before it; layout in table.md.
 * 48 bytes and 136 per channel: six channels fit one 1-KB flash page with the store's two words.
 * Decoding checks every field; each kind of nonsense has its own status, and `place` says where. */
#ifndef IMUCAL_TABLE_H
#define IMUCAL_TABLE_H

#include "kf.h"
#include "status.h"

#if defined(__cplusplus)
extern "C" {
#endif

#define IMUCAL_TABLE_MAGIC 0x4C434D49u /* "IMCL" */
#define IMUCAL_TABLE_VERSION 1
#define IMUCAL_SERIAL_LEN 16 /* characters; shorter ones are padded with 0 */
#define IMUCAL_NAME_LEN 12
#define IMUCAL_TABLE_SIGMA_N 9 /* evenly spaced temperatures of the valid span, ends included */
#define IMUCAL_TABLE_SCALE_N 3 /* scale-factor coefficients m0 m1 m2 */
#define IMUCAL_TABLE_MARKOV_N 2
#define IMUCAL_TABLE_HEADER_BYTES 44
#define IMUCAL_TABLE_CHANNEL_BYTES 136
#define IMUCAL_TABLE_BYTES(n_channels) (IMUCAL_TABLE_HEADER_BYTES + IMUCAL_TABLE_CHANNEL_BYTES * (n_channels) + 4)
#define IMUCAL_TABLE_MAX_BYTES IMUCAL_TABLE_BYTES(IMUCAL_MAX_CHANNELS) /* 864 */
#define IMUCAL_TABLE_MAX_COEFF 1e7f                                    /* |coefficient|, unit */

/* Where the header's fields stand in the bytes (table.md), for who reads bytes without decoding them. */
enum {
  IMUCAL_TABLE_AT_MAGIC = 0,
  IMUCAL_TABLE_AT_SERIAL = 8,
  IMUCAL_TABLE_AT_SEQUENCE = 24,
  IMUCAL_TABLE_AT_CHANNELS = 32
};

/* One channel.  unit: dph or mg, from the name's ending (gx_dph, ax_mg). */
typedef struct imucal_table_channel {
  char name[IMUCAL_NAME_LEN];    /* printable ASCII, padded with 0, ends in its unit; no two channels the same */
  uint8_t order;                 /* of B(T), 1..IMUCAL_MAX_ORDER; 0: no bias is known (coefficients all 0) */
  uint8_t scale_order;           /* 0..2, order of the scale-factor polynomial M(T) */
  uint8_t n_markov;              /* 0..IMUCAL_TABLE_MARKOV_N */
  float t0_degc, range_degc;     /* Tn = (T - t0)/range, range > 0 */
  float coeff[IMUCAL_MAX_COEFF]; /* b0.., unit; 0 above the order */
  float scale_coeff[IMUCAL_TABLE_SCALE_N]; /* m0..: rate = (raw - B(T)) (1 + M(T)); sum |m_i| <= 1/16 */
  float span_lo_degc, span_hi_degc;        /* valid span, inside t0 +- range, lo < hi */
  float sigma[IMUCAL_TABLE_SIGMA_N];       /* one-sigma calibration error at lo + i (hi - lo)/8, unit, > 0 */
  float arw;                               /* error model: (60 arw)^2 = white variance of 1-s means; deg/rt(h) */
  float markov_sigma[IMUCAL_TABLE_MARKOV_N], markov_tau_s[IMUCAL_TABLE_MARKOV_N]; /* unit, s; 0 above n_markov */
  float unit_per_count;                                                           /* > 0 */
  int32_t full_scale_counts; /* > 0: |counts| the sensor can deliver */
  uint32_t n_seconds;        /* measurements behind the estimate */
} imucal_table_channel_t;

typedef struct imucal_table {
  char serial[IMUCAL_SERIAL_LEN];     /* device's serial, printable ASCII without blanks, padded with 0 */
  uint32_t sequence;                  /* grows with every table written; >= 1, < 2^32 - 1 */
  uint32_t created_s;                 /* seconds since 1970-01-01 UTC */
  uint8_t n_channels;                 /* 1..IMUCAL_MAX_CHANNELS */
  float degc_per_count, degc_at_zero; /* temperature = counts * degc_per_count + degc_at_zero; scale > 0 */
  imucal_table_channel_t channel[IMUCAL_MAX_CHANNELS];
} imucal_table_t;

/* Fields a table can be refused for, in the order in which they are judged: F(name, status, text as in the JSON).
 * SIZE: fewer bytes than a header, or a length that no table has.  LENGTH: not that of its channels, or more than there is. */
#define IMUCAL_TABLE_FIELDS(F)                                                                                         \
  F(MAGIC, IMUCAL_ERR_MAGIC, "header")                                                                                 \
  F(SIZE, IMUCAL_ERR_LENGTH, "header")                                                                                 \
  F(VERSION, IMUCAL_ERR_VERSION, "version")                                                                            \
  F(LENGTH, IMUCAL_ERR_LENGTH, "length")                                                                               \
  F(CRC, IMUCAL_ERR_CRC, "crc")                                                                                        \
  F(RESERVED, IMUCAL_ERR_RESERVED, "reserved")                                                                         \
  F(SERIAL, IMUCAL_ERR_NAME, "serial")                                                                                 \
  F(SEQUENCE, IMUCAL_ERR_SEQUENCE, "sequence")                                                                         \
  F(CHANNELS, IMUCAL_ERR_CHANNELS, "channels")                                                                         \
  F(DEGC_PER_COUNT, IMUCAL_ERR_SCALE, "degc_per_count")                                                                \
  F(DEGC_AT_ZERO, IMUCAL_ERR_SCALE, "degc_at_zero")                                                                    \
  F(NAME, IMUCAL_ERR_NAME, "name")                                                                                     \
  F(ORDER, IMUCAL_ERR_ORDER, "order")                                                                                  \
  F(SCALE_ORDER, IMUCAL_ERR_ORDER, "scale_order")                                                                      \
  F(MARKOV, IMUCAL_ERR_MODEL, "markov")                                                                                \
  F(T0, IMUCAL_ERR_SPAN, "t0_degc")                                                                                    \
  F(RANGE, IMUCAL_ERR_SPAN, "range_degc")                                                                              \
  F(COEFF, IMUCAL_ERR_COEFFICIENT, "coeff")                                                                            \
  F(SCALE_COEFF, IMUCAL_ERR_COEFFICIENT, "scale_coeff")                                                                \
  F(SPAN, IMUCAL_ERR_SPAN, "span_degc")                                                                                \
  F(SIGMA, IMUCAL_ERR_SIGMA, "sigma")                                                                                  \
  F(MODEL, IMUCAL_ERR_MODEL, "model")                                                                                  \
  F(UNIT_PER_COUNT, IMUCAL_ERR_SCALE, "unit_per_count")                                                                \
  F(FULL_SCALE, IMUCAL_ERR_SCALE, "full_scale_counts")
#define IMUCAL_TABLE_FIELD_ENUM(name, status, text) IMUCAL_FIELD_##name,
typedef enum imucal_table_field {
  IMUCAL_FIELD_NONE,
  IMUCAL_TABLE_FIELDS(IMUCAL_TABLE_FIELD_ENUM) IMUCAL_N_FIELDS
} imucal_table_field_t;

/* Where a refused table went wrong; not written where it is valid. */
typedef struct imucal_table_place {
  int8_t channel; /* -1: header */
  uint8_t field;  /* imucal_table_field_t */
} imucal_table_place_t;

/* The field's name as in the JSON; "" for IMUCAL_FIELD_NONE and numbers that are no field.  Never null. */
const char* imucal_table_field_text(uint32_t field);

/* Check every field of a struct.  place may be null.  Of names it asks more than decode does: a unit, and no two the same. */
IMUCAL_MUST_USE imucal_status imucal_table_validate(const imucal_table_t* table, imucal_table_place_t* place);

/* The same for one channel of a table with this thermometer, where there is no room for a whole table. */
IMUCAL_MUST_USE imucal_status imucal_table_validate_channel(const imucal_table_channel_t* channel, float degc_per_count,
                                                            float degc_at_zero);

/* Validate and write.  *len_bytes = bytes written.  IMUCAL_ERR_SPACE or the status of validate. */
IMUCAL_MUST_USE imucal_status imucal_table_encode(const imucal_table_t* table, uint8_t* bytes, size_t max_bytes,
                                                  size_t* len_bytes);

/* Length the header at `bytes` claims, after checking magic, version and plausibility; needs
 * IMUCAL_TABLE_HEADER_BYTES bytes. */
IMUCAL_MUST_USE imucal_status imucal_table_peek(const uint8_t* bytes, size_t have_bytes, size_t* len_bytes);

/* Read and check everything: magic, version, length, CRC, then every field.  Bytes after the table are allowed
 * (a flash page is longer).  On error *table is in no defined state.  table may be null: check only; place may be
 * null. */
IMUCAL_MUST_USE imucal_status imucal_table_decode(const uint8_t* bytes, size_t have_bytes, imucal_table_t* table,
                                                  imucal_table_place_t* place);

/* Set a fixed-size name or serial from text (zero-terminated); IMUCAL_ERR_NAME: empty, too long, not printable. */
IMUCAL_MUST_USE imucal_status imucal_text_set(char* to, size_t size, const char* text);
/* Is it such a text?  Printable ASCII without blanks, not empty, then zeros to the end. */
bool imucal_text_is_valid(const char* text, size_t size);
/* Equal as fixed-size texts. */
bool imucal_text_equal(const char* a, const char* b, size_t size);

/* Characters of a channel's name before the "_unit" that it ends in: 2 of gx_dph.  0: no such name (not printable, no unit,
 * nothing before it).  Units: dph and mg, and dps, radps, ms2 of tables made of logs in these (the numbers are dph and mg). */
size_t imucal_name_stem(const char* name);

/* Fill what the filter learnt into a channel: order, t0, range, coefficients, sigma at 9 temperatures of the span,
 * n_seconds.  The caller sets name, scale, model, full scale.  IMUCAL_ERR_NOT_LEARNT: no measurement yet;
 * IMUCAL_ERR_SPAN: span reversed or outside t0 +- range. */
IMUCAL_MUST_USE imucal_status imucal_table_from_kf(imucal_table_channel_t* channel, const imucal_kf_t* kf,
                                                   float span_lo_degc, float span_hi_degc);

#if defined(__cplusplus)
}
#endif
#endif
