"""Kernels of the time step: velocity Verlet with the dashpots at the predicted velocities, Lees-Edwards cell and barostat.

x(t + dt) = x + dt v + dt^2 a / 2,  v* = v + dt a,  a' = forces(x(t + dt), v*) / m,  v(t + dt) = v + dt (a + a') / 2.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from barchan.bodies.soft._contact_kernels import cross, pair_forces, wall_forces

Array = NDArray[np.float64]
Whole = NDArray[np.int64]


@njit(cache=True)
def turn(rotation: Array, wx: float, wy: float, wz: float, dt: float) -> None:
    """Turn an angle (1,) or a unit quaternion (4,) by `dt` seconds of a world spin: the exponential (seed B, 2.1.1)."""
    if len(rotation) == 1:
        rotation[0] += dt * wz
        return
    angle = dt * np.sqrt(wx * wx + wy * wy + wz * wz)
    c, s = np.cos(0.5 * angle), 0.5 * dt
    if angle > 1e-8:
        s *= np.sin(0.5 * angle) / (0.5 * angle)
    a, b, d, e = rotation[0], rotation[1], rotation[2], rotation[3]
    x, y, z = s * wx, s * wy, s * wz
    q0, q1 = c * a - x * b - y * d - z * e, c * b + x * a + y * e - z * d
    q2, q3 = c * d - x * e + y * a + z * b, c * e + x * d - y * b + z * a
    size = np.sqrt(q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
    rotation[0], rotation[1], rotation[2], rotation[3] = q0 / size, q1 / size, q2 / size, q3 / size


@njit(cache=True, parallel=True)
def drift(
    x: Array, v: Array, w: Array, rotations: Array, a: Array, b: Array, start: Array, shear: Array, dt: float
) -> float:
    """Move and turn all grains, predict their velocities, and return how far the farthest one strayed from the list's places.

    a, b (n, 3) : accelerations of the beginning of the step. start (n, 3) : where the list was made.
    shear (4,) : shear rate and its seconds since then, the axis of the gradient and the height of no motion.
    """
    farthest = 0.0
    axis = int(shear[2])
    for i in prange(len(x)):
        strayed = 0.0
        away = x[i, axis] - shear[3]
        for c in range(3):
            half = v[i, c] + 0.5 * dt * a[i, c]
            x[i, c] += dt * half
            v[i, c] = half + 0.5 * dt * a[i, c]
            flow = shear[0] * away if c == 0 else 0.0
            path = x[i, c] - start[i, c] - flow * shear[1]
            path = abs(path) + 2.0 * dt * abs(v[i, c] - flow)
            strayed += path * path
        farthest = max(farthest, strayed)
        h = 0.5 * dt
        turn(rotations[i], w[i, 0] + h * b[i, 0], w[i, 1] + h * b[i, 1], w[i, 2] + h * b[i, 2], dt)
        for c in range(3):
            w[i, c] += dt * b[i, c]
    return float(np.sqrt(farthest))


@njit(cache=True, parallel=True)
def kick(
    x: Array,
    v: Array,
    w: Array,
    a: Array,
    b: Array,
    grains: Array,
    gravity: Array,
    rows: Whole,
    second: Whole,
    second_rows: Whole,
    out: Array,
    walls: Array,
    time: float,
    law: Array,
    rolling: float,
    dt: float,
    wall_memory: Array,
    wall_out: Array,
) -> None:
    """Sum the forces of each grain, put its new accelerations into a, b and correct its predicted velocities by them."""
    for i in prange(len(x)):
        wall_forces(i, x, v, w, grains, walls, time, law, rolling, dt, wall_memory[i], wall_out[i])
        fx, fy, fz, tx, ty, tz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        own = rows[i + 1] - rows[i]
        for k in range(second[i + 1] - second[i] + own):
            before = second[i + 1] - second[i]
            p = second_rows[second[i] + k] if k < before else rows[i] + k - before
            sign = -1.0 if k < before else 1.0
            if out[p, 6] == 0.0:
                continue
            fx, fy, fz = fx + sign * out[p, 0], fy + sign * out[p, 1], fz + sign * out[p, 2]
            branch = (out[p, 8], out[p, 9], out[p, 10])
            distance = np.sqrt(branch[0] ** 2 + branch[1] ** 2 + branch[2] ** 2)
            arm = (grains[i, 0] - 0.5 * out[p, 6]) / distance
            lever = cross(branch, (out[p, 0], out[p, 1], out[p, 2]))
            tx += sign * out[p, 3] - arm * lever[0]
            ty += sign * out[p, 4] - arm * lever[1]
            tz += sign * out[p, 5] - arm * lever[2]
        for k in range(len(walls)):
            if wall_out[i, k, 6] == 0.0:
                continue
            force = (wall_out[i, k, 0], wall_out[i, k, 1], wall_out[i, k, 2])
            arm = grains[i, 0] - 0.5 * wall_out[i, k, 6]
            lever = cross((walls[k, 0], walls[k, 1], walls[k, 2]), force)
            fx, fy, fz = fx + force[0], fy + force[1], fz + force[2]
            tx += wall_out[i, k, 3] - arm * lever[0]
            ty += wall_out[i, k, 4] - arm * lever[1]
            tz += wall_out[i, k, 5] - arm * lever[2]
        if grains[i, 1] == 0.0:
            continue
        forces, torques = (fx, fy, fz), (tx, ty, tz)
        for c in range(3):
            linear = forces[c] * grains[i, 1] + gravity[c]
            angular = torques[c] * grains[i, 2]
            v[i, c] += 0.5 * dt * (linear - a[i, c])
            w[i, c] += 0.5 * dt * (angular - b[i, c])
            a[i, c], b[i, c] = linear, angular


@njit(cache=True)
def normal_stress(axis: int, v: Array, grains: Array, out: Array, volume: float) -> float:
    """Compressive stress [Pa] along `axis`: of contacts, and of velocities about their mean."""
    total, momentum, mass = 0.0, 0.0, 0.0
    for p in range(len(out)):
        if out[p, 6] > 0.0:
            total += out[p, axis] * out[p, 8 + axis]
    for i in range(len(v)):
        if grains[i, 1] > 0.0:
            m = 1.0 / grains[i, 1]
            mass += m
            momentum += m * v[i, axis]
            total += m * v[i, axis] ** 2
    if mass > 0.0:
        total -= momentum**2 / mass
    return float(total / volume)


@njit(cache=True)
def advance_cell(cell: Array, drive: Array, dt: float) -> None:
    """Shear the cell by one step and let its top, a piston, follow the stress of the grains.

    drive (7,) : axis of the gradient, shear rate, pressure [Pa], mass of the piston per area [kg/m^(d-1)], its damping
    time [s], 1 if there is a piston, and the stress. cell : as in `pair_forces`.
    """
    g = int(drive[0])
    if drive[5] > 0.0:
        cell[g, 3 + g] += dt * ((drive[6] - drive[2]) / drive[3] - cell[g, 3 + g] / drive[4])
        cell[g, g] += dt * cell[g, 3 + g]
    if drive[1] != 0.0:
        cell[g, 3] = drive[1] * cell[g, g]
        cell[g, 0] += dt * cell[g, 3]


@njit(cache=True)
def run(
    steps: int,
    dt: float,
    time: float,
    x: Array,
    v: Array,
    w: Array,
    rotations: Array,
    a: Array,
    b: Array,
    grains: Array,
    gravity: Array,
    cell: Array,
    drive: Array,
    law: Array,
    rolling: float,
    skin: float,
    reach: float,
    pairs: Whole,
    shifts: NDArray[np.int8],
    rows: Whole,
    second: Whole,
    second_rows: Whole,
    memory: Array,
    out: Array,
    walls: Array,
    wall_memory: Array,
    wall_out: Array,
) -> int:
    """Take up to `steps` steps, fewer when the neighbour list is used up; returns how many. All arrays are updated."""
    start = x.copy()
    g = int(drive[0])
    shear = np.array([drive[1], 0.0, drive[0], 0.5 * cell[g, g]])
    other = 1.0
    for c in range(3):
        if c != g and cell[c, c] > 0.0:
            other *= cell[c, c]
    grown = 0.0
    for step in range(steps):
        shear[1] += dt
        farthest = drift(x, v, w, rotations, a, b, start, shear, dt)
        advance_cell(cell, drive, dt)
        grown += dt * (abs(drive[1]) * reach + abs(cell[g, 3 + g]))
        pair_forces(pairs, shifts, x, v, w, grains, cell, law, rolling, dt, memory, out)
        kick(
            x, v, w, a, b, grains, gravity, rows, second, second_rows, out,
            walls, time + (step + 1) * dt, law, rolling, dt, wall_memory, wall_out,
        )  # fmt: skip
        if drive[5] > 0.0:
            drive[6] = normal_stress(g, v, grains, out, other * cell[g, g])
        if 2.0 * farthest + 1.5 * grown > skin:
            return step + 1
    return steps
