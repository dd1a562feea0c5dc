"""A collapsing column by the material point method: seconds a step and certificates, beside NVIDIA Newton's implicit MPM.

Both programs make the same steps from the same particles, a block of steps in turn; one certificate judges the friction
problem that each has assembled. Every step of ours is solved twice in two simulations: to the certificate that Newton's step
of the same number has reached, and to the tolerance of the plan.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numba
import numpy as np
from numpy.typing import NDArray

from barchan import friction
from barchan.bench.newton import Newton, NewtonFailure, PeerStep
from barchan.bench.newton_problem import NewtonStep, Scale, newton_step
from barchan.errors import InputError
from barchan.flows.mpm import Material, Options, State, Stepper, Wall, Walls, fill_box
from barchan.spaces import RegularGrid

GRAVITY, DENSITY, DT, VOXEL = 9.81, 1500.0, 1.0 / 240.0, 1.0 / 32.0
BOX_CELLS, COLUMN_CELLS, PER_AXIS = (48, 48, 16), (8, 8, 11), 2
NEWTON, EQUAL, OWN = "Newton", "barchan to Newton's certificate", "barchan"
LOOSEST = 1e-2  # of our tolerances, whatever Newton reaches
EDGE = 0.995  # share of the matter inside the reach and below the top
# Newton's grid has its nodes half a voxel off the multiples of the voxel: so both programs see the same cells.
OFFSET = 0.5 * VOXEL


@dataclass(frozen=True)
class ColumnPlan:
    """What is compared: a column of 8 x 8 x 11 cells of 1/32 m (0.25 x 0.25 x 0.34 m), 8 particles a cell, 1/240 s.

    blocks, steps : blocks of steps made in turn, and steps in each.  warm_up : steps before that do not count.
    tolerance : of Newton's solver (largest change of strain in a sweep) and of our own certificate.
    friction : physical coefficient of the sand and of the floor.  most_sweeps : of Newton, a step.
    threads : of ours; Newton has one on the processor.
    strain_basis, collider_basis : Newton's elements; Q1 strains are those of `flows.mpm`, S2 its usual collider.

    Raises
    ------
    InputError : for a number out of range.
    """

    blocks: int = 7
    steps: int = 10
    warm_up: int = 3
    tolerance: float = 1e-4
    friction: float = 0.5
    most_sweeps: int = 250
    threads: int = 1
    strain_basis: str = "Q1"
    collider_basis: str = "S2"

    def __post_init__(self) -> None:
        for name, least in (("blocks", 1), ("steps", 1), ("warm_up", 0), ("most_sweeps", 1), ("threads", 1)):
            if getattr(self, name) < least:
                raise InputError(name, getattr(self, name), f"a whole number >= {least}")
        for name in ("tolerance", "friction"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(name, value, "a finite number > 0")


@dataclass(frozen=True)
class Step:
    """A measured step: program, block, number, seconds (clock, processor), sweeps, certificate (NaN: unknown)."""

    solver: str
    block: int
    step: int
    seconds: float
    processor: float
    sweeps: int
    certificate: float


@dataclass(frozen=True)
class Shape:
    """The column after a block: time [s], mean height, top and reach from the axis [m] of 99.5 % of the matter.

    excess : share of the matter that is too much for its cell.
    """

    solver: str
    time: float
    mean_height: float
    top: float
    reach: float
    excess: float


@dataclass(frozen=True)
class SameProblem:
    """A friction problem of Newton's solved by both from Newton's start: seconds, and the certificates reached."""

    block: int
    newton_seconds: float
    newton_certificate: float
    seconds: float
    certificate: float
    sweeps: int


@dataclass
class Comparison:
    """All that was measured.

    particles : their number.  versions : of Newton.  notes : what went wrong.
    own_residuals : (root mean square, largest) of Newton's last sweep, step by step.
    """

    particles: int
    versions: dict[str, str] = field(default_factory=dict)
    steps: list[Step] = field(default_factory=list)
    shapes: list[Shape] = field(default_factory=list)
    same: list[SameProblem] = field(default_factory=list)
    own_residuals: list[tuple[float, float]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def of(self, solver: str) -> list[Step]:
        """The steps of one program."""
        return [step for step in self.steps if step.solver == solver]

    def median_seconds(self, solver: str) -> float:
        """Of a step; NaN for a program that did not run."""
        found = [step.seconds for step in self.of(solver)]
        return statistics.median(found) if found else math.nan

    def median_processor(self, solver: str) -> float:
        """Of a step, on the processor: what the clock would say on a machine with nothing else to do, on one thread."""
        found = [step.processor for step in self.of(solver)]
        return statistics.median(found) if found else math.nan

    def ratio(self, solver: str) -> float:
        """Newton's median seconds over those of `solver`; NaN without Newton."""
        return self.median_seconds(NEWTON) / self.median_seconds(solver)

    @property
    def no_worse(self) -> float:
        """Share of the steps in which `EQUAL` has reached Newton's certificate or a better one; NaN without Newton."""
        theirs = {step.step: step.certificate for step in self.of(NEWTON)}
        ours = [step.certificate <= theirs[step.step] for step in self.of(EQUAL)]
        return sum(ours) / len(ours) if ours else math.nan


