# SPDX-License-Identifier: MIT
"""``python -m imucal SUBCOMMAND``: what `imucal SUBCOMMAND` starts."""
import importlib
import os
import sys
import warnings

COMMANDS = {"import": "import_command", "export": "export_command", "look": "look", "plot": "plot_command", "check": "check",
            "example": "example", "report": "report"}


def main(arguments=None):
    """Run one subcommand; returns the exit status."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if not arguments or arguments[0] not in COMMANDS:
        print(f"imucal: expected one of {', '.join(COMMANDS)} (try imucal --help)", file=sys.stderr)
        return 2
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the matrices here are small: threads only cost
    from .errors import DataWarning, ImucalError
    warnings.simplefilter("ignore")  # a library's words name neither file nor remedy
    warnings.simplefilter("always", DataWarning)
    warnings.showwarning = lambda message, *_: print(f"imucal {arguments[0]}: note: {message}", file=sys.stderr)
    try:
        return importlib.import_module(f".{COMMANDS[arguments[0]]}", __package__).run(arguments[1:])
    except ImucalError as error:
        print(f"imucal {arguments[0]}: {error}", file=sys.stderr)
        return error.exit_status
    except BrokenPipeError:
        return 0
    except KeyboardInterrupt:
        return 130  # Exit::kInterrupted


if __name__ == "__main__":
    sys.exit(main())
