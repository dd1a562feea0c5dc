"""Boundaries as flat facets, and the quadrature they give (seed B, 7.4.1 integrates over the boundary of a body).

A facet is a segment (2D) or a triangle (3D); facets (F, d, d) list its d vertices, ordered so that its normal points outward:
the tangent turned by -90 degrees in the plane, the right-hand rule in space. Points at the centroids make the rule exact for
a constant pressure: over a closed surface neither a force nor a torque is left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from barchan.errors import InputError

MOST_FACETS = 5_000_000


@dataclass(frozen=True, eq=False)
class Surface:
    """Quadrature of a boundary.

    points : (m, d) [m].
    normals : (m, d) unit, outward.
    areas : (m,) [m^(d-1)].
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    areas: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.areas)


def facet_vectors(facets: NDArray[np.float64]) -> NDArray[np.float64]:
    """Area times outward normal (F, d) of facets (F, d, d)."""
    edge = facets[:, 1] - facets[:, 0]
    if facets.shape[1] == 2:
        return np.stack([edge[:, 1], -edge[:, 0]], axis=1)
    return 0.5 * np.cross(edge, facets[:, 2] - facets[:, 0])


def quadrature(facets: NDArray[np.float64]) -> Surface:
    """One point a facet, at its centroid; facets without area are left out."""
    vectors = facet_vectors(facets)
    areas = np.linalg.norm(vectors, axis=1)
    size = np.max(np.abs(facets), initial=0.0)
    kept = areas > 1e-14 * max(size, 1e-300) ** (facets.shape[1] - 1)
    areas = areas[kept]
    return Surface(np.mean(facets[kept], axis=1), vectors[kept] / areas[:, None], areas)


def closed(surface: Surface) -> Surface:
    """`surface` of a closed boundary with its areas changed as little as possible so that nothing remains of a pressure.

    Weights a (1 + g . c), g = (n, x ^ n), with c such that sum a g = 0: cut facets leave a small defect, of second order.
    """
    if len(surface) == 0:
        return surface
    centre = np.mean(surface.points, axis=0)
    size = max(float(np.max(np.abs(surface.points - centre))), 1e-300)
    arms = (surface.points - centre) / size
    if surface.points.shape[1] == 2:
        n = surface.normals
        levers = (arms[:, 0] * n[:, 1] - arms[:, 1] * n[:, 0])[:, None]
    else:
        levers = np.cross(arms, surface.normals)
    g = np.concatenate([surface.normals, levers], axis=1)
    areas = surface.areas
    for _ in range(2):  # the second pass removes the rounding of the first
        change = np.linalg.lstsq((g * areas[:, None]).T @ g, -(areas @ g), rcond=1e-9)[0]
        areas = areas * (1.0 + g @ change)
    if np.min(areas) <= 0.0:  # far too coarse a surface for a correction: keep it as it is
        return surface
    return Surface(surface.points, surface.normals, areas)


