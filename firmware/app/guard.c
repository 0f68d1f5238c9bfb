// SPDX-License-Identifier: MIT
#include "guard.h"

#include "table.h"

/* Every bit of the input moves half of the output's (Steele, Lea and Flood's finaliser, 32 bits). */
static uint32_t mix(uint32_t x) {
  x = (x ^ x >> 16) * 0x7FEB352Du;
  x = (x ^ x >> 15) * 0x846CA68Bu;
  return x ^ x >> 16;
}

/* Another value each time, unlike the one before the last start. */
static uint32_t fresh(const imucal_app_guard_t* guard, uint64_t now_us) {
  return mix(guard->challenge + 0x9E3779B9u) ^ mix((uint32_t)now_us ^ (uint32_t)(now_us >> 32));
}

void app_guard_init(imucal_app_guard_t* guard, uint32_t seed, uint64_t now_us) {
  *guard = (imucal_app_guard_t){.challenge = mix(seed)};
  guard->challenge = fresh(guard, now_us);
}

uint16_t app_guard_left_s(imucal_app_guard_t* guard, uint64_t now_us) {
  if (now_us >= guard->until_us) guard->is_open = false;
  return guard->is_open ? (uint16_t)((guard->until_us - now_us + 999999u) / 1000000u) : 0;
}

imucal_status app_guard_unlock(imucal_app_guard_t* guard, const imucal_link_unlock_t* request, const char* serial,
                               uint64_t now_us, imucal_link_unlock_reply_t* reply) {
  if (request->challenge != guard->challenge) return IMUCAL_ERR_STALE;
  if (!imucal_text_equal(request->serial, serial, IMUCAL_SERIAL_LEN)) return IMUCAL_ERR_SERIAL;
  if (request->seconds < 1 || request->seconds > IMUCAL_LINK_MAX_UNLOCK_S) return IMUCAL_ERR_RANGE;
  guard->token = fresh(guard, now_us);
  guard->challenge = mix(guard->token);
  guard->number = 0;
  guard->until_us = now_us + (uint64_t)request->seconds * 1000000u;
  guard->is_open = true;
  *reply = (imucal_link_unlock_reply_t){.token = guard->token, .seconds = request->seconds};
  return IMUCAL_OK;
}

imucal_status app_guard_take(imucal_app_guard_t* guard, uint32_t token, uint32_t number, uint64_t now_us) {
  /* This first: LOCKED tells the host to send the command once more, and this one may have been done. */
  if (token != guard->token || number <= guard->number) return IMUCAL_ERR_STALE;
  if (app_guard_left_s(guard, now_us) == 0) return IMUCAL_ERR_LOCKED;
  guard->number = number;
  return IMUCAL_OK;
}
