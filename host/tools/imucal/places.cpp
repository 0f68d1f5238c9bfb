// SPDX-License-Identifier: MIT
#include "imucal/places.h"

#include <unistd.h>

#include <cstdlib>

namespace fs = std::filesystem;

namespace imucal {

Places places_of(const fs::path& executable) {
  Places places;
  places.bin = executable.parent_path();
  const fs::path up = places.bin.parent_path();
  places.programs = {places.bin, up / "libexec/imucal"};
  // build/bin and build/<variant>/bin lie two and three folders below the top.
  places.packages = {up / "lib/imucal/python", up.parent_path() / "host/python",
                     up.parent_path().parent_path() / "host/python"};
  if (const char* chosen = std::getenv("IMUCAL_PYTHON")) places.pythons.emplace_back(chosen);
  places.pythons.push_back(up / "lib/imucal/venv/bin/python");
  places.pythons.push_back(up / "venv/bin/python");
  places.pythons.push_back(up.parent_path() / "venv/bin/python");
  return places;
}

std::optional<fs::path> find_program(const Places& places, const std::string& name) {
  for (const fs::path& folder : places.programs)
    if (::access((folder / name).c_str(), X_OK) == 0) return folder / name;
  return std::nullopt;
}

std::optional<fs::path> find_package(const Places& places) {
  for (const fs::path& folder : places.packages)
    if (fs::exists(folder / "imucal/__main__.py")) return folder;
  return std::nullopt;
}

std::string find_python(const Places& places) {
  for (const fs::path& python : places.pythons)
    if (::access(python.c_str(), X_OK) == 0) return python.string();
  return "python3";
}

} // namespace imucal
