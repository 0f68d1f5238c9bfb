// SPDX-License-Identifier: MIT
/* Purpose: the registers of the STM32F405 that the port touches, and the one way to touch them: on the chip a volatile
 * access, in the unit tests a model of the peripheral (tests/emu/stm32f405.h defines STM32_REGISTER_MODEL).
 * Source: RM0090 rev. 19 "STM32F405/415, 407/417, 427/437, 429/439 reference manual"; chapter beside each block.
 * Base addresses: its table 1. */
#ifndef IMUCAL_PORT_STM32F405_REGISTERS_H
#define IMUCAL_PORT_STM32F405_REGISTERS_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#if defined(STM32_REGISTER_MODEL)
uint32_t stm32_model_read(uint32_t address);
void stm32_model_write(uint32_t address, uint32_t value);
#define reg_read stm32_model_read
#define reg_write stm32_model_write
const void* stm32_model_memory(uint32_t address);
#define reg_memory stm32_model_memory
uint32_t stm32_model_address(const void* memory);
#define reg_address stm32_model_address
#else
static inline uint32_t reg_read(uint32_t address) {
  return *(volatile uint32_t*)(uintptr_t)address;
}
static inline void reg_write(uint32_t address, uint32_t value) {
  *(volatile uint32_t*)(uintptr_t)address = value;
}
static inline const void* reg_memory(uint32_t address) {
  return (const void*)(uintptr_t)address;
}
static inline uint32_t reg_address(const void* memory) {
  return (uint32_t)(uintptr_t)memory;
}
#endif

static inline void reg_set(uint32_t address, uint32_t bits) {
  reg_write(address, reg_read(address) | bits);
}
static inline void reg_clear(uint32_t address, uint32_t bits) {
  reg_write(address, reg_read(address) & ~bits);
}

/* RCC, chapter 7.3 */
#define RCC_CR 0x40023800u
#define RCC_PLLCFGR 0x40023804u
#define RCC_CFGR 0x40023808u
#define RCC_AHB1ENR 0x40023830u
#define RCC_AHB2ENR 0x40023834u
#define RCC_APB1ENR 0x40023840u
#define RCC_APB2ENR 0x40023844u
#define RCC_CSR 0x40023874u
#define RCC_CR_HSEON (1u << 16)
#define RCC_CR_HSERDY (1u << 17)
#define RCC_CR_PLLON (1u << 24)
#define RCC_CR_PLLRDY (1u << 25)
#define RCC_CSR_RMVF (1u << 24)
#define RCC_CSR_WATCHDOGS (3u << 29) /* WWDGRSTF, IWDGRSTF */

/* FLASH, chapter 3.9 */
#define FLASH_ACR 0x40023C00u
#define FLASH_KEYR 0x40023C04u
#define FLASH_OPTKEYR 0x40023C08u
#define FLASH_SR 0x40023C0Cu
#define FLASH_CR 0x40023C10u
#define FLASH_OPTCR 0x40023C14u
#define FLASH_SR_EOP (1u << 0)
#define FLASH_SR_OPERR (1u << 1)
#define FLASH_SR_WRPERR (1u << 4)
#define FLASH_SR_PGAERR (1u << 5)
#define FLASH_SR_PGPERR (1u << 6)
#define FLASH_SR_PGSERR (1u << 7)
#define FLASH_SR_BSY (1u << 16)
#define FLASH_SR_ERRORS (FLASH_SR_OPERR | FLASH_SR_WRPERR | FLASH_SR_PGAERR | FLASH_SR_PGPERR | FLASH_SR_PGSERR)
#define FLASH_CR_PG (1u << 0)
#define FLASH_CR_SER (1u << 1)
#define FLASH_CR_SNB(sector) ((uint32_t)(sector) << 3)
#define FLASH_CR_PSIZE_32 (2u << 8)
#define FLASH_CR_STRT (1u << 16)
#define FLASH_CR_LOCK (1u << 31)
#define FLASH_OPTCR_OPTLOCK (1u << 0)
#define FLASH_OPTCR_OPTSTRT (1u << 1)
#define FLASH_OPTCR_BOR_LEV (3u << 2) /* 0: level 3, 2.70 V and more; 3: off */

/* PWR, chapter 5.4 */
#define PWR_CR 0x40007000u
#define PWR_CSR 0x40007004u
#define PWR_CR_PVDE (1u << 4)
#define PWR_CR_PLS_2V9 (7u << 5)
#define PWR_CSR_PVDO (1u << 2) /* supply below the threshold */

/* GPIO, chapter 8.4: n = 0 for A */
#define GPIO(n) (0x40020000u + 0x400u * (n))
#define GPIO_MODER 0x00u
#define GPIO_OSPEEDR 0x08u
#define GPIO_PUPDR 0x0Cu
#define GPIO_OTYPER 0x04u
#define GPIO_IDR 0x10u
#define GPIO_BSRR 0x18u
#define GPIO_AFR(high) (0x20u + 4u * (high))

