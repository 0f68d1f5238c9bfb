// SPDX-License-Identifier: MIT
#include "analysis/diagnose/evidence/lines.h"

#include <algorithm>
#include <cmath>
#include <complex>

#include "analysis/diagnose/evidence/fourier.h"
#include "analysis/diagnose/evidence/maximise.h"
#include "base/units.h"

namespace imucal {

using Eigen::VectorXd;

namespace {

constexpr double kSlowestLine_hz = 1.0 / 400;
constexpr size_t kSurroundings = 60;   // frequencies on either side that a line is compared with
constexpr int kSlopes = 24;            // of the drift, either sign
constexpr double kLargestSlope = 2e-3; // relative change of a unit frequency of 1 Hz per degC
constexpr double kSlopeUnit = kLargestSlope / (kSlopes * kSlopes); // slopes of the grid: k^2 units

// A search along tracks: pieces of so many samples, in which a line hardly drifts.
constexpr size_t kPieces[] = {128, 512};
constexpr size_t kFewestPieces = 8;
constexpr double kTrack_nats = 14; // largest of 6e4 tracks of noise: above this in 1 of 20

// A power of two that holds the longest run.
size_t transform_length(const Campaign& campaign) {
  size_t longest = 0, n_fft = 64;
  for (const CampaignRun& run : campaign.runs)
    longest = std::max(longest, static_cast<size_t>(run.input.tick.back() + 1));
  while (n_fft < longest) n_fft *= 2;
  return n_fft;
}

// Slopes of drift, in units: the next is `step` further, and the step grows by `growth` each time.
struct Slopes {
  long first, step, growth;
};

// Sums over the runs of |transform of e exp(-i slope phi)|^2 / n, slope after slope; phi is the phase that a slope of one
// unit has run through.  What turns a sample from slope to slope is multiplied by one factor at each: sines and cosines
// are taken once.
class DriftingPower {
public:
  DriftingPower(const Campaign& campaign, const std::vector<VectorXd>& e, const Fourier& fourier, const Slopes& slopes)
      : fourier_(fourier) {
    for (size_t r = 0; r < e.size(); ++r) {
      const CampaignRun& run = campaign.runs[r];
      double phase = 0;
      long last = 0;
      Turned turned;
      for (size_t k = 0; k < run.n(); ++k) {
        const size_t row = static_cast<size_t>(run.used[k]);
        const long tick = run.input.tick[row];
        phase += 2 * kPi * kSlopeUnit * (run.input.smooth_degc[row] - run.input.t0_degc) *
                 static_cast<double>(tick - last) * campaign.dt_s;
        last = tick;
        const auto turn = [&](long units) { return std::polar(1.0, -phase * static_cast<double>(units)); };
        turned.tick.push_back(static_cast<size_t>(tick));
        turned.e.push_back(e[r][static_cast<long>(k)] * turn(slopes.first));
        turned.step.push_back(turn(slopes.step)), turned.growth.push_back(turn(slopes.growth));
      }
      runs_.push_back(std::move(turned));
    }
  }

  // The next slopes, as many as a transform takes side by side; then power(..) speaks of them.
  void sum_next() {
    const size_t n = fourier_.n();
    sum_.assign(n * kLanes, 0.0);
    std::vector<double> re(n * kLanes), im(n * kLanes);
    for (Turned& run : runs_) {
      std::fill(re.begin(), re.end(), 0.0), std::fill(im.begin(), im.end(), 0.0);
      for (size_t lane = 0; lane < kLanes; ++lane) put_and_turn(&run, lane, re.data(), im.data());
      fourier_.transform_lanes(re.data(), im.data());
      add_squares(re, im, 1 / static_cast<double>(run.e.size()), &sum_);
    }
  }
  // At the bins 0 .. n_fft / 2 - 1, of one of these slopes or of its opposite: the samples are real, so that along the
  // opposite slope a transform has the same values at the negative frequencies.
  std::vector<double> power(size_t lane, bool is_opposite) const {
    const size_t n = fourier_.n();
    std::vector<double> out(n / 2);
    for (size_t i = 0; i < out.size(); ++i)
      out[i] = sum_[fourier_.place(is_opposite && i > 0 ? n - i : i) * kLanes + lane];
    return out;
  }
  static constexpr size_t kLanes = Fourier::kLanes;

private:
  using Complex = std::complex<double>;
  struct Turned {
    std::vector<size_t> tick;
    std::vector<Complex> e, step, growth;
  };
  // Without the checks for infinite parts that the operator makes.
  static Complex times(const Complex& a, const Complex& b) {
    return {a.real() * b.real() - a.imag() * b.imag(), a.real() * b.imag() + a.imag() * b.real()};
  }
  static void put_and_turn(Turned* run, size_t lane, double* re, double* im) {
    for (size_t i = 0; i < run->e.size(); ++i) {
      const size_t at = run->tick[i] * kLanes + lane;
      re[at] = run->e[i].real(), im[at] = run->e[i].imag();
      run->e[i] = times(run->e[i], run->step[i]);
      run->step[i] = times(run->step[i], run->growth[i]);
    }
  }

