"""Membrane of Saint Venant and Kirchhoff on flat triangles, by metrics: exact gradients, Hessians and mixed derivatives.

A triangle with edges e1, e2 has the metric a = (e1.e1, e1.e2, e2.e2), at rest b. With J = det b, D = a - b, plane stress and
t = tr(b^-1 D) its energy is W(a, b) = k sqrt(J) (t^2 - 2 (1 - nu) det D / J) / 2, k = h E / (8 (1 - nu^2)). It does not
depend on the plane the rest shape lies in. Derivatives in positions follow from those in a, whose second ones are constant,
and in b.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from barchan.bodies.cloth._blocks import add_block, add_isotropic

Array = NDArray[np.float64]
Whole = NDArray[np.int64]


@njit(cache=True)
def _edges(x: Array, triangles: Whole, m: int, edges: Array, metric: Array) -> None:
    for i in range(3):
        edges[0, i] = x[triangles[m, 1], i] - x[triangles[m, 0], i]
        edges[1, i] = x[triangles[m, 2], i] - x[triangles[m, 0], i]
    metric[:] = 0.0
    for i in range(3):
        metric[0] += edges[0, i] * edges[0, i]
        metric[1] += edges[0, i] * edges[1, i]
        metric[2] += edges[1, i] * edges[1, i]


@njit(cache=True)
def _metric_rows(edges: Array, rows: Array) -> None:
    """rows[k, v] = d metric_k / d x_v (3, 3, 3)."""
    for i in range(3):
        one, two = edges[0, i], edges[1, i]
        rows[0, 0, i], rows[0, 1, i], rows[0, 2, i] = -2.0 * one, 2.0 * one, 0.0
        rows[1, 0, i], rows[1, 1, i], rows[1, 2, i] = -one - two, two, one
        rows[2, 0, i], rows[2, 1, i], rows[2, 2, i] = -2.0 * two, 0.0, 2.0 * two


@njit(cache=True)
def _stress(a: Array, b: Array, k: float, nu: float, stress: Array) -> float:
    """stress = dW/da; the energy is returned. From D, not from a and b alone: small strains lose no digits."""
    J = b[0] * b[2] - b[1] * b[1]
    d0, d1, d2 = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    t = (b[2] * d0 - 2.0 * b[1] * d1 + b[0] * d2) / J
    scale = k / np.sqrt(J)
    rest = 1.0 - nu
    stress[0] = scale * (t * b[2] - rest * d2)
    stress[1] = scale * (-2.0 * t * b[1] + 2.0 * rest * d1)
    stress[2] = scale * (t * b[0] - rest * d0)
    return 0.5 * scale * (t * t * J - 2.0 * rest * (d0 * d2 - d1 * d1))


@njit(cache=True)
def _moduli(b: Array, k: float, nu: float, moduli: Array) -> None:
    """moduli = d2W/da2 (3, 3), positive definite for -1 < nu < 1."""
    J = b[0] * b[2] - b[1] * b[1]
    scale, rest = k / np.sqrt(J), 1.0 - nu
    g0, g1, g2 = b[2] / J, -2.0 * b[1] / J, b[0] / J
    moduli[0, 0], moduli[1, 1], moduli[2, 2] = scale * g0 * b[2], -2.0 * scale * g1 * b[1], scale * g2 * b[0]
    moduli[1, 1] += 2.0 * rest * scale
    moduli[0, 1] = moduli[1, 0] = scale * g1 * b[2]
    moduli[0, 2] = moduli[2, 0] = scale * (g2 * b[2] - rest)
    moduli[1, 2] = moduli[2, 1] = -2.0 * scale * g2 * b[1]


@njit(cache=True)
def _rest_moduli(a: Array, b: Array, k: float, nu: float, out: Array) -> None:
    """out[i, j] = d (dW/da_i) / db_j, from dW/da in powers of J."""
    J = b[0] * b[2] - b[1] * b[1]
    s = b[2] * a[0] - 2.0 * b[1] * a[1] + b[0] * a[2]
    three, one = J**-1.5, J**-0.5
    ds = (a[2], -2.0 * a[1], a[0])
    dJ = (b[2], -2.0 * b[1], b[0])
    polar_b = (b[2], -2.0 * b[1], b[0])
    polar_a = (a[2], -2.0 * a[1], a[0])
    # dW/da_i = k (s J^-3/2 polar_b_i - (1 + nu) J^-1/2 polar_b_i - (1 - nu) J^-1/2 polar_a_i)
    for i in range(3):
        for j in range(3):
            own = 0.0
            if i == 1 and j == 1:
                own = -2.0
            elif i != 1 and j == 2 - i:
                own = 1.0
            value = (ds[j] * three - 1.5 * s * three / J * dJ[j]) * polar_b[i] + s * three * own
            value += 0.5 * one / J * dJ[j] * ((1.0 + nu) * polar_b[i] + (1.0 - nu) * polar_a[i])
            out[i, j] = k * (value - (1.0 + nu) * one * own)


@njit(cache=True)
def add_membrane(x: Array, triangles: Whole, rest: Array, k: float, nu: float, gradient: Array) -> float:
    """Energy [J]; its gradient is added to `gradient` (n, 3). rest : (m, 3) metrics at rest."""
    edges, metric, stress, rows = np.empty((2, 3)), np.empty(3), np.empty(3), np.empty((3, 3, 3))
    energy = 0.0
    for m in range(triangles.shape[0]):
        _edges(x, triangles, m, edges, metric)
        energy += _stress(metric, rest[m], k, nu, stress)
        _metric_rows(edges, rows)
        for v in range(3):
            vertex = triangles[m, v]
            for i in range(3):
                gradient[vertex, i] += (
                    stress[0] * rows[0, v, i] + stress[1] * rows[1, v, i] + stress[2] * rows[2, v, i]
                )
    return energy


@njit(cache=True)
def _tensile(stress: Array, b: Array, geometric: Array) -> None:
    """The part of the geometric stiffness [[2 P0, P1], [P1, 2 P2]] that stretches: its negative eigenvalues set to zero.

    Eigenvalues are those along orthonormal directions of the rest triangle, so that the numbering of corners does not matter.
    """
    l00 = np.sqrt(b[0])
    l10 = b[1] / l00
    l11 = np.sqrt(b[2] - l10 * l10)
    # sigma = L^T S L
    s00, s01, s11 = 2.0 * stress[0], stress[1], 2.0 * stress[2]
    x0, x1 = s00 * l00 + s01 * l10, s01 * l00 + s11 * l10
    o00 = l00 * x0 + l10 * x1
    o01 = l11 * x1
    o11 = l11 * s11 * l11
    mean, half = 0.5 * (o00 + o11), np.hypot(0.5 * (o00 - o11), o01)
    high, low = max(mean + half, 0.0), max(mean - half, 0.0)
    if half > 0.0:
        c, s = 0.5 * (o00 - o11) / half, o01 / half
        middle, spread = 0.5 * (high + low), 0.5 * (high - low)
        o00, o01, o11 = middle + spread * c, spread * s, middle - spread * c
    else:
        o00, o01, o11 = high, 0.0, high
    # S = L^-T sigma L^-1
    i00, i11, i10 = 1.0 / l00, 1.0 / l11, -l10 / (l00 * l11)
    y00, y01 = i00 * o00 + i10 * o01, i00 * o01 + i10 * o11
    geometric[0] = y00 * i00 + y01 * i10
    geometric[1] = y01 * i11
    geometric[2] = i11 * o11 * i11


@njit(cache=True)
def add_membrane_hessian(
    x: Array, triangles: Whole, rest: Array, k: float, nu: float, convex: bool, entries: Whole, data: Array
) -> None:
    """Add the Hessian to blocks: entries (m, 3, 3) in data (nnz, 3, 3); `convex` leaves out the compressive stress."""
    edges, metric, stress, rows = np.empty((2, 3)), np.empty(3), np.empty(3), np.empty((3, 3, 3))
    moduli, geometric = np.empty((3, 3)), np.empty(3)
    for m in range(triangles.shape[0]):
        _edges(x, triangles, m, edges, metric)
        _stress(metric, rest[m], k, nu, stress)
        _moduli(rest[m], k, nu, moduli)
        _metric_rows(edges, rows)
        geometric[0], geometric[1], geometric[2] = 2.0 * stress[0], stress[1], 2.0 * stress[2]
        if convex:
            _tensile(stress, rest[m], geometric)
        for v in range(3):
            for w in range(3):
                entry = entries[m, v, w]
                for p in range(3):
                    for q in range(3):
                        add_block(data, entry, moduli[p, q], rows[p, v], rows[q, w])
                v1, v2 = _edge_share(v)
                w1, w2 = _edge_share(w)
                value = geometric[0] * v1 * w1 + geometric[1] * (v1 * w2 + v2 * w1) + geometric[2] * v2 * w2
                add_isotropic(data, entry, value)


@njit(cache=True)
def _edge_share(v: int) -> tuple[float, float]:
    """How the two edges move with corner v."""
    if v == 0:
        return -1.0, -1.0
    return (1.0, 0.0) if v == 1 else (0.0, 1.0)


@njit(cache=True)
def add_membrane_mixed(
    x: Array, p: Array, triangles: Whole, k: float, nu: float, entries: Whole, data: Array
) -> None:
    """Add d(dE/dx)/dp to blocks, p (n, 3) being the rest positions."""
    edges, metric, rows = np.empty((2, 3)), np.empty(3), np.empty((3, 3, 3))
    rest_edges, rest, rest_rows = np.empty((2, 3)), np.empty(3), np.empty((3, 3, 3))
    moduli = np.empty((3, 3))
    for m in range(triangles.shape[0]):
        _edges(x, triangles, m, edges, metric)
        _edges(p, triangles, m, rest_edges, rest)
        _rest_moduli(metric, rest, k, nu, moduli)
        _metric_rows(edges, rows)
        _metric_rows(rest_edges, rest_rows)
        for v in range(3):
            for w in range(3):
                for i in range(3):
                    for j in range(3):
                        add_block(data, entries[m, v, w], moduli[i, j], rows[i, v], rest_rows[j, w])
