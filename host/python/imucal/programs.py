# SPDX-License-Identifier: MIT
"""The programs behind the package: found, fed and read through their JSON contracts.  A program runs in its own process:
the interpreter is free meanwhile, and Ctrl-C ends it."""
import json
import os
import shutil
import subprocess
import tempfile
import warnings
from pathlib import Path

from .errors import DataError, DataWarning, ImucalError, UsageError

#: how a line on standard error begins that is no answer and no error
_REMARKS = ("note: ", "warning: ", "accepted: ")


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


def _without_name(line):
    """What a program says, without its own name before it."""
    return line.partition(": ")[2] or line


def run(name, *arguments, negative_is_answer=False, said=str, stacklevel=3):
    """Run a program with --json -; its result as a dict.  What it tells beside the result ("note: ...", "accepted: ...") is a DataWarning.

    Parameters
    ----------
    said : function              what the program writes, JSON too -> the same in the caller's words
    stacklevel : int             the call that a warning is about: 2 is the caller of this function

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
    told = [said(_without_name(line)) for line in err.splitlines() if line.strip()]
    is_done = process.returncode == 0 or (process.returncode == 1 and negative_is_answer)
    for text in told:
        if is_done or text.startswith(_REMARKS):
            warnings.warn(text, DataWarning, stacklevel=stacklevel)
    if is_done or (process.returncode == 1 and out):
        return json.loads(said(out)) if out.strip() else {}
    kind = {2: UsageError, 3: DataError}.get(process.returncode, ImucalError)
    raise kind(told[-1] if told else f"exit {process.returncode}")


def _of_numpy(value):
    """A number or array of numpy as JSON knows it; DataError: a value of another kind."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise DataError(f"a dict with a {type(value).__name__} in it, which JSON has not; give numbers, texts, lists and dicts")


def model_text(value):
    """JSON of a dict; DataError: a value that JSON has not."""
    try:
        return json.dumps(value, allow_nan=False, default=_of_numpy)
    except ValueError:
        raise DataError("a dict with NaN or an infinity in it: no file can hold it, and no program reads it; give numbers, or leave the member out") from None


class Folder:
    """A temporary folder: models, profiles and logs that are given as objects become files in it.  Its files are unknown to the
    user, so a message about one of them is told of the object."""

    def __init__(self):
        self._folder = tempfile.TemporaryDirectory(prefix="imucal-")
        self._n = 0
        self._called = {}

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._folder.cleanup()

    def new(self, suffix, called=None):
        """A name for a file, and what the user calls it."""
        self._n += 1
        path = os.path.join(self._folder.name, f"{self._n}{suffix}")
        self._called[path] = called or f"the file {self._n}{suffix} between package and program"
        return path

    def json(self, value, called="the dict given"):
        """A path: the one given, or a file that holds the dict."""
        if isinstance(value, (str, os.PathLike)):
            return os.fspath(value)
        path = self.new(".json", called)
        with open(path, "w", encoding="utf-8") as file:
            file.write(model_text(value))
        return path

    def log(self, value):
        """A path: the one given, or a file that holds the Log."""
        if isinstance(value, (str, os.PathLike)):
            return os.fspath(value)
        from .log import write_log
        path = self.new(".csv", value.path or "the log given")
        write_log(path, value)
        return path

    def said(self, text):
        """A message about files of this folder as one about what they were made of."""
        for path, called in self._called.items():
            text = text.replace(path, json.dumps(called, ensure_ascii=False)[1:-1])
        return text

    def run(self, name, *arguments, negative_is_answer=False):
        """The function run of this module, for the caller of a public function of the package: warnings point at that call."""
        return run(name, *arguments, negative_is_answer=negative_is_answer, said=self.said, stacklevel=4)
