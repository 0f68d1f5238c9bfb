// SPDX-License-Identifier: MIT
/* Purpose: what the core is checked with on every machine: the same log through sum, kf, table and comp with
 * all results as bits, and the cost of each function in processor instructions. The same files run on this
 * machine and as images for the microcontrollers. */
#ifndef IMUCAL_CHECK_H
#define IMUCAL_CHECK_H
#include "sample.h"

typedef struct check_io {
  void* ctx;
  /* The next sample of the log; false at its end. `is_rewound`: from the beginning. */
  bool (*sample)(void* ctx, bool is_rewound, imucal_sample_t* sample);
  void (*print)(void* ctx, const char* text);
  uint32_t (*ticks)(void); /* counts up, 32 bits; null: no cost can be measured */
  uint32_t instructions_per_1000_ticks;
  void (*stack_paint)(void); /* null: the stack cannot be measured */
  uint32_t (*stack_used_bytes)(void);
} check_io_t;

/* Two passes over a log of three channels at 20 Hz: learn with order 3 and order 5, make tables, compensate.
 * Prints lines of "name numbers… hexadecimal bits". */
void check_bits(const check_io_t* io);

/* Prints lines of "profile soak_min n_cycles" and, as bits, the predicted one-sigma calibration error at 0, 5
 * .. 60 degC and the worst. */
void check_profiles(const check_io_t* io);

/* Prints lines of "name value": instructions per call, averaged over many calls, of everything that runs with
 * a sample or a second, call included. */
void check_cycles(const check_io_t* io);

/* Prints lines of "name bytes": stack used below the caller. */
void check_stack(const check_io_t* io);

/* ---- printing without a library ---- */
void check_text(const check_io_t* io, const char* text);
void check_number(const check_io_t* io, uint32_t value);
void check_hex(const check_io_t* io, uint32_t value);
#endif
