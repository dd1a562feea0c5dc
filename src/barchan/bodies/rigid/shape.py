"""What a shape is: a signed distance in the frame of its body, negative inside (seed B, 7.4.1).

A shape gives its distance, normals, bounds and boundary facets; quadrature and moments follow from the facets.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.rigid.inputs import positive
from barchan.bodies.rigid.surfaces import (
    Surface,
    clipped_to_box,
    enclosed_moments,
    inertia_of,
    quadrature,
)
from barchan.errors import InputError

CELLS_FOR_MOMENTS = 100  # facets across the longest side when moments have no closed form


class Shape(ABC):
    """A solid in d = 2 or 3 dimensions; lengths in metres, coordinates in the frame of the body."""

    @property
    @abstractmethod
    def dimension(self) -> int:
        """Space dimension d."""

    @abstractmethod
    def signed_distance(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance (n,) [m] of points (n, d) to the boundary, negative inside; never more than the distance in size."""

    @abstractmethod
    def normals(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Gradient (n, d) of the distance, of unit length, outward; any unit vector where the gradient does not exist."""

    @abstractmethod
    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower and upper corner (d,) of a box that holds the shape; infinite along unbounded directions."""

    @abstractmethod
    def facets(
        self, spacing: float, lower: NDArray[np.float64], upper: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Boundary facets (F, d, d) with edges of at most about `spacing`; unbounded shapes reach beyond the box."""

    @property
    def bounded(self) -> bool:
        """Whether the shape has a finite extent."""
        lower, upper = self.bounds()
        return bool(np.all(np.isfinite(lower)) and np.all(np.isfinite(upper)))

    def surface(
        self, spacing: float, lower: ArrayLike | None = None, upper: ArrayLike | None = None
    ) -> Surface:
        """Quadrature of the boundary with facets no longer than `spacing` [m], cut off at the box `lower` .. `upper` (d,).

        The box may be left out for bounded shapes. Without it the sums of area times normal and of their torques vanish
        to rounding. InputError: spacing not positive, unbounded shape without a box.
        """
        positive("spacing", spacing)
        d = self.dimension
        low = np.full(d, -np.inf) if lower is None else _corner("lower", lower, d)
        high = np.full(d, np.inf) if upper is None else _corner("upper", upper, d)
        least, most = self.bounds()
        inner, outer = np.maximum(low, least), np.minimum(high, most)
        if not (np.all(np.isfinite(inner)) and np.all(np.isfinite(outer))):
            raise InputError(
                "shape", type(self).__name__, "bounded, or its surface asked for inside a finite box"
            )
        if np.any(inner > outer):  # nothing of the shape is in the box
            return Surface(np.zeros((0, d)), np.zeros((0, d)), np.zeros(0))
        cut = bool(np.any(low > least) or np.any(high < most))
        facets = self.facets(spacing, inner, outer)
        if cut:
            facets = clipped_to_box(facets, low, high)
        return self.quadrature_of(facets, spacing, cut)

    def quadrature_of(self, facets: NDArray[np.float64], spacing: float, cut: bool) -> Surface:
        """Quadrature of `facets`; `cut` tells that they do not close."""
        return quadrature(facets)

    def volume_properties(self) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
        """Volume [m^d], centre (d,) and inertia per unit density about it: (3, 3) in space, (1, 1) in the plane.

        InputError when the shape is unbounded.
        """
        lower, upper = self.bounded_box()
        spacing = float(np.max(upper - lower)) / CELLS_FOR_MOMENTS
        volume, centre, second = enclosed_moments(self.facets(spacing, lower, upper))
        return volume, centre, inertia_of(second)

    def bounded_box(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The bounds, which must be finite: InputError otherwise."""
        if not self.bounded:
            raise InputError(
                "shape", type(self).__name__, "bounded: an unbounded one has no mass and no centre"
            )
        return self.bounds()


def _corner(field: str, value: ArrayLike, dimension: int) -> NDArray[np.float64]:
    array = np.array(value, dtype=np.float64)
    if array.shape != (dimension,) or np.any(np.isnan(array)):
        raise InputError(field, value, f"{dimension} numbers")
    return array


def unit_or_vertical(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Vectors (n, d) made unit; the last axis where a vector vanishes."""
    lengths = np.linalg.norm(vectors, axis=1)
    unit: NDArray[np.float64] = vectors / np.where(lengths > 0.0, lengths, 1.0)[:, None]
    unit[lengths == 0.0] = np.eye(vectors.shape[1])[-1]
    return unit
