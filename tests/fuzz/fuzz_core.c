// SPDX-License-Identifier: MIT
// Anything at all into the core's two doors for bytes: the link receiver and the table decoder, and what a table that
// passes then drives (encode, compensation).  One entry point for libFuzzer; with IMUCAL_FUZZ_MAIN an own driver that
// mutates valid frames and tables from a seed and, on a failure, has printed the line that repeats it.
//
// Input: byte 0 chooses the door; the rest goes in.
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "comp.h"
#include "crc.h"
#include "link.h"
#include "num.h"
#include "sample.h"
#include "table.h"

#include "common/table_example.h"

#define CHECK(condition)                                                                                               \
  do {                                                                                                                 \
    if (!(condition)) {                                                                                                \
      fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #condition);                                                  \
      abort();                                                                                                         \
    }                                                                                                                  \
  } while (0)

static void into_link(const uint8_t* data, size_t len) {
  static imucal_link_rx_t rx;
  static imucal_link_server_t server;
  imucal_link_any_t message;
  imucal_link_rx_init(&rx);
  imucal_link_server_init(&server);
  for (size_t i = 0; i < len; i++) {
    if (imucal_link_rx_put(&rx, data[i]) != IMUCAL_FRAME_READY) continue;
    CHECK(rx.len >= 6 && rx.len <= IMUCAL_LINK_MAX_RAW);
    if (imucal_link_server_request(&server, &rx) == IMUCAL_OK) {
      const imucal_link_done_t done = {.request = imucal_link_rx_type(&rx)};
      CHECK(imucal_link_server_reply(&server, IMUCAL_LINK_ID_DONE, &done) == IMUCAL_OK);
    }
    if (imucal_link_rx_message(&rx, &message) != IMUCAL_OK) continue;
    uint8_t payload[IMUCAL_LINK_MAX_PAYLOAD];
    size_t payload_len = 0;
    CHECK(imucal_link_encode(imucal_link_rx_type(&rx), &message, payload, sizeof payload, &payload_len) == IMUCAL_OK);
    CHECK(payload_len == imucal_link_rx_payload_len(&rx));
    CHECK(memcmp(payload, imucal_link_rx_payload(&rx), payload_len) == 0);
  }
  CHECK(rx.n_frames <= len && rx.n_crc <= len && rx.n_resync <= len && rx.n_overflow <= len);
}

static void drive_comp(const imucal_table_t* table) {
  static const int32_t edges[] = {INT32_MIN, INT32_MIN + 1, -65536, -1, 0, 1, 12345, INT32_MAX - 1, INT32_MAX};
  for (uint32_t c = 0; c < table->n_channels; c++) {
    imucal_comp_t comp;
    if (imucal_comp_prepare(&comp, table, c) != IMUCAL_OK) continue;
    CHECK(comp.out_frac_bits <= 8 && comp.temp_lo_counts < comp.temp_hi_counts);
    for (size_t i = 0; i < sizeof edges / sizeof edges[0]; i++)
      for (size_t k = 0; k < sizeof edges / sizeof edges[0]; k++) {
        uint32_t flags = 0;
        int32_t tn = imucal_comp_tn_q30(&comp, edges[i], &flags);
        CHECK(tn >= -(1 << 30) - 1 && tn <= (1 << 30) + 1);
        flags = 0;
        (void)imucal_comp_apply(&comp, edges[i], edges[k], &flags);
        int32_t full = table->channel[c].full_scale_counts;
        if (edges[k] >= -full && edges[k] <= full) CHECK((flags & IMUCAL_COMP_SATURATED) == 0);
      }
  }
}

static void into_table(const uint8_t* data, size_t len, int is_sealed) {
  static uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  static imucal_table_t table;
  imucal_table_place_t place;
  if (len > sizeof bytes) len = sizeof bytes;
  memcpy(bytes, data, len);
  size_t claimed = 0;
  if (is_sealed && imucal_table_peek(bytes, len, &claimed) == IMUCAL_OK && claimed <= len)
    imucal_put_u32(bytes + claimed - 4, imucal_crc32(bytes, claimed - 4)); /* past the CRC, to the fields */
  imucal_status status = imucal_table_decode(bytes, len, &table, &place);
  CHECK(imucal_table_decode(bytes, len, NULL, NULL) == status);
  if (status != IMUCAL_OK) {
    CHECK(imucal_table_field_text(place.field)[0] != 0 && place.channel >= -1 && place.channel < IMUCAL_MAX_CHANNELS);
    return;
  }
  CHECK(imucal_table_validate(&table, NULL) == IMUCAL_OK);
  uint8_t again[IMUCAL_TABLE_MAX_BYTES];
  size_t again_len = 0;
  CHECK(imucal_table_encode(&table, again, sizeof again, &again_len) == IMUCAL_OK);
  CHECK(again_len == imucal_get_u16(bytes + 6) && memcmp(again, bytes, again_len) == 0);
  drive_comp(&table);
}

