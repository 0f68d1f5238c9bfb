// SPDX-License-Identifier: MIT
// link: golden frames, every message there and back, noise, cut frames, repeated requests; link.md against the table.
#include "unit.h"

#include "crc.h"
#include "link.h"
#include "num.h"

static imucal_status feed(imucal_link_rx_t* rx, const uint8_t* bytes, size_t len) {
  imucal_status last = IMUCAL_OK;
  for (size_t i = 0; i < len; i++) last = imucal_link_rx_put(rx, bytes[i]);
  return last;
}

static void test_pack_hello_golden_frame(void** state) {
  (void)state;
  const imucal_link_hello_t hello = {.protocol = IMUCAL_LINK_PROTOCOL, .nonce = 0x44003322u};
  uint8_t frame[IMUCAL_LINK_MAX_FRAME];
  size_t len = 0;
  assert_int_equal(imucal_link_pack(IMUCAL_LINK_ID_HELLO, 7, &hello, frame, sizeof frame, &len), IMUCAL_OK);
  /* raw: 01 07 02 22 33 00 44 | CRC-32 of these by Python zlib.crc32 = 0x01790ee7; the example of link.md */
  const uint8_t expected[] = {0, 6, 0x01, 0x07, 0x02, 0x22, 0x33, 6, 0x44, 0xE7, 0x0E, 0x79, 0x01, 0};
  assert_int_equal(len, sizeof expected);
  assert_memory_equal(frame, expected, sizeof expected);
}

#define LIST(id, name, NAME) id,
static const uint8_t all_ids[] = {IMUCAL_LINK_MESSAGES(LIST)};
#define N_IDS (sizeof all_ids)

/* The number fields (N) of a random message must be possible. */
static void bound_counts(uint8_t id, imucal_link_any_t* m) {
  if (id == IMUCAL_LINK_ID_CAL_START) m->cal_start.n_markov %= 3;
  if (id == IMUCAL_LINK_ID_TABLE_READ_REPLY) m->table_read_reply.length %= 201;
  if (id == IMUCAL_LINK_ID_TABLE_DATA) m->table_data.length %= 201;
  if (id == IMUCAL_LINK_ID_SECOND) m->second.n_channels %= 7;
  if (id == IMUCAL_LINK_ID_COMMAND) m->command.length %= 207;
  if (id == IMUCAL_LINK_ID_HEALTH_REPLY) m->health_reply.n_rules %= 17;
  if (id == IMUCAL_LINK_ID_PROGRESS) m->progress.n_channels %= 7;
}

/* A value of 1, 2, 4 or 8 bytes, little-endian by arithmetic. */
static size_t put(uint8_t* to, size_t at, const void* value, size_t size) {
  uint64_t number = 0;
  uint8_t u8 = 0;
  uint16_t u16 = 0;
  uint32_t u32 = 0;
  if (size == 1) memcpy(&u8, value, 1), number = u8;
  if (size == 2) memcpy(&u16, value, 2), number = u16;
  if (size == 4) memcpy(&u32, value, 4), number = u32;
  if (size == 8) memcpy(&number, value, 8);
  for (size_t i = 0; i < size; i++) to[at + i] = (uint8_t)(number >> 8 * i);
  return at + size;
}

