# SPDX-License-Identifier: MIT
"""Faults in front of a device: the firmware as a process is fed with raw samples that are spoilt, `calibrate run` talks to it,
and what came of it is one row of the table.  10 samples a second of three gyros; gx is sick, gy and gz are healthy."""
import json
import os
import resource
import signal
import subprocess
import threading
import time
from pathlib import Path

import numpy as np

from imu import CALIBRATE, IMPATIENT, Imu, wait_until
from noisy_line import NoisyLine
from reference import DRIFTING as MODEL
from reference import soaked_ramp
from sick.case import Fault, Outcome

RATE_HZ, SOAK_S, RAMP_S = 10, 300, 1000
TEST_S = 2 * SOAK_S + RAMP_S  # 0 to 60 degC
PROFILE = soaked_ramp(SOAK_S, 3.6)
FULL_SCALE = 8388607
RECORD = np.dtype([("marker", "u1"), ("n", "u1"), ("saturated", "u1"), ("fault", "u1"), ("temp", "<i4"), ("t_us", "<u8"), ("counts", "<i4", 6)])


def markov(n, sigma, tau_s, rng):
    phi = np.exp(-1 / (tau_s * RATE_HZ))
    noise = rng.normal(0, sigma * np.sqrt(1 - phi * phi), n)
    out = np.empty(n)
    value = rng.normal(0, sigma)
    for i in range(n):
        value = phi * value + noise[i]
        out[i] = value
    return out


def healthy_samples(seed=1):
    """Arrays of a healthy test: s["t_s"], ["temp_degc"], ["rate"] (n x 3, dph), ["saturated"], ["fault"], ["stamp_us"]."""
    rng = np.random.default_rng(seed)
    n = TEST_S * RATE_HZ
    t_s = np.arange(n) / RATE_HZ
    temp = np.clip((t_s - SOAK_S) * 60 / RAMP_S, 0, 60)
    tn = (temp - 30) / 30
    bias = np.polynomial.polynomial.polyval(tn, MODEL["bias"]["coeff_dph"])
    noise = rng.normal(0, 36 * np.sqrt(RATE_HZ), (n, 3)) + np.stack([markov(n, 20, 100, rng) for _ in range(3)], 1)
    return {"t_s": t_s, "temp_degc": temp, "rate": bias[:, None] + noise, "saturated": np.zeros(n, "u1"), "fault": np.zeros(n, "u1"),
            "stamp_us": (t_s * 1e6).round().astype("u8") + np.uint64(1000)}


def as_bytes(samples):
    records = np.zeros(len(samples["t_s"]), RECORD)
    records["marker"], records["n"] = 0xA5, 3
    records["temp"] = np.round((samples["temp_degc"] - 25) / 0.01)
    records["t_us"] = samples["stamp_us"]
    records["counts"][:, :3] = np.clip(np.round(samples["rate"]), -FULL_SCALE, FULL_SCALE)
    records["saturated"], records["fault"] = samples["saturated"], samples["fault"]
    return records.tobytes()


