"""Split and merge of particles, so that they stay well distributed over the cells (seed B, 7.3.2; Narain et al. 2010).

A particle that has become long is split in two along its longest axis; two close particles of a cell are merged where the
union is more isotropic than either. Volume, momentum, centre of mass, space (frame volume) and, for splits and for merges
of one affine motion, the moments of first and second order are conserved.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Integral
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.errors import InputError
from barchan.flows.mpm._frame_kernels import frame_extremes
from barchan.flows.mpm._resampling_kernels import pair_particles
from barchan.flows.mpm.frames import frame_volumes, matrices, semi_axes

REQUIRED = ("positions", "velocities", "affine", "volumes", "frames")
# Splitting the longest of three semi-axes in half again and again never ends for particles like (1, 2^(1/3), 2^(2/3)) if
# the threshold is at or below this ratio: the children are as elongated as their parent. In the plane it is sqrt(2).
ENDLESS_RATIO = 2.0 ** (2.0 / 3.0)
# No merged particle is wider than this share of the smallest cell edge.
LARGEST_MERGED = 1.0


@dataclass(frozen=True)
class Resampling:
    """When particles are split and merged.

    Parameters
    ----------
    split_ratio : a particle is split when its longest semi-axis is more than this many times its shortest; above
        2^(2/3) = 1.59, below which splitting does not end.
    split_length : only particles longer (2 a) than this share of the smallest cell edge are split, >= 0.
    merge_ratio : no two particles are merged into one with a ratio above this; at least 1, below `split_ratio`, so that
        neither what was split is merged nor what was merged is split at once.
    merge_reach : two particles are close when their frames' half-widths along the line of centres, times this, bridge it;
        > 0. At 1 only particles that touch are merged, and in matter kneaded to and fro their number grows.
    most_per_cell : cells with more particles are crowded: none is split there, and close particles are merged when the
        union keeps to `merge_ratio`, be it more isotropic or not.
    fewest_per_cell : merging leaves at least so many particles in a cell, >= 1, at most `most_per_cell`.

    Raises
    ------
    InputError : for a value out of range; in particular split thresholds that never end.
    """

    split_ratio: float = 2.0
    split_length: float = 0.25
    merge_ratio: float = 1.7
    merge_reach: float = 1.2
    most_per_cell: int = 64
    fewest_per_cell: int = 8

    def __post_init__(self) -> None:
        if not _finite(self.split_ratio) or self.split_ratio <= ENDLESS_RATIO:
            raise InputError(
                "resampling.split_ratio",
                self.split_ratio,
                f"above 2^(2/3) = {ENDLESS_RATIO:.4f}: at or below it halves can be as elongated as what was split, "
                "and splitting never ends",
            )
        if not _finite(self.split_length) or self.split_length < 0.0:
            raise InputError(
                "resampling.split_length", self.split_length, "a finite number >= 0 (cell edges)"
            )
        if not _finite(self.merge_ratio) or not 1.0 <= self.merge_ratio < self.split_ratio:
            raise InputError(
                "resampling.merge_ratio",
                self.merge_ratio,
                f"at least 1 and below split_ratio = {self.split_ratio}, or merged particles are split for ever",
            )
        if not _finite(self.merge_reach) or self.merge_reach <= 0.0:
            raise InputError("resampling.merge_reach", self.merge_reach, "a finite number > 0")
        for name in ("most_per_cell", "fewest_per_cell"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, Integral) or value < 1:
                raise InputError(f"resampling.{name}", value, "a whole number >= 1")
        if self.fewest_per_cell > self.most_per_cell:
            raise InputError(
                "resampling.fewest_per_cell",
                self.fewest_per_cell,
                f"at most most_per_cell = {self.most_per_cell}",
            )


class Resampled(NamedTuple):
    """Particles after a resampling, and who became who.

    fields : the arrays given, P' particles each.
    parents : (P',) int64 old index of each new particle; of a merged one, the lower of its two.
    heirs : (P,) int64 new index of each old particle: the first child of a split one (the second follows it), the merged
        particle for both that went into it.
    """

    fields: dict[str, NDArray[Any]]
    parents: NDArray[np.int64]
    heirs: NDArray[np.int64]


def resample(
    fields: Mapping[str, NDArray[Any]],
    cells: ArrayLike,
    options: Resampling,
    spacing: ArrayLike,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
) -> Resampled:
    """Split and merge once: each particle is split in two, or merged with one other, or left alone.

    Parameters
    ----------
    fields : particle arrays, P rows each: `positions` (P, d) [m], `velocities` (P, d) [m/s], `affine` (P, d, d) [1/s],
        `volumes` (P,) [m^d], `frames` (P, d, d) [m^2], and any others. Of the others children get copies; a merged
        particle gets the volume-weighted mean of real numbers. Particles that differ in a field of whole numbers
        (`materials`) are never merged. Arrays without rows (fields not in use) stay so.
    cells : (P,) flat cell numbers.
    options : when to split and merge.
    spacing : (d,) cell edges [m].
    lower, upper : (d,) corners of the box [m]: children are put closer to their parent rather than outside of it.

    A particle with longest semi-axis a along e is split into halves at x -+ (a/2) e: two bricks of half the volume that
    fill the same space and have the same first and second moments, with velocities v -+ (a/2) c e. In a merged particle
    the affine field is the projection (least squares over the two bricks) of the two affine fields.

    Raises
    ------
    InputError : for missing fields or arrays of the wrong shape.
    """
    given = _checked(fields)
    count, d = given["positions"].shape
    flat = np.asarray(cells)
    if flat.shape != (count,) or not np.issubdtype(flat.dtype, np.integer):
        raise InputError(
            "cells", f"{flat.dtype} array of shape {flat.shape}", f"whole numbers of shape ({count},)"
        )
    edge = float(np.min(_corner("spacing", spacing, d, math.nan)))
    if not 0.0 < edge < math.inf:
        raise InputError("spacing", spacing, f"{d} finite numbers > 0 (m)")
    box = _corner("lower", lower, d, -math.inf), _corner("upper", upper, d, math.inf)
    split, partners = _choices(given, flat, options, edge)
    keepers = np.flatnonzero(partners > np.arange(count))
    absorbed = partners[keepers]
    if not len(keepers) and not np.any(split):
        same = np.arange(count)
        return Resampled(given, same, same.copy())
    rows = 1 + split.astype(np.int64)
    rows[absorbed] = 0
    parents = np.repeat(np.arange(count), rows)
    heirs = np.cumsum(rows) - rows
    heirs[absorbed] = heirs[keepers]
    result = {name: value[parents] if len(value) else value.copy() for name, value in given.items()}
    splitting = np.flatnonzero(split)
    _write_children(given, result, splitting, heirs[splitting], box)
    _write_merged(given, result, keepers, absorbed, heirs[keepers], box)
    return Resampled(result, parents, heirs)


def _checked(fields: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    for name in REQUIRED:
        if name not in fields:
            raise InputError(f"fields.{name}", "missing", "given")
    given: dict[str, NDArray[Any]] = {name: np.ascontiguousarray(value) for name, value in fields.items()}
    shape = given["positions"].shape
    if len(shape) != 2 or shape[1] not in (2, 3):
        raise InputError("fields.positions", f"array of shape {shape}", "of shape (P, 2) or (P, 3)")
    count, d = shape
    expected = {"velocities": shape, "affine": (count, d, d), "volumes": (count,), "frames": (count, d, d)}
    for name, value in given.items():
        if name in expected and value.shape != expected[name]:
            raise InputError(f"fields.{name}", f"array of shape {value.shape}", f"of shape {expected[name]}")
        if value.ndim == 0 or len(value) not in (0, count):
            raise InputError(
                f"fields.{name}", f"array of shape {value.shape}", f"an array of {count} rows, or none"
            )
    matrices("fields.frames", given["frames"])
    return given


def _choices(
    given: dict[str, NDArray[Any]], cells: NDArray[Any], options: Resampling, edge: float
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Which particles (P,) are split, and the partner (P,) of each that is merged, -1 for the others."""
    order = np.argsort(cells, kind="stable")
    firsts = np.flatnonzero(np.append(True, np.diff(cells[order]) != 0)[: len(order)])
    starts = np.append(firsts, len(order)).astype(np.int64)
    crowd = np.empty(len(order), dtype=np.int64)
    crowd[order] = np.repeat(np.diff(starts), np.diff(starts))
    extremes = np.empty((len(order), 2))
    frame_extremes(given["frames"], extremes)
    split = (
        (extremes[:, 0] > options.split_ratio**2 * extremes[:, 1])
        & (extremes[:, 0] > (0.5 * options.split_length * edge) ** 2)
        & (crowd <= options.most_per_cell)
    )
    partners = np.full(len(order), -1, dtype=np.int64)
    rules = (float(options.merge_ratio), float(options.merge_reach), 0.5 * LARGEST_MERGED * edge)
    pair_particles(
        order, starts, int(options.fewest_per_cell), int(options.most_per_cell), _kinds(given),
        given["positions"], given["volumes"], given["frames"], extremes, rules, ~split, partners,
    )  # fmt: skip
    return split, partners


def _kinds(given: dict[str, NDArray[Any]]) -> NDArray[np.int64]:
    """(P,) numbers that are equal where all fields of whole numbers are."""
    count = len(given["positions"])
    columns = [
        value.reshape(count, -1)
        for value in given.values()
        if len(value) and np.issubdtype(value.dtype, np.integer)
    ]
    if not columns:
        return np.zeros(count, dtype=np.int64)
    if len(columns) == 1 and columns[0].shape[1] == 1:
        return columns[0][:, 0].astype(np.int64)
    _, kinds = np.unique(np.concatenate(columns, axis=1), axis=0, return_inverse=True)
    return kinds.reshape(-1).astype(np.int64)


def _write_children(
    given: dict[str, NDArray[Any]],
    result: dict[str, NDArray[Any]],
    parents: NDArray[np.int64],
    first: NDArray[np.int64],
    box: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> None:
    """Halves of the `parents` into rows `first` and `first` + 1."""
    if not len(parents):
        return
    positions, frames = given["positions"][parents], given["frames"][parents]
    lengths, axes = semi_axes(frames)
    longest, axis = lengths[:, 0], axes[:, 0]
    offset = 0.5 * longest[:, None] * axis
    room = np.maximum(np.minimum(positions - box[0], box[1] - positions), 0.0)
    share = np.divide(room, np.abs(offset), out=np.ones_like(room), where=np.abs(offset) > room)
    offset *= np.min(share, axis=1)[:, None]
    kick = np.einsum("pij,pj->pi", given["affine"][parents], offset)
    halved = frames - (0.75 * longest**2)[:, None, None] * axis[:, :, None] * axis[:, None, :]
    for row, sign in ((first, -1.0), (first + 1, 1.0)):
        result["positions"][row] = np.clip(positions + sign * offset, *box)
        result["velocities"][row] = given["velocities"][parents] + sign * kick
        result["volumes"][row] = 0.5 * given["volumes"][parents]
        result["frames"][row] = halved


def _write_merged(
    given: dict[str, NDArray[Any]],
    result: dict[str, NDArray[Any]],
    keepers: NDArray[np.int64],
    absorbed: NDArray[np.int64],
    rows: NDArray[np.int64],
    box: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> None:
    """Unions of `keepers` and `absorbed` into `rows`: volume-weighted means of every field of real numbers but four."""
    if not len(keepers):
        return
    first, second = given["volumes"][keepers], given["volumes"][absorbed]
    share = second / (first + second)

    def mean(name: str) -> NDArray[np.float64]:
        a, b = given[name][keepers], given[name][absorbed]
        return a + share.reshape(-1, *[1] * (a.ndim - 1)) * (b - a)

    for name, value in given.items():
        if len(value) and not np.issubdtype(value.dtype, np.integer):
            result[name][rows] = mean(name)
    product = (share * (1.0 - share))[:, None, None]
    arm = given["positions"][absorbed] - given["positions"][keepers]
    jump = given["velocities"][absorbed] - given["velocities"][keepers]
    # Second moments, times 3: c F = mean(c_i F_i) + 3 w_1 w_2 jump (x) arm determines the affine field nearest to both.
    frames = mean("frames") + 3.0 * product * arm[:, :, None] * arm[:, None, :]
    w = share[:, None, None]
    moments = (1.0 - w) * (given["affine"][keepers] @ given["frames"][keepers])
    moments += w * (given["affine"][absorbed] @ given["frames"][absorbed])
    moments += 3.0 * product * jump[:, :, None] * arm[:, None, :]
    result["affine"][rows] = np.swapaxes(np.linalg.solve(frames, np.swapaxes(moments, 1, 2)), 1, 2)
    # The union has the axes of these moments and the space of both together.
    space = frame_volumes(given["frames"][keepers]) + frame_volumes(given["frames"][absorbed])
    scale = (space / frame_volumes(frames)) ** (2.0 / arm.shape[1])
    result["frames"][rows] = scale[:, None, None] * frames
    result["positions"][rows] = np.clip(result["positions"][rows], *box)
    result["volumes"][rows] = first + second


def _corner(field: str, value: ArrayLike | None, d: int, default: float) -> NDArray[np.float64]:
    if value is None:
        return np.full(d, default)
    corner = np.asarray(value, dtype=np.float64)
    if corner.shape != (d,) or np.any(np.isnan(corner)):
        raise InputError(field, value, f"{d} numbers (m)")
    return corner


def _finite(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
