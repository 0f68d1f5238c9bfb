# SPDX-License-Identifier: MIT
"""Input as the programs take it: a file, plain or gzip, or standard input ("-").  Readers want a plain file with a name: a packed or
piped one is copied into a folder of its own for the time it is read, and errors and warnings name what the user gave."""
import contextlib
import gzip
import os
import shutil
import sys
import tempfile
import warnings
import zlib

from .errors import DataError, ImucalError

#: said of a text whose lines no program here ends
CR_ENDS = "the lines end in CR alone, as on old Macs; save it with the line ends of Unix or Windows"
_MARKS = {b"\xff\xfe\0\0": "UTF-32", b"\0\0\xfe\xff": "UTF-32", b"\xff\xfe": "UTF-16", b"\xfe\xff": "UTF-16"}
_TEXT = frozenset(b"\t\r\n" + bytes(range(32, 127)))
_GZIP = b"\x1f\x8b"


class Input:
    """A plain file to read (os.fspath), what the user calls it, and the bytes as they were given."""

    def __init__(self, path, name=None, given=None):
        self.path, self.name, self.given = path, name or path, given or path

    def __fspath__(self):
        return self.path

    @property
    def base(self):
        """The last part of the user's name."""
        return os.path.basename(os.path.normpath(self.name))

    @property
    def stem(self):
        """The same without what tells the format, for the name of a result."""
        return os.path.splitext(os.path.basename(os.path.normpath(self.path)))[0]

    def said(self, text):
        """A message about the plain file as one about the user's."""
        return text if self.path == self.name else text.replace(self.path, self.name)


def not_utf8(path, otherwise):
    """Why a file is no text in UTF-8: JSON with its line, and of what is no text `otherwise`."""
    with open(path, "rb") as file:
        raw = file.read()
    if coding := other_coding(raw[:4096]):
        return f"{path}: {coding}"
    try:
        raw.decode()
    except UnicodeDecodeError as error:
        if raw.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] in (b"{", b"["):
            line = 1 + raw.count(b"\n", 0, error.start)
            return f"{path}:{line}: the byte \\x{raw[error.start]:02x} is no UTF-8; save the file as UTF-8"
    return f"{path}: {otherwise}"


def other_coding(head, only_marks=False):
    """What to say of a file that begins with these bytes, of UTF-16 or UTF-32 with or without their marks; None of another."""
    name = next((name for mark, name in _MARKS.items() if head.startswith(mark)), None)
    for name_without, width in () if name or only_marks else (("UTF-32", 4), ("UTF-16", 2)):
        for at in (0, width - 1):  # of a character's byte that is not zero, in one order and in the other
            letters, others = head[at::width], [head[i::width] for i in range(width) if i != at]
            if len(head) >= 4 * width and _TEXT.issuperset(letters) and not any(any(zeros) for zeros in others):
                name = name or name_without
    return name and f"the file is {name}; save it as UTF-8"


def ends_in_cr(text):
    """Are most line ends CR without LF?"""
    return text.count("\r") - text.count("\r\n") > text.count("\n")


def _is_gzip(path):
    if not os.path.isfile(path):
        return False
    try:
        with open(path, "rb") as file:
            return file.read(2) == _GZIP
    except OSError:  # the reader says why
        return False


def _unpack(given, to, name):
    try:
        with gzip.open(given, "rb") as packed, open(to, "wb") as plain:
            shutil.copyfileobj(packed, plain, 1 << 20)
    except EOFError:
        raise DataError(f"{name}: cannot be read: the gzip data end too early; copy the file again") from None
    except (zlib.error, gzip.BadGzipFile):
        raise DataError(f"{name}: cannot be read: the gzip data are damaged; copy the file again") from None


def _copy(path, folder):
    """An Input of a plain copy."""
    name, given = path, path
    if path == "-":
        name, given = "standard input", os.path.join(folder, "given")
        with open(given, "wb") as file:
            shutil.copyfileobj(sys.stdin.buffer, file, 1 << 20)
        if not _is_gzip(given):
            plain = os.path.join(folder, "standard_input")
            os.rename(given, plain)
            return Input(plain, name)
    base = "standard_input" if path == "-" else os.path.basename(path)
    plain = os.path.join(folder, base[:-3] if base.endswith(".gz") else base)
    _unpack(given, plain, name)
    return Input(plain, name, given)


@contextlib.contextmanager
def plain_file(path):
    """The Input of a path, or of an Input, while the context lasts.

    Raises
    ------
    DataError : gzip that is damaged or cut short
    """
    if isinstance(path, Input):
        yield path
        return
    path = os.fspath(path)
    if path != "-" and not _is_gzip(path):
        yield Input(path)
        return
    with tempfile.TemporaryDirectory(prefix="imucal-") as folder:
        source = _copy(path, folder)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                yield source
            except ImucalError as error:
                raise type(error)(source.said(str(error))) from None
            finally:
                said = [type(w.message)(source.said(str(w.message))) for w in caught]
        for message in said:
            warnings.warn(message, stacklevel=4)
