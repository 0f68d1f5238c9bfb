// SPDX-License-Identifier: MIT
#include "analysis/diagnose/evidence/constants.h"

namespace imucal {

namespace {

using C = SelectorConstants;

std::vector<SelectorConstant> of_search() {
  return {
      {"mean_nats", &C::mean_nats, "what a name in the mean must gain, where no draws of the noise set it",
       "about 1 in 400 for one name", false},
      {"noise_nats", &C::noise_nats, "what a kind of slow noise must gain to be named",
       "three parameters: chi2/2 at 1 in 140", false},
      {"step_nats", &C::step_nats, "what one jump in time must gain", "logarithm of the number of places: 3000 blocks",
       false},
      {"first_step_nats", &C::first_step_nats, "what jumps in time must gain beyond that together, at 1 in 100",
       "3 of 839 devices without a gap gained that: half of the rate is left to names", false},
      {"step_try_part", &C::step_try_part, "part of step_nats at a grid place from which a jump is polished",
       "a place between two blocks loses up to two thirds", true},
      {"reestimated_nats", &C::reestimated_nats, "what other noise parameters than the believed ones cost",
       "three parameters at 1 in 140; tried in the study of the method", false},
      {"noise_kind_nats", &C::noise_kind_nats, "what another kind of slow noise costs, alone too",
       "a repeatable cause must lose by odds of 20 to 1", false},
      {"near_nats", &C::near_nats, "how far below the best a candidate is still polished",
       "what polishing gains at most", false},
      {"near_part", &C::near_part, "the same as a part of what the best gains", "coarse grids lose a share of the gain",
       true},
      {"below_null_nats", &C::below_null_nats, "how far below no name a candidate is still polished",
       "polishing gains a little", false},
      {"more_names_nats", &C::more_names_nats, "what one name must gain before pairs are looked for",
       "a pair of which neither member shows is not asked for: time", false},
      {"rivals_nats", &C::rivals_nats, "how much less a rival may gain and stand in the printed set", "odds of 20 to 1",
       false},
      {"member_share", &C::member_share, "part of the gain of a free shape from which a member is the answer",
       "real shapes miss the library's by up to this (five mechanisms of hysteresis)", true},
      {"polish_gain_nats", &C::polish_gain_nats, "added to the threshold: what data gain by polishing and draws do not",
       "in 19 campaigns draws gained at most 0.96 by polishing", false},
      {"least_threshold_nats", &C::least_threshold_nats, "smallest threshold of a name",
       "150 draws do not promise less", false},
      {"most_threshold_nats", &C::most_threshold_nats, "largest threshold of a name",
       "a tail fitted to 30 draws can run away", false},
  };
}

std::vector<SelectorConstant> of_selection() {
  return {
      {"family_margin_nats", &C::family_margin_nats, "margin below which members are one family", "odds of 7 to 1",
       false},
      {"least_held_out_nats", &C::least_held_out_nats, "what a name must gain on data that were not fitted",
       "at 2: 336 true names kept, 14 of 55 false ones removed; half of it", false},
      {"predicted_part", &C::predicted_part,
       "part of its gain, or of what logs that were not fitted can show of it, that a name must have there",
       "a repeatable cause: 0.3 to 4 (development cases); one that does not come back: 0.1 and less", true},
      {"short_by_chance", &C::short_by_chance,
       "standard errors by which a name may gain too little beyond its start states while all of it foretells the logs",
       "a right name in 1 of 100", false},
      {"undecided_nats", &C::undecided_nats, "how much less a repeatable cause may gain than slow noise and stay open",
       "odds of 50 to 1", false},
      {"carried_part", &C::carried_part, "part of the spread that it must not leave to the noise",
       "a rival takes half of the variance", true},
      {"slow_tau_part", &C::slow_tau_part, "part of the longest log from which a time constant is slow",
       "a ramp lasts a twentieth of a log; with 0.02 four more of 839 devices without a gap were left open", true},
      {"agreed_tau_part", &C::agreed_tau_part, "the same where the noise is as the model says, or no model says any",
       "noise of 200 s in healthy logs of 12 to 60 min; true causes that a fitted noise had taken: 0.38 and more",
       true},
      {"growth_part", &C::growth_part, "growth of the held-out residual beyond which nothing is 'explained'",
       "rounding and the constant of a run", true},
      {"noise_errors", &C::noise_errors,
       "chance that noise and errors of the fit alone leave so much on held-out data, as standard errors of a normal "
       "number",
       "1 in 740", false},
      {"noise_times", &C::noise_times,
       "times noise and errors of the fit that the held-out residual is at most where a gap is 'explained', or is none",
       "170 right answers: 1.34 in 98 of 100 (development cases)", false},
      {"lack_nats", &C::lack_nats, "what a free shape must gain beside an answer to be held against it",
       "odds of 20 to 1", false},
      {"lack_part", &C::lack_part, "the same as a part of all that is explained then",
       "right names: up to 0.08, wrong ones 0.11 and more (development cases)", true},
      {"foretold_nats", &C::foretold_nats,
       "what a free shape that costs less than lack_nats beside an answer must gain on data that were not fitted",
       "likelihood ratio of data not fitted: 1 in 150 at most", false},
      {"foretold_part", &C::foretold_part,
       "part of what a right name foretells of other logs that noise which jumps has to make up for before it takes "
       "its place",
       "half of the mean of right names", true},
      {"least_share", &C::least_share, "share of the gain of the least of three causes from which they are a stand-in",
       "two causes hold nine tenths where there are not three", true},
      {"beside_free_part", &C::beside_free_part,
       "part of all that is explained from which a name stands beside a free shape that holds more",
       "wrong names beside it held 0.04 to 0.26 (34 answers with one, development cases)", true},
      {"noise_margin_nats", &C::noise_margin_nats, "margin below which kinds of slow noise are one family",
       "power laws between them are nearer to one kind than to another by this", false},
      {"against_nats", &C::against_nats, "what held-out logs must lose by jumps or by a kind of noise to reject it",
       "odds of 20 to 1", false},
  };
}

std::vector<SelectorConstant> of_seconds() {
  return {
      {"fast_nats", &C::fast_nats, "what a kind of fast noise must gain", "three parameters and the choice of kinds",
       false},
      {"line_nats", &C::line_nats, "what a line in the spectrum must gain",
       "largest of 10^5 frequencies exceeds 11.5 in 2 of 3, 22 in 1 of 36 000", false},
      {"drift_nats", &C::drift_nats, "the same for a line that drifts with temperature",
       "49 slopes more; largest of 10 draws was 25.6", false},
      {"retuned_nats", &C::retuned_nats, "what other noise parameters must gain in the seconds to be remarked",
       "three parameters: chi2/2 at 1 in 300, of REML likelihoods", false},
      {"rest_rate", &C::rest_rate, "rate at which each test of what is left fires on a right model", "stated", true},
      {"rest_line_nats", &C::rest_line_nats, "line in what is left that the tests object to",
       "1 in 1000 exceeds about 18", false},
      {"shared_nats", &C::shared_nats, "what noise shared by two axes must gain",
       "chi2/2 of one parameter at 1 in 16 000: fifteen pairs of axes", false},
  };
}

} // namespace

const std::vector<SelectorConstant>& selector_constants() {
  static const std::vector<SelectorConstant> list = [] {
    std::vector<SelectorConstant> all = of_search();
    for (const auto& more : {of_selection(), of_seconds()}) all.insert(all.end(), more.begin(), more.end());
    return all;
  }();
  return list;
}

} // namespace imucal
