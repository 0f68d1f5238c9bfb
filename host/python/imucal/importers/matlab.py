# SPDX-License-Identifier: MIT
"""MATLAB .mat: up to version 7.2 by scipy, 7.3 (HDF5) by h5py.  Named arrays, matrices of three columns, and structs
(a timetable exported with timetable2table and table2struct(…, 'ToScalar', true)) become columns."""
import dataclasses

import numpy as np

from ..errors import DataError
from . import cause, need
from .named import stream_of


class _Opaque:
    """A MATLAB object (timetable, table, duration, string …): only MATLAB can read it."""

    def __init__(self, class_name):
        self.class_name = class_name


def _flatten(name, value, into):
    """Numbers under their whole names ("log.gyro" is field gyro of struct log); a matrix n x 3 as three columns."""
    if hasattr(value, "_fieldnames"):
        for field in value._fieldnames:
            _flatten(f"{name}.{field}", getattr(value, field), into)
    elif isinstance(value, dict):
        for field, inner in value.items():
            _flatten(f"{name}.{field}", inner, into)
    elif type(value).__name__ == "MatlabOpaque":
        class_name = value.flat[0]["s2"] if value.size else b"object"
        into[name] = _Opaque(class_name.decode(errors="replace") if isinstance(class_name, bytes) else str(class_name))
    elif isinstance(value, _Opaque):
        into[name] = value
    elif isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and value.size > 1:
        _add_array(name, value, into)
    elif np.isscalar(value) and np.isreal(value):
        into[name] = np.asarray([value])


def _short(name):
    return name.rpartition(".")[2]


def _short_names(columns):
    """Columns under the last part of their names, where that is no other's too; and {whole name: name}."""
    lasts = [_short(name) for name in columns]
    names = {name: last if lasts.count(last) == 1 else name for name, last in zip(columns, lasts)}
    return {names[name]: values for name, values in columns.items()}, names


def _use_names(options, names):
    """Options that name a struct's field ("log.gyro"), or a matrix of three columns."""
    known = set(names.values())
    for option in ("gyro", "accel", "temp", "time"):
        text = getattr(options, option)
        if not text:
            continue
        tail = ""
        if option == "time" and ":" in text and text not in names and text not in known:
            text, _, tail = text.partition(":")
        words = [names.get(word.strip(), word.strip()) for word in text.split(",")]
        if option in ("gyro", "accel") and len(words) == 1 and words[0] not in known:
            thrice = [names.get(f"{text}_{axis}", f"{words[0]}_{axis}") for axis in "xyz"]
            words = thrice if known.issuperset(thrice) else words
        setattr(options, option, ",".join(words) + (f":{tail}" if tail else ""))


def _add_array(name, array, into):
    array = np.squeeze(array)
    if array.ndim == 1:
        into[name] = array
    elif array.ndim == 2 and 3 in array.shape:
        columns = array if array.shape[1] == 3 else array.T
        for i, axis in enumerate("xyz"):
            into[f"{name}_{axis}"] = np.ascontiguousarray(columns[:, i])


def _read_hdf5(path):
    h5py = need("h5py", "h5py", path, "a MATLAB 7.3 file")

    def walk(group):
        return {k: leaf(v) for k, v in group.items() if not k.startswith("#")}

    def leaf(value):
        if "MATLAB_object_decode" in value.attrs:
            name = value.attrs.get("MATLAB_class", b"object")
            return _Opaque(name.decode() if isinstance(name, bytes) else str(name))
        return walk(value) if isinstance(value, h5py.Group) else value[()].T

    with h5py.File(path, "r") as file:
        return walk(file)


def _name_of_opaque(value):
    name = value.flat[0]["s0"] if getattr(value, "size", 0) else b"T"
    return name.decode(errors="replace") if isinstance(name, bytes) else str(name)


_EXPORT = ("s = table2struct(timetable2table({name}), 'ToScalar', true); s.{time} = seconds(s.{time} - s.{time}(1)); "
           "save('log.mat', 's', '-v7')")


def _no_arrays(path, found):
    objects = {k: v.class_name for k, v in found.items() if isinstance(v, _Opaque)}
    if objects:
        name, what = next(iter(objects.items()))
        return DataError(f"{path}: {name} is a MATLAB {what}: an object that only MATLAB can read. Export it in MATLAB as numbers: "
                         + _EXPORT.format(name=name, time="Time"))
    return DataError(f"{path}: a MATLAB file without numeric arrays (it holds: {', '.join(found) or 'nothing that can be read'}; tables and "
                     "timetables are opaque outside MATLAB: " + _EXPORT.format(name="T", time="Time") + ")")


def _read(path):
    with open(path, "rb") as file:
        head = file.read(1024)
    try:
        if head.startswith(b"\x89HDF") or b"MATLAB 7.3" in head[:128]:
            return _read_hdf5(path)
        loadmat = need("scipy.io", "scipy", path, "a MATLAB file").loadmat
        found = loadmat(path, squeeze_me=True, struct_as_record=False)
        # An object has no name of its own in the file: its description names it.
        return {_name_of_opaque(v) if type(v).__name__ == "MatlabOpaque" else k: v for k, v in found.items() if not str(k).startswith("__")}
    except DataError:
        raise
    except Exception as error:
        raise DataError(f"{path}: a MATLAB file that cannot be read ({cause(error)}); save it again with save -v7") from None


def streams(path, options):
    """One stream of the longest set of arrays of equal length."""
    found = {}
    for name, value in _read(path).items():
        _flatten(name, value, found)
    numbers = {k: v for k, v in found.items() if not isinstance(v, _Opaque)}
    arrays = {k: v for k, v in numbers.items() if len(v) > 1}
    if not arrays:
        raise _no_arrays(path, found)
    named, names = _short_names(arrays)
    given, options = options, dataclasses.replace(options)
    _use_names(options, names)
    wanted = (options.gyro or "").split(",")[0].strip()
    lengths = [len(v) for v in arrays.values()]
    n = len(named[wanted]) if wanted in named else max(set(lengths), key=lambda length: (lengths.count(length), length))
    columns = {k: v for k, v in named.items() if len(v) == n}
    rate = next((float(v[0]) for k, v in numbers.items() if _short(k) in ("Fs", "fs", "rate_hz", "sample_rate") and len(v) == 1), None)
    if rate and not options.rate_hz and options.time is None:
        given.rate_hz = options.rate_hz = rate
    try:
        return [stream_of(path, columns, options, "matlab")]
    except DataError as error:
        objects = [f"{k} is a MATLAB {v.class_name}" for k, v in found.items() if isinstance(v, _Opaque)]
        if not objects:
            raise
        time = next((_short(k) for k, v in found.items() if isinstance(v, _Opaque) and v.class_name in ("duration", "datetime")), None)
        help = f"; in MATLAB: s.{time} = seconds(s.{time} - s.{time}(1))" if time else ""
        raise DataError(f"{error} ({'; '.join(objects)}: objects that only MATLAB can read, left out{help})") from None
