"""Why seed C replaced its strategy f1: stagnation, an endless loop, and f3, in the Couette flow (8.1; Fig. 31-34).

Modified Poliquen viscosity, from rest; f1, f2, f3 and the stress-velocity method on levels 2 and 3 with two regularisations.
Steps are whole, as in seed C.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from barchan.flows.quasi_newtonian import NonlinearOptions
from barchan.flows.quasi_newtonian.weights import FACTORS
from barchan.reproductions.couette_lines import couette_fluid
from barchan.reproductions.flow_solves import History, Wanted, solve_all
from barchan.reproductions.workshop import Report, Table, Workshop, new_figure

TITLE = "Stagnation, endless loop and success of adaptive strategies in the Couette flow (seed C, Fig. 31-34)"

LEVELS = (2, 3)
EPSILONS = ("1e-2", "1e-3")
METHODS = ("f1", "f2", "f3", "stress-velocity")
DELTA0 = 0.2
MOST, QUICK_MOST = 1500, 120
LONGEST_PERIOD, REPEATED = 12, 1e-6
"""A residual repeats when it comes back within REPEATED, over a whole period, at the end of an iteration."""
SLOW, LONG = 0.95, 100
"""An iteration stagnates where most of its more than LONG steps have Q_n above SLOW."""

SAID = {
    ("f1", 2, "1e-3"): "stagnates, 918 steps",
    ("f2", 3, "1e-2"): "loop of 3 steps",
    ("f3", 2, "1e-2"): "20 steps",
    ("f3", 3, "1e-2"): "21 steps",
    ("f3", 2, "1e-3"): "34 steps",
    ("f3", 3, "1e-3"): "32 steps",
}
"""Published: 8.1.1, 8.1.2 (with the eps of 6.2), Table 15 (there with multigrid; the start is not given)."""


def reproduce(workshop: Workshop) -> Report:
    """Every strategy on both levels with both regularisations; quickly with fewer steps at most."""
    keys = [(method, level, eps) for level in LEVELS for eps in EPSILONS for method in METHODS]
    most = QUICK_MOST if workshop.quick else MOST
    done = solve_all(workshop, [_wanted(*key, most) for key in keys])
    ours = {key: found[0] for key, found in zip(keys, done, strict=True)}
    rows = [
        (method, str(level), eps, SAID.get((method, level, eps), ""), outcome(history))
        for (method, level, eps), history in ours.items()
    ]
    table = Table("strategies from rest", ("strategy", "level", "eps", "published", "ours"), rows)
    _write(workshop, ours)
    _draw(workshop, ours)
    notes = [
        "Fig. 33-34 do not say which eps they are for; 8.1.2 refers to 6.2, where it is 0.01.",
        f"An iteration is stopped after {most} steps.",
    ]
    own = [history.converged for (method, _, _), history in ours.items() if method == "stress-velocity"]
    return Report([table], notes, all(own))


def _wanted(method: str, level: int, eps: str, most: int) -> Wanted:
    fluid = replace(couette_fluid(), eps=float(eps))
    given: dict[str, Any] = {"method": "stress-velocity"}
    if method != "stress-velocity":
        given = {"method": "adaptive-newton", "strategy": method, "delta0": DELTA0, "halvings": 0}
    options = NonlinearOptions(max_iterations=most, **given)
    return Wanted(f"{method}-level{level}-eps{eps}", "couette", level, (fluid,), options)


def outcome(history: History) -> str:
    """What became of an iteration: converged, in a loop, stagnating or none of these."""
    if history.converged:
        slow = history.iterations > LONG and float(np.median(history.changes)) > SLOW
        return f"stagnates, {history.iterations} steps" if slow else f"{history.iterations} steps"
    period = loop_length(history.residuals)
    if period is not None:
        return f"loop of {period} steps" if period > 1 else "stands still"
    last = history.changes[-20:]
    if last and min(last) > SLOW and max(last) < 1.0:
        return (
            f"stagnates: residual {history.residuals[-1]:.0e} after {history.iterations} steps, "
            f"Q in ({min(last):.3f}, {max(last):.3f})"
        )
    return f"no convergence in {history.iterations} steps: residual {history.residuals[-1]:.0e}"


def loop_length(residuals: list[float]) -> int | None:
    """Steps after which the last residuals repeat; None when they do not."""
    tail = np.array(residuals[-4 * LONGEST_PERIOD :])
    for period in range(1, LONGEST_PERIOD + 1):
        if len(tail) < 3 * period + 1:
            return None
        late, early = tail[-2 * period :], tail[-3 * period : -period]
        if np.all(np.abs(late - early) <= REPEATED * np.abs(early)):
            return period
    return None


def _write(workshop: Workshop, ours: dict[tuple[str, int, str], History]) -> None:
    rows = [
        (method, level, eps, step, norm, None if step == 0 else history.weights[step - 1])
        for (method, level, eps), history in ours.items()
        for step, norm in enumerate(history.residuals)
    ]
    workshop.write_csv("histories.csv", ("strategy", "level", "eps", "step", "residual", "delta"), rows)


def _draw(workshop: Workshop, ours: dict[tuple[str, int, str], History]) -> None:
    """Residuals, then Q_n, f(Q_n), delta_n of f1 on level 2 (Fig. 31-32) and of f2 on level 3 (Fig. 33-34)."""
    figure = new_figure(11.0, 7.5)
    top, bottom = figure.subplots(2, 2)
    for axis, (level, eps) in zip(top, ((2, "1e-3"), (3, "1e-2")), strict=True):
        for method in METHODS:
            history = ours[method, level, eps]
            axis.loglog(
                np.arange(1, len(history.residuals) + 1), history.residuals, label=method, linewidth=1.0
            )
        axis.set(xlabel="nonlinear iteration + 1", ylabel="residual", title=f"level {level}, eps = {eps}")
    for axis, (method, level, eps) in zip(bottom, (("f1", 2, "1e-3"), ("f2", 3, "1e-2")), strict=True):
        history = ours[method, level, eps]
        last = slice(max(0, history.iterations - 60), None)
        steps = np.arange(1, len(history.changes) + 1)[last]
        axis.plot(steps, history.changes[last], ".-", label="Q_n", linewidth=0.8)
        factors = [FACTORS[method](change) for change in history.changes[last]]
        axis.plot(steps, factors, ".-", label="f(Q_n)", linewidth=0.8)
        axis.plot(steps, history.weights[last], ".-", label="delta_n", linewidth=0.8)
        axis.set(xlabel="nonlinear iteration", title=f"{method}, level {level}, eps = {eps}: the last steps")
        axis.set_yscale("log")
    for axis in (*top, *bottom):
        axis.grid(alpha=0.3)
        axis.title.set_fontsize(9)
        axis.legend(fontsize=7)
    workshop.save("strategies.png", figure)
