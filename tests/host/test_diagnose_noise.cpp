// SPDX-License-Identifier: MIT
// What diagnose answers to noise of other kinds and to jumps in time.
#include "analysis/diagnose/search/time_jumps.h"
#include "analysis/diagnose/stages/bursts.h"
#include "analysis/diagnose/stages/seconds_noise.h"
#include "analysis/diagnose/stages/sloped_noise.h"
#include "analysis/diagnose/stages/slow_stage.h"
#include "diagnose_logs.h"

static void test_noise_of_the_seconds_is_fitted_beside_another_kind(void**) {
  const Campaign campaign = make_campaign({simulated_log(24, 9000, false, 0)}, "gx_dph", nominal_model());
  const std::vector<VectorXd> residual = fit_hypothesis(campaign, nominal_hypothesis()).residual;
  NoiseModel start = nominal_hypothesis().base_noise;
  start.white_sigma_dph = 15; // what block means may leave it at
  const auto doubled = [](NoiseModel base) {
    base.white_sigma_dph *= 2, base.markov.push_back({1, 1000});
    return base;
  };
  const SecondsNoise found = fit_seconds_noise(campaign, start, residual, doubled);
  assert_near(found.base.white_sigma_dph, 18, 0.5);
  assert_int_equal(found.base.markov.size(), 1);
}

static void test_noise_believed_too_small_is_no_other_kind_of_noise(void**) {
  std::vector<Log> logs;
  for (uint64_t seed = 51; seed < 54; ++seed) logs.push_back(simulated_log(seed, 5000, false, 0));
  const Campaign campaign = make_campaign(logs, "gx_dph", nominal_model());
  const SlowData data(block_means(campaign, block_length_s(campaign)));
  NoiseBelief belief = nothing_believed();
  belief.has_believed = true;
  belief.model.white_sigma_dph = 36;
  belief.model.markov = {{20.0 / 3, 100.0 / 3}};
  SlowSearch search(data, belief, effect_library(), all_active(), {});
  const SlowResult result = search.run();
  // Noise beside the believed one pays what other parameters pay.
  for (const SlowCandidateScore& noise : result.noises)
    assert_true(noise.score_nats + SelectorConstants().noise_kind_nats < result.null.free_score() + 4);
}

// Whatever evidence block means gave it: the seconds are as likely without a slope.
static void test_noise_without_a_slope_follows_no_temperature(void**) {
  std::vector<Log> logs;
  for (uint64_t seed = 111; seed < 113; ++seed) logs.push_back(simulated_log(seed, 5000, false, 0));
  Campaign campaign = make_campaign(logs, "gx_dph", nominal_model());
  AxisQuestion question{campaign, nullptr, effect_library(), all_active(), nothing_believed(), {}};
  SlowAnswer slow;
  prepare_slow(question, &campaign, nullptr, &slow);
  run_slow(question, &slow);
  SlowModel& best = slow.found.best;
  best = slow.found.null;
  best.noise_effect = &find_effect("markov_sigma_vs_temperature"), best.noise_theta = {0.05};
  slow.found.noise_evidence = 20;
  const std::vector<VectorXd> residual = fit_hypothesis(campaign, nominal_hypothesis()).residual;
  const std::optional<SecondsNoise> noise = fit_sloped_noise(question, residual, &slow);
  assert_true(noise.has_value() && noise->base.is_stationary());
  assert_near(noise->base.white_sigma_dph, 36, 1);
  assert_true(!best.noise_effect && !slow.found.noise_evidence);
}

// Over 7 degC the noise falls to less than a half: per 30 degC that is a slope of -9.
static void test_the_slope_of_noise_over_a_narrow_range_is_not_cut(void**) {
  Log log = simulated_log(883, 6000, false, 0);
  Rng rng(883, 0, 0, Stream::kTool);
  for (size_t i = 0; i < log.size(); ++i) {
    log.temp_degc[i] = 25 + 7 * log.temp_degc[i] / 60;
    log.axes[0].rate_dph[i] = 200 * std::exp(-4.5 * (log.temp_degc[i] - 28.5) / 30) * rng.normal();
  }
  DiagnoseOptions options;
  options.nulls = 40;
  const Selection said = diagnose_logs(options, {}, {log}, {}).axes.at(0).study.selection;
  assert_int_equal(said.effects.size(), 1);
  assert_string_equal(said.effects[0].term.effect->name().c_str(), "white_noise_vs_temperature");
  const double error = said.effects[0].term.shape_errors.at(0);
  assert_true(error > 0 && error < 0.5);
  assert_near(said.effects[0].term.shape.at(0), -9, 4 * error);
}

static void test_jumps_that_come_again_and_again_are_no_events(void**) {
  // One in each of four logs, each time at another place.
  size_t row = 0;
  const auto slips = [&](double t, double) {
    return t > std::array{1500., 2600., 4100., 3300.}[row++ / 6000] ? 120. : 0.;
  };
  const Selection again = answer_to(slips, 81, 0);
  assert_int_equal(again.effects.size(), 1);
  assert_string_equal(again.effects[0].term.effect->name().c_str(), "bias_step");
  assert_true(again.effects[0].is_family && again.effects[0].family == Family::kSlowNoise);
  assert_int_equal(members_of(again).count("telegraph_noise"), 1); // it jumps again and again
  // A single one is: in the first log only.
  size_t rows = 0;
  const Selection one = answer_to([&](double, double) { return ++rows > 2500 && rows <= 6000 ? 90.0 : 0.0; }, 91, 0);
  assert_int_equal(one.effects.size(), 1);
  assert_string_equal(one.effects[0].term.effect->name().c_str(), "bias_step");
  assert_false(one.effects[0].is_family);
}

// Three jumps of any size at any time in every log: two levels are not told from single events by so few.
static void test_a_few_jumps_are_not_said_to_be_telegraph_noise(void**) {
  for (const uint64_t seed : {601u, 602u, 603u, 608u, 611u}) {
    Rng rng(seed, 5, 0, Stream::kTool);
    double at_s[3] = {}, height[3] = {};
    const auto f = [&](double t, double) {
      if (t < 1.5)
        for (int i = 0; i < 3; ++i) at_s[i] = 6000 * rng.uniform(), height[i] = 300 * rng.normal();
      double sum = 0;
      for (int i = 0; i < 3; ++i) sum += t > at_s[i] ? height[i] : 0;
      return sum;
    };
    const Selection said = answer_to(f, 11 * seed, 3, true);
    assert_true(said.effects[0].is_family && said.effects[0].family == Family::kSlowNoise);
    for (const char* kind : {"telegraph_noise", "bias_step"}) assert_int_equal(members_of(said).count(kind), 1);
  }
}

