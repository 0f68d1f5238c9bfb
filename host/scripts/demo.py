# SPDX-License-Identifier: MIT
"""The demonstration: an IMU on an emulated microcontroller is calibrated over its serial port.

    demo.py --build build                 simulated chamber: 140 min, 0 to 60 degC, three gyros at 100 Hz
    demo.py --build build --log LOG.csv [--check-log LOG.csv]   the same on a recorded log, replayed into the firmware as raw counts

1. QEMU runs the firmware of a Cortex-M4F; `gyrosim` is its sensor; `calibrate run` learns, flashes and verifies.
2. The power is cut (QEMU is killed) and comes back: the flashed table must be there.
3. The same temperature profile once more, now compensated by the firmware: what is left of the bias?

Everything it makes stands in BUILD/demo: logs, table, report.json, calibration.png."""

import argparse
import atexit
import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "python"))
import imucal  # noqa: E402
import plot_calibration  # noqa: E402

PROFILE = {"imucal_profile": 1, "start_degc": 0, "segments": [
    {"rate_degc_per_min": 0, "duration_s": 1200}, {"rate_degc_per_min": 0.6, "to_degc": 60},
    {"rate_degc_per_min": 0, "duration_s": 1200}]}
NOISE = {"imucal_model": 1, "arw_deg_rt_h": 0.6, "markov": [{"sigma_dph": 20, "tau_s": 100}]}
TRUE_COEFF_DPH = {"gx_dph": [80, 300, 150, -100], "gy_dph": [-240, -180, 90, 60], "gz_dph": [150, 90, -220, 130]}
MINUTE_S = 60


class Step:
    """Says what is done, and how long it took."""

    def __init__(self, text):
        self.text = text

    def __enter__(self):
        print(f"{self.text} ...", flush=True)
        self.start = time.monotonic()

    def __exit__(self, kind, value, trace):
        if kind is None:
            print(f"   {time.monotonic() - self.start:.1f} s", flush=True)


class Device:
    """The firmware on an emulated MPS2 board; its flash file outlives it."""

    def __init__(self, build, folder, board):
        self.command = ["qemu-system-arm", "-M", "mps2-an386", "-kernel", str(build / "firmware/mps2_an386/imucal.elf"),
                        "-display", "none", "-monitor", "none", "-serial", "pty", "-semihosting-config",
                        "enable=on,target=native,arg=imucal," + ",".join(
                            "arg=%s=%s" % (name, str(value).replace(",", ",,")) for name, value in board.items())]
        self.folder, self.process, self.port = folder, None, None
        atexit.register(self.cut_power)

    def power_on(self):
        self.process = subprocess.Popen(self.command, cwd=self.folder, stdout=subprocess.PIPE, text=True)
        line = self.process.stdout.readline()
        found = re.search(r"(/dev/pts/\d+)", line)
        if not found:
            sys.exit(f"demo: QEMU did not start: {line.strip() or 'no serial port'}; is qemu-system-arm installed?")
        self.port = found.group(1)

    def cut_power(self):
        if self.process and self.process.poll() is None:
            self.process.send_signal(signal.SIGKILL)
            self.process.wait()


