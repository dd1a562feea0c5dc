"""Velocity components that the boundary prescribes, node by node, along the axes or along normals of curved walls.

A node with one prescribed direction that follows no axis gets rotated unknowns: x = T y with T orthogonal, its first unknown
along that direction. Everything else is plain Dirichlet data.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from barchan.errors import InputError
from barchan.flows.quasi_newtonian.conditions import ChannelEnd, Condition, FreeSlip, NoSlip, Slip, Velocity
from barchan.spaces.quadratic import QuadraticSpace

SAME_DIRECTION = 0.35
"""Sine below which two prescribed directions at a node count as one."""
ALONG_AXIS = 1e-12
OPEN = 1e-6
"""Share of the normal left free above which a part is open."""


@dataclass(frozen=True, eq=False)
class Constraints:
    """fixed : (size,) bool prescribed unknowns.  values : (size,) what they are, zero elsewhere.
    rotation : T (size, size) with x = T y, or None when no node is rotated.  frames : {node: (2, 2) columns of T}."""

    fixed: np.ndarray
    values: np.ndarray
    rotation: sp.csr_array | None
    frames: Mapping[int, np.ndarray]

    def impose(self, x: np.ndarray) -> np.ndarray:
        """x (size,) with the prescribed unknowns set."""
        y = self.to_rotated(x)
        y[self.fixed] = self.values[self.fixed]
        return self.to_cartesian(y)

    def to_rotated(self, x: np.ndarray) -> np.ndarray:
        """T^T x, a copy; also what a dual vector (a residual) becomes."""
        return x.copy() if self.rotation is None else np.asarray(self.rotation.T @ x)

    def to_cartesian(self, y: np.ndarray) -> np.ndarray:
        """T y."""
        return y if self.rotation is None else np.asarray(self.rotation @ y)

    def rotate_elements(self, space: QuadraticSpace, elements: np.ndarray) -> None:
        """Element matrices (C, n, n) in rotated unknowns, in place."""
        if not self.frames:
            return
        rotated = np.isin(space.cell_nodes, np.fromiter(self.frames, dtype=np.int64))
        k = space.cell_nodes.shape[1]
        for c in np.flatnonzero(rotated.any(axis=1)):
            turn = np.eye(elements.shape[1])
            for i in range(k):
                frame = self.frames.get(int(space.cell_nodes[c, i]))
                if frame is not None:
                    turn[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = frame
            elements[c] = turn.T @ elements[c] @ turn


def constrain(space: QuadraticSpace, conditions: Mapping[str, Condition]) -> Constraints:
    """The constraints of named conditions. Raises InputError for unknown parts and for components of a wrong shape."""
    known: dict[int, list[tuple[np.ndarray, float]]] = {}
    for name, condition in _by_rank(conditions):
        nodes = space.mesh.part_nodes(name)
        for node, direction, value in _prescribed(space, name, condition, nodes):
            _add(known.setdefault(node, []), direction, value)
    fixed, values = np.zeros(space.size, dtype=bool), np.zeros(space.size)
    frames: dict[int, np.ndarray] = {}
    for node, rows in known.items():
        if len(rows) == 2:
            fixed[2 * node : 2 * node + 2] = True
            values[2 * node : 2 * node + 2] = np.linalg.solve(
                np.stack([rows[0][0], rows[1][0]]), [rows[0][1], rows[1][1]]
            )
            continue
        direction, value = rows[0]
        axis = int(np.argmax(np.abs(direction)))
        if abs(direction[1 - axis]) < ALONG_AXIS:
            fixed[2 * node + axis], values[2 * node + axis] = True, value * np.sign(direction[axis])
            continue
        frames[node] = np.array([[direction[0], -direction[1]], [direction[1], direction[0]]])
        fixed[2 * node], values[2 * node] = True, value
    return Constraints(fixed, values, _rotation(space.size, frames), frames)


def _by_rank(conditions: Mapping[str, Condition]) -> list[tuple[str, Condition]]:
    """No slip first, whole velocities then (the later named first), what prescribes one direction last."""

    def rank(item: tuple[int, tuple[str, Condition]]) -> tuple[int, int]:
        number, (_, condition) = item
        if isinstance(condition, NoSlip):
            return 0, 0
        if isinstance(condition, Velocity):
            return (1 if condition.whole else 2), -number
        return 3, number

    return [item for _, item in sorted(enumerate(conditions.items()), key=rank)]


def _prescribed(
    space: QuadraticSpace, name: str, condition: Condition, nodes: np.ndarray
) -> list[tuple[int, np.ndarray, float]]:
    """Node, unit direction, value of every component that the condition prescribes on a part."""
    axes = np.eye(2)
    if isinstance(condition, NoSlip):
        return [(int(node), axes[a], 0.0) for node in nodes for a in (0, 1)]
    if isinstance(condition, Velocity):
        values = condition.at(space.mesh.nodes[nodes])
        return [
            (int(node), axes[a], float(value[a]))
            for node, value in zip(nodes, values, strict=True)
            for a in (0, 1)
            if np.isfinite(value[a])
        ]
    if isinstance(condition, FreeSlip | Slip | ChannelEnd):
        normals = node_normals(space, name)[nodes]
        if isinstance(condition, ChannelEnd):
            normals = np.stack([-normals[:, 1], normals[:, 0]], axis=1)
        return [(int(node), normal, 0.0) for node, normal in zip(nodes, normals, strict=True)]
    return []


def node_normals(space: QuadraticSpace, name: str) -> np.ndarray:
    """(N, 2) unit outward normals at the nodes of a part, weighted by the shapes; zero elsewhere."""
    side = space.boundary(name)
    total = np.zeros((space.N, 2))
    local = np.einsum("fq,fqk,fqa->fka", side.weights, side.values, side.normals)
    np.add.at(total, space.cell_nodes[side.cells], local)
    on = space.mesh.part_nodes(name)
    normals = np.zeros_like(total)
    normals[on] = total[on] / np.linalg.norm(total[on], axis=1, keepdims=True)
    return normals


def _add(rows: list[tuple[np.ndarray, float]], direction: np.ndarray, value: float) -> None:
    """Keep a prescribed direction of a node unless it is fixed already or says the same as one there."""
    if len(rows) == 2:
        return
    if rows:
        first = rows[0][0]
        if abs(first[0] * direction[1] - first[1] * direction[0]) < SAME_DIRECTION:
            return
    rows.append((direction, value))


def _rotation(size: int, frames: Mapping[int, np.ndarray]) -> sp.csr_array | None:
    """T as a sparse matrix."""
    if not frames:
        return None
    turn = sp.lil_array(sp.eye_array(size))
    for node, frame in frames.items():
        for a in (0, 1):
            for b in (0, 1):
                turn[2 * node + a, 2 * node + b] = frame[a, b]
    return sp.csr_array(turn)


def open_parts(space: QuadraticSpace, constraints: Constraints) -> list[str]:
    """Names of the parts through which the fluid may pass as it likes, so that the pressure there is set.

    The middles of sides decide: no other part prescribes anything there.
    """
    vertices, found = space.mesh.skeleton.p.shape[1], []
    for name, facets in space.mesh.boundaries.items():
        normals = np.zeros(space.size)
        normals[: 2 * space.N] = node_normals(space, name).ravel()
        through = constraints.to_rotated(normals)
        through[constraints.fixed] = 0.0
        middles = through[: 2 * space.N].reshape(-1, 2)[vertices + np.asarray(facets)]
        if np.abs(middles).max() > OPEN:
            found.append(name)
    return found


def check_parts(space: QuadraticSpace, conditions: Mapping[str, Condition]) -> None:
    """Raise InputError for a condition on a part that does not exist."""
    for name in conditions:
        if name not in space.mesh.boundaries:
            raise InputError(
                "conditions", name, "a part of the boundary: " + ", ".join(space.mesh.boundaries)
            )