class DeviceBench:
    """One device after the other, each with erased flash and a sensor of its own."""

    def __init__(self, folder):
        self.folder = Path(folder)
        self.n = 0
        self.healthy = healthy_samples()

    def start(self, serial="tcp:0"):
        self.n += 1
        folder = self.folder / f"device{self.n}"
        folder.mkdir(parents=True, exist_ok=True)
        for name in ("feed", "imu.flash", "log.csv", "log.csv.part", "run.json", "table.json"):
            (folder / name).unlink(missing_ok=True)
        imu = Imu(folder, serial=serial, options=["--rate", str(RATE_HZ), "--serial-number", "sick-1"])
        (folder / "model.json").write_text(json.dumps(MODEL))
        (folder / "profile.json").write_text(json.dumps(PROFILE))
        return imu

    def feed(self, imu, data, holds_s=0.0, paced=0.0):
        """The sensor: its bytes, then `holds_s` of silence before the end; paced: bytes per second."""
        def write():
            try:
                with open(imu.feed, "wb", buffering=0) as pipe:
                    step = RECORD.itemsize * RATE_HZ * 4
                    for at in range(0, len(data), step):
                        pipe.write(data[at:at + step])
                        if paced:
                            time.sleep(step / paced)
                    end = time.monotonic() + holds_s
                    while time.monotonic() < end and imu.process.poll() is None:
                        time.sleep(0.05)
            except OSError:
                pass
        thread = threading.Thread(target=write, daemon=True)
        thread.start()
        return thread

    def outcome(self, imu, process):
        try:
            out, err = process.communicate(timeout=60)
        except subprocess.TimeoutExpired:
            process.kill()
            out, err = process.communicate()
            return Outcome(-1, [], "hangs", False)
        answer = imu.json("run.json") if (imu.folder / "run.json").exists() else {}
        lines = [line for line in err.splitlines() if line]
        left_out = sum(a["n_rejected"] + a["n_bad_temperature"] for a in answer.get("axes", []))
        n = answer.get("samples", {})
        left_out += n.get("delivered", 0) - n.get("summed", 0) + n.get("clock_set", 0) + n.get("clock_wrapped", 0) + n.get("jumps", 0)
        left_out += answer.get("link", {}).get("spoilt_frames", 0)
        rules = sorted({r["rule"] for r in answer.get("judgement", {}).get("reasons", [])})
        if imu.process.poll() is not None:
            imu.power_on()
        return Outcome(process.returncode, rules, lines[0] if lines else "", self.is_flashed(imu), left_out)

    def is_flashed(self, imu):
        return any(byte != 0xFF for byte in (imu.folder / "imu.flash").read_bytes()) if (imu.folder / "imu.flash").exists() else False

    def run(self, samples=None, *arguments, feeding=None, **options):
        """`calibrate run` on a device fed with `samples`; during(imu, process) meanwhile."""
        imu = self.start()
        try:
            self.feed(imu, as_bytes(samples or self.healthy), **(feeding or {}))
            return self.run_on(imu, *arguments, **options)
        finally:
            imu.close()

    def run_on(self, imu, *arguments, during=None, preexec=None, port=None, link=IMPATIENT, record="log.csv",
               output="table.json"):
        command = [CALIBRATE, "--port", port or imu.port, *link, "--json", "run.json", "-q", "run", "--order", "3", "--model", "model.json",
                   "--range", "0:60", "--record", record, "-o", output, *map(str, arguments)]
        process = subprocess.Popen(command, cwd=imu.folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=preexec)
        if during:
            during(imu, process)
        return self.outcome(imu, process)


# ---- faults of samples ----

def change(**arrays):
    """A copy of the healthy test with arrays changed: name=function(samples) -> array."""
    def make(samples):
        spoilt = {name: value.copy() for name, value in samples.items()}
        for name, function in arrays.items():
            spoilt[name] = function(spoilt)
        return spoilt
    return make


def gx(function, where=lambda s: slice(None)):
    def rate(s):
        s["rate"][where(s), 0] = function(s)[where(s)]
        return s["rate"]
    return change(rate=rate)


def between(lo_s, hi_s):
    return lambda s: (s["t_s"] >= lo_s) & (s["t_s"] < hi_s)


def sick(area, name, found_by, spoil, *arguments):
    return Fault(area, "device: " + name, found_by, lambda bench: bench.run(spoil(bench.healthy), *arguments))


def rng_of(seed):
    return np.random.default_rng(seed)


def second_of(s):
    return s["t_s"].astype(int)


SENSOR = [
    sick("sensor", "axis always 0", "no-noise", gx(lambda s: 0 * s["t_s"])),
    sick("sensor", "axis frozen at one value", "repeated", gx(lambda s: 123 + 0 * s["t_s"])),
    sick("sensor", "axis frozen from the middle on", "repeated", gx(lambda s: 50 + 0 * s["t_s"], between(800, 9999))),
    sick("sensor", "axis at its rail for 75 % of the time", "saturated", gx(lambda s: np.where(second_of(s) % 4 != 0, 1e9, s["rate"][:, 0]))),
    sick("sensor", "axis flagged saturated for 2 % of the time", "saturated", change(saturated=lambda s: (second_of(s) % 50 == 0).astype("u1"))),
    sick("sensor", "sensor reports a fault for 5 % of the time", "faulty", change(fault=lambda s: (second_of(s) % 20 == 0).astype("u1"))),
    sick("sensor", "fewer measurements on one axis", "measurements", change(fault=lambda s: between(700, 900)(s).astype("u1"))),
    sick("sensor", "noise three times the model's", "nis", gx(lambda s: s["rate"][:, 0] + rng_of(2).normal(0, 320, len(s["t_s"])))),
    sick("sensor", "slow random walk", "slow", gx(lambda s: s["rate"][:, 0] + np.cumsum(rng_of(3).normal(0, 5, len(s["t_s"]))))),
    sick("sensor", "step of 1000 dph that stays", "rejects", gx(lambda s: s["rate"][:, 0] + 1000 * (s["t_s"] > 800))),
    sick("sensor", "hum of 100 dph with 3 s", "lag1", gx(lambda s: s["rate"][:, 0] + 100 * np.sin(2.1 * s["t_s"]))),
    sick("sensor", "bump of 10 s, 50,000 dph", "left out", gx(lambda s: s["rate"][:, 0] + 50000 * between(700, 710)(s))),
    sick("sensor", "bump of 20 s, more than 1 % of the run", "rejects", gx(lambda s: s["rate"][:, 0] + 50000 * between(700, 720)(s))),
    sick("sensor", "bump of 20 s as the run begins", "nis", gx(lambda s: s["rate"][:, 0] + 50000 * between(0, 20)(s))),
    sick("sensor", "shape that no polynomial has", "residual", gx(lambda s: s["rate"][:, 0] + 150 * np.sign(np.sin(s["temp_degc"])))),
]

