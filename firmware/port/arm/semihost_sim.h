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

/* The feed of the argument feed=PATH as a stream of samples.  All three live as long as the stream. */
void semihost_feed_init(semihost_feed_t* feed, const char* command_line, sample_stream_t* stream, uint8_t* buffer,
                        size_t capacity);

/* What imucal_port_t.sample_read returns, and what its sample_enable does: a feed at its end is read anew. */
imucal_port_sample_t semihost_sample_read(sample_stream_t* stream, imucal_sample_t* sample);
void semihost_sample_enable(sample_stream_t* stream, bool is_wanted);

/* Sets the board from "name=value" arguments (board_options.h); the names feed, flash, flash-delay-us, sensor and bus,
 * and the program's name at the front, are passed over.  What cannot be read or is out of range is printed and
 * ends the emulation with status 2. */
void semihost_board(imucal_board_t* board, const char* command_line);

/* Unlike at every start of the emulator and after every reset. */
uint32_t semihost_boot_id(void);

#define SEMIHOST_WORD_BYTES 4u

typedef struct {
  int32_t file;
} semihost_flash_t;

/* The table store's flash: IMUCAL_STORE_SLOTS slots of slot_bytes in the file of the argument flash=PATH, which is created or
 * completed erased; words of SEMIHOST_WORD_BYTES.  Without a usable file it says so and ends the emulation with status 2.  `file` and `nor` live as long as the flash. */
imucal_flash_t semihost_flash(const char* command_line, semihost_flash_t* file, nor_t* nor, uint32_t slot_bytes,
                              uint32_t page_bytes);
/* Its functions, for a port that adds to them; ctx: the nor_t. */
imucal_status semihost_flash_erase(void* ctx, uint32_t slot);
imucal_status semihost_flash_program(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len);
imucal_status semihost_flash_read(void* ctx, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t len);
#endif
