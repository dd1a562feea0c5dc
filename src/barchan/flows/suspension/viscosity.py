"""Effective viscosity of a fluid that holds grains, as a multiple of the fluid's own (seed B, Eq. 8.2-8.3).

Laws that are infinite at phi_max stop growing at `LARGEST_SHARE` phi_max: from there on grains touch, and their friction is
the business of the contact stress.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.flows.suspension.values import checked

Vector = NDArray[np.float64]

LARGEST_SHARE = 0.99
"""Part of phi_max beyond which no law grows: Krieger and Dougherty's ends at 1000 for phi_max = 0.6, the other one at 335."""


@runtime_checkable
class EffectiveViscosity(Protocol):
    """A law of the effective viscosity."""

    def ratio(self, phi: ArrayLike, phi_max: float) -> Vector:
        """eta_eff / eta_f (n,), at least 1 and finite, at volume fractions (n,) of grains."""
        ...


@dataclass(frozen=True)
class Constant:
    """eta_eff = eta_f: grains do not stiffen the fluid."""

    def ratio(self, phi: ArrayLike, phi_max: float) -> Vector:
        """1 (n,)."""
        return np.ones(np.shape(phi))


@dataclass(frozen=True)
class Einstein:
    """eta_eff = eta_f (1 + 5/2 phi): few grains, up to some hundredths of the volume; finite at any phi."""

    def ratio(self, phi: ArrayLike, phi_max: float) -> Vector:
        """eta_eff / eta_f (n,); see `EffectiveViscosity`."""
        return np.asarray(1.0 + 2.5 * np.clip(phi, 0.0, 1.0))


@dataclass(frozen=True)
class KriegerDougherty:
    """eta_eff = eta_f (1 - phi / phi_max)^-exponent (seed B, Eq. 8.3).

    exponent : > 0; None for 5/2 phi_max, with which few grains obey Einstein's law.

    Raises InputError for an exponent that is not a finite number > 0.
    """

    exponent: float | None = None

    def __post_init__(self) -> None:
        if self.exponent is not None:
            checked("effective_viscosity.exponent", self.exponent)

    def ratio(self, phi: ArrayLike, phi_max: float) -> Vector:
        """eta_eff / eta_f (n,); see `EffectiveViscosity`."""
        exponent = 2.5 * phi_max if self.exponent is None else self.exponent
        return np.asarray((1.0 - _share(phi, phi_max)) ** -exponent)


@dataclass(frozen=True)
class FrankelAcrivos:
    """eta_eff = 9/8 eta_f / ((phi_max / phi)^(1/3) - 1) (seed B, Eq. 8.2), but not less than eta_f.

    It is the lubrication limit of closely packed spheres and vanishes without grains. Below phi = 0.104 phi_max it would be
    less than the fluid's own viscosity; there it is the fluid's.
    """

    def ratio(self, phi: ArrayLike, phi_max: float) -> Vector:
        """eta_eff / eta_f (n,); see `EffectiveViscosity`."""
        root = np.cbrt(_share(phi, phi_max))
        return np.asarray(np.maximum(1.0, 1.125 * root / (1.0 - root)))


def _share(phi: ArrayLike, phi_max: float) -> Vector:
    """phi / phi_max (n,) within [0, LARGEST_SHARE]."""
    return np.asarray(np.clip(np.asarray(phi, dtype=np.float64) / phi_max, 0.0, LARGEST_SHARE))
