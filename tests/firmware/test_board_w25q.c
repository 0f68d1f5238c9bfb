// SPDX-License-Identifier: MIT
/* The STM32F405 board with the tables in a W25Q on the sensor's bus (board_store_w25q.c, SPI driver, flash driver, app) over the
 * register model of SPI1 and the model of the flash chip: wiring, names of its troubles, tables that outlive a power cut. */
#include "board_bench.h"
#include "emu/w25q.h"
/* The board's own sources, with their registers in the model. */
#include "port/stm32f405/board_chip.c"
#include "port/stm32f405/board_icm42688p.c"
#include "port/stm32f405/board_store_w25q.c"
#include "port/stm32f405/flash.c"
#include "port/stm32f405/spi.c"

static emu_w25q_t chip;
static uint8_t out[512];
static uint32_t n_out;

/* ---- the flash behind SPI1 and PB0, byte by byte ---- */

static bool is_reading(uint8_t instruction) {
  return instruction == 0x03 || instruction == 0x05 || instruction == 0x15 || instruction == 0x35 ||
         instruction == 0x9F;
}

static uint8_t flash_byte(uint8_t byte, uint32_t n) {
  static uint8_t in[1024];
  chip.now_us = stm32.now_us;
  if (n == 0) n_out = 0;
  if (n_out < sizeof out) out[n_out++] = byte;
  const uint32_t head = out[0] == 0x03 ? 4 : 1;
  if (chip.is_off || chip.bus_fault != EMU_W25Q_GOOD || !is_reading(out[0]) || n < head)
    return chip.bus_fault == EMU_W25Q_ZEROS ? 0x00 : 0xFF;
  emu_w25q_answer(&chip, out, head, in, n - head + 1);
  return in[n - head];
}

/* Instructions that do something do it when the chip is released. */
static void flash_released(void) {
  chip.now_us = stm32.now_us;
  if (chip.bus_fault == EMU_W25Q_GOOD && !chip.is_off && n_out > 0 && !is_reading(out[0]))
    emu_w25q_answer(&chip, out, n_out, NULL, 0);
  n_out = 0;
}

/* ---- the device ---- */

static void power_on(void) {
  emu_stm32_power_on();
  stm32.now_us = 1000000;
  stm32.slave_pb0 = flash_byte;
  stm32.release_pb0 = flash_released;
  chip.busy_until_us = 0;
  emu_w25q_power_on(&chip);
}

static int board_on(void** state) {
  (void)state;
  emu_w25q_init(&chip, STM32_W25Q_BASE);
  bench_start(&bench);
  power_on();
  board_start();
  return 0;
}

static int upload(float b0) {
  uint8_t table[IMUCAL_TABLE_MAX_BYTES];
  return bench_upload(&bench, table, bench_table(&bench, b0, table));
}

/* ---- tests ---- */

static void test_tables_are_kept_in_the_external_flash_and_outlive_a_power_cut(void** state) {
  (void)state;
  assert_string_equal(bench.port.device, "stm32f405");
  for (int i = 1; i <= 4; i++) {
    assert_int_equal(upload((float)i), IMUCAL_OK);
    power_on();
    board_start();
    assert_true(bench_ruling_b0(&bench) == (float)i);
  }
  assert_int_equal(stm32.n_erases + stm32.n_words, 0); /* the chip's own flash */
  assert_true(chip.n_erases >= 4);
  assert_int_equal(chip.n_violations + chip.n_pages_wrapped + stm32.n_spi_violations + stm32.n_dma_violations, 0);
}

static void test_a_cut_while_a_table_is_written_leaves_the_old_one(void** state) {
  (void)state;
  assert_int_equal(upload(1.0f), IMUCAL_OK);
  assert_int_equal(upload(2.0f), IMUCAL_OK);
  chip.steps_left = 600; /* in the table's pages, behind mark and erase */
  assert_int_equal(upload(3.0f), IMUCAL_ERR_FLASH);
  assert_true(chip.is_off);
  power_on();
  board_start();
  assert_true(bench_ruling_b0(&bench) == 2.0f);
  assert_int_equal(upload(4.0f), IMUCAL_OK);
  assert_true(bench_ruling_b0(&bench) == 4.0f);
}

static void test_what_is_wrong_with_the_flash_stands_in_the_devices_name(void** state) {
  (void)state;
  static const struct {
    const char* name;
    int bus_fault;
    uint8_t maker, sr1;
    bool stays_busy;
  } cases[] = {{"stm32f405 no w25q", EMU_W25Q_ONES, 0xEF, 0, false},
               {"stm32f405 no w25q", EMU_W25Q_ZEROS, 0xEF, 0, false},
               {"stm32f405 other flash", EMU_W25Q_GOOD, 0xC2, 0, false},
               {"stm32f405 w25q busy", EMU_W25Q_GOOD, 0xEF, 0, true},
               {"stm32f405 w25q locked", EMU_W25Q_GOOD, 0xEF, 0x1C, false}};
  for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
    emu_w25q_init(&chip, STM32_W25Q_BASE);
    power_on();
    chip.bus_fault = cases[i].bus_fault;
    chip.id[0] = cases[i].maker;
    chip.sr1 = cases[i].sr1;
    chip.stays_busy = cases[i].stays_busy;
    board_start();
    assert_string_equal(bench.port.device, cases[i].name);
    assert_int_equal(upload(1.0f), IMUCAL_ERR_FLASH);
    assert_true(stm32.now_us < 3500000); /* within the watchdog's time, also where it is looked at again and again */
    chip.bus_fault = EMU_W25Q_GOOD;
    chip.id[0] = 0xEF;
    chip.sr1 = 0;
    chip.stays_busy = false;
    assert_int_equal(upload(2.0f), IMUCAL_OK); /* found again without a restart */
    assert_true(bench_ruling_b0(&bench) == 2.0f);
  }
}

static void test_low_supply_refuses_and_counts(void** state) {
  (void)state;
  assert_int_equal(upload(1.0f), IMUCAL_OK);
  const uint32_t n_erases = chip.n_erases, n_programs = chip.n_programs;
  stm32.is_supply_low = true;
  assert_int_equal(upload(2.0f), IMUCAL_ERR_SUPPLY);
  assert_int_equal(board_sensor_now().is_supply_low, 1);
  assert_true(board_sensor_now().supply_refused >= 1);
  assert_int_equal(chip.n_erases, n_erases);
  assert_int_equal(chip.n_programs, n_programs);
  assert_true(bench_ruling_b0(&bench) == 1.0f);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_setup(test_tables_are_kept_in_the_external_flash_and_outlive_a_power_cut, board_on),
      cmocka_unit_test_setup(test_a_cut_while_a_table_is_written_leaves_the_old_one, board_on),
      cmocka_unit_test_setup(test_what_is_wrong_with_the_flash_stands_in_the_devices_name, board_on),
      cmocka_unit_test_setup(test_low_supply_refuses_and_counts, board_on),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
