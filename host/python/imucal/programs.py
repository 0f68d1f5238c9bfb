# SPDX-License-Identifier: MIT
"""The programs behind the package: found, fed and read through their JSON contracts.  A program runs in its own process:
the interpreter is free meanwhile, and Ctrl-C ends it."""
import json
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from .errors import DataError, ImucalError, UsageError


def find(name):
    """Path of a program: $IMUCAL_BIN, the build folder beside a source tree, libexec, PATH."""
    here = Path(__file__).resolve()
    given = os.environ.get("IMUCAL_BIN")
    folders = [given, given and Path(given).parent / "libexec/imucal", here.parents[3] / "build/bin"]
    folders += [here.parents[4] / "libexec/imucal"] if len(here.parents) > 4 else []
    for folder in filter(None, folders):
        if os.access(Path(folder) / name, os.X_OK):
            return str(Path(folder) / name)
    found = shutil.which(name)
    if not found:
        raise DataError(f"the program {name} is not found: build it (make host) and set IMUCAL_BIN to its folder, or install imucal (make install)")
    return found


def run(name, *arguments, negative_is_answer=False):
    """Run a program with --json -; its result as a dict.

    Raises
    ------
    UsageError, DataError : with the program's own message
    """
    command = [find(name), *map(str, arguments), "--json", "-"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        out, err = process.communicate()
    except BaseException:
        process.terminate()
        process.communicate()
        raise
    if process.returncode == 0 or (process.returncode == 1 and (negative_is_answer or out)):
        return json.loads(out) if out.strip() else {}
    message = err.strip().splitlines()[-1] if err.strip() else f"exit {process.returncode}"
    kind = {2: UsageError, 3: DataError}.get(process.returncode, ImucalError)
    raise kind(message.partition(": ")[2] or message)


def model_text(value):
    """JSON of a dict, or of what has to_json; DataError: a number that JSON has not."""
    try:
        return json.dumps(value.to_json() if hasattr(value, "to_json") else value, allow_nan=False)
    except ValueError:
        raise DataError("a dict with NaN or an infinity in it: no file can hold it, and no program reads it; give numbers, or leave the member out") from None


class Folder:
    """A temporary folder whose files are models, profiles and logs given as objects or as paths."""

    def __init__(self):
        self._folder = tempfile.TemporaryDirectory(prefix="imucal-")
        self._n = 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._folder.cleanup()

    def new(self, suffix):
        """A name for a file."""
        self._n += 1
        return os.path.join(self._folder.name, f"{self._n}{suffix}")

    def json(self, value):
        """A path: the one given, or a file that holds the dict (or what has to_json)."""
        if isinstance(value, (str, os.PathLike)):
            return os.fspath(value)
        path = self.new(".json")
        with open(path, "w", encoding="utf-8") as file:
            file.write(model_text(value))
        return path

    def log(self, value):
        """A path: the one given, or a file that holds the Log."""
        if isinstance(value, (str, os.PathLike)):
            return os.fspath(value)
        from .log import write_log
        path = self.new(".csv")
        write_log(path, value)
        return path