class Sand:
    """Our simulation of the column: its state, and a step at a tolerance of its own."""

    def __init__(self, plan: ColumnPlan) -> None:
        self.grid, material, self.state = column(plan)
        walls = Walls({"z_min": Wall("friction", plan.friction)})
        self.stepper = Stepper(self.grid, material, walls, GRAVITY, options=Options(tolerance=plan.tolerance))

    def advance(self, tolerance: float) -> tuple[float, float, int, float]:
        """Seconds by the clock and of the processor, sweeps and certificate of a step."""
        stepper = replace(self.stepper, options=replace(self.stepper.options, tolerance=tolerance))
        began, worked = time.perf_counter(), time.process_time()
        self.state, record = stepper.advance(self.state, DT)
        worked = time.process_time() - worked
        return time.perf_counter() - began, worked, record.sweeps, record.residual


def column(plan: ColumnPlan) -> tuple[RegularGrid, Material, State]:
    """Grid, sand and particles: a column in the middle of the floor."""
    grid = RegularGrid.from_box([VOXEL * cells for cells in BOX_CELLS], list(BOX_CELLS))
    material = Material(density=DENSITY, friction=plan.friction)
    corner = [VOXEL * (BOX_CELLS[k] - COLUMN_CELLS[k]) / 2 if k < 2 else 0.0 for k in range(3)]
    top = [corner[k] + VOXEL * COLUMN_CELLS[k] for k in range(3)]
    return grid, material, fill_box(grid, corner, top, PER_AXIS, material)


def compare(
    plan: ColumnPlan,
    interpreter: Path | None,
    progress: Callable[[str], None] = lambda line: None,
) -> Comparison:
    """Run the comparison.

    interpreter : a Python that has Newton (`newton.find_newton`); None measures barchan alone.
    progress : called with a line after every block.
    """
    with _threads(plan.threads):
        return _compare(plan, interpreter, progress)


@contextmanager
def _threads(count: int) -> Iterator[None]:
    """Within this context our kernels run on so many threads, or on all there are."""
    before = numba.get_num_threads()
    numba.set_num_threads(min(count, before))
    try:
        yield
    finally:
        numba.set_num_threads(before)


def _compare(plan: ColumnPlan, interpreter: Path | None, progress: Callable[[str], None]) -> Comparison:
    own, equal = Sand(plan), Sand(plan)
    found = Comparison(own.state.particle_count)
    _compile(plan)
    with ExitStack() as stack:
        newton = _started(plan, own.state, interpreter, found, stack)
        for _ in range(plan.warm_up):
            own.advance(plan.tolerance)
            equal.advance(plan.tolerance)
        for block in range(plan.blocks):
            tolerances: list[float] = []
            if newton is not None:
                try:
                    tolerances = _peer_block(newton, plan, block, found)
                except NewtonFailure as failure:
                    found.notes.append(str(failure))
                    newton = None
            if tolerances:
                _own_block(equal, EQUAL, block, tolerances, found)
            _own_block(own, OWN, block, [plan.tolerance] * plan.steps, found)
            progress(_told(found, block))
    return found


def _compile(plan: ColumnPlan) -> None:
    """Two steps of a column that is then forgotten, so that nothing measured compiles."""
    trial = Sand(plan)
    for tolerance in (LOOSEST, plan.tolerance):
        trial.advance(tolerance)


