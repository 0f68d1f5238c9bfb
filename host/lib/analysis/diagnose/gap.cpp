// SPDX-License-Identifier: MIT
#include "analysis/diagnose/gap.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include "base/rng.h"
#include "base/units.h"

namespace imucal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kConstantSigma_dph = 1e4; // prior of the constant of a held-out unit: integrated out
constexpr int kBootstrap = 60;
constexpr double kMean_s = 60;
constexpr double kFurther = 1.1; // ratio of residual rms from which a prediction is called worse

// Coefficients that a held-out run takes over from the fit: of the polynomial and of the common columns of
// terms.
struct Learned {
  std::vector<double> polynomial;
  std::vector<std::vector<double>> terms;
};

Learned learn(const Campaign& training, const Hypothesis& h) {
  const Fit fit = fit_hypothesis(training, h);
  const Design design = make_design(training, h);
  Learned out;
  out.terms.resize(h.terms.size());
  for (size_t c = 0; c < design.cols(); ++c) {
    const int t = design.term_of_column[c];
    if (t == -1) out.polynomial.push_back(fit.beta[static_cast<long>(c)]);
    if (t >= 0) out.terms[static_cast<size_t>(t)].push_back(fit.beta[static_cast<long>(c)]);
  }
  return out;
}

// One held-out run: its mean by the learned coefficients, and the columns whose coefficients are its own.
struct Unit {
  Campaign campaign; // one run
  double seconds() const { return static_cast<double>(campaign.runs[0].n()) * campaign.dt_s; }
};

struct UnitModel {
  VectorXd mean;  // learned part [dph]
  MatrixXd own;   // constant, tones, random effects
  VectorXd sigma; // prior standard deviations of `own`
  NoiseModel noise;
};

UnitModel model_of(const Unit& unit, const Hypothesis& h, const Learned& learned) {
  // A step belongs to its log: it predicts nothing in another.
  Hypothesis carried = h;
  std::vector<int> place;
  carried.terms.clear();
  for (size_t t = 0; t < h.terms.size(); ++t) {
    if (h.terms[t].form() == Form::kSteps) continue;
    carried.terms.push_back(h.terms[t]);
    place.push_back(static_cast<int>(t));
  }
  const Design design = make_design(unit.campaign, carried);
  const MatrixXd& x = design.x.front();
  UnitModel out;
  out.noise = carried.noise();
  out.mean = VectorXd::Zero(x.rows());
  size_t power = 0;
  std::vector<size_t> used(carried.terms.size(), 0);
  std::vector<long> own;
  std::vector<double> sigma;
  for (long c = 0; c < x.cols(); ++c) {
    const int t = design.term_of_column[static_cast<size_t>(c)];
    if (t == -2) {
      own.push_back(c), sigma.push_back(kConstantSigma_dph);
    } else if (t == -1) {
      out.mean += learned.polynomial[power++] * x.col(c);
    } else {
      const Term& term = carried.terms[static_cast<size_t>(t)];
      const std::vector<double>& beta = learned.terms[static_cast<size_t>(place[static_cast<size_t>(t)])];
      if (term.form() == Form::kColumns) {
        out.mean += beta[used[static_cast<size_t>(t)]++] * x.col(c);
      } else if (term.form() == Form::kTone) {
        double square = 0;
        for (double b : beta) square += b * b;
        own.push_back(c),
            sigma.push_back(std::sqrt(square / std::max<double>(1, static_cast<double>(beta.size()))) + 1e-9);
      } else if (term.form() == Form::kRunRandom) {
        own.push_back(c), sigma.push_back(term.shape[0]);
      }
    }
  }
  out.own.resize(x.rows(), static_cast<long>(own.size()));
  out.sigma.resize(static_cast<long>(own.size()));
  for (size_t i = 0; i < own.size(); ++i) {
    out.own.col(static_cast<long>(i)) = x.col(own[i]);
    out.sigma[static_cast<long>(i)] = sigma[i];
  }
  return out;
}

struct UnitScore {
  double deviance = 0;
  VectorXd residual; // rate minus mean and own columns [dph]
};