class Demo:
    """Folders, programs, and what both kinds of demonstration share."""

    def __init__(self, build, seed):
        self.build, self.seed = build.resolve(), seed
        self.folder = self.build / "demo"
        self.folder.mkdir(parents=True, exist_ok=True)
        for old in self.folder.iterdir():
            old.unlink()
        os.mkfifo(self.folder / "feed")
        self.sensor = None
        atexit.register(self.stop_sensor)

    def write(self, name, content):
        (self.folder / name).write_text(json.dumps(content, indent=1) + "\n")

    def read(self, name):
        return json.loads((self.folder / name).read_text())

    def start_sensor(self, arguments):
        """gyrosim waits until the device opens its feed, then delivers as fast as it is taken."""
        self.stop_sensor()
        self.sensor = subprocess.Popen([self.build / "bin/gyrosim", *arguments, "--to", "feed", "--quiet"], cwd=self.folder)

    def stop_sensor(self):
        if self.sensor and self.sensor.poll() is None:
            self.sensor.kill()
        if self.sensor:
            self.sensor.wait()

    def calibrate(self, device, *arguments):
        code = subprocess.run([self.build / "bin/calibrate", "--port", device.port, *arguments], cwd=self.folder).returncode
        if code != 0:
            print(self.why(code, arguments), file=sys.stderr)
            sys.exit(code)

    def why(self, code, arguments):
        """What to do about a calibrate that did not end well."""
        command = next(a for a in arguments if a in ("run", "verify", "record"))
        reasons = self.read("run.json").get("judgement", {}).get("reasons", []) if (self.folder / "run.json").exists() else []
        rules = sorted({r["rule"] for r in reasons if not r.get("accepted")})
        if command != "run" or code != 1 or not rules:
            return f"demo: calibrate {command} ended with status {code}; its message stands above, its files in {self.folder}"
        return ("demo: the device did not take this calibration, for the reasons above. With a simple error model, estimated from the log, "
                "that may well be: give another order (ORDER=2), or a longer or quieter log.\n"
                f"demo: to see it flashed and compensated all the same: make demo LOG=... ACCEPT=\"{' '.join(rules)}\"")

    def log(self, name):
        return read_log(self.folder / name)

    def run(self, device, sensor_first, sensor_again, duration_s, run_arguments, again="the same profile again"):
        """Calibrate, cut the power, verify, run again compensated.  The sensor's data end both runs, a minute before the
        duration given would: which of two ends comes first must not depend on the machine's speed."""
        ends = ["--duration-s", str(duration_s + 60), "--force"]
        device.power_on()
        with Step("1. calibrating: the Kalman filters on the microcontroller learn the polynomials"):
            self.start_sensor(sensor_first)
            self.calibrate(device, "--json", "run.json", "run", *run_arguments, *ends, "--record", "before.csv", "-o", "table.json")
        with Step("2. power cut (QEMU killed), power on, table verified"):
            device.cut_power()
            device.power_on()
            self.calibrate(device, "verify", "table.json")
        with Step("3. %s, compensated by the firmware" % again):
            self.start_sensor(sensor_again)
            self.calibrate(device, "--json", "again.json", "record", *ends, "-o", "again_raw.csv", "--compensated", "after.csv")
        device.cut_power()


def read_log(path):
    """Returns {"t_s": array, "temp_degc": array, "gx_dph": array, ...} of a log; one that cannot be read ends the demonstration."""
    try:
        log = imucal.read_log(path)
    except imucal.DataError as error:
        print(f"demo: {error}", file=sys.stderr)
        sys.exit(3)
    return {"t_s": log.t_s, "temp_degc": log.temp_degc, **log.rates}


def block_means(values, n):
    """Means over blocks of n rows; the rest at the end is left out."""
    usable = len(values) // n * n
    return np.nanmean(values[:usable].reshape(-1, n), axis=1)


def binned(temp_degc, rate_dph, n_bins=12):
    """Means of one-minute means in evenly wide temperature bins that hold at least five of them."""
    edges = np.linspace(temp_degc.min(), temp_degc.max(), n_bins + 1)
    place = np.clip(np.digitize(temp_degc, edges) - 1, 0, n_bins - 1)
    count = np.bincount(place, minlength=n_bins)
    keep = count >= 5
    return (np.bincount(place, temp_degc, n_bins)[keep] / count[keep], np.bincount(place, rate_dph, n_bins)[keep] / count[keep])


def polynomial(axis, temp_degc):
    """B(T) of a table's axis [dph]."""
    return np.polynomial.polynomial.polyval((temp_degc - axis["t0_degc"]) / axis["range_degc"], axis["coeff_dph"])


def minute_noise_dph(model):
    """Standard deviation of one-minute means of the model's noise: white and Markov, closed form."""
    variance = (60 * model["arw_deg_rt_h"]) ** 2 / MINUTE_S
    for term in model["markov"]:
        phi = math.exp(-1 / term["tau_s"])
        lags = np.arange(1, MINUTE_S)
        variance += term["sigma_dph"] ** 2 / MINUTE_S**2 * (MINUTE_S + 2 * np.sum((MINUTE_S - lags) * phi**lags))
    return math.sqrt(variance)


