// SPDX-License-Identifier: MIT
/* Purpose: the serial link between device and host: frames, and one table of messages for both ends.
 *
 * Frame on the wire:  COBS( type u8 | sequence u8 | payload | CRC-32 of all before, little-endian )  0x00
 * Before COBS at most IMUCAL_LINK_MAX_RAW bytes, so that COBS adds one byte; 0x00 occurs only as the
 * delimiter: after noise the receiver is in step again at the next one.  Frames are sent with a 0x00 before them too, so
 * that a hit delimiter costs the frame it ends and not the next one: frames lost <= frames touched.
 *
 * Types: 0x01..0x3F requests of the host; 0x80 + request: the reply, with the same sequence number; 0x40..0x7F
 * streamed records of the device, each stream with its own running counter.  A request that fails, or that has
 * nothing to tell, is answered by DONE.  A request repeated with the same sequence and the same bytes is answered
 * again from the kept reply and not done again (imucal_link_server_*): the host may repeat after a time-out.
 * A request that changes anything (imucal_link_is_guarded) goes inside COMMAND, with a token that UNLOCK gave and a
 * number that grows: what is old, doubled or meant for another device is not executed.
 * A released message never changes; new ones are added.  Documentation: link.md, checked against this table. */
#ifndef IMUCAL_LINK_H
#define IMUCAL_LINK_H

#include "status.h"

