// SPDX-License-Identifier: MIT
#include "device/feed.h"

#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstring>
#include <thread>

#include "base/error.h"
#include "base/progress.h"
#include "io/output.h"
#include "sample.h"

namespace imucal {

namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

void sleep_s(double s) {
  if (s > 0) std::this_thread::sleep_for(std::chrono::duration<double>(s));
}

Error cannot(const std::string& to, const std::string& why) {
  return device_error(to + ": cannot feed: " + why);
}

int connect_once(const std::string& host, const std::string& service, std::string* why) {
  addrinfo hints{}, *found = nullptr;
  hints.ai_socktype = SOCK_STREAM;
  if (const int code = ::getaddrinfo(host.c_str(), service.c_str(), &hints, &found); code != 0) {
    *why = ::gai_strerror(code);
    return -1;
  }
  int fd = -1;
  for (const addrinfo* a = found; a && fd < 0; a = a->ai_next) {
    fd = ::socket(a->ai_family, SOCK_STREAM | SOCK_CLOEXEC, a->ai_protocol);
    if (fd >= 0 && ::connect(fd, a->ai_addr, a->ai_addrlen) != 0) {
      *why = std::strerror(errno);
      ::close(fd);
      fd = -1;
    }
  }
  ::freeaddrinfo(found);
  return fd;
}

int connect_patiently(const std::string& to, const std::string& where) {
  const size_t colon = where.rfind(':');
  if (colon == std::string::npos || colon == 0 || colon + 1 == where.size())
    throw usage_error("'" + to + "': expected tcp:HOST:PORT");
  std::string why;
  const auto start = Clock::now();
  do {
    const int fd = connect_once(where.substr(0, colon), where.substr(colon + 1), &why);
    if (fd >= 0) return fd;
    sleep_s(0.05);
  } while (seconds_since(start) < kConnectPatience_s && !interrupted());
  throw cannot(to, why + "; is the device running and does it read its feed from TCP?");
}

int accept_one(const std::string& to, const std::string& service) {
  char* end = nullptr;
  const long port = std::strtol(service.c_str(), &end, 10);
  if (service.empty() || *end || port < 1 || port > 65535) throw usage_error("'" + to + "': expected tcp-listen:PORT");
  const int listener = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const int on = 1;
  ::setsockopt(listener, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  address.sin_port = htons(static_cast<uint16_t>(port));
  const bool listens =
      ::bind(listener, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0 && ::listen(listener, 1) == 0;
  const int fd = listens ? ::accept4(listener, nullptr, nullptr, SOCK_CLOEXEC) : -1;
  const int error = errno;
  ::close(listener);
  if (fd < 0) throw cannot(to, std::strerror(error));
  return fd;
}

int open_file(const std::string& to) {
  refuse_protected(to);
  const int fd = ::open(to.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (fd < 0 && errno == EINTR) throw cannot(to, "interrupted while waiting for the device to open the pipe");
  if (fd < 0) throw cannot(to, std::strerror(errno));
  return fd;
}

// Everything of one second as records.
class RecordWriter {
public:
  explicit RecordWriter(size_t n_channels) : n_channels_(static_cast<uint8_t>(n_channels)) {}

  const std::vector<uint8_t>& encode(const std::vector<RawSample>& samples) {
    bytes_.resize(samples.size() * IMUCAL_SAMPLE_RECORD_BYTES);
    for (size_t i = 0; i < samples.size(); ++i) {
      const RawSample& raw = samples[i];
      imucal_sample_t sample{};
      sample.t_us = raw.t_us;
      sample.temp_counts = raw.temp_counts;
      std::copy_n(raw.counts, n_channels_, sample.counts);
      sample.n_channels = n_channels_;
      sample.saturated = static_cast<uint8_t>(raw.saturated);
      sample.fault = static_cast<uint8_t>(raw.absent);
      imucal_sample_encode(&sample, bytes_.data() + i * IMUCAL_SAMPLE_RECORD_BYTES);
    }
    return bytes_;
  }

private:
  uint8_t n_channels_;
  std::vector<uint8_t> bytes_;
};

} // namespace

FeedSink::FeedSink(const std::string& to) : to_(to) {
  std::signal(SIGPIPE, SIG_IGN); // the device may end first: that is reported, not fatal
  (void)interrupted();           // from here on Ctrl-C also ends the wait for a reader
  if (to.rfind("tcp:", 0) == 0)
    fd_ = connect_patiently(to, to.substr(4));
  else if (to.rfind("tcp-listen:", 0) == 0)
    fd_ = accept_one(to, to.substr(11));
  else
    fd_ = open_file(to);
}

FeedSink::~FeedSink() {
  ::close(fd_);
}

bool FeedSink::write(const uint8_t* bytes, size_t n) {
  while (n > 0) {
    const ssize_t written = ::write(fd_, bytes, n);
    if (written < 0) {
      if (errno == EINTR && !interrupted()) continue;
      if (errno == EINTR || errno == EPIPE || errno == ECONNRESET) return false;
      throw cannot(to_, std::strerror(errno));
    }
    bytes += written;
    n -= static_cast<size_t>(written);
  }
  return true;
}

SimulatedDevice simulate_device(const std::vector<ErrorModel>& models, size_t n_axes, const Profile& profile,
                                const std::vector<EffectSpec>& effects, const SimOptions& options) {
  const SimulatedLog simulated = simulate(models, n_axes, profile, effects, options);
  SimulatedDevice device;
  device.log = to_log(simulated, options);
  size_t row = 0; // of the log, which leaves missing seconds out
  for (size_t k = 0; k < simulated.stamp_s.size(); ++k) {
    if (simulated.is_missing[k]) continue;
    FeedSecond second;
    second.t_s = static_cast<double>(k + 1); // jitter belongs to the samples, not to the seconds
    second.temp_degc = device.log.temp_degc[row++];
    for (const SimulatedAxis& axis : simulated.axes) {
      second.value.push_back(axis.run.rate_dph[k]);
      second.white_sigma.push_back(axis.run.white_sigma_dph[k]);
    }
    device.seconds.push_back(std::move(second));
  }
  return device;
}

std::vector<FeedSecond> replay_seconds(const Log& log) {
  if (log.axes.size() > kMaxRawAxes)
    throw data_error(log.path + ": " + std::to_string(log.axes.size()) + " axes, a device has at most " +
                     std::to_string(kMaxRawAxes) + "; remove columns");
  if (!log.has_temperature()) throw data_error(log.path + ": no temperature: a thermal calibration needs temp_degc");
  if (log.size() > 1 && std::abs(log.dt_s() - 1.0) > 0.05)
    throw data_error(log.path + ": rows are " + std::to_string(log.dt_s()) + " s apart; replay needs one per second");
  std::vector<FeedSecond> seconds;
  const double first_s = std::floor(log.t_s.front() + 0.5);
  for (size_t k = 0; k < log.size(); ++k) {
    if (!std::isfinite(log.temp_degc[k])) continue;
    FeedSecond second;
    second.t_s = std::floor(log.t_s[k] + 0.5) - first_s + 1;            // the device's clock starts with the log
    if (!seconds.empty() && second.t_s <= seconds.back().t_s) continue; // two rows in one second: keep the first
    second.temp_degc = log.temp_degc[k];
    for (const LogAxis& axis : log.axes) {
      const bool is_fault = !axis.flags.empty() && (axis.flags[k] & kSensorFault);
      second.value.push_back(is_fault ? std::nan("") : axis.rate_dph[k]);
    }
    second.white_sigma.assign(log.axes.size(), 0.0);
    seconds.push_back(std::move(second));
  }
  return seconds;
}

FeedResult feed(const std::vector<FeedSecond>& seconds, const FeedOptions& options) {
  if (seconds.empty()) throw data_error("nothing to feed: no seconds with a temperature");
  const size_t n_channels = seconds.front().value.size();
  RawSampler sampler(options.format, n_channels, options.seed, 0);
  RecordWriter writer(n_channels);
  FeedSink sink(options.to);
  Progress progress("feeding", seconds.back().t_s, options.quiet);
  std::vector<RawSample> samples;
  FeedResult result;
  const auto start = Clock::now();
  for (const FeedSecond& second : seconds) {
    samples.clear();
    sampler.second(second.t_s, second.temp_degc, second.value.data(), second.white_sigma.data(), &samples);
    const std::vector<uint8_t>& bytes = writer.encode(samples);
    if (options.speed > 0) sleep_s((second.t_s - seconds.front().t_s) / options.speed - seconds_since(start));
    if (interrupted() || !sink.write(bytes.data(), bytes.size())) return result;
    result.n_samples += samples.size();
    for (const RawSample& sample : samples) result.n_saturated += sample.saturated != 0;
    result.sensor_s = second.t_s - seconds.front().t_s + 1;
    progress.update(second.t_s, std::to_string(static_cast<long>(second.t_s)) + " s");
  }
  result.is_complete = true;
  return result;
}

} // namespace imucal
