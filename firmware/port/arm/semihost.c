// SPDX-License-Identifier: MIT
#include "semihost.h"

enum {
  SYS_OPEN = 0x01,
  SYS_CLOSE = 0x02,
  SYS_WRITE0 = 0x04,
  SYS_WRITE = 0x05,
  SYS_READ = 0x06,
  SYS_SEEK = 0x0A,
  SYS_FLEN = 0x0C,
  SYS_CLOCK = 0x10,
  SYS_TIME = 0x11,
  SYS_GET_CMDLINE = 0x15,
  SYS_EXIT_EXTENDED = 0x20
};
#define ADP_STOPPED_APPLICATION_EXIT 0x20026u

static uint32_t word_of(const void* pointer) {
  return (uint32_t)(uintptr_t)pointer;
}

static size_t text_length(const char* text) {
  size_t n = 0;
  while (text[n]) n++;
  return n;
}

#if defined(__riscv)
/* RISC-V semihosting specification 0.4: three instructions of 4 bytes each. */
static int32_t call(uint32_t operation, uint32_t argument) {
  register uint32_t a0 __asm("a0") = operation;
  register uint32_t a1 __asm("a1") = argument;
  __asm volatile(".option push\n\t.option norvc\n\t.balign 16\n\t"
                 "slli x0, x0, 0x1f\n\tebreak\n\tsrai x0, x0, 7\n\t.option pop"
                 : "+r"(a0)
                 : "r"(a1)
                 : "memory");
  return (int32_t)a0;
}
#else
static int32_t call(uint32_t operation, uint32_t argument) {
  register uint32_t r0 __asm("r0") = operation;
  register uint32_t r1 __asm("r1") = argument;
  __asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
  return (int32_t)r0;
}
#endif

int32_t semihost_open(const char* path, uint32_t mode) {
  const uint32_t block[3] = {word_of(path), mode, (uint32_t)text_length(path)};
  return call(SYS_OPEN, word_of(block));
}

void semihost_close(int32_t file) {
  const uint32_t block[1] = {(uint32_t)file};
  (void)call(SYS_CLOSE, word_of(block));
}

int32_t semihost_read(int32_t file, void* data, size_t length) {
  const uint32_t block[3] = {(uint32_t)file, word_of(data), (uint32_t)length};
  const int32_t not_read = call(SYS_READ, word_of(block));
  return not_read < 0 || not_read > (int32_t)length ? -1 : (int32_t)length - not_read;
}

int semihost_write(int32_t file, const void* data, size_t length) {
  const uint32_t block[3] = {(uint32_t)file, word_of(data), (uint32_t)length};
  return call(SYS_WRITE, word_of(block)) == 0;
}

int semihost_seek(int32_t file, uint32_t offset_bytes) {
  const uint32_t block[2] = {(uint32_t)file, offset_bytes};
  return call(SYS_SEEK, word_of(block)) == 0;
}

int32_t semihost_length(int32_t file) {
  const uint32_t block[1] = {(uint32_t)file};
  return call(SYS_FLEN, word_of(block));
}

void semihost_print(const char* text) {
  (void)call(SYS_WRITE0, word_of(text));
}

int semihost_command_line(char* text, size_t capacity) {
  uint32_t block[2] = {word_of(text), (uint32_t)capacity};
  text[0] = '\0';
  return call(SYS_GET_CMDLINE, word_of(block)) == 0;
}

__attribute__((noreturn)) void semihost_exit(uint32_t status) {
  const uint32_t block[2] = {ADP_STOPPED_APPLICATION_EXIT, status};
  for (;;) (void)call(SYS_EXIT_EXTENDED, word_of(block));
}

uint32_t semihost_seconds(void) {
  return (uint32_t)call(SYS_TIME, 0);
}

uint32_t semihost_centiseconds(void) {
  return (uint32_t)call(SYS_CLOCK, 0);
}

static const char* find_value(const char* at, const char* name) {
  const size_t n = text_length(name);
  while (*at) {
    size_t i = 0;
    while (i < n && at[i] == name[i]) i++;
    if (i == n && at[n] == '=') return at + n + 1;
    while (*at && *at != ' ') at++;
    while (*at == ' ') at++;
  }
  return NULL;
}

int semihost_option(const char* command_line, const char* name, char* value, size_t capacity) {
  const char* from = find_value(command_line, name);
  if (!from) return 0;
  for (size_t i = 0; i < capacity; i++) {
    const int is_end = from[i] == ' ' || from[i] == '\0';
    value[i] = (char)(is_end ? '\0' : from[i]);
    if (is_end) return 1;
  }
  return 0;
}

uint32_t semihost_option_u32(const char* command_line, const char* name, uint32_t fallback) {
  const char* at = find_value(command_line, name);
  if (!at || *at < '0' || *at > '9') return fallback;
  uint32_t value = 0;
  for (; *at >= '0' && *at <= '9'; at++) value = value * 10 + (uint32_t)(*at - '0');
  return value;
}
