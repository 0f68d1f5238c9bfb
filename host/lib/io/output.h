// SPDX-License-Identifier: MIT
// Writing files so that nothing half-written stays: to a temporary name in the same folder, then rename; through a symbolic
// link its target.  A device or pipe is written to as it is, "-" is standard output.  A signal that ends the program takes the
// temporary file with it.
// data_error (cannot be created, full, a folder): what was there is untouched.
#pragma once
#include <functional>
#include <iosfwd>
#include <string>

namespace imucal {

void write_text(const std::string& path, const std::string& text);
// For writers that stream: `write` gets the sink.
void write_stream(const std::string& path, const std::function<void(std::ostream&)>& write);

// From now on the file at `path`, by whatever name, is not written: data_error.  io/input.h does so with every file that it
// opens: what was read may be the only copy of a record, and a result is no reason to lose it.
void protect_from_writing(const std::string& path);
// A result will be written over the file at `path`: who protects that file ends with data_error, before the work and not after it.
void announce_result(const std::string& path);
// data_error where `path` is a protected file: for those who write otherwise than by this room.
void refuse_protected(const std::string& path);

// Two names of one file, as it is there or as it would be written.  Standard output, devices and pipes are no such files.
bool is_same_file(const std::string& a, const std::string& b);

} // namespace imucal
