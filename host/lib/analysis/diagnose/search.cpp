// SPDX-License-Identifier: MIT
#include "analysis/diagnose/search.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "analysis/diagnose/blocks.h"
#include "analysis/diagnose/fit.h"
#include "base/rng.h"

namespace imucal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kDensityFactors[] = {0.5, 1.0, 1.6};     // nodes: slow density, and
constexpr double kTauFactors[] = {0.04, 0.12, 0.35, 1.0}; // time constant, about the fit without a name
constexpr double kStartTaus_s[] = {100, 1000};
constexpr double kUsualTau_s = 300;
constexpr size_t kNoisesBeside = 2, kNoiseBases = 4;
constexpr size_t kPolished = 7, kPairBases = 6, kPairNodes = 6, kPairsPolished = 6, kPartners = 3;
constexpr int kEvaluations = 110, kQuickEvaluations = 60, kProbeEvaluations = 25;
constexpr double kHiddenTau_s = 5; // of a process that white noise may have swallowed
constexpr int kPasses = 3;         // of neighbours of a shape
constexpr size_t kPairsTried = 10, kAddedTried = 4;
constexpr int kRounds = 2;               // of exchanges
constexpr double kWorthwhile_nats = 0.5; // that a round has to gain for another one
constexpr size_t kMostNames = 3;
constexpr size_t kMembersTried = 3; // in the place of a free shape
constexpr double kMemberPart = 0.4; // of its gain, on the places of the grids
constexpr size_t kPartsKept = 12, kColumnsKept = 4, kNodesKept = 2;
const char kCalibrationVersion[] = "8"; // changes whenever a draw would gain something else
constexpr size_t kMostSteps = 6, kStepPlaces = 12;

// Standard deviations of the weak prior of log(white), log(slow density), log(tau).
struct NoisePrior {
  double centre[3] = {0, 0, 0}, sd[3] = {1.5, 3, 2};
  double at(const double* x) const {
    double sum = 0;
    for (int i = 0; i < 3; ++i) sum -= 0.5 * std::pow((x[i] - centre[i]) / sd[i], 2);
    return sum;
  }
};

NoiseModel scaled(const NoiseModel& base, const double* x) {
  NoiseModel out = base;
  out.white_sigma_dph *= std::exp(x[0]);
  for (Markov& m : out.markov) m.tau_s *= std::exp(x[2]), m.sigma_dph *= std::exp(0.5 * (x[1] + x[2]));
  return out;
}

double log_sum_exp(const std::vector<double>& x) {
  const double top = *std::max_element(x.begin(), x.end());
  double sum = 0;
  for (double v : x) sum += std::exp(v - top);
  return top + std::log(sum);
}
double log_mean_exp(const std::vector<double>& x) {
  return log_sum_exp(x) - std::log(static_cast<double>(x.size()));
}

} // namespace

Theta left_by_swallowed() {
  constexpr double kSigma = 0.3, kTau = 0.1;
  return {0, std::log(kSigma * kSigma / kTau), std::log(kTau)};
}
const Markov& slowest(const NoiseModel& noise) {
  return *std::max_element(noise.markov.begin(), noise.markov.end(),
                           [](const Markov& a, const Markov& b) { return a.tau_s < b.tau_s; });
}

SlowModel SlowModel::without(size_t name) const {
  SlowModel less = *this;
  less.names.erase(less.names.begin() + static_cast<long>(name));
  return less;
}
void SlowModel::take_noise_of(const SlowModel& other) {
  std::copy(other.log_noise, other.log_noise + 3, log_noise);
  is_believed = other.is_believed;
}
double SlowModel::charges() const {
  double sum = noise_effect ? noise_charge : 0;
  for (const Name& name : names) sum += name.charge;
  return sum;
}

struct SlowSearch::Impl {
  const SlowData& data;
  NoiseBelief belief;
  SelectorConstants constants;
  NoiseModel base; // what the factors of a hypothesis act on
  NoisePrior prior;
  std::vector<Candidate> candidates;
  std::vector<const Effect*> noise_effects;
  std::unique_ptr<ScanBank> bank;
  struct Node {
    SlowModel at; // its noise
    std::unique_ptr<ScanNode> scan;
  };
  std::vector<Node> nodes;
  double longest_tau_s = 1e4;
  const EffectEstimator* steps = nullptr; // of jumps, where they may be named
  SlowResult out;

  Impl(const SlowData& d, const NoiseBelief& b, const std::vector<const Effect*>& library,
       const std::vector<bool>& active, const SelectorConstants& c)
      : data(d), belief(b), constants(c) {
    set_noise();
    set_candidates(library, active);
  }

  void set_noise() {
    double longest = 0;
    for (const CampaignRun& run : data.campaign.runs) longest = std::max(longest, run.input.t_s.back());
    longest_tau_s = std::max(3 * longest, 1000.0);
    base = belief.model;
    if (base.markov.empty()) base.markov.push_back({data.spread_dph, kUsualTau_s});
    if (!(base.markov[0].sigma_dph > 0)) base.markov[0].sigma_dph = data.spread_dph;
    if (belief.has_data_sheet) {
      prior.sd[0] = 0.7, prior.sd[1] = 1.4, prior.sd[2] = 1;
      return;
    }
    const double white = white_between_samples(data.campaign);
    if (!(base.white_sigma_dph > 0)) base.white_sigma_dph = std::max(white, 1e-6);
    if (white > 0) prior.centre[0] = std::log(white / base.white_sigma_dph);
    const Markov& m = base.markov[0];
    prior.centre[1] = std::log(std::pow(data.spread_dph / m.sigma_dph, 2) * m.tau_s / kUsualTau_s);
    prior.centre[2] = std::log(kUsualTau_s / m.tau_s);
  }

  bool can_ask(const EffectEstimator& estimator) const {
    const Form form = estimator.form();
    if (form != Form::kColumns && form != Form::kTemperature && form != Form::kRunRandom) return false;
    if (form == Form::kRunRandom && data.campaign.runs.size() < 2) return false;
    if (estimator.needs_temperature() && (!data.campaign.has_temperature || data.campaign.order < 1)) return false;
    return !(estimator.concerns_coarse_thermometer() && !(data.campaign.temp_lsb_degc > 0));
  }

  // A kind of slow noise that the block means can show: Gaussian ones.
  bool is_slow_kind(const EffectEstimator& e) const {
    if (e.form() != Form::kNoise || !e.is_slow_noise() || e.is_nominal_noise()) return false;
    // One run passes each temperature once or twice: noise that follows it cannot be told from noise that changes.
    if (e.needs_temperature() && (!data.campaign.has_temperature || data.campaign.runs.size() < 2)) return false;
    const std::vector<Theta> starts = e.starts(base);
    return !starts.empty() && !e.noise(base, starts.front()).is_mixture();
  }

