"""Copies of grains beyond periodic sides, and mirror images behind walls: both are more grains to the kernels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.coarse_graining.interactions import Grains, Interactions
from barchan.bodies.coarse_graining.kernels import Kernel, share_beyond
from barchan.bodies.rigid import inputs
from barchan.errors import InputError

Vector = NDArray[np.float64]
_AROUND = 2  # images to each side: the cell may be slanted by half its length


@dataclass(frozen=True, eq=False)
class Periodic:
    """Edges of a periodic cell, and how its images move.

    edges (e, d) [m], e <= d : moving by one of them leads to the image. velocities (e, d) [m/s] of the images (Lees-Edwards).
    """

    edges: Vector
    velocities: Vector

    def __post_init__(self) -> None:
        edges = inputs.table("periodic.edges", self.edges, (2, 3), 1)
        velocities = inputs.table("periodic.velocities", self.velocities, (edges.shape[1],), len(edges))
        if len(velocities) != len(edges) or np.any(np.linalg.norm(edges, axis=1) == 0.0):
            raise InputError("periodic.edges", edges.tolist(), "not zero, with a velocity for each")
        object.__setattr__(self, "edges", edges)
        object.__setattr__(self, "velocities", velocities)


@dataclass(frozen=True, eq=False, init=False)
class Mirror:
    """The plane normal . x = offset [m] of a wall; `normal` (d,) points to the grains."""

    normal: Vector
    offset: float

    def __init__(self, normal: ArrayLike, offset: float = 0.0) -> None:
        given = inputs.vector("mirror.normal", normal, (2, 3))
        if not np.any(given) or not np.isfinite(offset):
            raise InputError("mirror.normal", given.tolist(), "not zero, with a finite offset")
        object.__setattr__(self, "normal", given / np.linalg.norm(given))
        object.__setattr__(self, "offset", float(offset))


@dataclass(frozen=True, eq=False)
class Sources:
    """All that adds to the fields near some points: grains as rows (n, ..), contacts as rows (k, ..)."""

    positions: Vector
    velocities: Vector
    masses: Vector
    volumes: Vector
    starts: Vector
    branches: Vector
    forces: Vector
    normals: Vector
    weights: Vector
    points: Vector
    walls: NDArray[np.bool_]

    @classmethod
    def of(cls, grains: Grains, interactions: Interactions) -> Sources:
        """Grains and contacts as they are; `weights` (k,) are the volumes that a contact counts with in the fabric."""
        first, second = interactions.first, interactions.second
        wall = second < 0
        weights = grains.volumes[first] + np.where(wall, 0.0, grains.volumes[np.maximum(second, 0)])
        return cls(
            grains.positions, grains.velocities, grains.masses, grains.volumes,
            grains.positions[first], interactions.branches, interactions.forces, interactions.normals,
            weights, interactions.points, wall,
        )  # fmt: skip

    def near(self, lower: Vector, upper: Vector, reach: float) -> Sources:
        """Those that a kernel of this `reach` carries into the box `lower` .. `upper` (d,)."""
        grain = np.all((self.positions >= lower - reach) & (self.positions <= upper + reach), axis=1)
        ends = self.starts - self.branches
        low, high = np.minimum(self.starts, ends), np.maximum(self.starts, ends)
        low, high = np.minimum(low, self.points), np.maximum(high, self.points)
        contact = np.all((high >= lower - reach) & (low <= upper + reach), axis=1)
        return self.picked(grain, contact)

    def picked(self, grain: NDArray[np.bool_], contact: NDArray[np.bool_]) -> Sources:
        """The grains and contacts marked."""
        return Sources(
            self.positions[grain], self.velocities[grain], self.masses[grain], self.volumes[grain],
            self.starts[contact], self.branches[contact], self.forces[contact], self.normals[contact],
            self.weights[contact], self.points[contact], self.walls[contact],
        )  # fmt: skip

    def shifted(self, by: Vector, velocity: Vector) -> Sources:
        """The image at `by` (d,), moving by `velocity` (d,) faster."""
        return Sources(
            self.positions + by, self.velocities + velocity, self.masses, self.volumes,
            self.starts + by, self.branches, self.forces, self.normals, self.weights, self.points + by, self.walls,
        )  # fmt: skip

    def mirrored(self, mirror: Mirror) -> Sources:
        """The mirror image."""
        n = mirror.normal
        turn = np.eye(len(n)) - 2.0 * np.outer(n, n)
        move = 2.0 * mirror.offset * n
        return Sources(
            self.positions @ turn + move, self.velocities @ turn, self.masses, self.volumes,
            self.starts @ turn + move, self.branches @ turn, self.forces @ turn, self.normals @ turn,
            self.weights, self.points @ turn + move, self.walls,
        )  # fmt: skip

    def together(self, others: Sequence[Sources]) -> Sources:
        """All in one."""
        parts = [self, *others]
        names = self.__dataclass_fields__
        return Sources(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def with_images(
    sources: Sources,
    lower: Vector,
    upper: Vector,
    reach: float,
    periodic: Periodic | None,
    mirrors: Sequence[Mirror],
) -> Sources:
    """`sources` and their images that reach into the box `lower` .. `upper` (d,)."""
    if periodic is not None:
        if periodic.edges.shape[1] != sources.positions.shape[1]:
            raise InputError("periodic.edges", periodic.edges.shape, "of the dimension of the grains")
        images = []
        for times in product(range(-_AROUND, _AROUND + 1), repeat=len(periodic.edges)):
            if any(times):
                image = sources.shifted(
                    np.array(times) @ periodic.edges, np.array(times) @ periodic.velocities
                )
                images.append(image.near(lower, upper, reach))
        sources = sources.together(images)
    for mirror in mirrors:
        sources = sources.together([sources.mirrored(mirror).near(lower, upper, reach)])
    return sources


def mass_outside(grains: Grains, kernel: Kernel, mirrors: Sequence[Mirror]) -> Vector:
    """Mass (w,) [kg] that the fields without mirror images put behind each wall."""
    return np.array(
        [
            grains.masses
            @ share_beyond(kernel, grains.positions @ wall.normal - wall.offset, grains.dimension)
            for wall in mirrors
        ]
    )
