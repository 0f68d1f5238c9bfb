// SPDX-License-Identifier: MIT
// Held-out logs are logs of a real sensor too: what happens in them alone is told, and changes nothing of what is named.
#include "analysis/diagnose/evidence/kalman.h"
#include "analysis/diagnose/stages/drawn_minutes.h"
#include "analysis/diagnose/stages/gap.h"
#include "analysis/diagnose/stages/own_jumps.h"
#include "analysis/diagnose/stages/seconds_noise.h"
#include "diagnose_logs.h"

namespace {

constexpr double kLoop_dph = 40;

// Three fitted logs of a hysteresis and one held out; `spoil` changes the latter.
Selection answer_with(const std::function<void(Log*)>& spoil, uint64_t seed = 700, double loop_dph = kLoop_dph) {
  std::vector<Log> logs, unseen;
  for (uint64_t k = 0; k < 4; ++k) (k < 3 ? logs : unseen).push_back(simulated_log(seed + k, 6000, false, loop_dph));
  spoil(&unseen[0]);
  DiagnoseOptions options;
  options.nulls = 40, options.model_path = "given";
  return diagnose_logs(options, nominal_model(), logs, unseen).axes.at(0).study.selection;
}
void nothing(Log*) {}

bool fires(const std::vector<RestFinding>& tests, Rest which) {
  for (const RestFinding& f : tests)
    if (f.test == which) return f.evidence_nats > 0;
  return false;
}
bool fires(const std::vector<RestFinding>& tests) {
  for (const RestFinding& f : tests)
    if (f.evidence_nats > 0) return true;
  return false;
}

} // namespace

static void test_a_clean_held_out_log_leaves_nothing(void**) {
  const Selection said = answer_with(nothing);
  assert_true(names_of(said).count("thermal_hysteresis") == 1);
  assert_true(said.verdict == Verdict::kExplained);
  assert_true(said.own_jumps.empty() && !fires(said.unseen) && said.unseen.size() >= 4);
}

// Only the held-out log was recorded with a small range: half of it is at the limit.
static void test_structure_of_a_held_out_log_is_left_out(void**) {
  const Selection said = answer_with([](Log* log) {
    for (double& rate : log->axes[0].rate_dph) rate = std::min(rate, 150.0);
  });
  const std::set<std::string> names = names_of(said);
  assert_true(names.count("thermal_hysteresis") == 1 && names.count("saturation") == 1);
  assert_true(said.n_left_out > 1000);
  const auto is_saturation = [](const SelectedEffect& e) {
    return e.term.effect && e.term.effect->name() == "saturation";
  };
  const auto told = std::find_if(said.effects.begin(), said.effects.end(), is_saturation);
  assert_true(told->statement.find(": held-out log 1") != std::string::npos);
  const Selection dropped = answer_with([](Log* log) {
    for (double& rate : log->axes[0].rate_dph) rate += 2000; // a zero is far from every rate
    for (size_t i = 20; i < log->size(); i += 100) log->axes[0].rate_dph[i] = 0;
  });
  assert_true(names_of(dropped).count("thermal_hysteresis") == 1 && names_of(dropped).count("held_samples") == 1);
  assert_int_equal(dropped.n_left_out, 60);
}

static void test_a_jump_of_a_held_out_log_is_told_and_takes_no_name_away(void**) {
  const Selection said = answer_with([](Log* log) {
    for (size_t i = 2500; i < log->size(); ++i) log->axes[0].rate_dph[i] += 150;
  });
  assert_true(names_of(said).count("thermal_hysteresis") == 1);
  assert_true(said.verdict == Verdict::kPartlyExplained); // nothing named tells of the jump
  assert_int_equal(said.own_jumps.size(), 1);
  const StepValue& jump = said.own_jumps[0];
  assert_int_equal(jump.log, 0);
  assert_near(jump.t_s, 2501, 3);
  assert_near(jump.amplitude_dph.value, 150, 4 * jump.amplitude_dph.std_error);
  assert_true(jump.amplitude_dph.std_error < 15);
  assert_true(!fires(said.unseen)); // it is found to the second
  assert_true(said.stronger_noise.empty());
}

// As large, but over ten minutes: a cause may do that, and the held-out log speaks for or against it.
static void test_a_slow_change_of_a_held_out_log_is_no_jump(void**) {
  const Selection said = answer_with([](Log* log) {
    for (size_t i = 0; i < log->size(); ++i)
      log->axes[0].rate_dph[i] += 150 * std::clamp((static_cast<double>(i) - 2200) / 600, 0.0, 1.0);
  });
  assert_true(said.own_jumps.empty());
  assert_true(said.verdict != Verdict::kExplained);
}

