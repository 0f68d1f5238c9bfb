// SPDX-License-Identifier: MIT
// A thermometer that is renewed seldom is found, with its period and what it costs; healthy thermometers never are.  Readings
// are simulated word by word: the true temperature, noise, rounding to the quantum, the mean of the samples of a second in
// single precision, as a device sends it.
#include <cmath>
#include <csetjmp>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <random>
#include <string>
#include <vector>

extern "C" {
#include <cmocka.h>
}

#include "analysis/fit/renewal.h"

using namespace imucal;

namespace {

constexpr double kPi = 3.14159265358979323846;

struct Thermometer {
  double quantum_degc, step_degc; // declared; what the converter really makes (0: the same)
  double noise_degc;              // of a word
  int samples_per_s;
  double every_s; // its word is renewed; 0: with every sample
};

struct Record {
  std::vector<double> t_s, temp_degc;
};

using Chamber = std::function<double(double)>;

Record record_of(const Thermometer& what, const Chamber& chamber, double duration_s, std::mt19937_64* random) {
  std::normal_distribution<double> noise;
  Record record;
  const double period_s = 1.0 / what.samples_per_s;
  double next_s = std::uniform_real_distribution<double>(-what.every_s, 0)(*random), word = 0;
  for (double second = 0; second < duration_s; ++second) {
    double sum = 0;
    for (int i = 0; i < what.samples_per_s; ++i) {
      const double t_s = second + i * period_s;
      if (t_s >= next_s) {
        double degc = chamber(t_s) + what.noise_degc * noise(*random);
        if (what.step_degc > 0) degc = std::round(degc / what.step_degc) * what.step_degc;
        word = std::round(degc / what.quantum_degc) * what.quantum_degc;
        next_s += std::max(what.every_s, period_s);
      }
      sum += word;
    }
    record.t_s.push_back(second + 1);
    record.temp_degc.push_back(static_cast<double>(static_cast<float>(sum / what.samples_per_s)));
  }
  return record;
}

// 20 min at 0, to 60 degC at so many degC a minute, 20 min.
Chamber ramp(double degc_per_min) {
  return [=](double t_s) { return std::min(60.0, std::max(0.0, (t_s - 1200) * degc_per_min / 60)); };
}
Chamber staircase() { // 5 degC in two minutes, then ten minutes of rest
  return [](double t_s) { return 5 * (std::floor(t_s / 720) + std::min(1.0, std::fmod(t_s, 720) / 120)); };
}
Chamber up_and_down() {
  return [](double t_s) { return 30 - 30 * std::cos(2 * kPi * t_s / 4000); };
}
Chamber regulated() { // a chamber that swings about its ramp
  return [](double t_s) {
    return ramp(1.0)(t_s) + 0.1 * std::sin(2 * kPi * t_s / 90) + 0.02 * std::sin(2 * kPi * t_s / 7);
  };
}
std::vector<Chamber> chambers() {
  return {ramp(0.6), ramp(1.3), ramp(4), staircase(), up_and_down(), regulated(), [](double) { return 25.0; }};
}

void test_healthy_thermometers_are_never_told(void**) {
  std::mt19937_64 random(1);
  const double quanta[] = {1.4e-5, 0.003, 0.01, 0.1, 0.5, 1};
  const double noises[] = {0, 0.3, 1, 5}; // quanta
  int n = 0;
  for (const Chamber& chamber : chambers())
    for (const double quantum : quanta)
      for (const double noise : noises)
        for (const int rate : {1, 10, 50}) {
          const Thermometer what{quantum, 0, noise * quantum, rate, 0};
          const Record record = record_of(what, chamber, 3600, &random);
          const Renewal renewal = thermometer_renewal(record.t_s, record.temp_degc, quantum);
          if (renewal.every_s > 0)
            fail_msg("quantum %g, noise %g, %d Hz: every %g s", quantum, noise, rate, renewal.every_s);
          ++n;
        }
  // converters that are coarser than declared: powers of two, tenths, 0.14 degC, in fine words
  for (const Chamber& chamber : chambers())
    for (const double step : {0.5, 0.25, 0.125, 0.1, 0.14, 1.0})
      for (const double noise : {0.0, 0.02, 0.3}) // steps
        for (const int rate : {1, 10}) {
          const Record record = record_of({0.003, step, noise * step, rate, 0}, chamber, 4800, &random);
          const Renewal renewal = thermometer_renewal(record.t_s, record.temp_degc, 0.003);
          if (renewal.every_s > 0) fail_msg("step %g, noise %g, %d Hz: every %g s", step, noise, rate, renewal.every_s);
          ++n;
        }
  assert_true(n >= 600);
}

void test_thermometers_that_are_renewed_seldom_are_found_with_their_period(void**) {
  std::mt19937_64 random(2);
  int n = 0, n_found = 0;
  for (const double every_s : {3.0, 4.5, 10.0, 30.0, 60.0, 100.0})
    for (const double noise_degc : {0.0, 0.003, 0.02})
      for (const double quantum : {0.003, 0.0078125})
        for (int k = 0; k < 3; ++k) {
          const Chamber chamber = k == 0 ? ramp(1.3) : k == 1 ? up_and_down() : regulated();
          const Record record = record_of({quantum, 0, noise_degc, 20, every_s}, chamber, 5400, &random);
          const Renewal renewal = thermometer_renewal(record.t_s, record.temp_degc, quantum);
          // a move is well beyond ten quanta, and no steady ramp without noise puts the readings on a lattice
          const bool can_be_seen = every_s / 60 > 20 * quantum && (k > 0 || noise_degc > 0);
          ++n;
          n_found += renewal.every_s > 0;
          if (can_be_seen && std::abs(renewal.every_s - every_s) > 0.1 * every_s + 0.5)
            fail_msg("every %g s, noise %g, quantum %g: %g", every_s, noise_degc, quantum, renewal.every_s);
        }
  assert_true(n_found > 0.7 * n);
}

void test_cost_is_delay_times_slope_times_ramp_and_undone_by_the_way_back(void**) {
  std::mt19937_64 random(3);
  const std::vector<double> coeff = {100, 300}; // 10 dph/degC over 30 +- 30 degC
  const Record up = record_of({0.003, 0, 0.01, 20, 60}, ramp(1.3), 5170, &random);
  const Renewal renewal = thermometer_renewal(up.t_s, up.temp_degc, 0.003);
  const double cost = renewal_cost(renewal, up.t_s, up.temp_degc, coeff, 30, 30);
  assert_true(std::abs(cost - 30 * 10 * 1.3 / 60) < 0.3); // 6.5 dph
  const Record both = record_of({0.003, 0, 0.01, 20, 60}, up_and_down(), 8000, &random);
  const Renewal same = thermometer_renewal(both.t_s, both.temp_degc, 0.003);
  assert_true(same.every_s > 55);
  assert_true(renewal_cost(same, both.t_s, both.temp_degc, coeff, 30, 30) < 4); // of 14 on one way alone
  assert_true(renewal_cost({}, up.t_s, up.temp_degc, coeff, 30, 30) == 0);
  const std::string text = renewal_text(renewal, cost, 0.65, "dph");
  assert_true(text.find("every 60 s") != std::string::npos && text.find("predicted error 0.65") != std::string::npos);
}

} // namespace

int main() {
  const CMUnitTest tests[] = {
      cmocka_unit_test(test_healthy_thermometers_are_never_told),
      cmocka_unit_test(test_thermometers_that_are_renewed_seldom_are_found_with_their_period),
      cmocka_unit_test(test_cost_is_delay_times_slope_times_ramp_and_undone_by_the_way_back),
  };
  return cmocka_run_group_tests(tests, nullptr, nullptr);
}
