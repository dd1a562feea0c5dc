"""Inertia and drag of grains and fluid at nodes or cells, where they are diagonal (seed B, 8.2.4 and 8.3.3).

A node holds masses m_g of grains and m_f of fluid, the drag d between them [kg/s], and steps in dt. Over a step,

    (m_g |u_g - u_g^k|^2 + m_f |u_f - u_f^k|^2) / (2 dt) + d |u_g - u_f|^2 / 2

is to be least, in competition with viscosity, pressure and contacts. In the mass average u_m and the fluctuation what (seed B,
8.3.2: u_g = u_m + what, u_f = u_m - (m_g / m_f) what) this is A |u_m|^2 / 2 + R |what|^2 / 2 and linear terms, with
A = (m_g + m_f) / dt and R = (m_g / dt + d m_m / m_f) m_m / m_f, m_m = m_g + m_f. Contacts see u_g only, and pressure and
viscosity the volume average u_v only. So we take for unknowns

    u_g   and   q = u_m - theta u_g,   theta = R / (A + R),

for which A |u_m|^2 + R |what|^2 = M_g |u_g|^2 + M_q |q|^2 with M_g = A R / (A + R) and M_q = A + R: still diagonal, while the
strain operator of the dry model serves as it is. Then u_f = e u_g + h q and u_v = a u_g + b q. A force F on u_v moves it by
F / M_v, 1 / M_v = a^2 / M_g + b^2 / M_q: the Stokes-like first step is that of one fluid of nodal masses M_v.

At walls the numbers change component by component. Where the fluid is held (no-slip beside frictional grains) q drops out and
u_f is a constant; where only the volume average is (the normal of a wall that grains may leave), u_f = -phi / (1 - phi) u_g.
The Darcy-like model (8.21) neglects the inertia of the fluctuation: R = d (m_m / m_f)^2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

FREE, HELD, FLUID_HELD, CLOSED = 0, 1, 2, 3
"""What a boundary does to a component: nothing; holds both phases; holds the fluid; lets no volume through."""

DENSEST = 0.95
"""Largest volume fraction of grains that a node is given: overpacked nodes keep a little fluid."""


@dataclass(frozen=True, eq=False)
class Phases:
    """The algebra of n nodes with d components each.

    fractions : (n,) volume fractions phi of grains.
    grain_inertia, rest_inertia : (n, d) M_g and M_q [kg/s]; 1 where there is no such unknown.
    grains_move, rest_moves : (n, d) whether u_g and q are unknowns.
    of_grains, of_rest, fixed : (n, d) e, h and the constant c of u_f = e u_g + h q + c.
    mean_share : (n, d) theta of q = u_m - theta u_g.
    """

    fractions: Vector
    grain_masses: Vector
    fluid_masses: Vector
    dt: float
    total: Vector
    fluctuation: Vector
    inertial: Vector
    grain_inertia: Vector
    rest_inertia: Vector
    grains_move: NDArray[np.bool_]
    rest_moves: NDArray[np.bool_]
    of_grains: Vector
    of_rest: Vector
    fixed: Vector
    mean_share: Vector
    held: Vector

    @property
    def a(self) -> Vector:
        """(n, d) part of u_g in the volume average; 0 where u_g is given or there are no grains."""
        phi = self.fractions[:, None]
        return np.where(self.grains_move, phi + (1.0 - phi) * self.of_grains, 0.0)

    @property
    def b(self) -> Vector:
        """(n, d) part of q in the volume average: beta where q is an unknown, else 0."""
        return np.where(self.rest_moves, (1.0 - self.fractions[:, None]) * self.of_rest, 0.0)

    @property
    def given(self) -> Vector:
        """(n, d) what the volume average has whatever the unknowns are."""
        phi = self.fractions[:, None]
        held_grains = np.where(self.grains_move, 0.0, self.held)
        return phi * held_grains + (1.0 - phi) * (self.of_grains * held_grains + self.fixed)

    @property
    def volume_compliance(self) -> Vector:
        """(n, d) 1 / M_v [s/kg] of the volume average; 0 where it is given."""
        a, b = self.a, self.b
        return np.asarray(a**2 / self.grain_inertia + b**2 / self.rest_inertia)

    def volume_average(self, grains: Vector, rest: Vector) -> Vector:
        """u_v (n, d) of the unknowns."""
        return self.a * grains + self.b * rest + self.given

    def fluid(self, grains: Vector, rest: Vector) -> Vector:
        """u_f (n, d) of the unknowns."""
        own = np.where(self.grains_move, grains, self.held)
        return self.of_grains * own + np.where(self.rest_moves, self.of_rest * rest, 0.0) + self.fixed

    def predicted(self, grains: Vector, fluid: Vector, gravity: Vector) -> tuple[Vector, Vector]:
        """Unknowns (u_g*, q*) after a step with inertia, gravity (d,) and drag alone, from velocities (n, d) of the phases.

        Without an unknown the rows of u_g* are the held velocity and those of q* zero.
        """
        mass_g, mass_f = self.grain_masses[:, None], self.fluid_masses[:, None]
        whole = mass_g + mass_f
        mean = (mass_g * grains + mass_f * fluid) / whole + self.dt * gravity
        before = mass_f / whole * (grains - fluid)
        inertial, R, A = self.inertial[:, None], self.fluctuation[:, None], self.total[:, None]
        slip = np.divide(
            inertial * before, R, out=np.zeros_like(before), where=np.broadcast_to(R > 0.0, before.shape)
        )
        both_grains = mean + slip
        both_rest = mean - self.mean_share * both_grains
        # One unknown: u_m = g u_g + m_f c / m_m and what = s u_g - (m_f / m_m) c.
        e, c, share = self.of_grains, self.fixed, mass_f / whole
        g, s = (mass_g + mass_f * e) / whole, share * (1.0 - e)
        load = A * g * (mean - share * c) + s * (inertial * before + R * share * c)
        one = load / self.grain_inertia
        u = np.where(self.rest_moves, both_grains, one)
        return np.where(self.grains_move, u, self.held), np.where(self.rest_moves, both_rest, 0.0)

    def with_volume_force(self, grains: Vector, rest: Vector, force: Vector) -> tuple[Vector, Vector]:
        """Unknowns after a force F (n, d) [N] on the volume average."""
        return grains + self.a * force / self.grain_inertia, rest + self.b * force / self.rest_inertia


def phases(
    grain_masses: Vector,
    fluid_masses: Vector,
    fractions: Vector,
    drag: Vector,
    dt: float,
    dimension: int,
    boundary: NDArray[np.int8] | None = None,
    held: Vector | None = None,
    darcy: bool = False,
) -> Phases:
    """The algebra of nodes with masses (n,) [kg], volume fractions (n,) and drag (n,) [kg/s] over a step of `dt` seconds.

    boundary : (n, d) of FREE, HELD, FLUID_HELD, CLOSED; None: free.  held : (n, d) the velocity of the boundary [m/s].
    darcy : neglect the inertia of the fluctuation (seed B, Eq. 8.21).
    """
    n = len(grain_masses)
    kind = np.zeros((n, dimension), np.int8) if boundary is None else boundary
    value = np.zeros((n, dimension)) if held is None else held
    whole = grain_masses + fluid_masses
    ratio = whole / fluid_masses
    total = whole / dt
    inertial = np.zeros(n) if darcy else grain_masses * ratio / dt
    R = inertial + drag * ratio**2
    grains_there = (grain_masses > 0.0) & (R > 0.0)
    theta = R / (total + R)
    phi, wall = fractions[:, None], value
    e_free, h_free = (theta - grain_masses / fluid_masses * (1.0 - theta))[:, None], ratio[:, None]
    e = np.where(kind == FREE, e_free, np.where(kind == CLOSED, -phi / (1.0 - phi), 0.0))
    h = np.where(kind == FREE, np.broadcast_to(h_free, kind.shape), 0.0)
    c = np.where(kind == FREE, 0.0, np.where(kind == CLOSED, wall / (1.0 - phi), wall))
    grains_move = grains_there[:, None] & (kind != HELD)
    rest_moves = kind == FREE
    share = (fluid_masses / whole)[:, None]
    g, s = (grain_masses[:, None] + fluid_masses[:, None] * e) / whole[:, None], share * (1.0 - e)
    single = total[:, None] * g**2 + R[:, None] * s**2
    both = (total * R / (total + R))[:, None]
    grain_inertia = np.where(grains_move, np.where(rest_moves, both, single), 1.0)
    rest_inertia = np.where(rest_moves, (total + R)[:, None], 1.0)
    # Without grains u_f is the only velocity: e counts for nothing, u_f = h q + c with h = 1.
    e = np.where(grains_there[:, None] | (kind != FREE), e, 0.0)
    e = np.where(grains_there[:, None], e, 0.0)
    return Phases(
        fractions, grain_masses, fluid_masses, dt, total, R, inertial, grain_inertia, rest_inertia, grains_move, rest_moves,
        e, h, c, np.broadcast_to(theta[:, None], kind.shape), value,
    )  # fmt: skip
