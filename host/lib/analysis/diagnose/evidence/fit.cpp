// SPDX-License-Identifier: MIT
#include "analysis/diagnose/evidence/fit.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "analysis/diagnose/logs/blocks.h"
#include "base/units.h"
#include "linear/linear.h"

namespace imucal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

NoiseModel Hypothesis::noise() const {
  NoiseModel out = base_noise;
  for (const Term& term : terms)
    if (term.form() == Form::kNoise) out = term.estimator->noise(out, term.shape);
  return out;
}

Hypothesis without_jumps(Hypothesis h) {
  const auto is_of_one_log = [](const Term& term) { return term.form() == Form::kSteps; };
  h.terms.erase(std::remove_if(h.terms.begin(), h.terms.end(), is_of_one_log), h.terms.end());
  return h;
}

namespace {

// Tn of the polynomial: that of the last term that replaces the temperature, else the logged one.
Column polynomial_input(const RunInput& in, const Hypothesis& hypothesis) {
  const Term* replaces = nullptr;
  for (const Term& term : hypothesis.terms)
    if (term.form() == Form::kTemperature) replaces = &term;
  return replaces ? normalised(in, replaces->estimator->temperature(in, replaces->shape)) : in.tn;
}

// Columns of one term: `fill` writes them, from column `first` on, into the design of a run.
struct TermColumns {
  int n = 0;
  std::function<void(size_t run, MatrixXd* x, int first)> fill;
  double precision = 0;
};

// Start states of an effect with a memory: columns of each run alone, with a weak prior.
struct StartColumns {
  std::vector<MatrixXd> of_run;
  double precision = 0;
  long cols() const {
    long sum = 0;
    for (const MatrixXd& m : of_run) sum += m.cols();
    return sum;
  }
};
StartColumns start_columns(const Campaign& campaign, const Term& term) {
  StartColumns out;
  if (term.form() != Form::kColumns && term.form() != Form::kTemperature) return out;
  const double sd = term.estimator->prior().start * campaign.spread_dph;
  out.precision = sd > 0 ? 1 / (sd * sd) : 1e-6;
  for (const CampaignRun& run : campaign.runs)
    out.of_run.push_back(used_rows(run, free_states(*term.estimator, run.input, term.shape)));
  return out;
}

// 1 in the seconds of a run from a jump on.
VectorXd from_jump(const CampaignRun& run, double jump_s) {
  VectorXd out(static_cast<long>(run.n()));
  for (size_t k = 0; k < run.n(); ++k)
    out[static_cast<long>(k)] = run.input.t_s[static_cast<size_t>(run.used[k])] >= jump_s ? 1.0 : 0.0;
  return out;
}
// The levels after jumps that a run has of its own.
StartColumns own_jump_columns(const Campaign& campaign) {
  StartColumns out;
  out.precision = 1e-6;
  for (const CampaignRun& run : campaign.runs) {
    out.of_run.emplace_back(MatrixXd::Zero(static_cast<long>(run.n()), static_cast<long>(run.own_jumps.size())));
    for (size_t j = 0; j < run.own_jumps.size(); ++j)
      out.of_run.back().col(static_cast<long>(j)) = from_jump(run, run.own_jumps[j].t_s);
  }
  return out;
}

TermColumns term_columns(const Campaign& campaign, const Term& term) {
  TermColumns out;
  const int n_runs = static_cast<int>(campaign.runs.size());
  switch (term.form()) {
  case Form::kColumns:
    out.n = static_cast<int>(term.estimator->n_columns());
    out.fill = [&campaign, &term](size_t r, MatrixXd* x, int first) {
      const auto columns = term.estimator->columns(campaign.runs[r].input, term.shape);
      x->middleCols(first, static_cast<long>(columns.size())) = used_rows(campaign.runs[r], columns);
    };
    break;
  case Form::kRunRandom:
    out.n = n_runs * static_cast<int>(term.estimator->n_columns());
    out.precision = 1.0 / (term.shape[0] * term.shape[0]);
    out.fill = [&campaign, &term](size_t r, MatrixXd* x, int first) {
      const auto columns = term.estimator->columns(campaign.runs[r].input, term.shape);
      const long n = static_cast<long>(columns.size());
      x->middleCols(first + static_cast<long>(r) * n, n) = used_rows(campaign.runs[r], columns);
    };
    break;
  case Form::kTone:
    out.n = 2 * n_runs;
    out.fill = [&campaign, &term](size_t r, MatrixXd* x, int first) {
      x->middleCols(first + 2 * static_cast<int>(r), 2) =
          used_rows(campaign.runs[r], term.estimator->columns(campaign.runs[r].input, term.shape));
    };
    break;
  case Form::kSteps:
    out.n = static_cast<int>(term.shape.size() / 2);
    out.fill = [&campaign, &term](size_t r, MatrixXd* x, int first) {
      for (size_t s = 0; s < term.shape.size() / 2; ++s)
        if (term.shape[2 * s] == static_cast<double>(r))
          x->col(first + static_cast<int>(s)) = from_jump(campaign.runs[r], term.shape[2 * s + 1]);
    };
    break;
  default:
    break;
  }
  return out;
}

} // namespace

