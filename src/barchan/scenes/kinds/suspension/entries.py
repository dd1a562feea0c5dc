"""The tables of a scene of kind "suspension": grains, fluid, closures, faces of the box, pieces of matter (seed B, chapter 8).

SI units; friction coefficients are physical (ERRATA 1); positions are those of centres, sizes full lengths.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field

from barchan.scenes.granular.parameters import SolverGroup, TimeGroup
from barchan.scenes.kinds.sand.entries import Piece, Share
from barchan.scenes.parameters import Group, NotNegative, Positive


class GrainsGroup(Group):
    """[grains]"""

    density: Positive = Field(description="density rho_g of the grains themselves, kg/m^3")
    diameter: Positive = Field(description="grain diameter D_g, of drag and mu(I), m")
    max_volume_fraction: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(
        default=0.6, description="volume fraction phi_max of packed grains"
    )
    friction: NotNegative = Field(
        default=0.4, description="friction coefficient at rest mu_s (2D: sine of the friction angle)"
    )
    friction_increment: NotNegative = Field(
        default=0.0, description="mu_D - mu_s: more friction in rapid flow"
    )
    inertial_reference: Positive = Field(
        default=0.4, description="inertial number I0 at which half of that is reached"
    )
    packing_tolerance: Annotated[float, Field(ge=0.0, lt=1.0)] = Field(
        default=0.02, description="matter within this share of phi_max counts as packed and bears load"
    )
    static_excess: NotNegative = Field(
        default=0.0, description="relative excess of friction where loaded matter hardly shears"
    )
    static_shear_rate: NotNegative = Field(default=0.0, description="shear rate below which it acts, 1/s")
    dilatancy: NotNegative = Field(default=0.0, description="expansion per shear, at most the friction")


class FluidGroup(Group):
    """[fluid]"""

    density: Positive = Field(default=1000.0, description="density rho_f, kg/m^3")
    viscosity: Positive = Field(default=1e-3, description="viscosity eta_f, Pa s")


class DragGroup(Group):
    """[drag]"""

    law: Literal["richardson_zaki", "carman_kozeny", "quadratic"] = Field(
        default="richardson_zaki", description="closure of the drag between grains and fluid"
    )
    exponent: NotNegative | None = Field(
        default=None, description="nu of hindered settling; left out: 4.65, of quadratic drag 2.4"
    )
    constant: Positive | None = Field(default=None, description="of Carman and Kozeny; left out: 180")
    coefficient: Positive | None = Field(
        default=None, description="C_D of quadratic drag; left out: 0.44, spheres in fast flow"
    )


class ViscosityGroup(Group):
    """[viscosity]"""

    law: Literal["constant", "einstein", "krieger_dougherty", "frankel_acrivos"] = Field(
        default="constant", description="how grains stiffen the fluid"
    )
    exponent: Positive | None = Field(
        default=None, description="of Krieger and Dougherty; left out: 5/2 phi_max"
    )


class SuspendedPiece(Piece):
    """A piece of [matter]."""

    packing: Annotated[float, Field(gt=0.0, le=1.0)] = Field(
        default=1.0, description="volume fraction of the grains over phi_max"
    )
    scatter: Share = Field(
        default=0.0,
        description="how far particles are from their lattice at random, over half its spacing: uneven from the start",
    )
    ripple: float = Field(
        default=0.0, description="amplitude of a wave along x of the upper or lower face of a box, m"
    )
    half_waves: Annotated[int, Field(ge=1)] = Field(
        default=2, description="half waves of it in the box: cos(half_waves pi x / length), upwards at x = 0"
    )
    rippled: Literal["bottom", "top"] = Field(default="bottom", description="the face that has the wave")


class SuspendedMatter(Group):
    """[matter]: the name of a piece of matter -> where it is at the start."""

    model_config = ConfigDict(extra="allow")
    entries = SuspendedPiece

    __pydantic_extra__: dict[str, SuspendedPiece] = Field(init=False)


class SideTable(Group):
    """A face with a number of its own: friction with the grains, or the velocity of the wall or of what crosses it."""

    kind: Literal["stick", "slip", "friction"] | None = None
    friction: NotNegative | None = None
    velocity: list[float] | None = None


SideChoice = Literal["stick", "slip", "open"] | SideTable


def side_key(default: str | None, description: str) -> Any:
    """A key of [sides]."""
    accepted = (
        '"stick", "slip", "open", {friction = F} with F a finite number >= 0, or {velocity = [...]} of a wall that sticks '
        '(kind = "slip": of what crosses the face), m/s'
    )
    return Field(default=default, description=description, json_schema_extra={"accepted": accepted})


class SidesGroup(Group):
    """[sides]: what the faces do to fluid and grains."""

    x_min: SideChoice = side_key(
        "slip", "wall at x = 0; through an open face matter leaves, the pore pressure is 0 outside"
    )
    x_max: SideChoice = side_key("slip", "wall opposite")
    y_min: SideChoice | None = side_key(None, "side wall (3D only)")
    y_max: SideChoice | None = side_key(None, "side wall (3D only)")
    z_min: SideChoice = side_key("stick", "floor")
    z_max: SideChoice = side_key("slip", "lid")


class SuspensionTime(TimeGroup):
    """[time]"""

    fluid_cfl: Positive = Field(
        default=4.0, description="cells the fastest fluid may cross in an adaptive step"
    )
    rest_speed: NotNegative = Field(
        default=0.0, description="the run ends at a frame when no grain is faster than this, m/s; 0: never"
    )


class SuspensionSolver(SolverGroup):
    """[solver]"""

    model: Literal["two_phase", "darcy"] = Field(
        default="two_phase", description="with or without the inertia of the relative motion"
    )
    solution: Literal["two_step", "coupled"] = Field(
        default="two_step", description="viscosity first and contacts then, or both at once (small problems)"
    )
    pressure: Literal["layers", "coarse", "penalised"] = Field(
        default="layers", description="space of the pore pressure"
    )
    penalty: Positive | None = Field(
        default=None,
        description="of penalised pressures, div u_v = -penalty p; left out: 1e-3 sqrt(g/H) / (rho_f g H), 1/(Pa s)",
    )
    stokes_tolerance: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(
        default=1e-7, description="relative residual of the viscous step"
    )


class SuspensionParticles(Group):
    """[particles]"""

    per_cell: Annotated[int, Field(ge=1, le=16)] = Field(
        default=3, description="particles along each axis of a cell"
    )
    transfer: Literal["apic", "pic", "flip"] = Field(
        default="apic", description="velocity transfer; apic keeps angular momentum"
    )
    flip_share: Share = Field(
        default=0.95, description="share of the change of velocity in flip, the rest pic"
    )
    stress: Literal["Q1", "Q1d", "particles", "P1", "P1d"] = Field(
        default="Q1", description="stress space: on nodes, in cells (d), on particles"
    )
    seed: Annotated[int, Field(ge=0)] = Field(
        default=0, description="of the random numbers of scattered matter"
    )
    volume_correction: Share = Field(default=0.3, description="share of excess volume removed in a step")
    move_cfl: Positive = Field(default=0.5, description="cells a particle may cross in a substep of its move")


class SuspensionObserve(Group):
    """[observe]"""

    length: Positive | None = Field(default=None, description="length L0 that run-outs are relative to, m")
    height: Positive | None = Field(default=None, description="height H0 that heights are relative to, m")
    back: float = Field(default=0.0, description="abscissa that the front is measured from, m")
    scale: Positive | None = Field(
        default=None,
        description="length L of the dimensionless numbers; left out: `height`, or the height of the box, m",
    )
    half_waves: Annotated[int, Field(ge=0)] = Field(
        default=0, description="half waves along x of the interface whose amplitude is measured; 0: none"
    )
    settled_share: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(
        default=0.01,
        description="grains have settled when the potential energy stays within this share of its drop",
    )
