// SPDX-License-Identifier: MIT
// Discrete Fourier transforms whose length is a power of two: X_k = sum_t x_t exp(-2 pi i k t / n).
//
// In place, by decimation in frequency in steps of four (Gentleman and Sande 1966); a last step of two where four do not
// divide the length.  What comes out stands in the order of reversed digits: `place` says where.  A part of 256 numbers
// goes through all its steps while it is in the first cache.  Threads: transforms may share an object.
// Why not a library's: Eigen's transforms one sequence after the other, which was a quarter of a diagnosis without a gap; those
// that set sequences side by side are not packaged or not under a licence that suits.
#pragma once
#include <cstddef>
#include <vector>

namespace imucal {

class Fourier {
public:
  explicit Fourier(size_t n); // a power of two, at least 4
  size_t n() const { return n_; }
  // Where frequency k, 0 .. n - 1, stands in a transform.
  size_t place(size_t k) const { return place_[k]; }

  // One sequence, in place; re and im: n numbers each.
  void transform(double* re, double* im) const { transform(1, re, im); }
  // kLanes sequences side by side, number t of sequence l at kLanes t + l.  Each gives the bits that it gives alone.
  static constexpr size_t kLanes = 8;
  void transform_lanes(double* re, double* im) const { transform(kLanes, re, im); }

private:
  void transform(size_t lanes, double* re, double* im) const;

  size_t n_;
  std::vector<size_t> place_;
  std::vector<double> turns_; // step after step; of each j: cosine and sine of j, 2 j and 3 j parts of a turn
};

// re^2 + im^2 times `scale`, place by place, added to sum.
void add_squares(const std::vector<double>& re, const std::vector<double>& im, double scale, std::vector<double>* sum);

// |X_k|^2 of a real sequence of n numbers (or two: `other` may be nullptr) at k = 0 .. n/2, times its scale, added to sum.
// Takes the sequences as scratch.
void add_powers(const Fourier& fourier, double* sequence, double scale, double* other, double other_scale,
                std::vector<double>* sum);

} // namespace imucal
