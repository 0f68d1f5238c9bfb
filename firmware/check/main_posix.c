// SPDX-License-Identifier: MIT
/* usage: check FEED     prints the bits of check_bits for the samples of this file (common/sample.h) */
#include <stdio.h>
#include <stdlib.h>

#include "check.h"

static bool next_sample(void* ctx, bool is_rewound, imucal_sample_t* sample) {
  uint8_t record[IMUCAL_SAMPLE_RECORD_BYTES];
  if (is_rewound) rewind(ctx);
  if (fread(record, sizeof record, 1, ctx) != 1) return false;
  if (imucal_sample_decode(record, sample) == IMUCAL_OK) return true;
  fprintf(stderr, "check: not a sample record\n");
  exit(3);
}

static void print(void* ctx, const char* text) {
  (void)ctx;
  fputs(text, stdout);
}

int main(int argc, char** argv) {
  FILE* feed = argc == 2 ? fopen(argv[1], "rb") : NULL;
  if (!feed) {
    fprintf(stderr, "check: cannot read the feed; usage: check FEED\n");
    return 2;
  }
  const check_io_t io = {.ctx = feed, .sample = next_sample, .print = print};
  check_bits(&io);
  return 0;
}