// -2 log of the density of the held-out rates, own coefficients integrated out (Woodbury), constant of 2 pi
// left out.
UnitScore score(const Unit& unit, const UnitModel& model, const VectorXd& y) {
  NoiseModel gaussian = model.noise;
  gaussian.hit_probability = 0;
  if (gaussian.telegraph_dph > 0)
    gaussian.markov.push_back({gaussian.telegraph_dph, gaussian.telegraph_tau_s});
  gaussian.telegraph_dph = 0;
  const CampaignRun& run = unit.campaign.runs.front();
  const long p = model.own.cols();
  MatrixXd xy(model.own.rows(), p + 1);
  xy << model.own, y - model.mean;
  VectorXd extra;
  UnitScore out;
  for (int pass = 0; pass < (model.noise.hit_probability > 0 ? 2 : 1); ++pass) {
    if (pass == 1) {
      mixture_log_likelihood(run, model.noise, out.residual, nullptr, &extra);
      extra *= model.noise.hit_sigma_dph * model.noise.hit_sigma_dph;
    }
    const RunGains gains = compute_gains(run, gaussian, pass ? &extra : nullptr);
    MatrixXd white = xy;
    whiten(gains, &white);
    MatrixXd stack(p + white.rows(), p + 1);
    stack.setZero();
    for (long c = 0; c < p; ++c) stack(c, c) = 1.0;
    stack.bottomRows(white.rows()) = white;
    for (long c = 0; c < p; ++c) stack.col(c).tail(white.rows()) *= model.sigma[c];
    Eigen::HouseholderQR<MatrixXd> qr(stack);
    const MatrixXd r = qr.matrixQR().topRows(p + 1).triangularView<Eigen::Upper>();
    double log_det = 0;
    for (long c = 0; c < p; ++c) log_det += 2 * std::log(std::fabs(r(c, c)));
    out.deviance = gains.sum_log_s + r(p, p) * r(p, p) + log_det;
    VectorXd b = r.topLeftCorner(p, p).triangularView<Eigen::Upper>().solve(r.block(0, p, p, 1));
    b = b.cwiseProduct(model.sigma);
    out.residual = xy.rightCols(1) - model.own * b;
    if (model.noise.is_mixture() && pass + 1 == (model.noise.hit_probability > 0 ? 2 : 1))
      out.deviance = -2 * mixture_log_likelihood(run, model.noise, out.residual) + log_det;
  }
  return out;
}

// A held-out unit and the campaign its model is learned from.
struct Split {
  Campaign training;
  Unit unit;
};

Campaign only(const Campaign& campaign, const std::vector<size_t>& runs) {
  Campaign out = campaign;
  out.runs.clear();
  for (size_t r : runs) out.runs.push_back(campaign.runs[r]);
  return out;
}

void keep_used(CampaignRun* run, const std::vector<bool>& keep) {
  std::vector<int> used;
  for (size_t k = 0; k < run->used.size(); ++k)
    if (keep[k]) used.push_back(run->used[k]);
  run->used = used;
  run->steps.clear();
  for (size_t k = 0; k < used.size(); ++k)
    run->steps.push_back(k ? static_cast<int>(run->input.tick[static_cast<size_t>(used[k])] -
                                              run->input.tick[static_cast<size_t>(used[k - 1])])
                           : 0);
}

std::vector<Split> splits(const Campaign& campaign, const Campaign* held_out, std::string* method) {
  std::vector<Split> out;
  if (held_out) {
    *method = "held-out logs";
    for (size_t r = 0; r < held_out->runs.size(); ++r) out.push_back({campaign, {only(*held_out, {r})}});
    return out;
  }
  if (campaign.runs.size() > 1) {
    *method = "each log held out in turn";
    for (size_t r = 0; r < campaign.runs.size(); ++r) {
      std::vector<size_t> others;
      for (size_t i = 0; i < campaign.runs.size(); ++i)
        if (i != r) others.push_back(i);
      out.push_back({only(campaign, others), {only(campaign, {r})}});
    }
    return out;
  }
  *method = "quarters of the one log held out in turn";
  const size_t n = campaign.runs[0].n();
  for (size_t q = 0; q < 4; ++q) {
    Split split{campaign, {campaign}};
    std::vector<bool> in(n), rest(n);
    for (size_t k = 0; k < n; ++k) in[k] = k * 4 / n == q, rest[k] = !in[k];
    keep_used(&split.training.runs[0], rest);
    keep_used(&split.unit.campaign.runs[0], in);
    out.push_back(split);
  }
  return out;
}

