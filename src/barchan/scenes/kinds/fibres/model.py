"""Fibres in frictional contact by linearised implicit steps (seed B 4.2), as a `Model`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.fibres.contact import fibre_contacts
from barchan.bodies.fibres.state import FibreState
from barchan.bodies.moreau import AssemblyRecord
from barchan.errors import InputError
from barchan.scenes.kinds.fibres.inverse import groomed
from barchan.scenes.kinds.fibres.making import build_assembly, build_model, build_obstacles
from barchan.scenes.kinds.fibres.parameters import FibresParameters
from barchan.scenes.model import Arrays

PROBLEMS_FOLDER = "problems"
_OVERLAP = 1e-6  # of a radius, at the start


class FibresModel:
    """The model of a scene of kind "fibres"; its states are `barchan.bodies.fibres.state.FibreState`.

    folder : run folder that friction problems are written to (`observe.write_problems_every`), or None.

    Raises InputError for fibres or bodies that cannot be made, or fibres that overlap at the start.
    """

    def __init__(self, parameters: FibresParameters) -> None:
        self._parameters = parameters
        self.folder: Path | None = None
        self.fibres = build_model(parameters)
        self.bodies = build_obstacles(parameters)
        self.assembly = build_assembly(parameters, self.fibres, self.bodies)
        self._start = self.assembly.started()
        self._check_overlaps()
        if parameters.inverse.target != "off":
            self.assembly = groomed(parameters, self.assembly)
            self.fibres, self._start = self.assembly.model, self.assembly.started()

    def _check_overlaps(self) -> None:
        contact, radius = self._parameters.contact, self._parameters.fibres.radius
        if not contact.touching:
            return
        nodes = self.fibres.centre_line(self._start.shape)
        found = fibre_contacts(self.assembly.layout, nodes, np.zeros_like(nodes), 1.0, 0.0, contact.bare)
        depth = -float(np.min(found.gaps, initial=0.0))
        if depth > _OVERLAP * radius:
            pair = found.fibres[int(np.argmin(found.gaps))].tolist()
            allowed = (
                f"fibres apart: numbers {pair[0]} and {pair[1]} overlap by {depth:.3g} m, the most of all"
            )
            raise InputError("fibres.spacing", self._parameters.fibres.spacing, allowed)

    def initial(self) -> FibreState[Any]:
        """All fibres as they are at time 0."""
        return self._start

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> FibreState[Any]:
        """The state of a checkpoint."""
        return self.assembly.restored(arrays)

    def arrays(self, state: FibreState[Any]) -> Arrays:
        """The complete state, for a checkpoint."""
        return dict(state.arrays())

    def longest_step(self, state: FibreState[Any]) -> float:
        """The step of the scene."""
        return self._parameters.time.step

    def advance(self, state: FibreState[Any], dt: float) -> tuple[FibreState[Any], AssemblyRecord]:
        """One time step; its friction problem goes to the run folder where the scene asks for it."""
        every = self._parameters.observe.write_problems_every
        if every and self.folder is not None and (state.step + 1) % every == 0:
            place = self.folder / PROBLEMS_FOLDER
            place.mkdir(exist_ok=True)
            self.assembly.write_problem(place / f"step_{state.step + 1:06d}.hdf5", state, dt)
        return self.assembly.advance(state, dt)

    def ended(self, state: FibreState[Any]) -> bool:
        """Never before the end."""
        return False

    def frame(self, state: FibreState[Any]) -> dict[str, Arrays]:
        """Nodes of the centre lines, fibre after fibre, with their volumes, and the contacts that carry force."""
        loaded = state.forces[:, 0] > 0.0
        nodes = self.fibres.centre_line(state.shape)
        fibre = np.repeat(np.arange(len(self.fibres.radii)), np.diff(self.fibres.node_offsets))
        particles = {
            "positions": nodes, "velocities": self.fibres.node_velocities(state.shape), "volumes": self._volumes(nodes),
            "fibres": fibre,
        }  # fmt: skip
        contacts = {
            "positions": state.contacts.points[loaded], "normals": state.contacts.normals[loaded],
            "forces": state.world_forces()[loaded], "pairs": state.contacts.fibres[loaded],
            "bodies": state.contacts.bodies[loaded],
        }  # fmt: skip
        return {"particles": particles, "contacts": contacts}

    def _volumes(self, nodes: NDArray[np.float64]) -> NDArray[np.float64]:
        """(p,) of the halves of the segments at each node [m^3]."""
        layout = self.assembly.layout
        halves = 0.5 * np.pi * layout.radii[layout.fibre] ** 2 * layout.lengths(nodes)
        count = len(nodes)
        return np.asarray(
            np.bincount(layout.first, halves, count) + np.bincount(layout.first + 1, halves, count)
        )

    def observables(self, state: FibreState[Any], record: AssemblyRecord | None) -> dict[str, float]:
        """Scalars of a frame: energies, contacts, forces, sliding, tips."""
        nodes, speeds = self.fibres.centre_line(state.shape), self.fibres.node_velocities(state.shape)
        tips = self.fibres.node_offsets[1:] - 1
        loaded = state.forces[:, 0] > 0.0
        sliding = state.sliding()
        bodies = loaded & (state.contacts.bodies >= 0)
        deepest = 0.0 if record is None else record.deepest
        tip, tip_speed = np.mean(nodes[tips], axis=0), np.mean(speeds[tips], axis=0)
        potential = self.fibres.potential_energy(state.shape, self.assembly.gravity_vector)
        return {
            "time": state.time,
            "kinetic_energy": self.fibres.kinetic_energy(state.shape),
            "potential_energy": potential,
            "max_speed": float(np.max(np.linalg.norm(speeds, axis=1))),
            "contacts": float(np.count_nonzero(loaded)),
            "contacts_with_bodies": float(np.count_nonzero(bodies)),
            "sliding_share": float(np.count_nonzero(sliding)) / max(1, int(np.count_nonzero(loaded))),
            "largest_force": float(np.max(np.linalg.norm(state.forces, axis=1), initial=0.0)),
            "deepest_overlap": deepest,
            "deepest_relative": deepest / self._parameters.fibres.radius,
            **{f"tip_{axis}": float(x) for axis, x in zip("xyz", tip, strict=True)},
            **{f"tip_v{axis}": float(v) for axis, v in zip("xyz", tip_speed, strict=True)},
            "tip_spread": float(np.sqrt(np.mean(np.sum((nodes[tips] - tip) ** 2, axis=1)))),
            "sweeps": 0.0 if record is None else float(record.sweeps),
            "certificate": 0.0 if record is None else record.residual,
        }
