// SPDX-License-Identifier: MIT
/* Purpose: who may change anything.  A host reads the challenge (STATE), sends it back with this device's serial number
 * (UNLOCK) and gets a token; each request that changes anything comes inside COMMAND with the token and a number that
 * grows.  So a frame that is late, doubled, recorded before the last start or meant for another device does nothing.
 * It is no secret: who reads the line can do the same (threat model in firmware/README.md).
 * Memory: this struct.  Thread: one context. */
#ifndef IMUCAL_APP_GUARD_H
#define IMUCAL_APP_GUARD_H
#include "link.h"

#if defined(__cplusplus)
extern "C" {
#endif

typedef struct imucal_app_guard {
  uint32_t challenge;     /* next UNLOCK must bring it */
  uint32_t token, number; /* of the running unlock; number of its newest command */
  uint64_t until_us;      /* end of the unlock */
  bool is_open;
} imucal_app_guard_t;

/* seed: unlike that of the last start (boot_id). */
void app_guard_init(imucal_app_guard_t* guard, uint32_t seed, uint64_t now_us);

/* Seconds left, rounded up; 0: locked. */
uint16_t app_guard_left_s(imucal_app_guard_t* guard, uint64_t now_us);

/* IMUCAL_OK: *reply holds the token; IMUCAL_ERR_STALE: another challenge; IMUCAL_ERR_SERIAL; IMUCAL_ERR_RANGE: seconds.
 * A refusal changes nothing. */
IMUCAL_MUST_USE imucal_status app_guard_unlock(imucal_app_guard_t* guard, const imucal_link_unlock_t* request,
                                               const char* serial, uint64_t now_us, imucal_link_unlock_reply_t* reply);

/* May a command with this token and number be done?  IMUCAL_ERR_STALE: another token (as from before the last start), or the
 * number came before, whether the unlock still lasts or not: it may have been done.  IMUCAL_ERR_LOCKED: the time of its
 * unlock is over; it was never done. */
IMUCAL_MUST_USE imucal_status app_guard_take(imucal_app_guard_t* guard, uint32_t token, uint32_t number,
                                             uint64_t now_us);

#if defined(__cplusplus)
}
#endif
#endif
