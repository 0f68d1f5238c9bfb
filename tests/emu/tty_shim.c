// SPDX-License-Identifier: MIT
// Preloaded under `calibrate` in tests, so that libserialport opens a pseudo-terminal: it asks every port for
// its modem lines (TIOCMGET, TIOCMSET), which a pseudo-terminal does not have.  Everything else goes through.
#define _GNU_SOURCE
#include <stdarg.h>
#include <sys/ioctl.h>
#include <sys/syscall.h>
#include <unistd.h>

int ioctl(int fd, unsigned long request, ...) {
  va_list arguments;
  va_start(arguments, request);
  void* argument = va_arg(arguments, void*);
  va_end(arguments);
  if (request == TIOCMGET) {
    *(int*)argument = TIOCM_DTR | TIOCM_RTS | TIOCM_CTS | TIOCM_CAR | TIOCM_DSR;
    return 0;
  }
  if (request == TIOCMSET || request == TIOCMBIS || request == TIOCMBIC) return 0;
  return (int)syscall(SYS_ioctl, fd, request, argument);
}
