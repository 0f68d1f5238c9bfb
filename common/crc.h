// SPDX-License-Identifier: MIT
/* Purpose: CRC-32 (IEEE 802.3, reflected 0xEDB88320, start and end 0xFFFFFFFF): "123456789" -> 0xCBF43926.
 * 16-entry table, two look-ups per byte, 64 bytes of flash for it.  Used by tables and by the link. */
#ifndef IMUCAL_CRC_H
#define IMUCAL_CRC_H

#include "status.h"

#if defined(__cplusplus)
extern "C" {
#endif

/* CRC of len bytes. */
uint32_t imucal_crc32(const uint8_t* data, size_t len);

/* The same in pieces: start with IMUCAL_CRC_INIT, add, then invert with imucal_crc_end. */
#define IMUCAL_CRC_INIT 0xFFFFFFFFu
uint32_t imucal_crc_add(uint32_t running, const uint8_t* data, size_t len);
static inline uint32_t imucal_crc_end(uint32_t running) {
  return ~running;
}

#if defined(__cplusplus)
}
#endif
#endif