static void into_sample(const uint8_t* data, size_t len) {
  imucal_sample_t sample;
  uint8_t record[IMUCAL_SAMPLE_RECORD_BYTES] = {0};
  memcpy(record, data, len < sizeof record ? len : sizeof record);
  if (imucal_sample_decode(record, &sample) != IMUCAL_OK) return;
  CHECK(sample.n_channels >= 1 && sample.n_channels <= IMUCAL_MAX_CHANNELS);
}

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t len);
int LLVMFuzzerTestOneInput(const uint8_t* data, size_t len) {
  if (len == 0) return 0;
  switch (data[0] & 3) {
  case 0:
    into_link(data + 1, len - 1);
    break;
  case 1:
    into_table(data + 1, len - 1, 0);
    break;
  case 2:
    into_table(data + 1, len - 1, 1);
    break;
  default:
    into_sample(data + 1, len - 1);
    break;
  }
  return 0;
}

#ifdef IMUCAL_FUZZ_MAIN

#include <time.h>

#include "common/unit.h"

/* A valid input of the kind, some of its bytes then changed. */
static size_t make_input(unit_rng_t* rng, uint8_t* data, size_t max_len) {
  size_t len = 1;
  data[0] = (uint8_t)unit_integer(rng, 0, 2);
  if (data[0] == 0) {
    static const uint8_t ids[] = {
#define LIST(id, name, NAME) id,
        IMUCAL_LINK_MESSAGES(LIST)};
    while (len + IMUCAL_LINK_MAX_FRAME < max_len && unit_integer(rng, 0, 4) != 0) {
      imucal_link_any_t message;
      for (size_t i = 0; i < sizeof message; i++) ((uint8_t*)&message)[i] = (uint8_t)(unit_bits(rng) & unit_bits(rng));
      size_t n = 0;
      if (imucal_link_pack(ids[unit_integer(rng, 0, sizeof ids - 1)], (uint8_t)unit_bits(rng), &message, data + len,
                           IMUCAL_LINK_MAX_FRAME, &n) == IMUCAL_OK)
        len += n;
    }
  } else {
    imucal_table_t table = example_table((int)unit_integer(rng, 1, 6), (int)unit_integer(rng, 0, 1000));
    size_t n = 0;
    if (imucal_table_encode(&table, data + 1, IMUCAL_TABLE_MAX_BYTES, &n) == IMUCAL_OK) len += n;
  }
  int64_t n_changes = unit_integer(rng, 0, 6);
  for (int64_t i = 0; i < n_changes && len > 1; i++) {
    uint8_t* at = data + unit_integer(rng, 1, (int64_t)len - 1);
    *at = unit_integer(rng, 0, 1) ? (uint8_t)unit_bits(rng) : *at ^ (uint8_t)(1 << unit_integer(rng, 0, 7));
  }
  return unit_integer(rng, 0, 9) == 0 && len > 2 ? (size_t)unit_integer(rng, 1, (int64_t)len) : len;
}

/* usage: fuzz_core [seconds [first seed]] */
int main(int argc, char** argv) {
  double seconds = argc > 1 ? atof(argv[1]) : 10;
  uint64_t seed = argc > 2 ? strtoull(argv[2], NULL, 10) : 1;
  int is_once = argc > 3;
  static uint8_t data[4096];
  time_t start = time(NULL);
  uint64_t n = 0;
  do {
    unit_rng_t rng = {(seed + n) * 0x9E3779B97F4A7C15ULL + 1};
    FILE* note = NULL;
    if (n % 4096 == 0 && (note = fopen("build/fuzz_last_seed", "w")) != NULL) {
      fprintf(note, "fuzz_core 10 %llu\n", (unsigned long long)(seed + n)); /* at most 4096 inputs before the failure */
      fclose(note);
    }
    size_t len = make_input(&rng, data, sizeof data);
    (void)LLVMFuzzerTestOneInput(data, len);
    n++;
  } while (!is_once && difftime(time(NULL), start) < seconds);
  printf("fuzz: %llu inputs from seed %llu, no failure\n", (unsigned long long)n, (unsigned long long)seed);
  return 0;
}
#endif
