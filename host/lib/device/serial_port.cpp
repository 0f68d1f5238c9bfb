// SPDX-License-Identifier: MIT
#include "device/serial_port.h"

#include <libserialport.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>

namespace imucal {

namespace {

unsigned blocking_ms(double timeout_s) {
  // 0 means "for ever" to libserialport's blocking calls.
  return std::max(1u, static_cast<unsigned>(std::lround(std::max(0.0, timeout_s) * 1000.0)));
}

// What libserialport says of its last failure, in one line.
std::string serial_reason() {
  char* text = sp_last_error_message();
  std::string reason = text ? text : "unknown reason";
  sp_free_error_message(text);
  return reason;
}

class SerialTransport : public Transport {
public:
  SerialTransport(std::string name, sp_port* port) : Transport(std::move(name)), port_(port) {}
  ~SerialTransport() override {
    sp_close(port_);
    sp_free_port(port_);
  }
  const char* kind() const override { return "serial"; }

  size_t read(uint8_t* bytes, size_t max, double timeout_s) override {
    const int n = sp_blocking_read_next(port_, bytes, max, blocking_ms(timeout_s));
    if (n >= 0) return static_cast<size_t>(n);
    if (sp_last_error_code() == EINTR) return 0;
    throw serial_gone(name());
  }

  void write(const uint8_t* bytes, size_t n, double timeout_s) override {
    const int sent = sp_blocking_write(port_, bytes, n, blocking_ms(timeout_s));
    if (sent < 0) throw serial_gone(name());
    if (static_cast<size_t>(sent) < n)
      throw device_error(name() + ": the device takes no more bytes (waited " + std::to_string(blocking_ms(timeout_s)) +
                         " ms); reset it and try again");
  }

private:
  sp_port* port_;
};

void configure(const std::string& port, sp_port* handle, int baud) {
  const bool done = sp_set_baudrate(handle, baud) == SP_OK && sp_set_bits(handle, 8) == SP_OK &&
                    sp_set_parity(handle, SP_PARITY_NONE) == SP_OK && sp_set_stopbits(handle, 1) == SP_OK &&
                    sp_set_flowcontrol(handle, SP_FLOWCONTROL_NONE) == SP_OK;
  if (!done)
    throw device_error(port + ": cannot set " + std::to_string(baud) + " baud, 8N1: " + serial_reason() +
                       "; give a rate the adapter knows with --baud");
}

} // namespace

std::unique_ptr<Transport> open_serial(const std::string& port, const std::string& name, int baud) {
  sp_port* handle = nullptr;
  if (sp_get_port_by_name(name.c_str(), &handle) != SP_OK) {
    // libserialport answers "invalid argument" for anything that sysfs does not list as a serial device.
    if (::access(name.c_str(), F_OK) != 0) throw serial_open_failed(port, ENOENT);
    throw device_error(port + ": not a serial device; `calibrate list` shows those of this machine");
  }
  if (sp_open(handle, SP_MODE_READ_WRITE) != SP_OK) {
    const int code = sp_last_error_code();
    sp_free_port(handle);
    throw serial_open_failed(port, code);
  }
  auto transport = std::make_unique<SerialTransport>(port, handle);
  int fd = -1;
  if (sp_get_port_handle(handle, &fd) == SP_OK) lock_port(port, fd);
  configure(port, handle, baud);
  sp_flush(handle, SP_BUF_BOTH);
  return transport;
}

std::vector<SerialPortInfo> list_serial_ports() {
  sp_port** ports = nullptr;
  std::vector<SerialPortInfo> found;
  if (sp_list_ports(&ports) != SP_OK) return found;
  const auto text = [](const char* value) { return std::string(value ? value : ""); };
  for (sp_port** port = ports; *port; ++port)
    found.push_back(
        {text(sp_get_port_name(*port)), text(sp_get_port_description(*port)), text(sp_get_port_usb_serial(*port))});
  sp_free_port_list(ports);
  return found;
}

} // namespace imucal
