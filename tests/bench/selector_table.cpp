// SPDX-License-Identifier: MIT
// What each constant of the selector does: a fixed set of simulated cases, diagnosed with the constants as they are and
// with each of them at half and at double.  Prints the tables of host/lib/analysis/diagnose/constants.md.
//   selector_table CACHE_FOLDER [constant ...]
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <string>
#include <vector>

#include "analysis/diagnose/diagnose.h"
#include "base/parallel.h"
#include "base/rng.h"
#include "io/json_file.h"
#include "physics/sim/simulate.h"

using namespace imucal;

namespace {

using Names = std::vector<std::string>;

enum class Noise { kExact, kNone };

// One question: what is in the logs, what is believed of the noise, and which names would be right.
struct Case {
  const char* what;
  std::vector<EffectSpec> effects;
  std::vector<Names> truth; // one of each group has to be among the names; empty: nothing may be named
  Noise believed = Noise::kExact;
  double drifting_dph = 0; // of a cause that is in no library: a tone of twenty minutes that grows with temperature
  size_t axes = 1;
  bool has_held_out = false;
};

EffectSpec effect(const char* name, const Json& parameters) {
  return {name, parameters};
}

const Names kMemory = {"thermal_hysteresis", "thermal_memory"}, kLag = {"thermal_lag", "thermal_memory"},
            kCurve = {"thermal_anomaly", "thermal_step", "function_of_temperature"},
            kJump = {"thermal_step", "function_of_temperature"}, kTime = {"warm_up", "function_of_time", "rate_ramp"},
            kSlow = {"rate_random_walk", "second_markov", "flicker_noise", "slow_noise"};

std::vector<Case> cases() {
  const EffectSpec loop = effect("thermal_hysteresis", {{"amplitude_dph", 25}, {"width_degc", 5}});
  const EffectSpec weak_loop = effect("thermal_hysteresis", {{"amplitude_dph", 15}, {"width_degc", 5}});
  const EffectSpec lag = effect("thermal_lag", {{"tau_s", 120}});
  const EffectSpec bump = effect("thermal_anomaly", {{"amplitude_dph", 45}, {"center_degc", 32}, {"width_degc", 2.5}});
  const EffectSpec jump = effect("thermal_step", {{"amplitude_dph", 80}, {"temp_degc", 35}, {"width_degc", 3}});
  const EffectSpec warm = effect("warm_up", {{"amplitude_dph", 220}, {"tau_s", 400}});
  const EffectSpec walk = effect("rate_random_walk", {{"k_dph_per_rt_s", 1.2}});
  const EffectSpec markov = effect("second_markov", {{"sigma_dph", 60}, {"tau_s", 900}});
  const EffectSpec hit = effect("bias_step", {{"steps", {{{"log", 1}, {"t_s", 2400}, {"amplitude_dph", 75}}}}});
  const EffectSpec tone = effect("sinusoid", {{"amplitude_dph", 7}, {"frequency_hz", 0.05}});
  const EffectSpec both = effect("common_mode", {{"correlation", 1.0}, {"sigma_dph", 10.5}});
  return {
      {"nothing", {}, {}},
      {"nothing, no model", {}, {}, Noise::kNone},
      {"weak hysteresis, no model", {weak_loop}, {kMemory}, Noise::kNone},
      {"lag, a log held out", {lag}, {kLag}, Noise::kExact, 0, 1, true},
      {"jump at a temperature", {jump}, {kJump}, Noise::kNone},
      {"jump in time", {hit}, {{"bias_step"}}},
      {"random walk", {walk}, {kSlow}},
      {"second Markov process, no model", {markov}, {kSlow}, Noise::kNone},
      {"hysteresis and warm-up", {loop, warm}, {kMemory, kTime}, Noise::kNone},
      {"anomaly and lag", {bump, lag}, {kCurve, kLag}},
      {"outside the library", {}, {}, Noise::kExact, 40},
      {"outside the library, a log held out", {}, {}, Noise::kNone, 60, 1, true},
      {"tone", {tone}, {{"sinusoid"}}},
      {"noise that two axes share", {both}, {{"common_mode"}}, Noise::kExact, 0, 2},
  };
}

// Up to 60 degC and down again with soaks; the second log begins hot.
Profile profile_of(size_t log) {
  Profile p;
  const bool is_hot = log % 2 == 1;
  p.start_degc = is_hot ? 60 : 0;
  const auto soak = [&](double s) { p.segments.push_back({0, s, 0}); };
  const auto ramp = [&](double rate, double to) { p.segments.push_back({rate, 0, to}); };
  soak(300);
  for (const double to : is_hot ? std::vector<double>{30, 0} : std::vector<double>{30, 60}) ramp(2, to), soak(400);
  for (const double to : is_hot ? std::vector<double>{25, 60} : std::vector<double>{25, 0}) ramp(1.5, to), soak(200);
  return p;
}

ErrorModel true_model() {
  ErrorModel model;
  model.arw_deg_rt_h = 0.6;
  model.markov = {{15, 100}};
  model.turn_on_sigma_dph = 30;
  model.bias = ThermalPolynomial{30, 30, {80, 300, 150, -100}};
  return model;
}

struct Drawn {
  std::vector<Log> logs, held_out;
};
Drawn draw(const Case& c, uint64_t seed) {
  Drawn out;
  const size_t n = c.has_held_out ? 3 : 2;
  for (size_t r = 0; r < n; ++r) {
    SimOptions options;
    options.seed = seed, options.log_index = r, options.n_logs = n, options.temp_noise_degc = 0.01;
    Log log = to_log(simulate({true_model()}, c.axes, profile_of(r), c.effects, options), options);
    log.path = "log " + std::to_string(r);
    Rng rng(seed, r, 0, Stream::kTool);
    const double phase = 6.2831853 * rng.uniform();
    for (size_t i = 0; i < log.size(); ++i)
      log.axes[0].rate_dph[i] +=
          c.drifting_dph * (0.5 + log.temp_degc[i] / 60) * std::sin(6.2831853 * log.t_s[i] / 1200 + phase);
    (r < 2 ? out.logs : out.held_out).push_back(std::move(log));
  }
  return out;
}

// What was said of one case.
struct Answer {
  size_t right = 0, wrong = 0; // names
  bool is_abstained = false;   // a gap is said to be there and nothing that is wrong
  std::string names;
};

Answer judge(const Case& c, const DiagnoseResult& result) {
  Answer out;
  std::vector<char> is_found(c.truth.size(), 0);
  bool has_gap = false;
  for (const AxisResult& axis : result.axes) {
    has_gap = has_gap || axis.study.selection.verdict != Verdict::kNoGap;
    for (const SelectedEffect& e : axis.study.selection.effects) {
      // That the noise is another one is a claim only where nothing is in the logs and the noise believed is the true one.
      const bool is_plain = c.effects.empty() && c.drifting_dph == 0 && c.believed == Noise::kExact;
      if (e.term.effect && e.term.estimator->is_nominal_noise() && !is_plain) continue;
      const std::string name = e.is_family || !e.term.effect ? family_name(e.family) : e.term.effect->name();
      out.names += (out.names.empty() ? "" : " ") + name + (e.doubt == Doubt::kSlowNoise ? "?" : "");
      // A family that is left open claims no cause.
      if (e.doubt == Doubt::kSlowNoise || e.doubt == Doubt::kShapeOpen) continue;
      size_t at = c.truth.size();
      for (size_t k = 0; k < c.truth.size(); ++k)
        if (std::find(c.truth[k].begin(), c.truth[k].end(), name) != c.truth[k].end()) at = k;
      if (at < c.truth.size())
        is_found[at] = 1;
      else
        ++out.wrong;
    }
  }
  out.right = static_cast<size_t>(std::count(is_found.begin(), is_found.end(), 1));
  out.is_abstained = has_gap && out.right == 0 && out.wrong == 0;
  return out;
}

struct Total {
  size_t right = 0, wrong = 0, abstained = 0, changed = 0; // changed: cases whose names are others than by default
};

class Table {
public:
  explicit Table(std::string cache) : cache_(std::move(cache)), cases_(cases()) {
    for (size_t i = 0; i < cases_.size(); ++i) drawn_.push_back(draw(cases_[i], 100 + i));
  }
  std::vector<Answer> run(const SelectorConstants& constants) const {
    std::vector<Answer> out(cases_.size());
    parallel_for(static_cast<long>(cases_.size()), 2,
                 [&](long i) { out[static_cast<size_t>(i)] = answer(static_cast<size_t>(i), constants); });
    return out;
  }
  Total total(const std::vector<Answer>& answers, const std::vector<Answer>& usual) const {
    Total t;
    for (size_t i = 0; i < answers.size(); ++i) {
      t.right += answers[i].right, t.wrong += answers[i].wrong;
      t.abstained += answers[i].is_abstained;
      t.changed += answers[i].names != usual[i].names;
    }
    return t;
  }
  const std::vector<Case>& all() const { return cases_; }

private:
  Answer answer(size_t i, const SelectorConstants& constants) const {
    const Case& c = cases_[i];
    DiagnoseOptions options;
    options.model_path = c.believed == Noise::kNone ? "" : "the case's model";
    options.cache_folder = cache_, options.constants = constants;
    return judge(c, diagnose_logs(options, true_model(), drawn_[i].logs, drawn_[i].held_out));
  }

