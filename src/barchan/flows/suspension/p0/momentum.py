"""The problem of a step: inertia, drag, viscosity and pressure first, then contacts with all constraints (seed B, 8.3.3).

Unknowns are those of `barchan.flows.suspension.phases`: u_g in the n cells with grains and q in all c cells, M diagonal. The
Stokes-like step gives the volume average and, through it, both phases; around these the lumped problem (8.27)

    M v = M v* + H^T r + C^T p,   C v = k,   u = H v + w,   H = [B, 0],   C = [C_0 a, C_0 b]

has the strain operator, wall contacts and end-of-step packing rule of the dry model (`barchan.flows.dry.momentum`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.cones import Coulomb, normalised_friction, tensor_block_size
from barchan.flows.dry._kernels import STICKY
from barchan.flows.dry.cells import Cells
from barchan.flows.dry.momentum import (
    Contacts,
    cell_friction,
    compression_allowance,
    overburden,
    wall_contacts,
    with_wall_rows,
)
from barchan.flows.dry.strain import strain_operator
from barchan.flows.suspension.mixture import Mixture
from barchan.flows.suspension.p0.boundaries import Boundary, Sides
from barchan.flows.suspension.p0.options import Options
from barchan.flows.suspension.p0.pressure import Pressures
from barchan.flows.suspension.p0.state import SuspensionState
from barchan.flows.suspension.p0.stokes import VolumeStep, volume_step
from barchan.flows.suspension.p0.viscosity import Viscosity
from barchan.flows.suspension.phases import Phases, phases
from barchan.friction import Problem

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Setting:
    """What every step of a run shares; `boundaries` in the order of `cells.names`, gravity (d,)."""

    cells: Cells
    boundaries: tuple[Boundary, ...]
    sides: Sides
    pressures: Pressures
    viscosity: Viscosity
    mixture: Mixture
    gravity: Vector
    options: Options


@dataclass(frozen=True, eq=False)
class StepProblem:
    """The frictional problem of a step and what it was made from.

    problem : n + k blocks of size s; r in Pa.  algebra : of all cells.  first : the Stokes-like step.
    active : (n,) cells with grains.  contacts : with walls.  start : (n + k, s) warm start.  friction : (n,) physical.
    """

    problem: Problem
    algebra: Phases
    first: VolumeStep
    active: NDArray[np.int64]
    contacts: Contacts
    start: Vector
    friction: Vector

    def velocities(self, v: Vector) -> tuple[Vector, Vector, Vector]:
        """Velocities (c, d) of grains, fluid and volume average of unknowns (m,)."""
        d = self.algebra.a.shape[1]
        found = v.reshape(-1, d)
        grains = np.zeros(self.algebra.a.shape)
        grains[self.active] = found[: len(self.active)]
        rest = found[len(self.active) :]
        return grains, self.algebra.fluid(grains, rest), self.algebra.volume_average(grains, rest)


def build_step_problem(setting: Setting, state: SuspensionState, dt: float) -> StepProblem:
    """The problem of a step of `dt` seconds from `state`; raises InputError when the viscous step does not converge."""
    cells, mixture, grains = setting.cells, setting.mixture, setting.mixture.grains
    filled = state.fractions > setting.options.empty
    active, d = np.flatnonzero(filled), cells.dimension
    algebra, first, predicted = _first_step(setting, state, np.where(filled, state.fractions, 0.0), dt)
    fractions, volumes = state.fractions[active], cells.volumes[active]
    strain = strain_operator(cells, state.fractions, filled)
    contacts = wall_contacts(cells, setting.boundaries, state.fractions, filled)
    friction = np.full(len(active), float(grains.friction))
    if grains.rate_dependent:
        sheared = strain_operator(cells, state.fractions, filled, setting.sides.codes == STICKY)
        friction = cell_friction(
            sheared, state.carried_grains[active], state.stresses[active], fractions * volumes, grains
        )
    start = np.zeros((len(active) + len(contacts.cells), tensor_block_size(d)))
    start[: len(active)] = state.stresses[active]
    start[len(active) :, :d] = state.tractions[contacts.cells, contacts.sides]
    offset = _wall_motion(setting, contacts, start.shape)
    offset[: len(active), 0] = compression_allowance(fractions, volumes, grains, d) / dt
    inertia = np.concatenate([algebra.grain_inertia[active], algebra.rest_inertia]).reshape(-1)
    operator = with_wall_rows(strain, contacts)
    C_0, k = setting.pressures.divergence, setting.pressures.sources
    columns = (active[:, None] * d + np.arange(d)).reshape(-1)
    reference = overburden(
        cells, state.fractions, buoyant(mixture), grains.max_volume_fraction, setting.gravity
    )
    problem = Problem(
        M=sp.dia_array((inertia[None, :], [0]), shape=(len(inertia),) * 2),
        f=inertia * np.concatenate([predicted[0][active], predicted[1]]).reshape(-1),
        H=sp.bsr_array(
            (operator.data, operator.indices, operator.indptr), shape=(operator.shape[0], len(inertia))
        ),
        w=offset.reshape(-1),
        law=Coulomb(np.concatenate([normalised_friction(friction, d), contacts.coefficients(friction)])),
        C=sp.csr_array(
            sp.hstack([
                C_0[:, columns] @ sp.diags_array(algebra.a[active].reshape(-1)),
                C_0 @ sp.diags_array(algebra.b.reshape(-1)),
            ])
        ),
        k=k,
        block_size=start.shape[1],
        reference_force=reference * float(np.sqrt(len(start))),
    )  # fmt: skip
    return StepProblem(problem, algebra, first, active, contacts, start, friction)


def pressures_of(setting: Setting, step: StepProblem, stresses: Vector) -> Vector:
    """(p,) pressures of the step: those of its first part and those that answer to contact stresses ((n + k) s,)."""
    problem = step.problem
    free = (problem.f + problem.H.T @ stresses) / problem.M.diagonal()
    schur = setting.pressures.schur(step.algebra.volume_compliance)
    return np.asarray(step.first.pressures + schur(problem.k - problem.C @ free))


def _first_step(
    setting: Setting, state: SuspensionState, fractions: Vector, dt: float
) -> tuple[Phases, VolumeStep, tuple[Vector, Vector]]:
    """The algebra of the step, the volume average before contacts, and the unknowns (c, d) each that have it."""
    cells, mixture = setting.cells, setting.mixture
    slip = np.linalg.norm(state.carried_grains - state.carried_fluid, axis=1)
    drag = np.where(fractions > 0.0, mixture.drag.coefficient(fractions, slip, mixture), 0.0)
    algebra = phases(
        mixture.grains.density * fractions * cells.volumes,
        mixture.fluid_density * (1.0 - fractions) * cells.volumes,
        fractions, drag * cells.volumes, dt, cells.dimension, darcy=setting.options.darcy,
    )  # fmt: skip
    one, other = state.carried_grains, state.carried_fluid
    if setting.options.darcy:
        one = other = state.carried_mean
    grains, rest = algebra.predicted(one, other, setting.gravity)
    before = algebra.volume_average(grains, rest)
    inertia = 1.0 / algebra.volume_compliance
    coefficients = mixture.fluid_viscosity * mixture.effective_viscosity.ratio(
        fractions, mixture.grains.max_volume_fraction
    )
    first = volume_step(
        setting.pressures, setting.viscosity, inertia, before, coefficients, setting.options.viscous_tolerance
    )
    moved = algebra.with_volume_force(grains, rest, inertia * (first.velocities - before))
    return algebra, first, moved


def _wall_motion(setting: Setting, contacts: Contacts, shape: tuple[int, ...]) -> Vector:
    """w (n + k, s) of walls that move along themselves: less their velocity in the frames of the contacts."""
    offset = np.zeros(shape)
    along = setting.sides.sliding(setting.cells)[contacts.cells, contacts.sides]
    seen = -contacts.weights[:, None] * np.einsum("kij,kj->ki", contacts.frames, along)
    offset[shape[0] - len(seen) :, : seen.shape[1]] = seen
    return offset


def buoyant(mixture: Mixture) -> float:
    """|rho_g - rho_f| [kg/m^3], at least a thousandth of rho_f: what packed grains weigh inside the fluid."""
    return max(abs(mixture.grains.density - mixture.fluid_density), 1e-3 * mixture.fluid_density)
