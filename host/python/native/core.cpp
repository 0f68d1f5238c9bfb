// SPDX-License-Identifier: MIT
// The compiled part of the Python package: the C core's filter, and the Direct Predictor on arrays.  What is thin text
// and units around it is Python (imucal/calibrator.py, imucal/analysis.py).  Long work runs without the GIL; it is done in
// pieces between which Ctrl-C is seen.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <limits>

#include "analysis/dp/dp.h"
#include "analysis/dp/tau_grid.h"
#include "analysis/errormodel/confidence.h"
#include "analysis/fit/fit.h"
#include "base/error.h"
#include "io/json_file.h"
#include "io/log.h"
#include "io/model.h"
#include "io/notice.h"
#include "io/profile.h"
#include "io/table_json.h"
#include "kf.h"
#include "number_table.h"
#include "physics/effects/effect.h"
#include "seconds.h"
#include "ulog_split.h"

namespace nb = nanobind;
using namespace imucal;
using Bytes = nb::ndarray<const uint8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Array = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Table = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Indices = nb::ndarray<const int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

namespace {

std::optional<ErrorModel> model_of(const std::optional<std::string>& text) {
  if (!text) return std::nullopt;
  return model_from_json(parse_json(*text, "nominal"));
}

struct Curve {
  std::vector<double> tau_s, dp_dph;
  std::vector<double> ci95_dph; // lower and upper limit of one tau, then of the next; NaN where they were not asked for
  std::vector<int64_t> n_windows;
};

// An array that numpy owns from now on.
template <typename T> nb::ndarray<nb::numpy, T> take_over(std::unique_ptr<T[]> values, std::vector<size_t> shape) {
  T* const data = values.release();
  const nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<T*>(p); });
  return nb::ndarray<nb::numpy, T>(data, shape.size(), shape.data(), owner);
}

// In rows of `columns`, or as one row.
template <typename T> nb::ndarray<nb::numpy, T> copied(const std::vector<T>& values, size_t columns = 0) {
  std::unique_ptr<T[]> copy(new T[values.size()]);
  std::copy(values.begin(), values.end(), copy.get());
  if (columns > 0) return take_over(std::move(copy), {values.size() / columns, columns});
  return take_over(std::move(copy), {values.size()});
}

// Taus as a text of parse_tau or as numbers.
std::vector<double> taus_of(const nb::object& tau, double dt_s, double longest_s) {
  if (nb::isinstance<nb::str>(tau)) return parse_tau(nb::cast<std::string>(tau), dt_s, longest_s);
  const auto numbers = nb::cast<Array>(tau);
  if (numbers.shape(0) == 0) throw usage_error("tau_s is empty");
  return whole_taus({numbers.data(), numbers.data() + numbers.shape(0)}, dt_s, "tau_s");
}

// Ctrl-C between two pieces of work.
void check_signals() {
  nb::gil_scoped_acquire held;
  if (PyErr_CheckSignals() != 0) throw nb::python_error();
}

constexpr int kThreads = 2;                            // of reading: what a small machine has
constexpr char kLog[] = "array", kAxis[] = "rate_dph"; // what messages name
constexpr long kCachedSize = 16384;                    // samples whose running sums stay in the cache
constexpr long kPieceWindows = 100000000;              // some tenths of a second

// A trend beyond the mean is fitted to a copy.
bool needs_copy(const Detrend& detrend) {
  return detrend.kind != Detrend::Kind::kNone && detrend.kind != Detrend::Kind::kMean && detrend.order > 0;
}

// The array as it lies; its mean is taken away on the way where that is all.
RateView take_rates(const Array& rate_dph, double dt_s, const Detrend& detrend, Series* copy) {
  const auto n = static_cast<long>(rate_dph.shape(0));
  const RateView view(rate_dph.data(), n, detrend.kind != Detrend::Kind::kNone);
  if (!needs_copy(detrend)) return view;
  copy->log = kLog, copy->axis = kAxis, copy->dt_s = dt_s, copy->n_missing = view.n_missing;
  copy->rate_dph.assign(view.rate_dph, view.rate_dph + n);
  check_signals();
  remove_trend(detrend, copy);
  return *copy;
}

