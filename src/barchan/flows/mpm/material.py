"""What the granular matter is made of, and how its friction grows with the inertial number (seed B, 0.3.3 and 7.1).

Friction coefficients given by people are physical (mu_hat); cone coordinates need sqrt(2/d) mu_hat (ERRATA 1).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from barchan.errors import InputError

# What the faceted law knows nothing of.
_WITHOUT_FACETS = ("cohesion", "shear_yield", "tensile_yield", "dilatancy", "anisotropy")


@dataclass(frozen=True)
class Material:
    """Dry granular material with the mu(I) friction law and a Newtonian viscosity.

    Parameters
    ----------
    density : mass per particle volume [kg/m^3], positive. With `max_volume_fraction` = 1, particle volumes are packed bulk
        volumes and this is the bulk density; below 1 they are grain volumes and this is the density of the grains.
    friction : static friction coefficient mu_s (physical: bound of sqrt(J2)/p), >= 0.
    friction_increment : mu_D - mu_s >= 0, the growth of friction at large inertial numbers.
    inertial_reference : I_0 > 0, the inertial number at which half of the increment is reached.
    grain_diameter : d_g >= 0 [m].
    viscosity : Newtonian eta >= 0 [Pa s], in sigma = eta D(u).
    max_volume_fraction : phi_max in (0, 1].
    static_excess, static_shear_rate : loaded matter that shears slower than `static_shear_rate` [1/s] has its friction
        multiplied by 1 + `static_excess`: what has stopped takes a little more to start again. 0 (none) by default.
    cohesion : c >= 0 [Pa], tension that matter in contact bears; the yield stress is mu (p + c) (seed B, Eq. 7.1-7.2).
    cohesion_decay : xi >= 0; cohesion of deforming matter decays as dc/dt = -xi |D| c (seed B, 7.5.2).
    shear_yield, tensile_yield : stresses >= 0 [Pa] borne besides, bounds of sqrt(J2) and of the tension as a pressure. Like
        cohesion they hold in packed matter only (seed B, Remark 7.1), but do not decay.
    dilatancy : 0 <= zeta <= friction: Tr D >= 2 zeta |Dev D| where matter yields; friction is the associated flow rule.
    anisotropy : alpha in [0, 1), how much friction follows the orientation of flat grains (seed B, 7.4.2).
    elongation : l in [0, 1], how fast these turn into the flow: (L/W - 1) / (L/W + 1).
    faceted : bound each component of the deviatoric stress by mu p in the place of their norm (seed B, 7.1.1): not friction,
        but the artefact of linearised cones, to be seen. Goes with no yield stress, cohesion, dilatancy or anisotropy.
    packing_tolerance : matter within this share of phi_max is packed and bears load, in [0, 1); with 0, the seed's sharp
        criterion, contacts open and close at every step where matter rests.

    Raises
    ------
    InputError : for any value that is not finite or out of range.
    """

    density: float
    friction: float
    friction_increment: float = 0.0
    inertial_reference: float = 0.4
    grain_diameter: float = 0.0
    viscosity: float = 0.0
    max_volume_fraction: float = 1.0
    packing_tolerance: float = 0.02
    static_excess: float = 0.0
    static_shear_rate: float = 0.0
    cohesion: float = 0.0
    cohesion_decay: float = 0.0
    shear_yield: float = 0.0
    tensile_yield: float = 0.0
    dilatancy: float = 0.0
    anisotropy: float = 0.0
    elongation: float = 0.9
    faceted: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.faceted, bool):
            raise InputError("material.faceted", self.faceted, "true or false")
        positive = ("density", "inertial_reference", "max_volume_fraction")
        for field in fields(self):
            value = getattr(self, field.name)
            allowed = "a finite number > 0" if field.name in positive else "a finite number >= 0"
            try:
                number = float(value)
            except (TypeError, ValueError):
                raise InputError(f"material.{field.name}", value, allowed) from None
            if not math.isfinite(number) or number < 0.0 or (number == 0.0 and field.name in positive):
                raise InputError(f"material.{field.name}", value, allowed)
        for name in ("packing_tolerance", "anisotropy"):
            if getattr(self, name) >= 1.0:
                raise InputError(f"material.{name}", getattr(self, name), "below 1")
        if self.elongation > 1.0:
            raise InputError("material.elongation", self.elongation, "at most 1")
        if self.dilatancy > self.friction:
            raise InputError("material.dilatancy", self.dilatancy, f"at most friction ({self.friction:g})")
        if self.faceted:
            refuse_with_facets(self)
        if self.max_volume_fraction > 1.0:
            raise InputError("material.max_volume_fraction", self.max_volume_fraction, "at most 1")

    @property
    def cohesive(self) -> bool:
        """Whether matter in contact bears tension."""
        return self.cohesion > 0.0 or self.tensile_yield > 0.0

    @property
    def rate_dependent(self) -> bool:
        """Whether friction depends on the flow at all."""
        grows = self.friction_increment > 0.0 and self.grain_diameter > 0.0
        return grows or (self.static_excess > 0.0 and self.static_shear_rate > 0.0)

    def friction_at(
        self, shear_rate: NDArray[np.float64], pressure: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Physical friction coefficient mu(I) (n,), I = shear_rate d_g / sqrt(pressure / density) (seed B, 0.3.3).

        shear_rate : (n,) |Dev D(u)| = sqrt(Dev D:Dev D / 2) [1/s], half of the velocity gradient du/dy of simple shear.
        pressure : (n,) [Pa]; where it is not positive, I is infinite and mu(I) = mu_D, except without shear: mu_s.
        """
        still = (np.asarray(shear_rate) < self.static_shear_rate) & (np.asarray(pressure) > 0.0)
        factor = np.where(still, 1.0 + self.static_excess, 1.0)
        if self.friction_increment == 0.0 or self.grain_diameter == 0.0:
            return self.friction * factor
        # mu_s + (mu_D - mu_s) I / (I_0 + I), multiplied out by sqrt(p / rho) so that p -> 0 needs no division by zero.
        grain_speed = np.asarray(shear_rate) * self.grain_diameter
        reference_speed = self.inertial_reference * np.sqrt(np.maximum(pressure, 0.0) / self.density)
        total = grain_speed + reference_speed
        share = np.divide(grain_speed, total, out=np.zeros_like(total), where=total > 0.0)
        return (self.friction + self.friction_increment * share) * factor


def refuse_with_facets(material: Material) -> None:
    """InputError for a property that a faceted material, or one that shares a scene with it, cannot have."""
    for name in _WITHOUT_FACETS:
        value = getattr(material, name)
        if value > 0.0:
            raise InputError(f"material.{name}", value, "0 where a material is faceted")
