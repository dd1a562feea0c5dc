"""Drag of a cylinder in granular flow, and the fields around it (seed A, Fig. 15-16)."""

from __future__ import annotations

from typing import Any

import numpy as np

from barchan.reproductions.workshop import Finished, Job, Report, Table, Workshop, all_converged, new_figure

TITLE = "Granular flow past a cylinder: drag against speed, fields (seed A, Fig. 15-16)"

DIAMETERS = (0.125, 0.1875, 0.25)
PRESSURES = (0.6, 0.8, 0.9, 1.0, 1.1)
BLOCKED = 3.0
"""A downstream pressure that bears the weight of the whole channel, whose length is 3: nothing flows."""
CHANNEL = {"mu": 0.5, "reynolds": 100.0, "bingham": 0.0, "sides": "no_slip", "tolerance": 1e-4}
NARROW = {"mu": 0.3, "diameter": 0.25}
WALLS = {"no_slip": 0.8, "free_slip": 1.7}
"""Sides of the narrow channel -> downstream pressure: sides that slip freely bear nothing, and it flows faster."""
STILL = 1e-3


def reproduce(workshop: Workshop) -> Report:
    """Drag for three diameters at several downstream pressures; the narrow channel with both kinds of walls."""
    vertices = 300 if workshop.quick else 900
    pressures = PRESSURES[::2] if workshop.quick else PRESSURES
    cases = [(diameter, pressure) for diameter in DIAMETERS for pressure in pressures]
    jobs = [_job(diameter, pressure, vertices) for diameter, pressure in cases]
    jobs += [
        _job(DIAMETERS[-1], BLOCKED, vertices),
        *(_narrow(sides, vertices) for sides in WALLS),
    ]
    runs = workshop.run(jobs)
    drag = dict(zip(cases, runs, strict=False))
    blocked, *narrow = runs[len(cases) :]
    _write(workshop, drag)
    _draw(workshop, drag, narrow)
    tables = [_slope_table(drag, pressures), _linear_table(drag, pressures), _field_table(narrow, blocked)]
    notes = [
        "Seed A prints no numbers: Fig. 15 shows straight lines in logarithmic axes, those over U on one another: "
        "C_D ~ Fr^-2, and a drag proportional to the diameter.",
    ]
    return Report(tables, notes, all_converged(runs))


def _job(diameter: float, pressure: float, vertices: int) -> Job:
    overrides = {**CHANNEL, "diameter": diameter, "external_pressure": pressure, "vertices": vertices}
    return Job(f"D{diameter:g}-p{pressure:g}", "cylinder", overrides)


def _narrow(sides: str, vertices: int) -> Job:
    overrides = {**CHANNEL, **NARROW, "sides": sides, "external_pressure": WALLS[sides], "vertices": vertices}
    return Job(f"narrow-{sides}", "cylinder", overrides)


def _series(drag: dict[Any, Finished], diameter: float, key: str) -> np.ndarray:
    """An observable over the downstream pressures at which something flows."""
    runs = [run.summary for (d, _), run in drag.items() if d == diameter]
    return np.array([s[key] for s in runs if s["mean_velocity"] > STILL])


def _slope_table(drag: dict[Any, Finished], pressures: tuple[float, ...]) -> Table:
    rows = []
    for diameter in DIAMETERS:
        froude, coefficient = (_series(drag, diameter, key) for key in ("froude", "drag_coefficient"))
        speeds = _series(drag, diameter, "mean_velocity")
        slope = np.polyfit(np.log(froude), np.log(coefficient), 1)[0] if len(froude) > 1 else np.nan
        rows.append((
            f"{diameter:g}", f"{len(froude)} of {len(pressures)}",
            f"{speeds.min():.3g} .. {speeds.max():.3g}" if len(speeds) else "none", "-2", f"{slope:.2f}",
        ))  # fmt: skip
    columns = (
        "D / L",
        "pressures at which it flows",
        "U / sqrt(g L)",
        "slope of C_D over Fr, published",
        "ours",
    )
    return Table("drag coefficient", columns, rows)


def _linear_table(drag: dict[Any, Finished], pressures: tuple[float, ...]) -> Table:
    rows = []
    for pressure in pressures:
        forces = [drag[diameter, pressure].summary["drag"] / diameter for diameter in DIAMETERS]
        spread = 100.0 * (max(forces) / min(forces) - 1.0)
        rows.append((f"{pressure:g}", *(f"{force:.3f}" for force in forces), f"{spread:.0f} %"))
    columns = (
        "downstream pressure",
        *(f"F / D at D = {diameter:g}" for diameter in DIAMETERS),
        "spread (published: 0)",
    )
    return Table("drag over diameter", columns, rows)


def _field_table(narrow: list[Finished], blocked: Finished) -> Table:
    rows = [
        (
            sides, f"{run.summary['wake_pressure']:.2g}", f"{run.summary['front_pressure']:.3g}",
            f"{run.summary['max_pressure']:.3g}", f"{run.summary['rigid_area_ahead']:.3g}", f"{run.summary['max_speed']:.3g}",
        )
        for sides, run in zip(("no slip", "free slip"), narrow, strict=True)
    ]  # fmt: skip
    s = blocked.summary
    rows.append((
        f"no slip, pressure {BLOCKED:g}", f"{s['wake_pressure']:.2g}", f"{s['front_pressure']:.3g}",
        f"{s['max_pressure']:.3g}", f"{s['rigid_area_ahead']:.3g}", f"{s['max_speed']:.1e} (published: 0)",
    ))  # fmt: skip
    columns = (
        "sides", "pressure in the wake (published: 0)", "ahead", "greatest", "rigid area ahead", "greatest speed",
    )  # fmt: skip
    return Table("the narrow channel, D = L/4, mu = 0.3", columns, rows)


def _write(workshop: Workshop, drag: dict[Any, Finished]) -> None:
    keys = ("mean_velocity", "drag", "froude", "drag_coefficient", "wake_pressure", "rigid_area_ahead")
    rows = [(*case, *(run.summary[key] for key in keys)) for case, run in drag.items()]
    workshop.write_csv("drag.csv", ("diameter", "external_pressure", *keys), rows)


def _draw(workshop: Workshop, drag: dict[Any, Finished], narrow: list[Finished]) -> None:
    from barchan.results.fields import DIMENSIONLESS, draw_flow_fields
    from barchan.results.stored_meshes import mesh_from

    figure = new_figure(9.0, 4.0)
    for axis, key, label in zip(
        figure.subplots(1, 2), ("froude", "mean_velocity"), ("Fr", "U / sqrt(g L)"), strict=True
    ):
        for diameter in DIAMETERS:
            x, y = _series(drag, diameter, key), _series(drag, diameter, "drag_coefficient")
            axis.loglog(x, y, "o-", label=f"D = {diameter:g} L")
        axis.set(xlabel=label, ylabel="C_D")
        axis.grid(alpha=0.3, which="both")
        axis.legend(fontsize=8)
    workshop.save("drag.png", figure)
    for name, run in zip(WALLS, narrow, strict=True):
        fields = run.results.fields(-1)
        draw_flow_fields(
            workshop.out / f"fields_{name}.png", mesh_from(run.results.mesh), fields["velocities"],
            fields["pressures"], fields["shear_stresses"], fields["shear_rates"], fields["plug"] > 0.5,
            title=f"cylinder, sides: {name.replace('_', ' ')}", mirror=True, units=DIMENSIONLESS,
        )  # fmt: skip
