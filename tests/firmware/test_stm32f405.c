// SPDX-License-Identifier: MIT
/* Flash and SPI drivers of the STM32F405 port, compiled from their own sources over the register model, errors included;
 * and the table store of the core on top of them. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "emu/stm32f405.h"
/* The drivers' own sources, with their registers in the model. */
#include "port/stm32f405/board_store_chip.c"
#include "port/stm32f405/flash.c"
#include "port/stm32f405/spi.c"
#include "store.h"

static int power_on(void** state) {
  (void)state;
  emu_stm32_power_on();
  return 0;
}

static const uint8_t words[8] = {1, 2, 3, 4, 0xF0, 0xF1, 0xF2, 0xF3};

static void assert_locked(void) {
  assert_true(stm32.cr & FLASH_CR_LOCK);
  assert_int_equal(stm32.cr & (FLASH_CR_PG | FLASH_CR_SER), 0);
}

/* ---- flash ---- */

static void test_flash_programs_words_of_its_slot_and_locks_again(void** state) {
  (void)state;
  memset(stm32.slot[1], 0, STM32_SLOT_BYTES);
  assert_int_equal(stm32_flash_erase(1), IMUCAL_OK);
  assert_int_equal(stm32.slot[1][STM32_SLOT_BYTES - 1], 0xFF);
  assert_locked();
  assert_int_equal(stm32_flash_program(1, 8, words, 8), IMUCAL_OK);
  assert_memory_equal(stm32.slot[1] + 8, words, 8);
  assert_int_equal(stm32.slot[0][8], 0xFF);
  assert_locked();
  assert_int_equal(stm32.n_violations, 0);
  assert_int_equal(stm32.acr, 5u | 7u << 8);
}

static void test_flash_refuses_what_is_outside(void** state) {
  (void)state;
  assert_int_equal(stm32_flash_erase(2), IMUCAL_ERR_ARGUMENT);
  assert_int_equal(stm32_flash_program(0, STM32_SLOT_BYTES - 4, words, 8), IMUCAL_ERR_ARGUMENT);
  assert_int_equal(stm32_flash_program(0, 2, words, 4), IMUCAL_ERR_ARGUMENT);
  assert_int_equal(stm32_flash_program(0, 0, words, 3), IMUCAL_ERR_ARGUMENT);
  assert_int_equal(stm32.n_words + stm32.n_erases, 0);
}

static void test_flash_busy_for_ever_ends_after_its_limit(void** state) {
  (void)state;
  stm32.stays_busy = true;
  assert_int_equal(stm32_flash_erase(0), IMUCAL_ERR_FLASH);
  assert_true(stm32.now_us > 900000 && stm32.now_us < 3000000);
  stm32.stays_busy = false;
  stm32.erase_us = UINT64_MAX / 4; /* it begins, but never ends */
  assert_int_equal(stm32_flash_erase(0), IMUCAL_ERR_FLASH);
  assert_locked();
}

static void test_flash_controllers_errors_are_reported_and_cleared_for_the_next(void** state) {
  (void)state;
  stm32.is_protected = true;
  assert_int_equal(stm32_flash_erase(0), IMUCAL_ERR_FLASH);
  assert_int_equal(stm32_flash_program(0, 0, words, 8), IMUCAL_ERR_FLASH);
  stm32.is_protected = false;
  stm32.is_sequence_wrong = true;
  assert_int_equal(stm32_flash_program(0, 0, words, 8), IMUCAL_ERR_FLASH);
  assert_locked();
  stm32.is_sequence_wrong = false;
  assert_int_equal(stm32_flash_program(0, 0, words, 8), IMUCAL_OK);
  stm32.fail_word = 2;
  assert_int_equal(stm32_flash_program(0, 16, words, 8), IMUCAL_ERR_FLASH);
  assert_int_equal(stm32.n_words, 3); /* it stopped there */
  assert_int_equal(stm32.n_violations, 0);
}

static void test_flash_that_does_not_unlock(void** state) {
  (void)state;
  stm32.is_key_wrong = true;
  assert_int_equal(stm32_flash_erase(0), IMUCAL_ERR_FLASH);
  assert_int_equal(stm32_flash_program(0, 0, words, 8), IMUCAL_ERR_FLASH);
  assert_int_equal(stm32.n_erases + stm32.n_words + stm32.n_violations, 0);
}

static void test_flash_is_not_written_with_a_low_supply(void** state) {
  (void)state;
  stm32.is_supply_low = true;
  const uint32_t refused = stm32_supply_refused();
  assert_int_equal(stm32_flash_erase(0), IMUCAL_ERR_SUPPLY);
  assert_int_equal(stm32_flash_program(0, 0, words, 8), IMUCAL_ERR_SUPPLY);
  assert_int_equal(stm32.n_erases + stm32.n_words, 0);
  assert_int_equal(stm32_supply_refused() - refused, 2);
}

