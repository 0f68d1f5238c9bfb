// SPDX-License-Identifier: MIT
#include "analysis/errormodel/expect.h"

#include <cmath>
#include <complex>

#include "base/error.h"
#include "base/scalar_product.h"
#include "physics/effects/closed_forms.h"

namespace imucal {

using Kind = NoiseComponent::Kind;

namespace {

// Weights of the prediction of a window of n: w_j = sum_m c[m] pole[m]^j on the j-th sample before t0.
std::vector<double> weight_factors(const DpOperator& op, long n) {
  const NominalFilter& f = op.filter;
  std::vector<double> c(f.size(), 0.0);
  for (size_t i = 0; i < f.size(); ++i) {
    const double factor = f.prediction_factor(i, n, op.type == DpType::kDp3);
    for (size_t m = 0; m < f.size(); ++m) c[m] += factor * f.response[i][m];
  }
  return c;
}

// |gain|^2 of the operator at a phase of omega per sample.
double squared_gain(const DpOperator& op, long n, double omega) {
  using C = std::complex<double>;
  const auto mean = [&](long k) { // (1/k) sum_{j<k} e^{i omega j}
    const double half = 0.5 * omega, s = std::sin(half);
    const auto steps = static_cast<double>(k);
    const double size = std::fabs(s) < 1e-300 ? 1 : std::sin(half * steps) / (steps * s);
    return C(size, 0) * std::exp(C(0, half * (steps - 1)));
  };
  const C back = std::exp(C(0, -omega));
  C gain = mean(n);
  if (op.type == DpType::kAv || op.type == DpType::kDp1) {
    gain -= std::conj(mean(op.history_n(n))) * back;
  } else {
    const std::vector<double> c = weight_factors(op, n);
    for (size_t m = 0; m < c.size(); ++m) gain -= c[m] * back / (1.0 - op.filter.pole[m] * back);
  }
  return std::norm(gain);
}

// E d^2 of DP2, DP3.  Random walk: with its generalised covariance, valid only inside a detrended record.
double filtered_square(const NoiseComponent& comp, const DpOperator& op, long n) {
  const std::vector<double> c = weight_factors(op, n);
  const std::vector<double>& pole = op.filter.pole;
  const auto steps = static_cast<double>(n);
  const double phi = std::exp(-comp.alpha);
  double window = 0, cross = 0, estimate = 0; // <mean, mean>, <mean, estimate>, <estimate, estimate>
  switch (comp.kind) {
  case Kind::kWhite:
    window = 1 / steps;
    break;
  case Kind::kMarkov:
    window = 1 + sum_variance(markov_component(1, 1 / comp.alpha), steps) / (steps * steps);
    break;
  case Kind::kAngleQuantization:
    window = 2 / (steps * steps);
    break;
  default:
    window = -(steps * steps - 1) / (6 * steps);
    break;
  }
  for (size_t m = 0; m < c.size(); ++m) {
    const double p = pole[m], left = 1 - p;
    switch (comp.kind) {
    case Kind::kWhite:
      break;
    case Kind::kMarkov:
      cross += c[m] * phi / (1 - p * phi) * std::expm1(-comp.alpha * steps) / std::expm1(-comp.alpha) / steps;
      break;
    case Kind::kAngleQuantization:
      cross -= c[m] / steps;
      break;
    default:
      cross -= 0.5 * c[m] * (0.5 * (steps + 1) / left + p / (left * left));
      break;
    }
    for (size_t k = 0; k < c.size(); ++k) {
      const double q = pole[k];
      double sum = 1;
      if (comp.kind == Kind::kMarkov) sum = 1 / (1 - p * phi) + 1 / (1 - q * phi) - 1;
      if (comp.kind == Kind::kAngleQuantization) sum = 2 - p - q;
      if (comp.kind == Kind::kRandomWalk) sum = -0.5 * (p / (left * left) + q / ((1 - q) * (1 - q)));
      estimate += c[m] * c[k] * sum / (1 - p * q);
    }
  }
  return comp.power_dph2 * (window - 2 * cross + estimate);
}

double general_square(const NoiseComponent& comp, const DpOperator& op, long n) {
  if (comp.kind == Kind::kSinusoid) return 0.5 * comp.power_dph2 * squared_gain(op, n, comp.omega_rad);
  if (op.type == DpType::kDp2 || op.type == DpType::kDp3) return filtered_square(comp, op, n);
  const auto steps = static_cast<double>(n), m = static_cast<double>(op.history_n(n));
  if (comp.kind == Kind::kRamp) return comp.power_dph2 * 0.25 * (steps + m) * (steps + m);
  const double v_n = sum_variance(comp, steps), v_m = sum_variance(comp, m), v_both = sum_variance(comp, steps + m);
  return v_n / (steps * steps) + v_m / (m * m) - (v_both - v_n - v_m) / (steps * m);
}

double dot(const std::vector<double>& a, const std::vector<double>& b) {
  return scalar_product(a.data(), b.data(), a.size());
}

Series with_rates(const Series& shape, const std::vector<double>& rates) {
  Series s = shape;
  for (size_t i = 0; i < rates.size(); ++i)
    if (!std::isnan(s.rate_dph[i])) s.rate_dph[i] = rates[i];
  return s;
}

// Mean square of d of given signals, averaged over them, after projecting `basis` out: deterministic components.
std::vector<double> deterministic_squares(const NoiseComponent& comp, const DpOperator& op, const Series& shape,
                                          const std::vector<std::vector<double>>& basis, const std::vector<long>& n) {
  const auto size = static_cast<size_t>(shape.size());
  std::vector<std::vector<double>> signals(comp.kind == Kind::kSinusoid ? 2 : 1, std::vector<double>(size));
  for (size_t i = 0; i < size; ++i) {
    const double t = static_cast<double>(i) - 0.5 * static_cast<double>(size - 1);
    if (comp.kind == Kind::kRamp) {
      signals[0][i] = t;
    } else {
      signals[0][i] = std::cos(comp.omega_rad * t);
      signals[1][i] = std::sin(comp.omega_rad * t);
    }
  }
  std::vector<double> out(n.size(), 0.0);
  for (auto& signal : signals) {
    for (size_t i = 0; i < size; ++i)
      if (std::isnan(shape.rate_dph[i])) signal[i] = 0;
    for (const auto& q : basis) {
      const double along = dot(q, signal);
      for (size_t i = 0; i < size; ++i) signal[i] -= along * q[i];
    }
    const auto moments = DpRecord(with_rates(shape, signal), op).moments(n);
    for (size_t k = 0; k < n.size(); ++k)
      out[k] += comp.power_dph2 * moments[k].mean_square() / static_cast<double>(signals.size());
  }
  return out;
}

// What removing the mean takes from E mean d^2 of DP2, DP3 on a whole record: the general formula with the one column
// q = 1/sqrt(N), to which every warmed-up window answers with the same number (to 1e-4, the warm-up's).
void subtract_mean_effect(const NoiseComponent& comp, const DpOperator& op, long size, const std::vector<long>& n,
                          std::vector<double>* square) {
  const double q = 1 / std::sqrt(static_cast<double>(size));
  const auto cq = covariance_times(comp, std::vector<double>(static_cast<size_t>(size), q));
  const NominalFilter& f = op.filter;
  const auto samples = static_cast<size_t>(size);
  std::vector<double> sum2(samples + 2, 0.0), state(f.size(), 0.0); // sum2[k]: sum of the running sums before k
  std::vector<std::vector<double>> states2(f.size(), std::vector<double>(samples + 2, 0.0));
  double sum = 0, qcq = 0;
  for (size_t i = 0; i <= samples; ++i) {
    sum2[i + 1] = sum2[i] + sum;
    for (size_t k = 0; k < f.size(); ++k) states2[k][i + 1] = states2[k][i] + state[k];
    if (i == samples) break;
    sum += cq[i];
    qcq += q * cq[i];
    double predicted = 0;
    for (size_t k = 0; k < f.size(); ++k) predicted += state[k] *= f.phi[k];
    for (size_t k = 0; k < f.size(); ++k) state[k] += f.gain[k] * (cq[i] - predicted);
  }
  for (size_t j = 0; j < n.size(); ++j) {
    const auto h = static_cast<size_t>(op.history_n(n[j])), steps = static_cast<size_t>(n[j]);
    if (h + steps > samples) continue;
    const size_t end = samples - steps + 1; // windows t0 = h … end - 1
    double answers = (sum2[end + steps] - sum2[h + steps] - sum2[end] + sum2[h]) / static_cast<double>(n[j]);
    double gain = 1;
    const std::vector<double> c = weight_factors(op, n[j]);
    for (size_t k = 0; k < f.size(); ++k) {
      answers -= f.prediction_factor(k, n[j], op.type == DpType::kDp3) * (states2[k][end] - states2[k][h]);
      gain -= c[k] / (1 - f.pole[k]);
    }
    const auto windows = static_cast<double>(end - h);
    (*square)[j] -= 2 * answers * gain * q / windows - qcq * gain * gain * q * q;
  }
}

} // namespace

double expected_square(const NoiseComponent& comp, const DpOperator& op, long n) {
  const bool filtered = op.type == DpType::kDp2 || op.type == DpType::kDp3;
  if (filtered && !comp.is_stationary())
    throw usage_error("the expected " + to_text(op.type) +
                      " of a random walk or ramp depends on the record's length: "
                      "give --duration-s (and --detrend)");
  return general_square(comp, op, n);
}

static std::vector<long> steps_of(const std::vector<double>& tau_s, double dt_s) {
  std::vector<long> n;
  for (double tau : tau_s) {
    n.push_back(std::lround(tau / dt_s));
    if (n.back() < 1)
      throw usage_error("tau " + std::to_string(tau) + " s is less than one sample of " + std::to_string(dt_s) + " s");
  }
  return n;
}

// G'G Q for one n: G gives the prediction errors of a record, Q are the columns that detrending removes.
struct Adjoint {
  std::vector<std::vector<double>> columns;
  std::vector<double> along; // Q'G'G Q
  size_t n_windows = 0;
};

static Adjoint adjoint_of(const std::vector<std::vector<double>>& basis, const std::vector<DpRecord>& records, long n) {
  Adjoint out;
  std::vector<double> d;
  std::vector<long> t0;
  for (const DpRecord& record : records) {
    record.samples(n, &d, &t0);
    out.columns.push_back(record.adjoint(n, d, t0));
  }
  out.n_windows = t0.size();
  for (const auto& q : basis)
    for (const auto& column : out.columns) out.along.push_back(dot(q, column));
  return out;
}

// Sum over the columns of their scalar products with those of each of z, piece by piece: `columns` is read once for all.
static std::vector<double> traces(const std::vector<std::vector<double>>& columns, const std::vector<Adjoint>& z) {
  constexpr size_t kPiece = 1024;
  std::vector<double> out(z.size(), 0.0);
  for (size_t a = 0; a < columns.size(); ++a)
    for (size_t b = 0; b < columns[a].size(); b += kPiece)
      for (size_t k = 0; k < z.size(); ++k)
        out[k] += scalar_product(&columns[a][b], &z[k].columns[a][b], std::min(kPiece, columns[a].size() - b));
  return out;
}

std::vector<double> expected_dp_dph(const ErrorModel& model, const DpOperator& op, const std::vector<double>& tau_s) {
  const auto components = noise_components(model, op.dt_s);
  std::vector<double> out;
  for (long n : steps_of(tau_s, op.dt_s)) {
    double sum = 0;
    for (const auto& c : components) sum += expected_square(c, op, n);
    out.push_back(std::sqrt(0.5 * sum));
  }
  return out;
}

std::vector<std::vector<double>> expected_record_squares(const std::vector<NoiseComponent>& components,
                                                         const DpOperator& op, const Series& shape,
                                                         const Detrend& detrend, const std::vector<long>& n) {
  const auto basis = detrend_basis(shape, detrend);
  const bool filtered = op.type == DpType::kDp2 || op.type == DpType::kDp3;
  // Constants are invisible to AV and DP1: removing the mean changes nothing.
  const bool nothing_removed = basis.empty() || (basis.size() == 1 && !filtered);
  std::vector<std::vector<double>> out(components.size(), std::vector<double>(n.size()));
  std::vector<size_t> stochastic;
  for (size_t c = 0; c < components.size(); ++c) {
    const auto& comp = components[c];
    if (comp.kind == Kind::kRamp || comp.kind == Kind::kSinusoid) {
      out[c] = deterministic_squares(comp, op, shape, basis, n);
      continue;
    }
    if (basis.empty() && filtered && !comp.is_stationary())
      throw usage_error("the expected " + to_text(op.type) +
                        " of a random walk without detrending depends on where "
                        "it starts; use --detrend mean or poly:N");
    for (size_t k = 0; k < n.size(); ++k) out[c][k] = general_square(comp, op, n[k]);
    if (!nothing_removed) stochastic.push_back(c);
  }
  if (stochastic.empty()) return out;

  if (basis.size() == 1 && shape.n_missing == 0) { // the mean alone: sums of windows are differences of running sums
    for (size_t c : stochastic) subtract_mean_effect(components[c], op, shape.size(), n, &out[c]);
    return out;
  }
  const size_t p = basis.size();
  std::vector<DpRecord> basis_records;
  for (const auto& q : basis) basis_records.emplace_back(with_rates(shape, q), op);
  std::vector<std::vector<std::vector<double>>> cq(components.size()); // [component][column] = C Q
  std::vector<std::vector<double>> qcq(components.size());
  for (size_t c : stochastic) {
    for (size_t a = 0; a < p; ++a) cq[c].push_back(covariance_times(components[c], basis[a]));
    for (size_t a = 0; a < p; ++a)
      for (size_t b = 0; b < p; ++b) qcq[c].push_back(dot(basis[a], cq[c][b]));
  }
  // Some n together: what is read of every component, which is the most, serves them all.
  constexpr size_t kTogether = 8;
  for (size_t first = 0; first < n.size(); first += kTogether) {
    const size_t last = std::min(first + kTogether, n.size());
    std::vector<Adjoint> z;
    for (size_t k = first; k < last; ++k) z.push_back(adjoint_of(basis, basis_records, n[k]));
    for (size_t c : stochastic) {
      const std::vector<double> trace = traces(cq[c], z);
      for (size_t k = first; k < last; ++k) {
        const Adjoint& at_n = z[k - first];
        if (at_n.n_windows == 0) continue;
        const double removed = 2 * trace[k - first] - dot(qcq[c], at_n.along);
        out[c][k] -= removed / static_cast<double>(at_n.n_windows);
      }
    }
  }
  return out;
}

std::vector<double> expected_record_dp_dph(const ErrorModel& model, const DpOperator& op, const Series& shape,
                                           const Detrend& detrend, const std::vector<double>& tau_s) {
  const auto squares =
      expected_record_squares(noise_components(model, op.dt_s), op, shape, detrend, steps_of(tau_s, op.dt_s));
  std::vector<double> out(tau_s.size(), 0.0);
  for (size_t k = 0; k < out.size(); ++k) {
    for (const auto& s : squares) out[k] += s[k];
    out[k] = std::sqrt(0.5 * out[k]);
  }
  return out;
}

Series empty_record(long n, double dt_s) {
  Series s;
  s.dt_s = dt_s;
  s.rate_dph.assign(static_cast<size_t>(n), 0.0);
  return s;
}

} // namespace imucal
