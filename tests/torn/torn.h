// SPDX-License-Identifier: MIT
// The store under power cuts: every start state, every action, cut inside every unit, then again from there.
// A case is a path: geometry, mode of torn cells, channels, start state, then cuts (action, step, pattern).  All that is
// random in it follows from the path and the seed, so that its one line repeats it.
#ifndef TESTS_TORN_TORN_H
#define TESTS_TORN_TORN_H
#include <stdio.h>
#include <stdlib.h>

#include "common/table_example.h"
#include "emu/torn_nor.h"

enum { TORN_WRITE, TORN_ROLLBACK, TORN_ERASE, TORN_ACTIONS };
enum { TORN_MAX_CUTS = 3, TORN_STARTS = 8, TORN_MAX_READS = 80, TORN_FINAL_MARK = 60 };

static const torn_nor_geometry_t torn_geometries[] = {
    {1024, 1024, 4},  // nRF51
    {1024, 512, 1},   // bytes, two pages a slot
    {1024, 256, 2},   // STM32F1: half words
    {2048, 2048, 8},  // STM32G4, L4: double words, ECC
    {4096, 1024, 16}, // STM32U5, H5: quad words, ECC
    {1024, 1024, 32}, // STM32H7: 256-bit words, in the smallest slot that holds six channels
#if IMUCAL_STORE_MAX_PROGRAM >= 256u
    {4096, 4096, 256}, // RP2040: pages of an SPI flash
#endif
};
enum { TORN_GEOMETRIES = sizeof torn_geometries / sizeof torn_geometries[0] };
static const char* const torn_mode_names[] = {"stable", "per read", "per start", "unreadable"};
static const char* const torn_action_names[] = {"write", "rollback", "erase"};

typedef struct {
  int action, pattern;
  long step;
} torn_cut_t;
typedef struct {
  uint64_t seed;
  int geometry, mode, channels, start, n_cuts;
  torn_cut_t cut[TORN_MAX_CUTS];
} torn_path_t;

typedef struct {
  uint64_t n_cuts[TORN_MAX_CUTS][TORN_ACTIONS], n_starts, n_commits; // n_cuts: by depth and action
  uint64_t n_none, n_wrong, n_stuck, n_slow, n_violations, n_origin; // failures
} torn_counts_t;

// A flash and what may rule on it: bit m: table with mark m; bit 0: none.
typedef struct {
  torn_nor_t nor;
  uint64_t allowed;
  int n_written, has_flips; // bits flipped at rest: the note of the origin may be lost
} torn_state_t;

static imucal_store_work_t torn_work;
static imucal_store_report_t torn_report;

// Mark of the ruling table, 0: none; -1: bytes that were never written.
static int torn_ruling(torn_nor_t* nor, int channels) {
  const imucal_flash_t flash = torn_nor_flash(nor);
  imucal_table_t table;
  const imucal_status status = imucal_store_load(&flash, "SN-17", (uint32_t)channels, &torn_work, &table, &torn_report);
  if (status == IMUCAL_ERR_NO_TABLE) return 0;
  if (status != IMUCAL_OK) return -1;
  const int mark = (int)(table.created_s - 1767225600u);
  imucal_table_t expected = example_table(channels, mark);
  expected.sequence = table.sequence;
  return mark > 0 && mark < 64 && memcmp(&table, &expected, sizeof table) == 0 ? mark : -1;
}

// The origin that a mark's table is written with, and the one to be found where the slot has room for it.
static uint8_t torn_origin(int mark) {
  return (uint8_t)(1 + mark * 37 % 255);
}
static int torn_is_origin(torn_nor_t* nor, const torn_path_t* path, int mark, int may_be_unknown) {
  const imucal_flash_t flash = torn_nor_flash(nor);
  const uint8_t noted = imucal_store_origin(&flash, &torn_report, (uint32_t)path->channels).noted;
  const int has_room = nor->geometry.slot_bytes > 1024 || nor->geometry.unit_bytes < 16 || path->channels < 6;
  return noted == (mark > 0 && has_room ? torn_origin(mark) : 0) || (may_be_unknown && noted == 0);
}

static imucal_status torn_act(torn_nor_t* nor, int action, int channels, int mark) {
  const imucal_flash_t flash = torn_nor_flash(nor);
  imucal_table_t table = example_table(channels, mark);
  switch (action) {
  case TORN_WRITE:
    return imucal_store_write(&flash, "SN-17", (uint32_t)channels, torn_origin(mark), &torn_work, &table, &torn_report);
  case TORN_ROLLBACK:
    return imucal_store_rollback(&flash, "SN-17", (uint32_t)channels, &torn_work, &table, &torn_report);
  default:
    return imucal_store_erase(&flash, &torn_work, &torn_report);
  }
}

