"""The collapse of a granular column by the material point method (seed B 7.2.3, 7.3 and 7.5.1), as a `Model`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.errors import InputError
from barchan.flows.mpm import Material, Options, State, Stepper, StepRecord, Wall, Walls, fill_box
from barchan.friction import methods
from barchan.scenes.kinds.column.observables import column_volume, geometry_observables
from barchan.scenes.kinds.column.parameters import FACES, ColumnParameters, FrictionalWall
from barchan.scenes.model import Arrays
from barchan.spaces import RegularGrid

# Corners of a cell in the order XDMF and VTK want them.
_CORNERS = {
    2: ((0, 0), (1, 0), (1, 1), (0, 1)),
    3: ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)),
}


class ColumnModel:
    """The model of a scene of kind "column"; its states are `barchan.flows.mpm.State`."""

    def __init__(self, parameters: ColumnParameters) -> None:
        self._parameters = parameters
        self.grid_of_nodes = build_grid(parameters)
        self.material = Material(**parameters.material.model_dump())
        self.stepper = Stepper(
            self.grid_of_nodes,
            self.material,
            build_walls(parameters),
            gravity=parameters.scene.gravity,
            options=build_options(parameters),
        )

    def initial(self) -> State:
        """The column at rest, a lattice of particles."""
        column, box = self._parameters.column, self._parameters.box
        lower = np.zeros(len(box.size))
        upper = np.array(box.size)
        lower[0] = column.position
        upper[0] = min(column.position + column.length, box.size[0])
        upper[-1] = min(column.height, box.size[-1])
        return fill_box(self.grid_of_nodes, lower, upper, self._parameters.particles.per_cell, self.material)

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> State:
        """The state of a checkpoint."""
        return State.from_arrays(arrays)

    def arrays(self, state: State) -> Arrays:
        """The complete state, for a checkpoint."""
        return dict(state.arrays())

    def longest_step(self, state: State) -> float:
        """The step of the scene, or less so that the fastest particle crosses at most `cfl` of the shortest cell edge."""
        time = self._parameters.time
        speed = float(np.sqrt(np.max(np.sum(state.velocities**2, axis=1))))
        if not time.adaptive or speed == 0.0:
            return time.step
        return min(time.step, time.cfl * min(self._parameters.spacing) / speed)

    def advance(self, state: State, dt: float) -> tuple[State, StepRecord]:
        """One time step."""
        return self.stepper.advance(state, dt)

    def ended(self, state: State) -> bool:
        """A column is simulated to its end time."""
        return False

    def frame(self, state: State) -> dict[str, Arrays]:
        """Positions, velocities and volumes of the particles; active nodes, their fields and the active cells."""
        particles = {"positions": state.positions, "velocities": state.velocities, "volumes": state.volumes}
        return {"particles": particles, "grid": self._grid(state)}

    def _grid(self, state: State) -> Arrays:
        """Active nodes, their fields and the active cells."""
        d = self._parameters.dimension
        # chi: lambda_N = Tr/sqrt(2d), so the pressure Tr/d is sqrt(2/d) lambda_N; |lambda_T| = sqrt(J2)
        # (ERRATA 1).
        stresses = state.node_stresses
        return {
            "node_ids": state.node_ids,
            "positions": self.grid_of_nodes.node_positions(state.node_ids),
            "cells": active_cells(state.node_ids, self.grid_of_nodes.nodes),
            "velocities": state.node_velocities,
            "stresses": stresses,
            "pressures": math.sqrt(2.0 / d) * stresses[:, 0],
            "shear_stresses": np.linalg.norm(stresses[:, 1:], axis=1),
            "volume_fractions": state.node_volume_fractions,
        }

    def observables(self, state: State, record: StepRecord | None) -> dict[str, float]:
        """Scalars of a frame (see `observables.py`); before the first step energies come from the particles."""
        material, gravity = self._parameters.material, self._parameters.scene.gravity
        masses = material.density * state.volumes
        volume = float(np.sum(state.volumes))
        values = {
            "time": state.time,
            **geometry_observables(self._parameters, state.positions, state.volumes),
            "kinetic_energy": 0.5 * float(np.sum(masses * np.sum(state.velocities**2, axis=1))),
            "potential_energy": gravity * float(np.sum(masses * state.positions[:, -1])),
            "max_speed": float(np.sqrt(np.max(np.sum(state.velocities**2, axis=1)))),
            "max_volume_fraction": material.max_volume_fraction,
            "volume": volume,
            "volume_drift": volume / column_volume(self._parameters) - 1.0,
        }
        if record is not None:
            names = ("kinetic_energy", "potential_energy", "max_speed", "max_volume_fraction")
            values |= {name: float(getattr(record, name)) for name in names}
        return values


def build_grid(parameters: ColumnParameters) -> RegularGrid:
    """The grid of the box, origin at the foot of the back wall."""
    return RegularGrid.from_box(parameters.box.size, parameters.box.cells)


def build_walls(parameters: ColumnParameters) -> Walls:
    """The walls of the box as the flow knows them."""
    faces: dict[str, Wall] = {}
    for face in FACES:
        choice = getattr(parameters.walls, face)
        if isinstance(choice, FrictionalWall):
            faces[face] = Wall("friction", choice.friction)
        elif choice is not None:
            faces[face] = Wall(choice)
    return Walls(faces)


def build_options(parameters: ColumnParameters) -> Options:
    """Solver and transfer options of the stepper. Raises InputError for a solver that does not exist."""
    solver, particles = parameters.solver, parameters.particles
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
