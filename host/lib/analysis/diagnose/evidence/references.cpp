// SPDX-License-Identifier: MIT
#include "analysis/diagnose/evidence/references.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>

#include "base/units.h"

namespace imucal {
namespace {

constexpr double kTurn_degc_min = 0.1; // slope of temperature below which it has no clear direction
constexpr double kDelays_s[] = {0., 60., 150., 350., 800., 1800., 4000.};
constexpr double kLongest_s = 40000; // beyond this the time functions are flat
constexpr double kPasts_s[] = {60., 250., 800., 2500.};
constexpr int kOrder = 5; // of the free function: sum of the orders of a product

// cos(k pi u), k = 1 .. n, of a variable that runs over [0, 1]: prior 1/k, a rough but continuous function.  Each from the
// two before it: cos((k + 1) a) = 2 cos(a) cos(k a) - cos((k - 1) a).
void add_cosines(const Column& u, int n, const Column* factor, std::vector<Column>* out) {
  const size_t first = out->size();
  out->resize(first + static_cast<size_t>(n), Column(u.size()));
  for (size_t i = 0; i < u.size(); ++i) {
    const double scale = factor ? (*factor)[i] : 1.0, one = std::cos(kPi * std::clamp(u[i], 0.0, 1.0));
    double before = 1, now = one;
    for (size_t k = first; k < out->size(); ++k) {
      (*out)[k][i] = now * scale;
      const double next = 2 * one * now - before;
      before = now, now = next;
    }
  }
}

// Temperature over the span of the fitted logs, widened by a tenth at either end, goes to [0, 1].
Column unit_temperature(const RunInput& in) {
  Column u(in.size());
  for (size_t i = 0; i < u.size(); ++i) u[i] = in.place_in_span(in.smooth_degc[i]);
  return u;
}
Column unit_time(const RunInput& in, double longest_s) {
  Column u(in.size());
  for (size_t i = 0; i < u.size(); ++i) u[i] = in.t_s[i] / longest_s;
  return u;
}
Column direction(const RunInput& in) {
  Column d(in.size());
  for (size_t i = 0; i < d.size(); ++i) {
    const double slope = in.rate_degc_min[i];
    d[i] = slope / std::sqrt(slope * slope + kTurn_degc_min * kTurn_degc_min);
  }
  return d;
}
Column low_pass(const RunInput& in, const Column& x, double tau_s) {
  if (!(tau_s > 0)) return x;
  Column out(x.size());
  double state = 0, last_dt = -1, share = 0;
  for (size_t i = 0; i < x.size(); ++i) {
    const double dt = i ? in.t_s[i] - in.t_s[i - 1] : in.dt_s;
    if (dt != last_dt) share = 1 - std::exp(-dt / tau_s), last_dt = dt;
    state += share * (x[i] - state);
    out[i] = state;
  }
  return out;
}

enum class Shape { kTemperature, kDirection, kResponse, kTime, kTemperatureTime };

class FreeShape : public EffectEstimator {
public:
  // `relative_sd`: of each column.
  FreeShape(Shape shape, std::vector<double> relative_sd) : shape_(shape), relative_sd_(std::move(relative_sd)) {}
  Form form() const override { return Form::kColumns; }
  bool needs_temperature() const override { return shape_ != Shape::kTime; }
  size_t n_columns() const override { return relative_sd_.size(); }
  std::vector<double> relative_sd() const override { return relative_sd_; }
  std::vector<Column> columns(const RunInput& in, const Theta& theta) const override {
    const double longest_s = theta.empty() ? kLongest_s : theta[0];
    std::vector<Column> out;
    switch (shape_) {
    case Shape::kTemperature:
      add_cosines(unit_temperature(in), static_cast<int>(n_columns()), nullptr, &out);
      break;
    case Shape::kDirection: {
      const Column d = direction(in), slow = low_pass(in, d, 300);
      out.push_back(d), out.push_back(slow);
      add_cosines(unit_temperature(in), 5, &d, &out);
      add_cosines(unit_temperature(in), 5, &slow, &out);
      break;
    }
    case Shape::kResponse:
      for (double delay : kDelays_s) out.push_back(low_pass(in, in.rate_degc_min, delay));
      for (size_t j = 0; j < std::size(kDelays_s); ++j) {
        Column c = out[j];
        for (size_t i = 0; i < c.size(); ++i) c[i] *= in.tn[i];
        out.push_back(std::move(c));
      }
      break;
    case Shape::kTime:
      add_cosines(unit_time(in, longest_s), static_cast<int>(n_columns()), nullptr, &out);
      break;
    case Shape::kTemperatureTime: {
      const Column u = unit_time(in, longest_s);
      Column tilt(u.size());
      for (size_t i = 0; i < u.size(); ++i) tilt[i] = 2 * u[i] - 1;
      add_cosines(unit_temperature(in), 4, &tilt, &out);
      for (size_t i = 0; i < u.size(); ++i) tilt[i] = std::cos(2 * kPi * u[i]);
      add_cosines(unit_temperature(in), 4, &tilt, &out);
      break;
    }
    }
    return out;
  }
  PriorScale prior() const override { return {1, shape_ == Shape::kResponse, 1}; }
  Parameters values(const Estimate&) const override { return {}; }

private:
  Shape shape_;
  std::vector<double> relative_sd_;
};

// Cosines of temperature, of its past and of the time, and products of two of them.
class FreeFunction : public EffectEstimator {
public:
  explicit FreeFunction(bool with_time) : variables_(with_time ? 3 : 2) {}
  Form form() const override { return Form::kColumns; }
  bool needs_temperature() const override { return true; }
  size_t n_columns() const override { return relative_sd().size(); }
  std::vector<Column> columns(const RunInput& in, const Theta& theta) const override {
    std::vector<Column> u = {unit_temperature(in), unit_past(in, theta[0], theta[1])};
    if (variables_ == 3) u.push_back(unit_time(in, theta[2]));
    std::vector<Column> out;
    for (const Column& variable : u) add_cosines(variable, kOrder, nullptr, &out);
    for_products([&](size_t v, size_t w, int i, int j) {
      const Column &a = out[v * kOrder + static_cast<size_t>(i - 1)], &b = out[w * kOrder + static_cast<size_t>(j - 1)];
      Column product(a.size());
      for (size_t k = 0; k < a.size(); ++k) product[k] = a[k] * b[k];
      out.push_back(std::move(product));
    });
    return out;
  }
  // Prior 1/order, as rough as the free functions of one variable.
  std::vector<double> relative_sd() const override {
    std::vector<double> sd;
    for (size_t v = 0; v < variables_; ++v)
      for (int i = 1; i <= kOrder; ++i) sd.push_back(1.5 / i);
    for_products([&](size_t, size_t, int i, int j) { sd.push_back(1.5 / (i + j)); });
    return sd;
  }
  PriorScale prior() const override { return {1, false, 1}; }
  Parameters values(const Estimate&) const override { return {}; }

private:
  template <class F> void for_products(F f) const {
    for (size_t v = 0; v < variables_; ++v)
      for (size_t w = v + 1; w < variables_; ++w)
        for (int i = 1; i < kOrder; ++i)
          for (int j = 1; i + j <= kOrder; ++j) f(v, w, i, j);
  }
  static Column unit_past(const RunInput& in, double delay_s, double largest) {
    Column u = low_pass(in, in.rate_degc_min, delay_s);
    for (double& x : u) x = 0.5 + 0.5 * x / largest;
    return u;
  }
  size_t variables_;
};

std::vector<double> falling(size_t n) {
  std::vector<double> out(n);
  for (size_t k = 0; k < n; ++k) out[k] = 1.5 / static_cast<double>(k + 1);
  return out;
}

} // namespace

const Reference& free_function(bool with_time) {
  static const FreeFunction with(true), without(false);
  static const Reference of_all = {
      Family::kFunctionOfTime, "a free function of temperature, its past and time", {&with, {}}, false};
  static const Reference of_past = {
      Family::kThermalMemory, "a free function of temperature and its past", {&without, {}}, false};
  return with_time ? of_all : of_past;
}

std::vector<Theta> free_function_shapes(const Campaign& campaign, double longest_s) {
  std::vector<Theta> shapes;
  for (const double delay_s : kPasts_s) {
    double largest = 1e-9;
    for (const CampaignRun& run : campaign.runs)
      for (const double x : low_pass(run.input, run.input.rate_degc_min, delay_s))
        largest = std::max(largest, std::fabs(x));
    shapes.push_back({delay_s, largest, longest_s});
  }
  return shapes;
}

const Reference* any_shape_of(const Effect& effect) {
  static const std::map<const Effect*, Reference> all = [] {
    std::map<const Effect*, Reference> out;
    for (const Effect* e : effect_library()) {
      if (!e->estimator()) continue;
      const EffectEstimator::AnyShape any = e->estimator()->of_any_shape();
      if (any.estimator) out[e] = {e->family(), any.what, {any.estimator, {{}}}};
    }
    return out;
  }();
  const auto found = all.find(&effect);
  return found == all.end() ? nullptr : &found->second;
}

const std::vector<Reference>& free_shapes() {
  static const FreeShape temperature(Shape::kTemperature, falling(24)),
      direction(Shape::kDirection, std::vector<double>(12, 0.7)),
      response(Shape::kResponse, std::vector<double>(14, 0.7)), time(Shape::kTime, falling(20)),
      both(Shape::kTemperatureTime, std::vector<double>(8, 0.5));
  static const std::vector<Reference> list = {
      {Family::kFunctionOfTemperature, "a free function of temperature", {&temperature, {{}}}},
      {Family::kThermalMemory, "a free function of temperature and the direction of its change", {&direction, {{}}}},
      {Family::kThermalMemory, "a free response to earlier temperature rates", {&response, {{}}}},
      {Family::kFunctionOfTime, "a free function of the time since the start", {&time, {{}}}},
      {Family::kFunctionOfTime, "a free function of temperature and time", {&both, {{}}}, false},
  };
  return list;
}

} // namespace imucal
