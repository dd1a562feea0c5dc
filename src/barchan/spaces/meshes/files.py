"""Meshes in files: any format meshio reads whose facets carry names or tags, such as gmsh's physical groups.

The names of boundary parts are taken, in this order, from named sets of facets, from gmsh's physical groups, from 0/1 cell
data "part:NAME" (what `write_mesh` writes where a format has no names), and from integer tags of the facets.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from pathlib import Path

import meshio
import numpy as np
from numpy.typing import NDArray
from skfem import Mesh, MeshQuad, MeshTet, MeshTri

from barchan.errors import InputError
from barchan.spaces.meshes.checking import check_cells, check_names
from barchan.storage import replacing

PART = "part:"
_CELLS = {"triangle": MeshTri, "quad": MeshQuad, "tetra": MeshTet}
_FACET_OF = {"triangle": "line", "quad": "line", "tetra": "triangle"}
# Integer cell data that name the parts of a mesh, as the formats that meshio reads call them.
_TAGS = ("gmsh:physical", "medit:ref", "cell_tags", "facet_tags", "boundary", "boundaries", "CellEntityIds")
_FORMATS = {".msh": "gmsh22", ".vtu": "vtu", ".xdmf": "xdmf"}


def read_mesh(path: str | Path) -> Mesh:
    """Mesh of triangles, quadrilaterals or tetrahedra with named boundary parts, checked as by `check_mesh`.

    Parameters
    ----------
    path : a file of any format of meshio (gmsh .msh, .vtu, .xdmf, .mesh, ...), holding cells of one kind, straight sides,
        and boundary facets with names or integer tags; a tag without a name becomes the part "tag_NUMBER".

    Raises InputError for a file that is missing or cannot be read, several kinds of cells, and all that `check_mesh` refuses.
    """
    file = Path(path)
    content = _read(file)
    kind, cells = _volume_cells(content, str(file))
    dimension = 3 if kind == "tetra" else 2
    points = np.asarray(content.points, dtype=np.float64)
    if points.shape[1] == 3 and dimension == 2:
        if np.ptp(points[:, 2]) > 1e-9 * np.max(np.ptp(points, axis=0)):
            raise InputError(str(file), "a surface in space", "a flat mesh in the x-y plane, or tetrahedra")
        points = points[:, :2]
    check_cells(points, cells, str(file), oriented=True)
    mesh = _CELLS[kind](np.ascontiguousarray(points.T), np.ascontiguousarray(cells.T))
    boundaries = {
        name: _facet_numbers(mesh, facets, name, str(file))
        for name, facets in _named_facets(content, _FACET_OF[kind]).items()
    }
    result = type(mesh)(mesh.p, mesh.t, _boundaries=boundaries)
    check_names(result, str(file))
    return result


def write_mesh(path: str | Path, mesh: Mesh) -> None:
    """Write `mesh` with its named parts to a .msh (gmsh 2.2), .vtu or .xdmf file, atomically; `read_mesh` reads it back.

    Raises InputError for another ending or a place that cannot be written.
    """
    file = Path(path)
    if file.suffix not in _FORMATS:
        raise InputError("mesh.path", str(file), "a file name ending in " + ", ".join(_FORMATS))
    kind = next(name for name, cls in _CELLS.items() if isinstance(mesh, cls))
    names = list(mesh.boundaries or {})
    facets = [np.asarray(mesh.boundaries[name]) for name in names]
    lines = [(_FACET_OF[kind], mesh.facets[:, numbers].T) for numbers in facets]
    points = np.zeros((mesh.p.shape[1], 3))
    points[:, : mesh.p.shape[0]] = mesh.p.T
    blocks = [(kind, _counter_clockwise(mesh)), *lines]
    sizes = [len(data) for _, data in blocks]
    fields: dict[str, NDArray[np.int64]] = {}
    if file.suffix == ".msh":
        tags = [np.full(size, number) for number, size in enumerate(sizes, start=1)]
        data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
        facet_dimension = mesh.p.shape[0] - 1
        fields = {name: np.array([2 + number, facet_dimension]) for number, name in enumerate(names)}
        fields["domain"] = np.array([1, facet_dimension + 1])
    else:
        data = {
            PART + name: [
                np.full(size, block == number + 1, dtype=np.int64) for block, size in enumerate(sizes)
            ]
            for number, name in enumerate(names)
        }
    content = meshio.Mesh(points, blocks, cell_data=data, field_data=fields)
    options = {"data_format": "XML"} if file.suffix == ".xdmf" else {}
    with replacing(file) as temporary, _silence():
        meshio.write(temporary, content, file_format=_FORMATS[file.suffix], **options)


def _read(file: Path) -> meshio.Mesh:
    """What meshio reads, its messages and exits turned into InputError."""
    if not file.is_file():
        raise InputError(str(file), "missing", "a mesh file that exists")
    try:
        with _silence():
            return meshio.read(file, file_format="gmsh" if file.suffix == ".msh" else None)
    except (Exception, SystemExit) as error:  # a damaged file makes its reader fail in any way
        raise InputError(
            str(file), "unreadable (damaged, or of an unknown format)", "a mesh file that meshio reads"
        ) from error


@contextlib.contextmanager
def _silence() -> Iterator[None]:
    """meshio prints what it has to say; here it is said by exceptions."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        yield


