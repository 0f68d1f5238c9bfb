// SPDX-License-Identifier: MIT
/* Purpose: drivers of the STM32F405 that the port needs: clocks, time, USART1 with interrupt rings, SPI1, I2C1, the two
 * table slots in the chip's flash, watchdog, brown-out, cause of the last reset, fault record.
 * Source: RM0090 rev. 19; the registers and chapters stand in registers.h.
 * Thread/ISR: USART1's handler moves bytes between its rings and the line; all else runs in the main loop. */
#ifndef IMUCAL_PORT_STM32F405_H
#define IMUCAL_PORT_STM32F405_H
#include "registers.h"
#include "status.h"

/* Crystal of the board, Hz: a whole number of MHz from 4 to 26. */
#ifndef STM32_HSE_HZ
#define STM32_HSE_HZ 8000000u
#endif
#if STM32_HSE_HZ % 1000000u != 0 || STM32_HSE_HZ < 4000000u || STM32_HSE_HZ > 26000000u
#error "STM32_HSE_HZ: whole MHz, 4 to 26"
#endif
/* The timer's clock where it is not the chip's (QEMU counts at 1 GHz); 0: computed. */
#ifndef STM32_TIM_HZ
#define STM32_TIM_HZ 0u
#endif

/* ---- clocks ---- */

typedef struct stm32_clocks {
  uint32_t core_hz, apb1_hz, apb2_hz, tim_hz;
  bool is_crystal; /* false: no crystal answered; runs from the internal 16 MHz (1 %: time and baud rate are off) */
} stm32_clocks_t;

/* 168 MHz from the crystal by the PLL, else 16 MHz; then TIM2 counts microseconds. */
stm32_clocks_t stm32_clocks_init(void);

/* Microseconds since stm32_clocks_init; must be called at least once in 71 minutes. */
uint64_t stm32_time_us(void);
void stm32_delay_us(uint32_t us);

/* ---- line: USART1, PA9 transmits, PA10 receives, 8N1 ---- */

#define STM32_RX_RING 1024u
#define STM32_TX_RING 1024u
void stm32_usart_init(uint32_t apb2_hz, uint32_t baud);
size_t stm32_usart_read(uint8_t* data, size_t capacity);
size_t stm32_usart_write(const uint8_t* data, size_t length);
bool stm32_usart_is_sent(void); /* all bytes have left the shift register */
/* Received bytes lost: ring full or overrun.  For a debugger: the host sees the frames that they broke (COUNTERS: rx_crc,
 * rx_resync), which is what it has to repeat. */
uint32_t stm32_usart_lost(void);
void usart1_handler(void);

/* ---- SPI1: PA5 clock, PA6 in, PA7 out; chip selects PA4 (sensor) and PB0 (external flash); mode 3 ---- */

typedef enum stm32_spi_chip { STM32_SPI_PA4, STM32_SPI_PB0 } stm32_spi_chip_t;

/* Nearest rate at or below `hz`; apb2_hz / 2 ... / 256. */
void stm32_spi_init(uint32_t apb2_hz, uint32_t hz);
/* PB0 as a chip select, high; before anything is sent to the chip at PA4. */
void stm32_spi_init_pb0(void);

/* n_out bytes out, then n_in bytes in, under one select of `chip`.  IMUCAL_ERR_SENSOR: the peripheral did not finish within
 * its time (then it is switched off and on again), an overrun, or another master. */
IMUCAL_MUST_USE imucal_status stm32_spi_transfer(stm32_spi_chip_t chip, const uint8_t* out, size_t n_out, uint8_t* in,
                                                 size_t n_in);

/* ---- I2C1: PB6 clock, PB7 data; 400 kHz ---- */

/* Frees a bus on which a sensor holds the data line (nine clocks, then a stop), then sets the peripheral up. */
void stm32_i2c_init(uint32_t apb1_hz);

/* n_out bytes to the address, then n_in bytes from it after a repeated start, at least one of both.  IMUCAL_ERR_SENSOR: no
 * acknowledge, arbitration lost, a bus error, or the bus did not move on within 1 ms: it is stopped and, where it stays busy,
 * set up anew. */
IMUCAL_MUST_USE imucal_status stm32_i2c_transfer(uint8_t address, const uint8_t* out, size_t n_out, uint8_t* in,
                                                 size_t n_in);

/* ---- flash ---- */

/* Sectors 1 and 2, 16 KB each (table 5 of RM0090): the small sectors are erased in 0.25 s (at most 0.5 s), a 128-KB one
 * in 1 s (2 s), and while the flash is busy the core stands still at its next instruction from it.  Sector 0 holds the
 * vector table alone; the program begins in sector 3 (link.ld). */
#define STM32_SLOT_BYTES 0x4000u
#define STM32_SLOT_ADDRESS(slot) (0x08004000u + (slot)*STM32_SLOT_BYTES)
#define STM32_SLOT_SECTOR(slot) (1u + (slot))

/* Whole slot.  IMUCAL_ERR_SUPPLY: the supply is below 2.9 V, nothing was touched; IMUCAL_ERR_FLASH: the controller is busy
 * or locked for good, or reports an error.  The controller is locked again in every case. */
IMUCAL_MUST_USE imucal_status stm32_flash_erase(uint32_t slot);
/* Words of 32 bits: offset and length multiples of 4, inside the slot, else IMUCAL_ERR_ARGUMENT. */
IMUCAL_MUST_USE imucal_status stm32_flash_program(uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len);

/* Supply watched at 2.9 V from now on; and the option bytes' brown-out reset at level 3 (2.7 V), which is programmed
 * once in a chip's life.  IMUCAL_ERR_FLASH: they could not be written. */
IMUCAL_MUST_USE imucal_status stm32_supply_init(void);
bool stm32_supply_is_good(void);
uint32_t stm32_supply_refused(void); /* erases and programs refused because of it */

/* ---- watchdog, resets, faults ---- */

/* Independent watchdog, 2 s nominal (1.4 to 3.8 s over the tolerance of its 32-kHz oscillator): longer than the erase of
 * a slot.  It cannot be stopped. */
void stm32_watchdog_start(void);
void stm32_watchdog_feed(void);

typedef struct stm32_fault {
  uint32_t exception; /* 2 NMI, 3 HardFault, 4 MemManage, 5 BusFault, 6 UsageFault */
  uint32_t pc, lr, cfsr, address;
} stm32_fault_t;

/* What outlives a reset, in RAM that the start-up code leaves alone; checked by its own words. */
typedef struct stm32_record {
  uint32_t magic, check;
  uint32_t n_starts, n_watchdog_resets, n_faults;
  stm32_fault_t fault; /* of the last fault */
} stm32_record_t;

/* Once per start, before anything else: counts this start. */
void stm32_record_init(void);
const stm32_record_t* stm32_record(void);
bool stm32_was_watchdog(void);
bool stm32_was_fault(void); /* the last life ended in a processor fault */
__attribute__((noreturn)) void stm32_record_fault(const stm32_fault_t* fault);

/* True random number; falls back on start counter and time where the generator does not answer. */
uint32_t stm32_random(void);
#endif
