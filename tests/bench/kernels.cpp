// SPDX-License-Identifier: MIT
// The kernels whose speed is kept (tests/bench/kept.py), each called through the library's public doors.
// usage: kernels FOLDER           processor time of each as JSON: seconds of one call, and over those of `reference`
//        kernels FOLDER KERNEL    one call of one kernel, for counting its instructions (callgrind collects kernel_call)
// FOLDER takes the log that `log_reading` reads.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <fstream>
#include <functional>
#include <iostream>

#include "analysis/dp/dp.h"
#include "analysis/dp/tau_grid.h"
#include "analysis/montecarlo/campaign.h"
#include "analysis/montecarlo/chain.h"
#include "base/fast_normal.h"
#include "base/rng.h"
#include "io/json_file.h"
#include "io/log.h"
#include "noise/whiten.h"

using namespace imucal;

namespace {

volatile double sink; // what is computed must not be optimised away

const ErrorModel kModel = {0.6, {{20, 100}}, 0, {}, {}};

// The yardstick of this machine: a chain of dependent multiplications and additions, and of 64-bit integers.
double reference() {
  double x = 0.5;
  uint64_t bits = 1;
  for (int i = 0; i < 2000000; ++i) {
    x = 3.6 * x * (1 - x);
    bits ^= bits << 13, bits ^= bits >> 7, bits ^= bits << 17;
  }
  return x + static_cast<double>(bits >> 60);
}

std::vector<double> record(size_t n) {
  Rng rng(1, 0, 0, Stream::kTool);
  std::vector<double> out(n);
  for (double& x : out) x = 36 * rng.normal();
  return out;
}

std::function<double()> prepare_dp_oadev() {
  Series series;
  series.rate_dph = record(200000);
  return [series] {
    Series s = series;
    remove_trend(Detrend{}, &s);
    const DpOperator op = make_dp_operator(DpType::kAv, 1, kModel);
    return dp_curve(s, DpRecord(s, op), parse_tau("octave", 1, 100000), DpEstimator::kRms).dp_dph.back();
  };
}

std::function<double()> prepare_whiten() {
  const std::vector<double> rows = record(4 * 20000);
  return [rows] {
    std::vector<double> columns = rows;
    whiten_rows(compute_gains({20000, nullptr, 1.0}, noise_of(kModel)), 4, columns.data());
    return columns.back();
  };
}

// What a simulated raw sample needs at least.
std::function<double()> prepare_normals() {
  return [] {
    FastNormal noise(Rng(1, 0, 0, Stream::kTool));
    double sum = 0;
    for (int i = 0; i < 100000; ++i) sum += noise.normal();
    return sum;
  };
}

// As many, of eight streams side by side.
std::function<double()> prepare_normals_of_8() {
  return [] {
    const auto stream = [](uint64_t run) { return FastNormal(Rng(1, run, 0, Stream::kTool)); };
    FastNormalLanes noise({stream(0), stream(1), stream(2), stream(3), stream(4), stream(5), stream(6), stream(7)});
    double sum = 0, block[8 * 100];
    for (int i = 0; i < 125; ++i) {
      noise.normals(100, block);
      for (const double x : block) sum += x;
    }
    return sum;
  };
}

// Raw samples -> sum -> kf -> table, 600 s at 10 Hz.
std::function<double()> prepare_kf_chain() {
  std::vector<imucal_sample_t> samples(6000);
  Rng rng(1, 0, 0, Stream::kTool);
  for (size_t i = 0; i < samples.size(); ++i) {
    samples[i] = {};
    samples[i].t_us = 100000 * i + 50000;
    samples[i].temp_counts = static_cast<int32_t>(i) - 3000;
    samples[i].counts[0] = static_cast<int32_t>(100 * rng.normal());
    samples[i].n_channels = 1;
  }
  return [samples] {
    ChainSetup setup;
    setup.filter = kModel;
    setup.t0_degc = 25, setup.range_degc = 30;
    setup.span_lo_degc = -4, setup.span_hi_degc = 54;
    setup.raw.rate_hz = 10;
    CoreChain chain(setup);
    for (const imucal_sample_t& sample : samples) chain.push(sample);
    chain.finish();
    return chain.table_bias_dph(25);
  };
}

// Eight runs of 600 s side by side at 10 Hz, random numbers included.
std::function<double()> prepare_montecarlo() {
  CampaignOptions options;
  options.model = options.filter = kModel;
  options.profile.segments = {{6, 0, 60}};
  options.raw.rate_hz = 10;
  options.raw.counts_scale_dph = 1;
  options.least_squares_every = options.reference_every = options.residual_every = 0;
  const CampaignPlan plan = plan_campaign(options);
  return [plan] { return calibrate_runs(plan, 0, kBatch).back().chain.table_bias_dph(25); };
}

std::function<double()> prepare_comp() {
  imucal_table_t table;
  std::memset(&table, 0, sizeof table);
  table.n_channels = 1;
  table.degc_per_count = 0.01f, table.degc_at_zero = 25;
  imucal_table_channel_t& c = table.channel[0];
  c.order = 5, c.t0_degc = c.range_degc = 30, c.span_hi_degc = 60;
  for (int k = 0; k <= 5; ++k) c.coeff[k] = 300.0f - 77.0f * static_cast<float>(k);
  c.scale_order = 2;
  for (float& m : c.scale_coeff) m = 0.002f;
  c.unit_per_count = 1, c.full_scale_counts = 8388607;
  imucal_comp_t prepared;
  if (imucal_comp_prepare(&prepared, &table, 0) != IMUCAL_OK) std::abort();
  return [prepared] {
    uint32_t flags = 0;
    int64_t sum = 0;
    for (int32_t i = 0; i < 100000; ++i) sum += imucal_comp_apply(&prepared, i % 6000 - 2500, 37 * i, &flags);
    return static_cast<double>(sum);
  };
}

std::function<double()> prepare_log_reading(const std::string& folder) {
  const std::string path = folder + "/kernels.csv";
  std::ofstream out(path);
  out << "# imucal_log = 1\nt_s,temp_degc,gx_dph,gy_dph,gz_dph\n";
  Rng rng(1, 0, 0, Stream::kTool);
  char line[120];
  for (int i = 1; i <= 10000; ++i) {
    std::snprintf(line, sizeof line, "%d,%.3f,%.3f,%.3f,%.3f\n", i, 20 + 0.001 * i, 36 * rng.normal(),
                  36 * rng.normal(), 36 * rng.normal());
    out << line;
  }
  out.close();
  return [path] { return read_log(path).axes[2].rate_dph.back(); };
}

struct Kernel {
  const char* name;
  std::function<std::function<double()>()> prepare;
};

} // namespace