/* The payload written member by member, by the names of link.h. */
#define PUT_N_OF(n, type, name)                                                                                        \
  for (size_t i = 0; i < (n); i++)                                                                                     \
    at = put(to, at, (const uint8_t*)&m->name + i * sizeof(IMUCAL_LINK_C_##type), sizeof(IMUCAL_LINK_C_##type));
#define PUT_F(type, name, unit) PUT_N_OF(1u, type, name)
#define PUT_A(type, name, n, unit) PUT_N_OF((size_t)n, type, name)
#define PUT_N(name, unit) PUT_N_OF(1u, u8, name) n_of_variable = m->name;
#define PUT_V(type, name, n, unit) PUT_N_OF(n_of_variable, type, name)
#define PUT_MESSAGE(number, name, NAME)                                                                                \
  if (id == number) {                                                                                                  \
    const imucal_link_##name##_t* m = message;                                                                         \
    IMUCAL_LINK_##NAME(PUT_F, PUT_A, PUT_N, PUT_V)                                                                     \
  }
static size_t payload_by_names(uint8_t id, const void* message, uint8_t* to) {
  size_t at = 0, n_of_variable = 0;
  IMUCAL_LINK_MESSAGES(PUT_MESSAGE)
  (void)n_of_variable;
  return at;
}

static void test_payload_is_the_members_in_their_order(void** state) {
  (void)state;
  unit_rng_t rng = {unit_seed()};
  for (size_t i = 0; i < N_IDS; i++) {
    imucal_link_any_t message, back;
    uint8_t* bytes = (uint8_t*)&message;
    for (size_t k = 0; k < sizeof message; k++) bytes[k] = (uint8_t)unit_bits(&rng);
    bound_counts(all_ids[i], &message);
    uint8_t expected[IMUCAL_LINK_MAX_PAYLOAD], got[IMUCAL_LINK_MAX_PAYLOAD];
    const size_t expected_len = payload_by_names(all_ids[i], &message, expected);
    size_t len = 0;
    assert_int_equal(imucal_link_encode(all_ids[i], &message, got, sizeof got, &len), IMUCAL_OK);
    assert_int_equal(len, expected_len);
    assert_memory_equal(got, expected, len);
    assert_int_equal(imucal_link_decode(all_ids[i], expected, len, &back), IMUCAL_OK);
    assert_int_equal(payload_by_names(all_ids[i], &back, got), len);
    assert_memory_equal(got, expected, len);
  }
}

static void test_every_message_there_and_back_same_payload(void** state) {
  (void)state;
  unit_rng_t rng = {unit_seed()};
  for (size_t i = 0; i < N_IDS; i++) {
    for (int run = 0; run < 200; run++) {
      imucal_link_any_t sent, got;
      uint8_t* bytes = (uint8_t*)&sent;
      for (size_t k = 0; k < sizeof sent; k++) bytes[k] = (uint8_t)unit_bits(&rng);
      bound_counts(all_ids[i], &sent);
      uint8_t frame[IMUCAL_LINK_MAX_FRAME];
      size_t len = 0;
      assert_int_equal(imucal_link_pack(all_ids[i], (uint8_t)run, &sent, frame, sizeof frame, &len), IMUCAL_OK);
      for (size_t k = 1; k + 1 < len; k++) assert_int_not_equal(frame[k], 0);
      assert_true(frame[0] == 0 && frame[len - 1] == 0);
      imucal_link_rx_t rx;
      imucal_link_rx_init(&rx);
      assert_int_equal(feed(&rx, frame, len), IMUCAL_FRAME_READY);
      assert_int_equal(imucal_link_rx_type(&rx), all_ids[i]);
      assert_int_equal(imucal_link_rx_sequence(&rx), (uint8_t)run);
      assert_int_equal(imucal_link_rx_message(&rx, &got), IMUCAL_OK);
      uint8_t again[IMUCAL_LINK_MAX_FRAME];
      size_t again_len = 0;
      assert_int_equal(imucal_link_pack(all_ids[i], (uint8_t)run, &got, again, sizeof again, &again_len), IMUCAL_OK);
      assert_int_equal(again_len, len);
      assert_memory_equal(again, frame, len);
    }
  }
}

static void test_decode_fields_arrive_in_their_members(void** state) {
  (void)state;
  imucal_link_second_t sent = {.counter = 65535,
                               .t_s = 0xDEADBEEF,
                               .n_samples = 100,
                               .temp_degc = -12.5f,
                               .is_gap = 1,
                               .compensated = 5,
                               .temp_clamped = 2,
                               .n_channels = 2};
  sent.flags[1] = 4;
  sent.raw[0] = 1.25f;
  sent.out[1] = -3e4f;
  uint8_t payload[IMUCAL_LINK_MAX_PAYLOAD];
  size_t len = 0;
  assert_int_equal(imucal_link_encode(IMUCAL_LINK_ID_SECOND, &sent, payload, sizeof payload, &len), IMUCAL_OK);
  assert_int_equal(len, 2 + 4 + 2 + 4 + 3 + 1 + 2 + 8 + 8);
  imucal_link_any_t got;
  assert_int_equal(imucal_link_decode(IMUCAL_LINK_ID_SECOND, payload, len, &got), IMUCAL_OK);
  assert_memory_equal(&got.second.raw, &sent.raw, sizeof sent.raw);
  assert_memory_equal(&got.second.out, &sent.out, sizeof sent.out);
  assert_memory_equal(&got.second.flags, &sent.flags, sizeof sent.flags);
  assert_true(got.second.t_s == sent.t_s && got.second.counter == 65535 && got.second.temp_degc == -12.5f);
  assert_int_equal(got.second.compensated, 5);
  assert_int_equal(got.second.temp_clamped, 2);
}

static void test_decode_wrong_length_or_count_is_refused(void** state) {
  (void)state;
  for (size_t i = 0; i < N_IDS; i++) {
    imucal_link_any_t message = {0}, got;
    uint8_t payload[IMUCAL_LINK_MAX_PAYLOAD + 1] = {0};
    size_t len = 0;
    assert_int_equal(imucal_link_encode(all_ids[i], &message, payload, sizeof payload, &len), IMUCAL_OK);
    assert_true(len >= 1);
    assert_int_equal(imucal_link_decode(all_ids[i], payload, len, &got), IMUCAL_OK);
    assert_int_equal(imucal_link_decode(all_ids[i], payload, len - 1, &got), IMUCAL_ERR_LENGTH);
    assert_int_equal(imucal_link_decode(all_ids[i], payload, len + 1, &got), IMUCAL_ERR_LENGTH);
    assert_int_equal(imucal_link_encode(all_ids[i], &message, payload, len - 1, &len), IMUCAL_ERR_SPACE);
  }
  imucal_link_any_t message = {0}, got;
  message.table_data.length = 201;
  uint8_t payload[IMUCAL_LINK_MAX_PAYLOAD];
  size_t len = 0;
  assert_int_equal(imucal_link_encode(IMUCAL_LINK_ID_TABLE_DATA, &message, payload, sizeof payload, &len),
                   IMUCAL_ERR_RANGE);
  memset(payload, 255, sizeof payload);
  assert_int_equal(imucal_link_decode(IMUCAL_LINK_ID_TABLE_DATA, payload, 203, &got), IMUCAL_ERR_RANGE);
  assert_int_equal(imucal_link_decode(0x3E, payload, 1, &got), IMUCAL_ERR_UNKNOWN);
  assert_int_equal(imucal_link_encode(0x3E, &message, payload, sizeof payload, &len), IMUCAL_ERR_UNKNOWN);
}

/* A frame with this sequence number; payload of the largest message. */
static size_t big_frame(uint8_t sequence, uint8_t fill, uint8_t* frame) {
  uint8_t payload[IMUCAL_LINK_MAX_PAYLOAD];
  memset(payload, fill, sizeof payload);
  size_t len = 0;
  assert_int_equal(imucal_link_frame(0x3F, sequence, payload, sizeof payload, frame, IMUCAL_LINK_MAX_FRAME, &len),
                   IMUCAL_OK);
  return len;
}

static void test_frame_longest_payload_of_any_byte_survives(void** state) {
  (void)state;
  for (int fill = 0; fill < 256; fill++) {
    uint8_t frame[IMUCAL_LINK_MAX_FRAME];
    size_t len = big_frame(9, (uint8_t)fill, frame);
    imucal_link_rx_t rx;
    imucal_link_rx_init(&rx);
    assert_int_equal(feed(&rx, frame, len), IMUCAL_FRAME_READY);
    assert_int_equal(imucal_link_rx_payload_len(&rx), IMUCAL_LINK_MAX_PAYLOAD);
    for (size_t i = 0; i < IMUCAL_LINK_MAX_PAYLOAD; i++) assert_int_equal(imucal_link_rx_payload(&rx)[i], fill);
  }
  uint8_t frame[IMUCAL_LINK_MAX_FRAME], payload[IMUCAL_LINK_MAX_PAYLOAD + 1] = {0};
  size_t len;
  assert_int_equal(imucal_link_frame(1, 1, payload, IMUCAL_LINK_MAX_PAYLOAD + 1, frame, sizeof frame, &len),
                   IMUCAL_ERR_SPACE);
  assert_int_equal(imucal_link_frame(1, 1, payload, 10, frame, 18, &len), IMUCAL_ERR_SPACE);
  assert_int_equal(imucal_link_frame(1, 1, payload, 10, frame, 19, &len), IMUCAL_OK);
}

static void test_rx_one_flipped_bit_anywhere_next_frame_survives(void** state) {
  (void)state;
  uint8_t frame[IMUCAL_LINK_MAX_FRAME], next[IMUCAL_LINK_MAX_FRAME];
  const imucal_link_cal_stop_t stop = {.action = 1};
  size_t len = 0, next_len = 0;
  const imucal_link_hello_t hello = {.protocol = 1, .nonce = 12345};
  assert_int_equal(imucal_link_pack(IMUCAL_LINK_ID_HELLO, 1, &hello, frame, sizeof frame, &len), IMUCAL_OK);
  assert_int_equal(imucal_link_pack(IMUCAL_LINK_ID_CAL_STOP, 2, &stop, next, sizeof next, &next_len), IMUCAL_OK);
  for (size_t bit = 0; bit < 8 * len; bit++) {
    imucal_link_rx_t rx;
    imucal_link_rx_init(&rx);
    frame[bit / 8] ^= (uint8_t)(1 << bit % 8);
    const bool is_first = bit < 8; /* a hit leading delimiter matters only where one is needed: after junk */
    for (size_t i = 0; i < len; i++)
      if (imucal_link_rx_put(&rx, frame[i]) == IMUCAL_FRAME_READY) assert_true(is_first);
    frame[bit / 8] ^= (uint8_t)(1 << bit % 8);
    assert_int_equal(feed(&rx, next, next_len), IMUCAL_FRAME_READY);
    assert_int_equal(imucal_link_rx_type(&rx), IMUCAL_LINK_ID_CAL_STOP);
    assert_true(is_first || rx.n_crc + rx.n_resync >= 1);
  }
}

static void test_rx_truncated_anywhere_next_frame_survives(void** state) {
  (void)state;
  uint8_t frame[IMUCAL_LINK_MAX_FRAME];
  size_t len = big_frame(3, 0x11, frame);
  for (size_t cut = 1; cut < len; cut++) {
    imucal_link_rx_t rx;
    imucal_link_rx_init(&rx);
    (void)feed(&rx, frame, cut);
    (void)!imucal_link_rx_put(&rx, 0);
    assert_int_equal(rx.n_frames, cut == len - 1);
    assert_int_equal(feed(&rx, frame, len), IMUCAL_FRAME_READY);
  }
}

static void test_rx_endless_bytes_are_bounded_and_counted_once(void** state) {
  (void)state;
  imucal_link_rx_t rx;
  imucal_link_rx_init(&rx);
  int n_space = 0;
  for (int i = 0; i < 100000; i++) n_space += imucal_link_rx_put(&rx, 0xFF) == IMUCAL_ERR_SPACE;
  assert_int_equal(n_space, 1);
  assert_int_equal(rx.n_overflow, 1);
  assert_int_equal(imucal_link_rx_put(&rx, 0), IMUCAL_OK);
  uint8_t frame[IMUCAL_LINK_MAX_FRAME];
  size_t len = big_frame(3, 0x11, frame);
  assert_int_equal(feed(&rx, frame, len), IMUCAL_FRAME_READY);
}

/* Frames between stretches of noise: each whole frame arrives unless noise touches it; no frame is invented. */
static void test_rx_noise_costs_at_most_the_frame_it_touches(void** state) {
  (void)state;
  unit_rng_t rng = {unit_seed()};
  imucal_link_rx_t rx;
  imucal_link_rx_init(&rx);
  uint32_t n_sent = 0, n_got = 0;
  for (int run = 0; run < 3000; run++) {
    uint8_t noise[64], frame[IMUCAL_LINK_MAX_FRAME];
    size_t n_noise = (size_t)unit_integer(&rng, 0, 64);
    for (size_t i = 0; i < n_noise; i++) noise[i] = (uint8_t)unit_bits(&rng);
    for (size_t i = 0; i < n_noise; i++) assert_int_not_equal(imucal_link_rx_put(&rx, noise[i]), IMUCAL_FRAME_READY);
    (void)!imucal_link_rx_put(&rx, 0); /* the sender's leading delimiter */
    imucal_link_event_t event = {.counter = (uint16_t)run, .detail = (uint32_t)unit_bits(&rng)};
    size_t len = 0;
    assert_int_equal(imucal_link_pack(IMUCAL_LINK_ID_EVENT, 0, &event, frame, sizeof frame, &len), IMUCAL_OK);
    n_sent++;
    if (feed(&rx, frame, len) != IMUCAL_FRAME_READY) continue;
    imucal_link_any_t got;
    assert_int_equal(imucal_link_rx_message(&rx, &got), IMUCAL_OK);
    assert_int_equal(got.event.counter, (uint16_t)run);
    n_got++;
  }
  assert_int_equal(n_got, n_sent);
}

/* Bytes changed, lost, doubled and invented at random: frames lost <= frames touched, and none is invented.  A frame is
 * touched where a byte from its leading to its last delimiter was, or was invented next to one. */
static void test_rx_frames_lost_are_at_most_the_frames_touched(void** state) {
  (void)state;
  unit_rng_t rng = {unit_seed()};
  for (int rate = 20; rate <= 2000; rate *= 10) {
    imucal_link_rx_t rx;
    imucal_link_rx_init(&rx);
    enum { N_SENT = 20000 };
    static uint8_t is_touched[N_SENT], n_got[N_SENT];
    memset(is_touched, 0, sizeof is_touched), memset(n_got, 0, sizeof n_got);
    uint32_t n_lost = 0, n_touched = 0, details[2] = {0};
    for (uint32_t k = 0; k < N_SENT; k++) {
      uint8_t frame[IMUCAL_LINK_MAX_FRAME];
      imucal_link_event_t event = {.counter = (uint16_t)k, .detail = (uint32_t)unit_bits(&rng)};
      size_t len = 0;
      assert_int_equal(imucal_link_pack(IMUCAL_LINK_ID_EVENT, (uint8_t)k, &event, frame, sizeof frame, &len),
                       IMUCAL_OK);
      details[k % 2] = event.detail;
      for (size_t i = 0; i < len; i++) {
        const int64_t dice = unit_integer(&rng, 0, rate - 1);
        const uint8_t noise = (uint8_t)unit_bits(&rng);
        uint8_t bytes[2] = {dice == 0 ? noise : frame[i], dice == 2 ? frame[i] : noise};
        is_touched[k] |= dice <= 3;
        const int n = dice == 1 ? 0 : dice == 2 || dice == 3 ? 2 : 1;
        for (int b = 0; b < n; b++) {
          if (imucal_link_rx_put(&rx, bytes[b]) != IMUCAL_FRAME_READY) continue;
          imucal_link_any_t got;
          assert_int_equal(imucal_link_rx_message(&rx, &got), IMUCAL_OK);
          assert_true(got.event.counter == k ||
                      got.event.counter + 1u == k); /* or the one before, ended by this one's start */
          assert_int_equal(got.event.detail, details[got.event.counter % 2]);
          n_got[got.event.counter]++;
        }
      }
    }
    for (uint32_t k = 0; k < N_SENT; k++) {
      n_touched += is_touched[k];
      n_lost += n_got[k] == 0;
      assert_true(n_got[k] == 1 || (n_got[k] == 0 && is_touched[k])); /* an untouched frame always arrives, once */
    }
    assert_true(n_touched > 50 && n_lost <= n_touched);
  }
}

/* The first frame after junk arrives. */
static void test_rx_first_frame_after_junk_arrives(void** state) {
  (void)state;
  unit_rng_t rng = {unit_seed()};
  for (int run = 0; run < 2000; run++) {
    imucal_link_rx_t rx;
    imucal_link_rx_init(&rx);
    for (int64_t n = unit_integer(&rng, 1, 600); n > 0; n--) (void)!imucal_link_rx_put(&rx, (uint8_t)unit_bits(&rng));
    const imucal_link_info_t info = {0};
    uint8_t frame[IMUCAL_LINK_MAX_FRAME];
    size_t len = 0;
    assert_int_equal(imucal_link_pack(IMUCAL_LINK_ID_INFO, 1, &info, frame, sizeof frame, &len), IMUCAL_OK);
    assert_int_equal(feed(&rx, frame, len), IMUCAL_FRAME_READY);
  }
}

static void test_rx_unknown_type_is_counted(void** state) {
  (void)state;
  uint8_t frame[IMUCAL_LINK_MAX_FRAME];
  size_t len = big_frame(3, 0x11, frame);
  imucal_link_rx_t rx;
  imucal_link_any_t message;
  imucal_link_rx_init(&rx);
  assert_int_equal(feed(&rx, frame, len), IMUCAL_FRAME_READY);
  assert_int_equal(imucal_link_rx_message(&rx, &message), IMUCAL_ERR_UNKNOWN);
  assert_int_equal(rx.n_unknown, 1);
}

static void give(imucal_link_rx_t* rx, uint32_t id, uint8_t sequence, const void* message) {
  uint8_t frame[IMUCAL_LINK_MAX_FRAME];
  size_t len = 0;
  assert_int_equal(imucal_link_pack(id, sequence, message, frame, sizeof frame, &len), IMUCAL_OK);
  assert_int_equal(feed(rx, frame, len), IMUCAL_FRAME_READY);
}

static void test_server_repeated_request_is_answered_again_not_done_again(void** state) {
  (void)state;
  imucal_link_rx_t rx;
  imucal_link_server_t server;
  imucal_link_rx_init(&rx);
  imucal_link_server_init(&server);
  const imucal_link_cal_stop_t keep = {.action = 1}, discard = {.action = 0};
  const imucal_link_done_t done = {.request = IMUCAL_LINK_ID_CAL_STOP, .status = -1};
  /* GIVEN a request answered */
  give(&rx, IMUCAL_LINK_ID_CAL_STOP, 5, &keep);
  assert_int_equal(imucal_link_server_request(&server, &rx), IMUCAL_OK);
  assert_int_equal(imucal_link_server_reply(&server, IMUCAL_LINK_ID_DONE, &done), IMUCAL_OK);
  uint8_t first[IMUCAL_LINK_MAX_FRAME];
  uint16_t first_len = server.reply_len;
  memcpy(first, server.reply, first_len);
  /* WHEN it comes again, THEN the same reply stands ready */
  give(&rx, IMUCAL_LINK_ID_CAL_STOP, 5, &keep);
  assert_int_equal(imucal_link_server_request(&server, &rx), IMUCAL_FRAME_REPEATED);
  assert_int_equal(server.reply_len, first_len);
  assert_memory_equal(server.reply, first, first_len);
  assert_int_equal(server.n_repeated, 1);
  /* Another sequence, or other bytes under the same sequence, are new requests. */
  give(&rx, IMUCAL_LINK_ID_CAL_STOP, 6, &keep);
  assert_int_equal(imucal_link_server_request(&server, &rx), IMUCAL_OK);
  assert_int_equal(imucal_link_server_reply(&server, IMUCAL_LINK_ID_DONE, &done), IMUCAL_OK);
  give(&rx, IMUCAL_LINK_ID_CAL_STOP, 6, &discard);
  assert_int_equal(imucal_link_server_request(&server, &rx), IMUCAL_OK);
  /* A request under way and not answered yet is not repeated from an old reply. */
  give(&rx, IMUCAL_LINK_ID_CAL_STOP, 6, &discard);
  assert_int_equal(imucal_link_server_request(&server, &rx), IMUCAL_OK);
  /* The reply carries the request's sequence. */
  assert_int_equal(imucal_link_server_reply(&server, IMUCAL_LINK_ID_DONE, &done), IMUCAL_OK);
  assert_int_equal(feed(&rx, server.reply, server.reply_len), IMUCAL_FRAME_READY);
  assert_int_equal(imucal_link_rx_sequence(&rx), 6);
}

/* link.md is the manual of this table: every line the table demands must be in it. */
static char* read_text(const char* path) {
  FILE* file = fopen(path, "rb");
  if (!file) return NULL;
  char* text = calloc(1, 1 << 18);
  (void)!fread(text, 1, (1 << 18) - 1, file);
  fclose(file);
  return text;
}
static char* manual;
static void expect_line(const char* line) {
  if (getenv("IMUCAL_PRINT")) printf("%s\n", line);
  if (!manual || !strstr(manual, line)) fail_msg("common/link.md lacks: %s", line);
}
static void test_manual_lists_every_message_and_field(void** state) {
  (void)state;
  manual = read_text("common/link.md");
  if (!manual && !getenv("IMUCAL_PRINT")) {
    printf("SKIP: common/link.md not found: run from the repository's root\n");
    skip();
  }
  char line[300];
#define DOC_F(type, name, unit)                                                                                        \
  snprintf(line, sizeof line, "| `%s` | %s | %s |", #name, #type, unit), expect_line(line);
#define DOC_A(type, name, n, unit)                                                                                     \
  snprintf(line, sizeof line, "| `%s` | %s[%d] | %s |", #name, #type, n, unit), expect_line(line);
#define DOC_N(name, unit) snprintf(line, sizeof line, "| `%s` | u8, count | %s |", #name, unit), expect_line(line);
#define DOC_V(type, name, n, unit)                                                                                     \
  snprintf(line, sizeof line, "| `%s` | %s[count <= %d] | %s |", #name, #type, n, unit), expect_line(line);
#define DOC(id, name, NAME)                                                                                            \
  snprintf(line, sizeof line, "### 0x%02X %s", id, #NAME), expect_line(line);                                          \
  IMUCAL_LINK_##NAME(DOC_F, DOC_A, DOC_N, DOC_V)
  IMUCAL_LINK_MESSAGES(DOC)
  int surplus = 0; /* headings of messages that the table has not */
  for (const char* at = manual; at && (at = strstr(at, "\n### 0x")); at++) surplus++;
#define LESS_ONE(id, name, NAME) surplus--;
  IMUCAL_LINK_MESSAGES(LESS_ONE)
  assert_true(!manual || surplus == 0);
  free(manual);
}

/* Room for exactly the message, guarded by a byte behind it: enough, and one byte less is not. */
static void test_pack_and_encode_stay_inside_their_room(void** state) {
  (void)state;
  enum { GUARD = 0xA5 };
  unit_rng_t rng = {unit_seed()};
  for (size_t i = 0; i < N_IDS; i++) {
    imucal_link_any_t message;
    uint8_t *bytes = (uint8_t*)&message, room[IMUCAL_LINK_MAX_FRAME + 1];
    for (size_t k = 0; k < sizeof message; k++) bytes[k] = (uint8_t)unit_bits(&rng);
    bound_counts(all_ids[i], &message);
    size_t len = 0, again = 0;
    assert_int_equal(imucal_link_encode(all_ids[i], &message, room, sizeof room, &len), IMUCAL_OK);
    memset(room, GUARD, sizeof room);
    assert_int_equal(imucal_link_encode(all_ids[i], &message, room, len, &again), IMUCAL_OK);
    assert_int_equal(room[len], GUARD);
    assert_int_equal(imucal_link_encode(all_ids[i], &message, room, len - 1, &again), IMUCAL_ERR_SPACE);
    len += 9;
    memset(room, GUARD, sizeof room);
    assert_int_equal(imucal_link_pack(all_ids[i], 1, &message, room, len, &again), IMUCAL_OK);
    assert_int_equal(again, len);
    assert_int_equal(room[len], GUARD);
    assert_int_equal(imucal_link_pack(all_ids[i], 1, &message, room, len - 1, &again), IMUCAL_ERR_SPACE);
    assert_int_equal(imucal_link_pack(all_ids[i], 1, &message, room, 8, &again), IMUCAL_ERR_SPACE);
  }
}

/* Decoding writes the members and nothing else: what is behind them in the union stays zero. */
static void test_decode_writes_the_members_only(void** state) {
  (void)state;
  const uint8_t payload[4] = {0xFF, 0xFF, 0xFF, 0xFF};
  imucal_link_any_t got;
  assert_int_equal(imucal_link_decode(IMUCAL_LINK_ID_ERASE, payload, 4, &got), IMUCAL_OK);
  for (size_t i = 4; i < sizeof got; i++) assert_int_equal(((const uint8_t*)&got)[i], 0);
  assert_int_equal(imucal_link_decode(IMUCAL_LINK_ID_CAL_STOP, payload, 1, &got), IMUCAL_OK);
  for (size_t i = 1; i < sizeof got; i++) assert_int_equal(((const uint8_t*)&got)[i], 0);
}

/* Any type, and payloads of no byte and of one, pass through. */
static void test_frame_of_any_type_and_shortest_payload_passes(void** state) {
  (void)state;
  const uint8_t payload[1] = {0};
  for (size_t n = 0; n <= 1; n++) {
    for (int type = 0; type < 256; type++) {
      uint8_t frame[IMUCAL_LINK_MAX_FRAME];
      size_t len = 0;
      imucal_link_rx_t rx;
      imucal_link_rx_init(&rx);
      assert_int_equal(imucal_link_frame((uint8_t)type, 0, n == 0 ? NULL : payload, n, frame, 9 + n, &len), IMUCAL_OK);
      assert_int_equal(feed(&rx, frame, len), IMUCAL_FRAME_READY);
      assert_int_equal(imucal_link_rx_type(&rx), type);
      assert_int_equal(imucal_link_rx_payload_len(&rx), n);
      if (n == 1) assert_int_equal(*imucal_link_rx_payload(&rx), 0);
    }
  }
}

/* One byte and its right CRC: no frame, for it has no sequence number. */
static void test_rx_frame_without_sequence_is_refused_and_counted(void** state) {
  (void)state;
  const uint8_t raw[1] = {0x11};
  uint8_t frame[] = {6, 0x11, 0, 0, 0, 0, 0};
  imucal_put_u32(frame + 2, imucal_crc32(raw, 1));
  for (size_t i = 2; i < 6; i++) assert_int_not_equal(frame[i], 0);
  imucal_link_rx_t rx;
  imucal_link_rx_init(&rx);
  assert_int_equal(feed(&rx, frame, sizeof frame), IMUCAL_ERR_FRAME);
  assert_true(rx.n_resync == 1 && rx.n_crc == 0 && rx.n_frames == 0);
  const uint8_t wrong[] = {7, 0x11, 1, 1, 1, 1, 1, 0};
  assert_int_equal(feed(&rx, wrong, sizeof wrong), IMUCAL_ERR_CRC);
  assert_true(rx.n_resync == 1 && rx.n_crc == 1 && rx.n_frames == 0);
}

/* Two requests whose CRCs (by Python zlib.crc32: 0x261ee472, 0x251ee472) and last payload bytes differ in one byte only;
 * and what is left in the buffer behind a frame is no part of it. */
static void test_server_every_byte_of_the_crc_counts_and_none_behind(void** state) {
  (void)state;
  const imucal_link_hello_t a = {.protocol = 0, .nonce = 0}, b = {.protocol = 0xAB, .nonce = 0x0001CC26};
  const imucal_link_hello_reply_t reply = {.protocol = 1};
  uint8_t frame[IMUCAL_LINK_MAX_FRAME], longer[IMUCAL_LINK_MAX_FRAME];
  size_t len = 0;
  imucal_link_rx_t rx;
  imucal_link_server_t server;
  imucal_link_rx_init(&rx);
  imucal_link_server_init(&server);
  assert_int_equal(imucal_link_pack(IMUCAL_LINK_ID_HELLO, 7, &a, frame, sizeof frame, &len), IMUCAL_OK);
  assert_int_equal(feed(&rx, frame, len), IMUCAL_FRAME_READY);
  assert_int_equal(imucal_link_server_request(&server, &rx), IMUCAL_OK);
  assert_int_equal(imucal_link_server_reply(&server, IMUCAL_LINK_ID_HELLO_REPLY, &reply), IMUCAL_OK);
  (void)feed(&rx, longer, big_frame(3, 0x11, longer));
  assert_int_equal(feed(&rx, frame, len), IMUCAL_FRAME_READY);
  assert_int_equal(imucal_link_server_request(&server, &rx), IMUCAL_FRAME_REPEATED);
  assert_int_equal(imucal_link_pack(IMUCAL_LINK_ID_HELLO, 7, &b, frame, sizeof frame, &len), IMUCAL_OK);
  assert_int_equal(feed(&rx, frame, len), IMUCAL_FRAME_READY);
  assert_int_equal(imucal_link_server_request(&server, &rx), IMUCAL_OK);
  /* a reply that cannot be built is not kept */
  assert_int_equal(imucal_link_server_reply(&server, 0x7E, &reply), IMUCAL_ERR_UNKNOWN);
  assert_int_equal(server.reply_len, 0);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_pack_hello_golden_frame),
      cmocka_unit_test(test_payload_is_the_members_in_their_order),
      cmocka_unit_test(test_every_message_there_and_back_same_payload),
      cmocka_unit_test(test_decode_fields_arrive_in_their_members),
      cmocka_unit_test(test_decode_wrong_length_or_count_is_refused),
      cmocka_unit_test(test_frame_longest_payload_of_any_byte_survives),
      cmocka_unit_test(test_rx_one_flipped_bit_anywhere_next_frame_survives),
      cmocka_unit_test(test_rx_truncated_anywhere_next_frame_survives),
      cmocka_unit_test(test_rx_first_frame_after_junk_arrives),
      cmocka_unit_test(test_rx_unknown_type_is_counted),
      cmocka_unit_test(test_server_repeated_request_is_answered_again_not_done_again),
      cmocka_unit_test(test_manual_lists_every_message_and_field),
      cmocka_unit_test(test_pack_and_encode_stay_inside_their_room),
      cmocka_unit_test(test_decode_writes_the_members_only),
      cmocka_unit_test(test_frame_of_any_type_and_shortest_payload_passes),
      cmocka_unit_test(test_rx_frame_without_sequence_is_refused_and_counted),
      cmocka_unit_test(test_server_every_byte_of_the_crc_counts_and_none_behind),
      cmocka_unit_test(test_rx_frames_lost_are_at_most_the_frames_touched),
      cmocka_unit_test(test_rx_noise_costs_at_most_the_frame_it_touches),
      cmocka_unit_test(test_rx_endless_bytes_are_bounded_and_counted_once),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
