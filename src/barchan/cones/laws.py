"""Laws of dry friction and granular plasticity, block by block: Coulomb, second-order cone, Drucker-Prager.

Seed B: Coulomb (1.1), non-associated Drucker-Prager flow rule (1.19)-(1.20), De Saxce shift (Property 1.6).
Compression is positive: r = -sigma. A law knows no solver, no operator and no mesh. What depends on the Euclidean norm of r_T
is in `RoundLaw`; the law with facets, which exists to show what they do, is in faceted.py.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np

from barchan.cones import complementarity, derivatives
from barchan.cones._checks import FloatArray, as_numbers, as_step_length
from barchan.cones.complementarity import Coefficients
from barchan.errors import InputError

Parameter = float | FloatArray


@dataclass(frozen=True, eq=False)
class Law(ABC):
    """What every law shares; use `Coulomb`, `SecondOrderCone` or `DruckerPrager`.

    The flow rule puts -(u + s(u)) in the normal cone of the admissible forces at r, with a shift s(u) along e_N.

    Parameters are in normalised cone coordinates (ERRATA 1). Each is a number, the same for all blocks, or an
    array (n,), stored as a read-only float64 copy.

    Methods take the blocks u, r (relative velocity or strain rate; force or stress) as arrays (n, s), s >= 2,
    ordered (N; T...), or flat (n s,), and answer in the same shape; a flat vector needs `block_size` unless a
    parameter is an array, which tells the number of blocks. `rho` (unit of r over unit of u) is a positive
    number or an array (n,). They raise InputError on shapes that do not fit and on a `rho` that is not
    positive and finite; NaN in u or r gives NaN.
    """

    mu: Parameter

    def __post_init__(self) -> None:
        for field in fields(self):
            object.__setattr__(self, field.name, _checked_parameter(field.name, getattr(self, field.name)))
        for name, parameter in self._coefficients()._asdict().items():
            if parameter.ndim and len(parameter) != self.count:
                length = f"array of length {len(parameter)}"
                raise InputError(name, length, f"a number or of length {self.count}, as the other parameters")
        if not np.all(np.asarray(self.dilatancy) <= self.mu):
            raise InputError(
                "dilatancy", self.dilatancy, "at most the friction coefficient mu in every block"
            )

    @property
    def shear_yield(self) -> Parameter:
        """Shear stress sustained without compression (sigma_S); 0 unless the law has one."""
        return 0.0

    @property
    def tensile_yield(self) -> Parameter:
        """Normal tension sustained (tau_c); 0 unless the law has one."""
        return 0.0

    @property
    def dilatancy(self) -> Parameter:
        """Normal opening for a unit of sliding (zeta); 0 unless the law has one."""
        return 0.0

    @property
    def count(self) -> int | None:
        """Number of blocks when a parameter is an array, else None: the law fits any number of blocks."""
        for parameter in self._coefficients():
            if parameter.ndim:
                return len(parameter)
        return None

    def parameters(self, n: int) -> FloatArray:
        """Table (n, 4) of (mu, shear_yield, tensile_yield, dilatancy), C-contiguous float64, for kernels.

        Raises InputError when the law is for another number of blocks.
        """
        if self.count not in (None, n):
            raise InputError("n", n, f"{self.count}, the number of blocks of the law")
        table = np.empty((n, 4))
        for column, parameter in enumerate(self._coefficients()):
            table[:, column] = parameter
        return table

    def project(self, r: FloatArray, block_size: int | None = None) -> FloatArray:
        """Nearest admissible force of each block, in the shape of r. Source: seed B, Eq. (1.17)."""
        blocks, shape = self._blocks("r", r, block_size)
        return self._projected(blocks).reshape(shape)

    def shift(self, u: FloatArray, block_size: int | None = None) -> FloatArray:
        """De Saxce's s(u) = (mu - dilatancy) |u_T| e_N, in the shape and unit of u.

        |u_T| is the norm dual to the one that bounds r_T. Source: seed B, Property 1.6; ERRATA 3.
        """
        blocks, shape = self._blocks("u", u, block_size)
        shift = np.zeros_like(blocks)
        shift[:, 0] = self._normal_shift(blocks)
        return shift.reshape(shape)

    def natural_map(
        self, u: FloatArray, r: FloatArray, rho: Parameter, block_size: int | None = None
    ) -> FloatArray:
        """r - P(r - rho (u + s(u))), zero exactly on the law, in the shape and unit of r.

        Source: seed B, Eqs. (1.28)-(1.29), whose function has the opposite sign.
        """
        velocities, forces, steps, shape = self._pair(u, r, rho, block_size)
        trial = forces - np.asarray(steps)[..., None] * velocities
        trial[:, 0] -= steps * self._normal_shift(velocities)
        return (forces - self._projected(trial)).reshape(shape)

    def alart_curnier(
        self, u: FloatArray, r: FloatArray, rho: Parameter, block_size: int | None = None
    ) -> FloatArray:
        """Alart and Curnier's function, zero exactly on the law, in the shape and unit of r.

        Source: seed B, Eqs. (1.26)-(1.27).
        """
        velocities, forces, steps, shape = self._pair(u, r, rho, block_size)
        return self._alart_curnier(velocities, forces, steps).reshape(shape)

    def with_friction(self, mu: Parameter) -> Self:
        """The same law with another friction coefficient; raises InputError as the constructor does."""
        return replace(self, mu=mu)

    def take(self, indices: Any) -> Self:
        """The law of the selected blocks, by numpy indexing (integers, mask or slice); numbers stay numbers.

        Raises InputError on an index out of range.
        """
        taken = {}
        for field in fields(self):
            parameter = getattr(self, field.name)
            if np.ndim(parameter):
                try:
                    taken[field.name] = np.atleast_1d(parameter[indices])
                except IndexError as error:
                    raise InputError("indices", indices, f"indices of {len(parameter)} blocks") from error
        return replace(self, **taken)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Law) or type(other) is not type(self):
            return NotImplemented
        return all(map(np.array_equal, self._coefficients(), other._coefficients()))

    __hash__ = None  # type: ignore[assignment]

    def _coefficients(self) -> Coefficients:
        return Coefficients(
            np.asarray(self.mu),
            np.asarray(self.shear_yield),
            np.asarray(self.tensile_yield),
            np.asarray(self.dilatancy),
        )

    @abstractmethod
    def _projected(self, blocks: FloatArray) -> FloatArray:
        """Nearest admissible forces (n, s) of blocks (n, s)."""

    @abstractmethod
    def _normal_shift(self, velocities: FloatArray) -> FloatArray:
        """s_N (n,) of velocities (n, s)."""

    @abstractmethod
    def _alart_curnier(self, velocities: FloatArray, forces: FloatArray, steps: FloatArray) -> FloatArray:
        """Alart and Curnier's function (n, s) of blocks (n, s)."""

    def _blocks(
        self, field: str, x: FloatArray, block_size: int | None
    ) -> tuple[FloatArray, tuple[int, ...]]:
        """x as blocks (n, s), and its own shape."""
        array = as_numbers(field, x)
        given = f"array of shape {array.shape}"
        size = array.shape[1] if array.ndim == 2 and block_size is None else block_size
        if size is None and self.count is not None and array.ndim == 1:
            # No block at all fits any size.
            size = array.size // self.count if self.count else 2
        if size is None or array.ndim not in (1, 2):
            # Guessing that a flat vector is a single block would silently mix up several.
            raise InputError(field, given, "of shape (n, s), or flat with block_size given")
        if size < 2 or array.size % size or (array.ndim == 2 and array.shape[1] != size):
            raise InputError(field, given, f"made of blocks of equal size >= 2, not {size}")
        blocks = array.reshape(-1, size)
        if self.count not in (None, len(blocks)):
            raise InputError(field, given, f"made of {self.count} blocks, as the law")
        return blocks, array.shape

    def _pair(
        self, u: FloatArray, r: FloatArray, rho: Parameter, block_size: int | None
    ) -> tuple[FloatArray, FloatArray, FloatArray, tuple[int, ...]]:
        """u and r as blocks (n, s), rho checked, and the shape to answer in."""
        velocities, shape = self._blocks("u", u, block_size)
        forces, force_shape = self._blocks("r", r, block_size)
        if force_shape != shape:
            raise InputError("r", f"array of shape {force_shape}", f"of the shape of u, {shape}")
        return velocities, forces, as_step_length("rho", rho, len(forces)), shape