  std::string cache_;
  std::vector<Case> cases_;
  std::vector<Drawn> drawn_;
};

std::string cell(const Total& t) {
  char text[80];
  std::snprintf(text, sizeof text, "%zu / %zu / %zu, %zu", t.right, t.wrong, t.abstained, t.changed);
  return text;
}

void print_cases(const Table& table, const std::vector<Answer>& usual) {
  size_t causes = 0;
  for (const Case& c : table.all()) causes += c.truth.size();
  std::printf("%zu cases with %zu causes; answers with the constants as they are:\n\n| case | said |\n| --- | --- |\n",
              usual.size(), causes);
  for (size_t i = 0; i < usual.size(); ++i)
    std::printf("| %s | %s |\n", table.all()[i].what, usual[i].names.empty() ? "-" : usual[i].names.c_str());
  const Total t = table.total(usual, usual);
  std::printf("\nRight names %zu, false names %zu, abstained %zu.\n", t.right, t.wrong, t.abstained);
  std::printf(
      "\nAt half and at double: right / false / abstained, cases with other names than above.\n\n"
      "| constant | value | what it decides | where from | half | double |\n| --- | --- | --- | --- | --- | --- |\n");
}

} // namespace

int main(int argc, char** argv) {
  if (argc < 2) return std::fprintf(stderr, "usage: selector_table CACHE_FOLDER [constant ...]\n"), 2;
  const Table table(argv[1]);
  const std::vector<Answer> usual = table.run({});
  print_cases(table, usual);
  for (const SelectorConstant& c : selector_constants()) {
    const auto is_named = [&](const char* a) { return std::strcmp(a, c.name) == 0; };
    if (argc > 2 && std::none_of(argv + 2, argv + argc, is_named)) continue;
    const double value = SelectorConstants().*c.value;
    std::string cells;
    for (const double factor : {0.5, 2.0}) {
      SelectorConstants changed;
      changed.*c.value = c.is_part ? std::min(1.0, factor * value) : factor * value;
      cells += cell(table.total(table.run(changed), usual)) + " | ";
    }
    std::printf("| `%s` | %g | %s | %s | %s\n", c.name, value, c.meaning, c.source, cells.c_str());
    std::fflush(stdout);
  }
  return 0;
}
