"""Motions of roots and bodies as functions of time: to and fro, round, one soft turn."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.rigid import Prescribed
from barchan.bodies.rigid.rotations import exponential, identity, inverse, matrix, product
from barchan.scenes.kinds.fibres.entries import ObstacleEntry, RootsGroup

Vector = NDArray[np.float64]
Placement = Callable[[float], tuple[Vector, Vector]]

_AFTER = 4  # steps beyond the end of a run that keyframes reach


def root_motion(roots: RootsGroup) -> Placement:
    """Place of the pivot (3,) [m] and unit quaternion (4,) of what holds the roots, at a time [s]."""
    pivot = np.array(roots.pivot, dtype=np.float64)
    axis = np.array(roots.axis, dtype=np.float64)
    axis /= np.linalg.norm(axis)
    amplitude = np.array(roots.amplitude, dtype=np.float64)
    if roots.motion == "still":
        return lambda time: (pivot, identity(3))
    if roots.motion == "oscillation":
        return lambda time: (
            pivot + amplitude * math.sin(2.0 * math.pi * roots.frequency * _since(roots, time)),
            identity(3),
        )
    if roots.motion == "rotation":
        return lambda time: (pivot, exponential(roots.turn_rate * _since(roots, time) * axis))
    return lambda time: (pivot, exponential(math.radians(roots.angle_deg) * _soft(roots, time) * axis))


def _since(roots: RootsGroup, time: float) -> float:
    """Time [s] that the motion has lasted."""
    stop = math.inf if roots.stop is None else roots.stop
    return max(0.0, min(time, stop) - roots.start)


def _soft(roots: RootsGroup, time: float) -> float:
    """Share of a turn made: from 0 to 1 with neither speed nor acceleration at the ends."""
    x = min(max((time - roots.start) / roots.duration, 0.0), 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x * x)


def carried(place: Placement, position: Vector, rotation: Vector) -> Placement:
    """The motion of a body that starts at `position` with `rotation` and moves as what is at `place`."""
    first, turned = place(0.0)
    away = matrix(turned).T @ (position - first)

    def follow(time: float) -> tuple[Vector, Vector]:
        here, turn = place(time)
        return here + matrix(turn) @ away, product(product(turn, inverse(turned)), rotation)

    return follow


def swinging(entry: ObstacleEntry, position: Vector, rotation: Vector) -> Placement:
    """The motion of an oscillating body."""
    way = np.zeros(3) if entry.amplitude is None else np.array(entry.amplitude, dtype=np.float64)
    swing = np.zeros(3) if entry.swing is None else np.radians(np.array(entry.swing, dtype=np.float64))

    def place(time: float) -> tuple[Vector, Vector]:
        share = math.sin(2.0 * math.pi * entry.frequency * max(0.0, time - entry.start))
        return position + share * way, product(exponential(share * swing), rotation)

    return place


def keyframes(place: Placement, step: float, end: float) -> Prescribed:
    """A motion by keyframes at all steps [s] up to the end of a run [s]."""
    times = step * np.arange(math.ceil(end / step) + _AFTER, dtype=np.float64)
    rows = [place(float(time)) for time in times]
    return Prescribed(times, np.array([row[0] for row in rows]), np.array([row[1] for row in rows]))
