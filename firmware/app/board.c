// SPDX-License-Identifier: MIT
#include "board.h"

#include <string.h>

#include "num.h"
#include "sum.h"

/* The device speaks dph and mg only; what stands before the unit names the columns of a record (gx_dph, gx_flags). */
static bool is_name_good(const imucal_board_t* board, uint32_t i) {
  const char* name = board->channel[i].name;
  const size_t stem = imucal_name_stem(name), left = IMUCAL_NAME_LEN - stem;
  if (stem == 0 || !(imucal_text_equal(name + stem, "_dph", left) || imucal_text_equal(name + stem, "_mg", left)))
    return false;
  for (uint32_t k = 0; k < i; k++)
    if (imucal_name_stem(board->channel[k].name) == stem && memcmp(board->channel[k].name, name, stem) == 0)
      return false;
  return true;
}

imucal_status imucal_board_check(const imucal_board_t* board) {
  if (!imucal_text_is_valid(board->serial, sizeof board->serial)) return IMUCAL_ERR_NAME;
  if (board->n_channels < 1 || board->n_channels > IMUCAL_MAX_CHANNELS) return IMUCAL_ERR_CHANNELS;
  if (board->rate_hz < 1 || board->rate_hz > IMUCAL_SUM_MAX_RATE_HZ) return IMUCAL_ERR_RANGE;
  if (!imucal_is_finite(board->degc_per_count) || !(board->degc_per_count > 0.0f) ||
      !imucal_is_finite(board->degc_at_zero))
    return IMUCAL_ERR_SCALE;
  for (uint32_t i = 0; i < board->n_channels; i++) {
    if (!is_name_good(board, i)) return IMUCAL_ERR_NAME;
    if (!imucal_is_finite(board->channel[i].unit_per_count) || !(board->channel[i].unit_per_count > 0.0f))
      return IMUCAL_ERR_SCALE;
    if (board->channel[i].full_scale_counts < 1) return IMUCAL_ERR_RANGE;
  }
  return IMUCAL_OK;
}
