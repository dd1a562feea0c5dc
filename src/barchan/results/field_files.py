"""Finite-element fields in files for ParaView: one instant as .vtu, a run as one .xdmf. Written whole or not at all."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterable, Mapping
from pathlib import Path

import meshio
import numpy as np
from numpy.typing import ArrayLike, NDArray
from skfem import Mesh, MeshHex, MeshQuad, MeshTet, MeshTri

from barchan.errors import InputError
from barchan.results.stored_meshes import mesh_group
from barchan.storage import replacing

Fields = Mapping[str, ArrayLike]

_KINDS = {MeshTri: "triangle", MeshQuad: "quad", MeshTet: "tetra", MeshHex: "hexahedron"}


def write_vtu(
    path: str | Path, mesh: Mesh, point_data: Fields | None = None, cell_data: Fields | None = None
) -> None:
    """Write fields on `mesh` to the VTK file `path`, atomically.

    Parameters
    ----------
    path : file name, in a folder that exists.
    mesh : triangles, quadrilaterals, tetrahedra or hexahedra.
    point_data, cell_data : name -> values (vertices,) or (vertices, k), (cells,) or (cells, k); vectors of the plane get a
        third component 0, as ParaView expects.

    Raises InputError for values of another length or a place that cannot be written.
    """
    content = _content(mesh, point_data or {}, cell_data or {})
    with replacing(Path(path)) as temporary, contextlib.redirect_stdout(io.StringIO()):
        meshio.write(temporary, content, file_format="vtu")


def write_series(path: str | Path, mesh: Mesh, instants: Iterable[tuple[float, Fields, Fields]]) -> None:
    """Write fields at several times to one XDMF file, atomically.

    Parameters
    ----------
    path : file name ending in .xdmf.
    mesh : the same at all times.
    instants : (time, point data, cell data), the data as for `write_vtu`.

    Raises InputError as `write_vtu`.
    """
    with (
        replacing(Path(path)) as temporary,
        contextlib.redirect_stdout(io.StringIO()),
        meshio.xdmf.TimeSeriesWriter(temporary, data_format="XML") as writer,
    ):
        empty = _content(mesh, {}, {})
        writer.write_points_cells(empty.points, empty.cells)
        for time, point_data, cell_data in instants:
            content = _content(mesh, point_data, cell_data)
            writer.write_data(time, point_data=content.point_data, cell_data=content.cell_data)


def _content(mesh: Mesh, point_data: Fields, cell_data: Fields) -> meshio.Mesh:
    """What meshio writes: points in space, cells, checked data."""
    points = np.zeros((mesh.p.shape[1], 3))
    points[:, : mesh.p.shape[0]] = mesh.p.T
    kind = next((name for cls, name in _KINDS.items() if isinstance(mesh, cls)), None)
    if kind is None:
        raise InputError(
            "mesh", type(mesh).__name__, "made of triangles, quadrilaterals, tetrahedra or hexahedra"
        )
    at_points = {name: _checked(name, values, len(points)) for name, values in point_data.items()}
    in_cells = {name: [_checked(name, values, mesh.t.shape[1])] for name, values in cell_data.items()}
    return meshio.Mesh(points, [(kind, mesh_group(mesh)["cells"])], point_data=at_points, cell_data=in_cells)


def _checked(name: str, values: ArrayLike, count: int) -> NDArray[np.generic]:
    array = np.asarray(values)
    if array.ndim not in (1, 2) or array.shape[0] != count:
        raise InputError(
            f"field {name!r}", f"values of shape {array.shape}", f"of shape ({count},) or ({count}, k)"
        )
    if array.dtype == np.bool_:
        array = array.astype(np.int8)
    if array.ndim == 2 and array.shape[1] == 2:
        array = np.concatenate([array, np.zeros((count, 1), dtype=array.dtype)], axis=1)
    return array