Design make_design(const Campaign& campaign, const Hypothesis& hypothesis) {
  Design design;
  const size_t n_runs = campaign.runs.size();
  std::vector<TermColumns> of_terms;
  for (size_t r = 0; r < n_runs; ++r) design.term_of_column.push_back(kColumnOfConstant);
  for (int i = 0; i < campaign.order; ++i) design.term_of_column.push_back(kColumnOfPolynomial);
  for (size_t t = 0; t < hypothesis.terms.size(); ++t) {
    of_terms.push_back(term_columns(campaign, hypothesis.terms[t]));
    for (int i = 0; i < of_terms.back().n; ++i) design.term_of_column.push_back(static_cast<int>(t));
  }
  std::vector<StartColumns> starts;
  for (const Term& term : hypothesis.terms) starts.push_back(start_columns(campaign, term));
  for (const Term& term : hypothesis.known) starts.push_back(start_columns(campaign, term));
  starts.push_back(own_jump_columns(campaign));
  for (const StartColumns& start : starts) {
    design.term_of_column.insert(design.term_of_column.end(), static_cast<size_t>(start.cols()), kColumnOfStart);
  }
  design.start_of_column.assign(design.cols(), -1);
  size_t at = design.cols();
  for (const StartColumns& start : starts) at -= static_cast<size_t>(start.cols());
  for (size_t t = 0; t < starts.size(); ++t)
    for (const MatrixXd& of_run : starts[t].of_run) {
      if (t < hypothesis.terms.size() && of_run.cols() > 0) design.start_of_column[at] = static_cast<int>(t);
      at += static_cast<size_t>(of_run.cols());
    }
  const long p = static_cast<long>(design.cols());
  design.prior_precision = VectorXd::Zero(p);
  for (size_t r = 0; r < n_runs; ++r) {
    const CampaignRun& run = campaign.runs[r];
    MatrixXd x = MatrixXd::Zero(static_cast<long>(run.n()), p);
    x.col(static_cast<long>(r)).setOnes();
    if (campaign.order > 0)
      x.middleCols(static_cast<long>(n_runs), campaign.order) =
          powers(run, polynomial_input(run.input, hypothesis), campaign.order);
    int first = static_cast<int>(n_runs) + campaign.order;
    for (const TermColumns& columns : of_terms) {
      if (columns.n == 0) continue;
      columns.fill(r, &x, first);
      first += columns.n;
    }
    for (const StartColumns& start : starts)
      for (size_t of = 0; of < start.of_run.size(); ++of) {
        const long width = start.of_run[of].cols();
        if (of == r) x.middleCols(first, width) = start.of_run[of];
        first += static_cast<int>(width);
      }
    design.x.push_back(std::move(x));
  }
  int first = static_cast<int>(n_runs) + campaign.order;
  for (const TermColumns& columns : of_terms) {
    for (int i = 0; i < columns.n; ++i) design.prior_precision[first + i] = columns.precision;
    first += columns.n;
  }
  for (const StartColumns& start : starts)
    for (long i = 0; i < start.cols(); ++i) design.prior_precision[first++] = start.precision;
  return design;
}

