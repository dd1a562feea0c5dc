"""How a container empties: the discharge between 0.9 and 0.2 of the initial volume, and whether it is constant.

The hourglass effect (seed B 7.2.3): the discharge of grains stays constant as long as the volume V lies in
[0.9 V0, 0.2 V0], that of a fluid falls.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

WINDOW = (0.9, 0.2)
PARTS = 4  # of the window, whose discharges are compared


def discharge_figures(times: Vector, volumes: Vector) -> dict[str, Any]:
    """Figures of the volume (frames,) m^d left at `times` (frames,) s.

    `discharge` is the slope of the straight line through the window (m^d/s), None when the window is not passed through;
    `discharge_variation` is the largest deviation of the discharge of a quarter of the window (by volume) from it, relative,
    and `discharge_trend` the discharge of the last quarter over that of the first.
    """
    share = volumes / volumes[0]
    rates, mean = part_rates(times, share), mean_discharge(times, volumes, WINDOW)
    if rates is None or mean is None:
        return {
            "discharge": None,
            "discharge_variation": None,
            "discharge_trend": None,
            "share_left": float(share[-1]),
        }
    return {
        "discharge": mean,
        "discharge_variation": float(np.abs(rates * volumes[0] / mean - 1.0).max()),
        "discharge_trend": float(rates[-1] / rates[0]),
        "share_left": float(share[-1]),
    }


def mean_discharge(times: Vector, volumes: Vector, window: tuple[float, float]) -> float | None:
    """Mean discharge (m^d/s) while `volumes` (frames,) fall from the first to the second share of the initial one.

    None when they have not fallen so far.
    """
    share = volumes / volumes[0]
    if share.min() > window[1]:
        return None
    took = crossing(times, share, window[1]) - crossing(times, share, window[0])
    return float((window[0] - window[1]) * volumes[0] / took)


def part_rates(times: Vector, share: Vector) -> Vector | None:
    """Discharge (PARTS,) of each part of the window, in initial volumes per second; None when it is not passed through."""
    if share.min() > WINDOW[1]:
        return None
    cuts = np.linspace(*WINDOW, PARTS + 1)
    moments = np.array([crossing(times, share, cut) for cut in cuts])
    return np.asarray(-np.diff(cuts) / np.maximum(np.diff(moments), 1e-300))


def crossing(times: Vector, share: Vector, level: float) -> float:
    """The time at which `share` first falls to `level`, by linear interpolation between frames; it must do so."""
    last = int(np.argmax(share <= level))
    if last == 0:
        return float(times[0])
    low, high = share[last], share[last - 1]
    return float(times[last] - (level - low) / (high - low) * (times[last] - times[last - 1]))
