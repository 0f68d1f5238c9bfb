// SPDX-License-Identifier: MIT
#include "learn.h"

#include "num.h"

void imucal_thermometer_init(imucal_thermometer_t* thermometer, float degc_per_count, float degc_at_zero) {
  *thermometer = (imucal_thermometer_t){.degc_per_count = degc_per_count,
                                        .degc_at_zero = degc_at_zero,
                                        .is_tracked = degc_per_count > IMUCAL_TRACK_COARSE_DEGC};
  imucal_track_init(&thermometer->track);
}

void imucal_thermometer_read(imucal_thermometer_t* thermometer, const imucal_second_t* second) {
  int64_t mean_q16 = imucal_mean_q16_rne(second->temp_sum, second->n_samples);
  thermometer->is_sure = true;
  if (thermometer->is_tracked) {
    imucal_track_skip(&thermometer->track, second->n_skipped);
    mean_q16 = imucal_track_update(&thermometer->track, mean_q16);
    thermometer->is_sure = thermometer->track.is_sure;
  }
  thermometer->temp_degc = imucal_unit_from_q16(mean_q16, thermometer->degc_per_count, thermometer->degc_at_zero);
}

imucal_status imucal_learn_init(imucal_learn_t* learn, const imucal_kf_config_t* config) {
  if (learn == NULL) return IMUCAL_ERR_ARGUMENT;
  const imucal_status status = imucal_kf_init(&learn->kf, config);
  if (status != IMUCAL_OK) return status;
  for (uint32_t i = 0; i < IMUCAL_LEARN_N_OUTCOMES; i++) learn->n[i] = 0;
  learn->n_gap_s = 0;
  return IMUCAL_OK;
}

/* A gap longer than the filter takes at once leaves nothing of the Markov state either way.  The filter
 * refuses before init only, and then there is nothing to bridge. */
static void bridge(imucal_kf_t* kf, uint32_t n_s) {
  const imucal_status status = imucal_kf_skip(kf, n_s < IMUCAL_KF_MAX_GAP_S ? n_s : IMUCAL_KF_MAX_GAP_S);
  (void)status;
}

imucal_learn_outcome_t imucal_learn_take(imucal_learn_t* learn, const imucal_learn_input_t* input) {
  imucal_learn_outcome_t outcome = input->verdict;
  bridge(&learn->kf, input->gap_s);
  learn->n_gap_s += input->gap_s;
  if (outcome == IMUCAL_LEARN_USED &&
      imucal_kf_update_scaled(&learn->kf, input->value, input->temp_degc, input->noise_ratio) != IMUCAL_OK)
    outcome = IMUCAL_LEARN_REFUSED;
  if (outcome != IMUCAL_LEARN_USED) bridge(&learn->kf, 1);
  learn->n[outcome]++;
  return outcome;
}

imucal_learn_outcome_t imucal_learn_checked(imucal_learn_t* learn, imucal_health_t* health,
                                            const imucal_learn_input_t* input, uint32_t flags) {
  const bool is_measured = input->verdict == IMUCAL_LEARN_USED && imucal_is_finite(input->value);
  imucal_learn_input_t checked = *input;
  if (!imucal_health_second(health, input->value, input->temp_degc, flags, is_measured, input->gap_s) && is_measured)
    checked.verdict = IMUCAL_LEARN_TEMPERATURE;
  const imucal_kf_t before = learn->kf;
  const imucal_learn_outcome_t outcome = imucal_learn_take(learn, &checked);
  const imucal_kf_stats_t* last = &learn->kf.stats;
  if (outcome != IMUCAL_LEARN_USED || imucal_health_gate(health, last->innovation, last->innovation_weight))
    return outcome;
  learn->kf = before;
  bridge(&learn->kf, input->gap_s);
  bridge(&learn->kf, 1);
  learn->n[IMUCAL_LEARN_USED]--;
  learn->n[IMUCAL_LEARN_KNOCK]++;
  return IMUCAL_LEARN_KNOCK;
}

/* Is the second a measurement of this channel?  The first reason against it. */
static imucal_learn_outcome_t verdict_of(const imucal_thermometer_t* thermometer, const imucal_second_t* second,
                                         uint32_t flags) {
  if (second->is_gap) return IMUCAL_LEARN_MISSING;
  if ((flags & IMUCAL_FLAG_FAULT) != 0) return IMUCAL_LEARN_FAULT;
  if ((flags & IMUCAL_FLAG_SATURATED) != 0) return IMUCAL_LEARN_SATURATED;
  if (!thermometer->is_sure) return IMUCAL_LEARN_TEMPERATURE;
  return IMUCAL_LEARN_USED;
}

imucal_learn_input_t imucal_learn_input_of(const imucal_thermometer_t* thermometer, const imucal_sum_t* sum,
                                           const imucal_second_t* second, uint32_t i_channel, float value) {
  return (imucal_learn_input_t){.value = value,
                                .temp_degc = thermometer->temp_degc,
                                .noise_ratio = imucal_sum_noise_ratio(sum, second, i_channel),
                                .gap_s = second->n_skipped,
                                .verdict = verdict_of(thermometer, second, second->flags[i_channel])};
}

imucal_learn_outcome_t imucal_learn_second(imucal_learn_t* learn, const imucal_thermometer_t* thermometer,
                                           const imucal_sum_t* sum, const imucal_second_t* second, uint32_t i_channel,
                                           float value) {
  const imucal_learn_input_t input = imucal_learn_input_of(thermometer, sum, second, i_channel, value);
  return imucal_learn_take(learn, &input);
}
