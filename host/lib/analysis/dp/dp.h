// SPDX-License-Identifier: MIT
// Allan deviation and Direct Predictor (paper section II, reference figures C, tests/README.md).
//
// Prediction error of the mean of the next n samples at t0:  d = mean(x[t0 .. t0+n)) - prediction, and
// DP(tau) = sigma_EST{d over t0} / sqrt(2), tau = n dt.  The prediction is
//   AV    mean of the n samples before t0 (over all t0 this is the overlapping Allan deviation)
//   DP1   mean of a fixed number of samples before t0
//   DP2   the nominal model's steady-state Kalman estimate after the sample before t0
//   DP3   that estimate, optimally predicted over the n samples
// A window counts when at least the part min_fill of its samples is present, and of those it is predicted from
// (min_fill = 1: all of them); the mean of these is taken.  Nothing is interpolated.  DP2 and DP3 need
// warm_up_n() samples before t0 at the start of a record and after a gap.  Where min_fill < 1 allows a missing
// sample, the filter predicts over it without a measurement.
//
// Memory: 8 bytes per sample for the running sums, 8 more per nominal Markov term for DP2 and DP3, 4 more where
// samples are missing.  Time: one pass over the samples per tau, all taus block by block through the cache; missing
// samples only cut the record into runs, unless min_fill < 1 lets windows have some.
#pragma once
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "analysis/dp/nominal_filter.h"
#include "analysis/dp/second_differences.h"
#include "analysis/dp/series.h"
#include "analysis/dp/sizes.h"

namespace imucal {

enum class DpType { kAv, kDp1, kDp2, kDp3 };
DpType dp_type_from_text(const std::string& text); // av dp1 dp2 dp3; usage_error otherwise
std::string to_text(DpType type);

// sigma_EST: rms; the largest |d| over 3; the 95.4th percentile of |d| over 2.
enum class DpEstimator { kRms, kMax, kP95 };
DpEstimator dp_estimator_from_text(const std::string& text);
std::string to_text(DpEstimator estimator);

struct DpOperator {
  DpType type = DpType::kAv;
  double dt_s = 1;
  long estimation_n = 20; // DP1
  NominalFilter filter;   // DP2, DP3
  double min_fill = 1;    // part of a window's samples that must be present

  // Samples before t0 that a window of n needs.
  long history_n(long n) const;
};

// usage_error: DP2 or DP3 without a nominal model, or with one that has nothing to estimate.
DpOperator make_dp_operator(DpType type, double dt_s, const std::optional<ErrorModel>& nominal,
                            double estimation_s = 20.0);

// One record made ready for an operator.  The series should be detrended: a mean other than 0 falsifies DP2 and
// DP3, and costs digits in AV and DP1.
class DpRecord {
public:
  // `initial`: the nominal filter's states before the first sample (empty: zero, to be warmed up).
  DpRecord(const RateView& rates, const DpOperator& op, const std::vector<double>& initial = {});

  // Number of windows if there were no gaps.  Below 1: tau is too long for the record.
  long possible_windows(long n) const { return size_ - n - op_.history_n(n) + 1; }
  const DpOperator& op() const { return op_; }
  long size() const { return size_; }

  // All prediction errors d of one n, with their t0 (index of the first predicted sample).
  void samples(long n, std::vector<double>* d, std::vector<long>* t0, long first_t0 = 0) const;

  // The transposed operator: sum over k of d[k] times the weights that the window at t0[k] gives the samples.
  std::vector<double> adjoint(long n, const std::vector<double>& d, const std::vector<long>& t0) const;

