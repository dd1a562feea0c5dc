"""The frictional problem of a step: momentum balance with the end-of-step constraint phi <= phi_max (seed B, 7.1.3-7.2.2).

Two steps: velocities u* with inertia, gravity and Newtonian viscosity (Eq. 7.22), then M v = M u* + H^T r, u = H v + w with
the diagonal mass, whose blocks are the cells' contact stresses and then the contacts with walls.

The constraint. The matter of a cell that expands at the rate div u has, at the end of the step, phi (1 - dt div u) to the
first order (Eq. 7.6) and phi / (1 + dt div u) by the implicit Euler rule that the transport of the volume fraction uses.
We ask for the second, phi^k div u + phi^k (phi_max - phi^k) / (phi_max dt) >= 0: it differs from the seed's by the factor
phi^k / phi_max of the allowance, which is 1 in packed matter, and makes phi^(k+1) <= phi_max a theorem (see `transport`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from barchan.cones import Coulomb, normalised_friction, tensor_block_size
from barchan.errors import InputError
from barchan.flows.dry._kernels import STICKY
from barchan.flows.dry.boundaries import Boundary
from barchan.flows.dry.cells import Cells
from barchan.flows.dry.options import Options
from barchan.flows.dry.state import DryState
from barchan.flows.dry.strain import strain_operator
from barchan.flows.mpm.material import Material
from barchan.friction import Problem
from barchan.linalg.frames import contact_frames

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Contacts:
    """Sides at walls of the active cells: k contacts.

    cells, sides : (k,) where they are.  numbers : (k,) active numbers of the cells.
    weights : (k,) volume fraction of the cell times area of the side [m^(d-1)].
    frames : (k, d, d) rows: inward normal, tangents.
    friction : (k,) physical coefficients; NaN where the matter slides under its own.
    """

    cells: NDArray[np.int64]
    sides: NDArray[np.int64]
    numbers: NDArray[np.int64]
    weights: Vector
    frames: Vector
    friction: Vector

    def coefficients(self, of_cells: Vector) -> Vector:
        """(k,) physical coefficients, given those (n,) of the active cells."""
        return np.where(np.isnan(self.friction), of_cells[self.numbers], self.friction)


@dataclass(frozen=True, eq=False)
class StepProblem:
    """The frictional problem of a step and what it was made from.

    problem : n + k blocks of size s; r in Pa.  active : (n,) cells.  contacts : with walls.
    start : (n + k, s) warm start.  masses : (n,) [kg].  friction : (n,) physical coefficients of the cells.
    """

    problem: Problem
    active: NDArray[np.int64]
    contacts: Contacts
    start: Vector
    masses: Vector
    friction: Vector


def build_step_problem(
    cells: Cells, codes: NDArray[np.int64], boundaries: tuple[Boundary, ...], state: DryState, material: Material,
    gravity: Vector, dt: float, options: Options,
) -> StepProblem:  # fmt: skip
    """The problem of a step of `dt` seconds from `state`; `boundaries` in the order of `cells.names`.

    Raises InputError when the viscous step does not converge.
    """
    filled = state.fractions > options.empty
    active = np.flatnonzero(filled)
    fractions, volumes, d = state.fractions[active], cells.volumes[active], cells.dimension
    strain = strain_operator(cells, state.fractions, filled)
    contacts = wall_contacts(cells, boundaries, state.fractions, filled)
    masses = material.density * fractions * volumes
    friction = np.full(len(active), float(material.friction))
    if material.rate_dependent:
        sheared = strain_operator(cells, state.fractions, filled, codes == STICKY)
        friction = cell_friction(
            sheared, state.carried[active], state.stresses[active], fractions * volumes, material
        )
    predicted = state.carried[active] + dt * gravity
    if material.viscosity > 0.0:
        weights = 0.5 * material.viscosity / (fractions * volumes)
        predicted = viscous_velocities(strain, masses / dt, weights, predicted, options.viscous_tolerance)
    tractions = np.zeros((len(contacts.cells), tensor_block_size(d)))
    tractions[:, :d] = state.tractions[contacts.cells, contacts.sides]
    start = np.concatenate([state.stresses[active], tractions])
    allowance = np.zeros(start.shape)
    allowance[: len(active), 0] = compression_allowance(fractions, volumes, material, d) / dt
    diagonal = np.repeat(masses / dt, d)
    problem = Problem(
        M=sp.dia_array((diagonal[None, :], [0]), shape=(len(diagonal), len(diagonal))),
        f=diagonal * predicted.reshape(-1),
        H=with_wall_rows(strain, contacts),
        w=allowance.reshape(-1),
        law=Coulomb(np.concatenate([normalised_friction(friction, d), contacts.coefficients(friction)])),
        block_size=start.shape[1],
        reference_force=overburden(
            cells, state.fractions, material.density, material.max_volume_fraction, gravity
        )
        * float(np.sqrt(len(start))),
    )
    return StepProblem(problem, active, contacts, start, masses, friction)


def compression_allowance(fractions: Vector, volumes: Vector, material: Material, d: int) -> Vector:
    """(n,) e_N component sqrt(2/d) phi |K| max(1 - phi / phi_p, 0) [m^d] of k, phi_p = (1 - packing_tolerance) phi_max."""
    packed = (1.0 - material.packing_tolerance) * material.max_volume_fraction
    return np.asarray(np.sqrt(2.0 / d) * fractions * volumes * np.maximum(1.0 - fractions / packed, 0.0))


def cell_friction(
    strain: sp.bsr_array, velocities: Vector, stresses: Vector, weights: Vector, material: Material
) -> Vector:
    """Physical mu(I) (n,), explicit: strain rate of the carried velocities (n, d), pressure of `stresses` (n, s)."""
    n, d = velocities.shape
    rates = (strain @ velocities.reshape(-1)).reshape(n, -1) / (2.0 * weights[:, None])
    shear_rate = np.sqrt(np.sum(rates[:, 1:] ** 2, axis=1))
    return material.friction_at(shear_rate, np.sqrt(2.0 / d) * stresses[:, 0])


def viscous_velocities(
    strain: sp.bsr_array, inertia: Vector, weights: Vector, velocities: Vector, tolerance: float
) -> Vector:
    """u* (n, d) of (M + C^T S^-1 C) u* = M u, the weak derivative of the weak derivative, by conjugate gradients.

    inertia : (n,) masses over dt.  weights : (n,) eta / (2 phi |K|), since C u = B u / 2 and <s, t> = s:t/2.
    """
    size, (s, d) = velocities.size, strain.blocksize
    diagonal, scaled = np.repeat(inertia, d), np.repeat(weights, s)
    transposed = strain.T.tocsr()
    squares = strain.copy()
    squares.data **= 2
    preconditioner = 1.0 / (diagonal + squares.T @ scaled)
    solution, info = spla.cg(
        spla.LinearOperator(
            (size, size), matvec=lambda x: diagonal * x + transposed @ (scaled * (strain @ x)), dtype=float
        ),
        diagonal * velocities.reshape(-1), x0=velocities.reshape(-1), rtol=tolerance, maxiter=10 * size,
        M=spla.LinearOperator((size, size), matvec=lambda x: preconditioner * x, dtype=float),
    )  # fmt: skip
    if info != 0:
        raise InputError("material.viscosity", "not solvable", "small enough for the viscous step")
    return np.asarray(solution).reshape(velocities.shape)


def wall_contacts(
    cells: Cells, boundaries: tuple[Boundary, ...], fractions: Vector, filled: NDArray[np.bool_]
) -> Contacts:
    """Contacts of filled cells with every part that is not free."""
    solid = np.array([boundary.kind != "free" for boundary in boundaries], dtype=bool)
    own = {"no_slip": np.nan, "slip": 0.0}
    coefficient = np.array([own.get(boundary.kind, boundary.friction) for boundary in boundaries])
    at_wall = (cells.parts >= 0) & filled[:, None]
    at_wall[at_wall] = solid[cells.parts[at_wall]]
    found, sides = np.nonzero(at_wall)
    vectors = cells.faces[found, sides]
    areas = np.linalg.norm(vectors, axis=1)
    numbers = np.cumsum(filled) - 1
    return Contacts(
        found, sides, numbers[found], fractions[found] * areas, contact_frames(-vectors / areas[:, None]),
        coefficient[cells.parts[found, sides]],
    )  # fmt: skip


def with_wall_rows(strain: sp.bsr_array, contacts: Contacts) -> sp.bsr_array:
    """The operator with one block (s, d) by contact below: weight times (normal; tangents) of the cell's velocity, zeros."""
    k = len(contacts.cells)
    if k == 0:
        return strain
    s, d = strain.blocksize
    blocks = np.zeros((k, s, d))
    blocks[:, :d] = contacts.weights[:, None, None] * contacts.frames
    indptr = np.concatenate([strain.indptr, strain.indptr[-1] + 1 + np.arange(k)]).astype(np.int32)
    indices = np.concatenate([strain.indices, contacts.numbers]).astype(np.int32)
    data = np.concatenate([strain.data, blocks])
    return sp.bsr_array((data, indices, indptr), shape=((len(indptr) - 1) * s, strain.shape[1]))


def overburden(cells: Cells, fractions: Vector, density: float, largest: float, gravity: Vector) -> float:
    """rho phi_max |g| times the height of the centre of mass above the lowest matter [Pa], at least that of one cell."""
    matter = fractions * cells.volumes
    strength = float(np.linalg.norm(gravity))
    if strength == 0.0 or not np.any(matter > 0.0):
        return density * cells.smallest_width**2  # no scale of stress: that of a speed of one cell a second
    heights = -(cells.centres @ gravity) / strength
    mean = float(matter @ heights / np.sum(matter)) - float(np.min(heights[matter > 0.0]))
    return density * largest * strength * max(mean, cells.smallest_width)
