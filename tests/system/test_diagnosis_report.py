# SPDX-License-Identifier: MIT
"""The HTML page of a diagnosis, from outside: what it says, what it draws, what it refuses."""
import base64
import contextlib
import copy
import hashlib
import io
import json
import re
import shutil
import subprocess
import sys

import pytest

import diagnosis_report
from where import ROOT

SCRIPT = ROOT / "host/scripts/diagnosis_report.py"

def triangle(k):
    """Degrees of minute k: an hour up, an hour down."""
    return k % 60 if k % 120 < 60 else 60 - k % 60


DIAGNOSIS = {
    "imucal_diagnosis": 1, "version": "3.2.1", "model": "model.json", "logs": ["runs/a.csv", "runs/<b>.csv"], "held_out_logs": [],
    "false_alarm_rate": 0.01, "seed": 7, "warnings": ["device names differ"],
    "library": {"effects": [
        {"name": "thermal_hysteresis", "label": "thermal hysteresis: a loop over temperature", "family": "thermal_memory",
         "parameters": [{"name": "amplitude_dph", "unit": "dph"}, {"name": "width_degc", "unit": "degC"}],
         "hardware_causes": [{"what": "stress of the package <glue>", "source": "a paper"}]},
        {"name": "rate_ramp", "label": "a drift", "parameters": [{"name": "ramp_dph_per_h", "unit": "dph/h"}]}], "families": []},
    "axes": [
        {"axis": "gx_dph", "verdict": "explained",
         "where": {"tau_s": [512, 4096], "temp_degc": [10, 50], "time_s": None, "direction": "up", "logs": [0],
                   "findings": [{"probe": "direction", "evidence_nats": 41.2, "p_value": 1e-19, "statement": "up and down differ"}],
                   "by_tau": [{"tau_s": [512, 1024], "z": 5.6}]},
         "effects": [{"name": "thermal_hysteresis", "parameters": {"amplitude_dph": 19.84, "width_degc": 5.2},
                      "std_errors": {"amplitude_dph": 0.9, "width_degc": 0.31}, "evidence_nats": 305.2,
                      "set": [{"name": "thermal_hysteresis", "evidence_nats": 305.2}, {"name": "thermal_lag", "evidence_nats": 303}]}],
         "not_detectable_here": [{"name": "rate_ramp", "smallest_detectable": {"ramp_dph_per_h": 11.0}}],
         "indistinguishable": [["rate_ramp", "warm_up"]], "advice": ["Run the staircase."],
         "advised_profile": {"imucal_profile": 1, "start_degc": 0, "repeat": 1, "segments": [
             {"rate_degc_per_min": 0, "duration_s": 600}, {"rate_degc_per_min": 2, "to_degc": 60}]},
         "gap": {"before": 142.0, "after": 9.1, "shrinkage": 0.936, "ci95": [0.88, 0.98], "unit": "deviance per hour, held out",
                 "remainder": "6 % above 1000 s", "residual_rms_dph": {"before": 26.0, "after": 18.3, "noise": 17.9},
                 "dp2_distance_dph": {"before": 0.56, "after": 0.21}},
         "plots": {
             "gap_map": {"tau_s": [2, 4, 8], "temp_edges_degc": [0, 20, 40], "z": [[0, 3.5], [9, None], [1, -4]]},
             "gap_map_after": {"tau_s": [2, 4, 8], "temp_edges_degc": [0, 20, 40], "z": [[0, 0.5], [1, None], [1, 0]]},
             "residual": {"mean_s": 60, "temp_degc": [triangle(k) for k in range(240)], "t_s": [60 * k for k in range(240)],
                          "rate_degc_per_min": [1 if k % 120 < 60 else -1 for k in range(240)],
                          "log": [k // 120 for k in range(240)],
                          "rate_dph": [3 * triangle(k) + 100 * (k // 120) + (5 if k % 120 < 60 else -5) + k % 7 for k in range(240)],
                          "polynomial_dph": [3 * triangle(k) + 100 * (k // 120) for k in range(240)],
                          "before_dph": [(5 if k % 120 < 60 else -5) + k % 7 for k in range(240)],
                          "after_dph": [k % 7 for k in range(240)]},
             "dp2": {"tau_s": [2, 10, 100], "data_dph": [30, 20, 15], "model_before_dph": [30, 19, 12],
                     "model_after_dph": [30, 20, 15]},
             "candidates": [{"name": "thermal_hysteresis", "gain_nats": 312, "threshold_nats": 7, "evidence_nats": 305}],
             "tests": [{"name": "generic <T>", "evidence_before_nats": -3, "evidence_after_nats": -3, "threshold_nats": 23}]},
         "notes": ["Slow noise would take 12 % of it."]},
        {"axis": "gy_dph", "verdict": "no_gap", "where": None, "effects": [], "notes": [],
         "not_detectable_here": [{"name": "rate_ramp", "smallest_detectable": {"ramp_dph_per_h": 11.0}}],
         "indistinguishable": [], "advice": [], "gap": {}}]}


def run(tmp_path, diagnosis, is_program=False):
    """The end of the script, and its page; in this process, unless it is to be a program of its own."""
    source, out = tmp_path / "d.json", tmp_path / "r.html"
    source.write_text(diagnosis if isinstance(diagnosis, str) else json.dumps(diagnosis))
    words = [str(source), "-o", str(out)]
    if is_program:
        done = subprocess.run([sys.executable, SCRIPT, *words], capture_output=True, text=True)
    else:
        with contextlib.redirect_stderr(io.StringIO()) as stderr:
            code = diagnosis_report.main(words)
        done = subprocess.CompletedProcess(words, code, "", stderr.getvalue())
    return done, out.read_text() if out.exists() else ""


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    done, text = run(tmp_path_factory.mktemp("page"), DIAGNOSIS, is_program=True)
    assert done.returncode == 0, done.stderr
    return text


def test_page_needs_nothing_from_outside(page):
    assert not re.search(r"""(src|href)=["'](?!data:image/svg|#)""", page)
    images = re.findall(r"data:image/svg\+xml;base64,([^\"]+)", page)
    assert len(images) == 8  # four of the record, three of the evidence, the advised profile
    assert all(b"<svg" in base64.b64decode(i) for i in images)


@pytest.mark.parametrize("words", [
    "Gap explained", "No gap found", "removes 94 % of the gap on held-out data (95 % interval 88 to 98 %)",
    "amplitude 19.8 ± 0.9 dph, width 5.2 ± 0.31 °C", "at averaging times of 512 to 4096 s, between 10 and 50 °C",
    "while the temperature rises", "cannot exclude thermal lag instead", "rate ramp and warm up", "Run the staircase.",
    "142 → 9.1", "each held out in turn", "Gap explained: thermal hysteresis: a loop over temperature.",
    "one-minute means lie 26 dph rms off the polynomial", "noise alone would leave 18 dph, with what was found 18 dph remain",
    "Rising and falling temperature differ by up to 10 dph", "stress of the package &lt;glue&gt; [a paper]",
    "Command: diagnose --model model.json --log runs/a.csv", "imucal 3.2.1.", "false-alarm rate 1 %", "up and down differ", "device names differ", "Slow noise would take 12 %",
    "No gap found; 1 effect would stay unseen on these profiles."])
def test_page_says_what_the_diagnosis_says(page, words):
    assert words in page


def test_page_escapes_text_from_files(page):
    assert "<b>.csv" not in page and "&lt;b&gt;.csv" in page


def test_missing_and_malformed_plots_do_not_stop_the_page(tmp_path):
    diagnosis = copy.deepcopy(DIAGNOSIS)
    del diagnosis["axes"][0]["plots"]["dp2"]
    diagnosis["axes"][0]["plots"]["candidates"] = [{"gain_nats": 3, "threshold_nats": 2}]
    done, text = run(tmp_path, diagnosis)
    assert done.returncode == 0
    assert len(re.findall("data:image/svg", text)) == 6
    assert "plots.candidates is not as documented" in text


@pytest.mark.parametrize("text, words", [("{", "not JSON"), ("{}", "imucal_diagnosis"),
                                         ('{"imucal_diagnosis": 1, "axes": [3]}', "field axes")])
def test_what_is_no_diagnosis_is_refused(tmp_path, text, words):
    done, page_text = run(tmp_path, text)
    assert done.returncode == 3 and words in done.stderr and not page_text


def test_the_record_comes_before_its_likelihoods(page):
    places = [page.index(w) for w in ("rate and temperature against time", "Rate against temperature", "The same less the polynomial",
                                      "The same after what was found", "What to do next", "Likelihoods and tests")]
    assert places == sorted(places)
    assert page.rindex("<details>", 0, places[-1]) > places[-2]  # likelihoods are folded away


def test_logs_lie_on_one_curve_without_their_constants():
    """Two logs 100 dph apart: rate less its constant is the polynomial, the gap and nothing of the 100 dph."""
    from imucal.plot import diagnosis as diagnosis_figures
    import numpy as np

    record = diagnosis_figures.Record(DIAGNOSIS["axes"][0]["plots"]["residual"])
    free = record.rate_dph - record.offset_dph - record.before_dph
    assert np.ptp(free - 3 * record.temp_degc) < 1e-6
    dph, degc = diagnosis_figures.loop_dph(DIAGNOSIS["axes"][0]["plots"]["residual"])
    assert abs(dph - 10) < 3 and 0 <= degc <= 60


def test_a_stand_in_is_not_called_an_explanation(tmp_path):
    diagnosis = copy.deepcopy(DIAGNOSIS)
    axis = diagnosis["axes"][0]
    axis.update(verdict="unexplained", gap={"shrinkage": None, "ci95": None, "stand_in_shrinkage": 0.7})
    text = run(tmp_path, diagnosis)[1]
    assert "A flexible stand-in removes 70 % of the gap on held-out data: that is not an explanation." in text
    assert "Adding what was found removes" not in text
    axis.update(gap={"shrinkage": None, "ci95": None, "stand_in_shrinkage": -0.5})
    assert "A flexible stand-in makes the gap 50 % worse on held-out data" in run(tmp_path, diagnosis)[1]
    axis.update(verdict="partly_explained", gap={"shrinkage": -0.3, "ci95": [-0.4, -0.2]})
    assert ("Adding what was found makes the gap 30 % worse on held-out data (95 % interval 20 to 40 %)"
            in run(tmp_path, diagnosis)[1])


def test_an_axis_without_an_answer_has_no_verdict(tmp_path):
    diagnosis = copy.deepcopy(DIAGNOSIS)
    why = "what the recorder did to the samples leaves too few usable seconds to judge"
    diagnosis["axes"] = [{**diagnosis["axes"][1], "verdict": "partly_explained", "refused": why}]
    text = run(tmp_path, diagnosis)[1]
    assert f"No answer: {why}" in text and "partly explained" not in text.lower()


def test_the_page_is_never_stronger_than_the_program(tmp_path):
    """Headline, badge, chip and doubts are the program's own words."""
    weak = "weak evidence: odds of 6.9 to 1 beyond what a name must gain; another log should confirm it"
    diagnosis = copy.deepcopy(DIAGNOSIS)
    axis = diagnosis["axes"][0]
    axis.update(statement="a gap, explained by little more than a name must gain: thermal_hysteresis", title="gap, weakly explained", is_weak=True)
    axis["effects"][0]["remarks"] = [weak, "cannot be told from: thermal_lag"]
    text = run(tmp_path, diagnosis)[1]
    assert text.count("A gap, explained by little more than a name must gain: thermal hysteresis") == 2  # headline and chip
    assert f"hysteresis: {weak}." in text and "cannot be told from: thermal" in text and "Gap, weakly explained</span>" in text
    assert "Gap explained" not in text and "#2b6cb0" not in text.split("</style>")[1].split("<section")[0]
    open_line = "a gap: slow noise or a repeatable cause, these logs cannot tell"
    axis.update(verdict="partly_explained", statement=open_line, title="gap, noise or cause open", is_weak=False)
    text = run(tmp_path, diagnosis)[1]
    assert text.count(open_line.capitalize()) == 2 and "partly explained" not in text.lower()


def test_words_of_a_finding_go_before_those_of_the_library(tmp_path):
    diagnosis = copy.deepcopy(DIAGNOSIS)
    diagnosis["axes"][0]["effects"][0].update(label="the loop the other way", hardware_causes=[{"what": "another part", "source": "a book"}])
    text = run(tmp_path, diagnosis)[1]
    assert "<td>the loop the other way (thermal hysteresis)</td>" in text and "another part [a book]" in text
    assert "stress of the package" not in text


def test_a_noise_does_not_remain(tmp_path):
    """What it leaves on other data is not what it removed: the statement of the gap compares noises."""
    diagnosis = copy.deepcopy(DIAGNOSIS)
    axis = diagnosis["axes"][0]
    axis["effects"][0].update(name="rate_random_walk", family="slow_noise")
    statement = "one-minute means: the believed noise would leave 18 dph, these logs show 26; with the noise that was found 27 is expected"
    axis["gap"].update(has_mean=False, shrinkage=None, statement=statement)
    text = run(tmp_path, diagnosis)[1]
    assert statement in text and "noise alone would leave" not in text and "with what was found 18 dph remain" not in text
    axis["gap"].update(has_mean=True)
    assert "the noise, with the slow noise found, would leave 18 dph" in run(tmp_path, diagnosis)[1]


def test_without_temperatures_nothing_is_said_of_them(tmp_path):
    diagnosis = copy.deepcopy(DIAGNOSIS)
    axis = diagnosis["axes"][0]
    n = len(axis["plots"]["residual"]["temp_degc"])
    axis["plots"]["residual"].update(temp_degc=[None] * n, rate_degc_per_min=[0] * n)
    axis["plots"].update(gap_map=None, gap_map_after=None)
    axis.update(advised_profile=None, advice=["No temperatures in the log."], where={**axis["where"], "direction": "any", "temp_degc": [0, 0]})
    text = run(tmp_path, diagnosis)[1].split("<section")[1]
    assert "ne-minute means lie 26 dph rms off their mean" in text and "The record: rate against time" in text
    assert "off the polynomial" not in text and "while the temperature rises" not in text and "Profile to run" not in text
    from imucal.plot import diagnosis as figures
    assert figures.Record(axis["plots"]["residual"]).believed_mean == "mean of each log"


def test_hits_left_out_of_means_are_counted(tmp_path):
    diagnosis = copy.deepcopy(DIAGNOSIS)
    residual = diagnosis["axes"][0]["plots"]["residual"]
    assert "out of all noise" not in run(tmp_path, diagnosis)[1]
    for n_hits, words in ((1, "Means over 60 s without 1 sample that stands out of all noise"),
                          (4, "Means over 60 s without 4 samples that stand out of all noise")):
        residual["n_hits"] = n_hits
        assert words in run(tmp_path, diagnosis)[1]


def test_findings_are_listed_as_people_read_them(tmp_path):
    diagnosis = copy.deepcopy(DIAGNOSIS)
    axis = diagnosis["axes"][0]
    axis["effects"].insert(0, {"name": "quantization", "parameters": {"lsb_dph": 1.8}, "is_note": True, "hardware_causes": [{"what": "few bits", "source": "a book"}]})
    axis["reading_order"] = [1, 0, 2]
    axis["effects"].append({"name": "common_mode", "parameters": {"correlation": 1}, "measured": "noise shared with gy: measured correlation 0.02"})
    text = run(tmp_path, diagnosis)[1]
    assert text.index("<td>thermal hysteresis") < text.index("<td>Note: quantization") and "few bits" not in text
    assert "<td>noise shared with gy: measured correlation 0.02</td>" in text


def test_noise_is_not_drawn_as_a_cause(tmp_path):
    diagnosis = copy.deepcopy(DIAGNOSIS)
    diagnosis["axes"][0]["effects"][0]["has_curve"] = False
    text = run(tmp_path, diagnosis)[1]
    assert "The same after what was found" not in text and "drawn through it" not in text and len(re.findall("data:image/svg", text)) == 7


def test_one_log_says_what_is_free_in_its_quarters(tmp_path):
    diagnosis = copy.deepcopy(DIAGNOSIS)
    diagnosis["axes"][0]["gap"]["method"] = "quarters of the one log held out in turn"
    text = run(tmp_path, diagnosis)[1]
    assert "off the polynomial in quarters of the one log, each predicted from the others but for its own constant; noise alone" in text


def test_logs_are_counted_from_one_for_people(tmp_path):
    diagnosis = copy.deepcopy(DIAGNOSIS)
    axis = diagnosis["axes"][0]
    diagnosis["library"]["effects"].append({"name": "bias_step", "label": "steps", "parameters": [{"name": "steps", "unit": ""}]})
    axis["effects"] = [{"name": "bias_step", "parameters": {"steps": [{"log": 1, "t_s": 93024, "amplitude_dph": 427.9}, {"log": 0, "t_s": 1020, "amplitude_dph": -12}]},
                        "std_errors": {"steps": [{"amplitude_dph": 62}, {"amplitude_dph": None}]}}]
    axis["where"].update(by_log=[{"log": 0, "z": 1.5}, {"log": 1, "z": 2.5}], logs=[0, 1])
    text = run(tmp_path, diagnosis)[1]
    assert "amplitude 428 ± 62 dph at 93024 s of log 2; amplitude -12 dph at 1020 s of log 1" in text
    assert "<td>1</td><td>1.5</td>" in text and "<td>2</td><td>2.5</td>" in text and "in every log" in text
    assert "<td>runs/a.csv</td><td>log 1, fitted</td>" in text
    diagnosis["logs"] = diagnosis["logs"][:1]
    axis["where"].update(logs=[0])
    axis["effects"][0]["parameters"]["steps"] = axis["effects"][0]["parameters"]["steps"][1:]
    text = run(tmp_path, diagnosis)[1]
    assert "in every log" not in text and "amplitude -12 ± 62 dph at 1020 s</td>" in text


def test_legends_do_not_lie_over_points():
    import numpy as np
    from imucal.plot import diagnosis as figures

    data = DIAGNOSIS["axes"][0]["plots"]["residual"]
    drawn = []
    kept, figures.svg_image = figures.svg_image, lambda fig, alt: drawn.append(fig)
    try:
        figures.style()
        figures.draw_record(data), figures.draw_against_temperature(data, "before"), figures.draw_dp2(DIAGNOSIS["axes"][0]["plots"]["dp2"])
    finally:
        figures.svg_image = kept
    for fig in drawn:
        fig.draw_without_rendering()
        for ax in fig.axes:
            if ax.get_legend():
                assert ax.get_legend().get_window_extent().y0 >= ax.get_window_extent().y1 - 2
                assert ax.get_legend().get_window_extent().x0 >= fig.bbox.x0 and np.isfinite(ax.get_legend().get_window_extent().x1)


def test_folds_are_open_on_paper(page, tmp_path):
    """In the words of the page; with a browser, on its paper."""
    assert "beforeprint" in page and "details::details-content" in page.replace(":not([open])", "")
    browser, reader = shutil.which("chromium"), shutil.which("pdftotext")
    if not browser or not reader:
        print("SKIP: no chromium or no pdftotext: the page was not printed")
        return
    (tmp_path / "r.html").write_text(page)
    subprocess.run([browser, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
                    "--disable-component-update", "--disable-sync", f"--user-data-dir={tmp_path / 'profile'}", f"--print-to-pdf={tmp_path / 'r.pdf'}",
                    f"file://{tmp_path / 'r.html'}"], check=True, capture_output=True, timeout=120)
    text = subprocess.run([reader, "-layout", str(tmp_path / "r.pdf"), "-"], check=True, capture_output=True, text=True).stdout
    assert "Likelihoods and tests" in text and "142 → 9.1" in text and "up and down differ" in text


def test_a_shrinkage_without_a_figure_says_why(tmp_path):
    diagnosis = copy.deepcopy(DIAGNOSIS)
    diagnosis["axes"][0].update(gap={"shrinkage": None, "ci95": None, "statement": "no figure: noise hides how far the gap shrinks"})
    text = run(tmp_path, diagnosis)[1]
    assert "On data that were not fitted: no figure: noise hides how far the gap shrinks." in text
    diagnosis["axes"][0]["gap"].update(statement="", remainder="jumps at single moments foretell no other data")
    assert "<p>Remainder: jumps at single moments foretell no other data.</p>" in run(tmp_path, diagnosis)[1]


def test_hash_of_a_log_beside_the_diagnosis(tmp_path):
    (tmp_path / "a.csv").write_bytes(b"# device: unit <7>\nt_s\n")
    text = run(tmp_path, DIAGNOSIS)[1]
    assert hashlib.sha256(b"# device: unit <7>\nt_s\n").hexdigest()[:16] in text and "unit &lt;7&gt;" in text


def test_branches_are_the_means_by_direction():
    """Rising branch 5 + mean, falling branch -5 + mean, with errors of the size of the scatter."""
    parts = diagnosis_report.branches(DIAGNOSIS["axes"][0]["plots"]["residual"], "before_dph", n_bins=3)
    assert set(parts) == {"up", "down"}
    assert abs((parts["up"][1] - parts["down"][1]).mean() - 10) < 1
    assert all(0.2 < e < 10 for e in parts["up"][2])


def test_missing_file_is_named(tmp_path):
    done = subprocess.run([sys.executable, SCRIPT, str(tmp_path / "no.json"), "-o", str(tmp_path / "r.html")],
                          capture_output=True, text=True)
    assert done.returncode == 3 and "no.json" in done.stderr


def test_sentences_say_each_thing_once_and_in_words():
    """Names as people write them, no quantity that the logs do not have, nothing twice."""
    from imucal.diagnosis_words import Library, sentence, where_sentence

    assert where_sentence({"tau_s": [1, 16], "temp_degc": [0, 0], "time_s": [0, 900]}) == (
        "The gap shows at averaging times of 1 to 16 s, from 0 to 900 s after the start.")
    assert where_sentence({"sentence": "between 28 and 37 degC, in log 2", "temp_degc": [28, 37]}) == "The gap shows between 28 and 37 °C, in log 2."
    none = "no averaging time, temperature or direction stands out by itself"
    assert where_sentence({"sentence": none, "temp_degc": [0, 60], "tau_s": [1, 2]}) == none.capitalize() + "."
    library = Library({"library": {"effects": [{"name": "thermal_creep"}], "families": [{"name": "slow_noise", "label": "wander"}]}})
    assert library.in_words("thermal_creep and slow_noise, not athermal_creep") == "thermal creep and slow noise, not athermal_creep"
    assert sentence("all rates lie on a lattice") == "All rates lie on a lattice." and sentence("Why?") == "Why?" and sentence("") == ""


def test_pairs_that_do_not_bear_on_the_answer_are_no_advice(tmp_path):
    diagnosis = copy.deepcopy(DIAGNOSIS)
    assert "Cannot be told apart on these profiles" in run(tmp_path, diagnosis)[1]
    diagnosis["axes"][0]["open_pairs"] = []
    diagnosis["axes"][0]["advice"] = ["These logs would not show rate_ramp below ramp_dph_per_h 11, thermal_hysteresis below amplitude_dph 42.5 (width_degc 8)."]
    text = run(tmp_path, diagnosis)[1]
    assert "Cannot be told apart" not in text and "<td>rate ramp</td><td>warm up</td>" in text
    assert "would not show rate ramp below ramp 11 dph/h, thermal hysteresis below amplitude 42.5 dph (width 8 °C)." in text


def test_what_the_advice_says_is_not_said_again(tmp_path):
    diagnosis = copy.deepcopy(DIAGNOSIS)
    axis = diagnosis["axes"][0]
    axis["advice"] = ["Not distinguishable: " + "; ".join(" and ".join(pair) for pair in axis["indistinguishable"])]
    axis["effects"] = [axis["effects"][0], axis["effects"][0]]
    diagnosis["library"]["effects"] += [{"name": "rate_ramp"}, {"name": "warm_up"}]
    done, text = run(tmp_path, diagnosis)
    assert done.returncode == 0 and "Cannot be told apart" not in text and text.count("rate ramp and warm up") == 1
    assert "Gap explained: thermal hysteresis: a loop over temperature</span>" in text
