"""Plane shear at fixed pressure: one point of the friction law mu(I) from grains (seed C, 3.2.1; da Cruz et al. 2005).

Lees-Edwards images shear the cell, a piston keeps the normal stress: no walls, so the flow is the same everywhere in the mean.
Lengths are in grain diameters, densities in grain densities, stresses in the pressure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.coarse_graining.rheology import effective_friction, inertial_number
from barchan.bodies.coarse_graining.virial import VolumeMean, volume_mean
from barchan.bodies.rigid import inputs
from barchan.bodies.soft.cell import Cell, Piston
from barchan.bodies.soft.laws import Hookean
from barchan.bodies.soft.model import SoftSpheres
from barchan.bodies.soft.packing import lattice_packing
from barchan.bodies.soft.state import SoftState
from barchan.errors import InputError

Vector = NDArray[np.float64]
_LOOSE = 1.15  # edge of the lattice cells at the start, in largest diameters
_BLOCKS = 8  # of the time series, for the standard errors
_STEP = 1.0 / 20.0  # of the contact duration


@dataclass(frozen=True, eq=False)
class ShearAverage:
    """Steady plane shear, averaged over strain; `_error` are standard errors of block means.

    inertial_number : |Dev D| d sqrt(rho / p), half of what du/dy would give (as `flows.mpm.Material`). friction :
    sqrt(J2) / p. stress (d, d), compression positive. wall_friction : |sigma_xy| / sigma_yy, what a wall would feel.
    volume_fraction,
    coordination, temperature : as `VolumeMean`. strain : over which it was averaged. samples : how many states.
    """

    inertial_number: float
    friction: float
    friction_error: float
    wall_friction: float
    volume_fraction: float
    volume_fraction_error: float
    coordination: float
    temperature: float
    stress: Vector
    strain: float
    samples: int

    @property
    def disc_inertial_number(self) -> float:
        """gamma' sqrt(m / P) of da Cruz et al. for discs of mass m = rho pi d^2 / 4."""
        return self.inertial_number * math.sqrt(math.pi)


class PlaneShear:
    """Grains of mean diameter 1 and density 1 under pressure 1, sheared at du/dy = 2 I.

    inertial_number : I > 0, |Dev D| d sqrt(rho / P). count : grains. dimension : 2 or 3.
    friction, restitution : of contacts. stiffness : k_n / (P d^(d-2)), 1e4 for rigid grains. spread : diameters are
    uniform in 1 -+ spread.
    aspect : height of the cell over its length, about. seed : of sizes and places.
    """

    def __init__(
        self,
        inertial_number: float,
        count: int = 1000,
        dimension: int = 2,
        friction: float = 0.4,
        restitution: float = 0.1,
        stiffness: float = 1e4,
        spread: float = 0.2,
        aspect: float = 1.0,
        seed: int = 0,
    ) -> None:
        if dimension not in (2, 3):
            raise InputError("dimension", dimension, "2 or 3")
        if not isinstance(count, int) or count < 50:
            raise InputError("count", count, "a whole number of at least 50")
        if not 0.0 <= spread < 1.0:
            raise InputError("spread", spread, "at least 0 and below 1")
        self.shear_rate = 2.0 * inputs.positive("inertial_number", inertial_number)
        radii = 0.5 * np.random.default_rng(seed).uniform(1.0 - spread, 1.0 + spread, count)
        edge = _LOOSE * 2.0 * float(np.max(radii))
        across = math.ceil((count / inputs.positive("aspect", aspect)) ** (1.0 / dimension))
        lengths = np.full(dimension, edge * across)
        lengths[-1] = edge * math.ceil(count / across ** (dimension - 1))
        # a plate as heavy as a tenth of the grains, damped in about the time a wave takes through them
        mass = 0.1 * float(np.sum(np.pi / 6.0 * (2.0 * radii) ** dimension)) / across ** (dimension - 1)
        piston = Piston(1.0, mass, math.sqrt(lengths[-1] * mass))
        self.spheres = SoftSpheres(
            radii,
            1.0,
            Hookean.of_restitution(inputs.positive("stiffness", stiffness), restitution, 0.5),
            friction,
            gravity=np.zeros(dimension),
            cell=Cell(lengths, None, self.shear_rate, piston),
        )
        self._lengths = lengths
        self._seed = seed

    def start(self) -> SoftState:
        """Loose grains moving with the flow."""
        x = lattice_packing(self.spheres.radii, np.zeros_like(self._lengths), self._lengths, self._seed)
        v = np.zeros_like(x)
        v[:, 0] = self.shear_rate * (x[:, -1] - 0.5 * self._lengths[-1])
        return self.spheres.start(x, v)

    def settled(self, strain: float = 2.5) -> SoftState:
        """Steady flow: from `start`, sheared by `strain`, or by more where the piston needs longer to come to rest."""
        return self.sheared(self.start(), max(strain, self.shear_rate * self._lengths[-1]))

    def volume(self, state: SoftState) -> float:
        """Volume of the cell."""
        return float(np.prod(self._lengths[:-1]) * state.cell.height)

    def mean(self, state: SoftState) -> VolumeMean:
        """Means over the cell in one state."""
        gradient = np.zeros((self.spheres.dimension, self.spheres.dimension))
        gradient[0, -1] = self.shear_rate
        return volume_mean(*self.spheres.grains(state), self.volume(state), gradient)

    def sheared(self, state: SoftState, strain: float) -> SoftState:
        """State after the shear `strain` du/dy dt."""
        dt = self.spheres.time_step(share=_STEP)
        return self.spheres.advance(state, dt, round(strain / (self.shear_rate * dt)))

    def averaged(
        self, state: SoftState, strain: float = 5.0, samples: int = 400
    ) -> tuple[SoftState, ShearAverage]:
        """Shear by `strain` and average over `samples` states on the way."""
        if samples < _BLOCKS:
            raise InputError("samples", samples, f"at least {_BLOCKS}")
        inputs.positive("strain", strain)
        means, fractions = [], []
        for _ in range(samples):
            state = self.sheared(state, strain / samples)
            means.append(self.mean(state))
            fractions.append(means[-1].volume_fraction)
        stresses = np.array([mean.stress for mean in means])
        stress = np.mean(stresses, axis=0)
        friction = float(effective_friction(stress[None])[0])
        blocks = [np.mean(part, axis=0) for part in np.array_split(stresses, _BLOCKS)]
        parts = effective_friction(np.array(blocks))
        rate = np.zeros_like(stress)
        rate[0, -1] = self.shear_rate
        number = inertial_number(rate[None], np.array([np.trace(stress) / len(stress)]), 1.0, 1.0)
        average = ShearAverage(
            float(number[0]),
            friction,
            float(np.std(parts, ddof=1) / math.sqrt(_BLOCKS)),
            float(abs(stress[0, -1]) / stress[-1, -1]),
            float(np.mean(fractions)),
            float(
                np.std([np.mean(f) for f in np.array_split(fractions, _BLOCKS)], ddof=1) / math.sqrt(_BLOCKS)
            ),
            float(np.mean([mean.coordination for mean in means])),
            float(np.mean([mean.temperature for mean in means])),
            stress,
            strain,
            samples,
        )
        return state, average