  const Fourier& fourier_;
  std::vector<Turned> runs_;
  std::vector<double> sum_; // [place][slope]
};

// -ln P(power > x) where `runs` runs give exponential powers of mean 1: the sum's distribution is Gamma(runs), and
// P = exp(-x) (1 + x + .. + x^(runs - 1)/(runs - 1)!).  One run: x itself.  Never more than x.
double gain_of_power(double x, size_t runs) {
  double log_term = 0, log_sum = 0; // many logs with a strong line: the terms themselves would leave the range
  for (size_t k = 1; k < runs; ++k) {
    log_term += std::log(x / static_cast<double>(k));
    log_sum = std::max(log_sum, log_term) + std::log1p(std::exp(-std::abs(log_sum - log_term)));
  }
  return x - log_sum;
}

// A line stands out of the mean of its surroundings.  power: summed over the runs; white noise has 1 in each.
void take_line(const std::vector<double>& power, size_t runs, double hz_of_bin, double slope, size_t bins, Line* best) {
  const size_t first = static_cast<size_t>(kSlowestLine_hz / hz_of_bin) + 1;
  std::vector<double> sum(bins + 1, 0.0);
  for (size_t i = 0; i < bins; ++i) sum[i + 1] = sum[i] + power[i];
  for (size_t i = first; i + 1 < bins; ++i) {
    if (power[i] <= best->gain_nats || power[i] < power[i - 1]) continue;
    const size_t lo = i > first + kSurroundings ? i - kSurroundings : first, hi = std::min(bins - 1, i + kSurroundings);
    const double own = power[i] + power[i - 1] + power[i + 1];
    const double around = (sum[hi + 1] - sum[lo] - own) / static_cast<double>(hi - lo - 2);
    const double background = std::max(1.0, around / static_cast<double>(runs)); // of one run
    const double gain = gain_of_power(power[i] / background, runs);
    if (gain > best->gain_nats) *best = {static_cast<double>(i) * hz_of_bin, slope, gain};
  }
}

// Powers of pieces of the runs, to be summed along f0 + k (T - t0): where a line could lie that drifts so much that it is in
// no bin of a whole run, and so fast that the slopes of a grid miss it.  Phases from piece to piece are not used.
class Tracks {
public:
  Tracks(const Campaign& campaign, const std::vector<VectorXd>& e, size_t samples)
      : samples_(samples), bin_hz_(1 / (2 * static_cast<double>(samples) * campaign.dt_s)) {
    for (size_t r = 0; r < e.size(); ++r) add_run(campaign.runs[r], e[r]);
    transform();
    for (const Piece& piece : pieces_) span_degc_ = std::max(span_degc_, std::fabs(piece.temp_degc));
  }
  // Half a bin at the temperature furthest from t0.
  double slope_step() const { return bin_hz_ / std::max(span_degc_, 1e-3); }
  size_t size() const { return pieces_.size(); }

  // The strongest over all slopes; its gain is that of its sum, of which noise alone has Gamma(pieces).
  Line strongest() const {
    Line best;
    double highest = 0;
    const long n = static_cast<long>(kLargestSlope / slope_step());
    const double pieces = static_cast<double>(pieces_.size());
    for (long k = -n; k <= n; ++k) {
      const double slope = static_cast<double>(k) * slope_step();
      const std::vector<double> sum = along(slope);
      const double background = std::max(1.0, mean_of(sum) / pieces); // of one piece
      for (size_t i = static_cast<size_t>(kSlowestLine_hz / bin_hz_) + 1; i < sum.size(); ++i) {
        if (sum[i] / background <= highest) continue;
        highest = sum[i] / background;
        best = {static_cast<double>(i) * bin_hz_, slope, gain_of_power(highest, pieces_.size())};
      }
    }
    return best;
  }

private:
  struct Piece {
    double temp_degc = 0; // from t0
    size_t used = 0;
    std::vector<double> power; // at the bins 0 .. samples - 1 of half a transform of twice the length
  };

