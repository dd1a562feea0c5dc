"""The mesh-based model of dry granular flow, piecewise constant throughout (seed B, 7.2): state in, state and record out."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.cones import tensor_block_size
from barchan.errors import InputError
from barchan.flows.dry.boundaries import Boundary, boundaries_of_parts, codes_of_sides
from barchan.flows.dry.cells import Cells
from barchan.flows.dry.momentum import StepProblem, build_step_problem
from barchan.flows.dry.options import Options
from barchan.flows.dry.state import DryRecord, DryState
from barchan.flows.dry.transport import Moved, transport
from barchan.flows.mpm.material import Material
from barchan.friction import Problem, Solution, solve

Vector = NDArray[np.float64]

_SAMPLES = 12
_NOT_HERE = ("cohesion", "shear_yield", "tensile_yield", "dilatancy", "anisotropy", "faceted")
SEEN = 0.1
"""Share of phi_max from which on the speed of a cell is reported: below it the solver's tolerance outweighs the weight."""


class DryFlow:
    """Dry granular matter on a mesh: velocities, stresses and volume fractions constant in each cell.

    Parameters
    ----------
    mesh : scikit-fem mesh of triangles, quadrilaterals or tetrahedra with named parts of the boundary.
    material : `barchan.flows.mpm.Material`.
    boundaries : name of a part -> `Boundary`; parts not named are slip walls.
    gravity : [m/s^2] down the last axis, or a vector (d,).
    options : see `Options`.

    Raises
    ------
    InputError : a mesh that `check_mesh` refuses, an unknown part, a gravity of another size or not finite, a material with
        cohesion, yield stresses, dilatancy or anisotropy, which this model does not have (seed B, 7 sets them to zero).
    """

    def __init__(
        self, mesh: Any, material: Material, boundaries: Mapping[str, Boundary],
        gravity: float | ArrayLike = 9.81, options: Options | None = None,
    ) -> None:  # fmt: skip
        self.cells = Cells.of(mesh)
        refuse_unknown_strength(material)
        self.material, self.options = material, Options() if options is None else options
        self.boundaries = boundaries_of_parts(self.cells, boundaries, Boundary)
        self._codes = codes_of_sides(self.cells, self.boundaries)
        self.gravity = gravity_vector(gravity, self.cells.dimension)

    # -- states ------------------------------------------------------------------------------------------------------

    def at_rest(self, fractions: ArrayLike) -> DryState:
        """State at time 0 with volume fractions (c,), between 0 and phi_max. Raises InputError for others."""
        cells = self.cells
        given = checked_fractions(fractions, cells.count, self.material.max_volume_fraction)
        if not np.any(given > self.options.empty):
            raise InputError("fractions", "all zero", "somewhere positive: there is no matter")
        d, s = cells.dimension, tensor_block_size(cells.dimension)
        still = np.zeros((cells.count, d))
        return DryState(
            0.0, 0, given, still, still, np.zeros((cells.count, s)), np.zeros((*cells.neighbours.shape, d)),
            np.full(cells.count, float(self.material.friction)), 0.0,
        )  # fmt: skip

    def filled(self, inside: Callable[[Vector], NDArray[np.bool_]]) -> DryState:
        """State at rest, packed where `inside` (points (n, d) -> (n,)) holds; cells cut by its edge by their share."""
        return self.at_rest(filled_shares(self.cells, inside) * self.material.max_volume_fraction)

    # -- steps -------------------------------------------------------------------------------------------------------

    def problem(self, state: DryState, dt: float) -> Problem:
        """The discrete Coulomb friction problem of a step of `dt` seconds."""
        return self._build(state, dt).problem

    def advance(self, state: DryState, dt: float) -> tuple[DryState, DryRecord]:
        """State after one step of `dt` seconds, and its record; raises InputError for a dt that is not finite and positive.

        A step whose certificate misses the tolerance is accepted and recorded with `converged` False.
        """
        step = self._build(state, dt)
        options, cells = self.options, self.cells
        swept = options.method in ("auto", "gauss_seidel")
        choices: dict[str, Any] = {"min_iterations": options.min_sweeps} if swept else {}
        solution = solve(
            step.problem, method=options.method, tol=options.tolerance, r0=step.start,
            max_iterations=options.max_sweeps, **choices,
        )  # fmt: skip
        assert solution.v is not None  # a full problem always has velocities
        velocities = np.zeros((cells.count, cells.dimension))
        velocities[step.active] = solution.v.reshape(-1, cells.dimension)
        moved = transport(
            cells, self._codes, state.fractions, velocities, dt, self.material.max_volume_fraction, options
        )
        forces = np.asarray(solution.r).reshape(len(step.start), -1)
        n, contacts = len(step.active), step.contacts
        stresses = np.zeros((cells.count, forces.shape[1]))
        stresses[step.active] = forces[:n]
        tractions = np.zeros(state.tractions.shape)
        tractions[contacts.cells, contacts.sides] = forces[n:, : cells.dimension]
        frictions = np.full(cells.count, float(self.material.friction))
        frictions[step.active] = step.friction
        after = DryState(
            state.time + dt, state.step + 1, moved.fractions, velocities, moved.carried, stresses, tractions,
            frictions, state.left + moved.gone,
        )  # fmt: skip
        return after, self._record(after, dt, step, solution, moved)

    def max_speed(self, state: DryState, share: float = SEEN) -> float:
        """Greatest speed [m/s] of the cells that hold more than this share of what they can; 0 when there is none."""
        there = state.fractions > share * self.material.max_volume_fraction
        return math.sqrt(float(np.max(np.sum(state.velocities[there] ** 2, axis=1), initial=0.0)))

    def _build(self, state: DryState, dt: float) -> StepProblem:
        if not math.isfinite(dt) or dt <= 0.0:
            raise InputError("dt", dt, "a finite number > 0 (s)")
        if state.velocities.shape != (self.cells.count, self.cells.dimension):
            raise InputError(
                "state", f"of {len(state.fractions)} cells", f"of the {self.cells.count} cells of the mesh"
            )
        return build_step_problem(
            self.cells, self._codes, self.boundaries, state, self.material, self.gravity, dt, self.options
        )

    def _record(
        self, state: DryState, dt: float, step: StepProblem, solution: Solution, moved: Moved
    ) -> DryRecord:
        cells, density = self.cells, self.material.density
        squared = np.sum(state.velocities**2, axis=1)
        matter = state.fractions * cells.volumes
        certificate = solution.certificate
        return DryRecord(
            step=state.step, time=state.time, dt=dt, sweeps=solution.iterations, residual=certificate.residual,
            law_residual=certificate.law, balance_residual=certificate.balance,
            converged=certificate.residual <= self.options.tolerance,
            kinetic_energy=float(0.5 * step.masses @ squared[step.active]),
            potential_energy=float(-density * (matter @ (cells.centres @ self.gravity))),
            max_speed=self.max_speed(state),
            min_volume_fraction=float(np.min(state.fractions)),
            max_volume_fraction=float(np.max(state.fractions)),
            volume=float(np.sum(matter)), left=state.left, excess=moved.excess,
            active_cells=len(step.active), blocks=len(step.start),
        )  # fmt: skip


