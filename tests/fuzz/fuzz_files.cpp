// SPDX-License-Identifier: MIT
// libFuzzer's door to the files that the host programs read: make fuzz-files.
#include "fuzz/files.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size);

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  fuzz_files::one(data, size);
  return 0;
}