// Up, and back after ten minutes: each edge alone is less than the two are.
static void test_a_jump_and_its_return_are_told(void**) {
  const Selection said = answer_with([](Log* log) {
    for (size_t i = 2500; i < 3100; ++i) log->axes[0].rate_dph[i] += 150;
  });
  assert_true(names_of(said).count("thermal_hysteresis") == 1);
  assert_int_equal(said.own_jumps.size(), 2);
  for (const StepValue& jump : said.own_jumps) {
    const bool is_up = jump.amplitude_dph.value > 0;
    assert_near(jump.t_s, is_up ? 2501 : 3101, 3);
    assert_near(std::fabs(jump.amplitude_dph.value), 150, 4 * jump.amplitude_dph.std_error);
  }
}

// What the recorder did is looked for before what the model knows is taken out: less that, a zero is no zero.
static void test_drop_outs_are_found_beside_a_known_effect(void**) {
  ErrorModel model = nominal_model();
  model.effects.push_back({"thermal_hysteresis", {{"amplitude_dph", 40.0}, {"width_degc", 5.0}}});
  std::vector<Log> logs;
  for (uint64_t k = 0; k < 3; ++k) {
    logs.push_back(simulated_log(780 + k, 6000, false, 40));
    for (double& rate : logs.back().axes[0].rate_dph) rate += 2000; // a zero is far from every rate
    for (size_t i = 20; i < 6000; i += 100) logs.back().axes[0].rate_dph[i] = 0;
  }
  DiagnoseOptions options;
  options.nulls = 40, options.model_path = "given";
  const Selection said = diagnose_logs(options, model, logs, {}).axes.at(0).study.selection;
  assert_true(names_of(said) == std::set<std::string>{"held_samples"});
  assert_int_equal(said.n_left_out, 180);
}

// The only log that reached the hot end is left out: up there every answer is extrapolated, whatever was recorded.
static void test_only_rows_that_were_fitted_count_as_fitted_temperatures(void**) {
  const Campaign campaign = make_campaign({simulated_log(790, 3000, false, 0)}, "gx_dph", nominal_model());
  CampaignRun run = campaign.runs[0];
  for (size_t i = 0; i < run.input.size(); ++i)
    if (run.input.smooth_degc[i] > 40) run.input.rate_dph[i] = std::nan("");
  find_used(&run);
  FittedSpan span;
  assert_true(!span.holds(20));
  span.add(run, 0, run.n());
  assert_true(span.holds(20) && span.holds(40.5) && !span.holds(42));
}

// A jump that the model holds of the first fitted log is no jump of the first held-out one.
static void test_a_known_jump_of_a_fitted_log_is_taken_out_of_that_log_alone(void**) {
  ErrorModel model = nominal_model();
  model.effects.push_back({"bias_step", {{"steps", {{{"log", 0}, {"t_s", 2500.0}, {"amplitude_dph", 200.0}}}}}});
  std::vector<Log> logs, unseen;
  for (uint64_t k = 0; k < 4; ++k) (k < 3 ? logs : unseen).push_back(simulated_log(795 + k, 6000, false, 0));
  for (size_t i = 2500; i < 6000; ++i) logs[0].axes[0].rate_dph[i] += 200;
  DiagnoseOptions options;
  options.nulls = 40, options.model_path = "given";
  const Selection said = diagnose_logs(options, model, logs, unseen).axes.at(0).study.selection;
  assert_true(said.verdict == Verdict::kNoGap && said.own_jumps.empty());
}

// A soak is a natural log to hold out.  Its temperature moves by less than 2 degC, and the polynomial holds it as it holds all.
static void test_a_soak_is_judged_by_the_polynomial_of_the_fitted_logs(void**) {
  constexpr double kSlope_dph_degc = 80; // steep enough that 1.6 degC show
  for (const double span_degc : {0.4, 1.6}) {
    std::vector<Log> logs, unseen;
    for (uint64_t k = 0; k < 4; ++k) {
      Log log = simulated_log(770 + k, 6000, false, 0);
      for (size_t i = 0; k == 3 && i < log.size(); ++i) {
        const double soak_degc = 48 + span_degc * (log.temp_degc[i] / 60 - 0.5);
        log.axes[0].rate_dph[i] += bias_dph(soak_degc) - bias_dph(log.temp_degc[i]);
        log.temp_degc[i] = soak_degc;
      }
      for (size_t i = 0; i < log.size(); ++i) log.axes[0].rate_dph[i] += kSlope_dph_degc * log.temp_degc[i];
      (k < 3 ? logs : unseen).push_back(log);
    }
    DiagnoseOptions options;
    options.nulls = 40, options.model_path = "given";
    const DiagnoseResult result = diagnose_logs(options, nominal_model(), logs, unseen);
    assert_true(result.axes.at(0).study.selection.verdict == Verdict::kNoGap);
    const GapResult& gap = result.axes[0].study.gap;
    assert_true(gap.minutes.rms_after_dph < 1.4 * gap.minutes.noise_rms_dph);
  }
}

