# SPDX-License-Identifier: MIT
"""The shape of the project: what stands at the top, and that dependencies point one way."""
import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from where import ROOT


def tracked():
    return subprocess.run(["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True).stdout.split()


def includes(path):
    text = (ROOT / path).read_text(errors="replace")
    return re.findall(r'^\s*#\s*include\s+[<"]([^>"]+)[>"]', text, re.M)


def test_top_level_holds_the_agreed_entries_only():
    top = {name.split("/")[0] for name in tracked()}
    assert {name for name in top if not name.startswith(".")} == {
        "firmware", "host", "common", "tests", "Makefile", "README.md", "LICENSE"}


def test_common_is_freestanding():
    allowed = {"stdint.h", "stddef.h", "stdbool.h", "limits.h", "float.h", "string.h"}
    rooms = {Path(name).name for name in tracked() if name.startswith("common/")}
    for name in tracked():
        if name.startswith("common/") and name.endswith((".c", ".h")):
            for include in includes(name):
                assert include in allowed or include in rooms, f"{name} includes {include}"


def test_host_and_firmware_do_not_know_each_other():
    host_rooms = ("base/", "io/", "linear/", "noise/", "physics/", "analysis/", "device/", "cli/")
    for name in tracked():
        if not name.endswith((".c", ".h", ".cpp")):
            continue
        for include in includes(name):
            if name.startswith("host/"):
                assert "firmware" not in include and not include.startswith(("app/", "port/")), f"{name}: {include}"
            if name.startswith("firmware/"):
                assert not include.startswith(host_rooms), f"{name}: {include}"


# The host's rooms from the lowest tier to the highest (host/README.md): a room may use those of its own tier and of
# the tiers below, without a cycle.
TIERS = [
    ["lib/base"],
    ["lib/io", "lib/linear"],
    ["lib/noise"],
    ["lib/physics/effects", "lib/physics/sim"],
    ["lib/analysis/dp", "lib/analysis/errormodel", "lib/analysis/fit", "lib/analysis/profile",
     "lib/analysis/montecarlo"],
    ["lib/analysis/diagnose/logs"],
    ["lib/analysis/diagnose/evidence"],
    ["lib/analysis/diagnose/search"],
    ["lib/analysis/diagnose/stages"],
    ["lib/analysis/diagnose/judge"],
    ["lib/analysis/diagnose"],
    ["lib/device"],
    ["tools/cli"],
    ["tools/calibrate", "tools/diagnose", "tools/dp", "tools/errormodel", "tools/gyrosim", "tools/imucal",
     "tools/montecarlo", "tools/profile"],
]
TIER_OF = {room: number for number, tier in enumerate(TIERS) for room in tier}


def host_sources():
    return [name for name in tracked() if re.match(r"host/(lib|tools)/.*\.(h|cpp)$", name)]


def room_of(path):
    return str(Path(path).parent.relative_to("host"))


def host_arrows():
    """(room, room it uses, where) of every #include between rooms of the host."""
    rooms = {room_of(name) for name in host_sources()}
    arrows = []
    for name in host_sources():
        for include in includes(name):
            folder = str(Path(include).parent)
            for room in (f"lib/{folder}", f"tools/{folder}"):
                if room in rooms and room != room_of(name):
                    arrows.append((room_of(name), room, f"{name}: {include}"))
    return arrows


def test_every_room_of_the_host_has_its_tier():
    assert {room_of(name) for name in host_sources()} == set(TIER_OF), "name the room in TIERS and in host/README.md"


def test_arrows_between_rooms_go_down():
    arrows = host_arrows()
    assert len(arrows) > 100  # they were found at all
    assert not [where for room, used, where in arrows if TIER_OF[used] > TIER_OF[room]]


def test_programs_do_not_use_each_other():
    programs = set(TIERS[-1])
    assert not [where for room, used, where in host_arrows() if room in programs and used in programs]


def test_rooms_have_no_cycle():
    uses = {}
    for room, used, _ in host_arrows():
        uses.setdefault(room, set()).add(used)
    left = set(TIER_OF)
    while free := {room for room in left if not uses.get(room, set()) & left}:
        left -= free
    assert not left, f"these rooms use each other: {sorted(left)}"


# ---- the order of the tiers, from the highest to the lowest, in the build and in the map ----
def rooms_that_are_linked():
    """{program: its rooms in the order in which they are linked}; of "all" the whole list."""
    words = "$(foreach p,all $(notdir $(HOST_PROGRAMS)),$(info $p: $(or $(ROOMS_$p),$(HOST_ROOMS))))"
    environment = {key: value for key, value in os.environ.items() if key not in ("MAKEFLAGS", "MFLAGS", "MAKELEVEL")}
    out = subprocess.run(["make", "-s", f"--eval=rooms-of-programs: ; @:{words}", "rooms-of-programs"], cwd=ROOT, env=environment,
                         check=True, capture_output=True, text=True).stdout
    return {name: rooms.split() for name, rooms in (line.split(":") for line in out.splitlines() if ": " in line)}


def rooms_of_the_map():
    """The rooms of the library in the table of host/README.md."""
    return re.findall(r"(?m)^\| [\w, ]*\| `lib/([\w/]+)` \|", (ROOT / "host/README.md").read_text())


def test_tiers_have_one_order_in_tests_build_and_map():
    linked = rooms_that_are_linked()["all"]
    levels = [TIER_OF[f"lib/{room}"] for room in linked]
    assert len(levels) > 10 and levels == sorted(levels, reverse=True), "HOST_ROOMS of host.mk against TIERS"
    assert rooms_of_the_map() == linked, "the map of host/README.md against HOST_ROOMS"


def test_programs_link_the_rooms_that_they_reach_in_that_order():
    uses = {}
    for room, used, _ in host_arrows():
        uses.setdefault(room, set()).add(used)
    linked = rooms_that_are_linked()
    for program, rooms in linked.items():
        if program == "all":
            continue
        reached, new = set(), {f"tools/{program}"}
        while new:
            reached |= new
            new = {used for room in new for used in uses.get(room, ())} - reached
        assert rooms == [room for room in linked["all"] if f"lib/{room}" in reached], f"ROOMS_{program}"


def test_a_markov_process_is_discretised_in_one_place():
    sources = [name for name in tracked() if re.match(r"host/(lib|tools|python)/.*\.(h|cpp|py)$", name)]
    own = "host/lib/io/model.h"  # MarkovStep
    assert "expm1(-2" in (ROOT / own).read_text()
    assert not [name for name in sources if name != own and re.search(r"expm1\(-2\b", (ROOT / name).read_text())]


# ---- files that comments name ----
def comments_of(text):
    """The comments of a C or C++ source, one after the other; what looks like one inside a string is none."""
    found = re.finditer(r'"(?:\\.|[^"\\\n])*"|(//[^\n]*|/\*.*?\*/)', text, re.S)
    return "\n".join(match.group(1) for match in found if match.group(1))


def headers_named():
    """(file, header it names, folders where that may be) of comments in the sources and of the READMEs of host/lib."""
    roots = [ROOT / folder for folder in ("", "host/lib", "host/tools", "common", "firmware", "tests")]
    for name in tracked():
        is_readme = name.startswith("host/lib/") and name.endswith("README.md")
        if is_readme or re.match(r"(host|common|firmware)/.*\.(h|c|cpp)$", name):
            text = (ROOT / name).read_text()
            above = list((ROOT / name).parents)[:-len(ROOT.parents) - 1]
            for header in re.findall(r"(?<![\w/.<>-])((?:[\w-]+/)*\w+\.h)\b", text if is_readme else comments_of(text)):
                yield name, header, roots + above


def test_headers_that_comments_and_readmes_name_exist():
    """By the path that an #include has, from a folder above the file (inside a room), or by their name alone."""
    names, found = {Path(name).name for name in tracked()}, list(headers_named())
    assert len(found) > 150  # they were found at all
    stale = {f"{name}: {header}" for name, header, folders in found if not header.startswith("build/")
             and not ("/" not in header and header in names) and not any((folder / header).exists() for folder in folders)}
    assert not stale


# ---- files of one room ----
def files_of(room):
    """{file without its ending: those of the room, and of the rooms inside it, that it includes} of headers and sources."""
    def is_inside(folder):
        return folder == room or folder.startswith(f"{room}/")

    uses = {}
    for name in host_sources():
        if is_inside(room_of(name)):
            own = Path(name).stem
            used = {Path(include).stem for include in includes(name) if is_inside(f"lib/{Path(include).parent}")}
            uses.setdefault(own, set()).update(used - {own})
    return uses


@pytest.mark.parametrize("room, at_least", [("lib/analysis/diagnose", 40)])
def test_files_of_a_layered_room_use_no_file_above_them(room, at_least):
    uses = files_of(room)
    assert len(uses) > at_least and sum(map(len, uses.values())) > at_least  # they were found at all
    left = set(uses)
    while free := {name for name in left if not uses[name] & left}:
        left -= free
    assert not left, f"these files use each other, or files that do: {sorted(left)}"


def test_readme_of_diagnose_names_every_file_of_the_room():
    table = (ROOT / "host/lib/analysis/diagnose/README.md").read_text().split("## Files")[1].split("\n## ")[0]
    named = set(re.findall(r"`(\w+)`", table))
    assert not [name for name in files_of("lib/analysis/diagnose") if name not in named]


# ---- the device's app and its ports ----
def test_porting_guide_names_every_member_of_the_port():
    struct = re.search(r"typedef struct imucal_port \{(.*)\} imucal_port_t;", (ROOT / "firmware/app/port.h").read_text(), re.S).group(1)
    struct = re.sub(r"/\*.*?\*/", "", struct, flags=re.S)
    members = re.findall(r"\(\*(\w+)\)\(|(\w+);", struct)
    members = [callback or value for callback, value in members]
    assert len(members) >= 15 and "reboot" in members and "boot_id" in members
    table = (ROOT / "firmware/README.md").read_text().partition("## Porting")[2].partition("\n## ")[0]
    named = {name for row in table.splitlines() if row.startswith("| `") for name in re.findall(r"`(\w+)`", row.split("|")[1])}
    assert set(members) == named


def test_files_of_the_app_call_down_only():
    """In the order in which parts.h lists them; app.c above all, what it names from outside (guard, board) below."""
    listed = re.findall(r"^/\* (\w+\.c) \*/$", (ROOT / "firmware/app/parts.h").read_text(), re.M)
    sources = [name for name in device_sources() if re.match(r"firmware/app/\w+\.c$", name)]
    order = ["guard.c", "board.c", *listed, "app.c"]
    assert sorted(order) == sorted(Path(name).name for name in sources)
    home = {function: Path(path).name for _, function, path in functions_of(sources)}
    calls = [(Path(name).name, home[word], word) for name in sources for word in re.findall(r"\b(\w+)\(", (ROOT / name).read_text())
             if home.get(word, Path(name).name) != Path(name).name]
    shared = [(user, used, word) for user, used, word in calls if word.startswith(("app_", "imucal_"))]
    assert len(shared) > 40  # they were found at all
    assert not [call for call in shared if order.index(call[1]) > order.index(call[0])]


def test_headers_of_the_device_can_be_included_from_cpp():
    """What a sketch or a C++ firmware includes declares its functions as C's."""
    headers = [name for name in tracked() if re.match(r"(common|firmware/(app|sensors|flash))/\w+\.h$", name)]
    assert len(headers) > 20
    bare = [name for name in headers if re.search(r"^\w[^#]*\);", (text := (ROOT / name).read_text()), re.M) and 'extern "C" {' not in text]
    assert not bare


# ---- size of functions ----
MOST_LINES = 60


def functions_of(sources):
    """(lines, name, path) of every C and C++ function of these sources by universal-ctags."""
    ctags = shutil.which("ctags-universal") or shutil.which("ctags")
    if not ctags:
        pytest.fail("ctags is missing: apt-get install universal-ctags")
    found = subprocess.run(
        [ctags, "--output-format=json", "--fields=+ne", "--languages=C,C++", "--langmap=C++:.cpp.h", "--kinds-C=f",
         "--kinds-C++=f", "-f", "-", "-L", "-"], cwd=ROOT, input="\n".join(sources), check=True, capture_output=True, text=True)
    tags = [json.loads(line) for line in found.stdout.splitlines()]
    return [(tag["end"] - tag["line"] + 1, tag["name"], tag["path"]) for tag in tags if "end" in tag]


def device_sources():
    return [name for name in tracked() if name.startswith(("common/", "firmware/")) and name.endswith((".c", ".h"))]


@pytest.mark.parametrize("sources, at_least", [(host_sources, 1000), (device_sources, 500)], ids=["host", "device"])
def test_functions_are_short(sources, at_least):
    functions = functions_of(sources())
    assert len(functions) > at_least  # they were found at all
    longer = {f"{path}: {name}": lines for lines, name, path in functions if lines > MOST_LINES}
    assert not longer, "cut them where they have joints"
    lengths = sorted(lines for lines, _, _ in functions)
    assert lengths[len(lengths) // 2] <= 10
    assert lengths[len(lengths) * 9 // 10] <= 30


def test_sources_carry_a_licence_tag():
    bare = [name for name in tracked() if name.endswith((".c", ".h", ".cpp", ".py"))
            and "SPDX-License-Identifier" not in (ROOT / name).read_text(errors="replace")[:400]]
    assert not bare


def test_recorded_data_stays_outside():
    for name in tracked():
        if name.endswith(".csv"):
            text = (ROOT / name).read_text(errors="replace")[:2000]
            assert "imudata" not in text and "diveMove" not in text, f"{name} holds recorded data"
