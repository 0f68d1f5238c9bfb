// SPDX-License-Identifier: MIT
#include "analysis/diagnose/search/slow_scan.h"

#include <algorithm>
#include <cmath>

namespace imucal {

namespace {

constexpr double kDensityFactors[] = {0.5, 1.0, 1.6};     // nodes: slow density, and
constexpr double kTauFactors[] = {0.04, 0.12, 0.35, 1.0}; // time constant, about the fit without a name
constexpr size_t kPairNodes = 6, kNodesKept = 2;

} // namespace

void SlowScan::make_nodes(const SlowModel& about) {
  const std::array<double, 3> noise = {about.log_noise[0], about.log_noise[1], about.log_noise[2]};
  if (!nodes_.empty() && about_ == noise) return;
  about_ = noise;
  nodes_.clear();
  for (double q : kDensityFactors)
    for (double t : kTauFactors) {
      SlowModel m = about;
      m.is_believed = false;
      m.log_noise[1] += std::log(q), m.log_noise[2] += std::log(t);
      nodes_.push_back({m, std::make_unique<ScanNode>(*space_.bank, likelihood_.noise(m))});
    }
  if (space_.belief.has_believed) {
    SlowModel m = about;
    m.is_believed = true;
    nodes_.push_back({m, std::make_unique<ScanNode>(*space_.bank, likelihood_.noise(m))});
  }
}

// What differs from a hypothesis in its names has the same one.
SlowScan::OwnNode SlowScan::node_of(const SlowModel& m) const {
  const NoiseModel own = likelihood_.noise(m);
  for (const OwnNode& kept : kept_nodes_)
    if (kept->at.noise_effect == m.noise_effect && kept->at.is_believed == m.is_believed && kept->scan->noise() == own)
      return kept;
  if (kept_nodes_.size() == kNodesKept) kept_nodes_.erase(kept_nodes_.begin());
  kept_nodes_.push_back(
      std::make_shared<const SlowNode>(SlowNode{m, std::make_unique<ScanNode>(*space_.bank, own, true)}));
  return kept_nodes_.back();
}

// Per candidate, 1: not asked beside `m`.
std::vector<char> SlowScan::left_out(const SlowModel& m, bool only_free) const {
  std::vector<char> skip(space_.candidates.size(), 0);
  for (size_t j = 0; j < skip.size(); ++j) {
    const Effect* effect = space_.candidates[j].effect;
    // An effect and the same of any shape are one.
    const auto is_it = [&](const SlowModel::Name& name) {
      return name.candidate == j || (effect && effect == space_.candidates[name.candidate].effect);
    };
    const bool is_in_time = space_.candidates[j].is_once && !m.steps.empty();
    skip[j] = (only_free && effect) || is_in_time || std::any_of(m.names.begin(), m.names.end(), is_it) ? 1 : 0;
  }
  return skip;
}

std::vector<SlowCandidateScore> SlowScan::scan(const SlowModel& m, const std::vector<const SlowNode*>& where,
                                               bool only_free) const {
  return scan_each({m}, where, only_free).front();
}
std::vector<std::vector<SlowCandidateScore>> SlowScan::scan_each(const std::vector<SlowModel>& models,
                                                                 const std::vector<const SlowNode*>& where,
                                                                 bool only_free) const {
  std::vector<std::vector<SlowLikelihood::Part>> own;
  std::vector<ScanNode::Asked> asked;
  for (const SlowModel& m : models) {
    own.push_back(likelihood_.parts(m));
    asked.push_back({pointers_of(own.back()), left_out(m, only_free)});
  }
  SlowCandidateScore none;
  none.score_nats = -1e300;
  std::vector<std::vector<SlowCandidateScore>> best(models.size(),
                                                    std::vector<SlowCandidateScore>(space_.candidates.size(), none));
  for (const SlowNode* node : where) {
    const std::vector<ScanNode::Scores> scores = node->scan->score(asked);
    for (size_t i = 0; i < models.size(); ++i) take_best(models[i], *node, scores[i], &best[i]);
  }
  return best;
}
void SlowScan::take_best(const SlowModel& m, const SlowNode& node, const ScanNode::Scores& scores,
                         std::vector<SlowCandidateScore>* best) const {
  std::vector<std::vector<double>> values(space_.candidates.size());
  std::vector<size_t> top(space_.candidates.size(), 0);
  for (size_t g = 0; g < space_.bank->groups().size(); ++g) {
    const size_t j = space_.bank->groups()[g].candidate;
    const double v = scores.group(static_cast<long>(g), 0);
    if (v < -1e299) continue;
    if (values[j].empty() || v > *std::max_element(values[j].begin(), values[j].end())) top[j] = g;
    values[j].push_back(v);
  }
  for (size_t j = 0; j < space_.candidates.size(); ++j) {
    if (values[j].empty()) continue;
    const double mean = log_mean_exp(values[j]) + likelihood_.noise_value(node.at);
    if (mean <= (*best)[j].score_nats) continue;
    SlowCandidateScore& b = (*best)[j];
    b.score_nats = mean;
    b.model = m;
    b.model.take_noise_of(node.at);
    if (node.at.noise_effect) b.model.noise_theta = node.at.noise_theta;
    b.model.value = *std::max_element(values[j].begin(), values[j].end()) + likelihood_.noise_value(node.at);
    b.model.names.push_back({j, space_.bank->groups()[top[j]].shape, b.model.value - mean, false});
  }
}
std::vector<const SlowNode*> SlowScan::all_nodes() const {
  std::vector<const SlowNode*> list;
  for (const SlowNode& node : nodes_) list.push_back(&node);
  return list;
}
std::vector<const SlowNode*> SlowScan::likely_nodes(const SlowModel& m) const {
  const SlowLikelihood::Columns own = likelihood_.columns(m);
  std::vector<std::pair<double, const SlowNode*>> ranked;
  for (const SlowNode& node : nodes_)
    ranked.push_back({RunGrams(space_.data, *own, likelihood_.noise(node.at)).log_marginal_any_scale() +
                          likelihood_.noise_value(node.at),
                      &node});
  std::sort(ranked.begin(), ranked.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<const SlowNode*> list;
  for (size_t i = 0; i < ranked.size() && i < kPairNodes; ++i) list.push_back(ranked[i].second);
  return list;
}
std::vector<const SlowNode*> SlowScan::nodes_with(const SlowNode& own, const SlowModel& likely) const {
  std::vector<const SlowNode*> list;
  if (!own.at.noise_effect) list = likely_nodes(likely);
  list.push_back(&own);
  return list;
}

std::vector<SlowCandidateScore> SlowScan::scan_members(const SlowModel& m,
                                                       const std::vector<const SlowNode*>& where) const {
  std::vector<SlowCandidateScore> list;
  for (SlowCandidateScore& s : scan(m, where))
    if (!s.model.names.empty() && space_.candidates[s.model.names.back().candidate].is_member())
      list.push_back(std::move(s));
  sort_by_score(&list);
  return list;
}

} // namespace imucal