#if defined(__cplusplus)
extern "C" {
#endif

#define IMUCAL_LINK_PROTOCOL 2
#define IMUCAL_LINK_MAX_PAYLOAD 240
#define IMUCAL_LINK_MAX_RAW (2 + IMUCAL_LINK_MAX_PAYLOAD + 4)
#define IMUCAL_LINK_MAX_FRAME (IMUCAL_LINK_MAX_RAW + 3) /* COBS adds at most 1, delimiter before and after */
#define IMUCAL_LINK_MAX_DATA 200                        /* bytes of a table per message */
#define IMUCAL_LINK_REPLY 0x80

/* The message table.  Fields:  F(type, name, unit)             one value
 *                              A(type, name, n, unit)          fixed array; chr: text padded with 0
 *                              N(name, unit)                   u8: number of elements of the V arrays that follow
 *                              V(type, name, max, unit)        array of that many elements
 * Types: u8 u16 u32 u64 i16 i32 f32 chr.  On the wire little-endian in this order, without padding. */
#define IMUCAL_LINK_HELLO(F, A, N, V)                                                                                  \
  F(u8, protocol, "highest protocol version the host speaks")                                                          \
  F(u32, nonce, "any; makes the first request of a host unlike that of another")
#define IMUCAL_LINK_HELLO_REPLY(F, A, N, V)                                                                            \
  F(u8, protocol, "version the device speaks")                                                                         \
  F(u32, nonce, "as in the request")                                                                                   \
  A(chr, device, 24, "name of board or port")                                                                          \
  A(chr, firmware, 16, "version")                                                                                      \
  A(chr, serial, 16, "device serial, as in its tables")                                                                \
  F(u8, n_channels, "1..6")                                                                                            \
  F(f32, rate_hz, "nominal samples per second")                                                                        \
  F(u16, max_payload, "bytes")                                                                                         \
  F(u32, boot_id, "differs after a restart (reset cause, random, or count of boots)")
#define IMUCAL_LINK_INFO(F, A, N, V) F(u8, reserved, "0")
#define IMUCAL_LINK_INFO_REPLY(F, A, N, V)                                                                             \
  F(u64, uptime_us, "us")                                                                                              \
  F(i16, table_status, "0: a table rules; else why not (imucal_status)")                                               \
  F(u8, ruling_slot, "0, 1; 255: none")                                                                                \
  F(u32, sequence, "of the ruling table; 0: none")                                                                     \
  A(i16, slot_status, 2, "imucal_status of each slot")                                                                 \
  A(u32, slot_sequence, 2, "sequence number in each slot, 0: unreadable")                                              \
  F(u16, table_bytes, "length of the ruling table; 0: none")                                                           \
  F(u8, session, "0 idle, 1 calibrating, 2 stopped and kept, 3 sensor ended while calibrating")                        \
  F(u8, calibrating, "bit i: channel i has a filter")                                                                  \
  F(u32, t_s, "end of the newest second")                                                                              \
  F(u8, stream_what, "as in STREAM")                                                                                   \
  F(u8, stream_channels, "as in STREAM")
#define IMUCAL_LINK_COUNTERS(F, A, N, V) F(u8, reserved, "0")
#define IMUCAL_LINK_COUNTERS_REPLY(F, A, N, V)                                                                         \
  F(u32, rx_frames, "valid frames received")                                                                           \
  F(u32, rx_crc, "frames with a wrong CRC")                                                                            \
  F(u32, rx_resync, "malformed or cut frames")                                                                         \
  F(u32, rx_overflow, "frames too long")                                                                               \
  F(u32, rx_unknown, "frames of unknown type or with a payload that does not fit it")                                  \
  F(u32, rx_repeated, "requests answered again from the kept reply")                                                   \
  F(u32, tx_dropped, "streamed records dropped because the line was full")                                             \
  F(u32, samples, "samples delivered by the sensor (SAMPLES: what became of them)")                                    \
  F(u32, duplicates, "samples with the time stamp of the one before")                                                  \
  F(u32, backward, "samples older than the newest")                                                                    \
  F(u32, jumps, "times at least one whole second was missing")                                                         \
  F(u32, feed_errors, "records of the sensor that could not be read, and samples refused")                             \
  F(u32, seconds, "seconds finished")                                                                                  \
  F(u32, gaps, "seconds with fewer than half of their samples")                                                        \
  F(u32, filter_refused, "filter inputs refused")                                                                      \
  F(u32, watchdog_resets, "restarts by the watchdog")
#define IMUCAL_LINK_CHANNEL_INFO(F, A, N, V) F(u8, channel, "0..n_channels-1")
#define IMUCAL_LINK_CHANNEL_INFO_REPLY(F, A, N, V)                                                                     \
  F(u8, channel, "as in the request")                                                                                  \
  A(chr, name, 12, "with its unit: gx_dph, ax_mg")                                                                     \
  F(f32, unit_per_count, "unit of the channel per count")                                                              \
  F(i32, full_scale_counts, "largest |counts|")                                                                        \
  F(u8, is_compensated, "1: the ruling table has a bias or scale factor for it")                                       \
  F(u8, out_frac_bits, "LSB of compensated samples = 2^-this counts")                                                  \
  F(f32, degc_per_count, "degC per count of the thermometer")                                                          \
  F(f32, degc_at_zero, "degC at count 0")
#define IMUCAL_LINK_STREAM(F, A, N, V)                                                                                 \
  F(u8, what, "bits: 1 SECOND, 2 INNOVATION, 4 PROGRESS, 8 EVENT; 0 stops")                                            \
  F(u8, channels, "bit i: INNOVATION of channel i; SECOND always carries all")                                         \
  F(u16, period_s, "PROGRESS every so many seconds of sensor time, >= 1")
#define IMUCAL_LINK_STATE(F, A, N, V) F(u8, reserved, "0")
#define IMUCAL_LINK_STATE_REPLY(F, A, N, V)                                                                            \
  F(u32, challenge, "to be given back in UNLOCK; another one after each UNLOCK and each start")                        \
  F(u16, unlocked_s, "seconds until the unlock ends; 0: locked")                                                       \
  F(u32, table_crc, "CRC-32 at the end of the ruling table; 0: none")                                                  \
  F(u32, table_created_s, "s since 1970-01-01 UTC, of the ruling table")                                               \
  F(u8, table_origin,                                                                                                  \
    "0 none, 1 not noted with the table, 2 of the filters of this device, 3 of a host, 4 rolled back to")              \
  F(u32, silence_s, "a calibration that hears nothing from a host for so long stops and keeps its filters")            \
  F(u32, refused_locked, "requests refused because they need COMMAND and an unlock")                                   \
  F(u32, refused_stale, "commands and unlocks refused: old token, number or challenge")                                \
  F(u32, refused_unlock, "unlocks refused: serial number of another device, or time out of range")                     \
  F(u32, refused_busy, "requests refused because a calibration runs")                                                  \
  F(u32, refused_reserved, "requests refused because a reserved field is not 0")                                       \
  F(u32, refused_table, "tables refused: serial, CRC, a field out of its limits, another board")                       \
  F(u32, flash_failed, "writes, rollbacks and erases that the flash did not take")                                     \
  F(u32, sessions_silent, "calibrations stopped because no host was heard")
#define IMUCAL_LINK_SAMPLES(F, A, N, V) F(u8, reserved, "0")
#define IMUCAL_LINK_SAMPLES_REPLY(F, A, N, V)                                                                          \
  F(u32, samples, "delivered by the sensor since the start; never set back, as all of these")                          \
  F(u32, summed, "of them in a second")                                                                                \
  F(u32, duplicates, "left out: time stamp of the one before")                                                         \
  F(u32, behind, "left out: time stamp older than the newest")                                                         \
  F(u32, ahead, "left out: time stamp far ahead of the one before, and the next did not agree")                        \
  F(u32, refused, "left out: other channels than the board's, time out of range, too many in a second")                \
  F(u32, unreadable, "records of the sensor that could not be read; not in samples")                                   \
  F(u32, clock_set, "times the sensor's clock was set back and followed")                                              \
  F(u32, clock_wrapped, "times it began anew at 0 by its width of 32 bits")                                            \
  F(u32, jumps, "times at least one whole second was missing")                                                         \
  F(u32, seconds, "seconds finished")                                                                                  \
  F(u32, gaps, "of them with fewer than half of their samples")
#define IMUCAL_LINK_SENSOR(F, A, N, V) F(u8, reserved, "0")
#define IMUCAL_LINK_SENSOR_REPLY(F, A, N, V)                                                                           \
  F(u8, is_counted, "1: this board counts what follows; 0: it cannot, and all of it is 0")                             \
  A(chr, name, 16, "of the driver")                                                                                    \
  F(i16, status, "imucal_status of the newest start or read")                                                          \
  F(u8, identity, "what the chip says it is (WHO_AM_I)")                                                               \
  F(u32, starts, "times the driver was started; never set back, as all of these")                                      \
  F(u32, wrong_identity, "another chip answered")                                                                      \
  F(u32, bus_errors, "transfers that failed, or an answer no sensor gives: all zeros, all ones")                       \
  F(u32, overruns, "times the FIFO was full before it was read")                                                       \
  F(u32, lost, "samples lost in overruns, gaps and resets, by the clock")                                              \
  F(u32, invalid, "packets refused: header, tag, parity or the sensor's own mark")                                     \
  F(u32, resets, "times the sensor had reset itself")                                                                  \
  F(u32, stuck_temp, "times the temperature word stood still for too long")                                            \
  F(u32, stuck_data, "times all other words stood still")                                                              \
  F(u32, supply_refused, "erases and programs of the flash refused because the supply was too low")                    \
  F(u32, saturated, "samples with a channel at its rail")                                                              \
  F(f32, drift_ppm, "sensor's clock against the board's, positive: fast")                                              \
  F(u8, is_supply_low, "1: too low to program the flash now")
#define IMUCAL_LINK_UNLOCK(F, A, N, V)                                                                                 \
  F(u32, challenge, "of the newest STATE_REPLY")                                                                       \
  A(chr, serial, 16, "must be this device's")                                                                          \
  F(u16, seconds, "1..600: the token is good for so long")
#define IMUCAL_LINK_UNLOCK_REPLY(F, A, N, V)                                                                           \
  F(u32, token, "for COMMAND, until the time is over, the next UNLOCK or the next start")                              \
  F(u16, seconds, "as in the request")
#define IMUCAL_LINK_COMMAND(F, A, N, V)                                                                                \
  F(u32, token, "of UNLOCK_REPLY")                                                                                     \
  F(u32, number, "above that of every command of this token so far")                                                   \
  F(u8, request, "type of the request inside")                                                                         \
  N(length, "bytes")                                                                                                   \
  V(u8, payload, 206, "of the request inside; the answer is that of the request")
#define IMUCAL_LINK_CAL_START(F, A, N, V)                                                                              \
  F(u8, channel, "0..n_channels-1; refused while its filter runs")                                                     \
  F(u8, order, "1..5")                                                                                                 \
  F(f32, t0_degc, "degC")                                                                                              \
  F(f32, range_degc, "degC")                                                                                           \
  F(f32, m, "1 - exp(-1 s/tau)")                                                                                       \
  F(f32, q, "unit^2")                                                                                                  \
  F(f32, r, "unit^2")                                                                                                  \
  F(f32, markov_variance, "unit^2")                                                                                    \
  F(f32, prior_sigma, "unit")                                                                                          \
  F(f32, span_lo_degc, "degC, where the error is predicted and the table valid")                                       \
  F(f32, span_hi_degc, "degC")                                                                                         \
  F(f32, arw, "error model for the table: unit as arw_deg_rt_h")                                                       \
  N(n_markov, "0..2")                                                                                                  \
  V(f32, markov_sigma, 2, "unit")                                                                                      \
  V(f32, markov_tau_s, 2, "s")
#define IMUCAL_LINK_CAL_STATE(F, A, N, V) F(u8, channel, "0..n_channels-1")
#define IMUCAL_LINK_CAL_STATE_REPLY(F, A, N, V)                                                                        \
  F(u8, channel, "as in the request")                                                                                  \
  F(u8, order, "1..5")                                                                                                 \
  F(u32, t_s, "end of the newest second")                                                                              \
  F(u32, n, "measurements taken")                                                                                      \
  F(u32, n_missed, "seconds bridged")                                                                                  \
  F(u32, n_refused, "inputs refused")                                                                                  \
  F(f32, mean_nis, "mean of nu^2/S; 1 with a right model")                                                             \
  F(f32, lag1, "lag-1 correlation of the innovations; 0 with a right model")                                           \
  F(f32, weighted_sum, "sum nu/S, 1/unit")                                                                             \
  F(f32, inverse_sum, "sum 1/S, 1/unit^2")                                                                             \
  F(f32, innovation, "unit, the last one")                                                                             \
  F(f32, innovation_variance, "unit^2")                                                                                \
  F(f32, worst_sigma, "predicted worst one-sigma calibration error over the span, unit")                               \
  F(f32, worst_temp_degc, "degC")                                                                                      \
  A(f32, coeff, 6, "unit; 0 above the order")
#define IMUCAL_LINK_CAL_FILTER(F, A, N, V) F(u8, channel, "0..n_channels-1")
#define IMUCAL_LINK_CAL_FILTER_REPLY(F, A, N, V)                                                                       \
  F(u8, channel, "as in the request")                                                                                  \
  F(u8, n_states, "order + 2: entries of x, x_lo, d, d_lo that mean something")                                        \
  A(u32, x, 7, "f32 bits: 1 + V0; then R c")                                                                           \
  A(u32, x_lo, 7, "f32 bits: to be added to x")                                                                        \
  A(u32, d, 7, "f32 bits: variance of e given c; then D")                                                              \
  A(u32, d_lo, 7, "f32 bits: to be added to d")                                                                        \
  A(u32, u, 21, "f32 bits: first filter's e; V1 .. V5; R above its diagonal by columns: R01 R02 R12 R03 ..")
#define IMUCAL_LINK_HEALTH(F, A, N, V) F(u8, channel, "0..n_channels-1")
#define IMUCAL_LINK_HEALTH_REPLY(F, A, N, V)                                                                           \
  F(u8, channel, "as in the request")                                                                                  \
  F(u32, t_s, "end of the newest second")                                                                              \
  F(u32, bits, "bit i: rule i of health.h speaks against the channel")                                                 \
  F(u32, judged, "bit i: rule i could be judged")                                                                      \
  F(u32, n, "seconds since CAL_START")                                                                                 \
  F(u32, n_used, "of them fit to learn from")                                                                          \
  F(u32, n_rejected, "left out: innovation beyond 6 sigma")                                                            \
  F(u32, n_spikes, "left out: temperature out of reach")                                                               \
  F(u32, n_saturated, "with a sample at the rail")                                                                     \
  F(u32, n_faulty, "with a fault of the sensor")                                                                       \
  F(f32, error_factor, "how many times the predicted error is too small by the innovations, >= 1")                     \
  F(u8, has_span, "1: temperatures were seen")                                                                         \
  F(f32, span_lo_degc, "degC, seen for 8 seconds and more")                                                            \
  F(f32, span_hi_degc, "degC")                                                                                         \
  N(n_rules, "rules this device knows")                                                                                \
  V(f32, value, 16, "figure of rule i")                                                                                \
  V(f32, limit, 16, "what it was compared with")
#define IMUCAL_LINK_CAL_STOP(F, A, N, V) F(u8, action, "0 discard the filters, 1 keep them for TABLE_FROM_CAL")
#define IMUCAL_LINK_TABLE_FROM_CAL(F, A, N, V)                                                                         \
  F(u32, created_s, "s since 1970-01-01 UTC")                                                                          \
  A(chr, serial, 16, "must be this device's")
#define IMUCAL_LINK_TABLE_READ(F, A, N, V)                                                                             \
  F(u8, slot, "0, 1; 255: the ruling one")                                                                             \
  F(u16, offset, "bytes")                                                                                              \
  F(u8, length, "bytes, 1..200")
#define IMUCAL_LINK_TABLE_READ_REPLY(F, A, N, V)                                                                       \
  F(u8, slot, "which slot it was")                                                                                     \
  F(u16, offset, "bytes")                                                                                              \
  F(u16, total, "length of the table, bytes")                                                                          \
  N(length, "bytes")                                                                                                   \
  V(u8, data, 200, "bytes")
#define IMUCAL_LINK_TABLE_BEGIN(F, A, N, V)                                                                            \
  F(u16, total, "length of the table, bytes")                                                                          \
  F(u32, crc, "the last four bytes, the table's own CRC-32 (that of all its bytes, always 0x2144DF1C, is taken too)")
#define IMUCAL_LINK_TABLE_DATA(F, A, N, V)                                                                             \
  F(u16, offset, "bytes")                                                                                              \
  N(length, "bytes")                                                                                                   \
  V(u8, data, 200, "bytes")
#define IMUCAL_LINK_TABLE_COMMIT(F, A, N, V) F(u8, reserved, "0")
#define IMUCAL_LINK_ROLLBACK(F, A, N, V) F(u8, reserved, "0")
#define IMUCAL_LINK_ERASE(F, A, N, V) F(u32, confirm, "0x45524153: both slots are erased")
#define IMUCAL_LINK_REBOOT(F, A, N, V) F(u8, reserved, "0; the reply is sent before the restart")
#define IMUCAL_LINK_DONE(F, A, N, V)                                                                                   \
  F(u8, request, "type of the request")                                                                                \
  F(i16, status, "imucal_status")                                                                                      \
  F(u32, detail, "by request: sequence of the new table, offset expected, channel + 1 that was refused; else 0")
#define IMUCAL_LINK_SECOND(F, A, N, V)                                                                                 \
  F(u16, counter, "of this stream, +1 each")                                                                           \
  F(u32, t_s, "end of the second")                                                                                     \
  F(u16, n_samples, "0xFFFF: that many or more")                                                                       \
  F(f32, temp_degc, "degC, mean")                                                                                      \
  F(u8, is_gap, "1: fewer than half of the samples")                                                                   \
  F(u8, compensated, "bit i: channel i is compensated by a table")                                                     \
  F(u8, temp_clamped, "bit i: some sample was outside the valid span of channel i")                                    \
  N(n_channels, "1..6")                                                                                                \
  V(u8, flags, 6, "1 saturated, 2 samples missing, 4 sensor fault")                                                    \
  V(f32, raw, 6, "unit, mean")                                                                                         \
  V(f32, out, 6, "unit, mean of the compensated samples")
#define IMUCAL_LINK_INNOVATION(F, A, N, V)                                                                             \
  F(u16, counter, "of this stream, +1 each")                                                                           \
  F(u32, t_s, "end of the second")                                                                                     \
  F(u8, channel, "0..5")                                                                                               \
  F(f32, innovation, "unit")                                                                                           \
  F(f32, variance, "unit^2")
#define IMUCAL_LINK_PROGRESS(F, A, N, V)                                                                               \
  F(u16, counter, "of this stream, +1 each")                                                                           \
  F(u32, t_s, "end of the newest second")                                                                              \
  F(f32, temp_degc, "degC, mean of that second")                                                                       \
  F(u8, session, "as in INFO")                                                                                         \
  N(n_channels, "1..6")                                                                                                \
  V(f32, worst_sigma, 6, "unit; predicted worst error over the span; 0: no filter")                                    \
  V(f32, mean_nis, 6, "mean of nu^2/S; 0: no filter")
#define IMUCAL_LINK_EVENT(F, A, N, V)                                                                                  \
  F(u16, counter, "of this stream, +1 each")                                                                           \
  F(u8, code, "imucal_link_event_code")                                                                                \
  F(i16, status, "imucal_status")                                                                                      \
  F(u32, detail, "by code: slot, sequence number, time")

/* M(id, name in C, NAME) */
#define IMUCAL_LINK_MESSAGES(M)                                                                                        \
  M(0x01, hello, HELLO)                                                                                                \
  M(0x81, hello_reply, HELLO_REPLY)                                                                                    \
  M(0x02, info, INFO)                                                                                                  \
  M(0x82, info_reply, INFO_REPLY)                                                                                      \
  M(0x03, counters, COUNTERS)                                                                                          \
  M(0x83, counters_reply, COUNTERS_REPLY)                                                                              \
  M(0x04, channel_info, CHANNEL_INFO)                                                                                  \
  M(0x84, channel_info_reply, CHANNEL_INFO_REPLY)                                                                      \
  M(0x05, stream, STREAM)                                                                                              \
  M(0x06, reboot, REBOOT)                                                                                              \
  M(0x07, state, STATE)                                                                                                \
  M(0x87, state_reply, STATE_REPLY)                                                                                    \
  M(0x08, unlock, UNLOCK)                                                                                              \
  M(0x88, unlock_reply, UNLOCK_REPLY)                                                                                  \
  M(0x09, command, COMMAND)                                                                                            \
  M(0x0A, samples, SAMPLES)                                                                                            \
  M(0x8A, samples_reply, SAMPLES_REPLY)                                                                                \
  M(0x0B, sensor, SENSOR)                                                                                              \
  M(0x8B, sensor_reply, SENSOR_REPLY)                                                                                  \
  M(0x10, cal_start, CAL_START)                                                                                        \
  M(0x11, cal_state, CAL_STATE)                                                                                        \
  M(0x91, cal_state_reply, CAL_STATE_REPLY)                                                                            \
  M(0x13, cal_stop, CAL_STOP)                                                                                          \
  M(0x14, table_from_cal, TABLE_FROM_CAL)                                                                              \
  M(0x15, cal_filter, CAL_FILTER)                                                                                      \
  M(0x95, cal_filter_reply, CAL_FILTER_REPLY)                                                                          \
  M(0x16, health, HEALTH)                                                                                              \
  M(0x96, health_reply, HEALTH_REPLY)                                                                                  \
  M(0x20, table_read, TABLE_READ)                                                                                      \
  M(0xA0, table_read_reply, TABLE_READ_REPLY)                                                                          \
  M(0x21, table_begin, TABLE_BEGIN)                                                                                    \
  M(0x22, table_data, TABLE_DATA)                                                                                      \
  M(0x23, table_commit, TABLE_COMMIT)                                                                                  \
  M(0x24, rollback, ROLLBACK)                                                                                          \
  M(0x25, erase, ERASE)                                                                                                \
  M(0xFF, done, DONE)                                                                                                  \
  M(0x40, second, SECOND)                                                                                              \
  M(0x41, innovation, INNOVATION)                                                                                      \
  M(0x42, progress, PROGRESS)                                                                                          \
  M(0x43, event, EVENT)

#define IMUCAL_LINK_ERASE_CONFIRM 0x45524153u
#define IMUCAL_LINK_SLOT_RULING 255u
#define IMUCAL_LINK_MAX_UNLOCK_S 600u
enum { IMUCAL_STREAM_SECOND = 1, IMUCAL_STREAM_INNOVATION = 2, IMUCAL_STREAM_PROGRESS = 4, IMUCAL_STREAM_EVENT = 8 };
enum {
  IMUCAL_SESSION_IDLE = 0,
  IMUCAL_SESSION_CALIBRATING = 1,
  IMUCAL_SESSION_KEPT = 2,
  IMUCAL_SESSION_SENSOR_ENDED = 3
};
enum { IMUCAL_STOP_DISCARD = 0, IMUCAL_STOP_KEEP = 1 };
enum {
  IMUCAL_ORIGIN_NONE = 0,
  IMUCAL_ORIGIN_UNKNOWN = 1,
  IMUCAL_ORIGIN_FILTERS = 2,
  IMUCAL_ORIGIN_HOST = 3,
  IMUCAL_ORIGIN_ROLLBACK = 4
};

/* Bits of EVENT SENSOR_COUNTED, in the order of SENSOR_REPLY. */
enum {
  IMUCAL_SENSOR_WRONG_IDENTITY = 1,
  IMUCAL_SENSOR_BUS_ERRORS = 2,
  IMUCAL_SENSOR_OVERRUNS = 4,
  IMUCAL_SENSOR_LOST = 8,
  IMUCAL_SENSOR_INVALID = 16,
  IMUCAL_SENSOR_RESETS = 32,
  IMUCAL_SENSOR_STUCK_TEMP = 64,
  IMUCAL_SENSOR_STUCK_DATA = 128,
  IMUCAL_SENSOR_SUPPLY = 256, /* refused because of the supply, or the supply is low now */
  IMUCAL_SENSOR_N_COUNTS = 9
};

/* Codes of EVENT. */
typedef enum imucal_link_event_code {
  IMUCAL_EVENT_BOOT = 1,           /* detail: boot_id */
  IMUCAL_EVENT_TABLE_LOADED = 2,   /* detail: sequence number */
  IMUCAL_EVENT_TABLE_NONE = 3,     /* running uncompensated; status: why */
  IMUCAL_EVENT_TABLE_REFUSED = 4,  /* detail: slot; status: why */
  IMUCAL_EVENT_SENSOR_ENDED = 5,   /* the sample feed is at its end; detail: t_s */
  IMUCAL_EVENT_SENSOR_FAULT = 6,   /* detail: channel bits */
  IMUCAL_EVENT_WATCHDOG = 7,       /* the last restart was the watchdog's */
  IMUCAL_EVENT_SENSOR_COUNTED = 9, /* counts of SENSOR_REPLY grew that had not the second before; status: its own;
                                      detail: IMUCAL_SENSOR_* */
  IMUCAL_EVENT_CLOCK_BACK =
      10, /* the board's clock ran back, as one of 32 bits does; status: ERR_PERIOD; detail: how often */
  IMUCAL_EVENT_HOST_SILENT = 8 /* the calibration was stopped, its filters are kept; detail: s of silence */
} imucal_link_event_code;

/* ids:      IMUCAL_LINK_ID_HELLO = 0x01, …
 * structs:  imucal_link_hello_t, … with the fields above (u8 -> uint8_t, chr -> char, …). */
#define IMUCAL_LINK_ENUM_(id, name, NAME) IMUCAL_LINK_ID_##NAME = id,
typedef enum imucal_link_id { IMUCAL_LINK_MESSAGES(IMUCAL_LINK_ENUM_) IMUCAL_LINK_ID_NONE = 0 } imucal_link_id;
#undef IMUCAL_LINK_ENUM_

#define IMUCAL_LINK_C_u8 uint8_t
#define IMUCAL_LINK_C_u16 uint16_t
#define IMUCAL_LINK_C_u32 uint32_t
#define IMUCAL_LINK_C_u64 uint64_t
#define IMUCAL_LINK_C_i16 int16_t
#define IMUCAL_LINK_C_i32 int32_t
#define IMUCAL_LINK_C_f32 float
#define IMUCAL_LINK_C_chr char
#define IMUCAL_LINK_F_(type, name, unit) IMUCAL_LINK_C_##type name;
#define IMUCAL_LINK_A_(type, name, n, unit) IMUCAL_LINK_C_##type name[n];
#define IMUCAL_LINK_N_(name, unit) uint8_t name;
#define IMUCAL_LINK_STRUCT_(id, name, NAME)                                                                            \
  typedef struct imucal_link_##name {                                                                                  \
    IMUCAL_LINK_##NAME(IMUCAL_LINK_F_, IMUCAL_LINK_A_, IMUCAL_LINK_N_, IMUCAL_LINK_A_)                                 \
  } imucal_link_##name##_t;
