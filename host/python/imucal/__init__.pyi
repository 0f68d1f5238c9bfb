# SPDX-License-Identifier: MIT
"""What the package gives; imucal/__init__.py loads it on first use."""
from . import plot as plot
from .analysis import allan_deviation as allan_deviation
from .analysis import as_log as as_log
from .analysis import calibrate as calibrate
from .analysis import calibration_error as calibration_error
from .analysis import check_bound as check_bound
from .analysis import compensate as compensate
from .analysis import diagnose as diagnose
from .analysis import direct_predictor as direct_predictor
from .analysis import expect as expect
from .analysis import fit_error_model as fit_error_model
from .analysis import optimize_profile as optimize_profile
from .analysis import simulate as simulate
from .calibrator import ThermalCalibrator as ThermalCalibrator
from .errors import DataError as DataError
from .errors import DataWarning as DataWarning
from .errors import ImucalError as ImucalError
from .errors import UsageError as UsageError
from .importers import import_log as import_log
from .log import Log as Log
from .log import read_log as read_log
from .log import write_log as write_log
from .table import read_table as read_table

__version__: str
