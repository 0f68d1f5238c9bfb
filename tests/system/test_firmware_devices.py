# SPDX-License-Identifier: MIT
"""The running devices from outside: posix process, MPS2 AN386 and nRF51 in QEMU, over their serial line."""
import os
import random
import struct
import subprocess
import threading
import time

import pytest

from device_link import Device, Line, Silence, connect, frame, free_port, sample_record
from where import BUILD

PORTS = ["posix", "mps2_an386", "nrf51"]
RATE_HZ, DURATION_S = 20, 400
BIAS = [(80, 300, 150, -100), (-400, 50, 20, 10), (20, -90, 5, 40)]


def make_feed(path, channels=3):
    rng = random.Random(3)
    with open(path, "wb") as out:
        for k in range(DURATION_S * RATE_HZ):
            degc = 60.0 * k / (DURATION_S * RATE_HZ)
            tn = (degc - 30) / 30
            counts = [round(sum(b * tn ** i for i, b in enumerate(BIAS[c % 3])) + rng.gauss(0, 60)) for c in range(channels)]
            out.write(sample_record(k * 50000, round((degc - 25) * 100), counts))
    return path


@pytest.fixture(scope="module")
def feed(tmp_path_factory):
    return make_feed(tmp_path_factory.mktemp("feed") / "samples.bin")


def options(port, **values):
    """Board options in the way the port takes them."""
    values.setdefault("rate", RATE_HZ)
    if port == "posix":
        return [part for k, v in values.items() for part in ("--" + k.replace("_", "-"), str(v))]
    return ["%s=%s" % (k.replace("_", "-"), v) for k, v in values.items()]


def learn(line, channels=3, order=3):
    assert line.calibrate(range(channels), order=order) == 0
    assert line.done("stream", what=15, channels=(1 << channels) - 1, period_s=50) == 0
    records = line.records_until_end(40)
    assert line.done("stream", what=8, channels=0, period_s=1) == 0
    return records


def store(line):
    name, reply = line.ask("table_from_cal", created_s=1750000000, serial="0001")
    assert name == "done" and reply["status"] == 0, reply


def worst_means(line):
    """Largest |mean over 40 s| of raw and of compensated rates over a run of the feed."""
    assert line.done("stream", what=9, channels=0, period_s=1) == 0
    seconds = [v for n, v in line.records_until_end() if n == "second"]
    assert len(seconds) == DURATION_S
    worst = []
    for key in ("raw", "out"):
        blocks = [[sum(s[key][c] for s in seconds[i:i + 40]) / 40 for c in range(3)] for i in range(0, DURATION_S, 40)]
        worst.append(max(abs(v) for block in blocks for v in block))
    return worst


def power_cycle(device, port, flash, feed):
    """A new process on the old flash; the nRF51's flash lives in QEMU, so there the device restarts itself."""
    if port != "nrf51":
        device.kill()
        return Device(port, flash, feed, extra=options(port)).__enter__()
    assert device.line.done("reboot", reserved=0) == 0
    time.sleep(0.3)
    return device


@pytest.fixture(scope="module")
def tables(feed, tmp_path_factory):
    """Table bytes learnt on each port from the same feed; and each device was power-cycled and run again."""
    result = {}
    for port in PORTS:
        flash = tmp_path_factory.mktemp("flash") / (port + ".flash")
        device = Device(port, flash, feed, extra=options(port)).__enter__()
        try:
            records = learn(device.line)
            store(device.line)
            before = device.line.download()
            device = power_cycle(device, port, flash, feed)
            info = device.line.info()
            result[port] = dict(records=records, table=before, after=device.line.download(), info=info,
                                worst=worst_means(device.line))
        finally:
            device.kill()
    return result


@pytest.mark.parametrize("port", PORTS)
def test_device_learns_stores_and_compensates_after_power_cycle(tables, port):
    run = tables[port]
    assert [n for n, _ in run["records"]].count("second") == DURATION_S
    counters = [v["counter"] for n, v in run["records"] if n == "second"]
    assert counters == list(range(DURATION_S))
    assert run["info"]["table_status"] == 0 and run["info"]["sequence"] == 1
    assert run["after"] == run["table"]
    raw, out = run["worst"]
    assert raw > 350  # the bias is there
    assert out < 15  # mean of 40 s of 60/sqrt(20) dph noise: 2.1 dph; 3-sigma of 30 values, and the fit's own error