// The curve in pieces of a few tau, so that Ctrl-C is seen in a long record.  A short one is one piece: its blocks stay in
// the cache for all tau.
DpCurve curve_in_pieces(const RateView& rates, const DpRecord& record, const std::vector<double>& tau_s,
                        DpEstimator estimator, bool with_intervals) {
  // Intervals want sums by blocks; without them a record that the cache holds is taken in one go for each tau.
  const long per_window = !with_intervals && rates.size <= kCachedSize ? rates.size : 0;
  const size_t n_piece = static_cast<size_t>(std::max(1L, kPieceWindows / std::max(1L, rates.size)));
  DpCurve whole;
  for (size_t i = 0; i < tau_s.size() || i == 0; i += n_piece) {
    check_signals();
    const size_t end = std::min(tau_s.size(), i + n_piece);
    DpCurve piece =
        dp_curve(kLog, kAxis, rates, record,
                 {tau_s.begin() + static_cast<long>(i), tau_s.begin() + static_cast<long>(end)}, estimator, per_window);
    if (i == 0) {
      whole = std::move(piece);
      continue;
    }
    whole.tau_s.insert(whole.tau_s.end(), piece.tau_s.begin(), piece.tau_s.end());
    whole.dp_dph.insert(whole.dp_dph.end(), piece.dp_dph.begin(), piece.dp_dph.end());
    whole.n.insert(whole.n.end(), piece.n.begin(), piece.n.end());
    whole.moments.insert(whole.moments.end(), piece.moments.begin(), piece.moments.end());
  }
  return whole;
}

Curve direct_predictor(const Array& rate_dph, double dt_s, const std::string& type, const nb::object& tau,
                       const std::string& estimator, const std::optional<std::string>& nominal, double estimation_s,
                       const std::string& detrend, double min_fill, bool with_intervals) {
  Series copy;
  Curve result;
  try {
    const std::vector<double> tau_s =
        taus_of(tau, dt_s, std::max(dt_s, static_cast<double>(rate_dph.shape(0)) * dt_s / 10));
    nb::gil_scoped_release free;
    const RateView rates = take_rates(rate_dph, dt_s, Detrend::parse(detrend), &copy);
    check_signals();
    DpOperator op = make_dp_operator(dp_type_from_text(type), dt_s, model_of(nominal), estimation_s);
    op.min_fill = min_fill;
    const DpRecord record(rates, op);
    const DpCurve curve = curve_in_pieces(rates, record, tau_s, dp_estimator_from_text(estimator), with_intervals);
    check_signals();
    result.tau_s = curve.tau_s, result.dp_dph = curve.dp_dph, result.n_windows.assign(curve.n.begin(), curve.n.end());
    if (!with_intervals) {
      result.ci95_dph.assign(2 * result.tau_s.size(), std::numeric_limits<double>::quiet_NaN());
      return result;
    }
    for (const Interval& i : curve_intervals(curve, op, {}).ci)
      result.ci95_dph.push_back(i.lo), result.ci95_dph.push_back(i.hi);
  } catch (const Error& e) {
    throw nb::value_error(e.what());
  }
  return result;
}

// (rest, {message id: (bytes of a record, records)}), or None where the file is to be read whole.
nb::object split_ulog(const Bytes& file, const std::vector<std::string>& topics) {
  UlogSplit split;
  {
    nb::gil_scoped_release free;
    split = UlogSplitter(file.data(), file.shape(0), topics).split();
  }
  if (!split.is_simple) return nb::none();
  nb::dict blocks;
  for (auto& [id, block] : split.blocks) {
    if (block.bytes.empty()) continue;
    auto* const bytes = new std::vector<uint8_t>(std::move(block.bytes));
    const nb::capsule owner(bytes, [](void* p) noexcept { delete static_cast<std::vector<uint8_t>*>(p); });
    const nb::ndarray<nb::numpy, uint8_t, nb::ndim<1>> records(bytes->data(), {bytes->size()}, owner);
    blocks[nb::int_(id)] = nb::make_tuple(block.record_bytes, records);
  }
  return nb::make_tuple(nb::bytes(split.rest.data(), split.rest.size()), blocks);
}

