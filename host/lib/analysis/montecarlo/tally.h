// SPDX-License-Identifier: MIT
// Sums over runs that do not depend on the order of summation: the same campaign gives the same bits on one
// thread, on ten, or cut into shards on several machines and merged.
//
// A value is rounded once to a multiple of 2^-44 and summed as an integer of 128 bits.  Range of a value: +- 2^62
// (4e18), resolution 6e-14; 2^21 largest values fit.  Ordinary results (errors of 1e-3 … 1e4 dph and their
// squares) lose nothing of interest.
#pragma once
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "io/json_file.h"

namespace imucal {

class ExactSum {
public:
  void add(double x); // throws std::overflow_error for NaN, infinity and |x| > 2^62: a result nobody can use
  void add(const ExactSum& other) { add(other.high_, other.low_); }
  double value() const;                               // within one unit in the last place
  std::string text() const;                           // decimal, exact
  static ExactSum from_text(const std::string& text); // throws std::invalid_argument

private:
  void add(int64_t high, uint64_t low);
  void negate();

  // high_ 2^64 + low_, in units of 2^-44: compilers for 32 bits have no integer of 128.
  int64_t high_ = 0;
  uint64_t low_ = 0;
};

// Named lists of sums, counts and maxima.  A list takes its length from the first use.
class Tally {
public:
  void add(const std::string& name, const std::vector<double>& values);
  void add(const std::string& name, double value) { add(name, std::vector<double>{value}); }
  void count(const std::string& name, const std::vector<int64_t>& values);
  void count(const std::string& name, int64_t value = 1) { count(name, std::vector<int64_t>{value}); }
  void highest(const std::string& name, const std::vector<double>& values);
  void highest(const std::string& name, double value) { highest(name, std::vector<double>{value}); }

  void merge(const Tally& other);

  bool has(const std::string& name) const { return sums_.count(name) || counts_.count(name) || highest_.count(name); }
  // Zeros (or one zero) where nothing was added.
  std::vector<double> sums(const std::string& name) const;
  double sum(const std::string& name) const;
  std::vector<int64_t> counts(const std::string& name) const;
  int64_t counted(const std::string& name) const;
  double maximum(const std::string& name) const;
  std::vector<double> maxima(const std::string& name) const;

  Json to_json() const;
  static Tally from_json(const JsonField& field); // data_error names the field

private:
  std::map<std::string, std::vector<ExactSum>> sums_;
  std::map<std::string, std::vector<int64_t>> counts_;
  std::map<std::string, std::vector<double>> highest_;
};

} // namespace imucal