static void test_brown_out_level_is_set_once(void** state) {
  (void)state;
  assert_int_equal(stm32_supply_init(), IMUCAL_OK);
  assert_int_equal(stm32.optcr & FLASH_OPTCR_BOR_LEV, 0);
  assert_int_equal(stm32.optcr & ~(FLASH_OPTCR_BOR_LEV | 1u), 0x0FFFAAEDu & ~(FLASH_OPTCR_BOR_LEV | 1u));
  assert_false(stm32.is_option_open);
  const uint64_t before_us = stm32.now_us;
  assert_int_equal(stm32_supply_init(), IMUCAL_OK);
  assert_true(stm32.now_us - before_us < 10); /* nothing was written again */
  (void)power_on(NULL);
  stm32.is_option_stuck = true;
  assert_int_equal(stm32_supply_init(), IMUCAL_ERR_FLASH);
  assert_int_equal(stm32.n_violations, 0);
}

/* ---- the core's store on this flash ---- */

static void test_store_on_this_flash_breaks_no_rule(void** state) {
  (void)state;
  const imucal_flash_t flash = board_store_init(NULL).flash;
  static imucal_store_work_t work;
  imucal_table_t table = {.serial = "chip", .sequence = 1, .n_channels = 1, .degc_per_count = 0.01f};
  imucal_table_channel_t* channel = &table.channel[0];
  assert_int_equal(imucal_text_set(channel->name, sizeof channel->name, "gx_dph"), IMUCAL_OK);
  channel->order = 1;
  channel->t0_degc = channel->range_degc = 30.0f;
  channel->span_hi_degc = 60.0f;
  for (int i = 0; i < IMUCAL_TABLE_SIGMA_N; i++) channel->sigma[i] = 1.0f;
  channel->unit_per_count = 1.0f;
  channel->full_scale_counts = 1000;
  channel->n_seconds = 10;
  for (uint32_t sequence = 1; sequence <= 3; sequence++) {
    imucal_store_report_t report;
    imucal_table_t read;
    assert_int_equal(imucal_store_write(&flash, table.serial, 1, IMUCAL_STORE_NO_ORIGIN, &work, &table, &report),
                     IMUCAL_OK);
    assert_int_equal(imucal_store_load(&flash, table.serial, 1, &work, &read, &report), IMUCAL_OK);
    assert_int_equal(read.sequence, sequence);
  }
  imucal_store_report_t report;
  imucal_table_t read;
  stm32.fail_word = 5; /* a write that the controller breaks off: the old table rules */
  assert_true(imucal_store_write(&flash, table.serial, 1, IMUCAL_STORE_NO_ORIGIN, &work, &table, &report) != IMUCAL_OK);
  assert_int_equal(imucal_store_load(&flash, table.serial, 1, &work, &read, &report), IMUCAL_OK);
  assert_int_equal(read.sequence, 3);
  assert_int_equal(stm32.n_violations, 0);
}

/* ---- SPI ---- */

static void test_spi_one_select_around_both_directions(void** state) {
  (void)state;
  const uint8_t out[2] = {0xF5, 0x11};
  uint8_t in[3] = {0};
  stm32_spi_init(84000000u, 10500000u);
  assert_int_equal(stm32.cr1 >> 3 & 7u, 2); /* 84 MHz / 8 */
  assert_int_equal(stm32_spi_transfer(STM32_SPI_PA4, out, 2, in, 3), IMUCAL_OK);
  assert_int_equal(stm32.n_selects, 1);
  assert_false(stm32.is_selected);
  assert_memory_equal(stm32.out, out, 2);
  const uint8_t expected[3] = {0xA2, 0xA3, 0xA4};
  assert_memory_equal(in, expected, 3);
  assert_int_equal(stm32.n_spi_violations, 0);
}

static void test_spi_rate_is_never_above_the_one_asked_for(void** state) {
  (void)state;
  stm32_spi_init(84000000u, 1000000u);
  assert_int_equal(stm32.cr1 >> 3 & 7u, 6); /* 656 kHz */
  stm32_spi_init(16000000u, 10500000u);
  assert_int_equal(stm32.cr1 >> 3 & 7u, 0);
}

