"""Contact detection: the shapes of bodies compiled once into flat arrays, and all contacts in a given state of the bodies.

geometry = ContactGeometry.of(bodies, dimension=3)
contacts = geometry.detect(states, reach=1e-3)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.contact._clipping import FEATURE_BITS
from barchan.bodies.contact._grids import Extents, close_pairs
from barchan.bodies.contact._placing import boxes, place_cores, turns_of
from barchan.bodies.contact.arrays import PLANE, Cores, Meshes, Placed
from barchan.bodies.contact.compiling import compiled_cores, compiled_meshes
from barchan.bodies.contact.contact_set import ContactSet, merged
from barchan.bodies.contact.narrow import check_pairs, contacts_of
from barchan.bodies.contact.pieces import Piece, pieces_of
from barchan.bodies.rigid import Body, BodyStates, inputs
from barchan.errors import InputError

Vector = NDArray[np.float64]
MOST_PIECES = 2**FEATURE_BITS - 1


@dataclass(frozen=True, eq=False)
class ContactGeometry:
    """The shapes of `bodies` taken apart into g pieces, in the frames of the bodies.

    dimension : d.  pieces : one a convex part, plane, mesh or signed distance; body, kind (g,) of each.
    cores, meshes : flat arrays of them.  movable (b,), centres (b, 3): whether a body can move, and its centre of mass.
    ignored : sorted codes first * b + second of pairs of bodies that never touch.
    """

    bodies: Sequence[Body]
    dimension: int
    pieces: tuple[Piece, ...]
    body: NDArray[np.int64]
    kind: NDArray[np.int64]
    cores: Cores
    meshes: Meshes
    movable: NDArray[np.bool_]
    centres: Vector
    ignored: NDArray[np.int64]

    @classmethod
    def of(
        cls, bodies: Sequence[Body], dimension: int, ignored: Sequence[tuple[int, int]] = ()
    ) -> ContactGeometry:
        """Compile bodies of one dimension; `ignored` names pairs of bodies, by number, that never touch.

        InputError: a body of another dimension, a pair of shapes without a contact test of which one body can move, numbers in
        `ignored` that are not those of bodies.
        """
        if dimension not in (2, 3):
            raise InputError("dimension", dimension, "2 or 3")
        for number, body in enumerate(bodies):
            if body.dimension != dimension:
                raise InputError(_name(bodies, number), body.dimension, f"a body of dimension {dimension}")
        known = {id(shape): pieces_of(shape) for shape in {id(b.shape): b.shape for b in bodies}.values()}
        of_body = [known[id(b.shape)] for b in bodies]
        pieces = tuple(piece for parts in of_body for piece in parts)
        if len(pieces) > MOST_PIECES:
            raise InputError("bodies", len(pieces), f"at most {MOST_PIECES} pieces in all")
        owners = np.repeat(np.arange(len(bodies)), [len(parts) for parts in of_body]).astype(np.int64)
        movable = np.array([not body.driven for body in bodies], dtype=np.bool_)
        kinds = np.array([piece.kind for piece in pieces], dtype=np.int64)
        codes = [_pair_code(pair, len(bodies)) for pair in ignored]
        check_pairs(bodies, pieces, kinds, owners, movable)
        centres = np.zeros((len(bodies), 3))
        if bodies:
            centres[:, :dimension] = [body.centre for body in bodies]
        return cls(
            bodies, dimension, pieces, owners, kinds, compiled_cores(pieces), compiled_meshes(pieces), movable,
            centres, np.unique(np.array(codes, dtype=np.int64)),
        )  # fmt: skip

    def detect(
        self, states: BodyStates, reach: float | Vector, velocities_dt: float | None = None
    ) -> ContactSet:
        """All contacts with gaps up to `reach` [m]; bodies that cannot move never touch one another.

        reach : of all pairs, or a share for each body (b,), those of the two bodies of a pair adding up.
        velocities_dt : [s], also those whose gap would fall below the reach within that time at the present velocities.
        InputError: reach negative or of another shape, velocities_dt not positive, states of other bodies.
        """
        if velocities_dt is not None:
            inputs.positive("velocities_dt", velocities_dt)
        if len(states) != len(self.bodies) or states.dimension != self.dimension:
            raise InputError("states", states.positions.shape, f"those of the {len(self.bodies)} bodies")
        shares = _shares(reach, len(self.bodies))
        if not self.pieces:
            return merged([], self.body, self.dimension)
        placed = self.placed(states)
        drift, swing = self.ways(states, placed, velocities_dt)
        extents = self.extents(placed, shares, drift, swing)
        pairs = self.without_ignored(close_pairs(extents))
        limits = shares[self.body[pairs[:, 0]]] + shares[self.body[pairs[:, 1]]]
        if velocities_dt is not None:
            limits += approach(placed, extents, pairs, drift, swing)
        contacts = merged(contacts_of(self, placed, pairs, limits), self.body, self.dimension)
        if velocities_dt is None:
            return contacts
        ways = velocities_dt * np.maximum(self.closing_speeds(states, placed, contacts), 0.0)
        return contacts.take(contacts.gaps - ways <= shares[contacts.first] + shares[contacts.second])

    def placed(self, states: BodyStates) -> Placed:
        """All pieces in the world."""
        turns = np.empty((len(states), 3, 3))
        turns_of(states.rotations, turns)
        places = np.zeros((len(states), 3))
        places[:, : self.dimension] = states.positions
        world = self.cores._replace(
            centre=np.empty_like(self.cores.centre),
            vertices=np.empty_like(self.cores.vertices),
            normals=np.empty_like(self.cores.normals),
        )
        place_cores(self.cores, world, self.body, turns, places)
        normal, offset = np.zeros((len(self.pieces), 3)), np.zeros(len(self.pieces))
        for g in np.flatnonzero(self.kind == PLANE):
            b, piece = self.body[g], self.pieces[g]
            normal[g] = turns[b] @ piece.normal
            offset[g] = piece.offset + normal[g] @ places[b]
        return Placed(world, normal, offset, turns, places, self.body)

    def ways(self, states: BodyStates, placed: Placed, dt: float | None) -> tuple[Vector, Vector]:
        """How far the origins of the bodies go in `dt` at their present velocities (b, 3) [m], and turn (b,) [rad]."""
        if dt is None:
            return np.zeros((len(states), 3)), np.zeros(len(states))
        velocities, spins = self._in_space(states)
        arms = np.einsum("bij,bj->bi", placed.turns, self.centres)
        return dt * (velocities - np.cross(spins, arms)), dt * np.linalg.norm(spins, axis=1)

    def extents(self, placed: Placed, margins: Vector, drift: Vector, swing: Vector) -> Extents:
        """Boxes and balls that hold each piece on its way, wider by the `margins` (b,) [m] of the bodies."""
        count = len(self.pieces)
        lower, upper = self.boxes
        middle, half, radius = np.empty((count, 3)), np.empty((count, 3)), np.empty(count)
        boxes(
            placed.cores, self.kind, self.body, placed.turns, placed.places, lower, upper, margins, drift, swing,
            middle, half, radius,
        )  # fmt: skip
        movable = self.movable[self.body]
        return Extents(
            middle, half, radius, self.kind, self.body, movable, placed.plane_normal, placed.plane_offset
        )

    @cached_property
    def boxes(self) -> tuple[Vector, Vector]:
        """Lower and upper corners (g, 3) of the boxes of the pieces in the frames of their bodies."""
        return np.array([p.lower for p in self.pieces]), np.array([p.upper for p in self.pieces])

    @cached_property
    def room(self) -> int:
        """Corners that a polygon cut by another can have at most, eight or more."""
        return max(8, 2 * int(np.max(np.diff(self.cores.ring_start), initial=0)) + 4)

    @cached_property
    def room_of_one(self) -> tuple[int, int, int, int]:
        """Most corners, faces, entries of rings, and edges of a single core."""
        cores = self.cores
        rings = cores.ring_start[cores.face_start[1:]] - cores.ring_start[cores.face_start[:-1]]
        counts = (np.diff(cores.vertex_start), np.diff(cores.face_start), rings, np.diff(cores.edge_start))
        vertices, faces, entries, edges = (int(np.max(count, initial=1)) for count in counts)
        return vertices, faces, entries, edges

    def without_ignored(self, pairs: NDArray[np.int64]) -> NDArray[np.int64]:
        """The pairs of pieces (p, 2) whose bodies may touch."""
        if len(self.ignored) == 0:
            return pairs
        codes = self.body[pairs[:, 0]] * len(self.bodies) + self.body[pairs[:, 1]]
        return pairs[~np.isin(codes, self.ignored)]

    def closing_speeds(self, states: BodyStates, placed: Placed, contacts: ContactSet) -> Vector:
        """Speeds (k,) [m/s] at which the gaps shrink, bodies being rigid."""
        velocities, spins = self._in_space(states)
        middles = placed.places + np.einsum("bij,bj->bi", placed.turns, self.centres)
        points, normals = np.zeros((len(contacts), 3)), np.zeros((len(contacts), 3))
        points[:, : self.dimension], normals[:, : self.dimension] = contacts.points, contacts.normals
        speeds = [
            velocities[body] + np.cross(spins[body], points - middles[body])
            for body in (contacts.first, contacts.second)
        ]
        return -np.einsum("ki,ki->k", speeds[0] - speeds[1], normals)

    def _in_space(self, states: BodyStates) -> tuple[Vector, Vector]:
        """Velocities and spins (b, 3), z = 0 and spins about z in the plane."""
        if self.dimension == 3:
            return states.velocities, states.spins
        velocities, spins = np.zeros((len(states), 3)), np.zeros((len(states), 3))
        velocities[:, :2], spins[:, 2:] = states.velocities, states.spins
        return velocities, spins


def approach(
    placed: Placed, extents: Extents, pairs: NDArray[np.int64], drift: Vector, swing: Vector
) -> Vector:
    """How much nearer (p,) [m] two pieces can come on their ways: a bound, taken about the smaller of the two."""
    a, b = pairs.T
    small = np.where(extents.radius[a] <= extents.radius[b], a, b)
    bodies = placed.body[a], placed.body[b]
    ways = np.linalg.norm(drift[bodies[0]] - drift[bodies[1]], axis=1)
    for body in bodies:
        arms = np.linalg.norm(extents.middle[small] - placed.places[body], axis=1) + extents.radius[small]
        ways += np.where(swing[body] > 0.0, swing[body] * np.where(np.isfinite(arms), arms, 0.0), 0.0)
    return ways


def _shares(reach: float | Vector, bodies: int) -> Vector:
    """What each body adds to the reach of a pair (b,)."""
    if np.ndim(reach) == 0:
        return np.full(bodies, 0.5 * inputs.not_negative("reach", float(reach)))
    shares = np.asarray(reach, dtype=np.float64)
    if shares.shape != (bodies,) or not np.all(np.isfinite(shares)) or np.any(shares < 0.0):
        raise InputError("reach", reach, f"a number >= 0, or one for each of the {bodies} bodies")
    return shares


def _pair_code(pair: tuple[int, int], bodies: int) -> int:
    first, second = min(pair), max(pair)
    if not 0 <= first < second < bodies:
        raise InputError("ignored", pair, f"two different numbers of the {bodies} bodies")
    return first * bodies + second


def _name(bodies: Sequence[Body], number: int) -> str:
    return f"body {bodies[number].name or f'number {number}'}"
