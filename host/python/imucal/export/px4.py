# SPDX-License-Identifier: MIT
"""PX4 thermal compensation parameters, TC_G* and TC_A*, as a .params file for QGroundControl.

Formula (PX4-Autopilot, src/modules/temperature_compensation/TemperatureCompensation.cpp, calc_thermal_offsets_3D):
  dT = clip(T, TMIN, TMAX) - TREF;   offset[i] = X0_i + X1_i dT + X2_i dT^2 + X3_i dT^3   in float32, rad/s or m/s2,
and the corrected sample is data - offset.
"""
from ..errors import DataError
from ..units import DPH_PER_RADPS, MG_PER_MS2
from .cubic import common_span, cubic_powers, note_scale, text, three_axes

_INT32, _FLOAT = 6, 9  # MAV_PARAM_TYPE


def _sensor(table, letter, prefix, per_unit, device_id, notes):
    channels = three_axes(table, letter, "PX4")
    if not channels:
        return []
    span = common_span(channels, notes, table.path)
    note_scale(channels, notes)
    t_ref = float(text(channels[0].t0_degc))
    rows = [(f"{prefix}_ID", str(device_id), _INT32), (f"{prefix}_TREF", text(t_ref), _FLOAT), (f"{prefix}_TMIN", text(span[0]), _FLOAT),
            (f"{prefix}_TMAX", text(span[1]), _FLOAT)]
    for i, channel in enumerate(channels):
        for power, value in enumerate(cubic_powers(channel, t_ref, span, per_unit, notes)):
            rows.append((f"{prefix}_X{power}_{i}", text(value), _FLOAT))
    return rows


def export(table, options):
    """(text, notes) of a .params file."""
    notes = []
    index = options.instance or 0
    if not 0 <= index <= 3:
        raise DataError(f"{table.path}: PX4 has thermal parameters for sensors 0 to 3, not for {index}")
    device = options.device_id or 0
    gyro = _sensor(table, "g", f"TC_G{index}", 1 / DPH_PER_RADPS, device, notes)
    accel = _sensor(table, "a", f"TC_A{index}", 1 / MG_PER_MS2, device, notes)
    if not gyro and not accel:
        raise DataError(f"{table.path}: no axes gx, gy, gz or ax, ay, az (there are: {', '.join(c.axis for c in table.channels)})")
    if accel:
        notes.append("accelerometer: b0 holds gravity as it lay in the calibration; PX4 would subtract it: clear TC_A*_X0_* or calibrate in six poses")
    if not options.device_id:
        notes.append(f"TC_G{index}_ID is 0, and PX4 ignores it: give --device-id (the log's px4_device_id, or the parameter CAL_GYRO{index}_ID)")
    rows = ([("TC_G_ENABLE", "1", _INT32)] if gyro else []) + gyro + ([("TC_A_ENABLE", "1", _INT32)] if accel else []) + accel
    head = ["# Onboard parameters for Vehicle 1", f"# imucal thermal calibration of {table.serial}, table {table.sequence}, {table.created}",
            "#", "# Vehicle-Id Component-Id Name Value Type"]
    return "\n".join(head + [f"1\t1\t{name}\t{value}\t{kind}" for name, value, kind in rows]) + "\n", notes
