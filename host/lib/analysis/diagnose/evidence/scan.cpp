// SPDX-License-Identifier: MIT
#include "analysis/diagnose/evidence/scan.h"

#include <algorithm>
#include <cmath>

#include "linear/linear.h"

namespace imucal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

// Base columns of one run, whitened: local ones, common ones of parts, powers last.
struct Base {
  long local = 1, parts = 0, powers = 0;
  bool has_usual_powers = true; // of the logged temperature
  std::vector<MatrixXd> white;  // per run: local (constant first), parts, powers
  VectorXd local_precision, part_precision;
  long common() const { return parts + powers; }
  // Columns that the bank has met in every base, at the end, and those between the constant and them.
  long usual_powers() const { return has_usual_powers ? powers : 0; }
  long n_new() const { return local + common() - 1 - usual_powers(); }
  long expanded(long runs) const { return runs * local + common(); }
};

Base base_of(const SlowData& data, const std::vector<const MeanPart*>& parts, const std::vector<RunGains>& gains) {
  Base out;
  const std::vector<MatrixXd>* powers = &data.powers;
  for (const MeanPart* part : parts) {
    out.local += part->local_precision.size();
    out.parts += part->common_precision.size();
    if (!part->powers.empty()) powers = &part->powers, out.has_usual_powers = false;
  }
  out.powers = powers->front().cols();
  out.local_precision = VectorXd::Zero(out.local);
  out.part_precision = VectorXd::Zero(out.parts);
  long l = 1, c = 0;
  for (const MeanPart* part : parts) {
    out.local_precision.segment(l, part->local_precision.size()) = part->local_precision;
    out.part_precision.segment(c, part->common_precision.size()) = part->common_precision;
    l += part->local_precision.size(), c += part->common_precision.size();
  }
  for (size_t r = 0; r < gains.size(); ++r) {
    MatrixXd x(data.y[r].size(), out.local + out.common());
    long at = 0;
    const auto put = [&](const MatrixXd& m) { x.middleCols(at, m.cols()) = m, at += m.cols(); };
    x.col(at++).setOnes();
    for (const MeanPart* part : parts) put(part->local[r]);
    for (const MeanPart* part : parts) put(part->common[r]);
    put((*powers)[r]);
    whiten(gains[r], &x);
    out.white.push_back(std::move(x));
  }
  return out;
}

// Products of base columns with others, run by run, in the places of the expanded base: local columns of run r at
// r * local, common ones at the end.
MatrixXd expanded_products(const Base& base, const std::vector<MatrixXd>& products) {
  const long runs = static_cast<long>(products.size());
  MatrixXd out = MatrixXd::Zero(base.expanded(runs), products.front().cols());
  for (long r = 0; r < runs; ++r) {
    const MatrixXd& p = products[static_cast<size_t>(r)];
    out.middleRows(r * base.local, base.local) = p.topRows(base.local);
    out.bottomRows(base.common()) += p.bottomRows(base.common());
  }
  return out;
}

MatrixXd normal_matrix(const Base& base) {
  const long runs = static_cast<long>(base.white.size()), l = base.local, c = base.common();
  MatrixXd n = MatrixXd::Zero(base.expanded(runs), base.expanded(runs));
  for (long r = 0; r < runs; ++r) {
    const MatrixXd& x = base.white[static_cast<size_t>(r)];
    const MatrixXd g = column_gram(x);
    n.block(r * l, r * l, l, l) = g.topLeftCorner(l, l);
    n.block(r * l, r * l, l, l).diagonal() += base.local_precision;
    n.block(runs * l, r * l, c, l) = g.bottomLeftCorner(c, l);
    n.block(r * l, runs * l, l, c) = g.topRightCorner(l, c);
    n.bottomRightCorner(c, c) += g.bottomRightCorner(c, c);
  }
  n.diagonal().segment(runs * l, base.parts) += base.part_precision;
  for (long i = 0; i < n.rows(); ++i)
    if (!(n(i, i) > 0)) n(i, i) = 1; // a power that depends on the others
  return n;
}

double log_of(const VectorXd& precision) {
  double sum = 0;
  for (long i = 0; i < precision.size(); ++i)
    if (precision[i] > 0) sum += std::log(precision[i]);
  return sum;
}

} // namespace

MeanPart part_of(const SlowData& data, const ScanCandidate& candidate, const Theta& shape) {
  MeanPart part = mean_part(data, *candidate.estimator, shape);
  const std::vector<double> sd = candidate.estimator->relative_sd();
  for (size_t c = 0; c < sd.size(); ++c) part.common_precision[static_cast<long>(c)] /= sd[c] * sd[c];
  return part;
}