// One slip of either sign in each of seven logs at any time: more than single jumps are looked for, and in each log no more
// than an event.
static void test_one_slip_in_each_of_many_logs_is_not_said_to_be_telegraph_noise(void**) {
  for (const uint64_t seed : seeds_of(1, {1, 2, 3})) {
    Rng rng(seed, 5, 0, Stream::kTool);
    std::vector<Log> logs;
    for (uint64_t k = 0; k < 7; ++k) {
      logs.push_back(simulated_log(11 * seed + k, 6000, false, 0));
      const double at_s = 600 + 4800 * rng.uniform(), height = rng.uniform() < 0.5 ? 110 : -110;
      for (size_t i = 0; i < 6000; ++i) logs.back().axes[0].rate_dph[i] += logs.back().t_s[i] > at_s ? height : 0;
    }
    DiagnoseOptions options;
    options.nulls = 40, options.model_path = "given";
    const Selection said = diagnose_logs(options, nominal_model(), logs, {}).axes.at(0).study.selection;
    assert_int_equal(said.effects.size(), 1);
    assert_string_equal(said.effects[0].term.effect->name().c_str(), "telegraph_noise");
    assert_true(said.effects[0].is_family);
    assert_true(members_of(said) == (std::set<std::string>{"bias_step", "telegraph_noise"}));
  }
}

// Jumps anywhere in a block, in each of four logs: said with the second before which they came, in seconds from the first row.
static void test_a_jump_in_time_is_placed_to_its_second(void**) {
  for (const uint64_t row : seeds_of(3, {2380, 7095, 15937, 10666, 14254, 1100})) {
    size_t at = 0;
    const auto jump = [&](double, double) {
      const size_t k = at++;
      return k / 6000 == row / 6000 && k >= row ? 300.0 : 0.0;
    };
    const Selection said = answer_to(jump, 7 * row, 0);
    assert_true(names_of(said) == std::set<std::string>{"bias_step"}); // and no hits in between
    const Theta& shape = said.effects[0].term.shape;
    assert_int_equal(shape.size(), 2); // two parts of one jump are one
    assert_near(shape[0], static_cast<double>(row / 6000), 0);
    assert_near(shape[1], static_cast<double>(row % 6000) - 0.5, 1e-9);
  }
}

static void test_a_small_jump_beside_two_large_ones_makes_no_noise_of_them(void**) {
  size_t row = 0;
  const auto jumps = [&](double, double) {
    const size_t k = row++;
    return (k > 2500 && k < 6000 ? 150.0 : 0.0) + (k > 9500 && k < 12000 ? 150.0 : 0.0) +
           (k > 15000 && k < 18000 ? -28.0 : 0.0);
  };
  const Selection said = answer_to(jumps, 181, 0);
  assert_int_equal(said.effects.size(), 1);
  assert_string_equal(said.effects[0].term.effect->name().c_str(), "bias_step");
  assert_int_equal(said.effects[0].term.shape.size(), 6); // all three were found
  assert_false(said.effects[0].is_family);
}

static void test_slips_that_outweigh_the_answer_leave_no_name(void**) {
  // Jumps at places drawn anew in every log, and back: now and then near the same temperature.
  Rng rng(161, 0, 0, Stream::kTool);
  size_t row = 0;
  double level = 0;
  const auto slips = [&](double, double) {
    if (row++ % 6000 == 0) level = 0;
    if (rng.uniform() < 1.0 / 1200) level = 150 * rng.normal();
    return level;
  };
  const Selection said = answer_to(slips, 161, 0);
  for (const SelectedEffect& effect : said.effects)
    assert_true(effect.is_family || effect.family == Family::kSlowNoise);
  assert_true(said.verdict != Verdict::kNoGap);
}

static void test_kinds_of_noise_stand_beside_other_parameters(void**) {
  // A random walk, the noise believed as it is without: other parameters do as well, and are not all that does.  Beside a cause too.
  for (const double height_dph : {0.0, 300.0}) {
    std::vector<Log> logs;
    for (uint64_t seed = 171; seed < 173; ++seed) {
      Log log = simulated_log(seed, 6000, false, 0);
      Rng rng(seed, 0, 0, Stream::kTool);
      double walk = 0;
      for (size_t i = 0; i < log.size(); ++i)
        log.axes[0].rate_dph[i] +=
            (walk += 0.8 * rng.normal()) + height_dph * std::exp(-0.5 * std::pow((log.temp_degc[i] - 30) / 4, 2));
      logs.push_back(log);
    }
    DiagnoseOptions options;
    options.nulls = 40;
    options.model_path = "given";
    const Selection said = diagnose_logs(options, nominal_model(), logs, {}).axes.at(0).study.selection;
    const std::set<std::string> all = members_of(said);
    assert_int_equal(all.count("thermal_anomaly"), height_dph > 0 ? 1 : 0);
    assert_true(all.count("rate_random_walk") == 1);
    assert_int_equal(all.count("second_markov"), all.count("telegraph_noise")); // they have one spectrum
  }
}

static void test_kinds_of_noise_are_found_that_the_fitted_noise_has_swallowed(void**) {
  // A fast process, a slow one of thirty times its time constant, and nothing believed: one process alone takes a middle.
  std::vector<Log> logs;
  for (uint64_t seed = 201; seed < 207; ++seed) {
    Log log = simulated_log(seed, 6000, false, 0);
    Rng rng(seed, 0, 0, Stream::kTool);
    const double phi = std::exp(-1 / 3000.0);
    double slow = 60 * rng.normal();
    for (double& rate : log.axes[0].rate_dph)
      slow = phi * slow + 60 * std::sqrt(1 - phi * phi) * rng.normal(), rate += slow;
    logs.push_back(log);
  }
  const Campaign campaign = make_campaign(logs, "gx_dph", nominal_model());
  const SlowData data(block_means(campaign, block_length_s(campaign)));
  SlowSearch search(data, nothing_believed(), effect_library(), all_active(), {});
  const SlowResult result = search.run();
  double second = 0, walk = 0;
  for (const SlowCandidateScore& s : result.noises) {
    const double gain = s.score_nats - result.null.free_score();
    if (s.model.noise_effect == &find_effect("second_markov")) second = gain;
    if (s.model.noise_effect == &find_effect("rate_random_walk")) walk = gain;
  }
  // Within logs that are short against its time constant the slow process is a random walk.
  assert_true(second > SelectorConstants().noise_nats);
  assert_near(second, walk, 4);
}

