// SPDX-License-Identifier: MIT
// The libserialport side of transport.h (in a file of its own, so that only `calibrate` links the library).
#pragma once
#include <memory>
#include <string>

#include "base/error.h"
#include "device/transport.h"

namespace imucal {

// `port` is the name the user gave (for messages), `name` what libserialport opens.
std::unique_ptr<Transport> open_serial(const std::string& port, const std::string& name, int baud);

// Exclusive access to an open port; device_error when another program has it.
void lock_port(const std::string& port, int fd);

// The messages all kinds of port share.
Error serial_open_failed(const std::string& port, int error);
Error serial_gone(const std::string& port);

} // namespace imucal
