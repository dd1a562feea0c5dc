"""Fits of discharge against outlet: the Beverloo law Q = C (D - D0)^(3/2), and the exponent left free."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

BEVERLOO = 1.5
GRAINS = 11.2
"""L in grain diameters, with which seed A turns D0 / L into k."""


@dataclass(frozen=True)
class Fit:
    """Q = factor (D - offset)^exponent. worst : largest deviation of the fit, relative to the greatest Q.

    quality : 1 minus the share of the variance of Q that the fit leaves.
    """

    factor: float
    offset: float
    exponent: float
    worst: float
    quality: float

    @property
    def k(self) -> float:
        """The offset in grain diameters."""
        return GRAINS * self.offset

    def at(self, outlet: ArrayLike) -> np.ndarray:
        """Q of the fit; 0 where the outlet is smaller than the offset."""
        above = np.maximum(np.asarray(outlet, dtype=float) - self.offset, 0.0)
        return np.asarray(self.factor * above**self.exponent)


def fit_law(outlets: ArrayLike, discharges: ArrayLike, exponent: float = BEVERLOO) -> Fit:
    """Least squares of Q^(1/exponent), which is linear in D; needs two different outlets and Q > 0."""
    D, Q = np.asarray(outlets, dtype=float), np.asarray(discharges, dtype=float)
    slope, intercept = np.polyfit(D, Q ** (1.0 / exponent), 1)
    if slope <= 0.0:  # the discharge does not grow with the outlet: no law of this form
        return Fit(0.0, 0.0, exponent, 1.0, 0.0)
    fit = Fit(float(slope**exponent), float(-intercept / slope), exponent, 0.0, 0.0)
    rest = fit.at(D) - Q
    variance = float(np.sum((Q - Q.mean()) ** 2))
    quality = 1.0 - float(np.sum(rest**2)) / variance if variance > 0.0 else 1.0
    return Fit(fit.factor, fit.offset, exponent, float(np.abs(rest).max() / Q.max()), quality)


def fit_exponent(outlets: ArrayLike, discharges: ArrayLike, offset: float = 0.0) -> float:
    """Slope of log Q over log(D - offset)."""
    D, Q = np.asarray(outlets, dtype=float), np.asarray(discharges, dtype=float)
    return float(np.polyfit(np.log(D - offset), np.log(Q), 1)[0])


def fit_free(outlets: ArrayLike, discharges: ArrayLike) -> Fit:
    """The exponent between 0.5 and 4 whose fit leaves least, in steps of 0.01."""
    fits = [fit_law(outlets, discharges, exponent) for exponent in np.linspace(0.5, 4.0, 351)]
    return max(fits, key=lambda fit: fit.quality)
