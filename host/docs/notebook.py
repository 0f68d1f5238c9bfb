# SPDX-License-Identifier: MIT
# %% [markdown]
# # From an array to a diagnosis
#
# A notebook in the percent format: editors open it cell by cell, `python notebook.py` runs it whole. Rates are in degrees
# per hour (dph), temperatures in degC, times in s. The numbers below are those of the run that made this page.

# %%
import os

import numpy as np

import imucal

# Seconds of soak before and after each ramp, and degC per minute: the test of this page is shorter than a real one.
SOAK_S = int(os.environ.get("NOTEBOOK_SOAK_S", "900"))
RATE_DEGC_PER_MIN = float(os.environ.get("NOTEBOOK_RATE", "1.0"))

# %% [markdown]
# ## 1. Arrays
#
# Your arrays would stand here: 1-s means of the rate of one axis at rest, and the temperature. A simulated sensor with a
# fault stands in, which we do not look at before the end: its bias goes round a loop when the temperature rises and falls.

# %%
believed = {"imucal_model": 1, "arw_deg_rt_h": 0.6, "markov": [{"sigma_dph": 20, "tau_s": 100}],
            "bias": {"t0_degc": 30, "range_degc": 30, "coeff_dph": [80, 300, 150, -100]}}
chamber = {"imucal_profile": 1, "start_degc": 0, "segments": [
    {"rate_degc_per_min": 0, "duration_s": SOAK_S}, {"rate_degc_per_min": RATE_DEGC_PER_MIN, "to_degc": 60},
    {"rate_degc_per_min": 0, "duration_s": SOAK_S}, {"rate_degc_per_min": -RATE_DEGC_PER_MIN, "to_degc": 0}]}
fault = [{"name": "thermal_hysteresis", "parameters": {"amplitude_dph": 60, "width_degc": 10}}]
runs = [imucal.simulate(believed, chamber, seed=4, effects=fault, log_index=i, n_logs=3) for i in range(3)]
rate_dph, temp_degc = runs[0].rates["gx_dph"], runs[0].temp_degc
print(f"{len(rate_dph)} s, {temp_degc.min():.0f} to {temp_degc.max():.0f} degC, mean {rate_dph.mean():.0f} dph")

# %% [markdown]
# ## 2. Allan deviation
#
# At one second it is the white noise: 60 dph for each deg/sqrt(h) of angle random walk. At long times the thermal bias
# drives it up.

# %%
allan = imucal.allan_deviation(rate_dph)
for tau_s, adev_dph, (low, high) in zip(allan.tau_s, allan.adev_dph, allan.ci95_dph):
    print(f"{tau_s:6.0f} s  {adev_dph:7.2f} dph  ({low:.2f} to {high:.2f})")

# %% [markdown]
# ## 3. Error model
#
# Maximum likelihood, with the thermal polynomial taken out: angle random walk, and a bounded (Gauss-Markov) instability.

# %%
log = imucal.as_log(rate_dph, temp_degc)
noise = imucal.fit_error_model(log, markov=1, criterion="ml", detrend="poly:3")
arw_deg_rt_h = noise.model["arw_deg_rt_h"]
print(f"ARW {arw_deg_rt_h:.3f} +- {noise.std_errors['arw_deg_rt_h']:.3f} deg/sqrt(h)")
print(f"instability {noise.model['markov'][0]['sigma_dph']:.1f} dph with {noise.model['markov'][0]['tau_s']:.0f} s")

# %% [markdown]
# ## 4. Calibrate and compensate
#
# The filter is the C core's own, second by second: on the device the same numbers give the same bits.

# %%
core = imucal.ThermalCalibrator(order=3, t0_degc=30, range_degc=30, arw_deg_rt_h=0.6, sigma_dph=20, tau_s=100)
core.run(rate_dph, temp_degc)
print("B(T) coefficients, dph:", np.round(core.coeff_dph, 1))
print(f"predicted error at 25 degC: {core.bias_sigma_dph(25.0):.1f} dph; innovations: mean square {core.mean_nis:.2f}, should be 1")
left_dph = rate_dph - core.bias_dph(temp_degc)
print(f"rms before {rate_dph.std():.0f} dph, after {left_dph.std():.0f} dph (white noise alone: {60 * arw_deg_rt_h:.0f})")

# %% [markdown]
# ## 5. Diagnosis
#
# What does the believed model leave out? Two runs to find it, the third, held out, to judge.

# %%
diagnosis = imucal.diagnose(runs[:2], believed, holdout=runs[2:], threads=1)
axis = diagnosis["axes"][0]
best = (axis.get("effects") or [{}])[0]
print(f"{axis['statement']}: {(axis.get('where') or {}).get('sentence', 'nowhere')}")
print("effect:", best.get("name"), {k: round(v, 1) for k, v in best.get("parameters", {}).items() if isinstance(v, float)})

# %% [markdown]
# What was put in:

# %%
print(fault[0]["name"], fault[0]["parameters"])