def test_whole_app_gives_the_same_bits_on_every_port(tables):
    for port in PORTS[1:]:
        assert tables[port]["table"] == tables["posix"]["table"]
        for kind in ("second", "innovation", "progress"):
            assert ([v for n, v in tables[port]["records"] if n == kind] ==
                    [v for n, v in tables["posix"]["records"] if n == kind])


def test_six_channels_of_order_5_fit_the_small_target(tmp_path):
    """16 KB RAM; and the stack painted at the start shows no more than the call graph predicts."""
    feed, monitor, dump = make_feed(tmp_path / "six.bin", channels=6), free_port(), tmp_path / "stack.bin"
    with Device("nrf51", feed=feed, extra=options("nrf51", channels=6, scale=1),
                monitor="tcp:127.0.0.1:%d,server,nowait" % monitor) as device:
        seconds = [v for n, v in learn(device.line, channels=6, order=5) if n == "second"]
        assert len(seconds) == DURATION_S and seconds[-1]["n_channels"] == 6
        store(device.line)
        table = device.line.download()
        assert len(table) == 44 + 6 * 136 + 4
        assert device.line.ask("channel_info", channel=5)[1]["is_compensated"] == 1
        assert device.line.upload(table) == 0
        monitor_command(monitor, 'stop\nmemsave 0x20003400 3072 "%s"' % dump)
    words = struct.unpack("<768I", dump.read_bytes())
    used = 3072 - 4 * next(i for i, word in enumerate(words) if word != 0xA5C35A3C)
    import cost
    predicted, _ = cost.deepest(cost.call_graph(BUILD, "arm-none-eabi-", "nrf51"), "main")
    assert 1000 < used <= predicted <= 3072


# ---- power cuts ----

def table_with(base, b0):
    """The same table with another b0 on channel 0 (found by its bits) and a new CRC."""
    import zlib
    (old,) = struct.unpack_from("<f", base, table_with.offset)
    assert old != 0
    changed = base[:table_with.offset] + struct.pack("<f", b0) + base[table_with.offset + 4:-4]
    return changed + struct.pack("<I", zlib.crc32(changed))


def find_b0(line, table):
    coefficient = line.ask("cal_state", channel=0)[1]["coeff"][0]
    table_with.offset = table.index(struct.pack("<f", coefficient))


def ruling_b0(line):
    return struct.unpack_from("<f", line.download(), table_with.offset)[0]


@pytest.fixture(scope="module")
def good_table(feed, tmp_path_factory):
    with Device("posix", None, feed, extra=options("posix")) as device:
        learn(device.line)
        store(device.line)
        table = device.line.download()
        find_b0(device.line, table)
        return table_with(table, 1.0)


def begin_commit(line, table):
    """Uploads and sends the commit without waiting for its answer."""
    import zlib
    assert line.done("table_begin", total=len(table), crc=zlib.crc32(table)) == 0
    for at in range(0, len(table), 200):
        data = table[at:at + 200]
        assert line.done("table_data", offset=at, length=len(data), data=data) == 0
    line.send_bytes(line.command("table_commit", 77, reserved=0))


@pytest.mark.parametrize("port", ["posix", "mps2_an386"])
def test_kill_in_the_middle_of_a_flash_write_keeps_the_last_good_table(port, good_table, tmp_path):
    flash, seen = tmp_path / "cut.flash", set()
    with Device(port, flash, extra=options(port)) as device:
        assert device.line.upload(good_table) == 0
    for k in range(24):  # until some cut was seen inside the write: on a busy machine the first ones come too early
        if k > 4 and any(what not in ("old", "new") for what in seen):
            break
        new = table_with(good_table, 2.0 + k)
        with Device(port, flash, extra=options(port, flash_delay_us=1500)) as device:
            before = ruling_b0(device.line)
            begin_commit(device.line, new)
            time.sleep(0.03 + 0.035 * k)
            device.kill()
        with Device(port, flash, extra=options(port)) as device:
            info = device.line.info()
            assert info["table_status"] == 0, info
            after = ruling_b0(device.line)
            assert after in (before, 2.0 + k)
            seen.add("new" if after == 2.0 + k else "old")
            seen |= {status for status in info["slot_status"] if status < 0}
    assert "old" in seen
    assert any(status != "old" and status != "new" for status in seen)  # some cut left a slot that is refused
    with Device(port, flash, extra=options(port)) as device:
        assert device.line.upload(table_with(good_table, 99.0)) == 0
        assert ruling_b0(device.line) == 99.0


