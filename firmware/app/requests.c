// SPDX-License-Identifier: MIT
/* One function per request of common/link.h; each builds the reply that the link server keeps. */
#include <string.h>

#include "app.h"
#include "crc.h"
#include "num.h"
#include "parts.h"

#define BIT(i) (1u << (i))

/* The messages of link.h state sizes and ranges as numbers, for other programs to be written by (link.md); these are the core's. */
#define FIELD(message, field) (((imucal_link_##message##_t*)0)->field)
#define N_OF(message, field) (sizeof FIELD(message, field) / sizeof FIELD(message, field)[0])
IMUCAL_STATIC_ASSERT(words_1_to_6_and_1_to_5, IMUCAL_MAX_CHANNELS == 6 && IMUCAL_MAX_ORDER == 5);
IMUCAL_STATIC_ASSERT(serials_are_those_of_tables, N_OF(hello_reply, serial) == IMUCAL_SERIAL_LEN &&
                                                      N_OF(unlock, serial) == IMUCAL_SERIAL_LEN &&
                                                      N_OF(table_from_cal, serial) == IMUCAL_SERIAL_LEN);
IMUCAL_STATIC_ASSERT(names_are_those_of_tables, N_OF(channel_info_reply, name) == IMUCAL_NAME_LEN);
IMUCAL_STATIC_ASSERT(slots_are_those_of_the_store, N_OF(info_reply, slot_status) == IMUCAL_STORE_SLOTS &&
                                                       N_OF(info_reply, slot_sequence) == IMUCAL_STORE_SLOTS);
IMUCAL_STATIC_ASSERT(markov_terms_are_those_of_tables, N_OF(cal_start, markov_sigma) == IMUCAL_TABLE_MARKOV_N &&
                                                           N_OF(cal_start, markov_tau_s) == IMUCAL_TABLE_MARKOV_N);
IMUCAL_STATIC_ASSERT(coefficients_are_those_of_the_filter, N_OF(cal_state_reply, coeff) == IMUCAL_MAX_COEFF);
IMUCAL_STATIC_ASSERT(states_are_those_of_the_filter, N_OF(cal_filter_reply, x) == IMUCAL_KF_MAX_STATES &&
                                                         N_OF(cal_filter_reply, x_lo) == IMUCAL_KF_MAX_STATES &&
                                                         N_OF(cal_filter_reply, d) == IMUCAL_KF_MAX_STATES &&
                                                         N_OF(cal_filter_reply, d_lo) == IMUCAL_KF_MAX_STATES &&
                                                         N_OF(cal_filter_reply, u) == IMUCAL_KF_MAX_U);
IMUCAL_STATIC_ASSERT(rules_of_health_have_room, N_OF(health_reply, value) >= IMUCAL_HEALTH_N_RULES &&
                                                    N_OF(health_reply, limit) >= IMUCAL_HEALTH_N_RULES);
IMUCAL_STATIC_ASSERT(channels_of_a_second, N_OF(second, flags) == IMUCAL_MAX_CHANNELS &&
                                               N_OF(second, raw) == IMUCAL_MAX_CHANNELS &&
                                               N_OF(second, out) == IMUCAL_MAX_CHANNELS);
IMUCAL_STATIC_ASSERT(channels_of_progress, N_OF(progress, worst_sigma) == IMUCAL_MAX_CHANNELS &&
                                               N_OF(progress, mean_nis) == IMUCAL_MAX_CHANNELS);
IMUCAL_STATIC_ASSERT(bytes_of_tables, N_OF(table_read_reply, data) == IMUCAL_LINK_MAX_DATA &&
                                          N_OF(table_data, data) == IMUCAL_LINK_MAX_DATA);

/* ---- replies ---- */

static void reply(imucal_app_t* app, uint32_t id, const void* message) {
  if (imucal_link_server_reply(&app->server, id, message) != IMUCAL_OK) app->server.reply_len = 0;
}

static void done(imucal_app_t* app, imucal_status status, uint32_t detail) {
  const imucal_link_done_t message = {.request = app->request, .status = (int16_t)status, .detail = detail};
  reply(app, IMUCAL_LINK_ID_DONE, &message);
}

/* Texts of the port end at their field's size at the latest. */
static void put_text(char* to, size_t size, const char* from) {
  memset(to, 0, size);
  for (size_t i = 0; i + 1 < size && from && from[i]; i++) to[i] = from[i];
}

/* ---- who and how ---- */

