// SPDX-License-Identifier: MIT
// The library: what effect_list.sh finds in this folder, in a fixed order.
#include <algorithm>
#include <stdexcept>

#include "base/error.h"
#include "physics/effects/effect.h"
#include "physics/effects/estimation.h"

namespace imucal {

#define ENTRY(Type) const Effect* library_entry_##Type();
#include "effect_list.inc"
#undef ENTRY

namespace {

struct FamilyWords {
  Family family;
  const char *name, *label;
};

constexpr FamilyWords kFamilies[] = {
    {Family::kThermalMemory, "thermal_memory", "a memory of earlier temperatures"},
    {Family::kFunctionOfTemperature, "function_of_temperature",
     "a curve over temperature that the polynomial does not follow"},
    {Family::kFunctionOfTime, "function_of_time", "a drift with the time since the start"},
    {Family::kRunToRun, "run_to_run", "a change from run to run"},
    {Family::kTone, "tone", "a periodic disturbance"},
    {Family::kSlowNoise, "slow_noise", "slow random wander of the bias"},
    {Family::kFastNoise, "fast_noise", "noise of single seconds"},
    {Family::kStructural, "structural", "what the converter or the recorder did to the samples"},
    {Family::kExternal, "external", "a cause outside this axis"}};

const FamilyWords& words_of(Family family) {
  for (const FamilyWords& words : kFamilies)
    if (words.family == family) return words;
  throw std::logic_error("a family without words");
}

long place_of(Family family) {
  return &words_of(family) - kFamilies;
}

void sort_library(std::vector<const Effect*>* library) {
  std::sort(library->begin(), library->end(), [](const Effect* a, const Effect* b) {
    const long x = place_of(a->family()), y = place_of(b->family());
    return x != y ? x < y : a->name() < b->name();
  });
}

std::vector<const Effect*>& mutable_library() {
  static std::vector<const Effect*> library = [] {
    std::vector<const Effect*> all = {
#define ENTRY(Type) library_entry_##Type(),
#include "effect_list.inc"
#undef ENTRY
    };
    sort_library(&all);
    return all;
  }();
  return library;
}

} // namespace

std::string family_name(Family family) {
  return words_of(family).name;
}

std::string family_label(Family family) {
  return words_of(family).label;
}

const std::vector<Family>& all_families() {
  static const std::vector<Family> all = [] {
    std::vector<Family> list;
    for (const FamilyWords& words : kFamilies) list.push_back(words.family);
    return list;
  }();
  return all;
}

const std::vector<const Effect*>& effect_library() {
  return mutable_library();
}

void add_effect(const Effect& effect) {
  for (const Effect* known : effect_library())
    if (known->name() == effect.name()) throw data_error("effect \"" + effect.name() + "\" is there already");
  mutable_library().push_back(&effect);
  sort_library(&mutable_library());
}

const Effect& find_effect(const std::string& name) {
  std::string known;
  for (const Effect* effect : effect_library()) {
    if (effect->name() == name) return *effect;
    known += (known.empty() ? "" : ", ") + effect->name();
  }
  throw data_error("effect \"" + name + "\" is not in the library (known: " + known + ")");
}

const Effect& find_effect(const EffectSpec& spec) {
  try {
    return find_effect(spec.name);
  } catch (const Error& error) {
    throw spec.place.empty() ? error : data_error(spec.place + ": " + error.what());
  }
}

} // namespace imucal
