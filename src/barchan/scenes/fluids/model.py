"""Quasi-Newtonian flows on curved cells as a `Model`: steady ones solved in one step, the others stepped in time from rest.

A steady scene has two frames: 0 is the start, at rest, and 1 the solution; `time` counts them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.flows.quasi_newtonian import observables
from barchan.flows.quasi_newtonian.flow import Inertia, QuasiNewtonianFlow
from barchan.flows.quasi_newtonian.newton import FlowSolution, NonlinearOptions
from barchan.flows.quasi_newtonian.observables import CutLine
from barchan.flows.quasi_newtonian.sampling import magnitude
from barchan.flows.quasi_newtonian.solving import solve
from barchan.flows.quasi_newtonian.time_stepping import backward_difference
from barchan.linalg.multigrid import CycleOptions
from barchan.results.stored_meshes import mesh_group
from barchan.scenes.model import Arrays
from barchan.spaces.quadratic import QuadraticMesh, QuadraticSpace

Vector = NDArray[np.float64]

MOST_DRAWN = 60_000
"""Nodes up to which all of them are vertices of the stored mesh; of finer meshes only the corners of cells are."""

MOST_DIRECT = 50_000
"""Unknowns up to which the direct solver is the faster one (benchmarks/bench_couette.py)."""
LINE_POINTS = 401
LEAST = 1e-12
"""Smallest value of a field over its greatest that is told apart from it."""


@dataclass(frozen=True)
class FluidState:
    """State of a scene: time, steps taken, how the last step was solved.

    scale : residual of the first start, to which tolerances are relative.
    before : (N, 2) velocity one step earlier.  inertia : time derivative of the last step, None when it was a steady solution.
    """

    time: float
    step: int
    solution: FlowSolution
    scale: float
    before: Vector
    inertia: Inertia | None


@dataclass(frozen=True)
class FluidRecord:
    """One step: time at its end, length, nonlinear iterations, residual over that of the start, mean cycles, greatest speed."""

    step: int
    time: float
    dt: float
    sweeps: int
    residual: float
    converged: bool
    cycles: float
    max_speed: float


class FluidModel:
    """The model of a kind of scene; a subclass builds mesh and flow and says what is measured."""

    def __init__(self, parameters: Any) -> None:
        self.parameters = parameters
        self.meshes = self.hierarchy()
        if parameters.elements.split:
            self.meshes = [self.meshes[-1].split_at_centres()]
        self.space = QuadraticSpace(self.meshes[-1], parameters.elements.chosen)
        self.flow = self.build(self.space)

    # -- what a kind says --------------------------------------------------------------------------------------------

    def hierarchy(self) -> list[QuadraticMesh]:
        """The meshes from the coarsest to that of the flow, each the refinement of the one before."""
        raise TypeError("a kind of scene makes its own meshes")

    def build(self, space: QuadraticSpace) -> QuasiNewtonianFlow:
        """The flow on the finest mesh. Raises InputError for a parameter that it rejects."""
        raise TypeError("a kind of scene builds its own flow")

    def scalars(self, state: FluidState) -> dict[str, float]:
        """What is measured at every frame."""
        return {}

    def lines(self, solution: FlowSolution) -> dict[str, Vector]:
        """What is sampled along lines at every frame, each (m,)."""
        return {}

    # -- Model -------------------------------------------------------------------------------------------------------

    def initial(self) -> FluidState:
        """Nothing moves."""
        space = self.space
        pressure = (self.flow.mean_pressure or 0.0) * space.unit_pressure
        rest = FlowSolution(np.zeros((space.N, 2)), pressure, None, [0.0], [], [], True)
        return FluidState(0.0, 0, rest, 0.0, rest.velocity, None)

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> FluidState:
        """The state of a checkpoint."""
        direction = arrays["direction"]
        solution = FlowSolution(
            arrays["velocity"],
            arrays["pressure"],
            direction if direction.size else None,
            arrays["residuals"].tolist(),
            arrays["weights"].tolist(),
            arrays["cycles"].tolist(),
            bool(arrays["converged"]),
        )
        rate = float(arrays["rate"])
        return FluidState(
            float(arrays["time"]),
            int(arrays["step"]),
            solution,
            float(arrays["scale"]),
            arrays["before"],
            Inertia(rate, arrays["past"]) if rate > 0.0 else None,
        )

    def arrays(self, state: FluidState) -> Arrays:
        """The complete state, for a checkpoint."""
        solution, inertia = state.solution, state.inertia
        return {
            "time": np.array(state.time),
            "step": np.array(state.step),
            "scale": np.array(state.scale),
            "before": state.before,
            "rate": np.array(0.0 if inertia is None else inertia.rate),
            "past": np.zeros((0, 2)) if inertia is None else inertia.past,
            "velocity": solution.velocity,
            "pressure": solution.pressure,
            "direction": np.zeros((0, 0, 3)) if solution.direction is None else solution.direction,
            "residuals": np.array(solution.residuals),
            "weights": np.array(solution.weights),
            "cycles": np.array(solution.cycles, dtype=np.int64),
            "converged": np.array(solution.converged),
        }

    def longest_step(self, state: FluidState) -> float:
        """A steady scene is one step long."""
        return 1.0 if self.parameters.steady else float(self.parameters.time.step)

    def advance(self, state: FluidState, dt: float) -> tuple[FluidState, FluidRecord]:
        """One time step, or the steady solution."""
        # Steps that fill a frame differ in their last digits.
        inertia = None if self.parameters.steady else self._inertia(state, float(f"{dt:.12g}"))
        solution = self._solve(state, inertia)
        scale = state.scale if state.step else solution.scale
        after = FluidState(state.time + dt, state.step + 1, solution, scale, state.solution.velocity, inertia)
        record = FluidRecord(
            step=after.step,
            time=after.time,
            dt=dt,
            sweeps=solution.iterations,
            residual=solution.residuals[-1] / scale if scale > 0.0 else 0.0,
            converged=solution.converged,
            cycles=_mean(solution.cycles),
            max_speed=max_speed(solution),
        )
        return after, record

    def ended(self, state: FluidState) -> bool:
        """A flow is stepped to its end."""
        return False

    def frame(self, state: FluidState) -> dict[str, Arrays]:
        """Fields at the vertices of the stored mesh, lines, the history of the solver; the mesh with the first frame."""
        groups: dict[str, Arrays] = {}
        if state.step == 0:
            groups["mesh"] = mesh_group(self.shown)
        solution = state.solution
        groups["fields"] = self.fields(solution)
        groups["lines"] = {
            **self.lines(solution),
            "residuals": np.array(solution.residuals),
            "weights": np.array(solution.weights),
            "cycles": np.array(solution.cycles, dtype=float),
        }
        return groups

    def observables(self, state: FluidState, record: FluidRecord | None) -> dict[str, float]:
        """Scalars of a frame."""
        solution = state.solution
        return {
            "time": state.time,
            "max_speed": max_speed(solution),
            "nonlinear_iterations": float(solution.iterations),
            "multigrid_cycles": _mean(solution.cycles),
            "unknowns": float(self.space.size),
            **self.scalars(state),
        }

    # -- help for kinds ----------------------------------------------------------------------------------------------

    @cached_property
    def shown(self) -> Any:
        """The straight mesh on which fields are stored: a quarter of each cell, or whole ones of a very fine mesh."""
        mesh = self.meshes[-1]
        return mesh.refined().skeleton if len(mesh.nodes) <= MOST_DRAWN else mesh.skeleton

    def fields(self, solution: FlowSolution) -> Arrays:
        """Velocities (V, 2), pressures, shear rates |g|, viscosities, plug (0 or 1 between them) at the vertices (V,)."""
        flow, count = self.flow, self.shown.p.shape[1]
        at_points = flow.fields(solution.velocity, solution.pressure)
        nodal = {
            "pressures": observables.nodal(self.space, at_points.pressure),
            "shear_rates": self._smooth(magnitude(at_points.rate)),
            "viscosities": self._smooth(at_points.viscosity),
            "plug": observables.nodal(self.space, observables.rigid_points(flow, solution).astype(float)),
        }
        return {
            "velocities": solution.velocity[:count],
            **{name: field[:count] for name, field in nodal.items()},
        }

    def cut(
        self, solution: FlowSolution, start: ArrayLike, end: ArrayLike, points: int = LINE_POINTS
    ) -> CutLine:
        """The fields at `points` of a straight line."""
        return observables.cut_line(self.flow, solution, start, end, points)

    def _smooth(self, values: Vector) -> Vector:
        """(N,) nodal values of a positive field (C, Q) that changes by orders of magnitude, by way of its logarithm."""
        greatest = float(np.max(values))
        if greatest <= 0.0:
            return np.zeros(self.space.N)
        return np.asarray(np.exp(observables.nodal(self.space, np.log(np.maximum(values, LEAST * greatest)))))

    def _inertia(self, state: FluidState, dt: float) -> Inertia:
        """The time derivative at the end of a step."""
        before = state.before if state.step > 0 else None
        return backward_difference(self.parameters.time.scheme, dt, state.solution.velocity, before)

    @property
    def linear_solver(self) -> str:
        """ "direct" or "multigrid"."""
        chosen = str(self.parameters.solver.linear_solver)
        if chosen != "auto":
            return chosen
        many = self.space.mesh.quadrilateral and self.space.size > MOST_DIRECT
        return "multigrid" if many else "direct"

    @cached_property
    def spaces(self) -> list[QuadraticSpace]:
        """Coarse to fine, the last one that of the flow; that one only where nothing needs the others."""
        if self.linear_solver == "direct" and not (self.parameters.steady and self.parameters.nested):
            return [self.space]
        coarser = [QuadraticSpace(mesh, self.space.pressure_name) for mesh in self.meshes[:-1]]
        return [*coarser, self.space]

    def _solve(self, state: FluidState, inertia: Inertia | None) -> FlowSolution:
        """The steady flow, or the flow at the end of a step from that at its start."""
        solver, solution, first = self.parameters.solver, state.solution, state.step == 0
        options = NonlinearOptions(
            method=solver.method,
            tolerance=solver.tolerance if first else solver.tolerance * state.scale,
            max_iterations=solver.max_iterations,
            relative=first,
            strategy=solver.strategy,
            delta0=solver.delta0,
            halvings=solver.halvings,
        )
        # A solver orders its matrices by the first it sees: a resumed run must show it the same one, so each step has its own.
        return solve(
            self.flow,
            options,
            self.linear_solver,
            self.spaces,
            nested=inertia is None and self.parameters.nested,
            start=None if first else solution.state,
            inertia=inertia,
            gain=solver.gain,
            max_cycles=solver.max_cycles,
            cycle=CycleOptions(pre=solver.smoothing, post=solver.smoothing),
        )


def max_speed(solution: FlowSolution) -> float:
    """Greatest speed at the nodes."""
    return float(np.sqrt(np.max(np.sum(solution.velocity**2, axis=1))))


def _mean(cycles: list[int]) -> float:
    return float(np.mean(cycles)) if cycles else 0.0