static void serve_hello(imucal_app_t* app, const imucal_link_hello_t* request) {
  if (request->protocol < IMUCAL_LINK_PROTOCOL) {
    done(app, IMUCAL_ERR_VERSION, IMUCAL_LINK_PROTOCOL);
    return;
  }
  imucal_link_hello_reply_t answer = {.protocol = IMUCAL_LINK_PROTOCOL,
                                      .nonce = request->nonce,
                                      .n_channels = app->board->n_channels,
                                      .rate_hz = (float)app->board->rate_hz,
                                      .max_payload = IMUCAL_LINK_MAX_PAYLOAD,
                                      .boot_id = app->port->boot_id};
  put_text(answer.device, sizeof answer.device, app->port->device);
  put_text(answer.firmware, sizeof answer.firmware, IMUCAL_FIRMWARE_VERSION);
  memcpy(answer.serial, app->board->serial, sizeof answer.serial);
  reply(app, IMUCAL_LINK_ID_HELLO_REPLY, &answer);
}

static void serve_info(imucal_app_t* app) {
  const bool has_table = app->table_status == IMUCAL_OK;
  imucal_link_info_reply_t answer = {.uptime_us = app_now(app),
                                     .table_status = (int16_t)app->table_status,
                                     .ruling_slot = (uint8_t)(has_table ? app->report.ruling : 255),
                                     .sequence = has_table ? app->table.sequence : 0,
                                     .table_bytes =
                                         (uint16_t)(has_table ? IMUCAL_TABLE_BYTES(app->table.n_channels) : 0),
                                     .session = app->session,
                                     .calibrating = app->calibrating,
                                     .t_s = app->t_s,
                                     .stream_what = app->stream_what,
                                     .stream_channels = app->stream_channels};
  for (uint32_t slot = 0; slot < IMUCAL_STORE_SLOTS; slot++) {
    answer.slot_status[slot] = (int16_t)app->report.slot_status[slot];
    answer.slot_sequence[slot] = app->report.sequence[slot];
  }
  reply(app, IMUCAL_LINK_ID_INFO_REPLY, &answer);
}

static uint32_t table_crc(const imucal_app_t* app) {
  uint32_t word = 0;
  const uint32_t at = (uint32_t)IMUCAL_TABLE_BYTES(app->table.n_channels) - 4;
  if (app->table_status != IMUCAL_OK) return 0;
  const imucal_status status =
      app->port->flash.read(app->port->flash.ctx, (uint32_t)app->report.ruling, at, (uint8_t*)&word, 4);
  return status == IMUCAL_OK ? imucal_get_u32((const uint8_t*)&word) : 0;
}

static void serve_state(imucal_app_t* app) {
  const bool has_table = app->table_status == IMUCAL_OK;
  const uint16_t unlocked_s = app_guard_left_s(&app->guard, app_now(app));
  const imucal_link_state_reply_t answer = {.challenge = app->guard.challenge,
                                            .unlocked_s = unlocked_s,
                                            .table_crc = table_crc(app),
                                            .table_created_s = has_table ? app->table.created_s : 0,
                                            .table_origin = app->table_origin,
                                            .silence_s = IMUCAL_APP_SILENCE_S,
                                            .refused_locked = app->n_locked,
                                            .refused_stale = app->n_stale,
                                            .refused_unlock = app->n_unlock_refused,
                                            .refused_busy = app->n_busy,
                                            .refused_reserved = app->n_reserved,
                                            .refused_table = app->n_table_refused,
                                            .flash_failed = app->n_flash_failed,
                                            .sessions_silent = app->n_silent};
  reply(app, IMUCAL_LINK_ID_STATE_REPLY, &answer);
}

static void serve_unlock(imucal_app_t* app, const imucal_link_unlock_t* request) {
  imucal_link_unlock_reply_t answer;
  const imucal_status status = app_guard_unlock(&app->guard, request, app->board->serial, app_now(app), &answer);
  if (status == IMUCAL_OK) {
    reply(app, IMUCAL_LINK_ID_UNLOCK_REPLY, &answer);
    return;
  }
  app->n_stale += status == IMUCAL_ERR_STALE;
  app->n_unlock_refused += status != IMUCAL_ERR_STALE;
  done(app, status, 0);
}

static void serve_counters(imucal_app_t* app) {
  imucal_link_counters_reply_t answer = {.rx_frames = app->rx.n_frames,
                                         .rx_crc = app->rx.n_crc,
                                         .rx_resync = app->rx.n_resync,
                                         .rx_overflow = app->rx.n_overflow,
                                         .rx_unknown = app->rx.n_unknown + app->n_rx_unknown,
                                         .rx_repeated = app->server.n_repeated,
                                         .tx_dropped = app->n_tx_dropped,
                                         .samples = app->n_samples,
                                         .duplicates = app->raw_sum.n_duplicate,
                                         .backward = app->raw_sum.n_backward + app->clock.n_behind,
                                         .jumps = app->raw_sum.n_jump,
                                         .feed_errors = app->n_bad_samples + app->raw_sum.n_refused,
                                         .seconds = app->n_seconds,
                                         .gaps = app->n_gaps,
                                         .watchdog_resets = app->port->n_watchdog_resets};
  for (uint32_t i = 0; i < app->board->n_channels; i++)
    if (app->calibrating & BIT(i)) answer.filter_refused += app->channel[i].learn.kf.stats.n_refused;
  reply(app, IMUCAL_LINK_ID_COUNTERS_REPLY, &answer);
}

