"""Meshes whose cells have curved sides: nine-node quadrilaterals and six-node triangles, refined towards given curves.

A cell is the image of the reference cell under its own quadratic shapes (isoparametric). Refinement takes the nodes of a cell
as the vertices of its four children and puts boundary nodes back on their curves: the domain converges to the true one at order
four (seed C 4.2 keeps straight sides).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import skfem

from barchan.errors import InputError
from barchan.spaces.elements import Shapes

Curve: TypeAlias = Callable[[np.ndarray], np.ndarray]
"""Points (n, 2) to the nearest points (n, 2) of a curve."""

QUADRILATERAL_OFFSETS = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
"""(4, 2) lower corner of each child in half reference cells."""

_CHILD_CORNERS = {
    9: ((0, 4, 8, 7), (4, 1, 5, 8), (8, 5, 2, 6), (7, 8, 6, 3)),
    6: ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
}
_SHAPES = {
    9: Shapes(skfem.ElementQuad2(), 2),
    6: Shapes(skfem.ElementTriP2(), 2),
}
_REFERENCE = {count: np.asarray(shapes.element.doflocs, dtype=float) for count, shapes in _SHAPES.items()}


@dataclass(frozen=True, eq=False)
class QuadraticMesh:
    """Cells with curved sides on the skeleton of a straight mesh.

    skeleton : scikit-fem MeshQuad or MeshTri: vertices, cells, named parts of the boundary.
    nodes : (N, 2) positions: the vertices, the middles of `skeleton.facets` in order, the centres of quadrilaterals.
    curves : what the named parts of the boundary follow; the others are straight between the nodes given.
    """

    skeleton: Any
    nodes: np.ndarray
    curves: Mapping[str, Curve] = field(default_factory=dict)

    @classmethod
    def of(
        cls, mesh: Any, curves: Mapping[str, Curve] | None = None, nodes: np.ndarray | None = None
    ) -> QuadraticMesh:
        """The straight `mesh` with the sides of its named parts bent to their curves.

        nodes : (N, 2) positions of all nodes; halfway between the vertices when None.

        Raises InputError for a mesh of other cells, or a curve of a part that does not exist.
        """
        if not isinstance(mesh, skfem.MeshQuad | skfem.MeshTri) or mesh.p.shape[0] != 2:
            raise InputError(
                "mesh",
                type(mesh).__name__,
                "a plane mesh of quadrilaterals (MeshQuad) or triangles (MeshTri)",
            )
        if nodes is None:
            middles = [mesh.p.T, np.mean(mesh.p[:, mesh.facets], axis=1).T]
            if isinstance(mesh, skfem.MeshQuad):
                middles.append(np.mean(mesh.p[:, mesh.t], axis=1).T)
            nodes = np.concatenate(middles)
        curves = dict(curves or {})
        for name in curves:
            if name not in (mesh.boundaries or {}):
                raise InputError("curves", name, "one of the parts " + ", ".join(mesh.boundaries or {}))
        return _snapped(cls(mesh, np.array(nodes, dtype=float), curves))

    @property
    def quadrilateral(self) -> bool:
        """Whether the cells are quadrilaterals."""
        return isinstance(self.skeleton, skfem.MeshQuad)

    @property
    def shapes(self) -> Shapes:
        """The quadratic shapes of a cell."""
        return _SHAPES[9 if self.quadrilateral else 6]

    @cached_property
    def cell_nodes(self) -> np.ndarray:
        """(C, 9) or (C, 6) nodes of each cell: corners, middles of its sides as in `skeleton.t2f`, centre."""
        vertices, facets = self.skeleton.p.shape[1], self.skeleton.facets.shape[1]
        rows = [self.skeleton.t, vertices + self.skeleton.t2f]
        if self.quadrilateral:
            rows.append(vertices + facets + np.arange(self.skeleton.t.shape[1])[None])
        return np.ascontiguousarray(np.vstack(rows).T.astype(np.int32))

    @property
    def boundaries(self) -> Mapping[str, np.ndarray]:
        """Facets of each named part."""
        return self.skeleton.boundaries or {}

    def part_nodes(self, name: str) -> np.ndarray:
        """Sorted numbers of the nodes on a named part. Raises InputError for an unknown name."""
        if name not in self.boundaries:
            raise InputError("boundary", name, "one of " + ", ".join(self.boundaries))
        facets = np.asarray(self.boundaries[name])
        vertices = self.skeleton.p.shape[1]
        return np.unique(np.concatenate([self.skeleton.facets[:, facets].ravel(), vertices + facets]))

    def refined(self) -> QuadraticMesh:
        """Four children for each cell, child j of cell K being cell 4 K + j; the vertices are the nodes of this mesh."""
        count = self.cell_nodes.shape[1]
        children = np.array(_CHILD_CORNERS[count])
        corners = self.cell_nodes[:, children].reshape(-1, children.shape[1])
        kind = skfem.MeshQuad if self.quadrilateral else skfem.MeshTri
        skeleton = kind(np.ascontiguousarray(self.nodes.T), np.ascontiguousarray(corners.T.astype(np.int64)))
        skeleton = kind(skeleton.doflocs, skeleton.t, _boundaries=self._child_parts(skeleton))
        fine = QuadraticMesh(skeleton, np.zeros((0, 2)), self.curves)
        return _snapped(
            QuadraticMesh(skeleton, self._child_nodes(fine.cell_nodes), self.curves), halving=True
        )

    def _child_parts(self, skeleton: Any) -> dict[str, np.ndarray]:
        """The facets of the refined skeleton on each part."""
        vertices = self.skeleton.p.shape[1]
        total = np.int64(skeleton.p.shape[1])
        keys = skeleton.facets[0].astype(np.int64) * total + skeleton.facets[1]
        order = np.argsort(keys)
        parts = {}
        for name, facets in self.boundaries.items():
            facets = np.asarray(facets)
            ends, middle = self.skeleton.facets[:, facets].astype(np.int64), vertices + facets
            wanted = np.concatenate([ends[0] * total + middle, ends[1] * total + middle])
            parts[name] = np.sort(order[np.searchsorted(keys, wanted, sorter=order)])
        return parts

    def _child_nodes(self, cell_nodes: np.ndarray) -> np.ndarray:
        """Positions of the nodes of the children: the parent's map at their reference places."""
        count = cell_nodes.shape[1]
        reference, parents = _REFERENCE[count], self.nodes[self.cell_nodes]
        children = np.array(_CHILD_CORNERS[count])
        nodes = np.empty((int(cell_nodes.max()) + 1, 2))
        for j, corners in enumerate(children):
            child_cells = cell_nodes[j::4]
            # scikit-fem sorts the corners of triangles: the places of a child's nodes follow from its own corners.
            if count == 9:
                places = reference[corners[:1]] + 0.5 * (reference - reference[:1])
                nodes[child_cells] = np.einsum("ai,cid->cad", self.shapes.values(places.T).T, parents)
                continue
            flat = self.cell_nodes[:, corners]
            for a in range(3):
                for b in range(a + 1, 3):
                    middle = 0.5 * (reference[corners[a]] + reference[corners[b]])
                    value = np.einsum("i,cid->cd", self.shapes.values(middle[:, None])[:, 0], parents)
                    pair = np.sort(flat[:, [a, b]], axis=1)
                    for side, (first, second) in enumerate(((0, 1), (1, 2), (0, 2))):
                        own = np.sort(child_cells[:, [first, second]], axis=1)
                        same = np.all(own == pair, axis=1)
                        nodes[child_cells[same, 3 + side]] = value[same]
        nodes[: len(self.nodes)] = self.nodes
        return nodes

    def split_at_centres(self) -> QuadraticMesh:
        """Each triangle cut in three at its centre: the split on which P2/P1d is a stable pair.

        Raises InputError for quadrilaterals.
        """
        if self.quadrilateral:
            raise InputError("mesh", "quadrilaterals", "triangles, to be split at their centres")
        vertices = self.skeleton.p.shape[1]
        place = np.full((2, 1), 1.0 / 3.0)
        weights = self.shapes.values(place)[:, 0]
        centres = np.einsum("i,cid->cd", weights, self.nodes[self.cell_nodes])
        numbers = vertices + np.arange(len(centres))
        t = self.skeleton.t
        cells = np.hstack([np.stack([t[a], t[b], numbers]) for a, b in ((0, 1), (1, 2), (0, 2))])
        points = np.hstack([self.skeleton.p, centres.T])
        skeleton = skfem.MeshTri(np.ascontiguousarray(points), np.ascontiguousarray(cells))
        total = np.int64(points.shape[1])
        keys = skeleton.facets[0].astype(np.int64) * total + skeleton.facets[1]
        order = np.argsort(keys)
        old = self.skeleton.facets.astype(np.int64)
        kept = order[np.searchsorted(keys, old[0] * total + old[1], sorter=order)]
        parts = {name: np.sort(kept[facets]) for name, facets in self.boundaries.items()}
        skeleton = skfem.MeshTri(skeleton.doflocs, skeleton.t, _boundaries=parts)
        nodes = np.concatenate([skeleton.p.T, np.mean(skeleton.p[:, skeleton.facets], axis=1).T])
        nodes[skeleton.p.shape[1] + kept] = self.nodes[vertices : vertices + old.shape[1]]
        # The new sides follow the map of the triangle they cut: its parts are then as sound as it is.
        for a, corner in enumerate(_REFERENCE[6][:3]):
            middle = self.shapes.values(0.5 * (corner[:, None] + place))[:, 0]
            side = order[np.searchsorted(keys, t[a].astype(np.int64) * total + numbers, sorter=order)]
            nodes[skeleton.p.shape[1] + side] = np.einsum("i,cid->cd", middle, self.nodes[self.cell_nodes])
        return QuadraticMesh(skeleton, nodes, self.curves)


