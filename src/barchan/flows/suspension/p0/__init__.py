"""Grains inside a fluid on a mesh of triangles or tetrahedra: piecewise constant, with linear pressures (seed B, 8.3.4).

sand = Mixture(Material(2500.0, 0.5, max_volume_fraction=0.6), 1000.0, 1e-3, grain_diameter=5e-4)
flow = SuspensionFlow(rectangle((0, 0), (1, 1), (20, 20)), sand, {"bottom": Boundary("no_slip")})
state = flow.filled(lambda x: x[:, 1] < 0.9, fraction=0.18)
state, record = flow.advance(state, 0.01)
"""

from __future__ import annotations

from barchan.flows.suspension.p0.boundaries import Boundary
from barchan.flows.suspension.p0.flow import SuspensionFlow
from barchan.flows.suspension.p0.options import Options
from barchan.flows.suspension.p0.state import SuspensionRecord, SuspensionState

__all__ = ["Boundary", "Options", "SuspensionFlow", "SuspensionRecord", "SuspensionState"]
