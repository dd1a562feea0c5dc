"""The Bingham cavity with a regularised viscosity (seed C, Eq. 3.5) and without any regularisation (seeds A and B chapter 6).

Velocities come to each other as eps -> 0 until the meshes differ; the yield surface does not: |sigma| = sqrt(2) tau0 of the
regularised stress is the line |g|^3 = eps^2 tau0 / (2 sqrt(2) eta) of the shear rate, whatever the rigid zones are.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np

from barchan.reproductions.workshop import Finished, Job, Report, Table, Workshop, all_converged, new_figure

Cases: TypeAlias = dict[tuple[float, int], Finished]
"""Nonsmooth runs by Bingham number and cells."""
Regularised: TypeAlias = dict[tuple[float, int, float], Finished]
"""Regularised runs by Bingham number, cells and eps."""

TITLE = "Bingham cavity with and without regularisation: profiles, yield surfaces (vortex: Vola et al. 2003, Fig. 2a)"

BINGHAM = (2.0, 5.0, 20.0)
CELLS, QUICK_CELLS = (32, 64), (8, 16)
EPS = (1e-1, 1e-2, 1e-3, 1e-4)
SHOWN = (2.0, 20.0)
"""Bingham numbers of the picture of yield surfaces."""
DRAWN = (1e-2, 1e-4)
"""eps of the picture of yield surfaces."""
SHARES = (0.99, 1.0, 1.01)
"""|sigma| / (sqrt(2) tau0) of the lines that are drawn for the regularised stress."""
LINE_COLOURS = ("tab:orange", "tab:red", "tab:pink")
EXACT = 1e-7
"""Tolerance of the nonsmooth runs; it leaves shear rates of 1e-6 to 1e-4 V / L in their rigid zones."""
RIGID_RATE = 1e-5
"""Shear rate L / V, du/dy in simple shear, below which matter counts as rigid: a tenth of the smallest eps."""
ROUNDING = 1e-5
"""Share of the yield stress that is forgiven where both are equal but for the last digits."""
VORTEX = {2.0: 0.078, 5.0: 0.063, 20.0: 0.040}
"""Bi -> greatest |psi| / (V L) on the curve of Vola et al., J. Comput. Phys. 2003 (doi 10.1016/S0021-9991(03)00118-9), Fig. 2a,
whose yield stresses are lengths sqrt(2) tau0; by points that the Basilisk wiki has read off it (vola2003-2a), to 0.001."""
LINES = (("centreline_y", "centreline_ux"), ("centreline_x", "centreline_uy"))


def reproduce(workshop: Workshop) -> Report:
    """Centre lines, vortices and unyielded areas for several eps beside those without regularisation, on two meshes."""
    meshes, eps = (QUICK_CELLS, EPS[::2]) if workshop.quick else (CELLS, EPS)
    numbers = SHOWN if workshop.quick else BINGHAM
    nonsmooth_cases = [(bi, n) for bi in numbers for n in meshes]
    regularised_cases = [(bi, n, e) for bi in numbers for n in meshes for e in eps]
    jobs = [
        Job(f"nonsmooth-{bi:g}-{n}", "cavity_bingham", {"bingham": bi, "cells": n, "tolerance": EXACT})
        for bi, n in nonsmooth_cases
    ]
    jobs += [
        Job(f"regularised-{bi:g}-{n}-{e:g}", "cavity", {"bingham": bi, "cells": n, "eps": e})
        for bi, n, e in regularised_cases
    ]
    runs = workshop.run(jobs)
    nonsmooth = dict(zip(nonsmooth_cases, runs, strict=False))
    regularised = dict(zip(regularised_cases, runs[len(nonsmooth) :], strict=True))
    _write(workshop, nonsmooth, regularised)
    _draw_profiles(workshop, nonsmooth, regularised, eps)
    _draw_yield_surfaces(
        workshop, nonsmooth, regularised, meshes[-1], (eps[-2], eps[-1]) if workshop.quick else DRAWN
    )
    tables = [_difference_table(bi, nonsmooth, regularised, meshes, eps) for bi in numbers]
    tables += [
        _area_table(numbers, nonsmooth, regularised, meshes[-1], eps),
        _vortex_table(numbers, nonsmooth, regularised, meshes[-1], eps[-1]),
    ]
    notes = [
        "Both fluids are the same: sqrt(2) tau0 is the length of the deviatoric stress at yield, |g| that of D(u).",
        "The regularised stress reaches the yield stress where |g| = (eps^2 Bi / (2 sqrt(2)))^(1/3) V / L: a line that moves "
        "with eps, and that leaves the yield surface once the mesh no longer resolves this rate.",
        "Only without regularisation do zones without any shear exist; what is left there is the tolerance of the solver.",
    ]
    return Report(tables, notes, all_converged(runs))


def yield_rate(bingham: float, eps: float) -> float:
    """|g| L / V at which the regularised stress 2 |g| + sqrt(2) Bi |g| / sqrt(|g|^2 + eps^2) has the length sqrt(2) Bi.

    With |g| >> eps the second term lacks sqrt(2) Bi eps^2 / (2 |g|^2), which the first one makes up for.
    """
    return float((bingham * eps**2 / (2.0 * np.sqrt(2.0))) ** (1.0 / 3.0))


def stress_share(shear_rate: np.ndarray, bingham: float, eps: float) -> np.ndarray:
    """|sigma| / (sqrt(2) tau0) of the regularised fluid at shear rates |g| L / V of any shape."""
    return np.asarray(np.sqrt(2.0) * shear_rate / bingham + shear_rate / np.sqrt(shear_rate**2 + eps**2))


def profile_differences(first: Finished, second: Finished) -> tuple[float, float]:
    """Greatest differences of u_x on x = 1/2 and of u_y on y = 1/2 over the speed of the lid, at the points of `first`."""
    found = []
    for along, component in LINES:
        place = first.observables[along]
        other = np.interp(place, second.observables[along], second.observables[component])
        found.append(float(np.abs(first.observables[component] - other).max()))
    return found[0], found[1]


def _vortex_distance(first: Finished, second: Finished) -> float:
    """Distance of the centres of two vortices over the side of the cavity."""
    a, b = (np.array([run.summary["vortex_x"], run.summary["vortex_y"]]) for run in (first, second))
    return float(np.linalg.norm(a - b))


def _difference_table(
    bi: float, nonsmooth: Cases, regularised: Regularised, meshes: Sequence[int], eps: Sequence[float]
) -> Table:
    def figures(first: Finished, second: Finished) -> list[str]:
        values = (*profile_differences(first, second), _vortex_distance(first, second))
        return [f"{value:.1e}" for value in values]

    rows = []
    for e in eps:
        pairs = [(nonsmooth[bi, n], regularised[bi, n, e]) for n in meshes]
        rows.append((f"eps = {e:g}", *(text for pair in pairs for text in figures(*pair))))
    coarse, fine = meshes
    meshes_apart = figures(nonsmooth[bi, coarse], nonsmooth[bi, fine])
    rows.append((f"nonsmooth, {coarse} against {fine} cells", *meshes_apart, *[""] * len(meshes_apart)))
    columns = [
        f"{what}, {n} cells" for n in meshes for what in ("u_x on x = 1/2", "u_y on y = 1/2", "vortex centre")
    ]
    return Table(f"Bi = {bi:g}: distance from the nonsmooth solution", ("", *columns), rows)


def _area_table(
    numbers: Sequence[float], nonsmooth: Cases, regularised: Regularised, cells: int, eps: Sequence[float]
) -> Table:
    rows = []
    for bi in numbers:
        run = nonsmooth[bi, cells]
        fields = run.results.fields(-1)
        # Where matter flows, its viscous stress 2 |D| is parallel to the contact stress and adds to it.
        rate = 2.0 * fields["shear_rates"]
        areas = _areas(run, (fields["shear_stresses"] + rate) / bi, rate)
        rows.append((f"{bi:g}", "nonsmooth", "0", *areas))
        for e in eps:
            run = regularised[bi, cells, e]
            g = run.results.fields(-1)["shear_rates"]
            areas = _areas(run, stress_share(g, bi, e), np.sqrt(2.0) * g)
            rows.append((f"{bi:g}", f"eps = {e:g}", f"{np.sqrt(2.0) * yield_rate(bi, e):.1e}", *areas))
    columns = (
        "Bi", "", "shear rate at the yield stress", *(f"stress <= {share:g} yield" for share in SHARES),
        f"rate <= {RIGID_RATE:g}", f"rate <= {10.0 * RIGID_RATE:g}",
    )  # fmt: skip
    return Table(f"areas over that of the cavity, shear rates over V / L, {cells} cells", columns, rows)


def _areas(run: Finished, share: np.ndarray, rate: np.ndarray) -> list[str]:
    """Areas where a share of the yield stress is below each of `SHARES` and where nothing is sheared.

    share, rate : (vertices,) of the stored mesh.
    """
    mesh = _triangles(run)
    corners = np.stack([mesh.x, mesh.y], axis=1)[mesh.triangles]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    third = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 6.0
    weights = np.bincount(mesh.triangles.ravel(), np.repeat(third, 3), minlength=len(mesh.x))
    below = [share <= bound * (1.0 + ROUNDING) for bound in SHARES]
    still = [rate <= bound for bound in (RIGID_RATE, 10.0 * RIGID_RATE)]
    return [f"{weights[mask].sum():.3f}" for mask in (*below, *still)]


def _vortex_table(
    numbers: Sequence[float], nonsmooth: Cases, regularised: Regularised, cells: int, eps: float
) -> Table:
    rows = []
    for bi in numbers:
        pair = nonsmooth[bi, cells].summary, regularised[bi, cells, eps].summary
        centres = [f"({s['vortex_x']:.4f}, {s['vortex_y']:.4f})" for s in pair]
        strengths = [f"{abs(s['vortex_strength']):.5f}" for s in pair]
        rows.append((f"{bi:g}", f"{VORTEX[bi]:.3f}", *strengths, *centres))
    columns = (
        "Bi", "strength psi / (V L), Vola et al. 2003, Fig. 2a", "nonsmooth", f"regularised, eps = {eps:g}",
        "centre, nonsmooth", f"centre, eps = {eps:g}",
    )  # fmt: skip
    return Table(f"vortex, {cells} cells", columns, rows)


def _write(workshop: Workshop, nonsmooth: Cases, regularised: Regularised) -> None:
    keys = ("vortex_x", "vortex_y", "vortex_strength", "plug_area", "centreline_min", "centreline_min_y")
    rows: list[tuple[Any, ...]] = [
        (*case, 0.0, 0.0, 0.0, *(run.summary[key] for key in keys)) for case, run in nonsmooth.items()
    ]
    for (bi, n, e), run in regularised.items():
        apart = profile_differences(nonsmooth[bi, n], run)
        rows.append((bi, n, e, *apart, *(run.summary[key] for key in keys)))
    columns = ("bingham", "cells", "eps", "difference_ux", "difference_uy", *keys)
    workshop.write_csv("cavity.csv", columns, rows)


def _draw_profiles(
    workshop: Workshop, nonsmooth: Cases, regularised: Regularised, eps: Sequence[float]
) -> None:
    """Left u_x on x = 1/2 of all fluids on the finest mesh, right how far they are from the nonsmooth ones."""
    numbers, meshes = (sorted({case[k] for case in nonsmooth}) for k in (0, 1))
    figure = new_figure(10.5, 4.4)
    profile, apart = figure.subplots(1, 2)
    for number, bi in enumerate(numbers):
        colour = f"C{number}"
        fine = nonsmooth[bi, int(meshes[-1])].observables
        profile.plot(fine["centreline_ux"], fine["centreline_y"], color=colour, label=f"Bi = {bi:g}")
        for e, style in ((eps[0], ":"), (eps[-1], "--")):
            other = regularised[bi, int(meshes[-1]), e].observables
            dark = {"color": "black", "linewidth": 0.8, "linestyle": style}
            words = f"eps = {e:g}" if number == 0 else None
            profile.plot(other["centreline_ux"], other["centreline_y"], label=words, **dark)
        for n, style in zip(meshes, ("o--", "s-"), strict=True):
            found = [max(profile_differences(nonsmooth[bi, int(n)], regularised[bi, int(n), e])) for e in eps]
            apart.loglog(eps, found, style, color=colour, markersize=4, label=f"Bi = {bi:g}, {n:g} cells")
    profile.set(xlabel="u_x / V on x = L/2", ylabel="y / L", title="colours: nonsmooth; black: regularised")
    apart.set(
        xlabel="eps L / V",
        ylabel="greatest difference of a centre line / V",
        title="regularised to nonsmooth",
    )
    for axis in (profile, apart):
        axis.grid(alpha=0.3, which="major")
        axis.legend(fontsize=7)
    workshop.save("profiles.png", figure)


def _draw_yield_surfaces(
    workshop: Workshop, nonsmooth: Cases, regularised: Regularised, cells: int, drawn: Sequence[float]
) -> None:
    """Shear rates by order of magnitude; left nonsmooth with its rigid zones hatched, then regularised with its level lines."""
    from matplotlib.colors import LogNorm
    from matplotlib.lines import Line2D

    figure = new_figure(3.6 * (1 + len(drawn)) + 1.0, 3.7 * len(SHOWN))
    rows = figure.subplots(len(SHOWN), 1 + len(drawn), sharex=True, sharey=True, squeeze=False)
    norm, colours = LogNorm(1e-5, 1e1), None
    for bi, axes in zip(SHOWN, rows, strict=True):
        run = nonsmooth[bi, cells]
        mesh, fields = _triangles(run), run.results.fields(-1)
        # Half of du/dy in simple shear there, du/dy / sqrt(2) in the regularised runs.
        colours = _shade(axes[0], mesh, 2.0 * fields["shear_rates"], norm)
        decade = np.log10(np.maximum(2.0 * fields["shear_rates"], 1e-3 * RIGID_RATE))
        still = np.log10(RIGID_RATE)
        hatched = axes[0].tricontourf(
            mesh, decade, levels=[still - 4.0, still], colors="none", hatches=["////"]
        )
        hatched.set(edgecolor="tab:cyan", linewidth=0.0)
        axes[0].set_title(f"Bi = {bi:g}, no regularisation", fontsize=9, loc="left")
        for e, axis in zip(drawn, axes[1:], strict=True):
            other = regularised[bi, cells, e]
            grid, rates = _triangles(other), other.results.fields(-1)["shear_rates"]
            _shade(axis, grid, np.sqrt(2.0) * rates, norm)
            axis.tricontour(
                mesh, decade, levels=[still], colors="tab:cyan", linestyles="solid", linewidths=1.2
            )
            axis.tricontour(
                grid, stress_share(rates, bi, e), levels=list(SHARES),
                colors=LINE_COLOURS, linewidths=1.0,
            )  # fmt: skip
            axis.set_title(f"Bi = {bi:g}, eps = {e:g}", fontsize=9, loc="left")
        for axis in axes:
            axis.set(aspect="equal", xlim=(0.0, 1.0), ylim=(0.0, 1.0))
        axes[0].set_ylabel("y / L")
    for axis in rows[-1]:
        axis.set_xlabel("x / L")
    figure.colorbar(
        colours, ax=rows, label="shear rate L / V (du/dy in simple shear)", extend="both", shrink=0.7
    )
    words = [
        "rigid without regularisation (shear rate 0)",
        *(f"|sigma| = {share:g} sqrt(2) tau0" for share in SHARES),
    ]
    handles = [Line2D([], [], color=colour) for colour in ("tab:cyan", *LINE_COLOURS)]
    figure.legend(handles, words, loc="outside lower center", ncols=len(words), fontsize=9)
    workshop.save("yield_surfaces.png", figure)


def _triangles(run: Finished) -> Any:
    """The stored mesh of a run, quadrilaterals cut in two, as matplotlib draws it."""
    from matplotlib.tri import Triangulation

    from barchan.results.stored_meshes import mesh_from

    mesh = mesh_from(run.results.mesh)
    cells = mesh.t.T
    if cells.shape[1] == 4:
        cells = np.concatenate([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]])
    return Triangulation(mesh.p[0], mesh.p[1], cells)


def _shade(axis: Any, mesh: Any, rate: np.ndarray, norm: Any) -> Any:
    """Colours of a shear rate; what is below the bar has its lowest colour."""
    return axis.tripcolor(mesh, np.maximum(rate, norm.vmin), shading="gouraud", cmap="bone", norm=norm)
