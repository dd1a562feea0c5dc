"""A scikit-fem mesh as the arrays of the group `mesh` of a run, and back: vertices, cells, named parts of the boundary."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import skfem

PART = "part:"
_KINDS = {(2, 3): skfem.MeshTri, (2, 4): skfem.MeshQuad, (3, 4): skfem.MeshTet, (3, 8): skfem.MeshHex}
_CORNERS = {(3, 8): [0, 4, 3, 1, 7, 5, 2, 6]}
"""Where scikit-fem's corners stand in the order of XDMF and VTK, which is that of stored cells, if that is another one."""


def mesh_group(mesh: Any) -> dict[str, np.ndarray]:
    """positions (V, d), cells (c, corners), and `part:NAME` (f, d) with the vertices of the facets of each named part."""
    parts = {
        PART + name: np.asarray(mesh.facets[:, facets]).T for name, facets in (mesh.boundaries or {}).items()
    }
    order = np.argsort(_CORNERS.get((len(mesh.p), len(mesh.t)), range(len(mesh.t))))
    return {"positions": mesh.p.T, "cells": mesh.t.T[:, order], **parts}


def mesh_from(group: Mapping[str, np.ndarray]) -> Any:
    """The mesh whose `mesh_group` this is (`Results.mesh`)."""
    positions, cells = group["positions"], group["cells"]
    points, corners = np.ascontiguousarray(positions.T), np.ascontiguousarray(cells.T.astype(np.int64))
    kind = _KINDS[positions.shape[1], cells.shape[1]]
    corners = corners[_CORNERS.get((positions.shape[1], cells.shape[1]), slice(None))]
    mesh = kind(points, corners)
    number = {frozenset(facet): index for index, facet in enumerate(mesh.facets.T.tolist())}
    boundaries = {
        name.removeprefix(PART): np.array(
            [number[frozenset(facet)] for facet in facets.tolist()], dtype=np.int64
        )
        for name, facets in group.items()
        if name.startswith(PART)
    }
    return kind(points, corners, _boundaries=boundaries)
