// SPDX-License-Identifier: MIT
/* RM0090 chapter 27.3.3, master mode by polling.  When the last bytes of a read must be refused is the chip's own order of
 * events: one byte: before ADDR is cleared; two: with POS; more: when the third last waits in DR. */
#include "stm32f405.h"

#define STEP_LIMIT_US 1000u /* a byte takes 22.5 us; the rest is for a sensor that holds the clock */
#define FAST_HZ 400000u
#define SCL (1u << 6)
#define SDA (1u << 7)

static uint32_t apb1; /* for setting up anew */

/* PB6, PB7: open drain with pull-ups, as outputs (1) or as the peripheral's (2). */
static void set_pins(uint32_t mode) {
  reg_write(GPIO(1) + GPIO_MODER, (reg_read(GPIO(1) + GPIO_MODER) & ~(0xFu << 12)) | (mode << 12 | mode << 14));
}

static void wait_us(uint32_t us) {
  const uint64_t end_us = stm32_time_us() + us;
  while (stm32_time_us() <= end_us) {
  }
}

/* A sensor that was cut off in the middle of a byte holds SDA until it has been clocked out. */
static void free_bus(void) {
  reg_write(GPIO(1) + GPIO_BSRR, SCL | SDA);
  set_pins(1);
  for (uint32_t i = 0; i < 9 && !(reg_read(GPIO(1) + GPIO_IDR) & SDA); i++) {
    reg_write(GPIO(1) + GPIO_BSRR, SCL << 16);
    wait_us(5);
    reg_write(GPIO(1) + GPIO_BSRR, SCL);
    wait_us(5);
  }
  reg_write(GPIO(1) + GPIO_BSRR, SDA << 16); /* a stop: SDA rises while SCL is high */
  wait_us(5);
  reg_write(GPIO(1) + GPIO_BSRR, SDA);
  wait_us(5);
  set_pins(2);
}

static void set_up(void) {
  free_bus();
  reg_write(I2C_CR1, I2C_CR1_SWRST);
  reg_write(I2C_CR1, 0);
  reg_write(I2C_CR2, apb1 / 1000000u);
  reg_write(I2C_CCR, I2C_CCR_FAST | (apb1 + 3u * FAST_HZ - 1u) / (3u * FAST_HZ)); /* low twice as long as high */
  reg_write(I2C_TRISE, apb1 / 1000000u * 3u / 10u + 1u);                          /* 300 ns */
  reg_write(I2C_CR1, I2C_CR1_PE);
}

void stm32_i2c_init(uint32_t apb1_hz) {
  apb1 = apb1_hz;
  reg_set(RCC_AHB1ENR, 1u << 1);  /* port B */
  reg_set(RCC_APB1ENR, 1u << 21); /* I2C1 */
  reg_set(GPIO(1) + GPIO_OTYPER, SCL | SDA);
  reg_write(GPIO(1) + GPIO_PUPDR, (reg_read(GPIO(1) + GPIO_PUPDR) & ~(0xFu << 12)) | 5u << 12);
  reg_write(GPIO(1) + GPIO_AFR(0), (reg_read(GPIO(1) + GPIO_AFR(0)) & 0x00FFFFFFu) | 0x44000000u);
  set_up();
}

/* Waits for the flag; false: an error flag, or too long. */
static bool wait_for(uint32_t flag) {
  const uint64_t end_us = stm32_time_us() + STEP_LIMIT_US;
  for (;;) {
    const uint32_t sr1 = reg_read(I2C_SR1);
    if (sr1 & I2C_SR1_ERRORS) return false;
    if (sr1 & flag) return true;
    if (stm32_time_us() > end_us) return false;
  }
}

static bool wait_not_busy(void) {
  const uint64_t end_us = stm32_time_us() + STEP_LIMIT_US;
  while (reg_read(I2C_SR2) & I2C_SR2_BUSY)
    if (stm32_time_us() > end_us) return false;
  return true;
}

/* Start, or repeated start, and the address; ADDR is left set. */
static bool call(uint8_t address_and_direction) {
  reg_write(I2C_CR1, I2C_CR1_PE | I2C_CR1_ACK | I2C_CR1_START);
  if (!wait_for(I2C_SR1_SB)) return false;
  reg_write(I2C_DR, address_and_direction);
  return wait_for(I2C_SR1_ADDR);
}

/* SR1 was read by wait_for; reading SR2 clears ADDR, and the bytes begin to run. */
static void run_on(void) {
  (void)reg_read(I2C_SR2);
}

static uint8_t take(void) {
  return (uint8_t)reg_read(I2C_DR);
}

static bool send(const uint8_t* out, size_t n) {
  for (size_t i = 0; i < n; i++) {
    if (!wait_for(I2C_SR1_TXE)) return false;
    reg_write(I2C_DR, out[i]);
  }
  return wait_for(I2C_SR1_BTF);
}

static bool receive_one(uint8_t* in) {
  reg_clear(I2C_CR1, I2C_CR1_ACK);
  run_on();
  reg_set(I2C_CR1, I2C_CR1_STOP);
  if (!wait_for(I2C_SR1_RXNE)) return false;
  in[0] = take();
  return true;
}

/* The last two wait in DR and in the shift register; the stop goes out before they are read. */
static bool receive_last_two(uint8_t* in) {
  if (!wait_for(I2C_SR1_BTF)) return false;
  reg_set(I2C_CR1, I2C_CR1_STOP);
  in[0] = take();
  in[1] = take();
  return true;
}

static bool receive_two(uint8_t* in) {
  reg_write(I2C_CR1, I2C_CR1_PE | I2C_CR1_POS);
  run_on();
  return receive_last_two(in);
}

static bool receive_many(uint8_t* in, size_t n) {
  run_on();
  for (size_t i = 0; i + 3 < n; i++) {
    if (!wait_for(I2C_SR1_RXNE)) return false;
    in[i] = take();
  }
  if (!wait_for(I2C_SR1_BTF)) return false;
  reg_clear(I2C_CR1, I2C_CR1_ACK); /* the third last is in DR, the second last behind it: the last will be refused */
  in[n - 3] = take();
  return receive_last_two(in + n - 2);
}

static bool receive(uint8_t* in, size_t n) {
  return n == 1 ? receive_one(in) : n == 2 ? receive_two(in) : receive_many(in, n);
}

/* Error flags are cleared by writing 0; arbitration lost: the bus is another's, no stop. */
static void give_up(void) {
  const uint32_t sr1 = reg_read(I2C_SR1);
  reg_write(I2C_SR1, ~I2C_SR1_ERRORS & 0xFFFFu);
  if (!(sr1 & I2C_SR1_ARLO)) reg_set(I2C_CR1, I2C_CR1_STOP);
  if (!wait_not_busy()) set_up();
}

imucal_status stm32_i2c_transfer(uint8_t address, const uint8_t* out, size_t n_out, uint8_t* in, size_t n_in) {
  if (n_out + n_in == 0) return IMUCAL_ERR_ARGUMENT;
  bool is_good = wait_not_busy();
  if (is_good && n_out > 0) {
    is_good = call((uint8_t)(address << 1));
    if (is_good) run_on();
    is_good = is_good && send(out, n_out);
    if (is_good && n_in == 0) reg_set(I2C_CR1, I2C_CR1_STOP);
  }
  if (is_good && n_in > 0) is_good = call((uint8_t)(address << 1 | 1u)) && receive(in, n_in);
  if (is_good && wait_not_busy()) return IMUCAL_OK;
  give_up();
  return IMUCAL_ERR_SENSOR;
}
