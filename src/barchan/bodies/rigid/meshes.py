"""Closed triangle meshes as shapes: exact moments, and a signed distance tabulated once in the frame of the body."""

from __future__ import annotations

from pathlib import Path

import igl
import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.rigid import inputs
from barchan.bodies.rigid._kernels import table_distances
from barchan.bodies.rigid.shape import Shape, unit_or_vertical
from barchan.bodies.rigid.surfaces import (
    Surface,
    bisected,
    closed,
    coarsened,
    enclosed_moments,
    inertia_of,
    quadrature,
)
from barchan.errors import InputError

Vector = NDArray[np.float64]
DEFAULT_CELLS = 64  # of the table of distances, along the longest side of the mesh
MOST_CELLS = 400
WORST_VOLUME_ERROR = 0.3  # of what the table shows of a mesh
MARGIN = 2  # cells of the table beyond the mesh
MESH_FORMATS = (".obj", ".off", ".ply", ".stl")


class TriangleMesh(Shape):
    """The solid enclosed by triangles.

    Parameters
    ----------
    vertices : (v, 3) [m].
    faces : (f, 3) numbers of vertices, counter-clockwise seen from outside; a mesh turned inside out is turned back.
    resolution : cell [m] of the table that holds the signed distance; what is thinner is lost. Default: extent / 64.

    The distance is interpolated between nodes of the table, exact up to resolution^2 times a curvature. Beyond the table it is
    a lower bound that tends to the distance. InputError: open, inconsistent, empty or overlapping itself.
    """

    def __init__(self, vertices: ArrayLike, faces: ArrayLike, resolution: float | None = None) -> None:
        points = inputs.table("vertices", vertices, (3,), 4)
        triangles = np.asarray(faces)
        if triangles.ndim != 2 or triangles.shape[1] != 3 or not np.issubdtype(triangles.dtype, np.integer):
            raise InputError("faces", triangles.shape, "an integer array of shape (f, 3)")
        if len(triangles) == 0 or triangles.min() < 0 or triangles.max() >= len(points):
            raise InputError("faces", triangles.shape, f"numbers of the {len(points)} vertices")
        self.vertices, self.faces = _closed_mesh(points, triangles.astype(np.int64))
        self._moments = enclosed_moments(self.vertices[self.faces])
        if not self._moments[0] > 0.0:
            raise InputError("faces", triangles.shape, "a mesh that encloses a volume")
        longest = float(np.max(np.ptp(self.vertices, axis=0)))
        self.resolution = (
            longest / DEFAULT_CELLS if resolution is None else inputs.positive("resolution", resolution)
        )
        if longest / self.resolution > MOST_CELLS:
            raise InputError(
                "resolution", resolution, f"at least {longest / MOST_CELLS:.3g}: 1/{MOST_CELLS} of the mesh"
            )
        self._table: Vector | None = None
        self._origin = np.min(self.vertices, axis=0) - MARGIN * self.resolution

    @classmethod
    def from_file(cls, path: str | Path, scale: float = 1.0, resolution: float | None = None) -> TriangleMesh:
        """Mesh of an STL, OBJ, PLY or OFF file, its coordinates times `scale`; InputError when it cannot be read."""
        import trimesh  # half a second to load, for those who have a mesh

        file = Path(path)
        inputs.positive("scale", scale)
        if file.suffix.lower() not in MESH_FORMATS:
            raise InputError("mesh", str(path), f"a file that ends in {', '.join(MESH_FORMATS)}")
        if not file.is_file():
            raise InputError("mesh", str(path), "a file that exists")
        try:
            loaded = trimesh.load_mesh(file, process=False)
        except (ValueError, IndexError, KeyError, TypeError, OSError) as error:
            raise InputError("mesh", str(path), f"a readable mesh ({error})") from None
        if not isinstance(loaded, trimesh.Trimesh) or len(loaded.faces) == 0:
            raise InputError("mesh", str(path), "a mesh with triangles")
        return cls(scale * np.asarray(loaded.vertices), np.asarray(loaded.faces), resolution)

    def write(self, path: str | Path) -> None:
        """Write the mesh as STL, OBJ, PLY or OFF, as the name says."""
        import trimesh

        if Path(path).suffix.lower() not in MESH_FORMATS:
            raise InputError("mesh", str(path), f"a file that ends in {', '.join(MESH_FORMATS)}")
        trimesh.Trimesh(self.vertices, self.faces, process=False).export(path)

    @property
    def dimension(self) -> int:
        return 3

    def signed_distance(self, points: Vector) -> Vector:
        return self._interpolated(points)[0]

    def normals(self, points: Vector) -> Vector:
        return unit_or_vertical(self._interpolated(points)[1])

    def _interpolated(self, points: Vector) -> tuple[Vector, Vector]:
        x = inputs.points(points, 3)
        if self._table is None:
            self._table = self._tabulated()
        distance, gradient = np.empty(len(x)), np.empty_like(x)
        table_distances(x, self._table, self._origin, self.resolution, distance, gradient)
        return distance, gradient

    def _tabulated(self) -> Vector:
        """Signed distances at the nodes of the table, exact; the sign is that of the winding number."""
        extent = np.ptp(self.vertices, axis=0)
        count = np.ceil(extent / self.resolution).astype(np.int64) + 2 * MARGIN + 1
        shape = (int(count[0]), int(count[1]), int(count[2]))
        ticks = np.meshgrid(*(np.arange(n) for n in shape), indexing="ij")
        nodes = np.stack(ticks, axis=-1).reshape(-1, 3) * self.resolution + self._origin
        squares = igl.point_mesh_squared_distance(nodes, self.vertices, self.faces)[0]
        winding = igl.fast_winding_number(self.vertices, self.faces, nodes)
        if np.max(winding) > 1.5 or np.min(winding) < -0.5:
            raise InputError("mesh", f"{len(self.faces)} triangles", "a mesh that does not overlap itself")
        distances = np.where(winding > 0.5, -1.0, 1.0) * np.sqrt(np.asarray(squares))
        # the volume that a table shows tells whether it has lost what is thin
        shown = float(np.sum(np.clip(0.5 - distances / self.resolution, 0.0, 1.0))) * self.resolution**3
        share = shown / self._moments[0]
        if abs(share - 1.0) > WORST_VOLUME_ERROR:
            raise InputError(
                "resolution", self.resolution, f"finer: its table shows {share:.2f} of the volume"
            )
        return np.ascontiguousarray(distances.reshape(shape))

    def bounds(self) -> tuple[Vector, Vector]:
        return np.min(self.vertices, axis=0), np.max(self.vertices, axis=0)

    def facets(self, spacing: float, lower: Vector, upper: Vector) -> Vector:
        return bisected(self.vertices[self.faces], spacing)

    def quadrature_of(self, facets: Vector, spacing: float, cut: bool) -> Surface:
        """Triangles much finer than `spacing` are put together."""
        surface = quadrature(facets)
        if len(surface) <= 12.0 * float(np.sum(surface.areas)) / spacing**2:
            return surface
        coarse = coarsened(surface, spacing)
        return coarse if cut else closed(coarse)

    def volume_properties(self) -> tuple[float, Vector, Vector]:
        volume, centre, second = self._moments
        return volume, centre.copy(), inertia_of(second)


