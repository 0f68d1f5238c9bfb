// SPDX-License-Identifier: MIT
// The value of one hypothesis on the block means: its noise, its columns and its marginal likelihood with the prior of the
// noise.  Nothing is searched here.  One thread: the columns asked for last are kept.
#pragma once
#include "analysis/diagnose/search/slow_space.h"

namespace imucal {

class SlowLikelihood {
public:
  explicit SlowLikelihood(const SlowSpace& space) : space_(space) {} // must outlive it
  const SlowSpace& space() const { return space_; }

  NoiseModel base_noise(const SlowModel& m) const;    // of 1-s means, without its kind of slow noise
  NoiseModel seconds_noise(const SlowModel& m) const; // of 1-s means, with it
  NoiseModel noise(const SlowModel& m) const;         // of block means, with it

  using Part = std::shared_ptr<const MeanPart>;
  using Columns = std::shared_ptr<const MeanColumns>;
  // The parts of the mean on the data searched, and their columns.
  std::vector<Part> parts(const SlowModel& m) const;
  Columns columns(const SlowModel& m) const;
  // The parts on this or on other data: jumps in time belong to the runs of the data searched, which come first.
  std::vector<MeanPart> parts_on(const SlowData& where, const SlowModel& m) const;
  RunGrams grams(const SlowModel& m) const;

  // Prior of the noise, less what other noise than the believed one costs.
  double noise_value(const SlowModel& m) const;
  // What SlowModel::value is to be.
  double evaluate(const SlowModel& m) const;
  // Value less all charges and thresholds: what the search maximises.
  double score(const SlowModel& m) const;

private:
  Part part_at(const SlowModel::Name& name) const; // on the data searched; kept
  MeanPart part_on(const SlowData& where, const SlowModel::Name& name) const;
  bool are_jumps_seen(const SlowModel& m, const RunGrams& grams) const;

  const SlowSpace& space_;
  struct KeptPart {
    size_t candidate = 0;
    Theta shape;
    bool is_start_only = false;
    Part part;
  };
  struct KeptColumns {
    size_t n_names = 0;
    std::vector<Theta> key; // steps, whether without lines; of each name what it is, and its shape
    Columns columns;
  };
  mutable std::vector<KeptPart> kept_parts_;
  mutable std::vector<KeptColumns> kept_columns_;
  mutable size_t next_part_ = 0, next_columns_ = 0;
};

// Logarithms of the sum and of the mean of exp(x); x is not empty.
double log_sum_exp(const std::vector<double>& x);
double log_mean_exp(const std::vector<double>& x);

std::vector<const MeanPart*> pointers_of(const std::vector<SlowLikelihood::Part>& list);

} // namespace imucal
