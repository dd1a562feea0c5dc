"""Cross-section and matter of rods: what a length of fibre weighs, and how it resists (Kirchhoff rods; Bergou et al. 2010)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.errors import InputError

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Section:
    """Cross-section of rods: one number for all fibres, or one for each (f,).

    radius : [m], of the tube in which contact happens.
    mass : [kg/m].  inertia : about the centre line [kg m].
    bending : (2, 2) or (f, 2, 2) [N m^2], symmetric, positive definite: moment of a curvature in the plane of the tangent and
        the first material direction, and of the second.
    twisting : [N m^2].  stretching : [N].
    """

    radius: Vector
    mass: Vector
    inertia: Vector
    bending: Vector
    twisting: Vector
    stretching: Vector

    def __post_init__(self) -> None:
        for name in ("radius", "mass", "inertia", "twisting", "stretching"):
            object.__setattr__(self, name, _positive(f"section.{name}", getattr(self, name)))
        bending = np.array(self.bending, dtype=np.float64)
        allowed = "symmetric positive definite, (2, 2) or (f, 2, 2) [N m^2]"
        if bending.ndim not in (2, 3) or bending.shape[-2:] != (2, 2) or not np.all(np.isfinite(bending)):
            raise InputError("section.bending", bending.tolist(), allowed)
        if np.any(np.linalg.eigvalsh(bending)[..., 0] <= 0.0) or not np.allclose(
            bending, np.swapaxes(bending, -1, -2), rtol=1e-9, atol=0.0
        ):
            raise InputError("section.bending", bending.tolist(), allowed)
        object.__setattr__(self, "bending", bending)

    @classmethod
    def circular(
        cls,
        radius: ArrayLike,
        *,
        density: ArrayLike,
        young: ArrayLike,
        shear: ArrayLike | None = None,
        poisson: float | None = None,
    ) -> Section:
        """Section of radius [m], density [kg/m^3], Young's modulus [Pa] and a shear modulus [Pa] or Poisson's ratio.

        Poisson's ratio is 0.5, of hair and rubber, when neither is given.
        """
        return cls.elliptic(radius, radius, density=density, young=young, shear=shear, poisson=poisson)

    @classmethod
    def elliptic(
        cls,
        first: ArrayLike,
        second: ArrayLike,
        *,
        density: ArrayLike,
        young: ArrayLike,
        shear: ArrayLike | None = None,
        poisson: float | None = None,
    ) -> Section:
        """Section of semi-axes `first` and `second` [m] along the material directions; its tube has the larger for radius.

        Twisting stiffness pi G a^3 b^3 / (a^2 + b^2) (Saint-Venant).
        """
        a, b = _positive("section.first", first), _positive("section.second", second)
        rho, modulus = _positive("section.density", density), _positive("section.young", young)
        rigidity = _shear_modulus(modulus, shear, poisson)
        area, in_first, in_second = np.pi * a * b, np.pi * a**3 * b / 4.0, np.pi * a * b**3 / 4.0
        bending = np.zeros((*np.broadcast(modulus, area).shape, 2, 2))
        bending[..., 0, 0], bending[..., 1, 1] = modulus * in_first, modulus * in_second
        twisting = np.pi * rigidity * a**3 * b**3 / (a * a + b * b)
        inertia = rho * (in_first + in_second)
        return cls(np.maximum(a, b), rho * area, inertia, bending, twisting, modulus * area)

    def for_fibres(self, count: int) -> Section:
        """The same with a number for each of `count` fibres; InputError when other numbers are given."""
        own = {}
        for name in ("radius", "mass", "inertia", "twisting", "stretching", "bending"):
            value = getattr(self, name)
            tail = (2, 2) if name == "bending" else ()
            if value.shape not in (tail, (count, *tail)):
                raise InputError(f"section.{name}", value.shape, f"for one fibre or for {count}")
            own[name] = np.ascontiguousarray(np.broadcast_to(value, (count, *tail)))
        return Section(**own)


def _positive(name: str, value: ArrayLike) -> Vector:
    """Finite positive number () or numbers (f,)."""
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(name, value, "a positive number, or one for each fibre") from None
    if array.ndim > 1 or not np.all(np.isfinite(array)) or np.any(array <= 0.0):
        raise InputError(name, array.tolist(), "positive and finite: one number, or one for each fibre")
    return array


def _shear_modulus(young: Vector, shear: ArrayLike | None, poisson: float | None) -> Vector:
    """Shear modulus [Pa] from what was given."""
    if shear is not None and poisson is not None:
        raise InputError("section.poisson", poisson, "left out when the shear modulus is given")
    if shear is not None:
        return _positive("section.shear", shear)
    ratio = 0.5 if poisson is None else float(poisson)
    if not -1.0 < ratio <= 0.5:
        raise InputError("section.poisson", poisson, "above -1, at most 0.5")
    modulus: Vector = young / (2.0 * (1.0 + ratio))
    return modulus