// One array per column: (bits, whether they are int64, else float64); None where the text is no table of plain numbers.
nb::object read_numbers(const Bytes& text, size_t begin, size_t end, const std::string& delimiter, size_t n_columns) {
  if (begin > end || end > text.shape(0) || delimiter.size() != 1) throw nb::value_error("no such part of the text");
  NumberTable table;
  {
    nb::gil_scoped_release free;
    const char* const data = reinterpret_cast<const char*>(text.data());
    table = NumberTableReader(data + begin, end - begin, delimiter[0], n_columns, kThreads).read();
  }
  if (table.columns.empty()) return nb::none();
  nb::list columns;
  for (NumberColumn& column : table.columns)
    columns.append(nb::make_tuple(take_over(std::move(column.values), {table.n_rows}), column.is_whole));
  return std::move(columns);
}

// (means, standard deviations), each of shape (seconds, columns): seconds.h.
nb::object spread_of_seconds(const Table& values, const Indices& first, const Indices& n) {
  const size_t m = first.shape(0), k = values.shape(1), rows = values.shape(0);
  if (n.shape(0) != m) throw nb::value_error("first and n differ in length");
  for (size_t s = 0; s < m; ++s)
    if (first.data()[s] < 0 || n.data()[s] < 1 || static_cast<size_t>(first.data()[s] + n.data()[s]) > rows)
      throw nb::value_error("a second lies outside of the samples");
  std::unique_ptr<double[]> mean(new double[m * k]), deviation(new double[m * k]);
  {
    nb::gil_scoped_release free;
    for (size_t s = 0; s < m; ++s)
      spread_of(values.data() + static_cast<size_t>(first.data()[s]) * k, n.data()[s], k, &mean[s * k],
                &deviation[s * k]);
  }
  return nb::make_tuple(take_over(std::move(mean), {m, k}), take_over(std::move(deviation), {m, k}));
}

// (median step, samples in each second that has any) of increasing times in us; None where they do not increase.
nb::object steps_and_counts(const Indices& t_us) {
  std::vector<int64_t> counts;
  double step = 0;
  bool is_increasing = false;
  {
    nb::gil_scoped_release free;
    is_increasing = t_us.shape(0) >= 2 && find_steps(t_us.data(), t_us.shape(0), &step, &counts);
  }
  if (!is_increasing) return nb::none();
  return nb::make_tuple(step, copied(counts));
}

// Medians of a centred window of 2 half + 1 rows, the first and the last row repeated beyond the ends; values finite.
nb::object running_median(const Table& values, size_t half) {
  const size_t n = values.shape(0), k = values.shape(1);
  std::unique_ptr<double[]> medians(new double[n * k]);
  {
    nb::gil_scoped_release free;
    for (size_t c = 0; c < k; ++c) median_of_windows(values.data() + c, n, k, half, &medians[c]);
  }
  return nb::cast(take_over(std::move(medians), {n, k}));
}

// What the library has to say while this lives, for Python to say; no two at a time: they are made with the GIL held.
class Notices {
public:
  Notices() {
    set_notice_sink([this](const std::string& message) { messages_.push_back(message); });
  }
  ~Notices() {
    set_notice_sink([](const std::string&) {});
  }
  Notices(const Notices&) = delete;
  Notices& operator=(const Notices&) = delete;
  const std::vector<std::string>& messages() const { return messages_; }

private:
  std::vector<std::string> messages_;
};

