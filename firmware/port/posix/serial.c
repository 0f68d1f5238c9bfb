// SPDX-License-Identifier: MIT
#include "serial.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

static bool fail(char* error, size_t capacity, const char* what) {
  snprintf(error, capacity, "%s: %s", what, strerror(errno));
  return false;
}

static bool open_pty(serial_t* serial, char* error, size_t capacity) {
  serial->line_fd = posix_openpt(O_RDWR | O_NOCTTY);
  if (serial->line_fd < 0 || grantpt(serial->line_fd) || unlockpt(serial->line_fd))
    return fail(error, capacity, "no pseudo-terminal");
  const char* name = ptsname(serial->line_fd);
  if (!name) return fail(error, capacity, "no pseudo-terminal");
  snprintf(serial->name, sizeof serial->name, "%s", name);
  serial->slave_fd = open(name, O_RDWR | O_NOCTTY);
  if (serial->slave_fd < 0) return fail(error, capacity, serial->name);
  struct termios settings;
  if (tcgetattr(serial->slave_fd, &settings)) return fail(error, capacity, serial->name);
  cfmakeraw(&settings); /* no echo: the device must not read what it wrote */
  if (tcsetattr(serial->slave_fd, TCSANOW, &settings)) return fail(error, capacity, serial->name);
  fcntl(serial->line_fd, F_SETFL, O_NONBLOCK);
  return true;
}

static bool open_tcp(serial_t* serial, const char* port_text, char* error, size_t capacity) {
  char* end;
  const long port = strtol(port_text, &end, 10);
  if (end == port_text || *end || port < 0 || port > 65535) {
    snprintf(error, capacity, "'%s' is no TCP port (0 to 65535)", port_text);
    return false;
  }
  serial->listen_fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  const int yes = 1;
  setsockopt(serial->listen_fd, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  struct sockaddr_in address = {.sin_family = AF_INET, .sin_port = htons((uint16_t)port)};
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t length = sizeof address;
  if (serial->listen_fd < 0 || bind(serial->listen_fd, (struct sockaddr*)&address, sizeof address) ||
      listen(serial->listen_fd, 1) || getsockname(serial->listen_fd, (struct sockaddr*)&address, &length))
    return fail(error, capacity, "cannot listen on the TCP port");
  snprintf(serial->name, sizeof serial->name, "tcp:127.0.0.1:%u", (unsigned)ntohs(address.sin_port));
  return true;
}

bool serial_open(serial_t* serial, const char* where, char* error, size_t capacity) {
  *serial = (serial_t){.line_fd = -1, .listen_fd = -1, .slave_fd = -1};
  if (!strcmp(where, "pty")) return open_pty(serial, error, capacity);
  if (!strncmp(where, "tcp:", 4)) return open_tcp(serial, where + 4, error, capacity);
  snprintf(error, capacity, "--serial '%s': expected pty or tcp:PORT", where);
  return false;
}

static void drop_client(serial_t* serial) {
  if (serial->listen_fd < 0) return;
  close(serial->line_fd);
  serial->line_fd = -1;
}

/* Has the host at the line gone? */
static bool is_host_gone(const serial_t* serial) {
  struct pollfd line = {.fd = serial->line_fd, .events = POLLRDHUP};
  return poll(&line, 1, 0) > 0 && (line.revents & (POLLRDHUP | POLLHUP | POLLERR));
}

/* The line is for one host: another one is turned away at once, so that it can tell its user. */
static void accept_client(serial_t* serial) {
  if (serial->listen_fd < 0) return;
  const int fd = accept4(serial->listen_fd, NULL, NULL, SOCK_NONBLOCK | SOCK_CLOEXEC);
  if (fd < 0) return;
  if (serial->line_fd >= 0 && is_host_gone(serial)) drop_client(serial);
  if (serial->line_fd >= 0) {
    close(fd);
    return;
  }
  const int yes = 1;
  serial->line_fd = fd;
  setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
}

static bool is_transient(void) {
  return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR;
}

size_t serial_read(serial_t* serial, uint8_t* data, size_t capacity) {
  accept_client(serial);
  if (serial->line_fd < 0) return 0;
  const ssize_t n = read(serial->line_fd, data, capacity);
  if (n > 0) return (size_t)n;
  if (n == 0 || !is_transient()) drop_client(serial);
  return 0;
}

size_t serial_write(serial_t* serial, const uint8_t* data, size_t length) {
  accept_client(serial);
  if (serial->line_fd < 0 || length == 0) return 0;
  const ssize_t n =
      serial->listen_fd < 0 ? write(serial->line_fd, data, length) : send(serial->line_fd, data, length, MSG_NOSIGNAL);
  if (n >= 0) return (size_t)n;
  if (!is_transient()) drop_client(serial);
  return 0;
}

int serial_poll_fd(const serial_t* serial) {
  return serial->line_fd >= 0 ? serial->line_fd : serial->listen_fd;
}
