"""The dimensionless numbers of a granular flow inside a fluid (seed B, 8.2.5 and 8.4.3)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from barchan.errors import InputError
from barchan.flows.suspension.mixture import Mixture
from barchan.flows.suspension.values import checked

_FEWEST = 1e-9  # Volume fraction at which the drag of single grains is taken.


@dataclass(frozen=True)
class Numbers:
    """With U = sqrt(g L), or a given speed, and W the speed at which one grain settles under the closure of the drag.

    reynolds : Re = rho_f U L / eta_f.
    stokes : St = W / U, how far grains leave the fluid; |alpha| epsilon^2 Re / 18 under Stokes's drag.
    epsilon : D_g / L.
    alpha : (rho_g - rho_f) / rho_f.
    xi : Xi, drag on settling grains over the slow drag of as many single ones; (1 - phi)^(1 - nu) by Richardson and Zaki.
    regime : T_v / T_c = W eta_f / (rho_f g L D_g), the time of a viscous collapse over the one that grains need to come into
        contact; |alpha| epsilon / 18 under Stokes's drag. Small: the fluid carries the flow. From 1 on: contacts stop it.
    grain_reynolds : Re_g = rho_f W D_g / eta_f.

    Without viscosity Re and, as long as the drag is linear, W are infinite.
    """

    reynolds: float
    stokes: float
    epsilon: float
    alpha: float
    xi: float
    regime: float
    grain_reynolds: float

    def figures(self) -> dict[str, float | None]:
        """The numbers under names in words, for summaries of runs; None where infinite."""
        named = {
            "reynolds_number": self.reynolds,
            "stokes_number": self.stokes,
            "grain_size_over_length": self.epsilon,
            "relative_density_excess": self.alpha,
            "hindered_drag_over_single_grain_drag": self.xi,
            "viscous_time_over_contact_time": self.regime,
            "grain_reynolds_number": self.grain_reynolds,
        }
        return {name: value if math.isfinite(value) else None for name, value in named.items()}


def numbers(
    mixture: Mixture, length: float, gravity: float, phi: float, speed: float | None = None
) -> Numbers:
    """The numbers of a flow of size L = `length` [m] under `gravity` >= 0 [m/s^2] at a typical volume fraction `phi`.

    speed : [m/s] > 0, U of flows that gravity does not drive; without it and without gravity all but `epsilon`, `alpha` and
        `xi` are 0.

    Raises InputError for values that are not finite or out of range; phi is within [0, 1).
    """
    L = checked("numbers.length", length)
    g = checked("numbers.gravity", gravity, positive=False)
    share = checked("numbers.phi", phi, positive=False)
    if share >= 1.0:
        raise InputError("numbers.phi", phi, "below 1")
    U = math.sqrt(g * L) if speed is None else checked("numbers.speed", speed)
    W = abs(float(mixture.settling_velocity(0.0, g)))
    epsilon = mixture.grain_diameter / L
    pull = mixture.fluid_density * g * L * mixture.grain_diameter
    slow = abs(mixture.alpha) * epsilon / 18.0 if g > 0.0 else 0.0
    return Numbers(
        reynolds=_quotient(mixture.fluid_density * U * L, mixture.fluid_viscosity),
        stokes=_quotient(W, U),
        epsilon=epsilon,
        alpha=mixture.alpha,
        xi=_relative_drag(mixture, g, share),
        regime=slow if math.isinf(W) else _quotient(W * mixture.fluid_viscosity, pull),
        grain_reynolds=grain_reynolds(mixture, W),
    )


def grain_reynolds(mixture: Mixture, speed: float) -> float:
    """rho_f |w| D_g / eta_f of grains at `speed` |w| [m/s] in the fluid; infinite without viscosity."""
    return _quotient(mixture.fluid_density * speed * mixture.grain_diameter, mixture.fluid_viscosity)


def _relative_drag(mixture: Mixture, gravity: float, phi: float) -> float:
    """xi / (phi (1 - phi)) of settling grains over 18 eta_f / D_g^2; 0 without any drag."""
    share = np.array([max(phi, _FEWEST)])
    slip = np.abs(mixture.settling_velocity(share, gravity)) / (1.0 - share)
    xi = mixture.drag.coefficient(share, slip, mixture) / (share * (1.0 - share))
    return _quotient(float(xi[0]), mixture.stokes_drag)


def _quotient(part: float, whole: float) -> float:
    """part / whole of numbers >= 0: infinite for a whole of 0, and 0 for a part of 0."""
    if part == 0.0:
        return 0.0
    return part / whole if whole > 0.0 else math.inf
