"""One step's frictional problem inside a fluid: the velocities of grains and of the rest, with u_v free of divergence.

    M v = f + H^T r + C^T p,  C v = k,  u = H v + w,      v = (u_g at nodes with grains; q at all nodes; slacks)

M is diagonal (`phases`), H the strain operator and the contacts of the dry model, C = [B diag(a), B diag(b)] the weak
divergence of u_v (seed B, Eq. 8.26). A penalised pressure, C v = -c p, is a slack velocity s of inertia 1 / c for every row:
C v + s = 0. Such problems are ordinary bilateral ones and are certified as these are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.cones import Coulomb, DruckerPrager
from barchan.flows.mpm.assembly import compression_allowance, strain_operator
from barchan.flows.mpm.contacts import Contacts, wall_contacts, with_contact_rows
from barchan.flows.mpm.momentum import warm_start
from barchan.flows.mpm.rheology import Rheology, rheology
from barchan.flows.mpm.setting import Setting
from barchan.flows.mpm.state import State
from barchan.flows.mpm.stresses import StressRows, stress_rows
from barchan.flows.mpm.transfer import GridMatter, particles_to_grid
from barchan.flows.mpm.velocity import VelocityField, velocity_field
from barchan.flows.suspension.phases import Phases
from barchan.friction import Problem

Vector = NDArray[np.float64]

# Inertia below this share of a full cell's is raised to it in M; momenta are those of the true one.
SMALLEST_INERTIA_SHARE = 1e-12


@dataclass(frozen=True, eq=False)
class GrainRows:
    """The granular part of a step: matter on the grid, velocities, stresses, contacts, their operator H and offset w.

    strain : (q s, n d) with zero columns where the boundary holds the grains.  operator : with the contacts below.
    offset : ((q + k) s,) w.  start : (q + k, s) [Pa] warm start.
    """

    matter: GridMatter
    velocity: VelocityField
    rows: StressRows
    contacts: Contacts
    rheology: Rheology
    operator: sp.bsr_array
    offset: Vector
    start: Vector

    @property
    def law(self) -> Coulomb | DruckerPrager:
        """The law of rows and contacts."""
        mu, shear, tensile, dilatancy = self.rheology.law_parameters(self.matter.grid.dimension)
        friction = np.concatenate([mu, self.contacts.friction])
        if not (np.any(shear) or np.any(tensile) or np.any(dilatancy)):
            return Coulomb(friction)
        none = np.zeros(len(self.contacts))
        return DruckerPrager(
            friction,
            np.concatenate([shear, none]),
            np.concatenate([tensile, none]),
            np.concatenate([dilatancy, none]),
        )

    def stresses(self, r: Vector) -> Vector:
        """(q, s) contact stresses [Pa] of a solution r (q + k, s)."""
        return r[: len(self.rows.ids)].copy()


def grains_on_grid(setting: Setting, grains: State, affine: bool) -> tuple[GridMatter, VelocityField]:
    """The grains as the nodes of their cells see them."""
    matter = particles_to_grid(setting.grid, grains, affine=affine)
    return matter, velocity_field(matter, grains, setting.basis, setting.densities(grains), affine)


def grain_rows(
    setting: Setting, grains: State, matter: GridMatter, velocity: VelocityField, moving: NDArray[np.bool_], held: Vector,
    dt: float,
) -> GrainRows:  # fmt: skip
    """Stresses and contacts of the grains; `moving` (n, d) whether u_g is an unknown, else it is `held` (n, d)."""
    rows = stress_rows(setting.options.stress, matter, velocity, grains)
    contacts = wall_contacts(velocity, setting.walls, matter.volumes)
    contacts = replace(contacts, driven=contacts.areas[:, None] * held[contacts.indices])
    start = warm_start(setting, grains, rows, contacts)
    material, count = setting.materials[0], len(rows.ids)
    allowance = compression_allowance(rows, material.max_volume_fraction, material.packing_tolerance, dt)
    strain = strain_operator(rows, moving)
    seen = strain
    offset = allowance.reshape(-1)
    if np.any(held):
        seen = strain_operator(rows, np.ones_like(moving))
        offset = offset + seen @ np.where(moving, 0.0, held).reshape(-1)
    law = rheology(
        rows, seen, velocity.velocities, grains, setting.materials, start[:count], allowance[:, 0] == 0.0
    )
    boundary = np.zeros((len(contacts), start.shape[1]))
    boundary[:, : setting.grid.dimension] = contacts.velocities_of_boundary
    operator = with_contact_rows(strain, contacts, moving, 0)
    offset = np.concatenate([offset, boundary.reshape(-1)])
    return GrainRows(matter, velocity, rows, contacts, law, operator, offset, start)


def constraint(
    divergence: sp.csr_array, algebra: Phases, nodes: NDArray[np.int64]
) -> tuple[sp.csr_array, Vector]:
    """C (c, (n_g + n) d) and k (c,) of B u_v = 0; `nodes` (n_g,) those with grains."""
    columns = (nodes[:, None] * algebra.a.shape[1] + np.arange(algebra.a.shape[1])).reshape(-1)
    of_grains = sp.csr_array(divergence[:, columns] @ sp.diags_array(algebra.a.reshape(-1)[columns]))
    of_rest = sp.csr_array(divergence @ sp.diags_array(algebra.b.reshape(-1)))
    together = sp.csr_array(sp.hstack([of_grains, of_rest], format="csr"))
    together.eliminate_zeros()
    return together, -(divergence @ algebra.given.reshape(-1))


def lumped_problem(
    grains: GrainRows,
    algebra: Phases,
    predicted: tuple[Vector, Vector],
    bilateral: tuple[sp.csr_array, Vector],
    slacks: tuple[Vector, Vector] | None,
    heaviest: float,
    reference: float,
) -> Problem:
    """The problem of the second step around `predicted` unknowns (u_g, q), each (n, d) (seed B, Eq. 8.27).

    slacks : of penalised pressures, (c,) inertia 1 / c and (c,) pressures that the first step has left.
    heaviest : M of a full cell.  reference : stress of the certificate [Pa].
    """
    nodes, d = grains.velocity.ids, algebra.a.shape[1]
    own, rest = predicted[0][nodes].reshape(-1), predicted[1].reshape(-1)
    inertia = np.concatenate([algebra.grain_inertia[nodes].reshape(-1), algebra.rest_inertia.reshape(-1)])
    inertia = np.maximum(inertia, SMALLEST_INERTIA_SHARE * heaviest)
    load = inertia * np.concatenate([own, rest])
    C, k = bilateral
    if slacks is not None:
        slack_inertia, before = slacks
        # H has blocks of d columns: their number is made whole.
        spare = -len(slack_inertia) % d
        inertia = np.concatenate([inertia, slack_inertia, np.ones(spare)])
        load = np.concatenate([load, before, np.zeros(spare)])
        C = sp.csr_array(
            sp.hstack([C, sp.eye_array(C.shape[0]), sp.csr_array((C.shape[0], spare))], format="csr")
        )
    H = grains.operator
    wide = sp.bsr_array((H.data, H.indices, H.indptr), shape=(H.shape[0], len(inertia)))
    return Problem(
        M=sp.dia_array((inertia[None, :], [0]), shape=(len(inertia), len(inertia))), f=load, H=wide, w=grains.offset,
        law=grains.law, C=C, k=k, block_size=grains.start.shape[1], reference_force=reference,
    )  # fmt: skip


def coupled_problem(
    lumped: Problem, stiffness: sp.sparray, algebra: Phases, nodes: NDArray[np.int64]
) -> Problem:
    """The same with viscosity: M + T^T K T, u_v = T v + given, instead of a first step of its own."""
    d = algebra.a.shape[1]
    columns = (nodes[:, None] * d + np.arange(d)).reshape(-1)
    size, n = lumped.M.shape[0], algebra.a.size
    own = sp.csr_array(
        (algebra.a.reshape(-1)[columns], (columns, np.arange(len(columns)))), shape=(n, len(columns))
    )
    rest = sp.diags_array(algebra.b.reshape(-1))
    T = sp.csr_array(sp.hstack([own, rest, sp.csr_array((n, size - len(columns) - n))], format="csr"))
    M = sp.csr_array(lumped.M + T.T @ (stiffness @ T))
    load = lumped.f - T.T @ (stiffness @ algebra.given.reshape(-1))
    return Problem(
        M=M, f=load, H=lumped.H, w=lumped.w, law=lumped.law, C=lumped.C, k=lumped.k, block_size=lumped.s,
        reference_force=lumped.reference_force,
    )  # fmt: skip