ScanBank::ScanBank(const SlowData& data, const std::vector<ScanCandidate>& candidates)
    : data_(data), n_candidates_(candidates.size()) {
  long width = 0;
  for (size_t j = 0; j < candidates.size(); ++j)
    for (const Theta& shape : candidates[j].shapes) {
      ScanGroup group{j, shape, part_of(data, candidates[j], shape)};
      Place place;
      place.first = width;
      place.common = group.part.common_precision.size();
      place.local = group.part.local_precision.size();
      place.powers = group.part.powers.empty() ? 0 : group.part.powers.front().cols();
      width += place.width();
      places_.push_back(place);
      groups_.push_back(std::move(group));
    }
  for (size_t r = 0; r < data.y.size(); ++r) {
    MatrixXd x(data.y[r].size(), width);
    for (size_t g = 0; g < groups_.size(); ++g) {
      const Place& at = places_[g];
      const MeanPart& part = groups_[g].part;
      x.middleCols(at.first, at.common) = part.common[r];
      if (at.powers > 0) x.middleCols(at.first + at.common, at.powers) = part.powers[r];
      x.middleCols(at.first + at.common + at.powers, at.local) = part.local[r];
    }
    columns_.emplace_back(x);
  }
  for (ScanGroup& group : groups_) // kept in columns_
    group.part.common.clear(), group.part.local.clear(), group.part.powers.clear();
}

ScanNode::ScanNode(const ScanBank& bank, const NoiseModel& noise, bool keeps_bank)
    : bank_(bank), noise_(noise), self_(bank.places_.size()), white_(bank.columns_.size()) {
  GainsByRun by_run(bank.data_.campaign.runs, noise);
  for (size_t r = 0; r < bank.columns_.size(); ++r) {
    gains_.push_back(by_run.of(bank.data_.campaign.runs[r]));
    sum_log_s_ += gains_.back().sum_log_s;
  }
  const Base usual = base_of(bank.data_, {}, gains_);
  for (size_t r = 0; r < bank.columns_.size(); ++r) {
    MatrixXd x = whitened_bank(r);
    for (size_t g = 0; g < self_.size(); ++g) {
      const auto own = x.middleCols(bank.places_[g].first, bank.places_[g].width());
      self_[g].push_back(column_gram(own));
    }
    MatrixXd y = bank.data_.y[r], both(y.rows(), usual.white[r].cols() + 1); // the bank is read once
    whiten(gains_[r], &y);
    both << usual.white[r], y;
    const MatrixXd products = column_products(both, x);
    usual_.push_back(products.topRows(products.rows() - 1));
    own_.with_bank.push_back(products.bottomRows(1).transpose());
    own_.y.push_back(std::move(y));
    if (keeps_bank) white_[r] = std::move(x);
  }
}

MatrixXd ScanNode::whitened_bank(size_t run) const {
  return bank_.columns_[run].whitened(gains_[run]);
}

const MatrixXd& ScanNode::white(size_t run) const {
  if (white_[run].size() == 0) white_[run] = whitened_bank(run);
  return white_[run];
}

ScanNode::WhiteData ScanNode::white_data(const std::vector<MatrixXd>& y) const {
  WhiteData out;
  for (size_t r = 0; r < y.size(); ++r) {
    MatrixXd x = y[r];
    whiten(gains_[r], &x);
    out.with_bank.push_back(column_products(white(r), x));
    out.y.push_back(std::move(x));
  }
  return out;
}

namespace {

// A group in its expanded places: common columns and powers, then local ones run by run.
struct Expanded {
  MatrixXd m, a, u; // normal matrix; solved products with the base; products with the data
  VectorXd precision;
};

// Log marginal likelihood of the base per draw: `rows` of the solved products `ay`; `log_dets`: of
// innovations, normal matrix and prior.
VectorXd base_value(const VectorXd& energy, const MatrixXd& ay, long rows, double log_dets) {
  return VectorXd(-0.5 * (energy - ay.topRows(rows).colwise().squaredNorm().transpose()).array() - 0.5 * log_dets);
}

// What a group adds to the base, prior at one scale, per draw; -1e300 where its matrix cannot be factored.
Eigen::RowVectorXd gain_at_scale(const Expanded& e, double scale) {
  const VectorXd precision = e.precision / (scale * scale);
  MatrixXd m = e.m;
  m.diagonal() += precision;
  for (long i = 0; i < m.rows(); ++i)
    if (!(m(i, i) > 1e-12)) m(i, i) += 1; // dependent on the base: adds nothing
  const Cholesky own(m);
  if (!own.is_positive()) return Eigen::RowVectorXd::Constant(e.u.cols(), -1e300);
  const MatrixXd half = own.half_solve(e.u);
  return (0.5 * half.colwise().squaredNorm()).array() - 0.5 * (own.log_det() - log_of(precision));
}

// Logarithm of the mean over the prior scales, on top of `start`; -1e300 where no scale could be factored.
Eigen::RowVectorXd value_of(const Expanded& e, const VectorXd& start) {
  const long draws = start.size();
  MatrixXd by_scale(3, draws);
  for (int s = 0; s < 3; ++s) by_scale.row(s) = gain_at_scale(e, kPriorScales[s]);
  Eigen::RowVectorXd out = Eigen::RowVectorXd::Constant(draws, -1e300);
  for (long d = 0; d < draws; ++d) {
    const double top = by_scale.col(d).maxCoeff();
    if (top > -1e299) out[d] = start[d] + top + std::log((by_scale.col(d).array() - top).exp().mean());
  }
  return out;
}

} // namespace

