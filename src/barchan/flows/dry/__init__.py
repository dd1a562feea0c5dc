"""Dry granular flow on a mesh: velocities, stresses and volume fractions constant in each cell (seed B, 7.2).

    flow = DryFlow(rectangle((0, 0), (4, 1), (80, 20), "quadrilateral"), Material(1500.0, 0.5), {"bottom": Boundary("no_slip")})
    state = flow.filled(lambda x: x[:, 0] < 1.0)
    state, record = flow.advance(state, 0.01)

In 2D and 3D; the material is that of the material point method.
"""

from __future__ import annotations

from barchan.flows.dry.boundaries import Boundary
from barchan.flows.dry.cells import Cells
from barchan.flows.dry.flow import DryFlow
from barchan.flows.dry.options import Options
from barchan.flows.dry.state import DryRecord, DryState
from barchan.flows.mpm.material import Material

__all__ = ["Boundary", "Cells", "DryFlow", "DryRecord", "DryState", "Material", "Options"]
