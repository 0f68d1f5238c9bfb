// SPDX-License-Identifier: MIT
#include "feed.h"

#include <errno.h>
#include <fcntl.h>
#include <netdb.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

void feed_init(feed_t* feed, const char* where) {
  memset(feed, 0, sizeof *feed);
  feed->where = where;
  feed->fd = -1;
}

bool feed_restart_if_ended(feed_t* feed) {
  const bool is_restart = feed->has_ended;
  if (is_restart) feed_init(feed, feed->where);
  return is_restart;
}

static int connect_to(const char* host_port) {
  char host[128];
  snprintf(host, sizeof host, "%s", host_port);
  char* colon = strrchr(host, ':');
  if (!colon) return -1;
  *colon = '\0';
  struct addrinfo hints = {.ai_socktype = SOCK_STREAM}, *found = NULL;
  if (getaddrinfo(host, colon + 1, &hints, &found)) return -1;
  int fd = socket(found->ai_family, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (fd >= 0 && connect(fd, found->ai_addr, found->ai_addrlen)) {
    close(fd);
    fd = -1;
  }
  freeaddrinfo(found);
  if (fd >= 0) fcntl(fd, F_SETFL, O_NONBLOCK);
  return fd;
}

static bool open_feed(feed_t* feed) {
  if (feed->fd >= 0) return true;
  feed->fd = !strncmp(feed->where, "tcp:", 4) ? connect_to(feed->where + 4)
                                              : open(feed->where, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  return feed->fd >= 0;
}

static int32_t end_feed(feed_t* feed, int32_t state) {
  if (feed->fd >= 0) close(feed->fd);
  feed->fd = -1;
  feed->has_ended = true;
  return state;
}

int32_t feed_refill(void* ctx, uint8_t* data, size_t capacity) {
  feed_t* feed = ctx;
  if (!feed->where) return STREAM_NOTHING_YET;
  if (feed->has_ended) return STREAM_ENDED;
  if (!open_feed(feed)) return end_feed(feed, STREAM_FAILED);
  const ssize_t n = read(feed->fd, data, capacity);
  if (n > 0) {
    feed->has_delivered = true;
    return (int32_t)n;
  }
  struct stat status;
  const bool is_file = !fstat(feed->fd, &status) && S_ISREG(status.st_mode);
  if (n == 0) return feed->has_delivered || is_file ? end_feed(feed, STREAM_ENDED) : STREAM_NOTHING_YET;
  const bool is_transient = errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR;
  return is_transient ? STREAM_NOTHING_YET : end_feed(feed, STREAM_FAILED);
}
