// SPDX-License-Identifier: MIT
#include "analysis/dp/series.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <utility>

#include "base/error.h"
#include "base/scalar_product.h"
#include "base/simd.h"
#include "io/input.h"
#include "io/log.h"

namespace imucal {

namespace {

constexpr double kMissing = std::numeric_limits<double>::quiet_NaN();
constexpr size_t kStepProbe = 4096;   // rows whose median step becomes the grid's
constexpr double kSpanOverSame = 1e6; // of the values: what differs by less is the same value
constexpr size_t kMostLevels = 100000;

// Puts rows on the grid as they come; the first rows wait until the step is known.
// `begin` once with first time stamp and step, then `sample` for every grid place and axis in turn: (t0_s, dt_s) and
// (axis, rate, temp_degc, flagged).
template <typename Begin, typename Sample> class Gridder {
public:
  Gridder(const std::string& path, std::vector<size_t> columns, Begin begin, Sample sample)
      : path_(path), columns_(std::move(columns)), begin_(std::move(begin)), sample_(std::move(sample)) {}

  void row(const LogRow& row) {
    if (dt_s_ > 0) return place(row.t_s, row.temp_degc, row.rate_dph, row.flags);
    t_s_.push_back(row.t_s);
    temp_.push_back(row.temp_degc);
    for (size_t c : columns_) {
      rate_.push_back(row.rate_dph[c]);
      flags_.push_back(row.flags ? row.flags[c] : 0);
    }
    if (t_s_.size() == kStepProbe) settle();
  }
  void finish() {
    if (dt_s_ == 0) settle();
  }

private:
  void settle() {
    std::vector<double> steps;
    for (size_t i = 0; i + 1 < t_s_.size(); ++i) steps.push_back(t_s_[i + 1] - t_s_[i]);
    if (steps.empty()) steps.push_back(1.0);
    std::nth_element(steps.begin(), steps.begin() + static_cast<long>(steps.size() / 2), steps.end());
    dt_s_ = steps[steps.size() / 2];
    begin_(t_s_.front(), dt_s_);
    const size_t n = columns_.size();
    std::vector<size_t> packed(n);
    for (size_t a = 0; a < n; ++a) packed[a] = a;
    columns_.swap(packed);
    for (size_t i = 0; i < t_s_.size(); ++i) place(t_s_[i], temp_[i], &rate_[i * n], &flags_[i * n]);
    columns_.swap(packed);
    rate_ = {};
  }

  void place(double t_s, double temp_degc, const double* rate, const int* flags) {
    if (n_ > 0) {
      const double steps = std::round((t_s - last_t_s_) / dt_s_);
      if (steps < 1)
        fail_at(t_s,
                "two rows lie within half a step of " + std::to_string(dt_s_) + " s; average the log to even seconds");
      if (steps + static_cast<double>(n_) > 1e9) fail_at(t_s, "the gap before this row needs more than 1e9 samples");
      for (double k = 1; k < steps; ++k) push(kMissing, nullptr, nullptr);
    }
    push(temp_degc, rate, flags);
    last_t_s_ = t_s;
  }
  void push(double temp_degc, const double* rate, const int* flags) {
    for (size_t a = 0; a < columns_.size(); ++a) {
      const bool flagged = flags && (flags[columns_[a]] & (kSaturated | kSensorFault)) != 0;
      sample_(a, rate && !flagged ? rate[columns_[a]] : kMissing, temp_degc, flagged);
    }
    ++n_;
  }
  [[noreturn]] void fail_at(double t_s, const std::string& problem) const {
    throw data_error(path_ + ": at t_s = " + std::to_string(t_s) + ": " + problem);
  }

  std::string path_;
  std::vector<size_t> columns_;
  Begin begin_;
  Sample sample_;
  std::vector<double> t_s_, temp_, rate_;
  std::vector<int> flags_;
  double dt_s_ = 0, last_t_s_ = 0;
  size_t n_ = 0;
};

void require_samples(const std::string& path, const std::string& axis, long n) {
  if (n < 2)
    throw data_error(path + ": axis " + axis + " has " + std::to_string(n) +
                     " usable sample(s); at least two are needed");
}

double poly_argument(const Series& s, const Detrend& detrend, long i) {
  return detrend.kind == Detrend::Kind::kPolyTime ? static_cast<double>(i) : s.temp_degc[static_cast<size_t>(i)];
}

// Where the named axes (all when empty) stand among those of the log.
std::vector<size_t> columns_of_axes(const Log& header, const std::vector<std::string>& axes, SeriesHeader* out) {
  out->axes = axes;
  out->expected_rows = header.expected_rows;
  if (axes.empty())
    for (const LogAxis& a : header.axes) out->axes.push_back(a.name);
  std::vector<size_t> columns;
  for (std::string& name : out->axes) {
    const LogAxis& axis = header.axis(name);
    columns.push_back(static_cast<size_t>(&axis - header.axes.data()));
    name = axis.name;
  }
  return columns;
}

template <typename Begin, typename Sample>
SeriesHeader scan_grid(const std::string& path, const std::vector<std::string>& axes, Begin begin, Sample sample) {
  SeriesHeader out;
  out.log = path == "-" ? path : input_name(path);
  const auto settled = [&](double t0_s, double dt_s) {
    out.t0_s = t0_s, out.dt_s = dt_s;
    begin(out);
  };
  using Grid = Gridder<decltype(settled), Sample>;
  std::unique_ptr<Grid> grid;
  scan_log(
      path,
      [&](const Log& header) {
        grid = std::make_unique<Grid>(path, columns_of_axes(header, axes, &out), settled, sample);
      },
      [&](const LogRow& row) { grid->row(row); });
  grid->finish();
  return out;
}

} // namespace

SeriesHeader scan_series(const std::string& path, const std::vector<std::string>& axes,
                         const std::function<void(const SeriesHeader&)>& begin,
                         const std::function<void(size_t axis, double rate, double temp_degc, bool flagged)>& sample) {
  return scan_grid<const std::function<void(const SeriesHeader&)>&,
                   const std::function<void(size_t, double, double, bool)>&>(path, axes, begin, sample);
}

std::vector<Series> load_series(const std::string& path, const std::vector<std::string>& axes, bool with_temp) {
  std::vector<Series> out;
  const auto begin = [&](const SeriesHeader& header) {
    for (const std::string& name : header.axes) {
      Series& s = out.emplace_back();
      s.log = header.log, s.axis = name, s.t0_s = header.t0_s, s.dt_s = header.dt_s;
      s.rate_dph.reserve(header.expected_rows);
      if (with_temp) s.temp_degc.reserve(header.expected_rows);
    }
  };
  const auto sample = [&](size_t axis, double rate, double temp_degc, bool flagged) {
    Series& s = out[axis];
    s.n_missing += std::isnan(rate);
    s.n_flagged += flagged;
    s.rate_dph.push_back(rate);
    if (with_temp) s.temp_degc.push_back(temp_degc);
  };
  scan_grid(path, axes, begin, sample);
  for (Series& s : out) {
    require_samples(path, s.axis, s.size() - s.n_missing);
    if (std::none_of(s.temp_degc.begin(), s.temp_degc.end(), [](double t) { return std::isfinite(t); }))
      s.temp_degc = {};
  }
  return out;
}

// At least so many values lie further apart than `same`: half of the cells of that width that are not empty.  Linear in
// the number of values.
static size_t fewest_distinct(const std::vector<double>& values, double least, double same) {
  std::vector<bool> is_taken(static_cast<size_t>(kSpanOverSame) + 2);
  size_t n_cells = 0;
  const double per_same = 1 / same;
  for (double x : values) {
    if (!std::isfinite(x)) continue;
    const auto cell = static_cast<size_t>((x - least) * per_same);
    n_cells += !is_taken[cell];
    is_taken[cell] = true;
  }
  return n_cells / 2;
}

double quantum_dph(const Series& s) {
  double least = std::numeric_limits<double>::infinity(), most = -least;
  for (double x : s.rate_dph) least = x < least ? x : least, most = x > most ? x : most;
  // Written digits: the same value twice differs by less than a millionth of the span.
  const double same = (most - least) / kSpanOverSame;
  const auto n = static_cast<size_t>(s.size() - s.n_missing);
  if (!(same > 0) || !std::isfinite(same) || fewest_distinct(s.rate_dph, least, same) > std::min(n / 10, kMostLevels))
    return 0;
  std::vector<double> values;
  for (double x : s.rate_dph)
    if (!std::isnan(x)) values.push_back(x);
  std::sort(values.begin(), values.end());
  std::vector<double> distinct;
  for (double x : values)
    if (distinct.empty() || x - distinct.back() > same) distinct.push_back(x);
  if (distinct.size() < 3 || distinct.size() * 10 > n) return 0;
  double step = distinct.back() - distinct.front();
  for (size_t i = 1; i < distinct.size(); ++i) step = std::min(step, distinct[i] - distinct[i - 1]);
  // Refined over the whole span, then every value must lie on it.
  const double span = distinct.back() - distinct.front();
  step = span / std::round(span / step);
  for (double x : distinct) {
    const double place = (x - distinct.front()) / step;
    if (std::fabs(place - std::round(place)) > 0.05) return 0;
  }
  return step;
}

Detrend Detrend::parse(const std::string& text) {
  if (text == "none") return {Kind::kNone, 0};
  if (text == "mean") return {Kind::kMean, 0};
  const size_t colon = text.find(':');
  const std::string head = text.substr(0, colon);
  if ((head == "poly" || head == "time") && colon != std::string::npos) {
    const std::string digits = text.substr(colon + 1);
    if (digits.size() == 1 && digits[0] >= '0' && digits[0] <= '9')
      return {head == "poly" ? Kind::kPolyTemperature : Kind::kPolyTime, digits[0] - '0'};
  }
  throw usage_error("--detrend " + text + ": expected none, mean, poly:N (in temperature) or time:N with N = 0 ... 9");
}

std::string Detrend::text() const {
  if (kind == Kind::kNone) return "none";
  if (kind == Kind::kMean) return "mean";
  return (kind == Kind::kPolyTemperature ? "poly:" : "time:") + std::to_string(order);
}

static IMUCAL_WIDE void subtract_times(double factor, const double* column, size_t n, double* x) {
  for (size_t i = 0; i < n; ++i) x[i] -= factor * column[i];
}

namespace {

// The argument of the polynomials of a trend, from -1 to 1 over the record; 0 where the rate is missing.
std::vector<double> chebyshev_argument(const Series& s, const Detrend& detrend) {
  if (detrend.kind == Detrend::Kind::kPolyTemperature && s.temp_degc.empty())
    throw data_error(s.log + ": the log has no temperature, so no polynomial in it; use --detrend time:N or mean");
  double lo = 1e300, hi = -1e300;
  for (long i = 0; i < s.size(); ++i) {
    if (std::isnan(s.rate_dph[static_cast<size_t>(i)])) continue;
    const double x = poly_argument(s, detrend, i);
    if (std::isnan(x))
      throw data_error(s.log + ": no temperature at t_s = " + std::to_string(s.t_s(i)) +
                       "; --detrend poly:N needs one for every rate");
    lo = std::min(lo, x);
    hi = std::max(hi, x);
  }
  if (!(hi > lo))
    throw data_error(s.log + ": axis " + s.axis + ": the temperature is constant: " + detrend.text() +
                     " cannot be fitted; use --detrend mean");
  std::vector<double> x(s.rate_dph.size(), 0.0);
  for (size_t i = 0; i < x.size(); ++i)
    if (!std::isnan(s.rate_dph[i])) x[i] = (2 * poly_argument(s, detrend, static_cast<long>(i)) - lo - hi) / (hi - lo);
  return x;
}

// next = 2 x last - before
IMUCAL_WIDE void next_chebyshev(const double* x, const double* last, const double* before, size_t n, double* next) {
  for (size_t i = 0; i < n; ++i) next[i] = 2 * x[i] * last[i] - before[i];
}

struct Orthonormal {
  std::vector<std::vector<double>> columns;      // zero where the rate is missing
  std::vector<std::vector<double>> combinations; // [c][p]: column c as a sum of Chebyshev polynomials p
};

// Chebyshev polynomials made orthonormal by Gram-Schmidt, done twice.
Orthonormal orthonormal_of(const Series& s, const std::vector<double>& x, int order) {
  const size_t n = s.rate_dph.size();
  Orthonormal out;
  std::vector<double> column(n, 0.0), last(n, 0.0), before(n, 0.0);
  for (int p = 0; p <= order; ++p) {
    before.swap(last), last.swap(column);
    if (p == 0)
      std::transform(s.rate_dph.begin(), s.rate_dph.end(), column.begin(), [](double v) { return !std::isnan(v); });
    else if (p == 1)
      column = x;
    else
      next_chebyshev(x.data(), last.data(), before.data(), n, column.data());
    std::vector<double> q = column, row(static_cast<size_t>(order) + 1, 0.0);
    row[static_cast<size_t>(p)] = 1;
    const double norm0 = scalar_product(q.data(), q.data(), n);
    for (int pass = 0; pass < 2; ++pass)
      for (size_t b = 0; b < out.columns.size(); ++b) {
        const double along = scalar_product(out.columns[b].data(), q.data(), n);
        subtract_times(along, out.columns[b].data(), n, q.data());
        subtract_times(along, out.combinations[b].data(), row.size(), row.data());
      }
    const double norm = scalar_product(q.data(), q.data(), n);
    if (norm <= 1e-20 * norm0)
      throw data_error(s.log + ": axis " + s.axis + ": the record does not determine a polynomial of order " +
                       std::to_string(order) + " (rank " + std::to_string(p) + "); lower the order");
    for (double& v : q) v /= std::sqrt(norm);
    for (double& v : row) v /= std::sqrt(norm);
    out.columns.push_back(std::move(q));
    out.combinations.push_back(std::move(row));
  }
  return out;
}

bool is_mean_alone(const Detrend& detrend) {
  return detrend.kind == Detrend::Kind::kMean || detrend.order == 0;
}

} // namespace

std::vector<std::vector<double>> detrend_basis(const Series& s, const Detrend& detrend) {
  if (detrend.kind == Detrend::Kind::kNone) return {};
  if (is_mean_alone(detrend)) return orthonormal_of(s, {}, 0).columns;
  return orthonormal_of(s, chebyshev_argument(s, detrend), detrend.order).columns;
}

// Sum of differences from `base`, in four chains.
static double sum_of_differences(const RateView& rates, double base) {
  const double* x = rates.rate_dph;
  const auto n = static_cast<size_t>(rates.size);
  double sum[4] = {0, 0, 0, 0};
  if (rates.n_missing == 0) {
    size_t i = 0;
    for (; i + 4 <= n; i += 4)
      for (size_t l = 0; l < 4; ++l) sum[l] += x[i + l] - base;
    for (; i < n; ++i) sum[0] += x[i] - base;
  } else {
    for (size_t i = 0; i < n; ++i)
      if (!std::isnan(x[i])) sum[i % 4] += x[i] - base;
  }
  return sum[0] + sum[1] + sum[2] + sum[3];
}

// Sums of differences from a first value stay exact where the mean is large.  0 where every rate is missing.
static double mean_of(const RateView& rates) {
  const double* const end = rates.rate_dph + rates.size;
  const double* const first = std::find_if(rates.rate_dph, end, [](double x) { return !std::isnan(x); });
  if (first == end) return 0;
  return *first + sum_of_differences(rates, *first) / static_cast<double>(rates.size - rates.n_missing);
}

RateView::RateView(const double* rates, long n, bool is_mean_removed) : rate_dph(rates), size(n) {
  offset_dph = mean_of(*this);
  // A sum is a number where every rate is one: no pass of its own over a record without gaps.
  if (!std::isfinite(offset_dph) || (n > 0 && std::isnan(rates[0]))) {
    n_missing = std::count_if(rates, rates + n, [](double x) { return std::isnan(x); });
    offset_dph = mean_of(*this);
  }
  if (!is_mean_removed) offset_dph = 0;
}

void remove_trend(const Detrend& detrend, Series* s) {
  // The mean first: sums of squares of what is left stay exact.
  if (detrend.kind == Detrend::Kind::kNone || s->n_missing == s->size()) return;
  const double offset = mean_of(*s);
  for (double& x : s->rate_dph) x -= offset;
  if (is_mean_alone(detrend)) return;
  remove_columns(detrend_basis(*s, detrend), s);
}

static void remove_column_with_gaps(const std::vector<double>& column, std::vector<double>* x) {
  double along = 0;
  for (size_t i = 0; i < x->size(); ++i)
    if (!std::isnan((*x)[i])) along += column[i] * (*x)[i];
  for (size_t i = 0; i < x->size(); ++i) (*x)[i] -= along * column[i];
}

constexpr size_t kMostOrder = 9;  // of a trend: Detrend::parse takes no higher one
constexpr size_t kInCache = 2048; // rates that stay in the first-level cache for all columns

// The columns are orthonormal: what a record has of each is found of all in one pass, and taken away in a second.
void remove_columns(const std::vector<std::vector<double>>& basis, Series* s) {
  if (s->n_missing > 0) {
    for (const auto& column : basis) remove_column_with_gaps(column, &s->rate_dph);
    return;
  }
  const auto n = static_cast<size_t>(s->size());
  double* const x = s->rate_dph.data();
  std::vector<double> along(basis.size(), 0.0);
  for (size_t b = 0; b < n; b += kInCache)
    for (size_t c = 0; c < basis.size(); ++c)
      along[c] += scalar_product(basis[c].data() + b, x + b, std::min(kInCache, n - b));
  for (size_t b = 0; b < n; b += kInCache)
    for (size_t c = 0; c < basis.size(); ++c)
      subtract_times(along[c], basis[c].data() + b, std::min(kInCache, n - b), x + b);
}

Trend::Trend(const Series& shape, const Detrend& detrend) {
  if (detrend.kind == Detrend::Kind::kNone) return;
  const int order = is_mean_alone(detrend) ? 0 : detrend.order;
  if (order > static_cast<int>(kMostOrder))
    throw usage_error("a trend of order " + std::to_string(order) + " is too high");
  x_ = order == 0 ? std::vector<double>(shape.rate_dph.size(), 0.0) : chebyshev_argument(shape, detrend);
  Orthonormal basis = orthonormal_of(shape, x_, order);
  combinations_ = std::move(basis.combinations);
  if (shape.n_missing > 0) columns_ = std::move(basis.columns);
}

namespace {

// Adds to sum[p] what the values have of Chebyshev polynomial p < K, in eight chains for each: all in registers.
template <size_t K> IMUCAL_WIDE_PART void add_products(const double* x, const double* values, size_t n, double* sum) {
  Lanes sums[K][2] = {};
  size_t i = 0;
  for (; i + 8 <= n; i += 8)
    for (size_t half = 0; half < 2; ++half) {
      Lanes at, v;
      load_lanes(&at, x + i + 4 * half), load_lanes(&v, values + i + 4 * half);
      Lanes before = {0, 0, 0, 0}, last = {1, 1, 1, 1};
      for (size_t p = 0; p < K; ++p) {
        sums[p][half] += last * v;
        const Lanes next = p == 0 ? at : 2.0 * at * last - before;
        before = last, last = next;
      }
    }
  for (size_t p = 0; p < K; ++p) {
    const Lanes s = sums[p][0] + sums[p][1];
    sum[p] += (s[0] + s[1]) + (s[2] + s[3]);
  }
  for (; i < n; ++i) {
    double before = 0, last = 1;
    for (size_t p = 0; p < K; ++p) {
      sum[p] += last * values[i];
      const double next = p == 0 ? x[i] : 2 * x[i] * last - before;
      before = last, last = next;
    }
  }
}

IMUCAL_WIDE void add_products_of(size_t polynomials, const double* x, const double* values, size_t n, double* sum) {
  switch (polynomials) {
  case 1:
    return add_products<1>(x, values, n, sum);
  case 2:
    return add_products<2>(x, values, n, sum);
  case 3:
    return add_products<3>(x, values, n, sum);
  case 4:
    return add_products<4>(x, values, n, sum);
  case 5:
    return add_products<5>(x, values, n, sum);
  case 6:
    return add_products<6>(x, values, n, sum);
  case 7:
    return add_products<7>(x, values, n, sum);
  case 8:
    return add_products<8>(x, values, n, sum);
  case 9:
    return add_products<9>(x, values, n, sum);
  case kMostOrder + 1:
    return add_products<kMostOrder + 1>(x, values, n, sum);
  }
}

// Takes the sum of factor[p] times polynomial p away: Clenshaw's recurrence, from the highest polynomial down.
IMUCAL_WIDE void subtract_polynomials(const double* factor, size_t polynomials, const double* x, size_t n,
                                      double* values) {
  size_t i = 0;
  for (; i + 8 <= n; i += 8) {
    Lanes at[2], v[2], sum[2] = {}, before[2] = {};
    for (size_t half = 0; half < 2; ++half) {
      load_lanes(&at[half], x + i + 4 * half), load_lanes(&v[half], values + i + 4 * half);
      for (size_t p = polynomials - 1; p > 0; --p) {
        const Lanes next = 2.0 * at[half] * sum[half] - before[half] + factor[p];
        before[half] = sum[half], sum[half] = next;
      }
      v[half] -= at[half] * sum[half] - before[half] + factor[0];
      store_lanes(v[half], values + i + 4 * half);
    }
  }
  for (; i < n; ++i) {
    double sum = 0, before = 0;
    for (size_t p = polynomials - 1; p > 0; --p) {
      const double next = 2 * x[i] * sum - before + factor[p];
      before = sum, sum = next;
    }
    values[i] -= x[i] * sum - before + factor[0];
  }
}

} // namespace

void Trend::remove_from(Series* s) const {
  if (s->n_missing > 0) return remove_columns(columns_, s);
  double* const rate = s->rate_dph.data();
  const size_t polynomials = combinations_.size();
  if (polynomials == 0) return;
  double of_polynomial[kMostOrder + 1] = {}, factor[kMostOrder + 1] = {};
  for (size_t b = 0; b < x_.size(); b += kInCache)
    add_products_of(polynomials, &x_[b], rate + b, std::min(kInCache, x_.size() - b), of_polynomial);
  for (const std::vector<double>& row : combinations_)
    subtract_times(-scalar_product(row.data(), of_polynomial, row.size()), row.data(), row.size(), factor);
  subtract_polynomials(factor, polynomials, x_.data(), x_.size(), rate);
}

} // namespace imucal
