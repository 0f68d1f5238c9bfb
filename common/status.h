// SPDX-License-Identifier: MIT
/* Purpose: the one list of outcomes of the core, for callers, for the serial link (as int16) and for
 * messages. 0 is success, positive values inform, negative values are errors grouped by whose fault it is.
 * The numbers go over the wire and into logs: never change one, only add. */
#ifndef IMUCAL_STATUS_H
#define IMUCAL_STATUS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#if defined(__GNUC__)
#define IMUCAL_MUST_USE __attribute__((warn_unused_result))
#define IMUCAL_COLD __attribute__((cold))            /* runs rarely: to be small rather than fast */
#define IMUCAL_APART __attribute__((cold, noinline)) /* the same, and not to cost its caller registers */
#else
#define IMUCAL_MUST_USE
#define IMUCAL_COLD
#define IMUCAL_APART
#endif

/* A fact that the compiler checks; name: what holds, unique in its file.  C99 has no _Static_assert: where the condition
 * does not hold this is an array of negative size. */
#define IMUCAL_STATIC_ASSERT(name, condition) typedef char name[(condition) ? 1 : -1]

#define IMUCAL_MAX_CHANNELS 6 /* three gyros and three accelerometers */
#define IMUCAL_MAX_ORDER 5    /* highest power of the normalised temperature */
#define IMUCAL_MAX_COEFF (IMUCAL_MAX_ORDER + 1)

#if defined(__cplusplus)
extern "C" {
#endif

typedef enum imucal_status {
  IMUCAL_OK = 0,
  /* informative */
  IMUCAL_SECOND_READY = 1,   /* sum: a second is complete and was handed out */
  IMUCAL_FRAME_READY = 2,    /* link: a valid frame is complete */
  IMUCAL_FRAME_REPEATED = 3, /* link: this request was answered before; send the kept reply again */
  IMUCAL_SLOT_EMPTY = 4,     /* store: the slot is erased */
  IMUCAL_SLOT_REVOKED = 5,   /* store: the slot was rolled back */
  /* the caller's fault */
  IMUCAL_ERR_ARGUMENT = -1, /* null, zero size, index out of range */
  IMUCAL_ERR_STATE = -2,    /* called out of order: before init, commit before begin, no session */
  IMUCAL_ERR_SPACE = -3,    /* the buffer given is too small */
  IMUCAL_ERR_UNKNOWN = -4,  /* unknown message, channel or action */
  IMUCAL_ERR_BUSY = -5,     /* a session runs; stop it first */
  IMUCAL_ERR_LOCKED = -6,   /* changes something: needs UNLOCK and COMMAND */
  IMUCAL_ERR_STALE = -7,    /* an old challenge, token or command number */
  /* the data's fault */
  IMUCAL_ERR_RANGE = -16,       /* a value outside its documented range; input refused, state unchanged */
  IMUCAL_ERR_NOT_FINITE = -17,  /* NaN or infinity */
  IMUCAL_ERR_MAGIC = -18,       /* not a table at all */
  IMUCAL_ERR_VERSION = -19,     /* table or protocol of a version this code does not know */
  IMUCAL_ERR_LENGTH = -20,      /* length field, number of channels and bytes given disagree */
  IMUCAL_ERR_CRC = -21,         /* CRC-32 differs */
  IMUCAL_ERR_SERIAL = -22,      /* table of another device */
  IMUCAL_ERR_ORDER = -23,       /* polynomial order outside 1..IMUCAL_MAX_ORDER (or 0..2, scale factor) */
  IMUCAL_ERR_SPAN = -24,        /* temperature span reversed, empty, or outside t0 +- range */
  IMUCAL_ERR_COEFFICIENT = -25, /* coefficient not finite, too large, or not zero above the order */
  IMUCAL_ERR_NAME = -26,        /* name or serial: empty, not printable ASCII, without its unit, or twice */
  IMUCAL_ERR_SCALE = -27,       /* unit per count or degC per count: zero, negative or not finite */
  IMUCAL_ERR_SIGMA = -28,       /* one-sigma calibration error negative or not finite */
  IMUCAL_ERR_MODEL = -29,       /* error model: negative, not finite or out of a table's limits */
  IMUCAL_ERR_CHANNELS = -30,    /* number of channels outside 1..IMUCAL_MAX_CHANNELS, or not this device's */
  IMUCAL_ERR_PRECISION = -31,   /* the fixed-point form cannot hold this table within one LSB */
  IMUCAL_ERR_RESERVED = -32,    /* reserved byte not zero */
  IMUCAL_ERR_SYNC = -33,        /* sample feed: record without its marker */
  IMUCAL_ERR_PERIOD = -34,      /* a gap too long or time that runs backwards */
  /* the device's fault */
  IMUCAL_ERR_SENSOR = -48,     /* the sensor reports a fault or no data */
  IMUCAL_ERR_NO_TABLE = -49,   /* no valid table in any slot: running uncompensated */
  IMUCAL_ERR_NO_OTHER = -50,   /* rollback: there is no other valid table */
  IMUCAL_ERR_NOT_LEARNT = -51, /* the filter has no data or stopped: no table can be made of it */
  /* the link's fault */
  IMUCAL_ERR_FRAME = -64, /* frame malformed (COBS, too short) */
  IMUCAL_ERR_LOST = -65,  /* streamed records were dropped */
  /* storage's fault */
  IMUCAL_ERR_FLASH = -80,    /* the driver reports failure */
  IMUCAL_ERR_VERIFY = -81,   /* what was read back is not what was programmed */
  IMUCAL_ERR_COMMIT = -82,   /* slot without a (whole) commit word: a write was cut */
  IMUCAL_ERR_SEQUENCE = -83, /* sequence number not above the ruling one */
  IMUCAL_ERR_NO_MARK = -84,  /* rollback: no mark is left in flash to note it with */
  IMUCAL_ERR_SUPPLY = -85,   /* the supply is too low to erase or program the flash; the ruling table stands */
  IMUCAL_ERR_GEOMETRY = -86, /* program unit, page or slot size of the flash: no table can be kept there */
  IMUCAL_ERR_SLOTS = -87     /* writing one slot changed the other: they share a page or an address */
} imucal_status;

/* One sentence in plain words, lower case, without full stop; never null. */
const char* imucal_status_text(imucal_status status);

#if defined(__cplusplus)
}
#endif
#endif
