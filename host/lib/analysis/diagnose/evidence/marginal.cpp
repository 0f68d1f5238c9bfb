// SPDX-License-Identifier: MIT
#include "analysis/diagnose/evidence/marginal.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "analysis/diagnose/evidence/minutes.h"
#include "linear/linear.h"

namespace imucal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kDependentColumn = 1e-9; // of its norm: what is left of a column that the others give
constexpr double kDependentStep = 1e-6;   // of its information alone: what is left of a step that the columns give
constexpr double kFreeLevel = 10;         // times the spread of the data: prior of a level that may be any

void centre(MatrixXd* m) {
  if (m->rows() > 0) m->rowwise() -= m->colwise().mean().eval();
}

// Root mean square of a column over all runs, each run's mean taken off.
VectorXd centred_rms(const std::vector<MatrixXd>& columns) {
  VectorXd sum = VectorXd::Zero(columns.front().cols());
  double rows = 0;
  for (MatrixXd m : columns) {
    centre(&m);
    sum += m.colwise().squaredNorm().transpose();
    rows += static_cast<double>(m.rows());
  }
  return (sum / rows).cwiseSqrt();
}

std::vector<MatrixXd> columns_of(const Campaign& campaign,
                                 const std::function<std::vector<Column>(const RunInput&)>& f) {
  std::vector<MatrixXd> out;
  for (const CampaignRun& run : campaign.runs) out.push_back(used_rows(run, f(run.input)));
  return out;
}

// A row is the mean over dt about its time.
std::vector<MatrixXd> step_columns(const Campaign& campaign, const Theta& shape) {
  std::vector<MatrixXd> out;
  for (size_t r = 0; r < campaign.runs.size(); ++r) {
    const CampaignRun& run = campaign.runs[r];
    MatrixXd x = MatrixXd::Zero(static_cast<long>(run.n()), static_cast<long>(shape.size() / 2));
    for (size_t s = 0; s < shape.size() / 2; ++s)
      if (shape[2 * s] == static_cast<double>(r))
        x.col(static_cast<long>(s)) = share_after(run, shape[2 * s + 1], campaign.dt_s);
    out.push_back(std::move(x));
  }
  return out;
}

std::vector<MatrixXd> none(const Campaign& campaign) {
  std::vector<MatrixXd> out;
  for (const CampaignRun& run : campaign.runs) out.emplace_back(static_cast<long>(run.n()), 0);
  return out;
}

// Precisions of the common columns by the prior of the effect, in units of the spread of the data.
void set_precision(double spread_dph, const PriorScale& prior, MeanPart* part) {
  const VectorXd rms = centred_rms(part->common);
  part->common_precision = VectorXd::Zero(rms.size());
  for (long c = 0; c < rms.size(); ++c) {
    const double unit = prior.by_rms && rms[c] > 0 ? rms[c] : 1.0;
    part->common_precision[c] = std::pow(unit / (prior.column * spread_dph), 2);
  }
}

// The runs may have different numbers of start columns: filled up with zeros, which the prior keeps harmless.
void same_width(std::vector<MatrixXd>* columns) {
  long width = 0;
  for (const MatrixXd& m : *columns) width = std::max(width, static_cast<long>(m.cols()));
  for (MatrixXd& m : *columns) {
    const long had = m.cols();
    m.conservativeResize(m.rows(), width);
    m.rightCols(width - had).setZero();
  }
}

// The powers of temperature in a mean: those of a part that replaces them, or the usual ones.
const std::vector<MatrixXd>& powers_of(const SlowData& data, const std::vector<const MeanPart*>& parts) {
  const std::vector<MatrixXd>* powers = &data.powers;
  for (const MeanPart* part : parts)
    if (!part->powers.empty()) powers = &part->powers;
  return *powers;
}

// Where the rows of `some` stand among those of `all`, which has them in the same order.
std::vector<long> places(const std::vector<int>& all, const std::vector<int>& some) {
  std::vector<long> at;
  size_t k = 0;
  for (const int row : some) {
    while (all[k] != row) ++k;
    at.push_back(static_cast<long>(k));
  }
  return at;
}

