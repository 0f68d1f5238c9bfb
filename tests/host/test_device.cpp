// SPDX-License-Identifier: MIT
// The device client against a scripted line: repetition, stale and doubled replies, refusals, lost records,
// tables in parts.  (Against the firmware itself: tests/system/test_calibrate*.py.)
#include <csetjmp>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <ios>
extern "C" {
#include <cmocka.h>
}
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <functional>
#include <limits>
#include <memory>
#include <string>

#include "base/error.h"
#include "device/device.h"
#include "device/recorder.h"
#include "device/watch.h"
#include "io/log.h"
#include "num.h"

using namespace imucal;

namespace {

using Bytes = std::vector<uint8_t>;

template <typename Message> Bytes frame(uint8_t id, uint8_t sequence, const Message& message) {
  Bytes out(IMUCAL_LINK_MAX_FRAME);
  size_t n = 0;
  assert_int_equal(imucal_link_pack(id, sequence, &message, out.data(), out.size(), &n), IMUCAL_OK);
  out.resize(n);
  return out;
}

Bytes done(uint8_t request, uint8_t sequence, imucal_status status = IMUCAL_OK, uint32_t detail = 0) {
  return frame(IMUCAL_LINK_ID_DONE, sequence, imucal_link_done_t{request, static_cast<int16_t>(status), detail});
}

Bytes info(uint8_t sequence, uint32_t t_s) {
  imucal_link_info_reply_t reply{};
  reply.t_s = t_s;
  return frame(IMUCAL_LINK_ID_INFO_REPLY, sequence, reply);
}

Bytes event(uint16_t counter) {
  imucal_link_event_t record{};
  record.counter = counter;
  record.code = IMUCAL_EVENT_SENSOR_FAULT;
  return frame(IMUCAL_LINK_ID_EVENT, 0, record);
}

// A line whose other end is a function: called with each request frame, it says what comes back.
class ScriptedLine : public Transport {
public:
  using Script = std::function<Bytes(uint8_t id, uint8_t sequence, const imucal_link_any_t& request)>;
  explicit ScriptedLine(Script script) : Transport("script"), script_(std::move(script)) { imucal_link_rx_init(&rx_); }
  const char* kind() const override { return "script"; }

  size_t read(uint8_t* bytes, size_t max, double) override {
    size_t n = 0;
    while (n < max && !waiting_.empty()) {
      bytes[n++] = waiting_.front();
      waiting_.pop_front();
    }
    return n;
  }
  void write(const uint8_t* bytes, size_t n, double) override {
    for (size_t i = 0; i < n; ++i) {
      if (imucal_link_rx_put(&rx_, bytes[i]) != IMUCAL_FRAME_READY) continue;
      imucal_link_any_t message;
      assert_int_equal(imucal_link_rx_message(&rx_, &message), IMUCAL_OK);
      answer(imucal_link_rx_type(&rx_), imucal_link_rx_sequence(&rx_), message);
    }
  }
  void send(const Bytes& bytes) { waiting_.insert(waiting_.end(), bytes.begin(), bytes.end()); }

  int n_requests = 0;

private:
  // Unlocks by itself; what comes in a COMMAND is given to the script as though it came alone.
  void answer(uint8_t id, uint8_t sequence, const imucal_link_any_t& message) {
    if (id == IMUCAL_LINK_ID_STATE) {
      imucal_link_state_reply_t state{};
      state.challenge = challenge;
      return send(frame(IMUCAL_LINK_ID_STATE_REPLY, sequence, state));
    }
    if (id == IMUCAL_LINK_ID_UNLOCK) {
      assert_int_equal(message.unlock.challenge, challenge++);
      return send(
          frame(IMUCAL_LINK_ID_UNLOCK_REPLY, sequence, imucal_link_unlock_reply_t{++token, message.unlock.seconds}));
    }
    ++n_requests;
    if (id != IMUCAL_LINK_ID_COMMAND) {
      assert_false(imucal_link_is_guarded(id));
      return send(script_(id, sequence, message));
    }
    imucal_link_any_t inside;
    const imucal_link_command_t& command = message.command;
    assert_int_equal(command.token, token);
    assert_int_equal(imucal_link_decode(command.request, command.payload, command.length, &inside), IMUCAL_OK);
    send(script_(command.request, sequence, inside));
  }

