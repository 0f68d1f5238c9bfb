// SPDX-License-Identifier: MIT
/* The W25Q driver's bytes on the wire against sequences written down from the manufacturer's tables, chip select by chip select;
 * neither the model of the chip (emu/w25q.h) nor the driver's constants are used here.  Sources:
 *  [BV]  W25Q16BV data sheet, revision F, July 8, 2010: instruction set; manufacturer and device identification (p. 17: EFh,
 *        4015h); page program (p. 36: 24-bit address, wraps at the page's end).
 *  [JV]  Apache NuttX, drivers/mtd/w25qxxxjv.c: instructions with their sequences, status registers 1 to 3 bit by bit, device
 *        types 40h (QE fixed to 1) and 70h.
 *  [T]   Seeed, W25Q16BV.h (os.mbed.com): tRES1 3 us.
 * Status 3 missing: W25Q32BV data sheet, p. 25; suspended: W25Q40BL data sheet, p. 44. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "flash/w25q.h"

/* One chip select, in hexadecimal: what the driver must send, and what the chip answers. */
typedef struct {
  const char *out, *in;
} selected_t;

static const selected_t* next;
static uint32_t waited_us; /* since the newest transfer */
static uint32_t least_us;  /* the wait that must stand before the next one */

static size_t bytes_of(const char* text, uint8_t* bytes) {
  size_t n = 0;
  for (; text[0] && text[1]; text += text[2] == ' ' ? 3 : 2) {
    const char pair[3] = {text[0], text[1], 0};
    bytes[n++] = (uint8_t)strtoul(pair, NULL, 16);
  }
  return n;
}

static imucal_status transfer(void* ctx, const uint8_t* out, size_t n_out, uint8_t* in, size_t n_in) {
  uint8_t bytes[32];
  (void)ctx;
  if (next->out == NULL) fail_msg("one transfer too many: instruction %02X", (unsigned)out[0]);
  if (n_out != bytes_of(next->out, bytes) || memcmp(out, bytes, n_out) != 0)
    fail_msg("%u bytes from %02X on, must be %s", (unsigned)n_out, (unsigned)out[0], next->out);
  const size_t n_answer = bytes_of(next->in, bytes);
  if (n_in != n_answer) fail_msg("%s: %u bytes read, must be %u", next->out, (unsigned)n_in, (unsigned)n_answer);
  if (n_in) memcpy(in, bytes, n_in);
  assert_true(waited_us >= least_us);
  least_us = out[0] == 0xAB ? 3 : 0; /* [T] tRES1 */
  waited_us = 0;
  next++;
  return IMUCAL_OK;
}

static void delay_us(void* ctx, uint32_t us) {
  (void)ctx;
  waited_us += us;
}

static const imucal_w25q_bus_t bus = {.transfer = transfer, .delay_us = delay_us};
static imucal_w25q_t driver;

static void follow(const selected_t* script) {
  next = script;
  waited_us = least_us = 0;
}

static void assert_followed(void) {
  if (next->out != NULL) fail_msg("not sent: %s", next->out);
}

/* A W25Q128JV-IQ that sleeps; its last two sectors but some. */
static void start_jv(void) {
  static const selected_t script[] = {{"AB", "FF FF FF 17"}, /* release: three dummy bytes, device ID */
                                      {"05", "00"},          {"9F", "EF 40 18"}, {"05", "00"}, {"35", "02"}, /* QE */
                                      {"15", "60"},          {NULL, NULL}};
  follow(script);
  assert_int_equal(imucal_w25q_start(&driver, &bus, 0x7FE000), IMUCAL_OK);
  assert_followed();
  assert_int_equal(driver.state, IMUCAL_W25Q_READY);
  assert_int_equal(driver.capacity_bytes, 16777216);
}

static void test_w25q_wire_start(void** state) {
  (void)state;
  start_jv();
}

static void test_w25q_wire_sector_erase(void** state) {
  (void)state;
  static const selected_t script[] = {{"05", "00"},        {"9F", "EF 40 18"}, {"05", "00"}, {"35", "02"},
                                      {"15", "60"},        {"06", ""},         {"05", "02"}, /* WEL */
                                      {"20 7F F0 00", ""}, {"05", "03"},       {"05", "03"}, /* BUSY and WEL */
                                      {"05", "00"},        {NULL, NULL}};
  start_jv();
  follow(script);
  assert_int_equal(imucal_w25q_erase(&driver, 1), IMUCAL_OK);
  assert_followed();
}

/* Eight bytes over the end of a page: two instructions, each with its own write enable. */
static void test_w25q_wire_page_program_ends_with_the_page(void** state) {
  (void)state;
  static const uint8_t data[8] = {0xD0, 0xD1, 0xD2, 0xD3, 0xD4, 0xD5, 0xD6, 0xD7};
  static const selected_t script[] = {{"05", "00"},
                                      {"9F", "EF 40 18"},
                                      {"05", "00"},
                                      {"35", "02"},
                                      {"15", "60"},
                                      {"06", ""},
                                      {"05", "02"},
                                      {"02 7F E2 FC D0 D1 D2 D3", ""},
                                      {"05", "03"},
                                      {"05", "00"},
                                      {"06", ""},
                                      {"05", "02"},
                                      {"02 7F E3 00 D4 D5 D6 D7", ""},
                                      {"05", "00"},
                                      {NULL, NULL}};
  start_jv();
  follow(script);
  assert_int_equal(imucal_w25q_program(&driver, 0, 0x2FC, data, 8), IMUCAL_OK);
  assert_followed();
}

