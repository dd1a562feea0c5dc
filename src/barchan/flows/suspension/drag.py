"""Drag between grains and fluid: the whole coefficient xi [kg/m^3/s] of the force -xi w on the grains (seed B, 8.2.3).

Every closure follows from a measured law by the two momentum balances (8.8)-(8.9), not by the seed's single one. Grains that
settle steadily in a closed vessel have u_v = 0, so w = u_g / (1 - phi), and eliminating the pore pressure leaves

    xi |w| = phi (1 - phi) |rho_g - rho_f| g.

With the settling law u_g(phi) this is xi; with a given xi it is the settling law. `docs/suspension.md` has the steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.flows.suspension.values import checked

if TYPE_CHECKING:
    from barchan.flows.suspension.mixture import Mixture

Vector = NDArray[np.float64]

DENSEST = 0.99
"""Volume fraction beyond which drag grows no further: it would be infinite where the fluid vanishes."""

STOKES_FACTOR = 18.0
"""Drag of single spheres on the volume they fill, in eta_f / D_g^2: 3 pi eta D w over pi D^3 / 6."""


@runtime_checkable
class Drag(Protocol):
    """A closure of the drag.

    `linear` : whether the coefficient is independent of the speed, which is right while the flow around a grain is slow.
    """

    linear: ClassVar[bool]

    def coefficient(self, phi: ArrayLike, speed: ArrayLike, mixture: Mixture) -> Vector:
        """xi (n,) [kg/m^3/s] at volume fractions (n,) and speeds |w| (n,) [m/s] of grains in the fluid; zero without grains."""
        ...

    def settling_velocity(self, phi: ArrayLike, mixture: Mixture, gravity: float) -> Vector:
        """u_g (n,) [m/s], downwards, of grains that settle in a closed vessel; negative where they rise. gravity [m/s^2]."""
        ...


@dataclass(frozen=True)
class RichardsonZaki:
    """Slow flow, hindered settling: u_g = w_inf (1 - phi)^nu (seed B, Eq. 8.1), xi = 18 eta_f / D_g^2 phi (1 - phi)^(2 - nu).

    The coefficient that the seed prints, 18 eta_f / D_g^2 phi (1 - phi)^-nu, is this one with `exponent` nu + 2.

    exponent : nu >= 0; observed 4.65 in slow flow, less in fast flow.

    Raises InputError for an exponent that is not a finite number >= 0.
    """

    exponent: float = 4.65
    linear: ClassVar[bool] = True

    def __post_init__(self) -> None:
        checked("drag.exponent", self.exponent, positive=False)

    def coefficient(self, phi: ArrayLike, speed: ArrayLike, mixture: Mixture) -> Vector:
        """xi (n,) [kg/m^3/s]; see `Drag`."""
        grains, fluid = _shares(phi)
        xi = mixture.stokes_drag * grains * fluid ** (2.0 - self.exponent)
        return np.asarray(xi + np.zeros(np.shape(speed)))

    def settling_velocity(self, phi: ArrayLike, mixture: Mixture, gravity: float) -> Vector:
        """u_g (n,) [m/s]; see `Drag`."""
        return np.asarray(mixture.terminal_velocity(gravity) * _shares(phi)[1] ** self.exponent)


@dataclass(frozen=True)
class CarmanKozeny:
    """Slow seepage through packed grains, of permeability k = D_g^2 (1 - phi)^3 / (constant phi^2): Darcy's law.

    xi = (1 - phi)^2 eta_f / k = constant eta_f phi^2 / ((1 - phi) D_g^2), so that u_g = 18 / constant w_inf (1 - phi)^3 / phi.
    Grains so few that this is less than Stokes's drag on as many single ones, phi < 18 / (18 + constant) = 0.09, feel Stokes's.

    constant : > 0, observed 150 to 180.

    Raises InputError for a constant that is not a finite number > 0.
    """

    constant: float = 180.0
    linear: ClassVar[bool] = True

    def __post_init__(self) -> None:
        checked("drag.constant", self.constant)

    def coefficient(self, phi: ArrayLike, speed: ArrayLike, mixture: Mixture) -> Vector:
        """xi (n,) [kg/m^3/s]; see `Drag`."""
        grains, fluid = _shares(phi)
        xi = mixture.stokes_drag * grains * self._excess(grains, fluid)
        return np.asarray(xi + np.zeros(np.shape(speed)))

    def settling_velocity(self, phi: ArrayLike, mixture: Mixture, gravity: float) -> Vector:
        """u_g (n,) [m/s]; see `Drag`."""
        grains, fluid = _shares(phi)
        return np.asarray(mixture.terminal_velocity(gravity) * fluid**2 / self._excess(grains, fluid))

    def _excess(self, grains: Vector, fluid: Vector) -> Vector:
        """Drag over that of as many single grains."""
        return np.asarray(np.maximum(1.0, self.constant / STOKES_FACTOR * grains / fluid))


@dataclass(frozen=True)
class Quadratic:
    """Fast flow around each grain: u_g = w_q (1 - phi)^nu with w_q^2 = 4 |rho_g - rho_f| g D_g / (3 C_D rho_f).

    xi = 3/4 C_D rho_f / D_g phi |w| (1 - phi)^(3 - 2 nu): the drag C_D (pi D^2 / 4) rho_f w^2 / 2 of a sphere, hindered.
    It vanishes with w, so that it does not hold a fluid at rest in the pores.

    drag_coefficient : C_D > 0; 0.44 for spheres at Reynolds numbers of 10^3 to 10^5.
    exponent : nu >= 0; observed 2.4 in fast flow.

    Raises InputError for numbers out of range.
    """

    drag_coefficient: float = 0.44
    exponent: float = 2.4
    linear: ClassVar[bool] = False

    def __post_init__(self) -> None:
        checked("drag.drag_coefficient", self.drag_coefficient)
        checked("drag.exponent", self.exponent, positive=False)

    def coefficient(self, phi: ArrayLike, speed: ArrayLike, mixture: Mixture) -> Vector:
        """xi (n,) [kg/m^3/s]; see `Drag`."""
        grains, fluid = _shares(phi)
        single = 0.75 * self.drag_coefficient * mixture.fluid_density / mixture.grain_diameter
        return np.asarray(single * grains * np.abs(speed) * fluid ** (3.0 - 2.0 * self.exponent))

    def settling_velocity(self, phi: ArrayLike, mixture: Mixture, gravity: float) -> Vector:
        """u_g (n,) [m/s]; see `Drag`."""
        square = 4.0 * mixture.alpha * gravity * mixture.grain_diameter / (3.0 * self.drag_coefficient)
        return np.asarray(np.sign(square) * np.sqrt(abs(square)) * _shares(phi)[1] ** self.exponent)


def _shares(phi: ArrayLike) -> tuple[Vector, Vector]:
    """Volume fractions (n,) of grains and fluid, within [0, DENSEST] and [1 - DENSEST, 1]."""
    grains = np.clip(np.asarray(phi, dtype=np.float64), 0.0, DENSEST)
    return grains, 1.0 - grains
