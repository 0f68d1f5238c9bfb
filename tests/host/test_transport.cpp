// SPDX-License-Identifier: MIT
// Transport: pseudo-terminals and TCP carry bytes unchanged, wait no longer than told, and end in clear
// errors.
#include <csetjmp>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
extern "C" {
#include <cmocka.h>
}
#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <cstring>
#include <string>

#include "base/error.h"
#include "device/transport.h"

using namespace imucal;

namespace {

double now_s() {
  using namespace std::chrono;
  return duration<double>(steady_clock::now().time_since_epoch()).count();
}

// The device's end of a pseudo-terminal.
struct Master {
  int fd = ::posix_openpt(O_RDWR | O_NOCTTY);
  std::string slave;
  Master() {
    ::grantpt(fd);
    ::unlockpt(fd);
    slave = ::ptsname(fd);
  }
  ~Master() {
    if (fd >= 0) ::close(fd);
  }
  void hang_up() {
    ::close(fd);
    fd = -1;
  }
};

struct Server {
  int fd = ::socket(AF_INET, SOCK_STREAM, 0);
  std::string port;
  Server() {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    ::bind(fd, reinterpret_cast<sockaddr*>(&address), size);
    ::listen(fd, 1);
    ::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size);
    port = "tcp:127.0.0.1:" + std::to_string(ntohs(address.sin_port));
  }
  ~Server() { ::close(fd); }
};

// The error of opening `port`: exit status and message.
struct Refusal {
  Exit exit = Exit::kDone;
  std::string message;
};
Refusal refusal_of(const std::string& port) {
  try {
    open_transport(port);
  } catch (const Error& e) {
    return {e.exit(), e.what()};
  }
  return {};
}

void assert_contains(const std::string& text, const char* part) {
  if (text.find(part) == std::string::npos) fail_msg("'%s' lacks '%s'", text.c_str(), part);
}

// Every byte value, both ways.
void check_echo(Transport* transport, int device_fd) {
  uint8_t all[256], back[256];
  for (int i = 0; i < 256; ++i) all[i] = static_cast<uint8_t>(i);
  transport->write(all, sizeof all, 1.0);
  for (size_t n = 0; n < sizeof back;) {
    const ssize_t got = ::read(device_fd, back + n, sizeof back - n);
    assert_true(got > 0);
    n += static_cast<size_t>(got);
  }
  assert_memory_equal(all, back, sizeof all);
  assert_int_equal(::write(device_fd, all, sizeof all), sizeof all);
  for (size_t n = 0; n < sizeof back;) {
    const size_t got = transport->read(back + n, sizeof back - n, 1.0);
    assert_true(got > 0);
    n += got;
  }
  assert_memory_equal(all, back, sizeof all);
}

void test_pty_every_byte_value_passes_both_ways(void**) {
  Master device;
  const auto transport = open_transport(device.slave);
  assert_string_equal(transport->kind(), "pty");
  check_echo(transport.get(), device.fd);
}

void test_tcp_every_byte_value_passes_both_ways(void**) {
  Server server;
  const auto transport = open_transport(server.port);
  const int device = ::accept(server.fd, nullptr, nullptr);
  assert_string_equal(transport->kind(), "tcp");
  check_echo(transport.get(), device);
  ::close(device);
}

void test_read_silent_device_returns_at_the_timeout(void**) {
  Master device;
  const auto transport = open_transport(device.slave);
  uint8_t byte;
  const double start = now_s();
  assert_int_equal(transport->read(&byte, 1, 0.1), 0);
  const double waited = now_s() - start;
  assert_true(waited > 0.09 && waited < 1.0);
}

void test_write_device_that_never_reads_ends_in_an_error(void**) {
  Server server;
  const auto transport = open_transport(server.port);
  const std::vector<uint8_t> much(64u << 20);
  try {
    transport->write(much.data(), much.size(), 0.1);
    fail_msg("64 MB were taken by a device that reads nothing");
  } catch (const Error& e) {
    assert_int_equal(e.exit(), Exit::kDevice);
    assert_contains(e.what(), "takes no more bytes");
  }
}

template <typename HangUp> void check_gone(Transport* transport, HangUp hang_up) {
  hang_up();
  try {
    uint8_t byte;
    for (int i = 0; i < 20; ++i) transport->read(&byte, 1, 0.1);
    fail_msg("no error though the device is gone");
  } catch (const Error& e) {
    assert_int_equal(e.exit(), Exit::kDevice);
    assert_contains(e.what(), "the device is gone");
  }
}

void test_pty_device_ends_is_reported(void**) {
  Master device;
  const auto transport = open_transport(device.slave);
  check_gone(transport.get(), [&] { device.hang_up(); });
}

void test_tcp_device_ends_is_reported(void**) {
  Server server;
  const auto transport = open_transport(server.port);
  check_gone(transport.get(), [&] { ::close(::accept(server.fd, nullptr, nullptr)); });
}

void test_open_twice_is_refused_as_busy(void**) {
  Master device;
  const auto first = open_transport(device.slave);
  const Refusal second = refusal_of(device.slave);
  assert_int_equal(second.exit, Exit::kDevice);
  assert_contains(second.message, "in use");
}

void test_open_again_after_close_succeeds(void**) {
  Master device;
  open_transport(device.slave).reset();
  assert_non_null(open_transport(device.slave).get());
}

void test_open_port_that_does_not_exist_says_so(void**) {
  for (const char* port : {"/dev/pts/99999", "/dev/ttyNOSUCH7", "serial:/dev/ttyNOSUCH7", "no-such-file"}) {
    const Refusal refusal = refusal_of(port);
    assert_int_equal(refusal.exit, Exit::kDevice);
    assert_contains(refusal.message, port);
    assert_contains(refusal.message, "no such port");
  }
}

void test_open_file_that_is_no_port_says_so(void**) {
  const Refusal refusal = refusal_of("/dev/null");
  assert_int_equal(refusal.exit, Exit::kDevice);
  assert_contains(refusal.message, "not a serial device");
}

void test_open_tcp_nobody_listens_says_so(void**) {
  std::string port;
  {
    Server server;
    port = server.port;
  }
  const Refusal refusal = refusal_of(port);
  assert_int_equal(refusal.exit, Exit::kDevice);
  assert_contains(refusal.message, "cannot connect");
}

void test_open_malformed_name_is_a_usage_error(void**) {
  for (const char* port : {"", "tcp:", "tcp:localhost", "tcp:localhost:", "tcp::5555"})
    assert_int_equal(refusal_of(port).exit, Exit::kUsage);
}

} // namespace

int main() {
  const CMUnitTest tests[] = {
      cmocka_unit_test(test_pty_every_byte_value_passes_both_ways),
      cmocka_unit_test(test_tcp_every_byte_value_passes_both_ways),
      cmocka_unit_test(test_read_silent_device_returns_at_the_timeout),
      cmocka_unit_test(test_write_device_that_never_reads_ends_in_an_error),
      cmocka_unit_test(test_pty_device_ends_is_reported),
      cmocka_unit_test(test_tcp_device_ends_is_reported),
      cmocka_unit_test(test_open_twice_is_refused_as_busy),
      cmocka_unit_test(test_open_again_after_close_succeeds),
      cmocka_unit_test(test_open_port_that_does_not_exist_says_so),
      cmocka_unit_test(test_open_file_that_is_no_port_says_so),
      cmocka_unit_test(test_open_tcp_nobody_listens_says_so),
      cmocka_unit_test(test_open_malformed_name_is_a_usage_error),
  };
  return cmocka_run_group_tests(tests, nullptr, nullptr);
}
