// SPDX-License-Identifier: MIT
#include "analysis/profile/signature.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <optional>
#include <sstream>

#include "base/error.h"
#include "linear/linear.h"
#include "noise/whiten.h"
#include "physics/effects/effect.h"

namespace imucal {

using Eigen::Index;
using Eigen::MatrixXd;

namespace {

struct SizedEffect {
  const Effect* effect;
  TypicalSize size;
  EffectSpec spec() const { return spec_of(*effect, size.parameters); }
};

// The effects that say a typical size, in the order of the tables.
std::vector<SizedEffect> sized_effects(int order) {
  std::vector<SizedEffect> list;
  for (const Effect* effect : effect_library())
    if (const std::optional<TypicalSize> size = effect->typical_size(order)) list.push_back({effect, *size});
  std::sort(list.begin(), list.end(), [](const auto& a, const auto& b) { return a.size.place < b.size.place; });
  return list;
}

} // namespace

std::vector<EffectSpec> standard_effects(int order) {
  std::vector<EffectSpec> out;
  for (const SizedEffect& sized : sized_effects(order))
    if (sized.size.is_standard) out.push_back(sized.spec());
  return out;
}

std::vector<EffectSpec> effects_by_name(const std::string& names, int order) {
  std::vector<EffectSpec> out;
  std::stringstream list(names);
  std::string name;
  const std::vector<SizedEffect> sized = sized_effects(order);
  while (std::getline(list, name, ',')) {
    const auto found = std::find_if(sized.begin(), sized.end(), [&](const SizedEffect& s) {
      return name == s.effect->name() || name == s.size.short_name;
    });
    if (found == sized.end()) {
      std::string all;
      for (const SizedEffect& s : sized) all += (all.empty() ? "" : ", ") + s.effect->name();
      throw usage_error("--tell-apart: '" + name + "' has no signature in the mean; choose from " + all);
    }
    out.push_back(found->spec());
  }
  if (out.size() < 2) throw usage_error("--tell-apart needs at least two effects, separated by commas");
  return out;
}

ThermalPolynomial standard_polynomial(const CalibrationSetup& setup) {
  return {(setup.lo_degc + setup.hi_degc) / 2, (setup.hi_degc - setup.lo_degc) / 2, {80, 300, 150, -100}};
}

// An effect that is judged, and its first parameter that is not 0: all amplitudes come first.
struct KnownEffect {
  explicit KnownEffect(const EffectSpec& spec) : effect(&find_effect(spec)), parameters(read_parameters(spec)) {
    for (const ParameterValue& value : parameters)
      if (value.kind == EffectParameter::kNumber && value.number.value != 0) {
        amplitude_name = value.name, amplitude = std::abs(value.number.value);
        break;
      }
  }
  const Effect* effect;
  Parameters parameters;
  std::string amplitude_name;
  double amplitude = 0;
};

// What the table is made from, beside the runs.
struct SignatureTask {
  CalibrationSetup setup;
  std::vector<EffectSpec> effects;
  std::vector<KnownEffect> known;
  ErrorModel model; // the setup's, with a polynomial
};

namespace {

constexpr double kLeastVisible = 1e-6; // part of a signature's energy below which no test can see it

// A noise-free sensor without any effect.
SimRun plain_run(const CalibrationRun& run, const ErrorModel& model, size_t i_run, size_t n_runs) {
  const size_t n = run.temp_degc.size();
  SimRun sim;
  sim.log = i_run;
  sim.n_logs = n_runs;
  sim.model = &model;
  sim.start = StartState::kCold; // a design has no history
  sim.t_s.resize(n);
  for (size_t k = 0; k < n; ++k)
    sim.t_s[k] = k == 0 ? run.dt_s : sim.t_s[k - 1] + (run.step_s.empty() ? run.dt_s : run.step_s[k]);
  sim.case_temp_degc = sim.gyro_temp_degc = sim.thermometer_degc = run.temp_degc;
  sim.bias = *model.bias;
  sim.rate_dph.assign(n, 0.0);
  sim.white_sigma_dph.assign(n, 0.0);
  return sim;
}

// The record of the sensor with the effect, less the nominal polynomial of its thermometer.
void add_signature(const KnownEffect& known, SimRun sim, double* out) {
  Rng rng(1, sim.log, 0, Stream::kTool);
  known.effect->simulate(SimStage::kTemperature, known.parameters, &sim, &rng);
  known.effect->simulate(SimStage::kBias, known.parameters, &sim, &rng);
  const ThermalPolynomial& nominal = *sim.model->bias;
  const bool same_curve = sim.bias.coeff_dph == nominal.coeff_dph && sim.bias.t0_degc == nominal.t0_degc &&
                          sim.bias.range_degc == nominal.range_degc;
  std::copy(sim.rate_dph.begin(), sim.rate_dph.end(), out);
  for (size_t k = 0; k < sim.rate_dph.size(); ++k) {
    const double gyro_degc = sim.gyro_temp_degc[k], shown_degc = sim.thermometer_degc[k];
    if (same_curve && gyro_degc == shown_degc) continue; // nothing but what was added
    out[k] += sim.bias.at(gyro_degc) - nominal.at(shown_degc);
  }
}

// Products of the whitened columns of one run: powers of Tn (order + 1), then a signature for each effect.  The turn-on
// constant of the run takes the place of b0 and is projected off.
MatrixXd gram_of_run(const SignatureTask& task, const std::vector<CalibrationRun>& runs, size_t r) {
  const CalibrationRun& run = runs[r];
  const Index p = task.setup.order + 1;
  MatrixXd columns(static_cast<Index>(run.temp_degc.size()), p + static_cast<Index>(task.known.size()));
  set_powers(run, task.setup, &columns);
  const SimRun plain = plain_run(run, task.model, r, runs.size());
  for (size_t e = 0; e < task.known.size(); ++e)
    add_signature(task.known[e], plain, columns.col(p + static_cast<Index>(e)).data());
  MatrixXd gram = WideColumns(columns).whitened_gram(compute_gains(sample_times(run), noise_of(task.setup.filter)));
  const Eigen::VectorXd ones = gram.col(0);
  gram -= ones * ones.transpose() / ones(0);
  return gram;
}

// Products of the signatures after the polynomial's b1 .. bM are projected off.
MatrixXd without_polynomial(const MatrixXd& gram, Index m) {
  const Index n_effects = gram.rows() - 1 - m;
  MatrixXd left = gram.bottomRightCorner(n_effects, n_effects);
  if (m > 0) {
    const MatrixXd nuisance = gram.block(1, 1, m, m), cross = gram.block(1, m + 1, m, n_effects);
    left -= cross.transpose() * solve_shortest(nuisance, cross);
  }
  return left;
}

// left: as without_polynomial; energy: of the signatures before it.
void set_strengths(const MatrixXd& left, const Eigen::VectorXd& energy, SignatureTable* table) {
  for (Index i = 0; i < left.rows(); ++i) {
    const double energy_left = std::max(0.0, left(i, i));
    table->strength.push_back(std::sqrt(energy_left));
    table->visible_frac.push_back(energy(i) > 0 ? energy_left / energy(i) : 0.0);
    if (table->visible_frac.back() < kLeastVisible)
      table->invisible.push_back(table->effects[static_cast<size_t>(i)].name);
  }
}

void set_correlations(const MatrixXd& left, SignatureTable* table) {
  const size_t n = table->effects.size();
  table->correlation.assign(n * n, 0.0);
  for (size_t i = 0; i < n; ++i) {
    for (size_t j = 0; j <= i; ++j) {
      if (table->visible_frac[i] < kLeastVisible || table->visible_frac[j] < kLeastVisible) continue;
      const double product = left(static_cast<Index>(i), static_cast<Index>(j));
      const double r = i == j ? 1.0 : product / (table->strength[i] * table->strength[j]);
      table->correlation[i * n + j] = table->correlation[j * n + i] = r;
      if (i != j && std::abs(r) > table->worst) {
        table->worst = std::abs(r);
        table->worst_a = j;
        table->worst_b = i;
      }
    }
  }
}

// Largest |correlation| of effect i with another.
double largest_correlation(const SignatureTable& table, size_t i) {
  const size_t n = table.effects.size();
  double like = 0;
  for (size_t j = 0; j < n; ++j)
    if (j != i) like = std::max(like, std::abs(table.correlation[i * n + j]));
  return like;
}

void set_separable(const std::vector<KnownEffect>& known, SignatureTable* table) {
  const size_t n = table->effects.size();
  for (size_t i = 0; i < n; ++i) {
    const double like = largest_correlation(*table, i);
    const bool visible = table->visible_frac[i] >= kLeastVisible;
    table->separable.push_back(visible ? table->strength[i] * std::sqrt(std::max(0.0, 1 - like * like)) : 0.0);
    table->amplitude.push_back(known[i].amplitude_name);
    table->needed.push_back(table->separable[i] > 0 ? known[i].amplitude * 4 / table->separable[i] : 0.0);
  }
  double sum = 0;
  for (double s : table->separable) sum += std::log(std::max(1e-6, s));
  table->mean_separable = std::exp(sum / static_cast<double>(n));
}

} // namespace

SignatureJudge::SignatureJudge(const CalibrationSetup& setup, const std::vector<EffectSpec>& effects) {
  auto task = std::make_shared<SignatureTask>();
  task->setup = setup, task->effects = effects, task->model = setup.truth;
  for (const EffectSpec& spec : effects) task->known.emplace_back(spec);
  if (!task->model.bias) task->model.bias = standard_polynomial(setup);
  task_ = std::move(task);
}

SignatureTable SignatureJudge::operator()(const std::vector<CalibrationRun>& runs) const {
  const auto size = static_cast<Index>(static_cast<size_t>(task_->setup.order) + 1 + task_->effects.size());
  MatrixXd gram = MatrixXd::Zero(size, size);
  for (size_t r = 0; r < runs.size(); ++r) gram += gram_of_run(*task_, runs, r);
  const MatrixXd left = without_polynomial(gram, task_->setup.order);
  SignatureTable table;
  table.effects = task_->effects;
  set_strengths(left, gram.diagonal().tail(left.rows()), &table);
  set_correlations(left, &table);
  set_separable(task_->known, &table);
  return table;
}

SignatureTable signature_table(const std::vector<CalibrationRun>& runs, const CalibrationSetup& setup,
                               const std::vector<EffectSpec>& effects) {
  return SignatureJudge(setup, effects)(runs);
}

} // namespace imucal