// A second process of 600 s beside an effect of the direction of the temperature: noise that is fitted without it has
// swallowed it, also beside the causes that are found.
static void test_a_kind_of_noise_is_found_beside_causes_whose_noise_has_swallowed_it(void**) {
  std::vector<Log> logs;
  for (uint64_t k = 0; k < 6; ++k) {
    Log log = simulated_log(100 + k, 6000, false, 0);
    Rng rng(1, k, 0, Stream::kTool);
    const double phi = std::exp(-1 / 600.0);
    double slow = 40 * rng.normal();
    for (size_t i = 0; i < log.size(); ++i) {
      slow = phi * slow + 40 * std::sqrt(1 - phi * phi) * rng.normal();
      log.axes[0].rate_dph[i] += slow + 80 * (log.t_s[i] < 3000 ? 1 : -1);
    }
    logs.push_back(log);
  }
  const Campaign campaign = make_campaign(logs, "gx_dph", nominal_model());
  const SlowData data(block_means(campaign, block_length_s(campaign)));
  SlowSearch search(data, nothing_believed(), effect_library(), all_active(), {});
  const SlowModel best = search.run().best;
  assert_true(best.noise_effect == &find_effect("second_markov"));
  assert_true(search.candidates()[best.names.at(0).candidate].effect == &find_effect("temperature_rate"));
}

static void test_telegraph_noise_is_found_that_the_fitted_noise_has_swallowed(void**) {
  // Seldom jumps, each of two standard deviations of the white noise: samples have no heavy tails.
  Rng rng(211, 0, 0, Stream::kTool);
  double level = 34;
  const Selection said = answer_to(
      [&](double, double) {
        if (rng.uniform() < 0.5 / 760) level = -level;
        return level;
      },
      211, 0);
  assert_int_equal(said.effects.size(), 1);
  assert_string_equal(said.effects[0].term.effect->name().c_str(), "telegraph_noise");
  assert_near(said.effects[0].term.shape[0], 34, 4);
}

static void test_telegraph_noise_has_no_stand_ins_beside_it(void**) {
  // The noise of the model is exact.  Block means take the jumps for other noise, jumps in time and jumps at temperatures.
  for (const uint64_t seed : seeds_of(2, {301, 302, 303, 304})) {
    const Selection said = answer_to(jumps_between_levels(seed, 90, 300), seed, 0, true);
    assert_true(names_of(said) == std::set<std::string>{"telegraph_noise"});
    assert_false(said.is_noise_retuned);
    assert_near(said.effects[0].term.shape[0], 45, 4);
  }
}

static void test_a_cause_is_found_beside_telegraph_noise(void**) {
  const auto jumps = jumps_between_levels(311, 90, 300);
  const auto both = [&](double t, double temp) {
    return jumps(t, temp) + 70 * std::exp(-0.5 * std::pow((temp - 22) / 4, 2));
  };
  for (const size_t held_out : {0, 1}) {
    const Selection said = answer_to(both, 311, held_out, true);
    const std::set<std::string> names = names_of(said);
    assert_int_equal(names.size(), 2);
    assert_int_equal(names.count("thermal_anomaly"), 1);
    assert_int_equal(members_of(said).count("telegraph_noise"), 1);
    assert_false(said.is_noise_retuned);
  }
}

// Jumps up, each with an exponential way back: shots.
static std::function<double(double, double)> shots(uint64_t seed, double height_dph, double interval_s) {
  return [rng = Rng(seed, 0, 0, Stream::kTool), height_dph, interval_s, left = 0.0](double, double) mutable {
    left *= std::exp(-1 / interval_s);
    if (rng.uniform() < 1 / interval_s) left += height_dph;
    return left;
  };
}

static void test_shots_are_no_hits(void**) {
  for (const double sign : {1.0, -1.0})
    for (const uint64_t seed : seeds_of(1, {331, 332, 333})) {
      const std::set<std::string> names = names_of(answer_to(shots(seed, sign * 150, 300), seed, 0, true));
      assert_int_equal(names.count("outliers") + names.count("fast_noise") + names.count("telegraph_noise"), 0);
    }
  // Hits are gone with their sample.
  Rng rng(341, 0, 0, Stream::kTool);
  const Selection hits =
      answer_to([&](double, double) { return rng.uniform() < 0.01 ? 200 * rng.normal() : 0.0; }, 341, 0, true);

  assert_int_equal(names_of(hits).count("outliers"), 1);
}

// Hits of any rate and size, one by one: the test fires at its rate, 1 in 1000.  In groups it fires, and no member is named.
static void test_hits_in_bursts_are_no_outliers(void**) {
  const Campaign campaign = make_campaign({simulated_log(351, 5000, false, 0)}, "gx_dph", nominal_model());
  NoiseModel noise;
  noise.white_sigma_dph = 36;
  const auto fires = [&](const std::function<bool(long, Rng*)>& is_hit, uint64_t seed) {
    Rng rng(seed, 6, 0, Stream::kTool);
    VectorXd x(static_cast<long>(campaign.runs[0].n()));
    for (long k = 0; k < x.size(); ++k) {
      const double white = 36 * rng.normal();
      x[k] = white + (is_hit(k, &rng) ? noise.hit_sigma_dph * rng.normal() : 0);
    }
    return hits_in_bursts(campaign, {x}, noise, {}).evidence_nats > 0;
  };
  int n_alone = 0, n_grouped = 0;
  for (uint64_t seed = 0; seed < 400; ++seed) {
    Rng rng(seed, 7, 0, Stream::kTool);
    noise.hit_probability = 5e-4 * std::pow(600, rng.uniform()), noise.hit_sigma_dph = 36 * (2 + 18 * rng.uniform());
    const double p = noise.hit_probability;
    n_alone += fires([p](long, Rng* r) { return r->uniform() < p; }, seed) ? 1 : 0;
  }
  noise.hit_probability = 0.003, noise.hit_sigma_dph = 200;
  for (uint64_t seed = 0; seed < 20; ++seed) // three in ten samples of half a minute, twice in an hour
    n_grouped +=
        fires([](long k, Rng* r) { return k % 1800 > 900 && k % 1800 < 930 && r->uniform() < 0.3; }, seed) ? 1 : 0;
  assert_in_range(n_alone, 0, 4); // more in 1 of 10,000
  assert_int_equal(n_grouped, 20);

  long row = 0;
  Rng rng(361, 0, 0, Stream::kTool);
  const Selection said = answer_to(
      [&](double, double) {
        const long k = row++ % 1800; // twice in an hour
        return k > 600 && k < 630 && rng.uniform() < 0.15 ? 300 * rng.normal() : 0.0;
      },
      361, 0, true);
  assert_true(names_of(said) == std::set<std::string>{"fast_noise"});
  assert_int_equal(members_of(said).count("outliers"), 1);
  assert_true(said.verdict == Verdict::kPartlyExplained);
}

