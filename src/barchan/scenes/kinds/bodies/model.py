"""Rigid bodies in frictional contact by Moreau and Jean's steps (seed B 2.2), as a `Model`."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.contact import crossing
from barchan.bodies.moreau import Assembly, AssemblyRecord, AssemblyState
from barchan.bodies.rigid import BodyStates
from barchan.scenes.kinds.bodies.building import (
    build_assembly,
    build_bodies,
    check_overlaps,
    size_of,
)
from barchan.scenes.kinds.bodies.frames import contact_frame, particle_frame
from barchan.scenes.kinds.bodies.observables import Contacts, Observer
from barchan.scenes.kinds.bodies.parameters import BodiesParameters
from barchan.scenes.model import Arrays

PROBLEMS_FOLDER = "problems"


@dataclass(frozen=True)
class BodiesRecord(AssemblyRecord):
    """A step. crossings : pairs of bodies of which one would cross the other in it at the speeds it begins with."""

    crossings: int


class MoreauModel:
    """The model of a scene of kind "bodies"; its states are `barchan.bodies.moreau.AssemblyState`.

    folder : run folder that friction problems are written to (`observe.write_problems_every`), or None.

    Raises InputError for bodies that cannot be made or overlap. Warns, once, of a step that lets a body cross another.
    """

    def __init__(self, parameters: BodiesParameters) -> None:
        self._parameters = parameters
        self.folder: Path | None = None
        self.bodies = build_bodies(parameters)
        self.assembly = build_assembly(parameters, self.bodies)
        check_overlaps(parameters, self.bodies, self._start.bodies, self.assembly.geometry)
        self._has_warned = False
        self._observer = Observer(parameters, self.bodies, self._start.bodies)

    @cached_property
    def _start(self) -> AssemblyState:
        """The bodies where they start, pushed apart where the scene asks for it."""
        start = self.assembly.started()
        if self._parameters.contact.relax == 0:
            return start
        return replace(start, bodies=relaxed(self._parameters, self.assembly, start))

    def initial(self) -> AssemblyState:
        """All bodies as they are at time 0."""
        return self._start

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> AssemblyState:
        """The state of a checkpoint."""
        return AssemblyState.from_arrays(arrays)

    def arrays(self, state: AssemblyState) -> Arrays:
        """The complete state, for a checkpoint."""
        return dict(state.arrays())

    def longest_step(self, state: AssemblyState) -> float:
        """The step of the scene."""
        return self._parameters.time.step

    def advance(self, state: AssemblyState, dt: float) -> tuple[AssemblyState, BodiesRecord]:
        """One time step; its friction problem goes to the run folder where the scene asks for it."""
        every = self._parameters.observe.write_problems_every
        if every and self.folder is not None and (state.step + 1) % every == 0:
            place = self.folder / PROBLEMS_FOLDER
            place.mkdir(exist_ok=True)
            self.assembly.write_problem(place / f"step_{state.step + 1:06d}.hdf5", state, dt)
        crossings = self._crossings(state, dt)
        new, record = self.assembly.advance(state, dt)
        return new, BodiesRecord(**vars(record), crossings=crossings)

    def ended(self, state: AssemblyState) -> bool:
        """Whether everything rests."""
        free = ~self.assembly.table.driven
        speeds = np.linalg.norm(state.bodies.velocities[free], axis=1)
        return state.step > 0 and bool(np.max(speeds) < self._parameters.time.rest_speed)

    def frame(self, state: AssemblyState) -> dict[str, Arrays]:
        """Bodies with their shapes, and the contacts that carry force."""
        loaded = state.forces[:, 0] > 0.0
        contacts = contact_frame(
            state.points[loaded], state.normals[loaded], state.world_forces()[loaded], state.pairs[loaded]
        )
        return {"particles": particle_frame(self.bodies, state.bodies), "contacts": contacts}

    def observables(self, state: AssemblyState, record: BodiesRecord | None) -> dict[str, float]:
        """Scalars of a frame (see `observables.py`)."""
        loaded = state.forces[:, 0] > 0.0
        contacts = Contacts(
            state.pairs[loaded], state.world_forces()[loaded], 0.0 if record is None else record.deepest
        )
        table = self.assembly.table
        return {
            "time": state.time,
            "kinetic_energy": table.kinetic_energy(state.bodies),
            "potential_energy": table.potential_energy(
                state.bodies, np.array(self._parameters.gravity_vector)
            ),
            **self._observer.observed(state.bodies, contacts, state.time),
            "certificate": 0.0 if record is None else record.residual,
        }

    @cached_property
    def _slow(self) -> float:
        """A way (m) in a step below which no body can cross another: half of the least extent of any body that has an end."""
        sizes = np.array([size_of(body) for body in self.bodies])
        return 0.5 * float(np.min(sizes[np.isfinite(sizes)]))

    def _crossings(self, state: AssemblyState, dt: float) -> int:
        """Number of pairs of which one would cross the other; a warning names the first pair found in the run."""
        speeds = np.linalg.norm(state.bodies.velocities, axis=1)
        if 2.0 * dt * float(np.max(speeds)) < self._slow:
            return 0
        found = crossing(self.assembly.geometry, state.bodies, None, dt)
        if len(found) and not self._has_warned:
            self._has_warned = True
            faster, slower = sorted(found.pairs[0], key=lambda number: -float(speeds[number]))
            warnings.warn(
                f"time.step = {dt:g} s is long: at t = {state.time:.4g} s {self.bodies[faster].name!r} goes "
                f"{found.ways[0]:.3g} m in one step and could cross {self.bodies[slower].name!r} "
                f"({found.allowed[0]:.3g} m would be safe)",
                stacklevel=2,
            )
        return len(found)


def relaxed(parameters: BodiesParameters, assembly: Assembly, start: AssemblyState) -> BodyStates:
    """The bodies pushed apart by at most `contact.relax` steps without gravity from rest, as long as an overlap is too deep."""
    pushing = Assembly(
        assembly.bodies, assembly.joints, 0.0,
        replace(assembly.options, restitution=0.0, tangential_restitution=0.0, recovery=1.0),
    )  # fmt: skip
    allowed = parameters.contact.allowed_overlap * min(
        size_of(body) for body in assembly.bodies if not body.driven
    )
    dt = parameters.time.step
    before = start.bodies
    rest = replace(before, velocities=np.zeros_like(before.velocities), spins=np.zeros_like(before.spins))
    for _ in range(parameters.contact.relax):
        # before time 0 prescribed bodies are at rest
        state, _ = pushing.advance(replace(start, time=-2.0 * dt, bodies=rest), dt)
        moved = state.bodies
        rest = replace(rest, positions=moved.positions, rotations=moved.rotations)
        gaps = pushing.geometry.detect(rest, 0.0).gaps
        if -float(np.min(gaps, initial=0.0)) <= allowed:
            break
    return replace(before, positions=rest.positions, rotations=rest.rotations)
