// SPDX-License-Identifier: MIT
#include "analysis/montecarlo/lanes.h"

#include <cmath>

#include "base/simd.h"

namespace imucal {

namespace of_8 {
#include "kf_of_8.h"
#undef FOLD_N
} // namespace of_8

struct ChainLanes::Filters {
  of_8::imucal_kf_t kf = {};
  Whiteness<Lanes8, Lanes8f> white;
  uint32_t n_new = 0; // seconds learnt since taken out of the tests
};

// One second of all; `is_white`: the innovations are judged.
IMUCAL_WIDE static void filter_second(of_8::imucal_kf_t* kf, Whiteness<Lanes8, Lanes8f>* white, const float* z_dph,
                                      float tn, bool is_white) {
  Lanes8f z;
  std::memcpy(&z, z_dph, sizeof z);
  of_8::take_second(kf, z, Lanes8f{} + tn, kf->config.r);
  if (is_white) white->keep(kf->stats.innovation, kf->stats.innovation_weight);
}

// Every number of a filter that differs from run to run, beside its lane.
template <class Move> static void each_number(imucal_kf_t& one, of_8::imucal_kf_t& eight, Move move) {
  move(one.e, eight.e);
  move(one.e_variance, eight.e_variance);
  move(one.one_plus_v0.hi, eight.one_plus_v0.hi);
  move(one.one_plus_v0.lo, eight.one_plus_v0.lo);
  for (size_t k = 0; k < IMUCAL_MAX_ORDER; ++k) move(one.v[k], eight.v[k]);
  for (size_t k = 0; k < IMUCAL_MAX_COEFF; ++k) {
    move(one.row[k].d.hi, eight.row[k].d.hi);
    move(one.row[k].d.lo, eight.row[k].d.lo);
    move(one.row[k].x.hi, eight.row[k].x.hi);
    move(one.row[k].x.lo, eight.row[k].x.lo);
  }
  for (size_t i = 0; i < IMUCAL_KF_MAX_R; ++i) move(one.r[i], eight.r[i]);
  for (size_t i = 0; i < IMUCAL_KF_N_SUMS; ++i) {
    move(one.stats.sum[i], eight.stats.sum[i]);
    move(one.stats.sum_lo[i], eight.stats.sum_lo[i]);
  }
  move(one.stats.innovation, eight.stats.innovation);
  move(one.stats.innovation_weight, eight.stats.innovation_weight);
}

template <class Move>
static void each_number(Whiteness<double, float>& one, Whiteness<Lanes8, Lanes8f>& eight, Move move) {
  for (size_t i = 0; i < one.kRing; ++i) move(one.ring[i], eight.ring[i]);
  for (size_t i = 0; i < kInnovationLagCount; ++i) move(one.lag_sums[i], eight.lag_sums[i]);
  move(one.weighted, eight.weighted);
  move(one.inverse, eight.inverse);
}

ChainLanes::ChainLanes(std::vector<CalibrationTest>* tests) : tests_(*tests), filters_(new Filters) {}
ChainLanes::~ChainLanes() = default;

bool ChainLanes::take() {
  CoreChain& first = tests_[0].chain;
  for (const CalibrationTest& test : tests_)
    if (test.chain.n_seconds_ != first.n_seconds_) return false;
  of_8::imucal_kf_t& kf = filters_->kf;
  for (size_t lane = 0; lane < RawSummer::kLanes; ++lane) {
    CoreChain& chain = tests_[lane < tests_.size() ? lane : 0].chain; // lanes without a test do as the first one
    const auto in = [lane](auto& one, auto& eight) { eight[lane] = one; };
    each_number(chain.learn_.kf, kf, in);
    each_number(chain.white_, filters_->white, in);
  }
  const imucal_kf_t& one = first.learn_.kf;
  kf.config.order = one.config.order;
  kf.config.m = Lanes8f{} + one.config.m;
  kf.config.q = Lanes8f{} + one.config.q;
  kf.config.r = Lanes8f{} + one.config.r;
  kf.forgotten = Lanes8f{} + one.forgotten;
  kf.stats.n = one.stats.n;
  filters_->white.n = first.white_.n;
  std::copy(first.white_.lag_counts, first.white_.lag_counts + kInnovationLagCount, filters_->white.lag_counts);
  filters_->n_new = 0;
  return is_held_ = true;
}

void ChainLanes::give_back() {
  if (!is_held_) return;
  is_held_ = false;
  for (size_t lane = 0; lane < tests_.size(); ++lane) {
    CoreChain& chain = tests_[lane].chain;
    const auto out = [lane](auto& one, auto& eight) { one = eight[lane]; };
    each_number(chain.learn_.kf, filters_->kf, out);
    each_number(chain.white_, filters_->white, out);
    chain.learn_.kf.stats.n = filters_->kf.stats.n;
    chain.learn_.n[IMUCAL_LEARN_USED] += filters_->n_new;
    chain.white_.n = filters_->white.n;
    std::copy(filters_->white.lag_counts, filters_->white.lag_counts + kInnovationLagCount, chain.white_.lag_counts);
  }
}

// False, and nothing done: a filter may refuse it.
bool ChainLanes::push_together(const float* z_dph, float temp_degc) {
  const CoreChain& chain = tests_[0].chain;
  const imucal_kf_t& kf = chain.learn_.kf;
  const float tn = (temp_degc - kf.config.t0_degc) * kf.inv_range;
  if (!(std::fabs(tn) <= IMUCAL_KF_MAX_TN)) return false;
  for (size_t lane = 0; lane < RawSummer::kLanes; ++lane)
    if (!(std::fabs(z_dph[lane]) <= IMUCAL_KF_MAX_RATE)) return false;
  if (!is_held_ && !take()) return false;
  filter_second(&filters_->kf, &filters_->white, z_dph, tn, chain.n_seconds_ >= chain.setup_.white_from_s);
  ++filters_->n_new;
  return true;
}

void ChainLanes::push_one_by_one(imucal_second_t second, const RawSums& sums, const imucal_thermometer_t& thermometer) {
  give_back();
  for (size_t lane = 0; lane < tests_.size(); ++lane) {
    second.sum[0] = sums.counts[lane];
    second.flags[0] = (sums.saturated >> lane & 1u) ? IMUCAL_FLAG_SATURATED : 0;
    tests_[lane].chain.push(second, thermometer);
  }
}

void ChainLanes::push(imucal_second_t second, const RawSums& sums, const imucal_thermometer_t& thermometer) {
  if (sums.saturated != 0 || !thermometer.is_sure) return push_one_by_one(second, sums, thermometer);
  float z_dph[RawSummer::kLanes];
  for (size_t lane = 0; lane < RawSummer::kLanes; ++lane) {
    second.sum[0] = sums.counts[lane];
    z_dph[lane] = tests_[0].chain.value_of(second);
  }
  if (!push_together(z_dph, thermometer.temp_degc)) return push_one_by_one(second, sums, thermometer);
  for (size_t lane = 0; lane < tests_.size(); ++lane) tests_[lane].chain.count_used(second, thermometer, z_dph[lane]);
}

void ChainLanes::finish() {
  give_back();
  for (CalibrationTest& test : tests_) test.chain.finish();
}

} // namespace imucal
