# SPDX-License-Identifier: MIT
"""The model and the profile that the documentation's figures use (reference figures A, tests/README.md), and shorter tests.

For reading: a test that needs another one makes a copy, {**MODEL, ...}."""
COEFF_DPH = [80, 300, 150, -100]
NOISE = {"imucal_model": 1, "arw_deg_rt_h": 0.6, "markov": [{"sigma_dph": 20, "tau_s": 100}]}
MODEL = {**NOISE, "bias": {"t0_degc": 30, "range_degc": 30, "coeff_dph": COEFF_DPH}}
DRIFTING = {**MODEL, "turn_on_sigma_dph": 50}  # another constant in every log


def soaked_ramp(soak_s, rate_degc_per_min=0.6):
    """0 to 60 degC, with a soak of this length at both ends."""
    soak = {"rate_degc_per_min": 0, "duration_s": soak_s}
    return {"imucal_profile": 1, "start_degc": 0, "segments": [soak, {"rate_degc_per_min": rate_degc_per_min, "to_degc": 60}, soak]}


BASIC = soaked_ramp(1200)  # 140 min
QUICK = soaked_ramp(60, 6)  # for tests that need only some table
RESTING = {"imucal_profile": 1, "start_degc": 25, "segments": [{"rate_degc_per_min": 0, "duration_s": 1200}]}