// Beside white noise a jump is no large innovation: it shifts all that follow, and with them the median by which noise is measured.
static void test_a_jump_beside_white_noise_is_told(void**) {
  for (uint64_t seed : {760, 761, 762, 763}) {
    std::vector<Log> logs, unseen;
    for (uint64_t k = 0; k < 4; ++k) {
      Log log = simulated_log(seed + 10 * k, 6000, false, 0);
      Rng rng(seed, k, 1, Stream::kTool);
      for (size_t i = 0; i < log.size(); ++i)
        log.axes[0].rate_dph[i] = bias_dph(log.temp_degc[i]) + 50 * rng.normal() + (k == 3 && i >= 2500 ? 90 : 0);
      (k < 3 ? logs : unseen).push_back(log);
    }
    DiagnoseOptions options;
    options.nulls = 40;
    const Selection said = diagnose_logs(options, ErrorModel(), logs, unseen).axes.at(0).study.selection;
    assert_true(said.effects.empty() && said.stronger_noise.empty());
    assert_int_equal(said.own_jumps.size(), 1);
    assert_near(said.own_jumps[0].t_s, 2501, 10);
  }
}

// All of its noise is twice as strong: that is told, makes no jumps, and takes no name away.
static void test_a_loud_held_out_log_is_told(void**) {
  for (uint64_t seed : {750, 751, 752}) {
    const Log other = simulated_log(seed + 100, 6000, false, 0);
    const Selection said = answer_with(
        [&](Log* log) {
          for (size_t i = 0; i < log->size(); ++i) {
            const double noise_dph = other.axes[0].rate_dph[i] - bias_dph(other.temp_degc[i]);
            log->axes[0].rate_dph[i] += std::sqrt(3.0) * noise_dph;
          }
        },
        seed);
    assert_true(names_of(said).count("thermal_hysteresis") == 1);
    assert_true(said.own_jumps.empty() && said.verdict == Verdict::kPartlyExplained);
    assert_int_equal(said.stronger_noise.size(), 1);
    assert_int_equal(said.stronger_noise[0].log, 0);
    assert_near(said.stronger_noise[0].times, 2, 0.2);
  }
}

// Of few rows a strength is known to a fifth: of devices whose noise never changes, held-out logs of ten minutes are not louder.
static void test_short_held_out_logs_of_the_same_noise_are_not_loud(void**) {
  size_t n_loud = 0;
  for (uint64_t seed = 0; seed < 12; ++seed) {
    std::vector<Log> logs, unseen;
    for (uint64_t k = 0; k < 2; ++k) logs.push_back(simulated_log(8000 + 20 * seed + k, 6000, false, 0));
    for (uint64_t k = 2; k < 10; ++k) unseen.push_back(simulated_log(8000 + 20 * seed + k, 600, false, 0));
    DiagnoseOptions options;
    options.nulls = 40, options.model_path = "given";
    n_loud += diagnose_logs(options, nominal_model(), logs, unseen).axes.at(0).study.selection.stronger_noise.size();
  }
  assert_true(n_loud <= 1); // 96 logs, of which 1 in 1000
}
// The rate that is stated, by draws; and noise of twice the strength is seen in a quarter of an hour.
static void test_a_log_seldom_is_loud_by_chance(void**) {
  constexpr int kDraws = 20000;
  Rng rng(41, 0, 0, Stream::kTool);
  for (const long n : {30L, 60L, 100L, 400L}) {
    int by_chance = 0, twice = 0;
    for (int i = 0; i < kDraws; ++i) {
      Eigen::VectorXd e(n);
      for (long k = 0; k < n; ++k) e[k] = rng.normal();
      const double strength = strength_of_innovations(e);
      const double fitted = std::exp(rng.normal() / std::sqrt(2.0 * 400));
      by_chance += is_clearly_stronger(strength / fitted, static_cast<size_t>(n), 400) ? 1 : 0;
      twice += is_clearly_stronger(2 * strength / fitted, static_cast<size_t>(n), 400) ? 1 : 0;
    }
    if (!(by_chance < 0.0015 * kDraws)) fail_msg("%ld rows: %d of %d", n, by_chance, kDraws);
    if (n >= 100 && !(twice > 0.9 * kDraws)) fail_msg("%ld rows: twice as strong in %d of %d", n, twice, kDraws);
  }
}

