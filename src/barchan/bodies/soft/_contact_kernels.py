"""Kernels of contacts: normal law, tangential spring with Coulomb cap, pairs and walls (seed C, 3.2.1 and 3.2.2).

Vectors have three components; in the plane the third one of places and forces is zero, and spins have only that one.

A row of `memory` (7,) is what a contact remembers: the tangential spring (3) [m], the rolling spring (3) [m], and the
stiffness k_t it had [N/m], zero for a contact that is open. A row of `grains` (4,) is the radius, 1 / mass, 1 / moment
(both zero for a grain that is held) and the coefficient of friction.

Each pair, in parallel, writes its own row; then each grain adds up its own rows in a fixed order. So results do not
depend on the number of threads, and what a pair does to its two grains is opposite to the last bit.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

Array = NDArray[np.float64]
Triple = tuple[float, float, float]
MEMORY, OUT = 7, 11


@njit(cache=True)
def normal_law(law: Array, mass: float, radius: float, overlap: float) -> Triple:
    """Elastic force [N], dashpot constant c_n [N s/m] and tangential stiffness k_t [N/m] at an overlap >= 0."""
    if law[0] == 0.0:
        return law[1] * overlap, law[2] * np.sqrt(mass) + law[3] * mass, law[4] * law[1]
    contact_radius = np.sqrt(radius * overlap)
    dashpot = law[2] * np.sqrt(mass * contact_radius) + law[3] * mass * contact_radius
    return law[1] * contact_radius * overlap, dashpot, law[4] * contact_radius


@njit(cache=True)
def normal_energy(law: Array, radius: float, overlap: float) -> float:
    """Elastic energy [J] of the normal spring."""
    if law[0] == 0.0:
        return 0.5 * law[1] * overlap * overlap
    return 0.4 * law[1] * np.sqrt(radius * overlap) * overlap * overlap


@njit(cache=True)
def cross(a: Triple, b: Triple) -> Triple:
    """a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def dot(a: Triple, b: Triple) -> float:
    """a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True)
def turned_spring(spring: Triple, normal: Triple, angle: float, before: float, k: float) -> Triple:
    """The spring carried into the plane across the present `normal`, and by `angle` [rad] around it, with its length kept.

    A contact that stiffens from `before` to `k` keeps its force, one that softens its spring: else a Hertzian contact would
    make energy (Thornton et al., Powder Technology 233, 2013). The projection is that of Luding, Granular Matter 10, 2008.
    """
    length = np.sqrt(dot(spring, spring))
    if length == 0.0:
        return spring
    t = cross(normal, spring)
    sx, sy, sz = spring[0] + angle * t[0], spring[1] + angle * t[1], spring[2] + angle * t[2]
    along = sx * normal[0] + sy * normal[1] + sz * normal[2]
    sx, sy, sz = sx - along * normal[0], sy - along * normal[1], sz - along * normal[2]
    now = np.sqrt(sx * sx + sy * sy + sz * sz)
    keep = length / now if now > 0.0 else 0.0
    if before > 0.0 and k > before:
        keep *= before / k
    return sx * keep, sy * keep, sz * keep


@njit(cache=True)
def capped(
    spring: Triple, velocity: Triple, k: float, c: float, limit: float, dt: float
) -> tuple[Triple, Triple, float]:
    """Spring stretched by `velocity` [m/s] for `dt`, its force -k s - c v cut off at `limit` [N], and the energy lost [J].

    What the cap takes from the force it takes from the spring (seed C, 3.2.2: "the tangential displacement is adjusted").
    """
    vx, vy, vz = velocity
    s = (spring[0] + dt * vx, spring[1] + dt * vy, spring[2] + dt * vz)
    f = (-k * s[0] - c * vx, -k * s[1] - c * vy, -k * s[2] - c * vz)
    size = np.sqrt(dot(f, f))
    dashpot = dt * c * dot(velocity, velocity)
    if size <= limit:
        return s, f, dashpot
    share = limit / size
    f = (f[0] * share, f[1] * share, f[2] * share)
    if k == 0.0:
        return s, f, -dt * dot(f, velocity)
    t = (-(f[0] + c * vx) / k, -(f[1] + c * vy) / k, -(f[2] + c * vz) / k)
    return t, f, dashpot + 0.5 * k * (dot(s, s) - dot(t, t))


@njit(cache=True)
def spring_force(
    memory: Array,
    first: int,
    normal: Triple,
    angle: float,
    velocity: Triple,
    k: float,
    c: float,
    limit: float,
    dt: float,
) -> tuple[Triple, float]:
    """Force [N] of the spring `memory[first : first + 3]` with its dashpot, and energy lost [J]; carries and stretches it.

    `memory[6]` is still the stiffness of the step before.
    """
    before = memory[6]
    old = (memory[first], memory[first + 1], memory[first + 2])
    spring = turned_spring(old, normal, angle, before, k)
    lost = 0.5 * (before * dot(old, old) - k * dot(spring, spring))
    spring, force, slid = capped(spring, velocity, k, c, limit, dt)
    memory[first], memory[first + 1], memory[first + 2] = spring
    return force, lost + slid


@njit(cache=True)
def contact_force(
    law: Array,
    rolling: float,
    friction: float,
    mass: float,
    radius: float,
    overlap: float,
    normal: Triple,
    velocity: Triple,
    arms: tuple[float, float],
    spins: tuple[Triple, Triple],
    memory: Array,
    dt: float,
) -> tuple[Triple, Triple, float, float]:
    """Force on the first body, rolling torque on it, normal force [N] and energy lost over `dt` [J]; updates `memory`.

    `normal` points to the first body, `velocity` is that of its centre relative to the second's, `arms` are the distances
    from the centres to the contact. The spins of a wall are zero.
    """
    elastic, dashpot, k = normal_law(law, mass, radius, overlap)
    approach = -dot(velocity, normal)
    path = abs(approach) * dt
    if overlap < path:
        # touches for a part of this step only, or will of the next one: the dashpot acts with the impulse of that part
        dashpot *= 0.5 + overlap / path
    push = elastic + dashpot * approach
    if law[6] == 0.0 and push < 0.0:
        push = 0.0
    lost = dt * (push - elastic) * approach
    a, b = spins
    turn = (
        arms[0] * a[0] + arms[1] * b[0], arms[0] * a[1] + arms[1] * b[1], arms[0] * a[2] + arms[1] * b[2]
    )  # fmt: skip
    t = cross(turn, normal)
    across = (
        velocity[0] + approach * normal[0] - t[0],
        velocity[1] + approach * normal[1] - t[1],
        velocity[2] + approach * normal[2] - t[2],
    )
    c, angle = law[5] * dashpot, 0.5 * dt * (dot(a, normal) + dot(b, normal))
    limit = max(push, 0.0)
    f, slid = spring_force(memory, 0, normal, angle, across, k, c, friction * limit, dt)
    lost += slid
    force = (f[0] + push * normal[0], f[1] + push * normal[1], f[2] + push * normal[2])
    torque = (0.0, 0.0, 0.0)
    if rolling > 0.0:
        # rolling velocity R* (w_i - w_j) x n (Luding 2008), its quasi-force a torque -R* f x n
        t = cross((radius * (a[0] - b[0]), radius * (a[1] - b[1]), radius * (a[2] - b[2])), normal)
        f, slid = spring_force(memory, 3, normal, angle, t, k, c, rolling * limit, dt)
        lost += slid
        t = cross(normal, f)
        torque = (radius * t[0], radius * t[1], radius * t[2])
    memory[6] = k
    return force, torque, push, lost


@njit(cache=True)
def forget(memory: Array) -> float:
    """Wipe the row of a contact that opens; returns the energy its springs still held [J]."""
    held = 0.0
    for c in range(6):
        held += memory[c] * memory[c]
        memory[c] = 0.0
    held *= 0.5 * memory[6]
    memory[6] = 0.0
    return held


@njit(cache=True, parallel=True)
def pair_forces(
    pairs: NDArray[np.int64],
    shifts: NDArray[np.int8],
    x: Array,
    v: Array,
    w: Array,
    grains: Array,
    cell: Array,
    law: Array,
    rolling: float,
    dt: float,
    memory: Array,
    out: Array,
) -> None:
    """Fill out (k, 11) for pairs (k, 2): force on the first grain (3), rolling torque on it (3), overlap (0 where the pair is
    apart), energy lost so far, and the branch x_i - x_j (3).

    cell (3, 6) : rows are the edges of the periodic cell [m] and, after them, the velocity of its far side [m/s].
    """
    for p in prange(len(pairs)):
        i, j = pairs[p, 0], pairs[p, 1]
        rx, ry, rz = x[i, 0] - x[j, 0], x[i, 1] - x[j, 1], x[i, 2] - x[j, 2]
        s0, s1, s2 = float(shifts[p, 0]), float(shifts[p, 1]), float(shifts[p, 2])
        image = s0 != 0.0 or s1 != 0.0 or s2 != 0.0
        if image:
            rx -= s0 * cell[0, 0] + s1 * cell[1, 0] + s2 * cell[2, 0]
            ry -= s0 * cell[0, 1] + s1 * cell[1, 1] + s2 * cell[2, 1]
            rz -= s0 * cell[0, 2] + s1 * cell[1, 2] + s2 * cell[2, 2]
        square = rx * rx + ry * ry + rz * rz
        reach = grains[i, 0] + grains[j, 0]
        if square >= reach * reach:
            if memory[p, 6] > 0.0:
                out[p, 7] += forget(memory[p])
            if out[p, 6] > 0.0:
                for c in range(7):
                    out[p, c] = 0.0
            continue
        distance = np.sqrt(square)
        normal = (rx / distance, ry / distance, rz / distance)
        vx, vy, vz = v[i, 0] - v[j, 0], v[i, 1] - v[j, 1], v[i, 2] - v[j, 2]
        if image:
            vx -= s0 * cell[0, 3] + s1 * cell[1, 3] + s2 * cell[2, 3]
            vy -= s0 * cell[0, 4] + s1 * cell[1, 4] + s2 * cell[2, 4]
            vz -= s0 * cell[0, 5] + s1 * cell[1, 5] + s2 * cell[2, 5]
        overlap = reach - distance
        half = 0.5 * overlap
        mass = 1.0 / (grains[i, 1] + grains[j, 1])
        radius = grains[i, 0] * grains[j, 0] / reach
        friction = np.sqrt(grains[i, 3] * grains[j, 3])
        arms = (grains[i, 0] - half, grains[j, 0] - half)
        spins = ((w[i, 0], w[i, 1], w[i, 2]), (w[j, 0], w[j, 1], w[j, 2]))
        force, torque, _, lost = contact_force(
            law, rolling, friction, mass, radius, overlap, normal, (vx, vy, vz), arms, spins, memory[p], dt
        )
        for c in range(3):
            out[p, c], out[p, 3 + c] = force[c], torque[c]
        out[p, 6] = overlap
        out[p, 7] += lost
        out[p, 8], out[p, 9], out[p, 10] = rx, ry, rz


@njit(cache=True)
def wall_forces(
    i: int,
    x: Array,
    v: Array,
    w: Array,
    grains: Array,
    walls: Array,
    time: float,
    law: Array,
    rolling: float,
    dt: float,
    memory: Array,
    out: Array,
) -> None:
    """Fill out (walls, 8) for grain i: force on it (3), rolling torque (3), overlap, energy lost so far.

    walls (m, 8) : unit normal out of the solid, offset at time 0, velocity, friction coefficient.
    """
    for k in range(len(walls)):
        normal = (walls[k, 0], walls[k, 1], walls[k, 2])
        speed = (walls[k, 4], walls[k, 5], walls[k, 6])
        gap = dot(normal, (x[i, 0], x[i, 1], x[i, 2])) - walls[k, 3] - time * dot(normal, speed)
        overlap = grains[i, 0] - gap
        if overlap <= 0.0 or grains[i, 1] == 0.0:
            if memory[k, 6] > 0.0:
                out[k, 7] += forget(memory[k])
            if out[k, 6] > 0.0:
                for c in range(7):
                    out[k, c] = 0.0
            continue
        velocity = (v[i, 0] - speed[0], v[i, 1] - speed[1], v[i, 2] - speed[2])
        friction = np.sqrt(grains[i, 3] * walls[k, 7])
        arms = (grains[i, 0] - 0.5 * overlap, 0.0)
        spins = ((w[i, 0], w[i, 1], w[i, 2]), (0.0, 0.0, 0.0))
        force, torque, _, lost = contact_force(
            law, rolling, friction, 1.0 / grains[i, 1], grains[i, 0], overlap,
            normal, velocity, arms, spins, memory[k], dt,
        )  # fmt: skip
        for c in range(3):
            out[k, c], out[k, 3 + c] = force[c], torque[c]
        out[k, 6] = overlap
        out[k, 7] += lost
