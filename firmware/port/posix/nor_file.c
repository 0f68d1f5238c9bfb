// SPDX-License-Identifier: MIT
#include "nor_file.h"

#include <errno.h>
#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

static int flash_fd = -1;

static bool load(void* ctx, uint32_t offset_bytes, uint8_t* data, size_t length) {
  return pread(*(int*)ctx, data, length, (off_t)offset_bytes) == (ssize_t)length;
}

static bool save(void* ctx, uint32_t offset_bytes, const uint8_t* data, size_t length) {
  return pwrite(*(int*)ctx, data, length, (off_t)offset_bytes) == (ssize_t)length;
}

static bool fill_erased(int fd, off_t from, off_t size) {
  uint8_t ones[256];
  memset(ones, 0xFF, sizeof ones);
  for (off_t at = from; at < size;) {
    const size_t n = size - at < (off_t)sizeof ones ? (size_t)(size - at) : sizeof ones;
    if (pwrite(fd, ones, n, at) != (ssize_t)n) return false;
    at += (off_t)n;
  }
  return true;
}

static int open_in_memory(void) {
  FILE* file = tmpfile();
  return file ? dup(fileno(file)) : -1;
}

bool nor_file_open(nor_t* nor, const char* path, uint32_t size_bytes, char* error, size_t capacity) {
  flash_fd = path ? open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0666) : open_in_memory();
  struct stat status;
  if (flash_fd < 0 || fstat(flash_fd, &status)) {
    snprintf(error, capacity, "--flash %s: %s", path ? path : "(none)", strerror(errno));
    return false;
  }
  if (flock(flash_fd, LOCK_EX | LOCK_NB)) {
    snprintf(error, capacity, "--flash %s: in use by another device", path);
    return false;
  }
  if (status.st_size > (off_t)size_bytes) {
    snprintf(error, capacity, "--flash %s: %lld bytes, more than the flash has (%u): not a flash file?", path,
             (long long)status.st_size, (unsigned)size_bytes);
    return false;
  }
  if (!fill_erased(flash_fd, status.st_size, (off_t)size_bytes)) {
    snprintf(error, capacity, "--flash %s: %s", path ? path : "(none)", strerror(errno));
    return false;
  }
  nor->ctx = &flash_fd;
  nor->load = load;
  nor->save = save;
  return true;
}
