// SPDX-License-Identifier: MIT
/* usage: check FEED      prints the bits of check_bits for the samples of this file (common/sample.h)
 *        check --profiles   prints those of check_profiles */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

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
  check_io_t io = {.sample = next_sample, .print = print};
  if (argc == 2 && !strcmp(argv[1], "--profiles")) {
    check_profiles(&io);
    return 0;
  }
  io.ctx = argc == 2 ? fopen(argv[1], "rb") : NULL;
  if (!io.ctx) {
    fprintf(stderr, "check: cannot read the feed; usage: check FEED | check --profiles\n");
    return 2;
  }
  check_bits(&io);
  return 0;
}
