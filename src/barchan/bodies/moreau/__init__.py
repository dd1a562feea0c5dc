"""Moreau and Jean's time stepping of rigid bodies in frictional contact (seed B, 2.2)."""

from __future__ import annotations

from barchan.bodies.moreau.assembly import Assembly
from barchan.bodies.moreau.joints import BallJoint, DistanceJoint, FixedJoint, Hinge, Joint, Slider
from barchan.bodies.moreau.options import Options
from barchan.bodies.moreau.state import AssemblyRecord, AssemblyState

__all__ = [
    "Assembly",
    "AssemblyRecord",
    "AssemblyState",
    "BallJoint",
    "DistanceJoint",
    "FixedJoint",
    "Hinge",
    "Joint",
    "Options",
    "Slider",
]
