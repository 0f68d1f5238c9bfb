# SPDX-License-Identifier: MIT
"""The C core's filter from Python: the same arithmetic, the same bits as on the device."""
import numpy as np

from .errors import DataError
from .native import core


class ThermalCalibrator:
    """Learns the thermal polynomial of one channel, second by second (common/kf.h).

    Parameters
    ----------
    order : int                  of the polynomial, 1..5
    t0_degc, range_degc : float  Tn = (T - t0)/range; the temperatures of interest should have |Tn| <= 1
    arw_deg_rt_h : float         angle random walk
    sigma_dph, tau_s : float     the instability (first-order Gauss-Markov)
    prior_sigma_dph : float      of every coefficient before the first second

    Raises
    ------
    DataError : a value the core refuses, with its reason

    Examples
    --------
    >>> c = ThermalCalibrator(order=3, t0_degc=30, range_degc=30, arw_deg_rt_h=0.6, sigma_dph=20, tau_s=100)
    >>> c.update(412.5, 24.8)
    True
    >>> c.bias_sigma_dph(25.0) > 0
    True
    """

    def __init__(self, order=3, t0_degc=25.0, range_degc=40.0, arw_deg_rt_h=0.6, sigma_dph=20.0, tau_s=100.0, prior_sigma_dph=1e4):
        if not tau_s > 0:
            raise DataError("tau_s must be positive")
        try:
            self._filter = core().Filter(order, t0_degc, range_degc, arw_deg_rt_h, sigma_dph, tau_s, prior_sigma_dph)
        except ValueError as error:
            raise DataError(f"ThermalCalibrator: {error}") from None
        self.order, self.t0_degc, self.range_degc = order, t0_degc, range_degc

    def update(self, rate_dph, temp_degc):
        """One 1-s mean and its temperature.

        Parameters
        ----------
        rate_dph, temp_degc : float    NaN: a missing second

        Returns
        -------
        bool : False where it was refused (out of range); the state is then unchanged
        """
        return self._filter.update(float(rate_dph), float(temp_degc))

    def run(self, rate_dph, temp_degc):
        """All seconds of a record; Ctrl-C is seen between them.

        Parameters
        ----------
        rate_dph, temp_degc : array (n,)    NaN: a missing second

        Returns
        -------
        int : seconds refused

        Raises
        ------
        DataError : arrays of different lengths
        """
        try:
            return self._filter.run(np.ascontiguousarray(rate_dph, np.float64), np.ascontiguousarray(temp_degc, np.float64))
        except ValueError as error:
            raise DataError(str(error)) from None

    def skip(self, seconds):
        """A gap.

        Parameters
        ----------
        seconds : int    whole seconds without a measurement

        Returns
        -------
        bool : False where the core refuses it
        """
        return self._filter.skip(int(seconds))

    def new_run(self, turn_on_sigma_dph=0.0):
        """The device was switched off and on.

        Parameters
        ----------
        turn_on_sigma_dph : float    repeatability of the bias over a restart

        Returns
        -------
        None
        """
        self._filter.new_run(float(turn_on_sigma_dph))

    @property
    def coeff_dph(self):
        """Coefficients b_0 .. b_order of B(T) = sum b_i Tn^i."""
        return np.array(self._filter.coefficients())

    def bias_dph(self, temp_degc):
        """B(T), by the core in float32.

        Parameters
        ----------
        temp_degc : float or array

        Returns
        -------
        float or array : in dph
        """
        return np.vectorize(self._filter.bias, otypes=[float])(temp_degc)[()]

    def bias_sigma_dph(self, temp_degc):
        """Predicted one-sigma calibration error.

        Parameters
        ----------
        temp_degc : float or array

        Returns
        -------
        float or array : in dph
        """
        return np.vectorize(self._filter.sigma, otypes=[float])(temp_degc)[()]

    @property
    def n(self):
        """Seconds taken."""
        return self._filter.n

    @property
    def n_missed(self):
        """Seconds bridged."""
        return self._filter.n_missed

    @property
    def n_refused(self):
        """Seconds refused."""
        return self._filter.n_refused

    @property
    def innovation_dph(self):
        """The last innovation."""
        return self._filter.innovation

    @property
    def mean_nis(self):
        """Mean squared innovation over its variance: 1 with a right model, standard error sqrt(2/n)."""
        return self._filter.mean_nis

    @property
    def lag1(self):
        """Lag-1 correlation of the innovations: 0 with a right model."""
        return self._filter.lag1