static void test_the_seconds_are_asked_for_slow_noise_where_their_spectrum_does_not_fit(void**) {
  // Processes of 60 and of 6000 s; one process was fitted to both.
  Log log = simulated_log(221, 40000, false, 0);
  Rng rng(221, 0, 0, Stream::kTool);
  double fast = 0, slow = 0;
  for (double& rate : log.axes[0].rate_dph) {
    fast = fast * std::exp(-1 / 60.0) + 200 * std::sqrt(2 / 60.0) * rng.normal();
    slow = slow * std::exp(-1 / 6000.0) + 600 * std::sqrt(2 / 6000.0) * rng.normal();
    rate += fast + slow;
  }
  const Campaign campaign = make_campaign({log}, "gx_dph", nominal_model());
  const std::vector<VectorXd> residual = fit_hypothesis(campaign, nominal_hypothesis()).residual;
  const SecondsNoise from = fit_seconds_noise(campaign, nominal_hypothesis().base_noise, residual);
  const auto has_second = [&](bool may_ask_slow) {
    for (const FastFinding& f :
         scan_fast_noise(campaign, from, residual, effect_library(), all_active(), {}, may_ask_slow).findings)
      if (f.effect == &find_effect("second_markov") && f.gain_nats > SelectorConstants().fast_nats) return true;
    return false;
  };
  assert_true(has_second(true));
  assert_false(has_second(false)); // it belongs to the slow stage
}

// A process of 4 s beside one of 100 s, and the one process that was fitted to these logs believed: its parameters are the
// best there are, their spectrum is not that of the seconds.
static void test_a_fast_process_is_found_where_the_fitted_noise_is_believed(void**) {
  std::vector<Log> logs;
  for (uint64_t seed = 231; seed < 235; ++seed) {
    Log log = simulated_log(seed, 6000, false, 0);
    Rng rng(seed, 0, 0, Stream::kTool);
    double fast = 0;
    for (double& rate : log.axes[0].rate_dph) {
      fast = fast * std::exp(-1 / 4.0) + 25 * std::sqrt(1 - std::exp(-2 / 4.0)) * rng.normal();
      rate += fast;
    }
    logs.push_back(log);
  }
  const Campaign campaign = make_campaign(logs, "gx_dph", nominal_model());
  const std::vector<VectorXd> residual = fit_hypothesis(campaign, nominal_hypothesis()).residual;
  const NoiseModel fitted = fit_seconds_noise(campaign, nominal_hypothesis().base_noise, residual).base;
  ErrorModel believed = nominal_model();
  believed.arw_deg_rt_h = fitted.white_sigma_dph / 60, believed.markov = fitted.markov;
  DiagnoseOptions options;
  options.nulls = 40;
  options.model_path = "given";
  const Selection said = diagnose_logs(options, believed, logs, {}).axes.at(0).study.selection;
  assert_int_equal(members_of(said).count("second_markov"), 1);
  for (const RestFinding& f : said.after) assert_true(f.evidence_nats < 0);
}

// White noise, a process of 6 s and nothing else, started from a slow process beside too much white noise: what leads out of
// there is not what helps beside.
static void test_what_better_plain_noise_gains_is_no_kind_of_fast_noise(void**) {
  for (const uint64_t seed : {1u, 2u, 3u})
    for (const Markov& slow : {Markov{11, 90}, Markov{13, 30}, Markov{5, 300}})
      for (const double slope : {0.0, 0.3}) { // of the logarithm of the white noise over 30 degC
        Log log = simulated_log(seed, 9000, false, 0);
        Rng rng(seed, 3, 0, Stream::kTool);
        double fast = 0;
        for (size_t i = 0; i < log.size(); ++i) {
          fast = std::exp(-1 / 6.0) * fast + 15 * std::sqrt(1 - std::exp(-2 / 6.0)) * rng.normal();
          log.axes[0].rate_dph[i] = 36 * std::exp(slope * (log.temp_degc[i] - 30) / 30) * rng.normal() + fast;
        }
        const Campaign campaign = make_campaign({log}, "gx_dph", nominal_model());
        const std::vector<VectorXd> residual = fit_hypothesis(campaign, nominal_hypothesis()).residual;
        SecondsNoise from;
        from.base.white_sigma_dph = 39, from.base.markov = {slow};
        from.log_likelihood = ResidualLikelihood(campaign, residual)(from.base);
        const FastScan scan = scan_fast_noise(campaign, from, residual, effect_library(), all_active(), {});
        assert_true(scan.plain.log_likelihood > from.log_likelihood + 2 * SelectorConstants().fast_nats);
        assert_near(scan.plain.base.markov.at(0).tau_s, 6, 2);
        double over_temperature = 0;
        for (const FastFinding& f : scan.findings) {
          const bool is_slope = f.effect == &find_effect("white_noise_vs_temperature");
          if (is_slope) over_temperature = f.gain_nats;
          if (!is_slope || slope == 0) assert_true(f.gain_nats < SelectorConstants().fast_nats);
        }
        if (slope > 0) assert_true(over_temperature > SelectorConstants().fast_nats);
      }
}

// White noise and one process, both as functions of Tn, beside the bias of the simulated logs.
static Log log_of_noise(uint64_t seed, const std::function<double(double)>& white_dph, double sigma_dph,
                        const std::function<double(double)>& tau_s) {
  Log log = simulated_log(seed, 6000, false, 0);
  Rng rng(seed, 3, 0, Stream::kTool);
  double slow = sigma_dph * rng.normal();
  for (size_t i = 0; i < log.size(); ++i) {
    const double tn = (log.temp_degc[i] - 30) / 30, phi = std::exp(-1 / tau_s(tn));
    slow = phi * slow + sigma_dph * std::sqrt(1 - phi * phi) * rng.normal();
    log.axes[0].rate_dph[i] = bias_dph(log.temp_degc[i]) + white_dph(tn) * rng.normal() + slow;
  }
  return log;
}

// White noise follows the temperature; block means make a process of 5 s do so instead.  In the seconds that process must not
// shrink to a fraction of a second: it would be the white noise itself, under the name of slow noise.
static void test_white_noise_that_follows_the_temperature_is_no_slow_process(void**) {
  const auto white_dph = [](double tn) { return 54 * std::exp(0.35 * tn); };
  std::vector<Log> logs;
  for (uint64_t seed = 261; seed < 264; ++seed)
    logs.push_back(log_of_noise(seed, white_dph, 12, [](double) { return 45.0; }));
  const Campaign campaign = make_campaign(logs, "gx_dph", nominal_model());
  const std::vector<VectorXd> residual = fit_hypothesis(campaign, nominal_hypothesis()).residual;
  NoiseModel follows;
  follows.white_sigma_dph = 42, follows.markov = {{25, 5}}, follows.markov_slope = 0.6;
  const SecondsNoise from = fit_seconds_noise(campaign, follows, residual);
  assert_true(from.base.markov.at(0).tau_s > 2.9);
  const FastScan scan = scan_fast_noise(campaign, from, residual, effect_library(), all_active(), {});
  assert_false(scan.findings.empty());
  assert_ptr_equal(scan.findings.front().effect, &find_effect("white_noise_vs_temperature"));
  assert_true(scan.findings.front().gain_nats > 100);
  assert_near(scan.findings.front().base.markov.at(0).tau_s, 45, 25);
}