  void set_candidates(const std::vector<const Effect*>& library, const std::vector<bool>& active) {
    for (size_t j = 0; j < library.size(); ++j) {
      const EffectEstimator* estimator = library[j]->estimator();
      if (estimator && estimator->form() == Form::kSteps) steps = active[j] ? estimator : nullptr;
      if (!estimator || !active[j]) continue;
      if (is_slow_kind(*estimator)) noise_effects.push_back(library[j]);
      if (!can_ask(*estimator)) continue;
      Candidate c;
      c.effect = library[j], c.place = j;
      c.scan.estimator = estimator;
      c.scan.shapes = shapes_of(*estimator);
      if (!c.scan.shapes.empty()) candidates.push_back(std::move(c));
    }
    for (size_t j = 0; j < free_shapes().size(); ++j) {
      const Reference& free = free_shapes()[j];
      // In one run anything is a function of the time.
      if (!can_ask(*free.candidate.estimator) ||
          (free.family == Family::kFunctionOfTime && data.campaign.runs.size() < 2))
        continue;
      Candidate c;
      c.reference = &free, c.place = j, c.scan = free.candidate;
      c.scan.shapes = {{longest_tau_s / 3}};
      candidates.push_back(std::move(c));
    }
    std::vector<ScanCandidate> scans;
    for (const Candidate& c : candidates) scans.push_back(c.scan);
    bank.reset(new ScanBank(data, scans));
    if (!data.campaign.has_temperature || data.campaign.order < 1) return;
    Candidate all;
    all.is_free_function = true;
    all.reference = &free_function(data.campaign.runs.size() > 1);
    all.scan = all.reference->candidate;
    all.scan.shapes = free_function_shapes(data.campaign, longest_tau_s / 3);
    candidates.push_back(std::move(all));
  }
  std::vector<Theta> shapes_of(const EffectEstimator& estimator) const {
    const RunInput& run = data.campaign.runs.front().input;
    if (estimator.form() == Form::kRunRandom) return {{data.spread_dph}};
    std::vector<Theta> grid = estimator.grid_on(run, data.campaign.lo_degc, data.campaign.hi_degc);
    if (estimator.concerns_coarse_thermometer()) grid = {{data.campaign.temp_lsb_degc}};
    if (estimator.is_near_thermometer()) grid = at_nearby_lags(grid);
    grid.erase(std::remove_if(grid.begin(), grid.end(), [&](const Theta& at) { return !is_repeated(estimator, at); }),
               grid.end());
    return grid;
  }
  static std::vector<Theta> at_nearby_lags(const std::vector<Theta>& grid) {
    std::vector<Theta> out;
    for (double part : {-0.5, 0.0, 0.5})
      for (Theta shape : grid) {
        shape.push_back(part * EffectEstimator::kNearby_s);
        out.push_back(shape);
      }
    return out;
  }
  bool is_repeated(const EffectEstimator& estimator, const Theta& shape) const {
    std::vector<const RunInput*> runs;
    for (const CampaignRun& run : data.campaign.runs) runs.push_back(&run.input);
    return estimator.is_repeated(runs, shape);
  }

  // ---- one hypothesis

  NoiseModel base_noise(const SlowModel& m) const {
    NoiseModel noise = m.is_believed ? belief.model : scaled(base, m.log_noise);
    for (Markov& markov : noise.markov)
      markov.tau_s = std::clamp(markov.tau_s, std::min(1.0, data.campaign.dt_s), longest_tau_s);
    return noise;
  }
  NoiseModel noise(const SlowModel& m) const { return block_equivalent(seconds_noise(m), data.campaign.dt_s); }
  NoiseModel seconds_noise(const SlowModel& m) const {
    const NoiseModel plain = base_noise(m);
    return m.noise_effect ? m.noise_effect->estimator()->noise(plain, m.noise_theta) : plain;
  }
  using Part = std::shared_ptr<const MeanPart>;
  // Polishing the noise asks for the same columns again and again.
  Part part_at(size_t candidate, const Theta& shape) const {
    for (const Kept& kept : kept_parts)
      if (kept.candidate == candidate && kept.shape == shape) return kept.part;
    if (kept_parts.size() < kPartsKept) kept_parts.emplace_back();
    Kept& place = kept_parts[next_part++ % kPartsKept];
    place = {candidate, shape, std::make_shared<const MeanPart>(part_of(data, candidates[candidate].scan, shape))};
    return place.part;
  }
  struct Kept {
    size_t candidate = 0;
    Theta shape;
    Part part;
  };
  mutable std::vector<Kept> kept_parts;
  mutable size_t next_part = 0;

  // The parts of a hypothesis on the data searched.
  std::vector<Part> parts(const SlowModel& m) const {
    SlowModel beside = m;
    beside.names.clear();
    std::vector<Part> list;
    for (MeanPart& part : parts_on(data, beside)) list.push_back(std::make_shared<const MeanPart>(std::move(part)));
    for (const SlowModel::Name& name : m.names) list.push_back(part_at(name.candidate, name.shape));
    return list;
  }
  static std::vector<const MeanPart*> pointers_of(const std::vector<Part>& list) {
    std::vector<const MeanPart*> pointers;
    for (const Part& part : list) pointers.push_back(part.get());
    return pointers;
  }
  std::vector<MeanPart> parts_on(const SlowData& where, const SlowModel& m) const {
    std::vector<MeanPart> list;
    for (const NoiseBelief::Known& known : belief.known)
      if (!m.is_without_lines || known.estimator->form() != Form::kTone)
        list.push_back(start_part(where, *known.estimator, known.shape));
    if (!m.steps.empty()) {
      Theta all;
      for (const Theta& step : m.steps) all.insert(all.end(), step.begin(), step.end());
      list.push_back(mean_part(where, *steps, all));
    }
    for (const SlowModel::Name& name : m.names)
      list.push_back(name.is_start_only ? start_part(where, *candidates[name.candidate].scan.estimator, name.shape)
                                        : part_of(where, candidates[name.candidate].scan, name.shape));
    return list;
  }

  // The columns of the last hypotheses: their noise is varied again and again.
  using Columns = std::shared_ptr<const MeanColumns>;
  Columns columns(const SlowModel& m) const {
    std::vector<Theta> key = m.steps;
    for (const SlowModel::Name& name : m.names)
      key.push_back({static_cast<double>(name.candidate)}), key.push_back(name.shape);
    for (const KeptColumns& kept : kept_columns)
      if (kept.n_names == m.names.size() && kept.key == key) return kept.columns;
    const std::vector<Part> own = parts(m);
    if (kept_columns.size() < kColumnsKept) kept_columns.emplace_back();
    KeptColumns& place = kept_columns[next_columns++ % kColumnsKept];
    place = {m.names.size(), key, std::make_shared<const MeanColumns>(data, pointers_of(own))};
    return place.columns;
  }
  struct KeptColumns {
    size_t n_names = 0;
    std::vector<Theta> key; // steps; candidate and shape of each name
    Columns columns;
  };
  mutable std::vector<KeptColumns> kept_columns;
  mutable size_t next_columns = 0;

  RunGrams grams(const SlowModel& m) const { return RunGrams(data, *columns(m), noise(m)); }
  double noise_value(const SlowModel& m) const {
    // Another kind of noise beside the believed one is other than believed too.
    if (m.is_believed) return m.noise_effect ? -constants.reestimated_nats : 0;
    return prior.at(m.log_noise) - (belief.has_believed ? constants.reestimated_nats : 0);
  }
  double evaluate(const SlowModel& m) const {
    for (const SlowModel::Name& name : m.names)
      if (const Candidate& c = candidates[name.candidate]; c.effect && !is_repeated(*c.scan.estimator, name.shape))
        return -1e300;
    return grams(m).log_marginal_any_scale() + noise_value(m);
  }

  // ---- search over noise and shape parameters of one hypothesis

  struct Axis {
    double* value;
    double step, lo, hi;
    bool is_log;
  };
  // First step of a shape parameter: half the way to the next value of the grid that was scanned.
  double first_step(const Candidate& c, size_t i, double value) const {
    double nearest = 1e300;
    for (const Theta& shape : c.scan.shapes)
      if (const double way = std::fabs(shape[i] - value); way > 1e-9) nearest = std::min(nearest, way);
    const double usual = 0.15 * std::fabs(value);
    return std::max(0.05, nearest < 1e299 ? 0.5 * nearest : usual);
  }
  std::vector<Axis> axes_of(SlowModel* m) const {
    std::vector<Axis> axes;
    if (!m->is_believed)
      for (double& x : m->log_noise) axes.push_back({&x, 0.4, -15, 15, false});
    if (m->noise_effect) {
      const EffectEstimator& e = *m->noise_effect->estimator();
      for (size_t i = 0; i < m->noise_theta.size(); ++i)
        axes.push_back(
            {&m->noise_theta[i], e.is_logarithmic() ? 0.4 : 0.3, e.theta_lo()[i], e.theta_hi()[i], e.is_logarithmic()});
    }
    for (SlowModel::Name& name : m->names) {
      const EffectEstimator& e = *candidates[name.candidate].scan.estimator;
      const double near_s = EffectEstimator::kNearby_s;
      if (e.is_near_thermometer()) axes.push_back({&name.shape.back(), 0.25 * near_s, -near_s, near_s, false});
      if (!candidates[name.candidate].effect || e.shape_lo().size() != name.shape.size()) continue;
      for (size_t i = 0; i < name.shape.size(); ++i)
        axes.push_back({&name.shape[i], first_step(candidates[name.candidate], i, name.shape[i]), e.shape_lo()[i],
                        e.shape_hi()[i], false});
    }
    return axes;
  }

