# SPDX-License-Identifier: MIT
"""What a first look asks the programs: the likely noise of each axis, what that lets expect, is a calibration accepted?"""
import json
import os
import subprocess
import tempfile

import numpy as np

from .errors import DataError
from .log import Log, write_log
from .programs import find


def _started(command):
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


class Asked:
    """Processes in the background on a log, or on a copy without the seconds that are no measurement.  Where a program is not
    there, its answer is not: what the log itself shows stands without."""

    def __init__(self, path, log, looks, is_imported, with_likelihood, trial):
        """trial: (axes, order) of a calibration that is going to be advised, or None."""
        self._folder, self._fits, self._trials = tempfile.TemporaryDirectory(prefix="imucal-"), {}, {}
        self.log_path = os.fspath(path)
        moving = [look for look in looks if not look.is_constant]
        if is_imported:
            self.log_path = self._written("log.csv", log, log.rates)
        noise_path = self.log_path
        if any(np.isnan(look.used[np.isfinite(look.rate)]).any() for look in moving):
            noise_path = self._written("noise.csv", log, {look.axis: look.used for look in moving})
        for look in moving if with_likelihood else ():
            self._start_fit(noise_path, look)
        self._noise_path = noise_path
        if trial:
            self._start_trial(*trial)

    def _written(self, name, log, rates):
        path = os.path.join(self._folder.name, name)
        write_log(path, Log(log.t_s, log.temp_degc, rates, {}, {}, name))
        return path

    @staticmethod
    def _detrend(look):
        return f"poly:{look.order}" if look.order else "mean"

    def _model_path(self, look):
        return os.path.join(self._folder.name, f"{look.axis}.json")

    def _start_fit(self, path, look):
        try:
            program = find("errormodel")
        except DataError:
            return
        # The likelihood needs no curve: two points of it are the fewest that the program makes.
        self._fits[look.axis] = _started([
            program, "fit", path, "--axis", look.axis, "--markov", "1", "--criterion", "ml", "--detrend", self._detrend(look),
            "--bootstrap", "0", "--tau", "2:4:2", "--threads", "1", "-o", self._model_path(look), "--json", "-"])

    def likelihood(self, look):
        """{"arw_deg_rt_h", "sigma_dph", "tau_s" and their errors}; empty where it could not be had."""
        if look.axis not in self._fits:
            return {}
        out, _ = self._fits[look.axis].communicate()
        if self._fits[look.axis].returncode not in (0, 1):
            return {}
        result = json.loads(out)
        markov, errors = (result["model"]["markov"] or [{}])[0], result.get("std_errors", {})
        return {"arw_deg_rt_h": result["model"]["arw_deg_rt_h"], "arw_error": errors.get("arw_deg_rt_h"),
                "sigma_dph": markov.get("sigma_dph"), "sigma_error": errors.get("markov[0].sigma_dph"),
                "tau_s": markov.get("tau_s"), "tau_error": errors.get("markov[0].tau_s")}

    def expected_allan(self, look):
        """The Allan deviation at look.allan_tau_s that the likely noise lets expect of a log with these gaps and this polynomial
        taken out; None where it could not be had."""
        if look.ml.get("arw_deg_rt_h") is None or not len(look.allan_tau_s) or not os.path.exists(self._model_path(look)):
            return None
        taus = ",".join(f"{tau:g}" for tau in look.allan_tau_s)
        command = [find("errormodel"), "expect", self._model_path(look), "--type", "av", "--like", self._noise_path,
                   "--axis", look.axis, "--detrend", self._detrend(look), "--tau", taus, "--json", "-"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            return None
        result = json.loads(done.stdout)
        at = np.array(result["tau_s"], float)
        value = np.array([np.nan if v is None else v for v in result["dp_dph"]], float)
        return value if len(at) == len(look.allan_tau_s) and np.allclose(at, look.allan_tau_s) else None

    def _start_trial(self, axes, order):
        try:
            command = [find("calibrate"), "fit", self.log_path, "--method", "poly", "--order", str(order), "-q",
                       "-o", os.path.join(self._folder.name, f"table{len(self._trials)}.json")]
        except DataError:
            return
        self._trials[tuple(axes), order] = _started(command + [word for axis in axes for word in ("--axis", axis)])

    def refused(self, axes, order):
        """{axis: why `calibrate fit` does not accept it}; the key "" where it names none.  Empty: tried and accepted."""
        if (tuple(axes), order) not in self._trials:
            self._start_trial(axes, order)
        run = self._trials.get((tuple(axes), order))
        if run is None:
            return {}
        _, said = run.communicate()
        if run.returncode == 0:
            return {}
        lines = [line.removeprefix("calibrate: ") for line in said.splitlines() if line.startswith("calibrate: ")]
        whys = {axis: [line.removeprefix(f"{axis}: ") for line in lines if line.startswith(f"{axis}: ")] for axis in axes}
        found = {axis: why[0] for axis, why in whys.items() if why}
        return found or {"": lines[0].replace(self.log_path + ": ", "") if lines else "it says no more"}

    def close(self):
        """End what still runs and remove what was written."""
        for run in [*self._fits.values(), *self._trials.values()]:
            if run.poll() is None:
                run.kill()
                run.communicate()
        self._folder.cleanup()
