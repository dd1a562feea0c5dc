"""Checks of what rods are made from."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.fibres.rods.natural import Natural
from barchan.bodies.fibres.roots import RootMotion
from barchan.errors import InputError

Vector = NDArray[np.float64]
Whole = NDArray[np.int64]

_FOLDED = 1e-6  # 1 + cosine of the turning angle: edges folded back on each other have no material direction to carry


def polylines(nodes: Sequence[ArrayLike] | ArrayLike, node_offsets: ArrayLike | None) -> tuple[Vector, Whole]:
    """All nodes (p, 3) and offsets (f + 1,), from a list of polylines or from one array and its offsets."""
    if node_offsets is None:
        try:
            lines = [np.atleast_2d(np.array(line, dtype=np.float64)) for line in nodes]  # type: ignore[union-attr]
        except (TypeError, ValueError):
            raise InputError(
                "nodes", type(nodes).__name__, "arrays (n + 1, 3) of numbers, one for each fibre"
            ) from None
        if not lines:
            raise InputError("nodes", "no fibre", "one fibre at least")
        for i, line in enumerate(lines):
            if line.ndim != 2 or line.shape[1] != 3:
                raise InputError(f"nodes[{i}]", line.shape, "(n + 1, 3)")
        points = np.ascontiguousarray(np.concatenate(lines))
        offsets = np.concatenate([[0], np.cumsum([len(line) for line in lines])]).astype(np.int64)
    else:
        points = np.array(nodes, dtype=np.float64)
        offsets = np.array(node_offsets, dtype=np.int64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise InputError("nodes", points.shape, "(p, 3)")
        if offsets.ndim != 1 or len(offsets) < 2 or offsets[0] != 0 or offsets[-1] != len(points):
            raise InputError("node_offsets", offsets.tolist(), f"from 0 to {len(points)}")
    few = np.diff(offsets) < 3
    if np.any(few):
        raise InputError("nodes", f"fibre {int(np.argmax(few))}", "of three nodes at least")
    if not np.all(np.isfinite(points)):
        row = int(np.argmin(np.all(np.isfinite(points), axis=1)))
        raise InputError("nodes", points[row].tolist(), f"finite; node {row} is not")
    return np.ascontiguousarray(points), offsets


def segments(points: Vector, offsets: Whole, radii: Vector) -> None:
    """Raise InputError for segments of no length, shorter than the radius, or folded back on each other."""
    for i in range(len(offsets) - 1):
        edges = np.diff(points[offsets[i] : offsets[i + 1]], axis=0)
        lengths = np.linalg.norm(edges, axis=1)
        short = int(np.argmin(lengths))
        if lengths[short] == 0.0:
            raise InputError("nodes", f"segment {short} of fibre {i}", "of positive length")
        if lengths[short] < radii[i]:
            raise InputError(
                "section.radius", float(radii[i]), f"at most {lengths[short]:g}, segment {short} of fibre {i}"
            )
        cosines = np.sum(edges[1:] * edges[:-1], axis=1) / (lengths[1:] * lengths[:-1])
        if np.any(1.0 + cosines < _FOLDED):
            raise InputError("nodes", f"node {int(np.argmin(cosines)) + 1} of fibre {i}", "not folded back")


def end_counts(roots: RootMotion, tips: RootMotion | None, fibres: int) -> None:
    """Raise InputError unless there is an end for each fibre."""
    for name, end in (("roots", roots), ("tips", tips)):
        if end is not None and len(end) != fibres:
            raise InputError(f"{name}.positions", len(end), f"one for each of the {fibres} fibres")


def numbers(name: str, values: ArrayLike, count: int) -> Vector:
    """`count` finite numbers."""
    array = np.array(values, dtype=np.float64)
    if array.shape != (count,) or not np.all(np.isfinite(array)):
        raise InputError(name, array.shape, f"{count} finite numbers")
    return array


def lengths(values: ArrayLike, count: int) -> Vector:
    """`count` positive lengths."""
    array = numbers("rest_lengths", values, count)
    if np.any(array <= 0.0):
        raise InputError("rest_lengths", float(array.min()), "positive [m]")
    return array


def table(name: str, values: ArrayLike, count: int) -> Vector:
    """Finite vectors (count, 3)."""
    array = np.array(values, dtype=np.float64)
    if array.shape != (count, 3) or not np.all(np.isfinite(array)):
        raise InputError(name, array.shape, f"finite, ({count}, 3)")
    return array


def natural_strains(natural: Natural, count: int) -> Natural:
    """Natural strains as contiguous arrays of `count` inner nodes."""
    curvatures = np.ascontiguousarray(natural.curvatures, dtype=np.float64)
    if curvatures.shape != (count, 2) or not np.all(np.isfinite(curvatures)):
        raise InputError("natural.curvatures", curvatures.shape, f"finite, ({count}, 2)")
    return Natural(curvatures, numbers("natural.twists", natural.twists, count))
