"""Reference elements of mixed velocity-stress spaces: shapes, points where the stress is imposed, and the map between both.

Seed B 6.3.3-6.3.4: R takes stress degrees of freedom to the quadrature points; R^dagger is its pseudo-inverse, cell by cell.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import skfem
from skfem.quadrature import get_quadrature

from barchan.errors import InputError

STRESSES = ("P0", "P1", "P1d", "P2d")
IMPOSITIONS = ("auto", "factored", "projected")

_VELOCITIES: dict[type, dict[str, tuple[type, int]]] = {
    skfem.MeshTri: {
        "P1": (skfem.ElementTriP1, 1),
        "P2": (skfem.ElementTriP2, 2),
        "P3": (skfem.ElementTriP3, 3),
        "P4": (skfem.ElementTriP4, 4),
    },
    skfem.MeshQuad: {"Q1": (skfem.ElementQuad1, 1), "Q2": (skfem.ElementQuad2, 2)},
    skfem.MeshTet: {"P1": (skfem.ElementTetP1, 1), "P2": (skfem.ElementTetP2, 2)},
}
_STRESS_SHAPES: dict[type, tuple[type, type, type]] = {
    skfem.MeshTri: (skfem.ElementTriP0, skfem.ElementTriP1, skfem.ElementTriP2),
    skfem.MeshQuad: (skfem.ElementQuad0, skfem.ElementQuad1, skfem.ElementQuad2),
    skfem.MeshTet: (skfem.ElementTetP0, skfem.ElementTetP1, skfem.ElementTetP2),
}


def _kind_of(mesh: Any) -> type:
    for kind in _VELOCITIES:
        if isinstance(mesh, kind):
            return kind
    raise InputError(
        "mesh", type(mesh).__name__, "a scikit-fem mesh of triangles, quadrilaterals or tetrahedra"
    )


@dataclass(frozen=True, eq=False)
class Shapes:
    """Scalar shape functions of a reference cell. degree : polynomial degree (in each direction on quadrilaterals)."""

    element: Any
    degree: int

    def values(self, X: np.ndarray) -> np.ndarray:
        """(k, Q) values of the k shape functions at the reference points X (d, Q)."""
        return np.stack(
            [np.broadcast_to(self.element.lbasis(X, i)[0], X.shape[1:]) for i in range(self.count)]
        )

    def gradients(self, X: np.ndarray) -> np.ndarray:
        """(k, Q, d) reference gradients at the reference points X (d, Q)."""
        rows = [np.asarray(self.element.lbasis(X, i)[1], dtype=float) for i in range(self.count)]
        return np.stack([np.moveaxis(np.broadcast_to(row, X.shape), 0, -1) for row in rows])

    @property
    def count(self) -> int:
        """Number of shape functions."""
        return len(self.element.doflocs)


@dataclass(frozen=True, eq=False)
class MixedElement:
    """A pair velocity-stress on one kind of cell.

    velocity : scalar shapes of each velocity component.  stress : scalar shapes of each stress component.
    continuous : stress shared between cells and imposed at the vertices (trapezoidal rule, seed B 6.3.4).
    imposed : "factored" (the points also integrate the form b exactly, B = R^T H) or "projected" (R^dagger^T B).
    points, weights : (d, n) and (n,) reference points where the law is imposed, for discontinuous stresses.
    """

    velocity: Shapes
    stress: Shapes
    continuous: bool
    imposed: str
    tensor_product: bool

    @property
    def reference(self) -> Any:
        """Reference cell in the sense of scikit-fem."""
        return self.velocity.element

    def quadrature(self, order: int) -> tuple[np.ndarray, np.ndarray]:
        """Points (d, Q) and positive weights (Q,), exact to `order` at least (in each direction on quadrilaterals)."""
        if order <= 1:
            return self._barycentre
        # Stresses at points of negative weight would resist the wrong way, and points on facets belong to several cells:
        # take the next rule without either.
        for exact in range(order, order + 4):
            X, W = get_quadrature(self.reference, exact)
            if np.min(W) > 0.0 and np.min(X) > 0.0 and np.max(X) < 1.0:
                break
        return np.asarray(X, dtype=float), np.asarray(W, dtype=float)

    @property
    def _barycentre(self) -> tuple[np.ndarray, np.ndarray]:
        X, W = get_quadrature(self.reference, 2)
        return np.mean(X, axis=1, keepdims=True), np.array([float(np.sum(W))])

    @cached_property
    def imposed_at(self) -> tuple[np.ndarray, np.ndarray]:
        """Reference points (d, n) and weights (n,) of the law: Gauss points of order 2 r, r the degree of the stress."""
        return self.quadrature(2 * self.stress.degree)

    @cached_property
    def integrated_at(self) -> tuple[np.ndarray, np.ndarray]:
        """Points and weights that integrate the form b: those of the law when factored, else exact for stress : D(v)."""
        if self.imposed == "factored":
            return self.imposed_at
        lost = 0 if self.tensor_product else 1
        return self.quadrature(self.stress.degree + self.velocity.degree - lost)

    @cached_property
    def interpolation(self) -> np.ndarray:
        """R (n, k) of one cell and component: degrees of freedom to values at the points; seed B Eq. (6.34)."""
        return self.stress.values(self.imposed_at[0]).T

    @cached_property
    def pseudo_inverse(self) -> np.ndarray:
        """R^dagger (k, n), with R^dagger R = 1."""
        return np.linalg.pinv(self.interpolation)

    @cached_property
    def spreading(self) -> np.ndarray:
        """(rows, Q): what a strain rate at integration point Q adds to each row of H, weight apart.

        Identity when factored, R^dagger^T alpha(x_Q) when projected, alpha(x_Q) (rows = cell vertices) when continuous.
        """
        if self.continuous:
            return self.stress.values(self.integrated_at[0])
        if self.imposed == "factored":
            return np.eye(len(self.imposed_at[1]))
        return self.pseudo_inverse.T @ self.stress.values(self.integrated_at[0])


def mixed_element(mesh: Any, velocity: str, stress: str, imposed: str = "auto") -> MixedElement:
    """The pair of elements for the cells of a mesh; see `barchan.spaces.mixed.MixedSpace` for the names.

    Raises InputError for unknown names, and for "factored" where the points do not integrate b exactly.
    """
    kind = _kind_of(mesh)
    known = _VELOCITIES[kind]
    if velocity not in known:
        raise InputError("velocity", velocity, f"one of {', '.join(known)} on a {kind.__name__}")
    if stress not in STRESSES:
        raise InputError("stress", stress, "one of " + ", ".join(STRESSES))
    if imposed not in IMPOSITIONS:
        raise InputError("imposed", imposed, "one of " + ", ".join(IMPOSITIONS))
    make, degree = known[velocity]
    order, continuous, tensor = int(stress[1]), stress == "P1", kind is skfem.MeshQuad
    # On simplices D(v) has degree k - 1. On quadrilaterals stress : D(v) has degree r + k in each direction, whatever their
    # shape (the Jacobian cancels), and r + 1 Gauss points are exact to 2 r + 1.
    exact = not continuous and degree - 1 <= order
    if imposed == "factored" and not exact:
        raise InputError(
            "imposed", imposed, f"projected or auto: {velocity}-{stress} cannot be factored exactly"
        )
    chosen = "factored" if exact and imposed != "projected" else "projected"
    return MixedElement(
        Shapes(make(), degree), Shapes(_STRESS_SHAPES[kind][order](), order), continuous, chosen, tensor
    )
