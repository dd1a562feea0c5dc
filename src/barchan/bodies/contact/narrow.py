"""Narrow phase: close pairs of pieces sorted by kind, each kind to its own kernel, and what cannot be tested refused."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.contact._ball_mesh import CONTACTS, ball_mesh_pairs
from barchan.bodies.contact._core_mesh_pairs import MESH_WIDTH, core_mesh_pairs
from barchan.bodies.contact._manifolds import core_pairs, plane_pairs
from barchan.bodies.contact._round import ball_pairs, segment_pairs
from barchan.bodies.contact.arrays import BALL, FIELD, MESH, PLANE, POLYTOPE, SEGMENT, Placed, Slots
from barchan.bodies.contact.contact_set import RawContacts
from barchan.bodies.contact.pieces import Piece
from barchan.bodies.rigid import Body
from barchan.errors import InputError

if TYPE_CHECKING:
    from barchan.bodies.contact.geometry import ContactGeometry

Numbers = NDArray[np.int64]
Vector = NDArray[np.float64]
# pairs of kinds, the lower first, that have no contact test
_UNTESTED = (
    {(kind, FIELD) for kind in (SEGMENT, POLYTOPE, PLANE, MESH, FIELD)} | {(PLANE, MESH), (MESH, MESH)}
)  # fmt: skip


def check_pairs(
    bodies: Sequence[Body],
    pieces: Sequence[Piece],
    kinds: Numbers,
    owners: Numbers,
    movable: NDArray[np.bool_],
) -> None:
    """Refuse bodies with a pair of pieces that have no contact test, and one of which can move: InputError names them."""
    for low, high in sorted(_UNTESTED):
        a, b = np.flatnonzero(kinds == low), np.flatnonzero(kinds == high)
        for one, others in ((a, b), (b, a)):
            moving = one[movable[owners[one]]]
            if len(moving) == 0:
                continue
            for other in others:
                apart = moving[owners[moving] != owners[other]]
                if len(apart):
                    pair = sorted((int(apart[0]), int(other)))
                    found = " and ".join(f"{_name(bodies, owners[g])}: {pieces[g].label}" for g in pair)
                    raise InputError("bodies", found, "shapes that can be tested for contact with each other")


def _name(bodies: Sequence[Body], number: int) -> str:
    return bodies[number].name or f"number {number}"


def contacts_of(
    geometry: ContactGeometry, placed: Placed, pairs: Numbers, limits: Vector
) -> list[RawContacts]:
    """Contacts of close pairs (p, 2) with gaps up to limits (p,)."""
    kinds = geometry.kind[pairs]
    turned = kinds[:, 0] > kinds[:, 1]
    if np.any(turned):
        pairs = np.where(turned[:, None], pairs[:, ::-1], pairs)
        kinds = np.where(turned[:, None], kinds[:, ::-1], kinds)
    codes = kinds[:, 0] * 8 + kinds[:, 1]
    present = np.flatnonzero(np.bincount(codes, minlength=64))
    found = []
    for code in present:
        chosen = slice(None) if len(present) == 1 else np.flatnonzero(codes == code)
        of_kind = np.ascontiguousarray(pairs[chosen])
        found.append(_of_kinds(geometry, placed, int(code) // 8, int(code) % 8, of_kind, limits[chosen]))
    return found


def _of_kinds(
    geometry: ContactGeometry, placed: Placed, low: int, high: int, pairs: Numbers, limits: Vector
) -> RawContacts:
    """Contacts of pairs of one piece of kind `low` with one of kind `high`."""
    plane = geometry.dimension == 2
    width = 2 if plane else 4
    cores, frames = placed.cores, (placed.cores, placed.turns, placed.places, placed.body)
    if high == FIELD:
        return _with_fields(geometry, placed, pairs, limits)
    if high == BALL:
        slots = Slots.empty(len(pairs), 1)
        ball_pairs(cores, pairs, limits, slots)
    elif high == SEGMENT:
        slots = Slots.empty(len(pairs), 2)
        segment_pairs(cores, pairs, limits, slots)
    elif high == POLYTOPE:
        slots = Slots.empty(len(pairs), 1 if low == BALL else width)
        core_pairs(cores, pairs, limits, geometry.room, plane, slots)
    elif high == PLANE:
        slots = Slots.empty(len(pairs), 1 if low == BALL else width)
        plane_pairs(cores, placed.plane_normal, placed.plane_offset, pairs, limits, geometry.room, slots)
    elif low == BALL:
        slots = Slots.empty(len(pairs), CONTACTS)
        ball_mesh_pairs(*frames, geometry.meshes, pairs, limits, slots)
    else:
        slots = Slots.empty(len(pairs), MESH_WIDTH)
        core_mesh_pairs(*frames, geometry.meshes, pairs, limits, *geometry.room_of_one, slots)
    return _compacted(pairs, slots)


def _compacted(pairs: Numbers, slots: Slots) -> RawContacts:
    """The slots that are used, one after the other."""
    if slots.gaps.shape[1] == 1:
        rows = np.flatnonzero(slots.used)
        return RawContacts(
            pairs[rows],
            slots.points[rows, 0],
            slots.normals[rows, 0],
            slots.gaps[rows, 0],
            slots.features[rows, 0],
        )
    used = np.arange(slots.gaps.shape[1]) < slots.used[:, None]
    return RawContacts(
        np.repeat(pairs, slots.used, axis=0), slots.points[used], slots.normals[used], slots.gaps[used],
        slots.features[used],
    )  # fmt: skip


def _with_fields(geometry: ContactGeometry, placed: Placed, pairs: Numbers, limits: Vector) -> RawContacts:
    """One contact of each ball with each signed distance nearer than its limit, by the distance of the ball's middle."""
    d = geometry.dimension
    gaps, normals = np.full(len(pairs), np.inf), np.zeros((len(pairs), 3))
    centres, radii = placed.cores.centre[pairs[:, 0]], placed.cores.radius[pairs[:, 0]]
    for g in np.unique(pairs[:, 1]):
        rows = np.flatnonzero(pairs[:, 1] == g)
        shape, b = geometry.pieces[g].shape, geometry.body[g]
        assert shape is not None
        turn = placed.turns[b, :d, :d]
        local = np.ascontiguousarray((centres[rows, :d] - placed.places[b, :d]) @ turn)
        gaps[rows] = shape.signed_distance(local) - radii[rows]
        near = gaps[rows] <= limits[rows]
        normals[rows[near], :d] = -shape.normals(local[near]) @ turn.T
    kept = np.flatnonzero(gaps <= limits)
    points = centres[kept] + (radii[kept] + 0.5 * gaps[kept])[:, None] * normals[kept]
    return RawContacts(pairs[kept], points, normals[kept], gaps[kept], np.zeros(len(kept), dtype=np.int64))
