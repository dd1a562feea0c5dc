"""Kernels of pieces of constant Darboux vector: their places, and how their points move (Bertails et al. 2006, 3.1).

A piece of length l starts at x with the frame R (columns: tangent, two material directions) and has the Darboux vector
q = (twist, curvature 1, curvature 2) in its frame, so that with w = s q, [w] the matrix of the cross product by w and e the
first axis, at the arc length s of the piece

    frame = R (1 + c1 [w] + c2 [w]^2),   place = x + s R y(w),   y(w) = (1 + c2 [w] + c3 [w]^2) e,

c_k = sum over n of (-z)^n / (2n + k)!, z = |w|^2, being Stumpff's functions: smooth through w = 0, with
c_k' = (k c_(k+2) - c_(k+1)) / 2. A change dq turns all that follows by psi dq (a rotation vector in space) and moves the end
of the piece by chi dq. All arrays are float64; (p, ...) is over all pieces of all fibres, `firsts` (f + 1,) over fibres.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Whole = NDArray[np.int64]
_SERIES = (
    4.0  # z below which the series is summed: it then ends far below round-off, and above no digits cancel
)


@njit(cache=True)
def stumpff(z: float) -> tuple[float, float, float, float, float, float, float]:
    """c1 to c7 at z >= 0, to a relative error of 1e-11 (c7; c1 to c3 to 1e-14)."""
    if z < _SERIES:
        c6, c7 = 0.0, 0.0
        for n in range(11, -1, -1):
            c6 = 1.0 - z / ((2 * n + 7) * (2 * n + 8)) * c6
            c7 = 1.0 - z / ((2 * n + 8) * (2 * n + 9)) * c7
        c6, c7 = c6 / 720.0, c7 / 5040.0
        c5, c4 = 1.0 / 120.0 - z * c7, 1.0 / 24.0 - z * c6
        c3, c2 = 1.0 / 6.0 - z * c5, 0.5 - z * c4
        return 1.0 - z * c3, c2, c3, c4, c5, c6, c7
    angle = np.sqrt(z)
    c1, c2 = np.sin(angle) / angle, (1.0 - np.cos(angle)) / z
    c3, c4 = (1.0 - c1) / z, (0.5 - c2) / z
    c5, c6 = (1.0 / 6.0 - c3) / z, (1.0 / 24.0 - c4) / z
    return c1, c2, c3, c4, c5, c6, (1.0 / 120.0 - c5) / z


@njit(cache=True)
def _times(frame: Array, local: tuple[float, float, float]) -> tuple[float, float, float]:
    """A vector of the frame (3, 3), in space."""
    a, b, c = local
    return (
        frame[0, 0] * a + frame[0, 1] * b + frame[0, 2] * c,
        frame[1, 0] * a + frame[1, 1] * b + frame[1, 2] * c,
        frame[2, 0] * a + frame[2, 1] * b + frame[2, 2] * c,
    )


@njit(cache=True)
def reach(frame: Array, q: Array, s: float) -> tuple[float, float, float]:
    """s R y(s q) [m]: from the start of a piece to its point at arc length s."""
    a, b, c = s * q[0], s * q[1], s * q[2]
    bend = b * b + c * c
    _, c2, c3, _, _, _, _ = stumpff(a * a + bend)
    return _times(frame, (s * (1.0 - c3 * bend), s * (c2 * c + c3 * a * b), s * (c3 * a * c - c2 * b)))


@njit(cache=True)
def bent(frame: Array, q: Array, s: float, out: Array) -> None:
    """out (3, 3) [m^2]: s^2 R dy/dw, how the point at arc length s of a piece moves with its own q."""
    a, b, c = s * q[0], s * q[1], s * q[2]
    bend = b * b + c * c
    _, c2, c3, c4, c5, _, _ = stumpff(a * a + bend)
    d2, d3 = 2.0 * c4 - c3, 3.0 * c5 - c4  # twice the derivatives of c2 and c3
    # d2 (w x e) + d3 w x (w x e), which the derivatives of the coefficients multiply by w
    m0, m1, m2 = -d3 * bend, d2 * c + d3 * a * b, d3 * a * c - d2 * b
    ss = s * s
    columns = (
        (ss * m0 * a, ss * (m1 * a + c3 * b), ss * (m2 * a + c3 * c)),
        (ss * (m0 * b - 2.0 * c3 * b), ss * (m1 * b + c3 * a), ss * (m2 * b - c2)),
        (ss * (m0 * c - 2.0 * c3 * c), ss * (m1 * c + c2), ss * (m2 * c + c3 * a)),
    )
    for k in range(3):
        out[0, k], out[1, k], out[2, k] = _times(frame, columns[k])


@njit(cache=True)
def _turned(frame: Array, q: Array, s: float, after: Array, psi: Array) -> None:
    """after (3, 3): the frame at arc length s; psi (3, 3) [m]: s R (1 + c2 [w] + c3 [w]^2), how it turns with q."""
    w0, w1, w2 = s * q[0], s * q[1], s * q[2]
    z = w0 * w0 + w1 * w1 + w2 * w2
    c1, c2, c3, _, _, _, _ = stumpff(z)
    for k in range(3):
        # [w] and [w]^2 = w w^T - z of the k-th axis
        if k == 0:
            cross, along = (0.0, w2, -w1), w0
        elif k == 1:
            cross, along = (-w2, 0.0, w0), w1
        else:
            cross, along = (w1, -w0, 0.0), w2
        axis = (1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0)
        square = (w0 * along - z * axis[0], w1 * along - z * axis[1], w2 * along - z * axis[2])
        after[0, k], after[1, k], after[2, k] = _times(
            frame,
            (
                axis[0] + c1 * cross[0] + c2 * square[0],
                axis[1] + c1 * cross[1] + c2 * square[1],
                axis[2] + c1 * cross[2] + c2 * square[2],
            ),
        )
        psi[0, k], psi[1, k], psi[2, k] = _times(
            frame,
            (
                s * (axis[0] + c2 * cross[0] + c3 * square[0]),
                s * (axis[1] + c2 * cross[1] + c3 * square[1]),
                s * (axis[2] + c2 * cross[2] + c3 * square[2]),
            ),
        )


@njit(cache=True)
def place(
    q: Array, lengths: Array, firsts: Whole, roots: Array, root_frames: Array,
    starts: Array, frames: Array, psi: Array, chi: Array,
) -> None:  # fmt: skip
    """starts (p + f, 3) and frames (p + f, 3, 3) of the pieces, and of the tip after each fibre's last; psi, chi (p, 3, 3)."""
    for i in range(len(firsts) - 1):
        at = firsts[i] + i
        starts[at] = roots[i]
        frames[at] = root_frames[i]
        for j in range(firsts[i], firsts[i + 1]):
            at = i + j
            _turned(frames[at], q[j], lengths[j], frames[at + 1], psi[j])
            bent(frames[at], q[j], lengths[j], chi[j])
            x, y, z = reach(frames[at], q[j], lengths[j])
            starts[at + 1, 0] = starts[at, 0] + x
            starts[at + 1, 1] = starts[at, 1] + y
            starts[at + 1, 2] = starts[at, 2] + z


