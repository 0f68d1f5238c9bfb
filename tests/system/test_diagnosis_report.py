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
         "indistinguishable": [["rate_ramp", "warm_up"]], "advice": ["Run the staircase.", "Four runs of the advised profile would show rate_ramp from ramp_dph_per_h 5."],
         "advised_profile": {"imucal_profile": 1, "start_degc": 0, "repeat": 1, "segments": [
             {"rate_degc_per_min": 0, "duration_s": 600}, {"rate_degc_per_min": 2, "to_degc": 60}]},
         "gap": {"before": 142.0, "after": 9.1, "shrinkage": 0.936, "ci95": [0.88, 0.98], "unit": "deviance per hour, held out",
                 "remainder": "6 % above 1000 s", "residual_rms_dph": {"before": 26.0, "after": 18.3, "noise": 17.9},
                 "dp2_distance_dph": {"before": 0.56, "after": 0.21}},
         "plots": {
             "gap_map": {"tau_s": [2, 4, 8], "temp_edges_degc": [0, 20, 40], "z": [[0, 3.5], [9, None], [1, -4]]},
             "gap_map_after": {"tau_s": [2, 4, 8], "temp_edges_degc": [0, 20, 40], "z": [[0, 0.5], [1, None], [1, 0]]},
             "residual": {"mean_s": 60, "temp_degc": [triangle(k) for k in range(240)], "t_s": [60 * (k % 120) for k in range(240)],
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


def figures_of(axis):
    """The figures of an axis as matplotlib has them, those of the folds last."""
    from imucal.diagnosis_words import Library
    from imucal.plot import diagnosis as figures, record

    drawn = []
    modules = [figures, record]
    kept = [module.svg_image for module in modules]
    try:
        for module in modules:
            module.svg_image = lambda fig, alt: drawn.append(fig) or "an image"
        figures.style()
        library = Library(DIAGNOSIS, axis.get("unit", "dph"))
        said = diagnosis_report.raw_figures(axis, library) + diagnosis_report.evidence_figures(axis)
        assert not [f["caption"] for f in said if f["caption"].startswith("not drawn")]
    finally:
        for module, function in zip(modules, kept):
            module.svg_image = function
    return drawn


def labels(ax):
    return {line.get_label(): line for line in ax.get_lines() if not line.get_label().startswith("_")}


def with_record(axis, unit="dph"):
    """The axis with its logs as they were recorded: an hour without rows in the first, clipped rows, two wild ones; one log held out."""
    axis = copy.deepcopy(axis)
    residual = axis["plots"]["residual"]
    hole = [k for k in range(240) if not 30 <= k < 90]
    for key in ("temp_degc", "t_s", "rate_degc_per_min", "log", "rate_dph", "polynomial_dph", "before_dph", "after_dph"):
        residual[key] = [residual[key][k] for k in hole]
    logs = []
    for log in (0, 1):
        own = [k for k in range(len(hole)) if residual["log"][k] == log]
        logs.append({"log": log, "is_held_out": False, "every": 60, "t_s": [residual["t_s"][k] for k in own],
                     "temp_degc": [residual["temp_degc"][k] for k in own], "rate_dph": [residual["rate_dph"][k] + 1 for k in own], "left_out": []})
    logs[0]["left_out"] = [
        {"why": "neighbour", "label": "within 10 s of those", "n": 7, "t_s": [1500], "temp_degc": [25], "rate_dph": [80]},
        {"why": "saturation", "label": "readings clipped at a limit", "n": 2483, "t_s": [1510, 1511], "temp_degc": [25, 25], "rate_dph": [170, 170]},
        {"why": "hit", "label": "single seconds out of all noise", "n": 2, "t_s": [60, 70], "temp_degc": [1, 1], "rate_dph": [20000.0, -9.0e5]}]
    logs.append({"log": 0, "is_held_out": True, "every": 60, "t_s": [0, 60, 120], "temp_degc": [0, 1, 2], "rate_dph": [3, 5, 9], "left_out": []})
    axis["plots"]["record"] = logs
    axis["plots"]["held_out"] = {"mean_s": 64, "are_logs": True, "unit": [0, 0, 0], "log": [0, 0, 0], "t_s": [0, 60, 120], "temp_degc": [0, 1, 2],
                                 "rate_degc_per_min": [1, 1, 1], "rate_dph": [3, 5, 9], "before_dph": [3, 2, 3], "after_dph": [1, 1, 0]}
    return axis


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    done, text = run(tmp_path_factory.mktemp("page"), DIAGNOSIS, is_program=True)
    assert done.returncode == 0, done.stderr
    return text


def test_page_needs_nothing_from_outside(page):
    assert not re.search(r"""(src|href)=["'](?!data:image/svg|#)""", page)
    images = re.findall(r"data:image/svg\+xml;base64,([^\"]+)", page)
    assert len(images) == 6  # two of the record, three of the evidence, the advised profile
    assert all(b"<svg" in base64.b64decode(i) for i in images)


@pytest.mark.parametrize("words", [
    "Gap explained", "No gap found", "removes 94 % of the gap on held-out data (95 % interval 88 to 98 %)",
    "amplitude 19.8 ± 0.9 dph, width 5.2 ± 0.31 °C", "at averaging times of 512 to 4096 s, between 10 and 50 °C",
    "while the temperature rises", "cannot exclude thermal lag instead", "rate ramp and warm up", "Run the staircase.",
    "142 → 9.1", "each held out in turn", "Gap explained: thermal hysteresis: a loop over temperature.",
    "In the figures of the record one-minute means lie 6.12 dph rms off the polynomial, and 3.59 dph with what was found; rising and falling",
    "one-minute means lie 26 dph rms off the polynomial, 18.3 dph with what was found; noise alone would leave 17.9 dph", "differ by up to 10 dph", "stress of the package &lt;glue&gt; [a paper]",
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
    assert len(re.findall("data:image/svg", text)) == 4
    assert "plots.candidates is not as documented" in text


@pytest.mark.parametrize("name, value, words", [
    ("where", "everywhere", 'axes[0].where: expected an object or null, found "everywhere"'),
    ("effects", [None], "axes[0].effects[0]: expected an object, found null"),
    ("effects", [{"name": "thermal_lag", "set": [{}]}], 'axes[0].effects[0].set[0]: field "name" is missing'),
    ("advice", 5, "axes[0].advice: expected a list or null, found 5"),
    ("gap", {"shrinkage": 0.5, "ci95": [[1]]}, "axes[0].gap.ci95: expected 2 or more, found 1"),
    ("indistinguishable", [None], "axes[0].indistinguishable[0]: expected a list")])
def test_a_damaged_field_is_named_with_its_line(tmp_path, name, value, words):
    diagnosis = copy.deepcopy(DIAGNOSIS)
    diagnosis["axes"][0][name] = value
    done, page = run(tmp_path, json.dumps(diagnosis, indent=1))
    assert done.returncode == 3 and not page
    assert re.search(rf"d\.json:\d+: {re.escape(words)}", done.stderr), done.stderr


@pytest.mark.parametrize("text, words", [("{", "not JSON"), ("{}", "imucal_diagnosis"),
                                         ('{"imucal_diagnosis": 1, "axes": [3]}', "field axes")])
def test_what_is_no_diagnosis_is_refused(tmp_path, text, words):
    done, page_text = run(tmp_path, text)
    assert done.returncode == 3 and words in done.stderr and not page_text


def test_the_record_comes_before_its_likelihoods(page):
    """Headline, pictures, then text."""
    section = page[page.index("<section"):]
    places = [section.index(w) for w in ("Gap explained: thermal", "rate and temperature against time", "Rate against temperature",
                                         "What was found</h3>", "In the figures of the record", "What to do next", "Likelihoods and tests")]
    assert places == sorted(places)
    assert section.rindex("<details>", 0, places[-1]) > places[-2]  # likelihoods are folded away


def test_logs_lie_on_one_curve_without_their_constants():
    """Two logs 100 dph apart: rate less its constant is the polynomial, the gap and nothing of the 100 dph."""
    from imucal.plot import diagnosis as diagnosis_figures
    import numpy as np

    record = diagnosis_figures.Record(DIAGNOSIS["axes"][0]["plots"]["residual"])
    free = record.rate_dph - record.offset_dph - record.before_dph
    assert np.ptp(free - 3 * record.temp_degc) < 1e-6
    dph, degc, error_dph = diagnosis_figures.loop_dph(DIAGNOSIS["axes"][0]["plots"]["residual"])
    assert abs(dph - 10) < 3 and 0 <= degc <= 60 and 0.2 < error_dph < 2


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
    assert "the noise, with the slow noise found, would leave 17.9 dph" in run(tmp_path, diagnosis)[1]


def test_without_temperatures_nothing_is_said_of_them(tmp_path):
    diagnosis = copy.deepcopy(DIAGNOSIS)
    axis = diagnosis["axes"][0]
    n = len(axis["plots"]["residual"]["temp_degc"])
    axis["plots"]["residual"].update(temp_degc=[None] * n, rate_degc_per_min=[0] * n)
    axis["plots"].update(gap_map=None, gap_map_after=None)
    axis.update(advised_profile=None, advice=["No temperatures in the log."], where={**axis["where"], "direction": "any", "temp_degc": [0, 0]})
    text = run(tmp_path, diagnosis)[1].split("<section")[1]
    assert "ne-minute means lie 6.12 dph rms off their mean" in text and "The record: rate against time" in text
    assert "while the temperature rises" not in text and "advised profile</h3>" not in text and "Rate against temperature" not in text
    assert "mean of each log" in labels(figures_of(axis)[0].axes[0])


def test_hits_left_out_of_means_are_counted(tmp_path):
    diagnosis = copy.deepcopy(DIAGNOSIS)
    residual = diagnosis["axes"][0]["plots"]["residual"]
    assert "out of all noise" not in run(tmp_path, diagnosis)[1]
    for n_hits, words in ((1, "Without 1 sample out of all noise"), (4, "Without 4 samples out of all noise")):
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
    panels = figures_of(diagnosis["axes"][0])[1].axes
    assert [ax.get_title(loc="left") for ax in panels] == ["as measured [dph]", "less the polynomial [dph]"]
    assert all("with what was found" not in labels(ax) for ax in panels) and "with what was found; rising" not in text


def test_one_log_says_what_is_free_in_its_quarters(tmp_path):
    diagnosis = copy.deepcopy(DIAGNOSIS)
    diagnosis["axes"][0]["gap"]["method"] = "quarters of the one log held out in turn"
    text = run(tmp_path, diagnosis)[1]
    assert "On data not used in the fit (quarters of the one log, each predicted from the others but for its own constant) one-minute means" in text


def test_logs_are_counted_from_one_for_people(tmp_path):
    diagnosis = copy.deepcopy(DIAGNOSIS)
    axis = diagnosis["axes"][0]
    diagnosis["library"]["effects"].append({"name": "bias_step", "label": "steps", "parameters": [{"name": "steps", "unit": ""}]})
    axis["effects"] = [{"name": "bias_step", "parameters": {"steps": [{"log": 1, "t_s": 93024, "amplitude_dph": 427.9}, {"log": 0, "t_s": 1020, "amplitude_dph": -12}]},
                        "std_errors": {"steps": [{"amplitude_dph": 62}, {"amplitude_dph": None}]}}]
    axis["where"].update(by_log=[{"log": 0, "z": 1.5}, {"log": 1, "z": 2.5}], logs=[0, 1])
    text = run(tmp_path, diagnosis)[1]
    assert "amplitude 428 ± 62 dph at 93024 s (25.84 h) of log 2; amplitude -12 dph at 1020 s (0.28 h) of log 1" in text
    assert "<td>1</td><td>1.5</td>" in text and "<td>2</td><td>2.5</td>" in text and "in every log" in text
    assert "<td>runs/a.csv</td><td>log 1, fitted</td>" in text
    diagnosis["logs"] = diagnosis["logs"][:1]
    axis["where"].update(logs=[0])
    axis["effects"][0]["parameters"]["steps"] = axis["effects"][0]["parameters"]["steps"][1:]
    text = run(tmp_path, diagnosis)[1]
    assert "in every log" not in text and "amplitude -12 ± 62 dph at 1020 s (0.28 h)</td>" in text


def test_legends_do_not_lie_over_points():
    drawn = figures_of(with_record(DIAGNOSIS["axes"][0]))
    assert len(drawn) == 6
    for fig in drawn:
        fig.draw_without_rendering()
        top = max(ax.get_window_extent().y1 for ax in fig.axes)
        legends = [*fig.legends, *(ax.get_legend() for ax in fig.axes if ax.get_legend())]
        for legend in legends:
            assert legend.get_window_extent().y0 >= top - 2 and legend.get_window_extent().x0 >= fig.bbox.x0
    assert drawn[0].legends and drawn[1].legends


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
    diagnosis["axes"][0].update(gap={"shrinkage": None, "ci95": None, "statement": "how far the gap shrinks is hidden by noise"})
    text = run(tmp_path, diagnosis)[1]
    assert "On data that were not fitted: how far the gap shrinks is hidden by noise." in text
    diagnosis["axes"][0]["gap"].update(statement="", remainder="jumps at single moments predict no other data")
    assert "<p>What is left: jumps at single moments predict no other data.</p>" in run(tmp_path, diagnosis)[1]


def test_hash_of_a_log_beside_the_diagnosis(tmp_path):
    content = b"# imucal-log = 1\n# device = unit <7>  serial = 12  run = up-2\nt_s,temp_degc,gx_dph\n1,20,3\n"
    (tmp_path / "a.csv").write_bytes(content)
    text = run(tmp_path, DIAGNOSIS)[1]
    assert hashlib.sha256(content).hexdigest()[:16] in text and "<td>unit &lt;7&gt;, serial 12; run up-2</td>" in text
    assert "<h1>What the error model leaves out: unit &lt;7&gt;, serial 12</h1>" in text
    assert re.search(r'class="sub">a.csv, &lt;b&gt;.csv · diagnosed \d{4}-\d\d-\d\d \d\d:\d\d UTC<br>2 logs fitted', text)
    (tmp_path / "a.csv").unlink()
    assert "a device that its logs do not name</h1>" in run(tmp_path, DIAGNOSIS)[1]
    assert "<h1>What plain noise does not explain: " in run(tmp_path, {**DIAGNOSIS, "model": None})[1]


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


def test_the_record_shows_rows_as_logged_and_what_was_left_out():
    """Rows behind their means, marks for what was left out, an arrow for what is far off, no line over an hour without rows."""
    import numpy as np
    axis = with_record(DIAGNOSIS["axes"][0])
    top, below = figures_of(axis)[0].axes
    seen = labels(top)
    rows = seen["rows as logged, one of 60"]
    assert len(rows.get_xdata()) == 60 and rows.get_zorder() < seen["means, temperature rising"].get_zorder()
    clipped = seen["left out, 2483: readings clipped at a limit"]
    assert clipped.get_marker() == "x" and list(clipped.get_ydata()) == [170, 170]
    assert "left out, 7: within 10 s of those" in seen and "left out, 2: single seconds out of all noise" in seen
    assert top.get_ylim()[1] < 600, "two wild seconds flatten the picture"
    arrows = [line for line in top.get_lines() if line.get_marker() in ("^", "v") and not line.get_clip_on()]
    assert sorted(line.get_ydata()[0] for line in arrows) == sorted(top.get_ylim())
    assert {"1 beyond, to 20000 dph", "1 beyond, to -900000 dph"} <= {text.get_text() for text in top.texts}
    line = seen["polynomial"]
    hole = np.flatnonzero(~np.isfinite(line.get_ydata()))
    assert len(hole) == 1 and np.diff(line.get_xdata()[[hole[0] - 1, hole[0] + 1]]) > 1 - 0.02, "a line is drawn over the hour without rows"
    assert np.isnan(below.get_lines()[0].get_ydata()).any(), "the temperature is drawn over the hour without rows"
    caption = diagnosis_report.raw_figures(axis, diagnosis_report.Library(DIAGNOSIS))[0]["caption"]
    assert "Left out: 2483 (readings clipped at a limit), 2 (single seconds out of all noise), 7 (within 10 s of those)." in caption


def test_held_out_logs_are_drawn_where_they_are_judged():
    axis = with_record(DIAGNOSIS["axes"][0])
    record, _, held = figures_of(axis)[:3]
    assert [text.get_text() for text in record.axes[0].texts if "log" in text.get_text()] == ["log 1", "log 2", "held-out log 1"]
    shades = [patch for patch in record.axes[0].patches]
    assert len(shades) == 1 and shades[0].get_x() > record.axes[0].get_lines()[0].get_xdata().max()
    lines = [line for line in record.axes[0].get_lines() if line.get_linestyle() == "-" and len(line.get_ydata()) == 3]
    assert list(lines[0].get_ydata()) == [2, 4, 9], "what is foretold of the held-out log is its rate less what is left"
    seen = labels(held.axes[0])
    assert list(seen["less the polynomial"].get_ydata()) == [3, 2, 3] and list(seen["less what was found too"].get_ydata()) == [1, 1, 0]
    axis["plots"]["held_out"].update(are_logs=False, unit=[0, 1, 2], log=[0, 0, 0])
    assert [text.get_text() for text in figures_of(axis)[2].axes[0].texts] == ["quarter 1", "quarter 2", "quarter 3"]


def test_an_axis_without_an_answer_shows_its_record():
    axis = {**copy.deepcopy(DIAGNOSIS["axes"][1]), "verdict": "unexplained", "refused": "it is stuck",
            "plots": {"record": with_record(DIAGNOSIS["axes"][0])["plots"]["record"]}}
    drawn = figures_of(axis)
    assert len(drawn) == 1 and "rows as logged, one of 60" in labels(drawn[0].axes[0])


def test_figures_of_an_accelerometer_are_in_its_unit(tmp_path):
    diagnosis = copy.deepcopy(DIAGNOSIS)
    axis = with_record(diagnosis["axes"][0])
    axis.update(axis="ax_mg", unit="mg", advice=["These logs would not show rate_ramp below ramp_mg_per_h 0.68."])
    axis["not_detectable_here"] = [{"name": "noise", "smallest_detectable": {"arw_deg_rt_h": 0.002}}]
    diagnosis["library"]["effects"].append({"name": "noise", "parameters": [{"name": "arw_deg_rt_h", "unit": "deg/sqrt(h)"}]})
    axis["gap"]["unit"] = "mg^2"
    diagnosis["axes"] = [axis]
    text = run(tmp_path, diagnosis)[1]
    words = re.sub(r'src="data:[^"]*"', "", text)
    assert "dph" not in words and "°/√h" not in words
    for said in ("amplitude 19.8 ± 0.9 mg", "mg rms off the polynomial, and", "ramp below ramp 0.68 mg/h", "arw 0.12 mg/√Hz", "specific force", "mg²"):
        assert said in words, said
    for fig in figures_of(axis):
        for ax in fig.axes:
            assert "dph" not in ax.get_xlabel() + ax.get_ylabel() + ax.get_title(loc="left") + "".join(t.get_text() for t in ax.texts)


def test_dp2_shows_the_logs_that_the_distance_is_of():
    """Before: the logs as they are against the believed model; after: less what was found, against the answer."""
    import numpy as np
    axis = copy.deepcopy(DIAGNOSIS["axes"][0])
    axis["plots"]["dp2"].update(data_dph=[30, 25, 47], data_after_dph=[30, 20.5, 14])
    seen = labels(figures_of(axis)[3].axes[0])
    assert set(seen) == {"believed model", "with what was found", "logs, what was found still in", "logs without it"}
    assert list(seen["logs without it"].get_ydata()) == [30, 20.5, 14]
    axis["plots"]["dp2"]["model_after_dph"] = axis["plots"]["dp2"]["model_before_dph"]
    drawn = figures_of(axis)[3]
    assert set(labels(drawn.axes[0])) == {"both models", "logs, what was found still in", "logs without it"}
    drawn.draw_without_rendering()
    shown = [t for t in drawn.axes[0].yaxis.get_major_ticks() if np.prod([*drawn.axes[0].get_ylim() - np.array(t.get_loc())]) < 0]
    assert len(shown) >= 2
    axis["effects"] = []
    assert set(labels(figures_of(axis)[3].axes[0])) == {"believed model", "logs"}


def test_cells_without_data_are_hatched():
    axis = copy.deepcopy(DIAGNOSIS["axes"][0])
    drawn = figures_of(axis)[2]
    hatched = [patch for patch in drawn.axes[0].patches if patch.get_hatch()]
    assert [(patch.get_x(), patch.get_y()) for patch in hatched] == [(1, 1)]
    captions = [f["caption"] for f in diagnosis_report.evidence_figures(axis)]
    assert captions[0].endswith("Hatched: no data.")
    for key in ("gap_map", "gap_map_after"):
        axis["plots"][key]["z"][1][1] = 0.0
    assert not [f["caption"] for f in diagnosis_report.evidence_figures(axis) if "no data" in f["caption"]]


def test_captions_are_true_of_the_case():
    """A memory is spoken of where branches part by more than their scatter; what was found is named; no profile where none helps."""
    library = diagnosis_report.Library(DIAGNOSIS)
    axis = copy.deepcopy(DIAGNOSIS["axes"][0])

    def caption():
        return diagnosis_report.raw_figures(axis, library)[1]["caption"]
    assert "The branches part; what was found: thermal hysteresis: a loop over temperature." in caption()
    axis["effects"] = []
    assert "a memory of the temperature's past, a jump, slow noise or a warm-up can do that" in caption()
    axis["plots"]["residual"]["before_dph"] = [(37 * k) % 31 - 15 for k in range(240)]
    assert "no more than their scatter" in caption() and "memory" not in caption()
    assert "differ by up to" not in diagnosis_report.picture_sentence(axis, diagnosis_report.loop_of(axis))
    assert diagnosis_report.advised_profile(axis)
    axis["effects"] = [{"name": "saturation", "family": "structural"}]
    assert not diagnosis_report.advised_profile(axis)
    axis.update(effects=[], advice=["One log only."])
    assert not diagnosis_report.advised_profile(axis)
    axis["effects"] = [{"name": "slow_noise", "evidence_nats": 0.0}]
    assert diagnosis_report.findings_title(axis) == "What it may be"


def test_sentences_give_the_sizes_of_their_pictures(tmp_path):
    import numpy as np
    axis = DIAGNOSIS["axes"][0]
    said = diagnosis_report.picture_sentence(axis, None)
    rms = [np.sqrt(np.mean(np.square(axis["plots"]["residual"][key]))) for key in ("before_dph", "after_dph")]
    assert f"lie {rms[0]:.3g} dph rms off the polynomial, and {rms[1]:.3g} dph with what was found" in said
    axis = copy.deepcopy(axis)
    axis["gap"]["residual_rms_dph"].update(before=466, after=208, noise=64, errors_of_fit=690)
    said = diagnosis_report.held_out_sentence(axis)
    assert "errors of the fit 690 dph" in said and "these data cannot judge how much of it is the answer's" in said
    axis["gap"]["residual_rms_dph"]["errors_of_fit"] = 100
    assert "cannot judge" not in diagnosis_report.held_out_sentence(axis)


def test_panels_against_temperature_have_one_scale_and_labels_have_room():
    axis = with_record(DIAGNOSIS["axes"][0])
    record, panels = figures_of(axis)[:2]
    assert len(panels.axes) == 3 and panels.axes[1].get_ylim() == panels.axes[2].get_ylim()
    panels.draw_without_rendering(), record.draw_without_rendering()
    boxes = [ax.get_window_extent() for ax in panels.axes]
    assert max(box.y0 for box in boxes) - min(box.y0 for box in boxes) < 1
    for ax in record.axes:
        label, box = ax.yaxis.label.get_window_extent(), ax.get_window_extent()
        assert label.y0 >= box.y0 - 3 and label.y1 <= box.y1 + 3, ax.get_ylabel()
    assert len(record.axes[1].get_yticks()) >= 3 and record.axes[1].get_ylabel() == "temp. [°C]"


@pytest.mark.parametrize("span_s, unit", [(150, "s"), (5000, "min"), (9000, "h")])
def test_time_has_the_unit_of_its_length(span_s, unit):
    rows = {"log": 0, "is_held_out": False, "every": 1, "t_s": [0, span_s / 2, span_s], "temp_degc": [None] * 3, "rate_dph": [1, 2, 3], "left_out": []}
    drawn = figures_of({"axis": "gx_dph", "verdict": "no_gap", "plots": {"record": [rows]}})
    assert drawn[0].axes[0].get_xlabel() == f"time [{unit}]"


def test_a_jump_is_drawn_against_time_alone():
    axis = copy.deepcopy(DIAGNOSIS["axes"][0])
    assert "with what was found" in labels(figures_of(axis)[1].axes[1])
    axis["effects"] = [{"name": "bias_step", "family": "function_of_time", "parameters": {"steps": [{"log": 0, "t_s": 90, "amplitude_dph": 9}]}}]
    drawn = figures_of(axis)
    assert "with what was found" in labels(drawn[0].axes[0]) and "with what was found" not in labels(drawn[1].axes[1])


def test_the_polynomial_against_temperature_is_a_curve_on_a_grid():
    """No zigzag between means, and none where no temperature was."""
    import numpy as np
    axis = copy.deepcopy(DIAGNOSIS["axes"][0])
    line = labels(figures_of(axis)[1].axes[0])["polynomial"]
    x, y = line.get_xdata(), line.get_ydata()
    assert np.all(np.diff(x) > 0) and np.ptp(y - 3 * x) < 1e-6
    residual = axis["plots"]["residual"]
    kept = [k for k in range(240) if not 20 <= residual["temp_degc"][k] < 40]
    for key in ("temp_degc", "t_s", "rate_degc_per_min", "log", "rate_dph", "polynomial_dph", "before_dph", "after_dph"):
        residual[key] = [residual[key][k] for k in kept]
    line = labels(figures_of(axis)[1].axes[0])["polynomial"]
    missing = line.get_xdata()[np.isnan(line.get_ydata())]
    assert missing.min() > 19 and missing.max() < 40.1 and len(missing) > 50


def test_candidates_show_what_was_named_and_leave_out_what_gains_nothing():
    from imucal.plot.diagnosis import candidate_rows

    candidates = [{"name": "thermal_anomaly", "gain_nats": 9.7, "threshold_nats": 7}, {"name": "thermal_anomaly", "gain_nats": 17.4, "threshold_nats": 7},
                  {"name": "thermal_lag", "gain_nats": 0, "threshold_nats": 7}, {"name": "warm_up", "gain_nats": 0.1, "threshold_nats": 7}]
    rows, n_others = candidate_rows(candidates, (), ["bias_step"])
    assert [row["label"] for row in rows[::-1]] == ["bias step", "thermal anomaly (any shape)", "thermal anomaly"] and n_others == 2
    assert rows[-1]["named"] and rows[-1]["elsewhere"]
    rows, _ = candidate_rows(candidates, (), ["thermal_anomaly"])
    assert [(row["label"], row["named"]) for row in rows[::-1]] == [("thermal anomaly (any shape)", True), ("thermal anomaly", False)]


def test_signs_and_units_are_those_of_a_page(tmp_path):
    from imucal.diagnosis_words import hours, typeset, with_hours

    assert typeset("1.42 +- 0.05 at -17.6 degC: 40.6 dph per degC/min, 3 -> 2") == "1.42 ± 0.05 at -17.6 °C: 40.6 dph per °C/min, 3 → 2"
    assert typeset("run_degC.csv, column temp_degc") == "run_degC.csv, column temp_degc"
    assert hours(4000.5) == "4000 s (1.11 h)" and hours(59.7) == "60 s"
    assert with_hours("at averaging times of 32 to 8192 s, from 3601 to 9601 s") == "at averaging times of 32 to 8192 s, from 3601 to 9601 s (1.00 to 2.67 h)"
    diagnosis = copy.deepcopy(DIAGNOSIS)
    diagnosis.update(warnings=["goes 2 degC above"], logs=["a_10 degC.csv"])
    axis = diagnosis["axes"][0]
    axis["effects"][0].update(in_words="1.42 +- 0.05 times at 5 degC", parameters={"slope": 3}, std_errors={})
    axis["advice"] = ["Record the temperature (column temp_degc); a negative width_degc is none."]
    diagnosis["library"]["effects"].append({"name": "thermal_step", "parameters": [{"name": "temp_degc", "unit": "degC"}]})
    text = run(tmp_path, diagnosis)[1]
    assert "goes 2 °C above" in text and "1.42 ± 0.05 times at 5 °C" in text and "a_10 degC.csv" in text
    assert "(column temp_degc); a negative width is none." in text


def test_tables_of_folds_name_quantities_and_units(page):
    for words in ("<th>averaging time [s]</th>", "<th>excess [standard errors]</th>", "What tests that assume no cause saw", "<th>after what was found</th>"):
        assert words in page, words
    assert "<th>z</th>" not in page and "<th>tau s</th>" not in page
