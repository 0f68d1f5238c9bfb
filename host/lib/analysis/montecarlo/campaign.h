// SPDX-License-Identifier: MIT
// A Monte Carlo campaign: R simulated calibration tests through the C core, scored against the truth.
//
// Every run is another device: own noise, own turn-on constant; the polynomial is the model's.  Run r is the
// same whatever the thread, the shard or the number of runs (random streams are addressed by the run), and
// the sums over runs are exact (tally.h): a campaign gives the same bits on any number of threads, and shards
// merge to the bits of the whole.
#pragma once
#include <functional>
#include <string>
#include <vector>

#include "analysis/montecarlo/chain.h"
#include "analysis/montecarlo/tally.h"
#include "physics/sim/simulate.h"

namespace imucal {

struct CampaignOptions {
  ErrorModel model;                // the truth, with polynomial and effects
  std::vector<EffectSpec> effects; // further effects
  ErrorModel filter;               // what the calibration filter assumes
  Profile profile;
  int order = 3;
  uint64_t seed = 1;
  uint64_t first_run = 0, runs = 1000;
  int threads = 1;
  RawFormat raw;
  bool no_track = false;   // leave a coarse thermometer's reading as it is
  double missing_frac = 0; // part of the whole seconds without any sample
  size_t points = 13;      // temperatures scored, evenly over the span
  double prior_sigma_dph = kPriorSigma;
  // Extras take more time than the chain itself; they are done for every n-th run (0: none).
  uint64_t least_squares_every = 1;
  uint64_t reference_every = 10; // double-precision filter
  uint64_t residual_every = 20;  // DP curve of the residual after compensation, on a fresh test of the device
};

constexpr int64_t kMostPoints = 1000;
constexpr double kMostMissing = 0.99;

// Windows of the residual's DP curve [s]; none where it is not asked for, or the filter's model has no Markov term.
std::vector<long> residual_windows(const CampaignOptions& options);

// Options made ready: what all runs share.
struct CampaignPlan {
  CampaignOptions options;
  ChainSetup chain;
  ThermalPolynomial truth;                          // in the filter's normalisation
  std::vector<double> t_s, chamber_degc;            // of one test
  std::vector<double> temp_degc;                    // temperatures scored
  std::vector<long> dp_n;                           // residual_windows
  std::vector<std::vector<double>> residual_weight; // see residual.h
  std::vector<double> residual_model_dph;
};

// usage_error or data_error where the request makes no sense: order, empty profile, a profile that does not
// move.
CampaignPlan plan_campaign(const CampaignOptions& options);

// Simulate and score runs first_run … first_run + n - 1, n <= kBatch: the same bits in any batches.
constexpr uint64_t kBatch = 8;
void score_runs(const CampaignPlan& plan, uint64_t first_run, uint64_t n, Tally* tally);

// One run's test through the core, and what the calibration ought to find (coefficients in the plan's
// normalisation, with the run's turn-on constant).
struct CalibrationTest {
  CoreChain chain;
  std::vector<double> truth;
  double turn_on_dph;
};
CalibrationTest calibrate_run(const CampaignPlan& plan, uint64_t run);
// The tests of some runs, n <= kBatch.  Where every sample comes at its time and no effect acts, side by side (batch.h).
std::vector<CalibrationTest> calibrate_runs(const CampaignPlan& plan, uint64_t first_run, uint64_t n);
// The address of a run's log in the simulation: log 0 its calibration test, 1 the fresh one.
SimOptions run_options(const CampaignPlan& plan, uint64_t run, size_t log_index);

struct CampaignResult {
  Tally tally;
  uint64_t first_run = 0, runs_done = 0; // the runs first_run … first_run + runs_done - 1
  bool is_interrupted = false;
  double elapsed_s = 0;
  double cpu_s = 0;
};

// Runs on options.threads threads.  `progress` is called now and then with a snapshot; `stop` is asked
// between batches of up to kBatch runs.
CampaignResult run_campaign(const CampaignPlan& plan, const std::function<void(const CampaignResult&)>& progress,
                            const std::function<bool()>& stop);
// The same with another score than that of score_runs, run by run.
using RunScore = std::function<void(const CampaignPlan&, uint64_t run, Tally*)>;
CampaignResult run_campaign(const CampaignPlan& plan, const RunScore& score,
                            const std::function<void(const CampaignResult&)>& progress,
                            const std::function<bool()>& stop);

// What identifies a campaign: everything but first_run, runs and threads.  Shards merge only when it is the
// same.
Json campaign_identity(const CampaignOptions& options);
CampaignOptions options_from_identity(const JsonField& identity);

// A shard: identity, runs and tally.
void write_partial(const std::string& path, const CampaignOptions& options, const CampaignResult& result);
struct Partial {
  std::string path;
  CampaignOptions options;
  Json identity;
  CampaignResult result;
};
Partial read_partial(const std::string& path);
// data_error: different campaigns, or runs that are in two shards (both files are named).
Partial merge_partials(const std::vector<Partial>& partials);

} // namespace imucal
