"""Where points lie in cells with curved sides, and what velocity, rate of strain and pressure are there (seed C 6.4).

A straight search on the skeleton gives a first cell; the isoparametric map of that cell and of those around it is inverted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barchan.errors import InputError
from barchan.spaces.location import Locator
from barchan.spaces.quadratic import QuadraticMesh, QuadraticSpace

ON_SIDE = 1e-9
"""Reference distance within which a point belongs to the cells on both sides."""

OUTSIDE = 0.02
"""Reference distance by which a point may lie beyond a boundary that only follows its curve at the nodes."""

_ITERATIONS = 30


@dataclass(frozen=True, eq=False)
class Places:
    """The cells that hold each of n points: a point on a side or a vertex appears once for each cell that has it.

    points : (m,) number of the point. cells : (m,). reference : (m, 2) in the cell. shares : (m,) of each point, summing to 1.
    """

    count: int
    points: np.ndarray
    cells: np.ndarray
    reference: np.ndarray
    shares: np.ndarray

    def mean(self, values: np.ndarray) -> np.ndarray:
        """(n, ...) means over the cells of each point of values (m, ...)."""
        flat = values.reshape(len(values), -1) * self.shares[:, None]
        total = np.stack(
            [np.bincount(self.points, column, minlength=self.count) for column in flat.T], axis=1
        )
        return total.reshape(self.count, *values.shape[1:])


def locate(mesh: QuadraticMesh, points: np.ndarray) -> Places:
    """The cells of points (n, 2), and the places in them.

    Raises InputError for points outside of the domain, or not of this shape.
    """
    skeleton = mesh.skeleton
    first = Locator(skeleton).find(points)[0]
    corner, cell = skeleton.t.ravel(), np.tile(np.arange(skeleton.t.shape[1]), skeleton.t.shape[0])
    order = np.argsort(corner, kind="stable")
    around = np.split(cell[order], np.cumsum(np.bincount(corner, minlength=skeleton.p.shape[1]))[:-1])
    candidates = [np.unique(np.concatenate([around[v] for v in skeleton.t[:, c]])) for c in first]
    number = np.repeat(np.arange(len(first)), [len(c) for c in candidates])
    cells = np.concatenate(candidates)
    reference = _inverted(mesh, cells, np.asarray(points, dtype=float)[number])
    beyond = _beyond(mesh, reference)
    nearest = np.full(len(first), np.inf)
    np.minimum.at(nearest, number, beyond)
    lost = np.flatnonzero(nearest > OUTSIDE)
    if len(lost):
        raise InputError("points", f"({points[lost[0]][0]:g}, {points[lost[0]][1]:g})", "in the domain")
    kept = np.flatnonzero(beyond <= np.maximum(nearest[number], ON_SIDE))
    shares = 1.0 / np.bincount(number[kept], minlength=len(first))[number[kept]]
    return Places(len(first), number[kept], cells[kept], reference[kept], shares)


def _inverted(mesh: QuadraticMesh, cells: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(m, 2) reference places of points (m, 2) under the maps of cells (m,), by Newton's method; NaN where it fails."""
    nodes = mesh.nodes[mesh.cell_nodes[cells]]
    size = np.max(np.ptp(nodes, axis=1), axis=1)
    X = np.full((len(cells), 2), 0.5 if mesh.quadrilateral else 1.0 / 3.0)
    for _ in range(_ITERATIONS):
        gap = points - np.einsum("km,mka->ma", mesh.shapes.values(X.T), nodes)
        if np.all(np.linalg.norm(gap, axis=1) < 1e-14 * size):
            break
        jacobian = np.einsum("kmb,mka->mab", mesh.shapes.gradients(X.T), nodes)
        determinant = jacobian[:, 0, 0] * jacobian[:, 1, 1] - jacobian[:, 0, 1] * jacobian[:, 1, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            step = (
                np.stack(
                    [
                        jacobian[:, 1, 1] * gap[:, 0] - jacobian[:, 0, 1] * gap[:, 1],
                        jacobian[:, 0, 0] * gap[:, 1] - jacobian[:, 1, 0] * gap[:, 0],
                    ],
                    axis=1,
                )
                / determinant[:, None]
            )
        # Beyond the cell its map may fold: steps longer than a cell are of no use.
        X = X + np.clip(np.nan_to_num(step, nan=1.0), -1.0, 1.0)
    gap = points - np.einsum("km,mka->ma", mesh.shapes.values(X.T), nodes)
    X[np.linalg.norm(gap, axis=1) > 1e-9 * size] = np.nan
    return X


def _beyond(mesh: QuadraticMesh, X: np.ndarray) -> np.ndarray:
    """(m,) distance of reference places (m, 2) from the reference cell, infinite for NaN."""
    margins = [-X[:, 0], -X[:, 1]]
    margins += [X[:, 0] - 1.0, X[:, 1] - 1.0] if mesh.quadrilateral else [X[:, 0] + X[:, 1] - 1.0]
    distance = np.maximum(np.max(np.stack(margins), axis=0), 0.0)
    return np.asarray(np.where(np.isnan(distance), np.inf, distance))


def interpolate(mesh: QuadraticMesh, places: Places, nodal: np.ndarray) -> np.ndarray:
    """(n, ...) values at the points of a continuous quadratic field with values (N, ...) at the nodes."""
    shapes = mesh.shapes.values(places.reference.T)
    return places.mean(np.einsum("km,mk...->m...", shapes, nodal[mesh.cell_nodes[places.cells]]))


def interpolate_within(mesh: QuadraticMesh, places: Places, nodal: np.ndarray) -> np.ndarray:
    """(n, ...) values at the points of the field that is linear between the nodes (N, ...): never beyond its nodes' values."""
    shares = hats(mesh, places.reference.T)
    return places.mean(np.einsum("mk,mk...->m...", shares, nodal[mesh.cell_nodes[places.cells]]))


def hats(mesh: QuadraticMesh, X: np.ndarray) -> np.ndarray:
    """(m, k) shares of the nodes of a cell, linear on the four parts between its nodes, at reference points X (2, m)."""
    if mesh.quadrilateral:
        one = np.stack([np.maximum(1 - 2 * X, 0), 1 - np.abs(2 * X - 1), np.maximum(2 * X - 1, 0)])
        places = np.rint(2 * np.asarray(mesh.shapes.element.doflocs, dtype=float)).astype(int)
        return np.stack([one[i, 0] * one[j, 1] for i, j in places], axis=1)
    corner = np.stack([1 - X[0] - X[1], X[0], X[1]])
    middles = [
        np.maximum(np.min(np.stack([2 * corner[i], 2 * corner[j], 1 - 2 * corner[k]]), axis=0), 0)
        for i, j, k in ((0, 1, 2), (1, 2, 0), (0, 2, 1))
    ]
    return np.concatenate([np.maximum(2 * corner - 1, 0), np.stack(middles)]).T


def rates_in_cells(mesh: QuadraticMesh, cells: np.ndarray, X: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """(m, 3) rate of strain (xx, yy, xy) of the velocity (N, 2) at reference places X (m, 2) of cells (m,)."""
    numbers = mesh.cell_nodes[cells]
    slopes = mesh.shapes.gradients(X.T)
    jacobian = np.einsum("kmb,mka->mab", slopes, mesh.nodes[numbers])
    by_reference = np.einsum("kmb,mka->mab", slopes, velocity[numbers])
    # d u_a / d x_c = sum_b d u_a / d X_b (J^-1)_bc
    gradient = np.swapaxes(
        np.linalg.solve(np.swapaxes(jacobian, 1, 2), np.swapaxes(by_reference, 1, 2)), 1, 2
    )
    return np.stack(
        [gradient[:, 0, 0], gradient[:, 1, 1], 0.5 * (gradient[:, 0, 1] + gradient[:, 1, 0])], axis=1
    )


def rates_at(mesh: QuadraticMesh, places: Places, velocity: np.ndarray) -> np.ndarray:
    """(n, 3) rate of strain at the points: what the cells that hold each say, averaged."""
    return places.mean(rates_in_cells(mesh, places.cells, places.reference, velocity))


def pressure_at(space: QuadraticSpace, places: Places, pressure: np.ndarray) -> np.ndarray:
    """(n,) pressures at the points of the coefficients (P,), averaged over the cells that hold each."""
    mesh, X, cells = space.mesh, places.reference, places.cells
    if space.pressure_name == "P1d":
        where = np.einsum("km,mka->ma", mesh.shapes.values(X.T), mesh.nodes[space.cell_nodes[cells]])
        shapes = space.pressure_at(X[:1].T, where[:, None], cells)[:, 0]
    else:
        shapes = space.pressure_at(X.T, X[None])[0]
    return places.mean(np.einsum("mk,mk->m", shapes, pressure[space.cell_pressures[cells]]))


def magnitude(rates: np.ndarray) -> np.ndarray:
    """(...,) |g| = sqrt(g:g) of rates (..., 3) = (xx, yy, xy)."""
    return np.asarray(np.sqrt(rates[..., 0] ** 2 + rates[..., 1] ** 2 + 2.0 * rates[..., 2] ** 2))