// The time constant of the process follows the temperature, 30 s at 30 degC.  Means over 10 s blur it: they make its slope too small,
// and what that leaves passed for white noise that follows the temperature.
static void test_the_slope_of_slow_noise_is_that_of_the_seconds(void**) {
  const double slope = 1.6; // per 30 degC
  const auto tau_s = [&](double tn) { return 30 * std::exp(slope * tn); };
  std::vector<Log> logs;
  for (uint64_t seed = 271; seed < 275; ++seed)
    logs.push_back(log_of_noise(
        seed, [](double) { return 12.0; }, 25, tau_s));
  DiagnoseOptions options;
  options.nulls = 40;
  const Selection said = diagnose_logs(options, ErrorModel(), logs, {}).axes.at(0).study.selection;
  assert_true(names_of(said) == std::set<std::string>{"markov_tau_vs_temperature"});
  assert_true(said.verdict == Verdict::kExplained);
  const Term& term = said.effects[0].term;
  assert_near(term.shape.at(0), slope, 4 * term.shape_errors.at(0));
  assert_true(term.shape_errors[0] > 0.02 && term.shape_errors[0] < 0.15);
}

// Log-variance = level + slope Tn with both free: the error of the slope is sqrt(2/n) over the spread of Tn, far from Tn = 0 too.
static void test_the_error_of_a_slope_of_noise_has_the_level_free(void**) {
  Log log = simulated_log(77, 9000, false, 0);
  for (double& temp : log.temp_degc) temp = 5 + temp * 13 / 60;
  const Campaign campaign = make_campaign({log}, "gx_dph", ErrorModel());
  const std::vector<double>& tn = campaign.runs[0].input.tn;
  Rng rng(77, 4, 0, Stream::kTool);
  VectorXd residual(static_cast<long>(tn.size()));
  for (long k = 0; k < residual.size(); ++k)
    residual[k] = 300 * std::exp(-0.5 * 1.2 * tn[static_cast<size_t>(k)]) * rng.normal();
  const std::vector<VectorXd> residuals = {residual};
  FastFinding found;
  found.effect = &find_effect("white_noise_vs_temperature");
  found.base.white_sigma_dph = 300, found.theta = {-1.2};
  const ResidualLikelihood log_likelihood(campaign, residuals);
  fit_again(log_likelihood, true, &found);
  set_errors(log_likelihood, &found);
  const VectorXd x = Eigen::Map<const VectorXd>(tn.data(), residual.size());
  const double spread = std::sqrt((x.array() - x.mean()).square().mean());
  const double expected = std::sqrt(2.0 / static_cast<double>(x.size())) / spread;
  assert_near(found.theta_errors.at(0), expected, 0.15 * expected);
  assert_near(found.theta[0], -1.2, 4 * expected);
}

// A drift that jumps back once in two hours or so: both parts are found, and neither is a cause of its own.  A drift beside
// jumps that do not take it back is one.
static void test_a_drift_that_jumps_back_is_no_ramp(void**) {
  for (const uint64_t seed : {51, 61}) {
    const auto saw = [rng = Rng(seed, 0, 0, Stream::kTool), level = 0.0, next = 0.0](double t_s, double) mutable {
      if (t_s < 2) next = 150 + 30 * rng.uniform(), level = next * (0.3 + 0.5 * rng.uniform());
      level += 200 / 7200.0;
      if (level > next) level = 0;
      return level;
    };
    const Selection said = answer_to(saw, seed, 0);
    assert_true(names_of(said) == std::set<std::string>{"slow_noise"});
    assert_true(said.verdict == Verdict::kPartlyExplained);
  }
  const auto drift_and_jumps = [log = 0](double t_s, double) mutable {
    if (t_s < 2) ++log;
    const double up = log == 1 || log == 4 ? 1 : -1; // as often with the drift as against it
    return 200 * t_s / 7200 + (t_s > 1500 + 800 * log ? up * 150 : 0);
  };
  assert_true(names_of(answer_to(drift_and_jumps, 51, 0)).count("rate_ramp") == 1);
}

// Up and down in turn, in each of two logs: of one height a noise of two levels, of others not; nor where two in a row go up.
static void test_jumps_between_two_levels_have_a_pattern(void**) {
  const auto pattern = [](std::array<double, 4> sizes_dph) {
    std::vector<Log> logs = {simulated_log(71, 6000, false, 0), simulated_log(72, 6000, false, 0)};
    SlowModel m;
    for (size_t i = 0; i < sizes_dph.size(); ++i) {
      const double at_s = i % 2 == 0 ? 1999.5 : 3999.5; // of the first row
      m.steps.push_back({static_cast<double>(i / 2), at_s});
      for (size_t k = i % 2 == 0 ? 2000 : 4000; k < 6000; ++k) logs[i / 2].axes[0].rate_dph[k] += sizes_dph[i];
    }
    const Campaign campaign = make_campaign(logs, "gx_dph", nominal_model());
    const SlowData data(block_means(campaign, block_length_s(campaign)));
    const SlowSpace space = make_slow_space(data, nothing_believed(), effect_library(), all_active(), {}, nullptr);
    return pattern_of(SlowLikelihood(space), m);
  };
  assert_true(pattern({300, -450, 300, -450}).are_two_levels);
  assert_false(pattern({300, -900, 300, -900}).are_two_levels);
  assert_false(pattern({300, 450, 300, -450}).are_two_levels || pattern({300, 450, 300, -450}).go_one_way);
  assert_true(pattern({300, 900, 300, 900}).go_one_way); // teeth
  assert_int_equal(pattern({300, 900, 300, 900}).n_followed, 2);
}

