"""Q2 or P2 velocities with linear pressures on curved cells, and the tables that element kernels read (seed C 4.2).

Q2/P1 on quadrilaterals, its pressure linear in physical coordinates ("P1d", non-parametric) or in reference ones
("P1d_mapped"); on triangles P2/P1d (stable on meshes split at their centres) and Taylor and Hood's P2/P1 ("P1").
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import skfem
from skfem.quadrature import get_quadrature

from barchan.errors import InputError
from barchan.spaces.quadratic.mesh import QuadraticMesh

PRESSURES = ("P1d", "P1d_mapped", "P1")

_SIDES = {9: ((0, 1), (1, 2), (2, 3), (0, 3)), 6: ((0, 1), (1, 2), (0, 2))}
_CORNERS = {
    9: np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]),
    6: np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),
}


@dataclass(frozen=True, eq=False)
class Boundary:
    """Quadrature of a named part of the boundary, F facets with R points each.

    cells : (F,).  values : (F, R, k) of the shapes of the cell.  points, normals (outward) : (F, R, 2).  weights : (F, R).
    """

    cells: np.ndarray
    values: np.ndarray
    points: np.ndarray
    normals: np.ndarray
    weights: np.ndarray


class QuadraticSpace:
    """Velocities and pressures on a mesh with curved cells.

    Parameters
    ----------
    mesh : of C cells.
    pressure : "P1d" (discontinuous, 1, (x - xc)/h, (y - yc)/h on each cell), "P1d_mapped" (the same in reference
        coordinates, quadrilaterals only) or "P1" (continuous, triangles only).

    Attributes
    ----------
    N, P, size : velocity nodes, pressure unknowns, 2 N + P unknowns. Unknown 2 i + c is component c at node i.
    cell_nodes (C, k), cell_pressures (C, m), cell_unknowns (C, 2 k + m) : numbers; pressures 3 c + i when discontinuous.
    values (Q, k), gradients (C, Q, k, 2), weights (C, Q), points (C, Q, 2), pressure_values (C, Q, m) : at the points.
    pressure_frames : (C, 3) xc, yc, h of the physical linear functions.

    Raises
    ------
    InputError : unknown pressure, one that does not exist on these cells, or a cell turned inside out.
    """

    def __init__(self, mesh: QuadraticMesh, pressure: str = "P1d") -> None:
        if pressure not in PRESSURES:
            raise InputError("pressure", pressure, "one of " + ", ".join(PRESSURES))
        if mesh.quadrilateral and pressure == "P1":
            raise InputError("pressure", pressure, "P1d or P1d_mapped on quadrilaterals")
        if not mesh.quadrilateral and pressure == "P1d_mapped":
            raise InputError("pressure", pressure, "P1d or P1 on triangles")
        self.mesh, self.pressure_name = mesh, pressure
        self.cell_nodes = mesh.cell_nodes
        self.cells, self._k = self.cell_nodes.shape
        self.N = len(mesh.nodes)
        if pressure == "P1":
            self.cell_pressures = self.cell_nodes[:, :3]
            self.P = mesh.skeleton.p.shape[1]
        else:
            self.P = 3 * self.cells
            self.cell_pressures = np.arange(self.P, dtype=np.int32).reshape(-1, 3)
        self.size = 2 * self.N + self.P
        velocity = np.repeat(2 * self.cell_nodes, 2, axis=1)
        velocity[:, 1::2] += 1
        self.cell_unknowns = np.ascontiguousarray(
            np.hstack([velocity, 2 * self.N + self.cell_pressures]).astype(np.int32)
        )
        element = skfem.ElementQuad2() if mesh.quadrilateral else skfem.ElementTriP2()
        X, W = get_quadrature(element, 5 if mesh.quadrilateral else 4)
        self.reference_points, self._reference_weights = (
            np.asarray(X, dtype=float),
            np.asarray(W, dtype=float),
        )
        self._tabulate()

    def _tabulate(self) -> None:
        X = self.reference_points
        self.values = np.ascontiguousarray(self.mesh.shapes.values(X).T)
        places = self.mesh.nodes[self.cell_nodes]
        slopes = np.ascontiguousarray(self.mesh.shapes.gradients(X).transpose(1, 0, 2))
        jacobian = np.einsum("cia,qib->cqab", places, slopes, optimize=True)
        a, b, c, d = (jacobian[..., i, j] for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)))
        determinant = a * d - b * c
        turned = np.flatnonzero(np.any(determinant * np.sign(determinant[:, :1]) <= 0.0, axis=1))
        if len(turned):
            x, y = np.mean(places[turned[0]], axis=0)
            raise InputError(
                "mesh",
                f"cell {turned[0]} at ({x:.4g}, {y:.4g}) folded over",
                "made of cells with positive Jacobians",
            )
        inverse = np.empty_like(jacobian)
        inverse[..., 0, 0], inverse[..., 0, 1] = d / determinant, -b / determinant
        inverse[..., 1, 0], inverse[..., 1, 1] = -c / determinant, a / determinant
        # d phi / d x_a = sum_b d phi / d X_b (J^-1)_ba
        self.gradients = np.ascontiguousarray(np.matmul(slopes[None], inverse))
        self.weights = np.ascontiguousarray(np.abs(determinant) * self._reference_weights)
        self.points = np.matmul(self.values[None], places)
        self.pressure_values = self.pressure_at(X, self.points)

    @cached_property
    def pressure_frames(self) -> np.ndarray:
        """(C, 3) centre and size of each cell."""
        places = self.mesh.nodes[self.cell_nodes]
        centre = (
            places[:, 8]
            if self.mesh.quadrilateral
            else np.einsum("i,cid->cd", self.mesh.shapes.values(np.full((2, 1), 1.0 / 3.0))[:, 0], places)
        )
        corners = places[:, : 4 if self.mesh.quadrilateral else 3]
        size = np.sqrt(np.mean(np.sum((corners - centre[:, None]) ** 2, axis=2), axis=1))
        return np.concatenate([centre, size[:, None]], axis=1)

    def pressure_at(
        self, X: np.ndarray, points: np.ndarray, cells: np.ndarray | slice = slice(None)
    ) -> np.ndarray:
        """(n, R, m) pressure shapes of the given cells at their reference points X (2, R), which are `points` (n, R, 2)."""
        if self.pressure_name == "P1d":
            frames = self.pressure_frames[cells]
            offsets = (points - frames[:, None, :2]) / frames[:, None, 2:]
            return np.concatenate([np.ones_like(offsets[..., :1]), offsets], axis=2)
        if self.pressure_name == "P1d_mapped":
            flat = np.stack([np.ones_like(X[0]), 2.0 * X[0] - 1.0, 2.0 * X[1] - 1.0], axis=1)
        else:
            flat = np.stack([1.0 - X[0] - X[1], X[0], X[1]], axis=1)
        return np.ascontiguousarray(np.broadcast_to(flat, (len(points), *flat.shape)))

    @cached_property
    def pressure_weights(self) -> np.ndarray:
        """(P,) integrals of the pressure shapes: their product with a pressure is its integral over the domain."""
        local = np.einsum("cq,cqm->cm", self.weights, self.pressure_values)
        return np.bincount(self.cell_pressures.ravel(), local.ravel(), minlength=self.P)

    @cached_property
    def unit_pressure(self) -> np.ndarray:
        """(P,) coefficients of the pressure 1."""
        if self.pressure_name == "P1":
            return np.ones(self.P)
        unit = np.zeros(self.P)
        unit[::3] = 1.0
        return unit

    @property
    def area(self) -> float:
        """Area of the domain."""
        return float(self.weights.sum())

    def boundary(self, part: str, points: int = 3) -> Boundary:
        """Gauss quadrature of a named part, `points` on each facet. Raises InputError for an unknown name."""
        boundaries = self.mesh.boundaries
        if part not in boundaries:
            raise InputError("boundary", part, "one of " + ", ".join(boundaries))
        facets = np.asarray(boundaries[part])
        skeleton = self.mesh.skeleton
        cells = np.asarray(skeleton.f2t[0, facets])
        local = np.argmax(skeleton.t2f[:, cells] == facets, axis=0)
        t, w = np.polynomial.legendre.leggauss(points)
        t, w = 0.5 * (t + 1.0), 0.5 * w
        corners, sides = _CORNERS[self._k], np.array(_SIDES[self._k])
        values = np.empty((len(facets), points, self._k))
        tangents = np.empty((len(facets), points, 2))
        places = self.mesh.nodes[self.cell_nodes[cells]]
        for side in range(len(sides)):
            mine = local == side
            start, end = corners[sides[side, 0]], corners[sides[side, 1]]
            X = (start[:, None] + np.outer(end - start, t)).copy()
            values[mine] = self.mesh.shapes.values(X).T
            slopes = np.einsum("kqb,b->qk", self.mesh.shapes.gradients(X), end - start)
            tangents[mine] = np.einsum("qk,fka->fqa", slopes, places[mine])
        where = np.einsum("fqk,fka->fqa", values, places)
        length = np.linalg.norm(tangents, axis=2)
        normals = np.stack([tangents[..., 1], -tangents[..., 0]], axis=2) / length[..., None]
        middle = np.mean(places, axis=1)
        outward = np.sign(np.einsum("fqa,fqa->fq", normals, where - middle[:, None]))
        return Boundary(cells, values, where, normals * outward[..., None], length * w)
