# SPDX-License-Identifier: MIT
"""MATLAB .mat: up to version 7.2 by scipy, 7.3 (HDF5) by h5py.  Named arrays, matrices of three columns, and structs
(a timetable exported with timetable2table and table2struct(…, 'ToScalar', true)) become columns."""
import numpy as np

from ..errors import DataError
from . import need
from .named import stream_of


def _flatten(name, value, into):
    """Numbers under their names; a struct's fields under their own names; a matrix n x 3 as three columns."""
    if hasattr(value, "_fieldnames"):
        for field in value._fieldnames:
            _flatten(field, getattr(value, field), into)
    elif isinstance(value, dict):
        for field, inner in value.items():
            _flatten(field, inner, into)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and value.size > 1:
        _add_array(name, value, into)
    elif np.isscalar(value) and np.isreal(value):
        into[name] = np.asarray([value])


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
        return {k: walk(v) if isinstance(v, h5py.Group) else v[()].T for k, v in group.items() if not k.startswith("#")}

    with h5py.File(path, "r") as file:
        return walk(file)


def _read(path):
    with open(path, "rb") as file:
        head = file.read(1024)
    try:
        if head.startswith(b"\x89HDF") or b"MATLAB 7.3" in head[:128]:
            return _read_hdf5(path)
        loadmat = need("scipy.io", "scipy", path, "a MATLAB file").loadmat
        return {k: v for k, v in loadmat(path, squeeze_me=True, struct_as_record=False).items() if not k.startswith("__")}
    except DataError:
        raise
    except Exception as error:
        raise DataError(f"{path}: a MATLAB file that cannot be read ({type(error).__name__}: {error}); save it again with save -v7") from None


def streams(path, options):
    """One stream of the longest set of arrays of equal length."""
    found = {}
    for name, value in _read(path).items():
        _flatten(name, value, found)
    arrays = {k: v for k, v in found.items() if len(v) > 1}
    if not arrays:
        raise DataError(f"{path}: a MATLAB file without numeric arrays (it holds: {', '.join(found) or 'nothing that can be read'}; tables and "
                        "timetables are opaque outside MATLAB: s = table2struct(timetable2table(T), 'ToScalar', true); save('log.mat', 's', '-v7'))")
    lengths = [len(v) for v in arrays.values()]
    n = max(set(lengths), key=lambda length: (lengths.count(length), length))
    columns = {k: v for k, v in arrays.items() if len(v) == n}
    rate = next((float(found[k][0]) for k in ("Fs", "fs", "rate_hz", "sample_rate") if k in found and len(found[k]) == 1), None)
    if rate and not options.rate_hz and options.time is None:
        options.rate_hz = rate
    if options.gyro and options.gyro not in columns and f"{options.gyro}_x" in columns:
        options.gyro = ",".join(f"{options.gyro}_{a}" for a in "xyz")
    return [stream_of(path, columns, options, "matlab")]
