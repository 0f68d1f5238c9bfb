// SPDX-License-Identifier: MIT
/* Purpose: files, command line and exit of the machine that emulates us (or of a debugger), by ARM
 * semihosting. Only for emulated devices: on a chip without a debugger the breakpoint is a fault. Source: ARM
 * semihosting specification 2.0. */
#ifndef IMUCAL_PORT_SEMIHOST_H
#define IMUCAL_PORT_SEMIHOST_H
#include <stddef.h>
#include <stdint.h>

enum { SEMIHOST_READ = 1, SEMIHOST_UPDATE = 3, SEMIHOST_CREATE = 7 }; /* fopen "rb", "r+b", "w+b" */

/* File handle, or negative where the host refuses. Opening a named pipe waits for its writer. */
int32_t semihost_open(const char* path, uint32_t mode);
void semihost_close(int32_t file);

/* Bytes read: 0 at the end of the file, negative on a failure. A pipe may deliver less than asked for. */
int32_t semihost_read(int32_t file, void* data, size_t length);

/* True where all bytes were written. */
int semihost_write(int32_t file, const void* data, size_t length);
int semihost_seek(int32_t file, uint32_t offset_bytes);
int32_t semihost_length(int32_t file);

/* Text to the emulator's standard error. */
void semihost_print(const char* text);

/* The arguments given with -semihosting-config arg=…, joined by spaces. True where they fitted. */
int semihost_command_line(char* text, size_t capacity);
__attribute__((noreturn)) void semihost_exit(uint32_t status);

/* Seconds since 1970 of the emulator's host, and its processor time since the emulator's start. */
uint32_t semihost_seconds(void);
uint32_t semihost_centiseconds(void);

/* Finds `name=` in a command line and copies its value up to the next space; false where it is not there or
 * too long. */
int semihost_option(const char* command_line, const char* name, char* value, size_t capacity);

/* The same for an unsigned decimal number; `fallback` where it is not there or not a number. */
uint32_t semihost_option_u32(const char* command_line, const char* name, uint32_t fallback);
#endif