// Near the place of a named jump the held-out log speaks for or against it; elsewhere a jump is its own.
static void test_a_jump_beside_one_at_a_temperature(void**) {
  const auto at_temperature = [](double, double temp_degc) { return temp_degc > 37.3 ? 90.0 : 0.0; };
  const Selection said = answer_to(at_temperature, 720, 1, true);
  assert_true(names_of(said).count("thermal_step") == 1);
  assert_true(said.own_jumps.empty());
  // A held-out log without it: that is no jump down and one up of its own.
  const auto only_fitted = [n = 0, at_temperature](double t_s, double temp_degc) mutable {
    n += t_s < 1.5 ? 1 : 0; // the log
    return n == 4 ? 0.0 : at_temperature(t_s, temp_degc);
  };
  assert_true(answer_to(only_fitted, 720, 1, true).own_jumps.empty());
  const auto with_own = [n = 0, at_temperature](double t_s, double temp_degc) mutable {
    n += t_s < 1.5 ? 1 : 0; // the log
    return at_temperature(t_s, temp_degc) + (n == 4 && t_s > 4500 ? 120.0 : 0.0);
  };
  const Selection both = answer_to(with_own, 720, 1, true);
  assert_true(names_of(both).count("thermal_step") == 1);
  assert_int_equal(both.own_jumps.size(), 1);
  assert_near(both.own_jumps[0].t_s, 4501, 5);
}

// A jump in time of a fitted log foretells nothing either.
static void test_a_jump_beside_one_of_a_fitted_log(void**) {
  const auto in_time = [n = 0](double t_s, double) mutable {
    n += t_s < 1.5 ? 1 : 0; // the log
    return (n == 2 && t_s > 1500) || (n == 4 && t_s > 4500) ? 120.0 : 0.0;
  };
  const Selection twice = answer_to(in_time, 721, 1, true);
  assert_int_equal(twice.effects.size(), 1);
  assert_true(twice.effects[0].is_family && twice.effects[0].family == Family::kSlowNoise); // they come again
  assert_int_equal(twice.own_jumps.size(), 1);
  assert_near(twice.own_jumps[0].t_s, 4501, 5);
}

// A gap that the fitted logs do not have is one all the same.
static void test_bursts_of_a_held_out_log_are_a_gap(void**) {
  Rng rng(740, 0, 0, Stream::kTool);
  const auto burst = [&](Log* log) {
    for (size_t i = 3000; i < 3040; ++i) log->axes[0].rate_dph[i] += 200 * rng.normal();
  };
  assert_true(answer_with(nothing, 740, 0).verdict == Verdict::kNoGap);
  const Selection said = answer_with(burst, 740, 0);
  assert_true(said.verdict == Verdict::kUnexplained && said.effects.empty());
  assert_true(fires(said.unseen, Rest::kBursts) && fires(said.unseen, Rest::kDistribution));
}

// One wrong sample is no strength that changes, no burst and no jump.
static void test_a_wrong_sample_of_a_held_out_log_is_one_sample(void**) {
  for (const double size_dph : {2e3, 1e6}) {
    const Selection said = answer_with([&](Log* log) { log->axes[0].rate_dph[3000] -= size_dph; }, 740, 0);
    assert_true(said.verdict == Verdict::kUnexplained && said.effects.empty() && said.stronger_noise.empty());
    for (const RestFinding& f : said.unseen) assert_true((f.evidence_nats > 0) == (f.test == Rest::kDistribution));
  }
}

// Without anything: at 1 in 1000 each.
static void test_right_held_out_logs_are_quiet(void**) {
  int n_fire = 0;
  for (uint64_t k = 0; k < 40; ++k) {
    Campaign campaign = make_campaign({simulated_log(2000 + k, 6000, true, 0)}, "gx_dph", nominal_model());
    const Fit fit = fit_hypothesis(campaign, nominal_hypothesis());
    n_fire += fires(test_unseen(campaign, fit.e, fit.e, SelectorConstants())) ? 1 : 0;
  }
  assert_true(n_fire <= 2); // 0.16 are expected, more than 2 in 1 of 1600 such tests
}

