"""A cloth in frictional contact by linearised implicit steps (seed B 4.3), as a `Model`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.cloth import ClothState
from barchan.bodies.cloth.checking import crossing_pair
from barchan.bodies.moreau import AssemblyRecord
from barchan.bodies.rigid import body_distance
from barchan.errors import InputError
from barchan.scenes.kinds.cloth.inverse import with_rest_shape
from barchan.scenes.kinds.cloth.making import build_assembly, build_cloth, build_obstacles
from barchan.scenes.kinds.cloth.observables import Observer
from barchan.scenes.kinds.cloth.parameters import ClothParameters
from barchan.scenes.model import Arrays

PROBLEMS_FOLDER = "problems"


class ClothModel:
    """The model of a scene of kind "cloth"; its states are `barchan.bodies.cloth.ClothState`.

    folder : run folder that friction problems are written to (`observe.write_problems_every`), or None.

    Raises InputError for a cloth or bodies that cannot be made, or that overlap at the start.
    """

    def __init__(self, parameters: ClothParameters) -> None:
        self._parameters = parameters
        self.folder: Path | None = None
        self.bodies = build_obstacles(parameters)
        self.cloth = build_cloth(parameters, self.bodies)
        self.assembly = build_assembly(parameters, self.cloth, self.bodies)
        self._check_overlaps()
        if parameters.inverse.rest_shape:
            self.cloth = with_rest_shape(parameters.inverse, self.assembly)
            self.assembly = build_assembly(parameters, self.cloth, self.bodies)
        self._observer = Observer(self.assembly)

    def _check_overlaps(self) -> None:
        start, thickness = self.assembly.started(), self.cloth.material.thickness
        if self._parameters.contact.self_contact:
            pair = crossing_pair(start.positions, self.cloth.mesh.triangles)
            if pair is not None:
                raise InputError(
                    "cloth.shape", list(pair), "a start at which no two triangles cut each other"
                )
        loose = ~self.cloth.pinned.mask
        for number, body in enumerate(self.bodies):
            gaps = body_distance(body, start.bodies.row(number), start.positions)[loose] - 0.5 * thickness
            if -np.min(gaps, initial=0.0) > self._parameters.contact.allowed_overlap * thickness:
                depth = f"{-np.min(gaps):.3g} m in, counting half its thickness"
                allowed = f"a place where the cloth is outside {body.name!r}: it is {depth}"
                raise InputError("cloth.position", self._parameters.cloth.position, allowed)

    def initial(self) -> ClothState:
        """The cloth as it is at time 0."""
        return self.assembly.started()

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> ClothState:
        """The state of a checkpoint."""
        return ClothState.from_arrays(arrays)

    def arrays(self, state: ClothState) -> Arrays:
        """The complete state, for a checkpoint."""
        return dict(state.arrays())

    def longest_step(self, state: ClothState) -> float:
        """The step of the scene."""
        return self._parameters.time.step

    def advance(self, state: ClothState, dt: float) -> tuple[ClothState, AssemblyRecord]:
        """One time step; its friction problem goes to the run folder where the scene asks for it."""
        every = self._parameters.observe.write_problems_every
        if every and self.folder is not None and (state.step + 1) % every == 0:
            place = self.folder / PROBLEMS_FOLDER
            place.mkdir(exist_ok=True)
            self.assembly.write_problem(place / f"step_{state.step + 1:06d}.hdf5", state, dt)
        return self.assembly.advance(state, dt)

    def ended(self, state: ClothState) -> bool:
        """Never before the end."""
        return False

    def frame(self, state: ClothState) -> dict[str, Arrays]:
        """The cloth as a mesh, and the contacts that carry force; bodies are where their motions say.

        Forces (k, 3) [N] are those on the cloth; `bodies` (k,) is the number of the body, -1 for the cloth itself.
        """
        loaded = state.pressing
        return {
            "grid": {
                "positions": state.positions, "velocities": state.velocities, "cells": self.cloth.mesh.triangles,
            },
            "contacts": {
                "positions": state.points[loaded], "normals": state.normals[loaded], "forces": state.forces[loaded],
                "bodies": state.contact_bodies[loaded],
            },
        }  # fmt: skip

    def observables(self, state: ClothState, record: AssemblyRecord | None) -> dict[str, float]:
        """Scalars of a frame (see `observables.py`)."""
        return self._observer.observed(state, record)
