"""What a cloth is made of: stiffness, thickness, mass, damping, friction."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from barchan.bodies.rigid import inputs
from barchan.errors import InputError

MEMBRANES = ("stvk", "springs")


@dataclass(frozen=True)
class ClothMaterial:
    """An elastic sheet.

    young_modulus : E [Pa] of stretching.  poisson_ratio : nu, of stretching with "stvk".  thickness : h [m] of the sheet, which
    is also how near two layers come.  area_density : [kg/m^2].
    membrane : "stvk" (Saint Venant and Kirchhoff on triangles), or "springs" along edges, which fix nu near 1/3.
    bending_stiffness : D [N m]; left out: E h^3 / (12 (1 - nu^2)).  Cloth bends more easily than a solid sheet.
    mass_damping : [1/s], stiffness_damping : [s] of Rayleigh's damping, times M and K.
    friction : physical coefficient of the surface.

    Raises InputError for a value out of range.
    """

    young_modulus: float = 1e5
    poisson_ratio: float = 0.3
    thickness: float = 1e-3
    area_density: float = 0.2
    membrane: Literal["stvk", "springs"] = "stvk"
    bending_stiffness: float | None = None
    mass_damping: float = 0.0
    stiffness_damping: float = 0.0
    friction: float = 0.5

    def __post_init__(self) -> None:
        for name in ("young_modulus", "thickness", "area_density"):
            inputs.positive(f"material.{name}", getattr(self, name))
        for name in ("mass_damping", "stiffness_damping", "friction"):
            inputs.not_negative(f"material.{name}", getattr(self, name))
        if self.bending_stiffness is not None:
            inputs.not_negative("material.bending_stiffness", self.bending_stiffness)
        if not (math.isfinite(self.poisson_ratio) and -1.0 < self.poisson_ratio <= 0.5):
            raise InputError("material.poisson_ratio", self.poisson_ratio, "above -1 and at most 0.5")
        if self.membrane not in MEMBRANES:
            raise InputError("material.membrane", self.membrane, "one of " + ", ".join(MEMBRANES))

    @property
    def membrane_stiffness(self) -> float:
        """E h [N/m]."""
        return self.young_modulus * self.thickness

    @property
    def flexural_rigidity(self) -> float:
        """D [N m]."""
        if self.bending_stiffness is not None:
            return self.bending_stiffness
        return self.young_modulus * self.thickness**3 / (12.0 * (1.0 - self.poisson_ratio**2))