// What callgrind counts.
extern "C" __attribute__((noinline)) void kernel_call(const std::function<double()>& f) {
  sink = f();
}

static double best_s(const std::function<double()>& f) {
  double best = 1e300;
  for (int k = 0; k < 15; ++k) {
    const std::clock_t start = std::clock();
    kernel_call(f);
    best = std::min(best, static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC);
  }
  return best;
}

int main(int argc, char** argv) {
  if (argc < 2 || argc > 3) {
    std::fprintf(stderr, "usage: kernels FOLDER [KERNEL]\n");
    return 2;
  }
  const std::string folder = argv[1];
  const std::vector<Kernel> kernels = {
      {"dp_oadev", prepare_dp_oadev}, {"whiten", prepare_whiten},
      {"normals", prepare_normals},   {"normals_of_8", prepare_normals_of_8},
      {"kf_chain", prepare_kf_chain}, {"montecarlo", prepare_montecarlo},
      {"comp", prepare_comp},         {"log_reading", [&] { return prepare_log_reading(folder); }}};
  if (argc == 3) {
    for (const Kernel& kernel : kernels)
      if (std::string(argv[2]) == kernel.name) {
        const std::function<double()> f = kernel.prepare();
        f(); // tables made once and allocations are not of the kernel
        kernel_call(f);
        return 0;
      }
    std::fprintf(stderr, "kernels: no kernel '%s'\n", argv[2]);
    return 2;
  }
  const double yardstick_s = best_s(reference);
  Json json;
  json["reference"] = {{"seconds", yardstick_s}};
  for (const Kernel& kernel : kernels) {
    const double seconds = best_s(kernel.prepare());
    json[kernel.name] = {{"seconds", seconds}, {"over_reference", seconds / yardstick_s}};
  }
  std::cout << json.dump() << "\n";
}
