// SPDX-License-Identifier: MIT
// Logs, models and questions that the unit tests of diagnose share.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <set>
#include <string>
#include <vector>

#include "analysis/diagnose/diagnose.h"
#include "analysis/diagnose/logs/blocks.h"
#include "base/rng.h"
#include "base/units.h"
#include "near.h" // after the others: it defines a macro `fail`

using namespace imucal;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// The bias of the simulated logs: a cubic polynomial of temperature.
inline double bias_dph(double temp_degc) {
  const double x = (temp_degc - 30) / 30;
  return 100 + 300 * x + 150 * x * x - 100 * x * x * x;
}

// A log of one axis over a triangle in temperature, noise from the model, with seconds missing.
inline Log simulated_log(uint64_t seed, size_t seconds, bool has_gaps, double hysteresis_dph) {
  Log log;
  log.path = "simulated.csv";
  LogAxis axis;
  axis.name = "gx_dph";
  Rng rng(seed, 0, 0, Stream::kWhite);
  double markov = 20 * rng.normal(), play = 5;
  const double phi = std::exp(-0.01), q = 20 * std::sqrt(1 - phi * phi);
  for (size_t k = 0; k < seconds; ++k) {
    const double half = static_cast<double>(seconds) / 2, t = static_cast<double>(k);
    const double temp = 60 * (t < half ? t / half : 2 - t / half);
    play = std::min(std::max(play, temp - 5), temp + 5);
    if (k) markov = phi * markov + q * rng.normal();
    const double white = 36 * rng.normal();
    if (has_gaps && (k % 97 == 5 || (k > 500 && k < 620))) continue;
    log.t_s.push_back(t + 1);
    log.temp_degc.push_back(temp);
    axis.rate_dph.push_back(bias_dph(temp) + hysteresis_dph * (play - temp) / 5 + markov + white);
  }
  log.axes.push_back(axis);
  return log;
}

inline ErrorModel nominal_model() {
  ErrorModel model;
  model.arw_deg_rt_h = 0.6;
  model.markov = {{20, 100}};
  model.bias = ThermalPolynomial{30, 30, {80, 300, 150, -100}};
  return model;
}

inline Hypothesis nominal_hypothesis() {
  Hypothesis h;
  h.base_noise.white_sigma_dph = 36;
  h.base_noise.markov = {{20, 100}};
  return h;
}

// Every effect of the library is looked for.
inline const std::vector<bool>& all_active() {
  static const std::vector<bool> active(effect_library().size(), true);
  return active;
}

inline NoiseBelief nothing_believed() {
  return {};
}

// The noise of simulated_log.
inline NoiseBelief true_noise_believed() {
  NoiseBelief belief;
  belief.has_believed = true;
  belief.model.white_sigma_dph = 36, belief.model.markov = {{20, 100}};
  return belief;
}

// No effect is two names of an answer, nor two entries of a set.
inline void assert_names_stand_once(const Selection& said) {
  std::set<const Effect*> names;
  for (const SelectedEffect& e : said.effects) {
    if (e.term.effect && !e.is_family) assert_true(names.insert(e.term.effect).second);
    std::set<const Effect*> members;
    for (const CandidateEvidence& c : e.set)
      if (c.effect) assert_true(members.insert(c.effect).second);
  }
}

// What is said of logs whose rate changes by f(t [s], temperature), with or without a log held out.
inline Selection answer_to(const std::function<double(double, double)>& f, uint64_t seed, size_t held_out,
                           bool is_believed = false) {
  std::vector<Log> logs, unseen;
  for (uint64_t k = 0; k < 4; ++k) {
    Log log = simulated_log(seed + k, 6000, false, 0);
    for (size_t i = 0; i < log.size(); ++i) log.axes[0].rate_dph[i] += f(log.t_s[i], log.temp_degc[i]);
    (k < 4 - held_out ? logs : unseen).push_back(log);
  }
  DiagnoseOptions options;
  options.nulls = 40;
  if (is_believed) options.model_path = "given";
  const Selection said =
      diagnose_logs(options, is_believed ? nominal_model() : ErrorModel(), logs, unseen).axes.at(0).study.selection;
  assert_names_stand_once(said);
  return said;
}

// The members in the sets of an answer.
inline std::set<std::string> members_of(const Selection& selection) {
  std::set<std::string> all;
  for (const SelectedEffect& effect : selection.effects)
    for (const CandidateEvidence& e : effect.set)
      if (e.effect) all.insert(e.effect->name());
  return all;
}

inline std::set<std::string> names_of(const Selection& selection) {
  std::set<std::string> names;
  for (const SelectedEffect& effect : selection.effects)
    names.insert(effect.is_family ? family_name(effect.family) : effect.term.effect->name());
  return names;
}

// Two levels in turn, from a generator of its own.
inline std::function<double(double, double)> jumps_between_levels(uint64_t seed, double height_dph, double dwell_s) {
  return [rng = Rng(seed, 0, 0, Stream::kTool), level = 0.5 * height_dph, dwell_s](double, double) mutable {
    if (rng.uniform() < 1 / dwell_s) level = -level;
    return level;
  };
}

// The first `n` of these seeds, or all of them with LONG in the environment (`make test-long`): for answers of many seconds.
inline std::vector<uint64_t> seeds_of(size_t n, std::vector<uint64_t> all) {
  if (!std::getenv("LONG") && n < all.size()) all.resize(n);
  return all;
}

inline void long_answers_are_left_out(void**) {
  print_message("skip: the long answers are left out (SHORT); all of them: make sanitize-long\n");
  skip();
}

// Runs both groups and returns how many tests failed.  With SHORT in the environment (`make sanitize`) the long tests, which
// take more than four seconds each, are left out and counted as one skipped test.
template <size_t N, size_t M>
int run_answers(const char* name, const CMUnitTest (&tests)[N], const CMUnitTest (&long_tests)[M]) {
  const CMUnitTest left_out[] = {cmocka_unit_test(long_answers_are_left_out)};
  const int failed = cmocka_run_group_tests_name(name, tests, nullptr, nullptr);
  return failed + (std::getenv("SHORT") ? cmocka_run_group_tests_name(name, left_out, nullptr, nullptr)
                                        : cmocka_run_group_tests_name(name, long_tests, nullptr, nullptr));
}
