// SPDX-License-Identifier: MIT
// One axis of one log on an even time grid: what the operators and the fits work on.
//
// Memory: 8 bytes per sample and axis (16 with temperature).  Each time stamp is compared with the one before it,
// so that a slowly drifting clock does no harm.  A missing row, an empty field, or a second flagged as saturated or
// faulty becomes NaN.  Nothing is ever interpolated.
#pragma once
#include <functional>
#include <string>
#include <vector>

namespace imucal {

struct Series {
  std::string log, axis;
  double t0_s = 0; // time stamp of sample 0
  double dt_s = 1;
  std::vector<double> rate_dph;  // NaN where missing (mg for accelerometers)
  std::vector<double> temp_degc; // empty where the log has none or it was not asked for; NaN where missing
  long n_missing = 0;            // of rate_dph
  long n_flagged = 0;            // of these: seconds the log flags as saturated or faulty

  long size() const { return static_cast<long>(rate_dph.size()); }
  double t_s(long i) const { return t0_s + static_cast<double>(i) * dt_s; }
};

// Rates where they lie: nothing is copied, and `offset_dph` is taken from each on the way.  The memory must outlive the view.
struct RateView {
  const double* rate_dph = nullptr; // NaN where missing
  long size = 0;
  long n_missing = 0;
  double offset_dph = 0;

  RateView() = default;
  RateView(const Series& series) : rate_dph(series.rate_dph.data()), size(series.size()), n_missing(series.n_missing) {}
  // Counts the missing ones.  `is_mean_removed`: the offset is their mean, bit for bit as remove_trend finds it.
  RateView(const double* rate_dph, long size, bool is_mean_removed);

  double operator[](size_t i) const { return rate_dph[i] - offset_dph; }
  bool is_missing(size_t i) const { return n_missing > 0 && rate_dph[i] != rate_dph[i]; }
};

// Reads the named axes (all when empty) of a log.  data_error: unknown axis, fewer than two samples of an axis,
// two rows within half a step, a gap that would need more than 1e9 samples.
std::vector<Series> load_series(const std::string& path, const std::vector<std::string>& axes, bool with_temp);

// The same sample by sample in bounded memory: `begin` once (it knows axes, first time stamp and step), then `sample` for
// every place of the grid and every axis in turn; a missing sample is NaN.
struct SeriesHeader {
  std::string log;
  std::vector<std::string> axes;
  double t0_s = 0, dt_s = 1;
  size_t expected_rows = 0; // a guess, for reserving; 0: unknown
};
SeriesHeader scan_series(const std::string& path, const std::vector<std::string>& axes,
                         const std::function<void(const SeriesHeader&)>& begin,
                         const std::function<void(size_t axis, double rate, double temp_degc, bool flagged)>& sample);

// The step q, in dph, of which all rates are multiples (but for a constant); 0 where no step is seen.  Give it raw rates,
// before any detrending.  A step is seen where values repeat (fewer distinct ones than a tenth of the samples, and than 100,000) and differ
// by multiples of the smallest difference, to the last digit written.  Rounding to the step q adds white noise of variance
// q^2/12 where the other noise is larger than half a step.
double quantum_dph(const Series& series);

// What is fitted to the rates and removed before anything else.
struct Detrend {
  enum class Kind { kNone, kMean, kPolyTemperature, kPolyTime } kind = Kind::kMean;
  int order = 0;
  // "none", "mean", "poly:N" (in temperature), "time:N" (in time).  usage_error otherwise.
  static Detrend parse(const std::string& text);
  std::string text() const;
};

// What `detrend` removes, as columns that are orthonormal over the samples present; the row of a missing sample is
// zero.  Empty for kNone.  data_error: too few different temperatures for the polynomial's order; a rate whose
// temperature is missing.
std::vector<std::vector<double>> detrend_basis(const Series& series, const Detrend& detrend);

// Removes what lies along columns of detrend_basis.
void remove_columns(const std::vector<std::vector<double>>& basis, Series* series);

// What `detrend` removes from records of one shape, such as simulated ones: the same as remove_columns(detrend_basis(shape,
// detrend), record) but for rounding.  Of a shape without gaps it keeps the argument of the polynomials alone and makes them
// anew in registers: a record of millions of samples waits for memory, not for multiplications.
class Trend {
public:
  // data_error as detrend_basis.
  Trend(const Series& shape, const Detrend& detrend);
  // `record` misses the samples that the shape misses.
  void remove_from(Series* record) const;

private:
  std::vector<double> x_;
  std::vector<std::vector<double>> combinations_; // orthonormal columns as sums of Chebyshev polynomials
  std::vector<std::vector<double>> columns_;      // the same as they are, of a shape with gaps
};

// Removes it, missing samples left missing.
void remove_trend(const Detrend& detrend, Series* series);

} // namespace imucal