template <typename Matrix> Matrix rows_at(const Matrix& all, const std::vector<long>& at) {
  Matrix out(static_cast<long>(at.size()), all.cols());
  for (size_t i = 0; i < at.size(); ++i) out.row(static_cast<long>(i)) = all.row(at[i]);
  return out;
}

} // namespace

SlowData::SlowData(Campaign blocks) : campaign(std::move(blocks)) {
  std::vector<Column> tn;
  for (const CampaignRun& run : campaign.runs) tn.push_back(run.input.tn);
  powers = polynomial_columns(campaign, tn);
  const long p = powers.front().cols();
  MatrixXd xx = MatrixXd::Zero(p, p);
  VectorXd xy = VectorXd::Zero(p);
  for (size_t r = 0; r < campaign.runs.size(); ++r) {
    VectorXd rate = used_rows(campaign.runs[r], {campaign.runs[r].input.rate_dph});
    rate.array() -= rate.mean();
    xx += powers[r].transpose() * powers[r];
    xy += powers[r].transpose() * rate;
    y.push_back(std::move(rate));
    rows_used.push_back(campaign.runs[r].used);
  }
  const VectorXd beta = p > 0 ? solve_symmetric(xx, xy) : VectorXd();
  Minutes left;
  for (size_t r = 0; r < y.size(); ++r)
    add_minutes(p > 0 ? VectorXd(y[r] - powers[r] * beta) : y[r], campaign.dt_s, &left);
  spread_dph = left.n > 0 ? std::sqrt(mean_square({left})) : 1;
  if (!(spread_dph > 0)) spread_dph = 1e-6;
}

SlowData::SlowData(Campaign blocks, const SlowData& like) : campaign(std::move(blocks)) {
  spread_dph = like.spread_dph;
  for (size_t r = 0; r < campaign.runs.size(); ++r) {
    rows_used.push_back(campaign.runs[r].used);
    const std::vector<long> kept = places(like.rows_used[r], rows_used[r]);
    y.push_back(rows_at(like.y[r], kept));
    powers.push_back(rows_at(like.powers[r], kept));
  }
}

size_t SlowData::rows() const {
  return campaign.n();
}

std::vector<MatrixXd> polynomial_columns(const Campaign& campaign, const std::vector<Column>& tn) {
  std::vector<MatrixXd> out;
  const long p = campaign.order;
  long rows = 0;
  for (size_t r = 0; r < campaign.runs.size(); ++r) {
    MatrixXd x = powers(campaign.runs[r], tn[r], campaign.order);
    centre(&x);
    rows += x.rows();
    out.push_back(std::move(x));
  }
  MatrixXd all(rows, p);
  long at = 0;
  for (const MatrixXd& x : out) all.middleRows(at, x.rows()) = x, at += x.rows();
  // Modified Gram-Schmidt, twice; a power that depends on the others becomes zero.
  for (long c = 0; c < p; ++c) {
    const double before = all.col(c).norm();
    for (int pass = 0; pass < 2; ++pass)
      for (long k = 0; k < c; ++k) all.col(c) -= all.col(k) * (all.col(k).dot(all.col(c)) / static_cast<double>(rows));
    const double after = all.col(c).norm();
    all.col(c) *= after > kDependentColumn * before ? std::sqrt(static_cast<double>(rows)) / after : 0.0;
  }
  at = 0;
  for (MatrixXd& x : out) x = all.middleRows(at, x.rows()), at += x.rows();
  return out;
}

MeanPart mean_part(const SlowData& data, const EffectEstimator& estimator, const Theta& shape) {
  MeanPart part;
  const Campaign& campaign = data.campaign;
  part.common = part.local = none(campaign);
  const PriorScale prior = estimator.prior();
  double local_sd = prior.start * data.spread_dph;
  const auto columns = [&](const RunInput& in) { return estimator.columns(in, shape); };
  const auto starts = [&](const RunInput& in) { return free_states(estimator, in, shape); };
  switch (estimator.form()) {
  case Form::kColumns:
    part.common = columns_of(campaign, columns);
    part.local = columns_of(campaign, starts);
    break;
  case Form::kTemperature: {
    std::vector<Column> tn;
    for (const CampaignRun& run : campaign.runs)
      tn.push_back(normalised(run.input, estimator.temperature(run.input, shape)));
    part.powers = polynomial_columns(campaign, tn);
    part.local = columns_of(campaign, starts);
    break;
  }
  case Form::kRunRandom:
  case Form::kTone:
    part.local = columns_of(campaign, columns);
    local_sd = data.spread_dph;
    break;
  case Form::kSteps:
    part.common = step_columns(campaign, shape);
    break;
  default:
    break;
  }
  same_width(&part.local);
  set_precision(data.spread_dph, prior, &part);
  part.local_precision = VectorXd::Constant(part.local.front().cols(), 1 / (local_sd * local_sd));
  return part;
}

