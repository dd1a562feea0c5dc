"""Bodies and contact forces of a stored run, frame by frame, and the window that pictures of them show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.rigid import Body, Moved, Shape, Sphere, Union
from barchan.bodies.rigid.rotations import matrix
from barchan.results.reader import Results

Vector = NDArray[np.float64]
Window = tuple[Vector, Vector]  # lower and upper corner (d,) [m] of what a picture shows

_MARGIN = 0.04  # of the window, round what moves
_FAR_SHARE = 0.995  # of the free bodies that the window is sure to hold
_FRAMES_LOOKED_AT = 12
_STILL = 0.01  # of sqrt(g R): the least speed at the upper end of a colour scale
_SLIMMEST = 0.5  # width of the window over its height, and the reverse for the height
_FLATTEST = 0.12
_NEAR = 2.0  # radii of a body, from its centre to a contact of its own


@dataclass(frozen=True, eq=False)
class Forces:
    """Contacts with force: points (k, d) [m], forces (k, d) [N] on the first body, pairs (k, 2) of numbers, sizes (k,) [N]."""

    points: Vector
    forces: Vector
    pairs: NDArray[np.int64]

    @property
    def sizes(self) -> Vector:
        """(k,) [N]."""
        return np.linalg.norm(self.forces, axis=1)


class BodyScene:
    """`bodies` as they are in the frames of `results`; `colour` is "speed" (m/s) or "size" (m)."""

    def __init__(self, bodies: Sequence[Body], results: Results, colour: str = "speed") -> None:
        self.bodies, self.results, self.colour = bodies, results, colour

    @property
    def times(self) -> Vector:
        """(frames,) [s]."""
        return np.asarray(self.results.times)

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """(k,) bodies that forces move."""
        return np.array([not body.driven for body in self.bodies])

    @cached_property
    def spheres(self) -> NDArray[np.int64]:
        """Numbers of the bodies that are spheres."""
        return np.flatnonzero([isinstance(body.shape, Sphere) for body in self.bodies])

    @cached_property
    def radii(self) -> Vector:
        """(k,) radii [m] of spheres, half of the greatest extent of other bounded bodies, 0 of unbounded ones."""
        return np.array([_radius(body) for body in self.bodies])

    def places(self, frame: int) -> Vector:
        """(k, d) [m]."""
        return np.asarray(self.results.particles(frame)["positions"], dtype=np.float64)

    def turns(self, frame: int) -> list[Vector]:
        """Rotation matrices (d, d) of all bodies."""
        return [matrix(row.astype(np.float64)) for row in self.results.particles(frame)["rotations"]]

    def values(self, frame: int) -> Vector:
        """(k,) what bodies are coloured by."""
        if self.colour == "size":
            return 2.0 * self.radii
        return np.linalg.norm(self.results.particles(frame)["velocities"], axis=1).astype(np.float64)

    @property
    def label(self) -> str:
        """What the colours mean."""
        return "size (m)" if self.colour == "size" else "speed (m/s)"

    @cached_property
    def scale(self) -> tuple[float, float]:
        """Ends of the colour scale over the frames that pictures show."""
        seen = np.concatenate([self.values(frame)[self.free] for frame in self.looked_at])
        if self.colour == "size":
            return 0.0, float(np.max(seen))
        # what rests but for the solver's tolerance must not look as if it moved
        gravity = float(self.results.scene["scene"].get("gravity", 0.0))
        least = _STILL * np.sqrt(gravity * float(np.mean(self.radii[self.free])))
        return 0.0, max(float(np.quantile(seen, 0.995)), least, 1e-9)

    def forces(self, frame: int) -> Forces:
        """Contacts of a frame."""
        group = self.results._group(frame, "contacts")
        return Forces(
            group["positions"].astype(np.float64), group["forces"].astype(np.float64), group["pairs"]
        )

    def chains(self, frame: int) -> tuple[Vector, Vector]:
        """Pieces (m, 2, d) of force chains, from the centres of free bodies to their contacts, and the forces (m,) [N].

        Contacts with the image of a body in the next periodic cell are left out on the far side.
        """
        forces, places = self.forces(frame), self.places(frame)
        pieces, strengths = [np.zeros((0, 2, places.shape[1]))], [np.zeros(0)]
        for side in range(2):
            number = np.maximum(forces.pairs[:, side], 0)
            near = np.linalg.norm(places[number] - forces.points, axis=1) <= _NEAR * self.radii[number]
            chosen = (forces.pairs[:, side] >= 0) & self.free[number] & near
            pieces.append(np.stack([places[number], forces.points], axis=1)[chosen])
            strengths.append(forces.sizes[chosen])
        return np.concatenate(pieces), np.concatenate(strengths)

    @cached_property
    def looked_at(self) -> list[int]:
        """Some frames, evenly spread."""
        count = min(_FRAMES_LOOKED_AT, self.results.frames)
        return sorted({round(k) for k in np.linspace(0, self.results.frames - 1, count)})

    @cached_property
    def window(self) -> Window:
        """What pictures of the whole run show."""
        return self.window_of(self.looked_at)

    def window_of(self, frames: Sequence[int]) -> Window:
        """Corners that hold nearly all free bodies of these frames, and the bounded driven ones near."""
        bounded = self.free & np.isfinite(self.radii)
        low, high = [], []
        for frame in frames:
            places, radii = self.places(frame)[bounded], self.radii[bounded, None]
            low.append(np.quantile(places - radii, 1.0 - _FAR_SHARE, axis=0))
            high.append(np.quantile(places + radii, _FAR_SHARE, axis=0))
        lower, upper = np.min(low, axis=0), np.max(high, axis=0)
        places, turns = self.places(frames[-1]), self.turns(frames[-1])
        for number in np.flatnonzero(~self.free & (self.radii > 0.0)).tolist():
            least, most = _box(self.bodies[number].shape, places[number], turns[number])
            near = np.all((least < upper) & (most > lower))
            if near and self.radii[number] < 2.0 * float(np.max(upper - lower)):
                lower, upper = np.minimum(lower, least), np.maximum(upper, most)
        margin = _MARGIN * float(np.max(upper - lower))
        lower, upper = lower - margin, upper + margin
        size = upper - lower
        wider = 0.5 * max(0.0, _SLIMMEST * float(size[-1]) - float(size[0]))
        lower[0], upper[0] = lower[0] - wider, upper[0] + wider
        upper[-1] += max(0.0, _FLATTEST * float(size[0]) - float(size[-1]))
        return lower, upper


def _radius(body: Body) -> float:
    if isinstance(body.shape, Sphere):
        return body.shape.radius
    lower, upper = body.shape.bounds()
    extent = float(np.max(np.maximum(np.abs(lower), np.abs(upper))))
    return extent if np.isfinite(extent) else 0.0


def _box(shape: Shape, place: Vector, turn: Vector) -> Window:
    """Corners of a box round a bounded shape, along the axes of the world."""
    if isinstance(shape, Union):
        lower, upper = zip(*(_box(part, place, turn) for part in shape.parts), strict=True)
        return np.min(lower, axis=0), np.max(upper, axis=0)
    if isinstance(shape, Moved):
        return _box(shape.shape, place + turn @ shape.offset, turn @ matrix(shape.rotation))
    least, most = shape.bounds()
    middle, half = turn @ (0.5 * (least + most)), np.abs(turn) @ (0.5 * (most - least))
    return place + middle - half, place + middle + half
