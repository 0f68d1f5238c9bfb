// SPDX-License-Identifier: MIT
#include "analysis/diagnose/record.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "analysis/diagnose/logs/blocks.h"

namespace imucal {
namespace {

constexpr size_t kMostUsed = 4000;    // rows of all logs together that are kept for the eye
constexpr size_t kMostLeftOut = 1500; // of one log and one reason

const LogAxis* axis_of(const Log& log, const std::string& name) {
  for (const LogAxis& axis : log.axes)
    if (axis.name == name) return &axis;
  return nullptr;
}

size_t steps_of(size_t n, size_t most) {
  return std::max<size_t>(1, (n + most - 1) / most);
}

} // namespace

void RecordedRows::add(const Log& log, const LogAxis& axis, size_t row) {
  t_s.push_back(log.t_s[row]);
  temp_degc.push_back(row < log.temp_degc.size() ? log.temp_degc[row] : std::nan(""));
  rate_dph.push_back(axis.rate_dph[row]);
}

Record::Record(const std::vector<Log>& fitted, const std::vector<Log>& held_out, const std::string& axis)
    : n_fitted_(fitted.size()) {
  const uint8_t no_rate = place_of(kLeftOutNoRate), flagged = place_of(kLeftOutFlagged);
  for (size_t i = 0; i < fitted.size() + held_out.size(); ++i) {
    const bool is_held_out = i >= fitted.size();
    const Log& log = is_held_out ? held_out[i - fitted.size()] : fitted[i];
    Rows rows = {&log, axis_of(log, axis), is_held_out, "", std::vector<uint8_t>(log.size(), 0)};
    for (size_t k = 0; rows.axis && k < log.size(); ++k)
      if (!std::isfinite(rows.axis->rate_dph[k]))
        rows.why[k] = no_rate;
      else if (!rows.axis->flags.empty() && (rows.axis->flags[k] & (kSaturated | kSensorFault)))
        rows.why[k] = flagged;
    rows_.push_back(std::move(rows));
  }
}

uint8_t Record::place_of(const std::string& why) {
  const auto at = std::find(names_.begin(), names_.end(), why);
  const auto place = static_cast<uint8_t>(at - names_.begin());
  if (at == names_.end()) names_.push_back(why);
  return place;
}

Record::Rows& Record::rows_of(const CampaignRun& run, bool is_held_out) {
  return rows_[run.input.log + (is_held_out ? n_fitted_ : 0)];
}

// Rows that do not count and have no reason yet.
void Record::name_unused(const CampaignRun& run, const char* why, Rows* rows) {
  const std::vector<size_t> row_of = rows_of_log(run, rows->log->size());
  std::vector<char> is_used(run.input.size(), 0);
  for (int k : run.used) is_used[static_cast<size_t>(k)] = 1;
  const uint8_t reason = place_of(why), zero = place_of(kLeftOutZero);
  for (size_t i = 0; i < row_of.size(); ++i)
    if (uint8_t& now = rows->why[row_of[i]]; !is_used[i] && now == 0)
      now = rows->axis->rate_dph[row_of[i]] == 0 ? zero : reason;
}

void Record::name_holds(const CampaignRun& run, Rows* rows) {
  const uint8_t stuck = place_of(kLeftOutStuck);
  for (const Hold& hold : run.holds)
    for (size_t k = hold.first + 1; k < hold.end; ++k)
      if (rows->why[k] == 0) rows->why[k] = stuck;
}

void Record::leave_out(const StructureResult& found, const Campaign& fitted, const Campaign& held_out) {
  std::vector<std::pair<const CampaignRun*, bool>> runs; // in the order of the findings
  for (const CampaignRun& run : fitted.runs) runs.push_back({&run, false});
  for (const CampaignRun& run : held_out.runs) runs.push_back({&run, true});
  for (size_t r = 0; r < runs.size(); ++r) {
    const CampaignRun& run = *runs[r].first;
    Rows& rows = rows_of(run, runs[r].second);
    const std::vector<size_t> row_of = rows_of_log(run, rows.log->size());
    for (const StructureFinding& finding : found.findings) {
      if (r >= finding.signature.unusable.size()) continue;
      const uint8_t reason = place_of(finding.effect->name());
      for (size_t i = 0; i < row_of.size(); ++i)
        if (finding.signature.unusable[r][i] && rows.why[row_of[i]] == 0) rows.why[row_of[i]] = reason;
    }
    name_holds(run, &rows);
    name_unused(run, kLeftOutNeighbour, &rows);
  }
}

void Record::name_lost_logs(const Campaign& campaign, bool is_held_out) {
  for (const LeftOutLog& lost : campaign.left_out)
    rows_[lost.log + (is_held_out ? n_fitted_ : 0)].why_left_out = lost.why;
}

void Record::leave_out_rest(const Campaign& fitted, const Campaign& held_out) {
  for (const Campaign* campaign : {&fitted, &held_out}) {
    const bool is_held_out = campaign == &held_out;
    name_lost_logs(*campaign, is_held_out);
    if (campaign->runs.empty()) continue;
    const std::vector<Eigen::VectorXd> hits = hits_of(*campaign);
    const uint8_t hit = place_of(kLeftOutHit);
    for (size_t r = 0; r < campaign->runs.size(); ++r) {
      const CampaignRun& run = campaign->runs[r];
      Rows& rows = rows_of(run, is_held_out);
      name_unused(run, kLeftOutJump, &rows);
      const std::vector<size_t> row_of = rows_of_log(run, rows.log->size());
      for (size_t k = 0; k < run.n(); ++k)
        if (hits[r][static_cast<long>(k)] != 0) rows.why[row_of[static_cast<size_t>(run.used[k])]] = hit;
    }
  }
}

std::vector<RecordedLog> Record::logs() const {
  size_t n_all = 0;
  for (const Rows& rows : rows_) n_all += rows.why.size();
  std::vector<RecordedLog> out;
  for (size_t i = 0; i < rows_.size(); ++i) {
    const Rows& rows = rows_[i];
    if (!rows.axis) continue;
    RecordedLog log;
    log.log = rows.is_held_out ? i - n_fitted_ : i, log.is_held_out = rows.is_held_out;
    log.why_left_out = rows.why_left_out, log.every = steps_of(n_all, kMostUsed);
    std::vector<size_t> n_of(names_.size(), 0), seen(names_.size(), 0);
    for (uint8_t why : rows.why) ++n_of[why];
    std::vector<size_t> place(names_.size(), 0);
    for (size_t row = 0; row < rows.why.size(); ++row) {
      const size_t why = rows.why[row];
      if (why == 0) {
        if (seen[0]++ % log.every == 0) log.used.add(*rows.log, *rows.axis, row);
        continue;
      }
      if (seen[why] == 0) place[why] = log.left_out.size(), log.left_out.push_back({names_[why], n_of[why], {}});
      if (seen[why]++ % steps_of(n_of[why], kMostLeftOut) == 0)
        log.left_out[place[why]].rows.add(*rows.log, *rows.axis, row);
    }
    out.push_back(std::move(log));
  }
  return out;
}

} // namespace imucal
