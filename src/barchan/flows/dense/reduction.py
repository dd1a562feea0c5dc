"""Velocities that meet the conditions on the boundary: v = basis y + prescribed (seed A, 4.3.2: the space V_h(u_D)).

Nodes where slip is free along a slanted direction get rotated unknowns, so that the reduced matrix stays symmetric definite.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from barchan.errors import InputError
from barchan.flows.dense.conditions import Condition, FreeSlip, NoSlip, Velocity
from barchan.flows.dense.walls import Walls
from barchan.spaces.mixed import MixedSpace

SAME_DIRECTION = 0.1
"""Sine below which two prescribed directions at a node count as one."""
SMOOTH = np.cos(np.radians(30.0))
"""A node whose facets' normals all lie within 30 degrees of their mean gets one normal, else one for each facet."""
BALANCED = 1e-9


@dataclass(frozen=True, eq=False)
class Reduction:
    """basis : (size, m), orthonormal columns.  prescribed : (size,) velocity that meets the data.
    free : indices of the m unknowns in (size,) when no node is rotated, else None.
    directions : (c, size) orthonormal rows of the prescribed components."""

    basis: sp.csr_array
    prescribed: np.ndarray
    free: np.ndarray | None
    directions: sp.csr_array

    def square(self, matrix: sp.csr_array) -> sp.csr_array:
        """basis^T matrix basis."""
        if self.free is not None:
            return sp.csr_array(matrix[self.free][:, self.free])
        return sp.csr_array(self._transposed @ (matrix @ self.basis))

    def columns(self, matrix: sp.csr_array) -> sp.csr_array:
        """matrix basis."""
        return sp.csr_array(matrix[:, self.free] if self.free is not None else matrix @ self.basis)

    def restrict(self, load: np.ndarray) -> np.ndarray:
        """basis^T load (m,)."""
        return load[self.free] if self.free is not None else self._transposed @ load

    def expand(self, y: np.ndarray) -> np.ndarray:
        """The velocity (size,) of the unknowns y (m,)."""
        return np.asarray(self.basis @ y + self.prescribed)

    @cached_property
    def places(self) -> np.ndarray:
        """(m,) number in (size,) of the component that each unknown is, or for rotated ones mostly is."""
        if self.free is not None:
            return self.free
        columns = abs(sp.csc_array(self.basis))
        return np.asarray(columns.argmax(axis=0)).reshape(-1)

    @cached_property
    def _transposed(self) -> sp.csr_array:
        return sp.csr_array(self.basis.T)


class _Constraints:
    """Orthonormal prescribed directions of every node, (N, d, d), the first `count` of each in use, with their values."""

    def __init__(self, nodes: int, d: int) -> None:
        self.directions = np.zeros((nodes, d, d))
        self.values = np.zeros((nodes, d))
        self.count = np.zeros(nodes, dtype=np.int64)

    def add(self, nodes: np.ndarray, direction: np.ndarray, value: np.ndarray) -> None:
        """Prescribe direction . v = value; what the directions already there determine is left as it is."""
        known = self.directions[nodes]
        along = np.einsum("nkc,nc->nk", known, direction)
        rest = direction - np.einsum("nk,nkc->nc", along, known)
        size = np.linalg.norm(rest, axis=1)
        new = size > SAME_DIRECTION
        place = nodes[new]
        slot = self.count[place]
        self.directions[place, slot] = rest[new] / size[new, None]
        given = value - np.einsum("nk,nk->n", along, self.values[nodes])
        self.values[place, slot] = given[new] / size[new]
        self.count[place] += 1


def reduce(space: MixedSpace, conditions: Mapping[str, Condition]) -> Reduction:
    """Eliminate what the conditions prescribe.

    At nodes shared by several parts: no-slip first, then whole velocities, then single components and slip; among equals
    the part named later wins. What is already determined by a stronger condition is not imposed again.
    """
    d = space.dimension
    constraints = _Constraints(len(space.nodes), d)
    unit = np.eye(d)
    for name, condition in _by_strength(conditions):
        nodes = space.boundary_nodes(name)
        if isinstance(condition, FreeSlip):
            for normal_nodes, normals in _normals(space, name):
                constraints.add(normal_nodes, normals, np.zeros(len(normal_nodes)))
            continue
        values = (
            np.zeros((len(nodes), d)) if isinstance(condition, NoSlip) else condition.at(space.nodes[nodes])
        )
        if isinstance(condition, NoSlip) or condition.whole:
            untouched = constraints.count[nodes] == 0
            nodes, values = nodes[untouched], values[untouched]
        for component in range(d):
            given = ~np.isnan(values[:, component])
            direction = np.broadcast_to(unit[component], (int(given.sum()), d))
            constraints.add(nodes[given], direction, values[given, component])
    return _assembled(constraints, d)


def _by_strength(conditions: Mapping[str, Condition]) -> list[tuple[str, Any]]:
    kinds: list[list[tuple[str, Any]]] = [[], [], []]
    for name, condition in conditions.items():
        if isinstance(condition, NoSlip):
            kinds[0].append((name, condition))
        elif isinstance(condition, Velocity):
            kinds[1 if condition.whole else 2].append((name, condition))
        elif isinstance(condition, FreeSlip):
            kinds[2].append((name, condition))
    return [pair for kind in kinds for pair in reversed(kind)]


