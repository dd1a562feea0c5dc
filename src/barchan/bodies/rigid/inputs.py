"""Reading numbers and vectors that a person gave: InputError names the field when they cannot be used."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.errors import InputError


def positive(field: str, value: float) -> float:
    """`value` as a float, finite and > 0."""
    if not _is_number(value) or not np.isfinite(value) or value <= 0.0:
        raise InputError(field, value, "a positive number")
    return float(value)


def not_negative(field: str, value: float) -> float:
    """`value` as a float, finite and >= 0."""
    if not _is_number(value) or not np.isfinite(value) or value < 0.0:
        raise InputError(field, value, "a number >= 0")
    return float(value)


def vector(field: str, value: ArrayLike, dimensions: tuple[int, ...]) -> NDArray[np.float64]:
    """`value` as a finite vector whose length is one of `dimensions`."""
    allowed = f"{' or '.join(str(d) for d in dimensions)} finite numbers"
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(field, value, allowed) from None
    if array.ndim != 1 or array.size not in dimensions or not np.all(np.isfinite(array)):
        raise InputError(field, value, allowed)
    return array


def table(field: str, value: ArrayLike, columns: tuple[int, ...], rows: int) -> NDArray[np.float64]:
    """`value` as a finite array of at least `rows` rows, the number of columns being one of `columns`."""
    allowed = f"at least {rows} rows of {' or '.join(str(c) for c in columns)} finite numbers"
    try:
        array = np.array(value, dtype=np.float64, order="C")
    except (TypeError, ValueError):
        raise InputError(field, value, allowed) from None
    if (
        array.ndim != 2
        or array.shape[1] not in columns
        or len(array) < rows
        or not np.all(np.isfinite(array))
    ):
        raise InputError(field, value, allowed)
    return array


def points(value: ArrayLike, dimension: int) -> NDArray[np.float64]:
    """`value` as contiguous points (n, dimension)."""
    array = np.ascontiguousarray(value, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != dimension:
        raise InputError("points", array.shape, f"an array of shape (n, {dimension})")
    return array


def axis_direction(field: str, value: int | ArrayLike, dimension: int = 3) -> NDArray[np.float64]:
    """Unit vector (dimension,) of an axis given by its number 0, 1, ... or by any non-zero vector."""
    if isinstance(value, (int, np.integer)):
        if not 0 <= value < dimension:
            numbers = ", ".join(str(number) for number in range(dimension))
            raise InputError(field, int(value), f"{numbers} or a vector")
        direction: NDArray[np.float64] = np.eye(dimension)[int(value)]
        return direction
    given = vector(field, value, (dimension,))
    length = float(np.linalg.norm(given))
    if length == 0.0:
        raise InputError(field, value, "a vector that is not zero")
    unit: NDArray[np.float64] = given / length
    return unit


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)
