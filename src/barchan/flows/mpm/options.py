"""Numerical options of the material point method, documented one by one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Integral
from typing import Literal

from barchan.errors import InputError
from barchan.friction import methods


@dataclass(frozen=True)
class Options:
    """How a step is solved; nothing here changes the physical model.

    Parameters
    ----------
    tolerance : certificate each step's friction problem must reach; the law residual is relative to the larger of |r| and
        a stress field equal to the mean overburden (seed B, 7.5.3 stops at 1e-3 of the typical stress rho g L).
    rest_tolerance : the certificate aimed at instead (if it is smaller) in steps that begin nearly at rest, with no particle
        faster than 2 % of sqrt(g H), H being twice the mean height of the matter: what is left over by `tolerance` moves
        surface grains faster than that for ever. Missing it is no failure.
    max_sweeps : iterations after which an unconverged step is accepted as it is, and recorded so.
    min_sweeps : Gauss-Seidel sweeps made even when the stresses of the last step already meet the tolerance; without
        them matter at rest creeps, because the same small imbalance acts in every step.
    method : "gauss_seidel", or any other name of `barchan.friction.methods()`.
    cfl : largest number of cells a particle crosses in one substep of its move.
    transfer : "apic" carries velocity gradients on the particles, "pic" does not (more dissipative; seed B, 5.2.4). Steps
        that begin nearly at rest, as above, are PIC steps always: energy then decreases strictly.
    volume_correction : share of the excess volume at a node that a shift of the particles removes each step, 0 (none) to 1;
        see `volume`. Without it volume fractions drift above the maximum where matter tumbles (seed B, 7.5.4).
    viscous_tolerance : relative residual of the conjugate gradients of the viscous step (seed B, Eq. 7.22).

    Raises
    ------
    InputError : for a value out of range.
    """

    tolerance: float = 1e-4
    rest_tolerance: float = 1e-5
    max_sweeps: int = 10_000
    min_sweeps: int = 5
    method: str = "auto"
    cfl: float = 0.5
    transfer: Literal["apic", "pic"] = "apic"
    volume_correction: float = 0.3
    viscous_tolerance: float = 1e-10

    def __post_init__(self) -> None:
        for name in ("tolerance", "rest_tolerance", "cfl", "viscous_tolerance"):
            value = getattr(self, name)
            if not isinstance(value, (int, float)) or not math.isfinite(value) or value <= 0.0:
                raise InputError(f"options.{name}", value, "a finite number > 0")
        for name, least in (("max_sweeps", 1), ("min_sweeps", 0)):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, Integral) or value < least:
                raise InputError(f"options.{name}", value, f"a whole number >= {least}")
        if not isinstance(self.volume_correction, (int, float)) or not 0.0 <= self.volume_correction <= 1.0:
            raise InputError("options.volume_correction", self.volume_correction, "a number from 0 to 1")
        if self.transfer not in ("apic", "pic"):
            raise InputError("options.transfer", self.transfer, "apic or pic")
        if self.method not in methods():
            raise InputError("options.method", self.method, "one of " + ", ".join(methods()))
