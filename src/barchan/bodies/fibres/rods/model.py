"""Discrete Elastic Rods: fibres that stretch, bend and twist (Bergou et al. 2008; 2010), stepped implicitly (seed B, Eq. 2.16).

Nodes carry mass, edges carry material directions. Per fibre the energy is
sum over edges EA/2 (l / rest - 1)^2 rest + sum over inner nodes ((k - k0) . B (k - k0) + GJ (m - m0)^2) / (2 share).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.fibres.model import FibreSystem, PointRows
from barchan.bodies.fibres.rods import _kernels, checking, ends
from barchan.bodies.fibres.rods.damping import NO_DAMPING, Damping
from barchan.bodies.fibres.rods.mechanics import RodMechanics
from barchan.bodies.fibres.rods.natural import Natural
from barchan.bodies.fibres.rods.section import Section
from barchan.bodies.fibres.rods.shape import FIELDS, RodShape
from barchan.bodies.fibres.roots import RootMotion, StillRoots, frames_along
from barchan.errors import InputError

Vector = NDArray[np.float64]
Whole = NDArray[np.int64]


class Rods(RodMechanics):
    """f rods: a `FibreModel`.

    Parameters
    ----------
    nodes : one array (n + 1, 3) [m] for each fibre, n >= 2; or all in one (p, 3) with `node_offsets` (f + 1,).
    section : cross-section and matter.
    roots : how first nodes are held; default: clamped where they are. Frames have the direction of the first edge and the
        first material direction. tips : the same of last nodes (frames still point from root to tip); default: free.
    natural : "shape", the given one; "straight"; or `Natural`.
    angles : (q,) [rad] by which material directions are turned from those of the root carried along the rod; default 0.
    rest_lengths : (q,) [m] of the edges; default: those given.
    velocities : (p, 3) [m/s] of the nodes at the start; default 0. What ends give has no say here.
    damping : see `Damping`.
    iterations : most linear systems of a step; 1 linearises where the fibres are (seed B, 2.16, truncated).

    Raises InputError for rods that make no sense: see `checking`.
    """

    def __init__(
        self,
        nodes: Sequence[ArrayLike] | ArrayLike,
        section: Section,
        *,
        roots: RootMotion | None = None,
        tips: RootMotion | None = None,
        natural: Natural | Literal["shape", "straight"] = "shape",
        angles: ArrayLike | None = None,
        rest_lengths: ArrayLike | None = None,
        velocities: ArrayLike | None = None,
        damping: Damping = NO_DAMPING,
        node_offsets: ArrayLike | None = None,
        iterations: int = 20,
    ) -> None:
        if iterations < 1:
            raise InputError("iterations", iterations, "at least 1")
        self.iterations = int(iterations)
        points, self.node_offsets = checking.polylines(nodes, node_offsets)
        fibres = len(self.node_offsets) - 1
        self.section = section.for_fibres(fibres)
        self.damping = damping
        self._edge_fibre = np.repeat(np.arange(fibres), np.diff(self.node_offsets) - 1)
        self._inner_fibre = np.repeat(np.arange(fibres), np.diff(self.node_offsets) - 2)
        checking.segments(points, self.node_offsets, self.radii)
        self._set_ends(points, roots, tips)
        directors = self._directors(points, angles)
        given = np.linalg.norm(self._edges(points), axis=1)
        self.rest_lengths = given if rest_lengths is None else checking.lengths(rest_lengths, len(given))
        self.shares = self._shares()
        self._set_masses()
        self._start = self._first_shape(points, directors, velocities)
        self.natural = self._natural(natural)

    def _set_ends(self, points: Vector, roots: RootMotion | None, tips: RootMotion | None) -> None:
        """Roots, tips, and which displacements are left to solve for."""
        first = self.node_offsets[:-1]
        if roots is None:
            roots = StillRoots(points[first], frames_along(points[first + 1] - points[first]))
        checking.end_counts(roots, tips, len(self.radii))
        self.roots, self.tips = roots, tips
        ends.check_end("roots", roots, False, self.node_offsets, points)
        if tips is not None:
            ends.check_end("tips", tips, True, self.node_offsets, points)
        self._held = (ends.HELD[roots.hold], ends.HELD[tips.hold] if tips else 0)
        sizes = 4 * np.diff(self.node_offsets) - 1 - sum(self._held)
        if np.any(sizes <= 0):
            k = int(np.argmin(sizes))
            raise InputError(
                "tips", f"held, and the root of fibre {k}", "held apart: they hold the same nodes"
            )
        self.offsets: Whole = np.concatenate([[0], np.cumsum(sizes)])
        self._block_offsets: Whole = np.concatenate([[0], np.cumsum(sizes * sizes)])
        skipped = np.arange(len(sizes)) * sum(self._held) + self._held[0]
        self.free = np.arange(self.offsets[-1]) + np.repeat(skipped, sizes)

    def _directors(self, points: Vector, angles: ArrayLike | None) -> Vector:
        """First material directions (q, 3): those of the roots carried along, then turned."""
        straight = np.zeros((len(self._edge_fibre), 3))
        straight[self.node_offsets[:-1] - np.arange(len(self.radii))] = self.roots.at(0.0)[1][:, :, 1]
        turns = (
            np.zeros(len(straight)) if angles is None else checking.numbers("angles", angles, len(straight))
        )
        _kernels.carry_along(self.node_offsets, points, turns, straight)
        if self.tips is not None and self.tips.hold == "clamped":
            last = self.node_offsets[1:] - np.arange(len(self.radii)) - 2
            ends.check_directors("tips", self.tips, straight[last])
        return straight

    def _shares(self) -> Vector:
        """(k,) lengths that inner nodes stand for [m]: half of both edges; all of an edge that is clamped, for it bends too.

        A cantilever is then clamped at its first node, with errors of second order in the length of edges.
        """
        before = np.flatnonzero(np.diff(self._edge_fibre, append=-1) == 0)  # edges with another after them
        shares = 0.5 * (self.rest_lengths[before] + self.rest_lengths[before + 1])
        fibres = np.arange(len(self.radii))
        for end, inner, edge in (
            (self.roots, self.node_offsets[:-1] - 2 * fibres, self.node_offsets[:-1] - fibres),
            (self.tips, self.node_offsets[1:] - 2 * fibres - 3, self.node_offsets[1:] - fibres - 2),
        ):
            if end is not None and end.hold == "clamped":
                shares[inner] += 0.5 * self.rest_lengths[edge]
        return shares

    def _set_masses(self) -> None:
        """(all,) masses of displacements [kg] and air friction [kg/s]: half of each edge at its nodes, spins over radius."""
        mass, air = np.zeros(self.size), np.zeros(self.size)
        edge_place = 4 * (np.arange(len(self.rest_lengths)) + self._edge_fibre) - self._edge_fibre
        half = 0.5 * self.rest_lengths
        for c in range(3):
            for place in (edge_place + c, edge_place + 4 + c):
                np.add.at(mass, place, half * self.section.mass[self._edge_fibre])
                np.add.at(air, place, half * self.damping.air)
        mass[edge_place + 3] = (self.section.inertia / self.radii**2)[self._edge_fibre] * self.rest_lengths
        self.masses, self._air = mass, air
        self.is_node = np.ones(self.size, dtype=np.bool_)
        self.is_node[edge_place + 3] = False
        sections = self.section
        moduli = (
            sections.bending[:, 0, 0],
            sections.bending[:, 0, 1],
            sections.bending[:, 1, 1],
            sections.twisting,
        )
        self._stiffness = np.ascontiguousarray(np.column_stack([*moduli, sections.stretching]))

    def _first_shape(self, points: Vector, directors: Vector, velocities: ArrayLike | None) -> RodShape:
        """Where the fibres start."""
        motion = np.zeros(self.size)
        if velocities is not None:
            motion[self.is_node] = checking.table("velocities", velocities, len(points)).ravel()
        inner = len(self._inner_fibre)
        strains = (np.zeros((inner, 2)), np.zeros(inner))
        blank = RodShape(0.0, points, directors, *strains, motion, motion[self.free])
        # angles may turn by more than half a turn in all, not from one edge to the next
        return self.displaced(blank, np.zeros(self.size))

    def _natural(self, natural: Natural | str) -> Natural:
        """Natural strains."""
        if natural == "shape":
            return Natural(self._start.curvatures, self._start.twists)
        if natural == "straight":
            return Natural(np.zeros_like(self._start.curvatures), np.zeros_like(self._start.twists))
        if not isinstance(natural, Natural):
            raise InputError("natural", natural, '"shape", "straight" or Natural(curvatures, twists)')
        return checking.natural_strains(natural, len(self._inner_fibre))

    # -- FibreModel ---------------------------------------------------------------------------------------------------

    def started(self) -> RodShape:
        """The fibres where they start."""
        return self._start

    def restored(self, arrays: Mapping[str, NDArray[Any]]) -> RodShape:
        """The state that `arrays()` of a shape wrote; raises InputError when it is not of these fibres."""
        shape = RodShape.from_arrays(arrays)
        for name in FIELDS:
            if getattr(shape, name).shape != getattr(self._start, name).shape:
                raise InputError(
                    f"fibres.{name}", getattr(shape, name).shape, f"{getattr(self._start, name).shape}"
                )
        return shape

    def centre_line(self, shape: RodShape) -> Vector:
        """(p, 3) nodes of all fibres [m]."""
        return shape.nodes

    def node_velocities(self, shape: RodShape) -> Vector:
        """(p, 3) velocities of the nodes [m/s]."""
        return shape.motion[self.is_node].reshape(-1, 3)

    def system(self, shape: RodShape, dt: float, gravity: Vector) -> FibreSystem:
        """Implicit Euler from `shape`: A = M/dt + dt K + damping, f = M v/dt + M g + elastic forces + dt K v*.

        K and the forces are those where Newton's method finds the fibres at the end of a step without contact, at velocities
        v*: after at most `iterations` - 1 linear systems, three or so in a quiet step. In one step of one linear system edges
        that turn grow longer, to second order; the tension that takes this back brakes a swing as thick air would.
        K is the Hessian. Where A would have less than half the inertia of M / dt in some motion (buckling), the fibre takes
        J^T K J and the stiffness of tension instead, positive semidefinite (seed B, after Eq. 2.16).
        """
        return self.implicit_system(shape, dt, gravity, self.given_velocities(shape, dt))

    def rows(self, shape: RodShape, dt: float, fibre: Whole, segment: Whole, share: Vector) -> PointRows:
        """Rows of points at `share` of the `segment` of `fibre`."""
        orders = np.diff(self.offsets)[fibre]
        starts: Whole = (
            3 * np.concatenate([[0], np.cumsum(orders)[:-1]]) if len(fibre) else np.zeros(0, dtype=np.int64)
        )
        values, drift = np.empty(3 * int(orders.sum())), np.empty((len(fibre), 3))
        moving = self.given_velocities(shape, dt)
        _kernels.point_rows(
            np.ascontiguousarray(fibre, dtype=np.int64), np.ascontiguousarray(segment, dtype=np.int64),
            np.ascontiguousarray(share, dtype=np.float64), self.node_offsets, self.offsets, self._held,
            moving, starts, values, drift,
        )  # fmt: skip
        return PointRows(values, starts, drift)

    def moved(self, shape: RodShape, velocities: Vector, dt: float) -> RodShape:
        """The fibres after a step of `dt` at end velocities (m,): nodes move straight, directions are carried along."""
        motion = self.given_velocities(shape, dt)
        motion[self.free] = velocities
        after = self.displaced(shape, dt * motion)
        return replace(
            after, time=shape.time + dt, motion=motion, velocities=np.array(velocities, dtype=np.float64)
        )
