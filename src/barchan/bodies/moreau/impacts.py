"""Restitution that makes no energy.

Newton's coefficients bound the relative velocity after an impact, not its work: where a blow turns the sliding of a slender
body back, friction may give more than the normal direction loses (Kane and Levinson, Dynamics: Theory and Applications, 1985).
Impacts that hang together, through bodies that move, therefore share a factor on their coefficients: the largest found for
which kinetic and potential energy do not grow. With the factor 0 they cannot: u . r <= 0 makes the change at most
-(p + dt f) . M^-1 (p + dt f) / 2, p being the impulses of the contacts and f the loads.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from barchan.bodies.moreau.contact_problem import ContactRows

Vector = NDArray[np.float64]
TRIALS = 4  # of the factor, after 1 and 0
LEAST = 1e-12  # of the work of the contacts: gains below are rounding


@dataclass(frozen=True, eq=False)
class Impacts:
    """A step whose impacts are to make no energy.

    rows : of its contacts.  pairs : (k, 2) bodies.  joined : (j, 2) bodies held together.  movable : (b,).
    masses, before, predicted : (b, 2, d) generalised, at the start of the step and at its end without contacts.
    dt, theta : of the step.  tolerance : of the friction solver, hence of energies.
    """

    rows: ContactRows
    pairs: NDArray[np.int32]
    joined: NDArray[np.int64]
    movable: NDArray[np.bool_]
    masses: Vector
    before: Vector
    predicted: Vector
    dt: float
    theta: float
    tolerance: float

    def islands(self, r: Vector) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Numbers of the islands of bodies (b,) and of contacts (k,) that the forces r (k, d) make."""
        loaded = self.pairs[(r[:, 0] > 0.0) & np.all(self.movable[self.pairs], axis=1)]
        edges = np.concatenate([loaded, self.joined[np.all(self.movable[self.joined], axis=1)]])
        count = len(self.movable)
        graph = sp.coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count, count))
        labels = connected_components(graph, directed=False)[1].astype(np.int64)
        moving = np.where(self.movable[self.pairs[:, 0]], self.pairs[:, 0], self.pairs[:, 1])
        return labels, labels[moving]

    def gains(
        self, islands: tuple[NDArray[np.int64], NDArray[np.int64]], r: Vector, v: Vector
    ) -> tuple[Vector, Vector]:
        """Energy [J] that each island gains by its impacts, and the size of the work of its contacts.

        r : (k, d) mean forces [N].  v : (b, 2, d) velocities after.
        """
        bodies, contacts = islands
        count = len(self.movable)
        rows = self.rows
        after = (rows.operator @ v.reshape(-1)).reshape(r.shape) + rows.driven
        mean = 0.5 * (after + rows.relative)
        resting = ~np.any(rows.rebound != 0.0, axis=1)
        mean[resting, 0] = np.minimum(mean[resting, 0], 0.0)  # overlaps pushed out are another matter
        work = self.dt * np.einsum("kd,kd->k", mean, r)
        moved = self.masses * (self.predicted - self.before) * (v - self.before)
        loads = (0.5 - self.theta) * np.where(self.movable, moved[:, 0].sum(axis=1), 0.0)
        size = self.dt * np.linalg.norm(rows.relative, axis=1) * np.linalg.norm(r, axis=1)
        gain, sizes = np.zeros(count), np.zeros(count)
        np.add.at(gain, contacts, work)
        np.add.at(gain, bodies, loads)
        np.add.at(sizes, contacts, size)
        return gain, sizes

    def tamed(
        self, r: Vector, v: Vector, solve: Callable[[Vector], tuple[Vector, Vector]]
    ) -> tuple[Vector, bool]:
        """Factors (k,) on the restitution of the contacts, and whether the last call of `solve` had them.

        r, v : the solution with the factor 1.  solve : r (k, d), v (b, 2, d) for given factors (k,).
        """
        islands = self.islands(r)
        contacts, factors = islands[1], np.ones(len(r))
        highest = self._excess(islands, r, v)
        wild = highest > 0.0
        if not np.any(wild):
            return factors, True
        low, high = np.where(wild, 0.0, 1.0), np.ones(len(highest))
        lowest = self._excess(islands, *solve(low[contacts]))
        for _ in range(TRIALS):
            slope = np.where(wild, highest - np.minimum(lowest, 0.0), 1.0)
            middle = low + (high - low) * np.clip(-np.minimum(lowest, 0.0) / slope, 0.05, 0.95)
            middle = np.where(wild, middle, 1.0)
            excess = self._excess(islands, *solve(middle[contacts]))
            good = excess <= 0.0
            low, lowest = np.where(wild & good, middle, low), np.where(good, excess, lowest)
            high, highest = np.where(wild & ~good, middle, high), np.where(good, highest, excess)
        return low[contacts], bool(np.array_equal(middle, low))

    def _excess(self, islands: tuple[NDArray[np.int64], NDArray[np.int64]], r: Vector, v: Vector) -> Vector:
        """Gains beyond what the tolerance of the solver explains."""
        gain, size = self.gains(islands, r, v)
        return gain - max(self.tolerance, LEAST) * size
