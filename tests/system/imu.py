# SPDX-License-Identifier: MIT
"""An IMU for tests of `calibrate`: the firmware as a process, its sensor, and the program at the other end."""
import json
import os
import re
import signal
import subprocess
import time
from pathlib import Path

from reference import BASIC, MODEL
from where import BIN, BUILD

CALIBRATE, GYROSIM = BIN / "calibrate", BIN / "gyrosim"
FIRMWARE = BUILD / "firmware/posix/imucal"

# Quick to give a silent device up.
IMPATIENT = ["--timeout-s", "0.1", "--tries", "3"]


class Imu:
    """The posix port of the firmware with a flash file in `folder`; `port` is what calibrate opens."""

    def __init__(self, folder, serial="tcp:0", options=()):
        self.folder, self.options, self.serial = Path(folder), list(options), serial
        self.feed = self.folder / "feed"
        if not self.feed.exists():
            os.mkfifo(self.feed)
        self.sensor = None
        self.power_on()

    def power_on(self, extra=()):
        self.process = subprocess.Popen(
            [FIRMWARE, "--serial", self.serial, "--flash", self.folder / "imu.flash", "--feed", self.feed,
             *self.options, *extra], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        line = self.process.stdout.readline()
        assert line.startswith("serial "), line + self.process.stderr.read()
        self.port = line.split()[1]

    def power_off(self):
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()

    def pause(self):
        os.kill(self.process.pid, signal.SIGSTOP)

    def resume(self):
        os.kill(self.process.pid, signal.SIGCONT)

    def sense(self, profile=BASIC, model=MODEL, axes=3, seed=1, options=()):
        """Start the sensor; it delivers once the device asks."""
        (self.folder / "model.json").write_text(json.dumps(model))
        (self.folder / "profile.json").write_text(json.dumps(profile))
        return self._start(["serve", "--model", "model.json", "--axes", axes, "--profile", "profile.json", "--seed", seed,
                            *options])

    def replay(self, log, options=()):
        return self._start(["replay", log, *options])

    def _start(self, arguments):
        self.stop_sensor()
        self.sensor = subprocess.Popen([GYROSIM, *map(str, arguments), "--to", self.feed, "--quiet"], cwd=self.folder,
                                       stderr=subprocess.PIPE, text=True)
        return self.sensor

    def stop_sensor(self):
        if self.sensor:
            if self.sensor.poll() is None:
                self.sensor.kill()
            self.sensor.communicate()
        self.sensor = None

    def start(self, *arguments, port=None, env=None):
        """calibrate in the background."""
        return subprocess.Popen([CALIBRATE, "--port", port or self.port, *map(str, arguments)], cwd=self.folder,
                                stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=env)

    def calibrate(self, *arguments, port=None, env=None, timeout_s=30):
        """calibrate to its end: (status, standard output, standard error)."""
        process = self.start(*arguments, port=port, env=env)
        try:
            out, err = process.communicate(timeout=timeout_s)
        except subprocess.TimeoutExpired:
            process.kill()
            out, err = process.communicate()
            raise AssertionError(f"calibrate {arguments} hangs\n{out}\n{err}")
        return process.returncode, out, err

    def run(self, *arguments, order=3, port=None, env=None):
        """`calibrate run` with the model of the sensor; the result as JSON."""
        status, out, err = self.calibrate("--json", "run.json", "run", "--order", order, "--model", "model.json",
                                          "-o", "table.json", *arguments, port=port, env=env)
        assert status == 0, out + err
        return self.json("run.json")

    def json(self, name):
        return json.loads((self.folder / name).read_text())

    def info(self):
        status, out, err = self.calibrate("--json", "-", "info")
        assert status == 0, err
        return json.loads(out)

    def close(self):
        self.stop_sensor()
        self.power_off()


class QemuImu(Imu):
    """The same on an emulated Cortex-M4F; board options as in firmware/README.md ("rate=10")."""

    def power_on(self, extra=()):
        arguments = ["flash=imu.flash", "feed=feed", *self.options, *extra]
        self.process = subprocess.Popen(
            ["qemu-system-arm", "-M", "mps2-an386", "-kernel", BUILD / "firmware/mps2_an386/imucal.elf", "-display", "none",
             "-monitor", "none", "-serial", "pty", "-semihosting-config",
             "enable=on,target=native,arg=imucal," + ",".join("arg=" + a.replace(",", ",,") for a in arguments)],
            cwd=self.folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        found = re.search(r"/dev/pts/\d+", self.process.stdout.readline())
        assert found, self.process.stderr.read()
        self.port = found.group(0)


def wait_until(condition, timeout_s=10):
    end = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)
