// SPDX-License-Identifier: MIT
/* Purpose: the bytes of the emulated flash in a file of this machine (created erased where it is missing). */
#ifndef IMUCAL_PORT_POSIX_NOR_FILE_H
#define IMUCAL_PORT_POSIX_NOR_FILE_H
#include "port/sim/nor.h"

/* Opens or creates `path` with `size_bytes` and fills load, save and ctx of `nor`. A missing path (NULL)
 * keeps the flash in memory for the life of the process. False with `error` set where the file cannot be used
 * or is in use by another device. */
bool nor_file_open(nor_t* nor, const char* path, uint32_t size_bytes, char* error, size_t capacity);
#endif
