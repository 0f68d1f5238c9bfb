# SPDX-License-Identifier: MIT
"""What `make install` puts under a prefix works from there, and `make uninstall` takes it away."""
import os
import pty
import re
import select
import shutil
import subprocess
import sys
import time

import pytest

from where import BUILD, ROOT

USER = """#include <kf.h>
#include <stdio.h>
int main(void) {
  static const imucal_kf_config_t config = {3, 30.0f, 30.0f, 0.00995f, 7.92f, 1296.0f, 400.0f, 1e4f};
  imucal_kf_t kf;
  if (imucal_kf_init(&kf, &config) != IMUCAL_OK || imucal_kf_update(&kf, 412.0f, 24.8f) != IMUCAL_OK) return 1;
  printf("%.1f\\n", (double)imucal_kf_bias(&kf, 24.8f));
  return 0;
}
"""
PROJECT = """cmake_minimum_required(VERSION 3.13)
project(user C)
find_package(imucal 0.1 REQUIRED)
add_executable(user main.c)
target_link_libraries(user imucal::imucal)
"""


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    """The files of an installation under PREFIX=/opt/imucal in a folder of its own."""
    destination = tmp_path_factory.mktemp("root")
    env = {**os.environ, "PREFIX": "/opt/imucal", "DESTDIR": str(destination), "BUILD": str(BUILD), "VERSION": "0.1.0"}
    subprocess.run([ROOT / "host/packaging/install.sh"], cwd=ROOT, env=env, check=True)
    return destination / "opt/imucal"


def clean(**more):
    return {"PATH": "/usr/bin:/bin", "IMUCAL_PYTHON": sys.executable, "HOME": "/nonexistent", **more}


def test_only_the_one_command_is_on_the_path(root):
    assert [p.name for p in (root / "bin").iterdir()] == ["imucal"]
    assert {"dp", "calibrate", "profile", "diagnose"} <= {p.name for p in (root / "libexec/imucal").iterdir()}


def test_installed_command_runs_programs_and_package_outside_the_source_tree(root, tmp_path):
    def imucal(*arguments):
        return subprocess.run([root / "bin/imucal", *arguments], capture_output=True, text=True, cwd=tmp_path, env=clean(), check=True).stdout
    assert imucal("dp", "--version").startswith("dp ")
    imucal("example", "play", "-q")
    (tmp_path / "d.json").write_text('{"imucal_diagnosis": 1, "model": "m.json", "logs": ["run1.csv"], "held_out_logs": [], "axes": []}')
    imucal("report", "d.json", "-o", "report.html")
    assert "<html" in (tmp_path / "report.html").read_text()
    assert "valid log" in imucal("check", "play/run1.csv")
    imucal("calibrate", "fit", "play/run1.csv", "--method", "kf", "--order", "3", "--model", "play/model.json",
           "--accept", "slow", "--accept", "residual", "-o", "table.json", "-q")
    assert "bias_fixed" in imucal("export", "table.json", "--to", "c-header")


def test_installed_package_finds_its_compiled_part_and_the_programs(root, tmp_path):
    code = "import imucal, numpy; assert 'opt/imucal' in imucal.__file__; print(len(imucal.allan_deviation(numpy.random.rand(500)).tau_s), " \
           "imucal.expect({'imucal_model': 1, 'arw_deg_rt_h': 0.6}, [4], type='av').dp_dph[0])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path,
                         env=clean(PYTHONPATH=str(root / "lib/imucal/python"))).stdout.split()
    assert int(out[0]) > 4 and float(out[1]) == pytest.approx(18.0)  # 36 dph / sqrt(4)


def test_man_pages_format_without_complaint(root):
    pages = sorted((root / "share/man/man1").glob("*.1"))
    assert len(pages) == 15
    for page in pages[:3] + pages[-2:]:
        done = subprocess.run(["man", "--warnings", "-E", "UTF-8", "-l", page], capture_output=True, text=True, env=clean(MANPAGER="cat", MANWIDTH="100", LC_ALL="C.UTF-8"))
        assert done.returncode == 0 and not done.stderr, f"{page}: {done.stderr}"
        assert "NAME" in done.stdout and page.name[:-2] in done.stdout
    text = subprocess.run(["man", "-l", root / "share/man/man1/imucal-errormodel.1"], capture_output=True, text=True, env=clean(MANPAGER="cat", MANWIDTH="200")).stdout
    assert "--criterion" in text and "--markov" in text


def test_bash_completes_subcommands_and_options(root):
    def complete(*words):
        script = f"source {root}/share/bash-completion/completions/imucal; COMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}; _imucal; echo ${{COMPREPLY[@]}}"
        return subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True, cwd="/").stdout.split()
    assert complete("imucal", "dia") == ["diagnose"]
    assert "--criterion" in complete("imucal", "errormodel", "--cr")
    assert "optimize" in complete("imucal", "profile", "opt")


def test_zsh_completes_subcommands(root, tmp_path):
    if not shutil.which("zsh"):
        pytest.skip("zsh is not installed: its completion is not tried (apt-get install zsh)")
    functions = root / "share/zsh/site-functions"
    words = f"fpath=({functions} $fpath); autoload -Uz compinit; compinit -u -d {tmp_path}/dump; print -r -- $_comps[imucal]; autoload -Uz +X _imucal && print loaded"
    done = subprocess.run(["zsh", "-f", "-c", words], capture_output=True, text=True, cwd=tmp_path)
    assert done.stdout.split() == ["_imucal", "loaded"] and not done.stderr


