"""Grains and rigid bodies in a box by the material point method (seed B 7.3 to 7.5), as a `Model`."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.rigid import check_bodies
from barchan.errors import InputError
from barchan.flows.mpm import State, Stepper, StepRecord
from barchan.scenes.granular.building import build_grid, build_walls, grid_fields, longest_step
from barchan.scenes.kinds.sand.matter import initial_state
from barchan.scenes.kinds.sand.motion import build_bodies
from barchan.scenes.kinds.sand.observables import body_observables, matter_observables, observed
from barchan.scenes.kinds.sand.options import build_materials, build_sand_options, remarks
from barchan.scenes.kinds.sand.parameters import SandParameters
from barchan.scenes.model import Arrays


class SandModel:
    """The model of a scene of kind "sand"; its states are `barchan.flows.mpm.State`.

    Raises InputError for bodies that overlap or are not in the box, an outlet narrower than a cell, options that do not fit.
    Warns of choices that cannot do what they seem to ask for (`options.remarks`).
    """

    def __init__(self, parameters: SandParameters) -> None:
        self._parameters = parameters
        self.grid_of_nodes = build_grid(parameters)
        self.materials = build_materials(parameters)
        self.bodies = build_bodies(parameters)
        check_outlets(parameters)
        if self.bodies:
            check_bodies(self.bodies, self.grid_of_nodes.origin, self.grid_of_nodes.upper)
        self.stepper = Stepper(
            self.grid_of_nodes,
            self.materials[0] if len(self.materials) == 1 else self.materials,
            build_walls(parameters.walls),
            gravity=parameters.gravity_vector,
            options=build_sand_options(parameters),
            bodies=tuple(self.bodies),
        )
        for remark in remarks(parameters):
            warnings.warn(remark, stacklevel=2)

    def initial(self) -> State:
        """All pieces of matter and bodies as they are at time 0."""
        made = initial_state(self._parameters, self.grid_of_nodes, self.materials, self.bodies)
        return self.stepper.started(made)

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> State:
        """The state of a checkpoint."""
        return State.from_arrays(arrays)

    def arrays(self, state: State) -> Arrays:
        """The complete state, for a checkpoint."""
        return dict(state.arrays())

    def longest_step(self, state: State) -> float:
        """The step of the scene, or less so that neither particle nor body crosses more than `cfl` of the shortest edge."""
        return longest_step(self._parameters, np.concatenate([state.velocities, state.bodies.velocities]))

    def advance(self, state: State, dt: float) -> tuple[State, StepRecord]:
        """One time step."""
        return self.stepper.advance(state, dt)

    def ended(self, state: State) -> bool:
        """Whether everything rests, or what is observed above a level has run out."""
        parameters, observe = self._parameters, self._parameters.observe
        if state.step == 0:
            return False
        if observe.level is not None and observe.until_share > 0.0:
            above = np.sum(state.volumes[state.positions[:, -1] > observe.level])
            if above < observe.until_share * self._volume_above_at_start:
                return True
        speeds = np.concatenate([state.velocities, state.bodies.velocities])
        return bool(np.max(np.sum(speeds**2, axis=1)) < parameters.time.rest_speed**2)

    def frame(self, state: State) -> dict[str, Arrays]:
        """Particles with what they carry; active nodes, their fields and the active cells; grains when they are wanted."""
        particles: Arrays = {
            "positions": state.positions, "velocities": state.velocities, "volumes": state.volumes
        }  # fmt: skip
        for name in ("materials", "cohesions"):
            if len(getattr(state, name)):
                particles[name] = getattr(state, name)
        groups = {"particles": particles, "grid": grid_fields(self.grid_of_nodes, state)}
        if len(state.grain_owners):
            groups["grains"] = {"positions": state.grain_positions, "owners": state.grain_owners}
        return groups

    def observables(self, state: State, record: StepRecord | None) -> dict[str, float]:
        """Scalars of a frame (see `observables.py`); the matter's kinetic energy is that of the last solve."""
        matter = matter_observables(self._parameters, state)
        if record is not None:
            matter["kinetic_energy"] = record.kinetic_energy
        return {
            "time": state.time,
            **matter,
            **observed(self._parameters, state.positions, state.volumes),
            **body_observables(self._parameters, self.bodies, state.bodies, matter),
        }

    @cached_property
    def _volume_above_at_start(self) -> float:
        """Volume (m^d) that was above the observed level at time 0."""
        start, level = self.initial(), self._parameters.observe.level
        return float(np.sum(start.volumes[start.positions[:, -1] > (level or 0.0)]))


def check_outlets(parameters: SandParameters) -> None:
    """Raise InputError for a hole or neck narrower than a cell: nothing that flows through it would be resolved."""
    across = parameters.spacing[:-1]
    for name, body in parameters.body_tables():
        edge = (
            across[0] if body.shape == "hourglass" else max(across)
        )  # the neck of an hourglass is a slit along y
        if body.hole is not None and body.hole < edge * (1.0 - 1e-9):
            raise InputError(f"bodies.{name}.hole", body.hole, f"at least one grid cell wide, {edge:g} m")