  uint32_t challenge = 77, token = 0;
  Script script_;
  imucal_link_rx_t rx_;
  std::deque<uint8_t> waiting_;
};

constexpr DeviceOptions kImpatient{0.01, 4};

struct Bench {
  ScriptedLine* line;
  Device device;
  explicit Bench(ScriptedLine::Script script) : Bench(std::make_unique<ScriptedLine>(std::move(script))) {}

private:
  explicit Bench(std::unique_ptr<ScriptedLine> made) : line(made.get()), device(std::move(made), kImpatient) {}
};

Bytes joined(std::initializer_list<Bytes> parts) {
  Bytes all;
  for (const Bytes& part : parts) all.insert(all.end(), part.begin(), part.end());
  return all;
}

void test_request_lost_twice_is_repeated_with_the_same_sequence(void**) {
  std::vector<uint8_t> sequences;
  Bench bench([&](uint8_t, uint8_t sequence, const imucal_link_any_t&) {
    sequences.push_back(sequence);
    return sequences.size() < 3 ? Bytes{} : info(sequence, 7);
  });
  assert_int_equal(bench.device.info().t_s, 7);
  assert_int_equal(sequences.size(), 3);
  assert_int_equal(sequences[0], sequences[2]);
  assert_int_equal(bench.device.statistics().repeated_requests, 2);
}

void test_next_request_has_another_sequence(void**) {
  std::vector<uint8_t> sequences;
  Bench bench([&](uint8_t, uint8_t sequence, const imucal_link_any_t&) {
    sequences.push_back(sequence);
    return info(sequence, 7);
  });
  bench.device.info();
  bench.device.info();
  assert_int_not_equal(sequences[0], sequences[1]);
}

void test_reply_to_an_earlier_request_is_not_taken(void**) {
  Bench bench([&](uint8_t, uint8_t sequence, const imucal_link_any_t&) {
    return joined(
        {info(static_cast<uint8_t>(sequence - 1), 1), done(IMUCAL_LINK_ID_STREAM, sequence), info(sequence, 2)});
  });
  assert_int_equal(bench.device.info().t_s, 2);
  assert_int_equal(bench.device.statistics().stale_replies, 2);
}

void test_spoilt_reply_is_asked_for_again(void**) {
  int n = 0;
  Bench bench([&](uint8_t, uint8_t sequence, const imucal_link_any_t&) {
    Bytes reply = info(sequence, 9);
    if (n++ == 0) reply[5] = static_cast<uint8_t>(reply[5] ^ 0x40);
    return reply;
  });
  assert_int_equal(bench.device.info().t_s, 9);
  assert_int_equal(bench.device.statistics().spoilt, 1);
}

void test_silent_device_ends_in_an_error_after_the_tries(void**) {
  Bench bench([](uint8_t, uint8_t, const imucal_link_any_t&) { return Bytes{}; });
  try {
    bench.device.info();
    fail_msg("a silent device was believed");
  } catch (const Error& e) {
    assert_int_equal(e.exit(), Exit::kDevice);
    assert_non_null(std::strstr(e.what(), "does not answer (INFO sent 4 times)"));
  }
  assert_int_equal(bench.line->n_requests, 4);
}

void test_refusal_is_an_error_with_its_reason_and_is_not_repeated(void**) {
  Bench bench(
      [](uint8_t id, uint8_t sequence, const imucal_link_any_t&) { return done(id, sequence, IMUCAL_ERR_NO_OTHER); });
  try {
    bench.device.rollback();
    fail_msg("a refusal was taken for success");
  } catch (const Error& e) {
    assert_int_equal(e.exit(), Exit::kDevice);
    assert_non_null(std::strstr(e.what(), imucal_status_text(IMUCAL_ERR_NO_OTHER)));
  }
  assert_int_equal(bench.line->n_requests, 1);
}

void test_streams_lost_and_doubled_records_are_counted_across_the_wrap(void**) {
  std::vector<int> seen;
  Bench bench([](uint8_t, uint8_t, const imucal_link_any_t&) { return Bytes{}; });
  bench.device.on_stream([&](uint8_t id, const imucal_link_any_t& record) {
    assert_int_equal(id, IMUCAL_LINK_ID_EVENT);
    seen.push_back(record.event.counter);
  });
  bench.line->send(joined({event(65533), event(65534), event(65534), event(1), event(2)}));
  assert_true(bench.device.poll(0.01));
  assert_int_equal(seen.size(), 4);
  assert_int_equal(bench.device.statistics().lost_records, 2); // 65535 and 0
  assert_int_equal(bench.device.statistics().doubled_records, 1);
}

void test_records_between_request_and_reply_reach_the_handler(void**) {
  int n = 0;
  Bench bench([](uint8_t, uint8_t sequence, const imucal_link_any_t&) {
    return joined({event(1), info(sequence, 3), event(2)});
  });
  bench.device.on_stream([&](uint8_t, const imucal_link_any_t&) { ++n; });
  bench.device.info();
  assert_int_equal(n, 1);
  bench.device.poll(0.01); // what came with the reply is not lost
  assert_int_equal(n, 2);
}

void test_tables_go_in_parts_both_ways(void**) {
  Bytes table(456), flashed;
  for (size_t i = 0; i < table.size(); ++i) table[i] = static_cast<uint8_t>(i * 7);
  Bench bench([&](uint8_t id, uint8_t sequence, const imucal_link_any_t& request) {
    switch (id) {
    case IMUCAL_LINK_ID_TABLE_BEGIN:
      assert_int_equal(request.table_begin.total, table.size());
      assert_int_equal(request.table_begin.crc, imucal_get_u32(table.data() + table.size() - 4));
      return done(id, sequence);
    case IMUCAL_LINK_ID_TABLE_DATA:
      assert_int_equal(request.table_data.offset, flashed.size());
      flashed.insert(flashed.end(), request.table_data.data, request.table_data.data + request.table_data.length);
      return done(id, sequence);
    case IMUCAL_LINK_ID_TABLE_COMMIT:
      return done(id, sequence, IMUCAL_OK, 12);
    default:
      break;
    }
    imucal_link_table_read_reply_t reply{};
    reply.offset = request.table_read.offset;
    reply.total = static_cast<uint16_t>(flashed.size());
    reply.length = static_cast<uint8_t>(std::min<size_t>(request.table_read.length, flashed.size() - reply.offset));
    std::copy_n(flashed.begin() + reply.offset, reply.length, reply.data);
    return frame(IMUCAL_LINK_ID_TABLE_READ_REPLY, sequence, reply);
  });
  assert_int_equal(bench.device.write_table(table), 12);
  assert_true(flashed == table);
  assert_true(bench.device.read_table() == table);
}

void test_connect_refuses_another_protocol(void**) {
  Bench bench([](uint8_t, uint8_t sequence, const imucal_link_any_t&) {
    imucal_link_hello_reply_t reply{};
    reply.protocol = IMUCAL_LINK_PROTOCOL + 1;
    return frame(IMUCAL_LINK_ID_HELLO_REPLY, sequence, reply);
  });
  try {
    bench.device.connect();
    fail_msg("connected to a device of an unknown protocol");
  } catch (const Error& e) {
    assert_non_null(std::strstr(e.what(), "protocol version"));
  }
}

// A device that refuses ROLLBACK the first time, and whose starts are numbered.
struct RefusingDevice {
  imucal_status refusal;
  uint32_t boot_id = 1;
  bool restarts = false; // before it refuses
  int n_rollbacks = 0, n_done = 0;