@njit(cache=True)
def points_at(
    pieces: Whole, arcs: Array, owners: Whole, q: Array, starts: Array, frames: Array, out: Array
) -> None:
    """out (k, 3): places of the points at `arcs` (k,) of `pieces` (k,); owners (p,): the fibre of each piece."""
    for k in range(len(pieces)):
        j = pieces[k]
        at = j + owners[j]
        x, y, z = reach(frames[at], q[j], arcs[k])
        out[k, 0] = starts[at, 0] + x
        out[k, 1] = starts[at, 1] + y
        out[k, 2] = starts[at, 2] + z


@njit(cache=True)
def carried(
    v: Array, firsts: Whole, starts: Array, psi: Array, chi: Array, linear: Array, spins: Array
) -> None:
    """linear, spins (p, 3): velocity and spin of the start of each piece, the root being at rest, at rates v (p, 3) of q."""
    for i in range(len(firsts) - 1):
        first = firsts[i]
        for c in range(3):
            linear[first, c], spins[first, c] = 0.0, 0.0
        for j in range(first, firsts[i + 1] - 1):
            s0, s1, s2 = spins[j, 0], spins[j, 1], spins[j, 2]
            d0 = starts[i + j + 1, 0] - starts[i + j, 0]
            d1 = starts[i + j + 1, 1] - starts[i + j, 1]
            d2 = starts[i + j + 1, 2] - starts[i + j, 2]
            linear[j + 1, 0] = linear[j, 0] + s1 * d2 - s2 * d1
            linear[j + 1, 1] = linear[j, 1] + s2 * d0 - s0 * d2
            linear[j + 1, 2] = linear[j, 2] + s0 * d1 - s1 * d0
            for c in range(3):
                spins[j + 1, c] = spins[j, c]
                for d in range(3):
                    linear[j + 1, c] += chi[j, c, d] * v[j, d]
                    spins[j + 1, c] += psi[j, c, d] * v[j, d]


