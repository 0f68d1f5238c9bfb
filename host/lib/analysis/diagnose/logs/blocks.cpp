// SPDX-License-Identifier: MIT
#include "analysis/diagnose/logs/blocks.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/median.h"

namespace imucal {

using Eigen::VectorXd;

namespace {

constexpr double kBlock_s = 10;
constexpr double kShortest_s = 60; // of block means that a run keeps
constexpr double kMostBlocks = 3500;
constexpr long kMostPlaces = 10;              // of the way of the temperature through a block
constexpr long kFewestAround = 5;             // samples whose median is no hit of its own
constexpr double kFastest = 4;                // blocks per time constant from which a process is white
constexpr double kMostNegative = 0.97;        // of the white noise that the blocks of a Markov process may take off
constexpr double kFar = 8;                    // noise standard deviations from the median of a block
constexpr double kLike = 0.5;                 // of that: two rates of one level differ by less
constexpr long kMostOnRamp = 20;              // samples of a block that lie on a ramp
constexpr double kOnRamp = 0.5;               // of the spread of a block, what a ramp leaves at most
constexpr double kMedianOfDifference = 0.954; // of |a - b|, a and b N(0,1)
constexpr double kFading = 0.3; // of a sample at the start of a run, in the next: no hit, gone with its sample

// Per used sample of a run: one that is like the used one before or after it.
std::vector<char> like_a_neighbour(const CampaignRun& run, double near_dph) {
  std::vector<char> out(run.n(), 0);
  for (size_t k = 1; k < run.n(); ++k) {
    const auto before = static_cast<size_t>(run.used[k - 1]), now = static_cast<size_t>(run.used[k]);
    if (std::fabs(run.input.rate_dph[now] - run.input.rate_dph[before]) <= near_dph) out[k - 1] = out[k] = 1;
  }
  return out;
}
// Half of them are nearer to their median.
double spread_of(std::vector<double> x) {
  const double middle = median(x);
  for (double& value : x) value = std::fabs(value - middle);
  return median(std::move(x));
}
// Rates at increasing ticks less the ramp that they are on: its slope is the median over all pairs (Theil 1950), which a few hits do
// not bend.  As they are, where no ramp leaves half of their spread, where samples are few, and where they are so many that they follow
// each other closely.
std::vector<double> without_ramp(const std::vector<double>& rates, const std::vector<double>& ticks) {
  const auto n = static_cast<long>(rates.size());
  if (n < kFewestAround || n > kMostOnRamp) return rates;
  std::vector<double> slopes;
  for (size_t k = 1; k < rates.size(); ++k)
    for (size_t j = 0; j < k; ++j) slopes.push_back((rates[k] - rates[j]) / (ticks[k] - ticks[j]));
  const double slope = median(std::move(slopes));
  std::vector<double> levels = rates;
  for (size_t k = 0; k < rates.size(); ++k) levels[k] -= slope * ticks[k];
  return spread_of(levels) < kOnRamp * spread_of(rates) ? levels : rates;
}
// What is far from the median of its block and stays is a jump inside the block: its share of the mean tells when it came.  Nor is it a
// hit on a ramp that a steep bias makes of the few samples of a block.
VectorXd hits_of(const CampaignRun& run, long length, double far_dph) {
  VectorXd out = VectorXd::Zero(static_cast<long>(run.n()));
  const std::vector<char> stays = like_a_neighbour(run, kLike * far_dph);
  const auto block_of = [&](size_t k) { return run.input.tick[static_cast<size_t>(run.used[k])] / length; };
  for (size_t first = 0, end = 0; first < run.n(); first = end) {
    std::vector<double> rates, ticks;
    for (end = first; end < run.n() && block_of(end) == block_of(first); ++end) {
      const auto row = static_cast<size_t>(run.used[end]);
      rates.push_back(run.input.rate_dph[row]), ticks.push_back(static_cast<double>(run.input.tick[row] % length));
    }
    if (std::find(&stays[first], &stays[first] + rates.size(), 0) == &stays[first] + rates.size()) continue;
    const std::vector<double> levels = without_ramp(rates, ticks);
    const double middle = median(rates), level = median(levels);
    for (size_t i = 0; i < rates.size(); ++i)
      if (!stays[first + i] && std::fabs(rates[i] - middle) > far_dph && std::fabs(levels[i] - level) > far_dph)
        out[static_cast<long>(first + i)] = levels[i] - level;
  }
  return out;
}

// Sums over the rows of one block.
struct BlockSum {
  struct Place {
    double sum = 0, n = 0;
  };
  std::array<Place, kMostPlaces> path; // smooth temperature, in equal parts of the block
  double rows = 0, t_s = 0, temp = 0, smooth = 0, slope = 0, tn = 0;
  double used = 0, rate = 0, counted = 0;                     // rates; sum and number of those that are no hits
  std::map<std::string, std::pair<double, double>> auxiliary; // sum, count