  Bytes answer(uint8_t id, uint8_t sequence) {
    if (id == IMUCAL_LINK_ID_HELLO) {
      imucal_link_hello_reply_t reply{};
      reply.protocol = IMUCAL_LINK_PROTOCOL;
      reply.boot_id = boot_id;
      return frame(IMUCAL_LINK_ID_HELLO_REPLY, sequence, reply);
    }
    assert_int_equal(id, IMUCAL_LINK_ID_ROLLBACK);
    if (++n_rollbacks > 1) return ++n_done, done(id, sequence);
    boot_id += restarts;
    return done(id, sequence, refusal);
  }
};

void test_command_is_sent_once_more_where_only_the_unlock_was_over(void**) {
  RefusingDevice refusing{IMUCAL_ERR_LOCKED};
  Bench bench([&](uint8_t id, uint8_t sequence, const imucal_link_any_t&) { return refusing.answer(id, sequence); });
  bench.device.connect();
  bench.device.rollback();
  assert_int_equal(refusing.n_rollbacks, 2);
  assert_int_equal(refusing.n_done, 1);
}

// The reply may have been lost with the restart: what was done would be done twice.
void test_command_is_not_sent_once_more_to_a_device_that_restarted(void**) {
  for (const imucal_status refusal : {IMUCAL_ERR_LOCKED, IMUCAL_ERR_STALE}) {
    RefusingDevice refusing{refusal};
    refusing.restarts = true;
    Bench bench([&](uint8_t id, uint8_t sequence, const imucal_link_any_t&) { return refusing.answer(id, sequence); });
    bench.device.connect();
    try {
      bench.device.rollback();
      fail_msg("a command was repeated over a restart");
    } catch (const Error& e) {
      assert_non_null(std::strstr(e.what(), "restarted"));
    }
    assert_int_equal(refusing.n_rollbacks, 1);
    bench.device.rollback(); // asked for again: the new start is unlocked
    assert_int_equal(refusing.n_done, 1);
  }
}

// ---- a device's channels ----

// Greets with the channels given.
Bytes greets(const std::vector<std::string>& names, uint8_t id, uint8_t sequence, const imucal_link_any_t& request) {
  if (id == IMUCAL_LINK_ID_HELLO) {
    imucal_link_hello_reply_t reply{};
    reply.protocol = IMUCAL_LINK_PROTOCOL;
    reply.n_channels = static_cast<uint8_t>(names.size());
    std::strcpy(reply.serial, "odd-1");
    std::strcpy(reply.device, "two\nlines");
    return frame(IMUCAL_LINK_ID_HELLO_REPLY, sequence, reply);
  }
  assert_int_equal(id, IMUCAL_LINK_ID_CHANNEL_INFO);
  imucal_link_channel_info_reply_t reply{};
  const std::string& name = names.at(request.channel_info.channel);
  std::copy_n(name.c_str(), std::min(name.size() + 1, sizeof reply.name), reply.name);
  reply.unit_per_count = reply.degc_per_count = 0.01F;
  reply.full_scale_counts = 32767;
  return frame(IMUCAL_LINK_ID_CHANNEL_INFO_REPLY, sequence, reply);
}

std::string refusal_of(const std::vector<std::string>& names) {
  Bench bench([&](uint8_t id, uint8_t sequence, const imucal_link_any_t& r) { return greets(names, id, sequence, r); });
  try {
    bench.device.connect();
  } catch (const Error& e) {
    assert_int_equal(e.exit(), Exit::kDevice);
    return e.what();
  }
  return "";
}

void test_connect_channels_that_no_log_can_hold_are_refused_by_name(void**) {
  const struct {
    std::vector<std::string> names;
    const char* what;
  } kOdd[] = {
      {{"gx_dph", "ax"}, "'ax' of its channels 'gx_dph', 'ax' does not end in its unit"},
      {{"gyro_x", "gyro_y"}, "'gyro_x' of its channels"},
      {{"gx_dph", "gy_dph", "gx_dph"}, "called 'gx' before the unit"},
      {{"x_dph", "x_mg"}, "called 'x' before the unit"},
      {{"_dph"}, "'_dph'"},
      {{""}, "''"},
      {{"g,x_dph"}, "'g,x_dph'"},
      {{"g\nx_dph"}, "does not end in its unit"},
      {{"gx_dps"}, "'gx_dps'"},
  };
  for (const auto& odd : kOdd) {
    const std::string refusal = refusal_of(odd.names);
    if (refusal.find(odd.what) == std::string::npos) fail_msg("%s: '%s'", odd.what, refusal.c_str());
    assert_non_null(std::strstr(refusal.c_str(), "_dph or _mg"));
  }
  assert_string_equal(refusal_of({"gx_dph", "gy_dph", "gz_dph", "ax_mg", "ay_mg", "az_mg"}).c_str(), "");
  assert_string_equal(refusal_of({"g1_x_dph", "g2_x_dph"}).c_str(), "");
}

// Whatever a device sends, what is recorded of it can be read.
void test_recorder_values_that_are_no_numbers_make_a_log_that_can_be_read(void**) {
  const std::vector<std::string> names = {"gx_dph", "ax_mg"};
  Bench bench([&](uint8_t id, uint8_t sequence, const imucal_link_any_t& r) { return greets(names, id, sequence, r); });
  bench.device.connect();
  char folder[] = "/tmp/imucal_test_XXXXXX";
  const std::string path = std::string(mkdtemp(folder)) + "/log.csv";
  LogRecorder recorder(path, bench.device, LogRecorder::What::kRaw);
  SecondRecord second{};
  second.n_channels = 2;
  for (uint32_t t_s = 1; t_s <= 5; ++t_s) {
    second.t_s = t_s;
    second.temp_degc = t_s == 2 ? std::numeric_limits<float>::quiet_NaN() : 20.0F;
    second.raw[0] = t_s == 3 ? std::numeric_limits<float>::infinity() : 7.0F;
    second.n_channels = t_s == 4 ? 1 : 2;
    recorder.add(second);
  }
  recorder.close();
  const Log log = read_log(path);
  assert_int_equal(log.size(), 4); // the fourth had one channel
  assert_true(std::isnan(log.temp_degc[1]) && std::isnan(log.axes[0].rate_dph[2]));
  assert_string_equal(log.metadata.at("serial").c_str(), "odd-1");
  std::remove(path.c_str());
  rmdir(folder);
}

// ---- a device that no longer streams ----

// What `Watch` says of a device that stopped after three seconds: it says so by an event, or is silent.
struct StoppedDevice {
  uint32_t boot_id_after;
  uint64_t uptime_us_after;
  uint8_t session_after;
  bool tells;
  bool has_stopped = false;

