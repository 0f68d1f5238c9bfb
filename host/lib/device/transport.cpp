// SPDX-License-Identifier: MIT
#include "device/transport.h"

#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <climits>
#include <cmath>
#include <cstdlib>
#include <cstring>

#include "base/error.h"
#include "device/serial_port.h"

namespace imucal {

namespace {

int milliseconds(double timeout_s) {
  return static_cast<int>(std::lround(std::max(0.0, timeout_s) * 1000.0));
}

std::string reason(int error) {
  return std::strerror(error);
}

// What a port's errors say, by errno, with the remedy.
Error open_failed(const std::string& port, int error) {
  switch (error) {
  case ENOENT:
  case ENODEV:
  case ENXIO:
    return device_error(port + ": no such port; `calibrate list` shows the serial devices of this machine");
  case EACCES:
  case EPERM:
    return device_error(port +
                        ": no permission to open the port; add yourself to its group (often dialout) and log in again");
  case EBUSY:
  case EWOULDBLOCK:
    return device_error(port + ": the port is in use by another program; end that program first");
  default:
    return device_error(port + ": cannot open the port: " + reason(error));
  }
}

Error gone(const std::string& port) {
  return device_error(port + ": the device is gone (unplugged, or its program ended); nothing was lost on it: "
                             "connect it again and repeat the command");
}

// A byte stream over a file descriptor: what a pseudo-terminal and a socket have in common.
class DescriptorTransport : public Transport {
public:
  DescriptorTransport(std::string name, const char* kind, int fd) : Transport(std::move(name)), kind_(kind), fd_(fd) {}
  ~DescriptorTransport() override { ::close(fd_); }
  const char* kind() const override { return kind_; }

  size_t read(uint8_t* bytes, size_t max, double timeout_s) override {
    if (!wait(POLLIN, timeout_s)) return 0;
    const ssize_t n = ::read(fd_, bytes, max);
    if (n > 0) {
      has_read_ = true;
      return static_cast<size_t>(n);
    }
    if (n < 0 && (errno == EAGAIN || errno == EINTR)) return 0;
    throw lost();
  }

  void write(const uint8_t* bytes, size_t n, double timeout_s) override {
    while (n > 0) {
      if (!wait(POLLOUT, timeout_s))
        throw device_error(name() + ": the device takes no more bytes (waited " +
                           std::to_string(milliseconds(timeout_s)) + " ms); reset it and try again");
      const ssize_t sent = ::write(fd_, bytes, n);
      if (sent < 0) {
        if (errno == EAGAIN || errno == EINTR) continue;
        throw lost();
      }
      bytes += sent;
      n -= static_cast<size_t>(sent);
    }
  }

private:
  // A connection that is closed before a byte came: the device ended, or it turned us away, for it serves one host at a
  // time.
  Error lost() const {
    if (has_read_ || std::strcmp(kind_, "tcp") != 0) return gone(name());
    return device_error(name() +
                        ": the connection was closed before a byte came: the port is in use by another program "
                        "(end that program first), or the device is gone (start it and try again)");
  }

  // False: nothing within the time (or a signal came, which the caller looks at between reads).
  bool wait(short events, double timeout_s) {
    pollfd entry{fd_, events, 0};
    const int n = ::poll(&entry, 1, milliseconds(timeout_s));
    if (n < 0 && errno != EINTR) throw device_error(name() + ": " + reason(errno));
    return n > 0;
  }