// The base with the data and with all columns of the bank: what every group needs.
struct ScanNode::Products {
  Base base;
  Cholesky factor;                    // of the normal matrix
  std::vector<MatrixXd> with_columns; // per run: base times bank
  const WhiteData* data = nullptr;
  VectorXd energy; // of the whitened data, per draw
  MatrixXd ay;     // solved products with the data
  long draws = 0;
  long n_free() const { return ay.rows() - base.powers; } // without the powers
};

// The columns of the bank from the first that is asked for to the last.
ScanNode::Range ScanNode::asked_columns(const std::vector<Asked>& asked) const {
  Range range;
  for (size_t g = 0; g < bank_.groups_.size(); ++g) {
    const ScanBank::Place& at = bank_.places_[g];
    const auto asks = [&](const Asked& a) { return !a.skip[bank_.groups_[g].candidate]; };
    if (!std::any_of(asked.begin(), asked.end(), asks)) continue;
    if (range.n == 0) range.first = at.first;
    range.n = at.first + at.width() - range.first;
  }
  return range;
}

// Bases times bank of one run: only the columns of parts are new, the usual ones are known.  Outside of `range` nothing
// that can be used.
void ScanNode::multiply_with_bank(const Range& range, size_t run, std::vector<Products>* all) const {
  const MatrixXd& usual = usual_[run];
  long n_new = 0;
  for (const Products& p : *all) n_new += p.base.n_new();
  MatrixXd fresh(gains_[run].n, n_new), with_range;
  long at = 0;
  for (const Products& p : *all) {
    fresh.middleCols(at, p.base.n_new()) = p.base.white[run].middleCols(1, p.base.n_new());
    at += p.base.n_new();
  }
  if (n_new > 0) with_range = column_products(fresh, white(run).middleCols(range.first, range.n));
  at = 0;
  for (Products& p : *all) {
    const long own = p.base.n_new(), powers = p.base.usual_powers();
    MatrixXd out(1 + own + powers, usual.cols());
    out.row(0) = usual.row(0);
    if (own > 0) out.block(1, range.first, own, range.n) = with_range.middleRows(at, own);
    out.bottomRows(powers) = usual.bottomRows(powers);
    p.with_columns.push_back(std::move(out));
    at += own;
  }
}

std::vector<ScanNode::Products> ScanNode::products(const std::vector<Asked>& asked, const WhiteData& y) const {
  std::vector<Products> all;
  for (const Asked& a : asked) {
    Products p;
    p.base = base_of(bank_.data_, a.base, gains_);
    p.data = &y;
    p.draws = y.y.front().cols();
    p.factor = Cholesky(normal_matrix(p.base));
    p.energy = VectorXd::Zero(p.draws);
    std::vector<MatrixXd> with_y;
    for (size_t r = 0; r < y.y.size(); ++r) {
      p.energy += y.y[r].colwise().squaredNorm().transpose();
      with_y.push_back(column_products(p.base.white[r], y.y[r]));
    }
    p.ay = p.factor.half_solve(expanded_products(p.base, with_y));
    all.push_back(std::move(p));
  }
  const Range range = asked_columns(asked);
  for (size_t r = 0; r < y.y.size(); ++r) multiply_with_bank(range, r, &all);
  return all;
}

