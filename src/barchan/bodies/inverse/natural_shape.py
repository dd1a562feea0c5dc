"""Natural shapes of fibres from their shape at rest under weight and contact (seed B, 4.4.1; Derouet-Jourdan et al. 2013).

A groom q of Super-Helices is at rest, with forces r in the cones of Coulomb's law at its contacts, when

    0 = f + K (q0 - q) + H^T r,   r_i in K_mu                                                       (4.19)

f being the weight. Of the many natural shapes q0 that there are, the nearest to a target is wanted. With p = q0 - q, p0 that of
the target, and distances measured by a diagonal D, eliminating p leaves a convex problem of friction (4.20),

    K D^-1 K v = f + K p0 + H^T r,   u = H v + e r,   u_i in K_(1/mu), r_i in K_mu, u_i . r_i = 0,   p = p0 - D^-1 K v,

one solve of the law `SecondOrderCone`. D = 1 is the seed's; D = K measures a change of natural shape by its elastic energy,
which does not depend on how fibres are cut. e keeps forces that contacts share without being determined from being huge.

Whatever the solver left over, q0 is computed from r in its cones by (4.19): the groom is then at rest to round-off.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from barchan.bodies.fibres.assembly import FibreAssembly
from barchan.bodies.fibres.helices import Helices, HelixShape
from barchan.bodies.fibres.model import Vector
from barchan.bodies.rigid import inputs
from barchan.cones import SecondOrderCone
from barchan.errors import InputError
from barchan.friction import Problem, Solution, solve

Target = Literal["input", "end", "straight"]
Metric = Literal["energy", "curvature"]


@dataclass(frozen=True, eq=False)
class NaturalShape:
    """What was found.

    natural : (p, 3) natural twist and curvatures [1/m].  forces : (n, 3) at the contacts [N], in the frames of the rows of H.
    solution : that of the friction problem, with its certificate; None without contacts.
    unbalanced : largest generalised force that is left, over that of the weight.
    """

    natural: Vector
    forces: Vector
    solution: Solution | None
    unbalanced: float


@dataclass(frozen=True)
class InverseOptions:
    """How natural shapes are chosen and computed.

    target : "input", the curvatures of the groom; "end", those of the last piece of each fibre, all along it; "straight".
    metric : "energy" or "curvature", see above.
    regularisation : e over the mean of the diagonal of H K^-1 D K^-1 H^T, >= 0.
    tolerance, method, max_iterations : of the friction solver.
    closed : contacts count when their gap is at most this share of the thinnest radius, >= 0.

    Raises InputError for a value out of range.
    """

    target: Target = "input"
    metric: Metric = "energy"
    regularisation: float = 1e-3
    tolerance: float = 1e-6
    method: str = "auto"
    max_iterations: int | None = None
    closed: float = 1e-3

    def __post_init__(self) -> None:
        for name, kind in (("target", Target), ("metric", Metric)):
            if getattr(self, name) not in get_args(kind):
                raise InputError(
                    f"inverse.{name}", getattr(self, name), "one of " + ", ".join(get_args(kind))
                )
        for name in ("regularisation", "closed"):
            inputs.not_negative(f"inverse.{name}", getattr(self, name))
        inputs.positive("inverse.tolerance", self.tolerance)


def natural_shape(
    model: Helices, shape: HelixShape, gravity: ArrayLike, rows: Any, friction: ArrayLike,
    options: InverseOptions | None = None,
) -> NaturalShape:  # fmt: skip
    """Natural curvatures with which `shape` is at rest under gravity (3,) [m/s^2] and contact.

    rows : H (3 n, m), sparse: normal and tangential velocities at the contacts that are closed.  friction : (n,) or one number.
    Raises InputError for rows that do not fit the fibres.
    """
    choice = options or InverseOptions()
    H = sp.csr_array(rows)
    if H.shape[1] != 3 * len(model.pieces) or H.shape[0] % 3:
        raise InputError("rows", H.shape, f"of shape (3 n, {3 * len(model.pieces)})")
    stiffness = model.stiffness.reshape(-1)
    weight = model.weight_forces(shape, np.asarray(gravity, dtype=float))
    target = (_target(model, shape, choice.target) - shape.curvatures).reshape(-1)
    solution, forces = None, np.zeros((0, 3))
    if H.shape[0]:
        problem = inverse_problem(stiffness, weight, target, H, friction, choice)
        solution = solve(
            problem, method=choice.method, tol=choice.tolerance, max_iterations=choice.max_iterations
        )
        forces = problem.law.project(solution.r, 3).reshape(-1, 3)
    pulled = weight + H.T @ forces.reshape(-1)
    natural = shape.curvatures - (pulled / stiffness).reshape(-1, 3)
    left = pulled + stiffness * (natural - shape.curvatures).reshape(-1)
    largest = float(np.max(np.abs(weight), initial=0.0))
    unbalanced = float(np.max(np.abs(left), initial=0.0)) / largest if largest > 0.0 else 0.0
    return NaturalShape(natural, forces, solution, unbalanced)


def inverse_problem(
    stiffness: Vector, weight: Vector, target: Vector, H: sp.csr_array, friction: ArrayLike, options: InverseOptions,
) -> Problem:  # fmt: skip
    """The convex problem (4.20) with stiffness (m,), weight (m,), p0 (m,); the regularisation has velocities of its own.

    These are u - H v = y with the inertia 1 / e, pushed by r alone: y = e r.
    """
    inertia = stiffness if options.metric == "energy" else stiffness**2 / np.mean(stiffness)
    n = H.shape[0]
    spread = float(np.sum((H * H) @ (1.0 / inertia))) / n
    operator, inertias = H, inertia
    force = weight + stiffness * target
    if options.regularisation > 0.0 and spread > 0.0:
        slack = options.regularisation * spread
        operator = sp.csr_array(sp.hstack([H, sp.eye_array(n)]))
        inertias = np.concatenate([inertia, np.full(n, 1.0 / slack)])
        force = np.concatenate([force, np.zeros(n)])
    return Problem(
        M=sp.diags_array(inertias), f=force, H=operator, w=np.zeros(n), law=SecondOrderCone(np.asarray(friction, dtype=float)),
        block_size=3,
    )  # fmt: skip


def hanging(
    assembly: FibreAssembly[HelixShape], dt: float, options: InverseOptions | None = None
) -> tuple[FibreAssembly[HelixShape], NaturalShape]:
    """The fibres of `assembly` with natural shapes that keep them where they start, and what was found.

    The contacts are those that a step of `dt` seconds would find and that are closed at the start, roots and bodies at rest.
    Raises InputError for fibres that are not Super-Helices.
    """
    model, choice = assembly.model, options or InverseOptions()
    if not isinstance(model, Helices):
        raise InputError("model", type(model).__name__, "Super-Helices, whose elastic forces are linear")
    state = assembly.started()
    problem = assembly.problem(state, dt)
    gaps = problem.w.reshape(-1, 3)[:, 0] * dt
    closed = np.flatnonzero(gaps <= choice.closed * np.min(model.radii))
    rows = (3 * closed[:, None] + np.arange(3)).reshape(-1)
    friction = problem.parameters[closed, 0]
    found = natural_shape(
        model, state.shape, assembly.gravity_vector, sp.csr_array(problem.H)[rows], friction, choice
    )
    return replace(assembly, model=model.with_natural(found.natural, state.shape.curvatures)), found


def _target(model: Helices, shape: HelixShape, target: Target) -> Vector:
    """(p, 3) natural curvatures aimed at."""
    if target == "straight":
        return np.zeros_like(shape.curvatures)
    if target == "end":
        return shape.curvatures[model.pieces.firsts[1:] - 1][model.pieces.owners]
    return shape.curvatures