THERMOMETER = [
    sick("thermometer", "stuck from the start", "status 3", change(temp_degc=lambda s: 0 * s["t_s"] + 20)),
    sick("thermometer", "stuck from the middle of the ramp on", "temp-stuck", change(
        temp_degc=lambda s: np.minimum(s["temp_degc"], 35), rate=lambda s: s["rate"] + 25 * np.maximum(s["t_s"] - 880, 0)[:, None].clip(0, 420))),
    sick("thermometer", "jumps by 8 degC and stays", "temp-jump", change(temp_degc=lambda s: s["temp_degc"] + 8 * (s["t_s"] > 700))),
    sick("thermometer", "one second in 40 out of reach", "temp-spikes", change(temp_degc=lambda s: np.where(second_of(s) % 40 == 20, 85, s["temp_degc"]))),
    sick("thermometer", "one bad second", "left out", change(temp_degc=lambda s: np.where(second_of(s) == 700, -40, s["temp_degc"]))),
    sick("thermometer", "ramp in two minutes", "temp-ramp", change(temp_degc=lambda s: np.clip((s["t_s"] - 700) / 2, 0, 60))),
    sick("thermometer", "covers a third of the range", "span", change(temp_degc=lambda s: s["temp_degc"] / 3)),
]


def stamps(function):
    return change(stamp_us=lambda s: function(s["stamp_us"].astype("i8")).astype("u8"))


