"""Kernels of discrete elastic rods, over fibres: implicit systems, motion, strains, points on the centre line.

A fibre of n edges has 4 n + 3 displacements, in the order node 0, edge 0, node 1, ..., node n, so that an inner node touches 11
in a row: the matrix of a fibre is a band. An edge's is its angle times the radius, so that all are lengths. Every parallel loop
writes what belongs to one fibre or one point: results do not depend on the thread count.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from barchan.bodies.fibres.rods import _elements as el

Array = NDArray[np.float64]
Whole = NDArray[np.int64]

BAND = 11  # diagonals kept: the main one and ten below


class Fibres(NamedTuple):
    """f rods of p nodes, q edges and k inner nodes, as kernels read them.

    node_offsets (f + 1,).  nodes (p, 3) [m].  directors (q, 3).  twists (k,) [rad].  tensions (q,) [N] that make edges stiff
    across.  rest (q,) [m] lengths of edges.  shares (k,) [m] lengths that inner nodes stand for.  natural (k, 2) and
    natural_twists (k,): strains without stress.  stiffness (f, 5): B11, B12, B22, GJ, EA.  radii (f,) [m].
    """

    node_offsets: Whole
    nodes: Array
    directors: Array
    twists: Array
    tensions: Array
    rest: Array
    shares: Array
    natural: Array
    natural_twists: Array
    stiffness: Array
    radii: Array


@njit(cache=True)
def _add_stretching(
    nodes: Array, p: int, first: int, rest: float, stiffness: float, tension: float, w: Array,
    weights: tuple[float, float, float], gauss_newton: bool, forces: Array, band: Array,
) -> None:  # fmt: skip
    """Add an edge of energy EA/2 (l / rest - 1)^2 rest, stiff across as under `tension`: not below 0 with `gauss_newton`."""
    length = 0.0
    for c in range(3):
        w[0, c] = nodes[p + 1, c] - nodes[p, c]
        length += w[0, c] * w[0, c]
    length = np.sqrt(length)
    pull = weights[0] * stiffness * (length / rest - 1.0)
    along = weights[1] * stiffness / rest
    across = weights[2] * tension / length
    if gauss_newton and across < 0.0:
        across = 0.0
    for c in range(3):
        w[0, c] /= length
        forces[first + c] += pull * w[0, c]
        forces[first + 4 + c] -= pull * w[0, c]
    for i in range(3):
        for j in range(3):
            value = (along - across) * w[0, i] * w[0, j] + (across if i == j else 0.0)
            if j <= i:
                band[first + i, i - j] += value
                band[first + 4 + i, i - j] += value
            band[first + 4 + i, 4 + i - j] -= value


@njit(cache=True)
def _add_node(
    first: int, lengths: tuple[float, float, float, float, float], stress: tuple[float, float, float],
    stiffness: tuple[float, float, float, float], weights: tuple[float, float, float], inverse_radius: float,
    w: Array, J: Array, G: Array, forces: Array, band: Array,
) -> None:  # fmt: skip
    """Add bending and twisting of an inner node; lengths: e, f, chi, k1, k2; stiffness: B11, B12, B22, GJ over its length."""
    e, f, chi, k1, k2 = lengths
    s1, s2, s3 = stress
    b11, b12, b22, c33 = stiffness
    el.first_derivatives(w, e, f, chi, k1, k2, J)
    for i in range(8):
        pull = weights[0] * (s1 * J[0, i] + s2 * J[1, i] + s3 * J[2, i])
        if i == 3 or i == 7:
            forces[first + i] -= pull * inverse_radius
        else:
            forces[first + i] += pull
            forces[first + 4 + i] -= pull
    if weights[1] == 0.0 and weights[2] == 0.0:
        return
    if weights[2] != 0.0:
        x1, x2, x3 = weights[2] * s1, weights[2] * s2, weights[2] * s3
        el.second_derivatives(w, e, f, chi, x1 * k1 + x2 * k2, x1, x2, x3, G)
    else:
        G[:, :] = 0.0
    for i in range(8):
        q1 = weights[1] * (b11 * J[0, i] + b12 * J[1, i])
        q2 = weights[1] * (b12 * J[0, i] + b22 * J[1, i])
        q3 = weights[1] * c33 * J[2, i]
        for j in range(i, 8):
            G[i, j] += q1 * J[0, j] + q2 * J[1, j] + q3 * J[2, j]
    el.spread(first, G, inverse_radius, band)


@njit(cache=True)
def _add_fibre(
    i: int | np.int64, fibres: Fibres, weights: tuple[float, float, float], gauss_newton: bool, forces: Array, band: Array,
    w: Array, J: Array, G: Array,
) -> None:  # fmt: skip
    """Add weights[0] times the elastic forces of fibre i, weights[1] times J^T K J, weights[2] times the rest of the Hessian.

    With `gauss_newton` only tension remains of that rest: then what is added is positive semidefinite.
    """
    nodes, directors, shares, natural = fibres.nodes, fibres.directors, fibres.shares, fibres.natural
    node_offsets, stiffness, inverse_radius = fibres.node_offsets, fibres.stiffness[i], 1.0 / fibres.radii[i]
    p0, p1 = node_offsets[i], node_offsets[i + 1]
    start, q0, k0 = 4 * p0 - i, p0 - i, p0 - 2 * i
    edges = p1 - p0 - 1
    for j in range(edges):
        _add_stretching(
            nodes, p0 + j, start + 4 * j, fibres.rest[q0 + j], stiffness[4], fibres.tensions[q0 + j], w,
            weights, gauss_newton, forces, band,
        )  # fmt: skip
    for j in range(edges - 1):
        e = el.edge_frame(nodes, directors, p0 + j, q0 + j, w, el.TE, el.M1E, el.M2E)
        f = el.edge_frame(nodes, directors, p0 + j + 1, q0 + j + 1, w, el.TF, el.M1F, el.M2F)
        chi, k1, k2 = el.bend(w)
        k = k0 + j
        b11, b12 = stiffness[0] / shares[k], stiffness[1] / shares[k]
        b22, c33 = stiffness[2] / shares[k], stiffness[3] / shares[k]
        d1, d2, d3 = k1 - natural[k, 0], k2 - natural[k, 1], fibres.twists[k] - fibres.natural_twists[k]
        stress = (b11 * d1 + b12 * d2, b12 * d1 + b22 * d2, c33 * d3)
        sizes, moduli = (e, f, chi, k1, k2), (b11, b12, b22, c33)
        factors = (weights[0], weights[1], 0.0 if gauss_newton else weights[2])
        _add_node(start + 4 * j, sizes, stress, moduli, factors, inverse_radius, w, J, G, forces, band)


@njit(cache=True)
def _factorised(band: Array, margin: Array, share: float, a: int, b: int, L: Array) -> bool:
    """Cholesky factor L of the rows a to b of a band less `share` times the diagonal `margin`; False if there is none."""
    for r in range(a, b):
        lowest = max(a, r - BAND + 1)
        for c in range(lowest, r + 1):
            value = band[r, r - c]
            for k in range(max(lowest, c - BAND + 1), c):
                value -= L[r, r - k] * L[c, c - k]
            if c < r:
                L[r, r - c] = value / L[c, 0]
            else:
                value -= share * margin[r]
                if not value > 0.0:
                    return False
                L[r, 0] = np.sqrt(value)
    return True


@njit(cache=True)
def _solve(L: Array, a: int, b: int, x: Array) -> None:
    """Overwrite the right-hand side x (b - a,) by the solution."""
    for r in range(a, b):
        for c in range(max(a, r - BAND + 1), r):
            x[r - a] -= L[r, r - c] * x[c - a]
        x[r - a] /= L[r, 0]
    for r in range(b - 1, a - 1, -1):
        for c in range(r + 1, min(b, r + BAND)):
            x[r - a] -= L[c, c - r] * x[c - a]
        x[r - a] /= L[r, 0]


@njit(cache=True)
def _add_product(band: Array, first: int, last: int, x: Array, out: Array) -> None:
    """Add the band's product with x to `out`, rows first to last."""
    for r in range(first, last):
        for c in range(max(first, r - BAND + 1), min(last, r + BAND)):
            out[r] += (band[r, r - c] if c <= r else band[c, c - r]) * x[c]


