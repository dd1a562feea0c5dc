"""Numerical options of the material point method, documented one by one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Integral
from typing import Literal

from barchan.errors import InputError
from barchan.flows.mpm.bases import VELOCITIES
from barchan.flows.mpm.resampling import Resampling
from barchan.friction import methods

STRESSES = ("Q1", "Q1d", "P1", "P1d", "particles")


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
    velocity : basis of the velocities: "Q1" multilinear, "P1" linear on simplices, "B2" quadratic splines (`bases`).
    stress : space of the stresses: "Q1", "Q1d", "P1", "P1d" or "particles" (`stresses`). Not all pairs hold a bed at rest.
    transfer : "apic" carries velocity gradients on the particles, "pic" does not (more dissipative; seed B, 5.2.4), "flip"
        adds the change of the grid's velocity to the particle's own, `flip_share` of it, the rest being PIC. Steps
        that begin nearly at rest, as above, are PIC steps always: energy then decreases strictly.
    warm_start : where the stresses of the last step are kept: on the "grid", or carried along with the "particles".
    multilevel : start steps that have no stresses before them from those of a coarser grid, and so on (`multilevel`).
    grains : passive grains sampled in the frame of each particle and carried along, for pictures (seed B, 7.3.2).
    resampling : splits and merges of the particles (`resampling`), None for none.
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
    velocity: Literal["Q1", "P1", "B2"] = "Q1"
    stress: Literal["Q1", "Q1d", "P1", "P1d", "particles"] = "Q1"
    transfer: Literal["apic", "pic", "flip"] = "apic"
    flip_share: float = 0.95
    warm_start: Literal["grid", "particles"] = "grid"
    multilevel: bool = True
    grains: int = 0
    resampling: Resampling | None = None
    volume_correction: float = 0.3
    viscous_tolerance: float = 1e-10

    def __post_init__(self) -> None:
        for name in ("tolerance", "rest_tolerance", "cfl", "viscous_tolerance"):
            value = getattr(self, name)
            if not isinstance(value, (int, float)) or not math.isfinite(value) or value <= 0.0:
                raise InputError(f"options.{name}", value, "a finite number > 0")
        for name, least in (("max_sweeps", 1), ("min_sweeps", 0), ("grains", 0)):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, Integral) or value < least:
                raise InputError(f"options.{name}", value, f"a whole number >= {least}")
        for name in ("volume_correction", "flip_share"):
            value = getattr(self, name)
            if not isinstance(value, (int, float)) or not 0.0 <= value <= 1.0:
                raise InputError(f"options.{name}", value, "a number from 0 to 1")
        choices = {
            "velocity": VELOCITIES,
            "stress": STRESSES,
            "transfer": ("apic", "pic", "flip"),
            "warm_start": ("grid", "particles"),
        }
        for name, known in choices.items():
            if getattr(self, name) not in known:
                raise InputError(f"options.{name}", getattr(self, name), "one of " + ", ".join(known))
        if self.method not in methods():
            raise InputError("options.method", self.method, "one of " + ", ".join(methods()))