// Steps name their log by its place: gone when the log is held out.
Hypothesis for_training(const Hypothesis& h, const Campaign& whole, const Campaign& training) {
  if (whole.runs.size() == training.runs.size()) return h;
  Hypothesis out = h;
  for (Term& term : out.terms) {
    if (term.form() != Form::kSteps) continue;
    Theta kept;
    for (size_t s = 0; s + 1 < term.shape.size(); s += 2)
      for (size_t r = 0; r < training.runs.size(); ++r)
        if (training.runs[r].input.log == whole.runs[static_cast<size_t>(term.shape[s])].input.log) {
          kept.push_back(static_cast<double>(r));
          kept.push_back(term.shape[s + 1]);
        }
    term.shape = kept;
  }
  return out;
}

double rms_of_means(const std::vector<VectorXd>& residuals, double dt_s) {
  double sum = 0, n = 0;
  const long block = std::max<long>(1, std::lround(kMean_s / dt_s));
  for (const VectorXd& r : residuals)
    for (long k = 0; k + block <= r.size(); k += block) {
      const double mean = r.segment(k, block).mean();
      sum += mean * mean, n += 1;
    }
  return n > 0 ? std::sqrt(sum / n) : 0;
}

// DP2 of a residual path: error of the mean over the next n samples, predicted by the nominal model's filter.
std::vector<double> dp2(const std::vector<VectorXd>& paths, const NoiseModel& nominal, double dt_s,
                        const std::vector<double>& tau_s) {
  const double phi = nominal.markov.empty() ? 0 : nominal.markov[0].phi(dt_s);
  const double q = nominal.markov.empty() ? 0 : nominal.markov[0].q_dph2(dt_s);
  const double r = nominal.white_sigma_dph * nominal.white_sigma_dph / dt_s;
  double p = q / std::max(1e-12, 1 - phi * phi);
  for (int i = 0; i < 5000; ++i) p = phi * phi * p * r / (p + r) + q;
  const double gain = p / (p + r);
  std::vector<double> out;
  for (double tau : tau_s) {
    const long n = std::lround(tau / dt_s);
    double sum = 0, count = 0;
    for (const VectorXd& x : paths) {
      VectorXd cumulative(x.size() + 1);
      cumulative[0] = 0;
      for (long k = 0; k < x.size(); ++k) cumulative[k + 1] = cumulative[k] + x[k];
      double estimate = 0;
      const long stride = std::max<long>(1, n / 10);
      for (long k = 0; k + n <= x.size(); ++k) {
        if (k > 300 && k % stride == 0) {
          const double d = (cumulative[k + n] - cumulative[k]) / static_cast<double>(n) - estimate;
          sum += d * d, count += 1;
        }
        estimate = phi * (estimate + gain * (x[k] - estimate));
      }
    }
    out.push_back(count > 0 ? std::sqrt(sum / count / 2) : std::nan(""));
  }
  return out;
}