// (times, temperatures, {axis: (rates, flags)}, {metadata}, [notices]) of a log, by the programs' own reader: io/log.h.
nb::object read_log_of(const std::string& path) {
  try {
    const Notices notices;
    const Log log = read_log(path);
    nb::dict axes, metadata;
    for (const LogAxis& axis : log.axes)
      axes[nb::str(axis.name.c_str())] = nb::make_tuple(copied(axis.rate_dph), copied(axis.flags));
    for (const auto& [key, value] : log.metadata) metadata[nb::str(key.c_str())] = nb::str(value.c_str());
    return nb::make_tuple(copied(log.t_s), copied(log.temp_degc), axes, metadata, notices.messages());
  } catch (const Error& e) {
    throw nb::value_error(e.what());
  }
}

// The library knows the effects of a model and their parameters; a model's own reader takes any.
void check_effects(const ErrorModel& model, const std::string& place) {
  for (size_t i = 0; i < model.effects.size(); ++i) {
    const std::string here = place + ": effects[" + std::to_string(i) + "]";
    const Effect* effect = nullptr;
    try {
      effect = &find_effect(model.effects[i].name);
    } catch (const Error& e) {
      throw data_error(here + ".name: " + e.what());
    }
    (void)read_parameters(*effect, model.effects[i].parameters, here);
  }
}

// The error of reading a text as a "model", "profile", "table" or, "", as JSON alone, as it stands behind the file's name
// (":17: …" or ": axes[0].order: …"); None where it is taken.
nb::object check_json(const std::string& text, const std::string& kind) {
  static const std::string kName = "@";
  try {
    const JsonField field = parse_json(text, kName);
    if (kind == "model") check_effects(model_from_json(field), kName);
    if (kind == "profile") (void)profile_from_json(field);
    if (kind == "table") (void)table_from_json(field);
  } catch (const Error& e) {
    return nb::str(e.what() + kName.size());
  }
  return nb::none();
}

// imucal_kf_t of an error model with one Markov term, with exceptions for refused configurations.
class Filter {
public:
  Filter(int order, double t0_degc, double range_degc, double arw_deg_rt_h, double sigma_dph, double tau_s,
         double prior_sigma) {
    if (order < 1 || order > IMUCAL_MAX_ORDER) throw nb::value_error(imucal_status_text(IMUCAL_ERR_ORDER));
    ErrorModel model;
    model.arw_deg_rt_h = arw_deg_rt_h, model.markov = {{sigma_dph, tau_s}};
    try {
      const imucal_kf_config_t config = kf_config(model, order, t0_degc, range_degc, prior_sigma);
      if (imucal_kf_init(&kf_, &config) != IMUCAL_OK) throw data_error("the filter refuses the model");
    } catch (const Error& e) {
      throw nb::value_error(e.what());
    }
  }

  bool update(double rate, double temp_degc) {
    if (std::isnan(rate) || std::isnan(temp_degc)) return skip(1);
    return imucal_kf_update(&kf_, static_cast<float>(rate), static_cast<float>(temp_degc)) == IMUCAL_OK;
  }
  bool skip(uint32_t n_s) { return imucal_kf_skip(&kf_, n_s) == IMUCAL_OK; }
  void new_run(double turn_on_sigma) {
    if (const imucal_status status = imucal_kf_new_run(&kf_, static_cast<float>(turn_on_sigma)); status != IMUCAL_OK)
      throw nb::value_error(imucal_status_text(status));
  }

  // All seconds of an array; NaN is a missing second.  Returns how many were refused.
  long run(const Array& rate, const Array& temp_degc) {
    if (rate.shape(0) != temp_degc.shape(0)) throw nb::value_error("rate and temp_degc differ in length");
    const double* z = rate.data();
    const double* t = temp_degc.data();
    const size_t n = rate.shape(0);
    const uint32_t before = kf_.stats.n_refused;
    nb::gil_scoped_release free;
    for (size_t k = 0; k < n; ++k) {
      update(z[k], t[k]);
      if (k % 262144 == 262143) check_signals();
    }
    return static_cast<long>(kf_.stats.n_refused - before);
  }