def test_posix_cut_at_an_exact_place_exits_with_its_status(good_table, tmp_path):
    n_cuts, flash = 0, tmp_path / "cut.flash"
    for operation in range(8):
        flash.unlink(missing_ok=True)
        with Device("posix", flash, extra=options("posix")) as device:
            assert device.line.upload(good_table) == 0
        with Device("posix", flash, extra=options("posix", cut="%d:2" % operation)) as device:
            begin_commit(device.line, table_with(good_table, 5.0))
            try:
                device.line.sequence = 77
                assert device.line.reply(2)[1]["status"] == 0  # fewer operations than that: done
                expected = 5.0
            except (Silence, OSError):
                assert device.process.wait(5) == 9
                n_cuts, expected = n_cuts + 1, 1.0
        with Device("posix", flash, extra=options("posix")) as device:
            assert ruling_b0(device.line) == expected
    assert 3 <= n_cuts < 8  # erase, program, commit at least


def monitor_command(port, text):
    with connect("127.0.0.1", port) as s:
        s.settimeout(5)
        s.sendall(text.encode() + b"\n")
        time.sleep(0.15)
        s.recv(65536)


def test_nrf51_flash_carried_over_a_power_cut_between_two_machines(good_table, tmp_path):
    """What the emulated flash controller holds when the machine is stopped in a commit is loaded into a new one."""
    for k in range(2):
        dump, monitor = tmp_path / ("flash%d.bin" % k), free_port()
        with Device("nrf51", extra=options("nrf51"), monitor="tcp:127.0.0.1:%d,server,nowait" % monitor) as device:
            assert device.line.upload(good_table) == 0
            begin_commit(device.line, table_with(good_table, 7.0 + k))
            monitor_command(monitor, 'stop\nmemsave 0x3f800 2048 "%s"' % dump)
        assert dump.stat().st_size == 2048
        program = tmp_path / "program.bin"
        subprocess.run(["arm-none-eabi-objcopy", "-O", "binary", BUILD / "firmware/nrf51/imucal.elf", program], check=True)
        chip = tmp_path / "chip.bin"  # all 256 KB of the flash: program, erased, the two slots
        chip.write_bytes(program.read_bytes().ljust(0x3F800, b"\xff") + dump.read_bytes())
        with Device("nrf51", extra=options("nrf51"), kernel=chip) as device:
            assert device.line.info()["table_status"] == 0
            assert ruling_b0(device.line) in (1.0, 7.0 + k)


# ---- the line and the feed ----

def test_second_host_after_one_that_vanished_in_a_request(tmp_path):
    with Device("posix", serial="tcp:0") as device:
        device.line.send_bytes(frame(2, 1, b"\0")[:5])
        device.line.socket.close()
        line = Line(device.name)
        line.send_bytes(b"\0")
        line.greet()
        assert line.info()["session"] == 0


def test_pty_does_not_echo_and_survives_its_host():
    with Device("posix") as device:
        first = device.line.info()
        os.close(device.line.fd)
        again = Line(device.name).greet()
        assert again.info()["uptime_us"] > first["uptime_us"]
        assert again.ask("counters", reserved=0)[1]["rx_unknown"] == 0