HOUR_US = 3_600_000_000
CLOCK = [
    sick("clock", "one sample an hour ahead", "left out", stamps(lambda t: np.where(np.arange(len(t)) == 8000, t + HOUR_US, t))),
    sick("clock", "one sample an hour behind", "left out", stamps(lambda t: np.where(np.arange(len(t)) == 8000, 5, t))),
    sick("clock", "set back by 10 minutes", "left out", stamps(lambda t: np.where(t > 800e6, t - 600_000_000, t))),
    sick("clock", "set forward to Unix time", "left out", stamps(lambda t: np.where(t > 800e6, t + 1_700_000_000_000_000, t))),
    sick("clock", "32-bit microseconds wrap", "left out", stamps(lambda t: (t + 2**32 - 800_000_000) % 2**32)),
    sick("clock", "32-bit milliseconds wrap", "left out", stamps(lambda t: (t // 1000 + 2**32 - 800_000) % 2**32 * 1000)),
    sick("clock", "one stamp in a hundred random", "left out", stamps(lambda t: np.where(np.arange(len(t)) % 100 == 50, rng_of(4).integers(0, HOUR_US, len(t)), t))),
    sick("clock", "every stamp twice", "left out", stamps(lambda t: t - (np.arange(len(t)) % 2) * 100_000)),
    sick("clock", "stands still", "status 4", stamps(lambda t: 0 * t + 5_000_000)),
    sick("clock", "every stamp random", "status 4", stamps(lambda t: rng_of(5).integers(0, 2**62, len(t)))),
]


# ---- line, device and operator ----

def recording_begun(imu, process, rows=50):
    path = imu.folder / "log.csv.part"
    wait_until(lambda: process.poll() is not None or (path.exists() and path.read_text().count("\n") > rows + 20))


def kept(outcome, imu_folder):
    """What was recorded before it ended is there."""
    log = imu_folder / "log.csv"
    assert log.exists() and log.read_text().count("\n") > 50, f"the record is lost: {outcome}"
    return outcome


def paced(bench):
    return {"paced": len(as_bytes(bench.healthy)) / 8}  # the test in 8 s


def power_cut(bench):
    def during(imu, process):
        recording_begun(imu, process)
        imu.power_off()
    return kept(bench.run(None, during=during, feeding=paced(bench)), bench.folder / f"device{bench.n}")


def restart_behind_the_line(bench):
    """The line stays, the device behind it starts anew."""
    imu = bench.start()
    other = bench.start()
    try:
        bench.feed(imu, as_bytes(bench.healthy), **paced(bench))
        with NoisyLine(imu.port) as line:
            took = []

            def during(imu, process):
                recording_begun(imu, process)
                fresh = NoisyLine(other.port)._open_device()
                os.dup2(fresh, line._device_fd)
                begin = time.monotonic()
                process.wait(timeout=30)
                took.append(time.monotonic() - begin)
            outcome = bench.run_on(imu, during=during, port=line.port)
            assert took[0] < 3.5, f"noticed after {took[0]:.1f} s"
            return kept(outcome, imu.folder)
    finally:
        other.close()
        imu.close()


def sensor_stops(bench):
    data = as_bytes(bench.healthy)[:RECORD.itemsize * 5000]
    took = []

    def during(imu, process):
        path = imu.folder / "log.csv.part"
        wait_until(lambda: path.exists() and path.read_text().count("\n") > 450)
        begin = time.monotonic()
        process.wait(timeout=30)
        took.append(time.monotonic() - begin)
    imu = bench.start()
    try:
        bench.feed(imu, data, holds_s=30)
        outcome = bench.run_on(imu, during=during)
        assert took[0] < 3.5, f"noticed after {took[0]:.1f} s"
        return kept(outcome, imu.folder)
    finally:
        imu.close()


def ctrl_c(*arguments):
    def inject(bench):
        def during(imu, process):
            recording_begun(imu, process, 500)
            process.send_signal(signal.SIGINT)
        return kept(bench.run(None, *arguments, during=during, feeding=paced(bench)), bench.folder / f"device{bench.n}")
    return inject


def no_room_to_record(bench):
    imu = bench.start()
    try:
        (imu.folder / "log.csv.part").symlink_to("/dev/full")
        bench.feed(imu, as_bytes(bench.healthy))
        return bench.run_on(imu, "--force")
    finally:
        imu.close()


def record_fails_later(bench):
    """The disk is full in the middle of the run: the table is flashed, the status says that the log is not whole."""
    def limit():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (60000, 60000))
    outcome = bench.run(None, preexec=limit)
    assert outcome.is_flashed, outcome
    return Outcome(outcome.status, outcome.rules, outcome.message, False, outcome.left_out)  # flashed as it must be


def noisy_line(bench):
    imu = bench.start()
    try:
        bench.feed(imu, as_bytes(bench.healthy))
        with NoisyLine(imu.port, corrupt=3e-4, double=3e-4, lose=3e-4) as line:
            return bench.run_on(imu, port=line.port, link=["--timeout-s", "0.1", "--tries", "30"])
    finally:
        imu.close()


def silent_line(bench):
    imu = bench.start()
    try:
        bench.feed(imu, as_bytes(bench.healthy), **paced(bench))
        with NoisyLine(imu.port) as line:
            def during(imu, process):
                recording_begun(imu, process)
                line.silent = True
            return kept(bench.run_on(imu, during=during, port=line.port), imu.folder)
    finally:
        imu.close()


def model_ten_times_too_good(*arguments):
    def inject(bench):
        imu = bench.start()
        try:
            (imu.folder / "model.json").write_text(json.dumps({**MODEL, "arw_deg_rt_h": 0.06, "markov": []}))
            bench.feed(imu, as_bytes(bench.healthy))
            return bench.run_on(imu, *arguments)
        finally:
            imu.close()
    return inject


LINE = [
    Fault("link", "device: line flips, doubles, loses bytes", "left out", noisy_line),
    Fault("link", "device: line falls silent", "status 4", silent_line),
    Fault("link", "device: power cut in the middle", "status 4", power_cut),
    Fault("link", "device: restarts in the middle, the line stays", "status 4", restart_behind_the_line),
    Fault("sensor", "device: sensor stops delivering", "status 4", sensor_stops),
]

OPERATORS = [
    Fault("operator", "device: Ctrl-C in the middle", "status 130", ctrl_c()),
    Fault("operator", "device: output in a folder that is not there", "status 3", lambda b: b.run(None, output="no/such/table.json")),
    Fault("operator", "device: a folder as output", "status 3", lambda b: b.run(None, output="..")),
    Fault("operator", "device: record in a folder that is not there", "status 3", lambda b: b.run(None, record="no/such/log.csv")),
    Fault("operator", "device: no room for the record at the start", "status 3", no_room_to_record),
    Fault("operator", "device: the record's disk is full in the middle", "status 3", record_fails_later),
    Fault("operator", "device: predicted error above what is allowed", "error", lambda b: b.run(None, "--max-error", "5")),
    Fault("operator", "device: model ten times too good", "nis", model_ten_times_too_good()),
    Fault("operator", "device: model ten times too good, one reason accepted", "rejects", model_ten_times_too_good("--accept", "nis")),
    Fault("operator", "device: rule to accept misspelt", "status 2", lambda b: b.run(None, "--accept", "nsi")),
]


FAULTS = SENSOR + THERMOMETER + CLOCK + LINE + OPERATORS


def campaign(bench, n):
    """Rules that refused each of n healthy runs on the device, or its status where it is not 0."""
    refused = []
    for seed in range(100, 100 + n):
        outcome = bench.run(healthy_samples(seed))
        if outcome.status != 0 or not outcome.is_flashed:
            refused.append((seed, outcome))
    return refused
