"""Ends of discrete elastic rods: which displacements roots and tips give, and the velocities they give them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.fibres.roots import RootMotion
from barchan.errors import InputError

Vector = NDArray[np.float64]
Whole = NDArray[np.int64]

HELD = {"clamped": 7, "ball": 3, "free": 0}  # node, edge and node; node; none
_PLACE_TOLERANCE = 1e-6  # of a segment length, and of a unit vector


def check_end(name: str, end: RootMotion, last: bool, node_offsets: Whole, nodes: Vector) -> None:
    """Raise InputError unless the positions and tangents of an end are those of the fibres where they start."""
    positions, frames = end.at(0.0)
    which = "last" if last else "first"
    own = node_offsets[1:] - 1 if last else node_offsets[:-1]
    inner = own - 1 if last else own + 1
    edges = nodes[own] - nodes[inner] if last else nodes[inner] - nodes[own]
    lengths = np.linalg.norm(edges, axis=1)
    off = np.linalg.norm(nodes[own] - positions, axis=1) > _PLACE_TOLERANCE * lengths
    if np.any(off):
        k = int(np.argmax(off))
        allowed = f"the {which} node of fibre {k}, {nodes[own[k]].tolist()}"
        raise InputError(f"{name}.positions", positions[k].tolist(), allowed)
    along = np.linalg.norm(edges / lengths[:, None] - frames[:, :, 0], axis=1) > _PLACE_TOLERANCE
    if np.any(along):
        k = int(np.argmax(along))
        allowed = f"with the direction of the {which} edge of fibre {k} first"
        raise InputError(f"{name}.frames", frames[k, :, 0].tolist(), allowed)


def check_directors(name: str, end: RootMotion, directors: Vector) -> None:
    """Raise InputError unless the first material directions of an end are `directors` (f, 3)."""
    first = end.at(0.0)[1][:, :, 1]
    turned = np.linalg.norm(directors - first, axis=1) > _PLACE_TOLERANCE
    if np.any(turned):
        k = int(np.argmax(turned))
        allowed = f"with the material direction {directors[k].tolist()} of fibre {k} second"
        raise InputError(f"{name}.frames", first[k].tolist(), allowed)


def given_velocities(
    end: RootMotion, last: bool, time: float, dt: float, node_offsets: Whole, nodes: Vector, directors: Vector,
    rest: Vector, radii: Vector, motion: Vector,
) -> None:  # fmt: skip
    """Write to `motion` (all displacements, [m/s]) what leads this end from where it is to where it is given at time + dt.

    Absolute, so that errors of earlier steps do not add up. A clamped edge keeps its rest length.
    """
    if end.hold == "free":
        return
    fibres = np.arange(len(node_offsets) - 1)
    positions, frames = end.at(time + dt)
    own = node_offsets[1:] - 1 if last else node_offsets[:-1]
    place = 4 * own - fibres  # of the node among all displacements: an edge follows each node but the last
    axes = np.arange(3)
    motion[place[:, None] + axes] = (positions - nodes[own]) / dt
    if end.hold == "ball":
        return
    side = -1 if last else 1
    edge = own - fibres - (1 if last else 0)
    tangent = frames[:, :, 0]
    target = positions + side * rest[edge][:, None] * tangent
    motion[(place + 4 * side)[:, None] + axes] = (target - nodes[own + side]) / dt
    before = side * (nodes[own + side] - nodes[own])
    before /= np.linalg.norm(before, axis=1)[:, None]
    turned = carried(directors[edge], before, tangent)
    angle = np.arctan2(
        np.sum(np.cross(turned, frames[:, :, 1]) * tangent, axis=1), np.sum(turned * frames[:, :, 1], axis=1)
    )
    motion[place - 1 if last else place + 3] = radii * angle / dt


def carried(vectors: Vector, before: Vector, after: Vector) -> Vector:
    """Vectors (k, 3), each normal to the unit vector `before`, turned by the shortest rotation that takes it to `after`."""
    share = np.sum(vectors * after, axis=1) / (1.0 + np.sum(before * after, axis=1))
    turned: Vector = vectors - share[:, None] * (before + after)
    return turned
