# SPDX-License-Identifier: MIT
"""Faults of recorded logs, of files and of operators, found by `calibrate fit`.  Columns: t_s, temp_degc, gx_dph, gy_dph;
the fault is on gx, gy is healthy."""
import gzip
import math
import random

from reference import BASIC
from reference import DRIFTING as MODEL
from sick.case import Fault

T, TEMP, GX = 0, 1, 2


def put(column, value_of, where=lambda i: True):
    """change(i, row) that writes value_of(i, old) where `where`."""
    def change(i, row):
        if where(i):
            row[column] = value_of(i, float(row[column]))
        return row
    return change


def between(lo, hi):
    return lambda i: lo <= i < hi


def rows(area, name, found_by, change, **options):
    return Fault(area, name, found_by, lambda bench: bench.fit_rows(change, **options))


def noise(scale, seed=1):
    rng = random.Random(seed)
    return lambda i, old: old + rng.gauss(0, scale)


def walk(step, seed=2):
    rng, at = random.Random(seed), [0.0]

    def value(i, old):
        at[0] += rng.gauss(0, step)
        return old + at[0]
    return value


def held(seconds):
    kept = [0.0]

    def value(i, old):
        if i % seconds == 0:
            kept[0] = old
        return kept[0]
    return value


def flagged(bits, where):
    """A log with a flags column for gx."""
    def inject(bench):
        head = [*bench.head[:-1], bench.head[-1] + ",gx_flags"]
        return bench.fit(bench.with_rows(lambda i, row: [*row, bits if where(i) else 0], head=head))
    return inject


