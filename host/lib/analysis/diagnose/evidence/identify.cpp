// SPDX-License-Identifier: MIT
#include "analysis/diagnose/evidence/identify.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>

namespace imucal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kDetect_d = 5;   // strength at the detection limit
constexpr double kSeparate_d = 4; // d sqrt(1 - rho^2) from which two effects are told apart
constexpr double kUsual_d = 10;   // strength at which pairs are judged
constexpr double kNever = 1e9;    // size of what no size would show
constexpr size_t kShapesTried = 30;

// The shape of a grid that lies nearest to the middle of what each of its parameters takes.
const Theta& middle_of(const std::vector<Theta>& grid) {
  std::vector<double> far(grid.size(), 0.0);
  for (size_t p = 0; p < grid.front().size(); ++p) {
    std::set<double> values;
    for (const Theta& shape : grid) values.insert(shape[p]);
    const double middle = *std::next(values.begin(), static_cast<long>(values.size() / 2));
    const double span = std::max(1e-12, *values.rbegin() - *values.begin());
    for (size_t g = 0; g < grid.size(); ++g) far[g] += std::fabs(grid[g][p] - middle) / span;
  }
  return grid[static_cast<size_t>(std::min_element(far.begin(), far.end()) - far.begin())];
}

// One effect: its signal at the middle of its grid, and the signals it could take instead.
struct Repertoire {
  std::string name;
  VectorXd signal;
  std::vector<VectorXd> all;
};

// Whitens columns of all runs and takes out what constants and polynomial explain.
class Projector {
public:
  Projector(const Campaign& campaign, const Hypothesis& nominal) : campaign_(campaign) {
    for (const CampaignRun& run : campaign.runs)
      gains_.push_back(compute_gains(run, gaussian_equivalent(nominal.noise())));
    std::vector<MatrixXd> design = make_design(campaign, nominal).x;
    for (size_t r = 0; r < design.size(); ++r) whiten(gains_[r], &design[r]);
    design_ = stacked(design) * orthonormaliser(design);
  }
  MatrixXd operator()(std::vector<MatrixXd> columns) const {
    for (size_t r = 0; r < columns.size(); ++r) whiten(gains_[r], &columns[r]);
    MatrixXd all = stacked(columns);
    all -= design_ * (design_.transpose() * all);
    return all;
  }

private:
  MatrixXd stacked(const std::vector<MatrixXd>& parts) const {
    MatrixXd all(static_cast<long>(campaign_.n()), parts.front().cols());
    long at = 0;
    for (const MatrixXd& m : parts) all.middleRows(at, m.rows()) = m, at += m.rows();
    return all;
  }
  const Campaign& campaign_;
  std::vector<RunGains> gains_;
  MatrixXd design_;
};

bool can_ask(const Campaign& campaign, const EffectEstimator& estimator, const std::vector<double>& beta) {
  if (estimator.form() != Form::kColumns && estimator.form() != Form::kTemperature) return false;
  if (estimator.needs_temperature() && !campaign.has_temperature) return false;
  return estimator.form() != Form::kTemperature || (!estimator.shape_lo().empty() && !beta.empty());
}

// Signals of an effect at one shape.  A replaced temperature acts by the change of B(T) it makes.
MatrixXd signals_at(const Campaign& campaign, const EffectEstimator& estimator, const Theta& shape,
                    const std::vector<double>& beta, const Projector& project) {
  std::vector<MatrixXd> columns;
  for (const CampaignRun& run : campaign.runs) {
    const RunInput& in = run.input;
    if (estimator.form() == Form::kColumns) {
      columns.push_back(used_rows(run, estimator.columns(in, shape)));
      continue;
    }
    const Eigen::Map<const VectorXd> slope(beta.data(), static_cast<long>(beta.size()));
    const MatrixXd moved = powers(run, normalised(in, estimator.temperature(in, shape)), campaign.order),
                   still = powers(run, normalised(in, in.smooth_degc), campaign.order);
    columns.push_back((moved - still) * slope);
  }
  return project(std::move(columns));
}

Detectability detectability(const Campaign& campaign, const EffectEstimator& estimator, const std::string& name,
                            const Theta& shape, double energy, double white_dph) {
  Detectability d;
  d.name = name;
  const bool is_temperature = estimator.form() == Form::kTemperature;
  const double unit = is_temperature ? std::fabs(shape[0]) : 1; // size of what the column stands for: tau of a lag
  d.smallest = energy > 0 ? kDetect_d / std::sqrt(energy) * unit : kNever;
  if (is_temperature) {
    d.smallest_detectable = estimator.values({{d.smallest}, {}, {}, {}});
  } else {
    std::vector<double> amplitudes(estimator.n_columns(), 0.0);
    amplitudes[0] = d.smallest;
    d.smallest_detectable = estimator.values_on(campaign.runs.front().input, {shape, amplitudes, {}, {}});
  }
  d.is_notable = d.smallest <= estimator.notable() * (is_temperature ? 1 : white_dph);
  return d;
}

// By how much the first column of an effect moves within a run, at most.
double range_within_runs(const Campaign& campaign, const EffectEstimator& estimator, const Theta& shape) {
  double range = 0;
  for (const CampaignRun& run : campaign.runs) {
    const Column column = estimator.columns(run.input, shape).front();
    const auto [lo, hi] = std::minmax_element(column.begin(), column.end());
    range = std::max(range, *hi - *lo);
  }
  return range;
}

