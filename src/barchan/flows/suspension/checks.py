"""What whoever starts a simulation should be told about a mixture: refusals, and choices that do not do what one may expect."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from barchan.errors import InputError
from barchan.flows.suspension.mixture import Mixture
from barchan.flows.suspension.numbers import grain_reynolds, numbers
from barchan.flows.suspension.values import checked

SLOW = 1.0
"""Grain Reynolds number up to which Stokes's drag is right within some ten per cent."""

DARCY_LIMIT = 0.1
"""Stokes number below which the inertia of the fluctuation is negligible (seed B, 8.2.6)."""


def notes(
    mixture: Mixture,
    spacing: ArrayLike,
    gravity: float = 9.81,
    length: float | None = None,
    darcy: bool = False,
) -> list[str]:
    """Sentences about a mixture on a grid or mesh; none when there is nothing to say.

    spacing : shortest edges of the cells (any shape) [m].  gravity : >= 0 [m/s^2].
    length : size of the flow [m], when known.  darcy : whether the Darcy-like model is solved.

    Raises InputError for grains larger than a cell, and for a drag that vanishes with the speed in the Darcy-like model.
    """
    edge = float(np.min(spacing))
    if mixture.grain_diameter > edge:
        allowed = f"at most the shortest edge of a cell ({edge:g} m): a cell holds grains, not parts of one"
        raise InputError("mixture.grain_diameter", mixture.grain_diameter, allowed)
    if darcy and not mixture.drag.linear:
        allowed = "linear (RichardsonZaki, CarmanKozeny) in the Darcy-like model: only drag resists the relative motion there"
        raise InputError("mixture.drag", type(mixture.drag).__name__, allowed)
    texts = [_rise(mixture), _speed_of_grains(mixture, gravity), _two_diameters(mixture)]
    if darcy and length is not None:
        texts.append(_inertia_dropped(mixture, gravity, length))
    return [text for text in texts if text]


def _rise(mixture: Mixture) -> str:
    if mixture.alpha >= 0.0:
        return ""
    densities = f"{mixture.grains.density:g} and {mixture.fluid_density:g} kg/m^3"
    return f"The grains are lighter than the fluid ({densities}): they rise."


def _speed_of_grains(mixture: Mixture, gravity: float) -> str:
    """Whether grains settle too fast for a linear drag, or too slowly for another."""
    g = checked("gravity", gravity, positive=False)
    reached = abs(float(mixture.settling_velocity(0.0, g)))
    reynolds = grain_reynolds(mixture, reached)
    name = type(mixture.drag).__name__
    if mixture.drag.linear and reynolds > SLOW:
        return (
            f"Single grains would settle at {reached:.3g} m/s, a grain Reynolds number of {reynolds:.3g}: the linear drag of "
            f"{name} is meant for slow flow around grains, and lets these move too fast through the fluid. Quadratic drag "
            "is for such grains."
        )
    if not mixture.drag.linear and abs(mixture.terminal_velocity(g)) < reached:
        return (
            f"Single grains would settle at a grain Reynolds number of {reynolds:.3g}: so slowly that Stokes's drag, which "
            f"{name} leaves out, holds them back more. RichardsonZaki is for such grains."
        )
    return ""


def _two_diameters(mixture: Mixture) -> str:
    own = mixture.grains.grain_diameter
    if own == mixture.grain_diameter or mixture.grains.friction_increment == 0.0:
        return ""
    return f"mu(I) counts with grains of {own:g} m (grains.grain_diameter), drag with grains of {mixture.grain_diameter:g} m."


def _inertia_dropped(mixture: Mixture, gravity: float, length: float) -> str:
    stokes = numbers(mixture, length, gravity, 0.0).stokes
    if stokes <= DARCY_LIMIT:
        return ""
    return (
        f"The Stokes number is {stokes:.3g}, above {DARCY_LIMIT:g}: the inertia of the relative motion, which the Darcy-like "
        "model leaves out, counts where grains are few (seed B, 8.2.6)."
    )