  void polish(SlowModel* m, int evaluations) const {
    std::vector<Axis> axes = axes_of(m);
    Theta x, lo, hi;
    for (const Axis& a : axes) {
      const auto inward = [&](double v) { return (a.is_log ? std::log(v) : v) / a.step; };
      x.push_back(inward(*a.value)), lo.push_back(inward(a.lo)), hi.push_back(inward(a.hi));
    }
    const auto set = [&](const Theta& at) {
      for (size_t i = 0; i < axes.size(); ++i)
        *axes[i].value = axes[i].is_log ? std::exp(at[i] * axes[i].step) : at[i] * axes[i].step;
    };
    if (!axes.empty()) {
      SearchOptions options;
      options.step = 1, options.max_evaluations = evaluations, options.tolerance = 0.02;
      maximise(
          [&](const Theta& at) {
            set(at);
            return evaluate(*m);
          },
          &x, lo, hi, options);
      set(x);
    }
    m->value = evaluate(*m);
    mark_bounds(m);
  }
  void mark_bounds(SlowModel* m) const {
    for (SlowModel::Name& name : m->names) {
      const EffectEstimator& e = *candidates[name.candidate].scan.estimator;
      name.is_at_bound = false;
      if (!candidates[name.candidate].effect || e.shape_lo().size() != name.shape.size()) continue;
      for (size_t i = 0; i < name.shape.size(); ++i) {
        const double margin = 1e-3 * (e.shape_hi()[i] - e.shape_lo()[i]);
        // A lower bound of zero is where the physics ends, not where the search does.
        const bool is_low = e.shape_lo()[i] != 0 && name.shape[i] < e.shape_lo()[i] + margin;
        if (is_low || name.shape[i] > e.shape_hi()[i] - margin) name.is_at_bound = true;
      }
    }
  }
  // The same names with the noise as believed, where something is believed: the better of the two.
  SlowModel polished(SlowModel m, int evaluations = kQuickEvaluations) const {
    if (belief.has_believed) {
      SlowModel believed = m;
      believed.is_believed = true;
      polish(&believed, evaluations / 2);
      m.is_believed = false;
      polish(&m, evaluations);
      return believed.value > m.value ? believed : m;
    }
    polish(&m, evaluations);
    return m;
  }
  // From the best of its own starts: beside re-estimated noise it may have faded away.
  SlowModel beside_believed(SlowModel m) const {
    m.is_believed = true;
    m.value = -1e300;
    SlowModel best = m;
    for (const Theta& theta : m.noise_effect->estimator()->starts(base_noise(m))) {
      m.noise_theta = theta;
      polish(&m, kQuickEvaluations);
      if (m.value > best.value) best = m;
    }
    return best;
  }

  // ---- scans

  SlowModel fit_null(const std::vector<Theta>& jumps) const {
    SlowModel best;
    for (double tau : kStartTaus_s) {
      SlowModel m;
      m.steps = jumps;
      m.log_noise[0] = prior.centre[0];
      m.log_noise[1] = prior.centre[1];
      m.log_noise[2] = std::log(tau / base.markov[0].tau_s);
      polish(&m, kEvaluations);
      if (m.value > best.value) best = m;
    }
    return best;
  }
  void make_nodes(const SlowModel& about) {
    nodes.clear();
    for (double q : kDensityFactors)
      for (double t : kTauFactors) {
        SlowModel m = about;
        m.is_believed = false;
        m.log_noise[1] += std::log(q), m.log_noise[2] += std::log(t);
        nodes.push_back({m, std::make_unique<ScanNode>(*bank, noise(m))});
      }
    if (belief.has_believed) {
      SlowModel m = about;
      m.is_believed = true;
      nodes.push_back({m, std::make_unique<ScanNode>(*bank, noise(m))});
    }
  }

  // The noise of a hypothesis, its kind of slow noise included, is seldom near that of a node: a node of its own.
  // What differs from a hypothesis in its names has the same one.
  using OwnNode = std::shared_ptr<const Node>;
  OwnNode node_of(const SlowModel& m) const {
    const NoiseModel own = noise(m);
    for (const OwnNode& kept : kept_nodes)
      if (kept->at.noise_effect == m.noise_effect && kept->at.is_believed == m.is_believed &&
          kept->scan->noise() == own)
        return kept;
    if (kept_nodes.size() < kNodesKept) kept_nodes.emplace_back();
    OwnNode& place = kept_nodes[next_node++ % kNodesKept];
    place = std::make_shared<const Node>(Node{m, std::make_unique<ScanNode>(*bank, own, true)});
    return place;
  }
  mutable std::vector<OwnNode> kept_nodes;
  mutable size_t next_node = 0;

