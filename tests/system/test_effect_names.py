# SPDX-License-Identifier: MIT
"""The name of an effect stands in its own file; whoever else needs one asks the effect for its properties."""
import re

from where import ROOT

EFFECTS = ROOT / "host" / "lib" / "physics" / "effects"

# Where a name may stand beside its own file, and why.  An entry that is not needed any more fails too.
ALLOWED = {
    "host/scripts/bench_diagnose.py": "what the benchmark simulates",
    "host/tools/dp/main.cpp": "member of the JSON of dp, not an effect",
    "host/lib/analysis/dp/ratios.cpp": "verdict of the DP ratios, not an effect",
    "host/lib/analysis/dp/ratios.h": "the same",
    "host/lib/analysis/errormodel/sanity.cpp": "a rule of errormodel fit, by the word of dp's verdict",
    "host/lib/io/model.h": "an example in a comment",
    "host/lib/physics/effects/library.cpp": "the family run_to_run, which has one member of its name",
    "host/python/imucal/example.py": "what the example simulates",
    "host/docs/notebook.py": "what the notebook simulates",
    "host/python/imucal/look.py": "a reading of its own, not an effect",
}


def names_and_files():
    out = {}
    for path in EFFECTS.glob("*.cpp"):
        text = path.read_text()
        if "IMUCAL_EFFECT(" in text:
            out[re.search(r'std::string name\(\) const override \{ return "(\w+)"; \}', text).group(1)] = path
    return out


def test_every_effect_file_is_named_after_its_effect():
    for name, path in names_and_files().items():
        assert path.stem == name


def test_names_stand_in_their_own_file_only():
    names = names_and_files()
    assert len(names) == 28
    quoted = re.compile(r"""["'](""" + "|".join(names) + r""")["']""")
    found = {}
    for path in [*(ROOT / "host").rglob("*.cpp"), *(ROOT / "host").rglob("*.h"), *(ROOT / "host").rglob("*.py")]:
        others = {name for name in quoted.findall(path.read_text()) if names[name] != path}
        if others:
            found[str(path.relative_to(ROOT))] = others
    assert {where: what for where, what in found.items() if where not in ALLOWED} == {}
    assert set(ALLOWED) <= set(found), "a file that needs its entry no more: take it out of the list"
