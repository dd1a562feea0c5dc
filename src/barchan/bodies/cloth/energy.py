"""The elastic energy of a cloth, E(q, p) of its positions q and rest positions p: value, gradient, Hessian, mixed derivative.

Membrane (Saint Venant-Kirchhoff or springs) and bending at hinges, sum k (theta - theta_0)^2 / 2 with k = D |e|^2 / (A1 + A2)
(Grinspun et al. 2003). On rows of equilateral triangles, and along the sides of squares, this k bends to a cylinder with the
energy D kappa^2 / 2 of a plate of rigidity D; double curvature costs that of a Poisson's ratio of -1/3 (equilateral).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.bodies.cloth import _hinge_kernels as hinge
from barchan.bodies.cloth import _membrane_kernels as membrane
from barchan.bodies.cloth import _spring_kernels as spring
from barchan.bodies.cloth.hinges import dihedral_angles
from barchan.bodies.cloth.material import ClothMaterial
from barchan.bodies.cloth.mesh import ClothMesh, triangle_areas
from barchan.bodies.cloth.pattern import BlockPattern, block_pattern
from barchan.errors import InputError

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ShellEnergy:
    """Elastic energy of the triangles of `mesh` at rest in `rest` (n, 3) [m], of a material; positions q are (n, 3) or flat.

    The topology is that of the mesh; rest positions may change (`with_rest`) without a look at the mesh.
    """

    mesh: ClothMesh
    material: ClothMaterial
    rest: Vector
    pattern: BlockPattern

    @classmethod
    def of(cls, mesh: ClothMesh, material: ClothMaterial) -> ShellEnergy:
        """At rest as the mesh is."""
        return cls(mesh, material, mesh.vertices, block_pattern(mesh))

    def with_rest(self, rest: Vector) -> ShellEnergy:
        """The same cloth with other rest positions (n, 3) or (3 n,); InputError for the wrong size."""
        return ShellEnergy(self.mesh, self.material, self._positions("rest", rest), self.pattern)

    def value(self, q: Vector) -> float:
        """Energy [J]."""
        return self._evaluated(q)[0]

    def gradient(self, q: Vector) -> Vector:
        """dE/dq (n, 3) [N]: minus the elastic forces."""
        return self._evaluated(q)[1]

    def hessian(self, q: Vector, convex: bool = False) -> sp.bsr_array:
        """d2E/dq2 (3 n, 3 n) in blocks of 3.

        `convex` leaves out, element by element, what is not positive semidefinite: compressive stress in the geometric
        stiffness of the membrane, and the curvature of the angles (the Gauss-Newton part remains). Implicit steps use it.
        """
        x = self._positions("q", q)
        data = self.pattern.zeros()
        if self.material.membrane == "stvk":
            membrane.add_membrane_hessian(
                x, self.mesh.triangles, self._rest_metrics, *self._moduli, convex, self.pattern.triangles, data
            )  # fmt: skip
        else:
            edges, lengths, stiffness = self._springs
            spring.add_spring_hessian(x, edges, lengths, stiffness, convex, self.pattern.edges, data)
        angles, stiffness = self._hinges
        hinge.add_bending_hessian(
            x, self.mesh.hinges.stencils, angles, stiffness, convex, self.pattern.hinges, data
        )
        return self.pattern.matrix(data)

    def mixed_derivative(self, q: Vector) -> sp.bsr_array:
        """d(dE/dq)/dp (3 n, 3 n): row 3 i + a, column 3 j + b is the change of dE/dq_ia with the rest position p_jb."""
        x = self._positions("q", q)
        data = self.pattern.zeros()
        if self.material.membrane == "stvk":
            membrane.add_membrane_mixed(
                x, self.rest, self.mesh.triangles, *self._moduli, self.pattern.triangles, data
            )
        else:
            spring.add_spring_mixed(
                x, self.rest, self.pattern.edge_stencils, self.material.membrane_stiffness, self.pattern.edges, data
            )  # fmt: skip
        hinge.add_bending_mixed(
            x,
            self.rest,
            self.mesh.hinges.stencils,
            self.material.flexural_rigidity,
            self.pattern.hinges,
            data,
        )
        return self.pattern.matrix(data)

    def angles(self, q: Vector) -> Vector:
        """(h,) dihedral angles [rad] of the hinges, `mesh.hinges.stencils`."""
        return dihedral_angles(self._positions("q", q), self.mesh.hinges.stencils)

    def _evaluated(self, q: Vector) -> tuple[float, Vector]:
        x = self._positions("q", q)
        gradient = np.zeros_like(x)
        if self.material.membrane == "stvk":
            energy = membrane.add_membrane(
                x, self.mesh.triangles, self._rest_metrics, *self._moduli, gradient
            )
        else:
            energy = spring.add_springs(x, *self._springs, gradient)
        energy += hinge.add_bending(x, self.mesh.hinges.stencils, *self._hinges, gradient)
        return float(energy), gradient

    @property
    def _moduli(self) -> tuple[float, float]:
        nu = self.material.poisson_ratio
        return self.material.membrane_stiffness / (8.0 * (1.0 - nu**2)), nu

    @cached_property
    def _rest_metrics(self) -> Vector:
        corner = self.rest[self.mesh.triangles]
        one, two = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
        return np.stack(
            [np.sum(one * one, axis=1), np.sum(one * two, axis=1), np.sum(two * two, axis=1)], axis=1
        )

    @cached_property
    def _areas(self) -> Vector:
        return triangle_areas(self.rest, self.mesh.triangles)

    @cached_property
    def _edge_areas(self) -> Vector:
        """(e,) area of the triangles beside each edge [m^2]."""
        beside = self.mesh.hinges.beside
        return np.sum(np.where(beside >= 0, self._areas[beside], 0.0), axis=1)

    @cached_property
    def _hinges(self) -> tuple[Vector, Vector]:
        """(h,) rest angles [rad] and stiffnesses [J]."""
        hinges = self.mesh.hinges
        lengths = self._rest_lengths[hinges.edge_of_hinge]
        areas = self._edge_areas[hinges.edge_of_hinge]
        return dihedral_angles(
            self.rest, hinges.stencils
        ), self.material.flexural_rigidity * lengths**2 / areas

    @cached_property
    def _springs(self) -> tuple[NDArray[np.int64], Vector, Vector]:
        """Edges (e, 2), rest lengths [m], stiffnesses [N/m]."""
        lengths = self._rest_lengths
        return (
            self.mesh.hinges.edges,
            lengths,
            self.material.membrane_stiffness * self._edge_areas / lengths**2,
        )

    @cached_property
    def _rest_lengths(self) -> Vector:
        ends = self.rest[self.mesh.hinges.edges]
        return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)

    def _positions(self, name: str, q: Vector) -> Vector:
        shape = self.mesh.vertices.shape
        x = np.ascontiguousarray(q, dtype=np.float64)
        if x.size != shape[0] * 3 or not np.all(np.isfinite(x)):
            raise InputError(name, np.shape(q), f"finite positions of shape {shape}")
        return x.reshape(shape)
