"""Run by an interpreter that has NVIDIA Newton, not by barchan: its implicit MPM on given particles, block by block.

Argument: a .npz with positions, volumes and the numbers of the column. Speaks JSON, one line to a request, on its standard
input and output. Private names of Newton are only watched, never changed: where they are missing, what they tell is null.
"""

from __future__ import annotations

import json
import os
import sys
import time
from typing import Any

import numpy as np

GIVEN = dict(np.load(sys.argv[1]))
ANSWERS = os.fdopen(os.dup(1), "w", encoding="utf-8")
os.dup2(2, 1)  # what Newton and Warp print is not an answer

import newton  # type: ignore[import-not-found] # noqa: E402
import warp as wp  # type: ignore[import-not-found] # noqa: E402
from newton.solvers import SolverImplicitMPM  # type: ignore[import-not-found] # noqa: E402


class Watch:
    """What Newton's solver of the friction problem is given, and what it makes of it.

    checks : its own (root mean square, largest) residuals of the step, one pair each time it looks.
    wanted : whether to keep problems; kept : the arrays of the last one, before and after the solve.
    solving, copying : seconds of the last solve, and of keeping it, which are not Newton's; the latter of the processor also.
    """

    def __init__(self) -> None:
        self.checks: list[tuple[float, float]] = []
        self.wanted = False
        self.kept: dict[str, Any] = {}
        self.solving = self.copying = self.copying_processor = 0.0
        self.sees_checks = self.sees_problems = False

    def install(self) -> None:
        """Stand between Newton's step and its solver."""
        try:
            from newton._src.solvers.implicit_mpm import solve_rheology as solving  # type: ignore[import-not-found]
            from newton._src.solvers.implicit_mpm import solver_implicit_mpm as stepping

            norms, solve = solving._nonlinear_solver_result_norms, stepping.solve_rheology
        except (ImportError, AttributeError):
            return

        def checked(*arguments: Any, **options: Any) -> Any:
            found = norms(*arguments, **options)
            self.checks.append((float(found[0]), float(found[1])))
            return found

        def solved(*arguments: Any, **options: Any) -> Any:
            began, worked = time.perf_counter(), time.process_time()
            if self.wanted:
                self.kept = problem_arrays(*arguments[3:6])
            ready, worked = time.perf_counter(), time.process_time() - worked
            answer = solve(*arguments, **options)
            done, again = time.perf_counter(), time.process_time()
            if self.wanted:
                self.kept |= answer_arrays(*arguments[3:6])
            self.copying_processor = worked + time.process_time() - again
            self.solving = done - ready
            self.copying = ready - began + time.perf_counter() - done
            return answer

        solving._nonlinear_solver_result_norms = checked
        stepping.solve_rheology = solved
        self.sees_checks = self.sees_problems = True


def rows_of(matrix: Any, prefix: str) -> dict[str, np.ndarray]:
    """Copies of the compressed rows of one of Warp's matrices."""
    count = int(matrix.nnz_sync())
    values = matrix.values.numpy()[:count]
    return {
        f"{prefix}_offsets": matrix.offsets.numpy().copy(),
        f"{prefix}_columns": matrix.columns.numpy()[:count].copy(),
        f"{prefix}_values": values.reshape(count, values[0].size if count else 0).copy(),
    }


def problem_arrays(momentum: Any, rheology: Any, collision: Any) -> dict[str, np.ndarray]:
    """The friction problem of a step, as Newton has assembled it."""
    return {
        "inverse_masses": momentum.inv_volume.numpy().copy(),
        "free_velocities": momentum.velocity.numpy().copy(),
        "yield_parameters": rheology.yield_params.numpy().copy(),
        "strain_offset": rheology.unilateral_strain_offset.numpy().copy(),
        "strain": rheology.elastic_strain_delta.numpy().copy(),
        "compliance": np.abs(rows_of(rheology.compliance_mat, "c")["c_values"]).max(initial=0.0),
        "wall_friction": collision.collider_friction.numpy().copy(),
        "wall_normals": collision.collider_normals.numpy().copy(),
        "stresses_before": rheology.stress.numpy().copy(),
        "impulses_before": collision.collider_impulse.numpy().copy(),
        "wall_velocities": collision.collider_velocities.numpy().copy(),
        **rows_of(rheology.strain_mat, "strain"),
        **rows_of(collision.collider_mat, "wall"),
    }