static void serve_samples(imucal_app_t* app) {
  const imucal_link_samples_reply_t answer = {.samples = app->n_samples,
                                              .summed = imucal_sum_n_taken(&app->raw_sum),
                                              .duplicates = app->raw_sum.n_duplicate,
                                              .behind = app->raw_sum.n_backward + app->clock.n_behind,
                                              .ahead = app->clock.n_ahead,
                                              .refused = app->raw_sum.n_refused + app->n_foreign,
                                              .unreadable = app->n_bad_samples - app->n_foreign,
                                              .clock_set = app->clock.n_set,
                                              .clock_wrapped = app->clock.n_wrapped,
                                              .jumps = app->raw_sum.n_jump,
                                              .seconds = app->n_seconds,
                                              .gaps = app->n_gaps};
  reply(app, IMUCAL_LINK_ID_SAMPLES_REPLY, &answer);
}

static void serve_sensor(imucal_app_t* app) {
  const imucal_link_sensor_reply_t answer = app_sensor_report(app);
  reply(app, IMUCAL_LINK_ID_SENSOR_REPLY, &answer);
}

static void serve_channel_info(imucal_app_t* app, const imucal_link_channel_info_t* request) {
  if (request->channel >= app->board->n_channels) {
    done(app, IMUCAL_ERR_UNKNOWN, app->board->n_channels);
    return;
  }
  const uint32_t i = request->channel;
  imucal_link_channel_info_reply_t answer = {.channel = request->channel,
                                             .unit_per_count = app->board->channel[i].unit_per_count,
                                             .full_scale_counts = app->board->channel[i].full_scale_counts,
                                             .is_compensated = app_is_compensated(app, i),
                                             .out_frac_bits = app->channel[i].comp.out_frac_bits,
                                             .degc_per_count = app->board->degc_per_count,
                                             .degc_at_zero = app->board->degc_at_zero};
  memcpy(answer.name, app->board->channel[i].name, sizeof answer.name);
  reply(app, IMUCAL_LINK_ID_CHANNEL_INFO_REPLY, &answer);
}

static void serve_stream(imucal_app_t* app, const imucal_link_stream_t* request) {
  const uint8_t known = IMUCAL_STREAM_SECOND | IMUCAL_STREAM_INNOVATION | IMUCAL_STREAM_PROGRESS | IMUCAL_STREAM_EVENT;
  const uint8_t channels = (uint8_t)(BIT(app->board->n_channels) - 1u);
  if ((request->what & ~known) || (request->channels & ~channels) || request->period_s < 1) {
    done(app, IMUCAL_ERR_RANGE, 0);
    return;
  }
  if (app->has_sensor_ended && app_restart_sums(app) == IMUCAL_OK) { /* a replay asked for again starts anew */
    app->has_sensor_ended = false;
    app->t_s = 0;
  }
  app->stream_what = request->what;
  app->stream_channels = request->channels;
  app->progress_period_s = request->period_s;
  app->progress_t_s = 0;
  done(app, IMUCAL_OK, 0);
}

static void serve_reboot(imucal_app_t* app) {
  app->is_reboot_due = true;
  app->reboot_us = 0;
  done(app, IMUCAL_OK, 0);
}

/* ---- calibration ---- */

/* What a table says of the board. */
static void describe_channel(const imucal_app_t* app, uint32_t i, imucal_table_channel_t* channel) {
  memcpy(channel->name, app->board->channel[i].name, sizeof channel->name);
  channel->unit_per_count = app->board->channel[i].unit_per_count;
  channel->full_scale_counts = app->board->channel[i].full_scale_counts;
}

/* May a table hold what this request brings?  Judged on a channel that has learnt zeros: what must be refused is refused
 * now, not after the hours of learning. */
static imucal_status check_candidate(const imucal_app_t* app, const imucal_link_cal_start_t* request) {
  const imucal_board_t* board = app->board;
  imucal_table_channel_t channel = {.order = request->order,
                                    .t0_degc = request->t0_degc,
                                    .range_degc = request->range_degc,
                                    .span_lo_degc = request->span_lo_degc,
                                    .span_hi_degc = request->span_hi_degc,
                                    .arw = request->arw,
                                    .n_markov = request->n_markov};
  describe_channel(app, request->channel, &channel);
  for (uint32_t k = 0; k < IMUCAL_TABLE_SIGMA_N; k++) channel.sigma[k] = 1.0f;
  memcpy(channel.markov_sigma, request->markov_sigma, sizeof channel.markov_sigma);
  memcpy(channel.markov_tau_s, request->markov_tau_s, sizeof channel.markov_tau_s);
  imucal_status status = imucal_store_check(&app->port->flash);
  if (status == IMUCAL_OK) status = imucal_table_validate_channel(&channel, board->degc_per_count, board->degc_at_zero);
  if (status != IMUCAL_OK) return status;
  imucal_comp_t trial;
  return imucal_comp_prepare_channel(&trial, &channel, board->degc_per_count, board->degc_at_zero);
}

