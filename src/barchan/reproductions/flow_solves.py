"""Nonlinear solves of the flows of seed C, which tables count by the hundred: wanted, done in processes, kept as JSON.

Scenes give mesh and conditions (chapters 5 and 6); what varies is the fluid, the solver and its start.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from barchan import scenes
from barchan.flows.quasi_newtonian import NonlinearOptions, QuasiNewtonianFlow, ViscosityModel, solve
from barchan.reproductions.workshop import RUNS_FOLDER, Table, Workshop
from barchan.spaces.quadratic import QuadraticSpace
from barchan.storage import write_text

OSCILLATES = "osci"
"""What seed C prints where an iteration does not converge."""


@dataclass(frozen=True)
class Wanted:
    """Solves on one mesh: each fluid from the solution of the one before, the first from rest or from coarser levels.

    scene : "cylinder_dfg" or "couette", for mesh and conditions.  nested : start from the coarser levels, for one fluid.
    gain : of multigrid.
    """

    label: str
    scene: str
    level: int
    fluids: tuple[ViscosityModel, ...]
    options: NonlinearOptions
    linear_solver: str = "direct"
    nested: bool = False
    gain: float = 0.1

    @property
    def file(self) -> str:
        """A name that belongs to exactly these solves."""
        return f"{self.label}-{hashlib.sha256(repr(self).encode()).hexdigest()[:8]}.json"


@dataclass(frozen=True)
class History:
    """One solve: residuals with that of the start, weights delta and multigrid cycles of the steps, seconds."""

    residuals: list[float]
    weights: list[float]
    cycles: list[int]
    converged: bool
    unknowns: int
    seconds: float

    @property
    def iterations(self) -> int:
        """Steps."""
        return len(self.weights)

    @property
    def count(self) -> str:
        """Steps in words of the tables of seed C."""
        return str(self.iterations) if self.converged else OSCILLATES

    @property
    def mean_cycles(self) -> float:
        """Multigrid cycles of a step."""
        return float(np.mean(self.cycles)) if self.cycles else 0.0

    @property
    def changes(self) -> list[float]:
        """Q_n = |R_n| / |R_n-1| of the steps."""
        return [after / before for before, after in zip(self.residuals, self.residuals[1:], strict=False)]


def solve_all(
    workshop: Workshop, wanted: Sequence[Wanted], processes: int | None = None
) -> list[list[History]]:
    """The histories of every fluid of every item, in order; what is in the folder is not solved again.

    processes : how many at a time, those of the workshop when None.
    """
    work = [(str(workshop.out / RUNS_FOLDER / item.file), item) for item in wanted]
    missing = [entry for entry in work if not Path(entry[0]).exists()]
    workshop.each(_solve_into, missing, processes or workshop.processes)
    return [_read(Path(path)) for path, _ in work]


def _read(path: Path) -> list[History]:
    return [History(**entry) for entry in json.loads(path.read_text(encoding="utf-8"))]


def _solve_into(entry: tuple[str, Wanted]) -> str:
    path, wanted = entry
    histories = run_solves(wanted)
    write_text(Path(path), json.dumps([asdict(history) for history in histories]) + "\n")
    counts = ", ".join(history.count for history in histories)
    return f"{wanted.label}: steps {counts}; {sum(history.seconds for history in histories):.1f} s"


def run_solves(wanted: Wanted) -> list[History]:
    """Solve for every fluid in order; a solution that misses the tolerance still starts the next one, unless it diverged."""
    flow, spaces = _flow(wanted.scene, wanted.level)
    start, histories = None, []
    for fluid in wanted.fluids:
        began = time.perf_counter()
        solution = solve(
            flow.with_model(fluid), wanted.options, wanted.linear_solver, spaces, wanted.nested, start,
            gain=wanted.gain,
        )  # fmt: skip
        seconds = time.perf_counter() - began
        finite = [float(norm) for norm in solution.residuals if math.isfinite(norm)]
        histories.append(
            History(
                finite,
                [float(weight) for weight in solution.weights],
                [int(cycles) for cycles in solution.cycles],
                bool(solution.converged),
                flow.space.size,
                seconds,
            )
        )
        start = solution.state if not wanted.nested and np.isfinite(solution.residuals[-1]) else None
    return histories


@lru_cache(maxsize=1)
def _flow(scene: str, level: int) -> tuple[QuasiNewtonianFlow, list[QuadraticSpace]]:
    """The flow of a scene and its spaces from level 1 on."""
    model: Any = scenes.load(scene, level=level).model()
    coarser = [QuadraticSpace(mesh, model.space.pressure_name) for mesh in model.meshes[:-1]]
    return model.flow, [*coarser, model.space]


# -- tables --------------------------------------------------------------------------------------------------------------


def beside(
    title: str, corner: str, columns: Sequence[str], rows: Iterable[tuple[str, Sequence[str], Sequence[str]]]
) -> Table:
    """A table with two columns, published and ours, for each of `columns`. rows : (words, published entries, our entries)."""
    heads = [corner, *(head for words in columns for head in (words, "ours"))]
    body = [
        [words, *(cell for pair in zip(theirs, ours, strict=True) for cell in pair)]
        for words, theirs, ours in rows
    ]
    return Table(title, heads, body)


def steps_of(entry: str) -> int | None:
    """Nonlinear steps of a published entry ("23", "23+6"); None where it is empty or the iteration did not converge."""
    if entry in {"", OSCILLATES}:
        return None
    return sum(int(part) for part in entry.split("+"))


def agreement(pairs: Iterable[tuple[str, History]]) -> str:
    """How our counts compare with published entries, as a sentence."""
    within = compared = failed = rescued = 0
    for theirs, ours in pairs:
        steps = steps_of(theirs)
        if steps is None:
            rescued += theirs == OSCILLATES and ours.converged
            continue
        compared += 1
        failed += not ours.converged
        within += ours.converged and ours.iterations <= 1.3 * steps
    return (
        f"{within} of {compared} published counts are met within 30 % or beaten; {failed} of ours do not converge where "
        f"the published ones do, {rescued} do where they do not."
    )


def long_rows(found: Mapping[tuple[Any, ...], tuple[str, History]]) -> list[tuple[Any, ...]]:
    """Rows for a CSV: key, published, ours, converged, last residual."""
    return [
        (*key, theirs, ours.iterations, ours.converged, ours.residuals[-1])
        for key, (theirs, ours) in found.items()
    ]
