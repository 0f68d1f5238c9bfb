// SPDX-License-Identifier: MIT
#include "analysis/diagnose/evidence/place.h"

#include <algorithm>
#include <numeric>

namespace imucal {

namespace {

double density(const Piece& piece) {
  return piece.n > 0 ? piece.weight / piece.n : 0;
}

} // namespace

Piece sum_of(const std::vector<Piece>& pieces) {
  Piece sum;
  for (const Piece& piece : pieces) sum.add(piece);
  return sum;
}

bool is_place(const Piece& place, const Piece& whole) {
  const Piece rest{whole.n - place.n, whole.weight - place.weight};
  if (!(place.weight > 0) || !(rest.n > 0)) return false;
  return place.weight >= kMostOfCause * whole.weight && density(place) >= kTimesRestOfCause * density(rest);
}

PieceSpan span_of_cause(const std::vector<Piece>& pieces) {
  const Piece whole = sum_of(pieces);
  PieceSpan best;
  double shortest = whole.n;
  for (size_t first = 0; first < pieces.size(); ++first) {
    Piece span;
    for (size_t last = first; last < pieces.size() && span.n < shortest; ++last) {
      span.add(pieces[last]);
      if (2 * span.n <= whole.n && span.n < shortest && is_place(span, whole))
        best = {first, last, span.n}, shortest = span.n;
    }
  }
  return best;
}

std::vector<size_t> pieces_of_cause(const std::vector<Piece>& pieces) {
  std::vector<size_t> order(pieces.size()), chosen;
  std::iota(order.begin(), order.end(), size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](size_t a, size_t b) { return density(pieces[a]) > density(pieces[b]); });
  const Piece whole = sum_of(pieces);
  Piece place;
  for (size_t i : order) {
    place.add(pieces[i]), chosen.push_back(i);
    if (!is_place(place, whole)) continue;
    std::sort(chosen.begin(), chosen.end());
    return chosen;
  }
  return {};
}

} // namespace imucal
