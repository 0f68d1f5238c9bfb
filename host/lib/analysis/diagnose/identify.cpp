// SPDX-License-Identifier: MIT
#include "analysis/diagnose/identify.h"

#include <algorithm>
#include <cmath>

namespace imucal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kDetect_d = 5;   // strength at the detection limit
constexpr double kSeparate_d = 4; // d sqrt(1 - rho^2) from which two effects are told apart
constexpr double kUsual_d = 10;   // strength at which pairs are judged

struct Signal {
  size_t effect;
  Theta shape;
  double unit = 1; // size of what the column stands for (tau of a lag)
  VectorXd column; // whitened, reduced, free of the design
};

} // namespace

std::string Identifiability::not_detectable() const {
  std::string names;
  for (const Detectability& d : effects)
    if (!d.is_notable) names += (names.empty() ? "" : ", ") + d.name;
  return names;
}

Identifiability identify(const Campaign& campaign, const Hypothesis& nominal, const std::vector<const Effect*>& library,
                         const std::vector<bool>& active, const std::vector<double>& beta) {
  Identifiability out;
  ColumnBank bank(campaign, library);
  const Panel panel(&bank, nominal, PanelScope::kDesign);
  const Eigen::Map<const VectorXd> slope(beta.data(), static_cast<long>(beta.size()));
  // A replaced temperature acts by the change of B(T) it makes.
  std::vector<MatrixXd> smooth;
  for (const CampaignRun& run : campaign.runs)
    smooth.push_back(powers(run, normalised(run.input, run.input.smooth_degc), campaign.order));
  const MatrixXd unchanged = bank.whiten_and_reduce(panel.columns().gains, std::move(smooth));
  const double white = nominal.noise().white_sigma_dph;
  // Per effect: its signal at the middle of its grid, and the signals it could take instead.
  std::vector<Signal> signals;
  std::vector<std::vector<VectorXd>> repertoire;
  for (size_t j = 0; j < library.size(); ++j) {
    const EffectEstimator* estimator = library[j]->estimator();
    if (!estimator || !active[j]) continue;
    if (estimator->form() != Form::kColumns && estimator->form() != Form::kTemperature) continue;
    if (estimator->needs_temperature() && !campaign.has_temperature) continue;
    if (estimator->form() == Form::kTemperature && (estimator->shape_lo().empty() || beta.empty())) continue;
    const std::vector<Theta>& grid = bank.shapes(j);
    if (grid.empty()) continue;
    const bool is_temperature = estimator->form() == Form::kTemperature;
    const long width = is_temperature ? campaign.order : static_cast<long>(estimator->n_columns());
    const auto columns_at = [&](size_t g) -> MatrixXd {
      const MatrixXd own = panel.columns().candidates[j].middleCols(static_cast<long>(g) * width, width);
      return panel.project(is_temperature ? MatrixXd((own - unchanged) * slope) : own);
    };
    std::vector<VectorXd> own;
    const size_t middle = grid.size() / 2;
    for (size_t g = 0; g < grid.size(); g += std::max<size_t>(1, grid.size() / 30)) {
      const MatrixXd columns = columns_at(g);
      for (long c = 0; c < columns.cols(); ++c) own.push_back(columns.col(c));
    }
    Signal s;
    s.effect = j;
    s.shape = grid[middle];
    s.column = columns_at(middle).col(0);
    const double middle_energy = s.column.squaredNorm();
    Detectability d;
    d.name = library[j]->name();
    double limit;
    if (estimator->form() == Form::kTemperature) {
      s.unit = s.shape[0];
      d.smallest = middle_energy > 0 ? kDetect_d / std::sqrt(middle_energy) * std::fabs(s.unit) : 1e9;
      d.smallest_detectable = estimator->values({{d.smallest}, {}, {}, {}});
      limit = estimator->notable();
    } else {
      d.smallest = middle_energy > 0 ? kDetect_d / std::sqrt(middle_energy) : 1e9;
      std::vector<double> amplitudes(estimator->n_columns(), 0.0);
      amplitudes[0] = d.smallest;
      d.smallest_detectable = estimator->values_on(campaign.runs.front().input, {s.shape, amplitudes, {}, {}});
      limit = estimator->notable() * white;
    }
    d.is_notable = d.smallest <= limit;
    out.effects.push_back(d);
    signals.push_back(s);
    repertoire.push_back(own);
  }
  // How much of one signal another effect could take.
  const auto absorbed = [&](const VectorXd& signal, const std::vector<VectorXd>& other) {
    double best = 0;
    const double energy = signal.squaredNorm();
    for (const VectorXd& column : other) {
      const double norm = column.squaredNorm();
      if (norm > 0 && energy > 0) best = std::max(best, std::pow(column.dot(signal), 2) / norm / energy);
    }
    return best;
  };
  for (size_t i = 0; i < signals.size(); ++i)
    for (size_t j = i + 1; j < signals.size(); ++j) {
      const double rho2 =
          std::max(absorbed(signals[i].column, repertoire[j]), absorbed(signals[j].column, repertoire[i]));
      if (kUsual_d * std::sqrt(std::max(0.0, 1 - rho2)) < kSeparate_d)
        out.indistinguishable.push_back({library[signals[i].effect]->name(), library[signals[j].effect]->name()});
    }
  return out;
}

Profile separating_profile(double lo_degc, double hi_degc) {
  const double step = (hi_degc - lo_degc) / 3;
  Profile profile;
  profile.start_degc = lo_degc;
  double at = lo_degc;
  const auto soak = [&](double seconds) { profile.segments.push_back({0, seconds, at}); };
  const auto ramp = [&](double rate, double to) {
    profile.segments.push_back({rate, std::fabs(to - at) / std::fabs(rate) * 60, to});
    at = to;
  };
  soak(400);
  for (int i = 1; i <= 3; ++i) ramp(2, lo_degc + i * step), soak(500);
  for (int i = 2; i >= 1; --i) ramp(-1, lo_degc + i * step), soak(500);
  ramp(-1, lo_degc);
  soak(300);
  return profile;
}

} // namespace imucal