@njit(cache=True, parallel=True)
def step_systems(
    fibres: Fibres, dt: float, internal: float, held: tuple[int, int], diagonal: Array, margin: Array, guess: Array,
    moving: Array, loads: Array, band: Array, L: Array, offsets: Whole, block_offsets: Whole, forces: Array,
    blocks: Array, solving: bool, active: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Implicit systems of fibres displaced by dt * `guess`: A = diagonal + dt K + internal J^T K J.

    held : displacements given at the root and at the tip, whose velocities are in `moving` (all displacements).
    loads : (all,) overwritten by loads + elastic forces + dt K guess.  Where the full Hessian leaves less than `margin` in A,
    the fibre gets J^T K J and the stiffness of edges in tension for K.
    forces (m,) : loads less A times `moving`; with `solving` the velocities, and `blocks` is left alone.
    active (f,) : the fibres to do.
    """
    node_offsets = fibres.node_offsets
    for fibre in prange(node_offsets.shape[0] - 1):
        i = np.int64(fibre)
        if not active[i]:
            continue
        w, J, G = np.empty((17, 3)), np.empty((3, 8)), np.empty((8, 8))
        first, last = 4 * node_offsets[i] - i, 4 * node_offsets[i + 1] - i - 1
        a, b = first + held[0], last - held[1]
        kept = loads[first:last].copy()
        for attempt in range(2):
            loads[first:last] = kept
            band[first:last] = 0.0
            _add_fibre(i, fibres, (1.0, dt, dt), attempt == 1, loads, band, w, J, G)
            _add_product(band, first, last, guess, loads)
            if internal > 0.0:
                _add_fibre(i, fibres, (0.0, internal, 0.0), attempt == 1, loads, band, w, J, G)
            for r in range(first, last):
                band[r, 0] += diagonal[r]
            if attempt == 1 or _factorised(band, margin, 1.0, a, b, L):
                break
        own = forces[offsets[i] : offsets[i + 1]]
        _place((first, a, b, last), band, moving, loads, own, blocks[block_offsets[i] :], not solving)
        if solving:
            if _factorised(band, margin, 0.0, a, b, L):
                _solve(L, a, b, own)
            else:  # only where numbers are no longer finite
                own[:] = np.nan


@njit(cache=True)
def _place(
    rows: tuple[int, int, int, int],
    band: Array,
    moving: Array,
    loads: Array,
    forces: Array,
    block: Array,
    whole: bool,
) -> None:
    """Loads less what held displacements do to `forces`; with `whole` the band between the held `rows` to a full block."""
    first, a, b, last = rows
    order = b - a
    for r in range(a, b):
        force = loads[r]
        for c in range(max(first, r - BAND + 1), min(last, r + BAND)):
            if not a <= c < b:
                force -= (band[r, r - c] if c <= r else band[c, c - r]) * moving[c]
        forces[r - a] = force
        if whole:
            row = block[(r - a) * order : (r - a + 1) * order]
            row[:] = 0.0
            for c in range(max(a, r - BAND + 1), min(b, r + BAND)):
                row[c - a] = band[r, r - c] if c <= r else band[c, c - r]


@njit(cache=True)
def elastic_forces(
    fibres: Fibres, weights: tuple[float, float, float], gauss_newton: bool, forces: Array, band: Array
) -> None:
    """Add forces on all displacements [N], and the Hessian weighted as in `step_systems` as a lower band (all, 11)."""
    for i in range(fibres.node_offsets.shape[0] - 1):
        w, J, G = np.empty((17, 3)), np.empty((3, 8)), np.empty((8, 8))
        _add_fibre(i, fibres, weights, gauss_newton, forces, band, w, J, G)


@njit(cache=True, parallel=True)
def displace(
    node_offsets: Whole, nodes: Array, directors: Array, twists: Array, radii: Array, step: Array,
    new_nodes: Array, new_directors: Array, new_twists: Array, curvatures: Array,
) -> None:  # fmt: skip
    """Nodes moved by `step` (all displacements), directions carried along and turned; twists follow without jumps."""
    for i in prange(node_offsets.shape[0] - 1):
        p0, p1 = node_offsets[i], node_offsets[i + 1]
        start, q0, k0 = 4 * p0 - i, p0 - i, p0 - 2 * i
        w = np.empty((17, 3))
        for j in range(p1 - p0):
            for c in range(3):
                new_nodes[p0 + j, c] = nodes[p0 + j, c] + step[start + 4 * j + c]
        for j in range(p1 - p0 - 1):
            el.edge_frame(nodes, directors, p0 + j, q0 + j, w, el.TE, el.M1E, el.M2E)
            el.edge_frame(new_nodes, directors, p0 + j, q0 + j, w, el.TF, el.M1F, el.M2F)
            el.carried(w, el.M1E, el.TE, el.TF, 8)
            el.cross(w, el.TF, 8, 9)
            turn = step[start + 4 * j + 3] / radii[i]
            along, size = 0.0, 0.0
            for c in range(3):
                w[8, c] = np.cos(turn) * w[8, c] + np.sin(turn) * w[9, c]
                along += w[8, c] * w[el.TF, c]
            for c in range(3):
                w[8, c] -= along * w[el.TF, c]
                size += w[8, c] * w[8, c]
            for c in range(3):
                new_directors[q0 + j, c] = w[8, c] / np.sqrt(size)
        for j in range(p1 - p0 - 2):
            k = k0 + j
            el.edge_frame(new_nodes, new_directors, p0 + j, q0 + j, w, el.TE, el.M1E, el.M2E)
            el.edge_frame(new_nodes, new_directors, p0 + j + 1, q0 + j + 1, w, el.TF, el.M1F, el.M2F)
            curvatures[k, 0], curvatures[k, 1] = el.bend(w)[1:]
            el.carried(w, el.M1E, el.TE, el.TF, 8)
            jump = el.angle(w, 8, el.M1F, el.TF, 9) - twists[k]
            new_twists[k] = twists[k] + jump - 2.0 * np.pi * np.round(jump / (2.0 * np.pi))


@njit(cache=True, parallel=True)
def point_rows(
    fibre: Whole, segment: Whole, share: Array, node_offsets: Whole, offsets: Whole, held: tuple[int, int],
    moving: Array, starts: Whole, values: Array, drift: Array,
) -> None:  # fmt: skip
    """Rows of `PointRows` of points on segments; `moving` has the velocities of held displacements, zero elsewhere."""
    for k in prange(fibre.shape[0]):
        i = fibre[k]
        order = offsets[i + 1] - offsets[i]
        start = 4 * node_offsets[i] - i
        values[starts[k] : starts[k] + 3 * order] = 0.0
        for c in range(3):
            drift[k, c] = 0.0
        for end in range(2):
            part = share[k] if end == 1 else 1.0 - share[k]
            for c in range(3):
                place = 4 * (segment[k] + end) + c
                if held[0] <= place < held[0] + order:
                    values[starts[k] + c * order + place - held[0]] += part
                else:
                    drift[k, c] += part * moving[start + place]


@njit(cache=True)
def carry_along(node_offsets: Whole, nodes: Array, turns: Array, directors: Array) -> None:
    """Directors (q, 3) of all edges from those of first edges, carried from edge to edge, then turned by `turns` (q,)."""
    w = np.empty((17, 3))
    for i in range(node_offsets.shape[0] - 1):
        q0, q1 = node_offsets[i] - i, node_offsets[i + 1] - i - 1
        for q in range(q0, q1 - 1):
            el.edge_frame(nodes, directors, q + i, q, w, el.TE, el.M1E, el.M2E)
            el.edge_frame(nodes, directors, q + i + 1, q + 1, w, el.TF, el.M1F, el.M2F)
            el.carried(w, el.M1E, el.TE, el.TF, 8)
            size = np.sqrt(el.dot(w, 8, 8))
            for c in range(3):
                directors[q + 1, c] = w[8, c] / size
        for q in range(q0, q1):
            el.edge_frame(nodes, directors, q + i, q, w, el.TE, el.M1E, el.M2E)
            for c in range(3):
                directors[q, c] = np.cos(turns[q]) * w[el.M1E, c] + np.sin(turns[q]) * w[el.M2E, c]
