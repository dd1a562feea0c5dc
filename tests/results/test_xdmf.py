"""The XDMF file says of results.h5 exactly what is in it."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import h5py
import numpy as np
import pytest

from barchan.results import MemoryStore, assemble, frame_tree, write_xdmf

TYPES = {
    ("Float", "4"): np.float32,
    ("Float", "8"): np.float64,
    ("Int", "4"): np.int32,
    ("Int", "8"): np.int64,
}


@pytest.fixture(params=[2, 3])
def movie(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Path, int]:
    """A results.xdmf with three frames, the first without grid, in a dimension."""
    d = request.param
    rng = np.random.default_rng(d)
    store = MemoryStore()
    for k in range(3):
        nodes = 2**d if k else 0
        grid = {
            "node_ids": np.arange(nodes),
            "positions": rng.random((nodes, d)),
            "velocities": rng.random((nodes, d)),
            "cells": np.arange(nodes, dtype=np.int32).reshape(-1, 2**d),
            "pressures": rng.random(nodes),
            "shear_stresses": rng.random(nodes),
            "volume_fractions": rng.random(nodes),
        }
        particles = {
            "positions": rng.random((9 + k, d)),
            "velocities": rng.random((9 + k, d)),
            "volumes": np.ones(9 + k),
        }
        store.put_frame(
            k,
            frame_tree(
                {"particles": particles, "grid": grid},
                {"time": np.array([k])} if k else {},
                {"time": 0.25 * k},
            ),
        )
    assemble(store, 3, "", tmp_path / "results.h5")
    write_xdmf(tmp_path / "results.h5", tmp_path / "results.xdmf")
    return tmp_path / "results.xdmf", d


def test_every_data_item_points_to_a_dataset_of_its_shape_and_type(movie: tuple[Path, int]) -> None:
    items = list(ElementTree.parse(movie[0]).iter("DataItem"))
    assert (
        len(items) == 3 * 3 + 2 * 6
    )  # particles: geometry, velocity, volume; grid: cells, geometry, four fields
    for item in items:
        assert item.text is not None
        name, _, dataset = item.text.strip().partition(":")
        with h5py.File(movie[0].parent / name, "r") as file:
            assert file[dataset].shape == tuple(int(size) for size in item.attrib["Dimensions"].split())
            assert file[dataset].dtype == TYPES[item.attrib["NumberType"], item.attrib["Precision"]]


def test_the_times_are_those_of_the_frames(movie: tuple[Path, int]) -> None:
    collection = ElementTree.parse(movie[0]).find("./Domain/Grid")
    assert collection is not None
    assert collection.attrib["CollectionType"] == "Temporal"
    assert [float(time.attrib["Value"]) for time in collection.iter("Time")] == [0.0, 0.25, 0.5]


def test_counts_topologies_and_vectors_agree(movie: tuple[Path, int]) -> None:
    path, d = movie
    for grid in ElementTree.parse(path).iter("Grid"):
        topology, geometry = grid.find("Topology"), grid.find("Geometry/DataItem")
        if topology is None or geometry is None:
            continue
        points = geometry.attrib["Dimensions"].split()[0]
        if grid.attrib["Name"] == "particles":
            assert topology.attrib["TopologyType"] == "Polyvertex"
            assert topology.attrib["NumberOfElements"] == points
        else:
            assert topology.attrib["TopologyType"] == {2: "Quadrilateral", 3: "Hexahedron"}[d]
        for attribute in grid.iter("Attribute"):
            item = attribute.find("DataItem")
            assert item is not None
            components = "" if attribute.attrib["AttributeType"] == "Scalar" else " 3"
            assert item.attrib["Dimensions"] == points + components


@pytest.mark.parametrize("d", [2, 3])
def test_bodies_and_their_contacts_are_two_clouds_that_vtk_reads(d: int, tmp_path: Path) -> None:
    pyvista = pytest.importorskip("pyvista", reason="VTK reads the file")
    rng, store = np.random.default_rng(d), MemoryStore()
    kept = []
    for k in range(2):
        touching = 3 * k
        bodies = {
            "positions": rng.random((5, d)), "velocities": rng.random((5, d)), "volumes": np.ones(5),
            "rotations": rng.random((5, 1 if d == 2 else 4)), "spins": rng.random((5, 1 if d == 2 else 3)),
            "shape_kinds": np.arange(5), "shape_sizes": rng.random((5, 3)),
        }  # fmt: skip
        contacts = {
            "positions": rng.random((touching, d)), "normals": rng.random((touching, d)),
            "forces": rng.random((touching, d)), "pairs": np.zeros((touching, 2), np.int32),
        }  # fmt: skip
        kept.append((bodies, contacts))
        store.put_frame(k, frame_tree({"particles": bodies, "contacts": contacts}, {}, {"time": 0.5 * k}))
    assemble(store, 2, "", tmp_path / "results.h5")
    write_xdmf(tmp_path / "results.h5", tmp_path / "results.xdmf")
    reader = pyvista.XdmfReader(str(tmp_path / "results.xdmf"))
    assert reader.time_values == [0.0, 0.5]
    reader.set_active_time_point(1)
    read = reader.read()
    found = {name.split("[")[0]: block for name, block in zip(read.keys(), read, strict=True)}
    bodies, contacts = kept[1]
    np.testing.assert_allclose(found["particles"].points[:, :d], bodies["positions"], rtol=1e-6)
    np.testing.assert_allclose(found["particles"]["size"], bodies["shape_sizes"], rtol=1e-6)
    np.testing.assert_allclose(found["contacts"]["force"][:, :d], contacts["forces"], rtol=1e-6)
    assert set(found["particles"].array_names) >= {"velocity", "volume", "spin", "shape", "size"}