def sample_mesh(length: float = 1.0, cells: int = 48) -> TriangleMesh:
    """A curled-up sleeping animal, `length` [m] long: a level of a sum of soft balls, by marching cubes on about `cells` cells.

    Lies on z = 0 with its middle above the origin.
    """
    inputs.positive("length", length)
    if not 16 <= cells <= MOST_CELLS:
        raise InputError("cells", cells, f"between 16 and {MOST_CELLS}")
    turn = np.linspace(0.0, 1.45 * np.pi, 12)  # back and tail, curled round
    spine = np.stack([0.30 * np.cos(turn), 0.24 * np.sin(turn), 0.0 * turn], axis=1)
    thickness = np.interp(turn, [0.0, 1.5, 3.0, turn[-1]], [0.15, 0.21, 0.17, 0.07])
    head = np.array([[0.27, -0.10, 0.06], [0.20, -0.20, 0.04], [0.36, -0.08, 0.17], [0.25, -0.03, 0.19]])
    balls = np.concatenate([spine, head])
    radii = np.concatenate([thickness, [0.15, 0.09, 0.055, 0.055]])
    step = 1.3 / cells
    axes = [np.arange(low, high + step, step) for low, high in ((-0.65, 0.65), (-0.6, 0.6), (-0.35, 0.4))]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    field = np.full(grid.shape[:3], -1.0)
    for ball, radius in zip(balls, radii, strict=True):
        field += np.exp(1.2 - 1.2 * np.sum((grid - ball) ** 2, axis=3) / radius**2)
    shape = field.shape
    # the library wants x to run fastest
    nodes = np.ascontiguousarray(grid.transpose(2, 1, 0, 3).reshape(-1, 3))
    values = np.ascontiguousarray(field.transpose(2, 1, 0).reshape(-1))
    vertices, faces = igl.marching_cubes(values, nodes, *shape, 0.0)[:2]
    vertices = np.asarray(vertices) * (length / float(np.max(np.ptp(vertices, axis=0))))
    middle = 0.5 * (np.min(vertices, axis=0) + np.max(vertices, axis=0))
    vertices -= [middle[0], middle[1], np.min(vertices[:, 2])]
    return TriangleMesh(vertices, np.asarray(faces, dtype=np.int64))


