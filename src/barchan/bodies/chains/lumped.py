"""A chain of point masses at the joints, at fixed distances from each other (seed B, 2.1.2).

With the "consistent" inertia of the chain each segment has the masses m/6 [[2, 1], [1, 2]] of a slender rod between its ends,
so that the motion is that of rigid segments; with "lumped", m/2 at each end. M is constant either way; bending is not linear.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.chains.chain import INERTIAS
from barchan.bodies.chains.model import ChainModel

Vector = NDArray[np.float64]


class LumpedChain(ChainModel):
    """Coordinates (2 N,) or, with no end held, (2 N + 2,): x, z of the joints [m]; a held end is none of them.

    Constraints: (|d_i|^2 - 4 L_i^2) / (4 L_i) = 0, d_i from one joint to the next. Bends are taken between -pi and pi by the
    arc tangent, where the print of seed B has an arc sine, which knows a quarter turn only.
    """

    def start(self) -> tuple[Vector, Vector]:
        """The joints of the segments end to end."""
        chain, first = self.chain, int(self.chain.held)
        angles, lengths = chain.angles, 2.0 * chain.half_lengths
        rates = np.column_stack([-np.sin(angles), np.cos(angles)]) * (lengths * chain.spins)[:, None]
        speeds = np.concatenate([chain.velocity[None], chain.velocity + np.cumsum(rates, axis=0)])
        return chain.joints_at(chain.root, angles)[first:].reshape(-1), speeds[first:].reshape(-1)

    def mass(self, q: Vector) -> Vector:
        """Constant; diagonal where the inertia is lumped."""
        return self._inertia

    def loads(self, q: Vector, v: Vector) -> Vector:
        """Weight, bending, drag."""
        found = self._weight - self._drag @ v
        if self.chain.bending_stiffness > 0.0:
            found -= self.chain.bending_stiffness * (self._bend_rows(q).T @ self.bends_of(q))
        return found

    def stiffness(self, q: Vector) -> Vector:
        """Of bending, the part of Gauss and Newton."""
        if self.chain.bending_stiffness == 0.0:
            return np.zeros((len(q), len(q)))
        rows = self._bend_rows(q)
        return self.chain.bending_stiffness * (rows.T @ rows)

    def damping(self, q: Vector) -> Vector:
        """Of the air, exact."""
        return self._drag

    def constraints(self, q: Vector) -> tuple[Vector, Vector] | None:
        """Elongations [m] and their derivative."""
        lengths = 2.0 * self.chain.half_lengths
        steps = np.diff(self.joints_of(q), axis=0)
        gaps = (np.sum(steps**2, axis=1) - lengths**2) / (2.0 * lengths)
        return gaps, self._along(steps / lengths[:, None])

    def joints_of(self, q: Vector) -> Vector:
        """The coordinates, with the held end."""
        places = q.reshape(-1, 2)
        return np.concatenate([self.chain.root[None], places]) if self.chain.held else places.copy()

    def joint_rows(self, q: Vector) -> Vector:
        """A one each."""
        return self._rows

    def angles_of(self, q: Vector) -> Vector:
        """Between -pi and pi."""
        steps = np.diff(self.joints_of(q), axis=0)
        return np.arctan2(steps[:, 1], steps[:, 0])

    def bends_of(self, q: Vector) -> Vector:
        """Between -pi and pi."""
        found = self.chain.bends(self.angles_of(q))
        return np.remainder(found + np.pi, 2.0 * np.pi) - np.pi

    def _along(self, vectors: Vector) -> Vector:
        """(N, m) rows of the product of `vectors` (N, 2) with the changes of the steps from joint to joint."""
        n, first = self.chain.segments, int(self.chain.held)
        rows = np.zeros((n, n + 1, 2))
        number = np.arange(n)
        rows[number, number], rows[number, number + 1] = -vectors, vectors
        return rows[:, first:].reshape(n, -1)

    def _bend_rows(self, q: Vector) -> Vector:
        """(b, m) derivative of the bends."""
        steps = np.diff(self.joints_of(q), axis=0)
        across = np.column_stack([-steps[:, 1], steps[:, 0]]) / np.sum(steps**2, axis=1)[:, None]
        return np.asarray(self.chain.springs @ self._along(across))

    @cached_property
    def _rows(self) -> Vector:
        n, first = self.chain.segments, int(self.chain.held)
        return np.eye(2 * n + 2).reshape(n + 1, 2, 2 * n + 2)[:, :, 2 * first :].copy()

    def _shared(self, weights: Vector) -> Vector:
        """Matrix of weights (N,) of segments, shared by their ends: (1 + k)/4 on the diagonal, (1 - k)/4 beside it."""
        n, spread = self.chain.segments, INERTIAS[self.chain.inertia]
        found = np.zeros((n + 1, n + 1))
        number = np.arange(n)
        for a in range(2):
            for b in range(2):
                share = 0.25 * (1.0 + spread if a == b else 1.0 - spread)
                np.add.at(found, (number + a, number + b), share * weights)
        first = int(self.chain.held)
        return np.asarray(np.kron(found[first:, first:], np.eye(2)), dtype=np.float64)

    @cached_property
    def _inertia(self) -> Vector:
        return self._shared(self.chain.masses)

    @cached_property
    def _drag(self) -> Vector:
        return self._shared(self.chain.drags)

    @cached_property
    def _weight(self) -> Vector:
        """Half of the weight of a segment on each end."""
        halves = 0.5 * self.chain.gravity * self.chain.masses
        loads = np.zeros((self.chain.segments + 1, 2))
        loads[:-1, 1] -= halves
        loads[1:, 1] -= halves
        return loads[int(self.chain.held) :].reshape(-1)
