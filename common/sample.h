// SPDX-License-Identifier: MIT
/* Purpose: one raw sample of the whole IMU, and its record in the sample feed of the simulated ports.
 *
 * A port with a real sensor fills imucal_sample_t itself.  The emulated ports read records of 40 bytes, one
 * after another, from a file, named pipe, TCP connection or semihosting file; host `gyrosim serve` and
 * `gyrosim replay` write them.  The feed ends with the stream.  Layout (little-endian):
 *   0 u8 marker 0xA5 | 1 u8 n_channels | 2 u8 saturated | 3 u8 fault | 4 i32 temp_counts | 8 u64 t_us |
 *   16 i32 counts[6] (0 above n_channels) */
#ifndef IMUCAL_SAMPLE_H
#define IMUCAL_SAMPLE_H

#include "status.h"

#if defined(__cplusplus)
extern "C" {
#endif

typedef struct imucal_sample {
  uint64_t t_us;       /* time stamp, microseconds since any fixed start; the same clock for all samples */
  int32_t temp_counts; /* thermometer, at most a second old; degC = temp_counts * scale + offset, see imucal_table_t */
  int32_t counts[IMUCAL_MAX_CHANNELS]; /* sensor words, offset removed, sign extended */
  uint8_t n_channels;                  /* 1..IMUCAL_MAX_CHANNELS */
  uint8_t saturated;                   /* bit i: channel i is at its rail */
  uint8_t fault;                       /* bit i: channel i's self test or data-ready reports a fault */
} imucal_sample_t;

#define IMUCAL_SAMPLE_RECORD_BYTES 40
#define IMUCAL_SAMPLE_MARKER 0xA5

/* Write the record.  Pre: n_channels <= IMUCAL_MAX_CHANNELS. */
void imucal_sample_encode(const imucal_sample_t* sample, uint8_t record[IMUCAL_SAMPLE_RECORD_BYTES]);

/* Read a record.  IMUCAL_ERR_SYNC: no marker here (the reader lost its place: move on by one byte);
 * IMUCAL_ERR_CHANNELS: 0 or too many.  On error *sample is unchanged. */
IMUCAL_MUST_USE imucal_status imucal_sample_decode(const uint8_t record[IMUCAL_SAMPLE_RECORD_BYTES],
                                                   imucal_sample_t* sample);

#if defined(__cplusplus)
}
#endif
#endif
