"""A chain in reduced coordinates, the angles between its segments: no constraints, but a dense M (seed B, 2.1.3).

With the angles t_j of the segments and s_ij = 2 L_j for j < i, L_i for j = i, the centres are c_i = root + sum_j s_ij e(t_j),

    M_jk = B_jk cos(t_j - t_k),  B = s^T diag(m) s + diag(I),   torque of inertia on t_j: -sum_k B_jk sin(t_j - t_k) w_k^2,
    weight: -g a_j cos(t_j),  a = s^T m,   drag: the same B and cosines with the drags in place of the masses.

The relative angles are t = clamp + S q with S a triangle of ones, hence M = S^T M_t S and so on.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.chains.chain import directions, normals
from barchan.bodies.chains.model import ChainModel

Vector = NDArray[np.float64]


class ReducedChain(ChainModel):
    """Coordinates (N,): angle of each segment from the one before, of the first from the clamp (or the x axis) [rad].

    With no end held (N + 2,): before them x, z of the first end [m].
    """

    def start(self) -> tuple[Vector, Vector]:
        """Differences of the angles and of the spins."""
        chain = self.chain
        turns, rates = np.diff(chain.angles, prepend=self._base), np.diff(chain.spins, prepend=0.0)
        if chain.held:
            return turns, rates
        return np.concatenate([chain.root, turns]), np.concatenate([chain.velocity, rates])

    def mass(self, q: Vector) -> Vector:
        """Dense."""
        return self._metric_of(self.chain.masses, self.chain.moments, q)

    def loads(self, q: Vector, v: Vector) -> Vector:
        """Weight, drag, bending."""
        chain, angles = self.chain, self.angles_of(q)
        found = np.zeros(chain.segments + 2)
        found[1] = -chain.gravity * float(np.sum(chain.masses))
        found[2:] = -chain.gravity * self._first * np.cos(angles)
        found -= self._metric(chain.drags, chain.turning_drags, angles, angles) @ (self._map @ v)
        found[2:] -= chain.bending_stiffness * (chain.springs.T @ self.bends_of(q))
        return np.asarray(self._map.T @ found)

    def coriolis(self, q: Vector, shift: Vector, v: Vector) -> Vector:
        """Coriolis and centrifugal forces."""
        angles = self.angles_of(q)
        squares = (self._map @ shift)[2:] * (self._map @ v)[2:]
        found = np.empty(self.chain.segments + 2)
        found[:2] = (self._first * squares) @ directions(angles)
        found[2:] = -(self._second * np.sin(angles[:, None] - angles)) @ squares
        return np.asarray(self._map.T @ found)

    def carried(self, q: Vector, before: Vector, v: Vector) -> Vector:
        """Velocities of all points at `before`, on the directions at q: the energy of a step is then that of the points."""
        metric = self._metric(
            self.chain.masses, self.chain.moments, self.angles_of(q), self.angles_of(before)
        )
        return np.asarray(self._map.T @ (metric @ (self._map @ v)))

    def stiffness(self, q: Vector) -> Vector:
        """Of bending, exact, and of the weight where it pulls back."""
        chain = self.chain
        found = np.zeros((chain.segments + 2, chain.segments + 2))
        pull = -chain.gravity * self._first * np.sin(self.angles_of(q))
        found[2:, 2:] = chain.bending_stiffness * chain.springs.T @ chain.springs + np.diag(
            np.maximum(pull, 0.0)
        )
        return self._reduced(found)

    def damping(self, q: Vector) -> Vector:
        """Of the air, exact."""
        return self._metric_of(self.chain.drags, self.chain.turning_drags, q)

    def constraints(self, q: Vector) -> tuple[Vector, Vector] | None:
        """None."""
        return None

    def joints_of(self, q: Vector) -> Vector:
        """From the first end on."""
        return self.chain.joints_at(self.chain.root if self.chain.held else q[:2], self.angles_of(q))

    def joint_rows(self, q: Vector) -> Vector:
        """Every joint moves with all angles before it."""
        n = self.chain.segments
        turns = 2.0 * self.chain.half_lengths[:, None] * normals(self.angles_of(q))
        rows = np.zeros((n + 1, 2, n + 2))
        rows[:, :, :2] = np.eye(2)
        before = np.tri(n + 1, n, -1)
        rows[:, :, 2:] = before[:, None, :] * turns.T[None]
        return np.asarray(rows @ self._map)

    def angles_of(self, q: Vector) -> Vector:
        """Sums of the relative angles."""
        return self._base + np.cumsum(q[-self.chain.segments :])

    def bends_of(self, q: Vector) -> Vector:
        """The coordinates themselves."""
        return self.chain.bends(self.angles_of(q))

    @property
    def _base(self) -> float:
        return 0.0 if self.chain.clamp_angle is None else self.chain.clamp_angle

    @cached_property
    def _map(self) -> Vector:
        """(2 + N, m) from rates of the coordinates to those of the first end and of all angles."""
        n = self.chain.segments
        found = np.eye(n + 2)
        found[2:, 2:] = np.tri(n)
        return found[:, 2:] if self.chain.held else found

    def _reduced(self, matrix: Vector) -> Vector:
        return np.asarray(self._map.T @ matrix @ self._map)

    def _metric_of(self, weights: Vector, moments: Vector, q: Vector) -> Vector:
        angles = self.angles_of(q)
        return self._reduced(self._metric(weights, moments, angles, angles))

    @cached_property
    def _arms(self) -> Vector:
        """s_ij (N, N)."""
        n = self.chain.segments
        return (2.0 * np.tri(n, n, -1) + np.eye(n)) * self.chain.half_lengths

    @cached_property
    def _first(self) -> Vector:
        """a (N,)."""
        return np.asarray(self._arms.T @ self.chain.masses)

    @cached_property
    def _second(self) -> Vector:
        """B (N, N)."""
        return np.asarray(self._arms.T @ (self.chain.masses[:, None] * self._arms)) + np.diag(
            self.chain.moments
        )

    def _metric(self, weights: Vector, moments: Vector, angles: Vector, other: Vector) -> Vector:
        """(2 + N, 2 + N) product of motions of the first end and of the angles: left ones at `angles`, right ones at `other`.

        weights (N,) : of centres.  moments (N,) : of spins.
        """
        arms = self._arms
        first, second = arms.T @ weights, arms.T @ (weights[:, None] * arms) + np.diag(moments)
        found = np.zeros((len(angles) + 2, len(angles) + 2))
        found[0, 0] = found[1, 1] = np.sum(weights)
        found[:2, 2:] = first * normals(other).T
        found[2:, :2] = first[:, None] * normals(angles)
        found[2:, 2:] = second * np.cos(angles[:, None] - other)
        return found