// Teeth of 0.88 standard deviations of a second, 57 in all: their third moment tells some of them.
static void test_small_teeth_are_sudden_changes(void**) {
  const Campaign campaign = make_campaign({simulated_log(1, 28000, false, 0)}, "gx_dph", nominal_model());
  int n_teeth = 0, n_none = 0;
  for (uint64_t draw = 0; draw < 60; ++draw) {
    Rng rng(900 + draw, 0, 0, Stream::kWhite);
    VectorXd e(28000);
    for (double& x : e) x = rng.normal();
    const auto sudden = [&] { return fires(test_rest(campaign, {e}, SelectorConstants()), Rest::kSuddenChanges); };
    n_none += sudden() ? 1 : 0;
    for (long tooth = 200; tooth + 100 < e.size(); tooth += 490)
      for (long k = 0; k < 60; ++k) e[tooth + k] -= 0.88 * std::exp(-static_cast<double>(k) / 15);
    n_teeth += sudden() ? 1 : 0;
  }
  assert_int_equal(n_none, 0);
  assert_in_range(n_teeth, 20, 60); // 27; 12 where the third moment counts as little as the fourth
}

// A loop of a few large relays jumps where no member of the library does.  What foretells a log that was not fitted is told all
// the same, as a family.
static void test_a_loop_of_relays_is_told_though_it_jumps(void**) {
  constexpr size_t kRelays = 12;
  Rng rng(31, 0, 0, Stream::kTool);
  std::vector<double> half(kRelays), centre(kRelays), height_dph(kRelays);
  for (size_t i = 0; i < kRelays; ++i)
    half[i] = 4 * rng.uniform(), centre[i] = 22 + 8 * rng.uniform(),
    height_dph[i] = -200.0 / 6 * std::log(rng.uniform());
  std::vector<bool> is_up(kRelays);
  const auto loop = [&](double t_s, double temp_degc) {
    double sum = 0;
    for (size_t i = 0; i < kRelays; ++i) {
      if (t_s < 2) is_up[i] = false;
      if (temp_degc > centre[i] + half[i]) is_up[i] = true;
      if (temp_degc < centre[i] - half[i]) is_up[i] = false;
      sum += height_dph[i] * ((is_up[i] ? 1 : -1) - std::tanh((temp_degc - centre[i]) / std::max(1.0, half[i])));
    }
    return sum;
  };
  const Selection said = answer_to(loop, 31, 1);
  assert_true(said.verdict ==
              Verdict::kPartlyExplained); // no name, unexplained, where sudden changes speak against all
  assert_false(said.effects.empty());
  assert_true(said.effects.front().held_out_nats > 5);
}

// The fitted log stays below 25 degC, those held out go to 60: beyond, a cubic is as wrong as it likes, and that is neither
// stronger noise nor a jump.
static void test_an_extrapolated_polynomial_is_no_noise_of_held_out_logs(void**) {
  for (const uint64_t seed : {321u, 341u, 351u}) {
    const Log whole = simulated_log(seed, 6000, false, 0);
    Log cold = whole;
    cold.t_s.clear(), cold.temp_degc.clear(), cold.axes[0].rate_dph.clear();
    for (size_t i = 0; i < whole.size(); ++i) {
      if (whole.temp_degc[i] > 25) continue;
      cold.t_s.push_back(whole.t_s[i]), cold.temp_degc.push_back(whole.temp_degc[i]);
      cold.axes[0].rate_dph.push_back(whole.axes[0].rate_dph[i]);
    }
    DiagnoseOptions options;
    options.nulls = 40;
    const std::vector<Log> unseen = {simulated_log(seed + 1, 6000, false, 0), simulated_log(seed + 2, 6000, false, 0)};
    const Selection said = diagnose_logs(options, ErrorModel(), {cold}, unseen).axes.at(0).study.selection;
    assert_true(said.stronger_noise.empty() && said.own_jumps.empty());
  }
}

