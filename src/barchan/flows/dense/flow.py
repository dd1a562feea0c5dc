"""Dense granular and viscoplastic flow on a mesh: steady creeping flow and steps with inertia (seed A, 4-5; seed B, 6).

Each solve is one discrete Coulomb friction problem; mu(I) and rate-dependent viscosity are explicit in time, or fixed points.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from barchan import friction
from barchan.cones import DruckerPrager
from barchan.errors import InputError
from barchan.flows.dense.assembly import Assembly, Operator
from barchan.flows.dense.closed import solve_at_lowest_pressure
from barchan.flows.dense.conditions import Condition
from barchan.flows.dense.inertia import Carrier
from barchan.flows.dense.material import Material, MuI, RateViscosity
from barchan.flows.dense.reduction import check_inflow, reduce
from barchan.flows.dense.state import DenseState
from barchan.flows.dense.walls import wall_blocks
from barchan.spaces.mixed import MixedSpace

LARGEST_SWEEPS = 100
RELAXATION = 0.5
"""Weight of the new viscosity (of its logarithm) and friction in the fixed point: stable for eta ~ |D|^(n - 1), n < 4."""


@dataclass(frozen=True, eq=False)
class _Discrete:
    """A friction problem with the data that a state needs afterwards.

    load : (size,) of the unreduced momentum balance.  offset : (m,) to be added to the velocities of the problem.
    """

    problem: friction.Problem
    operator: Operator
    load: np.ndarray
    offset: np.ndarray


class DenseFlow:
    """A dense flow: space, material, conditions, gravity.

    Parameters
    ----------
    space : `barchan.spaces.mixed.MixedSpace`.
    material : `Material`.
    conditions : name of a part of the boundary -> NoSlip(), Velocity(..), FreeSlip(), Symmetry(), Stress(..), Pressure(..)
        or FrictionalWall(..). Parts not named are free of external stress.
    gravity : (d,) acceleration; None is the unit vector down the last axis.

    Raises
    ------
    InputError : unknown boundary, values of a wrong shape, a closed domain with net inflow, parameters out of range.
    """

    def __init__(
        self, space: MixedSpace, material: Material, conditions: Mapping[str, Condition],
        gravity: Sequence[float] | np.ndarray | None = None,
    ) -> None:  # fmt: skip
        self.space, self.material, self.conditions = space, material, dict(conditions)
        for name, condition in self.conditions.items():
            space.facets(name)
            if not isinstance(condition, Condition):
                raise InputError(
                    f"conditions.{name}", condition, "a condition such as NoSlip() or Velocity((1, 0))"
                )
        default = -np.eye(space.dimension)[-1]
        self.gravity = default if gravity is None else np.asarray(gravity, dtype=float)
        if self.gravity.shape != (space.dimension,) or not np.isfinite(self.gravity).all():
            raise InputError("gravity", gravity, f"{space.dimension} finite numbers")
        self.reduction = reduce(space, self.conditions)
        self.walls = wall_blocks(space, self.conditions)
        check_inflow(space, self.reduction, self.conditions, self.walls)
        self.assembly = Assembly(space, material, self.conditions, self.gravity, self.reduction, self.walls)
        self._kept: tuple[Any, friction.Problem] | None = None

    # -- states and problems -----------------------------------------------------------------------------------------

    def at_rest(self, velocity: Any = None) -> DenseState:
        """State at time 0 without stresses; velocity (d,), callable or (size,), None: 0; prescribed parts take their data."""
        v = np.zeros(self.space.size)
        if velocity is not None:
            given = np.asarray(velocity) if not callable(velocity) else None
            whole = given is not None and given.shape == (self.space.size,)
            v = np.array(given, dtype=float) if whole else self.space.interpolate(velocity)
        v = self.reduction.expand(self.reduction.restrict(v - self.reduction.prescribed))
        return DenseState(0.0, v, np.zeros((self.assembly.blocks, self.space.s)), np.zeros(self.space.size))

    def problem(self, state: DenseState | None = None, dt: float | None = None) -> friction.Problem:
        """The friction problem of the steady flow (dt None) or of the step of length dt from `state`.

        Friction and viscosity that depend on the flow are those of `state`; None: rest.
        """
        discrete = self._discrete(state, dt)
        f = self.reduction.restrict(discrete.load - discrete.operator.lifted)
        return self._fresh(discrete.operator, f, discrete.problem.law)

    def law(self, state: DenseState | None = None) -> DruckerPrager:
        """Law of every block in cone coordinates, with mu(I) of `state` (None: rest)."""
        if state is None or not isinstance(self.material.mu, MuI):
            return self.assembly.law()
        return self.assembly.law(state.forces, state.velocity)

    def _viscosity(self, state: DenseState | None) -> np.ndarray | None:
        """Viscosities that depend on the flow, at the viscous points; None when they do not."""
        if not isinstance(self.material.viscosity, RateViscosity):
            return None
        return self.assembly.viscosity(None if state is None else self.assembly.shear_rates(state.velocity))

    def _discrete(
        self, state: DenseState | None, dt: float | None,
        viscosity: np.ndarray | None = None, law: DruckerPrager | None = None,
    ) -> _Discrete:  # fmt: skip
        load = self.assembly.load
        if dt is None:
            if not self.assembly.held:
                before = self.reduction.prescribed if state is None else state.velocity
                load = load + self.assembly.anchor @ before
        else:
            if not (np.isfinite(dt) and dt > 0.0):
                raise InputError("dt", dt, "finite and > 0")
            if state is None:
                raise InputError("state", None, "given for a step; see DenseFlow.at_rest")
            load = load + self.assembly.inertial_load(self.carrier.arriving(state.velocity, dt), dt)
        operator = self.assembly.operator(dt, self._viscosity(state) if viscosity is None else viscosity)
        f = self.reduction.restrict(load - operator.lifted)
        problem, offset = self._problem(operator, f, self.law(state) if law is None else law)
        return _Discrete(problem, operator, load, offset)

    def _problem(
        self, operator: Operator, f: np.ndarray, law: DruckerPrager
    ) -> tuple[friction.Problem, np.ndarray]:
        """A friction problem in v - offset, and the offset (m,).

        While the operator stays the same, so do its factorisation and metric: another load than that of the first problem
        is a velocity of its own, M offset = f - f_first, whose rates join the drift.
        """
        if self._kept is None or self._kept[0] is not operator:
            self._kept = (operator, self._fresh(operator, f, law))
        first = self._kept[1]
        offset = np.zeros(len(f)) if np.array_equal(first.f, f) else first.factor.solve(f - first.f)
        return first.variant(law, self.assembly.reduced_rates @ offset), offset

    def _fresh(self, operator: Operator, f: np.ndarray, law: DruckerPrager) -> friction.Problem:
        assembly, d = self.assembly, self.space.dimension
        component = self.reduction.places
        return friction.Problem(
            M=operator.reduced, f=f, H=assembly.reduced_rates, w=assembly.drift, law=law,
            block_size=self.space.s, reference_force=assembly.reference_force,
            places=(self.space.nodes[component // d], component % d),
        )  # fmt: skip

    @cached_property
    def carrier(self) -> Carrier:
        """What carries velocities along characteristics."""
        return Carrier(self.space)

    # -- solving -----------------------------------------------------------------------------------------------------

    def solve(
        self, tolerance: float = 1e-6, method: str = "auto", start: DenseState | None = None, **options: Any
    ) -> DenseState:
        """Steady creeping flow; friction and viscosity that depend on the flow are found by a relaxed fixed point.

        So is a flow that nothing but friction at walls holds (see `Assembly.anchor`).

        tolerance : of the certificate; the fixed point ends when velocities change by less than 10 tolerances, relatively.
        start : a state to start from.  options : passed to `barchan.friction.solve`.
        Raises InputError for viscosity <= 0, velocities not held anywhere, and conditions proven to have no solution.
        """
        if not self.material.nonlinear and self.assembly.held:
            discrete = self._discrete(start, None)
            return self._solved(discrete, 0.0, tolerance, method, start, options)
        return self._fixed_point(tolerance, method, start, options)

    def step(
        self, state: DenseState, dt: float, tolerance: float = 1e-6, method: str = "auto", **options: Any
    ) -> DenseState:
        """The state after a step of length dt: first-order characteristics, implicit stresses (seed A, 5.2).

        mu(I) and rate-dependent viscosity are those of `state`. A solve that misses its tolerance says converged=False.
        """
        discrete = self._discrete(state, dt)
        return self._solved(discrete, state.time + dt, tolerance, method, state, options)

    def _solved(
        self, discrete: _Discrete, time: float, tolerance: float, method: str,
        start: DenseState | None, options: Mapping[str, Any],
    ) -> DenseState:  # fmt: skip
        r0 = None if start is None else start.forces.reshape(-1)
        solution = solve_at_lowest_pressure(discrete.problem, method, tolerance, r0=r0, **options)
        if solution.status == "no solution":
            raise InputError(
                "conditions", ", ".join(self.conditions) or "none", f"compatible: {solution.message}"
            )
        assert solution.v is not None
        v = self.reduction.expand(solution.v + discrete.offset)
        forces = np.asarray(solution.r).reshape(-1, self.space.s)
        reactions = discrete.operator.full @ v - discrete.load - self.assembly.rates.T @ forces.reshape(-1)
        return DenseState(
            time, v, forces, reactions, solution.certificate, solution.iterations, solution.converged, 1
        )

    def _fixed_point(
        self, tolerance: float, method: str, start: DenseState | None, options: Mapping[str, Any]
    ) -> DenseState:
        viscosity, law = self._viscosity(start), self.law(start)
        state, iterations, sweeps, settled = start, 0, 0, False
        while sweeps < LARGEST_SWEEPS and not settled:
            sweeps += 1
            discrete = self._discrete(state, None, viscosity, law)
            new = self._solved(discrete, 0.0, tolerance, method, state, options)
            iterations += new.iterations
            before = np.inf if state is None else np.linalg.norm(new.velocity - state.velocity)
            state = new
            settled = bool(before <= 10.0 * tolerance * max(float(np.linalg.norm(new.velocity)), 1e-300))
            target = self._viscosity(state)
            if viscosity is not None and target is not None:
                viscosity = viscosity ** (1.0 - RELAXATION) * target**RELAXATION
            if isinstance(self.material.mu, MuI):
                wanted = self.law(state)
                law = law.with_friction((1.0 - RELAXATION) * law.mu + RELAXATION * wanted.mu)
        assert state is not None
        return replace(state, iterations=iterations, sweeps=sweeps, converged=state.converged and settled)
