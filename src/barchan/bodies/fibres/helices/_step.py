"""Kernels of the implicit step of Super-Helices: the block of each fibre, its forces, and the stiffness of weight.

Per fibre, with J the motion of a point with q, m and a its mass and its drag, u^k its velocity before and d what the root does:

    A = sum (m / dt + a) J^T J + D + dt (K + G),   f = sum J^T (m (u^k - d) / dt - a d + m g) - K (q - q0),

sums being over the points of quadrature. K is diagonal; G is the stiffness of weight, with the second derivatives of places.
"""

from __future__ import annotations

from numba import njit, prange

from barchan.bodies.fibres.helices._kinematics import Array, Whole, bent, jacobian, stumpff


@njit(cache=True, parallel=True)
def step_blocks(
    firsts: Whole, points: Whole, arcs: Array, masses: Array, drags: Array, places: Array, before: Array, drift: Array,
    gravity: Array, dt: float, q: Array, natural: Array, stiffness: Array, damping: Array, starts: Array, frames: Array,
    psi: Array, chi: Array, rooms: Array, own: Array, block_offsets: Whole, blocks: Array, forces: Array,
) -> None:  # fmt: skip
    """blocks (A without G) and forces f.

    points (p + 1,) : first point of each piece; arcs, masses, drags (k,), places, before, drift (k, 3) : of the points.
    stiffness, damping, natural (p, 3).  rooms (3 * 3 p,), own (f, 3, 3) : written over.
    """
    for i in prange(len(firsts) - 1):
        first, order = firsts[i], 3 * (firsts[i + 1] - firsts[i])
        a = blocks[block_offsets[i] : block_offsets[i + 1]].reshape(order, order)
        f = forces[3 * first : 3 * first + order]
        rows = rooms[9 * first : 9 * first + 3 * order].reshape(3, order)
        a[:] = 0.0
        for r in range(order):
            j, c = first + r // 3, r % 3
            f[r] = -stiffness[j, c] * (q[j, c] - natural[j, c])
            a[r, r] = damping[j, c] + dt * stiffness[j, c]
        for j in range(first, firsts[i + 1]):
            for k in range(points[j], points[j + 1]):
                jacobian(j, i, first, arcs[k], places[k], q, starts, frames, psi, chi, own[i], rows)
                inertia = masses[k] / dt
                total = inertia + drags[k]
                p0 = inertia * before[k, 0] - total * drift[k, 0] + masses[k] * gravity[0]
                p1 = inertia * before[k, 1] - total * drift[k, 1] + masses[k] * gravity[1]
                p2 = inertia * before[k, 2] - total * drift[k, 2] + masses[k] * gravity[2]
                for r in range(3 * (j - first + 1)):
                    j0, j1, j2 = rows[0, r], rows[1, r], rows[2, r]
                    f[r] += j0 * p0 + j1 * p1 + j2 * p2
                    j0, j1, j2 = total * j0, total * j1, total * j2
                    for c in range(r + 1):
                        a[r, c] += j0 * rows[0, c] + j1 * rows[1, c] + j2 * rows[2, c]
        for r in range(order):
            for c in range(r):
                a[c, r] = a[r, c]


@njit(cache=True)
def _form(
    w: tuple[float, float, float], a: tuple[float, float, float], r: tuple[float, float, float], derivatives: Array,
    scale: float, out: Array,
) -> None:  # fmt: skip
    """Add scale times the second derivatives by w of ca a.(w x r) + cb ((a.w)(r.w) - z a.r) to out (3, 3).

    derivatives (6,) : ca, cb and their first and second derivatives by z = |w|^2, as (ca', ca'', cb, cb', cb'', unused).
    """
    d1, d11, cb, e1, e11 = derivatives[0], derivatives[1], derivatives[2], derivatives[3], derivatives[4]
    m = (r[1] * a[2] - r[2] * a[1], r[2] * a[0] - r[0] * a[2], r[0] * a[1] - r[1] * a[0])
    z = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    mw = m[0] * w[0] + m[1] * w[1] + m[2] * w[2]
    aw = a[0] * w[0] + a[1] * w[1] + a[2] * w[2]
    rw = r[0] * w[0] + r[1] * w[1] + r[2] * w[2]
    ar = a[0] * r[0] + a[1] * r[1] + a[2] * r[2]
    form = aw * rw - z * ar
    for i in range(3):
        bi = a[i] * rw + r[i] * aw - 2.0 * w[i] * ar
        for k in range(3):
            bk = a[k] * rw + r[k] * aw - 2.0 * w[k] * ar
            value = 2.0 * d1 * (m[i] * w[k] + w[i] * m[k]) + (4.0 * d11 * mw + 4.0 * e11 * form) * w[i] * w[k]
            value += cb * (a[i] * r[k] + r[i] * a[k]) + 2.0 * e1 * (bi * w[k] + w[i] * bk)
            if i == k:
                value += 2.0 * d1 * mw - 2.0 * cb * ar + 2.0 * e1 * form
            out[i, k] += scale * value


