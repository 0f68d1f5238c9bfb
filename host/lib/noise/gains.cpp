// SPDX-License-Identifier: MIT
#include "noise/gains.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "base/error.h"
#include "noise/states.h"
#include "noise/steady_filter.h"

namespace imucal {
namespace {

// What is left of the way to the steady gains (gains.h).
class Settling {
public:
  Settling(const SampleTimes& times, const NoiseModel& noise) : times_(times), noise_(noise) {}
  // With the row just computed and the one before it, both `step_s` after their forerunners.
  bool is_settled(const RunGains& g, size_t row, double step_s) {
    const double change = change_of(g, row);
    if (change > kNear) return false;
    if (change <= kRounding) return true;
    const double rate = rate_on(step_s);
    return change * rate <= kSettledChange * (1 - rate);
  }

private:
  static constexpr double kNear = 1e-9; // far from the end nothing need be known exactly
  static constexpr double kRounding = 4 * std::numeric_limits<double>::epsilon();

  // Largest relative change of the row before; beyond kNear the first one will do.
  static double change_of(const RunGains& g, size_t row) {
    double change = std::fabs(g.inv_sqrt_s[row] - g.inv_sqrt_s[row - 1]) / g.inv_sqrt_s[row];
    if (change > kNear) return change;
    const double* now = g.gain.data() + row * g.n_states;
    const double* before = now - g.n_states;
    for (size_t i = 0; i < g.n_states; ++i)
      if (now[i] != before[i]) change = std::max(change, std::fabs((now[i] - before[i]) / now[i]));
    return change;
  }
  double rate_on(double step_s) {
    if (step_s == step_s_) return rate_;
    NoiseModel of_run = noise_;
    of_run.extra_white_dph2 += times_.own_white_dph2 * times_.dt_s; // of 1-s means
    step_s_ = step_s;
    return rate_ = std::pow(slowest_pole(of_run, step_s, times_.dt_s), 2);
  }

  const SampleTimes& times_;
  const NoiseModel& noise_;
  double step_s_ = -1, rate_ = 0;
};

// Sum of logarithms by logarithms of products: fewer of them.
class LogSum {
public:
  void add(double factor) {
    product_ *= factor;
    if (product_ < 1e-250 || product_ > 1e250) sum_ += std::log(product_), product_ = 1;
  }
  void add(double factor, size_t times) { sum_ += static_cast<double>(times) * std::log(factor); }
  double value() const { return sum_ + std::log(product_); }

private:
  double sum_ = 0, product_ = 1;
};

template <size_t M> class GainRun {
public:
  GainRun(const SampleTimes& times, const NoiseModel& noise, const NoiseStates& states)
      : times_(times), states_(states), covariance_(states), transitions_(states), settling_(times, noise) {
    out_.n = times.n;
    out_.n_states = states.size();
    if (!states.is_constant()) set_room(times.n); // nothing settles: a row for every sample
  }

  RunGains run() {
    for (size_t k = 0; k < times_.n;) k = is_settled_ ? settled_stretch(k) : one_sample(k);
    out_.sum_log_s = -2 * log_w_.value();
    set_room(n_rows_);
    return std::move(out_);
  }

private:
  bool has_step(size_t k, double step_s) const { return k + 1 == times_.n || times_.seconds(k + 1) == step_s; }
  size_t n() const { return M ? M : out_.n_states; }

  size_t settled_stretch(size_t begin) {
    size_t end = begin;
    while (end < times_.n && has_step(end, transitions_.step_s())) ++end;
    const size_t row = n_rows_ - 1;
    if (end > begin) out_.stretches.push_back({begin, end, row, true});
    log_w_.add(out_.inv_sqrt_s[row], end - begin);
    is_settled_ = false; // a gap: the covariance moves again
    return end;
  }

  size_t one_sample(size_t k) {
    const size_t row = n_rows_++;
    if (n_rows_ > out_.inv_sqrt_s.size()) set_room(std::min(times_.n, kLeastRoom + 2 * row));
    set_row(k, row);
    const bool is_even = k > 0 && k + 1 < times_.n && times_.seconds(k) == times_.seconds(k + 1);
    predict(k);
    std::copy_n(transitions_.phi(), n(), out_.phi.data() + row * n());
    is_settled_ = states_.is_constant() && is_even && settling_.is_settled(out_, row, transitions_.step_s());
    return k + 1;
  }

  void set_room(size_t rows) {
    out_.inv_sqrt_s.resize(rows);
    out_.gain.resize(rows * n()), out_.phi.resize(rows * n());
  }

  void set_row(size_t k, size_t row) {
    if (out_.stretches.empty() || out_.stretches.back().is_settled) out_.stretches.push_back({k, k, row, false});
    ++out_.stretches.back().end;
    double cross[M ? M : kMostStates];
    const double s = states_.white_dph2(k) + covariance_.spread(cross);
    for (size_t i = 0; i < n(); ++i) out_.gain[row * n() + i] = cross[i] / s;
    out_.inv_sqrt_s[row] = 1.0 / std::sqrt(s);
    log_w_.add(out_.inv_sqrt_s[row]);
    covariance_.update(cross, 1 / s);
  }

  void predict(size_t k) {
    if (k + 1 == times_.n) return;
    transitions_.set(states_, k);
    covariance_.predict(transitions_.phi(), transitions_.q());
  }

  static constexpr size_t kLeastRoom = 256; // rows

  const SampleTimes& times_;
  const NoiseStates& states_;
  Covariance<M> covariance_;
  Transitions<M> transitions_;
  bool is_settled_ = false;
  size_t n_rows_ = 0;
  Settling settling_;
  LogSum log_w_;
  RunGains out_;
};

} // namespace

RunGains compute_gains(const SampleTimes& times, const NoiseModel& noise, const Eigen::VectorXd* extra_dph2) {
  const NoiseStates states(times, noise, extra_dph2);
  if (states.size() > kMostStates)
    throw usage_error(std::to_string(states.size()) + " Markov terms: more than the " + std::to_string(kMostStates) +
                      " that are followed; merge terms of neighbouring time constants");
  switch (states.size()) {
  case 1:
    return GainRun<1>(times, noise, states).run();
  case 2:
    return GainRun<2>(times, noise, states).run();
  default:
    return GainRun<0>(times, noise, states).run();
  }
}

RunGains first_samples(const RunGains& gains, size_t n) {
  RunGains out;
  out.n = n, out.n_states = gains.n_states;
  size_t rows = 0;
  LogSum log_w;
  for (RunGains::Stretch s : gains.stretches) {
    if (s.begin >= n) break;
    s.end = std::min(s.end, n);
    out.stretches.push_back(s);
    rows = s.is_settled ? s.row + 1 : s.row + s.end - s.begin;
    if (s.is_settled) log_w.add(gains.inv_sqrt_s[s.row], s.end - s.begin);
    for (size_t row = s.row; !s.is_settled && row < rows; ++row) log_w.add(gains.inv_sqrt_s[row]);
  }
  const auto first = [](const std::vector<double>& x, size_t count) {
    return std::vector<double>(x.begin(), x.begin() + static_cast<long>(count));
  };
  out.inv_sqrt_s = first(gains.inv_sqrt_s, rows);
  out.gain = first(gains.gain, rows * gains.n_states), out.phi = first(gains.phi, rows * gains.n_states);
  out.sum_log_s = -2 * log_w.value();
  return out;
}

} // namespace imucal
