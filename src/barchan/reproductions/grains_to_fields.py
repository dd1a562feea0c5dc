"""From grains to fields: mu(I) from sheared discs, and a column of discs beside the continuum with that law (seed C, 3.3).

Plane shear of soft discs at constant pressure gives mu(I); a column of rigid discs with the same friction collapses by exact
friction; a column of `flows.mpm` with the fitted law, the same mass and the same packing collapses beside it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.coarse_graining import MuI, effective_friction, fit_mu_i, to_material
from barchan.reproductions.workshop import Finished, Job, Report, Table, Workshop, all_converged, new_figure
from barchan.scenes.granular.surface import free_surface

Vector = NDArray[np.float64]

TITLE = (
    "From grains to fields: mu(I) of sheared discs, their column and the continuum's (seed C, Fig. 5 and 3.3)"
)

INERTIAL = (0.2, 0.1, 0.05, 0.02, 0.01)
QUICK_INERTIAL = (0.2, 0.1, 0.05, 0.02)
STRAIN, QUICK_STRAIN = (2.0, 6.0), (1.0, 4.0)  # du/dy dt left out, and averaged over; at least these times:
TIMES = (30.0, 40.0)  # in d sqrt(rho / p): loose grains must be pressed together first
SAMPLES = 300  # frames of a shear run
BLOCKS = 8  # of a run, for standard errors
MOST_I_0 = 3.0  # in the largest I of the data, for I_0 to be fitted
FRICTION = 0.5
GATE = 0.4  # s, when the gate of `column_grains` begins to rise
CELL = 0.005  # m, of the grid of the continuum; surfaces of both are measured on it
BOX = (0.6, 0.15)
BULK = 0.99  # of the mass, behind the front that is compared


@dataclass(frozen=True)
class Column:
    """The column of discs at rest: packed volume fraction, height (m) it has at that, grain diameter (m), length (m)."""

    volume_fraction: float
    height: float
    diameter: float
    length: float


def reproduce(workshop: Workshop) -> Report:
    """The shear runs, the column of discs, the column of the continuum; one picture with both."""
    points, shears = _calibrate(workshop)
    law = law_of(points)
    (grains,) = workshop.run([Job("grains", "column_grains", {})])
    column = column_at_rest(grains)
    (continuum,) = workshop.run([_continuum_job(workshop, law, column)])
    workshop.write_csv("mu_of_i.csv", ("I", "mu", "error of mu", "volume fraction"), points.tolist())
    _draw_law(workshop, points, law)
    _draw_columns(workshop, grains, continuum, column)
    ours = figures_of(grains, column), figures_of(continuum, column)
    rows = [
        (
            name,
            f"{ours[0][key]:.3f}",
            f"{ours[1][key]:.3f}",
            f"{100.0 * (ours[1][key] / ours[0][key] - 1.0):+.1f} %",
        )
        for name, key in (
            ("run-out (L - L0)/L0, 99 % of the mass", "run_out"),
            ("height H/H0 at the back", "height"),
        )
    ]
    errors = law.errors
    fitted = [
        ("mu_s", f"{law.mu_s:.3f} +- {errors[0]:.3f}"),
        ("mu_2", f"{law.mu_2:.3f} +- {errors[1]:.3f}"),
        ("I_0", f"{law.I_0:.3g} +- {errors[2]:.2g}"),
        ("d mu / d I at 0", f"{law.slope:.2f}"),
        ("packed volume fraction", f"{column.volume_fraction:.3f}"),
    ]
    sheared = [(f"{i:.4g}", f"{mu:.4f} +- {error:.4f}", f"{phi:.3f}") for i, mu, error, phi in points]
    tables = [
        Table("discs in plane shear", ("I = |Dev D| d sqrt(rho / p)", "mu = |Dev sigma| / p", "volume fraction"), sheared),
        Table("mu(I) = mu_s + (mu_2 - mu_s) I / (I_0 + I)", ("", "fitted"), fitted),
        Table("final heap", ("", "discs", "continuum", "deviation"), rows),
    ]  # fmt: skip
    notes = [
        f"The column: {column.length:g} m long, {column.height:.3f} m high, discs of {1e3 * column.diameter:.1f} mm.",
        "I has |Dev D|, half of du/dy in plane shear; data far below I_0 fix only the slope.",
    ]
    return Report(tables, notes, all_converged([grains, continuum, *shears]))


def _calibrate(workshop: Workshop) -> tuple[Vector, list[Finished]]:
    """Rows (I, mu, its standard error, volume fraction), and the runs."""
    numbers = QUICK_INERTIAL if workshop.quick else INERTIAL
    spent, averaged = QUICK_STRAIN if workshop.quick else STRAIN
    count, edge = (324, 24.0) if workshop.quick else (900, 40.0)
    jobs: list[Job] = []
    shares: list[float] = []
    for number in numbers:
        rate = 2.0 * number
        first, rest = max(spent / rate, TIMES[0]), max(averaged / rate, TIMES[1])
        end = first + rest
        shares.append(first / end)
        over = {
            "generators.disc.count": count, "generators.disc.upper": [edge, edge], "generators.disc.friction": FRICTION,
            "cell.size": [edge, edge], "cell.shear_rate": rate, "time.end": end, "time.frame_rate": SAMPLES / end,
            "time.step": end / SAMPLES,
        }  # fmt: skip
        jobs.append(Job(f"shear-{number:g}", "shear_cell", over))
    runs = workshop.run(jobs)
    points = [shear_point(run.observables, share) for run, share in zip(runs, shares, strict=True)]
    return np.array(points), runs


def shear_point(found: dict[str, Any], left_out: float) -> tuple[float, float, float, float]:
    """I, mu, standard error of mu, volume fraction of a run of `shear_cell`, its first share `left_out` left out."""
    first = max(1, int(left_out * len(found["time"])))
    normal, shear, pressure = (found[name][first:] for name in ("normal_stress", "shear_stress", "pressure"))
    other = 2.0 * pressure - normal
    stresses = np.stack([np.stack([other, -shear], axis=1), np.stack([-shear, normal], axis=1)], axis=1)
    mean = np.mean(stresses, axis=0)
    blocks = np.array([np.mean(part, axis=0) for part in np.array_split(stresses, BLOCKS)])
    error = float(np.std(effective_friction(blocks), ddof=1)) / math.sqrt(BLOCKS)
    # I is proportional to 1 / sqrt(p), and known at every p
    root = float(np.median(found["inertial_number"][first:] * np.sqrt(pressure)))
    number = root / math.sqrt(0.5 * float(np.trace(mean)))
    phi = float(np.mean(found["volume_fraction"][first:]))
    return number, float(effective_friction(mean[None])[0]), error, phi


def law_of(points: Vector) -> MuI:
    """The fit to rows (I, mu, error, ...). Where the data are nearly straight, I_0 is held: they fix the slope alone."""
    inertial, mu, errors = points[:, 0], points[:, 1], points[:, 2]
    law = fit_mu_i(inertial, mu, errors)
    held = MOST_I_0 * float(np.max(inertial))
    if held >= law.I_0:
        return law
    share = inertial / (held + inertial)
    matrix = np.stack([np.ones_like(share), share], axis=1) / errors[:, None]
    (mu_s, increment), *_ = np.linalg.lstsq(matrix, mu / errors)
    change = np.array([[1.0, 0.0], [1.0, 1.0], [0.0, 0.0]])
    return MuI(
        float(mu_s), float(mu_s + increment), held, change @ np.linalg.inv(matrix.T @ matrix) @ change.T
    )


def column_at_rest(run: Finished) -> Column:
    """The column before its gate rises; its volume fraction is that of the middle four fifths of its height."""
    frame = int(np.argmin(np.abs(run.results.times - GATE)))
    x, volumes = discs_of(run, frame)
    length = float(run.results.scene["observe"]["length"])
    top = float(np.quantile(x[:, 1], 0.98))
    inside = (x[:, 1] > 0.1 * top) & (x[:, 1] < 0.9 * top)
    phi = float(np.sum(volumes[inside])) / (0.8 * top * length)
    diameter = 2.0 * math.sqrt(float(np.mean(volumes)) / math.pi)
    return Column(phi, float(np.sum(volumes)) / (phi * length), diameter, length)


def discs_of(run: Finished, frame: int) -> tuple[Vector, Vector]:
    """Centres (n, 2) and areas (n,) of the free discs."""
    particles = run.results.particles(frame)
    free = particles["volumes"] > 0.0
    return particles["positions"][free].astype(np.float64), particles["volumes"][free]


def _continuum_job(workshop: Workshop, law: MuI, column: Column) -> Job:
    """A column of the same length, mass and packing, of the fitted law."""
    material = to_material(law, 2500.0, column.diameter, column.volume_fraction)
    edge = 1.5 * CELL if workshop.quick else CELL
    over: dict[str, Any] = {f"material.{name}": value for name, value in material.items()}
    over |= {
        "material.viscosity": 0.0, "box.size": list(BOX), "box.cells": [round(length / edge) for length in BOX],
        "column.length": column.length, "column.height": column.height, "time.end": 0.8, "time.frame_rate": 25.0,
        "time.step": 0.002, "particles.per_cell": 3, "walls.x_min": "slip",
    }  # fmt: skip
    return Job("continuum", "collapse_2d", over)


def surface_of(run: Finished, frame: int, column: Column) -> tuple[Vector, Vector]:
    """Abscissae and heights (n,) m of the free surface of either run, measured alike."""
    x, volumes = discs_of(run, frame)
    cells = [round(length / CELL) for length in BOX]
    found = free_surface(x, volumes, list(BOX), cells, column.volume_fraction)
    return found.x, found.height


def figures_of(run: Finished, column: Column) -> dict[str, float]:
    """Run-out of the bulk and height at the back, over those of the column, in the last frame."""
    x, volumes = discs_of(run, -1)
    order = np.argsort(x[:, 0])
    behind = np.cumsum(volumes[order])
    front = float(x[order[np.searchsorted(behind, BULK * behind[-1])], 0])
    height = float(np.mean(surface_of(run, -1, column)[1][1:4]))
    return {"run_out": front / column.length - 1.0, "height": height / column.height}


def _draw_law(workshop: Workshop, points: Vector, law: MuI) -> None:
    """The shear runs and the fit."""
    figure = new_figure(5.6, 3.8)
    axis = figure.subplots()
    axis.errorbar(
        points[:, 0], points[:, 1], yerr=points[:, 2], fmt="o", color="black", label="sheared discs"
    )
    line = np.geomspace(0.5 * np.min(points[:, 0]), 1.3 * np.max(points[:, 0]), 100)
    mu, error = law.friction(line), law.friction_error(line)
    axis.plot(line, mu, color="tab:red", label="fit")
    axis.fill_between(line, mu - error, mu + error, color="tab:red", alpha=0.2, linewidth=0.0)
    axis.set(xscale="log", xlabel="I = |Dev D| d sqrt(rho / p)", ylabel="mu = |Dev sigma| / p")
    axis.grid(alpha=0.3)
    axis.legend(fontsize=8)
    workshop.save("mu_of_i.png", figure)


def _draw_columns(workshop: Workshop, grains: Finished, continuum: Finished, column: Column) -> None:
    """The discs at the end with the free surfaces of both, and the column they began as."""
    from matplotlib.collections import EllipseCollection

    figure = new_figure(10.0, 3.6)
    axis = figure.subplots()
    right = column.length
    x, volumes = discs_of(grains, -1)
    size = 2.0 * np.sqrt(volumes / math.pi)
    axis.add_collection(
        EllipseCollection(
            size, size, np.zeros(len(x)), units="xy", offsets=x, offset_transform=axis.transData, facecolors="0.85",
            edgecolors="0.5", linewidths=0.3,
        )
    )  # fmt: skip
    axis.plot(
        [0.0, column.length, column.length], [column.height, column.height, 0.0], "--", color="black", linewidth=1.0,
        label="column at the start",
    )  # fmt: skip
    for run, colour, words in (
        (grains, "tab:blue", "discs"),
        (continuum, "tab:red", "continuum with their mu(I)"),
    ):
        abscissae, height = surface_of(run, -1, column)
        axis.plot(abscissae, height, color=colour, label=words)
        right = max(right, float(abscissae[np.flatnonzero(height)[-1]]))
    axis.set(
        xlim=(0.0, 1.08 * right), ylim=(0.0, 1.15 * column.height), aspect="equal", xlabel="x (m)",
        ylabel="height (m)",
    )  # fmt: skip
    axis.legend(fontsize=8)
    workshop.save("columns.png", figure)
