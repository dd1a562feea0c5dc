"""Natural shapes of discrete elastic rods: given curvatures and twists, and the polylines they make when nothing pulls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.fibres.rods import _elements as el
from barchan.errors import InputError

Vector = NDArray[np.float64]
Whole = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Natural:
    """Strains without stress at k inner nodes.

    curvatures : (k, 2) integrated over the length of the node, 2 tan(half the turning angle), towards the material directions.
    twists : (k,) integrated [rad].
    """

    curvatures: Vector
    twists: Vector

    @classmethod
    def of_curve(cls, curvatures: ArrayLike, twists: ArrayLike, lengths: ArrayLike) -> Natural:
        """Strains of polylines inscribed in curves of given curvatures (2,) or (k, 2) [1/m] and twists () or (k,) [rad/m].

        lengths : (k,) mean lengths [m] of the two segments at each inner node, chords of the curve. Exact where segments and
        curvatures are the same along a fibre: nodes laid out then lie on the helix. Raises InputError when a chord is longer
        than any of its curve.
        """
        chords = np.array(lengths, dtype=np.float64).ravel()
        bends = np.broadcast_to(np.array(curvatures, dtype=np.float64), (len(chords), 2))
        turns = np.broadcast_to(np.array(twists, dtype=np.float64), (len(chords),))
        if not (np.all(np.isfinite(bends)) and np.all(np.isfinite(turns)) and np.all(chords > 0.0)):
            raise InputError("natural", "curvatures, twists or lengths", "finite, and lengths positive")
        # Darboux vectors in the material frame: bending towards direction 1 turns about direction 2
        darboux = np.column_stack([turns, -bends[:, 1], bends[:, 0]])
        arcs = _arcs(darboux, chords)
        angles = arcs[:, None] * darboux
        middle = _chord(angles)
        direction = middle / np.linalg.norm(middle, axis=1)[:, None]
        aligned = _shortest(direction)
        relative = np.swapaxes(aligned, 1, 2) @ _exponential(angles) @ aligned
        return cls(*_strains(relative))


def _chord(angles: Vector) -> Vector:
    """Chord over arc (k, 3) in the frame half-way along an arc that turns by `angles` (k, 3) in all; first axis the tangent."""
    sizes = np.linalg.norm(angles, axis=1)
    axis = angles / np.where(sizes == 0.0, 1.0, sizes)[:, None]
    along = axis[:, :1] * axis
    short = np.sinc(0.5 * sizes / np.pi)[:, None]
    chord: Vector = along + short * (np.array([1.0, 0.0, 0.0]) - along)
    return chord


def _arcs(darboux: Vector, chords: Vector) -> Vector:
    """Arc lengths (k,) [m] whose chords are `chords`, less than half a turn long, by bisection."""
    bend = np.linalg.norm(darboux, axis=1)
    low, high = chords.copy(), np.minimum(np.pi / np.where(bend == 0.0, 1e-300, bend), 4.0 * chords)

    def reach(arcs: Vector) -> Vector:
        return arcs * np.linalg.norm(_chord(arcs[:, None] * darboux), axis=1)

    short = reach(high) < chords
    if np.any(short):
        worst = int(np.argmax(short))
        raise InputError(
            "natural.curvatures", f"{bend[worst]:g} 1/m", "less than about 2 over the segment length"
        )
    for _ in range(60):
        middle = 0.5 * (low + high)
        below = reach(middle) < chords
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    arcs: Vector = 0.5 * (low + high)
    return arcs


def _exponential(angles: Vector) -> Vector:
    """Rotation matrices (k, 3, 3) of rotation vectors (k, 3)."""
    sizes = np.linalg.norm(angles, axis=1)[:, None, None]
    skew = _skew(angles)
    first, second = np.sinc(sizes / np.pi), 0.5 * np.sinc(0.5 * sizes / np.pi) ** 2
    turn: Vector = np.eye(3) + first * skew + second * (skew @ skew)
    return turn


def _skew(vectors: Vector) -> Vector:
    """Matrices (k, 3, 3) of the cross product by vectors (k, 3)."""
    out = np.zeros((len(vectors), 3, 3))
    for i, j, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[:, i, j], out[:, j, i] = -vectors[:, c], vectors[:, c]
    return out


def _shortest(directions: Vector) -> Vector:
    """Shortest rotations (k, 3, 3) from the first axis to unit vectors (k, 3)."""
    turn = _skew(np.column_stack([np.zeros(len(directions)), -directions[:, 2], directions[:, 1]]))
    shortest: Vector = np.eye(3) + turn + turn @ turn / (1.0 + directions[:, 0])[:, None, None]
    return shortest


def _strains(relative: Vector) -> tuple[Vector, Vector]:
    """Curvatures (k, 2) and twists (k,) of a node whose next material frame is `relative` (k, 3, 3) in that before it."""
    tangent = relative[:, :, 0]
    untwisted = np.swapaxes(_shortest(tangent), 1, 2) @ relative
    twists = np.arctan2(untwisted[:, 2, 1], untwisted[:, 1, 1])
    binormal = 2.0 * np.cross([1.0, 0.0, 0.0], tangent) / (1.0 + tangent[:, :1])
    second = np.array([[0.0, 0.0, 1.0]]) + relative[:, :, 2]
    first = np.array([[0.0, 1.0, 0.0]]) + relative[:, :, 1]
    curvatures = np.column_stack(
        [0.5 * np.sum(binormal * second, axis=1), -0.5 * np.sum(binormal * first, axis=1)]
    )
    return curvatures, twists


@njit(cache=True)
def _made_unit(w: Vector, row: int) -> None:
    """Divide a row by its length: rounding must not add up along a rod."""
    size = np.sqrt(el.dot(w, row, row))
    for c in range(3):
        w[row, c] /= size


@njit(cache=True)
def _lay(
    curvatures: Vector,
    twists: Vector,
    lengths: Vector,
    node_offsets: Whole,
    frames: Vector,
    nodes: Vector,
    directors: Vector,
) -> None:
    """Nodes and directors from the first node of each fibre, already in `nodes`, and its frame (f, 3, 3)."""
    w = np.empty((17, 3))
    for i in range(node_offsets.shape[0] - 1):
        for c in range(3):
            w[el.TE, c], w[el.M1E, c] = frames[i, c, 0], frames[i, c, 1]
        for p in range(node_offsets[i], node_offsets[i + 1] - 1):
            q, k = p - i, p - 2 * i
            for c in range(3):
                nodes[p + 1, c] = nodes[p, c] + lengths[q] * w[el.TE, c]
                directors[q, c] = w[el.M1E, c]
            if p == node_offsets[i + 1] - 2:
                break
            # from k1 = cos h (b cos h - a sin h), k2 = -cos h (a cos h + b sin h), h half the twist, a, b = kb . m1, kb . m2
            co, si = np.cos(0.5 * twists[k]), np.sin(0.5 * twists[k])
            a = (-curvatures[k, 0] * si - curvatures[k, 1] * co) / co
            b = (curvatures[k, 0] * co - curvatures[k, 1] * si) / co
            el.cross(w, el.TE, el.M1E, el.M2E)
            half = 0.25 * (a * a + b * b)  # squared tangent of half the turning angle
            for c in range(3):
                w[el.KB, c] = a * w[el.M1E, c] + b * w[el.M2E, c]
            el.cross(w, el.KB, el.TE, el.TF)
            for c in range(3):
                w[el.TF, c] = ((1.0 - half) * w[el.TE, c] + w[el.TF, c]) / (1.0 + half)
            _made_unit(w, el.TF)
            el.carried(w, el.M1E, el.TE, el.TF, 8)
            along = el.dot(w, 8, el.TF)
            for c in range(3):
                w[8, c] -= along * w[el.TF, c]
            _made_unit(w, 8)
            el.cross(w, el.TF, 8, 9)
            for c in range(3):
                w[el.M1E, c] = np.cos(twists[k]) * w[8, c] + np.sin(twists[k]) * w[9, c]
                w[el.TE, c] = w[el.TF, c]


def laid_out(
    natural: Natural, lengths: ArrayLike, node_offsets: ArrayLike, positions: ArrayLike, frames: ArrayLike
) -> tuple[Vector, Vector]:
    """Nodes (p, 3) [m] and directors (q, 3) of unstressed rods from their roots.

    lengths : (q,) of all edges [m].  node_offsets : (f + 1,).  positions (f, 3), frames (f, 3, 3) : of the roots, the first
    column of a frame being the direction of the first edge.
    """
    offsets = np.array(node_offsets, dtype=np.int64)
    edges = np.array(lengths, dtype=np.float64).ravel()
    fibres = len(offsets) - 1
    if len(edges) != offsets[-1] - fibres or len(natural.twists) != offsets[-1] - 2 * fibres:
        raise InputError("lengths", len(edges), "one for each edge, with natural strains for each inner node")
    nodes, directors = np.zeros((int(offsets[-1]), 3)), np.zeros((len(edges), 3))
    nodes[offsets[:-1]] = np.array(positions, dtype=np.float64).reshape(-1, 3)
    turns = np.ascontiguousarray(np.broadcast_to(np.array(frames, dtype=np.float64), (fibres, 3, 3)))
    bends = np.ascontiguousarray(natural.curvatures, dtype=np.float64)
    _lay(bends, np.ascontiguousarray(natural.twists), edges, offsets, turns, nodes, directors)
    return nodes, directors
