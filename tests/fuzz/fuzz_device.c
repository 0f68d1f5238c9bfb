// SPDX-License-Identifier: MIT
// make fuzz-device: the app under operations that libFuzzer chooses by coverage; with FUZZ_DEVICE_MAIN operations drawn at
// random from a seed (gcc).  usage: fuzz_device [inputs [seed]]
#include "fuzz/fuzz_device.h"

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size);
int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  fuzz_device(data, size);
  return 0;
}

#ifdef FUZZ_DEVICE_MAIN
int main(int argc, char** argv) {
  const uint64_t n = argc > 1 ? strtoull(argv[1], NULL, 10) : 2000, seed = argc > 2 ? strtoull(argv[2], NULL, 10) : 1;
  uint8_t data[400];
  for (uint64_t k = 0; k < n; k++) {
    uint64_t random = torn_nor_mix(seed + k);
    for (size_t i = 0; i < sizeof data; i++) data[i] = (uint8_t)(random = torn_nor_mix(random + 1));
    data[0] |= 0x80;
    fprintf(stderr, k % 1000 == 0 ? "input %llu of seed %llu\n" : "", (unsigned long long)(seed + k),
            (unsigned long long)seed);
    fuzz_device(data, sizeof data);
  }
  printf("fuzz-device: seed %llu, %llu inputs, %llu operations, %llu frames, %llu replies, %llu replays, %llu commands "
         "that may write, "
         "%llu starts, %llu of them after a cut; flash touched otherwise 0, not answered 0, done and lost 0\n",
         (unsigned long long)seed, (unsigned long long)fuzz_counts.n_inputs,
         (unsigned long long)fuzz_counts.n_operations, (unsigned long long)fuzz_counts.n_frames,
         (unsigned long long)fuzz_counts.n_replies, (unsigned long long)fuzz_counts.n_replays,
         (unsigned long long)fuzz_counts.n_flash_commands, (unsigned long long)fuzz_counts.n_power_cycles,
         (unsigned long long)fuzz_counts.n_cuts);
  return 0;
}
#endif
