# SPDX-License-Identifier: MIT
"""Errors of the package: what happened, where, what to do; and the exit status of the command line."""


class ImucalError(Exception):
    """Base of all errors; ``exit_status`` is what the command line ends with."""

    exit_status = 3


class UsageError(ImucalError):
    """The command line, or an argument, is wrong."""

    exit_status = 2


class DataError(ImucalError):
    """A file or an array cannot be used; the message names the place and the remedy."""

    exit_status = 3


class DataWarning(UserWarning):
    """What the user should know of a file though it can be used; the message names the place and the remedy."""