@dataclass(frozen=True, eq=False)
class RoundLaw(Law):
    """Laws whose admissible forces are bounded in the Euclidean norm: a second-order cone, moved and truncated.

    A force r is admissible when x = r + tensile_yield e_N has x_N >= 0 and |x_T| <= shear_yield + mu x_N.
    """

    def natural_map_jacobian(
        self, u: FloatArray, r: FloatArray, rho: Parameter, block_size: int | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Generalised Jacobian (J_u, J_r), each (n, s, s), of `natural_map`. Source: seed B, 3.1.2."""
        velocities, forces, steps, _ = self._pair(u, r, rho, block_size)
        return derivatives.natural_map_jacobian(velocities, forces, steps, self._coefficients())

    def alart_curnier_jacobian(
        self, u: FloatArray, r: FloatArray, rho: Parameter, block_size: int | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Generalised Jacobian (J_u, J_r), each (n, s, s), of `alart_curnier`. Source: seed B, 3.1.2."""
        velocities, forces, steps, _ = self._pair(u, r, rho, block_size)
        return derivatives.alart_curnier_jacobian(velocities, forces, steps, self._coefficients())

    def fischer_burmeister(
        self, u: FloatArray, r: FloatArray, rho: Parameter, block_size: int | None = None
    ) -> FloatArray:
        """Second-order-cone Fischer-Burmeister function, zero exactly on the law, in the shape and unit of r.

        Blocks with mu = 0 use the scalar function of (rho u_N, r_N) and -r_T. Raises InputError also when
        shear_yield is not 0: a truncated cone is no second-order cone. Source: seed B, Eqs. (4.1)-(4.3).
        """
        self._require_cone()
        velocities, forces, steps, shape = self._pair(u, r, rho, block_size)
        value = complementarity.fischer_burmeister(velocities, forces, steps, self._coefficients())
        return value.reshape(shape)

    def fischer_burmeister_jacobian(
        self, u: FloatArray, r: FloatArray, rho: Parameter, block_size: int | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Generalised Jacobian (J_u, J_r), each (n, s, s), of `fischer_burmeister`; same errors.

        At a kink it is one element, documented in `complementarity.fischer_burmeister_jacobian`.
        Source: seed B, B.1.1, whose two derivatives carry the opposite sign.
        """
        self._require_cone()
        velocities, forces, steps, _ = self._pair(u, r, rho, block_size)
        return complementarity.fischer_burmeister_jacobian(velocities, forces, steps, self._coefficients())

    @abstractmethod
    def convexified(self) -> RoundLaw:
        """The associated law with the same admissible forces: dilatancy = mu, hence s = 0. Seed B, 4.1.2."""

    def _require_cone(self) -> None:
        if np.any(self.shear_yield):
            allowed = (
                "0 for the Fischer-Burmeister function (a truncated cone is not self-dual up to scaling)"
            )
            raise InputError("shear_yield", self.shear_yield, allowed)

    def _projected(self, blocks: FloatArray) -> FloatArray:
        return complementarity.project_admissible(blocks, self._coefficients())

    def _normal_shift(self, velocities: FloatArray) -> FloatArray:
        return complementarity.de_saxce_shift(velocities, self._coefficients())

    def _alart_curnier(self, velocities: FloatArray, forces: FloatArray, steps: FloatArray) -> FloatArray:
        return complementarity.alart_curnier(velocities, forces, steps, self._coefficients())


@dataclass(frozen=True, eq=False)
class Coulomb(RoundLaw):
    """Coulomb friction with unilateral contact: take-off, or sticking with |r_T| <= mu r_N, or sliding.

    mu : normalised friction coefficient >= 0, number or (n,). For tensors see `normalised_friction`.
    Raises InputError on negative, infinite or NaN values. Source: seed B, Eq. (1.1).
    """

    def convexified(self) -> SecondOrderCone:
        """`SecondOrderCone` of the same coefficient. Source: seed B, 4.1.2."""
        return SecondOrderCone(self.mu)


@dataclass(frozen=True, eq=False)
class SecondOrderCone(RoundLaw):
    """The associated law, u in the dual of K_mu, r in K_mu, u . r = 0: friction with dilatancy mu, convex.

    mu : normalised friction coefficient >= 0, number or (n,).
    Raises InputError on negative, infinite or NaN values. Source: seed B, 1.2.1.
    """

    @property
    def dilatancy(self) -> Parameter:
        """Equal to mu: the flow rule is associated."""
        return self.mu

    def convexified(self) -> SecondOrderCone:
        """Itself."""
        return self


@dataclass(frozen=True, eq=False)
class DruckerPrager(RoundLaw):
    """Non-associated Drucker-Prager plasticity with tension cut-off and dilatancy, for r = -sigma.

    Parameters, each a number or an array (n,)
    ----------
    mu : normalised friction coefficient sqrt(2/d) mu_hat >= 0.
    shear_yield : shear stress sigma_S >= 0 sustained without compression (unit of r); nothing to convert.
    tensile_yield : normal tension tau_c >= 0 sustained (unit of r); sqrt(d/2) times the mean tension.
    dilatancy : zeta in [0, mu], scaled like mu; 0 keeps the volume in shear, mu is the associated law.

    Raises InputError on negative, infinite or NaN values, arrays of different lengths, a dilatancy above mu.
    Source: seed B, Eqs. (1.17), (1.19) and (1.20); ERRATA 1, 8.
    """

    shear_yield: Parameter = 0.0
    tensile_yield: Parameter = 0.0
    dilatancy: Parameter = 0.0

    def convexified(self) -> DruckerPrager:
        """The same with dilatancy = mu. Source: seed B, 1.3.3."""
        return replace(self, dilatancy=self.mu)


def _checked_parameter(name: str, value: Any) -> Parameter:
    numbers = as_numbers(name, value)
    if not np.all((numbers >= 0.0) & np.isfinite(numbers)):
        raise InputError(name, value, "non-negative and finite")
    if numbers.ndim == 0:
        return float(numbers)
    if numbers.ndim > 1:
        raise InputError(
            name, f"array of shape {numbers.shape}", "a number or an array with one value a block"
        )
    stored = numbers.copy()
    stored.flags.writeable = False
    return stored
