"""One inner node of a discrete elastic rod: strains, first and second derivatives (Bergou et al. 2008; 2010, Sections 4, 6).

The node stands between the edges e and f, of unit tangents t_e, t_f and material directions m1, m2. With the curvature
binormal kb = 2 t_e x t_f / (1 + t_e . t_f) its strains are the integrated curvatures towards m1 and m2,
k1 = kb . (m2_e + m2_f) / 2 and k2 = -kb . (m1_e + m1_f) / 2, and the twist: the angle about t_f from the directions of e,
carried to f by the shortest rotation, to those of f. Derivatives are with respect to the 8 numbers e, angle of e, f, angle
of f, the directions being carried along by the shortest rotation of each tangent (parallel transport in time).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

TE, TF, KB, TT, M1E, M2E, M1F, M2F = 0, 1, 2, 3, 4, 5, 6, 7  # rows of the working array of a node
_FOLDED = 1e-12  # 1 + t_e . t_f of edges folded back on each other


# signatures given: otherwise Numba compiles these anew for each choice of rows
@njit("float64(float64[:, ::1], int64, int64)", cache=True)
def dot(w: Array, a: int, b: int) -> float:
    """Product of rows a and b."""
    return w[a, 0] * w[b, 0] + w[a, 1] * w[b, 1] + w[a, 2] * w[b, 2]


@njit("void(float64[:, ::1], int64, int64, int64)", cache=True)
def cross(w: Array, a: int, b: int, out: int) -> None:
    """Row `out` becomes the cross product of rows a and b, others than itself."""
    w[out, 0] = w[a, 1] * w[b, 2] - w[a, 2] * w[b, 1]
    w[out, 1] = w[a, 2] * w[b, 0] - w[a, 0] * w[b, 2]
    w[out, 2] = w[a, 0] * w[b, 1] - w[a, 1] * w[b, 0]


@njit(cache=True)
def edge_frame(nodes: Array, directors: Array, p: int, q: int, w: Array, t: int, m1: int, m2: int) -> float:
    """Rows t, m1, m2 become tangent and material directions of edge q, from node p to p + 1; its length [m]."""
    square = 0.0
    for c in range(3):
        w[t, c] = nodes[p + 1, c] - nodes[p, c]
        w[m1, c] = directors[q, c]
        square += w[t, c] * w[t, c]
    length = np.sqrt(square)
    for c in range(3):
        w[t, c] /= length
    cross(w, t, m1, m2)
    return length


@njit(cache=True)
def bend(w: Array) -> tuple[float, float, float]:
    """Fill kb and t~ = (t_e + t_f) / chi from the frames; chi = 1 + t_e . t_f, k1, k2."""
    chi = max(1.0 + dot(w, TE, TF), _FOLDED)
    cross(w, TE, TF, KB)
    for c in range(3):
        w[KB, c] *= 2.0 / chi
        w[TT, c] = (w[TE, c] + w[TF, c]) / chi
    k1 = 0.5 * (dot(w, KB, M2E) + dot(w, KB, M2F))
    k2 = -0.5 * (dot(w, KB, M1E) + dot(w, KB, M1F))
    return chi, k1, k2


@njit(cache=True)
def carried(w: Array, d: int, a: int, b: int, out: int) -> None:
    """Row `out` becomes row d, normal to the unit row a, turned by the shortest rotation that takes a to the unit row b."""
    share = dot(w, d, b) / max(1.0 + dot(w, a, b), _FOLDED)
    for c in range(3):
        w[out, c] = w[d, c] - share * (w[a, c] + w[b, c])


@njit(cache=True)
def angle(w: Array, a: int, b: int, t: int, spare: int) -> float:
    """Signed angle about the unit row t from row a to row b, both normal to it."""
    cross(w, a, b, spare)
    return np.arctan2(dot(w, spare, t), dot(w, a, b))


@njit(cache=True)
def first_derivatives(w: Array, e: float, f: float, chi: float, k1: float, k2: float, J: Array) -> None:
    """J (3, 8): derivatives of k1, k2 and the twist (Bergou et al. 2010, Section 6; e, f the lengths)."""
    for c in range(3):
        w[8, c] = (w[M1E, c] + w[M1F, c]) / chi
        w[9, c] = (w[M2E, c] + w[M2F, c]) / chi
    cross(w, TF, 9, 10)
    cross(w, TE, 9, 11)
    cross(w, TF, 8, 12)
    cross(w, TE, 8, 13)
    for c in range(3):
        J[0, c] = (w[10, c] - k1 * w[TT, c]) / e
        J[0, 4 + c] = (-w[11, c] - k1 * w[TT, c]) / f
        J[1, c] = (-w[12, c] - k2 * w[TT, c]) / e
        J[1, 4 + c] = (w[13, c] - k2 * w[TT, c]) / f
        J[2, c] = 0.5 * w[KB, c] / e
        J[2, 4 + c] = 0.5 * w[KB, c] / f
    J[0, 3], J[0, 7] = -0.5 * dot(w, KB, M1E), -0.5 * dot(w, KB, M1F)
    J[1, 3], J[1, 7] = -0.5 * dot(w, KB, M2E), -0.5 * dot(w, KB, M2F)
    J[2, 3], J[2, 7] = -1.0, 1.0


@njit(cache=True)
def second_derivatives(
    w: Array, e: float, f: float, chi: float, bending: float, s1: float, s2: float, s3: float, G: Array
) -> None:
    """Upper triangle of G (8, 8): s1 k1'' + s2 k2'' + s3 twist'', with `bending` = s1 k1 + s2 k2.

    Derivatives of the 2010 formulas; rows 8 and 9 of w are those of `first_derivatives`. Symmetric, because directions are
    carried in one rotation from where they are (in two they would also turn by the solid angle between).
    """
    a, ae, af, ce, cf = 10, 11, 12, 13, 14
    for c in range(3):
        w[a, c] = s1 * w[9, c] - s2 * w[8, c]
        w[ae, c] = s1 * w[M2E, c] - s2 * w[M1E, c] - s3 * (w[TE, c] + w[TT, c])
        w[af, c] = s1 * w[M2F, c] - s2 * w[M1F, c] - s3 * (w[TF, c] + w[TT, c])
        w[ce, c] = s1 * w[M1E, c] + s2 * w[M2E, c]
        w[cf, c] = s1 * w[M1F, c] + s2 * w[M2F, c]
    G[3, 3] = -0.5 * (s1 * dot(w, KB, M2E) - s2 * dot(w, KB, M1E))
    G[7, 7] = -0.5 * (s1 * dot(w, KB, M2F) - s2 * dot(w, KB, M1F))
    G[3, 7] = 0.0
    _place_angles(w, e, f, chi, ce, cf, G)
    cross(w, TF, a, 15)
    cross(w, TE, a, 16)
    for i in range(3):
        for j in range(3):
            one = 1.0 if i == j else 0.0
            tilde = 2.0 * bending * w[TT, i] * w[TT, j]
            ef = tilde - w[15, i] * w[TT, j] + w[TT, i] * w[16, j]
            ef -= bending / chi * (one + w[TE, i] * w[TF, j]) + 0.5 * s3 * w[KB, i] * w[TT, j]
            G[i, 4 + j] = ef / (e * f)
            if j < i:
                continue
            ee = (
                tilde
                - w[15, i] * w[TT, j]
                - w[TT, i] * w[15, j]
                - bending / chi * (one - w[TE, i] * w[TE, j])
            )
            ff = (
                tilde
                + w[16, i] * w[TT, j]
                + w[TT, i] * w[16, j]
                - bending / chi * (one - w[TF, i] * w[TF, j])
            )
            G[i, j] = (ee + 0.25 * (w[KB, i] * w[ae, j] + w[ae, i] * w[KB, j])) / (e * e)
            G[4 + i, 4 + j] = (ff + 0.25 * (w[KB, i] * w[af, j] + w[af, i] * w[KB, j])) / (f * f)
    for c in range(3):  # the skew part of e, f
        i, j = (c + 1) % 3, (c + 2) % 3
        turn = (s3 * w[TE, c] / chi - w[a, c]) / (e * f)
        G[i, 4 + j] -= turn
        G[j, 4 + i] += turn


@njit(cache=True)
def _place_angles(w: Array, e: float, f: float, chi: float, ce: int, cf: int, G: Array) -> None:
    """Second derivatives by an edge and an angle, above the diagonal of G."""
    turn_e, turn_f = 0.5 * dot(w, KB, ce), 0.5 * dot(w, KB, cf)
    cross(w, TF, ce, 15)
    cross(w, TF, cf, 16)
    for c in range(3):
        G[c, 3] = (turn_e * w[TT, c] - w[15, c] / chi) / e
        G[c, 7] = (turn_f * w[TT, c] - w[16, c] / chi) / e
    cross(w, TE, ce, 15)
    cross(w, TE, cf, 16)
    for c in range(3):
        G[3, 4 + c] = (turn_e * w[TT, c] + w[15, c] / chi) / f
        G[4 + c, 7] = (turn_f * w[TT, c] + w[16, c] / chi) / f


@njit(cache=True)
def spread(first: int, G: Array, inverse_radius: float, band: Array) -> None:
    """Add the upper triangle of G (8, 8) of the node whose first edge starts at number `first` to a lower band (n, 11)."""
    for i in range(8):
        for j in range(i, 8):
            value = G[i, j]
            if i == 3 or i == 7:
                value *= inverse_radius
            if j == 3 or j == 7:
                value *= inverse_radius
            if value == 0.0:
                continue
            for a in range(2):
                ri = (
                    i if (i == 3 or i == 7) else i + 4 * a
                )  # an edge vector is its second node less its first
                si = 1.0 if (i == 3 or i == 7) else 2.0 * a - 1.0
                if a == 1 and (i == 3 or i == 7):
                    continue
                for b in range(2):
                    if b == 1 and (j == 3 or j == 7):
                        continue
                    rj = j if (j == 3 or j == 7) else j + 4 * b
                    sj = 1.0 if (j == 3 or j == 7) else 2.0 * b - 1.0
                    add = si * sj * value
                    if i == j:
                        if ri >= rj:
                            band[first + ri, ri - rj] += add
                    elif ri >= rj:
                        band[first + ri, ri - rj] += add if ri != rj else 2.0 * add
                    else:
                        band[first + rj, rj - ri] += add
