// SPDX-License-Identifier: MIT
#include "analysis/diagnose/stages/foretold_seconds.h"

#include <algorithm>
#include <cmath>

#include "analysis/diagnose/logs/blocks.h"
#include "linear/linear.h"

namespace imucal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr int kHitPasses = 3; // of the mean and of which samples are hits, in turn

// Places of the columns whose coefficients all runs share.
std::vector<long> shared_columns(const Design& design, const Hypothesis& hypothesis) {
  std::vector<long> out;
  for (size_t c = 0; c < design.cols(); ++c) {
    const int of = design.term_of_column[c];
    if (of == kColumnOfPolynomial || (of >= 0 && hypothesis.terms[static_cast<size_t>(of)].form() == Form::kColumns))
      out.push_back(static_cast<long>(c));
  }
  return out;
}

// What the fitted logs tell of one hypothesis.
struct Learned {
  VectorXd shared;              // coefficients
  MatrixXd root;                // root root' is their covariance
  std::vector<double> variance; // per term: of cosine and sine of a tone
};
Learned learn(const Campaign& fitted, const Hypothesis& hypothesis) {
  const Fit fit = fit_hypothesis(fitted, hypothesis);
  const Design design = make_design(fitted, hypothesis);
  const std::vector<long> shared = shared_columns(design, hypothesis);
  const long n = static_cast<long>(shared.size());
  Learned out;
  out.shared.resize(n);
  MatrixXd covariance(n, n);
  for (long i = 0; i < n; ++i) {
    out.shared[i] = fit.beta[shared[static_cast<size_t>(i)]];
    for (long k = 0; k < n; ++k)
      covariance(i, k) = fit.beta_covariance(shared[static_cast<size_t>(i)], shared[static_cast<size_t>(k)]);
  }
  out.root = covariance;
  if (n > 0) { // none: no temperatures, and a tone or a noise alone
    const Spectrum spectrum = symmetric_spectrum(covariance);
    out.root = spectrum.vectors * spectrum.values.cwiseMax(0).cwiseSqrt().asDiagonal();
  }
  for (size_t t = 0; t < hypothesis.terms.size(); ++t) {
    double square = 0, columns = 0;
    for (long c : columns_of(design, t)) square += fit.beta[c] * fit.beta[c], columns += 1;
    out.variance.push_back(columns > 0 ? square / columns : 0);
  }
  return out;
}

// The columns of a unit: what was learned, each with a standard normal coefficient, and what is its own.
struct UnitColumns {
  MatrixXd x;
  VectorXd precision; // 0: flat
  VectorXd y;         // less what was learned
};
UnitColumns columns_of_unit(const Campaign& one, const Hypothesis& hypothesis, const Learned& learned) {
  const Design design = make_design(one, hypothesis);
  const MatrixXd& all = design.x.front();
  const std::vector<long> shared = shared_columns(design, hypothesis);
  const long n_shared = static_cast<long>(shared.size()), n = static_cast<long>(design.cols());
  MatrixXd of_shared(all.rows(), n_shared);
  UnitColumns out;
  out.x.resize(all.rows(), n), out.precision = VectorXd::Ones(n);
  long at = n_shared;
  for (long c = 0; c < n; ++c) {
    const auto place = std::find(shared.begin(), shared.end(), c);
    if (place != shared.end()) {
      of_shared.col(place - shared.begin()) = all.col(c);
      continue;
    }
    const int term = design.term_of_column[static_cast<size_t>(c)];
    const bool is_tone = term >= 0 && hypothesis.terms[static_cast<size_t>(term)].form() == Form::kTone;
    const double variance = is_tone ? learned.variance[static_cast<size_t>(term)] : 0;
    out.precision[at] = variance > 0 ? 1 / variance : design.prior_precision[c];
    out.x.col(at++) = all.col(c);
  }
  out.x.leftCols(n_shared) = of_shared * learned.root;
  out.y = rates(one).front() - of_shared * learned.shared;
  return out;
}