def examine(axis, before, after, model, true_coeff=None):
    """One axis of the report: figures and curves."""
    name = axis["axis"]
    minutes = {}
    for key, log in (("before", before), ("after", after)):
        minutes[key] = (block_means(log["temp_degc"], MINUTE_S), block_means(log[name], MINUTE_S))
    temp, sigma = np.array(axis["curve"]["temp_degc"]), np.array(axis["curve"]["sigma_dph"])
    constant = 0.0 if true_coeff is not None else float(round(axis["coeff_dph"][0]))
    bin_before, bin_after = binned(*minutes["before"]), binned(*minutes["after"])
    result = {
        "axis": name,
        "noise_alone_dph": minute_noise_dph(model),
        "before": {"temp_degc": minutes["before"][0].tolist(), "rate_dph": minutes["before"][1].tolist()},
        "after": {"temp_degc": minutes["after"][0].tolist(), "rate_dph": minutes["after"][1].tolist()},
        "after_binned": {"temp_degc": bin_after[0].tolist(), "rate_dph": bin_after[1].tolist()},
        "constant_dph": constant,
        "table": {"temp_degc": temp.tolist(), "bias_dph": polynomial(axis, temp).tolist(), "sigma_dph": sigma.tolist()},
        "figures": {
            "bias_travel_dph": float(np.ptp(bin_before[1])),
            "rms_before_dph": float(np.sqrt(np.mean(minutes["before"][1] ** 2))),
            "rms_after_dph": float(np.sqrt(np.mean(minutes["after"][1] ** 2))),
            "binned_before_dph": float(np.sqrt(np.mean(bin_before[1] ** 2))),
            "binned_after_dph": float(np.sqrt(np.mean(bin_after[1] ** 2))),
            "worst_sigma_dph": float(np.max(axis["sigma_dph"])),
        },
    }
    if true_coeff is not None:
        truth = np.polynomial.polynomial.polyval((temp - 30) / 30, true_coeff)
        error = polynomial(axis, temp) - truth
        result["truth_error_dph"] = error.tolist()
        result["figures"].update(true_error_rms_dph=float(np.sqrt(np.mean(error**2))),
                                 true_error_worst_dph=float(np.max(np.abs(error))),
                                 worst_error_over_sigma=float(np.max(np.abs(error) / sigma)))
    return result


def print_report(report):
    has_truth = "truth_error_dph" in report["axes"][0]
    print("\nDone. Rates in deg/h; one-minute means.\n")
    head = f"{'axis':8}{'bias travel':>13}{'rms before':>12}{'rms after':>11}{'noise alone':>13}"
    print(head + (f"{'true error rms':>16}{'worst':>8}{'predicted worst':>17}" if has_truth else f"{'predicted worst':>17}"))
    for axis in report["axes"]:
        f = axis["figures"]
        line = (f"{axis['axis']:8}{f['bias_travel_dph']:13.1f}{f['rms_before_dph']:12.1f}{f['rms_after_dph']:11.1f}"
                f"{axis['noise_alone_dph']:13.1f}")
        if has_truth:
            line += f"{f['true_error_rms_dph']:16.2f}{f['true_error_worst_dph']:8.2f}"
        print(line + f"{f['worst_sigma_dph']:17.2f}")
    if has_truth:
        worst = max(axis["figures"]["worst_error_over_sigma"] for axis in report["axes"])
        print(f"\ntrue error: learned minus true polynomial over the range; at most {worst:.1f} of the predicted sigma anywhere")
    print(f"device: {report['device']}; {report['seconds']:.0f} s of sensor time twice, {report['wall_s']:.0f} s in all; "
          f"seed {report['seed']}")