// Jumps at temperatures that every log passes on its way up, another height at each: relays, told as what follows the temperature.
// Where a log has them at temperatures of its own they come again and again, and where they are in one log alone they are events.
static void test_jumps_that_repeat_at_temperatures_follow_the_temperature(void**) {
  constexpr std::array<double, 3> kUnlike_dph = {220, -150, 300}, kAlike_dph = {200, 200, 200};
  const auto jumps_at = [](std::function<double(size_t log, size_t i)> place_s, std::array<double, 3> heights_dph) {
    return [=, log = size_t{0}](double t_s, double) mutable {
      log += t_s < 1.5 ? 1 : 0;
      double sum = 0;
      for (size_t i = 0; i < heights_dph.size(); ++i) sum += t_s > place_s(log, i) ? heights_dph[i] : 0;
      return sum;
    };
  };
  const auto same = [](size_t, size_t i) { return 700.0 + 800.0 * static_cast<double>(i); };
  const auto other = [](size_t log, size_t i) {
    return 300.0 + 800.0 * static_cast<double>(i) + 170.0 * static_cast<double>(log);
  };
  const auto one_log = [=](size_t log, size_t i) { return log == 2 ? same(log, i) : 1e9; };
  const auto close_by = [](size_t log, size_t i) { return log == 2 ? 700.0 + 20 * static_cast<double>(i) : 1e9; };
  const auto said_of = [&](const std::function<double(size_t, size_t)>& place_s,
                           const std::array<double, 3>& heights_dph) {
    std::vector<Log> logs;
    auto level = jumps_at(place_s, heights_dph);
    for (uint64_t k = 0; k < 3; ++k) {
      Log log = simulated_log(751 + k, 6000, false, 0);
      for (size_t i = 0; i < log.size(); ++i) log.axes[0].rate_dph[i] += level(log.t_s[i], 0);
      logs.push_back(log);
    }
    const Campaign campaign = make_campaign(logs, "gx_dph", nominal_model());
    const SlowData data(block_means(campaign, block_length_s(campaign)));
    const SlowSpace space = make_slow_space(data, true_noise_believed(), effect_library(), all_active(), {}, nullptr);
    SlowModel m;
    for (size_t log = 1; log <= 3; ++log)
      for (size_t i = 0; i < 3; ++i)
        if (place_s(log, i) < 6000) m.steps.push_back({static_cast<double>(log - 1), place_s(log, i) + 0.5});
    return repeated_jumps(SlowLikelihood(space), m);
  };
  assert_true(said_of(same, kUnlike_dph).follow_temperature &&
              !said_of(same, kUnlike_dph).are_loops); // never passed on the way down
  assert_false(said_of(other, kUnlike_dph).follow_temperature);
  assert_false(said_of(one_log, kUnlike_dph).follow_temperature);
  assert_false(said_of(close_by, kAlike_dph).follow_temperature); // one passage
}
static void test_jumps_of_one_log_are_events_however_many(void**) {
  const auto jumps = [log = 0](double t_s, double) mutable {
    log += t_s < 1.5 ? 1 : 0;
    return log == 2 ? (t_s > 1400 ? 150.0 : 0) + (t_s > 2300 ? 120.0 : 0) - (t_s > 5100 ? 190.0 : 0) : 0.0;
  };
  const Selection said = answer_to(jumps, 97, 0);
  assert_int_equal(said.effects.size(), 1);
  assert_string_equal(said.effects[0].term.effect->name().c_str(), "bias_step");
  assert_int_equal(said.effects[0].term.coefficients.size(), 3);
  assert_false(said.effects[0].is_family);
  assert_true(said.verdict == Verdict::kExplained);
}

// Of what a dead band about the mean leaves the spread is not that of the noise: nothing is said of it.
static void test_a_dead_band_about_the_mean_is_no_other_noise(void**) {
  std::vector<Log> logs;
  for (uint64_t k = 0; k < 3; ++k) {
    Log log = simulated_log(761 + k, 6000, false, 0);
    for (size_t i = 0; i < log.size(); ++i) {
      double& rate_dph = log.axes[0].rate_dph[i];
      log.temp_degc[i] = 30 + (log.temp_degc[i] - 30) / 15;
      rate_dph -= bias_dph(30 + (log.temp_degc[i] - 30) * 15);
      if (std::fabs(rate_dph) < 35) rate_dph = 0;
    }
    logs.push_back(log);
  }
  DiagnoseOptions options;
  options.nulls = 40, options.model_path = "given";
  const Selection said = diagnose_logs(options, nominal_model(), logs, {}).axes.at(0).study.selection;
  assert_int_equal(said.effects.size(), 1);
  assert_string_equal(said.effects[0].term.effect->name().c_str(), "dead_band");
  assert_true(said.verdict == Verdict::kExplained);
  for (const RestFinding& f : said.after) assert_true(std::isnan(f.evidence_nats)); // not asked
}

// Three slips of any size at any time in every log: what seems to follow temperature, or wanders, beside them is a part of them.
static void test_many_slips_are_nothing_but_slow_noise(void**) {
  for (const uint64_t seed : {33u, 42u}) {
    const auto slips = [rng = Rng(seed, 6, 0, Stream::kTool), at_s = std::array<double, 3>(),
                        size_dph = std::array<double, 3>()](double t_s, double) mutable {
      if (t_s < 2)
        for (size_t i = 0; i < at_s.size(); ++i) at_s[i] = 5500 * rng.uniform(), size_dph[i] = 90 * rng.normal();
      double level = 0;
      for (size_t i = 0; i < at_s.size(); ++i) level += t_s > at_s[i] ? size_dph[i] : 0;
      return level;
    };
    const Selection said = answer_to(slips, seed, 0);
    assert_true(names_of(said) == std::set<std::string>{"slow_noise"});
    assert_int_equal(said.effects.size(), 1);
    for (const CandidateEvidence& other : said.effects[0].set)
      assert_false(other.is_family); // no curve would do as well
  }
}

static void test_saw_teeth_are_no_telegraph_noise(void**) {
  // Jumps all one way.  Noise that jumps up and down is what fits best among the members.
  Rng rng(212, 0, 0, Stream::kTool);
  double tooth = 0, period_s = 400;
  const Selection said = answer_to(
      [&](double, double) {
        tooth += 1 / period_s;
        if (tooth >= 1) tooth = 0, period_s = 300 + 300 * rng.uniform();
        return 44 * tooth;
      },
      212, 0);
  for (const SelectedEffect& effect : said.effects) assert_true(effect.is_family);
  assert_true(said.verdict != Verdict::kNoGap);
}

// Hits, and white noise that grows with the temperature: each passes for a part of the other.
static void test_two_kinds_of_fast_noise_are_told(void**) {
  Rng rng(751, 0, 0, Stream::kTool);
  const auto both = [&](double, double temp_degc) {
    const double more = 36 * std::sqrt(std::exp(0.8 * (temp_degc - 30) / 30) - std::exp(-0.8));
    return more * rng.normal() + (rng.uniform() < 0.003 ? 300 * rng.normal() : 0.0);
  };
  const Selection said = answer_to(both, 751, 0);
  assert_true(names_of(said) == (std::set<std::string>{"outliers", "white_noise_vs_temperature"}));
  for (const SelectedEffect& effect : said.effects) {
    const Parameters values = effect.term.estimator->values(effect.term.estimate());
    if (effect.term.effect->name() == "outliers") assert_near(values.number("probability"), 0.003, 0.001);
    assert_true(effect.evidence_nats > 50);
    assert_true(std::isfinite(effect.term.shape_errors.at(0)));
  }
  // One alone is one.
  const auto hits = [&](double, double) { return rng.uniform() < 0.003 ? 300 * rng.normal() : 0.0; };
  assert_true(names_of(answer_to(hits, 752, 0)) == std::set<std::string>{"outliers"});
}