VectorXd share_after(const CampaignRun& run, double change_s, double over_s) {
  VectorXd out(static_cast<long>(run.n()));
  for (size_t k = 0; k < run.n(); ++k) {
    const double after_s = run.input.t_s[static_cast<size_t>(run.used[k])] - change_s;
    out[static_cast<long>(k)] = std::clamp(after_s / over_s + 0.5, 0.0, 1.0);
  }
  return out;
}

MeanPart own_jumps_part(const SlowData& data) {
  Theta places;
  for (size_t r = 0; r < data.campaign.runs.size(); ++r)
    for (const OwnJump& jump : data.campaign.runs[r].own_jumps)
      places.push_back(static_cast<double>(r)), places.push_back(jump.t_s);
  MeanPart part;
  part.common = none(data.campaign);
  part.local = step_columns(data.campaign, places); // of other runs: zero
  const double sd = kFreeLevel * data.spread_dph;
  part.local_precision = VectorXd::Constant(part.local.front().cols(), 1 / (sd * sd));
  return part;
}

MeanPart rows_of(const MeanPart& part, const SlowData& all, const SlowData& some) {
  MeanPart out = part;
  for (std::vector<MatrixXd>* columns : {&out.common, &out.local, &out.powers})
    for (size_t r = 0; r < columns->size(); ++r)
      (*columns)[r] = rows_at((*columns)[r], places(all.rows_used[r], some.rows_used[r]));
  return out;
}

MeanPart start_part(const SlowData& data, const EffectEstimator& estimator, const Theta& shape) {
  MeanPart part = mean_part(data, estimator, shape);
  part.common = none(data.campaign);
  part.common_precision = VectorXd();
  part.powers.clear();
  return part;
}

std::vector<const MeanPart*> pointers_of(const std::vector<MeanPart>& parts) {
  std::vector<const MeanPart*> out;
  for (const MeanPart& part : parts) out.push_back(&part);
  return out;
}

MeanColumns::MeanColumns(const SlowData& data, const std::vector<const MeanPart*>& parts) {
  const std::vector<MatrixXd>& powers = powers_of(data, parts);
  std::vector<double> local{0.0}, common;
  for (const MeanPart* part : parts)
    for (long c = 0; c < part->local_precision.size(); ++c) local.push_back(part->local_precision[c]);
  for (long c = 0; c < powers.front().cols(); ++c) {
    // A power that depends on the others is zero; a precision keeps its place harmless.
    const auto has = [c](const MatrixXd& x) { return x.col(c).squaredNorm() > 0; };
    common.push_back(std::any_of(powers.begin(), powers.end(), has) ? 0.0 : 1.0);
  }
  for (const MeanPart* part : parts)
    for (long c = 0; c < part->common_precision.size(); ++c) common.push_back(part->common_precision[c]);
  local_precision_ = Eigen::Map<VectorXd>(local.data(), static_cast<long>(local.size()));
  common_precision_ = Eigen::Map<VectorXd>(common.data(), static_cast<long>(common.size()));
  wide_.reserve(data.y.size());
  for (size_t r = 0; r < data.y.size(); ++r) {
    const VectorXd ones = VectorXd::Ones(data.y[r].size());
    std::vector<const double*> columns{ones.data()};
    const auto put = [&](const MatrixXd& m) {
      for (long c = 0; c < m.cols(); ++c) columns.push_back(m.col(c).data());
    };
    for (const MeanPart* part : parts) put(part->local[r]);
    put(powers[r]);
    for (const MeanPart* part : parts) put(part->common[r]);
    columns.push_back(data.y[r].data());
    wide_.emplace_back(columns, data.campaign.runs[r].n());
  }
}

