// SPDX-License-Identifier: MIT
// What the user should know of an input though it is no error: a program prints it to standard error and goes on.
#pragma once
#include <functional>
#include <string>

namespace imucal {

// Says `message` ("log.csv:17: what was found; what to do") once in the life of the process, however often the file is
// read.  Any thread may call it.
void notice(const std::string& message);

// Where notices go from now on; before the first call: "note: <message>" on standard error.
void set_notice_sink(const std::function<void(const std::string&)>& sink);

} // namespace imucal
