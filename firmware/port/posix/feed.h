// SPDX-License-Identifier: MIT
/* Purpose: bytes of the emulated sensor from a file, a named pipe or a TCP server ("tcp:HOST:PORT"). Opened
 * when samples are first wanted, and again where they are wanted after the end (a file from its beginning, a
 * pipe from its next writer); never blocks; nothing is read while nobody wants samples, so nothing is lost.
 */
#ifndef IMUCAL_PORT_POSIX_FEED_H
#define IMUCAL_PORT_POSIX_FEED_H
#include "port/sim/sample_stream.h"

typedef struct {
  const char* where; /* NULL: a sensor that never delivers */
  int fd;
  bool has_delivered; /* a pipe without a writer reads as ended until the first byte came */
  bool has_ended;
} feed_t;

void feed_init(feed_t* feed, const char* where);

/* After the end, starts anew. True where it did. */
bool feed_restart_if_ended(feed_t* feed);

/* For sample_stream_t.refill; STREAM_FAILED where the feed cannot be opened or read. */
int32_t feed_refill(void* feed, uint8_t* data, size_t capacity);
#endif