RunGrams::RunGrams(const SlowData& data, const MeanColumns& columns, const NoiseModel& noise)
    : n_local_(columns.local_precision_.size()), n_common_(columns.common_precision_.size()),
      local_precision_(columns.local_precision_), common_precision_(columns.common_precision_) {
  GainsByRun by_run(data.campaign.runs, noise);
  for (size_t r = 0; r < data.y.size(); ++r) {
    const RunGains& gains = by_run.of(data.campaign.runs[r]);
    const double times = data.campaign.runs[r].own_strength;
    gram_.push_back(columns.wide_[r].whitened_gram(gains) / (times * times));
    sum_log_s_.push_back(gains.sum_log_s + 2 * std::log(times) * static_cast<double>(data.campaign.runs[r].n()));
  }
}

// The local coefficients of one run are integrated out; what is left is added to `common`.
double RunGrams::one_run(size_t r, double scale, MatrixXd* common) const {
  const MatrixXd& g = gram_[r];
  const long l = n_local_, q = n_common_ + 1;
  MatrixXd a = g.topLeftCorner(l, l);
  double log_prior = 0;
  for (long c = 0; c < l; ++c) {
    const double precision = local_precision_[c] / (scale * scale);
    a(c, c) += precision;
    if (precision > 0) log_prior += std::log(precision);
  }
  const Cholesky own(a);
  if (!own.is_positive()) return -1e300;
  const MatrixXd half = own.half_solve(MatrixXd(g.block(0, l, l, q)));
  *common += g.block(l, l, q, q) - half.transpose() * half;
  return -0.5 * (sum_log_s_[r] + own.log_det() - log_prior);
}

double RunGrams::log_marginal(double scale, const std::vector<char>& runs) const {
  const long q = n_common_ + 1, c = n_common_;
  MatrixXd common = MatrixXd::Zero(q, q);
  double sum = 0;
  for (size_t r = 0; r < gram_.size(); ++r)
    if (runs.empty() || runs[r]) sum += one_run(r, scale, &common);
  double log_prior = 0;
  for (long i = 0; i < c; ++i) {
    const double precision = common_precision_[i] / (scale * scale);
    common(i, i) += precision;
    if (precision > 0) log_prior += std::log(precision);
  }
  if (c == 0) return sum - 0.5 * common(0, 0);
  const Cholesky factor(common.topLeftCorner(c, c));
  if (!factor.is_positive()) return -1e300;
  const VectorXd half = factor.half_solve(VectorXd(common.col(c).head(c)));
  const double value = sum - 0.5 * (common(c, c) - half.squaredNorm() + factor.log_det() - log_prior);
  return std::isfinite(value) ? value : -1e300;
}

double RunGrams::log_marginal_any_scale(const std::vector<char>& runs) const {
  bool has_prior = n_local_ > 1;
  for (long i = 0; i < n_common_; ++i) has_prior = has_prior || common_precision_[i] > 0;
  if (!has_prior) return log_marginal(1, runs);
  double values[3], top = -1e300, sum = 0;
  for (int i = 0; i < 3; ++i) values[i] = log_marginal(kPriorScales[i], runs), top = std::max(top, values[i]);
  for (double v : values) sum += std::exp(v - top) / 3;
  return top + std::log(sum);
}

MatrixXd RunGrams::without_local(size_t run) const {
  MatrixXd common = MatrixXd::Zero(n_common_ + 1, n_common_ + 1);
  one_run(run, 1, &common);
  return common;
}

