"""Mixed finite-element spaces: velocities, and symmetric stresses imposed at points (seed B 6.3; seed A 4.3).

Turns fields into the matrices of the discrete Coulomb friction problem: H (strain rates), A (viscosity), mass and loads.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp
import skfem

from barchan.cones import chi_inverse, tensor_block_size
from barchan.errors import InputError
from barchan.spaces.elements import mixed_element
from barchan.spaces.location import Locator, evaluate

Field: TypeAlias = float | np.ndarray | Callable[[np.ndarray], Any]


def sampled(field: Any, points: np.ndarray, name: str, shape: tuple[int, ...] = ()) -> np.ndarray:
    """(n, *shape) values of a field at points (n, d): a constant, values already at the points, or a callable x -> (n, *shape).

    Raises InputError when the values have another shape or are not finite.
    """
    value = np.asarray(field(points) if callable(field) else field, dtype=float)
    full = (len(points), *shape)
    if value.shape not in (shape, full):
        raise InputError(name, f"array of shape {value.shape}", f"of shape {shape} or {full}")
    if not np.isfinite(value).all():
        raise InputError(name, "field with NaN or infinite values", "finite")
    return np.broadcast_to(value, full)


def strain_basis(dimension: int) -> np.ndarray:
    """(s, d, d): T with T[:, c, k] g_k = 2 chi^-1(sym(e_c (x) g)), the strain rate of the field e_c f with gradient g of f."""
    unit = np.eye(dimension)
    outer = np.einsum("ca,kb->ckab", unit, unit)
    return np.ascontiguousarray(
        np.moveaxis(2.0 * chi_inverse(0.5 * (outer + np.swapaxes(outer, -1, -2))), -1, 0)
    )


@dataclass(frozen=True, eq=False)
class Tables:
    """Shape functions at the points of one quadrature.

    values : (k, Q).  gradients : (cells, Q, k, d).  weights : (cells, Q).  points : (cells, Q, d).
    """

    values: np.ndarray
    gradients: np.ndarray
    weights: np.ndarray
    points: np.ndarray

    @property
    def flat_points(self) -> np.ndarray:
        """(cells Q, d) points, cell by cell."""
        return self.points.reshape(-1, self.points.shape[-1])


@dataclass(frozen=True, eq=False)
class WallRows:
    """Quadrature points of a named part of the boundary, with the rows of relative velocities.

    normals : (n, d) unit normals into the material.  frames : (n, d, d), rows (normal; tangents).
    points : (n, d).  weights : (n,) area of each point.  rates : (n d, size) rows w_q (v_N; v_T) of the velocity.
    """

    normals: np.ndarray
    frames: np.ndarray
    points: np.ndarray
    weights: np.ndarray
    rates: sp.csr_array


class MixedSpace:
    """Velocities and stresses on a mesh.

    Parameters
    ----------
    mesh : scikit-fem MeshTri, MeshQuad or MeshTet; `mesh.boundaries` names the parts of its boundary.
    velocity : "P1".."P4" on triangles, "P1", "P2" on tetrahedra, "Q1", "Q2" on quadrilaterals; continuous.
    stress : "P0", "P1d", "P2d" (discontinuous, imposed at Gauss points) or "P1" (continuous, imposed at the vertices by
        the trapezoidal rule). On quadrilaterals the degree is that in each direction.
    imposed : "factored" (seed B 6.3.4, where D(v) is within reach of the quadrature), "projected" (R^dagger^T B), or "auto".

    Attributes
    ----------
    dimension, s : d and d (d + 1) / 2.  size : all velocity unknowns.  n : points where the law is imposed.
    Velocity unknown `d i + c` is component c at node i (`nodes` (N, d) are the positions).

    Raises
    ------
    InputError : unknown element, or one that does not exist on this kind of cell.
    """

    def __init__(self, mesh: Any, velocity: str = "P2", stress: str = "P1d", imposed: str = "auto") -> None:
        self.element = mixed_element(mesh, velocity, stress, imposed)
        self.mesh = mesh
        self.velocity_name, self.stress_name = velocity, stress
        self.dimension = int(mesh.p.shape[0])
        self.s = tensor_block_size(self.dimension)
        vector = skfem.ElementVector(self.element.velocity.element)
        # A light quadrature: this basis numbers the unknowns and locates them; integrals use the tables below.
        self.basis = skfem.CellBasis(mesh, vector, intorder=1)
        self.size = int(self.basis.N)
        # scikit-fem numbers component c of node i as d i + c, whatever the entity the node belongs to.
        self.cell_dofs = np.ascontiguousarray(self.basis.element_dofs.T)
        self.cell_nodes = np.ascontiguousarray(self.cell_dofs[:, :: self.dimension] // self.dimension)
        self.nodes = np.ascontiguousarray(self.basis.doflocs[:, :: self.dimension].T)

    # -- quadratures -------------------------------------------------------------------------------------------------

    def tables(self, X: np.ndarray, W: np.ndarray) -> Tables:
        """Shape functions of the velocity at the reference points X (d, Q) of every cell, with weights W (Q,)."""
        mapping, shapes = self.basis.mapping, self.element.velocity
        inverse = np.asarray(mapping.invDF(X))
        gradients = np.einsum("ijeq,kqi->eqkj", inverse, shapes.gradients(X), optimize=True)
        weights = np.abs(np.asarray(mapping.detDF(X))) * W
        points = np.moveaxis(np.asarray(mapping.F(X)), 0, -1)
        return Tables(
            shapes.values(X), np.ascontiguousarray(gradients), weights, np.ascontiguousarray(points)
        )

    @cached_property
    def stress_tables(self) -> Tables:
        """Tables at the points that integrate the form b."""
        return self.tables(*self.element.integrated_at)

    @cached_property
    def viscous_tables(self) -> Tables:
        """Tables at the points where the viscosity is sampled, exact for constant viscosity on affine cells."""
        lost = 0 if self.element.tensor_product else 1
        return self.tables(*self.element.quadrature(2 * (self.element.velocity.degree - lost)))

    @cached_property
    def velocity_tables(self) -> Tables:
        """Tables exact for the mass matrix; forces and the feet of characteristics are sampled there."""
        return self.tables(*self.element.quadrature(2 * self.element.velocity.degree))

    @property
    def velocity_points(self) -> np.ndarray:
        """(n, d) points where forces are sampled, cell by cell."""
        return self.velocity_tables.flat_points

    @property
    def velocity_cells(self) -> np.ndarray:
        """(n,) the cell of each of `velocity_points`."""
        cells, points = self.velocity_tables.weights.shape
        return np.repeat(np.arange(cells), points)

    # -- points of the law -------------------------------------------------------------------------------------------

    @cached_property
    def _law_tables(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        cells = self.cell_dofs.shape[0]
        if self.element.continuous:
            tables = self.stress_tables
            share = tables.weights @ self.element.spreading.T
            weights = np.zeros(self.mesh.p.shape[1])
            np.add.at(weights, self.mesh.t.T, share)
            return self.mesh.p.T.copy(), weights, np.full(len(weights), -1)
        X, W = self.element.imposed_at
        points = np.moveaxis(np.asarray(self.basis.mapping.F(X)), 0, -1).reshape(-1, self.dimension)
        weights = (np.abs(np.asarray(self.basis.mapping.detDF(X))) * W).reshape(-1)
        return np.ascontiguousarray(points), weights, np.repeat(np.arange(cells), len(W))

    @property
    def points(self) -> np.ndarray:
        """(n, d) points where the law is imposed."""
        return self._law_tables[0]

    @property
    def weights(self) -> np.ndarray:
        """(n,) quadrature weights (areas, volumes) of the points of the law."""
        return self._law_tables[1]

    @property
    def cells(self) -> np.ndarray:
        """(n,) cell of each point of the law; -1 for continuous stresses."""
        return self._law_tables[2]

    @property
    def n(self) -> int:
        """Number of points of the law."""
        return len(self.weights)

    # -- matrices ----------------------------------------------------------------------------------------------------

    @cached_property
    def rates(self) -> sp.csr_array:
        """H (n s, size): 2 w_q chi^-1(D(v)) at the points, cell means of it when projected [velocity x length^(d-1)].

        gamma = H v, and H^T lambda integrates D(v) : chi(lambda) (seed B 6.3.4).
        """
        tables, spread = self.stress_tables, self.element.spreading
        local = np.einsum(
            "qp,ep,scg,epkg->eqskc",
            spread, tables.weights, strain_basis(self.dimension), tables.gradients, optimize=True,
        )  # fmt: skip
        cells, rows, s, k, d = local.shape
        data = local.reshape(cells, rows * s, k * d)
        if self.element.continuous:
            row = (self.s * self.mesh.t.T[:, :, None] + np.arange(s)).reshape(cells, rows * s, 1)
            full = np.broadcast_to(row, data.shape), np.broadcast_to(self.cell_dofs[:, None, :], data.shape)
            shape = (self.n * s, self.size)
            return sp.csr_array((data.ravel(), (full[0].ravel(), full[1].ravel())), shape=shape)
        order = np.argsort(self.cell_dofs, axis=1)
        columns = np.take_along_axis(self.cell_dofs, order, axis=1)
        data = np.take_along_axis(data, order[:, None, :], axis=2)
        indices = np.repeat(columns, rows * s, axis=0).ravel()
        indptr = np.arange(0, indices.size + 1, k * d)
        return sp.csr_array((data.ravel(), indices, indptr), shape=(cells * rows * s, self.size))

    @cached_property
    def _node_graph(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pattern (indptr, indices) of nodes that share a cell, and the place (cells, k, k) of each pair in it."""
        count, nodes = len(self.nodes), self.cell_nodes
        row = np.repeat(nodes, nodes.shape[1], axis=1).ravel()
        column = np.tile(nodes, (1, nodes.shape[1])).ravel()
        graph = sp.coo_array((np.ones(len(row), dtype=np.int8), (row, column)), shape=(count, count)).tocsr()
        graph.sort_indices()
        keys = np.repeat(np.arange(count), np.diff(graph.indptr)) * count + graph.indices
        places = np.searchsorted(keys, row.astype(np.int64) * count + column)
        return graph.indptr, graph.indices, places

    def _assembled(self, local: np.ndarray) -> sp.csr_array:
        """Sum of cell matrices (cells, k, d, k, d) into one (size, size), always on the same pattern."""
        indptr, indices, places = self._node_graph
        d = self.dimension
        blocks = np.empty((len(indices), d, d))
        for a in range(d):
            for b in range(d):
                entries = np.ascontiguousarray(local[:, :, a, :, b]).ravel()
                blocks[:, a, b] = np.bincount(places, entries, minlength=len(indices))
        return sp.csr_array(sp.bsr_array((blocks, indices, indptr), shape=(self.size, self.size)))

    def viscous(self, viscosity: Field, bulk: float = 1.0) -> sp.csr_array:
        """A (size, size): v.A u = integral of 2 eta (Dev D(u) : Dev D(v) + (bulk / d) div u div v) (seed A, 4.2).

        viscosity : constant, callable x (n, d) -> (n,), or values at `viscous_tables.flat_points`, >= 0.
        Raises InputError for a negative viscosity or bulk.
        """
        tables = self.viscous_tables
        eta = sampled(viscosity, tables.flat_points, "viscosity").reshape(tables.weights.shape)
        if eta.min(initial=0.0) < 0.0 or not bulk >= 0.0:
            raise InputError("viscosity, bulk", f"{eta.min():g}, {bulk}", ">= 0")
        basis = strain_basis(self.dimension).copy()
        # 2 eta D:D = eta |2 chi^-1(D)|^2 since |chi^-1(D)|^2 = D:D / 2; the trace part is weighted by b.
        basis[0] *= np.sqrt(bulk)
        strain = np.einsum("scg,epkg->epskc", basis, tables.gradients, optimize=True)
        cells, p, s, k, d = strain.shape
        rows = strain.reshape(cells, p * s, k * d)
        weighted = rows * np.repeat(eta * tables.weights, s, axis=1)[:, :, None]
        local = np.swapaxes(rows, 1, 2) @ weighted
        return self._assembled(local.reshape(cells, k, d, k, d))

    def mass(self, density: Field = 1.0) -> sp.csr_array:
        """M (size, size): v.M u = integral of rho u.v; density constant, callable, or at `velocity_points`, >= 0."""
        tables = self.velocity_tables
        rho = sampled(density, tables.flat_points, "density").reshape(tables.weights.shape)
        if rho.min(initial=0.0) < 0.0:
            raise InputError("density", f"{rho.min():g}", ">= 0")
        scalar = np.einsum("ep,kp,lp->ekl", rho * tables.weights, tables.values, tables.values, optimize=True)
        local = np.einsum("ekl,ab->ekalb", scalar, np.eye(self.dimension))
        return self._assembled(local)

    def load(self, force: Any) -> np.ndarray:
        """(size,) integral of f.v; force (d,), callable x -> (n, d), or values (n, d) at `velocity_points`."""
        tables, d = self.velocity_tables, self.dimension
        values = sampled(force, tables.flat_points, "force", (d,)).reshape(*tables.weights.shape, d)
        local = np.einsum("ep,kp,epc->ekc", tables.weights, tables.values, values, optimize=True)
        return np.bincount(self.cell_dofs.ravel(), local.ravel(), minlength=self.size)

    # -- boundary ----------------------------------------------------------------------------------------------------

    def facets(self, name: str) -> np.ndarray:
        """Facets of a named part of the boundary; InputError that lists the known names for another one."""
        known = self.mesh.boundaries or {}
        if name not in known:
            raise InputError(
                "boundary", name, "one of " + (", ".join(known) or "none: the mesh names no boundary")
            )
        return np.asarray(known[name], dtype=np.int64)

    def boundary_nodes(self, name: str) -> np.ndarray:
        """Nodes of the velocity on a named part, ascending."""
        return np.unique(self.basis.get_dofs(self.facets(name)).all() // self.dimension)

    def dofs(self, name: str, component: int | None = None) -> np.ndarray:
        """Velocity unknowns on a named part, of one component or of all."""
        nodes = self.boundary_nodes(name)
        chosen = np.arange(self.dimension) if component is None else np.array([component])
        return np.sort((self.dimension * nodes[:, None] + chosen).ravel())

    def facet_basis(self, part: str | np.ndarray, order: int | None = None) -> Any:
        """Scalar scikit-fem basis on a named part or on facets; `order` of its quadrature, by default exact for v.v."""
        facets = self.facets(part) if isinstance(part, str) else part
        order = 2 * self.element.velocity.degree if order is None else max(order, 1)
        return skfem.FacetBasis(self.mesh, self.element.velocity.element, facets=facets, intorder=order)

    def boundary_load(self, name: str | np.ndarray, stress: Any) -> np.ndarray:
        """(size,) integral over a part (or facets) of (sigma n).v.

        stress : sigma (d, d), tension positive, or a callable x (n, d) -> (n, d, d).
        """
        basis, d = self.facet_basis(name), self.dimension
        points = np.moveaxis(np.asarray(basis.default_parameters()["x"]), 0, -1)
        normals = np.moveaxis(np.asarray(basis.normals), 0, -1)
        sigma = sampled(stress, points.reshape(-1, d), "stress", (d, d)).reshape(*points.shape[:-1], d, d)
        traction = np.einsum("fqab,fqb->fqa", sigma, normals) * basis.dx[..., None]
        load = np.zeros(self.size)
        for k in range(basis.Nbfun):
            share = np.einsum("fq,fqa->fa", np.asarray(basis.basis[k][0]), traction)
            np.add.at(load, d * basis.element_dofs[k][:, None] + np.arange(d), share)
        return load

    def flux(self, part: str | np.ndarray) -> np.ndarray:
        """(size,) the row that integrates v.n over a named part or over facets (n outwards)."""
        return self.boundary_load(part, np.eye(self.dimension))

    def wall(self, name: str) -> WallRows:
        """Quadrature points of a part and rows of the velocity relative to it, for walls with friction."""
        d = self.dimension
        basis = self.facet_basis(name, 2 * (self.element.velocity.degree - 1))
        points = np.moveaxis(np.asarray(basis.default_parameters()["x"]), 0, -1)
        normals = -np.moveaxis(np.asarray(basis.normals), 0, -1).reshape(-1, d)
        weights = np.asarray(basis.dx).ravel()
        frames = wall_frames(normals)
        values = np.stack([np.asarray(basis.basis[k][0]) for k in range(basis.Nbfun)], axis=-1)
        dofs = d * np.repeat(basis.element_dofs.T, points.shape[1], axis=0)[:, :, None] + np.arange(d)
        local = np.einsum("q,qab,qk->qakb", weights, frames, values.reshape(len(weights), -1))
        columns = np.broadcast_to(dofs[:, None], local.shape)
        row = np.arange(len(weights) * d).reshape(-1, d, 1, 1)
        rows = np.broadcast_to(row, local.shape)
        rates = sp.csr_array(
            (local.ravel(), (rows.ravel(), columns.ravel())), shape=(len(weights) * d, self.size)
        )
        return WallRows(normals, frames, points.reshape(-1, d), weights, rates)

    # -- fields ------------------------------------------------------------------------------------------------------

    def strain_rates(self, v: np.ndarray) -> np.ndarray:
        """(n, s) strain rates chi^-1(D(v)) at the points of the law [1/time]; projected when H is."""
        return (self.rates @ v).reshape(self.n, self.s) / (2.0 * self.weights[:, None])

    def vertex_velocities(self, v: np.ndarray) -> np.ndarray:
        """(vertices, d) velocities at the vertices of the mesh."""
        return np.asarray(v)[self.basis.nodal_dofs].T.copy()

    def interpolate(self, field: Any) -> np.ndarray:
        """(size,) velocity whose nodal values are those of the field: (d,), callable x (n, d) -> (n, d), or (N, d)."""
        return sampled(field, self.nodes, "velocity", (self.dimension,)).reshape(-1).copy()

    def at(self, v: np.ndarray, points: np.ndarray) -> np.ndarray:
        """(n, d) velocities at points (n, d); a point outside the domain takes the value at the nearest point of it."""
        cells, reference, _ = self.locator.find(points)
        return np.asarray(evaluate(self.basis, v, cells, reference))

    @cached_property
    def locator(self) -> Locator:
        """What finds the cells of points."""
        return Locator(self.mesh)


def wall_frames(normals: np.ndarray) -> np.ndarray:
    """(n, d, d) orthonormal frames whose first rows are the unit normals (n, d)."""
    count, d = normals.shape
    frames = np.empty((count, d, d))
    frames[:, 0] = normals
    if d == 2:
        frames[:, 1] = np.stack([-normals[:, 1], normals[:, 0]], axis=1)
        return frames
    # Cross with the axis the normal is least aligned with: never close to parallel.
    axis = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    first = np.cross(normals, axis)
    frames[:, 1] = first / np.linalg.norm(first, axis=1, keepdims=True)
    frames[:, 2] = np.cross(normals, frames[:, 1])
    return frames
