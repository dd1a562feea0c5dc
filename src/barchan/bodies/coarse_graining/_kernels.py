"""Kernels of coarse graining: weights, exact integrals along branches, and sums at points (seed C, 3.3.1).

Places are padded to three components, those of the axes that are resolved first. `numbers` (4,) of a coarse-graining
function are its kind (0 Lucy, 1 Gaussian, 2 Heaviside), reach c, norm and width. Each point or grain writes its own
row: no race, any thread count.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

Array = NDArray[np.float64]
Whole = NDArray[np.int64]


@njit(cache=True)
def weight(numbers: Array, r: float) -> float:
    """W(r)."""
    c = numbers[1]
    if r >= c:
        return 0.0
    if numbers[0] == 0.0:
        q = r / c
        return numbers[2] * (1.0 + 3.0 * q) * (1.0 - q) ** 3
    if numbers[0] == 1.0:
        return numbers[2] * math.exp(-0.5 * (r / numbers[3]) ** 2)
    return numbers[2]


@njit(cache=True)
def slope(numbers: Array, r: float) -> float:
    """W'(r) / r, without the jumps at the reach."""
    c = numbers[1]
    if r >= c or numbers[0] == 2.0:
        return 0.0
    if numbers[0] == 0.0:
        return -12.0 * numbers[2] * (1.0 - r / c) ** 2 / (c * c)
    return -numbers[2] * math.exp(-0.5 * (r / numbers[3]) ** 2) / numbers[3] ** 2


@njit(cache=True)
def _primitive(numbers: Array, a: float, t: float) -> float:
    """Integral from 0 to t of W(sqrt(a^2 + t^2)) dt, over the norm, for Lucy: 1 - 6 q^2 + 8 q^3 - 3 q^4."""
    c = numbers[1]
    a, t = a / c, t / c
    s = math.sqrt(a * a + t * t)
    square = t * (t * t / 3.0 + a * a)
    fourth = t * (t**4 / 5.0 + 2.0 * a * a * t * t / 3.0 + a**4)
    cube = 0.125 * t * s * (2.0 * t * t + 5.0 * a * a)
    if a > 0.0:
        cube += 0.375 * a**4 * math.asinh(t / a)
    return c * (t - 6.0 * square + 8.0 * cube - 3.0 * fourth)


@njit(cache=True)
def along(numbers: Array, px: float, py: float, pz: float, bx: float, by: float, bz: float) -> float:
    """Integral over s in 0..1 of W(p + s b), exactly."""
    length = math.sqrt(bx * bx + by * by + bz * bz)
    c = numbers[1]
    if length < 1e-7 * c:
        return weight(numbers, math.sqrt((px + 0.5 * bx) ** 2 + (py + 0.5 * by) ** 2 + (pz + 0.5 * bz) ** 2))
    first = (px * bx + py * by + pz * bz) / length
    # distance from the line, by the cross product: the difference of squares would round
    ox, oy, oz = py * bz - pz * by, pz * bx - px * bz, px * by - py * bx
    a = math.sqrt(ox * ox + oy * oy + oz * oz) / length
    if a >= c:
        return 0.0
    half = math.sqrt(c * c - a * a)
    low, high = max(first, -half), min(first + length, half)
    if high <= low:
        return 0.0
    if numbers[0] == 0.0:
        return numbers[2] / length * (_primitive(numbers, a, high) - _primitive(numbers, a, low))
    if numbers[0] == 1.0:
        w = numbers[3] * math.sqrt(2.0)
        part = math.erf(high / w) - math.erf(low / w)
        return numbers[2] / length * 0.5 * math.sqrt(math.pi) * w * math.exp(-((a / w) ** 2)) * part
    return numbers[2] / length * (high - low)


@njit(cache=True)
def bins(places: Array, lower: Array, size: float, counts: Whole) -> tuple[Whole, Whole]:
    """Rows of `places` (n, 3) in the order of their bins, and where each bin starts."""
    n = len(places)
    starts = np.zeros(counts[0] * counts[1] * counts[2] + 1, dtype=np.int64)
    home = np.empty(n, dtype=np.int64)
    for i in range(n):
        c = 0
        for k in range(3):
            c = c * counts[k] + min(max(int((places[i, k] - lower[k]) / size), 0), counts[k] - 1)
        home[i] = c
        starts[c + 1] += 1
    for c in range(1, len(starts)):
        starts[c] += starts[c - 1]
    filled = starts[:-1].copy()
    order = np.empty(n, dtype=np.int64)
    for i in range(n):
        order[filled[home[i]]] = i
        filled[home[i]] += 1
    return order, starts


@njit(cache=True)
def _range(place: float, reach: float, low: float, size: float, count: int) -> tuple[int, int]:
    """Bins that overlap place -+ reach, the last excluded."""
    first = min(max(math.floor((place - reach - low) / size), 0), count - 1)
    last = min(max(math.floor((place + reach - low) / size), 0), count - 1)
    return first, last + 1