def test_feed_from_a_named_pipe_and_commands_while_it_is_silent(tmp_path, feed):
    pipe = tmp_path / "feed.fifo"
    os.mkfifo(pipe)
    with Device("posix", feed=pipe, extra=options("posix")) as device:
        assert device.line.done("stream", what=9, channels=0, period_s=1) == 0
        assert device.line.info()["stream_what"] == 9  # serves though nobody writes
        writer = threading.Thread(target=lambda: pipe.write_bytes(feed.read_bytes()))
        writer.start()
        records = device.line.records_until_end(20)
        writer.join()
        assert [n for n, _ in records].count("second") == DURATION_S


def test_feed_out_of_step_costs_only_what_it_touches(tmp_path, feed):
    damaged = tmp_path / "damaged.bin"
    data = feed.read_bytes()
    damaged.write_bytes(b"noise" + data[:40 * 1000] + data[40 * 1000 + 4:])
    with Device("posix", feed=damaged, extra=options("posix")) as device:
        assert device.line.done("stream", what=9, channels=0, period_s=1) == 0
        seconds = [v for n, v in device.line.records_until_end(20) if n == "second"]
        counters = device.line.ask("counters", reserved=0)[1]
        assert len(seconds) == DURATION_S and counters["feed_errors"] >= 2
        assert sum(s["n_samples"] for s in seconds) == DURATION_S * RATE_HZ - 1


@pytest.mark.parametrize("port", ["posix", "mps2_an386"])
def test_missing_feed_is_told(port, tmp_path):
    with Device(port, tmp_path / "flash", tmp_path / "nothing", extra=options(port)) as device:
        assert device.line.done("stream", what=9, channels=0, period_s=1) == 0
        records = device.line.records_until_end(20)
        assert [v["status"] for n, v in records if n == "event" and v["code"] == 5] == [-48]


def test_live_device_takes_samples_without_being_asked(feed):
    with Device("posix", feed=feed, extra=options("posix") + ["--live"]) as device:
        end = time.monotonic() + 10
        while device.line.ask("counters", reserved=0)[1]["samples"] < DURATION_S * RATE_HZ:
            assert time.monotonic() < end
        assert device.line.ask("counters", reserved=0)[1]["seconds"] >= DURATION_S - 1


# ---- options ----

@pytest.mark.parametrize("arguments, complaint", [
    (["--channels", "7"], "channels"), (["--channels", "two"], "--channels"), (["--scale", "1,x"], "--scale"),
    (["--scale", "-1"], "scale"), (["--serial", "usb"], "--serial"), (["--cut", "x"], "--cut"),
    (["--names", "a_very_long_name"], "--names"), (["stray"], "stray"), (["--flash", "/nowhere/flash"], "/nowhere/flash")])
def test_posix_bad_option_is_refused_by_name(arguments, complaint):
    run = subprocess.run([BUILD / "firmware/posix/imucal", *arguments], capture_output=True, text=True, timeout=5)
    assert run.returncode == 2
    assert complaint in run.stderr and run.stderr.startswith("imucal: ")


@pytest.mark.parametrize("arguments, complaint", [
    ([], "flash=PATH"), (["flash=%s", "channels=9"], "channels"), (["flash=%s", "wheels=4"], "wheels"),
    (["flash=/nowhere/flash"], "/nowhere/flash")])
def test_mps2_bad_argument_is_refused_by_name(arguments, complaint, tmp_path):
    arguments = [a % (tmp_path / "f") if "%s" in a else a for a in arguments]
    config = ",".join(["enable=on,target=native,arg=imucal"] + ["arg=" + a for a in arguments])
    run = subprocess.run(["qemu-system-arm", "-M", "mps2-an386", "-kernel", BUILD / "firmware/mps2_an386/imucal.elf",
                          "-display", "none", "-serial", "null", "-monitor", "none", "-semihosting-config", config],
                         capture_output=True, text=True, timeout=10)
    assert run.returncode == 2
    assert complaint in run.stderr


def test_two_devices_cannot_share_a_flash_file(tmp_path):
    with Device("posix", tmp_path / "one.flash"):
        run = subprocess.run([BUILD / "firmware/posix/imucal", "--flash", tmp_path / "one.flash"], capture_output=True,
                             text=True, timeout=5)
        assert run.returncode == 2 and "in use" in run.stderr
