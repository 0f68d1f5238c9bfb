// SPDX-License-Identifier: MIT
// A valid table of n channels whose content depends on `mark`, for tests of table and store.
#ifndef TESTS_COMMON_TABLE_EXAMPLE_H
#define TESTS_COMMON_TABLE_EXAMPLE_H
#include <stdio.h>
#include <string.h>

#include "table.h"

static inline imucal_table_t example_table(int n_channels, int mark) {
  static const char* const names[] = {"gx_dph", "gy_dph", "gz_dph", "ax_mg", "ay_mg", "az_mg"};
  imucal_table_t t;
  memset(&t, 0, sizeof t);
  strcpy(t.serial, "SN-17");
  t.sequence = 1;
  t.created_s = 1767225600u + (uint32_t)mark;
  t.n_channels = (uint8_t)n_channels;
  t.degc_per_count = 0.01f;
  t.degc_at_zero = 25.0f;
  for (int i = 0; i < n_channels; i++) {
    imucal_table_channel_t* c = &t.channel[i];
    strcpy(c->name, names[i]);
    c->order = 3;
    c->scale_order = 1;
    c->n_markov = 1;
    c->t0_degc = 30;
    c->range_degc = 30;
    for (int k = 0; k <= 3; k++) c->coeff[k] = (float)(mark + 10 * i + k) + 0.25f;
    c->scale_coeff[1] = 0.001f;
    c->span_lo_degc = 0;
    c->span_hi_degc = 60;
    for (int k = 0; k < IMUCAL_TABLE_SIGMA_N; k++) c->sigma[k] = 5.0f + (float)k;
    c->arw = 0.6f;
    c->markov_sigma[0] = 20;
    c->markov_tau_s[0] = 100;
    c->unit_per_count = 18;
    c->full_scale_counts = 32767;
    c->n_seconds = 8400;
  }
  return t;
}
#endif