  void add_run(const CampaignRun& run, const VectorXd& e) {
    const size_t first = pieces_.size();
    pieces_.resize(first + static_cast<size_t>(run.input.tick.back()) / samples_ + 1);
    for (size_t i = first; i < pieces_.size(); ++i) pieces_[i].power.assign(2 * samples_, 0.0);
    for (size_t k = 0; k < run.n(); ++k) {
      const size_t row = static_cast<size_t>(run.used[k]), tick = static_cast<size_t>(run.input.tick[row]);
      Piece& piece = pieces_[first + tick / samples_];
      piece.power[tick % samples_] = e[static_cast<long>(k)];
      piece.temp_degc += run.input.smooth_degc[row] - run.input.t0_degc, ++piece.used;
    }
  }
  // The samples of every piece become its powers; pieces of which most is missing go.
  void transform() {
    pieces_.erase(std::remove_if(pieces_.begin(), pieces_.end(), [&](const Piece& p) { return 2 * p.used < samples_; }),
                  pieces_.end());
    const Fourier fourier(2 * samples_);
    for (Piece& piece : pieces_) {
      std::vector<double> x;
      x.swap(piece.power);
      add_powers(fourier, x.data(), 1 / static_cast<double>(piece.used), nullptr, 0, &piece.power);
      piece.temp_degc /= static_cast<double>(piece.used);
    }
  }
  std::vector<double> along(double slope) const {
    const long bins = static_cast<long>(samples_);
    std::vector<double> sum(samples_, 0.0);
    for (const Piece& piece : pieces_) {
      const long shift = std::lround(slope * piece.temp_degc / bin_hz_);
      const long lo = std::clamp(-shift, 0L, bins), hi = std::clamp(bins - shift, lo, bins);
      for (long i = 0; i < lo; ++i) sum[static_cast<size_t>(i)] += 1;
      for (long i = lo; i < hi; ++i) sum[static_cast<size_t>(i)] += piece.power[static_cast<size_t>(i + shift)];
      for (long i = hi; i < bins; ++i) sum[static_cast<size_t>(i)] += 1;
    }
    return sum;
  }
  static double mean_of(const std::vector<double>& sum) {
    double total = 0;
    for (const double x : sum) total += x;
    return total / static_cast<double>(sum.size());
  }

