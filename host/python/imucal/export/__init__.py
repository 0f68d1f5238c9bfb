# SPDX-License-Identifier: MIT
"""Tables and models in other programs' formats.  Each writer returns (text, notes): notes say what the target cannot hold."""