// Where the logs are warm the white noise is up to 4.5 times that of 30 degC: so much less exactly a tone is placed.
static void test_the_error_of_a_tone_is_that_of_noise_that_follows_the_temperature(void**) {
  constexpr double kHz = 0.11, kAmplitude_dph = 40, kSlope = 3;
  const auto white_dph = [](double temp_degc) { return 36 * std::exp(0.5 * kSlope * (temp_degc - 30) / 30); };
  std::vector<Log> logs;
  double information = 0; // of the frequency, phase and amplitude of each run free
  for (uint64_t seed = 771; seed < 774; ++seed) {
    Log log = simulated_log(seed, 6000, false, 0);
    Rng rng(seed, 1, 0, Stream::kTool);
    double sum = 0, first = 0, second = 0;
    for (size_t i = 0; i < log.size(); ++i) {
      const double t = log.t_s[i];
      log.temp_degc[i] = 40 + log.temp_degc[i] / 3;
      const double sigma = white_dph(log.temp_degc[i]), weight = 1 / (sigma * sigma);
      log.axes[0].rate_dph[i] +=
          kAmplitude_dph * std::sin(2 * kPi * kHz * t) + std::sqrt(sigma * sigma - 36 * 36) * rng.normal();
      sum += weight, first += weight * t, second += weight * t * t;
    }
    information += 0.5 * std::pow(2 * kPi * kAmplitude_dph, 2) * (second - first * first / sum);
    logs.push_back(log);
  }
  DiagnoseOptions options;
  options.nulls = 40;
  const Selection said = diagnose_logs(options, ErrorModel(), logs, {}).axes.at(0).study.selection;
  assert_true(names_of(said) == (std::set<std::string>{"sinusoid", "white_noise_vs_temperature"}));
  for (const SelectedEffect& effect : said.effects) {
    if (effect.term.effect->name() != "sinusoid") continue;
    const double error = effect.term.shape_errors.at(0);
    assert_near(error * std::sqrt(information), 1, 0.2);
    assert_near(effect.term.shape[0], kHz, 4 * error);
  }
}

// A few samples of any size are hits.  The search for a second kind of noise found a better place for the first, and called that a
// gain of its own: white noise that follows the temperature by a slope of nothing.
static void test_a_few_wrong_samples_are_hits_and_nothing_else(void**) {
  constexpr double kSize_dph = 1e4;
  const auto hits = [](double t_s, double) {
    const long second = std::lround(t_s);
    return second % 1400 == 700 ? (second % 2800 == 700 ? kSize_dph : -kSize_dph) : 0;
  };
  for (const uint64_t seed : {860, 865, 870})
    assert_true(names_of(answer_to(hits, seed, 1, true)) == std::set<std::string>{"outliers"});
}

// Four logs with two hits each, of this size or the other way.
static std::vector<Log> logs_with_hits(double size_dph) {
  std::vector<Log> logs;
  for (uint64_t seed = 771; seed < 775; ++seed) {
    logs.push_back(simulated_log(seed, 6000, false, 0));
    Rng rng(seed, 4, 0, Stream::kTool);
    for (int i = 0; i < 2; ++i)
      logs.back().axes[0].rate_dph[static_cast<size_t>(6000 * rng.uniform())] +=
          rng.uniform() < 0.5 ? size_dph : -size_dph;
  }
  return logs;
}

// One of a million dph among 6000 seconds would move their mean by 170 dph.
static void test_a_hit_that_stands_out_does_not_move_the_mean(void**) {
  const auto fit_of = [](double size_dph) {
    const Campaign campaign = make_campaign(logs_with_hits(size_dph), "gx_dph", nominal_model());
    return std::make_pair(rates(campaign), fit_hypothesis(campaign, nominal_hypothesis()));
  };
  const auto [with_hits, with] = fit_of(1e6);
  const auto [plain_rates, without] = fit_of(0);
  for (size_t r = 0; r < plain_rates.size(); ++r) {
    const VectorXd moved = (with_hits[r] - with.residual[r]) - (plain_rates[r] - without.residual[r]);
    assert_true(moved.array().abs().maxCoeff() < 1);
    assert_true(with.e[r].array().abs().maxCoeff() > 1e4); // it is left whole
  }
  // Nor, once hits are known, does it widen the errors.
  Hypothesis known = nominal_hypothesis();
  known.base_noise.hit_probability = 8 / 24e3, known.base_noise.hit_sigma_dph = 1e6;
  const Campaign campaign = make_campaign(logs_with_hits(1e6), "gx_dph", nominal_model());
  const MatrixXd covariance = fit_hypothesis(campaign, known).beta_covariance;
  for (long i = 0; i < covariance.rows(); ++i)
    assert_near(std::sqrt(covariance(i, i) / without.beta_covariance(i, i)), 1, 0.02);
}

// The noise that was fitted to them has swallowed such hits: white noise of 1e4 dph.
static void test_hits_are_found_that_the_fitted_noise_has_swallowed(void**) {
  for (const double size_dph : {1e4, 1e6}) {
    const Campaign campaign = make_campaign(logs_with_hits(size_dph), "gx_dph", nominal_model());
    const std::vector<VectorXd> residual = fit_hypothesis(campaign, nominal_hypothesis()).residual;
    const NoiseModel start = nominal_hypothesis().base_noise;
    const SecondsNoise swallowed = fit_seconds_noise(campaign, start, residual);
    assert_true(swallowed.base.white_sigma_dph > 100);
    std::optional<StandingOut> hits = standing_out(campaign, residual);
    assert_true(hits.has_value());
    assert_near(hits->part, 8 / 24e3, 1e-9);
    assert_near(hits->rms_dph, size_dph, 50);
    hits->beside = fit_seconds_noise(campaign, start, hits->left);
    assert_near(hits->beside.base.white_sigma_dph, 36, 1);
    const FastScan scan =
        scan_fast_noise(campaign, swallowed, residual, effect_library(), all_active(), {}, false, hits);
    NoiseModel drawn = start;
    drawn.hit_probability = hits->part, drawn.hit_sigma_dph = size_dph;
    const FastFinding& first = scan.findings.front();
    const ResidualLikelihood log_likelihood(campaign, residual);
    assert_string_equal(first.effect->name().c_str(), "outliers");
    assert_true(log_likelihood(first.noise()) > log_likelihood(drawn) - 1);
    // They are sudden, and nothing jumps.
    assert_false(scan.changes_suddenly);
    for (const FastFinding& f : scan.findings) assert_false(f.effect->estimator()->is_jumping());
  }
}