static imucal_status check_cal_start(const imucal_app_t* app, const imucal_link_cal_start_t* request) {
  if (request->channel >= app->board->n_channels) return IMUCAL_ERR_UNKNOWN;
  if (!imucal_is_finite(request->t0_degc) || !imucal_is_finite(request->range_degc) ||
      !imucal_is_finite(request->span_lo_degc) || !imucal_is_finite(request->span_hi_degc))
    return IMUCAL_ERR_NOT_FINITE;
  return check_candidate(app, request);
}

/* The first channel started after a session has ended begins a new one: the old filters are gone. */
static void begin_session(imucal_app_t* app) {
  if (app->session != IMUCAL_SESSION_CALIBRATING) app->calibrating = 0;
  app->session = IMUCAL_SESSION_CALIBRATING;
  app->progress_t_s = 0;
}

/* The filter, and the rules with what it expects; refused: the channel is as it was. */
static imucal_status start_channel(imucal_app_t* app, const imucal_link_cal_start_t* request,
                                   const imucal_kf_config_t* config) {
  const imucal_health_config_t expected = {.r = request->r,
                                           .markov_variance = request->markov_variance,
                                           .lo_degc = request->span_lo_degc,
                                           .hi_degc = request->span_hi_degc,
                                           .temp_step_degc = app->board->degc_per_count};
  imucal_health_t health;
  imucal_status status = imucal_health_init(&health, &expected);
  if (status == IMUCAL_OK) status = imucal_learn_init(&app->channel[request->channel].learn, config);
  if (status == IMUCAL_OK) app->channel[request->channel].health = health;
  return status;
}

static void serve_cal_start(imucal_app_t* app, const imucal_link_cal_start_t* request) {
  imucal_status status = check_cal_start(app, request);
  if (status == IMUCAL_OK && app->session == IMUCAL_SESSION_CALIBRATING && (app->calibrating & BIT(request->channel)))
    status = IMUCAL_ERR_BUSY; /* what it has learnt is not thrown away */
  app->n_busy += status == IMUCAL_ERR_BUSY;
  const imucal_kf_config_t config = {.order = request->order,
                                     .t0_degc = request->t0_degc,
                                     .range_degc = request->range_degc,
                                     .m = request->m,
                                     .q = request->q,
                                     .r = request->r,
                                     .markov_variance = request->markov_variance,
                                     .prior_sigma = request->prior_sigma};
  if (status == IMUCAL_OK) status = start_channel(app, request, &config);
  if (status != IMUCAL_OK) {
    done(app, status, 0);
    return;
  }
  imucal_app_channel_t* channel = &app->channel[request->channel];
  channel->span_lo_degc = request->span_lo_degc;
  channel->span_hi_degc = request->span_hi_degc;
  channel->arw = request->arw;
  channel->n_markov = request->n_markov;
  memcpy(channel->markov_sigma, request->markov_sigma, sizeof channel->markov_sigma);
  memcpy(channel->markov_tau_s, request->markov_tau_s, sizeof channel->markov_tau_s);
  begin_session(app);
  app->calibrating = (uint8_t)(app->calibrating | BIT(request->channel));
  done(app, IMUCAL_OK, 0);
}

/* The filter asked for, or null and the refusal is the reply. */
static const imucal_kf_t* asked_filter(imucal_app_t* app, uint8_t channel) {
  if (channel < app->board->n_channels && (app->calibrating & BIT(channel))) return &app->channel[channel].learn.kf;
  done(app, channel < app->board->n_channels ? IMUCAL_ERR_STATE : IMUCAL_ERR_UNKNOWN, 0);
  return NULL;
}

static void serve_cal_state(imucal_app_t* app, const imucal_link_cal_state_t* request) {
  const imucal_kf_t* kf = asked_filter(app, request->channel);
  if (!kf) return;
  imucal_link_cal_state_reply_t answer = {.channel = request->channel,
                                          .order = kf->config.order,
                                          .t_s = app->t_s,
                                          .n = kf->stats.n,
                                          .n_missed = kf->stats.n_missed,
                                          .n_refused = kf->stats.n_refused,
                                          .mean_nis = imucal_kf_mean_nis(kf),
                                          .lag1 = imucal_kf_lag1(kf),
                                          .weighted_sum = imucal_kf_sum(kf, IMUCAL_KF_WEIGHTED),
                                          .inverse_sum = imucal_kf_sum(kf, IMUCAL_KF_INVERSE),
                                          .innovation = kf->stats.innovation,
                                          .innovation_variance = imucal_kf_innovation_variance(kf)};
  answer.worst_sigma = app_worst_sigma(app, request->channel, &answer.worst_temp_degc);
  for (uint32_t i = 0; i < IMUCAL_MAX_COEFF; i++) answer.coeff[i] = imucal_kf_coefficient(kf, i);
  reply(app, IMUCAL_LINK_ID_CAL_STATE_REPLY, &answer);
}

