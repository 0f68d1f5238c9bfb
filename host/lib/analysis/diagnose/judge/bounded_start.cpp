// SPDX-License-Identifier: MIT
#include "analysis/diagnose/judge/bounded_start.h"

#include <algorithm>
#include <cmath>

#include "analysis/diagnose/logs/campaign.h"
#include "linear/linear.h"

namespace imucal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kLeastChange = 0.015, kLongerChange = 1.25, kFurthestShape = 3; // of the shapes that are asked
constexpr int kStartRounds = 4;          // over the runs, each at its best start beside those of the others
constexpr double kStartGain_nats = 0.01; // that is worth another
constexpr double kAnySize = 1e3;         // times the spread of the data: prior of a size that may be any
constexpr double kStartChange = 0.02;    // over which the slope of a column with its start is taken
constexpr double kPlausibleErrors = 2;   // 95 %
// Starts that are asked, about the best ones so far: their distance in parts of the way from the middle to an extreme.  The last
// is a tenth of a degree or less, whatever the shape.
struct StartLevel {
  double apart;
  int n;
};
constexpr StartLevel kStartLevels[] = {{0.1, 21}, {0.02, 11}, {0.004, 11}};

// By how many nats a likelihood falls so many standard errors away.
constexpr double fall_nats(double errors) {
  return 0.5 * errors * errors;
}

// The likelihood at one shape, and the size there.
struct ShapePlace {
  double shape = 0, nats = -1e300;
  double size = 0;
  std::vector<double> starts; // of the runs
  double ratio() const { return size / shape; }
};

class BoundedStart {
public:
  BoundedStart(const SlowAnswer& slow, size_t name)
      : slow_(slow), name_(slow.found.best.names[name]), e_(*slow.candidate(name_.candidate).scan.estimator),
        noise_(slow.search->noise_of(slow.found.best)),
        others_(slow.search->parts_on(*slow.data, slow.found.best.without(name))) {}

  // From the shape found on, up and down.
  std::vector<ShapePlace> places() const {
    const double found = name_.shape[0];
    std::vector<ShapePlace> up = {at(found, std::vector<double>(n_runs(), 0.0))}, down = up;
    for (double step = kLeastChange, off = step; off < std::log(kFurthestShape); step *= kLongerChange, off += step) {
      if (found * std::exp(off) < e_.shape_hi()[0]) up.push_back(at(found * std::exp(off), up.back().starts));
      if (found * std::exp(-off) > e_.shape_lo()[0]) down.push_back(at(found * std::exp(-off), down.back().starts));
    }
    std::reverse(down.begin(), down.end());
    down.insert(down.end(), up.begin() + 1, up.end());
    return down;
  }
  // The standard error of the size at one of them: with other starts it is another.
  double size_error(const ShapePlace& place) const {
    std::vector<std::vector<double>> starts;
    for (double start : place.starts) starts.push_back({start});
    MeanPart with_starts = part(place.shape, starts);
    for (size_t r = 0; r < n_runs(); ++r) {
      const double lo = std::max(-1.0, place.starts[r] - kStartChange),
                   hi = std::min(1.0, place.starts[r] + kStartChange);
      const MatrixXd change = columns(r, place.shape, {hi}) - columns(r, place.shape, {lo});
      MatrixXd& local = with_starts.local[r];
      local.conservativeResize(Eigen::NoChange, local.cols() + 1);
      local.rightCols(1) = change * (place.size / (hi - lo));
    }
    VectorXd& precision = with_starts.local_precision;
    precision.conservativeResize(precision.size() + 1);
    precision[precision.size() - 1] = 1; // parts of the way to an extreme
    std::vector<MeanPart> parts = others_;
    parts.push_back(std::move(with_starts));
    const MatrixXd covariance = RunGrams(*slow_.data, pointers_of(parts), noise_).posterior().common_covariance;
    return std::sqrt(covariance(covariance.rows() - 1, covariance.cols() - 1));
  }

private:
  size_t n_runs() const { return slow_.data->campaign.runs.size(); }

