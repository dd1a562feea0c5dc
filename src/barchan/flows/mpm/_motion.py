"""Kernels that bring grid velocities to the particles and move them (seed B, Eq. 5.17 and 7.19; the move replaces 5.18).

A plane grid is treated as a solid one whose third axis has no extent. Each particle is one independent iteration: results
do not depend on the thread count.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from barchan.flows.mpm._kernels import _inside_unit


@njit(cache=True)
def _cell_and_local(x: float, origin: float, spacing: float, cells: int) -> tuple[int, float]:
    scaled = (x - origin) / spacing
    index = min(max(int(np.floor(scaled)), 0), cells - 1)
    return index, _inside_unit(scaled - index)


@njit(cache=True)
def _velocity_at(
    x0: float,
    x1: float,
    x2: float,
    origin: NDArray[np.float64],
    spacing: NDArray[np.float64],
    cells: NDArray[np.int64],
    strides: NDArray[np.int64],
    node_numbers: NDArray[np.int32],
    node_velocities: NDArray[np.float64],
    fallback: tuple[float, float, float],
) -> tuple[float, float, float]:
    """Velocity at a point: the average over the *active* corners of its cell, `fallback` if there is none."""
    solid = node_velocities.shape[1] == 3
    i0, t0 = _cell_and_local(x0, origin[0], spacing[0], cells[0])
    i1, t1 = _cell_and_local(x1, origin[1], spacing[1], cells[1])
    i2, t2 = _cell_and_local(x2, origin[2], spacing[2], cells[2]) if solid else (0, 0.0)
    total, u0, u1, u2 = 0.0, 0.0, 0.0, 0.0
    for i in range(2):
        for j in range(2):
            face = (t0 if i == 1 else 1.0 - t0) * (t1 if j == 1 else 1.0 - t1)
            for k in range(2 if solid else 1):
                a = node_numbers[(i0 + i) * strides[0] + (i1 + j) * strides[1] + (i2 + k) * strides[2]]
                if a < 0:
                    continue
                weight = face * (t2 if k == 1 else 1.0 - t2)
                total += weight
                u0 += weight * node_velocities[a, 0]
                u1 += weight * node_velocities[a, 1]
                if solid:
                    u2 += weight * node_velocities[a, 2]
    if total == 0.0:
        return fallback
    return u0 / total, u1 / total, u2 / total


@njit(cache=True, parallel=True)
def grid_to_particles(
    positions: NDArray[np.float64],
    origin: NDArray[np.float64],
    spacing: NDArray[np.float64],
    cells: NDArray[np.int64],
    strides: NDArray[np.int64],
    node_numbers: NDArray[np.int32],
    node_velocities: NDArray[np.float64],
    velocities: NDArray[np.float64],
    affine: NDArray[np.float64],
) -> None:
    """v_p = sum_i w_i(x_p) u_i (P, d) and c_p = sum_i u_i (x) grad w_i(x_p) (P, d, d) into arrays filled with zeros.

    An `affine` (0, d, d) leaves c_p out.
    """
    d, sloped = positions.shape[1], affine.shape[0] > 0
    for p in prange(positions.shape[0]):
        i0, t0 = _cell_and_local(positions[p, 0], origin[0], spacing[0], cells[0])
        i1, t1 = _cell_and_local(positions[p, 1], origin[1], spacing[1], cells[1])
        i2, t2 = _cell_and_local(positions[p, 2], origin[2], spacing[2], cells[2]) if d == 3 else (0, 0.0)
        for i in range(2):
            w0, g0 = (t0 if i == 1 else 1.0 - t0), (2 * i - 1) / spacing[0]
            for j in range(2):
                w1, g1 = (t1 if j == 1 else 1.0 - t1), (2 * j - 1) / spacing[1]
                for k in range(2 if d == 3 else 1):
                    w2, g2 = (t2 if k == 1 else 1.0 - t2), (2 * k - 1) / spacing[2]
                    a = node_numbers[(i0 + i) * strides[0] + (i1 + j) * strides[1] + (i2 + k) * strides[2]]
                    for e in range(d):
                        u = node_velocities[a, e]
                        velocities[p, e] += w0 * w1 * w2 * u
                        if not sloped:
                            continue
                        affine[p, e, 0] += g0 * w1 * w2 * u
                        affine[p, e, 1] += w0 * g1 * w2 * u
                        if d == 3:
                            affine[p, e, 2] += w0 * w1 * g2 * u


@njit(cache=True, parallel=True)
def move_particles(
    positions: NDArray[np.float64],
    velocities: NDArray[np.float64],
    origin: NDArray[np.float64],
    spacing: NDArray[np.float64],
    cells: NDArray[np.int64],
    strides: NDArray[np.int64],
    node_numbers: NDArray[np.int32],
    node_velocities: NDArray[np.float64],
    lowest: NDArray[np.float64],
    highest: NDArray[np.float64],
    substep: float,
    substeps: int,
    moved: NDArray[np.float64],
) -> None:
    """New positions (P, d) after `substeps` midpoint steps of `substep` seconds each through the frozen grid velocity.

    Positions stay within [lowest, highest] (3,). `velocities` (P, d) are those of the particles at their old positions.
    """
    d = positions.shape[1]
    for p in prange(positions.shape[0]):
        x0, x1, x2 = positions[p, 0], positions[p, 1], (positions[p, 2] if d == 3 else 0.0)
        u = (velocities[p, 0], velocities[p, 1], velocities[p, 2] if d == 3 else 0.0)
        for n in range(substeps):
            if n > 0:
                u = _velocity_at(
                    x0, x1, x2, origin, spacing, cells, strides, node_numbers, node_velocities, u
                )
            half = 0.5 * substep
            m0 = min(max(x0 + half * u[0], lowest[0]), highest[0])
            m1 = min(max(x1 + half * u[1], lowest[1]), highest[1])
            m2 = min(max(x2 + half * u[2], lowest[2]), highest[2])
            u = _velocity_at(m0, m1, m2, origin, spacing, cells, strides, node_numbers, node_velocities, u)
            x0 = min(max(x0 + substep * u[0], lowest[0]), highest[0])
            x1 = min(max(x1 + substep * u[1], lowest[1]), highest[1])
            x2 = min(max(x2 + substep * u[2], lowest[2]), highest[2])
        moved[p, 0] = x0
        moved[p, 1] = x1
        if d == 3:
            moved[p, 2] = x2