  // Sum of squares of d of some windows.
  struct Sum {
    double sum_sq = 0;
    long count = 0;
    double mean_square() const { return count > 0 ? sum_sq / static_cast<double>(count) : 0; }
  };
  // The same in consecutive blocks of t0, for every n: bounded memory, one streaming pass.
  struct Moments {
    std::vector<double> sum_sq; // per block
    std::vector<long> count;    // per block
    Sum whole() const;
    long n_windows() const { return whole().count; }
    double mean_square() const { return whole().mean_square(); }
  };
  // `first_t0`, one per n: only windows from there on (empty: all).
  std::vector<Moments> moments(const std::vector<long>& n, const std::vector<long>& first_t0 = {}) const;

  // Of windows that begin n/per_window apart, one sum for each n.
  std::vector<Sum> sums_of_some(const std::vector<long>& n, long per_window) const;

  // How large d is, for every n, in bounded memory.  Percentile: exact (sizes.h).
  struct Size {
    long n_windows = 0;
    double percentile = 0, largest = 0; // of |d|
  };
  std::vector<Size> sizes(const std::vector<long>& n) const;

private:
  void find_runs(const RateView& rates);
  void run_filter(const RateView& rates, const std::vector<double>& initial);
  using Range = T0Range;
  struct Walk;
  // Where no window of n has a missing sample; only for records with whole windows.
  std::vector<Range> whole_windows(long n, long first_t0) const;
  bool has_whole_windows() const { return present_.empty() || op_.min_fill >= 1; }
  std::vector<double> prediction_factors(long n) const;
  // d of whole windows, t0 in [first, last).
  void errors(long n, const std::vector<double>& factor, Range t0, double* d) const;
  Walk walk(const std::vector<long>& n, size_t place, long first_t0, long per_window, long piece) const;
  Range take(long end, Walk* walk) const;
  double sum_of_squares(const Walk& walk, Range t0) const;
  bool add_squares(long end, size_t count, Walk* walks) const;
  void advance(long begin, long end, std::vector<Walk>* walks) const;
  std::vector<double> sizes_of_some(long n, const std::vector<Range>& t0) const;
  void add_sizes(const std::vector<long>& n, std::vector<Size>* out) const;
  Size size_of_all(long n) const;
  void samples_of_filled(long n, std::vector<double>* d, std::vector<long>* t0, long first_t0) const;
  void moments_of_filled(const std::vector<long>& n, const std::vector<long>& first_t0, long block,
                         std::vector<Moments>* out) const;
  double estimate(long n, long t0) const;
  bool complete(long first, long last) const;
  double window_sum(long first, long last, long n) const;

  DpOperator op_;
  long size_ = 0;
  std::unique_ptr<double[]> sum_;           // size + 1 running sums
  std::vector<int> present_;                // running counts; empty where nothing is missing
  std::vector<Range> runs_;                 // of samples that are there, one after the other
  std::vector<std::vector<double>> states_; // per nominal term: estimate before sample t0
};

// sigma_EST of the values d.  May reorder d and replace it by |d|.
double dp_sigma(DpEstimator estimator, std::vector<double>* d);

// A curve of one record.
struct DpCurve {
  std::string log, axis;
  DpType type = DpType::kAv;
  DpEstimator estimator = DpEstimator::kRms;
  std::vector<double> tau_s, dp_dph;
  std::vector<long> n; // windows used
  std::vector<DpRecord::Moments>
      moments; // rms only, of windows at every sample: what confidence intervals by blocks need
};

// Curve of a record at tau_s (multiples of dt).  data_error where tau is beyond the record or no window is
// complete, and for a record that is constant.
// `per_window` (rms only, records with whole windows): windows begin n/per_window apart instead of at every sample, and there
// are no moments by blocks but one sum.
DpCurve dp_curve(const Series& series, const DpRecord& record, const std::vector<double>& tau_s, DpEstimator estimator,
                 long per_window = 0);
// The same of the rates that `record` was made from, where they lie; log and axis are what messages name.
DpCurve dp_curve(const std::string& log, const std::string& axis, const RateView& rates, const DpRecord& record,
                 const std::vector<double>& tau_s, DpEstimator estimator, long per_window = 0);

} // namespace imucal
