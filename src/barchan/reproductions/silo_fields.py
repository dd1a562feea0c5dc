"""Velocity, pressure and stress in the silo with and without inertia, mu = 0.3, Re = 100, Bi = 0 (seed A, Fig. 11-13)."""

from __future__ import annotations

import numpy as np

from barchan.reproductions.workshop import Finished, Job, Report, Table, Workshop, all_converged

TITLE = "Fields in the silo with and without inertia (seed A, Fig. 11-13)"

CASE = {"mu": 0.3, "reynolds": 100.0, "bingham": 0.0, "outlet": 1.0, "below": 0.5, "tolerance": 1e-4}
REGIMES = ("creeping", "inertial")


def reproduce(workshop: Workshop) -> Report:
    """One run of each regime on the same mesh, and what Fig. 12 shows of their pressures on the bottom."""
    vertices = 500 if workshop.quick else 1500
    runs = workshop.run(
        [Job(regime, "silo", {**CASE, "regime": regime, "vertices": vertices}) for regime in REGIMES]
    )
    _draw(workshop, runs)
    rows, profiles = [], []
    for regime, run in zip(REGIMES, runs, strict=True):
        x, pressure = _bottom(run)
        peak = int(np.argmax(pressure))
        profiles += [(regime, a, b) for a, b in zip(x, pressure, strict=True)]
        rows.append((
            regime, f"{run.summary['discharge']:.4g}", f"{run.summary['max_speed']:.4g}", f"{pressure[peak]:.3g}",
            f"{x[peak] - 0.5 * CASE['outlet']:.3g}", f"{run.summary['max_pressure']:.3g}",
        ))  # fmt: skip
    workshop.write_csv("bottom_pressure.csv", ("regime", "x", "pressure"), profiles)
    columns = (
        "regime", "discharge", "greatest speed", "greatest pressure on the bottom", "its distance to the outlet",
        "greatest pressure anywhere",
    )  # fmt: skip
    notes = [
        "Seed A prints no numbers. Creeping: a very high pressure right at the edge of the outlet; inertial: the zone of "
        "high pressure on the bottom begins at some distance from it and is wider.",
    ]
    return Report([Table("pressures on the bottom", columns, rows)], notes, all_converged(runs))


def _bottom(run: Finished) -> tuple[np.ndarray, np.ndarray]:
    """Abscissae and pressures at the vertices of the bottom, from the outlet to the wall."""
    mesh, fields = run.results.mesh, run.results.fields(-1)
    vertices = np.unique(mesh["part:bottom"])
    order = vertices[np.argsort(mesh["positions"][vertices, 0])]
    return mesh["positions"][order, 0], fields["pressures"][order]


def _draw(workshop: Workshop, runs: list[Finished]) -> None:
    from barchan.results.fields import DIMENSIONLESS, Panel, draw_panels
    from barchan.results.stored_meshes import mesh_from

    for regime, run in zip(REGIMES, runs, strict=True):
        fields = run.results.fields(-1)
        stresses = fields["stresses"]
        panels = [
            Panel(-fields["velocities"][:, 1], "downward velocity / U", "axial velocity (Fig. 11)"),
            Panel(
                fields["pressures"],
                DIMENSIONLESS["pressure"],
                "pressure (Fig. 12)",
                "magma",
                clip=0.005,
                lines=12,
            ),
            # chi: the first tangential coordinate is (lambda_xx - lambda_yy) / 2, the second lambda_xy.
            Panel(stresses[:, 1], "(p_xx - p_yy) / 2P", "normal deviator (Fig. 13)", "coolwarm", clip=0.005),
            Panel(stresses[:, 2], "p_xy / P", "tangential deviator (Fig. 13)", "coolwarm", clip=0.005),
        ]
        draw_panels(
            workshop.out / f"{regime}.png", mesh_from(run.results.mesh), panels, title=f"{regime} flow",
            columns=4, units=DIMENSIONLESS,
        )  # fmt: skip
