# SPDX-License-Identifier: MIT
"""imucal's own logs: 1-s means already; raw logs of counts are decimated when read."""
import numpy as np

from ..log import need_one_a_second, read_log
from ..stream import Stream


def streams(path, options):
    """One stream of the log's rows."""
    log = read_log(path)
    need_one_a_second(path, log.t_s)
    t_us = np.rint(log.t_s * 1e6).astype(np.int64)
    axes, units = zip(*(name.rsplit("_", 1) for name in log.axes))
    values = np.stack(list(log.rates.values()), axis=1)
    none = np.zeros(len(t_us), int)
    flags = np.stack([log.flags.get(name, none) for name in log.axes], axis=1)
    kept = {k: v for k, v in log.metadata.items() if k not in ("imucal-log", "rate_hz") and "_counts" not in k}
    return [Stream(0, log.metadata.get("device", "log"), list(axes), t_us, values, np.ones(len(axes)), "dph, mg", t_us,
                   log.temp_degc, metadata=kept, rate_hz=1.0, is_seconds=True, flags=flags, units=list(units))]
