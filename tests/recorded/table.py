# SPDX-License-Identifier: MIT
"""What must be said of each recorded log, and what must not.  Written from the plots and the notes beside the logs, not
from answers of the program.  Where an expert cannot tell, neither may the program.

A row holds for every believed noise of its log.  `must`: each group needs one of its names (or families) among the names or
their sets.  `must_not`: none of these may be given as a name.  `open_between`: these families must be named together as what
the log cannot tell apart.  `invariant`: the first repeatable cause is the same under all believed noises.
"""
from __future__ import annotations

from dataclasses import dataclass

BELIEVED = ((20.0, 100.0), (50.0, 300.0), (100.0, 1000.0), (200.0, 2000.0))  # sigma_dph, tau_s

MEMORY = ("thermal_memory", "thermal_hysteresis", "thermal_lag", "thermal_creep")
OF_TEMPERATURE = ("function_of_temperature", "thermal_anomaly", "thermal_step", "higher_order_polynomial")
NEEDS_TEMPERATURE = MEMORY + OF_TEMPERATURE + (
    "temperature_rate", "temperature_sensor_quantization", "white_noise_vs_temperature", "markov_sigma_vs_temperature",
    "markov_tau_vs_temperature")
SLOW = ("slow_noise", "second_markov", "rate_random_walk", "flicker_noise", "noise_parameters", "markov_sigma_vs_temperature",
        "markov_tau_vs_temperature", "telegraph_noise")
DRIFT = SLOW + ("function_of_time", "rate_ramp", "warm_up", "bias_step", "run_to_run")


@dataclass(frozen=True)
class Row:
    """One expectation about one axis of one set of logs."""

    row: str
    logs: tuple
    axis: str
    sees: str  # what an expert sees
    must: tuple = ()
    must_not: tuple = ()
    open_between: tuple = ()
    first: tuple = ()  # the first name given, but for re-tuned noise, is one of these
    invariant: bool = False
    gap: bool = False  # no_gap is wrong
    honest: bool = False  # no shrinkage claimed beside a residual that does not shrink by it
    order: int = 3


CHAMBER = ("chamber.csv",)
CATS = ("cats_p1.csv", "cats_p2.csv")
ADIS = ("adis16405_imu1.csv", "adis16405_imu2.csv", "adis16405_imu3.csv")

ROWS = (
    Row("gx-loop", CHAMBER, "gx_dph", "a closed loop of +-1000 dph, branches apart on every leg: hysteresis or another thermal memory",
        must=(MEMORY,), must_not=("temperature_rate",), gap=True),
    Row("gx-jumps", CHAMBER, "gx_dph", "two jumps in the cold (735 s and 1025 s): steps", must=(("bias_step", "thermal_step"),), gap=True),
    Row("gx-noise", CHAMBER, "gx_dph", "nothing that speaks for telegraph noise, for noise that follows temperature, or for a tone",
        must_not=("telegraph_noise", "markov_tau_vs_temperature", "markov_sigma_vs_temperature", "sinusoid", "dead_band", "saturation")),
    Row("gx-invariant", CHAMBER, "gx_dph", "the same cause whatever noise is believed", invariant=True, gap=True),
    Row("gx-honest", CHAMBER, "gx_dph", "no shrinkage beyond what the held-out residual shows", honest=True),
    Row("gy-open", CHAMBER, "gy_dph", "a loop of 200 to 570 dph, or slow noise of 350 dph: this log cannot tell",
        first=("slow_noise", "thermal_memory"), open_between=("thermal_memory", "slow_noise"), gap=True),
    Row("gy-not", CHAMBER, "gy_dph", "no ground for one slow-noise member, for noise that follows temperature, or for telegraph noise",
        must_not=("markov_tau_vs_temperature", "markov_sigma_vs_temperature", "telegraph_noise", "flicker_noise", "rate_random_walk",
                  "second_markov", "bias_step", "thermal_anomaly", "sinusoid")),
    Row("gy-invariant", CHAMBER, "gy_dph", "the same answer whatever noise is believed", invariant=True),
    Row("gy-honest", CHAMBER, "gy_dph", "no shrinkage beyond what the held-out residual shows", honest=True),
    *(Row(f"cats-{a[:2]}", CATS, a, "excursions of hundreds of dph below 10 degC that do not repeat from log to log: no function of "
          "temperature; white to beyond 100 s", must_not=OF_TEMPERATURE + ("sinusoid", "dead_band", "saturation", "held_samples"), gap=True)
      for a in ("gx_dph", "gy_dph", "gz_dph")),
    *(Row(f"cats-{a[:2]}-honest", CATS, a, "no shrinkage beyond what the held-out residual shows", honest=True) for a in ("gx_dph", "gz_dph")),
    *(Row(f"adis-{a[:2]}", ADIS, a, "no temperature in the log; slow drift of 100 to 250 dph within a run, cause unrecorded", must=(DRIFT,),
          must_not=NEEDS_TEMPERATURE + ("auxiliary_channel", "dead_band", "saturation"), gap=True) for a in ("gy_dph", "gz_dph")),
    Row("adis-gx", ADIS, "gx_dph", "no temperature in the log: nothing that needs one", must_not=NEEDS_TEMPERATURE + ("dead_band", "saturation")),
)

# Rows that stand as a regression: tests/system/test_recorded.py asserts these where IMUCAL_RECORDED=1 is set.  Add a row when the engine
# passes it; never take one out.
MUST_HOLD = ("gx-loop", "gx-jumps", "gx-noise", "gx-invariant", "gx-honest", "gy-open", "gy-not", "gy-invariant", "gy-honest")
