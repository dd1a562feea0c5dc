"""results.xdmf: the light XML beside results.h5 that lets ParaView open the run as a movie.

A material point run has two blocks per time: the particles (a Polyvertex cloud with velocity and volume) and
the active grid cells with their nodal fields. A finite-element run has one: its mesh, the same at all times,
with the fields at the vertices. A run of bodies has two clouds: the bodies, with their shapes and spins as well, and the
contacts with their forces. Nothing is copied: every DataItem points into results.h5.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import h5py

from barchan.results.reader import reading
from barchan.storage import write_bytes

_CELLS = {  # (dimension, corners) -> topology
    (2, 3): "Triangle",
    (2, 4): "Quadrilateral",
    (3, 3): "Triangle",
    (3, 4): "Tetrahedron",
    (3, 8): "Hexahedron",
}
_SCALAR_FIELDS = {
    "pressure": "pressures",
    "shear stress": "shear_stresses",
    "shear rate": "shear_rates",
    "plug": "plug",
    "volume fraction": "volume_fractions",
}
_CLOUDS = {  # of points: attribute -> dataset, where there is one
    "particles": {
        "velocity": "velocities", "volume": "volumes", "rotation": "rotations", "spin": "spins", "shape": "shape_kinds",
        "size": "shape_sizes",
    },
    "contacts": {"force": "forces", "normal": "normals"},
}  # fmt: skip
_KINDS = {1: "Scalar", 3: "Vector"}
_NUMBER_TYPES = {"f": "Float", "i": "Int"}


def write_xdmf(results_path: Path, path: Path) -> None:
    """Write the XDMF description of `results_path` (a results.h5) to `path` in the same folder, atomically.

    Raises InputError when `results_path` is damaged or the folder cannot be written.
    """
    root = Element("Xdmf", Version="2.0")
    domain = SubElement(root, "Domain")
    movie = SubElement(domain, "Grid", Name="run", GridType="Collection", CollectionType="Temporal")
    with reading(results_path) as file:
        for name, time in zip(file["frames"], file["observables/time"][()], strict=True):
            instant = SubElement(
                movie, "Grid", Name=f"frame {name}", GridType="Collection", CollectionType="Spatial"
            )
            SubElement(instant, "Time", Value=repr(float(time)))
            groups = file[f"frames/{name}"]
            for cloud, attributes in _CLOUDS.items():
                if cloud in groups:
                    _add_cloud(instant, cloud, groups[cloud], attributes, results_path.name)
            for place, fields in ((file.get("mesh"), groups.get("fields")), (groups.get("grid"),) * 2):
                if place is not None and fields is not None and place["cells"].shape[0] > 0:
                    _add_cells(instant, place, fields, int(file.attrs["dimension"]), results_path.name)
    ElementTree.indent(root)
    write_bytes(path, ElementTree.tostring(root, encoding="utf-8", xml_declaration=True))


def _add_cloud(
    parent: Element, name: str, group: h5py.Group, attributes: dict[str, str], file_name: str
) -> None:
    """A Polyvertex cloud of the points of a group."""
    count = group["positions"].shape[0]
    if count == 0 and name == "contacts":
        return  # bodies may touch later
    grid = SubElement(parent, "Grid", Name=name, GridType="Uniform")
    SubElement(grid, "Topology", TopologyType="Polyvertex", NumberOfElements=str(count), NodesPerElement="1")
    _add_data(SubElement(grid, "Geometry", GeometryType="XYZ"), group["positions"], file_name)
    for attribute, dataset in attributes.items():
        if dataset not in group:
            continue
        values = group[dataset]
        kind = _KINDS.get(values.shape[1] if values.ndim == 2 else 1)
        if kind is not None:  # readers take no quaternions
            _add_attribute(grid, attribute, kind, values, file_name)


def _add_cells(
    parent: Element, place: h5py.Group, fields: h5py.Group, dimension: int, file_name: str
) -> None:
    """The cells of a grid or mesh at `place` with nodal `fields`."""
    grid = SubElement(parent, "Grid", Name=place.name.rpartition("/")[2], GridType="Uniform")
    count, corners = place["cells"].shape
    topology = SubElement(
        grid, "Topology", TopologyType=_CELLS[dimension, corners], NumberOfElements=str(count)
    )
    _add_data(topology, place["cells"], file_name)
    _add_data(SubElement(grid, "Geometry", GeometryType="XYZ"), place["positions"], file_name)
    _add_attribute(grid, "velocity", "Vector", fields["velocities"], file_name)
    for name, field in _SCALAR_FIELDS.items():
        if field in fields:
            _add_attribute(grid, name, "Scalar", fields[field], file_name)


def _add_attribute(grid: Element, name: str, kind: str, values: h5py.Dataset, file_name: str) -> None:
    """A nodal field of kind "Scalar" or "Vector"."""
    attribute = SubElement(grid, "Attribute", Name=name, AttributeType=kind, Center="Node")
    _add_data(attribute, values, file_name)


def _add_data(parent: Element, values: h5py.Dataset, file_name: str) -> None:
    item = SubElement(
        parent,
        "DataItem",
        Dimensions=" ".join(str(size) for size in values.shape),
        NumberType=_NUMBER_TYPES[values.dtype.kind],
        Precision=str(values.dtype.itemsize),
        Format="HDF",
    )
    item.text = f"{file_name}:{values.name}"
