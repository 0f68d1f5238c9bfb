// SPDX-License-Identifier: MIT
// Noise of the seconds once the slow causes are in the mean: its parameters, fits of kinds of fast noise, hits that stand out,
// the sample of a jump.  Several stages ask it; fast_stage.h decides.
#pragma once
#include <functional>
#include <optional>
#include <vector>

#include "analysis/diagnose/evidence/fit.h"
#include "analysis/diagnose/search/search.h"

namespace imucal {

// Log-likelihood of noise models on a residual (rate minus fitted mean) of all runs; Gaussian models and mixtures.
class ResidualLikelihood {
public:
  // Both must outlive it: the residual is no temporary.
  ResidualLikelihood(const Campaign& campaign, const std::vector<Eigen::VectorXd>& residual);
  ResidualLikelihood(const Campaign& campaign, std::vector<Eigen::VectorXd>&& residual) = delete;
  double operator()(const NoiseModel& noise) const; // -1e300 where it is not finite
  double dt_s() const { return campaign_.dt_s; }

private:
  double of_mixture(const NoiseModel& noise) const;
  double of_followed(const NoiseModel& noise) const;
  double of_whitened(const NoiseModel& noise) const;

  const Campaign& campaign_;
  const std::vector<Eigen::VectorXd>& residual_;
  std::vector<RunTimes> times_;
  struct Alike {
    size_t first;            // run
    Eigen::MatrixXd columns; // of it and of the next runs with samples at the same times
  };
  std::vector<Alike> alike_;
};

// White noise, slow density and time constant of a noise model fitted to a residual; its effects stay as they are.
struct SecondsNoise {
  NoiseModel base;
  double log_likelihood = -1e300;
};
// `with`, where given: what an effect makes of the base that is varied.
SecondsNoise fit_seconds_noise(const Campaign& campaign, const NoiseModel& start,
                               const std::vector<Eigen::VectorXd>& residual,
                               const std::function<NoiseModel(const NoiseModel&)>& with = {});

// Samples that stand out of all noise, as block means leave them out.
struct StandingOut {
  std::vector<Eigen::VectorXd> left; // the residual without them
  double part = 0, rms_dph = 0;      // of all samples; how far they are off
  SecondsNoise beside = {};          // the noise of what is left, where somebody has fitted it
};
// Nothing: there are none.
std::optional<StandingOut> standing_out(const Campaign& campaign, const std::vector<Eigen::VectorXd>& residual);

// Innovations without them; normal scores of noise with hits hold none.
std::vector<Eigen::VectorXd> innovations_less_hits(const Campaign& campaign, const NoiseModel& noise, const Fit& fit);

struct FastFinding {
  const Effect* effect = nullptr;
  Theta theta, theta_errors;
  NoiseModel base; // noise parameters beside it
  double gain_nats = 0;
  // Another kind that is there too, as it was found; nullptr: none.
  const EffectEstimator* other = nullptr;
  Theta other_theta = {};

  // Both make of a base; and of that beside them.
  NoiseModel noise_on(const NoiseModel& any_base) const;
  NoiseModel noise() const { return noise_on(base); }
};
struct FastScan {
  std::vector<FastFinding> findings; // best first
  // The noise without any of them, from the start `from` and from that beside each that gains: a search beside a kind may
  // come to a better noise, and what that gains alone is not the kind's.
  SecondsNoise plain;
  bool changes_suddenly = false; // the innovations, hits that stand out apart
};
// Every kind of fast noise of the library that may be asked.  `from`: noise that all of them contain.
// `may_ask_slow`: kinds of slow noise too where that noise does not fit the spectrum of the residual.
// `hits`: `from` has swallowed them, kinds with hits are searched from the noise beside them.
FastScan scan_fast_noise(const Campaign& campaign, const SecondsNoise& from,
                         const std::vector<Eigen::VectorXd>& residual, const std::vector<const Effect*>& library,
                         const std::vector<bool>& active, const SelectorConstants& constants, bool may_ask_slow = false,
                         const std::optional<StandingOut>& hits = std::nullopt);
// The parameters of a finding searched again on another residual, those of the noise beside it where `is_base_free`.
// Returns the log-likelihood that they reach.
double fit_again(const ResidualLikelihood& log_likelihood, bool is_base_free, FastFinding* finding);
// A second kind beside the first, both searched in turn, where it gains `least_nats` over the first alone, which is changed
// then; no effect: it does not.
FastFinding second_kind(const ResidualLikelihood& log_likelihood, bool is_base_free,
                        const std::vector<FastFinding>& rest, double least_nats, FastFinding* first);
// By how much a free spectrum beside the noise of a finding makes a residual likelier than the kind that was found.
double gain_of_free_spectrum(const Campaign& campaign, const std::vector<Eigen::VectorXd>& residual,
                             const FastFinding& finding);
// Standard errors of its parameters, the noise beside it as free as the residual tells it: a slope over temperature has one
// with the level free, not at the middle of a scale that the logs may never pass.
void set_errors(const ResidualLikelihood& log_likelihood, FastFinding* finding);

// What is left of a run where a jump of this size comes before sample `to` and not before sample `from`.
Eigen::VectorXd with_jump_moved(Eigen::VectorXd residual, double size_dph, long from, long to);
// The sample before which a jump came, by what is left where it comes earlier or later: from the residual of its run, with the
// jump of this size before sample `at`.
long sample_of_jump(const CampaignRun& run, const NoiseModel& noise, const Eigen::VectorXd& residual, double size_dph,
                    long at, long reach);

} // namespace imucal
