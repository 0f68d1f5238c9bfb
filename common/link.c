// SPDX-License-Identifier: MIT
#include "link.h"

#include <string.h>

#include "crc.h"
#include "num.h"

/* ---- the message table as bytes: id, number of fields, then per field elements and kind*16 + type ---- */

enum { TYPE_u8, TYPE_chr, TYPE_u16, TYPE_i16, TYPE_u32, TYPE_i32, TYPE_f32, TYPE_u64 };
enum { KIND_FIXED = 0, KIND_NUMBER = 16, KIND_VARIABLE = 32 };
static const uint8_t type_size[] = {1, 1, 2, 2, 4, 4, 4, 8};

#define ONE_F(type, name, unit) +1
#define ONE_A(type, name, n, unit) +1
#define ONE_N(name, unit) +1
#define FIELD_F(type, name, unit) 1, KIND_FIXED + TYPE_##type,
#define FIELD_A(type, name, n, unit) n, KIND_FIXED + TYPE_##type,
#define FIELD_N(name, unit) 1, KIND_NUMBER + TYPE_u8,
#define FIELD_V(type, name, n, unit) n, KIND_VARIABLE + TYPE_##type,
#define MESSAGE(id, name, NAME)                                                                                        \
  id, 0 IMUCAL_LINK_##NAME(ONE_F, ONE_A, ONE_N, ONE_A), IMUCAL_LINK_##NAME(FIELD_F, FIELD_A, FIELD_N, FIELD_V)
static const uint8_t message_table[] = {IMUCAL_LINK_MESSAGES(MESSAGE) 0};

/* The longest message must fit a payload: checked at compile time on the packed size. */
#define SIZE_u8 1
#define SIZE_chr 1
#define SIZE_u16 2
#define SIZE_i16 2
#define SIZE_u32 4
#define SIZE_i32 4
#define SIZE_f32 4
#define SIZE_u64 8
#define BYTES_F(type, name, unit) +SIZE_##type
#define BYTES_A(type, name, n, unit) +SIZE_##type* n
#define BYTES_N(name, unit) +1
#define FITS(id, name, NAME)                                                                                           \
  typedef char                                                                                                         \
      name##_fits_payload[(0 IMUCAL_LINK_##NAME(BYTES_F, BYTES_A, BYTES_N, BYTES_A)) <= IMUCAL_LINK_MAX_PAYLOAD ? 1    \
                                                                                                                : -1];
IMUCAL_LINK_MESSAGES(FITS)

/* Descriptor of a message: its fields start at the result + 2.  Null: no such id. */
static const uint8_t* find_message(uint32_t id) {
  const uint8_t* at = message_table;
  while (*at != 0) {
    if (*at == id) return at;
    at += 2 + 2 * (size_t)at[1];
  }
  return NULL;
}

/* Walks the fields of a message struct; members lie at the next multiple of their own size (natural alignment, as
 * every ABI used here has it; tests/common/test_link.c compares with offsetof). */
typedef struct cursor {
  const uint8_t* field;
  size_t n_fields_left;
  size_t offset;  /* of the member in the struct */
  size_t members; /* elements in the struct */
  size_t used;    /* elements on the wire */
  size_t size;    /* of one element */
  uint8_t number; /* value of the last N field */
  bool is_number;
} cursor_t;

static cursor_t cursor_at(const uint8_t* message) {
  return (cursor_t){.field = message + 2, .n_fields_left = message[1]};
}

/* Step to the next field; false at the end. */
static bool cursor_next(cursor_t* c) {
  if (c->n_fields_left == 0) return false;
  c->n_fields_left--;
  c->offset += c->members * c->size;
  c->members = c->field[0];
  c->size = type_size[c->field[1] & 15u];
  c->offset = (c->offset + c->size - 1) & ~(c->size - 1);
  c->is_number = (c->field[1] & 0xF0u) == KIND_NUMBER;
  c->used = (c->field[1] & 0xF0u) == KIND_VARIABLE ? c->number : c->members;
  c->field += 2;
  return true;
}

