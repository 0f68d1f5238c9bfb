# SPDX-License-Identifier: MIT
"""Figures of temperature profiles: the paper's figures 7-10, the error over temperature with its bounds, best
profiles, the trade-off of duration against error, and what a profile can tell apart.

Everything is computed by the program PROFILE (environment variable) and drawn by
imucal.plot.profiles."""
import argparse
import json
import os
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "python"))
from imucal.plot import profiles as draw  # noqa: E402

sys.path.insert(0, str(Path(__file__).resolve().parent))
from profile_table import program  # noqa: E402

NOMINAL = {"imucal_model": 1, "arw_deg_rt_h": 0.6, "markov": [{"sigma_dph": 20, "tau_s": 100}]}
SLOW_DENSITY_DPH2_S = 2 * 20**2 * 100 + 36**2  # of NOMINAL


class Work:
    """Temporary files and calls of the program."""

    def __init__(self):
        self.folder = tempfile.mkdtemp(prefix="imucal_figures_")
        self.model = self.file("model", NOMINAL)

    def file(self, name, content):
        path = os.path.join(self.folder, name + ".json")
        with open(path, "w") as file:
            json.dump(content, file)
        return path

    def profile(self, *args):
        return program(*args)

    def error(self, profile, *args):
        return self.profile("error", self.file("profile", profile), "--model", self.model, "--order", 3, *args)

    def optimize(self, rate_degc_per_min, duration_s, *args):
        return self.profile("optimize", "--model", self.model, "--order", 3, "--range", "0:60", "--max-rate",
                            rate_degc_per_min, "--duration-s", duration_s, *args)


def ramp_and_soak(soak_s, rate_degc_per_min=0.6, passes=1):
    """Profile of ramps between 0 and 60 degC, up first, with soaks before and after each."""
    segments = []
    for i in range(passes):
        segments += [{"rate_degc_per_min": 0, "duration_s": soak_s},
                     {"rate_degc_per_min": rate_degc_per_min, "to_degc": 0 if i % 2 else 60},
                     {"rate_degc_per_min": 0, "duration_s": soak_s}]
    return {"imucal_profile": 1, "start_degc": 0, "repeat": 1,
            "segments": [s for s in segments if s.get("duration_s", 1) > 0]}


def save(figure, folder, name):
    path = os.path.join(folder, name + ".png")
    figure.savefig(path, dpi=120)
    print(path)


def paper_figures(work, folder):
    save(draw.calibration_errors("Fig. 7: ramp at 0.6 °C/min, no soak (100 min)", [(None, work.error(ramp_and_soak(0)))]), folder, "fig07_ramp")

    found = [(soak_min, work.error(ramp_and_soak(60 * soak_min))) for soak_min in (0, 5, 10, 20, 30)]
    save(draw.calibration_errors("Fig. 8: soaks at both ends", [(f"{m} min: worst {e['worst_dph']:.2f}", e) for m, e in found]), folder, "fig08_soaks")

    found = [(passes, work.error(ramp_and_soak(1200, passes=passes))) for passes in (1, 2, 4, 8)]
    labelled = [(f"{n} cycle{'s' if n > 1 else ''}: worst {e['worst_dph']:.2f}", e) for n, e in found]
    save(draw.calibration_errors("Fig. 9: cycles of the basic profile (20-min soaks)", labelled), folder, "fig09_cycles")

    labelled = []
    for sigma, tau in ((20, 100), (10, 30), (10, 250), (5, 100), (40, 100), (40, 250)):
        model = {**NOMINAL, "markov": [{"sigma_dph": sigma, "tau_s": tau}]}
        e = work.error(ramp_and_soak(1200), "--filter-model", work.file("filter", model))
        labelled.append((f"filter {sigma} °/h, {tau} s: worst {e['worst_dph']:.2f}, believes {e['believed_worst_dph']:.2f}", e))
    save(draw.calibration_errors("Fig. 10: truth covariance, basic profile, truth 20 °/h and 100 s", labelled, (0, 10), fontsize=8, loc="upper center"),
         folder, "fig10_truth_covariance")


def best_profiles(work, folder):
    save(draw.best_profiles([(rate, work.optimize(rate, 14400)) for rate in (0.6, 2.0, 5.0)]), folder, "profile_best")


def trade_off(work, folder):
    minutes = np.array([60, 80, 100, 110, 120, 140, 180, 240, 340, 480])
    results = [(rate, [(m, work.optimize(rate, 60 * m)) for m in minutes if m >= 60 / rate - 1e-9]) for rate in (0.6, 2.0)]
    save(draw.trade_off(results, minutes, SLOW_DENSITY_DPH2_S), folder, "profile_trade_off")


def tell_apart(work, folder):
    cases = (("accuracy alone", work.optimize(2, 14400, "--no-proof")),
             ("told apart, least cost", work.optimize(2, 14400, "--no-proof", "--tell-apart", "all")),
             ("told apart, 5 % spent", work.optimize(2, 14400, "--no-proof", "--tell-apart", "all", "--spend", 5)))
    save(draw.tell_apart(cases), folder, "profile_tell_apart")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", metavar="FOLDER", help="for the figures; made where it is not there")
    folder = parser.parse_args().folder
    os.makedirs(folder, exist_ok=True)
    work = Work()
    paper_figures(work, folder)
    best_profiles(work, folder)
    trade_off(work, folder)
    tell_apart(work, folder)


if __name__ == "__main__":
    main()
