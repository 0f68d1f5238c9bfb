// SPDX-License-Identifier: MIT
// The byte stream to a device: a serial device, a pseudo-terminal or a TCP connection behind one interface.
//
// PORT names (host/README.md):
//   /dev/ttyACM0, COM5      a serial device, through libserialport
//   /dev/pts/3, ./link      a pseudo-terminal (or a link that leads to one), through termios
//   tcp:HOST:PORT           an emulator or a serial device server
//   serial:NAME, pty:NAME   the same, saying which implementation opens it
//
// A port is opened for this program alone: a second `calibrate` on the same device is refused, because two
// programs that share a serial line each lose half of what the device says.
#pragma once
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace imucal {

class Transport {
public:
  virtual ~Transport() = default;
  Transport(const Transport&) = delete;
  Transport& operator=(const Transport&) = delete;

  // Bytes that have come, at most `max`; waits up to timeout_s for the first.  0: none came.
  // device_error: the other end is gone (unplugged, process ended, connection closed).
  virtual size_t read(uint8_t* bytes, size_t max, double timeout_s) = 0;

  // All bytes are handed to the line, or device_error after timeout_s without progress.
  virtual void write(const uint8_t* bytes, size_t n, double timeout_s) = 0;

  const std::string& name() const { return name_; }
  // "serial", "pty" or "tcp".
  virtual const char* kind() const = 0;

protected:
  explicit Transport(std::string name) : name_(std::move(name)) {}

private:
  std::string name_;
};

constexpr int kDefaultBaud = 115200;
constexpr double kConnectTimeout_s = 5.0;

// Opens a port.  usage_error: the name is malformed.  device_error: it does not exist, may not be opened,
// is in use, or nobody listens; the message says what to do.
std::unique_ptr<Transport> open_transport(const std::string& port, int baud = kDefaultBaud);

// The serial devices libserialport knows of on this machine.
struct SerialPortInfo {
  std::string name, description, usb_serial;
};
std::vector<SerialPortInfo> list_serial_ports();

} // namespace imucal
