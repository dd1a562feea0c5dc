"""Nonlinear solvers of quasi-Newtonian flows: fixed point, Newton, damped and adaptive Newton, stress-velocity Newton.

All share one loop and the true residual; they differ in the weights of the Jacobian (seed C 4.1.8, 4.3) and, for the
stress-velocity method, in an auxiliary unknown that takes the place of one of the two shear rates in the Jacobian.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeAlias

import numpy as np

from barchan.errors import InputError
from barchan.flows.quasi_newtonian.flow import Fields, Inertia, QuasiNewtonianFlow, Weights
from barchan.flows.quasi_newtonian.stress_velocity import flow_direction, next_direction
from barchan.flows.quasi_newtonian.weights import AdaptiveWeight

Start: TypeAlias = tuple[np.ndarray, np.ndarray, np.ndarray | None]
"""Velocity (N, 2), pressure (P,), auxiliary direction (C, Q, 3) or None."""

METHODS = ("stress-velocity", "newton", "adaptive-newton", "damped-newton", "fixed-point")
HALVINGS, ADAPTIVE_HALVINGS = 6, 3
"""Of a step of damped Newton, and of adaptive Newton, which does not reach the solution of every Bingham flow without."""
GROWTH = 1.3
"""Growth of the residual beyond which the stress-velocity method halves a step where the viscosity depends on the pressure. Of
lid-driven flows of Poliquen's grains (eps 0.003 to 0.1) full steps lose one in four, a bound of 2 one in eleven, 1.3 none."""
DIVERGED = 1e12


class LinearSolver(Protocol):
    """What solves the systems of a Newton method."""

    cycles: int

    def update(self, elements: np.ndarray) -> None:
        """Take the element matrices (C, n, n) of the next system; they may be overwritten."""

    def solve(self, rhs: np.ndarray, mean: float = 0.0) -> np.ndarray:
        """The increment (size,) for a right-hand side, changing the mean pressure of an enclosed flow by `mean`."""


@dataclass(frozen=True, eq=False)
class FlowSolution:
    """What a solve found.

    velocity (N, 2), pressure (P,).  direction : (C, Q, 3) auxiliary direction of the stress-velocity method, else None.
    residuals : Euclidean norm of the residual of the free unknowns, start included.  weights : delta of each step.
    cycles : multigrid cycles of each step.  iterations : steps.  converged : whether the tolerance was met.
    scale : residual that the tolerance is relative to, 1 for an absolute one.
    """

    velocity: np.ndarray
    pressure: np.ndarray
    direction: np.ndarray | None
    residuals: list[float]
    weights: list[float]
    cycles: list[int]
    converged: bool
    scale: float = 1.0
    message: str = ""

    @property
    def state(self) -> Start:
        """What another solve may start from."""
        return self.velocity, self.pressure, self.direction

    @property
    def iterations(self) -> int:
        """Nonlinear steps."""
        return len(self.residuals) - 1


@dataclass(frozen=True)
class NonlinearOptions:
    """Options of a nonlinear solve.

    method : one of METHODS.  tolerance : of the residual, times its scale (see `relative`).  max_iterations : steps.
    relative : the tolerance is relative to the residual of the flow at rest, else absolute.
    delta : constant weights of the Newton parts, for "newton".
    strategy, delta0, radius : of "adaptive-newton" (see `weights.AdaptiveWeight`).
    damping : factor of every step, 1 when None.
    halvings : how often a step is halved while the residual grows, the best of its parts being taken; when None HALVINGS for
        "damped-newton" without fixed damping, ADAPTIVE_HALVINGS for "adaptive-newton" (seed C: 0), else 0.

    Raises InputError for an unknown method, a tolerance or number of iterations that is not positive, a damping out of (0, 1],
    negative halvings.
    """

    method: str = "stress-velocity"
    tolerance: float = 1e-8
    max_iterations: int = 100
    relative: bool = True
    delta: Weights = field(default_factory=Weights)
    strategy: str = "f1"
    delta0: float = 0.2
    radius: float = 1e-3
    damping: float | None = None
    halvings: int | None = None

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise InputError("method", self.method, "one of " + ", ".join(METHODS))
        if not 0.0 < self.tolerance < 1.0:
            raise InputError("tolerance", self.tolerance, "between 0 and 1")
        if self.max_iterations < 1:
            raise InputError("max_iterations", self.max_iterations, "at least 1")
        if self.damping is not None and not 0.0 < self.damping <= 1.0:
            raise InputError("damping", self.damping, "above 0, at most 1")
        if self.halvings is not None and self.halvings < 0:
            raise InputError("halvings", self.halvings, "at least 0")
        AdaptiveWeight(self.strategy, self.delta0, self.radius)