static void put_bits(uint32_t* bits, const float* values, size_t n) {
  for (size_t i = 0; i < n; i++) bits[i] = imucal_bits_from_float(values[i]);
}

static void serve_cal_filter(imucal_app_t* app, const imucal_link_cal_filter_t* request) {
  const imucal_kf_t* kf = asked_filter(app, request->channel);
  if (!kf) return;
  imucal_link_cal_filter_reply_t answer = {.channel = request->channel, .n_states = (uint8_t)(kf->config.order + 2)};
  imucal_kf_state_t state;
  imucal_kf_get_state(kf, &state);
  put_bits(answer.x, state.x, IMUCAL_KF_MAX_STATES);
  put_bits(answer.x_lo, state.x_lo, IMUCAL_KF_MAX_STATES);
  put_bits(answer.d, state.d, IMUCAL_KF_MAX_STATES);
  put_bits(answer.d_lo, state.d_lo, IMUCAL_KF_MAX_STATES);
  put_bits(answer.u, state.u, IMUCAL_KF_MAX_U);
  reply(app, IMUCAL_LINK_ID_CAL_FILTER_REPLY, &answer);
}

static void serve_health(imucal_app_t* app, const imucal_link_health_t* request) {
  if (!asked_filter(app, request->channel)) return;
  const imucal_health_t* health = &app->channel[request->channel].health;
  imucal_health_verdict_t verdict;
  imucal_health_judge(health, &verdict);
  imucal_link_health_reply_t answer = {.channel = request->channel,
                                       .t_s = app->t_s,
                                       .bits = verdict.bits,
                                       .judged = verdict.judged,
                                       .n = health->n,
                                       .n_used = health->n_used,
                                       .n_rejected = health->n_rejected,
                                       .n_spikes = health->n_spikes,
                                       .n_saturated = health->n_saturated,
                                       .n_faulty = health->n_faulty,
                                       .error_factor = imucal_health_error_factor(health),
                                       .n_rules = IMUCAL_HEALTH_N_RULES};
  answer.has_span = imucal_health_span(health, &answer.span_lo_degc, &answer.span_hi_degc);
  memcpy(answer.value, verdict.value, sizeof verdict.value);
  memcpy(answer.limit, verdict.limit, sizeof verdict.limit);
  reply(app, IMUCAL_LINK_ID_HEALTH_REPLY, &answer);
}

static void serve_cal_stop(imucal_app_t* app, const imucal_link_cal_stop_t* request) {
  if (request->action != IMUCAL_STOP_DISCARD && request->action != IMUCAL_STOP_KEEP) {
    done(app, IMUCAL_ERR_RANGE, 0);
    return;
  }
  const bool is_nothing_to_keep = request->action == IMUCAL_STOP_KEEP && app->calibrating == 0;
  if (request->action == IMUCAL_STOP_DISCARD) app->calibrating = 0;
  app->session = app->calibrating ? IMUCAL_SESSION_KEPT : IMUCAL_SESSION_IDLE;
  done(app, is_nothing_to_keep ? IMUCAL_ERR_STATE : IMUCAL_OK, 0);
}

/* ---- tables ---- */

/* The flash holds the processor for milliseconds: not while a filter learns from every sample. */
static bool is_refused_busy(imucal_app_t* app) {
  if (app->session != IMUCAL_SESSION_CALIBRATING) return false;
  app->n_busy++;
  done(app, IMUCAL_ERR_BUSY, 0);
  return true;
}

static void count_flash(imucal_app_t* app, imucal_status status) {
  app->n_flash_failed += status == IMUCAL_ERR_FLASH || status == IMUCAL_ERR_VERIFY || status == IMUCAL_ERR_SUPPLY ||
                         status == IMUCAL_ERR_SLOTS;
}

/* app->table holds a candidate: check it against this board and write it. Whatever comes of it, what the
 * flash holds afterwards is loaded again and rules. */
static void commit_candidate(imucal_app_t* app, uint8_t origin) {
  uint32_t detail = 0;
  imucal_status status = app_check_table(app, &detail);
  app->n_table_refused += status != IMUCAL_OK;
  if (status == IMUCAL_OK)
    status = imucal_store_write(&app->port->flash, app->board->serial, app->board->n_channels, origin, &app->work,
                                &app->table, &app->report);
  count_flash(app, status);
  const imucal_status ruling = app_load_table(app);
  if (status == IMUCAL_OK) status = ruling;
  done(app, status, status == IMUCAL_OK ? app->table.sequence : detail);
}