  ShapePlace at(double shape, const std::vector<double>& near) const {
    ShapePlace best = from(shape, near);
    const ShapePlace other = from(shape, std::vector<double>(n_runs(), 0.0));
    return other.nats > best.nats ? other : best;
  }
  ShapePlace from(double shape, std::vector<double> starts) const {
    ShapePlace place;
    place.shape = shape;
    for (const StartLevel& level : kStartLevels) place.starts = starts = nearer(level, starts, &place);
    return place;
  }
  MatrixXd columns(size_t run, double shape, const std::vector<double>& starts) const {
    const CampaignRun& of = slow_.data->campaign.runs[run];
    std::vector<Column> out;
    for (double start : starts) out.push_back(e_.columns_from(of.input, {shape}, start).front());
    return used_rows(of, out);
  }
  // The columns from these starts, and start states that the run is free in later.
  MeanPart part(double shape, const std::vector<std::vector<double>>& starts) const {
    MeanPart out = start_part(*slow_.data, e_, {shape});
    for (size_t r = 0; r < n_runs(); ++r) {
      const CampaignRun& run = slow_.data->campaign.runs[r];
      const auto own = static_cast<long>(e_.start_columns(run.input, {shape}).size());
      out.local[r].leftCols(std::min(own, out.local[r].cols())).setZero();
      out.common[r] = columns(r, shape, starts[r]);
    }
    const double sd = kAnySize * slow_.data->spread_dph;
    out.common_precision = VectorXd::Constant(static_cast<long>(starts[0].size()), 1 / (sd * sd));
    return out;
  }
  // The best starts at some distance about these.
  std::vector<double> nearer(const StartLevel& level, const std::vector<double>& about, ShapePlace* place) const {
    const bool is_first = level.apart == kStartLevels[0].apart;
    std::vector<std::vector<double>> starts;
    std::vector<size_t> picked;
    for (double middle : about) {
      starts.emplace_back();
      for (int k = 0; k < level.n; ++k)
        starts.back().push_back(std::clamp((is_first ? 0 : middle) + (k - level.n / 2) * level.apart, -1.0, 1.0));
      const double from_middle = is_first ? std::round(middle / level.apart) : 0;
      picked.push_back(static_cast<size_t>(level.n / 2 + static_cast<int>(from_middle)));
    }
    std::vector<MeanPart> parts = others_;
    parts.push_back(part(place->shape, starts));
    const RunGrams grams(*slow_.data, pointers_of(parts), noise_);
    std::vector<MatrixXd> of_runs;
    for (size_t r = 0; r < n_runs(); ++r) of_runs.push_back(grams.without_local(r));
    choose(of_runs, grams.common_precision(), static_cast<size_t>(level.n), &picked, place);
    std::vector<double> out;
    for (size_t r = 0; r < n_runs(); ++r) out.push_back(starts[r][picked[r]]);
    return out;
  }
  // Products with one of the last columns before the data, in the place of all of these.
  static MatrixXd with_one(const MatrixXd& gram, size_t n, size_t picked) {
    const long before = gram.cols() - 1 - static_cast<long>(n);
    std::vector<long> kept;
    for (long c = 0; c < before; ++c) kept.push_back(c);
    kept.push_back(before + static_cast<long>(picked)), kept.push_back(gram.cols() - 1);
    const auto size = static_cast<long>(kept.size());
    MatrixXd out(size, size);
    for (long i = 0; i < size; ++i)
      for (long j = 0; j < size; ++j) out(i, j) = gram(kept[static_cast<size_t>(i)], kept[static_cast<size_t>(j)]);
    return out;
  }
  // Log likelihood at the best coefficients, but for what no start changes.
  static double at_best(const MatrixXd& sum) {
    const long c = sum.cols() - 1;
    const Cholesky factor(sum.topLeftCorner(c, c));
    if (!factor.is_positive()) return -1e300;
    return -0.5 * (sum(c, c) - factor.half_solve(VectorXd(sum.col(c).head(c))).squaredNorm());
  }
  static void choose(const std::vector<MatrixXd>& of_runs, const VectorXd& precision, size_t n,
                     std::vector<size_t>* picked, ShapePlace* place) {
    const long c = precision.size() - static_cast<long>(n) + 1;
    MatrixXd sum = MatrixXd::Zero(c + 1, c + 1);
    sum.topLeftCorner(c, c).diagonal() = precision.head(c);
    for (size_t r = 0; r < of_runs.size(); ++r) sum += with_one(of_runs[r], n, (*picked)[r]);
    double nats = at_best(sum);
    for (int round = 0; round < kStartRounds; ++round) {
      const double before = nats;
      for (size_t r = 0; r < of_runs.size(); ++r) {
        const MatrixXd rest = sum - with_one(of_runs[r], n, (*picked)[r]);
        for (size_t k = 0; k < n; ++k) {
          const MatrixXd other = rest + with_one(of_runs[r], n, k);
          if (const double value = at_best(other); value > nats) nats = value, sum = other, (*picked)[r] = k;
        }
      }
      if (nats < before + kStartGain_nats) break;
    }
    place->nats = nats;
    place->size = solve_symmetric(sum.topLeftCorner(c, c), sum.col(c).head(c))[c - 1];
  }