std::vector<long> columns_of(const Design& design, size_t term) {
  std::vector<long> out;
  for (size_t c = 0; c < design.cols(); ++c)
    if (design.term_of_column[c] == static_cast<int>(term)) out.push_back(static_cast<long>(c));
  return out;
}

std::vector<VectorXd> rates(const Campaign& campaign) {
  std::vector<VectorXd> out;
  for (const CampaignRun& run : campaign.runs) out.push_back(used_rows(run, {run.input.rate_dph}));
  return out;
}

namespace {

constexpr double kDependent = 1e-9; // of the scaled columns: below it a column adds nothing

constexpr long kRowsAtOnce = 1 << 17; // of a long run: bounds the memory

// Least squares by QR, run after run: the triangle of what came before is stacked on the next rows.
struct Triangle {
  MatrixXd r;     // upper triangle of [X y] or X
  VectorXd scale; // of the columns of X
};

// prior_precision: one per column of X; xy may have one more, y.
Triangle triangle(const std::vector<MatrixXd>& xy, const VectorXd& prior_precision) {
  const long q = xy.front().cols(), p = prior_precision.size();
  Triangle out;
  out.scale = VectorXd::Zero(p);
  for (const MatrixXd& m : xy) out.scale += m.leftCols(p).colwise().squaredNorm().transpose();
  out.scale += prior_precision;
  for (long c = 0; c < p; ++c) out.scale[c] = out.scale[c] > 0 ? 1.0 / std::sqrt(out.scale[c]) : 0.0;
  MatrixXd top = MatrixXd::Zero(q, q);
  for (long c = 0; c < p; ++c) top(c, c) = std::sqrt(prior_precision[c]) * out.scale[c];
  for (const MatrixXd& m : xy)
    for (long first = 0; first < m.rows(); first += kRowsAtOnce) {
      const long rows = std::min(kRowsAtOnce, m.rows() - first);
      MatrixXd stack(q + rows, q);
      stack.topRows(q) = top;
      stack.bottomRows(rows) = m.middleRows(first, rows);
      for (long c = 0; c < p; ++c) stack.block(q, c, rows, 1) *= out.scale[c];
      top = triangle_of(&stack);
    }
  out.r = top;
  return out;
}

// X times it has orthonormal columns; dependent ones are left out.
MatrixXd transform_of(const Triangle& t) {
  const long p = t.scale.size();
  const PivotedQr qr(t.r.topLeftCorner(p, p), kDependent);
  const MatrixXd places = qr.permuted(MatrixXd(MatrixXd::Identity(p, p)));
  return t.scale.asDiagonal() * places.leftCols(qr.rank()) * qr.r_inverse();
}

struct Solution {
  VectorXd beta;
  MatrixXd covariance;
  double rss = 0, log_det = 0;
};

Solution solve(const Triangle& t) {
  const long p = t.scale.size();
  Solution out;
  out.beta = VectorXd::Zero(p), out.covariance = MatrixXd::Zero(p, p);
  const MatrixXd r = t.r.topLeftCorner(p, p);
  const VectorXd z = t.r.block(0, p, p, 1);
  out.rss = t.r(p, p) * t.r(p, p);
  if (p == 0) return out;
  const PivotedQr qr(r, kDependent);
  const VectorXd b = qr.solve(z);
  out.rss += (z - r * b).squaredNorm();
  const long rank = qr.rank();
  for (long i = 0; i < rank; ++i) out.log_det += qr.log_abs_r(i);
  // Covariance (R'R)^-1 on the columns that are determined.
  MatrixXd half = MatrixXd::Zero(p, rank);
  half.topRows(rank) = qr.r_inverse();
  half = qr.permuted(half);
  for (long c = 0; c < p; ++c) {
    out.beta[c] = b[c] * t.scale[c];
    half.row(c) *= t.scale[c];
    if (t.scale[c] > 0) out.log_det -= std::log(t.scale[c]);
  }
  out.covariance.noalias() = half * half.transpose();
  return out;
}

// [X y], run by run; takes the columns away from the design: a copy of a long log is large.
std::vector<MatrixXd> with_rates(Design* design, const std::vector<VectorXd>& y) {
  std::vector<MatrixXd> xy = std::move(design->x);
  for (size_t r = 0; r < y.size(); ++r) {
    xy[r].conservativeResize(Eigen::NoChange, xy[r].cols() + 1);
    xy[r].rightCols(1) = y[r];
  }
  return xy;
}

// Additional variance of hits, per run.
std::vector<VectorXd> hit_variance(const Campaign& campaign, const NoiseModel& noise,
                                   const std::vector<VectorXd>& residual) {
  std::vector<VectorXd> out;
  for (size_t r = 0; r < campaign.runs.size(); ++r)
    out.push_back(expected_hit_dph2(campaign.runs[r], noise, residual[r]));
  return out;
}

// A hit that stands out counts as little as it is far off, before it is known whether the noise has hits: squares of one of a
// million dph moved the polynomial by hundreds.  Empty: no run has any.
std::vector<VectorXd> variance_of_hits(const Campaign& campaign) {
  std::vector<VectorXd> out = hits_of(campaign);
  bool has_any = false;
  for (VectorXd& hits : out) has_any = has_any || hits.any(), hits = hits.array().square();
  if (!has_any) out.clear();
  return out;
}

struct GlsPass {
  Solution solution;
  std::vector<MatrixXd> white; // whitened [X y]
  double sum_log_s = 0;
};

GlsPass gls(const Campaign& campaign, const std::vector<MatrixXd>& xy, const VectorXd& prior, const NoiseModel& noise,
            const std::vector<VectorXd>& extra) {
  GlsPass pass;
  for (size_t r = 0; r < xy.size(); ++r) {
    const RunGains gains = compute_gains(campaign.runs[r], noise, extra.empty() ? nullptr : &extra[r]);
    pass.white.push_back(xy[r]);
    whiten(gains, &pass.white.back());
    pass.sum_log_s += gains.sum_log_s;
  }
  pass.solution = solve(triangle(pass.white, prior));
  return pass;
}

std::vector<VectorXd> residuals(const std::vector<MatrixXd>& xy, const VectorXd& beta) {
  std::vector<VectorXd> out;
  for (const MatrixXd& m : xy) out.push_back(m.rightCols(1) - m.leftCols(m.cols() - 1) * beta);
  return out;
}

constexpr double kBlur[] = {4, 2};       // of the first passes: factors on white noise
constexpr int kLevelPasses = 8;          // after them, at most
constexpr double kLevelGain_nats = 0.05; // of a pass worth another one

double mixture_log_likelihood(const Campaign& campaign, const NoiseModel& noise, const Fit& fit) {
  double sum = 0;
  for (size_t r = 0; r < campaign.runs.size(); ++r)
    sum += mixture_log_likelihood(campaign.runs[r], noise, fit.residual[r]);
  return sum;
}

// The mean where telegraph noise has the levels that `told` finds in these residuals.  What is not known of a level lasts as
// long as that noise does: with no jump in sight this is the fit under its Gaussian twin.
Fit fit_less_levels(const Campaign& campaign, std::vector<MatrixXd> xy, const VectorXd& prior, const NoiseModel& noise,
                    const NoiseModel& told, const std::vector<VectorXd>& residual) {
  double unknown_dph2 = 0, n = 0;
  std::vector<VectorXd> levels;
  for (size_t r = 0; r < xy.size(); ++r) {
    const TelegraphLevel level = telegraph_level(campaign.runs[r], told, residual[r]);
    levels.push_back(level.mean_dph);
    xy[r].rightCols(1) -= level.mean_dph;
    unknown_dph2 += level.variance_dph2.sum(), n += static_cast<double>(level.mean_dph.size());
  }
  NoiseModel left = noise;
  left.telegraph_dph = std::sqrt(unknown_dph2 / std::max(n, 1.0));
  const Solution solution = gls(campaign, xy, prior, gaussian_equivalent(left), {}).solution;
  Fit fit;
  fit.residual = residuals(xy, solution.beta);
  for (size_t r = 0; r < levels.size(); ++r) fit.residual[r] += levels[r];
  fit.beta = solution.beta, fit.beta_covariance = solution.covariance, fit.log_det_r = solution.log_det;
  fit.log_likelihood = mixture_log_likelihood(campaign, noise, fit);
  return fit;
}

// The mean beside telegraph noise, in turn with its levels, from these residuals on; `fit` is what it becomes where it is
// likelier so.
void improve_levels(const Campaign& campaign, const std::vector<MatrixXd>& xy, const VectorXd& prior,
                    const NoiseModel& noise, std::vector<VectorXd> residual, Fit* fit) {
  double before = -1e300;
  for (int i = 0; i < kLevelPasses; ++i) {
    Fit next = fit_less_levels(campaign, xy, prior, noise, noise, residual);
    const double gain = next.log_likelihood - before;
    before = next.log_likelihood, residual = next.residual;
    if (next.log_likelihood > fit->log_likelihood) *fit = std::move(next);
    if (gain < kLevelGain_nats) return;
  }
}
// The mean under the Gaussian twin of telegraph noise may be wrong by as much as a level, and keeps levels wrong then.  Told
// through more white noise at first, levels are right on the whole before they are sharp (deterministic annealing: Ueda and
// Nakano, Neural Networks 11, 1998).  The likeliest of both ways and of what is `near` counts.
void fit_beside_levels(const Campaign& campaign, const std::vector<MatrixXd>& xy, const VectorXd& prior,
                       const NoiseModel& noise, const std::vector<VectorXd>* near, Fit* fit) {
  fit->log_likelihood = mixture_log_likelihood(campaign, noise, *fit);
  std::vector<VectorXd> residual = fit->residual;
  improve_levels(campaign, xy, prior, noise, residual, fit);
  for (double blur : kBlur) {
    NoiseModel blurred = noise;
    blurred.white_sigma_dph *= blur;
    residual = fit_less_levels(campaign, xy, prior, noise, blurred, residual).residual;
  }
  improve_levels(campaign, xy, prior, noise, residual, fit);
  if (near) improve_levels(campaign, xy, prior, noise, *near, fit);
}

} // namespace

