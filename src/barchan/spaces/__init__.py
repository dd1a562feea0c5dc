"""Room `spaces`: discrete spaces and the geometry kernels that turn fields into arrays.

Holds the regular grid with multilinear shape functions and the particle sorting used by the material point method
(seed B, 5.2.4, 7.3.1 and 7.3.3).
"""

from __future__ import annotations

from barchan.spaces.grid import RegularGrid
from barchan.spaces.shapes import ShapeValues, interpolate, shape_functions
from barchan.spaces.sorting import ActiveCells, sort_particles

__all__ = ["ActiveCells", "RegularGrid", "ShapeValues", "interpolate", "shape_functions", "sort_particles"]