def typed_in_zsh(functions, line, folder):
    """What a line becomes when Tab is pressed after it in an interactive zsh."""
    pid, terminal = pty.fork()
    if pid == 0:
        os.chdir(folder)
        os.execvpe("zsh", ["zsh", "-f", "-i"], {**os.environ, "ZDOTDIR": str(folder), "TERM": "dumb"})

    def until(mark):
        said, end = "", time.monotonic() + 60
        while mark not in said and time.monotonic() < end and select.select([terminal], [], [], 60)[0]:
            said += os.read(terminal, 65536).decode(errors="replace")
        return said

    os.write(terminal, f"PS1=; fpath=({functions} $fpath); autoload -Uz compinit; compinit -u -d {folder}/dump; bindkey -e; print re''ady\r".encode())
    until("ready\r")
    os.write(terminal, line.encode() + b"\t\x01print -r -- \"<\x05>\"\r")  # Tab; then the whole line into a print
    said = until(">\r\n")
    os.write(terminal, b"exit\r")
    os.close(terminal)
    os.waitpid(pid, 0)
    return re.findall(r"\n<(.*?)>\r\n", said)


@pytest.mark.parametrize("line, whole", [("imucal dia", "imucal diagnose"), ("imucal profile opt", "imucal profile optimize"),
                                         ("imucal errormodel --cr", "imucal errormodel --criterion")])
def test_zsh_completes_what_is_typed(root, tmp_path, line, whole):
    if not shutil.which("zsh"):
        pytest.skip("zsh is not installed: its completion is not tried (apt-get install zsh)")
    assert [found.strip() for found in typed_in_zsh(root / "share/zsh/site-functions", line, tmp_path)] == [whole]


def test_pkg_config_and_cmake_lead_to_a_program_that_runs(root, tmp_path):
    (tmp_path / "main.c").write_text(USER)
    (tmp_path / "CMakeLists.txt").write_text(PROJECT)
    destination = str(root)[:-len("/opt/imucal")]
    flags = subprocess.run(["pkg-config", "--cflags", "--libs", "imucal"], capture_output=True, text=True, check=True,
                           env=clean(PKG_CONFIG_PATH=str(root / "lib/pkgconfig"), PKG_CONFIG_SYSROOT_DIR=destination)).stdout.split()
    subprocess.run(["cc", "main.c", "-o", "one", *flags], cwd=tmp_path, check=True)
    assert subprocess.run([tmp_path / "one"], capture_output=True, text=True, check=True).stdout == "412.0\n"
    for command in (["cmake", "-S", ".", "-B", "b", f"-DCMAKE_PREFIX_PATH={root}"], ["cmake", "--build", "b"]):
        subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    assert subprocess.run([tmp_path / "b/user"], capture_output=True, text=True, check=True).stdout == "412.0\n"


def test_uninstall_takes_everything_away_and_leaves_strangers(root):
    """Last: the module's installation goes."""
    (root / "bin/stranger").write_text("not ours")
    subprocess.run(["make", "-s", "uninstall", "PREFIX=/opt/imucal", f"DESTDIR={str(root)[:-len('/opt/imucal')]}"], cwd=ROOT, check=True, capture_output=True)
    assert [p.name for p in root.rglob("*") if p.is_file()] == ["stranger"]


def test_a_library_archive_compiles_and_its_manifest_holds(tmp_path):
    done = subprocess.run([sys.executable, ROOT / "host/packaging/dist.py", "--version", "0.1.0", "-o", tmp_path, "--only", "platformio", "--check"],
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "1 archives, 1 checked, 0 faults" in done.stdout


def dist_module():
    import dist
    return dist


@pytest.mark.parametrize("shelf", ["arduino", "platformio", "zephyr", "esp-idf"])
def test_manifest_keeps_its_shelf_s_schema(shelf, tmp_path):
    dist = dist_module()
    shutil.unpack_archive(dist.write_archive(tmp_path, shelf, "0.1.0", dist.SHELVES[shelf]("0.1.0")), tmp_path)
    assert dist.check_manifest(shelf, tmp_path / "imucal") == []


@pytest.mark.parametrize("shelf, place, old, new, words", [
    ("arduino", "library.properties", "category=Sensors", "category=Gyros", "'Gyros' is not one of"),
    ("arduino", "library.properties", "version=0.1.0", "version=0.1", "does not match"),
    ("arduino", "library.properties", "includes=imucal.h", "includes=gone.h", "src/gone.h is not there"),
    ("platformio", "library.json", '"license": "MIT",', '"licence": "MIT",', "'licence' was unexpected"),
    ("platformio", "library.json", '"type": "git"', '"type": "ftp"', "'ftp' is not one of"),
    ("platformio", "library.json", '"main.c"', '"gone.c"', "examples/learn/gone.c is not there"),
    ("zephyr", "zephyr/module.yml", "kconfig: zephyr/Kconfig", "kconfigs: zephyr/Kconfig", "'kconfigs' was unexpected"),
    ("zephyr", "zephyr/module.yml", "cmake: zephyr", "cmake: nowhere", "nowhere/CMakeLists.txt is not there"),
    ("esp-idf", "idf_component.yml", 'idf: ">=4.4"', 'idf: "four"', "is not valid under any"),
    ("esp-idf", "idf_component.yml", "license:", "licence:", "'license' is a required property")])
def test_a_fault_in_a_manifest_is_found(shelf, place, old, new, words, tmp_path):
    dist = dist_module()
    files = dist.SHELVES[shelf]("0.1.0")
    assert old in files[place]
    files[place] = files[place].replace(old, new)
    shutil.unpack_archive(dist.write_archive(tmp_path, shelf, "0.1.0", files), tmp_path)
    faults = dist.check_manifest(shelf, tmp_path / "imucal")
    assert any(words in fault for fault in faults), faults