def refuse_unknown_strength(material: Material) -> None:
    """InputError for a material with a property that the mesh-based models do not have."""
    for name in _NOT_HERE:
        if getattr(material, name):
            raise InputError(f"material.{name}", getattr(material, name), "0 in the mesh-based model")


def checked_fractions(fractions: ArrayLike, count: int, largest: float) -> Vector:
    """Volume fractions (count,) as numbers; InputError unless all lie in [0, largest]."""
    given = np.array(fractions, dtype=float)
    if given.shape != (count,) or not np.all((given >= 0.0) & (given <= largest)):
        raise InputError("fractions", f"array of shape {given.shape}", f"{count} numbers in [0, {largest:g}]")
    return given


def filled_shares(cells: Cells, inside: Callable[[Vector], NDArray[np.bool_]]) -> Vector:
    """(c,) shares of the cells where `inside` (points (n, d) -> (n,)) holds, from sample points."""
    points, weights = sample_points(cells)
    share = inside(points.reshape(-1, cells.dimension)).reshape(weights.shape)
    return np.minimum(np.sum(weights * share, axis=1), 1.0)


def sample_points(cells: Cells) -> tuple[Vector, Vector]:
    """Points (c, m, d) spread over each cell and the shares (c, m) of it that they stand for; shares sum up to 1."""
    points, corners = np.asarray(cells.mesh.p.T, dtype=float), np.asarray(cells.mesh.t.T)
    d = cells.dimension
    if corners.shape[1] == 4 and d == 2:
        x, y = _lattice([0.5, 0.5]).T
        shapes = np.stack([(1 - x) * (1 - y), x * (1 - y), x * y, (1 - x) * y], axis=1)
        a, b, c, e = (points[corners[:, i]] for i in range(4))
        along = (b - a)[:, None] * (1 - y)[:, None] + (c - e)[:, None] * y[:, None]
        up = (e - a)[:, None] * (1 - x)[:, None] + (c - b)[:, None] * x[:, None]
        weights = np.abs(along[..., 0] * up[..., 1] - along[..., 1] * up[..., 0])
        weights = weights / np.sum(weights, axis=1)[:, None]
    else:
        # Sorted coordinates map the cube onto the simplex, evenly; unequal shifts keep points off its sides.
        ordered = np.sort(_lattice([(axis + 1.0) / (d + 1.0) for axis in range(d)]), axis=1)
        edges = np.concatenate([np.zeros((len(ordered), 1)), ordered, np.ones((len(ordered), 1))], axis=1)
        shapes = np.diff(edges, axis=1)
        weights = np.full((cells.count, len(shapes)), 1.0 / len(shapes))
    return np.einsum("mk,ckd->cmd", shapes, points[corners]), weights


def _lattice(shifts: list[float]) -> Vector:
    """(m, d) points of the unit cube, `_SAMPLES` along each axis, at these shares of their intervals."""
    lines = [(np.arange(_SAMPLES) + shift) / _SAMPLES for shift in shifts]
    return np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, len(shifts))


def gravity_vector(given: Any, dimension: int) -> Vector:
    """(d,) of a strength >= 0 down the last axis, or of the vector itself; InputError for others."""
    allowed = f"a finite number >= 0, or {dimension} finite numbers"
    try:
        value = np.array(given, dtype=float)
    except (TypeError, ValueError):
        raise InputError("gravity", given, allowed) from None
    if (
        value.shape not in ((), (dimension,))
        or not np.all(np.isfinite(value))
        or (value.ndim == 0 and value < 0.0)
    ):
        raise InputError("gravity", given, allowed)
    return value if value.ndim else -float(value) * np.eye(dimension)[-1]