def _volume_cells(content: meshio.Mesh, source: str) -> tuple[str, NDArray[np.int64]]:
    """Kind and vertices (n, k) of the cells of highest dimension."""
    kinds = {block.type for block in content.cells if len(block.data)} - {"vertex", "line"}
    solids = kinds - {"triangle"} if "tetra" in kinds else kinds
    if not solids:
        raise InputError(
            source, "no triangles, quadrilaterals or tetrahedra",
            "a mesh with cells (in gmsh, give the surface or volume a physical group too)",
        )  # fmt: skip
    if len(solids) > 1:
        raise InputError(source, "mixed cells: " + ", ".join(sorted(solids)), "made of cells of one kind")
    kind = solids.pop()
    if kind not in _CELLS:
        raise InputError(
            source, f"cells of kind {kind}", "made of straight triangles, quadrilaterals or tetrahedra"
        )
    return kind, np.concatenate([block.data for block in content.cells if block.type == kind]).astype(
        np.int64
    )


def _named_facets(content: meshio.Mesh, kind: str) -> dict[str, NDArray[np.int64]]:
    """Vertices (n, d) of the facets of each part; see the module for where names come from."""
    blocks = [(number, block.data) for number, block in enumerate(content.cells) if block.type == kind]
    names = {(int(tag), int(dimension)): name for name, (tag, dimension) in content.field_data.items()}
    facet_dimension = 1 if kind == "line" else 2
    found: dict[str, list[NDArray[np.int64]]] = {}

    def add(name: str, facets: NDArray[np.int64]) -> None:
        if len(facets):
            found.setdefault(name, []).append(facets.astype(np.int64))

    for name, sets in content.cell_sets.items():
        if not name.startswith("gmsh:"):
            for number, facets in blocks:
                if sets[number] is not None:
                    add(name, facets[np.asarray(sets[number], dtype=np.int64)])
    for key, data in content.cell_data.items():
        if not found and key in _TAGS:
            for number, facets in blocks:
                tags = np.asarray(data[number]).ravel()
                for tag in np.unique(tags[tags != 0]):
                    name = names.get((int(tag), facet_dimension), f"tag_{int(tag)}")
                    add(name, facets[tags == tag])
        elif key.startswith(PART):
            for number, facets in blocks:
                add(key.removeprefix(PART), facets[np.asarray(data[number]).ravel() != 0])
    return {name: np.concatenate(facets) for name, facets in found.items()}


def _facet_numbers(mesh: Mesh, facets: NDArray[np.int64], name: str, source: str) -> NDArray[np.int64]:
    """Numbers in the mesh of facets given by their vertices (n, d)."""
    known = np.sort(mesh.facets.T.astype(np.int64), axis=1)
    wanted = np.sort(facets, axis=1)
    _, inverse = np.unique(np.concatenate([known, wanted]), axis=0, return_inverse=True)
    place = np.full(np.max(inverse) + 1, -1, dtype=np.int64)
    place[inverse[: len(known)]] = np.arange(len(known))
    numbers = place[inverse[len(known) :]]
    if np.any(numbers < 0):
        raise InputError(
            source, f"part {name!r} has {np.count_nonzero(numbers < 0)} facets that belong to no cell",
            "a mesh whose named parts are sides of cells",
        )  # fmt: skip
    return np.unique(numbers)


def _counter_clockwise(mesh: Mesh) -> NDArray[np.int64]:
    """Cells (n, k) of the mesh listed with a positive size (scikit-fem sorts the vertices of its triangles)."""
    cells = np.array(mesh.t.T, dtype=np.int64)
    corners = mesh.p.T[cells]
    edges = corners[:, 1 : mesh.p.shape[0] + 1] - corners[:, :1]
    if isinstance(mesh, MeshQuad):
        edges = corners[:, [1, 3]] - corners[:, :1]
    negative = np.linalg.det(edges) < 0.0
    cells[negative] = cells[negative][
        :, [0, 3, 2, 1] if isinstance(mesh, MeshQuad) else [0, 2, 1, 3][: cells.shape[1]]
    ]
    return cells