def _normals(space: MixedSpace, name: str) -> list[tuple[np.ndarray, np.ndarray]]:
    """Nodes of a part with their normals, in rounds: one normal each, or at edges and corners one for each facet."""
    basis, d = space.facet_basis(name), space.dimension
    area = np.asarray(basis.dx).sum(axis=1)
    normal = np.einsum("cfq,fq->fc", np.asarray(basis.normals), np.asarray(basis.dx)) / area[:, None]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    shape = np.stack([np.abs(np.asarray(basis.basis[k][0])).max(axis=1) for k in range(basis.Nbfun)], axis=1)
    facet, local = np.nonzero(shape > 1e-9)
    node = basis.element_dofs.T[facet, local]
    mean = np.zeros((len(space.nodes), d))
    np.add.at(mean, node, normal[facet] * area[facet, None])
    nodes = np.unique(node)
    length = np.linalg.norm(mean[nodes], axis=1)
    mean[nodes] /= np.maximum(length, np.finfo(float).tiny)[:, None]
    sharp = np.zeros(len(mean), dtype=bool)
    np.logical_or.at(sharp, node, np.einsum("nc,nc->n", mean[node], normal[facet]) < SMOOTH)
    rounds = [(nodes[~sharp[nodes]], mean[nodes[~sharp[nodes]]])]
    corner = np.flatnonzero(sharp[node])
    order = corner[np.argsort(node[corner], kind="stable")]
    rank = np.arange(len(order)) - np.searchsorted(node[order], node[order])
    for turn in range(int(rank.max(initial=-1)) + 1):
        chosen = order[rank == turn]
        rounds.append((node[chosen], normal[facet[chosen]]))
    return rounds


def _assembled(constraints: _Constraints, d: int) -> Reduction:
    directions, count = constraints.directions, constraints.count
    nodes = len(count)
    prescribed = np.einsum("nk,nkc->nc", constraints.values, directions).reshape(-1)
    aligned = (np.abs(directions) > 1.0 - 1e-12).sum(axis=(1, 2)) == count
    fixed = (np.abs(directions) > 0.5).any(axis=1) & aligned[:, None]
    free = np.flatnonzero(~fixed.reshape(-1) & np.repeat(aligned, d))
    rows, columns, data = [free], [np.arange(len(free))], [np.ones(len(free))]
    width = len(free)
    for number in range(1, d):
        turned = np.flatnonzero(~aligned & (count == number))
        if len(turned) == 0:
            continue
        complement = np.linalg.svd(directions[turned, :number])[2][:, number:]
        place = width + np.arange(complement.shape[0] * complement.shape[1]).reshape(complement.shape[:2])
        width += place.size
        rows.append(np.broadcast_to((d * turned[:, None] + np.arange(d))[:, None], complement.shape).ravel())
        columns.append(np.broadcast_to(place[:, :, None], complement.shape).ravel())
        data.append(complement.ravel())
    triplets = (np.concatenate(data), (np.concatenate(rows), np.concatenate(columns)))
    basis = sp.csr_array(triplets, shape=(nodes * d, width))
    node, slot = np.nonzero(np.arange(d) < count[:, None])
    chosen = directions[node, slot]
    column = (d * node[:, None] + np.arange(d)).ravel()
    row = np.repeat(np.arange(len(node)), d)
    rows_of = sp.csr_array((chosen.ravel(), (row, column)), shape=(len(node), nodes * d))
    rows_of.eliminate_zeros()
    return Reduction(basis, prescribed, free if width == len(free) else None, rows_of)


def check_inflow(
    space: MixedSpace, reduction: Reduction, conditions: Mapping[str, Condition], walls: Walls
) -> None:
    """Refuse data that force matter to be compressed: a closed boundary with net inflow (seed A, Eq. (40) fails).

    Only where every normal velocity is prescribed, or bounded by a frictional wall, which nothing passes outwards;
    div u >= 0 then needs a total outflow >= 0. Raises InputError that names the part with the largest inflow.
    """
    held = space.flux(space.mesh.boundary_facets())
    outflow = {}
    for name in walls.ranges:
        held = held - space.flux(name)
        first, last = walls.ranges[name]
        outflow[name] = float(walls.drift.reshape(-1, space.s)[first:last, 0].sum())
    size = np.abs(held).max(initial=0.0)
    if np.abs(reduction.restrict(held)).max(initial=0.0) > BALANCED * size:
        return
    v = reduction.prescribed
    outflow |= {name: float(space.flux(name) @ v) for name in conditions if name not in outflow}
    total = float(held @ v) + sum(outflow[name] for name in walls.ranges)
    if total >= -BALANCED * sum(abs(value) for value in outflow.values()):
        return
    worst = min(outflow, key=lambda name: outflow[name])
    shown = ", ".join(f"{name} {value:+.4g}" for name, value in outflow.items())
    raise InputError(
        f"conditions.{worst}",
        f"inflow of {-outflow[worst]:.4g} into a closed domain",
        f"balanced by an outflow, since the matter cannot be compressed: criterion H(mu) fails "
        f"(outflow through {shown}; total {total:+.4g})",
    )


def free_rigid_motions(space: MixedSpace, reduction: Reduction) -> int:
    """Number of rigid motions that the prescribed components leave free: without inertia, viscosity does not resist them."""
    x, d = space.nodes - space.nodes.mean(axis=0), space.dimension
    modes = [np.tile(unit, (len(x), 1)) for unit in np.eye(d)]
    for a in range(d):
        for b in range(a):
            turn = np.zeros_like(x)
            turn[:, a], turn[:, b] = -x[:, b], x[:, a]
            modes.append(turn / max(float(np.abs(x).max()), np.finfo(float).tiny))
    rigid = np.stack([mode.reshape(-1) for mode in modes], axis=1)
    if reduction.directions.shape[0] == 0:
        return rigid.shape[1]
    return rigid.shape[1] - int(np.linalg.matrix_rank(reduction.directions @ rigid, tol=1e-6))