static double mean_square_of(int n, Rng* rng) {
  double sum = 0;
  for (int i = 0; i < n; ++i) sum += std::pow(rng->normal(), 2);
  return sum / n;
}
// Held-out minutes of so many free values, and fitted ones (0: the noise is known).
static GapResult gap_of_values(double after2, double noise2, int held, int fitted) {
  GapResult gap;
  gap.minutes.rms_after_dph = std::sqrt(after2), gap.minutes.noise_rms_dph = std::sqrt(noise2);
  gap.minutes.noise_error_dph = 0.5 * std::sqrt(2.0 / held) * gap.minutes.noise_rms_dph;
  gap.minutes.per_hour_fitted = fitted > 0 ? static_cast<double>(held) / fitted : 0;
  return gap;
}
// However few the free values are, the minutes exceed the noise by chance in 1 of 740, as is stated.
static void test_few_values_exceed_the_noise_at_the_stated_rate(void**) {
  constexpr int kDraws = 100000;
  Rng rng(32, 0, 0, Stream::kTool);
  for (const auto& [held, fitted] : {std::pair{3, 0}, {3, 12}, {8, 0}, {8, 8}, {60, 200}}) {
    int n = 0;
    for (int i = 0; i < kDraws; ++i) {
      const double held2 = mean_square_of(held, &rng), fitted2 = fitted > 0 ? mean_square_of(fitted, &rng) : 1;
      n += gap_of_values(held2, fitted2, held, fitted).minutes.exceed_noise({}) ? 1 : 0;
    }
    if (n < 90 || n > 185) fail_msg("%d and %d values: %d of %d", held, fitted, n, kDraws); // 135, four deviations
  }
}
// Minutes of draws are those that are worked out where the noise is the same throughout; where it follows the temperature
// they are those of the noise that it is there.
static void test_minutes_of_drawn_noise(void**) {
  const Campaign campaign =
      block_means(make_campaign({simulated_log(5, 6000, false, 0)}, "gx_dph", nominal_model()), 10);
  HeldOutUnit unit;
  unit.run = campaign.runs[0], unit.left = Eigen::VectorXd::Zero(static_cast<long>(unit.run.n()));
  unit.run.own_strength = 1.5;
  NoiseModel noise = block_equivalent(nominal_hypothesis().base_noise, 10);
  const MinutesOfNoise drawn = drawn_minutes({unit}, noise, 10);
  Minutes whole;
  whole.n = 100, whole.strength = 1.5;
  const double expected = noise_of_all(nominal_hypothesis().base_noise, 60, {whole}),
               error = error_of_minutes(nominal_hypothesis().base_noise, 60, {whole});
  assert_near(drawn.ms_dph2, expected, 0.05 * expected);
  assert_near(drawn.ms_error_dph2, error, 0.2 * error);
  for (double& tn : unit.run.input.tn) tn = 1;
  noise.markov_slope = std::log(9.0);
  NoiseModel three_times = nominal_hypothesis().base_noise;
  three_times.markov[0].sigma_dph *= 3;
  const double loud = noise_of_all(three_times, 60, {whole});
  assert_near(drawn_minutes({unit}, noise, 10).ms_dph2, loud, 0.06 * loud);
}

// Rates of the noise of simulated_log, whose slow part is `times` as strong at a temperature.
static Log log_of_slow_noise(uint64_t seed, size_t seconds, const std::function<double(double)>& times) {
  Log log = simulated_log(seed, seconds, false, 0);
  Rng rng(seed, 7, 0, Stream::kTool);
  double slow = 20 * rng.normal();
  for (size_t i = 0; i < log.size(); ++i) {
    slow = std::exp(-0.01) * slow + 20 * std::sqrt(1 - std::exp(-0.02)) * rng.normal();
    log.axes[0].rate_dph[i] = bias_dph(log.temp_degc[i]) + times(log.temp_degc[i]) * slow + 36 * rng.normal();
  }
  return log;
}
// Slow noise that is a multiple at one end of the temperatures: what is expected of the held-out minutes is what they leave,
// and how far that scatters is known.
static void test_noise_that_follows_the_temperature_leaves_what_is_expected(void**) {
  const auto times = [](double temp_degc) { return std::exp(0.8 * (temp_degc - 30) / 30); };
  std::vector<Log> logs, unseen;
  for (uint64_t k = 0; k < 6; ++k) (k < 4 ? logs : unseen).push_back(log_of_slow_noise(8500 + k, 6000, times));
  DiagnoseOptions options;
  options.nulls = 40, options.model_path = "given";
  const DiagnoseResult result = diagnose_logs(options, nominal_model(), logs, unseen);
  const AxisStudy& study = result.axes.at(0).study;
  assert_true(names_of(study.selection).count("markov_sigma_vs_temperature") == 1);
  const MinutesLeft& minutes = study.gap.minutes;
  assert_true(minutes.noise_error_dph > 0 && minutes.noise_error_dph < 0.3 * minutes.noise_rms_dph);
  assert_near(minutes.rms_after_dph, minutes.noise_rms_dph, 3 * minutes.noise_error_dph);
  assert_true(study.selection.verdict == Verdict::kExplained);
}
// A noise is all that is named, and held-out logs leave a third more than it would: it does not explain them.
static void test_noise_alone_is_held_against_held_out_minutes(void**) {
  for (const double louder : {1.0, 1.4}) {
    std::vector<Log> logs, unseen;
    for (uint64_t k = 0; k < 12; ++k)
      (k < 6 ? logs : unseen).push_back(log_of_slow_noise(8600 + k, 6000, [&](double) { return k < 6 ? 1 : louder; }));
    ErrorModel quiet = nominal_model();
    quiet.markov[0].sigma_dph = 12;
    DiagnoseOptions options;
    options.nulls = 40, options.model_path = "given";
    const DiagnoseResult result = diagnose_logs(options, quiet, logs, unseen);
    const AxisStudy& study = result.axes.at(0).study;
    const double times = study.gap.minutes.times_expected();
    assert_false(study.selection.effects.empty());
    assert_true(!study.gap.has_mean && study.selection.stronger_noise.empty());
    if (louder > 1 && (times < 1.25 || times > 1.4)) fail_msg("%g times", times);
    assert_true(study.selection.verdict == (louder > 1 ? Verdict::kPartlyExplained : Verdict::kExplained));
    assert_true(study.selection.leaves_mean == (louder > 1));
  }
}

