"""Matrices of a dense flow before boundary conditions, cached while nothing they depend on changes (seed A, 4.2 and 5.2)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from barchan.cones import DruckerPrager
from barchan.errors import InputError
from barchan.flows.dense.conditions import Condition, Pressure, Stress
from barchan.flows.dense.material import Material, RateViscosity
from barchan.flows.dense.reduction import Reduction, free_rigid_motions
from barchan.flows.dense.walls import Walls
from barchan.spaces.mixed import MixedSpace, strain_basis

SMALLEST_STRESS = 1e-3
"""Share of the stress scale at which a residual of the law becomes relative to the scale, no longer to the stresses."""

ANCHOR = 0.1
"""Weight of the drag towards the previous iterate, in units of viscosity / extent^2."""


@dataclass(frozen=True, eq=False)
class Operator:
    """Momentum matrix before and after the reduction. full : (size, size).  reduced : (m, m).
    lifted : (size,) full times the prescribed velocity, which moves to the right-hand side."""

    full: sp.csr_array
    reduced: sp.csr_array
    lifted: np.ndarray


class Assembly:
    """Everything linear about a flow: strain and wall rates, viscosity, mass and loads."""

    def __init__(
        self, space: MixedSpace, material: Material, conditions: Mapping[str, Condition],
        gravity: np.ndarray, reduction: Reduction, walls: Walls,
    ) -> None:  # fmt: skip
        self.space, self.material, self.conditions = space, material, conditions
        self.gravity, self.reduction, self.walls = gravity, reduction, walls
        self.held = free_rigid_motions(space, reduction) == 0
        self._operators: dict[float | None, Operator] = {}

    @property
    def blocks(self) -> int:
        """Number of blocks: points of the law, then wall points."""
        return self.space.n + self.walls.count

    @cached_property
    def rates(self) -> sp.csr_array:
        """(blocks s, size) rows of strain rates and wall velocities of any velocity of the space."""
        if self.walls.count == 0:
            return self.space.rates
        return sp.csr_array(sp.vstack([self.space.rates, self.walls.rates], format="csr"))

    @cached_property
    def reduced_rates(self) -> sp.csr_array:
        """H of the friction problem (blocks s, m)."""
        return self.reduction.columns(self.rates)

    @cached_property
    def drift(self) -> np.ndarray:
        """w of the friction problem (blocks s,): rates of the prescribed velocities, less those of the walls."""
        drift = self.rates @ self.reduction.prescribed
        drift[self.space.n * self.space.s :] += self.walls.drift
        return np.asarray(drift)

    @cached_property
    def load(self) -> np.ndarray:
        """(size,) gravity and external stresses: integral of rho g.v, plus that of (sigma_ext n).v over the boundary.

        The seeds print a minus before the second integral; with sigma_ext the stress the surroundings exert (tension
        positive), so that sigma_tot n = sigma_ext n, integration by parts gives a plus.
        """
        points = self.space.velocity_points
        density = self.material.sampled("density", points)
        load = self.space.load(density[:, None] * self.gravity)
        for name, condition in self.conditions.items():
            if isinstance(condition, (Stress, Pressure)):
                load += self.space.boundary_load(name, condition.at)
        return load

    @cached_property
    def stress_scale(self) -> float:
        """Largest stress that gravity, external stresses and moving boundaries can cause in order of magnitude."""
        space = self.space
        extent = float(np.ptp(space.mesh.p, axis=1).max())
        density = float(self.material.sampled("density", space.velocity_points).max(initial=0.0))
        scales = [density * float(np.linalg.norm(self.gravity)) * extent]
        for name, condition in self.conditions.items():
            if isinstance(condition, (Stress, Pressure)):
                nodes = space.nodes[space.boundary_nodes(name)]
                scales.append(float(np.abs(condition.at(nodes)).max(initial=0.0)))
        speed = float(np.abs(self.reduction.prescribed).max(initial=0.0))
        scales.append(float(self.viscosity().max(initial=0.0)) * speed / extent)
        return max(scales)

    @property
    def reference_force(self) -> float:
        """Norm of stresses below which the certificate is absolute: a flow may have no contact stresses to compare with."""
        return float(SMALLEST_STRESS * self.stress_scale * np.sqrt(self.blocks))

    @cached_property
    def mass(self) -> sp.csr_array:
        """(size, size) mass matrix."""
        return self.space.mass(self._density)

    @cached_property
    def _density(self) -> np.ndarray:
        density = self.material.sampled("density", self.space.velocity_points)
        if density.min(initial=np.inf) <= 0.0:
            raise InputError("material.density", f"{density.min():g}", "> 0 for flows with inertia")
        return density

    @cached_property
    def anchor(self) -> sp.csr_array:
        """(size, size) weak drag towards the previous iterate, of a steady flow that only friction at walls holds.

        Viscosity does not resist its rigid motions. With anchor v = anchor v_before on both sides each solve is well posed,
        and at a fixed point the drag has vanished (proximal point method).
        """
        extent = float(np.ptp(self.space.mesh.p, axis=1).max())
        return self.space.mass(ANCHOR * float(self.viscosity().max(initial=0.0)) / extent**2)

    def inertial_load(self, arriving: np.ndarray, dt: float) -> np.ndarray:
        """(size,) (1 / dt) integral of rho (u o X).v from the velocities (n, d) that arrive at `velocity_points`."""
        return self.space.load(self._density[:, None] * arriving) / dt

    def shear_rates(self, v: np.ndarray) -> np.ndarray:
        """(n,) |D(u)| = sqrt(D:D / 2) at the viscous points [1/time]."""
        tables, d = self.space.viscous_tables, self.space.dimension
        nodal = np.asarray(v).reshape(-1, d)[self.space.cell_nodes]
        strain = 0.5 * np.einsum("scg,epkg,ekc->eps", strain_basis(d), tables.gradients, nodal, optimize=True)
        return np.asarray(np.linalg.norm(strain, axis=-1).reshape(-1))

    def viscosity(self, shear_rate: np.ndarray | None = None) -> np.ndarray:
        """(n,) viscosities at the viscous points, of the flow's shear rates there when they depend on them."""
        points = self.space.viscous_tables.flat_points
        if isinstance(self.material.viscosity, RateViscosity):
            law = self.material.viscosity
            rates = np.full(len(points), law.reference_rate) if shear_rate is None else shear_rate
            return law.at(rates)
        return self.material.sampled("viscosity", points)

    def operator(self, dt: float | None, viscosity: np.ndarray | None = None) -> Operator:
        """Momentum matrix of a steady flow (dt None) or of a step; kept for the next call unless `viscosity` is given.

        viscosity : (n,) at the viscous points, where it depends on the flow.
        Raises InputError for a steady flow somewhere without viscosity, or that nothing holds.
        """
        if dt is None and not self.held and self.walls.count == 0:
            allowed = "such that velocities are held somewhere: without inertia nothing else resists"
            raise InputError("conditions", "parts that leave rigid motions free", allowed)
        if viscosity is None and dt in self._operators:
            return self._operators[dt]
        eta = self.viscosity() if viscosity is None else viscosity
        if dt is None and eta.min(initial=np.inf) <= 0.0:
            raise InputError(
                "material.viscosity", f"{eta.min():g}", "> 0 in creeping flow, where nothing else resists"
            )
        full = self.space.viscous(eta, self.material.bulk)
        if dt is not None:
            full = sp.csr_array(full + self.mass / dt)
        elif not self.held:
            full = sp.csr_array(full + self.anchor)
        made = Operator(full, self.reduction.square(full), full @ self.reduction.prescribed)
        if viscosity is None:
            # One time step length at a time: a stepper that changes dt should not keep every matrix it ever used.
            self._operators = {key: kept for key, kept in self._operators.items() if key is None}
            self._operators[dt] = made
        return made

    def law(self, forces: np.ndarray | None = None, v: np.ndarray | None = None) -> DruckerPrager:
        """Law of every block; mu(I) takes the shear rates of v and the pressures of `forces` (blocks, s), or rest."""
        space = self.space
        shear = pressure = None
        if v is not None and forces is not None:
            shear = np.linalg.norm(space.strain_rates(v)[:, 1:], axis=1)
            pressure = np.sqrt(2.0 / space.dimension) * forces[: space.n, 0]
        law = self.material.law_at(space.points, shear, pressure)
        if self.walls.count == 0:
            return law
        none = np.zeros(self.walls.count)
        parts: list[Any] = [(law.mu, self.walls.mu), (law.shear_yield, none), (law.tensile_yield, none)]
        parts.append((law.dilatancy, none))
        return DruckerPrager(*(np.concatenate(part) for part in parts))
