"""Multilinear shape functions of the regular grid: values and gradients at given points (seed B, 7.3.3, Fig. 7.8a).

Vectorised reference for anything that is not a hot loop; the kernels of `flows.mpm` evaluate the same functions.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from barchan.errors import InputError
from barchan.spaces.grid import RegularGrid


@dataclass(frozen=True)
class ShapeValues:
    """The 2^d shape functions that do not vanish at each of P points.

    nodes : (P, 2^d) flat node indices.
    weights : (P, 2^d) values, in [0, 1], adding up to one.
    gradients : (P, 2^d, d) gradients [1/m].
    """

    nodes: NDArray[np.int64]
    weights: NDArray[np.float64]
    gradients: NDArray[np.float64]


def shape_functions(grid: RegularGrid, positions: NDArray[np.float64]) -> ShapeValues:
    """Evaluate the multilinear shape functions at `positions` (P, d) [m]; InputError for points outside the box."""
    points = np.asarray(positions, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != grid.dimension:
        raise InputError("positions", points.shape, f"an array of shape (P, {grid.dimension})")
    if not np.all(grid.contains(points)):
        raise InputError("positions", points[~grid.contains(points)][0], "inside the box of the grid")
    scaled = (points - grid.origin) / grid.spacing
    cell = np.clip(np.floor(scaled).astype(np.int64), 0, grid.cells - 1)
    local = scaled - cell
    corners = np.array(list(product((0, 1), repeat=grid.dimension)))
    nodes = np.ravel_multi_index(
        tuple(np.moveaxis(cell[:, None, :] + corners[None, :, :], -1, 0)), tuple(grid.nodes)
    )
    factors = np.where(corners[None, :, :] == 1, local[:, None, :], 1.0 - local[:, None, :])
    slopes = np.where(corners == 1, 1.0, -1.0) / grid.spacing
    gradients = np.empty((*factors.shape[:2], grid.dimension))
    for axis in range(grid.dimension):
        others = np.prod(np.delete(factors, axis, axis=-1), axis=-1)
        gradients[:, :, axis] = slopes[None, :, axis] * others
    return ShapeValues(nodes, np.prod(factors, axis=-1), gradients)


def interpolate(
    grid: RegularGrid, node_values: NDArray[np.float64], positions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Values (P, ...) at `positions` (P, d) of the multilinear field with `node_values` (node_count, ...)."""
    if len(node_values) != grid.node_count:
        raise InputError(
            "node_values", node_values.shape, f"an array with one row per node ({grid.node_count})"
        )
    shapes = shape_functions(grid, positions)
    picked = node_values[shapes.nodes]
    weights = shapes.weights.reshape(shapes.weights.shape + (1,) * (picked.ndim - 2))
    return np.asarray(np.sum(weights * picked, axis=1))
