# SPDX-License-Identifier: MIT
"""What the logs of the blind check cannot tell: outside causes that library noise comes near, pairs of which one hides the other."""
import copy

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.signal import freqz

from blind import cases, causes, gauge, noise, report, score, sensor, whiten

BIAS = np.array([80.0, 300.0, 150.0, -100.0])
WHITE_DPH, SIGMA_DPH, TAU_S = 36.0, 20.0, 100.0


@pytest.fixture(scope="module")
def device():
    return sensor.draw_device(np.random.default_rng(3), 3, 2, "triangle", 3000.0)


@pytest.fixture(scope="module")
def base():
    return noise.Noise(WHITE_DPH, [(SIGMA_DPH, TAU_S)])


@pytest.fixture(scope="module")
def meter(device, base):
    return gauge.Gauge(device, base.density)


# ---- outside causes ---------------------------------------------------------------------------------------

def filtered(f, pole):
    """Power that a one-pole filter gives unit white noise."""
    return np.abs(freqz([1.0], [1.0, -pole], 2 * np.pi * f)[1]) ** 2


def markov(f, tau):
    return filtered(f, np.exp(-1 / tau)) * (1 - np.exp(-2 / tau))


def by_hand(alpha, size, seconds):
    """d of a power law over every noise of the library, by brute force on all ordinates of the periodograms.

    For given times a model's density is a sum of known curves with free sizes: multiplicative updates (those of
    Itakura and Saito's factorisation) go down to the best sizes, for 73 single times and every pair of 19 side by side.
    """
    f = np.concatenate([np.arange(3, n // 2) / n for n in seconds])
    truth = WHITE_DPH**2 + SIGMA_DPH**2 * markov(f, TAU_S) + size**2 * (f / 0.01) ** -alpha
    taus = np.geomspace(1.0, 3e4, 19)
    one = [(np.ones_like(f), markov(f, t)) for t in np.geomspace(1.0, 3e4, 73)]
    forms = {"noise_parameters": one, "rate_random_walk": [(*c, filtered(f, 1.0)) for c in one], "flicker_noise": [(*c, 1 / f) for c in one],
             "second_markov": [(np.ones_like(f), markov(f, a), markov(f, b)) for a in taus for b in taus if a < b]}
    left = {}
    for form, curves in forms.items():
        c = np.array(curves)
        c /= c.mean(2, keepdims=True)
        h = np.full(c.shape[:2], truth.mean() / 3)
        for _ in range(500):
            model = np.einsum("pk,pkf->pf", h, c)
            h *= np.sqrt(np.einsum("pkf,pf->pk", c, truth / model**2) / np.einsum("pkf,pf->pk", c, 1 / model))
        ratio = truth / np.einsum("pk,pkf->pf", h, c)
        left[form] = np.sqrt(2 * np.min(np.sum(ratio - 1 - np.log(ratio), 1)))
    return left


@pytest.mark.parametrize("alpha", [pytest.param(alpha, marks=pytest.mark.long) for alpha in (0.5, 1.0, 1.6)])
def test_library_noise_comes_as_near_to_a_power_law_as_brute_force_finds(device, base, meter, alpha):
    cause = {"name": "power_law", "p": {"_size": 1.0, "_alpha": alpha}, "families": ["slow_noise"]}
    cause = cases.to_strength(cause, 40.0, device, base, BIAS, meter)
    told = cases.told_apart(cause, 40.0, device, base, BIAS, meter)
    left = by_hand(alpha, cause["p"]["_size"], [r.n for r in device.train])
    assert told["d_noise"] == pytest.approx(left["noise_parameters"], rel=0.05, abs=0.1)
    assert told["d_library"] == pytest.approx(min(left.values()), rel=0.1, abs=0.3)
    assert told["d_library"] < gauge.TELL and not told["can_tell_library"]
    if alpha == 1.0:  # this is flicker noise, which re-tuned parameters do not explain
        assert told["d_library"] < 0.1 and told["can_tell_family"]


def test_a_line_of_its_own_is_no_library_noise(device, base, meter):
    """A narrow hump in the spectrum: the library's noises only fall."""
    hump = {"name": "random_spectrum", "p": {"_size": 1.0, "_centre_hz": 0.05, "_width": 0.15, "_notch": 0.0}, "families": ["slow_noise"]}
    told = cases.told_apart(cases.to_strength(hump, 40.0, device, base, BIAS, meter), 40.0, device, base, BIAS, meter)
    assert told["can_tell_library"] and told["d_library"] > 15


def by_contrasts(device, mean, walk_dph_per_rt_s):
    """d of a mean under the nominal noise over the same noise with a random walk: dense covariances from sums over seconds, and only
    those combinations of block means that no constant, slope or higher power of the shown temperature enters."""
    means = [np.kron(np.eye(run.n // 20), np.full((1, 20), 1 / 20)) for run in device.train]
    x = [m @ device.x(run.shown_degc[: m.shape[1]]) for m, run in zip(means, device.train)]
    free = np.concatenate([np.column_stack([np.eye(len(x))[i][None] * np.ones((v.size, 1)), v, v**2, v**3]) for i, v in enumerate(x)])
    contrast = null_space(free.T)

    def covariance(walk):
        out, at = np.zeros((len(free), len(free))), 0
        for m in means:
            t = np.arange(m.shape[1])
            seconds = WHITE_DPH**2 * np.eye(t.size) + SIGMA_DPH**2 * np.exp(-np.abs(t[:, None] - t) / TAU_S) + walk**2 * np.minimum(t[:, None], t)
            out[at: at + len(m), at: at + len(m)] = m @ seconds @ m.T
            at += len(m)
        return contrast.T @ out @ contrast

    truth, model = covariance(0.0), covariance(walk_dph_per_rt_s)
    y = contrast.T @ np.concatenate([m @ s[: m.shape[1]] for m, s in zip(means, mean)])
    twice = np.trace(np.linalg.solve(model, truth)) - y.size + np.linalg.slogdet(model)[1] - np.linalg.slogdet(truth)[1]
    return np.sqrt(twice + y @ np.linalg.solve(model, y))


@pytest.mark.parametrize("walk_dph_per_rt_s", [0.0, 0.3, 2.0])
def test_what_a_random_walk_leaves_of_a_mean_is_what_dense_contrasts_say(walk_dph_per_rt_s):
    device = sensor.draw_device(np.random.default_rng(11), 2, 0, "triangle", 2000.0)
    base = noise.Noise(WHITE_DPH, [(SIGMA_DPH, TAU_S)])
    mean = [60 * np.cumsum(np.random.default_rng(r).standard_normal(run.n)) / np.sqrt(run.n) for r, run in enumerate(device.train)]
    walk = lambda f: base.density(f) + noise.walk_density(f, walk_dph_per_rt_s)
    assert gauge.left_under(device, base, mean, [walk]) == pytest.approx(by_contrasts(device, mean, walk_dph_per_rt_s), rel=0.02)


def test_library_noise_leaves_no_more_than_retuned_noise_and_keeps_a_repeated_anomaly(device, base, meter):
    walk = [2.0 * np.cumsum(np.random.default_rng(r).standard_normal(run.n)) for r, run in enumerate(device.train)]
    known = np.linalg.norm(meter.signature(walk))
    assert gauge.left_by_library_noise(device, base, walk) < 1.02 * gauge.left_by_noise(device, base, walk) < 0.7 * known
    bump = [60 * np.exp(-0.5 * ((run.temp_degc - device.t0_degc) / 1.5) ** 2) for run in device.train]
    assert gauge.left_by_library_noise(device, base, bump) > 0.6 * np.linalg.norm(meter.signature(bump))


def test_bursts_are_told_from_single_outliers_by_their_length():
    """Exactly: seconds inside a burst known, against the same mixture drawn anew every second; sizes of outliers are not free here."""
    p = {"_rate_per_h": 4.0, "_length_s": 60.0, "_dof": 3.0, "_size": 60.0}
    share, wide = 4 * 60 / 3600, np.hypot(WHITE_DPH, 60.0 * np.sqrt(3.0))
    rng = np.random.default_rng(4)
    inside = rng.random(400000) < share
    y = np.where(inside, wide, WHITE_DPH) * rng.standard_normal(inside.size)
    density = lambda s: np.exp(-0.5 * (y / s) ** 2) / s
    gain = np.log(np.where(inside, density(wide), density(WHITE_DPH)) / ((1 - share) * density(WHITE_DPH) + share * density(wide)))
    left = gauge.left_by_outliers(p, WHITE_DPH, 7200.0)
    assert left == pytest.approx(np.sqrt(2 * gain.mean() * 7200), rel=0.05)
    assert left < gauge.of_bursts(p, WHITE_DPH, 7200.0)


# ---- pairs ------------------------------------------------------------------------------------------------

def test_strength_beside_a_known_cause_is_what_the_kalman_filter_leaves(device, base):
    """At one second, nuisance and the other signature projected out of innovations."""
    rng = np.random.default_rng(7)
    first, second = ({**causes.draw(n, rng, device)} for n in ("thermal_hysteresis", "thermal_creep"))
    z = [cases.training_signals(c, device, BIAS) for c in (first, second)]
    columns = []
    for r, run in enumerate(device.train):
        x = device.x(run.shown_degc)
        own = np.eye(len(device.train))[r][None, :] * np.ones((run.n, 1))
        columns.append(np.column_stack([own, x, x**2, x**3, z[1][r], z[0][r]]))
    padded, keep = whiten.pad(columns)
    e, _ = whiten.kalman(padded, whiten.Noise(base.white_dph**2, [whiten.markov_part(*m) for m in base.markov]), keep)
    e = e.reshape(-1, e.shape[-1])
    alone, beside = (e[:, -1] - q @ (q.T @ e[:, -1]) for q in (gauge.basis(e[:, :-2]), gauge.basis(e[:, :-1])))
    meter = gauge.Gauge(device, base.density, z[1])
    assert np.linalg.norm(meter.signature(z[0])) == pytest.approx(np.linalg.norm(beside), rel=0.1)
    assert np.linalg.norm(beside) < 0.9 * np.linalg.norm(alone)


def test_a_ramp_is_not_told_beside_a_random_walk_and_two_alike_hide_each_other(device, base, meter):
    ramp = cases.to_strength(causes.draw("rate_ramp", np.random.default_rng(2), device), 25.0, device, base, BIAS, meter)
    walk = {"name": "rate_random_walk", "p": {"k_dph_per_rt_s": 3.0}}
    warm = {"name": "warm_up", "p": {"amplitude_dph": 100.0, "tau_s": 4e4, "_start": [1.0] * len(device.runs)}}
    outliers = {"name": "outliers", "p": {"probability": 0.01, "sigma_dph": 300.0}}
    told = [cases.told_given(ramp, other, device, base, BIAS, meter) for other in (outliers, walk, warm)]
    d_left = [t["d_noise"] for t in told]
    assert d_left[0] > 2 * gauge.TELL and max(d_left[1:]) < gauge.TELL
    assert [t["can_tell_family"] for t in told[1:]] == [False, False]


def test_pairs_of_a_draw_say_of_each_cause_whether_it_is_told():
    spec = {"kind": "pair", "names": ["thermal_anomaly", "flicker_noise"], "target": 25, "regimes": ["exact"], "pool": ["thermal_anomaly"],
            "seconds": 3000.0, "profile": "triangle"}
    case = cases.build(987, 1, spec)
    told = case.label["told"][case.label["sick"][0]]
    assert [t["can_tell_family"] for t in told] == [True, True] and told[1]["sibling"] != "none"
    assert score.tells_each(told) is (told[1]["d_noise"] >= gauge.TELL)


# ---- counting ---------------------------------------------------------------------------------------------

def told(family=True, d_noise=20.0, **more):
    return {"can_tell_member": True, "can_tell_family": family, "d_noise": d_noise, **more}


@pytest.mark.parametrize("each, expected", [
    ([told(), told()], True), ([told(), told(family=False)], False), ([told(), told(d_noise=3.0)], False), ([{}, {}], None), ([told(), {}], None)])
def test_a_pair_is_told_where_each_cause_is_and_old_labels_say_nothing(each, expected):
    assert score.tells_each(each) is expected


@pytest.mark.parametrize("label, expected", [
    (told(can_tell_library=False), False), (told(), True), (told(family=False), False), ({}, True), ({**told(), "can_tell_member": False}, False)])
def test_older_labels_say_what_the_library_comes_near_by_two_fields(label, expected):
    assert score.tells_library(label) is expected


def label_of(case, kind, names, each):
    return {"case": case, "kind": kind, "truth": {"gx_dph": names}, "sick": ["gx_dph"], "regimes": ["exact"], "target": 40, "n_train": 4, "n_axes": 1,
            "told": {"gx_dph": each}, "families": {"gx_dph": [["slow_noise"]] * len(names)}, "profile": "mixed", "noise": {"markov": [(20.0, 100.0)]}}


def answer(verdict, *names):
    effects = [{"name": n, "parameters": {}, "evidence_nats": 9, "set": [{"name": n}]} for n in names]
    return {"status": 0, "cpu_s": 0.5, "rss_mb": 20, "error": "",
            "diagnosis": {"axes": [{"axis": "gx_dph", "verdict": verdict, "effects": effects, "gap": {}, "where": None, "advice": []}]}}


def rows_of(labels, answers):
    """{title of the summary: "k/n"}"""
    shown = report.must_show(score.everything({x["case"]: x for x in labels}, answers, redraw=False))
    return [(row[0], row[1].rsplit("(", 1)[-1].rstrip(")")) for row in shown]


def test_ceilings_stand_below_the_plain_rows_which_count_as_before():
    near, far, two = told(can_tell_library=False), told(can_tell_library=True), ["rate_ramp", "flicker_noise"]
    labels = [label_of("o0", "outside", ["power_law"], [near]), label_of("o1", "outside", ["saw_tooth"], [far]),
              label_of("o2", "outside", ["saw_tooth"], [far]), label_of("o3", "outside", ["saw_tooth"], [far]), label_of("p0", "pair", two, [told(), told(d_noise=1.0)]),
              label_of("p1", "pair", two, [told(), told()])]
    answers = {"o0_0": answer("explained", "flicker_noise"), "o1_0": answer("unexplained"), "o2_0": answer("explained", "warm_up"),
               "o3_0": answer("explained", "thermal_memory"),
               "p0_0": answer("explained", "rate_ramp"), "p1_0": answer("explained", *two)}
    titles = [title for title, _ in rows_of(labels, answers)]
    rows = dict(rows_of(labels, answers))
    plain, told_ones = "outside causes, d = 40: abstains or right family only", "the same, d = 40, those that no library member comes near"
    assert (rows[plain], rows[told_ones]) == ("1/4", "1/3") and titles.index(plain) < titles.index(told_ones)
    assert rows["of these, d = 40: abstains or names families only, be they right or not"] == "2/3"
    plain, told_ones = "pairs, both named (member or family)", "the same, pairs of which the logs can tell each"
    assert (rows[plain], rows[told_ones]) == ("1/2", "1/1") and titles.index(plain) + 1 == titles.index(told_ones)
    old = copy.deepcopy(labels)
    for x in old:
        x["told"]["gx_dph"] = [{} for _ in x["told"]["gx_dph"]]
    assert dict(rows_of(old, answers))[told_ones] == "no case" and dict(rows_of(old, answers))[plain] == "1/2"
