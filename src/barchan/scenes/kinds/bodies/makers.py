"""Rules that make many bodies: loose and glued grains, stacks, card houses, containers, drums, hoppers."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.rigid import Body, Box, Capsule, Fixed, HalfSpace, Moved, Shape, Sphere, Union
from barchan.bodies.rigid.rotations import exponential
from barchan.bodies.soft import lattice_packing
from barchan.errors import InputError
from barchan.scenes.keyframes import steady_motion
from barchan.scenes.kinds.bodies.cards import card_places
from barchan.scenes.kinds.bodies.entries import GeneratorEntry

Vector = NDArray[np.float64]


def made_bodies(name: str, entry: GeneratorEntry, dimension: int, end: float) -> list[Body]:
    """The bodies of a rule; drums turn until twice the `end` (s). Raises InputError naming the key at fault."""
    field = f"generators.{name}"
    try:
        return _MAKERS[entry.kind](name, _Keys(field, entry), dimension, end)
    except InputError as error:
        if error.field.startswith("generators."):
            raise
        key = error.field.rpartition(".")[2]
        raise InputError(f"{field}.{key}", error.value, error.allowed) from None


class _Keys:
    """The keys of a rule; those that it needs must be there."""

    def __init__(self, field: str, entry: GeneratorEntry) -> None:
        self.field, self.entry = field, entry

    def needed(self, name: str) -> Any:
        value = getattr(self.entry, name)
        if value is None:
            raise InputError(
                f"{self.field}.{name}", "missing", f"given for a rule of kind {self.entry.kind!r}"
            )
        return np.array(value, dtype=np.float64) if isinstance(value, list) else value

    def corners(self) -> tuple[Vector, Vector]:
        lower, upper = self.needed("lower"), self.needed("upper")
        if np.any(upper <= lower):
            raise InputError(f"{self.field}.upper", upper.tolist(), f"above {lower.tolist()}")
        return lower, upper


def _grains(name: str, keys: _Keys, dimension: int, end: float) -> list[Body]:
    """Loose grains on a lattice, off it by as much as `jitter` says."""
    entry = keys.entry
    radius, (lower, upper) = keys.needed("radius"), keys.corners()
    rng = np.random.default_rng([entry.seed, 1])
    radii = radius * rng.uniform(1.0 - entry.spread, 1.0 + entry.spread, entry.count)
    places = lattice_packing(radii, lower, upper, entry.seed, entry.jitter)
    shapes = {float(r): _grain(entry.shape, float(r), dimension) for r in np.unique(radii)}
    spins = 1 if dimension == 2 else 3
    turns = rng.normal(size=(entry.count, spins))
    return [
        Body(
            shapes[float(r)], name=f"{name}_{k}", friction=entry.friction, density=entry.density, position=place,
            rotation=None if entry.shape == "sphere" else exponential(turn), velocity=entry.velocity,
        )
        for k, (r, place, turn) in enumerate(zip(radii, places, turns, strict=True))
    ]  # fmt: skip


def _grain(kind: str, radius: float, dimension: int) -> Shape:
    """A shape that fits into a sphere of `radius`."""
    if kind == "sphere":
        return Sphere(radius, dimension)
    if kind == "box":
        return Box(np.full(dimension, radius / math.sqrt(dimension)))
    return Capsule(0.5 * radius, 0.5 * radius, dimension=dimension)


def _floor_of_grains(name: str, keys: _Keys, dimension: int, end: float) -> list[Body]:
    """Fixed grains side by side, with their tops at the upper corner: ground that does not let grains roll."""
    radius, (lower, upper) = keys.needed("radius"), keys.corners()
    counts = np.maximum(1, np.floor((upper - lower)[:-1] / (2.0 * radius) + 1e-9).astype(np.int64))
    axes = [
        lower[k] + (np.arange(counts[k]) + 0.5) * (upper - lower)[k] / counts[k] for k in range(len(counts))
    ]
    across = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(counts))
    shape = Sphere(radius, dimension)
    return [
        Body(
            shape, name=f"{name}_{k}", friction=keys.entry.friction, position=[*place, upper[-1] - radius],
            motion=Fixed(),
        )
        for k, place in enumerate(across)
    ]  # fmt: skip


def _stack(name: str, keys: _Keys, dimension: int, end: float) -> list[Body]:
    """Boxes one on the other."""
    entry, size, foot = keys.entry, keys.needed("size"), keys.needed("position")
    shape, up = Box(0.5 * size), np.eye(dimension)[-1]
    return [
        Body(
            shape, name=f"{name}_{k}", friction=entry.friction, density=entry.density,
            position=foot + (k + 0.5) * size[-1] * up,
        )
        for k in range(entry.count)
    ]  # fmt: skip


def _card_house(name: str, keys: _Keys, dimension: int, end: float) -> list[Body]:
    """Cards that lean on each other in pairs, storeys of pairs with flat cards between."""
    entry, size, foot = keys.entry, keys.needed("size"), keys.needed("position")
    length, thickness = size[0], size[1]
    if not thickness < 0.1 * length:
        raise InputError(f"{keys.field}.size", size.tolist(), "cards thinner than a tenth of their length")
    half = 0.5 * np.array([thickness, length] if dimension == 2 else [thickness, size[2], length])
    shape = Box(half)
    bodies = []
    for k, (x, z, turn) in enumerate(
        card_places(entry.storeys, length, thickness, math.radians(entry.lean_deg))
    ):
        place = foot.copy()
        place[0] += x
        place[-1] += z
        rotation = exponential(np.array([turn] if dimension == 2 else [0.0, -turn, 0.0]))
        bodies.append(
            Body(
                shape, name=f"{name}_{k}", friction=entry.friction, density=entry.density, position=place,
                rotation=rotation,
            )
        )  # fmt: skip
    return bodies


def _container(name: str, keys: _Keys, dimension: int, end: float) -> list[Body]:
    """Plane walls at the faces of a box, open at the top unless there is a lid."""
    lower, upper = keys.corners()
    bodies = []
    for axis, letter in enumerate("xz" if dimension == 2 else "xyz"):
        for side, corner, sign in (("min", lower, 1.0), ("max", upper, -1.0)):
            if letter == "z" and side == "max" and not keys.entry.lid:
                continue
            bodies.append(
                _wall(f"{name}_{letter}_{side}", sign * np.eye(dimension)[axis], corner, keys.entry)
            )
    return bodies


def _wall(name: str, normal: Vector, point: Vector, entry: GeneratorEntry) -> Body:
    return Body(HalfSpace(normal), name=name, friction=entry.friction, position=point, motion=Fixed())


def _drum(name: str, keys: _Keys, dimension: int, end: float) -> list[Body]:
    """A regular polygon of boxes round an axis along y, turning; in 3D with plane walls at its ends."""
    entry = keys.entry
    radius, thickness, centre = keys.needed("radius"), keys.needed("thickness"), keys.needed("position")
    half = np.array([radius * math.tan(math.pi / entry.sides) + thickness, 0.5 * thickness])
    if dimension == 3:
        half = np.array([half[0], 0.5 * keys.needed("depth"), half[1]])
    parts = []
    for angle in 2.0 * math.pi / entry.sides * np.arange(entry.sides):
        offset = np.zeros(dimension)
        offset[0], offset[-1] = math.sin(angle), -math.cos(angle)
        turn = exponential(np.array([angle] if dimension == 2 else [0.0, -angle, 0.0]))
        parts.append(Moved(Box(half), (radius + 0.5 * thickness) * offset, turn))
    # counter-clockwise with x to the right and z up: about -y
    spin = np.array([entry.turn_rate] if dimension == 2 else [0.0, -entry.turn_rate, 0.0])
    motion = steady_motion(centre, None, np.zeros(dimension), spin, 0.0, 2.0 * end)
    bodies = [Body(Union(*parts), name=name, friction=entry.friction, motion=motion)]
    if dimension == 3:
        for side, sign in (("min", 1.0), ("max", -1.0)):
            end_at = centre - sign * np.array([0.0, half[1], 0.0])
            bodies.append(_wall(f"{name}_y_{side}", sign * np.eye(3)[1], end_at, entry))
    return bodies


def _hopper(name: str, keys: _Keys, dimension: int, end: float) -> list[Body]:
    """Two plates from the sides of a box down to an outlet in its middle; the sides are those of a container."""
    entry = keys.entry
    (lower, upper), outlet, thickness = keys.corners(), keys.needed("outlet"), keys.needed("thickness")
    width, slope = float(upper[0] - lower[0]), math.radians(entry.slope_deg)
    if outlet >= width:
        raise InputError(f"{keys.field}.outlet", outlet, f"less than the hopper is wide, {width:g} m")
    length = 0.5 * (width - outlet) / math.cos(slope)
    half = np.array([0.5 * length, 0.5 * thickness])
    if dimension == 3:
        half = np.array([half[0], 0.5 * float(upper[1] - lower[1]), half[1]])
    bodies = []
    for side, sign in (("left", -1.0), ("right", 1.0)):
        place = 0.5 * (lower + upper)
        place[0] += sign * (0.5 * outlet + 0.5 * length * math.cos(slope) + 0.5 * thickness * math.sin(slope))
        place[-1] = entry.level + 0.5 * length * math.sin(slope) - 0.5 * thickness * math.cos(slope)
        turn = sign * slope
        rotation = exponential(np.array([turn] if dimension == 2 else [0.0, -turn, 0.0]))
        bodies.append(
            Body(
                Box(half), name=f"{name}_{side}", friction=entry.friction, position=place, rotation=rotation,
                motion=Fixed(),
            )
        )  # fmt: skip
    return bodies


_MAKERS: dict[str, Callable[[str, _Keys, int, float], list[Body]]] = {
    "grains": _grains, "floor_of_grains": _floor_of_grains, "stack": _stack, "card_house": _card_house,
    "container": _container, "drum": _drum, "hopper": _hopper,
}  # fmt: skip
