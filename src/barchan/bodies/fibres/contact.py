"""Where fibres may touch one another within a step: capsule proximity of the segments of their centre lines (seed B, 2.2.3).

Broad phase on a grid, exact nearest points of two segments, at most one contact a pair of segments; a contact at a node that
two segments share is counted once, and neighbours on a fibre do not touch. Contact acts on the centre lines: rolling about
them is not resisted.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.contact._grids import Extents, close_pairs
from barchan.bodies.contact.arrays import SEGMENT
from barchan.bodies.fibres import _contact_kernels as kernels
from barchan.errors import InputError

Vector = NDArray[np.float64]
Whole = NDArray[np.int64]

KEY_BITS = 32
NO_FIBRE = -1


@dataclass(frozen=True, eq=False)
class FibreContacts:
    """k contacts sorted by their keys: of the first fibre with a second one or with a body.

    fibres, segments : (k, 2), the second -1 for a body; segments are counted on their fibre from the root.
    shares : (k, 2) 0 to 1 along the segments.  bodies : (k,) number of the body, -1 between fibres.
    points : (k, 3) [m] in the middle of the gap.  normals : (k, 3) unit, from the second to the first.  gaps : (k,) [m].
    keys : (k,) int64, all different; the same places of the same fibres have the same key in every step.
    """

    fibres: Whole
    segments: Whole
    shares: Vector
    bodies: Whole
    points: Vector
    normals: Vector
    gaps: Vector
    keys: Whole

    def __len__(self) -> int:
        return len(self.gaps)

    @classmethod
    def joined(cls, parts: list[FibreContacts]) -> FibreContacts:
        """All contacts of some sets, sorted by key."""
        names = ("fibres", "segments", "shares", "bodies", "points", "normals", "gaps", "keys")
        fields = [np.concatenate([getattr(part, name) for part in parts]) for name in names]
        order = np.argsort(fields[-1], kind="stable")
        return cls(*(field[order] for field in fields))

    def take(self, rows: NDArray[np.bool_] | Whole) -> FibreContacts:
        """Some of them: a mask (k,) or increasing numbers."""
        return FibreContacts(
            self.fibres[rows], self.segments[rows], self.shares[rows], self.bodies[rows], self.points[rows],
            self.normals[rows], self.gaps[rows], self.keys[rows],
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Layout:
    """The segments of fibres whose nodes are node_offsets[i]:node_offsets[i + 1], with their radii (f,) [m].

    Raises InputError for a fibre of less than two nodes or a radius that is not positive.
    """

    node_offsets: Whole
    radii: Vector

    def __post_init__(self) -> None:
        if np.any(np.diff(self.node_offsets) < 2):
            raise InputError("node_offsets", self.node_offsets.tolist(), "two nodes a fibre at least")
        if len(self.radii) != len(self.node_offsets) - 1 or not np.all(self.radii > 0.0):
            raise InputError("radii", np.asarray(self.radii).tolist(), "a positive radius for each fibre (m)")

    @cached_property
    def fibre(self) -> Whole:
        """(g,) fibre of each segment."""
        return np.repeat(np.arange(len(self.radii)), np.diff(self.node_offsets) - 1)

    @cached_property
    def starts(self) -> Whole:
        """(f,) first segment of each fibre."""
        return self.node_offsets[:-1] - np.arange(len(self.radii))

    @cached_property
    def first(self) -> Whole:
        """(g,) node where each segment begins."""
        return np.arange(len(self.fibre)) + self.fibre

    @cached_property
    def end(self) -> Whole:
        """(g,) bits: first of its fibre, last of it."""
        marks = np.zeros(len(self.fibre), dtype=np.int64)
        marks[self.starts] += kernels.ROOT
        marks[np.append(self.starts[1:], len(marks)) - 1] += kernels.TIP
        return marks

    def lengths(self, nodes: Vector) -> Vector:
        """(g,) of the segments [m]."""
        return np.asarray(np.linalg.norm(nodes[self.first + 1] - nodes[self.first], axis=1))

    def arc(self, nodes: Vector) -> Vector:
        """(g,) length of fibre before each segment [m]."""
        before = np.concatenate([[0.0], np.cumsum(self.lengths(nodes))[:-1]])
        return np.asarray(before - before[self.starts][self.fibre])

    def placed(self, nodes: Vector, velocities: Vector) -> kernels.Segments:
        """The segments where they are: nodes (p, 3) [m] with their velocities (p, 3) [m/s]."""
        return kernels.Segments(
            self.first, self.fibre, self.end, self.arc(nodes), self.radii[self.fibre],
            np.ascontiguousarray(nodes), np.ascontiguousarray(velocities),
        )  # fmt: skip


def fibre_contacts(
    layout: Layout, nodes: Vector, velocities: Vector, dt: float, slack: float, bare: float = 0.0
) -> FibreContacts:
    """Contacts between fibres, each with itself too, with gaps up to `slack` [m] and what they close in `dt` [s].

    bare : length of fibre [m] at the roots that touches nothing.
    """
    segments = layout.placed(nodes, velocities)
    pairs = _close_segments(segments, dt, slack)
    near = np.zeros(len(pairs), dtype=np.bool_)
    kernels.near_pairs(segments, pairs, dt, slack, bare, near)
    pairs = pairs[near]
    pairs = pairs[np.argsort((pairs[:, 0] << KEY_BITS) | pairs[:, 1], kind="stable")]
    k = len(pairs)
    shares, gaps, normals, points = np.empty((k, 2)), np.empty(k), np.empty((k, 3)), np.empty((k, 3))
    kernels.write_contacts(segments, pairs, dt, slack, bare, shares, gaps, normals, points)
    fibres = layout.fibre[pairs]
    return FibreContacts(
        fibres, pairs - layout.starts[fibres], shares, np.full(k, NO_FIBRE), points, normals, gaps,
        (pairs[:, 0] << KEY_BITS) | pairs[:, 1],
    )  # fmt: skip


def _close_segments(segments: kernels.Segments, dt: float, slack: float) -> Whole:
    """Pairs (p, 2) of segments, the lower number first, whose ways through the step are near each other."""
    count = len(segments.first)
    middle, half, radius = np.empty((count, 3)), np.empty((count, 3)), np.empty(count)
    # what all have in common brings none together
    drift = np.mean(segments.velocities, axis=0)
    kernels.segment_boxes(segments, drift, dt, slack, middle, half, radius)
    numbers = np.arange(count)
    return close_pairs(
        Extents(
            middle, half, radius, np.full(count, SEGMENT, dtype=np.int64), numbers, np.ones(count, dtype=np.bool_),
            np.zeros((count, 3)), np.zeros(count),
        )
    )  # fmt: skip