IMUCAL_LINK_MESSAGES(IMUCAL_LINK_STRUCT_)
#undef IMUCAL_LINK_STRUCT_

/* Any message, for the receiving end. */
#define IMUCAL_LINK_MEMBER_(id, name, NAME) imucal_link_##name##_t name;
typedef union imucal_link_any {
  IMUCAL_LINK_MESSAGES(IMUCAL_LINK_MEMBER_)
} imucal_link_any_t;
#undef IMUCAL_LINK_MEMBER_

/* ---- sending ---- */

/* Does a request change anything?  Then it is taken only inside COMMAND. */
static inline bool imucal_link_is_guarded(uint32_t id) {
  switch (id) {
  case IMUCAL_LINK_ID_STREAM:
  case IMUCAL_LINK_ID_REBOOT:
  case IMUCAL_LINK_ID_CAL_START:
  case IMUCAL_LINK_ID_CAL_STOP:
  case IMUCAL_LINK_ID_TABLE_FROM_CAL:
  case IMUCAL_LINK_ID_TABLE_BEGIN:
  case IMUCAL_LINK_ID_TABLE_DATA:
  case IMUCAL_LINK_ID_TABLE_COMMIT:
  case IMUCAL_LINK_ID_ROLLBACK:
  case IMUCAL_LINK_ID_ERASE:
    return true;
  default:
    return false;
  }
}

