"""Grains inside a fluid by the two-phase material point method (seed B, chapter 8), as a `Model`."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.flows.suspension.state import SuspensionRecord, SuspensionState
from barchan.flows.suspension.stepper import Suspension
from barchan.scenes.granular.building import active_cells, build_grid, grid_fields
from barchan.scenes.kinds.suspension.building import (
    as_in_the_file,
    build_mixture,
    build_sides,
    build_suspension_options,
    remarks,
)
from barchan.scenes.kinds.suspension.matter import initial_grains
from barchan.scenes.kinds.suspension.observables import observables_of_frame
from barchan.scenes.kinds.suspension.parameters import SuspensionParameters
from barchan.scenes.kinds.suspension.profiles import profiles
from barchan.scenes.model import Arrays


class SuspensionModel:
    """The model of a scene of kind "suspension"; its states are `barchan.flows.suspension.SuspensionState`.

    Raises InputError for what the flow rejects, under the names of the scene file. Warns of choices that cannot do what they
    seem to ask for (`building.remarks`).
    """

    def __init__(self, parameters: SuspensionParameters) -> None:
        self._parameters = parameters
        self.grid_of_nodes = build_grid(parameters)
        said = remarks(parameters)
        with as_in_the_file():
            self.flow = Suspension(
                self.grid_of_nodes,
                build_mixture(parameters),
                build_sides(parameters.sides),
                gravity=parameters.scene.gravity,
                options=build_suspension_options(parameters),
            )
        for remark in said:
            warnings.warn(remark, stacklevel=2)

    def initial(self) -> SuspensionState:
        """The grains as they are at time 0, the fluid at rest."""
        grains = initial_grains(self._parameters, self.grid_of_nodes, self.flow.mixture.grains)
        return self.flow.at_rest(grains)

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> SuspensionState:
        """The state of a checkpoint."""
        return SuspensionState.from_arrays(arrays)

    def arrays(self, state: SuspensionState) -> Arrays:
        """The complete state, for a checkpoint."""
        return dict(state.arrays())

    def longest_step(self, state: SuspensionState) -> float:
        """The step of the scene, or less so that neither grains nor fluid cross more than their share of cells."""
        time = self._parameters.time
        if not time.adaptive:
            return time.step
        edge = min(self._parameters.spacing)
        limits = [time.step]
        for cells, velocities in (
            (time.cfl, state.grains.velocities),
            (time.fluid_cfl, state.fluid_velocities),
        ):
            speed = float(np.sqrt(np.max(np.sum(velocities**2, axis=1))))
            if speed > 0.0:
                limits.append(cells * edge / speed)
        return min(limits)

    def advance(self, state: SuspensionState, dt: float) -> tuple[SuspensionState, SuspensionRecord]:
        """One time step."""
        return self.flow.advance(state, dt)

    def ended(self, state: SuspensionState) -> bool:
        """Whether the grains rest."""
        if state.step == 0:
            return False
        speed = np.max(np.sum(state.grains.velocities**2, axis=1))
        return bool(speed < self._parameters.time.rest_speed**2)

    def frame(self, state: SuspensionState) -> dict[str, Arrays]:
        """Particles; nodes with grains; the whole grid with the fluid's fields; means over layers."""
        grains, grid = state.grains, self.grid_of_nodes
        fractions = self.flow.volume_fractions(state)
        groups: dict[str, Arrays] = {
            "particles": {
                "positions": grains.positions,
                "velocities": grains.velocities,
                "volumes": grains.volumes,
            },
            "grid": grid_fields(grid, grains),
            "fields": {
                "velocities": state.fluid_velocities,
                "pressures": state.pressures,
                "volume_fractions": fractions,
            },
            "lines": profiles(self._parameters, grid, state, fractions),
        }
        if state.step == 0:
            every = np.arange(grid.node_count)
            groups["mesh"] = {
                "positions": grid.node_positions(every),
                "cells": active_cells(every, grid.nodes),
            }
        return groups

    def observables(self, state: SuspensionState, record: SuspensionRecord | None) -> dict[str, float]:
        """Scalars of a frame (see `observables.py`)."""
        return observables_of_frame(self._parameters, state, record, self.flow.fluid.volumes)
