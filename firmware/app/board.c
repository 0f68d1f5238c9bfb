// SPDX-License-Identifier: MIT
#include "board.h"

#include "num.h"
#include "sum.h"

imucal_status imucal_board_check(const imucal_board_t* board) {
  if (!imucal_text_is_valid(board->serial, sizeof board->serial)) return IMUCAL_ERR_NAME;
  if (board->n_channels < 1 || board->n_channels > IMUCAL_MAX_CHANNELS) return IMUCAL_ERR_CHANNELS;
  if (board->rate_hz < 1 || board->rate_hz > IMUCAL_SUM_MAX_RATE_HZ) return IMUCAL_ERR_RANGE;
  if (!imucal_is_finite(board->degc_per_count) || !(board->degc_per_count > 0.0f) ||
      !imucal_is_finite(board->degc_at_zero))
    return IMUCAL_ERR_SCALE;
  for (uint32_t i = 0; i < board->n_channels; i++) {
    if (!imucal_text_is_valid(board->channel[i].name, sizeof board->channel[i].name)) return IMUCAL_ERR_NAME;
    if (!imucal_is_finite(board->channel[i].unit_per_count) || !(board->channel[i].unit_per_count > 0.0f))
      return IMUCAL_ERR_SCALE;
    if (board->channel[i].full_scale_counts < 1) return IMUCAL_ERR_RANGE;
  }
  return IMUCAL_OK;
}