@njit(cache=True)
def velocities_at(
    pieces: Whole, arcs: Array, owners: Whole, q: Array, v: Array, starts: Array, frames: Array, linear: Array, spins: Array,
    room: Array, out: Array,
) -> None:  # fmt: skip
    """out (k, 3): velocities of points of fibres whose roots are at rest; room (k, 3, 3) is written over."""
    for k in range(len(pieces)):
        j = pieces[k]
        at = j + owners[j]
        d0, d1, d2 = reach(frames[at], q[j], arcs[k])
        bent(frames[at], q[j], arcs[k], room[k])
        s0, s1, s2 = spins[j, 0], spins[j, 1], spins[j, 2]
        out[k, 0] = linear[j, 0] + s1 * d2 - s2 * d1
        out[k, 1] = linear[j, 1] + s2 * d0 - s0 * d2
        out[k, 2] = linear[j, 2] + s0 * d1 - s1 * d0
        for c in range(3):
            for d in range(3):
                out[k, c] += room[k, c, d] * v[j, d]


@njit(cache=True)
def jacobian(
    j: int, fibre: int, first: int, arc: float, x: Array, q: Array, starts: Array, frames: Array, psi: Array, chi: Array,
    own: Array, out: Array,
) -> None:  # fmt: skip
    """Columns of the pieces first to j of out (3, 3 n): how the point x (3,) at `arc` of piece j moves with them.

    Columns of later pieces are left alone. own (3, 3) is written over.
    """
    for i in range(first, j):
        end = i + fibre + 1
        d0, d1, d2 = x[0] - starts[end, 0], x[1] - starts[end, 1], x[2] - starts[end, 2]
        for c in range(3):
            column = 3 * (i - first) + c
            p0, p1, p2 = psi[i, 0, c], psi[i, 1, c], psi[i, 2, c]
            out[0, column] = chi[i, 0, c] + p1 * d2 - p2 * d1
            out[1, column] = chi[i, 1, c] + p2 * d0 - p0 * d2
            out[2, column] = chi[i, 2, c] + p0 * d1 - p1 * d0
    bent(frames[j + fibre], q[j], arc, own)
    for r in range(3):
        for c in range(3):
            out[r, 3 * (j - first) + c] = own[r, c]


@njit(cache=True)
def jacobians(
    pieces: Whole, arcs: Array, places: Array, owners: Whole, firsts: Whole, q: Array, starts: Array, frames: Array,
    psi: Array, chi: Array, room: Array, rows: Whole, out: Array,
) -> None:  # fmt: skip
    """out: (3, m_i) blocks one after another, that of point k from rows[k] on; zero where a piece lies beyond the point."""
    for k in range(len(pieces)):
        j = pieces[k]
        fibre = owners[j]
        first, order = firsts[fibre], 3 * (firsts[fibre + 1] - firsts[fibre])
        block = out[rows[k] : rows[k] + 3 * order].reshape(3, order)
        block[:] = 0.0
        jacobian(j, fibre, first, arcs[k], places[k], q, starts, frames, psi, chi, room[k], block)