@njit(cache=True)
def _derivatives(z: float, place: bool, out: Array) -> None:
    """What `_form` wants, of (c2, c3) for a place along a piece, of (c1, c2) for the frame at its end."""
    _, c2, c3, c4, c5, c6, c7 = stumpff(z)
    d2, d3 = 0.5 * (2.0 * c4 - c3), 0.5 * (3.0 * c5 - c4)
    d4, d5 = 0.5 * (4.0 * c6 - c5), 0.5 * (5.0 * c7 - c6)
    if place:
        out[0], out[1] = d2, 0.5 * (2.0 * d4 - d3)
        out[2], out[3], out[4] = c3, d3, 0.5 * (3.0 * d5 - d4)
    else:
        d1 = 0.5 * (c3 - c2)
        out[0], out[1] = d1, 0.5 * (d3 - d2)
        out[2], out[3], out[4] = c2, d2, 0.5 * (2.0 * d4 - d3)


@njit(cache=True)
def _local(frame: Array, x0: float, x1: float, x2: float) -> tuple[float, float, float]:
    """A vector of space in the frame (3, 3)."""
    return (
        frame[0, 0] * x0 + frame[1, 0] * x1 + frame[2, 0] * x2,
        frame[0, 1] * x0 + frame[1, 1] * x1 + frame[2, 1] * x2,
        frame[0, 2] * x0 + frame[1, 2] * x1 + frame[2, 2] * x2,
    )


@njit(cache=True, parallel=True)
def weight_stiffness(
    firsts: Whole, points: Whole, arcs: Array, masses: Array, places: Array, gravity: Array, q: Array, lengths: Array,
    starts: Array, frames: Array, psi: Array, chi: Array, moves: Array, room: Array, block_offsets: Whole, out: Array,
) -> None:  # fmt: skip
    """out: second derivatives of -sum m g.x, block after block.

    moves (p, 3, 3) : becomes sum m dx/dq of each piece, over all points.  room (f, 3, 4, 3) : written over.
    """
    g = gravity
    for i in prange(len(firsts) - 1):
        first, order = firsts[i], 3 * (firsts[i + 1] - firsts[i])
        h = out[block_offsets[i] : block_offsets[i + 1]].reshape(order, order)
        h[:] = 0.0
        own, block, shape = room[i, 0, :3], room[i, 1, :3], room[i, 2].reshape(12)
        beyond, s0, s1, s2 = (
            0.0,
            0.0,
            0.0,
            0.0,
        )  # mass beyond the end of the piece, and its first moment from there
        for j in range(firsts[i + 1] - 1, first - 1, -1):
            at = j + i
            l = lengths[j]
            block[:] = 0.0
            a = _local(frames[at], -g[0], -g[1], -g[2])
            axis = (1.0, 0.0, 0.0)
            for c in range(3):
                p0, p1, p2 = psi[j, 0, c], psi[j, 1, c], psi[j, 2, c]
                moves[j, 0, c] = beyond * chi[j, 0, c] + p1 * s2 - p2 * s1
                moves[j, 1, c] = beyond * chi[j, 1, c] + p2 * s0 - p0 * s2
                moves[j, 2, c] = beyond * chi[j, 2, c] + p0 * s1 - p1 * s0
            w = (l * q[j, 0], l * q[j, 1], l * q[j, 2])
            z = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
            _derivatives(z, True, shape)
            _form(w, a, axis, shape, beyond * l * l * l, block)
            _derivatives(z, False, shape)
            _form(w, a, _local(frames[at + 1], s0, s1, s2), shape, l * l, block)
            # carry the mass beyond to the start of the piece, and add its own points
            s0 += beyond * (starts[at + 1, 0] - starts[at, 0])
            s1 += beyond * (starts[at + 1, 1] - starts[at, 1])
            s2 += beyond * (starts[at + 1, 2] - starts[at, 2])
            for k in range(points[j], points[j + 1]):
                s, m = arcs[k], masses[k]
                _own_motion(frames[at], q[j], s, m, own, moves[j])
                w = (s * q[j, 0], s * q[j, 1], s * q[j, 2])
                _derivatives(w[0] * w[0] + w[1] * w[1] + w[2] * w[2], True, shape)
                _form(w, a, axis, shape, m * s * s * s, block)
                beyond += m
                s0 += m * (places[k, 0] - starts[at, 0])
                s1 += m * (places[k, 1] - starts[at, 1])
                s2 += m * (places[k, 2] - starts[at, 2])
            _fill(h, block, moves, psi, g, first, j)


@njit(cache=True)
def _own_motion(frame: Array, q: Array, s: float, m: float, own: Array, total: Array) -> None:
    """Add m dx/dq of the point at arc length s of a piece to total (3, 3)."""
    bent(frame, q, s, own)
    for r in range(3):
        for c in range(3):
            total[r, c] += m * own[r, c]


@njit(cache=True)
def _fill(h: Array, block: Array, moves: Array, psi: Array, g: Array, first: int, j: int) -> None:
    """The diagonal block of piece j, and those of the pieces before it: -psi_i . (moves_j x g)."""
    for b in range(3):
        column = 3 * (j - first) + b
        for c in range(3):
            h[3 * (j - first) + c, column] = block[c, b]
        x0, x1, x2 = moves[j, 0, b], moves[j, 1, b], moves[j, 2, b]
        t0, t1, t2 = x1 * g[2] - x2 * g[1], x2 * g[0] - x0 * g[2], x0 * g[1] - x1 * g[0]
        for i in range(first, j):
            for c in range(3):
                value = -(psi[i, 0, c] * t0 + psi[i, 1, c] * t1 + psi[i, 2, c] * t2)
                h[3 * (i - first) + c, column] = value
                h[column, 3 * (i - first) + c] = value