  // Every candidate added to `m`, noise by node, shapes on their grids.
  std::vector<SlowCandidateScore> scan(const SlowModel& m, const std::vector<const Node*>& where,
                                       bool only_free = false) const {
    std::vector<char> skip(candidates.size(), 0);
    for (size_t j = 0; j < candidates.size(); ++j) skip[j] = only_free && candidates[j].effect ? 1 : 0;
    for (const SlowModel::Name& name : m.names) skip[name.candidate] = 1;
    const std::vector<Part> own = parts(m);
    const std::vector<const MeanPart*> pointers = pointers_of(own);
    std::vector<SlowCandidateScore> best(candidates.size());
    for (SlowCandidateScore& b : best) b.gain_nats = -1e300;
    for (const Node* node : where) {
      const ScanNode::Scores scores = node->scan->score(pointers, skip);
      take_best(m, *node, scores, &best);
    }
    return best;
  }
  void take_best(const SlowModel& m, const Node& node, const ScanNode::Scores& scores,
                 std::vector<SlowCandidateScore>* best) const {
    std::vector<std::vector<double>> values(candidates.size());
    std::vector<size_t> top(candidates.size(), 0);
    for (size_t g = 0; g < bank->groups().size(); ++g) {
      const size_t j = bank->groups()[g].candidate;
      const double v = scores.group(static_cast<long>(g), 0);
      if (v < -1e299) continue;
      if (values[j].empty() || v > *std::max_element(values[j].begin(), values[j].end())) top[j] = g;
      values[j].push_back(v);
    }
    for (size_t j = 0; j < candidates.size(); ++j) {
      if (values[j].empty()) continue;
      const double mean = log_mean_exp(values[j]) + noise_value(node.at);
      if (mean <= (*best)[j].gain_nats) continue;
      SlowCandidateScore& b = (*best)[j];
      b.gain_nats = mean;
      b.model = m;
      b.model.take_noise_of(node.at);
      if (node.at.noise_effect) b.model.noise_theta = node.at.noise_theta;
      b.model.value = *std::max_element(values[j].begin(), values[j].end()) + noise_value(node.at);
      b.model.names.push_back({j, bank->groups()[top[j]].shape, b.model.value - mean, false});
    }
  }
  std::vector<const Node*> all_nodes() const {
    std::vector<const Node*> list;
    for (const Node& node : nodes) list.push_back(&node);
    return list;
  }
  // The nodes where the hypothesis is likely.
  std::vector<const Node*> likely_nodes(const SlowModel& m) const {
    const Columns own = columns(m);
    std::vector<std::pair<double, const Node*>> ranked;
    for (const Node& node : nodes)
      ranked.push_back({RunGrams(data, *own, noise(node.at)).log_marginal_any_scale() + noise_value(node.at), &node});
    std::sort(ranked.begin(), ranked.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
    std::vector<const Node*> list;
    for (size_t i = 0; i < ranked.size() && i < kPairNodes; ++i) list.push_back(ranked[i].second);
    return list;
  }
  // `own` and, where it has no kind of slow noise that the others lack, the nodes where `likely` is likely.
  std::vector<const Node*> nodes_with(const Node& own, const SlowModel& likely) const {
    std::vector<const Node*> list;
    if (!own.at.noise_effect) list = likely_nodes(likely);
    list.push_back(&own);
    return list;
  }

  // The best neighbour of the last name's shape, again and again while it gains.
  void approach(SlowModel* m) const {
    const Candidate& c = candidates[m->names.back().candidate];
    if (!c.effect || c.scan.shapes.size() < 2) return;
    const SlowModel from = *m;
    const double spacing = std::fabs(c.scan.shapes[1][0] - c.scan.shapes[0][0]);
    double highest = evaluate(*m);
    for (int pass = 0; pass < kPasses; ++pass) {
      SlowModel best = *m;
      for (const Theta& shape : c.scan.estimator->neighbours(m->names.back().shape, spacing)) {
        SlowModel near = *m;
        near.names.back().shape = shape;
        if (const double value = evaluate(near); value > highest) highest = value, best = near;
      }
      if (best.names.back().shape == m->names.back().shape) break;
      *m = best;
    }
    if (m->names.back().shape != from.names.back().shape) charge_finer(from, highest, spacing, m);
  }
  // A shape found between the places of the grid is one of many more.  The mean of the likelihood over shapes is that
  // over the grid and, in the cell about the shape, that over its neighbours; the charge is the maximum over this mean.
  void charge_finer(const SlowModel& from, double highest, double spacing, SlowModel* m) const {
    SlowModel::Name& name = m->names.back();
    const Candidate& c = candidates[name.candidate];
    std::vector<double> first = {highest}, others = {highest}; // first parameter moved, or another
    for (const Theta& shape : c.scan.estimator->neighbours(name.shape, spacing)) {
      double way = 0;
      for (size_t i = 0; i < shape.size(); ++i) way = std::max(way, std::fabs(shape[i] - name.shape[i]));
      if (way > 0.51 * spacing) continue;
      SlowModel near = *m;
      near.names.back().shape = shape;
      (shape[0] != name.shape[0] ? first : others).push_back(evaluate(near));
    }
    const double cell = log_mean_exp(first) + log_mean_exp(others) - highest; // mean over the cell
    const double grid = from.value - from.names.back().charge;                // mean over the grid
    name.charge = highest - log_sum_exp({grid, cell - std::log(static_cast<double>(c.scan.shapes.size()))});
    m->value = highest;
  }
  // A jump between two places of the grid may gain next to nothing on either.  A candidate that jumps is also tried where
  // the innovations beside `m` are largest, and taken where it alone does better than `in_time`, which jumps at times.
  void try_jumps(const SlowModel& m, const SlowModel& in_time, std::vector<SlowCandidateScore>* scores) const {
    std::vector<JumpPlace> places;
    for (SlowCandidateScore& s : *scores) {
      if (s.model.names.size() != m.names.size() + 1) continue;
      const Candidate& c = candidates[s.model.names.back().candidate];
      if (!c.effect || !c.scan.estimator->can_jump()) continue;
      if (places.empty()) places = likely_jumps(m);
      SlowModel found = best_of(m, s.model, c.scan.estimator->shapes_of_jumps(places));
      if (found.names.empty()) continue;
      approach(&found);
      found = polished(found);
      if (score(found) > score(in_time) && found.free_score() > s.gain_nats)
        s.model = found, s.gain_nats = found.free_score();
    }
  }
  // `with` at the best of these shapes, with the noise of `m`: it counts as one of the shapes of the grid, which are
  // compared under that noise.
  SlowModel best_of(const SlowModel& m, const SlowModel& with, const std::vector<Theta>& shapes) const {
    SlowModel best, of_grid = m;
    of_grid.names.push_back(with.names.back());
    for (const Theta& shape : shapes) {
      SlowModel at = m;
      at.names.push_back(with.names.back());
      at.names.back().shape = shape;
      at.value = evaluate(at);
      if (at.value > best.value) best = at;
    }
    if (best.names.empty()) return best;
    const double n = static_cast<double>(candidates[best.names.back().candidate].scan.shapes.size());
    const double grid = evaluate(of_grid) - with.names.back().charge;
    best.names.back().charge = best.value - log_sum_exp({grid, best.value - std::log(n)});
    return best;
  }

  // How far below the best, which gains so much, a place of the grid is still polished.
  double near_nats(double gain_nats) const { return std::max(constants.near_nats, constants.near_part * gain_nats); }
  // Polishes the best of a scan; the others keep their values from the grid.
  void polish_best(std::vector<SlowCandidateScore>* scores, size_t count, double floor, int evaluations) const {
    std::vector<size_t> order(scores->size());
    for (size_t j = 0; j < order.size(); ++j) order[j] = j;
    std::sort(order.begin(), order.end(),
              [&](size_t a, size_t b) { return (*scores)[a].gain_nats > (*scores)[b].gain_nats; });
    const double best = order.empty() ? 0 : (*scores)[order[0]].gain_nats;
    for (size_t i = 0; i < order.size() && i < count; ++i) {
      SlowCandidateScore& s = (*scores)[order[i]];
      if (s.model.names.empty() || s.gain_nats < floor || s.gain_nats < best - near_nats(best - floor)) break;
      approach(&s.model);
      s.model = polished(s.model, evaluations);
      s.gain_nats = s.model.free_score();
    }
  }

  static void sort_by_gain(std::vector<SlowCandidateScore>* scores) {
    std::sort(scores->begin(), scores->end(), [](const auto& a, const auto& b) { return a.gain_nats > b.gain_nats; });
  }
  // Free shapes beside `m`, best first.
  std::vector<SlowCandidateScore> free_beside(const SlowModel& m, size_t most) const {
    std::vector<SlowCandidateScore> list;
    for (SlowCandidateScore& s : scan(m, likely_nodes(m), true))
      if (!s.model.names.empty() && s.gain_nats > -1e299) list.push_back(std::move(s));
    sort_by_gain(&list);
    if (list.size() > most) list.resize(most);
    for (SlowCandidateScore& s : list)
      if (s.gain_nats > m.free_score() - constants.near_nats) {
        s.model = polished(s.model, kQuickEvaluations);
        s.gain_nats = s.model.free_score();
      }
    sort_by_gain(&list);
    return list;
  }

  // A kind of noise at the best of these starts.
  SlowModel best_with_noise(const std::vector<SlowModel>& starts, const Effect& kind) const {
    SlowModel best;
    for (SlowModel with : starts) {
      with.noise_effect = &kind, with.noise_charge = constants.noise_kind_nats;
      with.value = evaluate(with);
      if (with.value > best.value) best = with;
    }
    return best;
  }
  // The noise of `m` may have swallowed what this kind is.  It then starts like half of the white noise, like the slowest
  // process beside what a smaller and faster one leaves, or like that one beside the noise as believed.
  SlowModel at_hidden_start(const SlowModel& m, const Effect& kind) const {
    SlowModel free = m;
    free.is_believed = false;
    const NoiseModel own = base_noise(free);
    if (own.markov.empty()) return {};
    const Theta slow = kind.estimator()->like(slowest(own));
    const double white = own.white_sigma_dph * std::sqrt(0.5);
    const Theta fast = kind.estimator()->like({white / std::sqrt(2 * kHiddenTau_s), kHiddenTau_s});
    if (slow.empty()) return {};
    SlowModel quieter = free, less = free, believed = m;
    quieter.log_noise[0] += std::log(white / own.white_sigma_dph);
    const Theta left = left_by_swallowed();
    for (size_t i = 0; i < left.size(); ++i) less.log_noise[i] += left[i];
    quieter.noise_theta = fast, less.noise_theta = believed.noise_theta = slow;
    if (!belief.has_believed || belief.model.markov.empty()) return best_with_noise({quieter, less}, kind);
    believed.is_believed = true;
    std::fill(believed.log_noise, believed.log_noise + 3, 0.0);
    return best_with_noise({quieter, less, believed}, kind);
  }
  SlowModel in_place_of_base(const SlowModel& m) const {
    SlowModel plain = m;
    plain.noise_effect = nullptr;
    const SlowModel with = at_hidden_start(polished(plain), *m.noise_effect);
    return with.noise_effect ? polished(with) : m;
  }
  // Whether a kind of noise beside `m` gains anything after a few evaluations; the start of the rest.
  bool is_hopeful(const SlowModel& m, SlowModel* with) const {
    for (SlowModel probe : {*with, at_hidden_start(m, *with->noise_effect)}) {
      if (!probe.noise_effect) continue;
      probe.is_believed = false;
      polish(&probe, kProbeEvaluations);
      if (probe.value > with->value) *with = probe;
    }
    return with->value > m.value;
  }
  // `m` with the starts of a kind of noise: its own, and where it was found alone or beside other names.
  std::vector<SlowModel> noise_starts(const SlowModel& m, const Effect& effect) const {
    std::vector<SlowModel> starts;
    for (const Theta& theta : effect.estimator()->starts(base_noise(m))) {
      starts.push_back(m);
      starts.back().noise_theta = theta;
    }
    const auto add = [&](const SlowModel& found) {
      if (found.noise_effect != &effect) return;
      starts.push_back(m);
      SlowModel& at = starts.back();
      at.noise_theta = found.noise_theta;
      at.take_noise_of(found);
    };
    for (const SlowCandidateScore& s : out.noises) add(s.model);
    add(out.best);
    return starts;
  }
  // Kinds of slow noise beside `m`, each from its best start; only the most promising ones are polished.
  std::vector<SlowCandidateScore> scan_noises(const SlowModel& m, size_t polish_most) const {
    std::vector<SlowCandidateScore> list;
    for (const Effect* effect : noise_effects) {
      const SlowModel with = best_with_noise(noise_starts(m, *effect), *effect);
      list.push_back({with.noise_effect ? with.free_score() : -1e300, with});
    }
    std::vector<size_t> order(list.size());
    for (size_t j = 0; j < order.size(); ++j) order[j] = j;
    std::sort(order.begin(), order.end(), [&](size_t a, size_t b) { return list[a].gain_nats > list[b].gain_nats; });
    for (size_t i = 0; i < order.size() && i < polish_most; ++i) {
      SlowCandidateScore& s = list[order[i]];
      if (!s.model.noise_effect || !is_hopeful(m, &s.model)) continue;
      s.model = polished(s.model, kQuickEvaluations);
      s.gain_nats = s.model.free_score();
    }
    start_like_best(m, &list);
    return list;
  }
  std::vector<SlowCandidateScore> kinds_beside(const SlowModel& m) const {
    SlowModel quiet = m;
    quiet.noise_effect = nullptr;
    return scan_noises(polished(quiet), noise_effects.size());
  }
  // Kinds of noise that could be like the best of them, from there: a random walk is the end of a valley of Markov
  // processes, along which a search from elsewhere stops.
  void start_like_best(const SlowModel& m, std::vector<SlowCandidateScore>* list) const {
    const auto best = std::max_element(list->begin(), list->end(),
                                       [](const auto& a, const auto& b) { return a.gain_nats < b.gain_nats; });
    if (best == list->end() || best->gain_nats <= m.free_score()) return;
    const SlowModel from = best->model;
    const NoiseModel base_of_best = base_noise(from);
    const NoiseModel all = from.noise_effect->estimator()->noise(base_of_best, from.noise_theta);
    Markov process{all.walk_dph_per_rt_s * std::sqrt(longest_tau_s / 6), longest_tau_s / 3};
    if (all.markov.size() == base_of_best.markov.size() + 1) process = all.markov.back();
    if (!(process.sigma_dph > 0)) return;
    for (SlowCandidateScore& s : *list) {
      if (!s.model.noise_effect || s.model.noise_effect == from.noise_effect) continue;
      const Theta alike = s.model.noise_effect->estimator()->like(process);
      if (alike.empty()) continue;
      SlowModel with = from;
      with.noise_theta = alike;
      with = best_with_noise({with}, *s.model.noise_effect);
      if (with.value <= s.model.value) continue;
      s.model = polished(with, kQuickEvaluations);
      s.gain_nats = s.model.free_score();
    }
  }

  double score(const SlowModel& m) const {
    return m.free_score() - constants.mean_nats * static_cast<double>(m.names.size()) -
           constants.step_nats * static_cast<double>(m.steps.size());
  }
  void consider(const SlowModel& m) {
    if (score(m) > score(out.best)) out.best = m;
  }

  // What gains most beside the best single is asked for its own partners too: the shape that the best single has alone is
  // that of a stand-in for both.
  static void add_partners(std::vector<SlowCandidateScore> beside, const std::vector<SlowCandidateScore>& singles,
                           std::vector<size_t>* bases) {
    sort_by_gain(&beside);
    for (size_t i = 0, added = 0; i < beside.size() && added < kPartners; ++i) {
      if (beside[i].model.names.empty()) continue;
      const size_t j = beside[i].model.names.back().candidate;
      if (singles[j].model.names.empty() || std::find(bases->begin(), bases->end(), j) != bases->end()) continue;
      bases->push_back(j), ++added;
    }
  }
  // The best single is scanned under every node of noise and its own: those likely under one cause alone are the ones
  // whose noise has swallowed the other.  The nodes likely under the best pair, and that one, serve the other singles.
  void pairs(const std::vector<SlowCandidateScore>& singles) {
    std::vector<size_t> order;
    for (size_t j = 0; j < singles.size(); ++j)
      if (!singles[j].model.names.empty()) order.push_back(j);
    std::sort(order.begin(), order.end(),
              [&](size_t a, size_t b) { return singles[a].gain_nats > singles[b].gain_nats; });
    if (order.size() > kPairBases) order.resize(kPairBases);
    std::vector<SlowCandidateScore> found;
    if (order.empty()) return;
    const OwnNode own = node_of(singles[order[0]].model);
    std::vector<const Node*> where = all_nodes();
    where.push_back(own.get());
    for (size_t i = 0; i < order.size(); ++i) {
      std::vector<SlowCandidateScore> beside = scan(singles[order[i]].model, where);
      if (i == 0) {
        add_partners(beside, singles, &order);
        const auto best = std::max_element(beside.begin(), beside.end(),
                                           [](const auto& a, const auto& b) { return a.gain_nats < b.gain_nats; });
        if (!best->model.names.empty()) where = nodes_with(*own, best->model);
      }
      for (SlowCandidateScore& s : beside)
        if (!s.model.names.empty()) found.push_back(std::move(s));
    }
    consider_best(std::move(found), kPairsTried, near_nats(score(out.best) - score(out.null)));
  }
  void one_more(const SlowModel& m) { one_more(m, m); }
  // `from`: where `m` comes from, of the same kind of noise.
  void one_more(const SlowModel& m, const SlowModel& from) {
    if (m.names.size() >= kMostNames) return;
    const OwnNode own = node_of(from);
    std::vector<SlowCandidateScore> found = scan(m, nodes_with(*own, out.best));
    if (!m.names.empty()) try_jumps(m, m, &found);
    consider_best(std::move(found), kAddedTried, near_nats(score(out.best) - score(out.null)));
  }
  static bool have_same_names(const SlowModel& a, const SlowModel& b) {
    const auto names = [](const SlowModel& m) {
      std::vector<size_t> list;
      for (const SlowModel::Name& name : m.names) list.push_back(name.candidate);
      std::sort(list.begin(), list.end());
      return list;
    };
    return names(a) == names(b);
  }
  // The best of a scan, each first brought near its own best shape: places of a grid lie so far apart that a right cause
  // may gain less there than a wrong one.
  void consider_best(std::vector<SlowCandidateScore> found, size_t tried, double near) {
    sort_by_gain(&found);
    std::vector<SlowCandidateScore> list;
    for (SlowCandidateScore& s : found) {
      if (list.size() == tried || s.model.names.empty()) break;
      if (std::any_of(list.begin(), list.end(), [&](const auto& o) { return have_same_names(o.model, s.model); }))
        continue;
      approach(&s.model);
      s.model.value = evaluate(s.model);
      s.gain_nats = score(s.model);
      list.push_back(std::move(s));
    }
    sort_by_gain(&list);
    if (list.size() > kPairsPolished) list.resize(kPairsPolished);
    for (const SlowCandidateScore& s : list)
      if (s.gain_nats > score(out.best) - near) consider(polished(s.model, kQuickEvaluations));
  }
  // One name exchanged, one less, one more, or the kind of noise left out: what singles and pairs miss where a stand-in
  // of three parts, or noise, gains more than any true cause alone.
  void refine() {
    for (int round = 0; round < kRounds && !out.best.names.empty(); ++round) {
      const SlowModel from = out.best;
      members_for_shapes();
      place_without_shapes(from);
      for (size_t i = 0; i < from.names.size() && from.names.size() + (from.noise_effect ? 1 : 0) > 1; ++i) {
        SlowModel less = from.without(i);
        try_about(less);
        if (less.noise_effect && !less.names.empty()) less.noise_effect = nullptr, try_about(less);
      }
      if (from.noise_effect) {
        SlowModel quiet = from;
        quiet.noise_effect = nullptr;
        try_about(quiet);
        quiet.value = evaluate(quiet);
        one_more(quiet); // its shapes as they are: alone it moves to where it takes what the noise took
      }
      if (score(out.best) < score(from) + kWorthwhile_nats) break;
    }
    if (out.best.names.size() > 1 || out.best.noise_effect) consider(polished(out.best, kEvaluations));
  }
  // A free shape may stand for two members, of which neither does as well alone.
  void members_for_shapes() {
    const SlowModel from = out.best;
    for (size_t i = 0; i < from.names.size() && from.names.size() < kMostNames; ++i) {
      if (candidates[from.names[i].candidate].effect) continue;
      const OwnNode own = node_of(from);
      const std::vector<SlowCandidateScore> firsts = scan_members(from.without(i), {own.get()});
      std::vector<SlowCandidateScore> found;
      for (size_t k = 0; k < firsts.size() && k < kMembersTried; ++k)
        for (SlowCandidateScore& both : scan_members(polished(firsts[k].model), {own.get()}))
          found.push_back(std::move(both));
      // A free shape has no shape parameters to polish, members have.
      consider_best(std::move(found), kMembersTried, near_nats(score(from) - score(out.null)));
    }
  }
  // A member beside a free shape stands where both together gain most: without the shape, each is placed anew.
  void place_without_shapes(const SlowModel& from) {
    for (size_t i = 0; i < from.names.size() && from.names.size() == kMostNames; ++i) {
      if (candidates[from.names[i].candidate].effect) continue;
      const SlowModel members = from.without(i);
      for (size_t j = 0; j < members.names.size(); ++j) one_more(polished(members.without(j), kQuickEvaluations), from);
    }
  }
  // Members of the library beside `m`, the one that gains most first.
  std::vector<SlowCandidateScore> scan_members(const SlowModel& m, const std::vector<const Node*>& where) const {
    std::vector<SlowCandidateScore> list;
    for (SlowCandidateScore& s : scan(m, where))
      if (!s.model.names.empty() && candidates[s.model.names.back().candidate].effect) list.push_back(std::move(s));
    sort_by_gain(&list);
    return list;
  }
  void try_about(SlowModel m) {
    const SlowModel as_found = m;
    m = polished(m, kQuickEvaluations);
    consider(m);
    one_more(m, as_found);
    more_noise(m);
  }
  void more_noise(const SlowModel& about) {
    if (about.noise_effect) return;
    for (const SlowCandidateScore& s : scan_noises(about, kNoisesBeside)) consider(s.model);
  }

  // A free shape has more freedom than any member: where a member gains nearly as much, it is the answer, and what the
  // shape gains beyond it is a remainder.
  SlowModel with_members(SlowModel best, std::vector<size_t>* replaced) const {
    for (size_t i = 0; i < best.names.size(); ++i) {
      const Candidate& c = candidates[best.names[i].candidate];
      if (c.effect || c.is_free_function) continue;
      const SlowModel less = without(best, i);
      const double free_gain = best.free_score() - less.free_score();
      SlowModel top;
      const OwnNode own = node_of(best);
      const std::vector<SlowCandidateScore> found = scan_members(less, nodes_with(*own, best));
      for (size_t k = 0; k < found.size() && k < kMembersTried; ++k) {
        if (found[k].gain_nats < less.free_score() + kMemberPart * free_gain) break;
        const SlowModel member = polished(found[k].model, kEvaluations);
        if (member.free_score() > top.free_score()) top = member;
      }
      if (top.free_score() - less.free_score() < constants.member_share * free_gain) continue;
      if (best.free_score() > top.free_score()) replaced->push_back(best.names[i].candidate);
      best = top;
    }
    return best;
  }

  // The hypothesis without one of its names, as good as it can be made.
  SlowModel without(const SlowModel& m, size_t i) const {
    SlowModel less = polished(m.without(i), kQuickEvaluations);
    if (less.names.empty()) {
      if (out.null.free_score() > less.free_score()) less = out.null;
      for (const SlowCandidateScore& s : out.noises)
        if (s.model.free_score() > less.free_score()) less = s.model;
    }
    return less;
  }

  double evidence_of(const SlowModel& m, size_t i) const {
    return m.free_score() - without(m, i).free_score() - constants.mean_nats;
  }

  void judge_names(SlowResult* result) const {
    result->best = with_members(result->best, &result->replaced);
    const SlowModel best = result->best;
    result->rivals.clear(), result->evidence.clear();
    for (size_t i = 0; i < best.names.size(); ++i) {
      result->evidence.push_back(evidence_of(best, i));
      result->rivals.push_back(rivals(best, i));
    }
    if (best.noise_effect) {
      SlowModel less = best;
      less.noise_effect = nullptr;
      less = polished(less, kQuickEvaluations);
      result->evidence.push_back(best.free_score() + best.noise_charge - less.free_score() - constants.noise_nats);
    }
  }
  std::vector<SlowResult::Rival> rivals(const SlowModel& best, size_t i) const {
    std::vector<SlowCandidateScore> others = scan(best.without(i), likely_nodes(best));
    others[best.names[i].candidate].model.names.clear();
    for (SlowCandidateScore& s : others)
      if (!s.model.names.empty() && s.gain_nats > best.free_score() - constants.near_nats) {
        s.model = polished(s.model, kQuickEvaluations);
        s.gain_nats = s.model.free_score();
      }
    std::vector<SlowResult::Rival> list;
    for (size_t j = 0; j < others.size(); ++j)
      if (!others[j].model.names.empty() && others[j].gain_nats > best.free_score() - constants.rivals_nats)
        list.push_back({j, nullptr, best.free_score() - others[j].gain_nats});
    if (best.names.size() == 1 && !best.noise_effect)
      for (const SlowCandidateScore& s : out.noises)
        if (s.gain_nats + constants.noise_kind_nats > best.free_score() - constants.rivals_nats)
          list.push_back({0, s.model.noise_effect, best.free_score() - s.gain_nats - constants.noise_kind_nats});
    std::sort(list.begin(), list.end(), [](const auto& a, const auto& b) { return a.gap_nats < b.gap_nats; });
    return list;
  }

  // The free function of everything beside a hypothesis, under its noise or that of `also`, at the likelier shape.
  SlowModel with_free_function(const SlowModel& m, const SlowModel& also) const {
    SlowModel best;
    if (candidates.empty() || !candidates.back().is_free_function) return best;
    std::vector<SlowModel> starts = {m, m};
    starts[1].take_noise_of(also);
    if (noise(starts[1]) == noise(m) && also.is_believed == m.is_believed) starts.pop_back();
    const std::vector<Theta>& shapes = candidates.back().scan.shapes;
    for (const Theta& shape : shapes)
      for (SlowModel with : starts) {
        with.names.push_back({candidates.size() - 1, shape, std::log(static_cast<double>(shapes.size())), false});
        with.value = evaluate(with);
        if (with.value > best.value) best = with;
      }
    return best;
  }

  // ---- a hypothesis that is given

  // The candidates added in this order, each where the grid is best, all polished; empty: one of them cannot be added.
  SlowModel built(const std::vector<size_t>& order) const {
    SlowModel m = out.null;
    for (const size_t j : order) {
      std::vector<SlowCandidateScore> found = scan(m, all_nodes());
      if (found[j].model.names.empty()) return {};
      m = found[j].model;
      approach(&m);
    }
    return order.empty() ? m : polished(polished(m, kEvaluations), kEvaluations);
  }
  SlowModel best_with(const std::vector<const Effect*>& effects) const {
    std::vector<size_t> order;
    const Effect* noise = nullptr;
    for (const Effect* effect : effects) {
      for (size_t j = 0; j < candidates.size(); ++j)
        if (candidates[j].effect == effect) order.push_back(j);
      if (std::find(noise_effects.begin(), noise_effects.end(), effect) != noise_effects.end()) noise = effect;
    }
    std::sort(order.begin(), order.end());
    SlowModel best;
    do {
      const SlowModel m = built(order);
      if (m.free_score() > best.free_score()) best = m;
    } while (std::next_permutation(order.begin(), order.end()));
    if (!noise) return best;
    SlowModel with;
    for (const SlowCandidateScore& s : scan_noises(best, noise_effects.size()))
      if (s.model.noise_effect == noise) with = polished(s.model, kEvaluations);
    return with;
  }

  // ---- jumps

  // Standardised innovations of a hypothesis, run by run.
  std::vector<VectorXd> innovations(const SlowModel& m) const {
    const std::vector<MeanPart> own = parts_on(data, m);
    const RunGrams::Posterior at = grams(m).posterior();
    const NoiseModel model = noise(m);
    std::vector<VectorXd> out_e;
    for (size_t r = 0; r < data.y.size(); ++r) {
      VectorXd e = residual_of(data, own, at, r);
      whiten(compute_gains(data.campaign.runs[r], model), e.data(), static_cast<size_t>(e.size()));
      out_e.push_back(std::move(e));
    }
    return out_e;
  }
  struct Block {
    size_t run;
    long k; // of its used rows
  };
  // The largest innovations, that of the largest first: where a jump would show.
  std::vector<Block> likely_jump_blocks(const SlowModel& m) const {
    std::vector<std::pair<double, Block>> list;
    const std::vector<VectorXd> e = innovations(m);
    for (size_t r = 0; r < e.size(); ++r)
      for (long k = 3; k + 3 < e[r].size(); ++k) list.push_back({std::fabs(e[r][k]), {r, k}});
    const size_t n = std::min(kStepPlaces, list.size());
    std::partial_sort(list.begin(), list.begin() + static_cast<long>(n), list.end(),
                      [](const auto& a, const auto& b) { return a.first > b.first; });
    std::vector<Block> blocks;
    for (size_t i = 0; i < n; ++i) blocks.push_back(list[i].second);
    return blocks;
  }
  std::vector<Theta> likely_steps(const SlowModel& m) const {
    std::vector<Theta> places;
    for (const Block& b : likely_jump_blocks(m)) {
      const CampaignRun& run = data.campaign.runs[b.run];
      const double t = run.input.t_s[static_cast<size_t>(run.used[static_cast<size_t>(b.k)])];
      places.push_back({static_cast<double>(b.run), t - 0.5 * data.campaign.dt_s});
    }
    return places;
  }
  std::vector<JumpPlace> likely_jumps(const SlowModel& m) const {
    std::vector<JumpPlace> places;
    for (const Block& b : likely_jump_blocks(m)) {
      const CampaignRun& run = data.campaign.runs[b.run];
      const auto temp_degc = [&](long k) {
        return run.input.smooth_degc[static_cast<size_t>(run.used[static_cast<size_t>(k)])];
      };
      places.push_back({0.5 * (temp_degc(b.k - 1) + temp_degc(b.k)), temp_degc(b.k + 3) > temp_degc(b.k - 3)});
    }
    return places;
  }
  // Jumps that earn their cost, one after the other, the noise estimated again with each.  More than a few are not
  // jumps but a noise: none then.
  std::vector<Theta> find_steps(const SlowModel& null) const {
    if (!steps) return {};
    SlowModel now = null;
    while (now.steps.size() < kMostSteps) {
      SlowModel best = now;
      best.value = -1e300;
      for (const Theta& place : likely_steps(now)) {
        SlowModel with = now;
        with.steps.push_back(place);
        with.value = evaluate(with);
        if (with.value > best.value) best = with;
      }
      if (best.value < now.value + constants.step_try_part * constants.step_nats) return now.steps;
      best = polished(best, kQuickEvaluations);
      if (best.value < now.value + constants.step_nats) return now.steps;
      now = best;
    }
    return {};
  }

  // The hypothesis without a name, and the nodes about it.
  SlowModel start, start_null;
  bool is_prepared = false;
  void prepare() {
    if (is_prepared) return;
    start = fit_null({});
    start_null = belief.has_believed ? polished(start, kQuickEvaluations) : start;
    is_prepared = true;
  }

  void go() {
    prepare();
    const std::vector<Theta> jumps = find_steps(start_null);
    if (jumps.empty()) return run_with(start, start_null, nullptr);
    SlowModel jumped = start;
    jumped.steps = jumps;
    polish(&jumped, kEvaluations);
    run_with(start, start_null, &jumped);
    // Names that take all the jumps: a search beside jumps would only come to them again.
    if (score(out.best) > score(jumped) && find_steps(out.best).empty()) return;
    const SlowResult plain = out;
    out = SlowResult();
    run_with(jumped, belief.has_believed ? polished(jumped, kQuickEvaluations) : jumped, nullptr);
    if (score(out.best) < score(plain.best)) {
      out = plain;
      return;
    }
    out.step_gain_nats = out.null.free_score() - plain.null.free_score();
    out.null = plain.null;
    out.without_steps = std::make_shared<const SlowResult>(plain);
  }
  // `in_time`: the null with the jumps in time that were found, or none.
  void run_with(const SlowModel& about, const SlowModel& null, const SlowModel* in_time) {
    make_nodes(about);
    out.null = null;
    out.best = out.null;
    out.singles = scan(out.null, all_nodes());
    if (in_time) try_jumps(out.null, *in_time, &out.singles);
    polish_best(&out.singles, kPolished, out.null.free_score() - constants.below_null_nats, kEvaluations);
    out.noise_effects = noise_effects;
    out.noises = scan_noises(out.null, noise_effects.size());
    for (const SlowCandidateScore& s : out.singles) consider(s.model);
    for (const SlowCandidateScore& s : out.noises) consider(s.model);
    double strongest = -1e300;
    for (const SlowCandidateScore& s : out.singles) strongest = std::max(strongest, s.gain_nats);
    if (strongest > out.null.free_score() + constants.more_names_nats) {
      more_noise_beside(out.singles);
      pairs(out.singles);
      while (out.best.names.size() >= 2 && out.best.names.size() < kMostNames) {
        const size_t before = out.best.names.size();
        one_more(out.best);
        if (out.best.names.size() == before) break;
      }
      if (out.best.names.size() >= 2) more_noise(out.best);
      refine();
    }
    judge_names(&out);
  }
  void more_noise_beside(const std::vector<SlowCandidateScore>& singles) {
    std::vector<size_t> order(singles.size());
    for (size_t j = 0; j < order.size(); ++j) order[j] = j;
    std::sort(order.begin(), order.end(),
              [&](size_t a, size_t b) { return singles[a].gain_nats > singles[b].gain_nats; });
    for (size_t i = 0; i < order.size() && i < kNoiseBases; ++i)
      if (!singles[order[i]].model.names.empty()) more_noise(singles[order[i]].model);
  }
};

namespace {

// FNV-1a over the bits of what is added.
class Hash {
public:
  void add(const std::string& text) { add(text.data(), text.size()), add(static_cast<double>(text.size())); }
  void add(double x) { add(&x, sizeof x); }
  template <class T> void add(const std::vector<T>& list) {
    add(list.data(), list.size() * sizeof(T)), add(static_cast<double>(list.size()));
  }
  std::string text() const {
    char out[20];
    std::snprintf(out, sizeof out, "%016llx", static_cast<unsigned long long>(state_));
    return out;
  }

private:
  void add(const void* bytes, size_t n) {
    const auto* at = static_cast<const unsigned char*>(bytes);
    for (size_t i = 0; i < n; ++i) state_ = (state_ ^ at[i]) * 0x100000001b3ull;
  }
  uint64_t state_ = 0xcbf29ce484222325ull;
};

void add_run(const CampaignRun& run, Hash* hash) {
  const RunInput& in = run.input;
  for (const std::vector<double>* column :
       {&in.t_s, &in.temp_degc, &in.smooth_degc, &in.rate_degc_min, &in.tn, &in.rate_dph})
    hash->add(*column);
  for (const auto& [name, values] : in.auxiliary) hash->add(name), hash->add(values);
  hash->add(run.used), hash->add(run.steps), hash->add(run.start_s);
}

void add_noise(const NoiseModel& noise, Hash* hash) {
  for (double x :
       {noise.white_sigma_dph, noise.walk_dph_per_rt_s, noise.white_slope, noise.markov_slope, noise.tau_slope,
        noise.extra_white_dph2, noise.hit_probability, noise.hit_sigma_dph, noise.telegraph_dph, noise.telegraph_tau_s})
    hash->add(x);
  for (const Markov& process : noise.markov) hash->add(process.sigma_dph), hash->add(process.tau_s);
}

} // namespace

std::string SlowSearch::null_key(size_t draws, uint64_t seed) const {
  const Campaign& campaign = impl_->data.campaign;
  const NoiseBelief& belief = impl_->belief;
  Hash hash;
  hash.add(std::string(IMUCAL_VERSION) + kCalibrationVersion);
  hash.add(static_cast<double>(draws)), hash.add(static_cast<double>(seed));
  for (const Candidate& c : impl_->candidates) hash.add(c.effect ? c.effect->name() : c.reference->what);
  for (const SelectorConstant& c : selector_constants()) hash.add(impl_->constants.*c.value);
  hash.add(campaign.dt_s), hash.add(campaign.order), hash.add(campaign.temp_lsb_degc);
  for (const CampaignRun& run : campaign.runs) add_run(run, &hash);
  hash.add(belief.has_believed), hash.add(belief.has_data_sheet), add_noise(belief.model, &hash);
  for (const NoiseBelief::Known& known : belief.known)
    for (const Effect* effect : effect_library())
      if (effect->estimator() == known.estimator) hash.add(effect->name()), hash.add(known.shape);
  return hash.text();
}

std::vector<double> SlowSearch::null_gains(size_t draws, uint64_t seed) {
  Impl& s = *impl_;
  s.prepare();
  s.make_nodes(s.start);
  const NoiseModel noise = s.noise(s.start_null);
  const RunGrams::Posterior at = s.grams(s.start_null).posterior();
  std::vector<MatrixXd> y;
  for (size_t r = 0; r < s.data.y.size(); ++r) {
    MatrixXd x(s.data.y[r].size(), static_cast<long>(draws));
    const RunGains gains = compute_gains(s.data.campaign.runs[r], noise);
    const VectorXd mean = s.data.powers[r] * at.common.head(s.data.powers[r].cols());
    for (size_t d = 0; d < draws; ++d) {
      Rng rng(seed, (static_cast<uint64_t>(d) << 16) + r, 0, static_cast<uint32_t>(Stream::kTool) + 7);
      for (long k = 0; k < x.rows(); ++k) x(k, static_cast<long>(d)) = rng.normal();
      colour(gains, x.col(static_cast<long>(d)).data(), static_cast<size_t>(x.rows()));
      x.col(static_cast<long>(d)) += mean;
    }
    y.push_back(std::move(x));
  }
  const size_t n = s.candidates.size();
  std::vector<double> base(draws, -1e300), best(draws, -1e300);
  for (const Impl::Node& node : s.nodes) {
    const ScanNode::Scores scores = node.scan->score({}, y, std::vector<char>(n, 0));
    const double extra = s.noise_value(node.at);
    for (size_t d = 0; d < draws; ++d) {
      const long column = static_cast<long>(d);
      base[d] = std::max(base[d], scores.base[column] + extra);
      std::vector<std::vector<double>> values(n);
      for (size_t g = 0; g < s.bank->groups().size(); ++g)
        if (scores.group(static_cast<long>(g), column) > -1e299)
          values[s.bank->groups()[g].candidate].push_back(scores.group(static_cast<long>(g), column));
      for (const std::vector<double>& of : values)
        if (!of.empty()) best[d] = std::max(best[d], log_mean_exp(of) + extra);
    }
  }
  for (size_t d = 0; d < draws; ++d) best[d] -= base[d];
  return best;
}

void SlowSearch::set_mean_threshold(double nats) {
  impl_->constants.mean_nats = nats;
}

double null_threshold(std::vector<double> gains, double rate, const SelectorConstants& constants) {
  if (gains.size() < 20) return constants.mean_nats;
  std::sort(gains.begin(), gains.end());
  const double q80 = gains[gains.size() * 4 / 5];
  double excess = 0, n = 0;
  for (double g : gains)
    if (g > q80) excess += g - q80, n += 1;
  // A Bayes factor falls off at least as fast as exp(-gain); few draws must not promise a faster fall.
  const double scale = std::max(1.0, n > 0 ? excess / n : 1.0);
  const double level = q80 + scale * std::log(0.2 / std::min(0.2, rate));
  return std::clamp(level + constants.polish_gain_nats, constants.least_threshold_nats, constants.most_threshold_nats);
}

SlowSearch::SlowSearch(const SlowData& data, const NoiseBelief& belief, const std::vector<const Effect*>& library,
                       const std::vector<bool>& active, const SelectorConstants& constants)
    : impl_(new Impl(data, belief, library, active, constants)) {}
SlowSearch::~SlowSearch() = default;
SlowResult SlowSearch::run() {
  impl_->go();
  return impl_->out;
}
const std::vector<Candidate>& SlowSearch::candidates() const {
  return impl_->candidates;
}
NoiseModel SlowSearch::noise_of(const SlowModel& model) const {
  return impl_->noise(model);
}
NoiseModel SlowSearch::seconds_noise_of(const SlowModel& model) const {
  return impl_->seconds_noise(model);
}
NoiseModel SlowSearch::base_noise_of(const SlowModel& model) const {
  return impl_->base_noise(model);
}
std::vector<MeanPart> SlowSearch::parts_on(const SlowData& data, const SlowModel& model) const {
  return impl_->parts_on(data, model);
}
bool SlowSearch::have_same_names(const SlowModel& a, const SlowModel& b) {
  return Impl::have_same_names(a, b);
}
double SlowSearch::score(const SlowModel& model) const {
  return impl_->score(model);
}
double SlowSearch::evidence_of(const SlowModel& model, size_t name) const {
  return impl_->evidence_of(model, name);
}
std::vector<SlowCandidateScore> SlowSearch::free_beside(const SlowModel& model, size_t most) const {
  return impl_->free_beside(model, most);
}
std::vector<SlowCandidateScore> SlowSearch::kinds_beside(const SlowModel& model) const {
  return impl_->kinds_beside(model);
}
SlowModel SlowSearch::with_free_function(const SlowModel& model, const SlowModel& also) const {
  return impl_->with_free_function(model, also);
}
SlowModel SlowSearch::polished(const SlowModel& model) const {
  return impl_->polished(model);
}
SlowModel SlowSearch::beside_believed(const SlowModel& model) const {
  return impl_->beside_believed(model);
}
SlowModel SlowSearch::in_place_of_base(const SlowModel& model) const {
  return impl_->in_place_of_base(model);
}
void SlowSearch::judge_again(SlowResult* result) const {
  result->best = impl_->polished(result->best);
  impl_->judge_names(result);
}
SlowModel SlowSearch::best_with(const std::vector<const Effect*>& effects) const {
  return impl_->best_with(effects);
}
RunGrams SlowSearch::grams_of(const SlowModel& model) const {
  return impl_->grams(model);
}

} // namespace imucal
