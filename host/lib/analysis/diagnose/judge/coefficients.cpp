// SPDX-License-Identifier: MIT
#include "analysis/diagnose/judge/coefficients.h"

#include <cmath>

#include "analysis/diagnose/stages/mean_lines.h"

namespace imucal {

namespace {

// Curvature of the marginal likelihood over the shape of one name, the rest as found.
Theta shape_errors(const SlowAnswer& slow, const SelectedEffect& effect) {
  const SlowModel& best = slow.found.best;
  for (size_t i = 0; i < best.names.size(); ++i) {
    const EffectEstimator& e = *slow.candidate(best.names[i].candidate).scan.estimator;
    if (&e != effect.term.estimator || e.shape_lo().size() != best.names[i].shape.size() || e.shape_lo().empty())
      continue;
    SlowModel m = best;
    return curvature_errors(
        [&](const Theta& shape) {
          m.names[i].shape = shape;
          return slow.search->grams_of(m).log_marginal(1);
        },
        best.names[i].shape, e.shape_lo(), e.shape_hi());
  }
  return {};
}

} // namespace

void fill_coefficients(const AxisQuestion& question, const Fit& fit, Found* found,
                       std::vector<SelectedEffect>* effects) {
  Hypothesis& h = found->seconds.final;
  const Design design = make_design(question.campaign, h);
  for (size_t t = 0; t < h.terms.size(); ++t) {
    Term& term = h.terms[t];
    term.coefficients.clear(), term.coefficient_errors.clear();
    term.starts.clear(), term.start_errors.clear(), term.start_covariances.clear();
    long first = -1;
    for (long c = 0; c < fit.beta.size(); ++c) {
      const double value = fit.beta[c], error = std::sqrt(fit.beta_covariance(c, c));
      if (design.term_of_column[static_cast<size_t>(c)] == static_cast<int>(t)) {
        if (term.coefficients.empty()) first = c;
        term.coefficients.push_back(value), term.coefficient_errors.push_back(error);
      }
    }
    for (long c = 0; c < fit.beta.size(); ++c)
      if (design.start_of_column[static_cast<size_t>(c)] == static_cast<int>(t)) {
        term.starts.push_back(fit.beta[c]), term.start_errors.push_back(std::sqrt(fit.beta_covariance(c, c)));
        term.start_covariances.push_back(first < 0 ? 0 : fit.beta_covariance(c, first));
      }
    for (SelectedEffect& effect : *effects)
      if (effect.term.estimator == term.estimator && (term.form() != Form::kTone || effect.term.shape == term.shape)) {
        effect.term.coefficients = term.coefficients;
        effect.term.coefficient_errors = term.coefficient_errors;
        effect.term.starts = term.starts, effect.term.start_errors = term.start_errors;
        effect.term.start_covariances = term.start_covariances;
        if (term.form() == Form::kTone)
          effect.term.shape_errors = line_errors(question.campaign, design, fit, found->seconds.noise.base, term, t);
        else if (effect.term.shape_errors.empty())
          effect.term.shape_errors = shape_errors(found->slow, effect);
      }
  }
}

} // namespace imucal
