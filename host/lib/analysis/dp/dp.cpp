// SPDX-License-Identifier: MIT
#include "analysis/dp/dp.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#ifdef __linux__
#include <sys/mman.h>
#endif

#include "base/error.h"
#include "base/scalar_product.h"
#include "base/simd.h"

namespace imucal {

namespace {

constexpr long kBlock = 16384; // t0 per block at most: three streams of it stay in the second-level cache
constexpr long kBlocksPerRecord = 64;
constexpr long kT0Piece = 8192;  // t0 at a time for all n: what one n has loaded, the next ones find in the cache
constexpr long kLongPiece = 256; // t0 from which on several n go abreast
constexpr long kPiece = 2048;    // d at a time: in the first-level cache
constexpr size_t kTogether = 16; // n whose sizes are collected in one pass: bounds what is kept

// Mean of the n samples from t0 on less that of the m before, t0 in [b, e).
IMUCAL_WIDE void mean_differences(const double* p, long b, long e, long n, long m, double* d) {
  const double inv_n = 1.0 / static_cast<double>(n), inv_m = 1.0 / static_cast<double>(m);
  for (long t = b; t < e; ++t) d[t - b] = (p[t + n] - p[t]) * inv_n - (p[t] - p[t - m]) * inv_m;
}

// Mean of the n samples from t0 on less factor x[t0], t0 in [b, e).
IMUCAL_WIDE void prediction_errors(const double* p, const double* x, long b, long e, long n, double factor, double* d) {
  const double inv_n = 1.0 / static_cast<double>(n);
  for (long t = b; t < e; ++t) d[t - b] = (p[t + n] - p[t]) * inv_n - x[t] * factor;
}

IMUCAL_WIDE void subtract_predictions(const double* x, long b, long e, double factor, double* d) {
  for (long t = b; t < e; ++t) d[t - b] -= x[t] * factor;
}

long steps_of(double tau_s, double dt_s) {
  return std::lround(tau_s / dt_s);
}

} // namespace

DpType dp_type_from_text(const std::string& text) {
  if (text == "av") return DpType::kAv;
  if (text == "dp1") return DpType::kDp1;
  if (text == "dp2") return DpType::kDp2;
  if (text == "dp3") return DpType::kDp3;
  throw usage_error("--type " + text + ": expected av, dp1, dp2 or dp3");
}

std::string to_text(DpType type) {
  static const char* const names[] = {"av", "dp1", "dp2", "dp3"};
  return names[static_cast<int>(type)];
}

DpEstimator dp_estimator_from_text(const std::string& text) {
  if (text == "rms") return DpEstimator::kRms;
  if (text == "max") return DpEstimator::kMax;
  if (text == "p95") return DpEstimator::kP95;
  throw usage_error("--estimator " + text + ": expected rms, max or p95");
}

std::string to_text(DpEstimator estimator) {
  static const char* const names[] = {"rms", "max", "p95"};
  return names[static_cast<int>(estimator)];
}

long DpOperator::history_n(long n) const {
  if (type == DpType::kAv) return n;
  if (type == DpType::kDp1) return estimation_n;
  return filter.warm_up_n();
}

DpOperator make_dp_operator(DpType type, double dt_s, const std::optional<ErrorModel>& nominal, double estimation_s) {
  DpOperator op;
  op.type = type;
  op.dt_s = dt_s;
  op.estimation_n = steps_of(estimation_s, dt_s);
  if (type == DpType::kDp1 && op.estimation_n < 1)
    throw usage_error("--estimation-s " + std::to_string(estimation_s) + " is less than one sample of " +
                      std::to_string(dt_s) + " s");
  if (type == DpType::kDp2 || type == DpType::kDp3) {
    if (!nominal) throw usage_error("--type " + to_text(type) + " needs --nominal MODEL.json");
    op.filter = make_nominal_filter(*nominal, dt_s);
  }
  return op;
}

// Large pages where the system has them: a long buffer is then there at once, and not 4 kB after 4 kB.
static void take_large_pages(void* memory, size_t bytes) {
#ifdef __linux__
  constexpr size_t kLarge = size_t{1} << 21, kPage = 4096;
  if (bytes < 2 * kLarge) return;
  const auto first = (reinterpret_cast<uintptr_t>(memory) + kPage - 1) / kPage * kPage;
  madvise(reinterpret_cast<void*>(first), (bytes - kPage) / kPage * kPage,
          MADV_HUGEPAGE); // a hint: refused, nothing is lost
#else
  (void)memory, (void)bytes;
#endif
}

DpRecord::DpRecord(const RateView& rates, const DpOperator& op, const std::vector<double>& initial)
    : op_(op), size_(rates.size) {
  const auto size = static_cast<size_t>(size_);
  sum_.reset(new double[size + 1]); // not zeroed first: each is written once
  take_large_pages(sum_.get(), (size + 1) * sizeof(double));
  double sum = 0;
  for (size_t i = 0; i < size; ++i) {
    sum_[i] = sum;
    if (!rates.is_missing(i)) sum += rates[i];
  }
  sum_[size] = sum;
  find_runs(rates);
  if (op.type == DpType::kDp2 || op.type == DpType::kDp3) run_filter(rates, initial);
}

void DpRecord::find_runs(const RateView& rates) {
  const auto size = static_cast<size_t>(size_);
  if (rates.n_missing == 0) {
    runs_ = {{0, size_}};
    return;
  }
  present_.resize(size + 1);
  for (size_t i = 0; i < size; ++i) {
    const bool is_present = !rates.is_missing(i);
    present_[i + 1] = present_[i] + is_present;
    const auto at = static_cast<long>(i);
    if (is_present && (runs_.empty() || runs_.back().end < at)) runs_.push_back({at, at});
    if (is_present) runs_.back().end = at + 1;
  }
}

void DpRecord::run_filter(const RateView& rates, const std::vector<double>& initial) {
  const auto size = static_cast<size_t>(size_);
  const NominalFilter& f = op_.filter;
  std::vector<double> x = initial.empty() ? std::vector<double>(f.size(), 0.0) : initial;
  states_.assign(f.size(), std::vector<double>(size + 1));
  for (size_t i = 0; i <= size; ++i) {
    for (size_t k = 0; k < x.size(); ++k) states_[k][i] = x[k];
    if (i == size) break;
    double predicted = 0;
    for (size_t k = 0; k < x.size(); ++k) predicted += x[k] *= f.phi[k];
    const double rate_dph = rates[i];
    if (std::isnan(rate_dph)) continue;
    const double innovation = rate_dph - predicted;
    for (size_t k = 0; k < x.size(); ++k) x[k] += f.gain[k] * innovation;
  }
  // DP2 with several terms needs only their sum.
  if (op_.type == DpType::kDp2 && f.size() > 1) {
    for (size_t k = 1; k < f.size(); ++k)
      for (size_t i = 0; i <= size; ++i) states_[0][i] += states_[k][i];
    states_.resize(1);
  }
}

bool DpRecord::complete(long first, long last) const {
  const int present = present_[static_cast<size_t>(last)] - present_[static_cast<size_t>(first)];
  return present > 0 && present >= op_.min_fill * static_cast<double>(last - first) - 1e-9;
}

// Mean of [first, last), over the samples present.
double DpRecord::window_sum(long first, long last, long n) const {
  const auto a = static_cast<size_t>(first), b = static_cast<size_t>(last);
  const double count = present_.empty() ? static_cast<double>(n) : present_[b] - present_[a];
  return (sum_[b] - sum_[a]) / count;
}

// AV and DP1.
double DpRecord::estimate(long n, long t0) const {
  const long history = op_.history_n(n);
  return window_sum(t0 - history, t0, history);
}

std::vector<DpRecord::Range> DpRecord::whole_windows(long n, long first_t0) const {
  std::vector<Range> out;
  const long history = op_.history_n(n);
  for (const Range& run : runs_) {
    const Range t0 = {std::max(run.begin + history, first_t0), run.end - n + 1};
    if (t0.begin < t0.end) out.push_back(t0);
  }
  return out;
}

// What each state predicts of the mean of the next n samples.
std::vector<double> DpRecord::prediction_factors(long n) const {
  std::vector<double> factor(states_.size());
  for (size_t k = 0; k < factor.size(); ++k) factor[k] = op_.filter.prediction_factor(k, n, op_.type == DpType::kDp3);
  return factor;
}

void DpRecord::errors(long n, const std::vector<double>& factor, Range t0, double* d) const {
  const double* p = sum_.get();
  if (op_.type == DpType::kAv)
    second_differences(p, n, t0, 1 / static_cast<double>(n), d);
  else if (factor.empty())
    mean_differences(p, t0.begin, t0.end, n, op_.estimation_n, d);
  else
    prediction_errors(p, states_[0].data(), t0.begin, t0.end, n, factor[0], d);
  for (size_t k = 1; k < factor.size(); ++k) subtract_predictions(states_[k].data(), t0.begin, t0.end, factor[k], d);
}

void DpRecord::samples(long n, std::vector<double>* d, std::vector<long>* t0, long first_t0) const {
  d->clear();
  if (t0) t0->clear();
  if (!has_whole_windows()) return samples_of_filled(n, d, t0, first_t0);
  const std::vector<Range> ranges = whole_windows(n, first_t0);
  const std::vector<double> factor = prediction_factors(n);
  for (const Range& range : ranges) {
    const size_t before = d->size();
    d->resize(before + static_cast<size_t>(range.end - range.begin));
    errors(n, factor, range, d->data() + before);
    if (t0)
      for (long t = range.begin; t < range.end; ++t) t0->push_back(t);
  }
}

// Windows that may have missing samples, one by one.
void DpRecord::samples_of_filled(long n, std::vector<double>* d, std::vector<long>* t0, long first_t0) const {
  const long history = op_.history_n(n);
  const std::vector<double> factor = prediction_factors(n);
  for (long t = std::max(history, first_t0); t + n <= size_; ++t) {
    if (!complete(t, t + n) || !complete(t - history, t)) continue;
    double predicted = 0;
    if (factor.empty())
      predicted = estimate(n, t);
    else
      for (size_t k = 0; k < factor.size(); ++k) predicted += factor[k] * states_[k][static_cast<size_t>(t)];
    d->push_back(window_sum(t, t + n, n) - predicted);
    if (t0) t0->push_back(t);
  }
}

std::vector<double> DpRecord::adjoint(long n, const std::vector<double>& d, const std::vector<long>& t0) const {
  const auto size = static_cast<size_t>(size_);
  std::vector<double> slope(size + 1, 0.0); // differences of the weights given by windows
  const auto add_mean = [&](long first, long last, double value) {
    const auto a = static_cast<size_t>(first), b = static_cast<size_t>(last);
    const double share = value / (present_.empty() ? static_cast<double>(last - first) : present_[b] - present_[a]);
    slope[a] += share;
    slope[b] -= share;
  };
  const bool filtered = !states_.empty();
  std::vector<double> from_filter(filtered ? size + 1 : 0, 0.0);
  for (size_t k = 0; k < d.size(); ++k) {
    add_mean(t0[k], t0[k] + n, d[k]);
    if (filtered)
      from_filter[static_cast<size_t>(t0[k])] = -d[k];
    else
      add_mean(t0[k] - op_.history_n(n), t0[k], -d[k]);
  }
  std::vector<double> out(size);
  double sum = 0;
  for (size_t i = 0; i < size; ++i) out[i] = sum += slope[i];
  if (filtered) { // the filter's recursion backwards
    const NominalFilter& f = op_.filter;
    std::vector<double> state(f.size(), 0.0), factor(f.size());
    for (size_t k = 0; k < f.size(); ++k) factor[k] = f.prediction_factor(k, n, op_.type == DpType::kDp3);
    for (size_t i = size; i-- > 0;) {
      for (size_t k = 0; k < f.size(); ++k) state[k] += from_filter[i + 1] * factor[k];
      double along = 0;
      if (present_.empty() || present_[i + 1] > present_[i])
        for (size_t k = 0; k < f.size(); ++k) along += f.gain[k] * state[k];
      out[i] += along;
      for (size_t k = 0; k < f.size(); ++k) state[k] = f.phi[k] * (state[k] - along);
    }
  }
  if (!present_.empty())
    for (size_t i = 0; i < size; ++i)
      if (present_[i + 1] == present_[i]) out[i] = 0;
  return out;
}

DpRecord::Sum DpRecord::Moments::whole() const {
  Sum out;
  for (size_t b = 0; b < count.size(); ++b) out.sum_sq += sum_sq[b], out.count += count[b];
  return out;
}

// The windows of one n, taken piece by piece in the order of t0, and the sum of their squares.
struct DpRecord::Walk {
  long n = 1, first_t0 = 0;
  long step = 1;              // between windows
  std::vector<double> factor; // prediction_factors
  bool is_abreast = false;    // with others of the kind
  size_t place = 0;           // of n among those asked for
  size_t run = 0;
  long next_t0 = 0; // in this run no window is left before it
  Sum sum;
};

// `piece`: t0 that are taken at a time.
DpRecord::Walk DpRecord::walk(const std::vector<long>& n, size_t place, long first_t0, long per_window,
                              long piece) const {
  Walk out;
  out.n = n[place], out.place = place, out.first_t0 = out.next_t0 = first_t0;
  out.step = per_window > 0 ? std::max(1L, out.n / per_window) : 1;
  out.factor = prediction_factors(out.n);
  out.is_abreast = op_.type == DpType::kAv && can_be_abreast(out.step) && piece >= kLongPiece;
  return out;
}

// The next windows of one run that begin before `end`; none: an empty range.
DpRecord::Range DpRecord::take(long end, Walk* walk) const {
  const long history = op_.history_n(walk->n);
  for (; walk->run < runs_.size(); ++walk->run, walk->next_t0 = walk->first_t0) {
    const Range& run = runs_[walk->run];
    const long begin = std::max(run.begin + history, walk->next_t0), last = run.end - walk->n + 1;
    if (begin >= last) continue;
    if (begin >= end) break;
    const Range taken = {begin, std::min(end, last)};
    const long length = taken.end - begin, count = walk->step == 1 ? length : (length + walk->step - 1) / walk->step;
    walk->next_t0 = begin + count * walk->step;
    walk->sum.count += count;
    return taken;
  }
  return {};
}

// Of the windows at t0.begin, t0.begin + step, … below t0.end.
double DpRecord::sum_of_squares(const Walk& walk, Range t0) const {
  const auto n = static_cast<double>(walk.n);
  if (op_.type == DpType::kAv) return spaced_second_difference_sum(sum_.get(), {walk.n, walk.step, t0}) / (n * n);
  double d[kPiece], sum = 0;
  const long length = walk.step == 1 ? kPiece : 1;
  for (long b = t0.begin; b < t0.end; b += std::max(length, walk.step)) {
    const Range piece = {b, std::min(b + length, t0.end)};
    errors(walk.n, walk.factor, piece, d);
    sum += scalar_product(d, d, static_cast<size_t>(piece.end - piece.begin));
  }
  return sum;
}

// Adds the next windows that begin before `end` to each of `count` <= kAbreast walks of one kind.  False: none are left.
bool DpRecord::add_squares(long end, size_t count, Walk* walks) const {
  SpacedWindows windows[kAbreast];
  bool is_any = false, is_more = false; // a run that ends before `end` may be followed by another
  for (size_t k = 0; k < count; ++k) {
    const Range t0 = take(end, &walks[k]);
    windows[k] = {walks[k].n, walks[k].step, t0};
    is_any |= t0.begin < t0.end, is_more |= t0.begin < t0.end && t0.end < end;
  }
  if (is_any && walks->is_abreast) {
    double sum[kAbreast];
    second_difference_sums(sum_.get(), count, windows, sum);
    for (size_t k = 0; k < count; ++k)
      walks[k].sum.sum_sq += sum[k] / (static_cast<double>(walks[k].n) * static_cast<double>(walks[k].n));
  } else if (is_any) {
    for (size_t k = 0; k < count; ++k) walks[k].sum.sum_sq += sum_of_squares(walks[k], windows[k].t0);
  }
  return is_more;
}

// All windows that begin in [begin, end): piece by piece, so that the running sums stay in the cache for all n.
void DpRecord::advance(long begin, long end, std::vector<Walk>* walks) const {
  for (long b = begin; b < end; b += kT0Piece) {
    const long piece_end = std::min(b + kT0Piece, end);
    for (size_t i = 0, count = 0; i < walks->size(); i += count) {
      Walk* const some = walks->data() + i;
      const size_t most = std::min(kAbreast, walks->size() - i);
      for (count = 1; count < most && some[count].is_abreast == some->is_abreast;) ++count;
      while (add_squares(piece_end, count, some)) continue;
    }
  }
}

std::vector<DpRecord::Moments> DpRecord::moments(const std::vector<long>& n, const std::vector<long>& first_t0) const {
  const long block = std::clamp(size_ / kBlocksPerRecord, 8L, kBlock);
  std::vector<Moments> out(n.size());
  if (!has_whole_windows()) {
    moments_of_filled(n, first_t0, block, &out);
    return out;
  }
  std::vector<Walk> walks;
  for (size_t i = 0; i < n.size(); ++i) walks.push_back(walk(n, i, first_t0.empty() ? 0 : first_t0[i], 0, block));
  for (long b = 0; b < size_; b += block) {
    advance(b, std::min(b + block, size_), &walks);
    for (size_t i = 0; i < n.size(); ++i) {
      if (walks[i].sum.count == 0) continue;
      out[i].sum_sq.push_back(walks[i].sum.sum_sq);
      out[i].count.push_back(walks[i].sum.count);
      walks[i].sum = {};
    }
  }
  return out;
}

std::vector<DpRecord::Sum> DpRecord::sums_of_some(const std::vector<long>& n, long per_window) const {
  std::vector<Sum> out(n.size());
  if (!has_whole_windows()) {
    const std::vector<Moments> all = moments(n);
    std::transform(all.begin(), all.end(), out.begin(), [](const Moments& m) { return m.whole(); });
    return out;
  }
  std::vector<Walk> walks;
  walks.reserve(n.size());
  for (size_t i = 0; i < n.size(); ++i) walks.push_back(walk(n, i, 0, per_window, kT0Piece));
  std::stable_partition(walks.begin(), walks.end(), [](const Walk& walk) { return walk.is_abreast; });
  advance(0, size_, &walks);
  for (const Walk& walk : walks) out[walk.place] = walk.sum;
  return out;
}

void DpRecord::moments_of_filled(const std::vector<long>& n, const std::vector<long>& first_t0, long block,
                                 std::vector<Moments>* out) const {
  std::vector<double> d;
  std::vector<long> t0;
  for (size_t i = 0; i < n.size(); ++i) {
    samples(n[i], &d, &t0, first_t0.empty() ? 0 : first_t0[i]);
    Moments& moments = (*out)[i];
    long end = -1;
    for (size_t k = 0; k < d.size(); ++k) {
      if (t0[k] >= end) {
        end = (t0[k] / block + 1) * block;
        moments.sum_sq.push_back(0);
        moments.count.push_back(0);
      }
      moments.sum_sq.back() += d[k] * d[k];
      ++moments.count.back();
    }
  }
}

// |d| at some t0, evenly over the ranges; empty where there are not many more.
std::vector<double> DpRecord::sizes_of_some(long n, const std::vector<Range>& t0) const {
  long windows = 0;
  for (const Range& range : t0) windows += range.end - range.begin;
  std::vector<double> out;
  if (windows < 4 * Sizes::kSample) return out;
  const double step = static_cast<double>(windows) / Sizes::kSample;
  const std::vector<double> factor = prediction_factors(n);
  double next = 0.5 * step, before = 0;
  for (const Range& range : t0) {
    const auto length = static_cast<double>(range.end - range.begin);
    for (; next < before + length; next += step) {
      const long t = range.begin + static_cast<long>(next - before);
      double d = 0;
      errors(n, factor, {t, t + 1}, &d);
      out.push_back(std::fabs(d));
    }
    before += length;
  }
  return out;
}

DpRecord::Size DpRecord::size_of_all(long n) const {
  std::vector<double> d;
  samples(n, &d, nullptr);
  if (d.empty()) return {};
  Sizes sizes;
  sizes.add(d.data(), static_cast<long>(d.size()));
  return {sizes.count(), *sizes.percentile(), sizes.largest()};
}

// The sizes of some n in one pass over the record, block by block.
void DpRecord::add_sizes(const std::vector<long>& n, std::vector<Size>* out) const {
  std::vector<std::vector<Range>> ranges;
  std::vector<std::vector<double>> factor;
  std::vector<Sizes> sizes;
  std::vector<size_t> at(n.size(), 0);
  for (long steps : n) {
    ranges.push_back(whole_windows(steps, 0));
    factor.push_back(prediction_factors(steps));
    sizes.emplace_back(sizes_of_some(steps, ranges.back()));
  }
  double d[kPiece];
  for (long b = 0; b < size_; b += kBlock)
    for (size_t i = 0; i < n.size(); ++i)
      for (size_t& k = at[i]; k < ranges[i].size() && ranges[i][k].begin < b + kBlock; ++k) {
        const long last = std::min(b + kBlock, ranges[i][k].end);
        for (long t = std::max(b, ranges[i][k].begin); t < last; t += kPiece) {
          const Range piece = {t, std::min(t + kPiece, last)};
          errors(n[i], factor[i], piece, d);
          sizes[i].add(d, piece.end - piece.begin);
        }
        if (ranges[i][k].end > b + kBlock) break;
      }
  for (size_t i = 0; i < n.size(); ++i) {
    const std::optional<double> percentile = sizes[i].percentile();
    out->push_back(percentile ? Size{sizes[i].count(), *percentile, sizes[i].largest()} : size_of_all(n[i]));
  }
}

std::vector<DpRecord::Size> DpRecord::sizes(const std::vector<long>& n) const {
  std::vector<Size> out;
  for (size_t first = 0; first < n.size(); first += kTogether) {
    const size_t last = std::min(first + kTogether, n.size());
    if (has_whole_windows())
      add_sizes(std::vector<long>(&n[first], &n[first] + (last - first)), &out);
    else
      for (size_t i = first; i < last; ++i) out.push_back(size_of_all(n[i]));
  }
  return out;
}

double dp_sigma(DpEstimator estimator, std::vector<double>* d) {
  if (d->empty()) return 0;
  if (estimator == DpEstimator::kRms) {
    double sum = 0;
    for (double v : *d) sum += v * v;
    return std::sqrt(sum / static_cast<double>(d->size()));
  }
  for (double& v : *d) v = std::fabs(v);
  if (estimator == DpEstimator::kMax) return *std::max_element(d->begin(), d->end()) / 3;
  return 0.5 * order_statistic(d, kPercentile);
}

// Ends at the first rate that differs.
static bool is_constant(const RateView& rates) {
  const double *begin = rates.rate_dph, *end = begin + rates.size;
  const double* first = std::find_if(begin, end, [](double x) { return !std::isnan(x); });
  return std::all_of(first, end, [&](double x) { return std::isnan(x) || x == *first; });
}

DpCurve dp_curve(const Series& series, const DpRecord& record, const std::vector<double>& tau_s, DpEstimator estimator,
                 long per_window) {
  return dp_curve(series.log, series.axis, series, record, tau_s, estimator, per_window);
}

DpCurve dp_curve(const std::string& log, const std::string& axis, const RateView& rates, const DpRecord& record,
                 const std::vector<double>& tau_s, DpEstimator estimator, long per_window) {
  const double dt_s = record.op().dt_s;
  DpCurve curve;
  curve.log = log;
  curve.axis = axis;
  curve.type = record.op().type;
  curve.estimator = estimator;
  if (is_constant(rates))
    throw data_error(log + ": axis " + axis + " is constant: nothing to analyse (is the sensor alive?)");
  std::vector<long> steps;
  for (double tau : tau_s) {
    const long n = steps_of(tau, dt_s);
    if (n < 1)
      throw usage_error("tau " + std::to_string(tau) + " s is less than one sample of " + std::to_string(dt_s) + " s");
    if (record.possible_windows(n) < 1)
      throw data_error(log + ": tau " + std::to_string(tau) + " s is beyond the record: " + to_text(curve.type) +
                       " needs " + std::to_string(record.op().history_n(n)) + " samples before and " +
                       std::to_string(n) + " after, the record has " + std::to_string(record.size()));
    steps.push_back(n);
    curve.tau_s.push_back(static_cast<double>(n) * dt_s);
  }
  if (estimator == DpEstimator::kRms) {
    const auto add = [&curve](const DpRecord::Sum& sum) {
      curve.dp_dph.push_back(std::sqrt(0.5 * sum.mean_square()));
      curve.n.push_back(sum.count);
    };
    if (per_window > 0)
      for (const DpRecord::Sum& sum : record.sums_of_some(steps, per_window)) add(sum);
    else
      for (const DpRecord::Moments& m : curve.moments = record.moments(steps)) add(m.whole());
  } else {
    for (const DpRecord::Size& size : record.sizes(steps)) {
      curve.n.push_back(size.n_windows);
      const double sigma = estimator == DpEstimator::kMax ? size.largest / 3 : 0.5 * size.percentile;
      curve.dp_dph.push_back(sigma / std::sqrt(2.0));
    }
  }
  for (size_t i = 0; i < steps.size(); ++i)
    if (curve.n[i] == 0)
      throw data_error(log + ": axis " + axis + ": no window of tau " + std::to_string(curve.tau_s[i]) +
                       " s is free of missing samples; lower tau, or let windows miss some");
  return curve;
}

} // namespace imucal