RunGrams::Posterior RunGrams::posterior(const std::vector<char>& runs) const {
  Posterior out;
  const long q = n_common_ + 1, c = n_common_, l = n_local_;
  MatrixXd common = MatrixXd::Zero(q, q);
  for (size_t r = 0; r < gram_.size(); ++r)
    if (runs.empty() || runs[r]) one_run(r, 1, &common);
  MatrixXd& covariance = out.common_covariance;
  covariance = MatrixXd::Zero(c, c);
  out.common = VectorXd::Zero(c);
  if (c > 0) {
    common.topLeftCorner(c, c).diagonal() += common_precision_;
    covariance = inverse_symmetric(common.topLeftCorner(c, c));
    out.common = covariance * common.block(0, c, c, 1);
  }
  for (const MatrixXd& g : gram_) {
    MatrixXd a = g.topLeftCorner(l, l);
    a.diagonal() += local_precision_;
    const MatrixXd inverse = inverse_symmetric(a), cross = inverse * g.block(0, l, l, c);
    out.local.push_back(inverse * g.block(0, l + c, l, 1) - cross * out.common);
    out.local_sd.push_back((inverse + cross * covariance * cross.transpose()).diagonal().cwiseMax(0).cwiseSqrt());
  }
  return out;
}

VectorXd residual_of(const SlowData& data, const std::vector<MeanPart>& parts, const RunGrams::Posterior& at,
                     size_t run) {
  const MatrixXd& powers = powers_of(data, pointers_of(parts))[run];
  VectorXd e = data.y[run];
  e.array() -= at.local[run][0];
  long l = 1, c = powers.cols();
  e -= powers * at.common.head(c);
  for (const MeanPart& part : parts) {
    const long nl = part.local[run].cols(), nc = part.common[run].cols();
    e -= part.local[run] * at.local[run].segment(l, nl) + part.common[run] * at.common.segment(c, nc);
    l += nl, c += nc;
  }
  return e;
}

// A step u beside the local columns L and the common columns X of its run.  The noise has the covariance s V, s the square of
// own_strength; Q: prior precisions of the local columns, C: covariance of the common coefficients over all runs.
//   score        u'V^-1 e / s
//   information  [ u'V^-1 u - t A t' - w C w' / s ] / s,   A = (L'V^-1 L + s Q)^-1,  t = u'V^-1 L,  w = u'V^-1 X - t A L'V^-1 X
// V^-1 is applied once, to the columns: their products with all steps are sums from a row to the last.
VectorXd step_gains(const SlowData& data, const std::vector<MeanPart>& parts, const RunGains& gains,
                    const RunGrams::Posterior& at, size_t run) {
  const auto n = static_cast<long>(gains.n);
  const double strength2 = std::pow(data.campaign.runs[run].own_strength, 2);
  std::vector<double> precision{0.0};
  MatrixXd local = MatrixXd::Ones(n, 1), common = powers_of(data, pointers_of(parts))[run];
  const auto put = [](const MatrixXd& columns, MatrixXd* to) {
    to->conservativeResize(Eigen::NoChange, to->cols() + columns.cols());
    to->rightCols(columns.cols()) = columns;
  };
  for (const MeanPart& part : parts) {
    put(part.local[run], &local), put(part.common[run], &common);
    precision.insert(precision.end(), part.local_precision.begin(), part.local_precision.end());
  }
  const long l = local.cols(), c = common.cols();
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rows(n, l + c + 1);
  rows << local, common, residual_of(data, parts, at, run);
  solve_rows(gains, static_cast<size_t>(l + c + 1), rows.data());
  MatrixXd own = local.transpose() * rows.leftCols(l);
  own.diagonal() += Eigen::Map<const VectorXd>(precision.data(), l) * strength2;
  const MatrixXd a = inverse_symmetric(own), cross = a * (local.transpose() * rows.middleCols(l, c));
  for (long k = n - 1; k-- > 0;) rows.row(k) += rows.row(k + 1);
  const MatrixXd t = rows.leftCols(l), w = rows.middleCols(l, c) - t * cross;
  const VectorXd alone = step_norms(gains);
  const VectorXd information = alone - (t * a).cwiseProduct(t).rowwise().sum() -
                               (w * at.common_covariance).cwiseProduct(w).rowwise().sum() / strength2;
  VectorXd gain = VectorXd::Zero(n);
  for (long k = 1; k < n; ++k)
    if (information[k] > kDependentStep * alone[k])
      gain[k] = 0.5 * std::pow(rows(k, l + c), 2) / (information[k] * strength2);
  return gain;
}

} // namespace imucal
