"""Passive grains for pictures: points inside the particles' ellipsoids that move with them (seed B, 7.3.2, last paragraph).

Grains carry no mass and act on nothing. Each belongs to a particle, moves with the particle's affine velocity field and never
leaves the ellipsoid of its frame, so that no grain drifts to a place where the velocity field means nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Integral

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.errors import InputError
from barchan.flows.mpm._grain_kernels import hand_over, place_grains
from barchan.flows.mpm.frames import ELLIPSOID_RADII, flow_maps, matrices


@dataclass(frozen=True, eq=False)
class Grains:
    """Grains and the particles they belong to.

    positions : (G, d) [m].
    owners : (G,) int64 particle indices.

    Raises InputError for arrays of other shapes.
    """

    positions: NDArray[np.float64]
    owners: NDArray[np.int64]

    def __post_init__(self) -> None:
        shape = np.shape(self.positions)
        if len(shape) != 2 or shape[1] not in (2, 3):
            raise InputError("grains.positions", f"array of shape {shape}", "of shape (G, 2) or (G, 3)")
        if np.shape(self.owners) != shape[:1] or not np.issubdtype(np.asarray(self.owners).dtype, np.integer):
            raise InputError(
                "grains.owners", f"array of shape {np.shape(self.owners)}", f"{shape[0]} whole numbers"
            )


def sample_grains(
    positions: ArrayLike,
    frames: ArrayLike,
    count: int | ArrayLike,
    seed: int,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
) -> Grains:
    """Grains spread evenly over the ellipsoids of particles at `positions` (P, d) [m] with `frames` (P, d, d) [m^2].

    Parameters
    ----------
    count : grains per particle, one number or (P,).
    seed : of the random numbers; the same seed gives the same grains.
    lower, upper : (d,) corners of a box that keeps the grains [m].

    Raises
    ------
    InputError : for arrays of other shapes, a negative count or seed, frames that are not positive definite.
    """
    tensors, points = _particles(positions, frames)
    d = points.shape[1]
    counts = np.asarray(count)
    whole = np.issubdtype(counts.dtype, np.integer) and counts.shape in ((), (len(points),))
    if not whole or np.any(counts < 0):
        raise InputError("count", count, f"a whole number >= 0, or {len(points)} of them")
    if isinstance(seed, bool) or not isinstance(seed, Integral) or seed < 0:
        raise InputError("seed", seed, "a whole number >= 0")
    owners = np.repeat(np.arange(len(points)), np.broadcast_to(counts, (len(points),)))
    random = np.random.default_rng(int(seed))
    directions = random.normal(size=(len(owners), d))
    lengths = np.sqrt(np.sum(directions**2, axis=1))
    radii = ELLIPSOID_RADII[d] * random.uniform(size=len(owners)) ** (1.0 / d)
    directions *= (radii / np.where(lengths > 0.0, lengths, 1.0))[:, None]
    try:
        roots = np.linalg.cholesky(tensors)
    except np.linalg.LinAlgError:
        raise InputError("frames", "a tensor that is not positive definite", "positive definite") from None
    arms = np.empty_like(directions)
    for row in range(d):  # row by row, so that no array of G matrices is made
        arms[:, row] = sum(roots[owners, row, k] * directions[:, k] for k in range(row + 1))
    return confined_grains(Grains(points[owners] + arms, owners), points, tensors, lower, upper)


def moved_grains(
    grains: Grains,
    old_positions: ArrayLike,
    affine: ArrayLike,
    new_positions: ArrayLike,
    new_frames: ArrayLike,
    dt: float,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
) -> Grains:
    """Grains after a step in which their owners moved from `old_positions` to `new_positions` (P, d) [m].

    The arm of a grain is carried by its owner's velocity gradient `affine` (P, d, d) [1/s], frozen for `dt` seconds:
    x = x_new + exp(dt c) (x - x_old), which is the owner's affine field v + c (x - x_p) with v the velocity the owner moved at.
    Frames obey the same map (`advected_frames`), so a grain keeps its place in the ellipsoid; where it would escape, because
    `new_frames` (P, d, d) were bounded or changed otherwise, it is pulled back towards the owner, to the surface.

    Raises InputError for arrays of other shapes.
    """
    tensors, points = _particles(new_positions, new_frames)
    before = np.ascontiguousarray(old_positions, dtype=np.float64)
    if before.shape != points.shape:
        raise InputError("old_positions", f"array of shape {before.shape}", f"of shape {points.shape}")
    maps = flow_maps(matrices("affine", affine, like=tensors), dt)
    return _placed(grains, before, maps, points, tensors, lower, upper)


def confined_grains(
    grains: Grains,
    positions: ArrayLike,
    frames: ArrayLike,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
) -> Grains:
    """Grains with those outside the ellipsoid of their owner, at `positions` (P, d), pulled back to its surface."""
    tensors, points = _particles(positions, frames)
    return _placed(grains, points, np.empty((0, *tensors.shape[1:])), points, tensors, lower, upper)


def renamed_grains(
    grains: Grains, parents: ArrayLike, heirs: ArrayLike, positions: ArrayLike, frames: ArrayLike
) -> Grains:
    """Grains whose owners were split and merged, with their new owners; no grain moves.

    Parameters
    ----------
    parents, heirs : as in `resampling.Resampled`.
    positions, frames : (P', d) and (P', d, d) of the particles after the resampling. A grain of a split particle goes to
        the child in whose ellipsoid it lies deeper, one of a merged particle to the union.

    Raises InputError for arrays of other shapes or owners without an heir.
    """
    tensors, points = _particles(positions, frames)
    origin = np.ascontiguousarray(parents, dtype=np.int64)
    following = np.ascontiguousarray(heirs, dtype=np.int64)
    if origin.shape != (len(points),):
        raise InputError("parents", f"array of shape {origin.shape}", f"of shape ({len(points)},)")
    if following.ndim != 1 or np.any((following < 0) | (following >= len(points))):
        raise InputError(
            "heirs", f"array of shape {following.shape}", f"a vector of indices below {len(points)}"
        )
    _check_owners(grains, len(following))
    owners = np.empty(len(grains.owners), dtype=np.int64)
    hand_over(
        np.ascontiguousarray(grains.positions), np.ascontiguousarray(grains.owners, dtype=np.int64),
        origin, following, points, tensors, owners,
    )  # fmt: skip
    return Grains(grains.positions, owners)


def _particles(positions: ArrayLike, frames: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    tensors = matrices("frames", frames)
    points = np.ascontiguousarray(positions, dtype=np.float64)
    if points.shape != tensors.shape[:2]:
        raise InputError("positions", f"array of shape {points.shape}", f"of shape {tensors.shape[:2]}")
    return tensors, points


def _check_owners(grains: Grains, count: int) -> None:
    if np.any((grains.owners < 0) | (grains.owners >= count)):
        raise InputError("grains.owners", int(np.max(grains.owners)), f"indices of the {count} particles")


def _placed(
    grains: Grains,
    before: NDArray[np.float64],
    maps: NDArray[np.float64],
    positions: NDArray[np.float64],
    frames: NDArray[np.float64],
    lower: ArrayLike | None,
    upper: ArrayLike | None,
) -> Grains:
    d = positions.shape[1]
    if grains.positions.shape[1] != d:
        raise InputError("grains.positions", f"{grains.positions.shape[1]}D", f"{d}D like their owners")
    _check_owners(grains, len(positions))
    low = np.full(d, -np.inf) if lower is None else np.ascontiguousarray(lower, dtype=np.float64)
    high = np.full(d, np.inf) if upper is None else np.ascontiguousarray(upper, dtype=np.float64)
    if low.shape != (d,) or high.shape != (d,):
        raise InputError("lower", (lower, upper), f"with `upper` two corners of {d} coordinates (m)")
    owners = np.ascontiguousarray(grains.owners, dtype=np.int64)
    moved = np.empty((len(owners), d))
    place_grains(
        np.ascontiguousarray(grains.positions), owners, before, maps, positions, frames,
        ELLIPSOID_RADII[d], low, high, moved,
    )  # fmt: skip
    return Grains(moved, owners)