// Mean squares of 16 free values of held-out logs and 24 of the fitted ones, which told the noise: by chance the first exceeds the
// second in less than four of a thousand, and a residual of twice the noise does exceed it.
static void test_few_minutes_seldom_exceed_the_noise_that_few_others_told(void**) {
  constexpr int kHeld = 16, kFitted = 24, kDraws = 20000;
  Rng rng(31, 0, 0, Stream::kTool);
  const auto mean_square = [&](int n) { return mean_square_of(n, &rng); };
  const auto exceeds = [](double after2, double noise2, int fitted) {
    return gap_of_values(after2, noise2, kHeld, fitted).minutes.exceed_noise({});
  };
  int estimated = 0, known = 0;
  for (int i = 0; i < kDraws; ++i) {
    const double held2 = mean_square(kHeld);
    known += exceeds(held2, 1, 0) ? 1 : 0;
    estimated += exceeds(held2, mean_square(kFitted), kFitted) ? 1 : 0;
  }
  assert_true(known < 0.004 * kDraws && estimated < 0.004 * kDraws);
  assert_true(exceeds(4, 1, 0) && exceeds(4, 1, kFitted) && !exceeds(3, 1, kFitted) && exceeds(3, 1, 0));
  assert_false(exceeds(0.5, 1, 0));
}

// The polynomial of one log goes astray in another.  Over devices with the noise that is believed, the minutes of a held-out log
// leave, on the average, what the noise and the stated errors of the fit make of them, and scatter as is stated.
static void test_what_the_polynomial_of_one_log_leaves_in_another_is_expected(void**) {
  constexpr int kDevices = 100;
  const std::vector<bool> none(effect_library().size(), false);
  double excess = 0, excess2 = 0, of_fit = 0, of_noise = 0, variance = 0;
  int told = 0;
  for (uint64_t k = 0; k < kDevices; ++k) {
    const auto campaign_of = [](uint64_t seed) {
      return make_campaign({simulated_log(seed, 2400, false, 0)}, "gx_dph", nominal_model());
    };
    const Campaign fitted = campaign_of(9000 + 2 * k);
    const SlowData data(block_means(fitted, block_length_s(fitted)));
    const Campaign unseen = block_means(campaign_of(9001 + 2 * k), data.campaign.dt_s);
    SlowSearch search(data, true_noise_believed(), effect_library(), none, {});
    const SlowModel null = search.run().null;
    const GapResult gap = measure_gap(search, data, &unseen, null, null);
    const double noise2 = std::pow(gap.minutes.noise_rms_dph, 2),
                 left = std::pow(gap.minutes.rms_after_dph, 2) - noise2;
    excess += left / kDevices, excess2 += left * left / kDevices;
    of_fit += gap.minutes.fit_ms_dph2 / kDevices, of_noise += noise2 / kDevices;
    variance += (std::pow(2 * gap.minutes.noise_rms_dph * gap.minutes.noise_error_dph, 2) +
                 std::pow(gap.minutes.fit_ms_error_dph2, 2)) /
                kDevices;
    told += gap.minutes.exceed_noise({}) ? 1 : 0;
  }
  const double scatter2 = excess2 - excess * excess;
  if (!(of_fit > 0.15 * of_noise)) fail_msg("errors of the fit %g, noise %g dph^2: nothing to see", of_fit, of_noise);
  assert_near(excess, of_fit, 3 * std::sqrt(scatter2 / kDevices));
  if (!(scatter2 > variance / 2 && scatter2 < 2 * variance)) fail_msg("scatter^2 %g, stated %g", scatter2, variance);
  assert_true(told <= 2);
}

