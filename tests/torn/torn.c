// SPDX-License-Identifier: MIT
// make torn: power cuts in the store, everywhere and again.  usage: torn [--seed N] [--three N] | --case NUMBERS
// The last line counts; exit status 1 where anything was lost.
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "torn/torn.h"

static torn_state_t state;

static int replay(int argc, char** argv) {
  torn_path_t path = {0};
  torn_counts_t counts = {0};
  long numbers[5 + 3 * TORN_MAX_CUTS] = {0};
  const int n = argc < (int)(sizeof numbers / sizeof *numbers) ? argc : (int)(sizeof numbers / sizeof *numbers);
  for (int i = 0; i < n; i++) numbers[i] = atol(argv[i]);
  path.seed = (uint64_t)strtoull(argv[0], NULL, 10);
  path.geometry = (int)numbers[1], path.mode = (int)numbers[2], path.channels = (int)numbers[3],
  path.start = (int)numbers[4];
  torn_start(&state, &path);
  for (int i = 5; i + 2 < n; i += 3) {
    path.cut[path.n_cuts++] =
        (torn_cut_t){.action = (int)numbers[i], .step = numbers[i + 1], .pattern = (int)numbers[i + 2]};
    const int was_cut = torn_cut(&state, &path, &counts);
    printf("%s cut in step %ld, pattern %d: %s; ruling slot %d, slots %d %d\n", torn_action_names[numbers[i]],
           numbers[i + 1], (int)numbers[i + 2], was_cut ? "cut" : "ended before", torn_report.ruling,
           torn_report.slot_status[0], torn_report.slot_status[1]);
  }
  return torn_n_failures(&counts) != 0;
}

static void report(const char* what, torn_counts_t* total, const torn_counts_t* c, clock_t begin) {
  printf("%-44s", what);
  for (int depth = 0; depth < TORN_MAX_CUTS; depth++) printf(" %9llu", (unsigned long long)torn_n_cuts(c, depth));
  printf(" %10llu starts %6.1f s\n", (unsigned long long)c->n_starts, (double)(clock() - begin) / CLOCKS_PER_SEC);
  uint64_t* to = (uint64_t*)total;
  for (size_t i = 0; i < sizeof *c / sizeof *to; i++) to[i] += ((const uint64_t*)c)[i];
  fflush(stdout);
}

int main(int argc, char** argv) {
  uint64_t seed = 1;
  long n_three = 100000;
  for (int i = 1; i + 1 < argc; i += 2) {
    if (!strcmp(argv[i], "--case")) return replay(argc - i - 1, argv + i + 1);
    if (!strcmp(argv[i], "--seed")) seed = strtoull(argv[i + 1], NULL, 10);
    if (!strcmp(argv[i], "--three")) n_three = atol(argv[i + 1]);
  }
  torn_counts_t total = {0};
  printf("%-44s %9s %9s %9s\n", "cuts at depth", "1", "2", "3");
  static const int all[] = {0, 1, 2, 3, 4, 5};
  for (int mode = 0; mode < TORN_NOR_MODES; mode++) { // depth one: one, three and six channels, every pattern
    torn_counts_t counts = {0};
    const clock_t begin = clock();
    for (int g = 0; g < TORN_GEOMETRIES; g++)
      for (int start = 0; start < TORN_STARTS; start++)
        for (int channels = 1; channels <= 6; channels += channels == 1 ? 2 : 3) {
          torn_path_t path = {.seed = seed, .geometry = g, .mode = mode, .channels = channels, .start = start};
          torn_start(&state, &path);
          torn_everywhere(&state, &path, 1, all, TORN_NOR_PATTERNS, &counts);
        }
    char what[80];
    snprintf(what, sizeof what, "once, torn cells %s", torn_mode_names[mode]);
    report(what, &total, &counts, begin);
  }
  for (int mode = 0; mode < TORN_NOR_MODES; mode++) { // depth two in full: every step of both, one channel
    static const int two[] = {TORN_NOR_ALL_WAVER, TORN_NOR_MIXED};
    torn_counts_t counts = {0};
    const clock_t begin = clock();
    for (int g = 0; g < TORN_GEOMETRIES; g++) {
      if (torn_geometries[g].unit_bytes < 4) continue; // the same marks as with 4, more steps inside the table
      for (int start = 0; start < TORN_STARTS; start++) {
        torn_path_t path = {.seed = seed, .geometry = g, .mode = mode, .channels = 1, .start = start};
        torn_start(&state, &path);
        torn_everywhere(&state, &path, 2, two, 2, &counts);
      }
    }
    char what[80];
    snprintf(what, sizeof what, "twice, torn cells %s", torn_mode_names[mode]);
    report(what, &total, &counts, begin);
  }
  torn_counts_t counts = {0};
  clock_t begin = clock();
  torn_sample(seed, n_three, 1, &counts);
  report("three times, sampled", &total, &counts, begin);
  memset(&counts, 0, sizeof counts), begin = clock();
  torn_flips(seed, 100, &counts);
  report("bits flipped at rest, then once", &total, &counts, begin);
  memset(&counts, 0, sizeof counts), begin = clock();
  uint64_t n_failed_calls = 0;
  torn_failures(seed, &counts, &n_failed_calls);
  report("driver fails, loudly and silently", &total, &counts, begin);
  const uint64_t n_cuts = torn_n_cuts(&total, 0) + torn_n_cuts(&total, 1) + torn_n_cuts(&total, 2);
  printf("torn: seed %llu, %llu cuts (%llu once, %llu twice, %llu three times), %llu failed calls, %llu starts, %llu "
         "next commits; "
         "no table %llu, wrong table %llu, wrong origin %llu, stuck %llu, too many reads %llu, rules of the flash "
         "broken %llu\n",
         (unsigned long long)seed, (unsigned long long)n_cuts, (unsigned long long)torn_n_cuts(&total, 0),
         (unsigned long long)torn_n_cuts(&total, 1), (unsigned long long)torn_n_cuts(&total, 2),
         (unsigned long long)n_failed_calls, (unsigned long long)total.n_starts, (unsigned long long)total.n_commits,
         (unsigned long long)total.n_none, (unsigned long long)total.n_wrong, (unsigned long long)total.n_origin,
         (unsigned long long)total.n_stuck, (unsigned long long)total.n_slow, (unsigned long long)total.n_violations);
  return torn_n_failures(&total) != 0;
}
