// SPDX-License-Identifier: MIT
#include "analysis/diagnose/search/slow_model.h"

#include <algorithm>
#include <cmath>

namespace imucal {

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
void SlowModel::drop_swallowed() {
  const Theta left = left_by_swallowed();
  for (size_t i = 0; i < left.size(); ++i) log_noise[i] += left[i];
}
double SlowModel::charges() const {
  double sum = noise_effect ? noise_charge : 0;
  for (const Name& name : names) sum += name.charge;
  return sum;
}

bool have_same_names(const SlowModel& a, const SlowModel& b) {
  const auto names = [](const SlowModel& m) {
    std::vector<size_t> list;
    for (const SlowModel::Name& name : m.names) list.push_back(name.candidate);
    std::sort(list.begin(), list.end());
    return list;
  };
  return names(a) == names(b);
}
void sort_by_score(std::vector<SlowCandidateScore>* scores) {
  std::sort(scores->begin(), scores->end(), [](const auto& a, const auto& b) { return a.score_nats > b.score_nats; });
}

} // namespace imucal
