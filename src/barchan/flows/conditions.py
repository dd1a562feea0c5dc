"""What may happen at the named parts of a boundary of a continuum (seed A, Eqs. (25)-(26); seed B, 6.2.1; seed C 8.2).

Parts without a condition are free: no external stress acts on them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from barchan.errors import InputError
from barchan.spaces.mixed import sampled


@dataclass(frozen=True)
class NoSlip:
    """No velocity at all. Where parts meet it wins over every other condition."""


@dataclass(frozen=True)
class Velocity:
    """Prescribed velocity.

    value : d entries, each a number, a callable x (n, d) -> (n,) or None (component left free); or one callable
        x (n, d) -> (n, d). A whole velocity wins over single components and slip; between equals the later named part wins.
    """

    value: Sequence[float | Callable[[np.ndarray], Any] | None] | Callable[[np.ndarray], Any]

    def at(self, points: np.ndarray) -> np.ndarray:
        """(n, d) values at points (n, d), NaN in components left free. InputError on a wrong shape or values not finite."""
        d = points.shape[1]
        if callable(self.value):
            return sampled(self.value, points, "velocity", (d,)).copy()
        entries = list(self.value)
        if len(entries) != d:
            raise InputError("velocity", self.value, f"a sequence of {d} components")
        columns = [
            np.full(len(points), np.nan) if entry is None else sampled(entry, points, "velocity")
            for entry in entries
        ]
        return np.stack(columns, axis=1)

    @property
    def whole(self) -> bool:
        """Whether every component is prescribed."""
        return callable(self.value) or all(entry is not None for entry in self.value)


@dataclass(frozen=True)
class FreeSlip:
    """No velocity through the part, no shear traction on it; sides need not follow the axes."""


@dataclass(frozen=True)
class Symmetry(FreeSlip):
    """A plane of symmetry: the same conditions as free slip."""


@dataclass(frozen=True)
class Stress:
    """External stress, tension positive: tensor (d, d), or callable x (n, d) -> (n, d, d); the traction is tensor . n."""

    tensor: Any

    def at(self, points: np.ndarray) -> np.ndarray:
        """(n, d, d) tensors at points (n, d)."""
        d = points.shape[1]
        return sampled(self.tensor, points, "stress", (d, d))


@dataclass(frozen=True)
class Pressure:
    """External pressure, compression positive: number, or callable x (n, d) -> (n,)."""

    value: float | Callable[[np.ndarray], Any]

    def at(self, points: np.ndarray) -> np.ndarray:
        """(n, d, d) tensors -p 1 at points (n, d)."""
        return -sampled(self.value, points, "pressure")[:, None, None] * np.eye(points.shape[1])
