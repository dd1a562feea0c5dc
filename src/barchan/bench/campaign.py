"""A campaign: chosen solvers over a set of problems, written down after every problem so that a kill loses little.

Leaves results.csv, results.md, profile.png and residuals.png in a folder; each file appears whole or not at all.
"""

from __future__ import annotations

import math
import os
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from barchan import friction
from barchan.bench.measurement import Measurement, Solver, measure
from barchan.bench.pictures import draw_profile, draw_residuals
from barchan.bench.profile import as_csv, as_markdown
from barchan.bench.siconos import PEERS, PLANE, SPATIAL, peer, siconos_is_there
from barchan.errors import InputError
from barchan.storage import unwritable, write_text

SUFFIXES = (".dat", ".hdf5", ".h5")
Named = tuple[str, friction.Problem]


@dataclass(frozen=True)
class Variant:
    """A method with options of its own, under the name that tables give it."""

    label: str
    method: str
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Plan:
    """What to compare.

    methods : names of `friction.methods()`.  variants : methods with options, compared beside them.
    tolerance : certificate to reach.  time_limit : seconds for one solve.  repeats : solves of which the shortest counts.
    peers : whether to ask Siconos, where the system has it.

    Raises
    ------
    InputError : unknown or no method, tolerance or limit not positive, repeats < 1.
    """

    methods: tuple[str, ...] = ("auto", "gauss_seidel", "aspg")
    tolerance: float = 1e-6
    time_limit: float = 10.0
    repeats: int = 3
    peers: bool = True
    variants: tuple[Variant, ...] = ()

    def __post_init__(self) -> None:
        if not self.methods and not self.variants:
            raise InputError("methods", "none", "one or more of " + ", ".join(friction.methods()))
        for name in (*self.methods, *(variant.method for variant in self.variants)):
            if name not in friction.methods():
                raise InputError("methods", name, "one of " + ", ".join(friction.methods()))
        for field_name in ("tolerance", "time_limit"):
            value = getattr(self, field_name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(field_name, value, "a finite number > 0")
        if self.repeats < 1:
            raise InputError("repeats", self.repeats, ">= 1")


@dataclass
class Campaign:
    """Measurements so far, in the order they were made, and the peers that took part."""

    measurements: list[Measurement] = field(default_factory=list)
    peers: tuple[str, ...] = ()


def problems_of_folder(folder: Path) -> list[Named]:
    """Every problem file of a folder, by name.

    Raises
    ------
    InputError : no such folder, no problem file in it, or a file that cannot be read (named).
    """
    if not folder.is_dir():
        raise InputError(str(folder), "no such folder", "a folder of problem files")
    files = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and path.is_file())
    if not files:
        raise InputError(str(folder), "no problem file", "a folder with " + ", ".join(SUFFIXES) + " files")
    return [(path.name, friction.read(path)) for path in files]


def run_campaign(
    problems: Sequence[Named],
    plan: Plan,
    out: Path,
    progress: Callable[[Measurement], None] = lambda measurement: None,
) -> Campaign:
    """Run every solver of the plan on every problem and write the results into the folder `out` (made if needed).

    progress : called with each measurement.

    Raises
    ------
    InputError : `out` cannot be made or written.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise InputError(str(out), "a file", "a folder") from error
    except OSError as error:
        raise unwritable(out, error) from error
    campaign = Campaign(peers=_peers_for(problems) if plan.peers and siconos_is_there() else ())
    own = (*(Variant(name, name) for name in plan.methods), *plan.variants)
    solvers: dict[str, Solver] = {variant.label: _own(variant) for variant in own}
    solvers |= {name: peer(name) for name in campaign.peers}
    for name, problem in problems:
        for solver in solvers.values():
            found = solver(name, problem, plan.tolerance, plan.time_limit, plan.repeats)
            campaign.measurements.append(found)
            progress(found)
        _write_tables(out, campaign, plan)
    draw_profile(out / "profile.png", campaign.measurements, plan.tolerance)
    draw_residuals(out / "residuals.png", campaign.measurements, plan.tolerance)
    return campaign


def _own(variant: Variant) -> Solver:
    def measured(
        name: str, problem: friction.Problem, tolerance: float, time_limit: float, repeats: int
    ) -> Measurement:
        return measure(
            name, problem, variant.method, tolerance, time_limit, repeats, variant.label, **variant.options
        )

    return measured


def _peers_for(problems: Sequence[Named]) -> tuple[str, ...]:
    sizes = {problem.s for _, problem in problems}
    known = (*(SPATIAL if sizes - {2} else ()), *(PLANE if 2 in sizes else ()))
    return tuple(name for name in PEERS if name in known)


def _write_tables(out: Path, campaign: Campaign, plan: Plan) -> None:
    machine = f"{os.cpu_count()} processors, {platform.machine()}, Python {platform.python_version()}"
    heading = f"Solvers to certificate {plan.tolerance:g}, at most {plan.time_limit:g} s a solve ({machine})"
    write_text(out / "results.csv", as_csv(campaign.measurements))
    write_text(out / "results.md", as_markdown(campaign.measurements, campaign.peers, heading))
