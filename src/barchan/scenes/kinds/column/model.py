"""The collapse of a granular column by the material point method (seed B 7.2.3, 7.3 and 7.5.1), as a `Model`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.flows.mpm import Material, State, Stepper, StepRecord, fill_box
from barchan.scenes.granular.building import build_grid, build_options, build_walls, grid_fields, longest_step
from barchan.scenes.kinds.column.observables import column_volume, geometry_observables
from barchan.scenes.kinds.column.parameters import ColumnParameters
from barchan.scenes.model import Arrays


class ColumnModel:
    """The model of a scene of kind "column"; its states are `barchan.flows.mpm.State`."""

    def __init__(self, parameters: ColumnParameters) -> None:
        self._parameters = parameters
        self.grid_of_nodes = build_grid(parameters)
        self.material = Material(**parameters.material.model_dump())
        self.stepper = Stepper(
            self.grid_of_nodes,
            self.material,
            build_walls(parameters.walls),
            gravity=parameters.scene.gravity,
            options=build_options(parameters.solver, parameters.particles),
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
        return longest_step(self._parameters, state.velocities)

    def advance(self, state: State, dt: float) -> tuple[State, StepRecord]:
        """One time step."""
        return self.stepper.advance(state, dt)

    def ended(self, state: State) -> bool:
        """A column is simulated to its end time."""
        return False

    def frame(self, state: State) -> dict[str, Arrays]:
        """Positions, velocities and volumes of the particles; active nodes, their fields and the active cells."""
        particles = {"positions": state.positions, "velocities": state.velocities, "volumes": state.volumes}
        return {"particles": particles, "grid": grid_fields(self.grid_of_nodes, state)}

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
