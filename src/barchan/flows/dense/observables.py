"""What is measured on a dense flow: discharge, drag, stresses, shear rates, rigid zones, stream lines (seed A, 6).

Values at points are those of the law (`flow.space.points`); `vertex_field` carries them to the vertices for pictures.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import skfem
from skfem.models.poisson import laplace

from barchan.errors import InputError
from barchan.flows.dense.flow import DenseFlow
from barchan.flows.dense.state import DenseState
from barchan.linalg import factorise

RIGID_MARGIN = 1e-3

APART = 1e-5
"""Yield stress, as a share of the flow's stresses, below which matter has come apart rather than being rigid."""


def discharge(flow: DenseFlow, state: DenseState, name: str) -> float:
    """Flow rate through a named part, outwards positive [length^d / time]; InputError for an unknown part."""
    return float(flow.space.flux(name) @ state.velocity)


def drag(flow: DenseFlow, state: DenseState, name: str) -> np.ndarray:
    """(d,) force of the matter on a named part, in volume form: the momentum balance tested with the unit fields on it.

    The part's nodes carry the reactions that hold their velocity; frictional walls add their tractions. Nodes shared with
    another held part count here in full. Parts with a prescribed stress have no reaction: their force is known.
    Raises InputError for an unknown part.
    """
    space = flow.space
    nodes = space.boundary_nodes(name)
    force = -state.reactions.reshape(-1, space.dimension)[nodes].sum(axis=0)
    if name in flow.walls.ranges:
        first, last = flow.walls.ranges[name]
        rows = flow.walls.geometry[name]
        traction = state.forces[space.n + first : space.n + last, : space.dimension]
        # The block force acts on the matter; the wall feels its opposite.
        force = -np.einsum("q,qab,qa->b", rows.weights, rows.frames, traction)
    return np.asarray(force)


def drag_parts(flow: DenseFlow, state: DenseState, name: str) -> tuple[np.ndarray, np.ndarray]:
    """(d,) forces of the contact stress lambda and of the viscous stress of the matter on a named part, in volume form.

    Each stress is tested with the unit fields on the part's nodes: integral of lambda : D(phi) and of 2 eta D(u) : D(phi). They
    add up to `drag` but for weight and inertia of the layer of cells along the part, which vanish as the mesh is refined.
    Raises InputError for an unknown part.
    """
    space, assembly = flow.space, flow.assembly
    nodes = space.boundary_nodes(name)
    viscosity = assembly.viscosity(assembly.shear_rates(state.velocity))
    viscous = space.viscous(viscosity, flow.material.bulk) @ state.velocity
    contact = -(space.rates.T @ state.forces[: space.n].reshape(-1))
    # The boundary holds the matter by these forces; the matter acts on it by their opposites.
    held = [-force.reshape(-1, space.dimension)[nodes].sum(axis=0) for force in (contact, viscous)]
    return held[0], held[1]


def pressures(flow: DenseFlow, state: DenseState) -> np.ndarray:
    """(n,) contact pressure p = Tr(lambda) / d at the points of the law."""
    return np.asarray(np.sqrt(2.0 / flow.space.dimension) * state.forces[: flow.space.n, 0])


def shear_stresses(flow: DenseFlow, state: DenseState) -> np.ndarray:
    """(n,) |Dev lambda| = sqrt(J2) of the contact stress at the points of the law, without the viscous part."""
    return np.asarray(np.linalg.norm(state.forces[: flow.space.n, 1:], axis=1))


def shear_rates(flow: DenseFlow, state: DenseState) -> np.ndarray:
    """(n,) |Dev D(u)| at the points of the law, half of du/dy in simple shear [1/time]."""
    return np.asarray(np.linalg.norm(flow.space.strain_rates(state.velocity)[:, 1:], axis=1))


def divergences(flow: DenseFlow, state: DenseState) -> np.ndarray:
    """(n,) div u at the points of the law [1/time]; >= 0 up to the residual."""
    return np.asarray(np.sqrt(2.0 * flow.space.dimension) * flow.space.strain_rates(state.velocity)[:, 0])


