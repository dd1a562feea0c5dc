"""Coarse-graining functions W (seed C, 3.3.1): Lucy, Gaussian, Heaviside; each integrates to 1 over m = 1, 2 or 3 dimensions.

m = 1 or 2 serves profiles: fields averaged over the directions that are left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.coarse_graining._kernels import weight
from barchan.bodies.rigid import inputs

Vector = NDArray[np.float64]
_NODES = 64


@dataclass(frozen=True)
class Lucy:
    """(1 + 3 r/c) (1 - r/c)^3 within the `reach` c > 0 [m]: smooth, with compact support; the seed's choice. Width c / 2."""

    reach: float

    def __post_init__(self) -> None:
        inputs.positive("kernel.reach", self.reach)

    def numbers(self, dimension: int) -> Vector:
        """Kind, reach, norm and width, as the compiled code reads them."""
        c = self.reach
        norm = (1.25 / c, 5.0 / (math.pi * c**2), 105.0 / (16.0 * math.pi * c**3))[dimension - 1]
        return np.array([0.0, c, norm, 0.5 * c])


@dataclass(frozen=True)
class Gaussian:
    """exp(-r^2 / 2 w^2), w = reach / `widths`, cut off at the `reach` > 0 [m] and normalised with what is left."""

    reach: float
    widths: float = 3.0

    def __post_init__(self) -> None:
        inputs.positive("kernel.reach", self.reach)
        inputs.positive("kernel.widths", self.widths)

    def numbers(self, dimension: int) -> Vector:
        """Kind, reach, norm and width, as the compiled code reads them."""
        w, u = self.reach / self.widths, self.widths / math.sqrt(2.0)
        kept = math.erf(u)
        if dimension == 2:
            kept = -math.expm1(-u * u)
        elif dimension == 3:
            kept -= 2.0 * u * math.exp(-u * u) / math.sqrt(math.pi)
        return np.array([1.0, self.reach, 1.0 / ((2.0 * math.pi * w * w) ** (0.5 * dimension) * kept), w])


@dataclass(frozen=True)
class Heaviside:
    """The same everywhere within the `reach` > 0 [m]; its fields jump, and have no gradient."""

    reach: float

    def __post_init__(self) -> None:
        inputs.positive("kernel.reach", self.reach)

    def numbers(self, dimension: int) -> Vector:
        """Kind, reach, norm and width, as the compiled code reads them."""
        c = self.reach
        norm = (0.5 / c, 1.0 / (math.pi * c**2), 3.0 / (4.0 * math.pi * c**3))[dimension - 1]
        return np.array([2.0, c, norm, c])


Kernel = Lucy | Gaussian | Heaviside


def share_beyond(kernel: Kernel, distances: Vector, dimension: int) -> Vector:
    """Share (q,) of the kernel that lies beyond a plane at signed `distances` (q,) [m] ahead of its centre.

    To 1e-8, by Gauss quadrature over the radius of the part of each sphere that is beyond.
    """
    numbers = kernel.numbers(dimension)
    s = np.minimum(np.abs(np.asarray(distances, dtype=np.float64)), kernel.reach)
    y, weights = np.polynomial.legendre.leggauss(_NODES)
    y, weights = 0.5 * (y + 1.0), 0.5 * weights
    span = (kernel.reach - s)[:, None]
    r = s[:, None] + span * y**2  # the square smooths the root at r = s
    values = np.array([[weight(numbers, q) for q in row] for row in r]).reshape(r.shape)
    part = s[:, None] / np.maximum(r, 1e-300)
    if dimension == 1:
        beyond = np.ones_like(r)  # one of the two ends
    elif dimension == 2:
        beyond = 2.0 * r * np.arccos(np.minimum(part, 1.0))
    else:
        beyond = 2.0 * np.pi * r * (r - s[:, None])
    share = (values * beyond * 2.0 * y * span) @ weights
    result: Vector = np.where(np.asarray(distances) >= 0.0, share, 1.0 - share)
    return result