SENSOR = [
    rows("sensor", "axis always 0", "no-noise", put(GX, lambda i, old: 0)),
    rows("sensor", "axis always at one value", "repeated", put(GX, lambda i, old: 123.4)),
    rows("sensor", "axis frozen for 100 s", "repeated", put(GX, lambda i, old: 50, between(4000, 4100))),
    rows("sensor", "axis frozen from the middle on", "repeated", put(GX, lambda i, old: 50, between(4200, 9999))),
    rows("sensor", "axis at its rail's value for the first 75 % of the time", "repeated", put(GX, lambda i, old: 590000, between(0, 6300))),
    rows("sensor", "axis at its rail's value for three of four seconds", "nis", put(GX, lambda i, old: 590000, lambda i: i % 4)),
    Fault("sensor", "axis flagged saturated for 75 % of the time", "saturated", flagged(1, lambda i: i % 4)),
    Fault("sensor", "axis flagged saturated for 2 % of the time", "saturated", flagged(1, lambda i: i % 50 == 0)),
    Fault("sensor", "sensor reports a fault for 5 % of the time", "faulty", flagged(4, lambda i: i % 20 == 0)),
    rows("sensor", "axis missing in half of the rows", "measurements", put(GX, lambda i, old: "", between(3000, 7200))),
    rows("sensor", "noise three times the model's", "nis", put(GX, noise(108))),
    rows("sensor", "noise gone (low-pass at the output)", "no-noise", lambda i, row: [row[T], row[TEMP], float(row[TEMP]) * 5 + i % 7 * 0.1, row[3]]),
    rows("sensor", "slow random walk the model knows nothing of", "slow", put(GX, walk(6))),
    rows("sensor", "step of 1000 dph that stays", "rejects", put(GX, lambda i, old: old + 1000, between(4000, 9999))),
    rows("sensor", "step of 200 dph that stays", "slow", put(GX, lambda i, old: old + 200, between(4000, 9999))),
    rows("sensor", "telegraph noise, 150 dph", "slow", put(GX, lambda i, old: old + (150 if i // 700 % 2 else 0))),
    rows("sensor", "hum of 100 dph with 3 s", "lag1", put(GX, lambda i, old: old + 100 * math.sin(2.1 * i))),
    rows("sensor", "samples held for 3 s", "lag1", put(GX, held(3))),
    rows("sensor", "bump of 20 s, 50,000 dph", "left out", put(GX, lambda i, old: old + 50000, between(4000, 4020))),
    rows("sensor", "bump of 20 s in the first minute", "left out", put(GX, lambda i, old: old + 50000, between(30, 50))),
    rows("sensor", "bump of 20 s as the log begins", "nis", put(GX, lambda i, old: old + 50000, between(0, 20))),
    rows("sensor", "moved for five minutes", "rejects", put(GX, noise(20000, 3), between(4000, 4300))),
    rows("sensor", "single spikes, one in 1000 s", "left out", put(GX, lambda i, old: old + 30000, lambda i: i % 1000 == 500)),
    rows("sensor", "single spikes, one in 30 s", "rejects", put(GX, lambda i, old: old + 30000, lambda i: i % 30 == 15)),
    rows("sensor", "unit mistaken: deg/s in a column of deg/h", "no-noise", put(GX, lambda i, old: old / 3600)),
    rows("sensor", "unit mistaken: rad/s times too much", "nis", put(GX, lambda i, old: old * 57.3)),
    rows("sensor", "hysteresis of 300 dph on the way up", "residual", put(GX, lambda i, old: old + 300 * math.sin(i / 8400 * 12))),
]

THERMOMETER = [
    rows("thermometer", "stuck at one value from the start", "status 3", put(TEMP, lambda i, old: 20)),
    rows("thermometer", "stuck from 20 degC on", "temp-stuck", put(TEMP, lambda i, old: 20, between(3200, 9999))),
    rows("thermometer", "stuck from 40 degC on", "temp-stuck", put(TEMP, lambda i, old: 40, between(5200, 9999))),
    rows("thermometer", "one bad second: 85 degC", "left out", put(TEMP, lambda i, old: 85, between(4000, 4001))),
    rows("thermometer", "one bad second: -40 degC, the first", "left out", put(TEMP, lambda i, old: -40, between(0, 1))),
    rows("thermometer", "one bad second: 85 degC, the last", "left out", put(TEMP, lambda i, old: 85, between(8399, 8400))),
    rows("thermometer", "reads 85 degC for an hour", "temp-jump", put(TEMP, lambda i, old: 85, between(3000, 6600))),
    rows("thermometer", "offset of 8 degC for a while", "temp-jump", put(TEMP, lambda i, old: old + 8, between(4000, 5000))),
    rows("thermometer", "offset of 2 degC for a while", "temp-jump", put(TEMP, lambda i, old: old + 2, between(4000, 5000))),
    rows("thermometer", "spikes, one in 40 s", "temp-spikes", put(TEMP, lambda i, old: old + 30, lambda i: i % 40 == 7)),
    rows("thermometer", "noise of 3 degC", "temp-spikes", put(TEMP, noise(3))),
    rows("thermometer", "in Fahrenheit", "temp-jump", put(TEMP, lambda i, old: old * 1.8 + 32, between(4000, 9999))),
    rows("thermometer", "in Kelvin", "status 3", put(TEMP, lambda i, old: old + 273.15)),
    rows("thermometer", "sign lost below 30 degC", "residual", put(TEMP, lambda i, old: abs(old - 30))),
    rows("thermometer", "empty throughout", "status 3", lambda i, row: [row[T], "", *row[GX:]]),
    rows("thermometer", "1e30", "status 3", put(TEMP, lambda i, old: 1e30, between(100, 101))),
]


def fast_ramp(bench):
    bench.write("fast.json", dict(BASIC, segments=[{"rate_degc_per_min": 0, "duration_s": 3000}, {"rate_degc_per_min": 20, "to_degc": 60},
                                                   {"rate_degc_per_min": 0, "duration_s": 3000}]))
    return bench.fit(bench.simulate("fast.csv", profile="fast.json"))


def short(bench):
    return bench.fit(bench.with_rows(lambda i, row: row if i % 40 == 0 else None, name="short.csv"), "--order", 5)


THERMOMETER += [Fault("thermometer", "ramp of 20 degC/min", "temp-ramp", fast_ramp)]

CLOCK = [
    rows("clock", "jump to Unix time", "status 3", put(T, lambda i, old: old + 1732190000, between(4000, 9999))),
    rows("clock", "set back by an hour", "status 3", put(T, lambda i, old: old - 3600, between(5000, 9999))),
    rows("clock", "one sample an hour ahead", "status 3", put(T, lambda i, old: old + 3600, between(4000, 4001))),
    rows("clock", "wraps at 4096 s", "status 3", put(T, lambda i, old: old % 4096)),
    rows("clock", "stands for ten seconds", "status 3", put(T, lambda i, old: 4000, between(4000, 4010))),
    rows("clock", "irregular steps", "status 3", put(T, lambda i, old: old + (i * i * 7 % 10) / 11)),
    rows("clock", "in milliseconds", "status 3", put(T, lambda i, old: old * 1e6)),
    rows("clock", "not a number", "status 3", put(T, lambda i, old: "nan", between(100, 101))),
]


def other_model(**changes):
    def inject(bench):
        return bench.fit("healthy.csv", model=bench.write("other.json", {**MODEL, **changes}))
    return inject


def short_markov(bench):
    return bench.fit("healthy.csv", model=bench.write("other.json", {**MODEL, "markov": [{"sigma_dph": 5, "tau_s": 20}]}))


MODELS = [
    Fault("model", "ARW of a tenth", "nis", other_model(arw_deg_rt_h=0.06)),
    Fault("model", "ARW of half", "nis", other_model(arw_deg_rt_h=0.3)),
    Fault("model", "ARW of ten times", "nis", other_model(arw_deg_rt_h=6)),
    Fault("model", "no instability at all", "slow", other_model(markov=[])),
    Fault("model", "instability of a quarter, five times shorter", "slow", short_markov),
    Fault("model", "no white noise (ARW 0)", "status 3", other_model(arw_deg_rt_h=0)),
    Fault("model", "ARW missing", "status 3", lambda b: b.fit("healthy.csv", model=b.write("m.json", {"imucal_model": 1}))),
    Fault("model", "key misspelt: markow", "status 3", other_model(markow=[])),
    Fault("model", "key given twice", "status 3",
          lambda b: b.fit("healthy.csv", model=b.write("m.json", '{"imucal_model": 1, "arw_deg_rt_h": 0.6, "arw_deg_rt_h": 6}'))),
    Fault("model", "number beyond double", "status 3",
          lambda b: b.fit("healthy.csv", model=b.write("m.json", '{"imucal_model": 1, "arw_deg_rt_h": 1e999}'))),
    Fault("model", "range of another device: 200 .. 300 degC", "status 3",
          other_model(bias=dict(MODEL["bias"], t0_degc=250))),
    Fault("model", "version of tomorrow", "status 3", other_model(imucal_model=2)),
]


def in_bytes(change, name="sick.csv"):
    def inject(bench):
        (bench.folder / name).write_bytes(change((bench.folder / "healthy.csv").read_bytes()))
        return bench.fit(name)
    return inject


def full_disk(bench):
    result = bench.run("calibrate", "fit", "healthy.csv", "--model", "model.json", "-o", "/dev/full", "-q")
    return bench.outcome(result, bench.folder / "none")


def folder_as_output(bench):
    (bench.folder / "a_folder").mkdir(exist_ok=True)
    result = bench.run("calibrate", "fit", "healthy.csv", "--model", "model.json", "-o", "a_folder", "-q")
    return bench.outcome(result, bench.folder / "none")


def full_standard_output(bench):
    with open("/dev/full", "w") as full:
        result = bench.run("calibrate", "fit", "healthy.csv", "--model", "model.json", "--json", "-", stdout=full)
    return bench.outcome(result, bench.folder / "none")


def packed(data):
    return gzip.compress(data)


FILES = [
    Fault("files", "log cut in the middle of a row", "noted", in_bytes(lambda d: d[:d.rindex(b"\n", 0, -1) + 7])),
    Fault("files", "log cut inside its last number", "noted", in_bytes(lambda d: d[:-3])),
    Fault("files", "log cut inside its first number after the header", "status 3", in_bytes(lambda d: d[:d.index(b"\n", d.index(b"t_s")) + 2])),
    Fault("files", "gzip cut", "status 3", in_bytes(lambda d: packed(d)[:-5000])),
    Fault("files", "gzip damaged", "status 3", in_bytes(lambda d: packed(d)[:3000] + bytes(60) + packed(d)[3060:])),
    Fault("files", "UTF-16", "status 3", in_bytes(lambda d: d.decode().encode("utf-16"))),
    Fault("files", "binary", "status 3", in_bytes(lambda d: bytes(range(256)) * 50)),
    Fault("files", "empty", "status 3", in_bytes(lambda d: b"")),
    Fault("files", "header without rows", "status 3", lambda b: b.fit(b.write("sick.csv", "\n".join(b.head) + "\n"))),
    Fault("files", "decimal commas", "status 3", in_bytes(lambda d: d.replace(b".", b","))),
    Fault("files", "a word in a row", "status 3", rows("", "", "", put(GX, lambda i, old: "warm", between(99, 100))).inject),
    Fault("files", "escape sequence in a column's name", "status 3", in_bytes(lambda d: d.replace(b"gx_dph", b"\x1b[31mx_dph"))),
    Fault("files", "column given twice", "status 3", in_bytes(lambda d: d.replace(b"gy_dph", b"gx_dph"))),
    Fault("files", "absent", "status 3", lambda b: b.fit("absent.csv")),
    Fault("files", "disk full", "status 3", full_disk),
    Fault("files", "a folder as output", "status 3", folder_as_output),
    Fault("files", "standard output full", "status 3", full_standard_output),
]


def two_devices(bench):
    other = bench.simulate("other.csv", "--axes", 2, seed=2)
    return bench.fit("healthy.csv", other)


def other_device_name(bench):
    head = [line.replace("device =", "device = another ") for line in bench.head]
    return bench.fit("healthy.csv", bench.with_rows(lambda i, row: row, name="other.csv", head=head))


def no_model(bench):
    return bench.outcome(bench.run("calibrate", "fit", "healthy.csv", "-o", "table.json"), bench.folder / "none")


OPERATORS = [
    Fault("operator", "logs of two serial numbers", "status 3", two_devices),
    Fault("operator", "logs of two kinds of device", "status 3", other_device_name),
    Fault("operator", "span hardly covered: 0 .. 20 of 0 .. 60", "span", lambda b: b.fit(b.with_rows(lambda i, row: row if i < 3200 else None), "--range", "0:60")),
    Fault("operator", "every fortieth second taken for a mean of 40 s", "nis", short),
    Fault("operator", "no model for the filter", "status 2", no_model),
    Fault("operator", "axis that is not there", "status 3", lambda b: b.fit("healthy.csv", "--axis", "gq_dph")),
    Fault("operator", "order 6", "status 2", lambda b: b.fit("healthy.csv", "--order", "6")),
    Fault("operator", "range reversed", "status 2", lambda b: b.fit("healthy.csv", "--range", "60:0")),
    Fault("operator", "rule to accept misspelt", "status 2", lambda b: b.fit("healthy.csv", "--accept", "nsi")),
    Fault("operator", "serial with a blank", "status 3", lambda b: b.fit("healthy.csv", "--serial", "two words")),
    Fault("operator", "predicted error above what is allowed", "error", lambda b: b.fit("healthy.csv", "--max-error", "5")),
    Fault("operator", "accepts one of two reasons", "slow", lambda b: b.fit("healthy.csv", "--accept", "nis", model=b.write("o.json", {**MODEL, "arw_deg_rt_h": 0.06, "markov": []}))),
]

FAULTS = SENSOR + THERMOMETER + CLOCK + MODELS + FILES + OPERATORS