static inline void torn_print(FILE* out, const torn_path_t* path) {
  fprintf(out, "%llu %d %d %d %d", (unsigned long long)path->seed, path->geometry, path->mode, path->channels,
          path->start);
  for (int i = 0; i < path->n_cuts; i++)
    fprintf(out, " %d %ld %d", path->cut[i].action, path->cut[i].step, path->cut[i].pattern);
  fprintf(out, "\n");
}
static void torn_fail(uint64_t* counter, const torn_path_t* path, const char* what, long value) {
  if (++*counter > 5) return;
  fprintf(stderr, "torn: %s (%ld); repeat: build/tests/torn/torn --case ", what, value);
  torn_print(stderr, path);
}

static uint64_t torn_hash(const torn_path_t* path) {
  uint64_t hash = torn_nor_mix(path->seed + 1);
  const int head[] = {path->geometry, path->mode, path->channels, path->start};
  for (int i = 0; i < 4; i++) hash = torn_nor_mix(hash * 31 + (uint64_t)head[i]);
  for (int i = 0; i < path->n_cuts; i++)
    hash = torn_nor_mix(hash * 31 + (uint64_t)path->cut[i].step * 64 +
                        (uint64_t)(path->cut[i].action * 8 + path->cut[i].pattern));
  return hash;
}

// The state before the first cut: 0 empty; 1 one table; 2 two; 3 two, rolled back; 4 that, one written over the revoked
// one; 5 rolled back a second time; 6 both erased; 7 two, and a third whose write failed half way.
static void torn_start(torn_state_t* s, const torn_path_t* path) {
  static const char* const scripts[TORN_STARTS] = {"", "w", "ww", "wwr", "wwrw", "wwrwr", "wwe", "wwf"};
  torn_nor_init(&s->nor, torn_geometries[path->geometry]);
  s->nor.mode = path->mode;
  s->n_written = s->has_flips = 0;
  for (const char* step = scripts[path->start]; *step; step++) {
    s->nor.fail_how = TORN_NOR_DOES_HALF;
    s->nor.n_calls = 0;
    s->nor.fail_at_call = *step == 'f' ? 3 : 0; // mark, erase, then the table's program
    const int action = *step == 'r' ? TORN_ROLLBACK : *step == 'e' ? TORN_ERASE : TORN_WRITE;
    const imucal_status status = torn_act(&s->nor, action, path->channels, action == TORN_WRITE ? s->n_written + 1 : 0);
    s->n_written += action == TORN_WRITE;
    if (status == IMUCAL_ERR_NO_MARK) continue; // the smallest slot notes one rollback: state 4 again
    if ((status == IMUCAL_OK) != (*step != 'f')) fprintf(stderr, "torn: start %d: %d\n", path->start, status), abort();
  }
  s->nor.fail_at_call = 0;
  s->allowed = 1ull << torn_ruling(&s->nor, path->channels);
  torn_nor_power_on(&s->nor);
}

// Start twice and load twice each time: always one of the allowed tables, in a bounded number of reads.
static int torn_check(torn_state_t* s, const torn_path_t* path, torn_counts_t* counts) {
  int is_good = 1;
  for (int boot = 0; boot < 2; boot++) {
    torn_nor_power_on(&s->nor);
    for (int load = 0; load < 2; load++) {
      s->nor.n_reads = 0;
      counts->n_starts++;
      const int mark = torn_ruling(&s->nor, path->channels);
      const int is_allowed = mark >= 0 && (s->allowed >> mark & 1);
      if (!is_allowed)
        is_good = 0,
        torn_fail(mark == 0 ? &counts->n_none : &counts->n_wrong, path, "not allowed to rule: table", mark);
      if (s->nor.n_reads > TORN_MAX_READS)
        is_good = 0, torn_fail(&counts->n_slow, path, "reads to load", (long)s->nor.n_reads);
      if (is_allowed && !torn_is_origin(&s->nor, path, mark, s->has_flips))
        is_good = 0, torn_fail(&counts->n_origin, path, "wrong origin of table", mark);
    }
  }
  if (s->nor.n_violations) is_good = 0, torn_fail(&counts->n_violations, path, s->nor.violation, s->nor.n_violations);
  return is_good;
}

// From here the next commit succeeds at the first attempt, and its table alone rules.
static int torn_check_commit(const torn_state_t* from, const torn_path_t* path, torn_counts_t* counts) {
  static torn_state_t s;
  s = *from;
  counts->n_commits++;
  const imucal_status status = torn_act(&s.nor, TORN_WRITE, path->channels, TORN_FINAL_MARK);
  if (status != IMUCAL_OK) {
    torn_fail(&counts->n_stuck, path, "the next commit fails", status);
    return 0;
  }
  s.allowed = 1ull << TORN_FINAL_MARK;
  return torn_check(&s, path, counts);
}

