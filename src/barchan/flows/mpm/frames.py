"""Particle frames: the tensors F_p = sum_i a_i a_i^T of the semi-axes of the matter each particle stands for (seed B, 7.3.2).

A frame with semi-axes a_i is read as the brick of edges 2 a_i, as which particles begin. Its volume is 2^d sqrt(det F), the
space the particle has for itself, V_p / phi. The second moments of that brick are F / 3 per unit volume; they are what
splits and merges conserve. Where a smooth shape is wanted, it is the ellipsoid x^T F^-1 x <= ELLIPSOID_RADII[d]^2, of the
same axes and the same volume as the brick.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.errors import InputError
from barchan.flows.mpm._frame_kernels import advance_frames, decompose_frames, determinants, exponentials

# Radius of the ball with the volume of the cube [-1, 1]^d.
ELLIPSOID_RADII = {2: math.sqrt(4.0 / math.pi), 3: (6.0 / math.pi) ** (1.0 / 3.0)}


def initial_frames(widths: ArrayLike) -> NDArray[np.float64]:
    """Frames (P, d, d) [m^2] of bricks with edges `widths` (P, d) [m] along the axes: F = diag((w / 2)^2).

    `frame_volumes` gives back the volumes of the bricks. Raises InputError for widths that are not finite and positive.
    """
    edges = np.asarray(widths, dtype=np.float64)
    if edges.ndim != 2 or edges.shape[1] not in (2, 3):
        raise InputError("widths", f"array of shape {edges.shape}", "of shape (P, 2) or (P, 3)")
    if not np.all(np.isfinite(edges) & (edges > 0.0)):
        raise InputError("widths", "an array with entries that are not positive", "finite and > 0 (m)")
    return (0.25 * edges**2)[:, :, None] * np.eye(edges.shape[1])


def frame_volumes(frames: ArrayLike) -> NDArray[np.float64]:
    """Volumes (P,) [m^d] of the frames (P, d, d): 2^d sqrt(det F)."""
    tensors = matrices("frames", frames)
    volumes = np.empty(len(tensors))
    determinants(tensors, volumes)
    return 2.0 ** tensors.shape[1] * np.sqrt(np.maximum(volumes, 0.0))


def advected_frames(frames: ArrayLike, gradients: ArrayLike, dt: float) -> NDArray[np.float64]:
    """Frames (P, d, d) after `dt` seconds in velocity gradients frozen at `gradients` (P, d, d), row k that of component k.

    With L = D + W, the right-hand side of seed B, Eq. (7.20), is (D + W) F + F (D - W) = L F + F L^T, whose solution is
    F(dt) = exp(dt L) F exp(dt L)^T: symmetric and positive definite, of a volume that grows by exp(dt Tr L). The
    exponential is exact to rounding (scaling and squaring of a Pade fraction).

    Raises InputError for arrays of other shapes, entries or a `dt` that are not finite.
    """
    tensors = matrices("frames", frames)
    slopes = matrices("gradients", gradients, like=tensors)
    out = np.empty_like(tensors)
    advance_frames(tensors, slopes, _finite_time(dt), out)
    return out


def flow_maps(gradients: ArrayLike, dt: float) -> NDArray[np.float64]:
    """exp(dt L), (P, d, d): where `dt` seconds of the frozen gradients (P, d, d) take the arms x - x_p; see above."""
    slopes = matrices("gradients", gradients)
    out = np.empty_like(slopes)
    exponentials(slopes, _finite_time(dt), out)
    return out


def semi_axes(frames: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lengths (P, d) [m] of the semi-axes of frames (P, d, d), decreasing, and unit directions (P, d, d).

    Row i of `directions[p]` belongs to `lengths[p, i]`; its sign has no meaning.
    """
    tensors = matrices("frames", frames)
    lengths, axes = np.empty(tensors.shape[:2]), np.empty_like(tensors)
    decompose_frames(tensors, lengths, axes)
    return lengths, axes


def bounded_frames(frames: ArrayLike, shortest: float, longest: float) -> NDArray[np.float64]:
    """Frames (P, d, d) with semi-axes clipped to [shortest, longest] [m], their directions kept.

    In matter that flies apart frames grow without end and mean nothing beyond the size of a cell; and an axis shorter than
    1e-8 of another is lost to rounding. Raises InputError unless 0 < shortest <= longest.
    """
    if not (math.isfinite(shortest) and math.isfinite(longest) and 0.0 < shortest <= longest):
        raise InputError("shortest", (shortest, longest), "positive and at most `longest`, both finite (m)")
    tensors = matrices("frames", frames)
    lengths, axes = semi_axes(tensors)
    outside = np.flatnonzero((lengths[:, 0] > longest) | (lengths[:, -1] < shortest))
    result = tensors.copy()
    squares = np.clip(lengths[outside], shortest, longest) ** 2
    result[outside] = np.einsum("pi,pij,pik->pjk", squares, axes[outside], axes[outside])
    return result


def matrices(field: str, value: ArrayLike, like: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    """`value` as a contiguous (P, d, d) array, d = 2 or 3; InputError naming `field` if it is not one, or not finite."""
    array = np.ascontiguousarray(value, dtype=np.float64)
    if like is not None and array.shape != like.shape:
        raise InputError(field, f"array of shape {array.shape}", f"of shape {like.shape}")
    if array.ndim != 3 or array.shape[1] not in (2, 3) or array.shape[1] != array.shape[2]:
        raise InputError(field, f"array of shape {array.shape}", "of shape (P, 2, 2) or (P, 3, 3)")
    if not np.all(np.isfinite(array)):
        raise InputError(field, "an array with NaN or infinite entries", "finite")
    return array


def _finite_time(dt: Any) -> float:
    if not isinstance(dt, (int, float)) or not math.isfinite(dt):
        raise InputError("dt", dt, "a finite number (s)")
    return float(dt)
