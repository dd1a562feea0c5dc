"""Time steps too long for detection: bodies that go through another, or sink in by more than half, in one step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.contact._grids import close_pairs
from barchan.bodies.contact.geometry import ContactGeometry
from barchan.bodies.contact.narrow import contacts_of
from barchan.bodies.rigid import BodyStates, inputs
from barchan.errors import InputError

MOST_LOOKS = 200  # along the way of a fast body


@dataclass(frozen=True, eq=False)
class Crossings:
    """Pairs of bodies of which one would cross the other in one step.

    first, second : (m,) numbers of the bodies.  ways : (m,) [m] of one relative to the other in the step.
    allowed : (m,) [m] ways that are short enough: the half thicknesses of both; planes, meshes, signed distances count zero.
    """

    first: NDArray[np.int32]
    second: NDArray[np.int32]
    ways: NDArray[np.float64]
    allowed: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.ways)

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """The pairs of numbers."""
        return list(zip(self.first.tolist(), self.second.tolist(), strict=True))


def crossing(
    geometry: ContactGeometry, states: BodyStates, velocities: NDArray[np.float64] | None, dt: float
) -> Crossings:
    """Pairs that would meet on their way within `dt` [s], that way being longer than their half thicknesses.

    velocities : (b, d) [m/s] of the origins, by default those of the states; bodies do not turn on the way. Such a pair may be
    found on the wrong side of each other after the step: a shorter step, or `velocities_dt` in `detect`, is called for.
    InputError: dt not positive, velocities of another shape.
    """
    inputs.positive("dt", dt)
    speeds = states.velocities if velocities is None else np.asarray(velocities, dtype=np.float64)
    if speeds.shape != states.velocities.shape:
        raise InputError("velocities", speeds.shape, f"an array of shape {states.velocities.shape}")
    placed = geometry.placed(states)
    drift = np.zeros((len(states), 3))
    drift[:, : geometry.dimension] = dt * speeds
    extents = geometry.extents(placed, np.zeros(len(states)), drift, np.zeros(len(states)))
    pairs = geometry.without_ignored(close_pairs(extents))
    thickness = placed.cores.radius + placed.cores.inner
    allowed = thickness[pairs[:, 0]] + thickness[pairs[:, 1]]
    way = np.linalg.norm(drift[geometry.body[pairs[:, 0]]] - drift[geometry.body[pairs[:, 1]]], axis=1)
    fast = np.flatnonzero(way > allowed)
    pairs, allowed, way = pairs[fast], allowed[fast], way[fast]
    met = _meets_on_way(geometry, states, pairs, allowed, way, dt * speeds)
    bodies = geometry.body[pairs[met]].astype(np.int32)
    return Crossings(bodies[:, 0], bodies[:, 1], way[met], allowed[met])


def _meets_on_way(
    geometry: ContactGeometry, states: BodyStates, pairs: NDArray[np.int64], allowed: NDArray[np.float64],
    way: NDArray[np.float64], moves: NDArray[np.float64],
) -> NDArray[np.bool_]:  # fmt: skip
    """Whether each pair overlaps at one of the places looked at along the way, no further apart than half the allowed way."""
    met = np.zeros(len(pairs), dtype=np.bool_)
    if len(pairs) == 0:
        return met
    looks = min(MOST_LOOKS, int(np.ceil(2.0 * float(np.max(way / np.maximum(allowed, 1e-300))))) + 1)
    # looks that are further apart must not miss a meeting in between
    limits = 0.5 * np.maximum(0.0, way / looks - allowed)
    for share in np.arange(1, looks + 1) / looks:
        left = np.flatnonzero(~met)
        if len(left) == 0:
            break
        on_way = BodyStates(
            states.positions + share * moves, states.rotations, states.velocities, states.spins
        )
        raw = contacts_of(geometry, geometry.placed(on_way), pairs[left], limits[left])
        touched = {tuple(sorted(pair)) for part in raw for pair in part.pieces.tolist()}
        met[left] = [tuple(pair) in touched for pair in pairs[left].tolist()]
    return met
