"""Adding 3 x 3 blocks of elements to a block-sparse matrix, and the skew matrices that the kernels of cloth share."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Whole = NDArray[np.int64]


@njit(cache=True)
def add_block(data: Array, entry: int, factor: float, left: Array, right: Array) -> None:
    """data[entry] += factor left right^T for vectors of three."""
    for i in range(3):
        for j in range(3):
            data[entry, i, j] += factor * left[i] * right[j]


@njit(cache=True)
def add_isotropic(data: Array, entry: int, factor: float) -> None:
    """data[entry] += factor I."""
    for i in range(3):
        data[entry, i, i] += factor


@njit(cache=True)
def fill_cross(a: Array, out: Array) -> None:
    """out x = a x x."""
    out[0, 0] = out[1, 1] = out[2, 2] = 0.0
    out[0, 1], out[0, 2], out[1, 2] = -a[2], a[1], -a[0]
    out[1, 0], out[2, 0], out[2, 1] = a[2], -a[1], a[0]


@njit(cache=True)
def cross_into(a: Array, b: Array, out: Array) -> None:
    """out = a x b."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def inner(a: Array, b: Array) -> float:
    """a . b"""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