/* 03h runs over the end of a page: one instruction. */
static void test_w25q_wire_read(void** state) {
  (void)state;
  static const selected_t script[] = {
      {"05", "00"}, {"9F", "EF 40 18"}, {"03 7F E2 FC", "D0 D1 D2 D3 D4 D5 D6 D7"}, {NULL, NULL}};
  uint8_t back[8];
  start_jv();
  follow(script);
  assert_int_equal(imucal_w25q_read(&driver, 0, 0x2FC, back, 8), IMUCAL_OK);
  assert_followed();
  assert_int_equal(back[0], 0xD0);
  assert_int_equal(back[7], 0xD7);
}

/* No write enable, no instruction to write: the latch that did not set, and one that is still busy. */
static void test_w25q_wire_nothing_is_written_without_the_latch(void** state) {
  (void)state;
  static const char* const not_enabled[] = {"00", "01", "03"};
  for (size_t i = 0; i < sizeof not_enabled / sizeof not_enabled[0]; i++) {
    const selected_t script[] = {{"05", "00"}, {"9F", "EF 40 18"}, {"05", "00"},           {"35", "02"},
                                 {"15", "60"}, {"06", ""},         {"05", not_enabled[i]}, {NULL, NULL}};
    start_jv();
    follow(script);
    assert_int_equal(imucal_w25q_erase(&driver, 0), IMUCAL_ERR_FLASH);
    assert_followed();
  }
}

/* Status bits by name, [JV]: what each of the 24 means for who wants to write. */
static void test_w25q_wire_status_bits(void** state) {
  (void)state;
  static const struct {
    const char *sr1, *sr2, *sr3;
    bool is_locked;
  } cases[] = {{"04", "02", "60", true},  /* BP0 */
               {"08", "02", "60", true},  /* BP1 */
               {"10", "02", "60", true},  /* BP2 */
               {"20", "02", "60", false}, /* TB: where BP begins */
               {"40", "02", "60", false}, /* SEC: in what BP counts */
               {"80", "02", "60", false}, /* SRP: of the register itself */
               {"00", "01", "60", false}, /* SRL */
               {"00", "3A", "60", false}, /* LB3 to LB1: other registers; QE */
               {"00", "42", "60", true},  /* CMP */
               {"00", "82", "60", true},  /* SUS: an erase that somebody suspended */
               {"00", "02", "64", true},  /* WPS */
               {"00", "02", "E0", false}, /* HOLD/RST, DRV */
               {"00", "02", "FF", false}, /* no register 3: the line is not driven */
               {"00", "02", "FB", false}, /* reserved bits */
               {"00", "02", "7F", true}};
  for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
    const selected_t script[] = {{"AB", "FF FF FF 17"}, {"05", cases[i].sr1}, {"9F", "EF 40 18"}, {"05", cases[i].sr1},
                                 {"35", cases[i].sr2},  {"15", cases[i].sr3}, {NULL, NULL}};
    follow(script);
    assert_int_equal(imucal_w25q_start(&driver, &bus, 0), IMUCAL_OK);
    assert_followed();
    assert_int_equal(driver.state, cases[i].is_locked ? IMUCAL_W25Q_PROTECTED : IMUCAL_W25Q_READY);
  }
}

/* The older BV, CV and DV types have two status registers, [BV]; the newer IM types another device type, [JV]. */
static void test_w25q_wire_older_and_newer_types_are_written(void** state) {
  (void)state;
  static const struct {
    const char *id, *sr2, *sr3;
    uint32_t capacity_bytes;
  } types[] = {{"EF 40 13", "00", "FF", 524288}, {"EF 40 15", "00", "FF", 2097152}, {"EF 70 18", "00", "60", 16777216}};
  for (size_t i = 0; i < sizeof types / sizeof types[0]; i++) {
    const selected_t script[] = {{"AB", "FF FF FF 12"}, {"05", "00"},         {"9F", types[i].id},  {"05", "00"},
                                 {"35", types[i].sr2},  {"15", types[i].sr3}, {"05", "00"},         {"9F", types[i].id},
                                 {"05", "00"},          {"35", types[i].sr2}, {"15", types[i].sr3}, {"06", ""},
                                 {"05", "02"},          {"20 00 00 00", ""},  {"05", "00"},         {NULL, NULL}};
    follow(script);
    assert_int_equal(imucal_w25q_start(&driver, &bus, 0), IMUCAL_OK);
    assert_int_equal(imucal_w25q_erase(&driver, 0), IMUCAL_OK);
    assert_followed();
    assert_int_equal(driver.capacity_bytes, types[i].capacity_bytes);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_w25q_wire_start),
      cmocka_unit_test(test_w25q_wire_sector_erase),
      cmocka_unit_test(test_w25q_wire_page_program_ends_with_the_page),
      cmocka_unit_test(test_w25q_wire_read),
      cmocka_unit_test(test_w25q_wire_nothing_is_written_without_the_latch),
      cmocka_unit_test(test_w25q_wire_status_bits),
      cmocka_unit_test(test_w25q_wire_older_and_newer_types_are_written),
  };
  return cmocka_run_group_tests_name("w25q_wire", tests, NULL, NULL);
}
