# SPDX-License-Identifier: MIT
"""Do the stated intervals hold the truth?  Of `dp` (Allan deviation, types 1 and 2) and of `calibrate fit --method poly`.

A row is the mean of a second of a rate that is continuous in time: white noise and first-order processes, each from its
stationary state, drawn exactly (the mean of a second and the state at its end together).  Flicker noise is a sum of 16
processes of one variance, time constants 1 to 100 000 s.  The truth of a curve is the root of the expected mean square,
of the weights of a window and the autocovariance of the means; where the weights do not add up to nothing the variance
of the record's mean goes off.  The truth of a fit is the drawn polynomial, and of logs with a turn-on constant of their
own the polynomial without its constant.

No code is shared with the programs.  Seeds, numbers and limits were chosen before the first run.  A count may be as low
as the 0.1 % quantile of the binomial distribution at the stated rate, asked at every tau or temperature; more than that
rate is no error and is printed.  What is asserted:
- white noise alone, and with a process of 20 to 100 s: every tau, every temperature, both levels;
- a process of 100 to 300 s: where an interval rests on blocks of the record (`ci_blocks`), and all fits: their output
  says that noise slower than a tenth of the log is not seen, and all that is here is faster;
- flicker noise and a process of 1000 to 3000 s: curves where an interval rests on blocks.  Elsewhere nothing is
  promised (`dp` names the noise that it assumes, `calibrate` the noise that it does not see), and counts are printed
  alone: `pytest -s -m long`.
`make test` asks few records, `make test-long` the others."""
import json
import math
import os
import subprocess

import numpy as np
import pytest

from asking import least_by_chance, most_by_chance, write_log
from where import BIN

SEED = 20271130
SECONDS = 6000
TAUS = [2, 5, 10, 20, 50, 100, 200, 300, 400, 600]
AXES = 10  # of a log, of one noise and independent
ESTIMATION_S = 20  # of type 1, by `dp --help`
PAPER = (36.0, [(20.0, 100.0)])  # the paper's nominal model: white noise of a second, processes
KINDS = ["white", "fast", "medium", "slow", "flicker"]
ALWAYS = ["white", "fast"]  # every interval is asked for
TAU_S = {"fast": (20, 100), "medium": (100, 300), "slow": (1000, 3000)}
TURN_ON = 30.0
SHAPE = ["b1", "b2", "b3"]  # of the polynomial without its constant
TEMPERATURES = [0, 2, 4, 6, 8]  # places in the nine temperatures of a table: 0, 15, 30, 45, 60 degC
ONE_SIGMA, TWO_SIGMA = math.erf(1 / math.sqrt(2)), math.erf(2 / math.sqrt(2))


def by_chance(n, rate):
    """Fewer or more than these of n come in less than 1 of 1000 draws each where each has this probability."""
    return least_by_chance(n, rate, 0.001), most_by_chance(n, rate, 0.001)


# ---- noise


def draw_noise(rng, kind):
    """White noise of a second in dph, and processes (sigma, tau)."""
    white = rng.uniform(20, 60)
    if kind == "white":
        return white, []
    if kind == "flicker":
        sigma = rng.uniform(2, 6)
        return white, [(sigma, tau) for tau in np.geomspace(1, 1e5, 16)]
    return white, [(rng.uniform(10, 30), math.exp(rng.uniform(*np.log(TAU_S[kind]))))]


def means_of_process(rng, n, sigma, tau_s):
    """Means of n seconds of AXES first-order processes."""
    phi, gone = math.exp(-1 / tau_s), -math.expm1(-1 / tau_s)
    end_var = 1 - phi ** 2
    both = tau_s * gone ** 2  # covariance of what is new at the end of a second and in its mean
    own = 2 * tau_s * (1 - tau_s * gone) - (tau_s * gone) ** 2 - both ** 2 / end_var
    end = math.sqrt(end_var) * rng.standard_normal((n, AXES))
    means = both / end_var * end + math.sqrt(max(own, 0)) * rng.standard_normal((n, AXES))
    state = rng.standard_normal(AXES)
    for k in range(n):
        means[k] += tau_s * gone * state
        state = phi * state + end[k]
    return sigma * means


def draw_rates(rng, n, noise):
    white, processes = noise
    return white * rng.standard_normal((n, AXES)) + sum(means_of_process(rng, n, *p) for p in processes)


