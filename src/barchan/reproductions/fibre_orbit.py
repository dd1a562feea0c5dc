"""Exact and faceted friction: the orbit of the free end of a fibre on a ball that turns to and fro (seed B, Fig. 4.6).

Every solver of exact friction leads to the same periodic orbit; the pyramid of four sides, as a local solver aligned with the
unconstrained sliding (Otaduy et al. 2009) or as a law in fixed directions, leads to others.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.reproductions.workshop import (
    Finished,
    Job,
    Report,
    Table,
    Workshop,
    all_converged,
    new_figure,
)

TITLE = "Periodic orbit of a fibre on a turning ball: exact friction and pyramids (seed B, Fig. 4.6)"

Vector = NDArray[np.float64]

EXACT: dict[str, tuple[str, str]] = {
    "GS, hybrid MFB + Enum": ("gauss_seidel", "fischer-burmeister+enumerative"),
    "GS, secular": ("gauss_seidel", "secular"),
    "GS, MFB": ("gauss_seidel", "fischer-burmeister"),
    "GS, DAC": ("gauss_seidel", "alart-curnier-damped"),
    "GS, Enum": ("gauss_seidel", "enumerative"),
    "GS, Duriez": ("gauss_seidel", "duriez"),
    "Newton, MFB": ("newton_fischer_burmeister", ""),
    "Newton, DAC": ("newton_alart_curnier", ""),
}
"""Name -> method and local solver."""

PYRAMIDS: dict[str, dict[str, Any]] = {
    "GS, 4sides": {
        "solver.method": "gauss_seidel", "solver.local_solver": "pyramid", "solver.max_sweeps": 200,
        "solver.tolerance": 1e-6,
    },
    "faceted law": {"contact.law": "faceted"},
}  # fmt: skip

QUICK = ("GS, hybrid MFB + Enum", "Newton, MFB")
SECONDS = 6  # that are run; the last one, two periods of the ball, is the orbit
ALLOWED = 0.01  # of the orbit, between exact solvers


def reproduce(workshop: Workshop) -> Report:
    """The orbits of all solvers and how far they are from the first one's."""
    names = QUICK if workshop.quick else tuple(EXACT)
    exact = [
        _job(name, {"solver.method": EXACT[name][0], "solver.local_solver": EXACT[name][1]}) for name in names
    ]
    faceted = [_job(name, over) for name, over in PYRAMIDS.items()]
    runs = workshop.run([*exact, *faceted])
    labels = [*names, *PYRAMIDS]
    orbits = [orbit(run) for run in runs]
    rows = []
    for label, run, own in zip(labels, runs, orbits, strict=True):
        rows.append(
            (
                label, "pyramid" if label in PYRAMIDS else "exact", f"{100.0 * difference(own, orbits[0]):.3g} %",
                f"{100.0 * drift(run):.2g} %", f"{run.summary['mean_sweeps']:.1f}",
                f"{run.summary['worst_certificate']:.1e}",
            )
        )  # fmt: skip
    columns = (
        "solver",
        "friction",
        "distance from the first orbit",
        "from one second to the next",
        "iterations",
        "certificate",
    )
    workshop.write_csv("fibre_orbit.csv", columns, rows)
    _draw(workshop, labels, orbits)
    same = max(difference(own, orbits[0]) for own in orbits[: len(names)])
    other = min(difference(own, orbits[0]) for own in orbits[len(names) :])
    notes = [
        f"Orbits of exact solvers differ by {100.0 * same:.2g} % at most (allowed {100.0 * ALLOWED:g} %), of position and "
        f"velocity each over its extent; those of pyramids by {100.0 * other:.2g} % at least.",
        "The scene is ours: seed B gives neither the fibre nor the motion of its ball.",
    ]
    return Report([Table("periodic orbits", columns, rows)], notes, all_converged(runs[: len(names)]))


def _job(label: str, overrides: dict[str, Any]) -> Job:
    folder = "".join(c if c.isalnum() else "_" for c in label)
    return Job(folder, "fibre_on_ball", {"time.end": float(SECONDS), **overrides})


def orbit(run: Finished) -> Vector:
    """(n, 6) places [m] and velocities [m/s] of the tip in the last second, two periods of the ball."""
    found = run.observables
    names = [f"tip_{axis}" for axis in "xyz"] + [f"tip_v{axis}" for axis in "xyz"]
    last = found["time"] > found["time"][-1] - 1.0 + 1e-6
    return np.column_stack([found[name][last] for name in names])


def drift(run: Finished) -> float:
    """Distance of the orbits of the last two seconds."""
    found = run.observables
    before = {name: values[found["time"] <= found["time"][-1] - 1.0 + 1e-6] for name, values in found.items()}
    return difference(orbit(run), orbit(Finished(run.summary, before, run.results)))


def difference(one: Vector, two: Vector) -> float:
    """Largest distance of two orbits at the same phase, of places and of velocities, each over the extent of the second."""
    found = 0.0
    for part in (slice(0, 3), slice(3, 6)):
        extent = float(np.linalg.norm(np.ptp(two[:, part], axis=0)))
        found = max(found, float(np.max(np.linalg.norm(one[:, part] - two[:, part], axis=1))) / extent)
    return found


def _draw(workshop: Workshop, labels: list[str], orbits: list[Vector]) -> None:
    """Phase plots of the tip: exact solvers in full, pyramids in dashes."""
    figure = new_figure(12.0, 4.8)
    for axis, (across, word) in zip(figure.subplots(1, 2), ((1, "y"), (2, "z")), strict=True):
        for number, (label, own) in enumerate(zip(labels, orbits, strict=True)):
            closed = np.vstack([own, own[:1]])
            style: dict[str, Any] = {"linestyle": "-", "linewidth": 3.6 * 0.75**number, "alpha": 0.8}
            if label in PYRAMIDS:
                style = {"linestyle": "--", "linewidth": 1.4}
            axis.plot(1e3 * closed[:, across], closed[:, across + 3], label=label, **style)
        axis.set(xlabel=f"{word} of the free end (mm)", ylabel=f"its velocity along {word} (m/s)")
        axis.grid(alpha=0.3)
    handles, words = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, words, fontsize=8, loc="outside right center")
    figure.suptitle(TITLE, fontsize=10)
    workshop.save("fibre_orbit.png", figure)
