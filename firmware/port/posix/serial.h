// SPDX-License-Identifier: MIT
/* Purpose: the emulated device's serial line: a pseudo-terminal or a TCP listener with one client at a time.
 * Never blocks. A client that leaves a TCP line may come back; a pseudo-terminal outlives its clients. */
#ifndef IMUCAL_PORT_POSIX_SERIAL_H
#define IMUCAL_PORT_POSIX_SERIAL_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct {
  int line_fd;   /* pty master or the connected client; -1: nobody there */
  int listen_fd; /* -1: pty */
  int slave_fd;  /* held open so that a client that leaves does not hang the line up */
  char name[128];
} serial_t;

/* `where`: "pty" or "tcp:PORT" (port 0: any free one). True with `name` set to what a client opens
 * ("/dev/pts/3", "tcp:127.0.0.1:5000"), else `error` tells why. */
bool serial_open(serial_t* serial, const char* where, char* error, size_t capacity);
size_t serial_read(serial_t* serial, uint8_t* data, size_t capacity);
size_t serial_write(serial_t* serial, const uint8_t* data, size_t length);

/* What to poll for input: the line, or the listener while nobody is connected. */
int serial_poll_fd(const serial_t* serial);
#endif
