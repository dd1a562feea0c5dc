"""A chain of rigid segments in maximal coordinates: centres and angles, held together by constraints (seed B, 2.1.1).

All forces are linear in the coordinates and rates, and M is constant; the constraints are not linear.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.chains.chain import directions, normals
from barchan.bodies.chains.model import ChainModel

Vector = NDArray[np.float64]


class MaximalChain(ChainModel):
    """Coordinates (3 N,): x, z of the centre [m] and angle [rad] of segment after segment.

    Constraints: the first end at the root if it is held, then p_i + L_i e(t_i) = p_(i+1) - L_(i+1) e(t_(i+1)) in both axes.
    """

    def start(self) -> tuple[Vector, Vector]:
        """The segments end to end, moving so."""
        chain = self.chain
        joints = chain.joints_at(chain.root, chain.angles)
        rates = 2.0 * chain.half_lengths[:, None] * normals(chain.angles) * chain.spins[:, None]
        speeds = np.concatenate([chain.velocity[None], chain.velocity + np.cumsum(rates, axis=0)])
        q = np.column_stack([0.5 * (joints[1:] + joints[:-1]), chain.angles])
        return q.reshape(-1), np.column_stack([0.5 * (speeds[1:] + speeds[:-1]), chain.spins]).reshape(-1)

    def mass(self, q: Vector) -> Vector:
        """Diagonal: m, m, I of each segment."""
        return self._inertia

    def loads(self, q: Vector, v: Vector) -> Vector:
        """Weight and springs of the joints, less the drag; linear in q and v."""
        chain = self.chain
        found = -self._drag @ v
        found[1::3] -= chain.gravity * chain.masses
        found[2::3] -= chain.bending_stiffness * (chain.springs.T @ self.bends_of(q))
        return found

    def stiffness(self, q: Vector) -> Vector:
        """Of bending, exact."""
        return self._stiffness

    def damping(self, q: Vector) -> Vector:
        """Of the air, exact."""
        return self._drag

    def constraints(self, q: Vector) -> tuple[Vector, Vector] | None:
        """Gaps between ends that belong together [m], two rows a joint, and their derivative."""
        chain, parts = self.chain, q.reshape(-1, 3)
        arms = chain.half_lengths[:, None] * directions(parts[:, 2])
        turns = chain.half_lengths[:, None] * normals(parts[:, 2])
        n, held = chain.segments, int(chain.held)
        gaps = np.zeros((n - 1 + held, 2))
        rows = np.zeros((n - 1 + held, 2, n, 3))
        if chain.held:
            gaps[0] = parts[0, :2] - arms[0] - chain.root
            rows[0, :, 0, :2], rows[0, :, 0, 2] = np.eye(2), -turns[0]
        first, place = np.arange(n - 1), held + np.arange(n - 1)
        gaps[held:] = parts[:-1, :2] + arms[:-1] - parts[1:, :2] + arms[1:]
        rows[place, :, first, :2], rows[place, :, first + 1, :2] = np.eye(2), -np.eye(2)
        rows[place, :, first, 2], rows[place, :, first + 1, 2] = turns[:-1], turns[1:]
        if not len(gaps):
            return None
        return gaps.reshape(-1), rows.reshape(2 * len(gaps), 3 * n)

    def joints_of(self, q: Vector) -> Vector:
        """The first end of the first segment, the last ends of all."""
        parts = q.reshape(-1, 3)
        arms = self.chain.half_lengths[:, None] * directions(parts[:, 2])
        return np.concatenate([parts[:1, :2] - arms[:1], parts[:, :2] + arms])

    def joint_rows(self, q: Vector) -> Vector:
        """v_i +- w_i L_i e'(t_i)."""
        parts, n = q.reshape(-1, 3), self.chain.segments
        turns = self.chain.half_lengths[:, None] * normals(parts[:, 2])
        rows = np.zeros((n + 1, 2, n, 3))
        rows[0, :, 0, :2], rows[0, :, 0, 2] = np.eye(2), -turns[0]
        number = np.arange(n)
        rows[number + 1, :, number, :2], rows[number + 1, :, number, 2] = np.eye(2), turns
        return rows.reshape(n + 1, 2, 3 * n)

    def angles_of(self, q: Vector) -> Vector:
        """Every third coordinate."""
        return q[2::3].copy()

    def bends_of(self, q: Vector) -> Vector:
        """Differences of angles, over any number of turns."""
        return self.chain.bends(q[2::3])

    @cached_property
    def _inertia(self) -> Vector:
        return np.diag(np.column_stack([self.chain.masses] * 2 + [self.chain.moments]).reshape(-1))

    @cached_property
    def _drag(self) -> Vector:
        return np.diag(np.column_stack([self.chain.drags] * 2 + [self.chain.turning_drags]).reshape(-1))

    @cached_property
    def _stiffness(self) -> Vector:
        n = self.chain.segments
        found = np.zeros((3 * n, 3 * n))
        found[2::3, 2::3] = self.chain.bending_stiffness * self.chain.springs.T @ self.chain.springs
        return found
