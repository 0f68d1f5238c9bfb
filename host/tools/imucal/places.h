// SPDX-License-Identifier: MIT
// Where the one command finds what it starts: from its own place, whatever argv[0] says.
#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace imucal {

struct Places {
  std::filesystem::path bin;                   // folder this program lies in
  std::vector<std::filesystem::path> programs; // folders searched for dp, calibrate, …
  std::vector<std::filesystem::path> packages; // folders that may hold the Python package `imucal`
  std::vector<std::filesystem::path> pythons;  // interpreters, best first
};

// In a build folder: build/bin, host/python, build/venv.  Installed: bin, libexec/imucal, lib/imucal/python.
Places places_of(const std::filesystem::path& executable);

std::optional<std::filesystem::path> find_program(const Places& places, const std::string& name);
std::optional<std::filesystem::path> find_package(const Places& places);
std::string find_python(const Places& places);

} // namespace imucal
