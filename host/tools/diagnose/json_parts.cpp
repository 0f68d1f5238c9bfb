// SPDX-License-Identifier: MIT
#include "diagnose/json_parts.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "diagnose/words.h"

namespace imucal {
Json number(double x) {
  return std::isfinite(x) ? Json(x) : Json(nullptr);
}

Json short_number(double x) {
  if (!std::isfinite(x)) return Json(nullptr);
  char text[32];
  std::snprintf(text, sizeof text, "%.7g", x);
  return Json(std::strtod(text, nullptr));
}

Json numbers(const std::vector<double>& x) {
  Json out = Json::array();
  for (double v : x) out.push_back(number(v));
  return out;
}

Json evidence_json(const CandidateEvidence& c) {
  return {{"name", name_of(c)},
          {"family", family_name(c.family)},
          {"evidence_nats", number(c.evidence_nats())},
          {"gain_nats", number(c.gain_nats)},
          {"threshold_nats", number(c.threshold_nats)}};
}

Json causes_json(const std::vector<HardwareCause>& causes) {
  Json out = Json::array();
  for (const HardwareCause& cause : causes) out.push_back({{"what", cause.what}, {"source", cause.source}});
  return out;
}

} // namespace imucal
