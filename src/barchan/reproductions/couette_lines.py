"""Cut lines of the Couette flow of seed C (6.4) by level and regularisation: runs, distances xi, pictures.

Between (0.019, 0) and (0.024, 0): speed |u|, shear rate |g|, viscosity eta.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from barchan import scenes
from barchan.flows.quasi_newtonian.observables import xi
from barchan.reproductions.workshop import Finished, Job, new_figure

QUANTITIES = {"u": "speed", "shear_rate": "shear_rate", "viscosity": "viscosity"}
"""Names in the published tables and in the observables of the scene."""
SYMBOLS = {"u": "|u| (m/s)", "shear_rate": "|g| (1/s)", "viscosity": "eta / rho (m^2/s)"}


def couette_job(level: int, eps: float) -> Job:
    """The flow on a level with a regularisation, by the default method from coarser levels."""
    return Job(f"level{level}-eps{eps:g}", "couette", {"level": level, "eps": eps, "start": "nested"})


@lru_cache(maxsize=1)
def couette_fluid() -> Any:
    """The fluid of the scene."""
    model: Any = scenes.load("couette", level=1).model()
    return model.flow.model


def distance(first: Finished, second: Finished, quantity: str) -> float:
    """xi_ij in percent between the lines i of `first` and j of `second`."""
    name = f"cut_{QUANTITIES[quantity]}"
    return xi(
        first.observables["cut_r"],
        first.observables[name],
        second.observables[name],
        second.observables["cut_r"],
    )


def distance_to_exact(run: Finished, quantity: str) -> float:
    """xi in percent between the exact line and that of a run."""
    name, lines = QUANTITIES[quantity], run.observables
    return xi(lines["cut_r"], lines[f"exact_{name}"], lines[f"cut_{name}"])


def figures(value: float) -> str:
    """A percentage with two or three digits, as the tables have them."""
    return f"{value:.3g}" if value < 0.1 else f"{value:.2f}"


def draw_lines(runs: Mapping[str, Finished], exact: Sequence[tuple[str, Finished]]) -> Any:
    """The three quantities along the cut, evenly (left) and by order of magnitude (right).

    runs : by label.  exact : (label, run whose exact lines are drawn too).
    """
    figure = new_figure(11.0, 10.0)
    for pair, (quantity, name) in zip(figure.subplots(3, 2), QUANTITIES.items(), strict=True):
        for axis in pair:
            for label, run in runs.items():
                r = 1e3 * run.observables["cut_r"]
                axis.plot(r, run.observables[f"cut_{name}"], label=label, linewidth=1.0)
            for label, run in exact:
                r = 1e3 * run.observables["cut_r"]
                axis.plot(r, run.observables[f"exact_{name}"], "k:", label=label, linewidth=0.8)
            axis.set(xlabel="r (mm)", ylabel=SYMBOLS[quantity])
            axis.grid(alpha=0.3)
        pair[1].set_yscale("log")
        pair[1].set_ylim(bottom=_least(runs, name))
        pair[0].legend(fontsize=7)
    return figure


def _least(runs: Mapping[str, Finished], name: str) -> float:
    """Where a logarithmic axis ends: below the least value but the zero at the wall."""
    inside = [run.observables[f"cut_{name}"][:-1] for run in runs.values()]
    return 0.5 * float(min(np.min(line[line > 0.0]) for line in inside))