def _snapped(mesh: QuadraticMesh, halving: bool = False) -> QuadraticMesh:
    """The mesh with the nodes of its curved parts on their curves.

    halving : middles of curved sides go to the middles of their arcs; normals at the nodes then converge with order three,
        where a middle off the middle leaves them with order one or two.
    """
    for name, curve in mesh.curves.items():
        on = mesh.part_nodes(name)
        mesh.nodes[on] = curve(mesh.nodes[on])
        if halving:
            facets = np.asarray(mesh.boundaries[name])
            chords = np.mean(mesh.nodes[mesh.skeleton.facets[:, facets]], axis=0)
            mesh.nodes[mesh.skeleton.p.shape[1] + facets] = curve(chords)
    # A new array of points, never the vertices of the coarser mesh.
    points = mesh.nodes[: mesh.skeleton.p.shape[1]].T
    kind = skfem.MeshQuad if mesh.quadrilateral else skfem.MeshTri
    skeleton = kind(np.ascontiguousarray(points), mesh.skeleton.t, _boundaries=mesh.skeleton._boundaries)
    return QuadraticMesh(skeleton, mesh.nodes, mesh.curves)


def refinements(coarsest: QuadraticMesh, levels: int) -> list[QuadraticMesh]:
    """`levels` meshes, `coarsest` first, each the refinement of the one before."""
    meshes = [coarsest]
    for _ in range(levels - 1):
        meshes.append(meshes[-1].refined())
    return meshes