/* Build a whole frame (delimiters before and after it) from a message struct of type id into out[max_out].
 * IMUCAL_ERR_UNKNOWN: no such id; IMUCAL_ERR_RANGE: a V count above its maximum; IMUCAL_ERR_SPACE. */
IMUCAL_MUST_USE imucal_status imucal_link_pack(uint32_t id, uint8_t sequence, const void* message, uint8_t* out,
                                               size_t max_out, size_t* out_len);

/* The same from payload bytes of any type (tests, pass-through). */
IMUCAL_MUST_USE imucal_status imucal_link_frame(uint8_t type, uint8_t sequence, const uint8_t* payload,
                                                size_t payload_len, uint8_t* out, size_t max_out, size_t* out_len);

/* Message struct to payload bytes and back. decode wants exactly the bytes of the message: IMUCAL_ERR_LENGTH;
 * IMUCAL_ERR_UNKNOWN: no such id; IMUCAL_ERR_RANGE: count above its maximum.  Texts are forced to end inside their
 * field only by the reader: compare with imucal_text_equal or copy with its size.  Array elements beyond a count
 * are set to 0. */
IMUCAL_MUST_USE imucal_status imucal_link_encode(uint32_t id, const void* message, uint8_t* payload, size_t max_payload,
                                                 size_t* payload_len);
