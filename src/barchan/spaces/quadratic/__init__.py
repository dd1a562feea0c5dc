"""Quadratic velocities with linear pressures on cells with curved sides: Q2/P1 (seed C 4.2), P2/P1 and P2/P1d."""

from barchan.spaces.quadratic.mesh import QuadraticMesh, refinements
from barchan.spaces.quadratic.space import Boundary, QuadraticSpace

__all__ = ["Boundary", "QuadraticMesh", "QuadraticSpace", "refinements"]
