"""Figures of granular runs that several kinds of scenes give: run-out, rest, energies, the solver's record.

The run-out is (L - L0)/L0 and the height ratio H/H0. L is taken twice: from the farthest particle (`front`,
the definition of seed B 7.2.3: "the maximum abscissa reached by the grains") and from the abscissa behind which lie
99.5 % of the volume (`front_bulk`), which a few grains rolling ahead cannot move.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.scenes.granular.surface import Surface

Vector = NDArray[np.float64]

REST_SPEED = 1e-4  # of sqrt(g H0)
REST_SHARE = 0.1  # of the run, at its end, over which the material must stay at rest
_BULK_SHARE = 0.995


@dataclass(frozen=True)
class ColumnReference:
    """The initial column that run-outs are relative to: length L0 and height H0 (m), abscissa of its back (m)."""

    length: float
    height: float
    back: float = 0.0


def run_out_observables(
    column: ColumnReference, surface: Surface, positions: Vector, volumes: Vector, thinnest: float
) -> dict[str, float]:
    """Front, run-out, height and slope of particles at `positions` (P, d) m with `volumes` (P,) m^d, under `surface`.

    Lengths in metres, slopes in degrees, only where matter is thicker than `thinnest` (m).
    """
    x = positions[:, 0]
    order = np.argsort(x, kind="stable")
    behind = np.cumsum(volumes[order])
    bulk = float(x[order[np.searchsorted(behind, _BULK_SHARE * behind[-1])]])
    height = float(surface.height.max())
    return {
        "front": float(x.max()),
        "front_bulk": bulk,
        "run_out": (float(x.max()) - column.back - column.length) / column.length,
        "run_out_bulk": (bulk - column.back - column.length) / column.length,
        "height": height,
        "height_back": float(surface.height[0]),
        "top": float(positions[:, -1].max()),
        "height_ratio": height / column.height,
        "slope_steepest": surface.steepest_slope(thinnest),
        "slope_mean": surface.mean_slope(),
    }


def rest_figures(steps: Mapping[str, NDArray[Any]], speed: float) -> dict[str, Any]:
    """Whether the material ends at rest, and from which time on (s); `speed` (m/s) is typical of the flow, sqrt(g H0)."""
    threshold = REST_SPEED * speed
    times, speeds = steps["time"], steps["max_speed"]
    moving = np.flatnonzero(speeds >= threshold)
    last = int(moving[-1]) if len(moving) else -1
    duration = float(times[last + 1]) if last + 1 < len(times) else None
    return {
        "at_rest": duration is not None and duration <= (1.0 - REST_SHARE) * float(times[-1]),
        "duration": duration,
        "rest_speed": threshold,
        "final_speed": float(speeds[-1]),
    }


def energy_figures(steps: Mapping[str, NDArray[Any]], observables: Mapping[str, Vector]) -> dict[str, float]:
    """Initial and final energies (J; per metre of depth in 2D) and the largest rise of their sum in one step."""
    initial = float(observables["kinetic_energy"][0] + observables["potential_energy"][0])
    total = np.concatenate([[initial], steps["kinetic_energy"] + steps["potential_energy"]])
    return {
        "initial_energy": initial,
        "final_energy": float(total[-1]),
        "largest_energy_rise": float(max(np.diff(total).max(), 0.0) / initial),
        "energy_drop": float((initial - total[-1]) / initial),
    }


def solver_figures(steps: Mapping[str, NDArray[Any]], tolerance: float) -> dict[str, Any]:
    """Certificates and iterations of a run, over its step records (steps,)."""
    return {
        "worst_certificate": float(steps["residual"].max()),
        "tolerance": tolerance,
        "converged": bool(np.all(steps["converged"])),
        "unconverged_steps": int(np.sum(~steps["converged"].astype(bool))),
        "steps": len(steps["time"]),
        "sweeps": int(steps["sweeps"].sum()),
    }
