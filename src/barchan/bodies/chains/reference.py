"""Motions to measure schemes against: the reduced equations to high order, and the period of small swings."""

from __future__ import annotations

import numpy as np
import scipy.linalg as sl
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

from barchan.bodies.chains.chain import Chain
from barchan.bodies.chains.reduced import ReducedChain
from barchan.errors import InputError

Vector = NDArray[np.float64]

_RELATIVE, _ABSOLUTE = 1e-12, 1e-13


class ReferenceMotion:
    """A chain without obstacles from its start to `end` [s], by Dormand and Prince's method of order 8, errors near 1e-11."""

    def __init__(self, chain: Chain, end: float) -> None:
        self._model = ReducedChain(chain)
        start, rates = self._model.start()
        self._size = len(start)
        found = solve_ivp(
            self._rates, (0.0, end), np.concatenate([start, rates]), "DOP853", dense_output=True,
            rtol=_RELATIVE, atol=_ABSOLUTE,
        )  # fmt: skip
        if not found.success:
            raise InputError("chain", found.message, "a chain whose motion can be followed")
        self.end, self._curve = end, found.sol

    def _rates(self, time: float, both: Vector) -> Vector:
        q, v = both[: self._size], both[self._size :]
        return np.concatenate([v, np.linalg.solve(self._model.mass(q), self._model.forces(q, v))])

    def angles(self, times: ArrayLike) -> Vector:
        """(n, N) angles of the segments [rad] at times (n,) [s]."""
        return np.array([self._model.angles_of(self._at(t)) for t in np.atleast_1d(times)])

    def joints(self, times: ArrayLike) -> Vector:
        """(n, N + 1, 2) ends and joints [m]."""
        return np.array([self._model.joints_of(self._at(t)) for t in np.atleast_1d(times)])

    def _at(self, time: float) -> Vector:
        if not 0.0 <= time <= self.end * (1.0 + 1e-9):
            raise InputError("time", time, f"between 0 and {self.end:g} s")
        return np.asarray(self._curve(min(float(time), self.end)))[: self._size]


def slowest_period(chain: Chain) -> float:
    """Period [s] of the slowest small swing about hanging straight down. Raises InputError for a chain that cannot swing."""
    if not chain.held or chain.gravity == 0.0:
        raise InputError("chain", "without held end or gravity", "a chain that hangs")
    hanging = Chain(
        chain.segments, chain.half_lengths, masses=chain.masses, angles=-0.5 * np.pi, gravity=chain.gravity,
        bending_stiffness=chain.bending_stiffness, inertia="lumped" if chain.inertia == "lumped" else "consistent",
        clamp_angle=None if chain.clamp_angle is None else -0.5 * np.pi,
    )  # fmt: skip
    model = ReducedChain(hanging)
    q, _ = model.start()
    squared = sl.eigh(model.stiffness(q), model.mass(q), eigvals_only=True)
    return 2.0 * np.pi / float(np.sqrt(squared[0]))
