"""One step's discrete Coulomb friction problem, from the matter on the grid (seed B, Eq. 7.21-7.23 and 7.3.5).

Two steps: unconstrained velocities u* with inertia, gravity and Newtonian viscosity (7.22), then the frictional problem
with the lumped mass alone (7.23), written for the total velocity: M v = M u* + H^T r, u = H v + k.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from barchan.cones import Coulomb, normalised_friction, tensor_block_size
from barchan.errors import InputError
from barchan.flows.mpm.assembly import (
    compression_allowance,
    strain_operator,
    viscous_stiffness,
    with_wall_rows,
)
from barchan.flows.mpm.material import Material
from barchan.flows.mpm.state import State
from barchan.flows.mpm.transfer import GridMatter
from barchan.flows.mpm.walls import WallContacts, Walls, free_components, wall_contacts
from barchan.friction import Problem

# Masses below this share of a full cell's are raised to it in M, which bounds the Delassus operator; velocities and
# momenta of such nodes are computed with their true mass, and f = M u* with the raised one, so they move as before.
SMALLEST_MASS_SHARE = 1e-12


@dataclass(frozen=True, eq=False)
class StepProblem:
    """The frictional problem of a step and what it was made from.

    matter : the matter on the grid, n active nodes.
    contacts : the k contacts with frictional walls.
    problem : n + k blocks of size s; r in Pa, the first n blocks being contact stresses and the others wall tractions.
    start : (n + k, s) warm start [Pa].
    node_friction : (n,) physical friction coefficients.
    masses : (n,) lumped masses [kg] (seed B, Eq. 7.16).
    """

    matter: GridMatter
    contacts: WallContacts
    problem: Problem
    start: NDArray[np.float64]
    node_friction: NDArray[np.float64]
    masses: NDArray[np.float64]


def build_step_problem(
    matter: GridMatter,
    state: State,
    material: Material,
    walls: Walls,
    gravity: float,
    dt: float,
    viscous_tolerance: float,
) -> StepProblem:
    """Assemble the problem of a step of `dt` seconds from `matter`, the particles of `state` summed up on the grid.

    Raises InputError when the viscous step does not converge (viscosity or time step out of any proportion).
    """
    grid, nodes = matter.grid, matter.active.nodes
    free = free_components(grid, walls, nodes)
    strain = strain_operator(matter, free)
    contacts = wall_contacts(grid, walls, nodes, matter.volumes)
    start = warm_start(state, nodes, contacts)
    friction = node_friction(matter, strain, material, start[: len(nodes)])
    masses = material.density * matter.volumes
    inertia = np.maximum(masses, SMALLEST_MASS_SHARE * material.density * grid.cell_volume) / dt
    predicted = unconstrained_velocities(matter, material, free, inertia, gravity, dt, viscous_tolerance)
    allowance = compression_allowance(matter, material, dt)
    walls_at_rest = np.zeros((len(contacts.numbers), start.shape[1]))
    diagonal = np.repeat(inertia, grid.dimension)
    problem = Problem(
        M=sp.dia_array((diagonal[None, :], [0]), shape=(len(diagonal), len(diagonal))),
        f=diagonal * predicted.reshape(-1),
        H=with_wall_rows(strain, contacts, free),
        w=np.concatenate([allowance, walls_at_rest]).reshape(-1),
        law=Coulomb(
            np.concatenate([np.asarray(normalised_friction(friction, grid.dimension)), contacts.friction])
        ),
        block_size=start.shape[1],
        reference_force=reference_stress(state, material, gravity) * float(np.sqrt(len(start))),
    )
    return StepProblem(matter, contacts, problem, start, friction, masses)


def reference_stress(state: State, material: Material, gravity: float) -> float:
    """The mean overburden [Pa]: rho phi_max g times the mean height of the matter above its lowest particle.

    Residuals are relative to it where stresses are smaller (seed B, 7.5.3 measures them by the typical stress rho g L):
    a falling block, without stress, needs no more accuracy than the same block at rest.
    """
    return material.density * material.max_volume_fraction * gravity * mean_height(state)


def mean_height(state: State) -> float:
    """Height [m] of the centre of mass above the lowest particle."""
    height = state.positions[:, -1]
    return float(np.sum(state.volumes * height) / np.sum(state.volumes) - np.min(height))


def unconstrained_velocities(
    matter: GridMatter,
    material: Material,
    free: NDArray[np.bool_],
    inertia: NDArray[np.float64],
    gravity: float,
    dt: float,
    tolerance: float,
) -> NDArray[np.float64]:
    """u* (n, d) of (M / dt + A) u* = M u^{p->g} / dt + M g, by conjugate gradients (seed B, Eq. 7.22).

    `inertia` (n,) is M / dt. Components that are not `free` (n, d) are zero. Without viscosity u* = u^{p->g} + dt g.
    """
    velocities = matter.velocities.copy()
    velocities[:, -1] -= gravity * dt
    velocities[~free] = 0.0
    if material.viscosity == 0.0:
        return velocities
    stiffness = viscous_stiffness(matter, material.viscosity, free)
    diagonal = np.repeat(inertia, matter.grid.dimension)
    size = len(diagonal)
    scale = 1.0 / (diagonal + stiffness.diagonal())
    solution, info = spla.cg(
        spla.LinearOperator((size, size), matvec=lambda x: diagonal * x + stiffness @ x, dtype=np.float64),
        diagonal * velocities.reshape(-1),
        x0=velocities.reshape(-1),
        rtol=tolerance,
        maxiter=10 * size,
        M=spla.LinearOperator((size, size), matvec=lambda x: scale * x, dtype=np.float64),
    )
    if info != 0:
        raise InputError(
            "material.viscosity", material.viscosity, "small enough for the viscous step to be solvable"
        )
    return np.asarray(solution).reshape(velocities.shape)


def node_friction(
    matter: GridMatter, strain: sp.bsr_array, material: Material, stresses: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Physical mu(I) (n,) at the stress nodes, explicit: strain rate of u^{p->g}, pressure of `stresses` (n, s)."""
    count, d = matter.velocities.shape
    if not material.rate_dependent:
        return np.full(count, material.friction)
    rates = (strain @ matter.velocities.reshape(-1)).reshape(count, -1) / (2.0 * matter.volumes[:, None])
    shear_rate = np.sqrt(np.sum(rates[:, 1:] ** 2, axis=1))
    return material.friction_at(shear_rate, np.sqrt(2.0 / d) * stresses[:, 0])


def warm_start(state: State, nodes: NDArray[np.int64], contacts: WallContacts) -> NDArray[np.float64]:
    """(n + k, s) stresses of the last step, found again by node and by wall contact; zero at new ones."""
    d = state.dimension
    start = np.zeros((len(nodes) + len(contacts.keys), tensor_block_size(d)))
    here, before = _matches(nodes, state.node_ids)
    start[here] = state.node_stresses[before]
    here, before = _matches(contacts.keys, state.wall_keys)
    start[len(nodes) + here, :d] = state.wall_tractions[before]
    return start


def _matches(
    keys: NDArray[np.int64], known: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    _, here, before = np.intersect1d(keys, known, assume_unique=True, return_indices=True)
    return here, before