  void add(const RunInput& in, size_t i, long place) {
    Place& at = path[static_cast<size_t>(place)];
    at.sum += in.smooth_degc[i], at.n += 1;
    rows += 1, t_s += in.t_s[i], temp += in.temp_degc[i], smooth += in.smooth_degc[i];
    slope += in.rate_degc_min[i], tn += in.tn[i];
    for (const auto& [name, column] : in.auxiliary)
      if (std::isfinite(column[i])) auxiliary[name].first += column[i], auxiliary[name].second += 1;
  }
  void add_rate(double rate_dph, bool is_hit) {
    used += 1;
    if (!is_hit) rate += rate_dph, counted += 1;
  }
};

// Places without a row stay where the one before them was; at first, where the next one is.
void append_path(const BlockSum& s, RunInput* out) {
  const auto next = std::find_if(s.path.begin(), s.path.end(), [](const BlockSum::Place& at) { return at.n > 0; });
  double degc = next->sum / next->n;
  for (size_t k = 0; k < out->path_per_row; ++k) {
    if (s.path[k].n > 0) degc = s.path[k].sum / s.path[k].n;
    out->path_degc.push_back(degc);
  }
}
void append(const BlockSum& s, long tick, double fewest, RunInput* out) {
  out->t_s.push_back(s.t_s / s.rows);
  out->tick.push_back(tick);
  out->temp_degc.push_back(s.temp / s.rows);
  out->smooth_degc.push_back(s.smooth / s.rows);
  append_path(s, out);
  out->rate_degc_min.push_back(s.slope / s.rows);
  out->tn.push_back(s.tn / s.rows);
  out->rate_dph.push_back(s.used < fewest || s.counted == 0 ? std::nan("") : s.rate / s.counted);
  for (auto& [name, column] : out->auxiliary) {
    const auto it = s.auxiliary.find(name);
    column.push_back(it == s.auxiliary.end() ? std::nan("") : it->second.first / it->second.second);
  }
}

CampaignRun blocks_of(const CampaignRun& run, long length, double far_dph) {
  CampaignRun out;
  out.start_s = run.start_s, out.cuts = run.cuts;
  out.own_white_dph2 = run.own_white_dph2 / static_cast<double>(length);
  const RunInput& in = run.input;
  out.input.log = in.log;
  out.input.dt_s = in.dt_s * static_cast<double>(length);
  out.input.t0_degc = in.t0_degc, out.input.range_degc = in.range_degc;
  out.input.lo_degc = in.lo_degc, out.input.hi_degc = in.hi_degc, out.input.order = in.order;
  out.input.start_halvings = in.start_halvings;
  const long places = std::min(kMostPlaces, length);
  out.input.path_per_row = static_cast<size_t>(places);
  for (const auto& entry : in.auxiliary) out.input.auxiliary[entry.first] = {};
  const VectorXd hits = hits_of(run, std::max(length, kFewestAround), far_dph);
  const double fewest = 0.5 * static_cast<double>(length);
  BlockSum sum;
  long block = in.tick.empty() ? 0 : in.tick.front() / length;
  for (size_t i = 0, k = 0; i < in.size(); ++i) {
    const long at = in.tick[i] / length;
    if (at != block && sum.rows > 0) {
      append(sum, block, fewest, &out.input);
      sum = BlockSum();
    }
    block = at;
    sum.add(in, i, in.tick[i] % length * places / length);
    if (k == run.n() || static_cast<size_t>(run.used[k]) != i) continue;
    sum.add_rate(in.rate_dph[i], hits[static_cast<long>(k)] != 0);
    ++k;
  }
  if (sum.rows > 0) append(sum, block, fewest, &out.input);
  for (const size_t row : in.restarts) {
    const std::vector<long>& ticks = out.input.tick;
    const auto at = std::lower_bound(ticks.begin(), ticks.end(), in.tick[row] / length);
    out.input.restarts.push_back(static_cast<size_t>(at - ticks.begin()));
  }
  return out;
}

long samples_of(const Campaign& seconds, double block_s) {
  return std::max(1L, std::lround(block_s / seconds.dt_s));
}
double far_dph(const Campaign& seconds) {
  const double white = white_between_samples(seconds) / std::sqrt(seconds.dt_s);
  return white > 0 ? kFar * white : 1e300;
}

} // namespace

double block_length_s(const Campaign& seconds) {
  const double total_s = static_cast<double>(seconds.n()) * seconds.dt_s;
  const double wanted = std::max(kBlock_s, total_s / kMostBlocks);
  return seconds.dt_s * std::max(1.0, std::round(wanted / seconds.dt_s));
}

static std::vector<double> changes_between(const CampaignRun& run, const VectorXd& rates_dph) {
  std::vector<double> changes;
  for (size_t k = 1; k < run.n(); ++k)
    if (run.steps[k] == 1)
      changes.push_back(std::fabs(rates_dph[static_cast<long>(k)] - rates_dph[static_cast<long>(k) - 1]));
  return changes;
}
std::vector<double> changes_between_samples(const CampaignRun& run) {
  return changes_between(run, used_rows(run, {run.input.rate_dph}));
}

double white_between_samples(const Campaign& campaign, const std::vector<VectorXd>& rates_dph) {
  std::vector<double> changes;
  for (size_t r = 0; r < campaign.runs.size(); ++r) {
    const std::vector<double> own = changes_between(campaign.runs[r], rates_dph[r]);
    changes.insert(changes.end(), own.begin(), own.end());
  }
  return changes.empty() ? 0 : median(std::move(changes)) / kMedianOfDifference * std::sqrt(campaign.dt_s);
}
double white_between_samples(const Campaign& campaign) {
  std::vector<VectorXd> rates_dph;
  for (const CampaignRun& run : campaign.runs) rates_dph.emplace_back(used_rows(run, {run.input.rate_dph}));
  return white_between_samples(campaign, rates_dph);
}

Campaign block_means(const Campaign& seconds, double block_s) {
  Campaign out = seconds;
  const double far = far_dph(seconds);
  out.dt_s = block_s;
  out.runs.clear();
  for (const CampaignRun& run : seconds.runs) {
    out.runs.push_back(blocks_of(run, samples_of(seconds, block_s), far));
    find_used(&out.runs.back());
  }
  return out;
}

// A memory that fades within seconds begins with samples that are far off, each less so than the one before.
static void keep_fading_start(const CampaignRun& run, VectorXd* hits) {
  const auto rate = [&](long k) { return run.input.rate_dph[static_cast<size_t>(run.used[static_cast<size_t>(k)])]; };
  long n = 0;
  while (n + 1 < hits->size() && (*hits)[n] != 0) ++n;
  if (n == 0) return;
  const double last = (*hits)[n - 1], next = rate(n) - (rate(n - 1) - last); // both off the middle of the block
  if (next / last > kFading) hits->head(n).setZero();
}
std::vector<VectorXd> hits_of(const Campaign& seconds) {
  const double far = far_dph(seconds);
  std::vector<VectorXd> out;
  const long length = std::max(samples_of(seconds, block_length_s(seconds)), kFewestAround);
  for (const CampaignRun& run : seconds.runs) {
    out.push_back(hits_of(run, length, far));
    keep_fading_start(run, &out.back());
  }
  return out;
}

bool drop_short_runs(Campaign* seconds) {
  const Campaign blocks = block_means(*seconds, block_length_s(*seconds));
  std::vector<std::string> why;
  for (const CampaignRun& run : blocks.runs)
    why.push_back(static_cast<double>(run.n()) * blocks.dt_s < kShortest_s ? kTooShort : "");
  if (std::find(why.begin(), why.end(), "") == why.end()) return false;
  drop_runs(why, seconds);
  return true;
}

NoiseModel block_equivalent(const NoiseModel& seconds, double block_s) {
  NoiseModel noise = gaussian_equivalent(seconds);
  const double white = noise.white_sigma_dph * noise.white_sigma_dph; // of 1-s means
  double extra = noise.extra_white_dph2;
  for (Markov& m : noise.markov) {
    const double a = block_s / m.tau_s, variance = m.sigma_dph * m.sigma_dph;
    const double apart = a < 1e-3 ? 1 + a * a / 12 : 2 * (std::cosh(std::min(a, 50.0)) - 1) / (a * a);
    const double together = variance_of_mean(a);
    if (a > kFastest) { // white at this length
      extra += block_s * variance * together;
      m.sigma_dph = 1e-9 * std::sqrt(white / block_s);
      continue;
    }
    extra += block_s * variance * (together - apart);
    m.sigma_dph *= std::sqrt(apart);
  }
  noise.extra_white_dph2 = std::max(extra, -kMostNegative * white);
  return noise;
}

} // namespace imucal
