# SPDX-License-Identifier: MIT
"""errormodel fit: its refits are counted on a terminal, Ctrl-C ends them with the errors found so far."""
import json
import os
import pty
import random
import re
import select
import signal
import subprocess
import time

from where import BIN

REFITS = 100000
PATIENCE_S = 60


def write_log(path):
    draw = random.Random(1)
    with open(path, "w", encoding="utf-8") as out:
        out.write("# imucal-log = 1\nt_s,temp_degc,gx_dph\n")
        for k in range(1, 4001):
            out.write(f"{k},25,{draw.gauss(0, 36):.3f}\n")


def read_until(terminal, wanted, n):
    """What the terminal shows until `wanted` came n times, it is closed, or patience is at its end."""
    shown, end = "", time.monotonic() + PATIENCE_S
    while shown.count(wanted) < n and select.select([terminal], [], [], max(0, end - time.monotonic()))[0]:
        try:
            piece = os.read(terminal, 4096)
        except OSError:  # the other end is closed
            break
        if not piece:
            break
        shown += piece.decode()
    return shown


def test_fit_counts_refits_on_a_terminal_and_ctrl_c_keeps_what_is_done(tmp_path):
    write_log(tmp_path / "log.csv")
    terminal, other_end = pty.openpty()
    command = [BIN / "errormodel", "fit", "log.csv", "--markov", "0", "--criterion", "ls", "--bootstrap", str(REFITS),
               "--threads", "2", "--json", "fit.json"]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=other_end, text=True)
    os.close(other_end)
    try:
        # The second one shows that the first was followed by a look for Ctrl-C.
        shown = read_until(terminal, "refits of simulated records", 3)
        assert shown.count("refits of simulated records") >= 3 and process.poll() is None, shown
        process.send_signal(signal.SIGINT)
        shown += read_until(terminal, "the errors are of those", 1)
        out, _ = process.communicate(timeout=PATIENCE_S)
    finally:
        process.kill()  # where Ctrl-C did nothing, the refits would go on for an hour
    os.close(terminal)
    assert process.returncode == 0, shown
    done = re.search(r"ended after (\d+) of (\d+) refits", shown)
    assert done and 0 < int(done.group(1)) < REFITS and int(done.group(2)) == REFITS
    result = json.loads((tmp_path / "fit.json").read_text())
    assert 0 < result["std_errors"]["arw_deg_rt_h"] < 0.1
    assert f"{done.group(1)} refits" in result["error_method"]
    assert "arw" in out
