"""Soft spheres on springs and dashpots (seed C 3.2), as a `Model` of the same scenes with the same output.

A step of the scene is many steps of velocity Verlet. Its certificate is the deepest overlap over the smallest radius: springs
stand for rigid grains only while that is small.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.coarse_graining import Interactions, effective_friction, inertial_number, volume_mean
from barchan.bodies.contact import ContactGeometry
from barchan.bodies.rigid import BodyStates, Sphere
from barchan.bodies.soft import Cell, Hertzian, Hookean, Piston, SoftState, from_bodies
from barchan.errors import InputError
from barchan.scenes.kinds.bodies.building import build_bodies, check_overlaps
from barchan.scenes.kinds.bodies.frames import contact_frame, particle_frame
from barchan.scenes.kinds.bodies.observables import Contacts, Observer
from barchan.scenes.kinds.bodies.parameters import BodiesParameters
from barchan.scenes.model import Arrays


@dataclass(frozen=True)
class SoftRecord:
    """A step of the scene: `sweeps` steps of the grains. residual : deepest overlap over the smallest radius, at its end."""

    step: int
    time: float
    dt: float
    contacts: int
    sweeps: int
    residual: float
    converged: bool
    kinetic_energy: float
    potential_energy: float
    max_speed: float
    deepest: float


class SoftModel:
    """The model of a scene of kind "bodies" with `contact.method = "soft"`; its states are `barchan.bodies.soft.SoftState`.

    Raises InputError for bodies that cannot be made, overlap, or are neither spheres nor fixed planes.
    """

    def __init__(self, parameters: BodiesParameters) -> None:
        self._parameters = parameters
        self.bodies = build_bodies(parameters)
        start = BodyStates.at_start(self.bodies)
        if parameters.cell.size is None:
            geometry = ContactGeometry.of(self.bodies, parameters.dimension)
            check_overlaps(parameters, self.bodies, start, geometry)
        self.spheres, self._start = from_bodies(
            self.bodies, contact_law(parameters), parameters.gravity_vector, cell_of(parameters, self.bodies),
            parameters.contact.rolling_friction,
        )  # fmt: skip
        if self.spheres.cell is not None:
            self._start = self.spheres.start(flowing(self._start.bodies, self.spheres.cell))
        self._rows = np.array(
            [number for number, body in enumerate(self.bodies) if isinstance(body.shape, Sphere)]
        )
        self._whole = start
        self._observer = Observer(parameters, self.bodies, start)
        share = 1.0 / parameters.contact.steps_per_contact
        self._dt = self.spheres.time_step(parameters.contact.largest_speed, share)

    def initial(self) -> SoftState:
        """All bodies as they are at time 0."""
        return self._start

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> SoftState:
        """The state of a checkpoint."""
        return SoftState.from_arrays(arrays)

    def arrays(self, state: SoftState) -> Arrays:
        """The complete state, for a checkpoint."""
        return dict(state.arrays())

    def longest_step(self, state: SoftState) -> float:
        """Time between records."""
        return self._parameters.time.step

    def advance(self, state: SoftState, dt: float) -> tuple[SoftState, SoftRecord]:
        """As many equal steps as the springs need to cover `dt` seconds."""
        count = math.ceil(dt / self._dt)
        new = self.spheres.advance(state, dt / count, count)
        contacts = self.spheres.contacts(new)
        deepest = self._deepest(contacts, new)
        free = ~self.spheres.held
        bodies, masses = self._seen(new), self.spheres.masses[free]
        speeds, spins = (np.sum(rates[free] ** 2, axis=1) for rates in (bodies.velocities, bodies.spins))
        residual = deepest / float(np.min(self.spheres.radii))
        record = SoftRecord(
            step=round(new.time / self._parameters.time.step), time=new.time, dt=dt, contacts=len(contacts.first),
            sweeps=count, residual=residual, converged=residual <= self._parameters.contact.most_overlap,
            kinetic_energy=0.5 * float(masses @ speeds + self.spheres.moments[free] @ spins),
            potential_energy=-float(masses @ (bodies.positions[free] @ self.spheres.gravity)),
            max_speed=math.sqrt(float(np.max(speeds))), deepest=deepest,
        )  # fmt: skip
        return new, record

    def ended(self, state: SoftState) -> bool:
        """Whether everything rests."""
        speeds = np.linalg.norm(self._seen(state).velocities[~self.spheres.held], axis=1)
        return state.time > 0.0 and bool(np.max(speeds) < self._parameters.time.rest_speed)

    def frame(self, state: SoftState) -> dict[str, Arrays]:
        """Bodies with their shapes, and the contacts."""
        contacts = self.spheres.contacts(state)
        return {
            "particles": particle_frame(self.bodies, self._all(state)),
            "contacts": contact_frame(
                contacts.points, contacts.normals, contacts.forces, self._pairs(contacts)
            ),
        }

    def observables(self, state: SoftState, record: SoftRecord | None) -> dict[str, float]:
        """Scalars of a frame (see `observables.py`), energies in springs and lost, and the means of a periodic cell."""
        contacts = self.spheres.contacts(state)
        energy = self.spheres.energy(replace(state, bodies=self._seen(state)))
        deepest = self._deepest(contacts, state)
        seen = Contacts(self._pairs(contacts), contacts.forces, deepest)
        return {
            "time": state.time,
            "kinetic_energy": energy.translation + energy.rotation,
            "potential_energy": energy.gravity,
            "elastic_energy": energy.normal + energy.tangential,
            "dissipated_energy": energy.dissipated,
            **self._observer.observed(self._all(state), seen, state.time),
            "certificate": deepest / float(np.min(self.spheres.radii)),
            **self._cell_means(state),
        }

    def _seen(self, state: SoftState) -> BodyStates:
        """The grains; in a periodic cell with velocities relative to their centre of mass, which nothing holds in place."""
        if self.spheres.cell is None:
            return state.bodies
        masses = self.spheres.masses
        mean = masses @ state.bodies.velocities / np.sum(masses)
        return replace(state.bodies, velocities=state.bodies.velocities - mean)

    def _all(self, state: SoftState) -> BodyStates:
        """The states of all bodies, walls included."""
        arrays = {name: np.array(values) for name, values in self._whole.arrays().items()}
        for name, values in self._seen(state).arrays().items():
            arrays[name][self._rows] = values
        return BodyStates.from_arrays(arrays)

    def _pairs(self, contacts: Interactions) -> NDArray[np.int32]:
        """Numbers (k, 2) of the bodies in contact; -1 for a wall or a fixed grain."""
        second = np.where(contacts.second >= 0, self._rows[np.maximum(contacts.second, 0)], -1)
        return np.stack([self._rows[contacts.first], second], axis=1).astype(np.int32)

    def _deepest(self, contacts: Interactions, state: SoftState) -> float:
        """Deepest overlap [m]: between grains from their branches, on walls from the arm."""
        if len(contacts.first) == 0:
            return 0.0
        radii, lengths = self.spheres.radii, np.linalg.norm(contacts.branches, axis=1)
        between = contacts.second >= 0
        reach = radii[contacts.first] + np.where(between, radii[np.maximum(contacts.second, 0)], 0.0)
        # the arm of a wall ends in the middle of the overlap
        depth = np.where(between, reach - lengths, 2.0 * (reach - lengths))
        return max(0.0, float(np.max(depth)))

    def _cell_means(self, state: SoftState) -> dict[str, float]:
        """Stress, friction, inertial number and volume fraction of a periodic cell (`coarse_graining.rheology`)."""
        if self.spheres.cell is None:
            return {}
        d = self.spheres.dimension
        grains, contacts = self.spheres.grains(state)
        volume = float(np.prod(self.spheres.cell.lengths[:-1]) * state.cell.height)
        gradient = np.zeros((d, d))
        gradient[0, -1] = self.spheres.cell.shear_rate
        mean = volume_mean(grains, contacts, volume, gradient)
        pressure = float(np.trace(mean.stress)) / d
        values = {
            "cell_height": state.cell.height,
            "pressure": pressure,
            "normal_stress": float(mean.stress[-1, -1]),
            "shear_stress": -float(mean.stress[0, -1]),
            "volume_fraction": mean.volume_fraction,
            "temperature": mean.temperature,
        }
        if pressure > 0.0:
            diameter = 2.0 * float(np.mean(self.spheres.radii))
            density = float(np.mean(self.spheres.densities))
            number = inertial_number(gradient[None], np.array([pressure]), diameter, density)
            values |= {
                "friction": float(effective_friction(mean.stress[None])[0]),
                "inertial_number": float(number[0]),
            }
        else:
            values |= {"friction": 0.0, "inertial_number": 0.0}
        return values


def flowing(bodies: BodyStates, cell: Cell) -> BodyStates:
    """The grains of a sheared cell moving with it at the start, besides the velocities they are given."""
    velocities = bodies.velocities.copy()
    velocities[:, 0] += cell.shear_rate * (bodies.positions[:, -1] - 0.5 * cell.lengths[-1])
    return replace(bodies, velocities=velocities)


def contact_law(parameters: BodiesParameters) -> Hookean | Hertzian:
    """The springs and dashpots of [contact]."""
    contact = parameters.contact
    if contact.law == "hookean":
        return Hookean.of_restitution(contact.stiffness, contact.restitution)
    return Hertzian.of_restitution(contact.young_modulus, contact.restitution, contact.poisson_ratio)


def cell_of(parameters: BodiesParameters, bodies: list[Any]) -> Cell | None:
    """The periodic cell of [cell]; a piston weighs a tenth of the grains and is damped in the time a wave takes."""
    cell = parameters.cell
    if cell.size is None:
        return None
    if any(not isinstance(body.shape, Sphere) for body in bodies):
        raise InputError("cell.size", cell.size, "left out, or spheres alone: a periodic cell has no walls")
    piston = None
    if cell.pressure > 0.0:
        ground = float(np.prod(cell.size[:-1]))
        mass = 0.1 * sum(body.mass for body in bodies if not body.driven) / ground
        piston = Piston(cell.pressure, mass, math.sqrt(cell.size[-1] * mass / cell.pressure))
    return Cell(cell.size, None, cell.shear_rate, piston)
