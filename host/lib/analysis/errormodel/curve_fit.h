// SPDX-License-Identifier: MIT
// Error models from Direct Predictor curves: the tightest bounding model, and least squares.
//
// For fixed time constants E d^2 is linear in the white variance and in each Markov variance.  The tightest bound
// minimises the sum over tau of model^2/data^2 - 1 subject to model >= data at every tau and variances >= 0.  Over a grid
// of time constants this is a linear program, and its solution is the global optimum (Clp's simplex, lp.h).
// A model with few Markov terms is then searched: the variances by the same program with that many columns, the time
// constants around it (all combinations of a coarse grid, then Nelder-Mead from the best).
//
// Where the data were detrended, the model's curve is that of a detrended record (expect.h): the fit of a trend removes
// part of the noise, and the model must allow for that.
#pragma once
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "analysis/errormodel/expect.h"

namespace imucal {

class CurveBasis;

// One curve to fit: mean squares of d at n, and the records they come from (for their expectation).
struct CurveData {
  DpOperator op;
  Detrend detrend;
  std::vector<long> n;
  std::vector<double> mean_square_dph2;
  std::vector<double> dof;           // equivalent degrees of freedom per n, summed over records
  std::vector<const Series*> shapes; // of equal dt
  double record_s = 0;               // longest record
  // What the fits expect; made anew by each of them where it is not set.  Records of the same shape, such as simulated
  // ones, share it.
  std::shared_ptr<const CurveBasis> basis;
};

// rms or max across the records' curves.
enum class Across { kRms, kMax };
// `series` detrended already with `detrend`; they must outlive the result.  Windows begin at every sample, or (some) an
// eighth of a window apart: the spread of the curve is the same to 1 %, its time no longer grows with tau.
enum class Windows { kAll, kSome };
CurveData make_curve_data(const std::vector<Series>& series, const DpOperator& op, const Detrend& detrend,
                          const std::vector<double>& tau_s, Across across, Windows windows = Windows::kAll);

// Expected mean squares per unit variance of a component.
class CurveBasis {
public:
  explicit CurveBasis(const CurveData& data);
  std::vector<double> white() const { return columns_[0]; }
  std::vector<double> markov(double tau_s) const; // any time constant: closed form times an interpolated correction
  const std::vector<double>& grid_tau_s() const { return grid_tau_s_; }
  const std::vector<double>& grid_column(size_t i) const { return columns_[i + 1]; }
  std::vector<double> model(const ErrorModel& m) const; // white and Markov terms only

private:
  std::vector<double> closed_markov(double tau_s) const;
  DpOperator op_;
  std::vector<long> n_;
  std::vector<double> grid_tau_s_;
  std::vector<std::vector<double>> columns_; // white, then the grid
  std::vector<std::vector<double>> ratio_;   // record over stationary, per grid point; empty: 1
};

struct Excess {
  double worst = 0, mean = 0;       // of model over data, relative, in DP
  double worst_ratio = 0;           // smallest model over data
  double at_tau_s = 0;              // where it is smallest
  std::vector<double> active_tau_s; // bound touched there (within 1e-6)
};
Excess excess_of(const CurveData& data, const std::vector<double>& model_square);

struct CurveFit {
  ErrorModel model;
  bool bounded = false;
  Excess excess;
  double objective = 0; // bound: sum of relative excess of the squares; ls: chi^2 per point
  // Bound: what any number of Markov terms of the grid could reach, and what each number reached.
  double grid_objective = 0;
  ErrorModel grid_model;
  std::vector<double> objective_by_terms; // index: number of Markov terms
  std::vector<double> mean_excess_by_terms;
};

// n_markov < 0: the smallest number whose mean relative excess of DP is at most `enough` above that of the grid.
CurveFit fit_bound(const CurveData& data, int n_markov, double enough = 0.005);

// A model that just bounds one test will not bound the next one.  So the data are first raised, at each tau, to the upper
// limit of their one-sided interval (chi-squared with `dof`).  confidence 0: unchanged.
CurveData raised_to_confidence(CurveData data, double confidence);
// Weighted least squares of ln DP^2, weights dof per tau.  n_markov < 0: chosen by an F-like rule: another term must
// lower the sum of squares, per effective point, by more than its 95 % level.
CurveFit fit_least_squares(const CurveData& data, int n_markov);

// Which tau tell about a parameter: d ln DP / d ln parameter times sqrt(2 dof), in standard deviations.
struct Information {
  std::string parameter;             // "arw_deg_rt_h", "markov[0].sigma_dph", …
  double tau_lo_s = 0, tau_hi_s = 0; // where at least half of the largest
  double largest = 0;                // 1: a change by e is one standard deviation
};
std::vector<Information> curve_information(const CurveData& data, const ErrorModel& model);

} // namespace imucal
