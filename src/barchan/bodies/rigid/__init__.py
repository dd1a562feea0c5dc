"""Rigid bodies (seed B, 2.1.1 and 7.4.1): shapes as signed distances, motions, states and their equations of motion.

ball = Body(Sphere(0.1), name="ball", density=19250.0, position=(0.5, 0.5, 0.5), velocity=(0.0, 0.0, -12.0))
states = BodyStates.at_start([ball])
blocks = predicted_velocities(ball, states.row(0), gravity, dt, time)
row = moved(ball, states.row(0), blocks, dt, time)
"""

from __future__ import annotations

from barchan.bodies.rigid.assemblies import funnel, hourglass, hourglass_of_revolution, plate_with_hole, wheel
from barchan.bodies.rigid.body import Body
from barchan.bodies.rigid.capsules import Capsule
from barchan.bodies.rigid.checking import check_bodies
from barchan.bodies.rigid.combined import Complement, Difference, Intersection, Moved, Repeated, Union
from barchan.bodies.rigid.dynamics import (
    angular_momentum,
    contact_columns,
    generalised_masses,
    generalised_velocities,
    is_driven,
    kinetic_energy,
    moved,
    predicted_velocities,
)
from barchan.bodies.rigid.hulls import ConvexHull
from barchan.bodies.rigid.meshes import TriangleMesh, sample_mesh
from barchan.bodies.rigid.motions import Fixed, Free, Motion, Prescribed
from barchan.bodies.rigid.placement import body_distance, body_normals, body_surface, to_body, to_world
from barchan.bodies.rigid.plane_shapes import Extruded, Polygon, Revolved
from barchan.bodies.rigid.primitives import Box, Cylinder, HalfSpace, Sphere, Torus
from barchan.bodies.rigid.shape import Shape
from barchan.bodies.rigid.states import BodyState, BodyStates
from barchan.bodies.rigid.surfaces import Surface

__all__ = [
    "Shape", "Surface", "Sphere", "Box", "Capsule", "Cylinder", "Torus", "HalfSpace", "Polygon", "ConvexHull", "Extruded",
    "Revolved", "TriangleMesh", "sample_mesh", "Union", "Intersection", "Difference", "Complement", "Moved", "Repeated",
    "wheel", "funnel", "hourglass", "hourglass_of_revolution", "plate_with_hole",
    "Body", "Motion", "Free", "Fixed", "Prescribed", "BodyState", "BodyStates",
    "is_driven", "generalised_masses", "generalised_velocities", "predicted_velocities", "contact_columns", "moved",
    "kinetic_energy", "angular_momentum", "to_body", "to_world", "body_distance", "body_normals", "body_surface",
    "check_bodies",
]  # fmt: skip
