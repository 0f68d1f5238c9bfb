// SPDX-License-Identifier: MIT
// make soak: one flash written a million times with power cuts at random places, and ten million frames over a bad line.
// usage: soak [--commits N] [--frames N] [--seed N].  The last lines count; exit status 1 where anything was lost.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "link.h"
#include "torn/torn.h"

/* The table that a rollback of this flash would go back to; -1: it is refused. */
static int soak_rollback_target(const torn_nor_t* nor) {
  static torn_nor_t trial;
  trial = *nor;
  trial.steps_left = TORN_NOR_NEVER;
  return torn_act(&trial, TORN_ROLLBACK, 1, 0) == IMUCAL_OK ? torn_ruling(&trial, 1) : -1;
}

/* After OK the table that was written rules.  After a cut either rules, what might have ruled before or what was being written,
 * and from start to start another, until the next write or rollback is done; what is refused changes nothing.
 * allowed: bit m, the table with mark m; bit 0: none. */
static int soak_store(uint64_t seed, long n_commits) {
  static torn_nor_t nor;
  uint64_t n_cuts = 0, n_lost = 0, n_stuck = 0, n_done = 0, n_rollbacks = 0;
  uint64_t random = torn_nor_mix(seed), allowed = 1;
  torn_nor_init(&nor, torn_geometries[seed % TORN_GEOMETRIES]);
  nor.mode = TORN_NOR_PER_READ;
  nor.random = seed;
  for (long k = 0; k < n_commits; k++) {
    random = torn_nor_mix(random + 0x9E3779B97F4A7C15ULL);
    const int mark = 1 + (int)(k % 59), is_rollback = random % 16 == 0;
    const long n_units = IMUCAL_TABLE_BYTES(1) / (long)nor.geometry.unit_bytes + 6;
    const int is_cut = random >> 8 & 1;
    torn_nor_power_on(&nor);
    nor.mode = (random >> 40) % 3;
    nor.pattern = (int)(random >> 32 & 0xFF) % TORN_NOR_PATTERNS;
    nor.steps_left = is_cut ? (long)(random >> 16 & 0xFFFF) % (2 * n_units) : TORN_NOR_NEVER;
    const int before = torn_ruling(&nor, 1), target = is_rollback ? soak_rollback_target(&nor) : mark;
    const imucal_status status = torn_act(&nor, is_rollback ? TORN_ROLLBACK : TORN_WRITE, 1, mark);
    const int was_cut = nor.is_off;
    n_cuts += (uint64_t)was_cut, n_rollbacks += is_rollback && status == IMUCAL_OK;
    torn_nor_power_on(&nor);
    const int now = torn_ruling(&nor, 1);
    const int was_allowed = before >= 0 && (allowed >> before & 1);
    n_stuck += !is_rollback && !was_cut && status != IMUCAL_OK;
    if (status == IMUCAL_OK && !was_cut) allowed = is_rollback ? 1ull << (now < 0 ? 0 : now) : 1ull << mark;
    if (was_cut && target >= 0) allowed |= 1ull << target;
    const int is_good =
        was_allowed && now >= 0 && (allowed >> now & 1) && !(is_rollback && status == IMUCAL_OK && now == before);
    if (!is_good && n_lost++ < 5)
      fprintf(stderr, "soak: commit %ld of seed %llu: table %d rules after %d, status %d\n", k,
              (unsigned long long)seed, now, before, status);
    n_done += !is_rollback && status == IMUCAL_OK;
  }
  printf("soak: seed %llu, %ld commits, %llu done, %llu cut, %llu rollbacks, %u + %u erases; lost or wrong %llu, stuck "
         "%llu, rules of the "
         "flash broken %d\n",
         (unsigned long long)seed, n_commits, (unsigned long long)n_done, (unsigned long long)n_cuts,
         (unsigned long long)n_rollbacks, nor.n_erase[0], nor.n_erase[1], (unsigned long long)n_lost,
         (unsigned long long)n_stuck, nor.n_violations);
  return n_lost || n_stuck || nor.n_violations;
}

