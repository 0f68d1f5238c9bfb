# SPDX-License-Identifier: MIT
"""ArduPilot IMU temperature calibration, INS_TCAL*, as a .parm file.

Formula (ArduPilot, libraries/AP_InertialSensor/AP_InertialSensor_tempcal.cpp, polynomial_eval and correct_sensor):
  P(d) = (c1 + (c2 + c3 d) d) d 1e-6,  d = T - 35;   v -= P(clip(T) - 35);  v += P(clip(CALTEMP) - 35)
in float32, rad/s or m/s2, T clipped to TMIN..TMAX; then INS_GYROFFS is subtracted.  The polynomial has no constant: it
goes into INS_GYROFFS at INS_GYRn_CALTEMP.
"""
import numpy as np

from ..errors import DataError
from ..units import DPH_PER_RADPS, MG_PER_MS2
from .cubic import common_span, cubic_powers, note_scale, shared_span, text, three_axes

T_REF_DEGC, SCALE = 35.0, 1e6


def _name(stem, imu):
    """INS_GYR_CALTEMP is of the first IMU, INS_GYR2OFFS_X of the second."""
    return stem.format("" if imu == 1 else str(imu))


def _sensor(table, letter, kind, imu, per_unit, notes):
    channels = three_axes(table, letter, "ArduPilot")
    if not channels:
        return [], None
    span = common_span(channels, notes, table.path)
    note_scale(channels, notes)
    rows = []
    for axis, channel in zip("XYZ", channels):
        powers = cubic_powers(channel, T_REF_DEGC, span, per_unit, notes)
        rows += [(f"INS_TCAL{imu}_{kind}{k}_{axis}", text(powers[k] * SCALE)) for k in (1, 2, 3)]
    return rows, (channels, span)


def export(table, options):
    """(text, notes) of a .parm file."""
    notes = []
    imu = (options.instance or 0) + 1
    if not 1 <= imu <= 3:
        raise DataError(f"{table.path}: ArduPilot has INS_TCAL1 to INS_TCAL3, that is instances 0 to 2, not {imu - 1}")
    gyro_rows, gyro = _sensor(table, "g", "GYR", imu, 1 / DPH_PER_RADPS, notes)
    accel_rows, accel = _sensor(table, "a", "ACC", imu, 1 / MG_PER_MS2, notes)
    if gyro is None and accel is None:
        raise DataError(f"{table.path}: no axes gx, gy, gz or ax, ay, az (there are: {', '.join(c.axis for c in table.channels)})")
    span = shared_span([sensor[1] for sensor in (gyro, accel) if sensor], table.path)
    if gyro and accel and gyro[1] != accel[1]:
        notes.append(f"one span for gyro and accelerometer: only {span[0]:g} to {span[1]:g} degC, which both have")
    rows = [(f"INS_TCAL{imu}_ENABLE", "1"), (f"INS_TCAL{imu}_TMIN", text(span[0])), (f"INS_TCAL{imu}_TMAX", text(span[1]))] + gyro_rows + accel_rows
    if gyro:
        cal_temp = float(np.clip(T_REF_DEGC, *span))
        for axis, channel in zip("XYZ", gyro[0]):
            rows.append((_name("INS_GYR{}OFFS_" + axis, imu), text(channel.bias(cal_temp) / DPH_PER_RADPS)))
        rows.append((f"INS_GYR{imu}_CALTEMP", text(cal_temp)))
        notes.append("ArduPilot measures INS_GYR*OFFS anew at every start (INS_GYR_CAL = 1): the constant is then its own, the shape stays imucal's")
    if accel:
        notes.append("accelerometer: the constant (gravity as it lay) is left out: ArduPilot's INS_ACCOFFS keeps its own")
    notes.append("axes are the sensor's after rotation to the board, as IMU messages show them with AHRS_ORIENTATION = 0")
    head = f"# imucal thermal calibration of {table.serial}, table {table.sequence}, {table.created}\n"
    return head + "".join(f"{name} {value}\n" for name, value in rows), notes
