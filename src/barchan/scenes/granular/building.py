"""From tables to the objects of `barchan.flows.mpm`, and what a frame stores of the grid."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from barchan.errors import InputError
from barchan.flows.mpm import Options, State, Wall, Walls
from barchan.friction import methods
from barchan.scenes.granular.parameters import (
    FACES,
    FrictionalWall,
    GranularParameters,
    ParticlesGroup,
    SolverGroup,
)
from barchan.scenes.model import Arrays
from barchan.scenes.parameters import Group
from barchan.spaces import RegularGrid

# Corners of a cell in the order XDMF and VTK want them.
_CORNERS = {
    2: ((0, 0), (1, 0), (1, 1), (0, 1)),
    3: ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)),
}


def build_grid(parameters: GranularParameters) -> RegularGrid:
    """The grid of the box, origin at its lower corner: the foot of the back wall."""
    return RegularGrid.from_box(parameters.box.size, parameters.box.cells)


def build_walls(walls: Group) -> Walls:
    """The walls of the box as the flow knows them."""
    faces: dict[str, Wall] = {}
    for face in FACES:
        choice = getattr(walls, face)
        if isinstance(choice, FrictionalWall):
            faces[face] = Wall("friction", choice.friction)
        elif choice is not None:
            faces[face] = Wall(choice)
    return Walls(faces)


def build_options(solver: SolverGroup, particles: ParticlesGroup) -> Options:
    """Solver and transfer options of the stepper. Raises InputError for a solver that does not exist."""
    if solver.method not in methods():
        raise InputError("solver.method", solver.method, "one of " + ", ".join(methods()))
    return Options(
        tolerance=solver.tolerance,
        max_sweeps=solver.max_sweeps,
        min_sweeps=solver.min_sweeps,
        method=solver.method,
        cfl=particles.move_cfl,
        transfer=particles.transfer,
    )


def longest_step(parameters: GranularParameters, velocities: NDArray[np.float64]) -> float:
    """The step (s) of the scene, or less so that what moves fastest, of `velocities` (n, d), crosses at most `cfl` of
    the shortest cell edge."""
    time = parameters.time
    speed = float(np.sqrt(np.max(np.sum(velocities**2, axis=1), initial=0.0)))
    if not time.adaptive or speed == 0.0:
        return time.step
    return min(time.step, time.cfl * min(parameters.spacing) / speed)


def grid_fields(grid: RegularGrid, state: State) -> Arrays:
    """Active nodes, their fields and the active cells."""
    d = grid.dimension
    # chi: lambda_N = Tr/sqrt(2d), so the pressure Tr/d is sqrt(2/d) lambda_N; |lambda_T| = sqrt(J2)
    # (ERRATA 1).
    stresses = state.node_stresses
    return {
        "node_ids": state.node_ids,
        "positions": grid.node_positions(state.node_ids),
        "cells": active_cells(state.node_ids, grid.nodes),
        "velocities": state.node_velocities,
        "stresses": stresses,
        "pressures": math.sqrt(2.0 / d) * stresses[:, 0],
        "shear_stresses": np.linalg.norm(stresses[:, 1:], axis=1),
        "volume_fractions": state.node_volume_fractions,
    }


def active_cells(node_ids: NDArray[np.int64], nodes: NDArray[np.int64]) -> NDArray[np.int32]:
    """Cells all of whose corners are active: (c, 2^d) numbers into `node_ids` (n,), in XDMF corner order.

    `node_ids` are increasing C-order flat indices into a grid with `nodes` (d,) nodes along each axis.
    """
    d = len(nodes)
    strides = np.array([math.prod(int(count) for count in nodes[axis + 1 :]) for axis in range(d)])
    coordinates = np.stack(np.unravel_index(node_ids, tuple(nodes)), axis=-1)
    first = node_ids[np.all(coordinates < np.asarray(nodes) - 1, axis=1)]
    ids = np.stack([first + int(np.dot(corner, strides)) for corner in _CORNERS[d]], axis=-1).reshape(
        -1, 2**d
    )
    numbers = np.minimum(np.searchsorted(node_ids, ids), max(len(node_ids) - 1, 0))
    whole = np.all(node_ids[numbers] == ids, axis=1) if len(node_ids) else np.zeros(len(ids), dtype=bool)
    return numbers[whole].astype(np.int32)