def _closed_mesh(points: Vector, triangles: NDArray[np.int64]) -> tuple[Vector, NDArray[np.int64]]:
    """Vertices put together, flat triangles left out, all triangles facing out; InputError when the mesh is open."""
    import trimesh

    mesh = trimesh.Trimesh(points, triangles, process=False)
    mesh.merge_vertices()
    vertices, faces = np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64)
    repeated = (faces[:, 0] == faces[:, 1]) | (faces[:, 1] == faces[:, 2]) | (faces[:, 2] == faces[:, 0])
    faces = faces[~repeated]
    if len(faces) < 4:
        raise InputError("mesh", f"{len(faces)} triangles", "a closed mesh")
    unpaired, turned = _edge_faults(faces)
    if unpaired:
        raise InputError("mesh", f"open, {unpaired} edges belong to one triangle", "closed (watertight)")
    if turned:
        faces = _faced_outward(vertices, faces)
    elif enclosed_moments(vertices[faces[:, ::-1]])[0] > 0.0:  # inside out
        faces = faces[:, ::-1]
    return np.ascontiguousarray(vertices), np.ascontiguousarray(faces)


def _edge_faults(faces: NDArray[np.int64]) -> tuple[int, int]:
    """Numbers of edges with an odd number of triangles, and of edges that are not run through as often each way."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    _, group = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    group = group.reshape(-1)
    times = np.bincount(group)
    balance = np.bincount(group, np.where(edges[:, 0] < edges[:, 1], 1.0, -1.0))
    return int(np.sum(times % 2 == 1)), int(np.sum(balance != 0.0))


def _faced_outward(vertices: Vector, faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Faces turned to agree with their neighbours and, piece by piece, outward; InputError for a one-sided surface."""
    oriented, pieces = igl.bfs_orient(faces)
    oriented = np.array(oriented, dtype=np.int64)
    if _edge_faults(oriented)[1]:
        raise InputError("mesh", "triangles that cannot all face outward", "the boundary of a solid")
    for piece in np.unique(pieces):
        of_piece = np.asarray(pieces) == piece
        if enclosed_moments(vertices[oriented[of_piece]][:, ::-1])[0] > 0.0:
            oriented[of_piece] = oriented[of_piece][:, ::-1]
    return oriented
