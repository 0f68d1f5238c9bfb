# SPDX-License-Identifier: MIT
"""The notebook of the documentation, run as the site runs it, on a short test."""
import re

import pytest

import docs
from where import BIN, ROOT


@pytest.fixture(scope="module")
def page():
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("IMUCAL_BIN", str(BIN))
        patch.setenv("NOTEBOOK_SOAK_S", "300")
        patch.setenv("NOTEBOOK_RATE", "1.5")
        return docs.executed(ROOT / "host/docs/notebook.py")


def numbers(page, pattern):
    return [float(v) for v in re.search(pattern, page).groups()]


def test_page_has_every_step_with_its_code_and_what_it_printed(page):
    assert re.findall(r"^## (\d)", page, re.M) == list("12345")
    assert page.count("```python") == 7 and page.count("```text") == 6
    assert "SPDX" not in page and "# %%" not in page


def test_figures_of_the_page_are_those_of_the_simulated_sensor(page):
    assert numbers(page, r"\n(\d+) s, 0 to 60")[0] == 300 + 2400 + 300 + 2400
    assert numbers(page, r"1 s +([\d.]+) dph") == [pytest.approx(36, rel=0.05)]
    arw, error = numbers(page, r"ARW ([\d.]+) \+- ([\d.]+)")
    assert abs(arw - 0.6) < 4 * error and error < 0.02
    before, after = numbers(page, r"rms before (\d+) dph, after (\d+) dph")
    assert before > 150 and 36 < after < 75


def test_diagnosis_names_the_fault_that_was_put_in(page):
    assert "a gap, explained" in page
    assert re.search(r"effect: (\w+)", page).group(1) == re.search(r"^(\w+) \{", page, re.M).group(1) == "thermal_hysteresis"


def test_fault_in_a_cell_is_not_printed_away(tmp_path):
    (tmp_path / "n.py").write_text("# %%\nprint(1)\n# %%\n1 / 0\n")
    with pytest.raises(ZeroDivisionError):
        docs.executed(tmp_path / "n.py")