def autocovariance(n, noise):
    """Of the means of a second, lags 0 to n - 1."""
    white, processes = noise
    total = np.zeros(n)
    total[0] = white ** 2
    for sigma, tau_s in processes:
        in_mean = -tau_s * math.expm1(-1 / tau_s)
        total[0] += 2 * sigma ** 2 * tau_s * (1 - in_mean)
        total[1:] += (sigma * in_mean) ** 2 * np.exp(-np.arange(n - 1) / tau_s)
    return total


# ---- what a curve is


def gain_of_filter(white, sigma, tau_s):
    """Steady state of the Kalman filter of white noise and one process sampled every second: gain and transition."""
    phi, p = math.exp(-1 / tau_s), sigma ** 2
    for _ in range(100000):
        before, p = p, phi ** 2 * p * white ** 2 / (p + white ** 2) + sigma ** 2 * (1 - phi ** 2)
        if abs(p - before) < 1e-13 * p:
            break
    return p / (p + white ** 2), phi


def estimate_weights(kind, tau, nominal):
    """Of the samples before a window, the youngest first."""
    if kind != "dp2":
        n = tau if kind == "av" else ESTIMATION_S
        return np.full(n, 1 / n)
    (white, ((sigma, tau_s),)) = nominal
    gain, phi = gain_of_filter(white, sigma, tau_s)
    decay = phi * (1 - gain)
    return gain * decay ** np.arange(min(SECONDS // 2, int(math.log(1e-5) / math.log(decay))))


def window_weights(kind, tau, nominal):
    return np.concatenate([-estimate_weights(kind, tau, nominal)[::-1], np.full(tau, 1 / tau)])


def true_curve(kind, noise, nominal):
    """Root of half the expected mean square of the prediction's error, of a record whose mean was taken away."""
    cov = autocovariance(SECONDS, noise)
    var_of_mean = (SECONDS * cov[0] + 2 * np.sum((SECONDS - np.arange(1, SECONDS)) * cov[1:])) / SECONDS ** 2
    curve = []
    for tau in TAUS:
        w = window_weights(kind, tau, nominal)
        size = 2 ** math.ceil(math.log2(2 * len(w)))
        pairs = np.fft.irfft(np.abs(np.fft.rfft(w, size)) ** 2, size)[:len(w)]
        square = pairs[0] * cov[0] + 2 * pairs[1:] @ cov[1:len(w)] - w.sum() ** 2 * var_of_mean
        curve.append(math.sqrt(square / 2))
    return np.array(curve)


# ---- files and programs


def model_text(noise):
    return json.dumps({"imucal_model": 1, "arw_deg_rt_h": noise[0] / 60,
                       "markov": [{"sigma_dph": s, "tau_s": t} for s, t in noise[1]]})


def write(path, degc, rates):
    return write_log(path, np.arange(1, len(rates) + 1), degc, *rates.T, axes=[f"g{i}_dph" for i in range(rates.shape[1])],
                     form="%d,%.3f" + ",%.3f" * rates.shape[1])


def ask(*command):
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, timeout=300,
                          env={**os.environ, "OMP_NUM_THREADS": "1"})
    assert done.returncode in (0, 1), done.stderr
    return json.loads(done.stdout)


def ask_dp(log, kind, model):
    """Curves of a log, an axis each."""
    nominal = ["--nominal", model] if kind == "dp2" else []
    return ask(BIN / "dp", log, "--type", kind, *nominal, "--tau", ",".join(map(str, TAUS)), "--detrend", "mean",
               "--no-ratios", "--threads", 1, "--quiet", "--json", "-")["curves"]


# ---- curves


def draw_record(rng, folder, kind):
    """Noise, nominal model, and the log's file: the nominal model is the true one where that has one process."""
    noise = draw_noise(rng, kind)
    nominal = noise if len(noise[1]) == 1 else PAPER
    rates = draw_rates(rng, SECONDS, noise)
    (folder / "model.json").write_text(model_text(nominal))
    return noise, nominal, rates, write(folder / "log.csv", 25 + 0.01 * rng.standard_normal(SECONDS), rates)


def held_by_curves(folder, kind, logs, types):
    """Of every type: place of the truth (-1 below the interval, 0 in it, 1 above) and blocks, per record and tau."""
    places, blocks = {t: [] for t in types}, {t: [] for t in types}
    for number in range(logs):
        rng = np.random.default_rng([SEED, 1, KINDS.index(kind), number])
        noise, nominal, _, log = draw_record(rng, folder, kind)
        for t in types:
            truth = true_curve(t, noise, nominal)
            for curve in ask_dp(log, t, folder / "model.json"):
                assert curve["tau_s"] == TAUS
                low, high = np.transpose(curve["ci95_dph"])
                places[t].append((truth > high).astype(int) - (truth < low))
                blocks[t].append(curve["ci_blocks"])
    return {t: (np.array(places[t]), np.array(blocks[t])) for t in types}


def count_curves(kind, held):
    """Prints the counts, and returns those that are lower than chance allows and are asserted."""
    wrong = []
    for t, (places, blocks) in held.items():
        for j, tau in enumerate(TAUS):
            for rests, chosen in (("blocks", blocks[:, j] > 0), ("assumed noise", blocks[:, j] == 0)):
                n, in_it = int(chosen.sum()), int((places[chosen, j] == 0).sum())
                if n == 0:
                    continue
                few, many = by_chance(n, 0.95)
                note = "TOO FEW" if in_it < few else "more than stated" if in_it > many else ""
                print(f"{kind:8} {t:4} tau {tau:4} {rests:14} {in_it:4} of {n:4} [{few}, {many}]  truth below "
                      f"{int((places[chosen, j] < 0).sum()):3}, above {int((places[chosen, j] > 0).sum()):3}  {note}")
                if in_it < few and (kind in ALWAYS or rests == "blocks"):
                    wrong.append((kind, t, tau, rests, in_it, n, few))
    return wrong


@pytest.mark.parametrize("kind", ["av", "dp1", "dp2"])
def test_a_curve_is_what_its_truth_is_worked_out_for(tmp_path, kind):
    """The same weights, run over a record, give the program's curve (type 2: up to how its filter starts)."""
    _, nominal, rates, log = draw_record(np.random.default_rng([SEED, 0]), tmp_path, "fast")
    for axis, curve in enumerate(ask_dp(log, kind, tmp_path / "model.json")[:3]):
        x = rates[:, axis] - rates[:, axis].mean()
        mine = []
        for tau, n in zip(TAUS, curve["n"]):
            errors = np.convolve(x, window_weights(kind, tau, nominal)[::-1], mode="full")[:SECONDS]
            mine.append(math.sqrt(np.mean(errors[-n:] ** 2) / 2))
        np.testing.assert_allclose(curve["dp_dph"], mine, rtol=1e-3)


@pytest.mark.parametrize("kind, logs", [("white", 5), ("fast", 5), *(
    pytest.param(kind, 60, marks=pytest.mark.long, id=f"{kind}-all") for kind in KINDS)])
def test_intervals_of_curves_hold_the_truth(tmp_path, kind, logs):
    """A log has ten records: 50 in the short form, 600 in the long one."""
    wrong = count_curves(kind, held_by_curves(tmp_path, kind, logs, ["av", "dp1", "dp2"]))
    assert not wrong, wrong


# ---- polynomials


def draw_chamber(rng):
    """100 to 160 min between 0 and 60 degC, soaks at the ends, up or up and down; the sensor follows within minutes."""
    minutes, soaks = rng.uniform(100, 160), rng.uniform(8, 20, 3)
    if rng.random() < 0.5:
        ramp = minutes - soaks[0] - soaks[1]
        at, goal = [0, soaks[0], soaks[0] + ramp, minutes], [0, 0, 60, 60]
    else:
        ramp = (minutes - soaks.sum()) / 2
        at, goal = np.cumsum([0, soaks[0], ramp, soaks[1], ramp, soaks[2]]), [0, 0, 60, 60, 0, 0]
    air = np.interp(np.arange(int(60 * minutes)) + 0.5, 60 * np.array(at), goal)
    lag = np.exp(-np.arange(600) / rng.uniform(30, 90))
    return np.convolve(air, lag / lag.sum())[:len(air)]


def draw_coefficients(rng):
    """In (T - 30 degC) / 30 degC, an axis each column."""
    return rng.normal(0, np.array([100, 300, 150, 80])[:, None], (4, AXES))


def polynomial(coeff, tn):
    return sum(c * tn[:, None] ** i for i, c in enumerate(coeff))


def draw_logs(rng, folder, noise, coeff, logs, turn_on):
    files = []
    for i in range(logs):
        degc = draw_chamber(rng)
        rates = polynomial(coeff, (degc - 30) / 30) + draw_rates(rng, len(degc), noise) + turn_on * rng.standard_normal(AXES)
        files.append(write(folder / f"run{i}.csv", degc + 0.01 * rng.standard_normal(len(degc)), rates))
    return files


def ask_fit(files):
    answer = ask(BIN / "calibrate", "--quiet", "--json", "-", "fit", *files, "--method", "poly", "--order", 3)
    reasons = answer["judgement"]["reasons"]
    return answer["axes"], {reason["axis"] for reason in reasons}


def other_normalisation(coeff, t0, span):
    """The same polynomials in (T - t0) / span."""
    tn = np.linspace(-1, 1, 4)
    return np.linalg.solve(np.vander(tn, 4, increasing=True), polynomial(coeff, (t0 + span * tn - 30) / 30))


def errors_of_fits(folder, kind, logs, files=1, turn_on=0.0):
    """Error over predicted error, a row a fit: at five temperatures, and of b1 to b3; the axes that were refused."""
    at_degc, of_shape, refused = [], [], []
    for number in range(logs):
        rng = np.random.default_rng([SEED, 1 + files, KINDS.index(kind), number])
        coeff = draw_coefficients(rng)
        axes, names = ask_fit(draw_logs(rng, folder, draw_noise(rng, kind), coeff, files, turn_on))
        refused += [(kind, number, name) for name in sorted(names)]
        for i, axis in enumerate(axes):
            tn = (np.array(axis["temp_degc"])[TEMPERATURES] - axis["t0_degc"]) / axis["range_degc"]
            off = np.array(axis["coeff_dph"]) - other_normalisation(coeff[:, [i]], axis["t0_degc"], axis["range_degc"])[:, 0]
            at_degc.append(polynomial(off[:, None], tn)[:, 0] / np.array(axis["sigma_dph"])[TEMPERATURES])
            of_shape.append((off / axis["coeff_sigma_dph"])[1:])
    return np.array(at_degc), np.array(of_shape), refused


def count_fits(kind, ratios, places):
    """Prints the counts and returns those that are lower than chance allows."""
    wrong = []
    for j, place in enumerate(places):
        for sigmas, rate in ((1, ONE_SIGMA), (2, TWO_SIGMA)):
            n, in_it = len(ratios), int((abs(ratios[:, j]) <= sigmas).sum())
            few, many = by_chance(n, rate)
            note = "TOO FEW" if in_it < few else "more than stated" if in_it > many else ""
            print(f"{kind:8} fit {place:8} {sigmas} sigma {in_it:4} of {n:4} [{few}, {many}]  "
                  f"rms of error over predicted {np.sqrt(np.mean(ratios[:, j] ** 2)):.3f}  {note}")
            if in_it < few:
                wrong.append((kind, place, sigmas, in_it, n, few))
    return wrong


@pytest.mark.parametrize("kind, logs", [("white", 1), ("fast", 2), *(
    pytest.param(kind, 30, marks=pytest.mark.long, id=f"{kind}-all") for kind in KINDS)])
def test_predicted_errors_of_fits_hold_the_truth(tmp_path, kind, logs):
    """Of one log without a constant of its own: all of the polynomial.  Ten fits a log."""
    at_degc, of_shape, refused = errors_of_fits(tmp_path, kind, logs)
    print(f"{kind:8} fits refused: {len(refused)} {refused}")
    wrong = count_fits(kind, at_degc, ["0 degC", "15 degC", "30 degC", "45 degC", "60 degC"])
    wrong += count_fits(kind, of_shape, SHAPE)
    if kind in ("white", "fast", "medium"):
        assert not wrong and not refused, (wrong, refused)


@pytest.mark.parametrize("kind, logs", [("fast", 1), *(
    pytest.param(kind, 15, marks=pytest.mark.long, id=f"{kind}-all") for kind in ("white", "fast", "medium"))])
def test_predicted_errors_hold_where_logs_have_constants_of_their_own(tmp_path, kind, logs):
    """Two logs a fit; the constant is left aside."""
    _, of_shape, refused = errors_of_fits(tmp_path, kind, logs, 2, TURN_ON)
    print(f"{kind:8} fits of two logs refused: {len(refused)} {refused}")
    wrong = count_fits(kind, of_shape, SHAPE)
    assert not wrong and not refused, (wrong, refused)