// A loop that the held-out log has the other way goes, and the jumps in time beside it stay: slow noise is not credited with what
// these gain.
static void test_what_jumps_in_time_gain_is_not_that_of_slow_noise(void**) {
  std::vector<Log> logs, unseen;
  for (uint64_t k = 0; k < 3; ++k)
    (k < 2 ? logs : unseen).push_back(simulated_log(2300 + k, 6000, false, k < 2 ? 30 : -30));
  for (size_t i = 2000; i < 6000; ++i) logs[0].axes[0].rate_dph[i] += 120;
  for (size_t i = 4200; i < 6000; ++i) logs[1].axes[0].rate_dph[i] -= 120;
  DiagnoseOptions options;
  options.nulls = 40, options.model_path = "given";
  const Selection said = diagnose_logs(options, nominal_model(), logs, unseen).axes.at(0).study.selection;
  double of_jumps = 0, of_noise = 0;
  for (const SelectedEffect& effect : said.effects) {
    const bool is_jump = effect.term.estimator && effect.term.form() == Form::kSteps;
    (is_jump ? of_jumps : of_noise) += effect.evidence_nats;
  }
  assert_int_equal(said.dropped.size(), 1);
  assert_true(of_jumps > 30 && of_noise < 15);
}

int main() {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_what_jumps_in_time_gain_is_not_that_of_slow_noise),
      cmocka_unit_test(test_what_the_polynomial_of_one_log_leaves_in_another_is_expected),
      cmocka_unit_test(test_few_values_exceed_the_noise_at_the_stated_rate),
      cmocka_unit_test(test_minutes_of_drawn_noise),
      cmocka_unit_test(test_noise_that_follows_the_temperature_leaves_what_is_expected),
      cmocka_unit_test(test_noise_alone_is_held_against_held_out_minutes),
      cmocka_unit_test(test_few_minutes_seldom_exceed_the_noise_that_few_others_told),
      cmocka_unit_test(test_an_extrapolated_polynomial_is_no_noise_of_held_out_logs),
      cmocka_unit_test(test_a_clean_held_out_log_leaves_nothing),
      cmocka_unit_test(test_structure_of_a_held_out_log_is_left_out),
      cmocka_unit_test(test_a_jump_of_a_held_out_log_is_told_and_takes_no_name_away),
      cmocka_unit_test(test_a_slow_change_of_a_held_out_log_is_no_jump),
      cmocka_unit_test(test_a_jump_and_its_return_are_told),
      cmocka_unit_test(test_a_known_jump_of_a_fitted_log_is_taken_out_of_that_log_alone),
      cmocka_unit_test(test_only_rows_that_were_fitted_count_as_fitted_temperatures),
      cmocka_unit_test(test_drop_outs_are_found_beside_a_known_effect),
      cmocka_unit_test(test_a_soak_is_judged_by_the_polynomial_of_the_fitted_logs),
      cmocka_unit_test(test_a_jump_beside_white_noise_is_told),
      cmocka_unit_test(test_a_loud_held_out_log_is_told),
      cmocka_unit_test(test_short_held_out_logs_of_the_same_noise_are_not_loud),
      cmocka_unit_test(test_a_log_seldom_is_loud_by_chance),
      cmocka_unit_test(test_a_jump_beside_one_at_a_temperature),
      cmocka_unit_test(test_a_jump_beside_one_of_a_fitted_log),
      cmocka_unit_test(test_bursts_of_a_held_out_log_are_a_gap),
      cmocka_unit_test(test_a_wrong_sample_of_a_held_out_log_is_one_sample),
      cmocka_unit_test(test_right_held_out_logs_are_quiet),
      cmocka_unit_test(test_small_teeth_are_sudden_changes),
      cmocka_unit_test(test_a_loop_of_relays_is_told_though_it_jumps),
  };
  return cmocka_run_group_tests_name("diagnose: held-out logs", tests, nullptr, nullptr);
}
