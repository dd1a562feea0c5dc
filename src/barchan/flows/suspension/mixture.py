"""What a mixture of grains and a Newtonian fluid is made of (seed B, 8.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.errors import InputError
from barchan.flows.mpm.material import Material
from barchan.flows.suspension.drag import STOKES_FACTOR, Drag, RichardsonZaki
from barchan.flows.suspension.values import checked
from barchan.flows.suspension.viscosity import Constant, EffectiveViscosity

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Mixture:
    """Grains inside a Newtonian fluid.

    Parameters
    ----------
    grains : their friction, cohesion and so on (`barchan.flows.mpm.Material`); `density` is that of the grains themselves,
        rho_g, and `max_volume_fraction` phi_max is below 1. `viscosity` is 0, since the fluid's acts. A `grain_diameter` of 0
        becomes that of the mixture; another one counts for mu(I) alone.
    fluid_density : rho_f > 0 [kg/m^3].
    fluid_viscosity : eta_f >= 0 [Pa s]; without it only `Quadratic` drag is left.
    grain_diameter : D_g > 0 [m], for the drag.
    drag : closure of xi; `RichardsonZaki`, `CarmanKozeny`, `Quadratic` or any `Drag`.
    effective_viscosity : law of eta_eff; `Constant`, `Einstein`, `KriegerDougherty`, `FrankelAcrivos` or another such law.

    Grains lighter than the fluid are allowed: they rise.

    Raises
    ------
    InputError : for a value that is not finite or out of range, or grains that fill space or have a viscosity.
    """

    grains: Material
    fluid_density: float
    fluid_viscosity: float
    grain_diameter: float
    drag: Drag = field(default_factory=RichardsonZaki)
    effective_viscosity: EffectiveViscosity = field(default_factory=Constant)

    def __post_init__(self) -> None:
        if not isinstance(self.grains, Material):
            raise InputError("mixture.grains", self.grains, "a barchan.flows.mpm.Material")
        if self.grains.max_volume_fraction >= 1.0:
            allowed = "below 1: the fluid needs room between the grains"
            raise InputError("mixture.grains.max_volume_fraction", self.grains.max_volume_fraction, allowed)
        if self.grains.viscosity > 0.0:
            allowed = "0: inside a fluid its viscosity acts (fluid_viscosity)"
            raise InputError("mixture.grains.viscosity", self.grains.viscosity, allowed)
        for name in ("fluid_density", "fluid_viscosity", "grain_diameter"):
            value = checked(f"mixture.{name}", getattr(self, name), positive=name != "fluid_viscosity")
            object.__setattr__(self, name, value)
        if not isinstance(self.drag, Drag) or isinstance(self.drag, type):
            raise InputError(
                "mixture.drag", self.drag, "RichardsonZaki, CarmanKozeny, Quadratic or another Drag"
            )
        law = self.effective_viscosity
        if not isinstance(law, EffectiveViscosity) or isinstance(law, type):
            allowed = "Constant, Einstein, KriegerDougherty, FrankelAcrivos or another EffectiveViscosity"
            raise InputError("mixture.effective_viscosity", law, allowed)
        if self.grains.grain_diameter == 0.0:
            object.__setattr__(self, "grains", replace(self.grains, grain_diameter=self.grain_diameter))

    @property
    def alpha(self) -> float:
        """(rho_g - rho_f) / rho_f, the relative excess of density; negative where grains rise."""
        return (self.grains.density - self.fluid_density) / self.fluid_density

    @property
    def stokes_drag(self) -> float:
        """18 eta_f / D_g^2 [kg/m^3/s]: slow drag of single grains on the volume they fill."""
        return STOKES_FACTOR * self.fluid_viscosity / self.grain_diameter**2

    def terminal_velocity(self, gravity: float) -> float:
        """w_inf [m/s] of a single grain under Stokes's drag, downwards; negative where grains rise. gravity [m/s^2].

        Infinite in a fluid without viscosity, unless nothing drives the grain.
        """
        weight = self.alpha * self.fluid_density * gravity
        if self.fluid_viscosity == 0.0:
            return math.copysign(math.inf, weight) if weight != 0.0 else 0.0
        return weight / self.stokes_drag

    def settling_velocity(self, phi: ArrayLike, gravity: float) -> Vector:
        """u_g (n,) [m/s], downwards, of grains at volume fractions (n,) in a closed vessel, by the closure of the drag."""
        return self.drag.settling_velocity(phi, self, gravity)