def _started(
    plan: ColumnPlan, state: State, interpreter: Path | None, found: Comparison, stack: ExitStack
) -> Newton | None:
    """Newton after its warm-up, closed by `stack`; None where there is none or it fails, which is a note."""
    if interpreter is None:
        return None
    given = {
        "positions": state.positions + OFFSET, "volumes": state.volumes, "density": DENSITY, "gravity": GRAVITY,
        "floor": OFFSET, "floor_friction": plan.friction, "friction": plan.friction, "voxel": VOXEL, "dt": DT,
        "tolerance": plan.tolerance, "most_sweeps": plan.most_sweeps, "strain_basis": plan.strain_basis,
        "collider_basis": plan.collider_basis, "air_drag": 1.0,
        "critical_fraction": 1.0 - Material(density=DENSITY, friction=plan.friction).packing_tolerance,
    }  # fmt: skip
    try:
        newton = stack.enter_context(Newton(interpreter, given))
        if plan.warm_up:
            newton.advance(plan.warm_up, False)
    except NewtonFailure as failure:
        found.notes.append(str(failure))
        return None
    found.versions = newton.versions
    return newton


def _peer_block(newton: Newton, plan: ColumnPlan, block: int, found: Comparison) -> list[float]:
    """A block of Newton's; the tolerances that ours must meet to be no worse, none where Newton shows no problem."""
    made, positions = newton.advance(plan.steps, True)
    assert positions is not None
    positions = positions - OFFSET
    stress = DENSITY * GRAVITY * float(np.mean(positions[:, 2]) - np.min(positions[:, 2]))
    scale = Scale(VOXEL, DT, DENSITY, stress)
    steps = [newton_step(peer.kept, scale) if peer.kept else None for peer in made]
    certificates = [step.certificate.residual if step else math.nan for step in steps]
    for number, (peer, certificate) in enumerate(zip(made, certificates, strict=True)):
        count = block * plan.steps + number
        found.steps.append(
            Step(NEWTON, block, count, peer.seconds, peer.processor, _sweeps(peer, plan), certificate)
        )
        if peer.residuals is not None:
            found.own_residuals.append(peer.residuals)
    time_now = (plan.warm_up + (block + 1) * plan.steps) * DT
    found.shapes.append(_shape(NEWTON, time_now, positions))
    last = steps[-1]
    if last is None or made[-1].solve is None:
        return []
    found.same.append(_same_problem(block, last, certificates[-1], made[-1].solve))
    return [min(certificate, LOOSEST) for certificate in certificates]


def _sweeps(peer: PeerStep, plan: ColumnPlan) -> int:
    """Newton's Gauss-Seidel looks at its residuals after every 25 sweeps."""
    return min(25 * peer.looks, 25 * math.ceil(plan.most_sweeps / 25))


def _own_block(sand: Sand, name: str, block: int, tolerances: Sequence[float], found: Comparison) -> None:
    for number, tolerance in enumerate(tolerances):
        seconds, processor, sweeps, certificate = sand.advance(tolerance)
        found.steps.append(
            Step(name, block, block * len(tolerances) + number, seconds, processor, sweeps, certificate)
        )
    found.shapes.append(_shape(name, sand.state.time, sand.state.positions))


def _same_problem(block: int, step: NewtonStep, certificate: float, seconds: float) -> SameProblem:
    """Solve Newton's problem of a step from Newton's start, to Newton's certificate; the shorter of two solves."""
    solutions = []
    for _ in range(2):
        fresh = replace(step.problem)  # without what the solve before has prepared
        began = time.perf_counter()
        solution = friction.solve(fresh, "auto", tol=min(certificate, LOOSEST), r0=step.start)
        solutions.append((time.perf_counter() - began, solution))
    ours, best = min(solutions, key=lambda found: found[0])
    return SameProblem(block, seconds, certificate, ours, best.certificate.residual, best.iterations)


def _shape(solver: str, now: float, positions: NDArray[np.float64]) -> Shape:
    middle = 0.5 * VOXEL * np.array(BOX_CELLS[:2])
    radii = np.linalg.norm(positions[:, :2] - middle, axis=1)
    heights = positions[:, 2]
    cells = np.floor(positions / VOXEL).astype(np.int64)
    _, counts = np.unique(cells, axis=0, return_counts=True)
    full = PER_AXIS**3
    return Shape(
        solver,
        now,
        float(np.mean(heights)),
        float(np.quantile(heights, EDGE)),
        float(np.quantile(radii, EDGE)),
        float(np.sum(np.maximum(counts - full, 0)) / len(positions)),
    )


def _told(found: Comparison, block: int) -> str:
    """A block in a line."""
    parts = []
    for solver in (NEWTON, EQUAL, OWN):
        steps = [step for step in found.of(solver) if step.block == block]
        if steps:
            seconds = statistics.median(step.seconds for step in steps)
            worst = max(step.certificate for step in steps)
            parts.append(f"{solver}: {1e3 * seconds:.1f} ms a step, certificate {worst:.1e}")
    return f"block {block + 1}  " + "; ".join(parts)
