// SPDX-License-Identifier: MIT
// The short form of `make fuzz-files`: every file of tests/fuzz/corpus through its door, where the first byte says which,
// and a few thousand mutations of each.  A file named refused_* must be refused, every other one read.
#include <algorithm>
#include <csetjmp>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>
extern "C" {
#include <cmocka.h>
}

#include "fuzz/files.h"

namespace {

using Bytes = std::vector<uint8_t>;
constexpr int kMutations = 2000; // of each file

std::vector<std::filesystem::path> corpus() {
  const auto folder = std::filesystem::path(__FILE__).parent_path().parent_path() / "fuzz" / "corpus";
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  return files;
}

Bytes bytes_of(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

size_t below(std::mt19937_64* random, size_t n) {
  return static_cast<size_t>((*random)() % n);
}

// One to three changes: another byte, a piece cut out or doubled, another digit, a byte of elsewhere.  The door stays.
Bytes mutated(Bytes bytes, std::mt19937_64* random) {
  for (size_t k = 1 + below(random, 3); k-- > 0 && bytes.size() > 2;) {
    const auto at = static_cast<std::ptrdiff_t>(1 + below(random, bytes.size() - 1));
    const auto n =
        static_cast<std::ptrdiff_t>(1 + below(random, std::min<size_t>(8, bytes.size() - static_cast<size_t>(at))));
    const Bytes piece(bytes.begin() + at,
                      bytes.begin() + std::min<std::ptrdiff_t>(at + n, static_cast<std::ptrdiff_t>(bytes.size())));
    switch (below(random, 6)) {
    case 0:
      bytes[static_cast<size_t>(at)] = static_cast<uint8_t>((*random)());
      break;
    case 1:
      bytes.erase(bytes.begin() + at, bytes.begin() + at + static_cast<std::ptrdiff_t>(piece.size()));
      break;
    case 2:
      bytes.insert(bytes.begin() + at, piece.begin(), piece.end());
      break;
    case 3: {
      const auto digit = std::find_if(bytes.begin() + at, bytes.end(), [](uint8_t c) { return c >= '0' && c <= '9'; });
      if (digit != bytes.end()) *digit = static_cast<uint8_t>('0' + below(random, 10));
      break;
    }
    default:
      bytes[static_cast<size_t>(at)] = bytes[1 + below(random, bytes.size() - 1)];
      break;
    }
  }
  return bytes;
}

void test_fuzz_files_corpus_is_read_or_refused(void** state) {
  (void)state;
  const auto files = corpus();
  assert_true(files.size() >= 10);
  for (const auto& path : files) {
    const Bytes bytes = bytes_of(path);
    const bool is_to_be_refused = path.filename().string().rfind("refused_", 0) == 0;
    if (fuzz_files::one(bytes.data(), bytes.size()) == is_to_be_refused)
      fail_msg("%s: %s", path.c_str(), fuzz_files::last_refusal);
  }
}

void test_fuzz_files_every_door_has_a_file(void** state) {
  (void)state;
  std::string doors;
  for (const auto& path : corpus()) doors += static_cast<char>(bytes_of(path).at(0));
  for (const char* door = fuzz_files::kDoors; *door != '\0'; ++door)
    assert_true(doors.find(*door) != std::string::npos);
}

// A failure aborts; the line that names it is printed by the check itself, the seed stands here.
void test_fuzz_files_mutations_are_read_or_refused(void** state) {
  (void)state;
  std::mt19937_64 random(1);
  long n_read = 0, n = 0;
  for (const auto& path : corpus()) {
    const Bytes bytes = bytes_of(path);
    for (int k = 0; k < kMutations; ++k, ++n) {
      const Bytes changed = mutated(bytes, &random);
      n_read += fuzz_files::one(changed.data(), changed.size()) ? 1 : 0;
    }
  }
  std::printf("fuzz_files: %ld mutations, %ld of them read, seed 1\n", n, n_read);
  assert_true(n_read > n / 50 && n_read < n - n / 50);
}

} // namespace

int main() {
  const CMUnitTest tests[] = {
      cmocka_unit_test(test_fuzz_files_corpus_is_read_or_refused),
      cmocka_unit_test(test_fuzz_files_every_door_has_a_file),
      cmocka_unit_test(test_fuzz_files_mutations_are_read_or_refused),
  };
  return cmocka_run_group_tests(tests, nullptr, nullptr);
}
