"""The layout of one stored frame, in one place: what is kept of the groups of a flow, of its steps and observables.

A frame holds named groups of arrays: `particles` and `grid` of a material point run, `fields` and `lines` of a
finite-element run, whose frame 0 also has its `mesh`. Vectors are stored with three components in 2D too (the
third is zero) because that is what every XDMF reader takes; `Results` gives back two. Fields are in single
precision; volumes, mesh, lines, steps and observables in double.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from barchan.results.sealed import Tree

VECTORS = ("positions", "velocities", "normals", "forces")
MESH = "mesh"
_IN_DOUBLE = (MESH, "lines")


def frame_tree(
    groups: Mapping[str, Mapping[str, np.ndarray]],
    steps: Mapping[str, np.ndarray],
    observables: Mapping[str, float],
) -> Tree:
    """The nested dict that is stored for a frame.

    Parameters
    ----------
    groups : name of a group -> its arrays. Of material points: `particles` with positions (P, d) m, velocities
        (P, d) m/s, volumes (P,) m^d, and `grid` with node_ids (n,), positions (n, d), velocities (n, d), cells
        (c, 2^d) rows of node numbers in XDMF corner order, and any further nodal fields (n,) or (n, s). Of
        finite elements: `fields` at the vertices, velocities (V, d) and scalars (V,), `lines` (m,) sampled
        along lines, and in frame 0 `mesh` with positions (V, d) and cells (c, corners).
    steps : one array per record field, for the steps since the previous frame (empty for frame 0).
    observables : scalars at the frame; `time` is one of them.
    """
    return {
        "dimension": np.int64(_dimension(groups)),
        **{
            name: {field: _stored(name, field, np.asarray(values)) for field, values in group.items()}
            for name, group in groups.items()
        },
        "steps": {name: np.asarray(values) for name, values in steps.items()},
        "observables": {name: np.float64(value) for name, value in observables.items()},
    }


def step_table(records: Iterable[Any]) -> dict[str, np.ndarray]:
    """Frozen dataclass records -> one array of shape (steps,) per field; empty dict without records.

    Wall-clock times, fields named `..._seconds`, are left out: the same run gives the same bytes.
    """
    rows = [vars(record) for record in records]
    names = [name for name in (rows[0] if rows else {}) if not name.endswith("_seconds")]
    return {name: np.array([row[name] for row in rows]) for name in names}


def with_true_dimension(group: Tree, dimension: int) -> Tree:
    """The group with its vectors cut back to `dimension` components."""
    return {name: values[:, :dimension] if name in VECTORS else values for name, values in group.items()}


def _dimension(groups: Mapping[str, Mapping[str, np.ndarray]]) -> int:
    """The dimension of space, that of the vectors in the groups."""
    return next(group[name].shape[1] for group in groups.values() for name in VECTORS if name in group)


def _stored(group: str, name: str, values: np.ndarray) -> np.ndarray:
    """An array as stored: integers kept (cells as 32 bits), vectors with three components, fields in single."""
    if values.dtype.kind in "iu":
        return values.astype(np.int32) if name == "cells" else values.astype(np.int64)
    in_double = group in _IN_DOUBLE or name == "volumes"
    values = values.astype(np.float64 if in_double else np.float32)
    return _three_components(values) if name in VECTORS else values


def _three_components(vectors: np.ndarray) -> np.ndarray:
    """(n, d) -> (n, 3), padded with zeros."""
    padded = np.zeros((len(vectors), 3), dtype=vectors.dtype)
    padded[:, : vectors.shape[1]] = vectors
    return padded