// May this be the answer with the power on?  A rollback may have nothing to go back to or no mark left.  It has one mark and
// no second choice: cells that read erased when it looked and not when it programs make it fail.
static int torn_is_answer(const torn_state_t* s, int action, imucal_status status) {
  if (status == IMUCAL_OK) return 1;
  if (action != TORN_ROLLBACK) return 0;
  return status == IMUCAL_ERR_NO_TABLE || status == IMUCAL_ERR_NO_OTHER || status == IMUCAL_ERR_NO_MARK ||
         s->nor.mode == TORN_NOR_PER_READ;
}

// What is to rule after the action, -1: it is refused.
static int torn_target(const torn_state_t* s, const torn_path_t* path, int action, torn_counts_t* counts) {
  static torn_nor_t trial;
  if (action == TORN_WRITE) return s->n_written + 1;
  if (action == TORN_ERASE) return 0;
  trial = s->nor;
  const imucal_status status = torn_act(&trial, TORN_ROLLBACK, path->channels, 0);
  if (!torn_is_answer(s, TORN_ROLLBACK, status)) torn_fail(&counts->n_stuck, path, "a rollback fails", status);
  if (trial.n_violations) torn_fail(&counts->n_violations, path, trial.violation, trial.n_violations);
  return status == IMUCAL_OK ? torn_ruling(&trial, path->channels) : -1;
}

// The last cut of the path, from `s`.  0: the action ended before its step (the path is one step too long).
static int torn_cut(torn_state_t* s, const torn_path_t* path, torn_counts_t* counts) {
  const torn_cut_t* cut = &path->cut[path->n_cuts - 1];
  s->nor.random = torn_hash(path);
  const int target = torn_target(s, path, cut->action, counts);
  if (target < 0) return 0;
  s->nor.steps_left = cut->step;
  s->nor.pattern = cut->pattern;
  s->nor.steps_used = 0;
  const imucal_status status = torn_act(&s->nor, cut->action, path->channels, target);
  if (!s->nor.is_off) {
    if (!torn_is_answer(s, cut->action, status))
      torn_fail(&counts->n_stuck, path, "an action fails with the power on", status);
    return 0;
  }
  counts->n_cuts[path->n_cuts - 1][cut->action]++;
  s->n_written += cut->action == TORN_WRITE;
  s->allowed |= 1ull << target;
  (void)torn_check(s, path, counts);
  (void)torn_check_commit(s, path, counts);
  (void)torn_target(s, path, TORN_ROLLBACK, counts); // from here a rollback is done or refused for a reason
  return 1;
}

// Cuts of every action at every step with every pattern; then from each state again, to depth max_cuts.
static inline void torn_everywhere(const torn_state_t* from, torn_path_t* path, int max_cuts, const int* patterns,
                                   int n_patterns, torn_counts_t* counts) {
  torn_state_t* s = (torn_state_t*)malloc(sizeof *s);
  torn_cut_t* cut = &path->cut[path->n_cuts++];
  for (cut->action = 0; cut->action < TORN_ACTIONS; cut->action++)
    for (int k = 0; k < n_patterns; k++) {
      cut->pattern = patterns[k];
      for (cut->step = 0;; cut->step++) {
        *s = *from;
        if (!torn_cut(s, path, counts)) break;
        if (path->n_cuts < max_cuts) torn_everywhere(s, path, max_cuts, patterns, n_patterns, counts);
      }
    }
  path->n_cuts--;
  free(s);
}

static inline uint64_t torn_n_cuts(const torn_counts_t* counts, int depth) {
  return counts->n_cuts[depth][0] + counts->n_cuts[depth][1] + counts->n_cuts[depth][2];
}
static inline uint64_t torn_n_failures(const torn_counts_t* counts) {
  return counts->n_none + counts->n_wrong + counts->n_stuck + counts->n_slow + counts->n_violations + counts->n_origin;
}