IMUCAL_MUST_USE imucal_status imucal_link_decode(uint32_t id, const uint8_t* payload, size_t payload_len,
                                                 imucal_link_any_t* message);

/* ---- receiving ---- */

/* One received frame; valid until the next byte is put. */
typedef struct imucal_link_rx {
  uint8_t buffer[IMUCAL_LINK_MAX_RAW]; /* decoded bytes */
  uint16_t len;                        /* of buffer */
  uint8_t block_left;                  /* COBS: bytes left in this block; 0: next byte is a code */
  bool is_skipping, is_started;
  /* what was received, readable by anybody */
  uint32_t n_frames, n_crc, n_resync, n_overflow, n_unknown;
} imucal_link_rx_t;

void imucal_link_rx_init(imucal_link_rx_t* rx);

/* Take one byte: bounded work (the CRC runs at the delimiter).  IMUCAL_FRAME_READY: a valid frame is in rx (type,
 * sequence, payload below); IMUCAL_OK: nothing yet; IMUCAL_ERR_CRC, IMUCAL_ERR_FRAME, IMUCAL_ERR_SPACE (too long):
 * the frame was dropped and counted.  After CRC and FRAME, which come at its delimiter, the next byte starts anew; after
 * SPACE the next delimiter does. */
IMUCAL_MUST_USE imucal_status imucal_link_rx_put(imucal_link_rx_t* rx, uint8_t byte);