/* Frames over a line that changes, loses, doubles and invents bytes, in bursts of good and of bad weather. */
static int soak_line(uint64_t seed, long n_frames) {
  imucal_link_rx_t rx;
  imucal_link_rx_init(&rx);
  uint64_t random = torn_nor_mix(seed ^ 0x6C696E65u), n_touched = 0, n_lost = 0, n_wrong = 0, n_untouched_lost = 0,
           n_got = 0;
  uint32_t details[2] = {0, 0};
  int was_got[2] = {1, 1}, was_touched[2] = {0, 0};
  for (long k = 0; k < n_frames; k++) {
    uint8_t frame[IMUCAL_LINK_MAX_FRAME];
    random = torn_nor_mix(random + 0x9E3779B97F4A7C15ULL);
    const imucal_link_event_t event = {.counter = (uint16_t)k, .detail = (uint32_t)random};
    size_t len = 0;
    if (imucal_link_pack(IMUCAL_LINK_ID_EVENT, (uint8_t)k, &event, frame, sizeof frame, &len) != IMUCAL_OK) abort();
    const int at = (int)(k & 1);
    n_lost += k >= 2 && !was_got[at];
    n_untouched_lost += k >= 2 && !was_got[at] && !was_touched[at];
    details[at] = event.detail, was_got[at] = was_touched[at] = 0;
    const uint32_t rate = k / 1000 % 2 ? 20 : 2000;
    for (size_t i = 0; i < len; i++) {
      random = torn_nor_mix(random + 1);
      const uint32_t dice = (uint32_t)random % rate;
      const uint8_t noise = (uint8_t)(random >> 32),
                    bytes[2] = {dice == 0 ? noise : frame[i], dice == 2 ? frame[i] : noise};
      was_touched[at] |= dice <= 3;
      const int n = dice == 1 ? 0 : dice == 2 || dice == 3 ? 2 : 1;
      for (int b = 0; b < n; b++) {
        if (imucal_link_rx_put(&rx, bytes[b]) != IMUCAL_FRAME_READY) continue;
        imucal_link_any_t got;
        const int is_event =
            imucal_link_rx_message(&rx, &got) == IMUCAL_OK && imucal_link_rx_type(&rx) == IMUCAL_LINK_ID_EVENT;
        const int of = is_event ? got.event.counter & 1 : 0;
        if (!is_event || got.event.detail != details[of] || was_got[of])
          n_wrong++;
        else
          was_got[of] = 1, n_got++;
      }
    }
    n_touched += (uint64_t)was_touched[at];
  }
  printf("soak: seed %llu, %ld frames, %llu touched, %llu arrived, %llu lost; untouched and lost %llu, wrong bytes "
         "accepted %llu, lost more "
         "than touched %d\n",
         (unsigned long long)seed, n_frames, (unsigned long long)n_touched, (unsigned long long)n_got,
         (unsigned long long)n_lost, (unsigned long long)n_untouched_lost, (unsigned long long)n_wrong,
         n_lost > n_touched);
  return n_untouched_lost || n_wrong || n_lost > n_touched;
}

int main(int argc, char** argv) {
  uint64_t seed = 1;
  long n_commits = 1000000, n_frames = 10000000;
  for (int i = 1; i + 1 < argc; i += 2) {
    if (!strcmp(argv[i], "--seed")) seed = strtoull(argv[i + 1], NULL, 10);
    if (!strcmp(argv[i], "--commits")) n_commits = atol(argv[i + 1]);
    if (!strcmp(argv[i], "--frames")) n_frames = atol(argv[i + 1]);
  }
  int failed = 0;
  for (int g = 0; g < TORN_GEOMETRIES; g++)
    failed |= soak_store(seed * TORN_GEOMETRIES + (uint64_t)g, n_commits / TORN_GEOMETRIES);
  failed |= soak_line(seed, n_frames);
  return failed;
}
