"""Coarse space of a domain decomposition: rigid motions of faces, edges and corners between parts, extended at least energy.

The functions are discrete-harmonic inside the parts (generalised Dryja-Smith-Widlund, "GDSW": Dohrmann, Klawonn and Widlund
2008): they follow stiff zones that cross several parts, and together they carry the volume fluxes that nearly incompressible
parts exchange (Dohrmann and Widlund 2009).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.linalg as sl
import scipy.sparse as sp

from barchan.linalg.pattern_solver import PatternSolver

DEPENDENT = 1e-8
Each = Callable[[Callable[[int], Any]], list[Any]]


def rigid_motions(points: np.ndarray, components: np.ndarray) -> np.ndarray:
    """(m, 3) or (m, 6) velocities of the rigid motions at unknowns that are component `components` (m,) at `points` (m, d)."""
    m, d = points.shape
    modes = np.zeros((m, d * (d + 1) // 2))
    modes[np.arange(m), components] = 1.0
    centred = points - points.mean(axis=0)
    size = np.abs(centred).max(initial=0.0) or 1.0
    planes = [(a, b) for a in range(d) for b in range(a + 1, d)]
    for k, (a, b) in enumerate(planes):
        modes[components == a, d + k] = -centred[components == a, b] / size
        modes[components == b, d + k] = centred[components == b, a] / size
    return modes


class HarmonicCoarseSpace:
    """Z (m, c) and the solves with Z^T K Z.

    Parameters
    ----------
    number : (m, m) csr whose entries say, counted from 1, where the entries of K lie among its data.
    owner : (m,) part of every unknown.   points (m, d), components (m,) : where and which component an unknown is.
    symmetric : kind of `PatternSolver`.   each : runs a function on every part and returns the results.
    """

    def __init__(
        self,
        number: sp.csr_array,
        owner: np.ndarray,
        points: np.ndarray,
        components: np.ndarray,
        symmetric: str,
        each: Each,
    ) -> None:
        self._owner, self._each, self._symmetric = owner, each, symmetric
        self._parts = int(owner.max()) + 1
        ones = sp.csr_array(
            (np.ones(number.nnz, np.int32), number.indices, number.indptr), shape=number.shape
        )
        member = sp.csr_array((np.ones(len(owner), np.int32), (np.arange(len(owner)), owner)))
        near = sp.csr_array(ones @ member)
        near.sort_indices()
        shared = np.diff(near.indptr) > 1
        self._interface = np.flatnonzero(shared)
        self._basis, columns_of = _interface_motions(near, self._interface, points, components)
        self._columns = [
            np.flatnonzero([part in parts for parts in columns_of]) for part in range(self._parts)
        ]
        self._interiors = [np.flatnonzero(~shared & (owner == part)) for part in range(self._parts)]
        prepared = each(lambda i: part_solver(number, self._interiors[i], symmetric))
        self._places = [place for place, _ in prepared]
        self._solvers = [solver for _, solver in prepared]
        self._extensions: list[np.ndarray] = []

    @property
    def size(self) -> int:
        """Coarse unknowns."""
        return int(self._basis.shape[1])

    @property
    def megabytes(self) -> float | None:
        """Memory of the factors inside the parts and of the functions; None where it is not known."""
        factors = [solver.megabytes for solver in self._solvers if solver is not None]
        if None in factors:
            return None
        return sum(filter(None, factors)) + sum(values.nbytes for values in self._extensions) / 2**20

    def factorise(self, K: sp.csr_array) -> bool:
        """Extend the functions for this matrix and factorise Z^T K Z; False when something is singular or indefinite."""
        across = K[self._interface]
        coarse = np.asarray((self._basis.T @ (across[:, self._interface] @ self._basis)).toarray())
        from_interface = K[:, self._interface]
        extended = self._each(lambda i: self._extend(i, K.data, from_interface, across))
        self._extensions.clear()
        for columns, found in zip(self._columns, extended, strict=True):
            if found is None:
                return False
            self._extensions.append(found[0])
            coarse[np.ix_(columns, columns)] += found[1]
        if not np.isfinite(coarse).all():
            return False
        self._factor = sl.lu_factor(coarse, check_finite=False)
        return bool((np.abs(np.diag(self._factor[0])) > 0.0).all())

    def _extend(
        self, i: int, data: np.ndarray, from_interface: sp.csr_array, across: sp.csr_array
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Values of the functions inside part i and their share of Z^T K Z."""
        inside, columns = self._interiors[i], self._columns[i]
        basis = self._basis[:, columns]
        if not len(inside):
            return np.zeros((0, len(columns))), np.zeros((len(columns), len(columns)))
        if not self._solvers[i].factorise(data[self._places[i]]):
            return None
        right = -(from_interface[inside] @ basis).toarray()
        values = self._solvers[i].solve(right, 0)
        left = (across[:, inside].T @ basis).toarray()
        return np.ascontiguousarray(values), left.T @ values

    def expand(self, y: np.ndarray) -> np.ndarray:
        """Z y (m,)."""
        out = np.empty(len(self._owner))
        out[self._interface] = self._basis @ y
        for inside, columns, values in zip(self._interiors, self._columns, self._extensions, strict=True):
            out[inside] = values @ y[columns]
        return out

    def restrict(self, r: np.ndarray) -> np.ndarray:
        """Z^T r (c,)."""
        out = np.asarray(self._basis.T @ r[self._interface])
        for inside, columns, values in zip(self._interiors, self._columns, self._extensions, strict=True):
            out[columns] += r[inside] @ values
        return out

    def solve(self, r: np.ndarray) -> np.ndarray:
        """Z (Z^T K Z)^-1 Z^T r (m,)."""
        return self.expand(sl.lu_solve(self._factor, self.restrict(r), check_finite=False))