/* SPI1, chapter 28.5 */
#define SPI1 0x40013000u
#define SPI_CR1 0x00u
#define SPI_CR2 0x04u
#define SPI_SR 0x08u
#define SPI_DR 0x0Cu
#define SPI_CR1_MASTER_MODE3 (0x0007u | 0x0300u) /* CPHA, CPOL, MSTR; SSM, SSI: the chip select is ours */
#define SPI_CR1_SPE (1u << 6)
#define SPI_CR2_RXDMAEN (1u << 0)
#define SPI_CR2_TXDMAEN (1u << 1)
#define SPI_SR_RXNE (1u << 0)
#define SPI_SR_TXE (1u << 1)
#define SPI_SR_MODF (1u << 5)
#define SPI_SR_OVR (1u << 6)
#define SPI_SR_BSY (1u << 7)

/* DMA2, chapter 10.5; SPI1 is channel 3 of stream 0 (receive) and stream 3 (transmit), table 43 */
#define DMA2_LISR 0x40026400u
#define DMA2_LIFCR 0x40026408u
#define DMA2_STREAM(s) (0x40026410u + 0x18u * (s))
#define DMA_CR 0x00u
#define DMA_NDTR 0x04u
#define DMA_PAR 0x08u
#define DMA_M0AR 0x0Cu
#define DMA_FCR 0x14u
#define DMA_CR_EN (1u << 0)
#define DMA_CR_TO_PERIPHERAL (1u << 6)
#define DMA_CR_MINC (1u << 10)
#define DMA_CR_CHANNEL(c) ((uint32_t)(c) << 25)
#define DMA2_LISR_TCIF0 (1u << 5)
#define DMA2_LISR_ERRORS (0xDu | 0xDu << 22) /* FEIF, DMEIF, TEIF of streams 0 and 3 */
#define DMA2_LISR_ALL (0x3Du | 0x3Du << 22)

/* I2C1, chapter 27.6 */
#define I2C1 0x40005400u
#define I2C_CR1 (I2C1 + 0x00u)
#define I2C_CR2 (I2C1 + 0x04u)
#define I2C_DR (I2C1 + 0x10u)
#define I2C_SR1 (I2C1 + 0x14u)
#define I2C_SR2 (I2C1 + 0x18u)
#define I2C_CCR (I2C1 + 0x1Cu)
#define I2C_TRISE (I2C1 + 0x20u)
#define I2C_CR1_PE (1u << 0)
#define I2C_CR1_START (1u << 8)
#define I2C_CR1_STOP (1u << 9)
#define I2C_CR1_ACK (1u << 10)
#define I2C_CR1_POS (1u << 11)
#define I2C_CR1_SWRST (1u << 15)
#define I2C_SR1_SB (1u << 0)
#define I2C_SR1_ADDR (1u << 1)
#define I2C_SR1_BTF (1u << 2)
#define I2C_SR1_RXNE (1u << 6)
#define I2C_SR1_TXE (1u << 7)
#define I2C_SR1_BERR (1u << 8)
#define I2C_SR1_ARLO (1u << 9)
#define I2C_SR1_AF (1u << 10)
#define I2C_SR1_OVR (1u << 11)
#define I2C_SR1_TIMEOUT (1u << 14)
#define I2C_SR1_ERRORS (I2C_SR1_BERR | I2C_SR1_ARLO | I2C_SR1_AF | I2C_SR1_OVR | I2C_SR1_TIMEOUT)
#define I2C_SR2_BUSY (1u << 1)
#define I2C_CCR_FAST (1u << 15)

/* USART1, chapter 30.6 */
#define USART1 0x40011000u
#define USART_SR (USART1 + 0x00u)
#define USART_DR (USART1 + 0x04u)
#define USART_BRR (USART1 + 0x08u)
#define USART_CR1 (USART1 + 0x0Cu)
#define USART_SR_ORE (1u << 3)
#define USART_SR_RXNE (1u << 5)
#define USART_SR_TC (1u << 6)
#define USART_SR_TXE (1u << 7)
#define USART_CR1_RE (1u << 2)
#define USART_CR1_TE (1u << 3)
#define USART_CR1_RXNEIE (1u << 5)
#define USART_CR1_TXEIE (1u << 7)
#define USART_CR1_UE (1u << 13)
#define USART1_IRQ 37u

/* TIM2, chapter 18.4: 32 bits */
#define TIM2_CR1 0x40000000u
#define TIM2_EGR 0x40000014u
#define TIM2_CNT 0x40000024u
#define TIM2_PSC 0x40000028u
#define TIM2_ARR 0x4000002Cu

/* IWDG, chapter 21.4 */
#define IWDG_KR 0x40003000u
#define IWDG_PR 0x40003004u
#define IWDG_RLR 0x40003008u

/* RNG, chapter 24.4 */
#define RNG_CR 0x50060800u
#define RNG_SR 0x50060804u
#define RNG_DR 0x50060808u

/* Unique device identifier, chapter 39.1: 96 bits */
#define DEVICE_UID 0x1FFF7A10u
#endif
