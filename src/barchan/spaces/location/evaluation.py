"""Values of a finite-element velocity at reference coordinates, compiled, for any Lagrange element of scikit-fem.

The shape functions are written once as polynomials, so that one kernel serves P1..P4, Q1, Q2 and tetrahedra.
"""

from __future__ import annotations

from functools import cache
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from skfem import CellBasis, ElementH1, ElementVector
from skfem.refdom import RefQuad

from barchan.errors import InputError
from barchan.spaces.location import _kernels as kernels


def evaluate(
    basis: CellBasis, values: ArrayLike, cells: NDArray[np.int64], reference: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Field with coefficients `values` (size,) at reference coordinates (n, d) in `cells` (n,).

    Parameters
    ----------
    basis : scikit-fem basis of a Lagrange element, or of an `ElementVector` of one.

    Returns (n, c), c being 1 for a scalar element. Raises InputError for another element or a wrong number of values.
    """
    field = np.ascontiguousarray(values, dtype=np.float64)
    if field.shape != (basis.N,):
        raise InputError("values", f"an array of shape {field.shape}", f"of shape ({basis.N},)")
    vector = isinstance(basis.elem, ElementVector)
    scalar = basis.elem.elem if vector else basis.elem
    kind: Any = type(scalar)
    coefficients, exponents = _polynomials(kind)
    return np.asarray(
        kernels.field_values(
            coefficients,
            exponents,
            basis.element_dofs,
            field,
            np.ascontiguousarray(cells, dtype=np.int64),
            np.ascontiguousarray(reference, dtype=np.float64),
            basis.elem.dim if vector else 1,
        )
    )


@cache
def _polynomials(kind: Any) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Coefficients (shapes, terms) of the shape functions of an element on monomials with exponents (terms, d)."""
    element = kind()
    if not isinstance(element, ElementH1) or np.any(np.isnan(element.doflocs)):
        raise InputError("element", kind.__name__, "a Lagrange element")
    dimension = element.doflocs.shape[1]
    # scikit-fem counts the degree of a quadrilateral's element as the sum of those along x and y.
    square = element.refdom is RefQuad
    degree = element.maxdeg // 2 if square else element.maxdeg
    exponents = np.array(
        [e for e in product(range(degree + 1), repeat=dimension) if square or sum(e) <= degree],
        dtype=np.int64,
    )
    lattice = np.array(list(product(np.linspace(0.0, 1.0, degree + 2), repeat=dimension)))
    monomials = np.prod(lattice[:, None, :] ** exponents[None], axis=2)
    shapes = np.stack([element.lbasis(lattice.T, i)[0] for i in range(len(element.doflocs))], axis=1)
    coefficients = np.linalg.lstsq(monomials, shapes, rcond=None)[0]
    if np.max(np.abs(monomials @ coefficients - shapes)) > 1e-9:
        raise InputError("element", kind.__name__, f"a polynomial of degree {degree}")
    return np.ascontiguousarray(coefficients.T), exponents