/* An uncalibrated channel: order 0, no bias; the span must still be one. */
static void clear_channel(imucal_table_channel_t* channel) {
  memset(channel, 0, sizeof *channel);
  channel->range_degc = 1.0f;
  channel->span_lo_degc = -1.0f;
  channel->span_hi_degc = 1.0f;
}

static imucal_status channel_from_filter(const imucal_app_t* app, uint32_t i, imucal_table_channel_t* channel) {
  const imucal_app_channel_t* learnt = &app->channel[i];
  clear_channel(channel);
  channel->arw = learnt->arw;
  channel->n_markov = learnt->n_markov;
  memcpy(channel->markov_sigma, learnt->markov_sigma, sizeof channel->markov_sigma);
  memcpy(channel->markov_tau_s, learnt->markov_tau_s, sizeof channel->markov_tau_s);
  return imucal_table_from_kf(channel, &learnt->learn.kf, learnt->span_lo_degc, learnt->span_hi_degc);
}

static void serve_table_from_cal(imucal_app_t* app, const imucal_link_table_from_cal_t* request) {
  if (is_refused_busy(app)) return;
  if (!imucal_text_equal(request->serial, app->board->serial, IMUCAL_SERIAL_LEN)) {
    done(app, IMUCAL_ERR_SERIAL, 0);
    return;
  }
  if (app->calibrating == 0) {
    done(app, IMUCAL_ERR_NOT_LEARNT, 0);
    return;
  }
  app->upload_total = 0; /* whatever comes of it, the staging area is the store's from here on */
  const bool has_old = app->table_status == IMUCAL_OK;
  imucal_table_t* table = &app->table; /* channels without a filter keep what the ruling table says of them */
  memcpy(table->serial, app->board->serial, sizeof table->serial);
  table->created_s = request->created_s;
  table->n_channels = app->board->n_channels;
  table->degc_per_count = app->board->degc_per_count;
  table->degc_at_zero = app->board->degc_at_zero;
  for (uint32_t i = 0; i < app->board->n_channels; i++) {
    imucal_status status = IMUCAL_OK;
    if (app->calibrating & BIT(i))
      status = channel_from_filter(app, i, &table->channel[i]);
    else if (!has_old)
      clear_channel(&table->channel[i]);
    if (status != IMUCAL_OK) {
      (void)app_load_table(app);
      done(app, status, i + 1);
      return;
    }
    describe_channel(app, i, &table->channel[i]);
  }
  commit_candidate(app, IMUCAL_ORIGIN_FILTERS);
}

/* The slot asked for, or IMUCAL_STORE_SLOTS and the refusal is the reply. */
static uint32_t asked_slot(imucal_app_t* app, uint8_t slot) {
  if (slot == IMUCAL_LINK_SLOT_RULING) {
    if (app->table_status == IMUCAL_OK) return (uint32_t)app->report.ruling;
    done(app, IMUCAL_ERR_NO_TABLE, 0);
    return IMUCAL_STORE_SLOTS;
  }
  if (slot < IMUCAL_STORE_SLOTS) return slot;
  done(app, IMUCAL_ERR_UNKNOWN, 0);
  return IMUCAL_STORE_SLOTS;
}

/* Reads by whole words into an aligned copy, then hands out the bytes asked for. */
static imucal_status read_slot(const imucal_flash_t* flash, uint32_t slot, const imucal_link_table_read_t* request,
                               imucal_link_table_read_reply_t* answer) {
  uint32_t words[IMUCAL_LINK_MAX_DATA / 4 + 2];
  uint8_t* bytes = (uint8_t*)words;
  imucal_status status = flash->read(flash->ctx, slot, 0, bytes, IMUCAL_TABLE_HEADER_BYTES);
  size_t total = 0;
  if (status == IMUCAL_OK) status = imucal_table_peek(bytes, IMUCAL_TABLE_HEADER_BYTES, &total);
  if (status != IMUCAL_OK) return status;
  if (request->length < 1 || request->length > IMUCAL_LINK_MAX_DATA || request->offset >= total)
    return IMUCAL_ERR_RANGE;
  const uint32_t left = (uint32_t)total - request->offset;
  const uint32_t n = request->length < left ? request->length : left;
  const uint32_t from = request->offset & ~3u;
  const uint32_t whole = (request->offset - from + n + 3u) & ~3u;
  status = flash->read(flash->ctx, slot, from, bytes, whole);
  if (status != IMUCAL_OK) return status;
  answer->slot = (uint8_t)slot;
  answer->offset = request->offset;
  answer->total = (uint16_t)total;
  answer->length = (uint8_t)n;
  memcpy(answer->data, bytes + (request->offset - from), n);
  return IMUCAL_OK;
}

