"""From the tables of a scene to the objects of `barchan.flows.suspension`, and what is to be said about them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from barchan.errors import InputError
from barchan.flows.mpm import Material
from barchan.flows.mpm import Options as GrainOptions
from barchan.flows.suspension.checks import notes
from barchan.flows.suspension.drag import CarmanKozeny, Drag, Quadratic, RichardsonZaki
from barchan.flows.suspension.fluid_grid import penalty_for
from barchan.flows.suspension.mixture import Mixture
from barchan.flows.suspension.numbers import Numbers, numbers
from barchan.flows.suspension.options import Options
from barchan.flows.suspension.sides import Side, Sides
from barchan.flows.suspension.viscosity import (
    Constant,
    EffectiveViscosity,
    Einstein,
    FrankelAcrivos,
    KriegerDougherty,
)
from barchan.friction import methods
from barchan.scenes.granular.parameters import FACES
from barchan.scenes.kinds.suspension.entries import DragGroup, SideChoice, SidesGroup, ViscosityGroup
from barchan.scenes.kinds.suspension.parameters import SuspensionParameters

_KEYS_OF_DRAG: dict[str, dict[str, str]] = {  # key of [drag] -> argument of the closure
    "richardson_zaki": {"exponent": "exponent"},
    "carman_kozeny": {"constant": "constant"},
    "quadratic": {"exponent": "exponent", "coefficient": "coefficient_of_drag"},
}
_DRAGS: dict[str, Any] = {
    "richardson_zaki": RichardsonZaki,
    "carman_kozeny": CarmanKozeny,
    "quadratic": Quadratic,
}
_VISCOSITIES: dict[str, Any] = {
    "constant": Constant,
    "einstein": Einstein,
    "frankel_acrivos": FrankelAcrivos,
}
_NAMES = {  # what the flow calls it -> where it stands in the file
    "mixture.grains.": "grains.",
    "mixture.fluid_density": "fluid.density",
    "mixture.fluid_viscosity": "fluid.viscosity",
    "mixture.grain_diameter": "grains.diameter",
    "mixture.drag": "drag.law",
    "mixture.effective_viscosity": "viscosity.law",
    "material.": "grains.",
    "effective_viscosity.": "viscosity.",
    "options.grains.": "solver.",
    "options.": "solver.",
    "pressure": "solver.pressure",
    "penalty": "solver.penalty",
}


@contextmanager
def as_in_the_file() -> Iterator[None]:
    """Errors of the flow name the keys of the scene file."""
    try:
        yield
    except InputError as error:
        for theirs, ours in _NAMES.items():
            if error.field.startswith(theirs):
                field = ours + error.field.removeprefix(theirs)
                raise InputError(field, error.value, error.allowed) from None
        raise


def build_mixture(parameters: SuspensionParameters) -> Mixture:
    """Grains, fluid and closures. Raises InputError for numbers that do not fit each other."""
    grains, fluid = parameters.grains.model_dump(), parameters.fluid
    diameter = grains.pop("diameter")
    with as_in_the_file():
        material = Material(grain_diameter=diameter, **grains)
        return Mixture(
            material, fluid.density, fluid.viscosity, diameter,
            drag=build_drag(parameters.drag), effective_viscosity=build_viscosity(parameters.viscosity),
        )  # fmt: skip


def build_drag(table: DragGroup) -> Drag:
    """The closure of the drag. Raises InputError for a number that another closure has."""
    known = _KEYS_OF_DRAG[table.law]
    given = {key: value for key, value in table.model_dump(exclude_none=True).items() if key != "law"}
    for key, value in given.items():
        if key not in known:
            raise InputError(f"drag.{key}", value, f"left out: {table.law} knows " + ", ".join(known))
    drag: Drag = _DRAGS[table.law](**{known[key]: value for key, value in given.items()})
    return drag


def build_viscosity(table: ViscosityGroup) -> EffectiveViscosity:
    """The law of the effective viscosity. Raises InputError for an exponent of a law that has none."""
    if table.law == "krieger_dougherty":
        return KriegerDougherty(table.exponent)
    if table.exponent is not None:
        raise InputError("viscosity.exponent", table.exponent, f"left out: {table.law} has none")
    law: EffectiveViscosity = _VISCOSITIES[table.law]()
    return law


def build_sides(table: SidesGroup) -> Sides:
    """The faces of the box. Raises InputError for one that cannot be."""
    faces = {}
    for face in FACES:
        choice: SideChoice | None = getattr(table, face)
        if choice is not None:
            faces[face] = _side(face, choice)
    return Sides(faces)


def _side(face: str, choice: SideChoice) -> Side:
    if isinstance(choice, str):
        return Side(choice)
    kind = choice.kind or ("stick" if choice.friction is None else "friction")
    if choice.friction is not None and kind != "friction":
        raise InputError(f"sides.{face}.friction", choice.friction, 'left out unless kind = "friction"')
    velocity = None if choice.velocity is None else tuple(choice.velocity)
    try:
        return Side(kind, choice.friction or 0.0, velocity)
    except InputError as error:
        name = error.field.rpartition(".")[2]
        raise InputError(f"sides.{face}.{name}", error.value, error.allowed) from None


def build_suspension_options(parameters: SuspensionParameters) -> Options:
    """Solver, spaces and transfers. Raises InputError for choices that do not exist or do not fit."""
    solver, particles = parameters.solver, parameters.particles
    if solver.method not in methods():
        raise InputError("solver.method", solver.method, "one of " + ", ".join(methods()))
    with as_in_the_file():
        grains = GrainOptions(
            tolerance=solver.tolerance, max_sweeps=solver.max_sweeps, min_sweeps=solver.min_sweeps, method=solver.method,
            cfl=particles.move_cfl, transfer=particles.transfer, flip_share=particles.flip_share,
            stress=particles.stress, volume_correction=particles.volume_correction,
        )  # fmt: skip
        return Options(
            grains=grains, model=solver.model, solution=solver.solution, pressure=solver.pressure, penalty=_penalty(parameters),
            stokes_tolerance=solver.stokes_tolerance,
        )  # fmt: skip


def _penalty(parameters: SuspensionParameters) -> float | None:
    """That of the file, or one under which the hydrostatic pressure hardly compresses."""
    solver, gravity = parameters.solver, parameters.scene.gravity
    if solver.pressure != "penalised" or solver.penalty is not None:
        return solver.penalty
    if gravity == 0.0:
        raise InputError("solver.penalty", "missing", "given where there is no gravity, 1/(Pa s)")
    return penalty_for(parameters.fluid.density, gravity, parameters.height)


def remarks(parameters: SuspensionParameters) -> list[str]:
    """What a person should know before the run. Raises InputError for grains larger than a cell."""
    with as_in_the_file():
        return notes(
            build_mixture(parameters), parameters.spacing, parameters.scene.gravity, parameters.length_scale,
            darcy=parameters.solver.model == "darcy",
        )  # fmt: skip


def numbers_of(parameters: SuspensionParameters) -> Numbers:
    """The dimensionless numbers at the mean volume fraction of the matter at the start."""
    packing = [piece.packing for _, piece in parameters.pieces()]
    fraction = parameters.grains.max_volume_fraction * sum(packing) / len(packing)
    return numbers(build_mixture(parameters), parameters.length_scale, parameters.scene.gravity, fraction)