def finish(demo, report, start_s):
    demo.write("report.json", report)
    plot_calibration.plot(report).savefig(demo.folder / "calibration.png", dpi=130)
    report["wall_s"] = time.monotonic() - start_s
    demo.write("report.json", report)
    print_report(report)
    print(f"plot: {os.path.relpath(demo.folder / 'calibration.png')}")


def simulated(demo):
    """The chamber of the paper's Section III: 140 min, 0 to 60 degC at 0.6 degC/min, soaks of 20 min."""
    start_s = time.monotonic()
    demo.write("profile.json", PROFILE)
    demo.write("filter_model.json", NOISE)
    for name, coeff in TRUE_COEFF_DPH.items():
        demo.write(f"{name}.json", {**NOISE, "bias": {"t0_degc": 30, "range_degc": 30, "coeff_dph": coeff}})
    device = Device(demo.build, demo.folder, {"flash": "imu.flash", "feed": "feed", "serial": "DEMO-1", "scale": "36,36,36",
                                              "full-scale": "32767,32767,32767", "rate": 100})
    serve = ["serve", "--profile", "profile.json", "--seed", str(demo.seed), "--rate-hz", "100", "--counts-scale-dph", "36",
             "--full-scale-counts", "32767", "--jitter-s", "0.001", "--missing-samples", "0.001"]
    for name in TRUE_COEFF_DPH:
        serve += ["--model", f"{name}.json"]
    print("An IMU with three gyros on an emulated Cortex-M4F (QEMU mps2-an386), in a simulated chamber:\n"
          "140 min, 0 to 60 degC at 0.6 degC/min, 100 raw samples per second; noise 0.6 deg/sqrt(h), drift 20 deg/h, 100 s\n")
    demo.run(device, serve + ["--log-index", "0"], serve + ["--log-index", "1"], 8400,
             ["--order", "3", "--model", "filter_model.json", "--profile", "profile.json"])
    before, after, run = demo.log("before.csv"), demo.log("after.csv"), demo.read("run.json")
    return start_s, {
        "title": "A gyro triad calibrated on its microcontroller",
        "subtitle": "140 min, 0 to 60 °C at 0.6 °C/min; angle random walk 0.6 deg/√h, drift 20 deg/h (100 s); one-minute means",
        "device": run["device"]["device"], "seed": demo.seed, "seconds": run["seconds"], "wall_s": 0,
        "axes": [examine(axis, before, after, NOISE, TRUE_COEFF_DPH[axis["axis"]]) for axis in run["axes"]]}


def model_of_residuals(temp_degc, rate_dph, order):
    """A simple error model of one axis: white noise from differences of neighbours, one Markov process from the
    one-minute means of the residuals of a polynomial (variance above the white noise, first e-folding of the
    autocorrelation)."""
    keep = np.isfinite(rate_dph) & np.isfinite(temp_degc)
    temp, rate = temp_degc[keep], rate_dph[keep]
    residual = rate - np.polynomial.Polynomial.fit(temp, rate, order)(temp)
    white = np.std(np.diff(residual)) / math.sqrt(2)
    minutes = block_means(residual, MINUTE_S)
    minutes -= minutes.mean()
    covariance = np.correlate(minutes, minutes, "full")[len(minutes) - 1:] / len(minutes)
    slow = max(covariance[0] - white**2 / MINUTE_S, 1e-6)
    below = np.nonzero(covariance[1:] < covariance[1] / math.e)[0]
    tau_s = MINUTE_S * (below[0] + 1 if len(below) else len(minutes) / 3)
    return {"imucal_model": 1, "arw_deg_rt_h": white / 60, "markov": [{"sigma_dph": math.sqrt(slow), "tau_s": float(tau_s)}]}


