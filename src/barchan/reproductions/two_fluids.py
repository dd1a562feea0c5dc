"""Linear theory of a heavy viscous fluid above a light one of equal viscosity, between two plates (Rayleigh-Taylor).

Perturbations w(z) exp(n t) cos(k x) of the vertical velocity of two layers at rest obey (Chandrasekhar 1961, 92)

    n^2 int rho (w' v' + k^2 w v) + n int eta (w'' v'' + 2 k^2 w' v' + k^4 w v) = g k^2 (rho_above - rho_below) w(h) v(h)

for every v that vanishes at the plates, with v' = 0 where these stick; where they slip w'' = 0 follows. The right side has rank
one, so 1 = g k^2 [rho] e . (n^2 A + n B)^-1 e, which falls with n: one growing mode, found by bisection in log n.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.sparse.linalg import spsolve

from barchan.errors import InputError

Vector = NDArray[np.float64]

ELEMENTS = 200


@dataclass(frozen=True)
class TwoFluids:
    """Two layers between plates `height` apart [m], the interface at `interface` [m] above the lower plate.

    below, above : densities [kg/m^3].  viscosity : of both [Pa s].  gravity : [m/s^2].
    stick_below, stick_above : whether the fluids stick to the plates or slip along them.
    """

    height: float
    interface: float
    below: float
    above: float
    viscosity: float
    gravity: float = 9.81
    stick_below: bool = True
    stick_above: bool = True

    def growth_rate(self, wave_number: float, elements: int = ELEMENTS) -> float:
        """n [1/s] of the growing mode of cos(k x), k = `wave_number` [1/m]. InputError when the lower fluid is heavier."""
        if self.above <= self.below:
            raise InputError("above", self.above, f"greater than the density below, {self.below:g} kg/m^3")
        inertia, friction, at = self._matrices(wave_number, elements)
        unit = np.zeros(inertia.shape[0])
        unit[at] = 1.0
        drive = self.gravity * wave_number**2 * (self.above - self.below)

        def excess(logarithm: float) -> float:
            n = np.exp(logarithm)
            return float(drive * spsolve(n**2 * inertia + n * friction, unit)[at] - 1.0)

        ideal = np.sqrt(self.gravity * wave_number * (self.above - self.below) / (self.above + self.below))
        creeping = self.gravity * (self.above - self.below) / (4.0 * wave_number * self.viscosity)
        slowest = 1e-8 * min(ideal, creeping)
        return float(np.exp(brentq(excess, np.log(slowest), np.log(2.0 * ideal), xtol=1e-12)))

    def _matrices(self, k: float, elements: int) -> tuple[sp.csc_array, sp.csc_array, int]:
        """A and B above on cubic Hermite elements with a node at the interface, and the number of the value there."""
        share = self.interface / self.height
        count = min(max(round(share * elements), 1), elements - 1)
        nodes = np.concatenate([
            np.linspace(0.0, self.interface, count + 1),
            np.linspace(self.interface, self.height, elements - count + 1)[1:],
        ])  # fmt: skip
        size = 2 * len(nodes)
        rows, columns, heavy, viscous = [], [], [], []
        for element, (low, high) in enumerate(pairwise(nodes)):
            density = self.below if element < count else self.above
            value, slope, bend = hermite_products(high - low)
            local = 2 * element + np.arange(4)
            rows.append(np.repeat(local, 4))
            columns.append(np.tile(local, 4))
            heavy.append((density * (slope + k**2 * value)).ravel())
            viscous.append((self.viscosity * (bend + 2.0 * k**2 * slope + k**4 * value)).ravel())
        place = (np.concatenate(rows), np.concatenate(columns))
        held = [0, size - 2] + [1] * self.stick_below + [size - 1] * self.stick_above
        free = np.setdiff1d(np.arange(size), held)
        A, B = (
            sp.csc_array(sp.coo_array((np.concatenate(data), place), shape=(size, size)))[free][:, free]
            for data in (heavy, viscous)
        )
        return sp.csc_array(A), sp.csc_array(B), int(np.searchsorted(free, 2 * count))


def hermite_products(length: float) -> tuple[Vector, Vector, Vector]:
    """(4, 4) integrals over an element of the products of the cubic Hermite functions, of their slopes, of their curvatures."""
    points, weights = np.polynomial.legendre.leggauss(4)
    s, weights = 0.5 * (points + 1.0), 0.5 * weights * length
    values = np.stack([
        1 - 3 * s**2 + 2 * s**3, length * (s - 2 * s**2 + s**3), 3 * s**2 - 2 * s**3, length * (s**3 - s**2)
    ])  # fmt: skip
    slopes = np.stack([
        (-6 * s + 6 * s**2) / length, 1 - 4 * s + 3 * s**2, (6 * s - 6 * s**2) / length, 3 * s**2 - 2 * s
    ])  # fmt: skip
    bends = np.stack([
        (-6 + 12 * s) / length**2, (-4 + 6 * s) / length, (6 - 12 * s) / length**2, (6 * s - 2) / length
    ])  # fmt: skip
    return tuple((part * weights) @ part.T for part in (values, slopes, bends))  # type: ignore[return-value]