// The same deviance for many draws of one unit: gains and the whitened own columns are computed once.
class Scorer {
public:
  Scorer(const Unit& unit, const UnitModel& model) : unit_(unit), model_(model) {
    NoiseModel noise = model.noise;
    noise.hit_probability = noise.telegraph_dph = 0;
    gains_ = compute_gains(unit.campaign.runs.front(), noise);
    z_ = model.own;
    whiten(gains_, &z_);
    z_ *= model.sigma.asDiagonal();
    llt_.compute(z_.transpose() * z_ + MatrixXd::Identity(z_.cols(), z_.cols()));
    for (long c = 0; c < z_.cols(); ++c) constant_ += 2 * std::log(llt_.matrixLLT()(c, c));
    constant_ += gains_.sum_log_s;
  }
  const RunGains& gains() const { return gains_; }
  double deviance(const VectorXd& y) const {
    if (model_.noise.is_mixture()) return score(unit_, model_, y).deviance;
    VectorXd e = y - model_.mean;
    whiten(gains_, e.data(), static_cast<size_t>(e.size()));
    const VectorXd half = llt_.matrixL().solve(z_.transpose() * e);
    return constant_ + e.squaredNorm() - half.squaredNorm();
  }

private:
  const Unit& unit_;
  const UnitModel& model_;
  RunGains gains_;
  MatrixXd z_;
  Eigen::LLT<MatrixXd> llt_;
  double constant_ = 0;
};

VectorXd simulated(const UnitModel& model, const RunGains& gains, Rng* rng) {
  VectorXd y(model.mean.size());
  for (long k = 0; k < y.size(); ++k) y[k] = rng->normal();
  colour(gains, y.data(), static_cast<size_t>(y.size()));
  if (model.noise.telegraph_dph > 0) {
    double level = rng->uniform() < 0.5 ? -model.noise.telegraph_dph : model.noise.telegraph_dph;
    for (long k = 0; k < y.size(); ++k) {
      if (rng->uniform() < -0.5 * std::expm1(-1.0 / model.noise.telegraph_tau_s)) level = -level;
      y[k] += level;
    }
  }
  if (model.noise.hit_probability > 0)
    for (long k = 0; k < y.size(); ++k)
      if (rng->uniform() < model.noise.hit_probability) y[k] += model.noise.hit_sigma_dph * rng->normal();
  for (long c = 1; c < model.own.cols(); ++c) y += model.own.col(c) * (model.sigma[c] * rng->normal());
  return y + model.mean;
}

// A free shape over temperature and direction, over earlier temperature rates, and over time: what a model
// without names would predict.  The better of it and the final model is the reference of the gap.
class FreeMean : public EffectEstimator {
public:
  FreeMean(const Campaign& c, int kind)
      : lo_(c.lo_degc), span_(std::max(1e-9, c.hi_degc - c.lo_degc)), kind_(kind) {}
  Form form() const override { return Form::kColumns; }
  size_t n_columns() const override { return kind_ == 0 ? 22 : 11; }
  std::vector<Column> columns(const RunInput& in, const Theta&) const override {
    std::vector<Column> out(n_columns(), Column(in.size(), 0.0));
    for (size_t i = 0; i < in.size(); ++i) {
      if (kind_ == 0) {
        const double at = (in.smooth_degc[i] - lo_) / span_ * 10;
        const size_t first = in.rate_degc_min[i] > 0 ? 11 : 0;
        for (size_t k = 0; k < 11; ++k)
          out[first + k][i] = std::max(0.0, 1 - std::fabs(at - static_cast<double>(k)));
      } else {
        for (size_t k = 0; k < 11; ++k) {
          const size_t back = static_cast<size_t>(kDelays_s[k] / in.dt_s);
          out[k][i] = i >= back ? in.rate_degc_min[i - back] : 0.0;
        }
      }
    }
    return out;
  }
  Parameters values(const Estimate&) const override { return {}; }

private:
  double lo_, span_;
  int kind_;
};

struct Totals {
  std::vector<double> deviance;
  std::vector<VectorXd> residuals;
};

Totals total(const std::vector<Split>& all, const Campaign& whole, const Hypothesis& h,
             std::vector<UnitModel>* models) {
  Totals out;
  Learned learned;
  for (size_t u = 0; u < all.size(); ++u) {
    const Hypothesis fitted = for_training(h, whole, all[u].training);
    // With held-out logs the training is the same for all units.
    const bool same =
        u > 0 && all[u].training.runs.size() == whole.runs.size() && all[u].training.n() == whole.n();
    if (!same) learned = learn(all[u].training, fitted);
    const UnitModel model = model_of(all[u].unit, fitted, learned);
    const UnitScore s = score(all[u].unit, model, rates(all[u].unit.campaign).front());
    out.deviance.push_back(s.deviance);
    out.residuals.push_back(s.residual);
    if (models) models->push_back(model);
  }
  return out;
}