  size_t samples_;
  double bin_hz_, span_degc_ = 0;
  std::vector<Piece> pieces_;
};

// Whole runs along the slopes from..to, in units.
void take_lines_between(const Campaign& campaign, const std::vector<VectorXd>& e, const Fourier& fourier, long from,
                        long to, Line* best) {
  const double hz = 1 / (static_cast<double>(fourier.n()) * campaign.dt_s);
  DriftingPower turned(campaign, e, fourier, {from, 1, 0});
  for (long units = from; units <= to; ++units) {
    const size_t lane = static_cast<size_t>(units - from) % DriftingPower::kLanes;
    if (lane == 0) turned.sum_next();
    take_line(turned.power(lane, false), campaign.runs.size(), hz, kSlopeUnit * static_cast<double>(units),
              fourier.n() / 2, best);
  }
}

// Tracks say where to look with all phases.
void take_lines_on_tracks(const Campaign& campaign, const std::vector<VectorXd>& e, const Fourier& fourier,
                          Line* best) {
  Line track;
  double way = 0;
  for (const size_t samples : kPieces) {
    const Tracks tracks(campaign, e, samples);
    if (tracks.size() < kFewestPieces) continue;
    if (const Line line = tracks.strongest(); line.gain_nats > track.gain_nats) track = line, way = tracks.slope_step();
  }
  if (track.gain_nats < kTrack_nats) return;
  const auto units = [](double slope) {
    return std::lround(std::clamp(slope, -kLargestSlope, kLargestSlope) / kSlopeUnit);
  };
  take_lines_between(campaign, e, fourier, units(track.hz_per_degc - way), units(track.hz_per_degc + way), best);
}

} // namespace

std::vector<double> summed_power(const Campaign& campaign, const std::vector<VectorXd>& e) {
  const Fourier fourier(transform_length(campaign));
  std::vector<double> power(fourier.n() / 2 + 1, 0.0);
  const auto at_ticks = [&](size_t r) {
    const CampaignRun& run = campaign.runs[r];
    std::vector<double> x(fourier.n(), 0.0);
    for (size_t k = 0; k < run.n(); ++k)
      x[static_cast<size_t>(run.input.tick[static_cast<size_t>(run.used[k])])] = e[r][static_cast<long>(k)];
    return x;
  };
  const auto scale = [&](size_t r) { return 1 / static_cast<double>(campaign.runs[r].n()); };
  for (size_t r = 0; r < e.size(); r += 2) {
    std::vector<double> one = at_ticks(r);
    if (r + 1 == e.size()) {
      add_powers(fourier, one.data(), scale(r), nullptr, 0, &power);
    } else {
      std::vector<double> other = at_ticks(r + 1);
      add_powers(fourier, one.data(), scale(r), other.data(), scale(r + 1), &power);
    }
  }
  return power;
}

Line steady_line(const Campaign& campaign, const std::vector<double>& power) {
  const size_t bins = power.size() - 1;
  Line best;
  take_line(power, campaign.runs.size(), 1 / (2 * static_cast<double>(bins) * campaign.dt_s), 0, bins, &best);
  return best;
}

Line strongest_line(const Campaign& campaign, const std::vector<VectorXd>& e) {
  return steady_line(campaign, summed_power(campaign, e));
}

Line stronger_drifting(const Campaign& campaign, const std::vector<VectorXd>& e, const Line& steady) {
  if (!campaign.has_temperature) return steady;
  const Fourier fourier(transform_length(campaign));
  const size_t bins = fourier.n() / 2, runs = campaign.runs.size();
  const double hz = 1 / (static_cast<double>(fourier.n()) * campaign.dt_s);
  Line best = steady;
  DriftingPower turned(campaign, e, fourier, {1, 3, 2}); // k^2
  for (int k = 1; k <= kSlopes; ++k) {
    const size_t lane = static_cast<size_t>(k - 1) % DriftingPower::kLanes;
    if (lane == 0) turned.sum_next();
    take_line(turned.power(lane, true), runs, hz, -kSlopeUnit * k * k, bins, &best);
    take_line(turned.power(lane, false), runs, hz, kSlopeUnit * k * k, bins, &best);
  }
  take_lines_on_tracks(campaign, e, fourier, &best);
  return best;
}

namespace {

// The strongest line of all slopes between the neighbours of a slope on the grid, unit by unit.
Line between_slopes(const Campaign& campaign, const std::vector<VectorXd>& e, const Line& line) {
  const long place = std::lround(std::sqrt(std::abs(line.hz_per_degc) / kSlopeUnit));
  const long first = (place - 1) * (place - 1) + 1, last = (place + 1) * (place + 1) - 1;
  Line best = line;
  const bool falls = line.hz_per_degc < 0;
  take_lines_between(campaign, e, Fourier(transform_length(campaign)), falls ? -last : first, falls ? -first : last,
                     &best);
  return best;
}

// Power along the cosine and the sine of a tone, in nats against white noise of 1, all runs together.
double power_along(const Campaign& campaign, const std::vector<VectorXd>& e, const EffectEstimator& tone,
                   const Theta& shape) {
  double sum = 0;
  for (size_t r = 0; r < e.size(); ++r) {
    const Eigen::MatrixXd x = used_rows(campaign.runs[r], tone.columns(campaign.runs[r].input, shape));
    sum += (x.transpose() * e[r]).squaredNorm() / static_cast<double>(e[r].size());
  }
  return sum;
}

} // namespace

PlacedLine place_of(const Campaign& campaign, const std::vector<VectorXd>& e, const EffectEstimator& tone,
                    const Line& line) {
  const bool drifts = line.hz_per_degc != 0;
  const Line near = drifts ? between_slopes(campaign, e, line) : line;
  const double bin_hz = 1 / (static_cast<double>(transform_length(campaign)) * campaign.dt_s);
  const double t0_degc = campaign.runs.front().input.t0_degc;
  // In bins and units of slope; the effect's frequency is that at 0 degC.
  const auto shape = [&](const Theta& x) {
    const double slope = drifts ? near.hz_per_degc + kSlopeUnit * x[1] : 0;
    const double hz = near.hz + bin_hz * x[0];
    return drifts ? Theta{hz - slope * t0_degc, slope} : Theta{hz};
  };
  Theta x(drifts ? 2 : 1, 0.0);
  SearchOptions options;
  options.max_evaluations = 80, options.tolerance = 1e-3;
  const double power = maximise([&](const Theta& at) { return power_along(campaign, e, tone, shape(at)); }, &x,
                                Theta(x.size(), -1.0), Theta(x.size(), 1.0), options);
  return {shape(x), power};
}

// The power is the gain in log-likelihood with the best amplitude and phase of every run.
Theta errors_of_place(const Campaign& campaign, const std::vector<VectorXd>& e, const EffectEstimator& tone,
                      const Theta& place) {
  const double bin_hz = 1 / (static_cast<double>(transform_length(campaign)) * campaign.dt_s);
  const double unit[] = {bin_hz, kSlopeUnit};
  Theta errors = curvature_errors(
      [&](const Theta& off) {
        Theta shape = place;
        for (size_t i = 0; i < shape.size(); ++i) shape[i] += off[i] * unit[i];
        return power_along(campaign, e, tone, shape);
      },
      Theta(place.size(), 0.0), Theta(place.size(), -1.0), Theta(place.size(), 1.0));
  for (size_t i = 0; i < errors.size(); ++i) errors[i] *= unit[i];
  return errors;
}

} // namespace imucal
