"""The regular grid of the material point method: an axis-aligned box cut into equal cells (seed B, 7.3.3).

Nodes and cells are numbered by C-order flat indices (the last axis, which is the vertical one, runs fastest).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.errors import InputError

# Flat cell ids are kept in int32 arrays by the sorting kernels.
_LARGEST_NODE_COUNT = 2**31 - 1


@dataclass(frozen=True, eq=False)
class RegularGrid:
    """Box `[origin, origin + spacing * cells]` divided into equal cells, in two or three dimensions.

    Parameters
    ----------
    origin : (d,) lower corner [m].
    spacing : (d,) edge lengths of a cell [m], positive.
    cells : (d,) number of cells along each axis, at least 1.

    Raises
    ------
    InputError : for lengths that differ or are not 2 or 3, values that are not finite, a spacing that is not
        positive, or an axis without cells.
    """

    origin: NDArray[np.float64]
    spacing: NDArray[np.float64]
    cells: NDArray[np.int64]

    def __init__(self, origin: ArrayLike, spacing: ArrayLike, cells: ArrayLike) -> None:
        start = _vector("grid.origin", origin)
        step = _vector("grid.spacing", spacing)
        counts = _counts("grid.cells", cells)
        if not len(start) == len(step) == len(counts):
            raise InputError(
                "grid.cells", cells, f"of the same length as the origin ({len(start)}) and the spacing"
            )
        if len(start) not in (2, 3):
            raise InputError("grid.origin", origin, "a vector of 2 or 3 coordinates")
        if not np.all(step > 0.0):
            raise InputError("grid.spacing", spacing, "positive along every axis (m)")
        if np.any(counts < 1):
            raise InputError("grid.cells", cells, "at least 1 along every axis")
        if float(np.prod(counts + 1.0)) > _LARGEST_NODE_COUNT:
            raise InputError(
                "grid.cells", cells, f"such that the grid has at most {_LARGEST_NODE_COUNT} nodes"
            )
        for name, value in (("origin", start), ("spacing", step), ("cells", counts)):
            value.setflags(write=False)
            object.__setattr__(self, name, value)

    @classmethod
    def from_box(cls, size: Sequence[float], cells: Sequence[int]) -> RegularGrid:
        """Grid of the box `[0, size]` (d,) [m] with the given number of cells (d,) per axis."""
        lengths, counts = _vector("grid.size", size), _counts("grid.cells", cells)
        if len(lengths) != len(counts):
            raise InputError("grid.cells", cells, f"of the same length as the size ({len(lengths)})")
        if np.any(counts < 1):
            raise InputError("grid.cells", cells, "at least 1 along every axis")
        if not np.all(lengths > 0.0):
            raise InputError("grid.size", size, "positive along every axis (m)")
        return cls(np.zeros(len(lengths)), lengths / counts, counts)

    @property
    def dimension(self) -> int:
        """Space dimension d, 2 or 3."""
        return len(self.origin)

    @property
    def upper(self) -> NDArray[np.float64]:
        """(d,) upper corner of the box [m]."""
        return self.origin + self.spacing * self.cells

    @property
    def nodes(self) -> NDArray[np.int64]:
        """(d,) number of nodes along each axis: one more than the cells."""
        return self.cells + 1

    @property
    def node_count(self) -> int:
        """Number of nodes of the whole grid."""
        return int(np.prod(self.nodes))

    @property
    def cell_count(self) -> int:
        """Number of cells of the whole grid."""
        return int(np.prod(self.cells))

    @property
    def cell_volume(self) -> float:
        """Volume of a cell [m^d]."""
        return float(np.prod(self.spacing))

    def node_indices(self, ids: ArrayLike) -> NDArray[np.int64]:
        """(n, d) integer coordinates of the nodes with flat indices `ids` (n,)."""
        flat = np.asarray(ids, dtype=np.int64)
        return np.stack(np.unravel_index(flat, tuple(self.nodes)), axis=-1)

    def node_positions(self, ids: ArrayLike) -> NDArray[np.float64]:
        """(n, d) positions [m] of the nodes with flat indices `ids` (n,)."""
        return self.origin + self.spacing * self.node_indices(ids)

    def node_volumes(self, ids: ArrayLike) -> NDArray[np.float64]:
        """(n,) integrals of the shape functions over the box [m^d]: a cell's volume inside, half of it at a wall."""
        index = self.node_indices(ids)
        at_wall = (index == 0).astype(np.int64) + (index == self.cells)
        return self.cell_volume * 0.5 ** np.sum(at_wall, axis=-1)

    def on_face(self, ids: ArrayLike, axis: int, upper: bool) -> NDArray[np.bool_]:
        """(n,) whether each node lies on the lower or upper face normal to `axis`."""
        return self.node_indices(ids)[..., axis] == (self.cells[axis] if upper else 0)

    def contains(self, positions: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(P,) whether each of the positions (P, d) lies in the closed box; False for NaN."""
        return np.all((positions >= self.origin) & (positions <= self.upper), axis=-1)


def _vector(field: str, value: Any) -> NDArray[np.float64]:
    try:
        vector = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(field, value, "a vector of 2 or 3 numbers") from None
    if vector.ndim != 1 or not np.all(np.isfinite(vector)):
        raise InputError(field, value, "a vector of 2 or 3 finite numbers")
    return vector


def _counts(field: str, value: Any) -> NDArray[np.int64]:
    numbers = _vector(field, value)
    counts = numbers.astype(np.int64)
    if np.any(counts != numbers):
        raise InputError(field, value, "whole numbers")
    return counts