  const char* kind_;
  int fd_;
  bool has_read_ = false;
};

// Closes unless released: the steps of opening may throw.
struct OpenDescriptor {
  int fd;
  ~OpenDescriptor() {
    if (fd >= 0) ::close(fd);
  }
  int release() {
    const int released = fd;
    fd = -1;
    return released;
  }
};

// Raw mode, like a serial line without handshake.
void make_raw(const std::string& port, int fd) {
  termios settings{};
  if (::tcgetattr(fd, &settings) != 0) throw device_error(port + ": not a terminal or serial device: " + reason(errno));
  ::cfmakeraw(&settings);
  settings.c_cflag |= CLOCAL | CREAD;
  settings.c_cc[VMIN] = 1;
  settings.c_cc[VTIME] = 0;
  if (::tcsetattr(fd, TCSANOW, &settings) != 0) throw device_error(port + ": cannot set raw mode: " + reason(errno));
}

std::unique_ptr<Transport> open_pty(const std::string& port, const std::string& path) {
  OpenDescriptor file{::open(path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC)};
  if (file.fd < 0) throw open_failed(port, errno == EIO ? ENODEV : errno);
  lock_port(port, file.fd);
  make_raw(port, file.fd);
  return std::make_unique<DescriptorTransport>(port, "pty", file.release());
}

bool connect_within(int fd, const addrinfo& address, double timeout_s, int* error) {
  if (::connect(fd, address.ai_addr, address.ai_addrlen) == 0) return true;
  *error = errno;
  if (errno != EINPROGRESS) return false;
  pollfd entry{fd, POLLOUT, 0};
  if (::poll(&entry, 1, milliseconds(timeout_s)) <= 0) {
    *error = ETIMEDOUT;
    return false;
  }
  socklen_t size = sizeof *error;
  ::getsockopt(fd, SOL_SOCKET, SO_ERROR, error, &size);
  return *error == 0;
}

std::unique_ptr<Transport> open_tcp(const std::string& port, const std::string& where) {
  const size_t colon = where.rfind(':');
  if (colon == std::string::npos || colon == 0 || colon + 1 == where.size())
    throw usage_error("port '" + port + "': expected tcp:HOST:PORT, for example tcp:localhost:5555");
  std::string host = where.substr(0, colon);
  if (host.size() > 2 && host.front() == '[' && host.back() == ']') host = host.substr(1, host.size() - 2);
  const std::string service = where.substr(colon + 1);

  addrinfo hints{}, *found = nullptr;
  hints.ai_socktype = SOCK_STREAM;
  if (const int code = ::getaddrinfo(host.c_str(), service.c_str(), &hints, &found); code != 0)
    throw device_error(port + ": cannot find the host: " + ::gai_strerror(code));
  const std::unique_ptr<addrinfo, void (*)(addrinfo*)> addresses(found, ::freeaddrinfo);
  int error = 0;
  for (const addrinfo* address = addresses.get(); address; address = address->ai_next) {
    OpenDescriptor file{::socket(address->ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, address->ai_protocol)};
    if (file.fd < 0 || !connect_within(file.fd, *address, kConnectTimeout_s, &error)) continue;
    const int on = 1;
    ::setsockopt(file.fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    return std::make_unique<DescriptorTransport>(port, "tcp", file.release());
  }
  throw device_error(port + ": cannot connect: " + reason(error) + "; is the emulator or the device server running?");
}

// A link (as socat or a test makes one) that leads to a pseudo-terminal.
bool leads_to_pty(const std::string& path) {
  char resolved[PATH_MAX];
  return ::realpath(path.c_str(), resolved) && std::strncmp(resolved, "/dev/pts/", 9) == 0;
}

bool starts_with(const std::string& text, const char* start) {
  return text.rfind(start, 0) == 0;
}

} // namespace

// Advisory lock and TIOCEXCL: the lock also keeps out programs run by root, TIOCEXCL also those that do not
// lock.
void lock_port(const std::string& port, int fd) {
  if (::flock(fd, LOCK_EX | LOCK_NB) != 0) throw open_failed(port, errno);
  ::ioctl(fd, TIOCEXCL); // not every kind of port knows it; the lock stands
}

Error serial_open_failed(const std::string& port, int error) {
  return open_failed(port, error);
}
Error serial_gone(const std::string& port) {
  return gone(port);
}

std::unique_ptr<Transport> open_transport(const std::string& port, int baud) {
  if (port.empty()) throw usage_error("no port: give --port /dev/ttyACM0, /dev/pts/N or tcp:HOST:PORT");
  if (starts_with(port, "tcp:")) return open_tcp(port, port.substr(4));
  if (starts_with(port, "pty:")) return open_pty(port, port.substr(4));
  if (starts_with(port, "serial:")) return open_serial(port, port.substr(7), baud);
  if (starts_with(port, "/dev/pts/")) return open_pty(port, port);
  if (!starts_with(port, "/dev/") && leads_to_pty(port)) return open_pty(port, port);
  return open_serial(port, port, baud);
}

} // namespace imucal
