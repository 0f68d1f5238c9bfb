# SPDX-License-Identifier: MIT
"""Blind check of `diagnose`: draws labelled cases, hides the labels, runs the binary, scores it.

Written from the contract alone (host/formats.md): nothing here shares code with the engine.
"""
