# SPDX-License-Identifier: MIT
"""The same log gives the same bits on the host, on the Cortex-M4F (hardware float) and on the Cortex-M0 (soft float)."""
import random
import struct
import subprocess

import pytest

from device_link import sample_record
from where import BUILD, ROOT

MACHINES = {"mps2_an386": "mps2-an386", "nrf51": "microbit"}
RATE_HZ, DURATION_S = 20, 1500


def make_log(path):
    """Soak, ramp and soak beyond both ends of the span; jitter, gaps, missing, saturated and faulty seconds."""
    rng, markov = random.Random(20), [0.0, 0.0, 0.0]
    gaps = {300, 301, 302, 303, 700} | set(range(1100, 1150))
    with open(path, "wb") as out:
        for k in range(DURATION_S * RATE_HZ):
            second = k // RATE_HZ
            if second in gaps or (second in (400, 900) and k % RATE_HZ > 6) or (second % 53 == 0 and k % RATE_HZ == 3):
                continue
            degc = -1.0 + 62.0 * min(1.0, max(0.0, (k / RATE_HZ - 200) / (DURATION_S - 400)))
            tn = (degc - 30) / 30
            markov = [0.9995 * m + 0.63 * rng.gauss(0, 1) for m in markov]
            counts = [round(80 + 300 * tn + 150 * tn ** 2 - 100 * tn ** 3 + markov[0] + rng.gauss(0, 160)),
                      round((-900 * tn + 40 * tn ** 5 + markov[1] + rng.gauss(0, 160)) / 36),
                      round((5000 + 2500 * tn ** 4 + markov[2] + rng.gauss(0, 300)) / 0.37)]
            saturated = 2 if second % 211 == 7 and k % RATE_HZ == 5 else 0
            if saturated:
                counts[1] = 32767
            t_us = k * (1000000 // RATE_HZ) + rng.randrange(0, 900) + (1500000 if second > 1200 else 0)
            out.write(sample_record(t_us, round((degc - 25) * 100 + rng.gauss(0, 2)), counts, saturated,
                                    4 if second == 555 else 0))


def run_on_mcu(port, feed, out, mode="bits", image=None):
    arguments = ["check", "mode=" + mode, "out=%s" % out] + (["feed=%s" % feed] if feed else [])
    command = ["qemu-system-arm", "-M", MACHINES[port], "-kernel", str(image or BUILD / "firmware" / port / "check.elf"),
               "-display", "none", "-monitor", "none", "-serial", "none", "-semihosting-config",
               ",".join(["enable=on,target=native"] + ["arg=%s" % a for a in arguments])]
    if mode == "cycles":
        command += ["-icount", "shift=0"]
    subprocess.run(command, check=True, timeout=100)
    return out.read_text()


@pytest.fixture(scope="module")
def bits(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bits")
    make_log(folder / "log.bin")
    result = {"host": subprocess.run([BUILD / "firmware/posix/check", folder / "log.bin"], check=True, text=True,
                                     capture_output=True, timeout=60).stdout}
    for port in MACHINES:
        result[port] = run_on_mcu(port, folder / "log.bin", folder / (port + ".txt"))
    return result


def test_log_exercises_what_the_comparison_claims(bits):
    lines = bits["host"].splitlines()
    assert lines[-1] == "end" and not [line for line in lines if line.startswith("error")]
    assert {line.split()[0] for line in lines} == {"second", "filter", "table", "comp", "out", "end"}
    seconds = [line.split() for line in lines if line.startswith("second")]
    assert any(int(s[3]) >= 50 for s in seconds)  # a long gap
    assert any(int(s[5]) & 1 for s in seconds)  # channel 1 saturated
    assert any(int(s[4]) & 2 for s in seconds)  # samples missing
    assert any(int(s[6]) & 4 for s in seconds)  # a fault on channel 2
    assert {line.split()[1] for line in lines if line.startswith("table")} == {"3", "5"}
    flags = {int(line.split()[3], 16) for line in lines if line.startswith("out")}
    assert any(f & 1 for f in flags)  # temperatures outside the valid span


@pytest.mark.parametrize("port", MACHINES)
@pytest.mark.parametrize("what", ["second", "filter", "table", "comp", "out"])
def test_same_bits_as_on_the_host(bits, port, what):
    host = [line for line in bits["host"].splitlines() if line.startswith(what + " ")]
    there = [line for line in bits[port].splitlines() if line.startswith(what + " ")]
    assert len(host) > 0 and len(there) == len(host)
    for here, other in zip(host, there):
        assert here == other


def test_instruction_counts_are_repeatable(tmp_path):
    first = run_on_mcu("mps2_an386", None, tmp_path / "a", mode="cycles")
    assert first == run_on_mcu("mps2_an386", None, tmp_path / "b", mode="cycles")
    assert "kf_update order 3" in first and first.endswith("end\n")


def test_contraction_would_change_the_bits(bits, tmp_path):
    """The comparison is sharp: the same filter built for the M4F with fused operations gives other bits."""
    cpu = "-mcpu=cortex-m4 -mthumb -mfloat-abi=hard -mfpu=fpv4-sp-d16".split()
    sources = sorted((ROOT / "common").glob("*.c"))
    sources += [ROOT / "firmware" / name for name in (
        "check/print.c check/bits.c check/profiles.c check/cost.c check/main_arm.c port/arm/startup.c port/arm/semihost.c "
        "port/arm/cmsdk.c").split()]
    objects = [BUILD / "obj/mps2_an386" / source.relative_to(ROOT).with_suffix(".o") for source in sources]
    sources = [source if source.name == "kf.c" or not built.exists() else built for source, built in zip(sources, objects)]
    subprocess.run(["arm-none-eabi-gcc", *cpu, "-std=c99", "-O2", "-ffp-contract=fast", "-Icommon", "-Ifirmware",
                    "-nostartfiles", "--specs=nano.specs", "-Wl,--gc-sections", "-Lfirmware/port/arm", "-T",
                    "firmware/port/mps2_an386/link.ld", *map(str, sources), "-o", str(tmp_path / "fused.elf")],
                   check=True, cwd=ROOT)
    make_log(tmp_path / "log.bin")
    fused = run_on_mcu("mps2_an386", tmp_path / "log.bin", tmp_path / "out", image=tmp_path / "fused.elf")
    assert fused != bits["host"]


# Reference figures A (tests/README.md) (the paper's Figures 7 to 9): one-sigma calibration error in dph; order 3, 0.6 deg/sqrt(h), 20 dph, 100 s.
RAMP_ONLY_DPH = [13.09, 7.47, 6.20, 6.45, 6.29, 5.75, 5.43, 5.75, 6.29, 6.45, 6.20, 7.47, 13.09]
WORST_DPH = {(5, 1): 10.18, (10, 1): 8.64, (20, 1): 6.93, (30, 1): 6.28, (20, 2): 5.03, (20, 4): 3.56, (20, 8): 2.52}


def read_profiles(text):
    """{(soak minutes, cycles): (sigma at 0, 5 .. 60 degC, worst)}"""
    lines = text.splitlines()
    assert lines[-1] == "end"
    result = {}
    for line in lines[:-1]:
        name, soak, cycles, *bits = line.split()
        assert name == "profile"
        values = [struct.unpack(">f", bytes.fromhex(b))[0] for b in bits]
        result[int(soak), int(cycles)] = values[:-1], values[-1]
    return result


def test_predicted_errors_of_the_paper_on_host_and_m4f(tmp_path):
    host = subprocess.run([BUILD / "firmware/posix/check", "--profiles"], check=True, text=True, capture_output=True,
                          timeout=60).stdout
    m4f = run_on_mcu("mps2_an386", None, tmp_path / "m4f", mode="profiles")
    assert m4f == host
    figures = read_profiles(m4f)
    assert figures[0, 1][0] == pytest.approx(RAMP_ONLY_DPH, rel=0.01)
    for profile, worst_dph in WORST_DPH.items():
        assert figures[profile][1] == pytest.approx(worst_dph, rel=0.01), profile