  Bytes answer(uint8_t id, uint8_t sequence) const {
    if (id == IMUCAL_LINK_ID_HELLO) {
      imucal_link_hello_reply_t reply{};
      reply.protocol = IMUCAL_LINK_PROTOCOL;
      reply.boot_id = has_stopped ? boot_id_after : 7;
      return frame(IMUCAL_LINK_ID_HELLO_REPLY, sequence, reply);
    }
    assert_int_equal(id, IMUCAL_LINK_ID_INFO);
    imucal_link_info_reply_t reply{};
    reply.uptime_us = has_stopped ? uptime_us_after : 4'000'000'000;
    reply.session = has_stopped ? session_after : static_cast<uint8_t>(IMUCAL_SESSION_CALIBRATING);
    reply.stream_what = has_stopped ? IMUCAL_STREAM_EVENT : IMUCAL_STREAM_SECOND | IMUCAL_STREAM_EVENT;
    return frame(IMUCAL_LINK_ID_INFO_REPLY, sequence, reply);
  }
};

std::string said_of(StoppedDevice stopped) {
  Bench bench([&](uint8_t id, uint8_t sequence, const imucal_link_any_t&) { return stopped.answer(id, sequence); });
  bench.device.connect();
  Watch watch(&bench.device, 0);
  bench.device.on_stream([&](uint8_t id, const imucal_link_any_t& record) { watch.saw(id, record); });
  imucal_link_second_t second{};
  for (second.t_s = 1; second.t_s <= 3; ++second.t_s, ++second.counter) {
    bench.line->send(frame(IMUCAL_LINK_ID_SECOND, 0, second));
    bench.device.poll(0.01);
  }
  stopped.has_stopped = true;
  imucal_link_event_t event{};
  event.code = IMUCAL_EVENT_HOST_SILENT;
  if (stopped.tells) bench.line->send(frame(IMUCAL_LINK_ID_EVENT, 0, event));
  try {
    for (int i = 0; i < 300; ++i) {
      bench.device.poll(0.01);
      watch.check();
    }
  } catch (const Error& e) {
    assert_int_equal(e.exit(), Exit::kDevice);
    return e.what();
  }
  return "nothing";
}

void test_watch_tells_a_restart_from_a_clock_that_ran_back_and_from_another_program(void**) {
  const struct {
    StoppedDevice device;
    const char *says, *says_not;
  } kCases[] = {
      {{7, 5'000'000, IMUCAL_SESSION_KEPT, true}, "clock ran back, from 4000 s to 5 s; time_us", "restarted"},
      {{7, 5'000'000, IMUCAL_SESSION_KEPT, false}, "must have 64 bits", "supply"},
      {{7, 90'000'000'000, IMUCAL_SESSION_KEPT, true}, "clock jumped to 9e+04 s", "restarted"},
      {{8, 5'000'000, IMUCAL_SESSION_IDLE, false}, "the device restarted after 3 s", "clock"},
      {{7, 5'000'000, IMUCAL_SESSION_IDLE, false},
       "the device restarted after 3 s",
       "clock"}, // a boot_id that never changes
      {{7, 4'010'000'000, IMUCAL_SESSION_IDLE, false}, "another program", "supply"},
  };
  for (const auto& c : kCases) {
    const std::string said = said_of(c.device);
    if (said.find(c.says) == std::string::npos || said.find(c.says_not) != std::string::npos)
      fail_msg("'%s' wanted: %s", c.says, said.c_str());
  }
}

} // namespace

int main() {
  const CMUnitTest tests[] = {
      cmocka_unit_test(test_request_lost_twice_is_repeated_with_the_same_sequence),
      cmocka_unit_test(test_next_request_has_another_sequence),
      cmocka_unit_test(test_reply_to_an_earlier_request_is_not_taken),
      cmocka_unit_test(test_spoilt_reply_is_asked_for_again),
      cmocka_unit_test(test_silent_device_ends_in_an_error_after_the_tries),
      cmocka_unit_test(test_refusal_is_an_error_with_its_reason_and_is_not_repeated),
      cmocka_unit_test(test_streams_lost_and_doubled_records_are_counted_across_the_wrap),
      cmocka_unit_test(test_records_between_request_and_reply_reach_the_handler),
      cmocka_unit_test(test_tables_go_in_parts_both_ways),
      cmocka_unit_test(test_connect_refuses_another_protocol),
      cmocka_unit_test(test_command_is_sent_once_more_where_only_the_unlock_was_over),
      cmocka_unit_test(test_command_is_not_sent_once_more_to_a_device_that_restarted),
      cmocka_unit_test(test_connect_channels_that_no_log_can_hold_are_refused_by_name),
      cmocka_unit_test(test_watch_tells_a_restart_from_a_clock_that_ran_back_and_from_another_program),
      cmocka_unit_test(test_recorder_values_that_are_no_numbers_make_a_log_that_can_be_read),
  };
  return cmocka_run_group_tests(tests, nullptr, nullptr);
}
