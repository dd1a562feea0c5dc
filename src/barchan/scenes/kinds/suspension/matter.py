"""The grains of a scene at its start: pieces filled, thinned to their volume fraction, their faces waved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from barchan.flows.mpm import Material, State
from barchan.flows.mpm.frames import initial_frames
from barchan.scenes.kinds.sand.matter import fill_piece
from barchan.scenes.kinds.sand.shapes import shape_of_piece
from barchan.scenes.kinds.suspension.entries import SuspendedPiece
from barchan.scenes.kinds.suspension.parameters import SuspensionParameters
from barchan.spaces import RegularGrid

Vector = NDArray[np.float64]


def initial_grains(parameters: SuspensionParameters, grid: RegularGrid, material: Material) -> State:
    """The particles of all pieces at time 0. Raises InputError for a piece that is not in the box."""
    positions, volumes, velocities, rooms = [], [], [], []
    random = np.random.default_rng(parameters.particles.seed)
    for name, piece in parameters.pieces():
        points, whole = fill_piece(f"matter.{name}", piece, grid, parameters.particles.per_cell, material, ())
        if piece.scatter > 0.0:
            points = scattered(piece, points, grid, parameters.particles.per_cell, random)
        if piece.ripple != 0.0:
            points, whole = rippled(piece, points, whole, parameters.box.size[0])
        positions.append(points)
        volumes.append(piece.packing * whole)
        rooms.append(whole / material.max_volume_fraction)
        velocity = np.zeros(grid.dimension) if piece.velocity is None else np.array(piece.velocity)
        velocities.append(np.tile(velocity, (len(whole), 1)))
    state = State.at_start(np.concatenate(positions), np.concatenate(volumes), np.concatenate(velocities))
    edges = np.concatenate(rooms) ** (1.0 / grid.dimension)
    return replace(state, frames=initial_frames(np.repeat(edges[:, None], grid.dimension, axis=1)))


def scattered(
    piece: SuspendedPiece, positions: Vector, grid: RegularGrid, per_cell: int, random: np.random.Generator
) -> Vector:
    """Particles of a piece, each moved at random within its own brick of the lattice, `scatter` of the way to its faces."""
    lower, upper = shape_of_piece("matter", piece, grid.dimension).bounds()
    reach = piece.scatter * grid.spacing / per_cell
    moved = positions + reach * (random.random(positions.shape) - 0.5)
    inside = np.maximum(lower, grid.origin), np.minimum(upper, grid.upper)
    return np.asarray(np.clip(moved, *inside))


def rippled(
    piece: SuspendedPiece, positions: Vector, volumes: Vector, length: float
) -> tuple[Vector, Vector]:
    """Particles of an upright box whose upper or lower face has become a wave: columns are stretched, their volumes with them.

    The opposite face stays, and the volume fraction is that of the box everywhere.
    """
    assert piece.size is not None
    height, middle = piece.size[-1], piece.position[-1]
    wave = piece.ripple * np.cos(piece.half_waves * np.pi * positions[:, 0] / length)
    low, high = middle - 0.5 * height, middle + 0.5 * height
    z, moved = positions[:, -1], positions.copy()
    if piece.rippled == "bottom":
        stretch = 1.0 - wave / height
        moved[:, -1] = high - (high - z) * stretch
    else:
        stretch = 1.0 + wave / height
        moved[:, -1] = low + (z - low) * stretch
    return moved, volumes * stretch
