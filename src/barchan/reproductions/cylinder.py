"""Drag of a cylinder in granular flow, and the fields around it (seed A, Fig. 15-16)."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

from barchan.reproductions.workshop import Finished, Job, Report, Table, Workshop, all_converged, new_figure

Drag: TypeAlias = dict[tuple[float, float], Finished]
"""Runs by diameter and downstream pressure."""

TITLE = "Granular flow past a cylinder: drag against speed, fields (seed A, Fig. 15-16)"

DIAMETERS = (0.0625, 0.125, 0.25)
PRESSURES = (0.2, 0.4, 0.5, 0.6, 0.7, 0.8)
EQUAL_SPEEDS = (0.3, 0.5, 1.0)
"""Mean upstream velocities at which the diameters are compared, in reach of all of them; the first with any friction."""
CHANNEL: dict[str, Any] = {
    "mu": 0.5,
    "reynolds": 100.0,
    "bingham": 0.0,
    "sides": "no_slip",
    "tolerance": 3e-4,
}
NARROW: dict[str, Any] = {"mu": 0.3, "diameter": DIAMETERS[-1], "stress": "P1", "tolerance": 1e-5}
"""Continuous stresses: discontinuous ones are more than the velocities determine, and scatter where matter is rigid."""
WALLS = {"no_slip": 0.8, "free_slip": 1.7}
"""Sides of the narrow channel -> downstream pressure: sides that slip freely bear nothing, and it flows faster."""
BLOCKING = (1.1, 1.5, 3.0)
"""Downstream pressures at which nothing flows; 3 bears the weight of the whole channel, whose length is 3, alone."""
EXACT = 1e-8
"""Tolerance of what stands still: its velocity is that of the certificate."""
STILL = 1e-3
FRICTIONS = {0.1: (1.6, 1.8, 1.9, 2.0), 0.3: (0.9, 1.0, 1.1, 1.2)}
"""Smaller friction coefficients -> downstream pressures, with speeds on both sides of the first of `EQUAL_SPEEDS`."""


def radial_exponent(mu: float) -> float:
    """n of F ~ D^n if stresses grow towards the cylinder as in a radial plastic field: (1 - mu) / (1 + mu).

    Yield with sin(phi) = mu gives sigma_r = K sigma_theta, K = (1 + mu) / (1 - mu), and d(r sigma_r)/dr = sigma_theta then
    r sigma_r ~ r^(1 / K): a stress that is given at a distance meets the cylinder with a force ~ D^(1 / K).
    """
    return (1.0 - mu) / (1.0 + mu)


def reproduce(workshop: Workshop) -> Report:
    """Drag for three diameters at several downstream pressures; the narrow channel with both kinds of walls; blockage."""
    vertices = 300 if workshop.quick else 1200
    pressures: dict[float, tuple[float, ...]] = {
        CHANNEL["mu"]: PRESSURES[1::2] if workshop.quick else PRESSURES
    }
    pressures |= {mu: those[::3] if workshop.quick else those for mu, those in FRICTIONS.items()}
    cases = [(mu, d, p) for mu, those in pressures.items() for d in DIAMETERS for p in those]
    jobs = [_job(d, p, vertices, mu=mu) for mu, d, p in cases]
    jobs += [_narrow(sides, 600 if workshop.quick else 3000) for sides in WALLS]
    jobs += [_job(DIAMETERS[-1], pressure, vertices, tolerance=EXACT) for pressure in BLOCKING]
    runs = workshop.run(jobs)
    found: dict[float, Drag] = {mu: {} for mu in pressures}
    for (mu, diameter, pressure), run in zip(cases, runs, strict=False):
        found[mu][diameter, pressure] = run
    others = runs[len(cases) :]
    narrow, blocked = others[: len(WALLS)], others[len(WALLS) :]
    drag = found[CHANNEL["mu"]]
    _write(workshop, found)
    _draw(workshop, drag, narrow)
    tables = [
        _slope_table(drag), _diameter_table(drag), _friction_table(found), _field_table(narrow),
        _blockage_table(drag, blocked),
    ]  # fmt: skip
    notes = [
        "Seed A prints no numbers: Fig. 15 shows straight lines in logarithmic axes, those over U on one another: "
        "C_D ~ Fr^-2, and a drag proportional to the diameter.",
        "Here it is not: stresses grow towards the cylinder about as in a radial plastic field (see docs/reproductions.md).",
    ]
    return Report(tables, notes, all_converged(runs))


def _job(diameter: float, pressure: float, vertices: int, **changes: float) -> Job:
    overrides = {
        **CHANNEL, "diameter": diameter, "external_pressure": pressure, "vertices": vertices, **changes,
    }  # fmt: skip
    return Job(f"mu{overrides['mu']:g}-D{diameter:g}-p{pressure:g}", "cylinder", overrides)


def _narrow(sides: str, vertices: int) -> Job:
    overrides = {**CHANNEL, **NARROW, "sides": sides, "external_pressure": WALLS[sides], "vertices": vertices}
    return Job(f"narrow-{sides}", "cylinder", overrides)


def _series(drag: Drag, diameter: float, key: str) -> np.ndarray:
    """An observable at the downstream pressures at which something flows, from slow to fast."""
    runs = [run.summary for (d, _), run in drag.items() if d == diameter]
    moving = sorted((s for s in runs if s["mean_velocity"] > STILL), key=lambda s: s["mean_velocity"])
    return np.array([s[key] for s in moving])


def _slope_table(drag: Drag) -> Table:
    rows = []
    for diameter in DIAMETERS:
        froude, coefficient = (
            np.log10(_series(drag, diameter, key)) for key in ("froude", "drag_coefficient")
        )
        speeds, forces = (_series(drag, diameter, key) for key in ("mean_velocity", "drag"))
        line = np.polyfit(froude, coefficient, 1) if len(froude) > 1 else np.full(2, np.nan)
        off = np.abs(coefficient - np.polyval(line, froude)).max(initial=0.0)
        rows.append((
            f"{diameter:g}", f"{speeds.min():.3g} .. {speeds.max():.3g}", f"{forces.min():.3f} .. {forces.max():.3f}",
            f"{np.ptp(coefficient):.1f}", "-2", f"{line[0]:.2f}", f"{off:.2f}",
        ))  # fmt: skip
    columns = (
        "D / L", "U / sqrt(g L)", "F / (rho g L^2)", "C_D spans decades", "slope of C_D over Fr, published", "ours",
        "off the straight line by decades",
    )  # fmt: skip
    return Table("drag coefficient", columns, rows)


def _at_speed(drag: Drag, diameter: float, key: str, speed: float) -> float:
    """An observable at a mean upstream velocity, between those that were run; NaN beyond them."""
    speeds, values = (_series(drag, diameter, name) for name in ("mean_velocity", key))
    return float(np.interp(np.log(speed), np.log(speeds), values, left=np.nan, right=np.nan))


def _diameter_table(drag: Drag) -> Table:
    rows = []
    for speed in EQUAL_SPEEDS:
        whole, contact = _forces(drag, speed)
        over = [
            f"{_known(part / d)} ({_known(touch / d)})"
            for part, touch, d in zip(whole, contact, DIAMETERS, strict=True)
        ]
        spread = np.log10((whole / DIAMETERS).max() / (whole / DIAMETERS).min())
        rows.append((f"{speed:g}", *over, f"{_known(spread)} (published: none seen)"))
    columns = (
        "U / sqrt(g L)", *(f"F / D (by contact) at D = {diameter:g}" for diameter in DIAMETERS),
        "C_D at this U differs by decades",
    )  # fmt: skip
    return Table("drag over diameter at equal speeds", columns, rows)


def _forces(drag: Drag, speed: float) -> tuple[np.ndarray, np.ndarray]:
    """Drag on each of `DIAMETERS` at a speed, whole and by contact."""
    whole, contact = (
        np.array([_at_speed(drag, diameter, key, speed) for diameter in DIAMETERS])
        for key in ("drag", "drag_contact")
    )
    return whole, contact


def _friction_table(found: dict[float, Drag]) -> Table:
    speed = EQUAL_SPEEDS[0]
    rows = []
    for mu in sorted(found):
        exponents = [_known(_exponent(forces)) for forces in _forces(found[mu], speed)]
        rows.append((f"{mu:g}", "1" if mu == CHANNEL["mu"] else "", *exponents, f"{radial_exponent(mu):.2f}"))
    columns = (
        "mu",
        "n in F ~ D^n, published",
        "ours",
        "by contact",
        "radial plastic field, (1 - mu) / (1 + mu)",
    )
    return Table(f"growth of the drag with the diameter, U = {speed:g} sqrt(g L)", columns, rows)


def _known(value: float) -> str:
    """Two decimals, or a dash where no runs lie on both sides of the speed."""
    return f"{value:.2f}" if np.isfinite(value) else "-"


def _exponent(forces: np.ndarray) -> float:
    """n of F ~ D^n through the forces at `DIAMETERS`; NaN when one is missing."""
    if not np.isfinite(forces).all():
        return np.nan
    return float(np.polyfit(np.log(DIAMETERS), np.log(forces), 1)[0])


def _field_table(narrow: list[Finished]) -> Table:
    rows = []
    for sides, run in zip(WALLS, narrow, strict=True):
        s = run.summary
        front, arch, distance, dip = _along_the_axis(
            run.observables["ahead_x"], run.observables["ahead_pressure"]
        )
        rows.append((
            sides.replace("_", " "), f"{s['mean_velocity']:.3g}", f"{s['wake_pressure']:.1e}", f"{s['wake_length']:.3g}",
            f"{front:.3g}", f"{arch:.3g}, {distance:.3g} ahead", f"{dip:.2g}", f"{s['rigid_area_ahead']:.2g}",
        ))  # fmt: skip
    columns = (
        "sides", "U", "pressure in the wake (published: 0)", "length of the wake", "pressure at the very front",
        "greatest on the axis (published: ahead of the front)", "dip on the axis upstream (published: no slip only)",
        "rigid area ahead (published: a triangle)",
    )  # fmt: skip
    return Table("the narrow channel, D = L/4, mu = 0.3", columns, rows)


def _along_the_axis(x: np.ndarray, pressure: np.ndarray) -> tuple[float, float, float, float]:
    """Of the pressure on the axis: at the front of the cylinder; the greatest, how far ahead; how deep it falls before."""
    top = int(np.argmax(pressure))
    dip = np.maximum.accumulate(pressure[: top + 1]) - pressure[: top + 1]
    return float(pressure[-1]), float(pressure[top]), float(x[-1] - x[top]), float(dip.max())


def _blockage_table(drag: Drag, blocked: list[Finished]) -> Table:
    diameter = DIAMETERS[-1]
    flowing = [(pressure, run) for (d, pressure), run in drag.items() if d == diameter]
    rows = [
        (f"{pressure:g}", f"{run.summary['mean_velocity']:.1e}", f"{run.summary['max_speed']:.1e}", "flows")
        for pressure, run in flowing
    ]
    rows += [
        (
            f"{pressure:g}",
            f"{run.summary['mean_velocity']:.1e}",
            f"{run.summary['max_speed']:.1e}",
            "nothing flows",
        )
        for pressure, run in zip(BLOCKING, blocked, strict=True)
    ]
    columns = ("downstream pressure", "U / sqrt(g L)", "greatest speed", "published")
    return Table(f"the downstream pressure stops the flow, D = {diameter:g}, mu = 0.5", columns, rows)


def _write(workshop: Workshop, found: dict[float, Drag]) -> None:
    keys = (
        "mean_velocity", "drag", "drag_contact", "drag_viscous", "froude", "drag_coefficient", "wake_pressure", "wake_length",
        "rigid_area_ahead",
    )  # fmt: skip
    rows = [
        (mu, *case, *(run.summary[key] for key in keys))
        for mu, drag in found.items()
        for case, run in drag.items()
    ]
    workshop.write_csv("drag.csv", ("mu", "diameter", "external_pressure", *keys), rows)


def _draw(workshop: Workshop, drag: Drag, narrow: list[Finished]) -> None:
    from barchan.results.fields import DIMENSIONLESS, draw_flow_fields
    from barchan.results.stored_meshes import mesh_from

    figure = new_figure(12.0, 4.0)
    panels = (
        ("froude", "drag_coefficient", "Fr", "C_D"),
        ("mean_velocity", "drag_coefficient", "U / sqrt(g L)", "C_D"),
        ("mean_velocity", "drag", "U / sqrt(g L)", "F / (rho g L^2)"),
    )
    for axis, (abscissa, ordinate, along, label) in zip(figure.subplots(1, 3), panels, strict=True):
        for diameter in DIAMETERS:
            x, y = _series(drag, diameter, abscissa), _series(drag, diameter, ordinate)
            axis.loglog(x, y, "o-", label=f"D = {diameter:g} L")
        axis.set(xlabel=along, ylabel=label)
        axis.grid(alpha=0.3, which="both")
        axis.legend(fontsize=8)
    workshop.save("drag.png", figure)
    for name, run in zip(WALLS, narrow, strict=True):
        mesh, fields = mesh_from(run.results.mesh), run.results.fields(-1)
        whole = mesh, np.arange(mesh.p.shape[1])
        for file, (part, vertices) in {"fields": whole, "near": _near(mesh, 1.5 * DIAMETERS[-1])}.items():
            draw_flow_fields(
                workshop.out / f"{file}_{name}.png", part, fields["velocities"][vertices], fields["pressures"][vertices],
                fields["shear_stresses"][vertices], fields["shear_rates"][vertices], fields["plug"][vertices] > 0.5,
                title=f"cylinder, {name.replace('_', ' ')}; U = sqrt(g L), P = rho g L", mirror=True, units=DIMENSIONLESS,
            )  # fmt: skip


def _near(mesh: Any, reach: float) -> tuple[Any, np.ndarray]:
    """The part of the mesh with |x| and |y| below `reach`, and its vertices in the whole one."""
    centres = mesh.p[:, mesh.t].mean(axis=1)
    part, vertices = mesh.restrict(np.nonzero(np.abs(centres).max(axis=0) < reach)[0], return_mapping=True)
    return part, np.asarray(vertices)
