// SPDX-License-Identifier: MIT
// The verdict of an axis: one of four words, from facts that have a name each.
#pragma once

namespace imucal {

enum class Verdict { kNoGap, kExplained, kPartlyExplained, kUnexplained };

// What is told, notes apart: what the recorder did, or axes share, where it is a small part of the noise, is no answer.
struct Told {
  bool answer = false;     // anything
  bool cause = false;      // a member, or a family whose shape was seen
  bool open_shape = false; // a family whose shape is open, or was not seen
  bool undecided = false;  // slow noise, and a cause would explain it as well
};

// What the answer leaves, or does wrong.
struct Left {
  bool finding =
      false; // tests of what is left, in fitted or held-out logs; jumps or stronger noise that held-out logs have of
             // their own; a name that they do not support
  bool shape = false; // a free shape, or a cause that may not be named, gains beside the answer
  bool minutes =
      false; // held-out minutes scatter so much more than noise and errors of the fit that nothing is explained
  bool are_of_one_passage = false; // these minutes: a polynomial says little beyond the rows that it was fitted to
  bool growth = false;             // the residual of held-out minutes grows by what is told
  bool part = false;               // surely a part of the gap, by the interval of the shrinkage
};

Verdict verdict_of(const Told& told, const Left& left);

} // namespace imucal
