// SPDX-License-Identifier: MIT
// Scans: every candidate beside a hypothesis, on the places of its grid, under nodes of noise.
#pragma once
#include <array>

#include "analysis/diagnose/search/slow_likelihood.h"

namespace imucal {

// A noise under which the columns of all candidates are whitened.
struct SlowNode {
  SlowModel at; // its noise
  std::unique_ptr<ScanNode> scan;
};

class SlowScan {
public:
  // `likelihood` must outlive it.
  explicit SlowScan(const SlowLikelihood& likelihood) : space_(likelihood.space()), likelihood_(likelihood) {}

  // The nodes that serve all hypotheses, about the noise of this one.
  void make_nodes(const SlowModel& about);
  std::vector<const SlowNode*> all_nodes() const;
  // Those where the hypothesis is likely.
  std::vector<const SlowNode*> likely_nodes(const SlowModel& m) const;
  // The noise of a hypothesis, its kind of slow noise included, is seldom near that of a node: a node of its own.
  using OwnNode = std::shared_ptr<const SlowNode>;
  OwnNode node_of(const SlowModel& m) const;
  // Frees the whitened columns of all nodes, which are quick to make anew: of a long log, hundreds of megabytes.
  void forget_white() {
    kept_nodes_.clear();
    for (const SlowNode& node : nodes_) node.scan->forget_white();
  }
  // `own` and, where it has no kind of slow noise that the others lack, the nodes where `likely` is likely.
  std::vector<const SlowNode*> nodes_with(const SlowNode& own, const SlowModel& likely) const;

  // Every candidate added to `m`, noise by node, shapes on their grids: per candidate of the space, score_nats is the mean of
  // the likelihood over its shapes; no names: it is in `m`, or left out.
  std::vector<SlowCandidateScore> scan(const SlowModel& m, const std::vector<const SlowNode*>& where,
                                       bool only_free = false) const;
  // The same of several hypotheses, with fewer passes over the columns.
  std::vector<std::vector<SlowCandidateScore>> scan_each(const std::vector<SlowModel>& models,
                                                         const std::vector<const SlowNode*>& where,
                                                         bool only_free = false) const;
  // Members of the library beside `m`, the one that gains most first.
  std::vector<SlowCandidateScore> scan_members(const SlowModel& m, const std::vector<const SlowNode*>& where) const;

private:
  std::vector<char> left_out(const SlowModel& m, bool only_free) const;
  void take_best(const SlowModel& m, const SlowNode& node, const ScanNode::Scores& scores,
                 std::vector<SlowCandidateScore>* best) const;

  const SlowSpace& space_;
  const SlowLikelihood& likelihood_;
  std::vector<SlowNode> nodes_;
  std::array<double, 3> about_ = {};        // logarithms of factors (SlowModel::log_noise) about which they lie
  mutable std::vector<OwnNode> kept_nodes_; // the last that were asked for, the oldest first
};

} // namespace imucal
