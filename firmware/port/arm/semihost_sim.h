// SPDX-License-Identifier: MIT
/* Purpose: the emulated sensor and the emulated flash of a device in QEMU, as files of QEMU's host.
 * Reading a named pipe that has nothing to say stops the whole emulated machine until it does. */
#ifndef IMUCAL_PORT_SEMIHOST_SIM_H
#define IMUCAL_PORT_SEMIHOST_SIM_H
#include "app/port.h"
#include "port/sim/board_options.h"
#include "port/sim/nor.h"
#include "port/sim/sample_stream.h"

typedef struct {
  char path[160]; /* empty: a sensor that never delivers */
  int32_t file;   /* negative: not open */
  bool has_ended;
} semihost_feed_t;

/* For sample_stream_t.refill. */
int32_t semihost_feed_refill(void* feed, uint8_t* data, size_t capacity);
bool semihost_feed_restart_if_ended(semihost_feed_t* feed);

/* The same as imucal_port_t.sample_read wants it, from a stream whose ctx is a semihost_feed_t. */
imucal_port_sample_t semihost_sample_read(sample_stream_t* stream, imucal_sample_t* sample);

/* Sets the board from "name=value" arguments (board_options.h); the names feed, flash, flash-delay-us, sensor and bus,
 * and the program's name at the front, are passed over.  What cannot be read or is out of range is printed and
 * ends the emulation with status 2. */
void semihost_board(imucal_board_t* board, const char* command_line);

/* Unlike at every start of the emulator and after every reset. */
uint32_t semihost_boot_id(void);

typedef struct {
  int32_t file;
} semihost_flash_t;

/* Opens `path`, creating or completing it erased, and fills load, save and ctx of `nor` (size_bytes is set).
 */
bool semihost_flash_open(semihost_flash_t* flash, nor_t* nor, const char* path);

/* The table store's flash: IMUCAL_STORE_SLOTS slots of slot_bytes in the file of the argument flash=PATH, words of 4 bytes.
 * Without a usable file it says so and ends the emulation with status 2.  `file` and `nor` live as long as the flash. */
imucal_flash_t semihost_flash(const char* command_line, semihost_flash_t* file, nor_t* nor, uint32_t slot_bytes,
                              uint32_t page_bytes);
#endif