/* One element between the struct and its little-endian bytes, either way. */
static void copy_element(uint8_t* to, const uint8_t* from, size_t size) {
  const uint16_t one = 1;
  const size_t flip = *(const uint8_t*)&one == 1 ? 0 : size - 1; /* a big-endian machine has them the other way round */
  for (size_t i = 0; i < size; i++) to[i] = from[i ^ flip];
}

/* All fields of a message: a struct to its payload, or back.  *len: bytes of the payload, at most max_payload. */
static imucal_status copy_fields(uint32_t id, const uint8_t* from, uint8_t* to, bool is_encoding, size_t max_payload,
                                 size_t* len) {
  const uint8_t* descriptor = find_message(id);
  if (descriptor == NULL) return IMUCAL_ERR_UNKNOWN;
  cursor_t c = cursor_at(descriptor);
  size_t at = 0;
  while (cursor_next(&c)) {
    if (c.used > c.members) return IMUCAL_ERR_RANGE;
    if (at + c.used * c.size > max_payload) return IMUCAL_ERR_SPACE;
    for (size_t i = 0; i < c.used; i++, at += c.size) {
      const size_t member = c.offset + i * c.size;
      const uint8_t* source = from + (is_encoding ? member : at);
      copy_element(to + (is_encoding ? at : member), source, c.size);
      if (c.is_number) c.number = *source;
    }
  }
  *len = at;
  return IMUCAL_OK;
}

imucal_status imucal_link_encode(uint32_t id, const void* message, uint8_t* payload, size_t max_payload,
                                 size_t* payload_len) {
  return copy_fields(id, message, payload, true, max_payload, payload_len);
}

imucal_status imucal_link_decode(uint32_t id, const uint8_t* payload, size_t payload_len, imucal_link_any_t* message) {
  memset(message, 0, sizeof *message);
  size_t len = 0;
  const imucal_status status = copy_fields(id, payload, (uint8_t*)message, false, payload_len, &len);
  if (status == IMUCAL_ERR_SPACE || (status == IMUCAL_OK && len != payload_len)) return IMUCAL_ERR_LENGTH;
  return status;
}

/* ---- sending ---- */

/* buffer[1 .. 1+raw_len] holds the raw bytes; becomes one COBS block chain with its delimiter.  raw_len < 254, so
 * that no block is full and encoding is in place: every zero becomes the distance to the next one. */
static size_t cobs_in_place(uint8_t* buffer, size_t raw_len) {
  size_t code_at = 0;
  for (size_t i = 1; i <= raw_len; i++) {
    if (buffer[i] != 0) continue;
    buffer[code_at] = (uint8_t)(i - code_at);
    code_at = i;
  }
  buffer[code_at] = (uint8_t)(raw_len + 1 - code_at);
  buffer[raw_len + 1] = 0;
  return raw_len + 2;
}

/* Around a payload: delimiter, code, type, sequence before; CRC and delimiter after. */
#define FRAME_OVERHEAD 9u
#define PAYLOAD_AT 4u

/* Header is to be put, payload is in place at out + PAYLOAD_AT. */
static size_t finish_frame(uint8_t type, uint8_t sequence, size_t payload_len, uint8_t* out) {
  out[0] = 0;
  out[2] = type;
  out[3] = sequence;
  imucal_put_u32(out + PAYLOAD_AT + payload_len, imucal_crc32(out + 2, payload_len + 2));
  return 1 + cobs_in_place(out + 1, payload_len + 6);
}

imucal_status imucal_link_frame(uint8_t type, uint8_t sequence, const uint8_t* payload, size_t payload_len,
                                uint8_t* out, size_t max_out, size_t* out_len) {
  if (payload_len > IMUCAL_LINK_MAX_PAYLOAD || payload_len + FRAME_OVERHEAD > max_out) return IMUCAL_ERR_SPACE;
  if (payload_len != 0) memcpy(out + PAYLOAD_AT, payload, payload_len);
  *out_len = finish_frame(type, sequence, payload_len, out);
  return IMUCAL_OK;
}

