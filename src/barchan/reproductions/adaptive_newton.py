"""Adaptive Newton method for a Bingham flow past a cylinder, phases 1-4 (seed C, 4.3: Tables 1-4, Fig. 10-14).

Level 2, eta0 = 1e-3, eps = 0.01 (1e-4 is added to |g|^2), from rest, until the Euclidean norm of the residual is below 1e-12.
Steps are whole as in seed C, but for two tables; in the last eps itself is added to |g|^2, as seed C writes for this flow.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from barchan.flows.quasi_newtonian import Bingham, NonlinearOptions
from barchan.reproductions.flow_solves import History, Wanted, agreement, beside, long_rows, solve_all
from barchan.reproductions.workshop import Report, Table, Workshop, new_figure, published

TITLE = "Adaptive Newton method for a Bingham fluid (seed C, Tables 1-4 and Fig. 10-14)"

LEVEL = 2
ETA, EPS = 1e-3, 1e-2
TAUS = ("0.001", "0.01", "0.1", "0.5", "1.0")
QUICK_TAUS = ("0.01", "0.5")
MOST = 400
"""Steps after which an iteration counts as oscillating; the longest published count of these tables is 241."""

PHASES = ("1", "2", "3", "4", "4 halved", "4 itself")
STRATEGY = {"1": "phase1", "2": "phase2", "3": "phase3", "4": "f1", "4 halved": "f1", "4 itself": "f1"}
WORDS = {
    "1": "Table 1, phase 1: steps with delta 0.5 + with delta 1, by the residual at the change",
    "2": "Table 2, phase 2: nonlinear iterations by delta_0",
    "3": "Table 3, phase 3: nonlinear iterations by delta_0",
    "4": "Table 4, phase 4 (f1): nonlinear iterations by delta_0",
    "4 halved": "Table 4, ours with steps that are halved where the residual grows (our default)",
    "4 itself": "Table 4, ours so and with eps itself added to |g|^2 (ERRATA 6)",
}

COMPARED_TAU, COMPARED_DELTA = 0.5, 0.2
COMPARED: dict[str, dict[str, Any]] = {
    "fixed point": {"method": "fixed-point", "max_iterations": 2000},
    "phase 2": {"method": "adaptive-newton", "strategy": "phase2-slow"},
    "phase 3": {"method": "adaptive-newton", "strategy": "phase3"},
    "phase 4": {"method": "adaptive-newton", "strategy": "f1"},
    "stress-velocity": {"method": "stress-velocity"},
}
"""The iterations of Fig. 11 and ours."""


def reproduce(workshop: Workshop) -> Report:
    """Every entry of the four tables; quickly two yield stresses, every third row and no fixed point."""
    taus = QUICK_TAUS if workshop.quick else TAUS
    theirs = {phase: _rows(phase, workshop.quick) for phase in PHASES}
    keys = [(phase, row, tau) for phase in PHASES for row in theirs[phase] for tau in taus]
    counted = solve_all(workshop, [_entry(*key) for key in keys])
    ours = {key: histories[0] for key, histories in zip(keys, counted, strict=True)}
    own = dict(zip(taus, solve_all(workshop, [_default(tau) for tau in taus]), strict=True))
    names = [name for name in COMPARED if name != "fixed point" or not workshop.quick]
    lines = solve_all(workshop, [_compared(name) for name in names])
    compared = {name: histories[0] for name, histories in zip(names, lines, strict=True)}
    tables = [_table(phase, theirs[phase], taus, ours) for phase in PHASES]
    tables.append(_default_table({tau: histories[0] for tau, histories in own.items()}))
    tables.append(_compared_table(compared))
    found = {key: (theirs[key[0]][key[1]][f"tau0={key[2]}"], history) for key, history in ours.items()}
    columns = ("phase", "row", "tau0", "published", "ours", "converged", "residual")
    workshop.write_csv("counts.csv", columns, long_rows(found))
    _write_histories(workshop, compared)
    _draw(workshop, compared)
    notes = [
        f"Phase {phase}: {agreement(pair for key, pair in found.items() if key[0] == phase)}"
        for phase in PHASES
    ]
    done = all(history.converged for key, history in ours.items() if key[0] in ("4 halved", "4 itself"))
    return Report(tables, notes, done and all(histories[0].converged for histories in own.values()))


def _rows(phase: str, quick: bool) -> dict[str, dict[str, str]]:
    """Published rows by delta_0 or radius."""
    if phase.startswith("4"):
        rows = {row["delta0"]: row for row in published("adaptive_newton")}
    else:
        rows = {row["row"]: row for row in published("adaptive_phases") if row["phase"] == phase}
    return dict(list(rows.items())[1::3]) if quick else rows


def _options(**given: Any) -> NonlinearOptions:
    return NonlinearOptions(**{"tolerance": 1e-12, "relative": False, "max_iterations": MOST, **given})


def _entry(phase: str, row: str, tau: str) -> Wanted:
    given = {"delta0": 0.5, "radius": float(row)} if phase == "1" else {"delta0": float(row)}
    halvings = None if phase in ("4 halved", "4 itself") else 0
    options = _options(method="adaptive-newton", strategy=STRATEGY[phase], halvings=halvings, **given)
    eps = EPS**0.5 if phase == "4 itself" else EPS
    return _wanted(f"phase{phase.replace(' ', '-')}-{row}-tau{tau}", float(tau), options, eps)


def _default(tau: str) -> Wanted:
    return _wanted(f"stress-velocity-tau{tau}", float(tau), _options(method="stress-velocity"))


def _compared(name: str) -> Wanted:
    options = _options(delta0=COMPARED_DELTA, halvings=0, **COMPARED[name])
    return _wanted(name.replace(" ", "-"), COMPARED_TAU, options)


def _wanted(label: str, tau: float, options: NonlinearOptions, eps: float = EPS) -> Wanted:
    return Wanted(label, "cylinder_dfg", LEVEL, (Bingham(ETA, tau, eps),), options)


def _table(
    phase: str,
    theirs: dict[str, dict[str, str]],
    taus: tuple[str, ...],
    ours: dict[tuple[str, str, str], History],
) -> Table:
    def entry(row: str, tau: str) -> str:
        history = ours[phase, row, tau]
        if phase != "1" or not history.converged:
            return history.count
        late = sum(weight == 1.0 for weight in history.weights)
        return f"{history.iterations - late}+{late}"

    rows = [
        (row, [entries[f"tau0={tau}"] for tau in taus], [entry(row, tau) for tau in taus])
        for row, entries in theirs.items()
    ]
    corner = "radius" if phase == "1" else "delta_0"
    return beside(WORDS[phase], corner, [f"tau_0 = {tau}" for tau in taus], rows)


def _default_table(own: dict[str, History]) -> Table:
    """The method without parameters, where seed C chooses delta_0."""
    best = published("adaptive_newton")
    rows = [
        ("fewest of Table 4", *(str(min(int(row[f"tau0={tau}"]) for row in best)) for tau in own)),
        ("stress-velocity, ours", *(history.count for history in own.values())),
    ]
    return Table(
        "nonlinear iterations without a delta_0", ("method", *(f"tau_0 = {tau}" for tau in own)), rows
    )


def _compared_table(compared: dict[str, History]) -> Table:
    theirs = {row["method"]: row["iterations"] for row in published("adaptive_histories")}
    rows = [(name, theirs.get(name, ""), history.count) for name, history in compared.items()]
    title = f"Fig. 11: iterations at tau_0 = {COMPARED_TAU:g}, delta_0 = {COMPARED_DELTA:g}"
    return Table(title, ("method", "published", "ours"), rows)


def _write_histories(workshop: Workshop, compared: dict[str, History]) -> None:
    rows: list[tuple[Any, ...]] = []
    for name, history in compared.items():
        for step, norm in enumerate(history.residuals):
            change = history.changes[step - 1] if step else None
            delta = history.weights[step - 1] if step else None
            rows.append((name, step, norm, change, delta))
    workshop.write_csv("histories.csv", ("method", "step", "residual", "Q", "delta"), rows)


def _draw(workshop: Workshop, compared: dict[str, History]) -> None:
    """Residuals of all methods (Fig. 10-11); residual, Q_n and delta_n of the three phases (Fig. 12-14)."""
    figure = new_figure(11.0, 4.2)
    linear, logarithmic = figure.subplots(1, 2)
    for name, history in compared.items():
        logarithmic.loglog(
            np.arange(1, len(history.residuals) + 1), history.residuals, label=name, linewidth=1.2
        )
        if name != "fixed point":
            linear.semilogy(history.residuals, ".-", label=name, linewidth=1.0)
    linear.set(xlabel="nonlinear iteration", ylabel="residual")
    logarithmic.set(xlabel="nonlinear iteration + 1", ylabel="residual")
    for axis in (linear, logarithmic):
        axis.grid(alpha=0.3)
        axis.legend(fontsize=7)
    figure.suptitle(f"Bingham, tau_0 = {COMPARED_TAU:g}, level {LEVEL}, from rest", fontsize=9)
    workshop.save("residuals.png", figure)
    figure = new_figure(11.0, 8.0)
    for column, name in zip(
        figure.subplots(3, 3, sharex="col").T, ("phase 2", "phase 3", "phase 4"), strict=True
    ):
        history = compared[name]
        steps = np.arange(1, history.iterations + 1)
        column[0].semilogy(history.residuals, ".-", color="C0")
        column[1].semilogy(steps[: len(history.changes)], history.changes, ".-", color="C1")
        column[1].axhline(1.0, color="0.6", linewidth=0.8)
        column[2].plot(steps, history.weights, ".-", color="C2")
        column[0].set_title(name, fontsize=9)
        column[2].set_xlabel("nonlinear iteration")
        for axis, words in zip(column, ("residual", "Q_n", "delta_n"), strict=True):
            axis.set_ylabel(words)
            axis.grid(alpha=0.3)
    workshop.save("phases.png", figure)
