"""Loose places to start from: one grain in each cell of a lattice, none touching another."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.rigid import inputs
from barchan.errors import InputError

Vector = NDArray[np.float64]


def lattice_packing(
    radii: ArrayLike, lower: ArrayLike, upper: ArrayLike, seed: int = 0, jitter: float = 1.0
) -> Vector:
    """Centres (n, d) [m] of grains of `radii` (n,) [m] in the box `lower` .. `upper` (d,), spread over all of it.

    Cells of the lattice have the largest diameter as least edge; a grain lies anywhere in its cell, `jitter` in [0, 1]
    times as far from the middle as it may. Which grain gets which cell is random. InputError when the box is too small.
    """
    r = np.atleast_1d(np.array(radii, dtype=np.float64))
    low = inputs.vector("lower", lower, (2, 3))
    high = inputs.vector("upper", upper, (len(low),))
    if not 0.0 <= jitter <= 1.0:
        raise InputError("jitter", jitter, "between 0 and 1")
    if r.ndim != 1 or len(r) == 0 or np.any(r <= 0.0):
        raise InputError("radii", radii, "positive numbers")
    across = 2.0 * float(np.max(r))
    counts = np.floor((high - low) / across + 1e-9).astype(np.int64)
    if np.any(counts < 1) or np.prod(counts) < len(r):
        raise InputError("upper", high.tolist(), f"large enough for {len(r)} cells of {across:g} m")
    # layers no closer than the height asks for: the same room for every grain
    layers = int(np.ceil(len(r) / np.prod(counts[:-1])))
    sizes = (high - low) / np.append(counts[:-1], layers)
    places = np.stack(np.unravel_index(np.arange(len(r)), (layers, *counts[:-1])), axis=1)
    places = np.roll(places, -1, axis=1)
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(r))
    free = 0.5 * sizes - r[order][:, None]
    centres = low + (places + 0.5) * sizes + jitter * free * rng.uniform(-1.0, 1.0, (len(r), len(low)))
    found = np.empty_like(centres)
    found[order] = centres
    return found