imucal_status imucal_link_pack(uint32_t id, uint8_t sequence, const void* message, uint8_t* out, size_t max_out,
                               size_t* out_len) {
  if (max_out < FRAME_OVERHEAD) return IMUCAL_ERR_SPACE;
  size_t room = max_out - FRAME_OVERHEAD;
  size_t payload_len = 0;
  imucal_status status = imucal_link_encode(
      id, message, out + PAYLOAD_AT, room < IMUCAL_LINK_MAX_PAYLOAD ? room : IMUCAL_LINK_MAX_PAYLOAD, &payload_len);
  if (status != IMUCAL_OK) return status;
  *out_len = finish_frame((uint8_t)id, sequence, payload_len, out);
  return IMUCAL_OK;
}

/* ---- receiving ---- */

void imucal_link_rx_init(imucal_link_rx_t* rx) {
  memset(rx, 0, sizeof *rx);
}

/* The delimiter came: judge the frame. */
static imucal_status end_of_frame(imucal_link_rx_t* rx) {
  bool is_whole = rx->block_left == 0 && rx->len >= 6;
  bool is_judged = rx->is_skipping || !rx->is_started; /* already counted, or no byte since the last delimiter */
  rx->is_skipping = false;
  rx->is_started = false;
  if (is_judged) return IMUCAL_OK;
  if (!is_whole) {
    rx->n_resync++;
    return IMUCAL_ERR_FRAME;
  }
  if (imucal_crc32(rx->buffer, (size_t)rx->len - 4) != imucal_get_u32(rx->buffer + rx->len - 4)) {
    rx->n_crc++;
    return IMUCAL_ERR_CRC;
  }
  rx->n_frames++;
  return IMUCAL_FRAME_READY;
}

static imucal_status append(imucal_link_rx_t* rx, uint8_t byte) {
  if (rx->len >= IMUCAL_LINK_MAX_RAW) {
    rx->is_skipping = true;
    rx->n_overflow++;
    return IMUCAL_ERR_SPACE;
  }
  rx->buffer[rx->len++] = byte;
  return IMUCAL_OK;
}

imucal_status imucal_link_rx_put(imucal_link_rx_t* rx, uint8_t byte) {
  if (byte == 0) return end_of_frame(rx);
  if (rx->is_skipping) return IMUCAL_OK;
  if (!rx->is_started) {
    rx->is_started = true;
    rx->len = 0;
    rx->block_left = (uint8_t)(byte - 1);
    rx->is_zero_due = byte != 0xFF;
    return IMUCAL_OK;
  }
  if (rx->block_left != 0) {
    rx->block_left--;
    return append(rx, byte);
  }
  imucal_status status = rx->is_zero_due ? append(rx, 0) : IMUCAL_OK;
  rx->block_left = (uint8_t)(byte - 1);
  rx->is_zero_due = byte != 0xFF;
  return status;
}

imucal_status imucal_link_rx_message(imucal_link_rx_t* rx, imucal_link_any_t* message) {
  imucal_status status =
      imucal_link_decode(imucal_link_rx_type(rx), imucal_link_rx_payload(rx), imucal_link_rx_payload_len(rx), message);
  if (status != IMUCAL_OK) rx->n_unknown++;
  return status;
}

/* ---- the device's end ---- */

void imucal_link_server_init(imucal_link_server_t* server) {
  memset(server, 0, sizeof *server);
}

imucal_status imucal_link_server_request(imucal_link_server_t* server, const imucal_link_rx_t* rx) {
  uint32_t crc = imucal_get_u32(rx->buffer + rx->len - 4);
  if (server->reply_len != 0 && server->request_crc == crc && server->request_sequence == imucal_link_rx_sequence(rx)) {
    server->n_repeated++;
    return IMUCAL_FRAME_REPEATED;
  }
  server->reply_len = 0;
  server->request_crc = crc;
  server->request_sequence = imucal_link_rx_sequence(rx);
  return IMUCAL_OK;
}

imucal_status imucal_link_server_reply(imucal_link_server_t* server, uint32_t id, const void* message) {
  size_t len = 0;
  imucal_status status =
      imucal_link_pack(id, server->request_sequence, message, server->reply, sizeof server->reply, &len);
  server->reply_len = (uint16_t)len;
  return status;
}
