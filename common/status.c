// SPDX-License-Identifier: MIT
#include "status.h"

const char* imucal_status_text(imucal_status status) {
  switch (status) {
  case IMUCAL_OK:
    return "ok";
  case IMUCAL_SECOND_READY:
    return "a second is complete";
  case IMUCAL_FRAME_READY:
    return "a frame is complete";
  case IMUCAL_FRAME_REPEATED:
    return "request repeated, answered again";
  case IMUCAL_SLOT_EMPTY:
    return "slot is empty";
  case IMUCAL_SLOT_REVOKED:
    return "slot was rolled back";
  case IMUCAL_ERR_ARGUMENT:
    return "bad argument";
  case IMUCAL_ERR_STATE:
    return "not possible in this state";
  case IMUCAL_ERR_SPACE:
    return "too long for its buffer";
  case IMUCAL_ERR_UNKNOWN:
    return "unknown message, channel or action";
  case IMUCAL_ERR_BUSY:
    return "busy: a calibration runs";
  case IMUCAL_ERR_LOCKED:
    return "locked: unlock the device first";
  case IMUCAL_ERR_STALE:
    return "old or foreign request: its token or number is not the newest";
  case IMUCAL_ERR_RANGE:
    return "value out of range";
  case IMUCAL_ERR_NOT_FINITE:
    return "value is not finite";
  case IMUCAL_ERR_MAGIC:
    return "not a table";
  case IMUCAL_ERR_VERSION:
    return "unknown version";
  case IMUCAL_ERR_LENGTH:
    return "length does not fit";
  case IMUCAL_ERR_CRC:
    return "wrong CRC";
  case IMUCAL_ERR_SERIAL:
    return "serial of another device";
  case IMUCAL_ERR_ORDER:
    return "polynomial order out of range";
  case IMUCAL_ERR_SPAN:
    return "temperature span reversed, empty or outside t0 +- range";
  case IMUCAL_ERR_COEFFICIENT:
    return "coefficient not finite, too large, or beyond the order";
  case IMUCAL_ERR_NAME:
    return "name or serial empty or not printable";
  case IMUCAL_ERR_SCALE:
    return "scale zero, negative or not finite";
  case IMUCAL_ERR_SIGMA:
    return "calibration error negative or not finite";
  case IMUCAL_ERR_MODEL:
    return "error model negative or not finite";
  case IMUCAL_ERR_CHANNELS:
    return "wrong number of channels";
  case IMUCAL_ERR_PRECISION:
    return "fixed point cannot hold this table within one LSB";
  case IMUCAL_ERR_RESERVED:
    return "reserved byte is not zero";
  case IMUCAL_ERR_SYNC:
    return "sample record without its marker";
  case IMUCAL_ERR_PERIOD:
    return "time stands still or runs backwards";
  case IMUCAL_ERR_SENSOR:
    return "sensor fault or no data";
  case IMUCAL_ERR_NO_TABLE:
    return "no valid table, running uncompensated";
  case IMUCAL_ERR_NO_OTHER:
    return "no other valid table to go back to";
  case IMUCAL_ERR_NOT_LEARNT:
    return "nothing learnt yet";
  case IMUCAL_ERR_FRAME:
    return "malformed frame";
  case IMUCAL_ERR_LOST:
    return "records were lost";
  case IMUCAL_ERR_FLASH:
    return "flash failed";
  case IMUCAL_ERR_VERIFY:
    return "flash does not hold what was programmed";
  case IMUCAL_ERR_COMMIT:
    return "write was cut before its commit";
  case IMUCAL_ERR_SEQUENCE:
    return "sequence number too small or used up";
  case IMUCAL_ERR_NO_MARK:
    return "the older table was rolled back to too often; flash it instead";
  }
  return "unknown status";
}
