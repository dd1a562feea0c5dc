"""What is measured on a quasi-Newtonian flow: drag and lift, cut lines, the error functional xi, nodal fields, plugs.

Seed C, 5.1.1 (drag and lift, here in volume form), 6.4 (cut lines) and 6.5 (xi).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import trapezoid

from barchan.errors import InputError
from barchan.flows.quasi_newtonian.flow import Inertia, QuasiNewtonianFlow, yield_stresses
from barchan.flows.quasi_newtonian.sampling import (
    interpolate,
    interpolate_within,
    locate,
    magnitude,
    pressure_at,
    rates_at,
)
from barchan.spaces.quadratic import QuadraticSpace

RECOVERIES = ("averaged", "direct")

PLUG_MARGIN = 0.01
"""Share above the yield stress up to which matter counts as rigid: regularised models always shear a little."""


class Solved(Protocol):
    """A solution: velocity (N, 2) and pressure (P,)."""

    @property
    def velocity(self) -> np.ndarray: ...

    @property
    def pressure(self) -> np.ndarray: ...


@dataclass(frozen=True, eq=False)
class DragLift:
    """Force on a part of the boundary [force per length], and its coefficients C = 2 F / (rho U^2 L)."""

    force: np.ndarray
    drag: float
    lift: float


def drag_lift(
    flow: QuasiNewtonianFlow,
    solution: Solved,
    part: str,
    speed: float,
    length: float,
    inertia: Inertia | None = None,
) -> DragLift:
    """Force of the fluid on a part, and drag (x) and lift (y) coefficients with the mean speed U and the length L.

    Volume form: the momentum equation tested with the field that is e_x (e_y) at the nodes of the part and 0 at all others,
    which converges twice as fast as integrals of the stress along the part. `inertia` is that of a time step.

    Raises InputError for an unknown part, for a speed or length that is not positive, and for a flow without density.
    """
    for name, value in (("speed", speed), ("length", length), ("density", flow.density)):
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(name, value, "a number > 0")
    nodes = flow.space.mesh.part_nodes(part)
    # The reaction acts on the fluid; the part feels its opposite.
    force = -flow.reaction(solution.velocity, solution.pressure, inertia)[nodes].sum(axis=0)
    drag, lift = 2.0 * force / (flow.density * speed**2 * length)
    return DragLift(force, float(drag), float(lift))


@dataclass(frozen=True, eq=False)
class CutLine:
    """Fields at n points of a straight line.

    positions : (n,) distances from its start. points, velocity : (n, 2). speed, shear_rate (|g|), viscosity, pressure : (n,).
    rates : (n, 3) rate of strain g (xx, yy, xy).
    """

    positions: np.ndarray
    points: np.ndarray
    velocity: np.ndarray
    rates: np.ndarray
    viscosity: np.ndarray
    pressure: np.ndarray

    @property
    def speed(self) -> np.ndarray:
        """(n,) |u|."""
        return np.asarray(np.linalg.norm(self.velocity, axis=1))

    @property
    def shear_rate(self) -> np.ndarray:
        """(n,) |g| = sqrt(g:g)."""
        return magnitude(self.rates)


def cut_line(
    flow: QuasiNewtonianFlow,
    solution: Solved,
    start: ArrayLike,
    end: ArrayLike,
    points: int = 201,
    recovery: str = "averaged",
) -> CutLine:
    """Profiles along the straight line from `start` (2,) to `end` (2,), at equally spaced points.

    Parameters
    ----------
    points : their number, >= 2. Points on sides of cells get the mean of what the cells say.
    recovery : of the viscosity. "averaged" carries its values at the quadrature points to the nodes (`nodal`), "direct" takes
        the model at the rates of the points, whose errors it magnifies where the viscosity grows a hundredfold within a cell.
        Rates are the gradients in the cells: nodal averages of them are far worse where the flow is smooth.

    Raises InputError for a line that leaves the domain, fewer than two points, or an unknown recovery.
    """
    if recovery not in RECOVERIES:
        raise InputError("recovery", recovery, "one of " + ", ".join(RECOVERIES))
    if points < 2:
        raise InputError("points", points, "at least 2")
    ends = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    if ends[0].shape != (2,) or ends[1].shape != (2,) or np.array_equal(*ends):
        raise InputError("end", end, "a point (2,) other than the start")
    share = np.linspace(0.0, 1.0, points)[:, None]
    where = (1.0 - share) * ends[0] + share * ends[1]
    space, mesh = flow.space, flow.space.mesh
    places = locate(mesh, where)
    rates = rates_at(mesh, places, solution.velocity)
    pressure = pressure_at(space, places, solution.pressure)

    def carried(values: np.ndarray) -> np.ndarray:
        return interpolate_within(mesh, places, nodal(space, values, positive=True))

    if recovery == "averaged":
        viscosity = carried(flow.viscosity(solution.velocity, solution.pressure))
    else:
        model = flow.model.at_other_points(carried)
        viscosity = np.asarray(model.viscosity(magnitude(rates) ** 2 + model.eps**2, pressure))
    positions = share[:, 0] * np.linalg.norm(ends[1] - ends[0])
    velocity = interpolate(mesh, places, solution.velocity)
    return CutLine(positions, where, velocity, rates, viscosity, pressure)


def xi(
    positions: ArrayLike, values_i: ArrayLike, values_j: ArrayLike, positions_j: ArrayLike | None = None
) -> float:
    """xi_ij = 100 sqrt(integral (L_i - L_j)^2 / integral L_i^2), in percent, by the trapezoidal rule (seed C, 6.5).

    Parameters
    ----------
    positions, values_i : (n,) line plot i, positions increasing.
    values_j, positions_j : (m,) line plot j, interpolated linearly; on the same positions when `positions_j` is None.

    Raises InputError for plots of other shapes, positions that do not increase, or a plot i that is zero.
    """
    x, first = np.asarray(positions, dtype=float), np.asarray(values_i, dtype=float)
    other = x if positions_j is None else np.asarray(positions_j, dtype=float)
    second = np.asarray(values_j, dtype=float)
    for name, place, values in (("values_i", x, first), ("values_j", other, second)):
        if place.ndim != 1 or place.shape != values.shape or len(place) < 2:
            raise InputError(name, f"array of shape {values.shape}", f"one number per position {place.shape}")
        if np.any(np.diff(place) <= 0.0):
            raise InputError("positions", "numbers that do not increase", "increasing")
    if positions_j is not None:
        second = np.interp(x, other, second)
    norm = trapezoid(first**2, x)
    if not norm > 0.0:
        raise InputError("values_i", "zero everywhere", "not zero")
    return float(100.0 * np.sqrt(trapezoid((first - second) ** 2, x) / norm))


def nodal(space: QuadraticSpace, values: ArrayLike, positive: bool = False) -> np.ndarray:
    """(N,) or (N, j) field at the nodes from values (C, Q) or (C, Q, j) at the quadrature points.

    In each cell the bilinear (on triangles linear) field nearest to the values is found, which meets a velocity gradient where
    it is superconvergent; each node takes the mean of what its cells say. Exact for linear fields on straight cells.

    positive : of a positive field: each node is kept between half the least and twice the greatest value around it, where the
        field jumps within a cell and the straight line through it would become negative.

    Raises InputError for values of another shape.
    """
    given = np.asarray(values, dtype=float)
    if given.shape[:2] != space.weights.shape or given.ndim > 3:
        raise InputError(
            "values", f"array of shape {given.shape}", f"of shape {space.weights.shape} or (..., j)"
        )
    flat = given.reshape(*given.shape[:2], -1)
    k = space.cell_nodes.shape[1]
    at_points = _linear(space, space.reference_points)
    at_nodes = _linear(space, np.asarray(space.mesh.shapes.element.doflocs, dtype=float).T)
    moments = np.einsum("cq,qi,qj->cij", space.weights, at_points, at_points)
    loads = np.einsum("cq,qi,cqa->cia", space.weights, at_points, flat)
    cells = np.einsum("ki,cia->cka", at_nodes, np.linalg.solve(moments, loads))
    numbers = space.cell_nodes.ravel()
    count = np.bincount(numbers, minlength=space.N)
    total = [np.bincount(numbers, column.ravel(), minlength=space.N) for column in np.moveaxis(cells, 2, 0)]
    result = np.stack(total, axis=1) / count[:, None]
    if positive:
        least, greatest = np.full_like(result, np.inf), np.full_like(result, -np.inf)
        np.minimum.at(least, numbers, np.repeat(flat.min(axis=1), k, axis=0))
        np.maximum.at(greatest, numbers, np.repeat(flat.max(axis=1), k, axis=0))
        result = np.clip(result, 0.5 * least, 2.0 * greatest)
    return result.reshape(space.N, *given.shape[2:])


def _linear(space: QuadraticSpace, X: np.ndarray) -> np.ndarray:
    """(m, 4 or 3) bilinear or linear functions at reference points X (2, m)."""
    functions = [np.ones_like(X[0]), X[0], X[1]]
    if space.mesh.quadrilateral:
        functions.append(X[0] * X[1])
    return np.stack(functions, axis=1)


def rigid_points(flow: QuasiNewtonianFlow, solution: Solved, margin: float = 0.0) -> np.ndarray:
    """(C, Q) whether |sigma| <= sqrt(2) tau_y (1 + margin) at the quadrature points; nowhere without a yield stress."""
    fields = flow.fields(solution.velocity, solution.pressure)
    bound = yield_stresses(flow.model, fields.pressure)
    return np.asarray((bound > 0.0) & (magnitude(fields.stress) <= np.sqrt(2.0) * bound * (1.0 + margin)))


def plug(flow: QuasiNewtonianFlow, solution: Solved, margin: float = PLUG_MARGIN) -> np.ndarray:
    """(C,) mask of the rigid cells: those whose quadrature points are all rigid. Raises InputError for a margin < 0."""
    if not (np.isfinite(margin) and margin >= 0.0):
        raise InputError("margin", margin, "a number >= 0")
    return np.asarray(np.all(rigid_points(flow, solution, margin), axis=1))
