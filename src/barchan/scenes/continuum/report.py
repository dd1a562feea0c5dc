"""Summary, first figures and pictures of the scenes on finite elements."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from barchan.results import Results
from barchan.scenes.continuum.model import ContinuumModel
from barchan.scenes.kinds.kind import Kind


@dataclass(frozen=True)
class Curve:
    """A picture of lines: names and words of the abscissa and of what is drawn over it.

    upright : the abscissa is drawn upwards, as a height is.  logarithmic : the values by order of magnitude.
    """

    abscissa: str
    along: str
    drawn: tuple[tuple[str, str], ...]
    values: str
    upright: bool = False
    logarithmic: bool = False


@dataclass(frozen=True)
class Shown:
    """What a person is shown of a finished scene.

    figures : (name, words) of observables whose last value is asked for first.  curves : pictures of lines by file name.
    mirror : half of the domain is simulated, and pictures of fields show the whole.
    """

    figures: tuple[tuple[str, str], ...]
    curves: tuple[tuple[str, Curve], ...] = ()
    mirror: bool = False


def continuum_kind(name: str, parameters: Any, model: Callable[[Any], ContinuumModel], shown: Shown) -> Kind:
    """The kind `name` of scenes on finite elements, from its classes of parameters and model."""

    def figures(summary: dict[str, Any]) -> list[tuple[str, str]]:
        return [
            *((words, figure_text(summary[key])) for key, words in shown.figures),
            ("greatest speed", figure_text(summary["max_speed"])),
            ("ended", f"{summary['ended']}, t = {summary['end_time']:.4g}"),
        ]

    def draw(scene: Any, results: Results, summary: dict[str, Any], folder: Path) -> None:
        _draw(scene, results, folder, shown)

    return Kind(name, parameters, model, summarise, draw, figures)


def summarise(parameters: Any, results: Results) -> dict[str, Any]:
    """Final observables, how the run ended, and its worst certificate."""
    steps, observables = results.steps, results.observables
    final = {name: float(values[-1]) for name, values in observables.items()}
    steady = bool(final.pop("steady"))
    mesh = results.mesh
    return {
        "end_time": final.pop("time"),
        **final,
        "ended": "steady" if steady else "time limit",
        "vertices": len(mesh["positions"]),
        "cells": len(mesh["cells"]),
        **solved(steps, parameters.solver.tolerance),
    }


def solved(steps: Mapping[str, np.ndarray], tolerance: float) -> dict[str, Any]:
    """What a summary says about the solves of a run."""
    return {
        "worst_certificate": float(steps["residual"].max()),
        "tolerance": tolerance,
        "converged": bool(np.all(steps["converged"])),
        "unconverged_steps": int(np.sum(~steps["converged"].astype(bool))),
        "steps": len(steps["time"]),
        "sweeps": int(steps["sweeps"].sum()),
    }


def figure_text(value: float | None) -> str:
    return "none" if value is None else f"{value:.6g}"


def _draw(scene: Any, results: Results, folder: Path, shown: Shown) -> None:
    """fields.png, one picture for each curve, and history.png of a run over time, in `folder`."""
    from barchan.results.fields import DIMENSIONLESS, SI, draw_flow_fields
    from barchan.results.lines import draw_lines
    from barchan.results.stored_meshes import mesh_from

    title = scene.scene.description or scene.scene.name
    if results.mesh["positions"].shape[1] == 2:
        fields = results.fields(-1)
        draw_flow_fields(
            folder / "fields.png",
            mesh_from(results.mesh),
            fields["velocities"],
            fields["pressures"],
            fields["shear_stresses"],
            fields["shear_rates"],
            fields["plug"] > 0.5,
            title=title,
            mirror=shown.mirror,
            units=DIMENSIONLESS if scene.scene.dimensionless else SI,
        )
    draw_curves(folder, shown.curves, results.lines(-1) if shown.curves else {}, title)
    if results.frames > 2:
        steps = results.steps
        draw_lines(
            folder / "history.png", steps["time"], {"every step": steps["watched"]}, ("time", "what is watched"),
            title=title,
        )  # fmt: skip


def draw_curves(
    folder: Path, curves: Sequence[tuple[str, Curve]], lines: Mapping[str, np.ndarray], title: str
) -> None:
    """One picture for each curve, of what `lines` holds of it."""
    from barchan.results.lines import draw_lines

    for name, curve in curves:
        draw_lines(
            folder / f"{name}.png",
            lines[curve.abscissa],
            {words: lines[key] for key, words in curve.drawn if key in lines},
            (curve.along, curve.values),
            title=title,
            upright=curve.upright,
            logarithmic=curve.logarithmic,
        )