// log p of a unit.  `of_hits`: further variance of samples that no noise of these hypotheses explains; empty: none.
double log_density(const Campaign& one, const Hypothesis& hypothesis, const Learned& learned, const VectorXd& of_hits) {
  const CampaignRun& run = one.runs.front();
  const UnitColumns columns = columns_of_unit(one, hypothesis, learned);
  const NoiseModel noise = hypothesis.noise(), gaussian = gaussian_equivalent(noise);
  const long n = columns.x.cols();
  VectorXd extra = of_hits, b;
  double out = 0;
  for (int pass = 0; pass < (noise.hit_probability > 0 ? kHitPasses : 1); ++pass) {
    const RunGains gains = compute_gains(run, gaussian, extra.size() > 0 ? &extra : nullptr);
    MatrixXd white(columns.x.rows(), n + 1);
    white.leftCols(n) = columns.x, white.col(n) = columns.y;
    whiten(gains, &white);
    MatrixXd curvature = white.leftCols(n).transpose() * white.leftCols(n);
    curvature.diagonal() += columns.precision;
    double log_curvature = 0;
    b = solve_symmetric(curvature, white.leftCols(n).transpose() * white.col(n), &log_curvature);
    out = -0.5 * (gains.sum_log_s + (white.col(n) - white.leftCols(n) * b).squaredNorm());
    const VectorXd residual = columns.y - columns.x * b;
    if (noise.is_mixture()) out = mixture_log_likelihood(run, noise, residual);
    if (noise.hit_probability > 0) extra = expected_hit_dph2(run, noise, residual);
    out -= 0.5 * (b.dot(columns.precision.cwiseProduct(b)) + log_curvature);
  }
  for (double p : columns.precision) out += p > 0 ? 0.5 * std::log(p) : 0;
  return out;
}

Campaign with_runs(const Campaign& like, std::vector<CampaignRun> runs) {
  Campaign out = like;
  out.runs = std::move(runs);
  return out;
}

// Deviance that the answer takes off some units.
std::vector<double> gain_of_units(const Campaign& fitted, const std::vector<CampaignRun>& units,
                                  const Hypothesis& nominal, const Hypothesis& final) {
  const Learned before = learn(fitted, nominal), after = learn(fitted, final);
  const bool has_hits = final.noise().hit_probability > 0;
  std::vector<double> out;
  for (const CampaignRun& unit : units) {
    const Campaign one = with_runs(fitted, {unit});
    const VectorXd of_hits = has_hits ? VectorXd() : VectorXd(hits_of(one).front().array().square());
    out.push_back(2 * (log_density(one, final, after, of_hits) - log_density(one, nominal, before, of_hits)));
  }
  return out;
}

} // namespace

bool has_names_of_seconds(const std::vector<SelectedEffect>& effects) {
  return std::any_of(effects.begin(), effects.end(), [](const SelectedEffect& e) {
    const EffectEstimator* of = e.term.estimator;
    return of && (of->form() == Form::kTone || (of->form() == Form::kNoise && !of->is_slow_noise()));
  });
}

std::vector<double> gain_of_seconds(const Campaign& fitted, const Campaign* held_out, const Hypothesis& nominal,
                                    const Hypothesis& final) {
  const Hypothesis answer = without_jumps(final);
  if (held_out) return gain_of_units(fitted, held_out->runs, nominal, answer);
  std::vector<double> out;
  const bool is_single = fitted.runs.size() == 1;
  for (size_t u = 0; u < (is_single ? kQuarters : fitted.runs.size()); ++u) {
    std::vector<CampaignRun> rest = fitted.runs;
    if (is_single)
      rest.front() = only_quarter(fitted.runs.front(), u, false);
    else
      rest.erase(rest.begin() + static_cast<long>(u));
    const CampaignRun unit = is_single ? only_quarter(fitted.runs.front(), u, true) : fitted.runs[u];
    out.push_back(unit.n() > 0 ? gain_of_units(with_runs(fitted, rest), {unit}, nominal, answer).front() : 0);
  }
  return out;
}

} // namespace imucal