@dataclass(frozen=True, eq=False)
class Iterate:
    """Velocity, pressure, auxiliary direction; their fields and residual."""

    velocity: np.ndarray
    pressure: np.ndarray
    direction: np.ndarray | None
    fields: Fields
    residual: np.ndarray
    norm: float


def solve_flow(
    flow: QuasiNewtonianFlow,
    linear: LinearSolver,
    options: NonlinearOptions,
    start: Start | None = None,
    inertia: Inertia | None = None,
    callback: Callable[[int, float, float], None] | None = None,
) -> FlowSolution:
    """Iterate from `start` (velocity, pressure, auxiliary direction; at rest when None) until the tolerance is met.

    The mean pressure of an enclosed flow is that of the flow, whatever the start. Raises InputError for a start without any
    viscosity: one without pressure of a fluid that owes all of it to pressure (seed C 8.2.2).
    """
    loop = _Loop(flow, linear, options, inertia)
    iterate = loop.begin(start)
    if not np.any(iterate.fields.viscosity > 0.0):
        raise InputError(
            "start",
            "no pressure anywhere",
            "one with pressures, or p > 0 (p_atm) on a part: no viscosity without",
        )
    residuals = [iterate.norm]
    weights: list[float] = []
    cycles: list[int] = []
    scale = loop.scale(start, iterate) if options.relative else 1.0
    # A flow that rests, or starts from its solution, has nothing but rounding to reduce.
    target = max(options.tolerance * scale, flow.rounding(iterate.fields, iterate.velocity, inertia))
    adaptive = AdaptiveWeight(options.strategy, options.delta0, options.radius)
    before: float | None = None
    message = ""
    while iterate.norm > target and len(weights) < options.max_iterations:
        weight = adaptive.update(iterate.norm, before) if options.method == "adaptive-newton" else None
        before = iterate.norm
        iterate = loop.step(iterate, weight)
        residuals.append(iterate.norm)
        weights.append(loop.weight)
        cycles.append(linear.cycles)
        if callback is not None:
            callback(len(weights), iterate.norm, loop.weight)
        if not np.isfinite(iterate.norm) or iterate.norm > DIVERGED * max(residuals[0], target):
            message = "diverged"
            break
    converged = bool(iterate.norm <= target)
    if not converged and not message:
        message = f"residual {iterate.norm:.2e} above {target:.2e} after {len(weights)} steps"
    return FlowSolution(
        iterate.velocity,
        iterate.pressure,
        iterate.direction,
        residuals,
        weights,
        cycles,
        converged,
        scale,
        message,
    )


