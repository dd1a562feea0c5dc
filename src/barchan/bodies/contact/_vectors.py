"""Vectors of three numbers as tuples: what the kernels of contact detection compute with, without arrays."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Vec = tuple[float, float, float]


@njit(cache=True)
def row(array: NDArray[np.float64], i: int) -> Vec:
    """Row i of an array (n, 3)."""
    return array[i, 0], array[i, 1], array[i, 2]


@njit(cache=True)
def put(array: NDArray[np.float64], i: int, a: Vec) -> None:
    """Write a to row i of an array (n, 3)."""
    array[i, 0], array[i, 1], array[i, 2] = a[0], a[1], a[2]


@njit(cache=True)
def dot(a: Vec, b: Vec) -> float:
    """a . b"""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True)
def cross(a: Vec, b: Vec) -> Vec:
    """a x b"""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def sub(a: Vec, b: Vec) -> Vec:
    """a - b"""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(cache=True)
def along(a: Vec, s: float, b: Vec) -> Vec:
    """a + s b"""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


@njit(cache=True)
def scaled(s: float, a: Vec) -> Vec:
    """s a"""
    return s * a[0], s * a[1], s * a[2]


@njit(cache=True)
def turn(matrix: NDArray[np.float64], a: Vec) -> Vec:
    """R a of a matrix (3, 3)."""
    return (
        matrix[0, 0] * a[0] + matrix[0, 1] * a[1] + matrix[0, 2] * a[2],
        matrix[1, 0] * a[0] + matrix[1, 1] * a[1] + matrix[1, 2] * a[2],
        matrix[2, 0] * a[0] + matrix[2, 1] * a[1] + matrix[2, 2] * a[2],
    )


@njit(cache=True)
def turn_back(matrix: NDArray[np.float64], a: Vec) -> Vec:
    """R^T a of a matrix (3, 3)."""
    return (
        matrix[0, 0] * a[0] + matrix[1, 0] * a[1] + matrix[2, 0] * a[2],
        matrix[0, 1] * a[0] + matrix[1, 1] * a[1] + matrix[2, 1] * a[2],
        matrix[0, 2] * a[0] + matrix[1, 2] * a[1] + matrix[2, 2] * a[2],
    )