def fit_to_replay(path, log, order):
    """Names of the log's gyros; ends with status 3 where the demonstration cannot use the log."""
    axes = [name for name in log if name.endswith("_dph")]
    remedy = f"imucal import {path} -o log.csv writes a log as it is needed (t_s,temp_degc,gx_dph,...)"
    temp = log.get("temp_degc")
    problem = None
    if not axes:
        problem = f"no column ending in _dph; {remedy}"
    elif temp is None or not np.isfinite(temp).any():
        problem = "no temperature, and a thermal calibration needs one"
    elif np.nanmax(temp) - np.nanmin(temp) < order:
        problem = f"the temperature moves by {np.nanmax(temp) - np.nanmin(temp):.2f} degC only; order {order} needs {order} at least"
    elif min(np.count_nonzero(np.isfinite(log[name]) & np.isfinite(temp)) for name in axes) < 10 * MINUTE_S:
        problem = "an axis has less than ten minutes with rate and temperature"
    if problem:
        print(f"demo: {path}: {problem}", file=sys.stderr)
        sys.exit(3)
    return axes


def recorded(demo, log_path, check_path, order, rate_hz, accept):
    """A recorded log, replayed as raw counts so that the device's 1-s sums give the recorded means back; the second
    run is of check_path where it is given: a recording the device has not learned from."""
    start_s = time.monotonic()
    log_path = Path(log_path).resolve()
    source = read_log(log_path)
    axes = fit_to_replay(log_path, source, order)
    models = {name: model_of_residuals(source["temp_degc"], source[name], order) for name in axes}
    for name, model in models.items():
        demo.write(f"{name}.json", model)
    lo, hi = np.nanmin(source["temp_degc"]), np.nanmax(source["temp_degc"])
    board = {"flash": "imu.flash", "feed": "feed", "serial": "DEMO-2", "rate": rate_hz, "channels": len(axes),
             "names": ",".join(axes), "scale": ",".join(["1"] * len(axes))}
    device = Device(demo.build, demo.folder, board)
    options = ["--rate-hz", str(rate_hz), "--seed", str(demo.seed)]
    again_path = Path(check_path or log_path).resolve()
    duration_s, span_s = len(source["temp_degc"]), int(source["t_s"][-1] - source["t_s"][0] + 1)
    print(f"{log_path.name}: {duration_s} s, {lo:.1f} to {hi:.1f} degC, replayed at {rate_hz} Hz into an emulated Cortex-M4F;\n"
          f"polynomials of order {order}; error models estimated from the log:")
    for name, model in models.items():
        drift = model["markov"][0]
        print(f"   {name}: {model['arw_deg_rt_h']:.2f} deg/sqrt(h), drift {drift['sigma_dph']:.1f} deg/h, {drift['tau_s']:.0f} s")
    arguments = ["--order", str(order), "--range", f"{lo:.3f}:{hi:.3f}"]
    for name in axes:
        arguments += ["--model", f"{name}.json"]
    for rule in accept:
        arguments += ["--accept", rule]
    demo.run(device, ["replay", log_path, *options], ["replay", again_path, *options], span_s, arguments,
             f"replay of {again_path.name}")
    before, after, run = demo.log("again_raw.csv"), demo.log("after.csv"), demo.read("run.json")
    return start_s, {
        "title": "A recorded IMU calibrated on the microcontroller",
        "subtitle": f"learned from {log_path.name}, shown on {again_path.name}: {duration_s} s, {lo:.1f} to {hi:.1f} °C, polynomials of order {order}; one-minute means",
        "device": run["device"]["device"], "seed": demo.seed, "seconds": run["seconds"], "wall_s": 0,
        "axes": [examine(axis, before, after, models[axis["axis"]]) for axis in run["axes"]]}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=Path, default=Path("build"), help="the build folder")
    parser.add_argument("--log", help="a recorded log to replay")
    parser.add_argument("--check-log", help="with --log: another recording for the second run")
    parser.add_argument("--order", type=int, default=3, help="order of the polynomials (with --log)")
    parser.add_argument("--rate-hz", type=int, default=10, help="raw samples per second (with --log)")
    parser.add_argument("--accept", default="", help="rules (several: separated by blanks) that shall not refuse the calibration (with --log)")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    demo = Demo(options.build, options.seed)
    start_s, report = recorded(demo, options.log, options.check_log, options.order, options.rate_hz, options.accept.split()) if options.log else simulated(demo)
    finish(demo, report, start_s)


if __name__ == "__main__":
    main()
