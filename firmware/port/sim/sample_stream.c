// SPDX-License-Identifier: MIT
#include "sample_stream.h"

#include <string.h>

void sample_stream_clear(sample_stream_t* stream) {
  stream->at = stream->end = 0;
  stream->n_skipped_bytes = 0;
}

static int32_t refill(sample_stream_t* stream) {
  const size_t held = stream->end - stream->at;
  memmove(stream->buffer, stream->buffer + stream->at, held);
  stream->at = 0;
  stream->end = held;
  const int32_t n = stream->refill(stream->ctx, stream->buffer + held, stream->capacity - held);
  if (n > 0) stream->end += (size_t)n;
  if (n == STREAM_ENDED) {
    stream->n_skipped_bytes += (uint32_t)held;
    stream->end = 0;
  }
  return n;
}

/* To the next marker that is held. */
static void skip_to_marker(sample_stream_t* stream) {
  do {
    stream->at++;
    stream->n_skipped_bytes++;
  } while (stream->at < stream->end && stream->buffer[stream->at] != IMUCAL_SAMPLE_MARKER);
}

int32_t sample_stream_next(sample_stream_t* stream, imucal_sample_t* sample) {
  while (stream->end - stream->at < IMUCAL_SAMPLE_RECORD_BYTES) {
    const int32_t n = refill(stream);
    if (n <= 0) return n;
  }
  if (imucal_sample_decode(stream->buffer + stream->at, sample) != IMUCAL_OK) {
    skip_to_marker(stream);
    return STREAM_BAD_RECORD;
  }
  stream->at += IMUCAL_SAMPLE_RECORD_BYTES;
  return 1;
}