// An effect that follows a column of the log, for each of them: what a constant of each run leaves of it, and the polynomial.
std::vector<Detectability> column_detectabilities(const Campaign& campaign, const Hypothesis& nominal,
                                                  const EffectEstimator& estimator, const std::string& name,
                                                  const std::vector<Theta>& shapes, const Projector& project) {
  Campaign without_polynomial = campaign;
  without_polynomial.order = 0;
  const Projector project_constants(without_polynomial, nominal);
  const double white_dph = nominal.noise().white_sigma_dph;
  std::vector<Detectability> out;
  for (const Theta& shape : shapes) {
    const auto told = [&](const Projector& by) {
      const double energy = signals_at(campaign, estimator, shape, {}, by).col(0).squaredNorm();
      return detectability(campaign, estimator, name, shape, energy, white_dph);
    };
    Detectability d = told(project);
    d.column = estimator.column_of(campaign.runs.front().input, shape);
    d.column_range = range_within_runs(campaign, estimator, shape);
    d.is_column_thermal = !d.is_notable && told(project_constants).is_notable;
    out.push_back(std::move(d));
  }
  return out;
}

// How much of one signal another effect could take.
double absorbed(const VectorXd& signal, const std::vector<VectorXd>& other) {
  double best = 0;
  const double energy = signal.squaredNorm();
  for (const VectorXd& column : other) {
    const double norm = column.squaredNorm();
    if (norm > 0 && energy > 0) best = std::max(best, std::pow(column.dot(signal), 2) / norm / energy);
  }
  return best;
}

} // namespace

Identifiability identify(const Campaign& campaign, const Hypothesis& nominal, const std::vector<const Effect*>& library,
                         const std::vector<bool>& active, const std::vector<double>& beta) {
  Identifiability out;
  const Projector project(campaign, nominal);
  std::vector<Repertoire> list;
  for (size_t j = 0; j < library.size(); ++j) {
    const EffectEstimator* estimator = library[j]->estimator();
    if (!estimator || !active[j] || !can_ask(campaign, *estimator, beta)) continue;
    const std::vector<Theta> grid = estimator->grid_on(campaign.runs.front().input, campaign.lo_degc, campaign.hi_degc);
    if (grid.empty()) continue;
    Repertoire own{library[j]->name(), {}, {}};
    for (size_t g = 0; g < grid.size(); g += std::max<size_t>(1, grid.size() / kShapesTried)) {
      const MatrixXd columns = signals_at(campaign, *estimator, grid[g], beta, project);
      for (long c = 0; c < columns.cols(); ++c) own.all.push_back(columns.col(c));
    }
    const Theta& middle = middle_of(grid);
    own.signal = signals_at(campaign, *estimator, middle, beta, project).col(0);
    std::vector<Detectability> told;
    if (estimator->column_of(campaign.runs.front().input, middle).empty())
      told = {detectability(campaign, *estimator, own.name, middle, own.signal.squaredNorm(),
                            nominal.noise().white_sigma_dph)};
    else
      told = column_detectabilities(campaign, nominal, *estimator, own.name, grid, project);
    out.effects.insert(out.effects.end(), told.begin(), told.end());
    list.push_back(std::move(own));
  }
  for (size_t i = 0; i < list.size(); ++i)
    for (size_t j = i + 1; j < list.size(); ++j) {
      const double rho2 = std::max(absorbed(list[i].signal, list[j].all), absorbed(list[j].signal, list[i].all));
      if (kUsual_d * std::sqrt(std::max(0.0, 1 - rho2)) < kSeparate_d)
        out.indistinguishable.push_back(
            {list[i].name, list[j].name, kSeparate_d / std::sqrt(std::max(0.0, 1 - rho2)) / kDetect_d});
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

Profile mirrored(Profile profile, double lo_degc, double hi_degc) {
  const double both = lo_degc + hi_degc;
  profile.start_degc = both - profile.start_degc;
  for (ProfileSegment& segment : profile.segments)
    segment.rate_degc_per_min = -segment.rate_degc_per_min, segment.to_degc = both - segment.to_degc;
  return profile;
}

Campaign advised_campaign(const Campaign& campaign, size_t n_runs) {
  Campaign out = campaign;
  out.runs.clear();
  const Profile profile = separating_profile(campaign.lo_degc, campaign.hi_degc),
                back = mirrored(profile, campaign.lo_degc, campaign.hi_degc);
  for (size_t r = 0; r < n_runs; ++r) {
    CampaignRun run;
    run.own_white_dph2 = campaign.runs[r % campaign.runs.size()].own_white_dph2;
    RunInput& in = run.input;
    in.log = r, in.dt_s = campaign.dt_s, in.t0_degc = campaign.t0_degc, in.range_degc = campaign.range_degc;
    in.lo_degc = campaign.lo_degc, in.hi_degc = campaign.hi_degc, in.order = campaign.order;
    in.temp_degc = (r % 2 ? back : profile).temperatures(campaign.dt_s);
    in.smooth_degc = in.temp_degc, in.tn = normalised(in, in.temp_degc);
    in.rate_dph.assign(in.temp_degc.size(), 0.0);
    for (size_t i = 0; i < in.temp_degc.size(); ++i) {
      const size_t before = i ? i - 1 : 0, after = std::min(i + 1, in.temp_degc.size() - 1);
      in.tick.push_back(static_cast<long>(i)), in.t_s.push_back(static_cast<double>(i) * campaign.dt_s);
      in.rate_degc_min.push_back((in.temp_degc[after] - in.temp_degc[before]) * 60 /
                                 (static_cast<double>(std::max<size_t>(1, after - before)) * campaign.dt_s));
    }
    find_used(&run);
    out.runs.push_back(std::move(run));
  }
  return out;
}

} // namespace imucal
