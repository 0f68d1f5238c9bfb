// SPDX-License-Identifier: MIT
/* From samples to seconds, filters and records. */
#include "app.h"
#include "parts.h"

imucal_status app_restart_out_sum(imucal_app_t* app) {
  imucal_clock_forget_doubted(&app->clock); /* it was compensated by what ruled before */
  return imucal_sum_init(&app->out_sum, app->board->n_channels, app->board->rate_hz);
}

/* A stream anew, but what was dropped stays counted. */
static imucal_status restart_raw_sum(imucal_app_t* app) {
  imucal_sum_t* sum = &app->raw_sum;
  const uint32_t n_taken = imucal_sum_n_taken(sum), n_duplicate = sum->n_duplicate, n_backward = sum->n_backward;
  const uint32_t n_jump = sum->n_jump, n_refused = sum->n_refused;
  const imucal_status status = imucal_sum_init(sum, app->board->n_channels, app->board->rate_hz);
  sum->n_handed_out = n_taken;
  sum->n_duplicate = n_duplicate;
  sum->n_backward = n_backward;
  sum->n_jump = n_jump;
  sum->n_refused = n_refused;
  return status;
}

imucal_status app_restart_sums(imucal_app_t* app) {
  app->clamped = 0;
  imucal_clock_restart(&app->clock);
  imucal_thermometer_init(&app->thermometer, app->board->degc_per_count, app->board->degc_at_zero);
  const imucal_status status = restart_raw_sum(app);
  return status != IMUCAL_OK ? status : app_restart_out_sum(app);
}

float app_worst_sigma(const imucal_app_t* app, uint32_t i, float* worst_temp_degc) {
  const imucal_app_channel_t* channel = &app->channel[i];
  return imucal_kf_worst_sigma(&channel->learn.kf, channel->span_lo_degc, channel->span_hi_degc, IMUCAL_APP_GRID,
                               worst_temp_degc);
}

/* ---- a finished second ---- */

static float mean_unit(int64_t sum, uint32_t n, float scale, float offset) {
  return imucal_unit_from_q16(imucal_mean_q16_rne(sum, n), scale, offset);
}

static void learn_channel(imucal_app_t* app, uint32_t i, const imucal_second_t* second, float rate) {
  imucal_learn_t* learn = &app->channel[i].learn;
  const imucal_learn_input_t input = imucal_learn_input_of(&app->thermometer, &app->raw_sum, second, i, rate);
  if (imucal_learn_checked(learn, &app->channel[i].health, &input, second->flags[i]) != IMUCAL_LEARN_USED) return;
  if (!(app->stream_channels & (1u << i)) || !(app->stream_what & IMUCAL_STREAM_INNOVATION)) return;
  const imucal_link_innovation_t record = {.counter = app_stream_count(app, IMUCAL_STREAM_INNOVATION),
                                           .t_s = second->t_s,
                                           .channel = (uint8_t)i,
                                           .innovation = learn->kf.stats.innovation,
                                           .variance = imucal_kf_innovation_variance(&learn->kf)};
  app_stream(app, IMUCAL_STREAM_INNOVATION, IMUCAL_LINK_ID_INNOVATION, &record);
}

/* Does the ruling table change the channel's counts?  By a bias, or by a scale factor alone. */
bool app_is_compensated(const imucal_app_t* app, uint32_t i) {
  const imucal_comp_t* comp = &app->channel[i].comp;
  return comp->order > 0 || comp->has_scale;
}

static uint8_t compensated_channels(const imucal_app_t* app) {
  uint8_t bits = 0;
  for (uint32_t i = 0; i < app->board->n_channels; i++)
    if (app_is_compensated(app, i)) bits = (uint8_t)(bits | 1u << i);
  return bits;
}

static void stream_second(imucal_app_t* app, imucal_link_second_t* record) {
  if (!(app->stream_what & IMUCAL_STREAM_SECOND)) return;
  record->counter = app_stream_count(app, IMUCAL_STREAM_SECOND);
  record->temp_clamped = app->clamped;
  app_stream(app, IMUCAL_STREAM_SECOND, IMUCAL_LINK_ID_SECOND, record);
}

static void stream_progress(imucal_app_t* app, float temp_degc) {
  if (!(app->stream_what & IMUCAL_STREAM_PROGRESS)) return;
  if (app->progress_t_s != 0 && app->t_s - app->progress_t_s < app->progress_period_s) return;
  app->progress_t_s = app->t_s;
  imucal_link_progress_t record = {.counter = app_stream_count(app, IMUCAL_STREAM_PROGRESS),
                                   .t_s = app->t_s,
                                   .temp_degc = temp_degc,
                                   .session = app->session,
                                   .n_channels = app->board->n_channels};
  for (uint32_t i = 0; i < app->board->n_channels; i++) {
    if (!(app->calibrating & (1u << i))) continue;
    record.worst_sigma[i] = app_worst_sigma(app, i, NULL);
    record.mean_nis[i] = imucal_kf_mean_nis(&app->channel[i].learn.kf);
  }
  app_stream(app, IMUCAL_STREAM_PROGRESS, IMUCAL_LINK_ID_PROGRESS, &record);
}

static void tell_new_faults(imucal_app_t* app, const imucal_second_t* second) {
  uint8_t fault = 0;
  for (uint32_t i = 0; i < second->n_channels; i++)
    if (second->flags[i] & IMUCAL_FLAG_FAULT) fault = (uint8_t)(fault | 1u << i);
  if (fault & ~app->fault) app_event(app, IMUCAL_EVENT_SENSOR_FAULT, IMUCAL_ERR_SENSOR, fault);
  app->fault = fault;
}

