"""One step's discrete Coulomb friction problem, from the matter on the grid (seed B, Eq. 7.21-7.24 and 7.3.5).

Two steps: unconstrained velocities u* with inertia, gravity and Newtonian viscosity (7.22), then the frictional problem
with the lumped mass alone (7.23), written for the total velocity: M v = M u* + H^T r, u = H v + k. Free rigid bodies add
their translation and rotation to v (7.24), in principal axes, so that M stays diagonal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.bodies.rigid import generalised_masses, predicted_velocities
from barchan.cones import Coulomb, DruckerPrager, FacetedCoulomb, tensor_block_size
from barchan.flows.mpm.assembly import compression_allowance, strain_operator
from barchan.flows.mpm.contacts import Contacts, joined, wall_contacts, with_contact_rows
from barchan.flows.mpm.material import Material, refuse_with_facets
from barchan.flows.mpm.rheology import Rheology, rheology
from barchan.flows.mpm.setting import Setting
from barchan.flows.mpm.state import State
from barchan.flows.mpm.stresses import StressRows, stress_rows
from barchan.flows.mpm.transfer import GridMatter, particles_to_grid
from barchan.flows.mpm.velocity import VelocityField, velocity_field
from barchan.flows.mpm.viscosity import unconstrained_velocities
from barchan.flows.mpm.walls import free_components
from barchan.friction import Problem

# Masses below this share of a full cell's are raised to it in M, which bounds the Delassus operator; velocities and
# momenta of such nodes are computed with their true mass, and f = M u* with the raised one, so they move as before.
SMALLEST_MASS_SHARE = 1e-12


@dataclass(frozen=True, eq=False)
class StepFields:
    """What the frictional problem of a step is made from.

    matter : the matter on the grid.  velocity : its n velocities.  rows : its q stresses.
    contacts : the k contacts with walls and bodies.  rheology : the law of the rows.
    start : (q + k, s) warm start [Pa], as r.
    """

    matter: GridMatter
    velocity: VelocityField
    rows: StressRows
    contacts: Contacts
    rheology: Rheology
    start: NDArray[np.float64]

    def stresses(self, r: NDArray[np.float64]) -> NDArray[np.float64]:
        """(q, s) contact stresses [Pa] of a solution r (q + k, s)."""
        own = r[: len(self.rows.ids)]
        if self.rheology.inverse_metric is None:
            return own.copy()
        return np.asarray(np.einsum("qst,qt->qs", self.rheology.inverse_metric, own))


@dataclass(frozen=True, eq=False)
class StepProblem(StepFields):
    """The frictional problem of a step, with what it was made from.

    problem : q + k blocks of size s; r in Pa, the first q blocks being contact stresses, multiplied by the metric where
        friction is anisotropic, and the others tractions.
    """

    problem: Problem

    @property
    def fields(self) -> StepFields:
        """All but the problem, whose matrices are most of the memory of a step."""
        return StepFields(self.matter, self.velocity, self.rows, self.contacts, self.rheology, self.start)


def build_step_problem(setting: Setting, state: State, dt: float, affine: bool) -> StepProblem:
    """Assemble the problem of a step of `dt` seconds; `affine`: whether nodes see the particles' velocity gradients.

    Raises InputError when the viscous step does not converge (viscosity or time step out of any proportion).
    """
    matter = particles_to_grid(setting.grid, state, affine=affine)
    if setting.coupling is not None:
        matter = replace(matter, free=setting.coupling.free_shares(state.bodies, matter.active.occupied))
    velocity = velocity_field(matter, state, setting.basis, setting.densities(state), affine)
    rows = stress_rows(setting.options.stress, matter, velocity, state)
    contacts = _contacts(setting, velocity, state, dt)
    free = free_components(setting.basis, setting.walls, velocity.ids)
    start = warm_start(setting, state, rows, contacts)
    material, count = setting.materials[0], len(rows.ids)
    inertia, predicted = _inertia(setting, state, velocity, free, dt)  # its matrices go before others come
    allowance = compression_allowance(rows, material.max_volume_fraction, material.packing_tolerance, dt)
    plain = strain_operator(rows, free)
    law = rheology(
        rows, plain, velocity.velocities, state, setting.materials, start[:count], allowance[:, 0] == 0.0
    )
    strain = plain
    if law.metric is not None and law.inverse_metric is not None:
        strain = strain_operator(rows, free, law.inverse_metric)
        start[:count] = np.einsum("qst,qt->qs", law.metric, start[:count])
    moving = setting.coupling.free if setting.coupling is not None else []
    boundary = np.zeros((len(contacts), start.shape[1]))
    boundary[:, : setting.grid.dimension] = contacts.velocities_of_boundary
    problem = Problem(
        M=sp.dia_array((inertia[None, :], [0]), shape=(len(inertia), len(inertia))),
        f=inertia * predicted,
        H=with_contact_rows(strain, contacts, free, len(moving)),
        w=np.concatenate([allowance, boundary]).reshape(-1),
        law=_law(law, contacts, setting.materials, setting.grid.dimension),
        block_size=start.shape[1],
        reference_force=reference_stress(setting, state) * float(np.sqrt(len(start))),
    )
    return StepProblem(matter, velocity, rows, contacts, law, start, problem)


def reference_stress(setting: Setting, state: State) -> float:
    """The mean overburden [Pa]: rho phi_max g times the mean height of the matter above its lowest particle.

    Residuals are relative to it where stresses are smaller (seed B, 7.5.3 measures them by the typical stress rho g L):
    a falling block, without stress, needs no more accuracy than the same block at rest.
    """
    density = float(np.sum(setting.masses(state)) / np.sum(state.volumes))
    bulk = density * setting.materials[0].max_volume_fraction
    return bulk * setting.weight * setting.mean_height(state)


def warm_start(setting: Setting, state: State, rows: StressRows, contacts: Contacts) -> NDArray[np.float64]:
    """(q + k, s) stresses of the last step, found again by name or carried with the particles; zero at new rows."""
    d, options = state.dimension, setting.options
    count = len(rows.ids)
    start = np.zeros((count + len(contacts), tensor_block_size(d)))
    if len(state.particle_stresses):
        if options.stress == "particles":
            start[:count] = state.particle_stresses
        else:
            start[:count] = rows.averages(state.volumes, state.particle_stresses)
    else:
        known, values = (
            (state.node_ids, state.node_stresses)
            if options.stress == "Q1"
            else (state.stress_ids, state.stresses)
        )
        here, before = _matches(rows.ids, known)
        start[here] = values[before]
    here, before = _matches(contacts.keys, state.contact_keys)
    start[count + here, :d] = state.contact_tractions[before]
    return start


def _contacts(setting: Setting, velocity: VelocityField, state: State, dt: float) -> Contacts:
    parts = [wall_contacts(velocity, setting.walls, _volumes(setting, velocity, state))]
    if setting.coupling is not None:
        parts += setting.coupling.contacts(state.bodies, velocity, setting.walls, dt, state.time)
    return joined(parts, setting.grid.dimension)


def _volumes(setting: Setting, velocity: VelocityField, state: State) -> NDArray[np.float64]:
    """(n,) volumes of matter at the velocity functions, from their masses and the mean density."""
    if setting.basis.name == "Q1":
        return velocity.matter.volumes
    return np.asarray(velocity.masses * float(np.sum(state.volumes) / np.sum(setting.masses(state))))


def _inertia(
    setting: Setting, state: State, velocity: VelocityField, free: NDArray[np.bool_], dt: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Diagonal of M [kg/s] and velocities without friction, of the matter and then of the free bodies."""
    options, d = setting.options, setting.grid.dimension
    heaviest = max(material.density for material in setting.materials)
    inertia = np.maximum(velocity.masses, SMALLEST_MASS_SHARE * heaviest * setting.grid.cell_volume) / dt
    etas = np.array([material.viscosity for material in setting.materials])
    viscosity = float(etas[0]) if len(etas) == 1 else etas[state.materials]
    predicted = unconstrained_velocities(
        velocity, viscosity, state.volumes, free, inertia, setting.gravity, dt, options.viscous_tolerance
    )
    masses, velocities = [np.repeat(inertia, d)], [predicted.reshape(-1)]
    for number in setting.coupling.free if setting.coupling is not None else []:
        body, row = setting.bodies[number], state.bodies.row(number)
        own = generalised_masses(body, row).reshape(-1)
        # Components that are held have no columns in H: any mass will do.
        masses.append(np.where(np.isinf(own), 1.0, own) / dt)
        velocities.append(predicted_velocities(body, row, setting.gravity, dt, state.time).reshape(-1))
    return np.concatenate(masses), np.concatenate(velocities)


def _law(
    law: Rheology, contacts: Contacts, materials: Sequence[Material], d: int
) -> Coulomb | DruckerPrager | FacetedCoulomb:
    """The law of the rows and of the contacts; faceted where any material is, at contacts too."""
    mu, shear, tensile, dilatancy = law.law_parameters(d)
    friction = np.concatenate([mu, contacts.friction])
    if any(material.faceted for material in materials):
        for material in materials:
            refuse_with_facets(material)
        return FacetedCoulomb(friction)
    if not (np.any(shear) or np.any(tensile) or np.any(dilatancy)):
        return Coulomb(friction)
    none = np.zeros(len(contacts))
    return DruckerPrager(
        friction,
        np.concatenate([shear, none]),
        np.concatenate([tensile, none]),
        np.concatenate([dilatancy, none]),
    )


def _matches(
    keys: NDArray[np.int64], known: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    _, here, before = np.intersect1d(keys, known, assume_unique=True, return_indices=True)
    return here, before
