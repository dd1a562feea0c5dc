"""Checks shared by the room: block vectors, cone coefficients and step lengths given by a caller.

Each returns a float64 array or raises `InputError`, which the mathematics elsewhere relies on.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.errors import InputError

FloatArray = NDArray[np.float64]


def as_numbers(field: str, value: ArrayLike) -> FloatArray:
    """`value` as a float64 array of any shape; InputError when it does not hold real numbers."""
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(field, value, "a real number or an array of real numbers") from error


def as_vectors(field: str, value: ArrayLike) -> FloatArray:
    """`value` as vectors (..., s) ordered (N; T...); InputError unless s >= 2. NaN passes."""
    vectors = as_numbers(field, value)
    if vectors.ndim == 0 or vectors.shape[-1] < 2:
        raise InputError(field, _shape(vectors), "of shape (..., s) with s >= 2")
    return vectors


def as_coefficient(field: str, value: ArrayLike, leading: tuple[int, ...]) -> FloatArray:
    """`value` as coefficients >= 0 (+inf allowed) that broadcast to the leading shape of the vectors."""
    coefficient = as_numbers(field, value)
    if not np.all(coefficient >= 0.0):
        raise InputError(field, value, "non-negative")
    _require_broadcast(field, coefficient, leading)
    return coefficient


def as_step_length(field: str, value: ArrayLike, count: int) -> FloatArray:
    """`value` as step lengths > 0, a scalar or one per block (count,)."""
    step = as_numbers(field, value)
    if not np.all((step > 0.0) & np.isfinite(step)):
        raise InputError(field, value, "positive and finite")
    if step.shape not in ((), (count,)):
        raise InputError(field, _shape(step), f"a scalar or one value for each of the {count} blocks")
    return step


def require_same_shape(field: str, array: FloatArray, reference: FloatArray, reference_field: str) -> None:
    """InputError unless both arrays have the same shape."""
    if array.shape != reference.shape:
        raise InputError(field, _shape(array), f"of the shape of {reference_field}, {reference.shape}")


def _require_broadcast(field: str, array: FloatArray, leading: tuple[int, ...]) -> None:
    try:
        fits = np.broadcast_shapes(array.shape, leading) == leading
    except ValueError:
        fits = False
    if not fits:
        raise InputError(field, _shape(array), f"a scalar or of a shape that broadcasts to {leading}")


def _shape(array: NDArray[Any]) -> str:
    return f"array of shape {array.shape}"
