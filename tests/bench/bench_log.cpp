// SPDX-License-Identifier: MIT
// Processor time of reading a log: whole into memory, and on an even grid as dp and errormodel read it.  The reference of
// the same process is one pass over the bytes that counts line ends: what the memory allows.
// usage: bench_log LOG.csv [REPEATS]; JSON on standard output.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <iostream>

#include "analysis/dp/series.h"
#include "io/input.h"
#include "io/json_file.h"
#include "io/log.h"

using namespace imucal;

template <typename F> static double best_s(int repeats, F f) {
  double best = 1e300;
  for (int k = 0; k < repeats; ++k) {
    const std::clock_t start = std::clock();
    f();
    best = std::min(best, static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC);
  }
  return best;
}

// Bytes through the same door, their line ends counted.
static long count_lines(const std::string& path) {
  Input in(path);
  std::vector<char> piece(size_t{1} << 19);
  long lines = 0;
  for (size_t n = 0; (n = in.read(piece.data(), piece.size())) > 0;)
    lines += std::count(piece.data(), piece.data() + n, '\n');
  return lines;
}

int main(int argc, char** argv) {
  if (argc < 2) {
    std::fprintf(stderr, "usage: bench_log LOG.csv [REPEATS]\n");
    return 2;
  }
  const std::string path = argv[1];
  const int repeats = argc > 2 ? std::atoi(argv[2]) : 5;
  Json json;
  json["rows"] = read_log(path).size();
  json["bytes"] = Input(path).size();
  long lines = 0;
  json["count_lines_s"] = best_s(repeats, [&] { lines += count_lines(path); });
  json["lines"] = lines / repeats;
  json["read_log_s"] = best_s(repeats, [&] { read_log(path); });
  json["load_series_s"] = best_s(repeats, [&] { load_series(path, {}, true); });
  std::cout << json.dump() << "\n";
  return 0;
}