class _Loop:
    """One nonlinear solve: what a step of the chosen method does."""

    def __init__(
        self,
        flow: QuasiNewtonianFlow,
        linear: LinearSolver,
        options: NonlinearOptions,
        inertia: Inertia | None,
    ) -> None:
        self.flow, self.linear, self.options, self.inertia = flow, linear, options, inertia
        # Without a yield stress there is no direction to follow: the method is then Newton's.
        self.dual = options.method == "stress-velocity" and flow.model.yield_stress(np.zeros(1)) is not None
        self.weight = 1.0
        # Full steps of a viscosity that depends on the pressure may end where pressures are negative and nothing resists.
        guarded = options.method == "stress-velocity" and flow.model.uses_pressure
        self.growth = GROWTH if guarded else 1.0
        self.halvings = _halvings(options, guarded)
        self._elements: np.ndarray | None = None

    def begin(self, start: Start | None) -> Iterate:
        velocity, pressure, direction = (*self.flow.at_rest(), None) if start is None else start
        x = np.concatenate([np.asarray(velocity).ravel(), pressure])
        x = self.flow.constraints.impose(x)
        size = 2 * self.flow.space.N
        velocity = x[:size].reshape(-1, 2)
        pressure = pressure + self._missing_pressure(pressure) * self.flow.space.unit_pressure
        fields = self.flow.fields(velocity, pressure)
        if self.dual and direction is None:
            # Zero where the start is at rest: the first step is then that of the fixed point.
            direction = np.zeros_like(fields.rate) if start is None else flow_direction(fields)
        return self._iterate(velocity, pressure, direction if self.dual else None, fields)

    def _missing_pressure(self, pressure: np.ndarray) -> float:
        """What the mean of a pressure lacks to the one wanted, 0 where the boundary sets it."""
        if self.flow.mean_pressure is None:
            return 0.0
        space = self.flow.space
        return self.flow.mean_pressure - float(space.pressure_weights @ pressure) / space.area

    def scale(self, start: Start | None, iterate: Iterate) -> float:
        """The residual that a relative tolerance refers to: that of the flow at rest, whatever the start."""
        return iterate.norm if start is None else self.begin(None).norm

    def _iterate(self, velocity: np.ndarray, pressure: np.ndarray, direction: Any, fields: Fields) -> Iterate:
        residual = self.flow.residual(fields, velocity, self.inertia)
        residual = self.flow.constraints.to_rotated(residual)
        residual[self.flow.constraints.fixed] = 0.0
        return Iterate(velocity, pressure, direction, fields, residual, float(np.linalg.norm(residual)))

    def step(self, iterate: Iterate, weight: float | None) -> Iterate:
        """The next iterate; `weight` is that of an adaptive method."""
        weights = self._weights(weight)
        self._elements = self.flow.jacobian(
            iterate.fields, weights, iterate.direction, self.inertia, self._elements
        )
        self.linear.update(self._elements)
        mean = self._missing_pressure(iterate.pressure)
        increment = self.flow.constraints.to_cartesian(self.linear.solve(-iterate.residual, mean))
        factor = self.options.damping or 1.0
        best = self._moved(iterate, increment, factor)
        for _ in range(self.halvings):
            if best.norm < self.growth * iterate.norm:
                break
            factor *= 0.5
            shorter = self._moved(iterate, increment, factor)
            if not shorter.norm >= best.norm:
                best = shorter
        return best

    def _weights(self, weight: float | None) -> Weights:
        if self.options.method == "fixed-point":
            weight = 0.0
        if weight is not None:
            self.weight = weight
            return Weights(weight, weight, weight)
        self.weight = self.options.delta.viscous
        return self.options.delta

    def _moved(self, iterate: Iterate, increment: np.ndarray, factor: float) -> Iterate:
        size = 2 * self.flow.space.N
        change = factor * increment
        velocity = iterate.velocity + change[:size].reshape(-1, 2)
        pressure = iterate.pressure + change[size:]
        fields = self.flow.fields(velocity, pressure)
        direction = None
        if iterate.direction is not None:
            direction = next_direction(iterate.direction, iterate.fields, fields)
        return self._iterate(velocity, pressure, direction, fields)


def _halvings(options: NonlinearOptions, guarded: bool) -> int:
    """How often a step may be halved."""
    if options.halvings is not None:
        return options.halvings
    if options.method == "adaptive-newton":
        return ADAPTIVE_HALVINGS
    return HALVINGS if guarded or (options.method == "damped-newton" and options.damping is None) else 0
