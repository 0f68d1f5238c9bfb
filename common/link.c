// SPDX-License-Identifier: MIT
#include "link.h"

#include <string.h>

#include "crc.h"
#include "num.h"

/* ---- the fields of a message, by their names in link.h: offsetof asks the compiler where each lies ---- */

enum { TYPE_u8, TYPE_chr, TYPE_u16, TYPE_i16, TYPE_u32, TYPE_i32, TYPE_f32, TYPE_u64 };
static const uint8_t type_size[] = {1, 1, 2, 2, 4, 4, 4, 8};
enum { KIND_FIXED, KIND_NUMBER, KIND_VARIABLE, KIND_END }; /* F and A, N, V of link.h */
typedef struct field {
  uint8_t kind_type; /* 8 kind + type */
  uint8_t members;   /* elements in the struct */
  uint8_t offset;    /* of the first in the struct; they fit: below */
} field_t;

#define FIELD_F(type, name, unit) {8 * KIND_FIXED + TYPE_##type, 1, offsetof(message_t, name)},
#define FIELD_A(type, name, n, unit) {8 * KIND_FIXED + TYPE_##type, n, offsetof(message_t, name)},
#define FIELD_N(name, unit) {8 * KIND_NUMBER + TYPE_u8, 1, offsetof(message_t, name)},
#define FIELD_V(type, name, n, unit) {8 * KIND_VARIABLE + TYPE_##type, n, offsetof(message_t, name)},
#define PLACE(id, name, NAME) PLACE_##name,
enum { IMUCAL_LINK_MESSAGES(PLACE) };
#define ID(id, name, NAME) id,
static const uint8_t ids[] = {IMUCAL_LINK_MESSAGES(ID)};
#define RETURN_FIELDS(id, name, NAME)                                                                                  \
  case PLACE_##name: {                                                                                                 \
    typedef imucal_link_##name##_t message_t;                                                                          \
    static const field_t fields[] = {IMUCAL_LINK_##NAME(FIELD_F, FIELD_A, FIELD_N, FIELD_V){8 * KIND_END, 0, 0}};      \
    return fields;                                                                                                     \
  }

/* In the order of the wire, KIND_END behind the last.  Null: no such id. */
static const field_t* find_fields(uint32_t id) {
  size_t place = 0;
  while (place < sizeof ids && ids[place] != id) place++;
  switch (place) {
    IMUCAL_LINK_MESSAGES(RETURN_FIELDS)
  default:
    return NULL;
  }
}

/* Every offset fits a byte. */
IMUCAL_STATIC_ASSERT(offsets_fit, sizeof(imucal_link_any_t) <= 256);

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
  IMUCAL_STATIC_ASSERT(name##_fits_payload,                                                                            \
                       (0 IMUCAL_LINK_##NAME(BYTES_F, BYTES_A, BYTES_N, BYTES_A)) <= IMUCAL_LINK_MAX_PAYLOAD);
IMUCAL_LINK_MESSAGES(FITS)

/* One element between the struct and its little-endian bytes, either way. */
static void copy_element(uint8_t* to, const uint8_t* from, size_t size) {
  const uint16_t one = 1;
  const size_t flip = *(const uint8_t*)&one == 1 ? 0 : size - 1; /* a big-endian machine has them the other way round */
  for (size_t i = 0; i < size; i++) to[i] = from[i ^ flip];
}

/* All fields of a message: a struct to its payload, or back.  *len: bytes of the payload, at most max_payload. */
static imucal_status copy_fields(uint32_t id, const uint8_t* from, uint8_t* to, bool is_encoding, size_t max_payload,
                                 size_t* len) {
  const field_t* field = find_fields(id);
  if (field == NULL) return IMUCAL_ERR_UNKNOWN;
  size_t at = 0, number = 0; /* number: value of the last N field */
  for (; field->kind_type != 8 * KIND_END; field++) {
    const size_t size = type_size[field->kind_type & 7u], kind = field->kind_type >> 3;
    const size_t n = kind == KIND_VARIABLE ? number : field->members;
    if (n > field->members) return IMUCAL_ERR_RANGE;
    if (at + n * size > max_payload) return IMUCAL_ERR_SPACE;
    for (size_t i = 0; i < n; i++, at += size) {
      const size_t member = field->offset + i * size;
      const uint8_t* source = from + (is_encoding ? member : at);
      copy_element(to + (is_encoding ? at : member), source, size);
      if (kind == KIND_NUMBER) number = *source;
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
    return IMUCAL_OK;
  }
  if (rx->block_left != 0) {
    rx->block_left--;
    return append(rx, byte);
  }
  /* A zero stood here.  Only a block of 254 bytes ends without one, and no frame is so long. */
  rx->block_left = (uint8_t)(byte - 1);
  return append(rx, 0);
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
