"""From fields to a friction law: inertial number, effective friction, and a fit of mu(I) with its uncertainty (seed B, 0.3.3).

The conventions are those of `flows.mpm.Material`: |T| = sqrt(T:T / 2) of the deviatoric part, p = Tr(sigma) / d, compression
positive, I = |Dev D| d sqrt(rho / p), mu = |Dev sigma| / p (physical: it bounds sqrt(J2) / p). In simple shear |Dev D|
is half of du/dy, so that a source with I = (du/dy) d sqrt(rho / p) has twice this inertial number.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import curve_fit

from barchan.bodies.rigid import inputs
from barchan.errors import InputError

Vector = NDArray[np.float64]


def deviatoric_norm(tensors: Vector) -> Vector:
    """|Dev T| = sqrt(Dev T : Dev T / 2) (q,) of the symmetric parts of tensors (q, d, d)."""
    t = np.asarray(tensors, dtype=np.float64)
    d = t.shape[-1]
    symmetric = 0.5 * (t + np.swapaxes(t, 1, 2))
    symmetric = symmetric - np.trace(symmetric, axis1=1, axis2=2)[:, None, None] / d * np.eye(d)
    norm: Vector = np.sqrt(0.5 * np.sum(symmetric**2, axis=(1, 2)))
    return norm


def effective_friction(stress: Vector) -> Vector:
    """|Dev sigma| / p (q,) of stresses (q, d, d), compression positive; NaN where the pressure is not positive."""
    pressure = np.trace(stress, axis1=1, axis2=2) / np.shape(stress)[-1]
    share: Vector = np.divide(
        deviatoric_norm(stress), pressure, out=np.full(len(pressure), np.nan), where=pressure > 0.0
    )
    return share


def inertial_number(
    gradient: Vector, pressure: Vector, grain_diameter: float, grain_density: float
) -> Vector:
    """|Dev D| d sqrt(rho / p) (q,) of velocity gradients (q, d, d) [1/s]; infinite where the pressure is not positive."""
    diameter = inputs.positive("grain_diameter", grain_diameter)
    density = inputs.positive("grain_density", grain_density)
    p = np.asarray(pressure, dtype=np.float64)
    root = np.sqrt(np.divide(density, p, out=np.full(p.shape, np.inf), where=p > 0.0))
    rate = deviatoric_norm(gradient) * diameter
    number: Vector = np.where(rate > 0.0, rate * root, np.where(p > 0.0, 0.0, np.inf))
    return number


@dataclass(frozen=True, eq=False)
class MuI:
    """mu(I) = mu_s + (mu_2 - mu_s) I / (I_0 + I).

    covariance (3, 3) : of (mu_s, mu_2, I_0). Data far below I_0 fix only the slope (mu_2 - mu_s) / I_0: then mu_2 and
    I_0 have large errors, nearly all in common, while `slope` and `friction` stay well known.
    """

    mu_s: float
    mu_2: float
    I_0: float
    covariance: Vector

    @property
    def errors(self) -> Vector:
        """Standard errors (3,) of mu_s, mu_2 and I_0."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def slope(self) -> float:
        """d mu / d I at I = 0."""
        return (self.mu_2 - self.mu_s) / self.I_0

    def friction(self, inertial: ArrayLike) -> Vector:
        """mu (q,) at inertial numbers (q,)."""
        return _law(np.asarray(inertial, dtype=np.float64), self.mu_s, self.mu_2 - self.mu_s, self.I_0)

    def friction_error(self, inertial: ArrayLike) -> Vector:
        """Standard error (q,) of `friction` by the covariance, to first order."""
        number = np.atleast_1d(np.asarray(inertial, dtype=np.float64))
        share = number / (self.I_0 + number)
        steps = (1.0 - share, share, -(self.mu_2 - self.mu_s) * share / (self.I_0 + number))
        gradient = np.stack(steps, axis=1)
        error: Vector = np.sqrt(np.einsum("qi,ij,qj->q", gradient, self.covariance, gradient))
        return error


def fit_mu_i(inertial: ArrayLike, friction: ArrayLike, errors: ArrayLike | None = None) -> MuI:
    """Least squares fit to pairs of inertial number (q,) and friction (q,), q >= 4.

    errors : standard errors (q,) > 0 of the frictions; then the covariance follows from them, else from the residuals.
    Bounds keep 0 <= mu_s <= mu_2 and I_0 > 0 within 1000 times the largest I.
    """
    number = np.asarray(inertial, dtype=np.float64)
    mu = np.asarray(friction, dtype=np.float64)
    if number.ndim != 1 or len(number) < 4 or not np.all(np.isfinite(number)) or np.any(number <= 0.0):
        raise InputError("inertial", number.tolist(), "at least 4 positive numbers")
    if mu.shape != number.shape or not np.all(np.isfinite(mu)) or np.any(mu < 0.0):
        raise InputError("friction", mu.tolist(), f"{len(number)} numbers >= 0")
    if len(np.unique(number)) < 3:
        raise InputError("inertial", number.tolist(), "at least 3 different numbers")
    sigma = None if errors is None else np.asarray(errors, dtype=np.float64)
    if sigma is not None and (
        sigma.shape != mu.shape or not np.all(np.isfinite(sigma)) or np.any(sigma <= 0.0)
    ):
        raise InputError("errors", sigma.tolist(), f"{len(number)} positive numbers")
    most = float(np.max(number))
    rise = max(float(np.max(mu) - np.min(mu)), 1e-3)
    values, covariance = curve_fit(
        _law,
        number,
        mu,
        p0=(float(np.min(mu)), 2.0 * rise, most),
        sigma=sigma,
        absolute_sigma=sigma is not None,
        bounds=((0.0, 0.0, 1e-6 * most), (np.inf, np.inf, 1e3 * most)),
        x_scale=(0.1, rise, most),
        max_nfev=20000,
    )
    # from (mu_s, mu_2 - mu_s, I_0) to (mu_s, mu_2, I_0)
    change = np.array([[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    mu_s, increment, reference = (float(v) for v in values)
    return MuI(mu_s, mu_s + increment, reference, change @ covariance @ change.T)


def to_material(
    law: MuI, grain_density: float, grain_diameter: float, volume_fraction: float
) -> dict[str, float]:
    """Arguments of `barchan.flows.mpm.Material` that make the continuum flow like the grains: `Material(**to_material(...))`.

    grain_density : [kg/m^d] of the solid. grain_diameter : [m]. volume_fraction : of packed grains, in (0, 1): the
    flow carries volumes of grains, so that its inertial number has the density of the grains, as the fit has.
    """
    if not 0.0 < volume_fraction < 1.0:
        raise InputError("volume_fraction", volume_fraction, "between 0 and 1")
    return {
        "density": inputs.positive("grain_density", grain_density),
        "friction": law.mu_s,
        "friction_increment": law.mu_2 - law.mu_s,
        "inertial_reference": law.I_0,
        "grain_diameter": inputs.positive("grain_diameter", grain_diameter),
        "max_volume_fraction": float(volume_fraction),
    }


def _law(number: Vector, mu_s: float, increment: float, reference: float) -> Vector:
    value: Vector = mu_s + increment * number / (reference + number)
    return value
