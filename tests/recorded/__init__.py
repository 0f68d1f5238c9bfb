# SPDX-License-Identifier: MIT
"""Recorded logs as a regression of `diagnose`: what an expert sees in them against what the program says."""
