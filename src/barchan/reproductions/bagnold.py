"""Bagnold's profile on an inclined plane, mu = 0.5 and tan a = 1.1 mu (seed A, Fig. 7)."""

from __future__ import annotations

from barchan.reproductions.workshop import Job, Report, Table, Workshop, all_converged, new_figure

TITLE = "Bagnold's avalanche: velocity and shear-rate profiles (seed A, Fig. 7)"


def reproduce(workshop: Workshop) -> Report:
    """Profiles on meshes of 8, 16 and 32 cells across; quickly on 8 alone."""
    counts = (8,) if workshop.quick else (8, 16, 32)
    runs = workshop.run([Job(f"cells-{n}", "bagnold", {"cells": n}) for n in counts])
    rows = []
    for n, run in zip(counts, runs, strict=True):
        s = run.summary
        rows.append((
            f"{n}", f"{s['surface_velocity_exact']:.6g}", f"{s['surface_velocity']:.6g}",
            f"{100.0 * s['velocity_error']:.3g} %", f"{100.0 * s['shear_rate_error']:.3g} %",
        ))  # fmt: skip
    columns = ("cells", "surface velocity, exact", "ours", "largest error, of the peak", "of the shear rate")
    finest = runs[-1].observables
    names = ("profile_y", "profile_ux", "profile_exact", "profile_shear_rate", "profile_shear_rate_exact")
    workshop.write_csv("profiles.csv", names, list(zip(*(finest[name] for name in names), strict=True)))
    figure = new_figure(8.0, 4.0)
    pairs = (("profile_ux", "profile_exact"), ("profile_shear_rate", "profile_shear_rate_exact"))
    labels = ("velocity / sqrt(g H)", "shear rate sqrt(H / g)")
    for axis, (ours, exact), label in zip(figure.subplots(1, 2), pairs, labels, strict=True):
        axis.plot(finest[exact], finest["profile_y"], color="black", linewidth=1.0, label="exact")
        axis.plot(finest[ours][::4], finest["profile_y"][::4], "o", markersize=3, label="ours")
        axis.set(xlabel=label, ylabel="y / H")
        axis.legend(fontsize=8)
    workshop.save("bagnold.png", figure)
    table = Table("the layer in motion, P2-P1d", columns, rows)
    return Report(
        [table], ["Seed A prints no numbers: its marks lie on the exact lines."], all_converged(runs)
    )
