"""Rigid walls with Coulomb friction: one more block per wall quadrature point (seed B names them as the missing piece).

The block holds w_q (v_N; v_T), N into the matter, padded with zero rows to the size of a tensor; its force is a traction.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from barchan.flows.dense.conditions import Condition, FrictionalWall
from barchan.spaces.mixed import MixedSpace, WallRows, sampled


@dataclass(frozen=True, eq=False)
class Walls:
    """Blocks of all frictional walls, parts one after the other.

    rates : (n s, size) padded rows.  drift : (n s,) minus the rates of the walls themselves.  mu : (n,) coefficients.
    ranges : name -> (first, last + 1) block, counted from the first wall block.  geometry : name -> its quadrature points.
    """

    rates: sp.csr_array
    drift: np.ndarray
    mu: np.ndarray
    ranges: dict[str, tuple[int, int]]
    geometry: dict[str, WallRows]

    @property
    def count(self) -> int:
        """Number of wall blocks."""
        return len(self.mu)


def wall_blocks(space: MixedSpace, conditions: Mapping[str, Condition]) -> Walls:
    """Blocks of the parts whose condition is a `FrictionalWall`."""
    d, s = space.dimension, space.s
    rates, drift, mu = [sp.csr_array((0, space.size))], [np.zeros(0)], [np.zeros(0)]
    ranges, geometry, start = {}, {}, 0
    for name, condition in conditions.items():
        if not isinstance(condition, FrictionalWall):
            continue
        rows = space.wall(name)
        count = len(rows.weights)
        own = np.zeros(d) if condition.velocity is None else condition.velocity
        speed = sampled(own, rows.points, f"conditions.{name}.velocity", (d,))
        relative = np.zeros((count, s))
        relative[:, :d] = -rows.weights[:, None] * np.einsum("nab,nb->na", rows.frames, speed)
        rates.append(_padded(rows.rates, count, d, s))
        drift.append(relative.reshape(-1))
        mu.append(np.array(sampled(condition.mu, rows.points, f"conditions.{name}.mu")))
        ranges[name], geometry[name] = (start, start + count), rows
        start += count
    stacked = sp.csr_array(sp.vstack(rates, format="csr"))
    return Walls(stacked, np.concatenate(drift), np.concatenate(mu), ranges, geometry)


def _padded(rows: sp.csr_array, count: int, d: int, s: int) -> sp.csr_array:
    """Rows (count d, size) spread over blocks of s rows, the last s - d of each empty."""
    place = (s * np.arange(count)[:, None] + np.arange(d)).ravel()
    lengths = np.zeros(count * s, dtype=rows.indptr.dtype)
    lengths[place] = np.diff(rows.indptr)
    indptr = np.concatenate([[0], np.cumsum(lengths)])
    return sp.csr_array((rows.data, rows.indices, indptr), shape=(count * s, rows.shape[1]))
