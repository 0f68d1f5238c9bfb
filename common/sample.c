// SPDX-License-Identifier: MIT
#include "sample.h"

#include "num.h"

void imucal_sample_encode(const imucal_sample_t* sample, uint8_t record[IMUCAL_SAMPLE_RECORD_BYTES]) {
  record[0] = IMUCAL_SAMPLE_MARKER;
  record[1] = sample->n_channels;
  record[2] = sample->saturated;
  record[3] = sample->fault;
  imucal_put_u32(record + 4, (uint32_t)sample->temp_counts);
  imucal_put_u64(record + 8, sample->t_us);
  for (uint32_t i = 0; i < IMUCAL_MAX_CHANNELS; i++)
    imucal_put_u32(record + 16 + 4 * i, i < sample->n_channels ? (uint32_t)sample->counts[i] : 0u);
}

imucal_status imucal_sample_decode(const uint8_t record[IMUCAL_SAMPLE_RECORD_BYTES], imucal_sample_t* sample) {
  if (record[0] != IMUCAL_SAMPLE_MARKER) return IMUCAL_ERR_SYNC;
  if (record[1] == 0 || record[1] > IMUCAL_MAX_CHANNELS) return IMUCAL_ERR_CHANNELS;
  sample->n_channels = record[1];
  sample->saturated = record[2];
  sample->fault = record[3];
  sample->temp_counts = (int32_t)imucal_get_u32(record + 4);
  sample->t_us = imucal_get_u64(record + 8);
  for (uint32_t i = 0; i < IMUCAL_MAX_CHANNELS; i++) sample->counts[i] = (int32_t)imucal_get_u32(record + 16 + 4 * i);
  return IMUCAL_OK;
}
