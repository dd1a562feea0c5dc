"""Where discrete elastic rods come to rest: Newton's method on the energy, held back by inertia while far away."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from barchan.bodies.fibres.model import FibreSystem
from barchan.bodies.fibres.rods.model import Rods
from barchan.bodies.fibres.rods.shape import RodShape

Vector = NDArray[np.float64]

_LARGEST_TURN = 0.3  # of an edge in one iteration: displacement across over length
_LONGEST_STEP = 1e6  # [s]: inertia no longer matters


@dataclass(frozen=True, eq=False)
class Rest:
    """Rods at rest, and how nearly.

    residual : the largest force left on a displacement, over the weight of its fibre plus the force EI / L^2 that bends one of
    its length L. The forces that keep edges at their lengths round to about 1e-16 EA.
    """

    shape: RodShape
    residual: float
    converged: bool
    iterations: int


def at_rest(
    rods: Rods, shape: RodShape, gravity: Vector, *, tolerance: float = 1e-6, max_iterations: int = 2000
) -> Rest:
    """Stable equilibrium that `shape` falls to under gravity (3,), its ends staying where they are.

    Implicit steps, each from rest, as long as no edge turns by more than 0.3: far away a descent, close to a minimum Newton's
    method. Forces are on the displacements that are not held.
    """
    none = np.zeros(rods.size)
    now = replace(shape, motion=none, velocities=np.zeros_like(shape.velocities))
    scales = np.repeat(_scales(rods, gravity), np.diff(rods.offsets))
    tensions, dt, shortest = rods.tensions(now), 1e-3, float(rods.rest_lengths.min())
    for iteration in range(max_iterations):
        system = rods.still_system(now, tensions, dt, gravity)
        residual = float(np.max(np.abs(system.forces) / scales))
        if residual <= tolerance:
            return Rest(now, residual, True, iteration)
        step = np.zeros(rods.size)
        step[rods.free] = dt * solved(rods, system)
        size = float(np.max(np.abs(step))) / shortest
        if size > _LARGEST_TURN:
            dt *= 0.5
            continue
        after = rods.displaced(now, step)
        now, tensions = after, rods.tensions_to(now, after)
        dt *= 2.0 if size < 0.5 * _LARGEST_TURN and dt < _LONGEST_STEP else 1.0
    return Rest(now, residual, False, max_iterations)


def _scales(rods: Rods, gravity: Vector) -> Vector:
    """(f,) weight of each fibre plus smallest EI / L^2 [N]."""
    fibre = np.repeat(np.arange(len(rods.radii)), np.diff(rods.node_offsets) - 1)
    lengths = np.bincount(fibre, rods.rest_lengths)
    bending = np.linalg.eigvalsh(rods.section.bending)[:, 0]
    scales: Vector = rods.section.mass * lengths * np.linalg.norm(gravity) + bending / lengths**2
    return scales


def solved(rods: Rods, system: FibreSystem) -> Vector:
    """Velocities (m,) of a system without contacts."""
    velocities = np.empty_like(system.forces)
    for i in range(len(rods.radii)):
        own = slice(rods.offsets[i], rods.offsets[i + 1])
        order = int(rods.offsets[i + 1] - rods.offsets[i])
        block = system.blocks[system.block_offsets[i] : system.block_offsets[i + 1]].reshape(order, order)
        velocities[own] = scipy.linalg.solve(block, system.forces[own], assume_a="pos")
    return velocities