  const SlowAnswer& slow_;
  const SlowModel::Name& name_;
  const EffectEstimator& e_;
  const NoiseModel noise_;
  const std::vector<MeanPart> others_;
};

double top_nats(const std::vector<ShapePlace>& places) {
  double top = -1e300;
  for (const ShapePlace& place : places) top = std::max(top, place.nats);
  return top;
}
// The place within so many standard errors of the best that is nearest to a shape.
const ShapePlace& nearest_within(const std::vector<ShapePlace>& places, double errors, double shape) {
  const double least = top_nats(places) - fall_nats(errors);
  const ShapePlace* nearest = nullptr;
  const auto away = [&](const ShapePlace& place) { return std::fabs(std::log(place.shape / shape)); };
  for (const ShapePlace& place : places)
    if (place.nats >= least && (!nearest || away(place) < away(*nearest))) nearest = &place;
  return *nearest;
}
// A standard error such that everything within three of them is as likely as that: of what each place says, about one of them.
template <class F> double spread_about(const std::vector<ShapePlace>& places, const ShapePlace& about, F says) {
  const double top = top_nats(places);
  double error = 0;
  for (const ShapePlace& place : places)
    if (const double below = top - place.nats; below <= fall_nats(kSeenErrors))
      error = std::max(error, std::fabs(says(place) - says(about)) / std::max(1.0, std::sqrt(2 * below)));
  return error;
}

} // namespace

void tell_bounded(const SlowAnswer& slow, size_t name, SelectedEffect* effect) {
  Term& term = effect->term;
  if (term.shape.size() != 1 || term.coefficients.size() != 1) return;
  const BoundedStart likelihood(slow, name);
  const std::vector<ShapePlace> places = likelihood.places();
  const double top = top_nats(places), found = term.shape[0];
  const auto is_seen_off = [&](const ShapePlace& end) { return end.nats < top - fall_nats(kSeenErrors); };
  const bool is_open = !is_seen_off(places.front()) || !is_seen_off(places.back());
  const ShapePlace& told = nearest_within(places, is_open ? kPlausibleErrors : kSeenErrors, found);
  const auto shape_of = [](const ShapePlace& place) { return place.shape; };
  const auto size_of = [](const ShapePlace& place) { return place.size; };
  const auto ratio_of = [](const ShapePlace& place) { return place.ratio(); };
  if (told.shape != found || is_open) {
    term.shape = {told.shape}, term.coefficients = {told.size};
    term.shape_errors = {0}, term.coefficient_errors = {0};
  }
  const double size_error = likelihood.size_error(told);
  term.shape_errors[0] = std::max(term.shape_errors[0], spread_about(places, told, shape_of));
  term.coefficient_errors[0] =
      std::max(term.coefficient_errors[0], std::hypot(size_error, spread_about(places, told, size_of)));
  if (!is_open) return;
  term.shape_errors = {kUnknown}, term.coefficient_errors = {kUnknown};
  const double ratio_error = std::hypot(size_error / told.shape, spread_about(places, told, ratio_of));
  effect->only_ratio = {{told.ratio(), ratio_error}, 0};
  if (is_seen_off(places.front()))
    effect->only_ratio->least_shape = nearest_within(places, kPlausibleErrors, places.front().shape).shape;
}

} // namespace imucal
