"""Kinematics of pieces of constant twist and curvatures: from coordinates to places, and to how places move.

A point is told by its piece and its arc length on it. The equations are in `_kinematics`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from barchan.bodies.fibres.helices import _kinematics
from barchan.bodies.fibres.model import Vector, Whole
from barchan.errors import InputError


@dataclass(frozen=True, eq=False)
class Placed:
    """Pieces in space: `starts` (p + f, 3), `frames` (p + f, 3, 3), tips included, and their derivatives psi, chi (p, 3, 3)."""

    starts: Vector
    frames: Vector
    psi: Vector
    chi: Vector


@dataclass(frozen=True, eq=False)
class Pieces:
    """How f fibres are cut: `lengths` (p,) of the pieces [m], `firsts` (f + 1,) first piece of each fibre; see `even_pieces`.

    Raises InputError for lengths that are not positive, or fibres without a piece.
    """

    lengths: Vector
    firsts: Whole

    def __post_init__(self) -> None:
        lengths = np.ascontiguousarray(np.atleast_1d(np.array(self.lengths, dtype=np.float64)))
        if lengths.ndim != 1 or not np.all(np.isfinite(lengths)) or np.any(lengths <= 0.0):
            raise InputError("lengths", self.lengths, "positive lengths of pieces (m)")
        bounds = np.asarray(self.firsts)
        if (
            bounds.ndim != 1 or len(bounds) < 2 or not np.issubdtype(bounds.dtype, np.integer)
            or bounds[0] != 0 or bounds[-1] != len(lengths) or np.any(np.diff(bounds) < 1)
        ):  # fmt: skip
            raise InputError(
                "firsts", self.firsts, f"whole numbers growing from 0 to the {len(lengths)} pieces"
            )
        object.__setattr__(self, "lengths", lengths)
        object.__setattr__(self, "firsts", np.ascontiguousarray(bounds, dtype=np.int64))

    def __len__(self) -> int:
        return len(self.lengths)

    @property
    def fibres(self) -> int:
        """Number of fibres f."""
        return len(self.firsts) - 1

    @cached_property
    def owners(self) -> Whole:
        """(p,) fibre of each piece."""
        return np.repeat(np.arange(self.fibres), np.diff(self.firsts))

    def orders(self, pieces: Whole) -> Whole:
        """(k,) number of coordinates of the fibres that own `pieces` (k,)."""
        whole: Whole = 3 * np.diff(self.firsts)[self.owners[pieces]]
        return whole

    def placed(self, q: Vector, positions: Vector, frames: Vector) -> Placed:
        """The pieces in space at coordinates q (p, 3) [1/m], from roots at `positions` (f, 3) with `frames` (f, 3, 3)."""
        p, f = len(self), self.fibres
        out = Placed(np.empty((p + f, 3)), np.empty((p + f, 3, 3)), np.empty((p, 3, 3)), np.empty((p, 3, 3)))
        roots, turns = np.ascontiguousarray(positions), np.ascontiguousarray(frames)
        _kinematics.place(
            q, self.lengths, self.firsts, roots, turns, out.starts, out.frames, out.psi, out.chi
        )
        return out

    def places(self, q: Vector, placed: Placed, pieces: Whole, arcs: Vector) -> Vector:
        """Places (k, 3) [m] of the points at arc lengths `arcs` (k,) of `pieces` (k,)."""
        out = np.empty((len(pieces), 3))
        _kinematics.points_at(pieces, arcs, self.owners, q, placed.starts, placed.frames, out)
        return out

    def motions(
        self, q: Vector, placed: Placed, pieces: Whole, arcs: Vector, places: Vector
    ) -> tuple[Vector, Whole]:
        """Derivatives of `places` by the coordinates of their fibres: blocks (3, m_i) in a row, starts (k,) of each."""
        bounds = np.concatenate([[0], np.cumsum(3 * self.orders(pieces))]).astype(np.int64)
        out, room = np.empty(bounds[-1]), np.empty((len(pieces), 3, 3))
        _kinematics.jacobians(
            pieces, arcs, places, self.owners, self.firsts, q, placed.starts, placed.frames, placed.psi, placed.chi, room,
            bounds[:-1], out,
        )  # fmt: skip
        return out, bounds[:-1]

    def velocities(self, q: Vector, rates: Vector, placed: Placed, pieces: Whole, arcs: Vector) -> Vector:
        """(k, 3) velocities of points [m/s] at rates (3 p,) of q, the roots being at rest."""
        linear, spins, room = np.empty_like(q), np.empty_like(q), np.empty((len(pieces), 3, 3))
        v = np.ascontiguousarray(rates).reshape(-1, 3)
        _kinematics.carried(v, self.firsts, placed.starts, placed.psi, placed.chi, linear, spins)
        out = np.empty((len(pieces), 3))
        _kinematics.velocities_at(
            pieces, arcs, self.owners, q, v, placed.starts, placed.frames, linear, spins, room, out
        )
        return out

    def quadrature(self, count: int) -> tuple[Whole, Vector, Vector]:
        """Piece (k,), arc length (k,) [m] and length stood for (k,) [m] of `count` Gauss points on each piece."""
        x, w = np.polynomial.legendre.leggauss(count)
        arcs = (0.5 * self.lengths[:, None] * (1.0 + x)).reshape(-1)
        pieces = np.repeat(np.arange(len(self)), count)
        return pieces, arcs, (0.5 * self.lengths[:, None] * w).reshape(-1)

    def nodes(self, per_piece: int) -> tuple[Whole, Vector, Whole]:
        """Piece and arc length of the root of each fibre and of the ends of `per_piece` equal segments of its pieces.

        The third array (f + 1,) is the first node of each fibre.
        """
        offsets = per_piece * self.firsts + np.arange(self.fibres + 1)
        pieces, arcs = np.zeros(offsets[-1], np.int64), np.zeros(offsets[-1])
        pieces[offsets[:-1]] = self.firsts[:-1]
        inner = np.ones(len(pieces), bool)
        inner[offsets[:-1]] = False
        pieces[inner] = np.repeat(np.arange(len(self)), per_piece)
        arcs[inner] = (self.lengths[:, None] * np.arange(1, per_piece + 1) / per_piece).reshape(-1)
        return pieces, arcs, offsets


def even_pieces(lengths: ArrayLike, pieces: int | ArrayLike) -> tuple[Vector, Whole]:
    """Lengths (p,) [m] of the pieces, and the first piece of each fibre (f + 1,), for fibres of `lengths` (f,) cut evenly.

    pieces : how many, for all or (f,).
    """
    total = np.atleast_1d(np.array(lengths, dtype=np.float64))
    if total.ndim != 1 or not np.all(np.isfinite(total)) or np.any(total <= 0.0):
        raise InputError("lengths", lengths, "positive numbers (m), one a fibre")
    given = np.asarray(pieces)
    if (
        not np.issubdtype(given.dtype, np.integer)
        or np.any(given < 1)
        or given.shape not in ((), total.shape)
    ):
        raise InputError("pieces", pieces, f"a whole number >= 1, or {len(total)} of them")
    counts = np.broadcast_to(given, total.shape)
    firsts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return np.repeat(total / counts, counts), firsts