static void serve_table_read(imucal_app_t* app, const imucal_link_table_read_t* request) {
  const uint32_t slot = asked_slot(app, request->slot);
  if (slot >= IMUCAL_STORE_SLOTS) return;
  imucal_link_table_read_reply_t answer;
  memset(&answer, 0, sizeof answer);
  const imucal_status status = read_slot(&app->port->flash, slot, request, &answer);
  if (status == IMUCAL_OK)
    reply(app, IMUCAL_LINK_ID_TABLE_READ_REPLY, &answer);
  else
    done(app, status, 0);
}

static void serve_table_begin(imucal_app_t* app, const imucal_link_table_begin_t* request) {
  if (is_refused_busy(app)) return;
  const bool is_possible = request->total >= IMUCAL_TABLE_BYTES(1) && request->total <= IMUCAL_TABLE_MAX_BYTES;
  app->upload_total = is_possible ? request->total : 0;
  app->upload_at = 0;
  app->upload_crc = request->crc;
  done(app, is_possible ? IMUCAL_OK : IMUCAL_ERR_LENGTH, (uint32_t)IMUCAL_TABLE_BYTES(app->board->n_channels));
}

static void serve_table_data(imucal_app_t* app, const imucal_link_table_data_t* request) {
  if (app->upload_total == 0 || request->offset != app->upload_at) {
    done(app, IMUCAL_ERR_STATE, app->upload_at);
    return;
  }
  if (request->length < 1 || request->length > app->upload_total - app->upload_at) {
    done(app, IMUCAL_ERR_LENGTH, app->upload_at);
    return;
  }
  memcpy((uint8_t*)app->work.words + app->upload_at, request->data, request->length);
  app->upload_at = (uint16_t)(app->upload_at + request->length);
  done(app, IMUCAL_OK, app->upload_at);
}

static void serve_table_commit(imucal_app_t* app) {
  if (is_refused_busy(app)) return;
  const uint16_t total = app->upload_total;
  app->upload_total = 0; /* whatever comes of it, the staging area is the store's from here on */
  if (total == 0 || app->upload_at != total) {
    done(app, IMUCAL_ERR_STATE, app->upload_at);
    return;
  }
  const uint8_t* bytes = (const uint8_t*)app->work.words;
  /* The table announced, not just some table: its own CRC, which decode checks. */
  if (app->upload_crc != imucal_get_u32(bytes + total - 4) && app->upload_crc != imucal_crc32(bytes, total)) {
    done(app, IMUCAL_ERR_CRC, 0);
    return;
  }
  imucal_table_place_t place = {.channel = -1};
  const imucal_status status = imucal_table_decode(bytes, total, &app->table, &place);
  if (status == IMUCAL_OK) {
    commit_candidate(app, IMUCAL_ORIGIN_HOST);
    return;
  }
  app->n_table_refused++;
  (void)app_load_table(app);
  done(app, status, (uint32_t)(place.channel + 1));
}

static void serve_rollback(imucal_app_t* app) {
  if (is_refused_busy(app)) return;
  app->upload_total = 0;
  imucal_status status = imucal_store_rollback(&app->port->flash, app->board->serial, app->board->n_channels,
                                               &app->work, &app->table, &app->report);
  count_flash(app, status);
  const imucal_status ruling = app_load_table(app);
  if (status == IMUCAL_OK) status = ruling;
  done(app, status, status == IMUCAL_OK ? app->table.sequence : 0);
}

static void serve_erase(imucal_app_t* app, const imucal_link_erase_t* request) {
  if (is_refused_busy(app)) return;
  if (request->confirm != IMUCAL_LINK_ERASE_CONFIRM) {
    done(app, IMUCAL_ERR_ARGUMENT, IMUCAL_LINK_ERASE_CONFIRM);
    return;
  }
  app->upload_total = 0;
  const imucal_status status = imucal_store_erase(&app->port->flash, &app->work, &app->report);
  count_flash(app, status);
  (void)app_load_table(app);
  done(app, status, 0);
}

/* ---- all of them ---- */

/* Requests about the device and its line; false: not one of them. */
static bool dispatch_device(imucal_app_t* app, const imucal_link_any_t* message) {
  switch (app->request) {
  case IMUCAL_LINK_ID_HELLO:
    serve_hello(app, &message->hello);
    return true;
  case IMUCAL_LINK_ID_INFO:
    serve_info(app);
    return true;
  case IMUCAL_LINK_ID_STATE:
    serve_state(app);
    return true;
  case IMUCAL_LINK_ID_UNLOCK:
    serve_unlock(app, &message->unlock);
    return true;
  case IMUCAL_LINK_ID_COUNTERS:
    serve_counters(app);
    return true;
  case IMUCAL_LINK_ID_SAMPLES:
    serve_samples(app);
    return true;
  case IMUCAL_LINK_ID_SENSOR:
    serve_sensor(app);
    return true;
  case IMUCAL_LINK_ID_CHANNEL_INFO:
    serve_channel_info(app, &message->channel_info);
    return true;
  case IMUCAL_LINK_ID_STREAM:
    serve_stream(app, &message->stream);
    return true;
  case IMUCAL_LINK_ID_REBOOT:
    serve_reboot(app);
    return true;
  default:
    return false;
  }
}

