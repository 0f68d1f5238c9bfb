# SPDX-License-Identifier: MIT
"""What an importer finds in a file: one Stream per sensor, and what else tells motion."""
from dataclasses import dataclass, field

import numpy as np


@dataclass
class Motion:
    """Samples that show whether the device moved: kind "gyro" (dph), "accel" (mg)."""

    kind: str
    t_us: np.ndarray
    values: np.ndarray


@dataclass
class Stream:
    """Raw samples of one sensor, in the file's own units.

    Attributes
    ----------
    instance : int
    name : str                   as the file calls it
    axes : list of str           stems: gx, gy, gz (and ax, ay, az)
    t_us : int64 array (n,)      sample times, any order
    values : array (n, k)
    to_internal : float array (k,)   dph (gyros) or mg (accelerometers) per unit of `values`
    unit : str                   of `values`, for the metadata
    temp_t_us, temp_degc : arrays; None: the file has no temperature of this sensor
    motion : list of Motion      besides the sensor's own samples
    metadata : dict              goes into the log
    notes : list of str          what the user should know
    """

    instance: int
    name: str
    axes: list
    t_us: np.ndarray
    values: np.ndarray
    to_internal: np.ndarray
    unit: str
    temp_t_us: np.ndarray = None
    temp_degc: np.ndarray = None
    motion: list = field(default_factory=list)
    metadata: dict = field(default_factory=dict)
    notes: list = field(default_factory=list)
    temp_hint: str = ""  # where a temperature may be found, where none was
    rate_hz: float = 0.0
    is_seconds: bool = False  # rows are 1-s means already, t is the second's end
    option: str = ""  # that chooses this sensor; empty: --instance N
    flags: np.ndarray = None  # (n, k) bits of the rows, where the file has them (log.Log)
    time_column: tuple = None  # its name and microseconds per unit, of a table
    clock: object = None  # clock.Clock, once it is found
    units: list = None  # inside, of each axis: "dph" or "mg"; None: an axis that begins with a is an accelerometer's

    @property
    def axis_units(self):
        """The unit inside of each axis."""
        return self.units or ["mg" if axis.startswith("a") else "dph" for axis in self.axes]

    @property
    def chosen_by(self):
        """The option that chooses this sensor of its file."""
        return self.option or f"--instance {self.instance}"
