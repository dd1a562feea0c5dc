"""Mesh of the channel 2.2 x 0.41 with a cylinder of diameter 0.1 at (0.2, 0.2): the benchmark of seed C, Figs. 15-16.

Level 1 has the 130 cells, 156 vertices and 286 sides of Table 5: five rings of 16 cells between the cylinder and a block
at the inflow, then ten columns of five cells. Each level halves the cells of the one before; sides follow the circle.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from barchan.spaces.meshes._cells import everywhere, one_sided_line, plane
from barchan.spaces.meshes._curved import check_level, circle, curved_mesh, nine_nodes, refined
from barchan.spaces.quadratic import QuadraticMesh

LENGTH, WIDTH = 2.2, 0.41
CENTRE, RADIUS = (0.2, 0.2), 0.05

# Cells across the channel, along the wall of the block, of a ring from cylinder to rim, along the channel after it.
_ACROSS, _ALONG, _RINGS, _COLUMNS = 5, 3, 5, 10
_BLOCK = 0.41
# Width of the last column over the first.
_STRETCH = 4.0


def dfg_channel(level: int, kind: str = "quadrilateral") -> QuadraticMesh:
    """The channel of `level` 1..8 (lengths in m): parts inflow, outflow, walls, cylinder.

    Parameters
    ----------
    level : 1 has 130 quadrilaterals; each further level four times as many.
    kind : "quadrilateral" or "triangle" (two of each quadrilateral).

    Raises InputError for another level or kind.
    """
    level = check_level(level, kind)
    rings = _rings()
    index = np.arange(rings.shape[0] * rings.shape[1]).reshape(rings.shape[:2])
    around = np.concatenate([index, index[:, :1]], axis=1)
    columns = _columns()
    first = index[-1, : 2 * _ACROSS + 1]
    later = index.size + np.arange(columns.shape[0] * columns.shape[1]).reshape(columns.shape[:2])
    cells = np.concatenate([nine_nodes(around), nine_nodes(np.vstack([first, later]))])
    points = np.concatenate([rings.reshape(-1, 2), columns.reshape(-1, 2)])
    parts = {
        "inflow": plane(0, 0.0, LENGTH),
        "outflow": plane(0, LENGTH, LENGTH),
        "walls": _on_walls,
        "cylinder": everywhere,
    }
    corners = [(x, y) for x in (0.0, LENGTH) for y in (0.0, WIDTH)]
    coarsest = curved_mesh(points, cells, parts, {"cylinder": circle(CENTRE, RADIUS)}, kind, corners)
    return refined(coarsest, level)


def _on_walls(x: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.asarray(np.minimum(np.abs(x[1]), np.abs(x[1] - WIDTH)) < 1e-9)


def _rings() -> NDArray[np.float64]:
    """(rings, angles, 2) points between the cylinder and the rim of the block, from its lower right corner to the left."""
    rise, run = np.linspace(0.0, 1.0, 2 * _ACROSS + 1)[:-1], np.linspace(0.0, 1.0, 2 * _ALONG + 1)[:-1]
    rim = np.concatenate([
        np.stack([np.full_like(rise, _BLOCK), WIDTH * rise], axis=1),
        np.stack([_BLOCK * (1.0 - run), np.full_like(run, WIDTH)], axis=1),
        np.stack([np.zeros_like(rise), WIDTH * (1.0 - rise)], axis=1),
        np.stack([_BLOCK * run, np.zeros_like(run)], axis=1),
    ])  # fmt: skip
    away = rim - np.array(CENTRE)
    # Between equal angles and straight rays, so that rings meet both the circle and the rim at fair angles.
    seen = np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
    even = 2.0 * np.pi * (np.arange(len(rim)) - _ACROSS) / len(rim)
    angles = 0.5 * (seen + even)
    cylinder = np.array(CENTRE) + RADIUS * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    # Depths between circle and rim grow geometrically, ray by ray: cells stay about as deep as wide.
    growth = np.linalg.norm(away, axis=1) / RADIUS
    step = np.linspace(0.0, 1.0, 2 * _RINGS + 1)[:, None]
    fraction = (growth**step - 1.0) / (growth - 1.0)
    return np.asarray(cylinder + fraction[:, :, None] * (rim - cylinder))


def _columns() -> NDArray[np.float64]:
    """(columns, rows, 2) points after the block."""
    x = one_sided_line(_BLOCK, LENGTH, 2 * _COLUMNS, _STRETCH)[1:]
    y = WIDTH * np.linspace(0.0, 1.0, 2 * _ACROSS + 1)
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=2)
