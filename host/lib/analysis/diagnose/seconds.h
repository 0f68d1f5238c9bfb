// SPDX-License-Identifier: MIT
// The fast stage: what the single seconds say once the slow causes are in the mean.  Noise parameters of the
// seconds, kinds of fast noise, tones, and tests of what is left that need no library.
#pragma once
#include <functional>
#include <vector>

#include "analysis/diagnose/fit.h"
#include "analysis/diagnose/search.h"

namespace imucal {

// Log-likelihood of noise models on a residual (rate minus fitted mean) of all runs; Gaussian models and mixtures.
class ResidualLikelihood {
public:
  // Both must outlive it.
  ResidualLikelihood(const Campaign& campaign, const std::vector<Eigen::VectorXd>& residual);
  double operator()(const NoiseModel& noise) const; // -1e300 where it is not finite

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

struct FastFinding {
  const Effect* effect = nullptr;
  Theta theta, theta_errors;
  NoiseModel base; // noise parameters beside it
  double gain_nats = 0;
};
// Every kind of fast noise of the library that may be asked, best first.  `from`: noise that all of them contain.
std::vector<FastFinding> scan_fast_noise(const Campaign& campaign, const SecondsNoise& from,
                                         const std::vector<Eigen::VectorXd>& residual,
                                         const std::vector<const Effect*>& library, const std::vector<bool>& active,
                                         const SelectorConstants& constants);

// A line in the spectrum of innovations, with its drift over temperature.
struct Line {
  double hz = 0, hz_per_degc = 0, gain_nats = 0;
};
// The strongest line above its surroundings, on a grid of frequencies; `with_drift` also looks along f0 + k (T - t0), on a
// grid of k.  What the grid loses on a line between its places is not given back: thresholds are those of the grid.
Line strongest_line(const Campaign& campaign, const std::vector<Eigen::VectorXd>& e, bool with_drift);
// The second part of this: the strongest that drifts where it gains more than `steady`, else `steady`.
Line stronger_drifting(const Campaign& campaign, const std::vector<Eigen::VectorXd>& e, const Line& steady);
// A line found, with frequency and drift where the power along its cosine and sine is largest near the place on the grid.
// A run of N seconds tells a frequency to a part of 1/N Hz, and what misses it leaves a beat behind.
struct PlacedLine {
  Theta shape;           // as the effect `tone` takes it
  double power_nats = 0; // against white noise of 1, all runs together
};
PlacedLine place_of(const Campaign& campaign, const std::vector<Eigen::VectorXd>& e, const EffectEstimator& tone,
                    const Line& line);
// Standard errors of such a place.  e: innovations with the line in them, of the noise without it.
Theta errors_of_place(const Campaign& campaign, const std::vector<Eigen::VectorXd>& e, const EffectEstimator& tone,
                      const Theta& place);

// Tests of innovations that no effect owns.
enum class Rest {
  kSpectrum,
  kVarianceOverTemperature,
  kVarianceOverTime,
  kDistribution,
  kBursts,
  kLine,
  kSuddenChanges,
  kCount
};
struct RestFinding {
  Rest test = Rest::kSpectrum;
  double evidence_nats = 0; // > 0: fires; at rest_rate on a right model
};
std::vector<RestFinding> test_rest(const Campaign& campaign, const std::vector<Eigen::VectorXd>& e,
                                   const SelectorConstants& constants);

} // namespace imucal