/* out: the same second compensated; null where the table changed in it and no sample came since. */
static void finish_second(imucal_app_t* app, const imucal_second_t* raw, const imucal_second_t* out) {
  const imucal_board_t* board = app->board;
  imucal_link_second_t record = {.t_s = raw->t_s,
                                 .n_samples = raw->n_samples > 0xFFFFu ? 0xFFFFu : (uint16_t)raw->n_samples,
                                 .is_gap = raw->is_gap,
                                 .compensated = out ? compensated_channels(app) : 0,
                                 .n_channels = board->n_channels};
  record.temp_degc = mean_unit(raw->temp_sum, raw->n_samples, board->degc_per_count, board->degc_at_zero);
  imucal_thermometer_read(&app->thermometer, raw);
  app->t_s = raw->t_s;
  app->n_seconds++;
  app->n_gaps += raw->is_gap ? 1u : 0u;
  for (uint32_t i = 0; i < board->n_channels; i++) {
    record.flags[i] = raw->flags[i];
    record.raw[i] = mean_unit(raw->sum[i], raw->n_samples, board->channel[i].unit_per_count, 0.0f);
    record.out[i] =
        out ? mean_unit(out->sum[i], out->n_samples, app->channel[i].comp.unit_per_lsb, 0.0f) : record.raw[i];
    if (app->session == IMUCAL_SESSION_CALIBRATING && (app->calibrating & (1u << i)))
      learn_channel(app, i, raw, record.raw[i]);
  }
  stream_second(app, &record);
  tell_new_faults(app, raw);
  app_watch_sensor(app);
  stream_progress(app, record.temp_degc);
}

/* ---- a sample ---- */

/* Compensates; returns the channels whose temperature was outside their span. */
static uint8_t compensate(imucal_app_t* app, const imucal_sample_t* raw, imucal_sample_t* out, uint8_t* frac_bits) {
  uint8_t clamped = 0;
  for (uint32_t i = 0; i < app->board->n_channels; i++) {
    uint32_t flags = 0;
    out->counts[i] = imucal_comp_apply(&app->channel[i].comp, raw->temp_counts, raw->counts[i], &flags);
    frac_bits[i] = app->channel[i].comp.out_frac_bits;
    if (flags & IMUCAL_COMP_TEMP_CLAMPED) clamped = (uint8_t)(clamped | 1u << i);
    if (flags & IMUCAL_COMP_SATURATED) out->saturated = (uint8_t)(out->saturated | 1u << i);
  }
  return clamped;
}

static void mark_rail(const imucal_app_t* app, imucal_sample_t* sample) {
  for (uint32_t i = 0; i < app->board->n_channels; i++) {
    const int32_t rail = app->board->channel[i].full_scale_counts;
    if (sample->counts[i] >= rail || sample->counts[i] <= -rail)
      sample->saturated = (uint8_t)(sample->saturated | 1u << i);
  }
}

static void sum_sample(imucal_app_t* app, const imucal_sample_t* raw, const imucal_sample_t* out) {
  imucal_second_t raw_second, out_second; /* both sums see the same time stamps, so both end a second at once */
  const imucal_status status = imucal_sum_add(&app->raw_sum, raw, &raw_second);
  const imucal_status out_status = imucal_sum_add(&app->out_sum, out, &out_second);
  if (status != IMUCAL_SECOND_READY) return;
  finish_second(app, &raw_second, out_status == IMUCAL_SECOND_READY ? &out_second : NULL);
  app->clamped = 0;
}

/* A sample whose time is doubted is kept: the next one may say that it was right. */
static void take_time(imucal_app_t* app, imucal_sample_t* raw, imucal_sample_t* out) {
  uint64_t t_us;
  if (!imucal_clock_take(&app->clock, raw->t_us, &t_us)) {
    app->doubted_raw = *raw;
    app->doubted_out = *out;
    return;
  }
  if (app->clock.has_released) {
    app->doubted_raw.t_us = app->doubted_out.t_us = app->clock.released_us;
    sum_sample(app, &app->doubted_raw, &app->doubted_out);
  }
  raw->t_us = out->t_us = t_us;
  sum_sample(app, raw, out);
}

void app_take_sample(imucal_app_t* app, const imucal_sample_t* sample) {
  app->n_samples++;
  if (sample->n_channels != app->board->n_channels) { /* the sensor is not this board's: nothing of it is right */
    app->n_bad_samples++;
    app->n_foreign++;
    return;
  }
  imucal_sample_t raw = *sample;
  mark_rail(app, &raw);
  imucal_sample_t out = raw;
  uint8_t frac_bits[IMUCAL_MAX_CHANNELS];
  const uint8_t clamped = compensate(app, &raw, &out, frac_bits);
  if (app->port->sample_out) app->port->sample_out(app->port->ctx, &raw, out.counts, frac_bits, clamped);
  take_time(app, &raw, &out);
  app->clamped = (uint8_t)(app->clamped | clamped);
}

void app_end_of_samples(imucal_app_t* app, imucal_status why) {
  imucal_second_t raw_second, out_second;
  const imucal_status status = imucal_sum_flush(&app->raw_sum, &raw_second);
  const imucal_status out_status = imucal_sum_flush(&app->out_sum, &out_second);
  if (status == IMUCAL_SECOND_READY)
    finish_second(app, &raw_second, out_status == IMUCAL_SECOND_READY ? &out_second : NULL);
  app_watch_sensor(app); /* what the last moments brought is told before the end is */
  app->has_sensor_ended = true;
  if (app->session == IMUCAL_SESSION_CALIBRATING) app->session = IMUCAL_SESSION_SENSOR_ENDED;
  app_event(app, IMUCAL_EVENT_SENSOR_ENDED, why, app->t_s);
}
