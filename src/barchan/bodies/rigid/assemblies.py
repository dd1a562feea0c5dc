"""Ready-made shapes of the scenes: wheel with treads, funnel, hourglass, plate with a hole (seed B, 7.5)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from barchan.bodies.rigid import inputs
from barchan.bodies.rigid.combined import Difference, Moved, Repeated, Union
from barchan.bodies.rigid.plane_shapes import Extruded, Polygon, Revolved
from barchan.bodies.rigid.primitives import Box, Cylinder
from barchan.bodies.rigid.shape import Shape
from barchan.errors import InputError


def wheel(
    radius: float,
    half_width: float,
    treads: int = 0,
    tread_height: float = 0.0,
    tread_width: float | None = None,
    axis: int = 1,
) -> Shape:
    """Wheel of `radius` [m] about `axis` (0, 1 or 2) with `treads` bars across its rim, evenly spaced.

    Bars are as long as the wheel is wide, `tread_height` [m] high above the rim and `tread_width` (default: their height) wide.
    """
    inputs.positive("radius", radius)
    direction = inputs.axis_direction("axis", axis)
    rim = Cylinder(radius, half_width, direction)
    if isinstance(treads, bool) or not isinstance(treads, (int, np.integer)) or treads < 0:
        raise InputError("treads", treads, "a whole number >= 0")
    if treads == 0:
        return rim
    height = inputs.positive("tread_height", tread_height)
    width = height if tread_width is None else inputs.positive("tread_width", tread_width)
    if treads * width >= 2.0 * np.pi * radius:
        raise InputError(
            "treads", treads, f"fewer than {2.0 * np.pi * radius / width:.3g}, the bars that fit the rim"
        )
    along = int(np.argmax(np.abs(direction)))
    out = (along + 1) % 3
    half = np.zeros(3)
    root = min(0.5 * radius, height + width**2 / radius)  # how deep a bar reaches into the rim
    half[along], half[out], half[(along + 2) % 3] = half_width, 0.5 * (height + root), 0.5 * width
    place = np.zeros(3)
    place[out] = radius + 0.5 * (height - root)
    return Union(rim, Repeated(Moved(Box(half), place), treads, along))


def funnel(radius: float, outlet: float, height: float, thickness: float, spout: float = 0.0) -> Revolved:
    """Cone of revolution about z, open at both ends: inner radius `outlet` at the height 0, `radius` at `height` [m].

    The wall is `thickness` thick, measured horizontally; a straight spout of the length `spout` may hang below.
    """
    for field, value in (
        ("radius", radius),
        ("outlet", outlet),
        ("height", height),
        ("thickness", thickness),
    ):
        inputs.positive(field, value)
    inputs.not_negative("spout", spout)
    if outlet >= radius:
        raise InputError("outlet", outlet, f"less than radius = {radius}")
    t = thickness
    corners = [(outlet + t, -spout)] if spout > 0.0 else []
    corners += [(outlet + t, 0.0), (radius + t, height), (radius, height), (outlet, 0.0)]
    corners += [(outlet, -spout)] if spout > 0.0 else []
    return Revolved(Polygon(corners))


def hourglass(
    width: float, height: float, neck: float, half_depth: float | None = None, neck_length: float = 0.0
) -> Union:
    """What fills a `width` x `height` [m] rectangle beside a plane hourglass about the origin, open by `neck`: two walls.

    In space, as thick as |y| <= `half_depth`; in the plane without it. The neck is straight over `neck_length`.
    """
    right = [(0.5 * width, 0.5 * height)]
    right += _neck_corners(
        0.5 * inputs.positive("neck", neck), inputs.not_negative("neck_length", neck_length)
    )
    right += [(0.5 * width, -0.5 * height)]
    if neck >= inputs.positive("width", width):
        raise InputError("neck", neck, f"less than width = {width}")
    if neck_length >= inputs.positive("height", height):
        raise InputError("neck_length", neck_length, f"less than height = {height}")
    walls = [Polygon(right), Polygon([(-x, z) for x, z in right])]
    if half_depth is None:
        return Union(*walls)
    return Union(*(Extruded(wall, half_depth) for wall in walls))


def hourglass_of_revolution(
    radius: float, height: float, neck: float, thickness: float, neck_length: float = 0.0
) -> Revolved:
    """Round glass about z: inner radius `radius` at both ends, `neck` at the origin, as thick as `thickness` horizontally."""
    for field, value in (("radius", radius), ("height", height), ("neck", neck), ("thickness", thickness)):
        inputs.positive(field, value)
    if neck >= radius:
        raise InputError("neck", neck, f"less than radius = {radius}")
    if inputs.not_negative("neck_length", neck_length) >= height:
        raise InputError("neck_length", neck_length, f"less than height = {height}")
    inner = [(radius, 0.5 * height), *_neck_corners(neck, neck_length), (radius, -0.5 * height)]
    return Revolved(Polygon([*inner, *((r + thickness, z) for r, z in reversed(inner))]))


def plate_with_hole(half_extents: ArrayLike, hole_radius: float) -> Shape:
    """Box about the origin with a vertical round hole through its middle; in the plane, a gap of the width 2 `hole_radius`."""
    plate = Box(half_extents)
    sides, radius = plate.half_extents, inputs.positive("hole_radius", hole_radius)
    if radius >= np.min(sides[:-1]):
        raise InputError(
            "hole_radius", hole_radius, f"less than {np.min(sides[:-1]):g}, the plate's half side"
        )
    if plate.dimension == 3:
        return Difference(plate, Cylinder(radius, 2.0 * float(sides[2]), 2))
    half = np.array([0.5 * (sides[0] - radius), sides[1]])
    offset = np.array([0.5 * (sides[0] + radius), 0.0])
    return Union(Moved(Box(half), -offset), Moved(Box(half), offset))


def _neck_corners(half: float, length: float) -> list[tuple[float, float]]:
    return [(half, 0.0)] if length == 0.0 else [(half, 0.5 * length), (half, -0.5 * length)]
