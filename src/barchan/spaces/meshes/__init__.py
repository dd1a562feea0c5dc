"""Meshes of the continuum models: builders for the scenes, files of any generator, and the check that refuses bad ones.

Every mesh is a `skfem` mesh (`MeshTri`, `MeshQuad`, `MeshTet`) whose boundary facets are each named once in
`mesh.boundaries`. The geometries are those of seed A: silo of Fig. 8, channel with a cylinder of Fig. 14. Those of seed C,
channel of Fig. 16 and ring of Fig. 17, have curved cells (`QuadraticMesh`).
"""

from __future__ import annotations

from barchan.spaces.meshes.annulus import annulus
from barchan.spaces.meshes.checking import check_mesh
from barchan.spaces.meshes.cylinder import channel_with_cylinder
from barchan.spaces.meshes.dfg_channel import dfg_channel
from barchan.spaces.meshes.files import read_mesh, write_mesh
from barchan.spaces.meshes.rectangle import box, rectangle, split_at_centres, tensor_rectangle
from barchan.spaces.meshes.silo import silo, silo_3d

__all__ = [
    "annulus",
    "box",
    "channel_with_cylinder",
    "check_mesh",
    "dfg_channel",
    "read_mesh",
    "rectangle",
    "silo",
    "silo_3d",
    "split_at_centres",
    "tensor_rectangle",
    "write_mesh",
]