// Where the search for hits ended too early, a search for two ends better: that is not what the second kind gains.
static void test_what_a_better_place_of_the_first_kind_gains_is_no_second_kind(void**) {
  const Campaign campaign = make_campaign(logs_with_hits(1e4), "gx_dph", nominal_model());
  const std::vector<VectorXd> residual = fit_hypothesis(campaign, nominal_hypothesis()).residual;
  const ResidualLikelihood log_likelihood(campaign, residual);
  FastFinding first, slope;
  first.effect = &find_effect("outliers"), first.theta = {0.002, 5e4};
  first.base = nominal_hypothesis().base_noise;
  first.base.white_sigma_dph = 39, first.base.markov = {{40, 600}};
  slope.effect = &find_effect("white_noise_vs_temperature"), slope.theta = {0}, slope.gain_nats = 100;
  const double too_early = log_likelihood(first.noise());
  assert_true(second_kind(log_likelihood, true, {slope}, 8, &first).effect == nullptr);
  assert_true(log_likelihood(first.noise()) > too_early + 30);
  assert_near(first.gain_nats, log_likelihood(first.noise()) - too_early, 0.1);
}

// One hit in each of four logs, another cause in all of them.
static std::set<std::string> names_beside_hits(const std::function<double(double, double)>& cause, uint64_t seed) {
  size_t row = 0;
  return names_of(answer_to(
      [&](double t, double temp_degc) { return cause(t, temp_degc) + (row++ % 6000 == 2345 ? 1e6 : 0.0); }, seed, 0));
}
static void test_large_hits_hide_nothing(void**) {
  Rng rng(791, 0, 0, Stream::kTool);
  const auto warm = [&](double, double temp_degc) {
    return 36 * std::sqrt(std::exp(0.4 * (temp_degc - 30) / 30) - std::exp(-0.4)) * rng.normal();
  };
  assert_true(names_beside_hits(warm, 791) == (std::set<std::string>{"outliers", "white_noise_vs_temperature"}));
  const auto tone = [](double t, double) { return 20 * std::cos(2 * kPi * 0.031 * t); };
  assert_true(names_beside_hits(tone, 792) == (std::set<std::string>{"outliers", "sinusoid"}));
}

static void test_few_large_hits_bring_no_second_name(void**) {
  for (const bool is_believed : {false, true}) {
    size_t row = 0;
    const auto hits = [&](double, double) { return row++ % 6000 == 2345 ? 1e6 : 0.0; };
    const Selection said = answer_to(hits, 781, 1, is_believed);
    assert_true(names_of(said) == std::set<std::string>{"outliers"});
    assert_true(said.verdict == Verdict::kExplained);
    assert_false(said.is_noise_retuned);
    const SelectedEffect& effect = said.effects.front();
    assert_near(effect.term.estimator->values(effect.term.estimate()).number("sigma_dph"), 1e6, 3e5);
  }
}

int main() {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_a_few_wrong_samples_are_hits_and_nothing_else),
      cmocka_unit_test(test_a_fast_process_is_found_where_the_fitted_noise_is_believed),
      cmocka_unit_test(test_noise_of_the_seconds_is_fitted_beside_another_kind),
      cmocka_unit_test(test_noise_believed_too_small_is_no_other_kind_of_noise),
      cmocka_unit_test(test_noise_without_a_slope_follows_no_temperature),
      cmocka_unit_test(test_the_slope_of_noise_over_a_narrow_range_is_not_cut),
      cmocka_unit_test(test_jumps_that_come_again_and_again_are_no_events),
      cmocka_unit_test(test_a_small_jump_beside_two_large_ones_makes_no_noise_of_them),
      cmocka_unit_test(test_kinds_of_noise_stand_beside_other_parameters),
      cmocka_unit_test(test_kinds_of_noise_are_found_that_the_fitted_noise_has_swallowed),
      cmocka_unit_test(test_a_kind_of_noise_is_found_beside_causes_whose_noise_has_swallowed_it),
      cmocka_unit_test(test_telegraph_noise_is_found_that_the_fitted_noise_has_swallowed),
      cmocka_unit_test(test_the_seconds_are_asked_for_slow_noise_where_their_spectrum_does_not_fit),
      cmocka_unit_test(test_what_better_plain_noise_gains_is_no_kind_of_fast_noise),
      cmocka_unit_test(test_white_noise_that_follows_the_temperature_is_no_slow_process),
      cmocka_unit_test(test_the_slope_of_slow_noise_is_that_of_the_seconds),
      cmocka_unit_test(test_the_error_of_a_slope_of_noise_has_the_level_free),
      cmocka_unit_test(test_a_drift_that_jumps_back_is_no_ramp),
      cmocka_unit_test(test_saw_teeth_are_no_telegraph_noise),
      cmocka_unit_test(test_jumps_between_two_levels_have_a_pattern),
      cmocka_unit_test(test_many_slips_are_nothing_but_slow_noise),
      cmocka_unit_test(test_jumps_that_repeat_at_temperatures_follow_the_temperature),
      cmocka_unit_test(test_jumps_of_one_log_are_events_however_many),
      cmocka_unit_test(test_a_dead_band_about_the_mean_is_no_other_noise),
      cmocka_unit_test(test_hits_in_bursts_are_no_outliers),
      cmocka_unit_test(test_two_kinds_of_fast_noise_are_told),
      cmocka_unit_test(test_the_error_of_a_tone_is_that_of_noise_that_follows_the_temperature),
      cmocka_unit_test(test_a_hit_that_stands_out_does_not_move_the_mean),
      cmocka_unit_test(test_hits_are_found_that_the_fitted_noise_has_swallowed),
      cmocka_unit_test(test_what_a_better_place_of_the_first_kind_gains_is_no_second_kind),
      cmocka_unit_test(test_few_large_hits_bring_no_second_name),
      cmocka_unit_test(test_large_hits_hide_nothing),
  };
  const struct CMUnitTest long_tests[] = {
      cmocka_unit_test(test_a_few_jumps_are_not_said_to_be_telegraph_noise),
      cmocka_unit_test(test_one_slip_in_each_of_many_logs_is_not_said_to_be_telegraph_noise),
      cmocka_unit_test(test_a_jump_in_time_is_placed_to_its_second),
      cmocka_unit_test(test_slips_that_outweigh_the_answer_leave_no_name),
      cmocka_unit_test(test_telegraph_noise_has_no_stand_ins_beside_it),
      cmocka_unit_test(test_a_cause_is_found_beside_telegraph_noise),
      cmocka_unit_test(test_shots_are_no_hits),
  };
  return run_answers("diagnose: noise", tests, long_tests);
}