double sum(const std::vector<double>& x) {
  double s = 0;
  for (double v : x) s += v;
  return s;
}

} // namespace

GapResult measure_gap(const Campaign& campaign, const Campaign* held_out, const Selection& selection,
                      uint64_t seed) {
  GapResult out;
  const std::vector<Split> all = splits(campaign, held_out, &out.method);
  std::vector<UnitModel> nominal_models, final_models;
  const Totals before = total(all, campaign, selection.nominal, &nominal_models);
  const bool has_effects = !selection.final.terms.empty();
  const Totals after = has_effects ? total(all, campaign, selection.final, &final_models) : before;
  if (!has_effects) final_models = nominal_models;
  double seconds = 0;
  for (const Split& s : all) seconds += s.unit.seconds();
  out.hours = seconds / 3600;
  for (size_t u = 0; u < all.size(); ++u) out.delta_by_unit.push_back(before.deviance[u] - after.deviance[u]);
  out.delta_deviance = sum(out.delta_by_unit);

  for (size_t t = 0; has_effects && t < selection.final.terms.size(); ++t) {
    Hypothesis without = selection.final;
    without.terms.erase(without.terms.begin() + static_cast<long>(t));
    const bool is_step = selection.final.terms[t].form() == Form::kSteps;
    const double value =
        is_step ? std::nan("") : sum(total(all, campaign, without, nullptr).deviance) - sum(after.deviance);
    out.gain_by_term.push_back(value / out.hours);
  }

  // Reference: the final model, or it with a free mean where a library-free test still fires.
  double reference = std::min(sum(after.deviance), sum(before.deviance));
  bool fires = false;
  for (const GenericFinding& f : selection.after) fires = fires || f.evidence_nats() > 0;
  std::string better;
  if (fires && campaign.has_temperature) {
    for (int kind = 0; kind < 2; ++kind) {
      const FreeMean free(campaign, kind);
      Hypothesis h = selection.final;
      Term term;
      term.estimator = &free;
      h.terms.push_back(term);
      const double value = sum(total(all, campaign, h, nullptr).deviance);
      if (value < reference) {
        reference = value;
        better = kind == 0 ? "a free shape over temperature and direction"
                           : "a free response to earlier temperature rates";
      }
    }
  }
  out.before = (sum(before.deviance) - reference) / out.hours;
  out.after = (sum(after.deviance) - reference) / out.hours;
  out.shrinkage = out.before > 1e-9 ? 1 - out.after / out.before : 0;
  bool has_steps = false, only_steps = has_effects;
  for (const Term& term : selection.final.terms) {
    has_steps = has_steps || term.form() == Form::kSteps;
    only_steps = only_steps && term.form() == Form::kSteps;
  }
  out.remainder = better.empty()
                      ? (fires ? "a remainder that the library-free tests see and no reference here predicts"
                               : "nothing detectable on the held-out data")
                      : better + " would still predict " + std::to_string(std::lround(out.after)) +
                            " deviance per hour more";

  if (only_steps) {
    out.shrinkage = 0;
    out.remainder = "steps belong to the moment and log they happened in: they predict nothing on other data";
  } else if (out.before <= 1e-9) {
    // The nominal model predicts the held-out data best: there is no gap on them to shrink.
    out.shrinkage = 0;
    if (has_effects) out.remainder = "the effects found do not show on the held-out data";
  } else if (has_steps) {
    out.remainder += "; the steps predict nothing on other data and are left out";
  }

  std::vector<Scorer> nominal_scorers, final_scorers;
  for (size_t u = 0; u < all.size(); ++u) {
    nominal_scorers.emplace_back(all[u].unit, nominal_models[u]);
    final_scorers.emplace_back(all[u].unit, final_models[u]);
  }
  // Interval of the gain: simulate the held-out units from the final model and score them again.
  if (has_effects) {
    std::vector<double> gains;
    for (int b = 0; b < kBootstrap; ++b) {
      double gain = 0;
      for (size_t u = 0; u < all.size(); ++u) {
        Rng rng(seed, static_cast<uint64_t>(b), static_cast<uint32_t>(u),
                static_cast<uint32_t>(Stream::kTool) + 8);
        const VectorXd y = simulated(final_models[u], final_scorers[u].gains(), &rng);
        gain += nominal_scorers[u].deviance(y) - final_scorers[u].deviance(y);
      }
      gains.push_back(gain);
    }
    double mean = 0, square = 0;
    for (double g : gains) mean += g / kBootstrap;
    for (double g : gains) square += (g - mean) * (g - mean) / (kBootstrap - 1);
    const double half = 2.0 * std::sqrt(square); // t with 59 degrees of freedom
    out.gain = out.delta_deviance / out.hours;
    out.gain_lo = (out.delta_deviance - half) / out.hours;
    out.gain_hi = (out.delta_deviance + half) / out.hours;
    if (out.before > 1e-9 && !only_steps) {
      out.ci_lo = std::clamp(out.gain_lo / out.before, -1.0, 1.0);
      out.ci_hi = std::clamp(out.gain_hi / out.before, -1.0, 1.0);
    }
    out.interval_method =
        "parametric bootstrap of the final model, " + std::to_string(kBootstrap) + " replicates";
  }
  out.rms_before_dph = rms_of_means(before.residuals, campaign.dt_s);
  out.rms_after_dph = rms_of_means(after.residuals, campaign.dt_s);
  if (out.rms_after_dph > kFurther * out.rms_before_dph)
    out.remainder +=
        "; the predicted mean is further from the held-out rates than before: the deviance falls only "
        "because larger errors are expected";

  // DP2 of the residual against that of simulations of either model, treated in the same way.
  double shortest = 1e300;
  for (const Split& s : all) shortest = std::min(shortest, s.unit.seconds());
  for (double tau = 2; tau <= shortest / 4; tau *= 1.6) out.dp2_tau_s.push_back(std::round(tau));
  const NoiseModel& filter = selection.nominal.base_noise;
  const auto simulated_curve = [&](const std::vector<UnitModel>& truth, const std::vector<Scorer>& scorers) {
    std::vector<double> square(out.dp2_tau_s.size(), 0.0);
    constexpr int kDraws = 4;
    for (int d = 0; d < kDraws; ++d) {
      std::vector<VectorXd> paths;
      for (size_t u = 0; u < all.size(); ++u) {
        Rng rng(seed, static_cast<uint64_t>(d), static_cast<uint32_t>(u),
                static_cast<uint32_t>(Stream::kTool) + 9);
        paths.push_back(
            score(all[u].unit, nominal_models[u], simulated(truth[u], scorers[u].gains(), &rng)).residual);
      }
      const std::vector<double> curve = dp2(paths, filter, campaign.dt_s, out.dp2_tau_s);
      for (size_t i = 0; i < square.size(); ++i) square[i] += curve[i] * curve[i] / kDraws;
    }
    for (double& s : square) s = std::sqrt(s);
    return square;
  };
  out.dp2_data_dph = dp2(before.residuals, filter, campaign.dt_s, out.dp2_tau_s);
  out.dp2_nominal_dph = simulated_curve(nominal_models, nominal_scorers);
  out.dp2_final_dph = has_effects ? simulated_curve(final_models, final_scorers) : out.dp2_nominal_dph;
  const auto distance = [&](const std::vector<double>& model) {
    double s = 0, n = 0;
    for (size_t i = 0; i < model.size(); ++i)
      if (std::isfinite(model[i]) && std::isfinite(out.dp2_data_dph[i]))
        s += std::pow(model[i] - out.dp2_data_dph[i], 2), n += 1;
    return n > 0 ? std::sqrt(s / n) : 0;
  };
  out.dp2_before_dph = distance(out.dp2_nominal_dph);
  out.dp2_after_dph = distance(out.dp2_final_dph);
  return out;
}

} // namespace imucal
