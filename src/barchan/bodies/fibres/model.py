"""What stepping and contact need from a model of fibres; Discrete Elastic Rods and Super-Helices are two of them.

A model holds f fibres. Fibre i owns the velocities offsets[i]:offsets[i+1] and the nodes node_offsets[i]:node_offsets[i+1] of
its centre line, a polyline on which contact is looked for. Roots may move as given: they have no velocities of their own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Whole = NDArray[np.int64]


class FibreShape(Protocol):
    """Configuration and velocities of the fibres of a model at a time: immutable."""

    @property
    def time(self) -> float:
        """[s]."""

    @property
    def velocities(self) -> Vector:
        """(m,) velocities of all degrees of freedom."""

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Every field as an array, for checkpoints."""


Shape = TypeVar("Shape", bound=FibreShape)


@dataclass(frozen=True, eq=False)
class FibreSystem:
    """The linearised implicit step without contacts: A v = f (seed B, Eq. 2.16), block-diagonal, one dense block a fibre.

    blocks : all blocks one after another, row by row, block i at block_offsets[i], of order offsets[i+1] - offsets[i];
    symmetric positive definite, already divided by dt [kg/s for a displacement].  forces : (m,) f.
    """

    blocks: Vector
    block_offsets: Whole
    forces: Vector


@dataclass(frozen=True, eq=False)
class PointRows:
    """How points on fibres move: velocity of point k = values[k] (3, m_i) times the velocities of its fibre, plus drift[k].

    values : all (3, m_i) blocks one after another, row by row, block k at starts[k].  drift : (k, 3) [m/s] what given motions
    of the roots do.
    """

    values: Vector
    starts: Whole
    drift: Vector


class FibreModel(Protocol[Shape]):
    """f fibres of one kind."""

    @property
    def offsets(self) -> Whole:
        """(f + 1,) first velocity of each fibre."""

    @property
    def node_offsets(self) -> Whole:
        """(f + 1,) first node of each fibre on its centre line."""

    @property
    def radii(self) -> Vector:
        """(f,) radii [m]."""

    def started(self) -> Shape:
        """The fibres where they start."""

    def restored(self, arrays: Mapping[str, NDArray[Any]]) -> Shape:
        """The state that `arrays()` of a shape wrote."""

    def centre_line(self, shape: Shape) -> Vector:
        """(p, 3) nodes of all fibres [m]."""

    def node_velocities(self, shape: Shape) -> Vector:
        """(p, 3) velocities of the nodes [m/s]."""

    def system(self, shape: Shape, dt: float, gravity: Vector) -> FibreSystem:
        """The step of `dt` seconds from `shape` under gravity (3,) [m/s^2], without contacts."""

    def rows(self, shape: Shape, dt: float, fibre: Whole, segment: Whole, share: Vector) -> PointRows:
        """How the points at `share` (0 to 1) of the `segment` (counted from the root) of `fibre` move over the step of dt."""

    def moved(self, shape: Shape, velocities: Vector, dt: float) -> Shape:
        """The fibres after a step of `dt` at these end velocities (m,)."""

    def kinetic_energy(self, shape: Shape) -> float:
        """[J]."""

    def potential_energy(self, shape: Shape, gravity: Vector) -> float:
        """Elastic energy and that of weight [J]."""