@njit(cache=True, parallel=True)
def total_weights(
    points: Array,
    order: Whole,
    starts: Whole,
    lower: Array,
    size: float,
    counts: Whole,
    places: Array,
    branches: Array,
    numbers: Array,
    totals: Array,
) -> None:
    """totals (k,) : sum over points (q, 3) of the weight of each branch (k, 3) that ends at places (k, 3)."""
    for i in prange(len(places)):
        far = numbers[1] * (1.0 + 1e-12)
        x0, x1 = _range(
            places[i, 0] - 0.5 * branches[i, 0], far + 0.5 * abs(branches[i, 0]), lower[0], size, counts[0]
        )
        y0, y1 = _range(
            places[i, 1] - 0.5 * branches[i, 1], far + 0.5 * abs(branches[i, 1]), lower[1], size, counts[1]
        )
        z0, z1 = _range(
            places[i, 2] - 0.5 * branches[i, 2], far + 0.5 * abs(branches[i, 2]), lower[2], size, counts[2]
        )
        total = 0.0
        for a in range(x0, x1):
            for b in range(y0, y1):
                for c in range(z0, z1):
                    cell = (a * counts[1] + b) * counts[2] + c
                    for k in range(starts[cell], starts[cell + 1]):
                        q = order[k]
                        total += along(
                            numbers, points[q, 0] - places[i, 0], points[q, 1] - places[i, 1],
                            points[q, 2] - places[i, 2], branches[i, 0], branches[i, 1], branches[i, 2],
                        )  # fmt: skip
        totals[i] = total


@njit(cache=True, parallel=True)
def grain_sums(
    points: Array,
    order: Whole,
    starts: Whole,
    lower: Array,
    size: float,
    counts: Whole,
    places: Array,
    velocities: Array,
    masses: Array,
    volumes: Array,
    scales: Array,
    numbers: Array,
    out: Array,
) -> None:
    """out (q, 26) : volume fraction, density, momentum (3), m v v (9), gradient of density (3) and of momentum (9)."""
    for q in prange(len(points)):
        x0, x1 = _range(points[q, 0], numbers[1], lower[0], size, counts[0])
        y0, y1 = _range(points[q, 1], numbers[1], lower[1], size, counts[1])
        z0, z1 = _range(points[q, 2], numbers[1], lower[2], size, counts[2])
        for a in range(x0, x1):
            for b in range(y0, y1):
                for c in range(z0, z1):
                    cell = (a * counts[1] + b) * counts[2] + c
                    for k in range(starts[cell], starts[cell + 1]):
                        i = order[k]
                        dx, dy, dz = (
                            points[q, 0] - places[i, 0],
                            points[q, 1] - places[i, 1],
                            points[q, 2] - places[i, 2],
                        )
                        r = math.sqrt(dx * dx + dy * dy + dz * dz)
                        if r >= numbers[1]:
                            continue
                        w = weight(numbers, r) * scales[i]
                        g = slope(numbers, r) * scales[i] * masses[i]
                        m = masses[i] * w
                        out[q, 0] += volumes[i] * w
                        out[q, 1] += m
                        away = (dx, dy, dz)
                        for s in range(3):
                            out[q, 2 + s] += m * velocities[i, s]
                            out[q, 14 + s] += g * away[s]
                            for t in range(3):
                                out[q, 5 + 3 * s + t] += m * velocities[i, s] * velocities[i, t]
                                out[q, 17 + 3 * s + t] += g * velocities[i, s] * away[t]


@njit(cache=True, parallel=True)
def branch_sums(
    points: Array,
    order: Whole,
    starts: Whole,
    lower: Array,
    size: float,
    counts: Whole,
    middles: Array,
    branches: Array,
    vectors: Array,
    scales: Array,
    longest: float,
    numbers: Array,
    out: Array,
) -> None:
    """out (q, 18) : contact stress (9) and fabric (9); the rows of `vectors` (k, 10) are force, branch, normal and volume."""
    for q in prange(len(points)):
        reach = numbers[1] + 0.5 * longest
        x0, x1 = _range(points[q, 0], reach, lower[0], size, counts[0])
        y0, y1 = _range(points[q, 1], reach, lower[1], size, counts[1])
        z0, z1 = _range(points[q, 2], reach, lower[2], size, counts[2])
        for a in range(x0, x1):
            for b in range(y0, y1):
                for c in range(z0, z1):
                    cell = (a * counts[1] + b) * counts[2] + c
                    for k in range(starts[cell], starts[cell + 1]):
                        i = order[k]
                        bx, by, bz = branches[i, 0], branches[i, 1], branches[i, 2]
                        w = along(
                            numbers,
                            points[q, 0] - middles[i, 0] - 0.5 * bx,
                            points[q, 1] - middles[i, 1] - 0.5 * by,
                            points[q, 2] - middles[i, 2] - 0.5 * bz,
                            bx, by, bz,
                        )  # fmt: skip
                        if w == 0.0:
                            continue
                        w *= scales[i]
                        for s in range(3):
                            for t in range(3):
                                out[q, 3 * s + t] += w * vectors[i, s] * vectors[i, 3 + t]
                                out[q, 9 + 3 * s + t] += (
                                    w * vectors[i, 9] * vectors[i, 6 + s] * vectors[i, 6 + t]
                                )
