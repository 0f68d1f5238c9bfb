// SPDX-License-Identifier: MIT
// The gap on data that were not fitted, in words: how far it shrinks, and what is left.
#pragma once
#include <string>
#include <vector>

#include "analysis/diagnose/diagnose.h"

namespace imucal {

// The answer claims a shrinkage, and the data tell it well enough for a figure.
bool has_figure(const AxisResult& axis);
// What a stand-in removes; a figure of which the residual says the contrary is none.
bool has_stand_in(const AxisResult& axis);

// How far the gap shrinks on data that were not fitted, or why that is not known; empty: not asked.
std::string held_out_statement(const AxisResult& axis);
// What is left, in a sentence.
std::string remainder(const AxisResult& axis);

const char* held_out_text(HeldOut method);
const char* rest_text(Rest test); // what a test of what is left found
// Jumps in time, one after the other.
std::string steps_text(const std::vector<StepValue>& steps, bool tells_log, const char* unit);

} // namespace imucal