// Products of the base with the columns of a group, solved: common columns and the local ones of every run.
MatrixXd ScanNode::solved_with(const Products& p, size_t group, long rows) const {
  const ScanBank::Place& at = bank_.places_[group];
  const long runs = static_cast<long>(p.with_columns.size()), shared = at.common + at.powers;
  const long l = p.base.local, c = p.base.common();
  MatrixXd a = MatrixXd::Zero(p.ay.rows(), shared + runs * at.local);
  for (long r = 0; r < runs; ++r) {
    const MatrixXd x = p.with_columns[static_cast<size_t>(r)].middleCols(at.first, at.width());
    a.block(r * l, 0, l, shared) += x.topLeftCorner(l, shared);
    a.block(runs * l, 0, c, shared) += x.bottomLeftCorner(c, shared);
    a.block(r * l, shared + r * at.local, l, at.local) = x.topRightCorner(l, at.local);
    a.block(runs * l, shared + r * at.local, c, at.local) = x.bottomRightCorner(c, at.local);
  }
  return p.factor.half_solve(a).topRows(rows);
}

// Log marginal likelihood of the base with one group, per draw; `rows` of the base stay beside it.
Eigen::RowVectorXd ScanNode::score_group(const Products& p, size_t group, long rows, const VectorXd& start) const {
  const ScanBank::Place& at = bank_.places_[group];
  const MeanPart& part = bank_.groups_[group].part;
  const long runs = static_cast<long>(p.with_columns.size());
  const long shared = at.common + at.powers, k = shared + runs * at.local;
  Expanded e;
  e.a = solved_with(p, group, rows);
  e.m = MatrixXd::Zero(k, k);
  e.u = MatrixXd::Zero(k, p.draws);
  e.precision = VectorXd::Zero(k);
  e.precision.head(at.common) = part.common_precision;
  for (long r = 0; r < runs; ++r) {
    const MatrixXd& s = self_[group][static_cast<size_t>(r)];
    const MatrixXd& xy = p.data->with_bank[static_cast<size_t>(r)];
    const long first = shared + r * at.local;
    e.m.topLeftCorner(shared, shared) += s.topLeftCorner(shared, shared);
    e.m.block(0, first, shared, at.local) = s.topRightCorner(shared, at.local);
    e.m.block(first, 0, at.local, shared) = s.bottomLeftCorner(at.local, shared);
    e.m.block(first, first, at.local, at.local) = s.bottomRightCorner(at.local, at.local);
    e.u.topRows(shared) += xy.middleRows(at.first, shared);
    e.u.middleRows(first, at.local) = xy.middleRows(at.first + shared, at.local);
    e.precision.segment(first, at.local) = part.local_precision;
  }
  e.m -= e.a.transpose() * e.a;
  e.u -= e.a.transpose() * p.ay.topRows(rows);
  return value_of(e, start);
}

ScanNode::Scores ScanNode::score(const std::vector<const MeanPart*>& parts, const std::vector<MatrixXd>& y,
                                 const std::vector<char>& skip) const {
  return score_white({{parts, skip}}, white_data(y)).front();
}

std::vector<ScanNode::Scores> ScanNode::score(const std::vector<Asked>& asked) const {
  return score_white(asked, own_);
}

std::vector<ScanNode::Scores> ScanNode::score_white(const std::vector<Asked>& asked, const WhiteData& y) const {
  const std::vector<Products> all = products(asked, y);
  std::vector<Scores> out;
  for (size_t i = 0; i < asked.size(); ++i) out.push_back(score_one(all[i], asked[i]));
  return out;
}

ScanNode::Scores ScanNode::score_one(const Products& p, const Asked& asked) const {
  const long n_base = p.ay.rows(), n_free = p.n_free();
  double log_det = 0, log_det_free = 0;
  for (long i = 0; i < n_base; ++i) {
    const double term = p.factor.log_det(i);
    log_det += term;
    if (i < n_free) log_det_free += term;
  }
  const double log_prior =
      static_cast<double>(p.data->y.size()) * log_of(p.base.local_precision) + log_of(p.base.part_precision);
  Scores out;
  out.base = base_value(p.energy, p.ay, n_base, sum_log_s_ + log_det - log_prior);
  const VectorXd free = base_value(p.energy, p.ay, n_free, sum_log_s_ + log_det_free - log_prior);
  bool is_replaced = false;
  for (const MeanPart* part : asked.base) is_replaced = is_replaced || !part->powers.empty();
  out.group = MatrixXd::Constant(static_cast<long>(bank_.groups_.size()), p.draws, -1e300);
  for (size_t g = 0; g < bank_.groups_.size(); ++g) {
    const bool replaces = bank_.places_[g].powers > 0; // its own powers take the place of the base's
    if (asked.skip[bank_.groups_[g].candidate] || (replaces && is_replaced)) continue;
    out.group.row(static_cast<long>(g)) = score_group(p, g, replaces ? n_free : n_base, replaces ? free : out.base);
  }
  return out;
}

} // namespace imucal
