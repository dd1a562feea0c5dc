"""Mesh of the ring between two concentric circles: the Couette device of seed C, Fig. 17.

Level 1 has 16 x 2 cells with every node where polar coordinates put it, as in Table 14; sides follow the circles.
"""

from __future__ import annotations

import numpy as np

from barchan.errors import InputError
from barchan.spaces.meshes._cells import count, everywhere, number
from barchan.spaces.meshes._curved import check_level, circle, curved_mesh, nine_nodes, refined
from barchan.spaces.quadratic import QuadraticMesh


def annulus(
    level: int,
    inner: float,
    outer: float,
    around: int = 16,
    across: int = 2,
    kind: str = "quadrilateral",
) -> QuadraticMesh:
    """The ring inner <= r <= outer about the origin (lengths in m): parts inner, outer.

    Parameters
    ----------
    level : 1..8; level 1 has around x across quadrilaterals, each further one four times as many.
    inner, outer : radii.
    around, across : cells around and across of level 1; the first begin at angle 0, so that sides lie on y = 0.
    kind : "quadrilateral" or "triangle" (two of each quadrilateral).

    Raises InputError for another level or kind, radii that are not positive and increasing, fewer than 6 cells around.
    """
    level = check_level(level, kind)
    inner, outer = number("mesh.inner", inner), number("mesh.outer", outer)
    if outer <= inner:
        raise InputError("mesh.outer", outer, f"above the inner radius {inner:g}")
    around, across = count("mesh.around", around, 6), count("mesh.across", across)
    angles = 2.0 * np.pi * np.arange(2 * around) / (2 * around)
    radii = np.linspace(inner, outer, 2 * across + 1)
    points = radii[:, None, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    index = np.arange(points.shape[0] * points.shape[1]).reshape(points.shape[:2])
    cells = nine_nodes(np.concatenate([index, index[:, :1]], axis=1))
    between = 0.5 * (inner + outer) * np.cos(np.pi / around)  # of the middles of chords
    parts = {"inner": lambda x: np.hypot(x[0], x[1]) < between, "outer": everywhere}
    curves = {"inner": circle((0.0, 0.0), inner), "outer": circle((0.0, 0.0), outer)}
    return refined(curved_mesh(points.reshape(-1, 2), cells, parts, curves, kind), level)