static void test_spi_faults_end_in_time_release_the_select_and_heal(void** state) {
  (void)state;
  const uint8_t out = 0xF5;
  uint8_t in[4];
  for (int fault = 0; fault < 4; fault++) {
    emu_stm32_power_on();
    stm32_spi_init(84000000u, 10500000u);
    stm32.is_silent = fault == 0;
    stm32.is_spi_busy = fault == 1;
    stm32.overrun_at = fault == 2 ? 3 : 0;
    stm32.modf_at = fault == 3 ? 2 : 0;
    assert_int_equal(stm32_spi_transfer(STM32_SPI_PA4, &out, 1, in, 4), IMUCAL_ERR_SENSOR);
    assert_true(stm32.now_us < 2000);
    assert_false(stm32.is_selected);
    stm32.is_silent = stm32.is_spi_busy = false;
    stm32.overrun_at = stm32.modf_at = 0;
    assert_int_equal(stm32_spi_transfer(STM32_SPI_PA4, &out, 1, in, 4), IMUCAL_OK);
    assert_int_equal(in[0], 0xA1);
    assert_int_equal(stm32.n_spi_violations, 0);
  }
}

/* ---- long answers: DMA ---- */

static imucal_status read_long(uint8_t* in, size_t n) {
  const uint8_t reg = 0xB0;
  stm32_spi_init(84000000, 10500000);
  return stm32_spi_transfer(STM32_SPI_PA4, &reg, 1, in, n);
}

static void assert_streams_off(void) {
  assert_int_equal((stm32.dma_cr[0] | stm32.dma_cr[1]) & DMA_CR_EN, 0);
  assert_int_equal(stm32.spi_cr2, 0);
  assert_false(stm32.is_selected);
}

static void test_long_answers_come_by_dma_and_short_ones_do_not(void** state) {
  (void)state;
  for (size_t n = 1; n <= 60; n++) {
    uint8_t in[61];
    memset(in, 0xEE, sizeof in);
    const uint32_t before = stm32.n_dma_bytes;
    assert_int_equal(read_long(in, n), IMUCAL_OK);
    for (size_t i = 0; i < n; i++) assert_int_equal(in[i], 0xA0 + 1 + i);
    assert_int_equal(in[n], 0xEE);
    assert_int_equal(stm32.n_dma_bytes - before, n < 16 ? 0 : n);
    assert_int_equal(stm32.n_dma_violations + stm32.n_spi_violations, 0);
    assert_streams_off();
  }
}

static void test_dma_error_overrun_and_stall_end_the_transfer_and_the_next_works(void** state) {
  (void)state;
  uint8_t in[40];
  for (int fault = 0; fault < 4; fault++) {
    (void)power_on(NULL);
    stm32.dma_error_at = fault == 0 ? 5 : 0;
    stm32.overrun_at = fault == 1 ? 9 : 0;
    stm32.modf_at = fault == 2 ? 9 : 0;
    stm32.is_dma_stalled = fault == 3;
    const uint64_t before_us = stm32.now_us;
    assert_int_equal(read_long(in, 40), IMUCAL_ERR_SENSOR);
    assert_true(stm32.now_us - before_us < 5000);
    assert_streams_off();
    stm32.dma_error_at = stm32.overrun_at = stm32.modf_at = 0;
    stm32.is_dma_stalled = false;
    assert_int_equal(read_long(in, 40), IMUCAL_OK);
    assert_int_equal(in[39], 0xA0 + 40);
    assert_int_equal(stm32.n_dma_violations, 0);
  }
}

static void test_a_stream_that_does_not_stop_is_an_error(void** state) {
  (void)state;
  uint8_t in[40];
  stm32.stays_enabled = true;
  assert_int_equal(read_long(in, 40), IMUCAL_ERR_SENSOR);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_setup(test_flash_programs_words_of_its_slot_and_locks_again, power_on),
      cmocka_unit_test_setup(test_flash_refuses_what_is_outside, power_on),
      cmocka_unit_test_setup(test_flash_busy_for_ever_ends_after_its_limit, power_on),
      cmocka_unit_test_setup(test_flash_controllers_errors_are_reported_and_cleared_for_the_next, power_on),
      cmocka_unit_test_setup(test_flash_that_does_not_unlock, power_on),
      cmocka_unit_test_setup(test_flash_is_not_written_with_a_low_supply, power_on),
      cmocka_unit_test_setup(test_brown_out_level_is_set_once, power_on),
      cmocka_unit_test_setup(test_store_on_this_flash_breaks_no_rule, power_on),
      cmocka_unit_test_setup(test_spi_one_select_around_both_directions, power_on),
      cmocka_unit_test_setup(test_spi_rate_is_never_above_the_one_asked_for, power_on),
      cmocka_unit_test_setup(test_spi_faults_end_in_time_release_the_select_and_heal, power_on),
      cmocka_unit_test_setup(test_long_answers_come_by_dma_and_short_ones_do_not, power_on),
      cmocka_unit_test_setup(test_dma_error_overrun_and_stall_end_the_transfer_and_the_next_works, power_on),
      cmocka_unit_test_setup(test_a_stream_that_does_not_stop_is_an_error, power_on),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