def part_solver(
    number: sp.csr_array, members: np.ndarray, symmetric: str
) -> tuple[np.ndarray, PatternSolver | None]:
    """Where the entries of a part lie among those of the whole (numbered from 1 in `number`), and their solver."""
    if not len(members):
        return np.zeros(0, np.int64), None
    local = sp.csr_array(number[members][:, members])
    local.sort_indices()
    place = local.data.astype(np.int64) - 1
    values = sp.csr_array((np.ones(local.nnz), local.indices, local.indptr), shape=local.shape)
    return place, PatternSolver(values, symmetric, threads=1)


def _interface_motions(
    near: sp.csr_array, interface: np.ndarray, points: np.ndarray, components: np.ndarray
) -> tuple[sp.csc_array, list[tuple[int, ...]]]:
    """Independent rigid motions (interface unknowns, c) of the sets of unknowns near the same parts, and these parts."""
    groups: dict[tuple[int, ...], list[int]] = {}
    for position, unknown in enumerate(interface):
        parts = tuple(near.indices[near.indptr[unknown] : near.indptr[unknown + 1]].tolist())
        groups.setdefault(parts, []).append(position)
    rows, values, lengths, columns_of = [], [], [0], []
    for parts, positions in groups.items():
        members = interface[positions]
        modes = rigid_motions(points[members], components[members])
        q, triangle, _ = sl.qr(modes, mode="economic", pivoting=True)
        diagonal = np.abs(np.diag(triangle))
        for column in np.flatnonzero(diagonal > DEPENDENT * diagonal[0]):
            rows.append(np.array(positions))
            values.append(q[:, column])
            lengths.append(len(positions))
            columns_of.append(parts)
    shape = (len(interface), len(columns_of))
    if not columns_of:
        return sp.csc_array(shape), columns_of
    return sp.csc_array(
        (np.concatenate(values), np.concatenate(rows), np.cumsum(lengths)), shape=shape
    ), columns_of
