"""Dense flows on finite elements as a `Model`: steady ones solved in one step, inertial ones stepped until they are steady.

A steady scene has two frames: 0 is the start, at rest but for prescribed velocities, and 1 the solution; `time` counts
them. An inertial scene is stepped with `step` until what it watches is steady, then with `final_step`, which lowers the
error of the characteristics, until it is steady again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import skfem
from numpy.typing import NDArray

from barchan.flows.dense import DenseFlow, DenseState, observables
from barchan.results.stored_meshes import mesh_group
from barchan.scenes.continuum.parameters import TimeGroup
from barchan.scenes.model import Arrays
from barchan.spaces.mixed import MixedSpace

Vector = NDArray[np.float64]

STAGES = 2
"""Stages of an inertial scene: with `step`, with `final_step`; after them it has ended."""


@dataclass(frozen=True)
class FlowState:
    """State of a scene.

    time : of the scene.  step : steps taken.  flow : velocities and stresses.  stage : 0, 1, or 2 when ended.
    past : (m, 2) times and values of what is watched since the stage began.
    """

    time: float
    step: int
    flow: DenseState
    stage: int
    past: Vector


@dataclass(frozen=True)
class FlowRecord:
    """One step: time at its end, length, iterations, certificate, greatest speed, stage, what is watched."""

    step: int
    time: float
    dt: float
    sweeps: int
    residual: float
    converged: bool
    max_speed: float
    stage: int
    watched: float


class ContinuumModel:
    """The model of a kind of scene on finite elements; a subclass builds the flow and says what is measured.

    parameters : of the scene.  time : its [time] table when it has inertia, None for a steady scene.
    """

    def __init__(self, parameters: Any, time: TimeGroup | None = None) -> None:
        self.parameters = parameters
        self.time = time
        self.flow = self.build()
        self._primed: float | None = None

    # -- what a kind says --------------------------------------------------------------------------------------------

    def build(self) -> DenseFlow:
        """The flow. Raises InputError for a parameter that it rejects."""
        raise TypeError("a kind of scene builds its own flow")

    def scalars(self, state: DenseState) -> dict[str, float]:
        """What is measured at every frame."""
        return {}

    def lines(self, state: DenseState) -> dict[str, Vector]:
        """What is sampled along lines at every frame, each (m,)."""
        return {}

    def watched(self, state: DenseState) -> float:
        """The number whose change decides whether an inertial flow is steady."""
        return self.max_speed(state)

    # -- Model -------------------------------------------------------------------------------------------------------

    def initial(self) -> FlowState:
        """At rest, but for prescribed velocities."""
        return FlowState(0.0, 0, self.flow.at_rest(), 0, np.zeros((0, 2)))

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> FlowState:
        """The state of a checkpoint."""
        flow: Any = arrays["flow"]
        return FlowState(
            float(arrays["time"]),
            int(arrays["step"]),
            DenseState.from_arrays(flow),
            int(arrays["stage"]),
            arrays["past"],
        )

    def arrays(self, state: FlowState) -> Arrays:
        """The complete state, for a checkpoint."""
        flow: Any = state.flow.arrays()
        return {
            "time": np.float64(state.time),
            "step": np.int64(state.step),
            "flow": flow,
            "stage": np.int64(state.stage),
            "past": state.past,
        }

    def longest_step(self, state: FlowState) -> float:
        """The step of the stage; a steady scene is one step long."""
        if self.time is None:
            return 1.0
        return self.time.step if state.stage == 0 else self.time.final_step

    def advance(self, state: FlowState, dt: float) -> tuple[FlowState, FlowRecord]:
        """One time step, or the steady solution."""
        solver = self.parameters.solver
        if self.time is None:
            flow = self.flow.solve(tolerance=solver.tolerance, method=solver.method)
        else:
            # Steps that fill a frame differ in their last digits; matrices are kept while the step is the same.
            length = float(f"{dt:.12g}")
            self._prime(length)
            flow = self.flow.step(state.flow, length, solver.tolerance, solver.method)
        time, watched = state.time + dt, self.watched(flow)
        past = np.vstack([state.past, [[time, watched]]])
        stage = state.stage
        if self.time is not None and stage < STAGES and self._steady(past):
            stage, past = stage + 1, np.zeros((0, 2))
            if stage == 1 and self.time.final_step >= self.time.step:
                stage = STAGES
        after = FlowState(time, state.step + 1, flow, stage, past)
        record = FlowRecord(
            step=after.step,
            time=time,
            dt=dt,
            sweeps=int(flow.iterations),
            residual=float(flow.certificate.residual),
            converged=bool(flow.converged),
            max_speed=self.max_speed(flow),
            stage=state.stage,
            watched=watched,
        )
        return after, record

    def ended(self, state: FlowState) -> bool:
        """Whether an inertial flow has become steady with its final step."""
        return state.stage >= STAGES

    def frame(self, state: FlowState) -> dict[str, Arrays]:
        """Fields at the vertices and lines; the mesh with the first frame."""
        groups: dict[str, Arrays] = {}
        if state.step == 0:
            groups["mesh"] = mesh_group(self.space.mesh)
        groups["fields"] = self.fields(state.flow)
        lines = self.lines(state.flow)
        if lines:
            groups["lines"] = dict(lines)
        return groups

    def observables(self, state: FlowState, record: FlowRecord | None) -> dict[str, float]:
        """Scalars of a frame."""
        return {
            "time": state.time,
            "max_speed": self.max_speed(state.flow),
            "steady": 1.0 if self.ended(state) or (self.time is None and record is not None) else 0.0,
            **self.scalars(state.flow),
        }

    # -- help for kinds ----------------------------------------------------------------------------------------------

    @property
    def space(self) -> MixedSpace:
        """Velocities and stresses."""
        return self.flow.space

    def max_speed(self, state: DenseState) -> float:
        """Greatest speed at the nodes."""
        d = self.space.dimension
        return float(np.sqrt(np.max(np.sum(state.velocity.reshape(-1, d) ** 2, axis=1))))

    def fields(self, state: DenseState) -> Arrays:
        """Vertex velocities (V, d), stresses (V, s) in block coordinates, pressures, shear stresses and rates, plug (V,)."""
        flow = self.flow
        stresses = state.forces[: self.space.n].T
        at_vertices = {
            "pressures": observables.pressures(flow, state),
            "shear_stresses": observables.shear_stresses(flow, state),
            "shear_rates": observables.shear_rates(flow, state),
            "plug": observables.rigid(flow, state).astype(float),
        }
        return {
            "velocities": self.space.vertex_velocities(state.velocity),
            "stresses": np.stack([observables.vertex_field(flow, values) for values in stresses], axis=1),
            **{name: observables.vertex_field(flow, values) for name, values in at_vertices.items()},
        }

    def line(
        self, state: DenseState, start: Any, end: Any, count: int = 201
    ) -> tuple[Vector, Vector, Vector]:
        """Points (count, d) from `start` to `end`, velocities (count, d) and pressures (count,) there."""
        share = np.linspace(0.0, 1.0, count)[:, None]
        points = (1.0 - share) * np.asarray(start, dtype=float) + share * np.asarray(end, dtype=float)
        pressures = observables.vertex_field(self.flow, observables.pressures(self.flow, state))
        return points, self.space.at(state.velocity, points), self._at_vertices(pressures, points)

    def _at_vertices(self, values: Vector, points: Vector) -> Vector:
        """Values (V,) at the vertices, interpolated linearly at points (n, d)."""
        basis = skfem.CellBasis(self.space.mesh, skfem.ElementTriP1(), intorder=1)
        return np.asarray(basis.probes(points.T) @ values)

    def _prime(self, length: float) -> None:
        """Let the flow make its matrices for steps of this length from rest, not from the state that comes first.

        A flow measures the loads of later steps from that of the first: a resumed run must measure from the same one.
        """
        if length != self._primed:
            self.flow.problem(self.flow.at_rest(), length)
            self._primed = length

    def _steady(self, past: Vector) -> bool:
        """Whether the means over the two halves of the window agree: the tolerance of the solver makes single values jump."""
        assert self.time is not None
        window = self.time.steady_window
        if past[-1, 0] - past[0, 0] < window * (1.0 - 1e-9):
            return False
        age = past[-1, 0] - past[:, 0]
        late, early = past[age < 0.5 * window, 1], past[(age >= 0.5 * window) & (age < window), 1]
        if len(early) == 0:  # steps longer than half of the window: the two last ones
            late, early = past[-1:, 1], past[-2:-1, 1]
        change = abs(float(late.mean() - early.mean()))
        return change <= self.time.steady_tolerance * abs(float(late.mean())) + 1e-12