Fit fit_hypothesis(const Campaign& campaign, const Hypothesis& hypothesis, const std::vector<VectorXd>* near) {
  const NoiseModel noise = hypothesis.noise(), gaussian = gaussian_equivalent(noise);
  Design design = make_design(campaign, hypothesis);
  const std::vector<MatrixXd> xy = with_rates(&design, rates(campaign));
  const std::vector<VectorXd> of_hits = variance_of_hits(campaign);
  GlsPass pass = gls(campaign, xy, design.prior_precision, gaussian, of_hits);
  Fit fit;
  fit.residual = residuals(xy, pass.solution.beta);
  if (noise.hit_probability > 0) {
    for (int i = 0; i < 2; ++i) {
      pass = gls(campaign, xy, design.prior_precision, gaussian, hit_variance(campaign, noise, fit.residual));
      fit.residual = residuals(xy, pass.solution.beta);
    }
  }
  fit.beta = pass.solution.beta;
  fit.beta_covariance = pass.solution.covariance;
  fit.log_det_r = pass.solution.log_det;
  if (noise.telegraph_dph > 0 && noise.hit_probability == 0)
    fit_beside_levels(campaign, xy, design.prior_precision, noise, near, &fit);
  if (noise.is_mixture()) {
    fit.log_likelihood = 0;
    for (size_t r = 0; r < campaign.runs.size(); ++r) {
      VectorXd scores;
      fit.log_likelihood += mixture_log_likelihood(campaign.runs[r], noise, fit.residual[r], &scores);
      fit.e.push_back(scores);
    }
  } else {
    fit.log_likelihood = -0.5 * (pass.sum_log_s + pass.solution.rss);
    fit.e = of_hits.empty() ? residuals(pass.white, fit.beta) : whitened(campaign.runs, gaussian, fit.residual);
  }
  return fit;
}

bool is_same_fit(const Hypothesis& a, const Hypothesis& b) {
  const bool has_more = !a.terms.empty() || !a.known.empty() || !b.terms.empty() || !b.known.empty();
  return !has_more && a.base_noise == b.base_noise;
}

MatrixXd orthonormaliser(const std::vector<MatrixXd>& columns) {
  return transform_of(triangle(columns, VectorXd::Zero(columns.front().cols())));
}

} // namespace imucal
