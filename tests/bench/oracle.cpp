// SPDX-License-Identifier: MIT
// Why diagnose said something else than what is in the logs.  Told the true causes of an axis, it compares the best
// hypothesis with exactly these causes with what the search chose, and with what was said in the end:
//   oracle AXIS CAUSE+CAUSE [--model MODEL.json] [--arw N] [--instability S:T] [--cache DIR] --log A.csv ... [--holdout B.csv ...]
// One JSON object: names and scores [nats, less all thresholds] of null, choice of the search and oracle; what held-out
// logs give to each; what was said.  tests/blind/confusions.py makes a table of it.
#include <cstdio>
#include <cstring>
#include <iostream>
#include <sstream>

#include "analysis/diagnose/diagnose.h"
#include "analysis/diagnose/logs/blocks.h"
#include "base/error.h"
#include "io/json_file.h"

using namespace imucal;

namespace {

std::vector<std::string> split(const std::string& text, char at) {
  std::vector<std::string> out;
  std::istringstream in(text);
  for (std::string part; std::getline(in, part, at);) out.push_back(part);
  return out;
}

struct Request {
  std::vector<const Effect*> truth;
  DiagnoseOptions options;
};

Request read_arguments(int argc, char** argv) {
  if (argc < 5) throw usage_error("usage: oracle AXIS CAUSE+CAUSE [--model M] --log A.csv ... [--holdout B.csv ...]");
  Request out;
  out.options.axes = {argv[1]};
  for (const std::string& name : split(argv[2], '+')) out.truth.push_back(&find_effect(name));
  for (int i = 3; i + 1 < argc; i += 2) {
    const std::string option = argv[i], value = argv[i + 1];
    if (option == "--model") out.options.model_path = value;
    if (option == "--log") out.options.logs.push_back(value);
    if (option == "--holdout") out.options.held_out.push_back(value);
    if (option == "--cache") out.options.cache_folder = value;
    if (option == "--arw") out.options.arw_deg_rt_h = std::stod(value);
    if (option == "--instability")
      out.options.instability = Markov{std::stod(split(value, ':').at(0)), std::stod(split(value, ':').at(1))};
  }
  return out;
}

// A hypothesis in numbers: names with shapes, score, what the held-out data gain by it and by each of its names.
Json told(const AxisStudy& study, const Campaign* held_out, const SlowModel& null, const SlowModel& m) {
  const SlowSearch& search = *study.search;
  Json out, names = Json::array(), held = Json::array();
  for (const SlowModel::Name& name : m.names) {
    const Candidate& c = search.candidates()[name.candidate];
    names.push_back({{"name", c.effect ? c.effect->name() : c.reference->what}, {"shape", name.shape}});
  }
  const GapResult gap = measure_gap(search, *study.data, held_out, null, m);
  for (size_t i = 0; i < gap.foretold.at_all.size(); ++i)
    held.push_back({gap.foretold.beyond_start[i].nats, gap.foretold.beyond_start[i].expected,
                    gap.foretold.at_all[i].nats, gap.foretold.at_all[i].expected});
  out["names"] = names, out["steps"] = m.steps.size();
  out["noise"] = m.noise_effect ? m.noise_effect->name() : "";
  out["score_nats"] = search.score(m) - search.score(null), out["gain_nats"] = m.free_score() - null.free_score();
  out["held_out_nats"] = 0.5 * gap.foretold.delta_deviance, out["held_out_by_name_nats"] = held;
  return out;
}

Json said(const Selection& s) {
  Json out = Json::object(), effects = Json::array(), dropped = Json::array(), rest = Json::array();
  for (const SelectedEffect& e : s.effects)
    effects.push_back({{"name", e.is_family || !e.term.effect ? family_name(e.family) : e.term.effect->name()},
                       {"member", e.term.effect ? e.term.effect->name() : ""},
                       {"evidence_nats", e.evidence_nats},
                       {"doubt", static_cast<int>(e.doubt)}});
  for (const SelectedEffect& e : s.dropped)
    dropped.push_back({{"name", e.term.effect ? e.term.effect->name() : family_name(e.family)},
                       {"gain_nats", e.gain_nats},
                       {"held_out_nats", e.held_out_nats}});
  for (const CandidateEvidence& e : s.remainders)
    rest.push_back(e.effect ? e.effect->name() : e.reference ? e.reference->what : family_name(e.family));
  out["effects"] = effects, out["dropped"] = dropped, out["remainders"] = rest;
  return out;
}

Json judged(const Request& request) {
  const DiagnoseResult result = diagnose(request.options);
  const AxisResult& axis = result.axes.front();
  const AxisStudy& study = axis.study;
  if (!axis.refused.empty() || study.selection.cannot_judge) return {{"refused", axis.refused}};
  // The study keeps the choice after all rules; the search makes it again before them.
  const SlowResult searched = study.search->run();
  const SlowModel oracle = study.search->best_with(request.truth);
  std::unique_ptr<Campaign> held_out;
  if (!request.options.held_out.empty()) {
    std::vector<Log> logs;
    for (const std::string& path : request.options.held_out) logs.push_back(read_log(path));
    const ErrorModel model = request.options.model_path.empty() ? ErrorModel() : read_model(request.options.model_path);
    const Campaign seconds = make_campaign(logs, axis.axis, model);
    if (!seconds.runs.empty()) held_out.reset(new Campaign(block_means(seconds, study.data->campaign.dt_s)));
  }
  Json out = said(study.selection);
  out["threshold_nats"] = study.selection.chance.threshold_nats;
  out["searched"] = told(study, held_out.get(), searched.null, searched.best);
  if (searched.without_steps)
    out["without_steps"] = told(study, held_out.get(), searched.null, searched.without_steps->best);
  out["kept"] = told(study, held_out.get(), searched.null, study.slow.best);
  out["oracle"] = oracle.value > -1e299 ? told(study, held_out.get(), searched.null, oracle) : Json();
  return out;
}

} // namespace

int main(int argc, char** argv) {
  try {
    std::cout << judged(read_arguments(argc, argv)).dump() << "\n";
    return 0;
  } catch (const Error& error) {
    std::fprintf(stderr, "oracle: %s\n", error.what());
    return static_cast<int>(error.exit());
  } catch (const std::exception& error) {
    std::fprintf(stderr, "oracle: %s\n", error.what());
    return 3;
  }
}
