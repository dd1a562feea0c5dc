"""The layout of one stored frame, in one place: what is kept of particles, grid, steps and observables.

Vectors are stored with three components in 2D too (the third is zero) because that is what every XDMF reader
takes; `Results` gives back two. Fields are in single precision, volumes, steps and observables in double.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from barchan.results.sealed import Tree

VECTORS = ("positions", "velocities")


def frame_tree(
    particles: Mapping[str, np.ndarray],
    grid: Mapping[str, np.ndarray],
    steps: Mapping[str, np.ndarray],
    observables: Mapping[str, float],
) -> Tree:
    """The nested dict that is stored for a frame.

    Parameters
    ----------
    particles : positions (P, d) m, velocities (P, d) m/s, volumes (P,) m^d.
    grid : node_ids (n,), positions (n, d), velocities (n, d), cells (c, 2^d) rows of node numbers in XDMF
        corner order,
        and any further nodal fields (n,) or (n, s), for example stresses, pressures, volume_fractions.
    steps : one array per record field, for the steps since the previous frame (empty for frame 0).
    observables : scalars at the frame; `time` (s) is one of them.
    """
    dimension = particles["positions"].shape[1]
    return {
        "dimension": np.int64(dimension),
        "particles": {
            **{name: _three_components(particles[name]) for name in VECTORS},
            "volumes": np.asarray(particles["volumes"], dtype=np.float64),
        },
        "grid": {name: _stored_field(name, np.asarray(values)) for name, values in grid.items()},
        "steps": {name: np.asarray(values) for name, values in steps.items()},
        "observables": {name: np.float64(value) for name, value in observables.items()},
    }


def step_table(records: Iterable[Any]) -> dict[str, np.ndarray]:
    """Frozen dataclass records -> one array of shape (steps,) per field; empty dict without records."""
    rows = [vars(record) for record in records]
    return {name: np.array([row[name] for row in rows]) for name in (rows[0] if rows else {})}


def with_true_dimension(group: Tree, dimension: int) -> Tree:
    """The group with its vectors cut back to `dimension` components."""
    return {name: values[:, :dimension] if name in VECTORS else values for name, values in group.items()}


def _stored_field(name: str, values: np.ndarray) -> np.ndarray:
    """A grid field as stored: integers kept (cells as 32 bits), vectors with three components, reals in single."""
    if values.dtype.kind in "iu":
        return values.astype(np.int32) if name == "cells" else values.astype(np.int64)
    return _three_components(values) if name in VECTORS else values.astype(np.float32)


def _three_components(vectors: np.ndarray) -> np.ndarray:
    """(n, d) -> (n, 3) in single precision, padded with zeros."""
    padded = np.zeros((len(vectors), 3), dtype=np.float32)
    padded[:, : np.shape(vectors)[1]] = vectors
    return padded
