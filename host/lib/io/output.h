// SPDX-License-Identifier: MIT
// Writing files so that nothing half-written stays: to a temporary name in the same folder, then rename; through a symbolic
// link its target.  A device or pipe is written to as it is, "-" is standard output.
// data_error (cannot be created, full, a folder): what was there is untouched.
#pragma once
#include <functional>
#include <iosfwd>
#include <string>

namespace imucal {

void write_text(const std::string& path, const std::string& text);
// For writers that stream: `write` gets the sink.
void write_stream(const std::string& path, const std::function<void(std::ostream&)>& write);

// From now on the file at `path`, by whatever name, is not written: data_error.  A record cannot be had again.
void protect_from_writing(const std::string& path);

} // namespace imucal
