// SPDX-License-Identifier: MIT
// Feeds a device with raw samples (records of common/sample.h), from a simulation or from a recorded log.
// The emulated ports of the firmware read the feed in place of a sensor: a file, a named pipe, or TCP.
#pragma once
#include <memory>
#include <string>
#include <vector>

#include "io/log.h"
#include "io/model.h"
#include "io/profile.h"
#include "physics/sim/raw_samples.h"
#include "physics/sim/simulate.h"

namespace imucal {

// Where the records go.
//   FILE, FIFO          opened for writing; a named pipe waits for its reader (the device)
//   tcp:HOST:PORT       connects, and repeats for up to kConnectPatience_s while nobody listens yet
//   tcp-listen:PORT     waits for the device to connect (on this machine only)
constexpr double kConnectPatience_s = 10.0;

class FeedSink {
public:
  // device_error: cannot be opened; the message names what and why.
  explicit FeedSink(const std::string& to);
  ~FeedSink();
  FeedSink(const FeedSink&) = delete;
  FeedSink& operator=(const FeedSink&) = delete;

  // False: the reader has ended (which is its right); nothing more will be taken.
  bool write(const uint8_t* bytes, size_t n);

private:
  std::string to_;
  int fd_ = -1;
};

struct FeedOptions {
  std::string to;
  RawFormat format;
  double speed = 0; // sensor seconds per second of wall time; 0: as fast as the device takes them
  uint64_t seed = 1;
  bool quiet = false;
};

struct FeedResult {
  uint64_t n_samples = 0, n_saturated = 0; // records written; of them with a channel at its limit
  double sensor_s = 0;                     // time from the first to the last second fed
  bool is_complete = false;                // false: the device ended first, or Ctrl-C
};

// One second to feed: 1-s means and the white noise that is spread inside it.  NaN in value: a channel fault.
struct FeedSecond {
  double t_s = 0, temp_degc = 0;
  std::vector<double> value, white_sigma;
};

// A simulated device: gyros, then accelerometers (whose model is read in mg where it says dph), one run.
struct SimulatedDevice {
  std::vector<FeedSecond> seconds;
  Log log; // what a 1-Hz log of the run would hold
};
SimulatedDevice simulate_device(const std::vector<ErrorModel>& models, size_t n_axes, const Profile& profile,
                                const std::vector<EffectSpec>& effects, const SimOptions& options);

// A recorded log as seconds to feed: rows without temperature are left out, as is whatever is missing in the
// log, so that the device sees the same gaps.  data_error: not 1 Hz, more than 6 axes, or nothing left.
std::vector<FeedSecond> replay_seconds(const Log& log);

FeedResult feed(const std::vector<FeedSecond>& seconds, const FeedOptions& options);

} // namespace imucal