// n random paths of three cuts.
static inline void torn_sample(uint64_t seed, long n, int channels, torn_counts_t* counts) {
  torn_state_t* s = (torn_state_t*)malloc(sizeof *s);
  uint64_t random = torn_nor_mix(seed ^ 0x746F726Eu);
  for (long i = 0; i < n; i++) {
    random = torn_nor_mix(random + 0x9E3779B97F4A7C15ULL);
    torn_path_t path = {.seed = seed + (uint64_t)i,
                        .geometry = (int)(random % TORN_GEOMETRIES),
                        .mode = (int)(random >> 8 & 3),
                        .channels = channels,
                        .start = (int)(random >> 12 & 7)};
    torn_start(s, &path);
    for (int depth = 0; depth < TORN_MAX_CUTS; depth++) {
      random = torn_nor_mix(random + 0x9E3779B97F4A7C15ULL);
      const long n_units = IMUCAL_TABLE_BYTES(channels) / (long)s->nor.geometry.unit_bytes + 6;
      // Half of the cuts where it matters most: in the first and the last few steps, marks and pages.
      const long far = (long)(random >> 8) & 0xFFFF, step = random & 64    ? far % n_units
                                                            : random & 128 ? far % 6
                                                                           : n_units - far % 8;
      path.cut[path.n_cuts++] = (torn_cut_t){.action = (random & 7) < 5   ? TORN_WRITE
                                                       : (random & 7) < 7 ? TORN_ROLLBACK
                                                                          : TORN_ERASE,
                                             .pattern = (int)(random >> 32) % TORN_NOR_PATTERNS,
                                             .step = step < 0 ? 0 : step};
      if (path.cut[depth].pattern < 0) path.cut[depth].pattern += TORN_NOR_PATTERNS;
      const torn_state_t before = *s;
      if (torn_cut(s, &path, counts)) continue;
      *s = before; // the action ended first: another cut in its place
      path.n_cuts--, depth--;
    }
  }
  free(s);
}

// Bits flipped at rest in one slot of a start state, then a write cut at every step: a table that was whole rules.
static inline void torn_flips(uint64_t seed, int n_rounds, torn_counts_t* counts) {
  torn_state_t *s = (torn_state_t*)malloc(sizeof *s), *from = (torn_state_t*)malloc(sizeof *s);
  for (int round = 0; round < n_rounds; round++)
    for (int g = 0; g < TORN_GEOMETRIES; g++)
      for (int start = 2; start < 6; start++) {
        torn_path_t path = {
            .seed = seed + (uint64_t)round, .geometry = g, .mode = TORN_NOR_STABLE, .channels = 1, .start = start};
        torn_start(from, &path);
        uint64_t random = torn_hash(&path);
        const uint32_t slot = (uint32_t)random & 1;
        const int n_flips = 1 + (int)(random >> 1) % 3;
        const int was = torn_ruling(&from->nor, 1);
        const int is_hit = torn_report.ruling == (int8_t)slot,
                  has_other = torn_report.slot_status[1 - slot] == IMUCAL_OK;
        for (int i = 0; i < n_flips; i++) {
          random = torn_nor_mix(random + 1);
          from->nor.bytes[slot][(random >> 8) % from->nor.geometry.slot_bytes] ^= (uint8_t)(1 << (random & 7));
        }
        const int now = torn_ruling(&from->nor, 1);
        const int is_good = now == was || (is_hit && (has_other ? now > 0 : now == 0)) || (!is_hit && now == was);
        counts->n_starts++;
        if (!is_good) torn_fail(&counts->n_wrong, &path, "bits flipped at rest: rules", now);
        memset(from->nor.is_used, 0, sizeof from->nor.is_used); // flipped cells are not the store's doing
        memset(from->nor.is_torn, 1, sizeof from->nor.is_torn);
        from->allowed = 1ull << now;
        from->has_flips = 1;
        path.n_cuts = 1;
        for (path.cut[0] = (torn_cut_t){TORN_WRITE, (int)(random >> 16 & 3), 0};; path.cut[0].step++) {
          *s = *from;
          s->nor.mode = TORN_NOR_PER_READ;
          if (!torn_cut(s, &path, counts)) break;
        }
      }
  free(s), free(from);
}

// Every call of the driver in turn fails: reports it, or silently does nothing or half.  Done only where it is so.
static inline void torn_failures(uint64_t seed, torn_counts_t* counts, uint64_t* n_failed_calls) {
  torn_state_t *s = (torn_state_t*)malloc(sizeof *s), *from = (torn_state_t*)malloc(sizeof *s);
  for (int g = 0; g < TORN_GEOMETRIES; g++)
    for (int start = 0; start < TORN_STARTS; start++)
      for (int action = 0; action < TORN_ACTIONS; action++)
        for (int how = 0; how < 3; how++) {
          const torn_path_t path = {
              .seed = seed, .geometry = g, .mode = TORN_NOR_STABLE, .channels = 3, .start = start};
          torn_start(from, &path);
          const int target = torn_target(from, &path, action, counts);
          if (target < 0) continue;
          for (int call = 1;; call++) {
            *s = *from;
            s->nor.fail_how = how, s->nor.fail_at_call = call, s->nor.n_calls = 0;
            const imucal_status status = torn_act(&s->nor, action, 3, target);
            if (s->nor.n_calls < call) break;
            ++*n_failed_calls;
            s->nor.fail_at_call = 0;
            s->allowed = status == IMUCAL_OK ? 1ull << target : from->allowed | 1ull << target;
            // a read that fails once in the survey makes the slot look bad: its table is then the one overwritten
            (void)torn_check(s, &path, counts);
            (void)torn_check_commit(s, &path, counts);
          }
        }
  free(s), free(from);
}
#endif
