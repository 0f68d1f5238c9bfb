// SPDX-License-Identifier: MIT
// Places of a cause: pieces of the data that hold most of it, while the rest holds clearly less.
#pragma once
#include <cstddef>
#include <vector>

namespace imucal {

// A piece of the data: how many samples it has, and how much of the cause.
struct Piece {
  double n = 0, weight = 0;
  void add(const Piece& other) { n += other.n, weight += other.weight; }
};
Piece sum_of(const std::vector<Piece>& pieces);

// The part of a cause that a place holds at least, and how many times as much a sample of it holds as one of the rest.
constexpr double kMostOfCause = 0.8, kTimesRestOfCause = 4;
bool is_place(const Piece& place, const Piece& whole);

// The shortest span of neighbours, first and last, that is a place and no more than half of the samples; first > last: none is.
struct PieceSpan {
  size_t first = 1, last = 0;
  double n = 0; // samples
  bool is_any() const { return first <= last; }
};
PieceSpan span_of_cause(const std::vector<Piece>& pieces);
// The fewest pieces that are a place together, in order; empty: none are.
std::vector<size_t> pieces_of_cause(const std::vector<Piece>& pieces);

} // namespace imucal