static inline uint8_t imucal_link_rx_type(const imucal_link_rx_t* rx) {
  return rx->buffer[0];
}
static inline uint8_t imucal_link_rx_sequence(const imucal_link_rx_t* rx) {
  return rx->buffer[1];
}
static inline const uint8_t* imucal_link_rx_payload(const imucal_link_rx_t* rx) {
  return rx->buffer + 2;
}
static inline size_t imucal_link_rx_payload_len(const imucal_link_rx_t* rx) {
  return (size_t)rx->len - 6;
}

/* Decode the frame in rx; counts n_unknown on failure.  Status of imucal_link_decode. */
IMUCAL_MUST_USE imucal_status imucal_link_rx_message(imucal_link_rx_t* rx, imucal_link_any_t* message);

/* ---- the device's end: answer again, do not do again ---- */

typedef struct imucal_link_server {
  uint8_t reply[IMUCAL_LINK_MAX_FRAME]; /* the kept reply frame */
  uint16_t reply_len;                   /* 0: nothing kept */
  uint8_t request_sequence;
  uint32_t request_crc; /* of the whole request frame */
  uint32_t n_repeated;
} imucal_link_server_t;

void imucal_link_server_init(imucal_link_server_t* server);

/* A request frame is in rx.  IMUCAL_FRAME_REPEATED: send server->reply[0..reply_len) again and do nothing else;
 * IMUCAL_OK: new; do it, then build the reply with imucal_link_server_reply. */
IMUCAL_MUST_USE imucal_status imucal_link_server_request(imucal_link_server_t* server, const imucal_link_rx_t* rx);

/* Build and keep the reply to the request last given to imucal_link_server_request; send server->reply. */
IMUCAL_MUST_USE imucal_status imucal_link_server_reply(imucal_link_server_t* server, uint32_t id, const void* message);

#if defined(__cplusplus)
}
#endif
#endif
