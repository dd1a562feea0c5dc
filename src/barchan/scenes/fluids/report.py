"""Summary, first figures and pictures of the scenes of quasi-Newtonian flows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from barchan.results import Results
from barchan.scenes.continuum.report import Curve, draw_curves, figure_text, solved
from barchan.scenes.fluids.model import FluidModel
from barchan.scenes.kinds.kind import Kind


@dataclass(frozen=True)
class FluidShown:
    """What a person is shown of a finished scene.

    figures : (name, words) of observables whose last value is asked for first.  curves : pictures of lines by file name.
    units : labels of `barchan.results.fields`; SI when empty.  pressure : whether the pressure has a panel.
    """

    figures: tuple[tuple[str, str], ...]
    curves: tuple[tuple[str, Curve], ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)
    pressure: bool = True


def fluid_kind(name: str, parameters: Any, model: Callable[[Any], FluidModel], shown: FluidShown) -> Kind:
    """The kind `name` of scenes of quasi-Newtonian flows, from its classes of parameters and model."""

    def figures(summary: dict[str, Any]) -> list[tuple[str, str]]:
        cycles = (
            f", {summary['multigrid_cycles']:.3g} multigrid cycles each"
            if summary["multigrid_cycles"]
            else ""
        )
        return [
            *((words, figure_text(summary[key])) for key, words in shown.figures),
            ("greatest speed", figure_text(summary["max_speed"])),
            ("unknowns, cells", f"{summary['unknowns']}, {summary['cells']}"),
            ("nonlinear iterations", f"{summary['nonlinear_iterations']:.0f}{cycles}"),
        ]

    def draw(scene: Any, results: Results, summary: dict[str, Any], folder: Path) -> None:
        _draw(scene, results, folder, shown)

    return Kind(name, parameters, model, summarise, draw, figures)


def summarise(parameters: Any, results: Results) -> dict[str, Any]:
    """Final observables, how the run ended, its worst residual (over that of the start of the step)."""
    steps = results.steps
    final = {name: float(values[-1]) for name, values in results.observables.items()}
    unknowns = int(final.pop("unknowns"))
    return {
        "end_time": final.pop("time"),
        **final,
        "ended": "steady" if parameters.steady else "time limit",
        "unknowns": unknowns,
        "cells": parameters.cells,
        **solved(steps, parameters.solver.tolerance),
    }


def _draw(scene: Any, results: Results, folder: Path, shown: FluidShown) -> None:
    """fields.png, one picture for each curve and residuals.png, in `folder`."""
    from barchan.results.fields import SI, draw_flow_fields
    from barchan.results.lines import draw_lines
    from barchan.results.stored_meshes import mesh_from

    title = scene.scene.description or scene.scene.name
    fields, lines = results.fields(-1), results.lines(-1)
    viscosities = fields["viscosities"]
    uniform = np.ptp(viscosities) < 1e-6 * np.max(viscosities)
    draw_flow_fields(
        folder / "fields.png",
        mesh_from(results.mesh),
        fields["velocities"],
        fields["pressures"] if shown.pressure else None,
        shear_rate=fields["shear_rates"],
        viscosity=None if uniform else viscosities,
        rigid=fields["plug"] > 0.5,
        title=title,
        units=shown.units or SI,
    )
    draw_curves(folder, shown.curves, lines, title)
    draw_lines(
        folder / "residuals.png",
        np.arange(len(lines["residuals"])),
        {"residual": lines["residuals"]},
        ("nonlinear iteration", "residual"),
        title=title,
        logarithmic=True,
    )