  std::vector<double> coefficients() const {
    std::vector<double> values;
    for (uint32_t i = 0; i <= kf_.config.order; ++i)
      values.push_back(static_cast<double>(imucal_kf_coefficient(&kf_, i)));
    return values;
  }
  double bias(double temp_degc) const {
    return static_cast<double>(imucal_kf_bias(&kf_, static_cast<float>(temp_degc)));
  }
  double sigma(double temp_degc) const {
    return static_cast<double>(imucal_kf_bias_sigma(&kf_, static_cast<float>(temp_degc)));
  }
  double innovation() const { return static_cast<double>(kf_.stats.innovation); }
  double innovation_variance() const { return static_cast<double>(imucal_kf_innovation_variance(&kf_)); }
  double mean_nis() const { return static_cast<double>(imucal_kf_mean_nis(&kf_)); }
  double lag1() const { return static_cast<double>(imucal_kf_lag1(&kf_)); }
  long n() const { return static_cast<long>(kf_.stats.n); }
  long n_missed() const { return static_cast<long>(kf_.stats.n_missed); }
  long n_refused() const { return static_cast<long>(kf_.stats.n_refused); }

private:
  imucal_kf_t kf_{};
};

} // namespace

NB_MODULE(_core, m) {
  m.doc() = "The compiled part of imucal.";
  nb::class_<Curve>(m, "Curve")
      .def_prop_ro(
          "tau_s", [](const Curve& c) { return copied(c.tau_s); }, nb::rv_policy::move)
      .def_prop_ro(
          "dp_dph", [](const Curve& c) { return copied(c.dp_dph); }, nb::rv_policy::move)
      .def_prop_ro(
          "ci95_dph", [](const Curve& c) { return copied(c.ci95_dph, 2); }, nb::rv_policy::move)
      .def_prop_ro(
          "n_windows", [](const Curve& c) { return copied(c.n_windows); }, nb::rv_policy::move);
  m.def("direct_predictor", &direct_predictor, nb::arg("rate_dph"), nb::arg("dt_s"), nb::arg("type"), nb::arg("tau"),
        nb::arg("estimator"), nb::arg("nominal").none(), nb::arg("estimation_s"), nb::arg("detrend"),
        nb::arg("min_fill"), nb::arg("with_intervals"));
  m.def("split_ulog", &split_ulog, nb::arg("file"), nb::arg("topics"));
  m.def("read_numbers", &read_numbers, nb::arg("text"), nb::arg("begin"), nb::arg("end"), nb::arg("delimiter"),
        nb::arg("n_columns"));
  m.def("read_log", &read_log_of, nb::arg("path"));
  m.def("check_json", &check_json, nb::arg("text"), nb::arg("kind"));
  m.def("steps_and_counts", &steps_and_counts, nb::arg("t_us"));
  m.def("running_median", &running_median, nb::arg("values"), nb::arg("half"));
  m.def("spread_of_seconds", &spread_of_seconds, nb::arg("values"), nb::arg("first"), nb::arg("n"));
  nb::class_<Filter>(m, "Filter")
      .def(nb::init<int, double, double, double, double, double, double>())
      .def("update", &Filter::update)
      .def("skip", &Filter::skip)
      .def("new_run", &Filter::new_run)
      .def("run", &Filter::run)
      .def("coefficients", &Filter::coefficients)
      .def("bias", &Filter::bias)
      .def("sigma", &Filter::sigma)
      .def_prop_ro("innovation", &Filter::innovation)
      .def_prop_ro("innovation_variance", &Filter::innovation_variance)
      .def_prop_ro("mean_nis", &Filter::mean_nis)
      .def_prop_ro("lag1", &Filter::lag1)
      .def_prop_ro("n", &Filter::n)
      .def_prop_ro("n_missed", &Filter::n_missed)
      .def_prop_ro("n_refused", &Filter::n_refused);
  m.attr("Filter").attr("usual_prior_sigma") = kPriorSigma;
}