def yield_stresses(flow: DenseFlow, state: DenseState) -> np.ndarray:
    """(n,) bound of `shear_stresses`: sigma_S + mu (lambda_N + tau_c), with mu(I) of the state."""
    law = flow.law(state).parameters(flow.assembly.blocks)[: flow.space.n]
    normal = state.forces[: flow.space.n, 0] + law[:, 2]
    return np.asarray(law[:, 1] + law[:, 0] * np.maximum(normal, 0.0))


def rigid(flow: DenseFlow, state: DenseState, margin: float = RIGID_MARGIN) -> np.ndarray:
    """(n,) mask of points that do not yield: shear stress below the yield stress by the relative `margin`.

    Where nothing presses on grains, both stresses are remainders of the solver's, and the grains are not rigid.
    """
    bound = yield_stresses(flow, state)
    return np.asarray(
        (bound > APART * flow.assembly.stress_scale) & (shear_stresses(flow, state) < (1.0 - margin) * bound)
    )


def vertex_field(flow: DenseFlow, values: np.ndarray) -> np.ndarray:
    """(vertices,) field from values (n,) at the points of the law: weighted means around each vertex, hence within bounds.

    Raises InputError for another number of values.
    """
    space, element = flow.space, flow.space.element
    given = np.asarray(values, dtype=float)
    if given.shape != (space.n,):
        raise InputError("values", f"array of shape {given.shape}", f"of shape ({space.n},)")
    if element.continuous:
        return given.copy()
    # Linear shape functions at the Gauss points share out the weights.
    shares = (
        _corner_shares(space.mesh, element.imposed_at[0])
        * space.weights.reshape(len(space.cell_dofs), -1)[:, None]
    )
    corners = np.broadcast_to(space.mesh.t.T[:, :, None], shares.shape)
    count = space.mesh.p.shape[1]
    total = np.bincount(corners.ravel(), shares.ravel(), minlength=count)
    moment = np.bincount(
        corners.ravel(), (shares * given.reshape(len(shares), 1, -1)).ravel(), minlength=count
    )
    return np.divide(moment, total, out=np.zeros(count), where=total > 0.0)


def _corner_shares(mesh: skfem.Mesh, X: np.ndarray) -> np.ndarray:
    """(corners, Q) linear (bilinear) shape functions at reference points."""
    element = mesh.elem()
    return np.stack([np.broadcast_to(element.lbasis(X, i)[0], X.shape[1:]) for i in range(mesh.t.shape[0])])


def stream_function(flow: DenseFlow, state: DenseState) -> np.ndarray:
    """(vertices,) psi with u = (d psi/dy, -d psi/dx), zero at the first vertex; 2D [length^2 / time].

    Least squares: where div u > 0 no such function exists, and the nearest one is returned. Raises InputError in 3D.
    """
    space = flow.space
    if space.dimension != 2:
        raise InputError("flow", "three-dimensional", "two-dimensional for a stream function")
    rule = space.element.quadrature(4)
    basis = skfem.CellBasis(space.mesh, space.mesh.elem(), quadrature=rule)
    values = space.element.velocity.values(rule[0])
    ux, uy = np.einsum("kp,ekc->cep", values, state.velocity.reshape(-1, 2)[space.cell_nodes])
    # grad psi = (-u_y, u_x), tested with the gradients of the linear shape functions.
    gradients = np.stack([np.asarray(shape[0].grad) for shape in basis.basis])
    local = np.einsum("kep,ep->ke", gradients[:, 1] * ux - gradients[:, 0] * uy, np.asarray(basis.dx))
    load = np.bincount(basis.element_dofs.ravel(), local.ravel(), minlength=basis.N)
    matrix = sp.csr_array(laplace.assemble(basis))
    psi = np.zeros(matrix.shape[0])
    psi[1:] = factorise(sp.csr_array(matrix[1:, 1:])).solve(load[1:])
    return psi
