// SPDX-License-Identifier: MIT
// Which kinds of noise, and which causes, cannot be excluded beside an effect of the answer: they join its set.
#pragma once
#include "analysis/diagnose/stages/slow_answer.h"

namespace imucal {

// Kinds of slow noise that gain less than an answer by less than this, best first.
void add_kinds_within(const AxisQuestion& question, const SlowAnswer& slow, double margin_nats, const SlowModel& answer,
                      SelectedEffect* effect);
// Causes in the mean, those that differ from run to run among them, that do as well as a kind of slow noise alone.
void add_means_that_do_as_well(const AxisQuestion& question, const SlowAnswer& slow, SelectedEffect* effect);
// Causes in the mean that do as well as the jumps in time of slow.found.best without any.
void add_means_without_steps(const AxisQuestion& question, const SlowAnswer& slow, SelectedEffect* steps);
// Kinds of noise beside the believed one, or beside other parameters, that do as well as these parameters.
void add_kinds_of_noise(const AxisQuestion& question, const SlowAnswer& slow, SelectedEffect* retuned);
// Telegraph noise has the spectrum of a Markov process: where this one stands in a set of slow noises and the seconds did
// not tell the two by their distribution, neither is excluded.
void add_same_spectrum(const AxisQuestion& question, SelectedEffect* effect);
// Effects that jump at a temperature, where jumping there once is as likely as the jumps in time of slow.found.best: logs
// that pass that temperature once do not tell the two.
void add_jumps_at_temperature(const AxisQuestion& question, const SlowAnswer& slow, SelectedEffect* steps);
// Jumps in time that come again and again are a noise: its family is told.
void open_jumps(const AxisQuestion& question, SelectedEffect* effect);
// Jumps in time that come again at the same temperatures: the family of the cause is told, a function of temperature or a memory.
void follow_temperature(const AxisQuestion& question, bool are_loops, SelectedEffect* effect);

} // namespace imucal
