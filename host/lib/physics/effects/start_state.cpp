// SPDX-License-Identifier: MIT
#include "physics/effects/start_state.h"

#include <utility>

#include "base/error.h"

namespace imucal {

namespace {

const std::pair<const char*, StartState> kWords[] = {
    {"random", StartState::kRandom}, {"cold", StartState::kCold}, {"settled", StartState::kSettled}};

constexpr uint32_t kAllAxes = 0xffffffffu;   // in place of the axis: shared by all
constexpr uint32_t kHistories = 0x50000000u; // purposes of the streams of histories, one per effect name

} // namespace

EffectParameter start_parameter() {
  EffectParameter start{
      "start", 0, 0, "state at the start of every run (random where it is left out)", EffectParameter::kText, true};
  for (const auto& [word, state] : kWords) start.words.push_back(word);
  return start;
}

StartState start_state_from(const std::string& word) {
  for (const auto& [known, state] : kWords)
    if (word == known) return state;
  throw usage_error("--start: '" + word + "' is not one of random, cold, settled");
}

StartState start_of(const Parameters& parameters, const SimRun& run, const Rng* rng) {
  const ParameterValue* own = parameters.find("start");
  const StartState state = own ? start_state_from(own->text) : run.start;
  return state == StartState::kRandom && !rng ? StartState::kCold : state;
}

Rng history_of(const Effect& effect, const SimRun& run) {
  uint32_t hash = 2166136261u; // FNV-1a of the name
  for (const char c : effect.name()) hash = (hash ^ static_cast<unsigned char>(c)) * 16777619u;
  return Rng(run.seed, run.log, kAllAxes, kHistories | (hash & 0x00ffffffu));
}

} // namespace imucal
