// SPDX-License-Identifier: MIT
/* Purpose: raw samples out of a byte stream of records (common/sample.h), for the emulated sensors.
 * A record that is not in step costs the bytes up to the next marker; they are counted.
 * Memory: the caller's buffer.  Never blocks by itself. */
#ifndef IMUCAL_PORT_SIM_SAMPLE_STREAM_H
#define IMUCAL_PORT_SIM_SAMPLE_STREAM_H
#include "sample.h"

enum { STREAM_NOTHING_YET = 0, STREAM_ENDED = -1, STREAM_FAILED = -2, STREAM_BAD_RECORD = -3 };

typedef struct {
  void* ctx;
  /* Up to `capacity` bytes: their number, or STREAM_*. */
  int32_t (*refill)(void* ctx, uint8_t* data, size_t capacity);
  uint8_t* buffer;
  size_t capacity; /* at least IMUCAL_SAMPLE_RECORD_BYTES */
  size_t at, end;
  uint32_t n_skipped_bytes;
} sample_stream_t;

void sample_stream_clear(sample_stream_t* stream);

/* 1: *sample is the next one; else STREAM_*.  STREAM_BAD_RECORD: out of step, moved on to the next marker
 * (call again).  A part of a record at the end is dropped and counted. */
int32_t sample_stream_next(sample_stream_t* stream, imucal_sample_t* sample);
#endif