def bisected(facets: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Facets cut in two across their longest edge until no edge is longer than `spacing`; flat, hence exact."""
    d = facets.shape[1]
    done: list[NDArray[np.float64]] = []
    least = float(np.sum(np.linalg.norm(facet_vectors(facets), axis=1))) / spacing ** (d - 1)
    if least > MOST_FACETS:
        raise InputError("spacing", spacing, f"larger: the surface has more than {MOST_FACETS} facets")
    while len(facets):
        following = np.roll(facets, -1, axis=1) if d == 3 else facets[:, ::-1]
        lengths = np.linalg.norm(following - facets, axis=2)
        longest = np.argmax(lengths, axis=1)
        short = np.max(lengths, axis=1) <= spacing * (1.0 + 1e-12)
        done.append(facets[short])
        long, longest = facets[~short], longest[~short]
        rows = np.arange(len(long))
        ahead = (longest + 1) % d
        middle = 0.5 * (long[rows, longest] + long[rows, ahead])
        first, second = long.copy(), long.copy()
        first[rows, ahead] = middle
        second[rows, longest] = middle
        facets = np.concatenate([first, second])
    return np.concatenate(done) if done else facets


def clipped(facets: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The parts of facets where a function is positive, linear on each facet, `values` (F, d) at the vertices."""
    d = facets.shape[1]
    above = values > 0.0
    number = np.sum(above, axis=1)
    kept = [facets[number == d]]
    # one vertex above: turn it to the front and shorten the edges that leave it
    few = number == 1
    corner = np.argmax(above[few], axis=1)
    f, v = _turned(facets[few], corner), _turned(values[few], corner)
    kept.append(np.stack([f[:, 0]] + [_crossing(f, v, 0, k) for k in range(1, d)], axis=1))
    if d == 3:
        many = number == 2
        corner = np.argmin(above[many], axis=1)
        f, v = _turned(facets[many], corner), _turned(values[many], corner)
        after, before = _crossing(f, v, 0, 1), _crossing(f, v, 0, 2)
        kept.append(np.stack([after, f[:, 1], f[:, 2]], axis=1))
        kept.append(np.stack([after, f[:, 2], before], axis=1))
        return np.concatenate(kept)
    # a segment whose second vertex came to the front runs backwards: turn it round
    kept[1][corner == 1] = kept[1][corner == 1][:, ::-1]
    return np.concatenate(kept)


def clipped_to_box(
    facets: NDArray[np.float64], lower: NDArray[np.float64], upper: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The parts of facets inside a box, exactly; infinite bounds do not cut."""
    for axis in range(facets.shape[1]):
        if np.isfinite(lower[axis]):
            facets = clipped(facets, facets[:, :, axis] - lower[axis])
        if np.isfinite(upper[axis]):
            facets = clipped(facets, upper[axis] - facets[:, :, axis])
    return facets


def coarsened(surface: Surface, spacing: float) -> Surface:
    """A surface with the points of a cell of size `spacing / 2` that face about the same way put together."""
    points, vectors = surface.points, surface.normals * surface.areas[:, None]
    d = points.shape[1]
    facing = np.argmax(np.abs(surface.normals), axis=1)
    side = 2 * facing + (surface.normals[np.arange(len(facing)), facing] > 0.0)
    cells = np.floor((points - np.min(points, axis=0)) / (0.5 * spacing)).astype(np.int64)
    _, group = np.unique(np.column_stack([cells, side]), axis=0, return_inverse=True)
    group = group.reshape(-1)
    count = int(group.max()) + 1 if len(group) else 0
    weights = np.bincount(group, surface.areas, count)

    def sums(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack([np.bincount(group, values[:, k], count) for k in range(d)], axis=1)

    total = sums(vectors)
    areas = np.linalg.norm(total, axis=1)
    return Surface(sums(points * surface.areas[:, None]) / weights[:, None], total / areas[:, None], areas)


def enclosed_moments(
    facets: NDArray[np.float64],
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Volume, centre (d,) and second moments T (d, d) about the centre of what closed facets enclose: exact.

    Sums over the simplices from one point to each facet: int x x^T = V (sum_i x_i x_i^T + s s^T) / ((d + 1)(d + 2)).
    """
    d = facets.shape[1]
    origin = 0.5 * (np.min(facets, axis=(0, 1)) + np.max(facets, axis=(0, 1))) if len(facets) else np.zeros(d)
    x = facets - origin
    volumes = np.einsum("fi,fi->f", np.mean(x, axis=1), facet_vectors(x)) / d
    volume = float(np.sum(volumes))
    if not volume > 0.0:
        return 0.0, origin, np.zeros((d, d))
    sums = np.sum(x, axis=1)
    centre = volumes @ sums / (d + 1) / volume
    second = np.einsum("f,fki,fkj->ij", volumes, x, x) + np.einsum("f,fi,fj->ij", volumes, sums, sums)
    second = second / ((d + 1) * (d + 2)) - volume * np.outer(centre, centre)
    return volume, origin + centre, second


def inertia_of(second_moments: NDArray[np.float64]) -> NDArray[np.float64]:
    """Inertia Tr(T) I - T (3, 3) in space, (1, 1) polar moment Tr(T) in the plane (seed B, 2.1.1)."""
    trace = np.trace(second_moments)
    if len(second_moments) == 2:
        return np.array([[trace]])
    inertia: NDArray[np.float64] = trace * np.eye(3) - second_moments
    return inertia


def _turned(rows: NDArray[np.float64], first: NDArray[np.int64]) -> NDArray[np.float64]:
    d = rows.shape[1]
    return rows[np.arange(len(rows))[:, None], (first[:, None] + np.arange(d)) % d]


def _crossing(
    facets: NDArray[np.float64], values: NDArray[np.float64], i: int, k: int
) -> NDArray[np.float64]:
    share = values[:, i] / (values[:, i] - values[:, k])
    return facets[:, i] + share[:, None] * (facets[:, k] - facets[:, i])
