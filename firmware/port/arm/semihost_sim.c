// SPDX-License-Identifier: MIT
#include "semihost_sim.h"

#include <string.h>

#include "semihost.h"

static int32_t feed_refill(void* ctx, uint8_t* data, size_t capacity) {
  semihost_feed_t* feed = ctx;
  if (feed->path[0] == '\0') return STREAM_NOTHING_YET;
  if (feed->has_ended) return STREAM_ENDED;
  if (feed->file < 0) feed->file = semihost_open(feed->path, SEMIHOST_READ);
  const int32_t n = feed->file < 0 ? -1 : semihost_read(feed->file, data, capacity);
  if (n > 0) return n;
  feed->has_ended = true;
  if (feed->file >= 0) semihost_close(feed->file);
  feed->file = -1;
  return n == 0 ? STREAM_ENDED : STREAM_FAILED;
}

void semihost_feed_init(semihost_feed_t* feed, const char* command_line, sample_stream_t* stream, uint8_t* buffer,
                        size_t capacity) {
  feed->file = -1;
  if (!semihost_option(command_line, "feed", feed->path, sizeof feed->path)) feed->path[0] = '\0';
  *stream = (sample_stream_t){.ctx = feed, .refill = feed_refill, .buffer = buffer, .capacity = capacity};
}

imucal_port_sample_t semihost_sample_read(sample_stream_t* stream, imucal_sample_t* sample) {
  switch (sample_stream_next(stream, sample)) {
  case 1:
    return IMUCAL_PORT_SAMPLE;
  case STREAM_BAD_RECORD:
    return IMUCAL_PORT_BAD_SAMPLE;
  case STREAM_ENDED:
    return IMUCAL_PORT_ENDED;
  case STREAM_FAILED:
    return IMUCAL_PORT_FAILED;
  default:
    return IMUCAL_PORT_NO_SAMPLE;
  }
}

void semihost_sample_enable(sample_stream_t* stream, bool is_wanted) {
  semihost_feed_t* feed = stream->ctx;
  if (!is_wanted || !feed->has_ended) return;
  feed->has_ended = false;
  sample_stream_clear(stream);
}

__attribute__((noreturn)) static void refuse(const char* what, const char* value) {
  semihost_print("imucal: ");
  semihost_print(what);
  semihost_print(value);
  semihost_print("\n");
  semihost_exit(2);
}

static bool is_other_option(const char* name) {
  static const char* const names[] = {"feed", "flash", "flash-delay-us", "sensor", "bus"};
  bool is_other = false;
  for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) is_other |= !strcmp(name, names[i]);
  return is_other;
}

void semihost_board(imucal_board_t* board, const char* command_line) {
  char name[24];
  for (const char* at = command_line; *at;) {
    size_t n = 0;
    while (at[n] && at[n] != ' ' && at[n] != '=') n++;
    const bool is_option = at[n] == '=';
    const bool is_long = n >= sizeof name;
    if (is_option && is_long) refuse("unknown argument ", at);
    if (is_option) {
      memcpy(name, at, n);
      name[n] = '\0';
      if (!is_other_option(name) && !board_options_set(board, name, at + n + 1)) refuse("cannot use argument ", at);
    } else if (at != command_line) {
      refuse("argument without '=': ", at);
    }
    while (*at && *at != ' ') at++;
    while (*at == ' ') at++;
  }
  const imucal_status status = imucal_board_check(board);
  if (status != IMUCAL_OK) refuse("this board cannot be: ", imucal_status_text(status));
}

uint32_t semihost_boot_id(void) {
  return semihost_seconds() << 10 ^ semihost_centiseconds();
}

static bool load(void* ctx, uint32_t offset_bytes, uint8_t* data, size_t length) {
  const semihost_flash_t* flash = ctx;
  return semihost_seek(flash->file, offset_bytes) && semihost_read(flash->file, data, length) == (int32_t)length;
}

static bool save(void* ctx, uint32_t offset_bytes, const uint8_t* data, size_t length) {
  const semihost_flash_t* flash = ctx;
  return semihost_seek(flash->file, offset_bytes) && semihost_write(flash->file, data, length);
}

static bool fill_erased(semihost_flash_t* flash, uint32_t from, uint32_t size) {
  uint8_t ones[64];
  memset(ones, 0xFF, sizeof ones);
  for (uint32_t at = from; at < size;) {
    const uint32_t n = size - at < sizeof ones ? size - at : (uint32_t)sizeof ones;
    if (!save(flash, at, ones, n)) return false;
    at += n;
  }
  return true;
}

static bool open_flash(semihost_flash_t* flash, nor_t* nor, const char* path) {
  flash->file = semihost_open(path, SEMIHOST_UPDATE);
  if (flash->file < 0) flash->file = semihost_open(path, SEMIHOST_CREATE);
  if (flash->file < 0) return false;
  const int32_t length = semihost_length(flash->file);
  if (length < 0 || (uint32_t)length > nor->size_bytes) return false;
  nor->ctx = flash;
  nor->load = load;
  nor->save = save;
  return fill_erased(flash, (uint32_t)length, nor->size_bytes);
}

static imucal_status status_of(nor_result_t result) {
  return result == NOR_OK ? IMUCAL_OK : IMUCAL_ERR_FLASH;
}

static uint32_t slot_start(const nor_t* nor, uint32_t slot) {
  return slot * (nor->size_bytes / IMUCAL_STORE_SLOTS);
}

imucal_status semihost_flash_erase(void* ctx, uint32_t slot) {
  nor_t* nor = ctx;
  return status_of(nor_erase(nor, slot_start(nor, slot), nor->size_bytes / IMUCAL_STORE_SLOTS));
}

imucal_status semihost_flash_program(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len) {
  return status_of(nor_program(ctx, slot_start(ctx, slot) + offset, data, len));
}

imucal_status semihost_flash_read(void* ctx, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t len) {
  return status_of(nor_read(ctx, slot_start(ctx, slot) + offset, data, len));
}

imucal_flash_t semihost_flash(const char* command_line, semihost_flash_t* file, nor_t* nor, uint32_t slot_bytes,
                              uint32_t page_bytes) {
  char path[160];
  *nor = (nor_t){.size_bytes = IMUCAL_STORE_SLOTS * slot_bytes,
                 .page_bytes = page_bytes,
                 .word_bytes = SEMIHOST_WORD_BYTES,
                 .cut_operation = NOR_NEVER};
  nor_power_on(nor);
  if (!semihost_option(command_line, "flash", path, sizeof path))
    refuse("argument flash=PATH is missing: there is no flash to hold the table", "");
  if (!open_flash(file, nor, path)) refuse("cannot use the flash file ", path);
  return (imucal_flash_t){.erase = semihost_flash_erase,
                          .program = semihost_flash_program,
                          .read = semihost_flash_read,
                          .ctx = nor,
                          .slot_bytes = slot_bytes,
                          .erase_bytes = slot_bytes,
                          .program_bytes = SEMIHOST_WORD_BYTES};
}