/* Requests about a calibration; false: not one of them. */
static bool dispatch_calibration(imucal_app_t* app, const imucal_link_any_t* message) {
  switch (app->request) {
  case IMUCAL_LINK_ID_CAL_START:
    serve_cal_start(app, &message->cal_start);
    return true;
  case IMUCAL_LINK_ID_CAL_STATE:
    serve_cal_state(app, &message->cal_state);
    return true;
  case IMUCAL_LINK_ID_CAL_FILTER:
    serve_cal_filter(app, &message->cal_filter);
    return true;
  case IMUCAL_LINK_ID_HEALTH:
    serve_health(app, &message->health);
    return true;
  case IMUCAL_LINK_ID_CAL_STOP:
    serve_cal_stop(app, &message->cal_stop);
    return true;
  case IMUCAL_LINK_ID_TABLE_FROM_CAL:
    serve_table_from_cal(app, &message->table_from_cal);
    return true;
  default:
    return false;
  }
}

/* Requests about tables in flash; false: not one of them. */
static bool dispatch_table(imucal_app_t* app, const imucal_link_any_t* message) {
  switch (app->request) {
  case IMUCAL_LINK_ID_TABLE_READ:
    serve_table_read(app, &message->table_read);
    return true;
  case IMUCAL_LINK_ID_TABLE_BEGIN:
    serve_table_begin(app, &message->table_begin);
    return true;
  case IMUCAL_LINK_ID_TABLE_DATA:
    serve_table_data(app, &message->table_data);
    return true;
  case IMUCAL_LINK_ID_TABLE_COMMIT:
    serve_table_commit(app);
    return true;
  case IMUCAL_LINK_ID_ROLLBACK:
    serve_rollback(app);
    return true;
  case IMUCAL_LINK_ID_ERASE:
    serve_erase(app, &message->erase);
    return true;
  default:
    return false;
  }
}

/* A request that may be done: alone, or out of its COMMAND.  The first group that knows it serves it. */
static bool dispatch(imucal_app_t* app, const imucal_link_any_t* message) {
  return dispatch_device(app, message) || dispatch_calibration(app, message) || dispatch_table(app, message);
}

/* Requests of one reserved byte: another value may mean something one day. */
static bool is_reserved_set(uint8_t request, const imucal_link_any_t* message) {
  switch (request) {
  case IMUCAL_LINK_ID_INFO:
  case IMUCAL_LINK_ID_STATE:
  case IMUCAL_LINK_ID_COUNTERS:
  case IMUCAL_LINK_ID_SAMPLES:
  case IMUCAL_LINK_ID_SENSOR:
  case IMUCAL_LINK_ID_REBOOT:
  case IMUCAL_LINK_ID_TABLE_COMMIT:
  case IMUCAL_LINK_ID_ROLLBACK:
    return message->info.reserved != 0;
  default:
    return false;
  }
}

/* Opens a COMMAND: what is inside takes its place in *message. */
static imucal_status open_command(imucal_app_t* app, imucal_link_any_t* message) {
  const uint32_t token = message->command.token, number = message->command.number;
  const size_t length = message->command.length;
  app->request = message->command.request;
  if (!imucal_link_is_guarded(app->request)) return IMUCAL_ERR_UNKNOWN;
  const uint8_t* inside = imucal_link_rx_payload(&app->rx) + imucal_link_rx_payload_len(&app->rx) - length;
  const imucal_status status = imucal_link_decode(app->request, inside, length, message);
  if (status != IMUCAL_OK) return status;
  return app_guard_take(&app->guard, token, number, app_now(app));
}

void app_serve(imucal_app_t* app) {
  imucal_link_any_t message;
  app->request = imucal_link_rx_type(&app->rx);
  imucal_status status = imucal_link_rx_message(&app->rx, &message);
  if (status == IMUCAL_OK && app->request == IMUCAL_LINK_ID_COMMAND)
    status = open_command(app, &message);
  else if (status == IMUCAL_OK && imucal_link_is_guarded(app->request))
    status = IMUCAL_ERR_LOCKED;
  if (status == IMUCAL_OK && is_reserved_set(app->request, &message)) status = IMUCAL_ERR_RESERVED;
  app->n_locked += status == IMUCAL_ERR_LOCKED;
  app->n_stale += status == IMUCAL_ERR_STALE;
  app->n_reserved += status == IMUCAL_ERR_RESERVED;
  const bool is_done = status == IMUCAL_OK && dispatch(app, &message);
  if (!is_done) done(app, status == IMUCAL_OK ? IMUCAL_ERR_UNKNOWN : status, 0);
}
