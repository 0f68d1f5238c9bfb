// SPDX-License-Identifier: MIT
#include "analysis/diagnose/judge/contribution.h"

#include <algorithm>
#include <cmath>

namespace imucal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kNothing = 0.1; // of its rms: what an effect adds where it rests

// Mean square about the mean of each run.
double about_runs(const std::vector<VectorXd>& parts) {
  double sum = 0, n = 0;
  for (const VectorXd& part : parts) {
    if (part.size() == 0) continue;
    sum += (part.array() - part.mean()).square().sum(), n += static_cast<double>(part.size());
  }
  return n > 0 ? sum / n : 0;
}

// It adds next to nothing half of the time, as a bump does.
bool rests(const VectorXd& added) {
  std::vector<double> sizes(static_cast<size_t>(added.size()));
  for (size_t k = 0; k < sizes.size(); ++k) sizes[k] = std::fabs(added[static_cast<long>(k)]);
  const auto middle = sizes.begin() + static_cast<long>(sizes.size() / 2);
  std::nth_element(sizes.begin(), middle, sizes.end());
  return *middle * *middle * static_cast<double>(added.size()) < kNothing * kNothing * added.squaredNorm();
}

// What one term adds to the mean, run by run.
std::vector<VectorXd> mean_of(const Campaign& campaign, const Hypothesis& h, const Fit& fit, const Design& design,
                              size_t term) {
  std::vector<VectorXd> out;
  const Term& t = h.terms[term];
  std::vector<long> of_term, of_polynomial;
  for (size_t c = 0; c < design.cols(); ++c) {
    if (design.term_of_column[c] == static_cast<int>(term)) of_term.push_back(static_cast<long>(c));
    if (design.term_of_column[c] == kColumnOfPolynomial) of_polynomial.push_back(static_cast<long>(c));
  }
  for (size_t r = 0; r < campaign.runs.size(); ++r) {
    const CampaignRun& run = campaign.runs[r];
    VectorXd mean = VectorXd::Zero(static_cast<long>(run.n()));
    for (long c : of_term) mean += design.x[r].col(c) * fit.beta[c];
    if (t.form() == Form::kTemperature) { // the columns are the polynomial at another temperature
      const MatrixXd still = powers(run, normalised(run.input, run.input.smooth_degc), campaign.order);
      const MatrixXd moved =
          powers(run, normalised(run.input, t.estimator->temperature(run.input, t.shape)), campaign.order);
      for (long i = 0; i < std::min<long>(campaign.order, static_cast<long>(of_polynomial.size())); ++i)
        mean += (moved.col(i) - still.col(i)) * fit.beta[of_polynomial[static_cast<size_t>(i)]];
    }
    out.push_back(mean);
  }
  return out;
}

// Variance of white noise from sample to sample, at a normalised temperature.
double white_at(const NoiseModel& noise, double tn, double dt_s) {
  const double white = noise.white_sigma_dph * noise.white_sigma_dph * std::exp(noise.white_slope * tn);
  return (white + noise.extra_white_dph2) / dt_s;
}
// Variance of the samples about the mean of a run of length_s, at a normalised temperature.
double variance_at(const NoiseModel& noise, double tn, double dt_s, double length_s) {
  double sum = white_at(noise, tn, dt_s);
  for (const Markov& m : noise.markov) {
    const double in_mean = variance_of_mean(length_s / m.tau_s); // takes the slow part of a process with it
    sum += m.sigma_dph * m.sigma_dph * std::exp(noise.markov_slope * tn) * (1 - in_mean);
  }
  return sum + noise.walk_dph_per_rt_s * noise.walk_dph_per_rt_s * length_s / 6;
}

// What a kind of noise adds to another, or takes from it where it is quieter.
double noise_change(const Campaign& campaign, const NoiseModel& with, const NoiseModel& without) {
  const double hits = with.hit_probability * with.hit_sigma_dph * with.hit_sigma_dph;
  const NoiseModel a = gaussian_equivalent(with), b = gaussian_equivalent(without);
  double sum = 0, n = 0;
  for (const CampaignRun& run : campaign.runs) {
    const double length_s = static_cast<double>(run.n()) * campaign.dt_s;
    for (size_t k = 0; k < run.n(); k += 1 + run.n() / 100) {
      const double tn = run.input.tn.empty() ? 0 : run.input.tn[static_cast<size_t>(run.used[k])];
      sum += std::fabs(variance_at(a, tn, campaign.dt_s, length_s) - variance_at(b, tn, campaign.dt_s, length_s)),
          n += 1;
    }
  }
  return hits + (n > 0 ? sum / n : 0);
}

} // namespace

void fill_contributions(const Campaign& campaign, const Hypothesis& final, const Fit& fit,
                        std::vector<SelectedEffect>* effects) {
  if (effects->empty()) return;
  const Design design = make_design(campaign, final);
  for (SelectedEffect& effect : *effects) {
    const EffectEstimator* of = effect.term.estimator;
    if (!of || effect.is_structural || std::isfinite(effect.rms_dph)) continue;
    double square = 0;
    if (of->form() == Form::kNoise) {
      const NoiseModel with = of->noise(final.base_noise, effect.term.shape);
      if (!of->is_nominal_noise()) square = noise_change(campaign, with, final.base_noise);
    }
    for (size_t t = 0; t < final.terms.size(); ++t) {
      const Term& term = final.terms[t];
      const bool is_it = term.estimator == of && (term.form() != Form::kTone || term.shape == effect.term.shape);
      if (is_it && term.form() != Form::kNoise) square += about_runs(mean_of(campaign, final, fit, design, t));
    }
    if (square > 0) effect.rms_dph = std::sqrt(square);
  }
}

std::vector<VectorXd> added_to_mean(const Campaign& campaign, const Hypothesis& hypothesis, const Fit& fit) {
  const Design design = make_design(campaign, hypothesis);
  std::vector<VectorXd> out;
  for (const CampaignRun& run : campaign.runs) out.emplace_back(VectorXd::Zero(static_cast<long>(run.n())));
  for (size_t t = 0; t < hypothesis.terms.size(); ++t) {
    const std::vector<VectorXd> part = mean_of(campaign, hypothesis, fit, design, t);
    for (size_t r = 0; r < out.size(); ++r) out[r] += part[r];
  }
  for (VectorXd& added : out)
    if (added.size() > 0 && !rests(added)) added.array() -= added.mean();
  return out;
}

double white_of_samples_dph(const Campaign& campaign, const NoiseModel& noise) {
  double sum = 0, n = 0;
  for (const CampaignRun& run : campaign.runs)
    for (const int k : run.used) {
      const double tn = run.input.tn.empty() ? 0 : run.input.tn[static_cast<size_t>(k)];
      sum += white_at(noise, tn, campaign.dt_s) + run.own_white_dph2, n += 1;
    }
  return n > 0 ? std::sqrt(sum / n) : 0;
}

} // namespace imucal