def answer_arrays(momentum: Any, rheology: Any, collision: Any) -> dict[str, np.ndarray]:
    """Its solution."""
    return {
        "velocities": momentum.velocity.numpy().copy(),
        "stresses": rheology.stress.numpy().copy(),
        "wall_impulses": collision.collider_impulse.numpy().copy(),
    }


class Column:
    """The particles in Newton, and their steps."""

    def __init__(self) -> None:
        builder = newton.ModelBuilder(up_axis=newton.Axis.Z)
        SolverImplicitMPM.register_custom_attributes(builder)
        count = len(GIVEN["positions"])
        builder.add_particles(
            pos=[tuple(map(float, x)) for x in GIVEN["positions"]],
            vel=[(0.0, 0.0, 0.0)] * count,
            mass=[float(GIVEN["density"] * volume) for volume in GIVEN["volumes"]],
            radius=[float(0.5 * volume ** (1.0 / 3.0)) for volume in GIVEN["volumes"]],
        )
        floor = newton.ModelBuilder.ShapeConfig(mu=float(GIVEN["floor_friction"]))
        builder.add_ground_plane(height=float(GIVEN["floor"]), cfg=floor)
        self.model = builder.finalize(device="cpu")
        self.model.set_gravity((0.0, 0.0, -float(GIVEN["gravity"])))
        self.model.mpm.friction.fill_(float(GIVEN["friction"]))
        config = SolverImplicitMPM.Config(
            voxel_size=float(GIVEN["voxel"]),
            tolerance=float(GIVEN["tolerance"]),
            max_iterations=int(GIVEN["most_sweeps"]),
            strain_basis=str(GIVEN["strain_basis"]),
            critical_fraction=float(GIVEN["critical_fraction"]),
            air_drag=float(GIVEN["air_drag"]),
            collider_basis=str(GIVEN["collider_basis"]),
        )
        self.state, self.other = self.model.state(), self.model.state()
        self.solver = SolverImplicitMPM(self.model, config=config)
        self.time = 0.0

    def step(self) -> float:
        """Advance by one step; seconds it took."""
        dt = float(GIVEN["dt"])
        began = time.perf_counter()
        self.solver.step(self.state, self.other, None, None, dt)
        self.solver.project_outside(self.other, self.other, dt)
        wp.synchronize_device("cpu")
        seconds = time.perf_counter() - began
        self.state, self.other = self.other, self.state
        self.time += dt
        return seconds


def main() -> None:
    """Answer requests {"steps": n, "keep": folder or null} until the input ends; step k is kept as <folder>/<k>.npz."""
    watch = Watch()
    watch.install()
    column = Column()
    tell({"newton": newton.__version__, "warp": wp.__version__, "python": sys.version.split()[0]})
    for line in sys.stdin:
        request = json.loads(line)
        watch.wanted = bool(request["keep"])
        steps = []
        for number in range(request["steps"]):
            watch.checks.clear()
            watch.kept, watch.solving, watch.copying, watch.copying_processor = {}, 0.0, 0.0, 0.0
            worked = time.process_time()
            seconds = column.step() - watch.copying
            processor = time.process_time() - worked - watch.copying_processor
            if watch.wanted and watch.kept:
                np.savez(os.path.join(request["keep"], f"{number}.npz"), **watch.kept)
            last = watch.checks[-1] if watch.sees_checks and watch.checks else None
            solve = watch.solving if watch.sees_problems else None
            checks = len(watch.checks)
            steps.append(
                {
                    "seconds": seconds,
                    "processor": processor,
                    "solve": solve,
                    "checks": checks,
                    "residuals": last,
                }
            )
        if request["keep"]:
            np.save(os.path.join(request["keep"], "positions.npy"), column.state.particle_q.numpy())
        tell({"time": column.time, "steps": steps})


def tell(answer: dict[str, Any]) -> None:
    """One line of JSON."""
    ANSWERS.write(json.dumps(answer) + "\n")
    ANSWERS.flush()


if __name__ == "__main__":
    main()
