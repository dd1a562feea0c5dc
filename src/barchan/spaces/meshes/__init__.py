"""Meshes of the continuum models: builders for the scenes, files of any generator, and the check that refuses bad ones.

Every mesh is a `skfem` mesh (`MeshTri`, `MeshQuad`, `MeshTet`) whose boundary facets are each named once in
`mesh.boundaries`. The geometries are those of seed A: silo of Fig. 8, channel with a cylinder of Fig. 14.
"""

from __future__ import annotations

from barchan.spaces.meshes.checking import check_mesh
from barchan.spaces.meshes.cylinder import channel_with_cylinder
from barchan.spaces.meshes.files import read_mesh, write_mesh
from barchan.spaces.meshes.rectangle import box, rectangle, split_at_centres, tensor_rectangle
from barchan.spaces.meshes.silo import silo, silo_3d

__all__ = [
    "box",
    "channel_with_cylinder",
    "check_mesh",
    "read_mesh",
    "rectangle",
    "silo",
    "silo_3d",
    "split_at_centres",
    "tensor_rectangle",
    "write_mesh",
]
