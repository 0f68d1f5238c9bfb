// SPDX-License-Identifier: MIT
#include "status.h"

/* A switch and not an array: the compiler finds a status without words. */
#define TEXT(status, words)                                                                                            \
  case status:                                                                                                         \
    return words

const char* imucal_status_text(imucal_status status) {
  switch (status) {
    TEXT(IMUCAL_OK, "ok");
    TEXT(IMUCAL_SECOND_READY, "a second is complete");
    TEXT(IMUCAL_FRAME_READY, "a frame is complete");
    TEXT(IMUCAL_FRAME_REPEATED, "request repeated, answered again");
    TEXT(IMUCAL_SLOT_EMPTY, "slot is empty");
    TEXT(IMUCAL_SLOT_REVOKED, "slot was rolled back");
    TEXT(IMUCAL_ERR_ARGUMENT, "bad argument");
    TEXT(IMUCAL_ERR_STATE, "not possible in this state");
    TEXT(IMUCAL_ERR_SPACE, "too long for its buffer");
    TEXT(IMUCAL_ERR_UNKNOWN, "unknown message, channel or action");
    TEXT(IMUCAL_ERR_BUSY, "busy: a calibration runs");
    TEXT(IMUCAL_ERR_LOCKED, "locked: unlock the device first");
    TEXT(IMUCAL_ERR_STALE, "old or foreign request: its token or number is not the newest");
    TEXT(IMUCAL_ERR_RANGE, "value out of range");
    TEXT(IMUCAL_ERR_NOT_FINITE, "value is not finite");
    TEXT(IMUCAL_ERR_MAGIC, "not a table");
    TEXT(IMUCAL_ERR_VERSION, "unknown version");
    TEXT(IMUCAL_ERR_LENGTH, "length does not fit");
    TEXT(IMUCAL_ERR_CRC, "wrong CRC");
    TEXT(IMUCAL_ERR_SERIAL, "serial of another device");
    TEXT(IMUCAL_ERR_ORDER, "polynomial order out of range");
    TEXT(IMUCAL_ERR_SPAN, "temperature span reversed, empty, outside t0 +- range or its limits");
    TEXT(IMUCAL_ERR_COEFFICIENT, "coefficient not finite, too large, or beyond the order");
    TEXT(IMUCAL_ERR_NAME, "name or serial empty, not printable, without its unit, or twice");
    TEXT(IMUCAL_ERR_SCALE, "scale zero, negative, not finite or out of its limits");
    TEXT(IMUCAL_ERR_SIGMA, "calibration error negative or not finite");
    TEXT(IMUCAL_ERR_MODEL, "error model out of its limits");
    TEXT(IMUCAL_ERR_CHANNELS, "wrong number of channels");
    TEXT(IMUCAL_ERR_PRECISION,
         "fixed point cannot hold this table within one LSB (thermometer, range or coefficients)");
    TEXT(IMUCAL_ERR_RESERVED, "reserved byte is not zero");
    TEXT(IMUCAL_ERR_SYNC, "sample record without its marker");
    TEXT(IMUCAL_ERR_PERIOD, "time stands still or runs backwards");
    TEXT(IMUCAL_ERR_SENSOR, "sensor fault or no data");
    TEXT(IMUCAL_ERR_NO_TABLE, "no valid table, running uncompensated");
    TEXT(IMUCAL_ERR_NO_OTHER, "no other valid table to go back to");
    TEXT(IMUCAL_ERR_NOT_LEARNT, "nothing learnt yet");
    TEXT(IMUCAL_ERR_FRAME, "malformed frame");
    TEXT(IMUCAL_ERR_LOST, "records were lost");
    TEXT(IMUCAL_ERR_FLASH, "flash failed");
    TEXT(IMUCAL_ERR_VERIFY, "flash does not hold what was programmed");
    TEXT(IMUCAL_ERR_COMMIT, "write was cut before its commit");
    TEXT(IMUCAL_ERR_SEQUENCE, "sequence number too small or used up");
    TEXT(IMUCAL_ERR_NO_MARK, "no mark is left to note this rollback; flash the older table instead");
    TEXT(IMUCAL_ERR_SUPPLY, "the supply is too low to erase or program the flash");
    TEXT(IMUCAL_ERR_GEOMETRY, "program unit, page or slot size of the flash cannot hold tables");
    TEXT(IMUCAL_ERR_SLOTS, "writing one table slot changed the other: they share a page or an address");
  }
  return "unknown status";
}
